//! Tissue as layers of known contents.

use std::sync::Arc;

use super::chromophore::{CURVE_PER_MM, Chromophore};
use super::optical_layer::{OpticalLayer, OpticalStack};
use super::scattering::LayerScattering;
use super::tissue_error::{TissueError, check};
use crate::spectral::{Fluorophore, Stokes, YieldDensity};

/// A fluorophore in a layer.
///
/// Its strength is the absorption coefficient of the fluorophore times its quantum yield at one wavelength: photons emitted
/// per mm of path of a photon of that wavelength, over all emission. At other wavelengths it follows the
/// excitation-emission matrix of the fluorophore, in photons per photon.
#[derive(Clone, Debug, PartialEq)]
pub struct TissueFluorophore {
    /// The fluorophore; its own scale does not matter.
    pub fluorophore: Arc<Fluorophore>,
    /// Absorption times quantum yield at `at_nm`, 1/mm; 0 to 400. Mucosa has 1e-5 to 1e-2.
    pub strength_per_mm: f64,
    /// Wavelength of the strength, nm; the fluorophore must be excited there.
    pub at_nm: f64,
    /// Quantum yield, 0.001 to 1: the absorption that the emission implies is added to that of the layer. `None` where the
    /// chromophores of the layer hold it already, or where it does not matter.
    pub quantum_yield: Option<f64>,
}

/// One layer of tissue.
#[derive(Clone, Debug, PartialEq)]
pub struct TissueLayer {
    /// Name, unique in its tissue.
    pub name: String,
    /// Thickness, um; 0.1 to 1e6.
    pub thickness_um: f64,
    /// How it scatters.
    pub scattering: LayerScattering,
    /// What absorbs in it.
    pub absorption: Vec<Chromophore>,
    /// What fluoresces in it.
    pub fluorophores: Vec<TissueFluorophore>,
    /// Refractive index, where it is not that of the tissue; 1 to 3.
    pub refractive_index: Option<f64>,
}

/// What lies below the last layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Below {
    /// A medium of the last layer's index, from which nothing returns.
    Black,
    /// A medium of another index, 1 to 3, from which nothing returns; its surface reflects.
    Index(f64),
}

/// Layers of tissue under air.
#[derive(Clone, Debug, PartialEq)]
pub struct LayeredTissue {
    /// The layers, the uppermost first.
    pub layers: Vec<TissueLayer>,
    /// Refractive index of layers that do not state their own; 1 to 3.
    pub refractive_index: f64,
    /// What lies below them.
    pub below: Below,
}

impl TissueFluorophore {
    /// Photons emitted per nm and per mm of path of one photon: `strength Y(emission|excitation) / Y(at_nm)` with `Y(at_nm)`
    /// over all emission and before the Stokes mask.
    pub(super) fn scale_per_mm(&self) -> f64 {
        self.strength_per_mm / unmasked_yield(&self.fluorophore, self.at_nm)
    }

    /// Absorption by the fluorophore itself, 1/mm: `strength / quantum yield`, following its excitation spectrum.
    #[must_use]
    pub fn own_absorption_per_mm(&self, wavelength_nm: f64) -> f64 {
        let Some(quantum_yield) = self.quantum_yield else { return 0.0 };
        self.scale_per_mm() * unmasked_yield(&self.fluorophore, wavelength_nm) / quantum_yield
    }

    /// Refuses numbers outside their ranges, and a wavelength that does not excite it.
    ///
    /// # Errors
    /// The first defect; `place` says of which layer.
    pub fn validate(&self, place: &str) -> Result<(), TissueError> {
        let place = format!("{place}, fluorophore '{}'", self.fluorophore.name);
        let hint = "absorption times quantum yield is in 1/mm (1/cm = 0.1/mm); mucosa has 1e-5 to 1e-2";
        check(&place, "strength_per_mm", self.strength_per_mm, CURVE_PER_MM, hint)?;
        check(&place, "at_nm", self.at_nm, [200.0, 1200.0], "it is in nm")?;
        if let Some(quantum_yield) = self.quantum_yield {
            let hint = "leave it out where it is not known";
            check(&place, "quantum_yield", quantum_yield, [0.001, 1.0], hint)?;
        }
        if unmasked_yield(&self.fluorophore, self.at_nm) > 0.0 {
            return Ok(());
        }
        Err(TissueError::NotExcited { place, at_nm: self.at_nm })
    }
}

/// Photons over all emission per photon, before the Stokes mask.
fn unmasked_yield(fluorophore: &Fluorophore, wavelength_nm: f64) -> f64 {
    let eem = &fluorophore.eem;
    match eem.density() {
        // Emission curves have unit area.
        YieldDensity::Separable(terms) => {
            eem.scale() * terms.iter().map(|term| term.excitation.at(wavelength_nm)).sum::<f64>()
        }
        YieldDensity::Table(_) => eem.clone().with_stokes(Stokes::Off).total_yields(&[wavelength_nm])[0],
    }
}

impl TissueLayer {
    /// Absorption coefficient of all contents, 1/mm.
    #[must_use]
    pub fn absorption_per_mm(&self, wavelength_nm: f64) -> f64 {
        let chromophores: f64 = self.absorption.iter().map(|c| c.absorption_per_mm(wavelength_nm)).sum();
        let own: f64 = self.fluorophores.iter().map(|f| f.own_absorption_per_mm(wavelength_nm)).sum();
        chromophores + own
    }

    /// The part of the thickness of a layer between two shares of it, as a layer with another name.
    #[must_use]
    pub fn part(&self, name: &str, thickness_um: f64) -> Self {
        Self { name: name.to_string(), thickness_um, ..self.clone() }
    }

    fn validate(&self, place: &str) -> Result<(), TissueError> {
        let hint = "it is in µm (1 mm = 1000 µm)";
        check(place, "thickness_um", self.thickness_um, [0.1, 1e6], hint)?;
        if let Some(index) = self.refractive_index {
            let hint = "tissue has 1.33 to 1.65";
            check(place, "refractive_index", index, super::REFRACTIVE_INDEX, hint)?;
        }
        self.scattering.validate(place)?;
        self.absorption.iter().try_for_each(|chromophore| chromophore.validate(place))?;
        self.fluorophores.iter().try_for_each(|fluorophore| fluorophore.validate(place))
    }
}

impl LayeredTissue {
    /// Refuses a tissue without layers, layers of one name, and numbers outside their ranges.
    ///
    /// # Errors
    /// The first defect, with the layer and the allowed range.
    pub fn validate(&self) -> Result<(), TissueError> {
        if self.layers.is_empty() {
            return Err(TissueError::NoLayers);
        }
        let hint = "tissue has 1.33 to 1.65";
        check("tissue", "refractive_index", self.refractive_index, super::REFRACTIVE_INDEX, hint)?;
        if let Below::Index(index) = self.below {
            check("medium below", "refractive_index", index, super::REFRACTIVE_INDEX, "air has 1")?;
        }
        for (number, layer) in self.layers.iter().enumerate() {
            if self.layers[..number].iter().any(|other| other.name == layer.name) {
                return Err(TissueError::NameTwice { name: layer.name.clone() });
            }
            layer.validate(&format!("layer '{}'", layer.name))?;
        }
        Ok(())
    }

    /// Refuses layers that emit more photons than they absorb. A fluorophore that brings its own absorption, with a quantum yield, can't.
    ///
    /// # Errors
    /// The layer and the wavelength where most photons are gained, with the strongest fluorophore there that brings none.
    pub fn check_photon_balance(&self, wavelengths_nm: &[f64]) -> Result<(), TissueError> {
        for layer in &self.layers {
            let of_one = |held: &TissueFluorophore| -> Vec<f64> {
                let yields = held.fluorophore.eem.total_yields(wavelengths_nm);
                yields.into_iter().map(|photons| photons * held.scale_per_mm()).collect()
            };
            let emitted: Vec<Vec<f64>> = layer.fluorophores.iter().map(of_one).collect();
            let at = |i: usize| {
                let sum: f64 = emitted.iter().map(|of_one| of_one[i]).sum();
                (i, sum, layer.absorption_per_mm(wavelengths_nm[i]))
            };
            let gain = |&(_, emitted, absorbed): &(usize, f64, f64)| emitted - absorbed;
            let most = (0..wavelengths_nm.len()).map(at).max_by(|a, b| gain(a).total_cmp(&gain(b)));
            let Some((i, emitted_per_mm, absorbed_per_mm)) = most else { continue };
            let without = layer.fluorophores.iter().zip(&emitted).filter(|(f, _)| f.quantum_yield.is_none());
            let strongest = without.max_by(|(_, a), (_, b)| a[i].total_cmp(&b[i]));
            // Rounding may leave a little more than a quantum yield of 1 gives.
            if let Some((held, _)) = strongest.filter(|_| emitted_per_mm > (1.0 + 1e-9) * absorbed_per_mm) {
                return Err(TissueError::GainsPhotons {
                    layer: layer.name.clone(),
                    fluorophore: held.fluorophore.name.clone(),
                    nm: wavelengths_nm[i],
                    emitted_per_mm,
                    absorbed_per_mm,
                });
            }
        }
        Ok(())
    }

    /// Refractive index of the uppermost layer.
    #[must_use]
    pub fn surface_index(&self) -> f64 {
        self.layers.first().and_then(|layer| layer.refractive_index).unwrap_or(self.refractive_index)
    }

    /// The layers at one wavelength, under air.
    #[must_use]
    pub fn optics(&self, wavelength_nm: f64) -> OpticalStack {
        let layers: Vec<OpticalLayer> = self
            .layers
            .iter()
            .map(|layer| OpticalLayer {
                thickness_mm: layer.thickness_um * 1e-3,
                absorption_per_mm: layer.absorption_per_mm(wavelength_nm),
                scattering_per_mm: layer.scattering.scattering_per_mm(wavelength_nm),
                anisotropy: layer.scattering.anisotropy,
                refractive_index: layer.refractive_index.unwrap_or(self.refractive_index),
            })
            .collect();
        let index_below = match self.below {
            Below::Index(index) => index,
            Below::Black => layers.last().map_or(self.refractive_index, |layer| layer.refractive_index),
        };
        OpticalStack { layers, index_above: 1.0, index_below }
    }

    /// Photons that each layer emits per nm of emission and per mm of path of a photon of the excitation: absorption times
    /// quantum yield per nm, 1/(mm nm), of all fluorophores of the layer.
    #[must_use]
    pub fn strengths_per_mm_nm(&self, excitation_nm: f64, emission_nm: f64) -> Vec<f64> {
        let strength = |content: &TissueFluorophore| {
            content.scale_per_mm() * content.fluorophore.eem.at(emission_nm, excitation_nm)
        };
        self.layers.iter().map(|layer| layer.fluorophores.iter().map(strength).sum()).collect()
    }

    /// The same with the absorption of the fluorophores added to that of the layers, by the quantum yields of those that a
    /// function knows. In the catalogue it is part of the background, which was fitted to reflectance.
    #[must_use]
    pub fn with_own_absorption(&self, quantum_yield: impl Fn(&str) -> Option<f64>) -> Self {
        let mut tissue = self.clone();
        for held in tissue.layers.iter_mut().flat_map(|layer| &mut layer.fluorophores) {
            held.quantum_yield = quantum_yield(&held.fluorophore.name).or(held.quantum_yield);
        }
        tissue
    }

    /// Depth of the lower end of each layer, um, and its name, from above.
    #[must_use]
    pub fn bottoms_um(&self) -> Vec<(f64, String)> {
        let sum = |depth_um: &mut f64, layer: &TissueLayer| {
            *depth_um += layer.thickness_um;
            Some((*depth_um, layer.name.clone()))
        };
        self.layers.iter().scan(0.0, sum).collect()
    }

    /// The layer of a name.
    #[must_use]
    pub fn layer(&self, name: &str) -> Option<&TissueLayer> {
        self.layers.iter().find(|layer| layer.name == name)
    }
}
