//! Solved light transport that is kept from one run to the next.

use std::fmt;
use std::sync::Arc;

use super::effective_tissue::{EffectiveTissue, Solution};
use super::layered_tissue::LayeredTissue;
use super::{DiscreteOrdinates, TissueError};

/// A place where bytes are kept under a key, for instance a folder. It may forget, and must not give what is damaged.
pub trait SolutionStore: Send + Sync {
    /// What was kept under the key.
    fn get(&self, key: &[u8]) -> Option<Vec<u8>>;
    /// Keeps bytes under a key, if it can.
    fn put(&self, key: &[u8], bytes: &[u8]);
}

/// Where solutions are kept, if anywhere. It changes no result, so that any two are equal.
#[derive(Clone, Default)]
pub struct CachedSolutions(Option<Arc<dyn SolutionStore>>);

impl CachedSolutions {
    /// Those in a store.
    #[must_use]
    pub fn new(store: Arc<dyn SolutionStore>) -> Self {
        Self(Some(store))
    }

    /// Solves several tissues at the same wavelengths, as [`EffectiveTissue::new`] does, or finds their solutions. What is kept
    /// goes by the optical properties of all layers at all wavelengths, on which alone the light depends.
    ///
    /// # Errors
    /// Those of [`EffectiveTissue::new`].
    pub fn solve(
        &self,
        tissues: &[LayeredTissue],
        wavelengths_nm: &[f64],
        solver: DiscreteOrdinates,
    ) -> Result<Vec<EffectiveTissue>, TissueError> {
        let solve = || EffectiveTissue::several(tissues, wavelengths_nm, solver);
        let Some(store) = &self.0 else { return solve() };
        let key = key(tissues, wavelengths_nm, solver);
        if let Some(found) = store.get(&key).and_then(|bytes| read(&bytes, tissues, wavelengths_nm)) {
            return Ok(found);
        }
        let solved = solve()?;
        store.put(&key, &written(&solved));
        Ok(solved)
    }
}

impl fmt::Debug for CachedSolutions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "CachedSolutions(in a store)" } else { "CachedSolutions(nowhere)" })
    }
}

impl PartialEq for CachedSolutions {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

fn key(tissues: &[LayeredTissue], wavelengths_nm: &[f64], solver: DiscreteOrdinates) -> Vec<u8> {
    let mut key = format!("{solver:?} {} {}", tissues.len(), wavelengths_nm.len()).into_bytes();
    let mut add = |value: f64| key.extend(value.to_bits().to_le_bytes());
    for &nm in wavelengths_nm {
        add(nm);
        for tissue in tissues {
            let stack = tissue.optics(nm);
            add(stack.layers.len() as f64);
            add(stack.index_below);
            for layer in &stack.layers {
                add(layer.thickness_mm);
                add(layer.absorption_per_mm);
                add(layer.scattering_per_mm);
                add(layer.anisotropy);
                add(layer.refractive_index);
            }
        }
    }
    key
}

/// All numbers of all solutions in their order.
fn written(solved: &[EffectiveTissue]) -> Vec<u8> {
    let solutions = solved.iter().flat_map(EffectiveTissue::solutions);
    solutions.flat_map(Solution::values).flat_map(f64::to_le_bytes).collect()
}

fn read(bytes: &[u8], tissues: &[LayeredTissue], wavelengths_nm: &[f64]) -> Option<Vec<EffectiveTissue>> {
    let mut values = bytes.chunks_exact(8).map(|bytes| bytes.try_into().map_or(f64::NAN, f64::from_le_bytes));
    let found: Vec<EffectiveTissue> = tissues
        .iter()
        .map(|tissue| EffectiveTissue::of_values(tissue, wavelengths_nm, &mut values))
        .collect::<Option<_>>()?;
    (values.next().is_none() && bytes.len().is_multiple_of(8)).then_some(found)
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::tissue::{
        Below, Blood, Chromophore, LayerScattering, Level, ScatteringCoefficient, TissueLayer,
    };

    #[derive(Default)]
    struct Memory {
        kept: Mutex<Vec<(Vec<u8>, Vec<u8>)>>,
        found: AtomicUsize,
    }

    impl SolutionStore for Memory {
        fn get(&self, key: &[u8]) -> Option<Vec<u8>> {
            let kept = self.kept.lock().unwrap();
            let found = kept.iter().rev().find(|(other, _)| other == key).map(|(_, bytes)| bytes.clone());
            self.found.fetch_add(usize::from(found.is_some()), Ordering::Relaxed);
            found
        }

        fn put(&self, key: &[u8], bytes: &[u8]) {
            self.kept.lock().unwrap().push((key.into(), bytes.into()));
        }
    }

    /// One layer, and two with so much blood in the second.
    fn tissues(volume_fraction: f64) -> Vec<LayeredTissue> {
        let blood =
            Blood { volume_fraction, saturation: 0.9, hemoglobin_g_per_l: 150.0, vessel_radius_um: 10.0 };
        let layer = |name: &str, absorption| TissueLayer {
            name: name.into(),
            thickness_um: 300.0,
            scattering: LayerScattering {
                coefficient: ScatteringCoefficient::PowerLaw {
                    scattering_per_mm: 19.0,
                    at_nm: 500.0,
                    power: 1.2,
                },
                anisotropy: 0.88,
            },
            absorption,
            fluorophores: Vec::new(),
            refractive_index: None,
        };
        let of = |layers| LayeredTissue { layers, refractive_index: 1.4, below: Below::Black };
        let above = layer("epithelium", Vec::new());
        vec![of(vec![above.clone()]), of(vec![above, layer("stroma", vec![Chromophore::Blood(blood)])])]
    }

    #[test]
    fn what_is_kept_is_what_was_solved_to_the_bit_and_of_these_tissues_alone() {
        let memory = Arc::new(Memory::default());
        let kept = CachedSolutions::new(memory.clone());
        let nm = [450.0, 500.0, 600.0];
        let curves = |kept: &CachedSolutions, tissues: &[LayeredTissue]| {
            let solved = kept.solve(tissues, &nm, DiscreteOrdinates::DIFFUSE).unwrap();
            solved.iter().map(|tissue| tissue.reflectance(Level::AboveSurface)).collect::<Vec<_>>()
        };
        let first = curves(&kept, &tissues(0.05));
        assert_eq!(memory.found.load(Ordering::Relaxed), 0);
        assert_eq!(curves(&kept, &tissues(0.05)), first);
        assert_eq!(memory.found.load(Ordering::Relaxed), 1);
        assert_eq!(curves(&CachedSolutions::default(), &tissues(0.05)), first);
        // Other blood is another tissue.
        assert_ne!(curves(&kept, &tissues(0.051)), first);
        assert_eq!(memory.found.load(Ordering::Relaxed), 1);
        // What has lost its end is solved anew.
        for (_, bytes) in memory.kept.lock().unwrap().iter_mut() {
            bytes.truncate(bytes.len() - 8);
        }
        assert_eq!(curves(&kept, &tissues(0.05)), first);
        assert_eq!(memory.kept.lock().unwrap().len(), 3);
    }
}
