//! Zarr, version 3: a folder of chunks with their description, after <https://zarr-specs.readthedocs.io>, as xarray opens it.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use rayon::prelude::*;
use serde_json::{Map, Value, json};

use super::{Cube, CubeFacts};
use crate::FormatError;
use crate::store::output::write_atomically;
use fluorspar::image::{ComponentImage, FeatureMaps, LightPath};
use fluorspar::spectral::WavelengthGrid;

/// Longest side of a chunk along `y` and `x`, and along `wavelength`.
const CHUNK: [usize; 2] = [128, 16];

/// Writes the cube into a folder: `radiance` or `irradiance` with `wavelength`, and `depth`, `normal` and `part` where they are known.
pub(super) fn write_zarr(folder: &Path, cube: &Cube) -> Result<(), FormatError> {
    let mut group = Group::new(folder);
    let ([width, height], grid) = (cube.light.size(), cube.light.grid());
    let (name, attributes) = match cube.light.is_radiance() {
        true => ("radiance", json!({ "units": "W m-2 sr-1 nm-1", "long_name": "spectral radiance" })),
        false => {
            ("irradiance", json!({ "units": "W m-2 nm-1", "long_name": "spectral irradiance on the film" }))
        }
    };
    let axes = [("y", height), ("x", width), ("wavelength", grid.len())];
    group.floats(name, &axes, cube.light.values(), attributes)?;
    group.wavelengths(grid)?;
    group.maps([width, height], &cube.facts.maps)?;
    group.finish(attributes_of(&cube.facts))
}

/// Writes a component image into a folder: `radiance` `[component, y, x, wavelength]`, its labels and the maps.
///
/// # Errors
/// A file that can't be written.
pub fn write_component_zarr(
    folder: &Path,
    image: &ComponentImage,
    facts: &CubeFacts,
) -> Result<(), FormatError> {
    let mut group = Group::new(folder);
    let (count, width, height) = (image.components.len(), image.width, image.height);
    let axes = [("component", count), ("y", height), ("x", width), ("wavelength", image.grid.len())];
    let attributes = json!({
        "units": "W m-2 sr-1 nm-1",
        "long_name": "spectral radiance",
        "coordinates": "light_group path",
    });
    group.floats("radiance", &axes, &image.all_values(), attributes)?;
    let path = |light: &LightPath| match light {
        LightPath::Reflected => "reflected".to_owned(),
        LightPath::Fluorescence(name) => name.clone(),
        LightPath::MultipleFluorescence => "multiple".to_owned(),
    };
    let of_components = [
        ("component", image.components.iter().map(|c| c.label()).collect::<Vec<_>>()),
        ("light_group", image.components.iter().map(|c| c.group_label()).collect()),
        ("path", image.components.iter().map(|c| path(&c.light)).collect()),
    ];
    for (name, texts) in of_components {
        group.texts(name, ("component", count), &texts)?;
    }
    group.wavelengths(&image.grid)?;
    group.maps([width, height], &image.features)?;
    group.finish(attributes_of(facts))
}

/// A group in the making.
pub(super) struct Group<'a> {
    folder: &'a Path,
    /// Descriptions of its arrays by name.
    arrays: Map<String, Value>,
}

/// Name and length of each axis.
pub(super) type Axes<'a> = [(&'a str, usize)];

impl<'a> Group<'a> {
    pub(super) fn new(folder: &'a Path) -> Self {
        Self { folder, arrays: Map::new() }
    }

    pub(super) fn floats(
        &mut self,
        name: &str,
        axes: &Axes<'_>,
        values: &[f32],
        attributes: Value,
    ) -> Result<(), FormatError> {
        self.array(name, ("float32", json!(0.0)), axes, values, f32::to_le_bytes, attributes)
    }

    fn wavelengths(&mut self, grid: &WavelengthGrid) -> Result<(), FormatError> {
        let attributes =
            json!({ "units": "nm", "long_name": "center of the band", "edges": grid.edges_nm() });
        let axes = [("wavelength", grid.len())];
        self.array(
            "wavelength",
            ("float64", json!(0.0)),
            &axes,
            &grid.centers_nm(),
            f64::to_le_bytes,
            attributes,
        )
    }

    /// Maps of an image, as far as it has them.
    fn maps(&mut self, [width, height]: [usize; 2], maps: &FeatureMaps) -> Result<(), FormatError> {
        let axes = [("y", height), ("x", width), ("axis", 3)];
        let fills = |length: usize| length == width * height && length > 0;
        if fills(maps.depth_m.len()) {
            let attributes = json!({ "units": "m", "long_name": "distance along the camera ray" });
            self.floats("depth", &axes[..2], &maps.depth_m, attributes)?;
        }
        if fills(maps.normal.len()) {
            let attributes =
                json!({ "units": "1", "long_name": "shading normal in the coordinates of the scene" });
            self.floats("normal", &axes, maps.normal.as_flattened(), attributes)?;
        }
        if fills(maps.part.len()) {
            let attributes = json!({
                "names": maps.part_names,
                "materials": maps.material_names,
                "long_name": "index into names plus one",
            });
            self.array("part", ("uint16", json!(0)), &axes[..2], &maps.part, u16::to_le_bytes, attributes)?;
        }
        Ok(())
    }

    /// An array of numbers, in chunks; those at the ends are filled up.
    fn array<T: Copy + Sync, const N: usize>(
        &mut self,
        name: &str,
        (kind, fill): (&str, Value),
        axes: &Axes<'_>,
        values: &[T],
        bytes: impl Fn(T) -> [u8; N] + Sync,
        attributes: Value,
    ) -> Result<(), FormatError> {
        let shape: Vec<usize> = axes.iter().map(|(_, length)| *length).collect();
        let side = |(axis, length): &(&str, usize)| match *axis {
            "component" | "c" => 1,
            "wavelength" if axes.len() > 1 => CHUNK[1].min(*length),
            "y" | "x" => CHUNK[0].min(*length),
            _ => *length,
        };
        let chunk: Vec<usize> = axes.iter().map(side).collect();
        let counts: Vec<usize> = shape.iter().zip(&chunk).map(|(all, one)| all.div_ceil(*one)).collect();
        (0..counts.iter().product()).into_par_iter().try_for_each(|number| {
            let place = unravel(number, &counts);
            let content = chunk_content(values, &bytes, (&shape, &chunk, &place));
            self.write_chunk(name, &place, &content)
        })?;
        let codec = json!({ "name": "bytes", "configuration": { "endian": "little" } });
        self.describe(name, (kind, fill, codec), axes, &chunk, attributes)
    }

    /// A vector of texts in one chunk: their number, then the length and bytes of each.
    fn texts(&mut self, name: &str, axis: (&str, usize), texts: &[String]) -> Result<(), FormatError> {
        let mut content = (texts.len() as u32).to_le_bytes().to_vec();
        for text in texts {
            content.extend((text.len() as u32).to_le_bytes());
            content.extend(text.as_bytes());
        }
        self.write_chunk(name, &[0], &content)?;
        let codec = json!({ "name": "vlen-utf8" });
        self.describe(name, ("string", json!(""), codec), &[axis], &[axis.1], json!({}))
    }

    fn write_chunk(&self, name: &str, place: &[usize], content: &[u8]) -> Result<(), FormatError> {
        let parts = place.iter().map(usize::to_string);
        let path = parts.fold(self.folder.join(name).join("c"), |path, part| path.join(part));
        let folder = path.parent().unwrap_or(self.folder);
        std::fs::create_dir_all(folder).map_err(|error| FormatError::io(folder, "create", error))?;
        write_atomically(&path, |file| {
            let mut packed = GzEncoder::new(file, Compression::fast());
            packed.write_all(content)?;
            packed.finish().map(|_| ())
        })
    }

    fn describe(
        &mut self,
        name: &str,
        (kind, fill, codec): (&str, Value, Value),
        axes: &Axes<'_>,
        chunk: &[usize],
        attributes: Value,
    ) -> Result<(), FormatError> {
        let described = json!({
            "zarr_format": 3,
            "node_type": "array",
            "shape": axes.iter().map(|(_, length)| length).collect::<Vec<_>>(),
            "data_type": kind,
            "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": chunk } },
            "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
            "fill_value": fill,
            "codecs": [codec, { "name": "gzip", "configuration": { "level": 1 } }],
            "dimension_names": axes.iter().map(|(axis, _)| axis).collect::<Vec<_>>(),
            "attributes": attributes,
            "storage_transformers": [],
        });
        write_json(&self.folder.join(name).join("zarr.json"), &described)?;
        self.arrays.insert(name.into(), described);
        Ok(())
    }

    /// Writes the description of the group, in which those of its arrays are repeated, so that one file is enough to open it.
    pub(super) fn finish(self, attributes: Value) -> Result<(), FormatError> {
        let described = json!({
            "zarr_format": 3,
            "node_type": "group",
            "attributes": attributes,
            "consolidated_metadata": { "kind": "inline", "must_understand": false, "metadata": self.arrays },
        });
        write_json(&self.folder.join("zarr.json"), &described)
    }
}

/// Facts by name, those that are known.
fn attributes_of(facts: &CubeFacts) -> Value {
    let mut all = Map::new();
    let mut put = |name: &str, value: Value| {
        if !value.is_null() {
            all.insert(name.into(), value);
        }
    };
    put("title", json!(facts.title));
    put("capture", json!(facts.capture));
    put("mm_per_pixel", json!(facts.mm_per_pixel));
    put("distance_m", json!(facts.distance_m));
    put("samples_per_pixel", json!(facts.samples_per_pixel));
    put("camera_matrix_px", json!(facts.camera_matrix_px));
    if let Some(view) = facts.maps.view {
        put("camera_position_m", json!(view.position_m));
        put("camera_forward", json!(view.forward));
        put("camera_right", json!(view.right));
    }
    if let Some(provenance) = &facts.provenance {
        put("fluorspar", json!(provenance.version));
        put("sha256", json!(provenance.experiment_sha256));
        put("toml", json!(provenance.resolved_experiment_toml));
    }
    Value::Object(all)
}

fn write_json(path: &Path, value: &Value) -> Result<(), FormatError> {
    write_atomically(path, |file| Ok(serde_json::to_writer_pretty(file, value)?))
}

/// Index along each axis of an element by its number, the last axis fastest.
fn unravel(mut number: usize, shape: &[usize]) -> Vec<usize> {
    let mut place = vec![0; shape.len()];
    for (at, length) in place.iter_mut().zip(shape).rev() {
        (*at, number) = (number % length, number / length);
    }
    place
}

/// The bytes of a chunk at its place; what lies beyond the array is 0. Runs along the last axis are copied whole.
fn chunk_content<T: Copy, const N: usize>(
    values: &[T],
    bytes: &impl Fn(T) -> [u8; N],
    (shape, chunk, place): (&[usize], &[usize], &[usize]),
) -> Vec<u8> {
    let last = shape.len() - 1;
    let first = place[last] * chunk[last];
    let length = chunk[last].min(shape[last] - first);
    let mut content = vec![0; N * chunk.iter().product::<usize>()];
    for (number, run) in content.chunks_exact_mut(N * chunk[last]).enumerate() {
        let within = unravel(number, &chunk[..last]);
        let mut at =
            within.iter().zip(place).zip(chunk).map(|((at, place), one)| at + place * one).zip(shape);
        let row = at.try_fold(0, |row, (at, length)| (at < *length).then_some(row * length + at));
        let Some(row) = row else { continue };
        let start = row * shape[last] + first;
        for (place, value) in run.chunks_exact_mut(N).zip(&values[start..start + length]) {
            place.copy_from_slice(&bytes(*value));
        }
    }
    content
}
