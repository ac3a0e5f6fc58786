//! Mouths and maps that were made already, kept by the digest of their parameters.

use std::sync::{Arc, Mutex};

use sha2::{Digest, Sha256};

use super::parameters::ParameterError;
use super::{Mouth, MouthParameters, SurfaceMap, Tissue, bake_surface_map};

type Key = [u8; 32];

/// The most recent results, newest last.
struct Recent<T> {
    kept: Mutex<Vec<(Key, Arc<T>)>>,
    most: usize,
}

impl<T> Recent<T> {
    const fn new(most: usize) -> Self {
        Self { kept: Mutex::new(Vec::new()), most }
    }

    fn get(&self, key: &Key) -> Option<Arc<T>> {
        let kept = self.kept.lock().ok()?;
        kept.iter().find(|(other, _)| other == key).map(|(_, value)| Arc::clone(value))
    }

    fn put(&self, key: Key, value: &Arc<T>) {
        if let Ok(mut kept) = self.kept.lock() {
            kept.retain(|(other, _)| *other != key);
            kept.push((key, Arc::clone(value)));
            if kept.len() > self.most {
                kept.remove(0);
            }
        }
    }
}

static MOUTHS: Recent<Mouth> = Recent::new(2);
static MAPS: Recent<BakedMap> = Recent::new(64);

/// Everything that a mouth depends on, but for the program that makes it: equal texts, equal bits.
fn mouth_key(parameters: &MouthParameters) -> String {
    // Debug text of finite numbers is exact: it reads back to the same bits.
    format!("mouth 3 {parameters:?}")
}

/// [`crate::generate_mouth`], or the same mouth again if it was made a short while ago by this process. `make` makes it; its
/// argument is a text of everything that the mouth depends on.
///
/// # Errors
/// Those of `make`.
pub fn shared_mouth(
    parameters: &MouthParameters,
    make: impl FnOnce(&str) -> Result<Mouth, ParameterError>,
) -> Result<Arc<Mouth>, ParameterError> {
    let text = mouth_key(parameters);
    let key: Key = Sha256::digest(text.as_bytes()).into();
    if let Some(mouth) = MOUTHS.get(&key) {
        return Ok(mouth);
    }
    let mouth = Arc::new(make(&text)?);
    MOUTHS.put(key, &mouth);
    Ok(mouth)
}

/// A map over texture coordinates as an image: rows from the top, values 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct BakedMap {
    /// Columns.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Values, row by row.
    pub values: Vec<f32>,
}

impl BakedMap {
    /// The map as bytes, for a cache: columns and rows, then the values.
    pub fn to_bytes(&self) -> Vec<u8> {
        let sizes = [self.columns as u32, self.rows as u32].into_iter().flat_map(u32::to_le_bytes);
        sizes.chain(self.values.iter().flat_map(|value| value.to_le_bytes())).collect()
    }

    /// The map of [`BakedMap::to_bytes`]; `None` for other bytes.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (words, rest) = bytes.as_chunks::<4>();
        let [columns, rows, values @ ..] = words else { return None };
        let [columns, rows] = [columns, rows].map(|word| u32::from_le_bytes(*word) as usize);
        let is_whole = rest.is_empty() && columns.checked_mul(rows) == Some(values.len());
        let values = values.iter().map(|word| f32::from_le_bytes(*word)).collect();
        is_whole.then_some(Self { columns, rows, values })
    }
}

/// A map of a tissue as an image, fine enough for its papillae or vessels at a level of detail of 1 and coarser below, as
/// the meshes are; kept for the next call. Where it is not there yet, `make` gives it: by its second argument, or the same map,
/// which the first one tells from all others, from where it was kept.
pub fn shared_surface_map(
    map: SurfaceMap,
    tissue: Tissue,
    parameters: &MouthParameters,
    make: impl FnOnce(&str, &dyn Fn() -> BakedMap) -> BakedMap,
) -> Arc<BakedMap> {
    let shape = shape_of_maps(parameters);
    let text = format!("map 3 {map:?} {tissue:?} {shape:?}");
    let key: Key = Sha256::digest(text.as_bytes()).into();
    if let Some(baked) = MAPS.get(&key) {
        return baked;
    }
    let [columns, rows] = map_size(tissue, shape.detail);
    let bake = || {
        let values = bake_surface_map(map, tissue, parameters, columns, rows);
        BakedMap { columns, rows, values }
    };
    let baked = Arc::new(make(&text, &bake));
    MAPS.put(key, &baked);
    baked
}

/// What maps depend on: sizes, seed, teeth, plaque and detail alone, not poses and meshes.
fn shape_of_maps(parameters: &MouthParameters) -> MouthParameters {
    MouthParameters {
        seed: parameters.seed,
        tongue_width_mm: parameters.tongue_width_mm,
        tongue_length_mm: parameters.tongue_length_mm,
        tooth_scale: parameters.tooth_scale,
        tooth_shade: parameters.tooth_shade,
        plaque: parameters.plaque,
        detail: parameters.detail.clamp(0.25, 1.0),
        ..MouthParameters::default()
    }
}

/// Columns and rows of the map of a tissue.
fn map_size(tissue: Tissue, detail: f64) -> [usize; 2] {
    let sides = match tissue {
        Tissue::TongueDorsum => [448.0, 640.0],
        _ => [256.0, 256.0],
    };
    sides.map(|side: f64| (side * detail).round() as usize)
}
