//! Fluorophores of the catalogue.

use serde::{Deserialize, Serialize};

use super::catalogue::{damaged, parse};
use super::curve_preset::check_name;
use super::kind::{PresetError, PresetKind};
use fluorspar::spectral::{BandTerm, Fluorophore, Stokes, YieldUnit};

/// Which cells of a measured matrix count in the error of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FluorophoreMask {
    /// Smallest emission minus excitation, nm.
    pub stokes_gap_nm: f64,
    /// Smallest distance of the emission from twice the excitation, nm.
    pub second_order_gap_nm: f64,
}

/// How a fluorophore was fitted to data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FluorophoreFit {
    /// The data, by the name of their file; empty where there were none.
    pub reference: String,
    /// "eem" (a matrix) or "spectra" (one excitation and one emission spectrum).
    pub quantity: String,
    /// Number of values compared.
    pub cells: usize,
    /// Relative Frobenius error `||s model - data|| / ||data||` with one free scale `s`.
    pub relative_frobenius: f64,
    /// The same for excitation between 350 and 520 nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative_frobenius_350_520: Option<f64>,
    /// The same with a Stokes gap of 20 nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative_frobenius_gap20: Option<f64>,
    /// The same with a Stokes gap of 20 nm, for excitation between 350 and 520 nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative_frobenius_gap20_350_520: Option<f64>,
    /// Error of the excitation spectrum alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative_excitation: Option<f64>,
    /// Error of the emission spectrum alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relative_emission: Option<f64>,
    /// The data of the emission spectrum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission_reference: Option<String>,
    /// Which cells count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<FluorophoreMask>,
    /// Notes on the fit.
    #[serde(default)]
    pub note: String,
}

/// What is published of a dye whose amount has a unit: one unit of concentration is 1 umol/l through 1 mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedDye {
    /// What it is dissolved in or bound to.
    pub medium: String,
    /// Where it absorbs most, nm.
    pub excitation_peak_nm: f64,
    /// Where it emits most photons per nm, nm.
    pub emission_peak_nm: f64,
    /// Photons emitted per photon absorbed, 0 to 1.
    pub quantum_yield: f64,
    /// Decadic molar absorption at its peak, l/(mol cm).
    pub molar_absorption_per_m_cm: f64,
}

impl PublishedDye {
    /// Photons out per photon in of a thin layer of one unit of concentration, all of its light to the front:
    /// `quantum yield (1 - 10^(-A))` with the absorbance `A` of 1 umol/l through 1 mm.
    pub fn photon_yield(&self) -> f64 {
        const MOL_PER_L: f64 = 1e-6;
        const PATH_CM: f64 = 0.1;
        let absorbance = self.molar_absorption_per_m_cm * MOL_PER_L * PATH_CM;
        self.quantum_yield * (1.0 - 10_f64.powf(-absorbance))
    }
}

/// A fluorophore of the catalogue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FluorophorePreset {
    /// Name by which files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Description and caveats.
    pub description: String,
    /// Where the numbers come from.
    pub source: String,
    /// Where the excitation spectrum is backed by data, nm.
    pub excitation_range_nm: [f64; 2],
    /// Where the emission spectrum is backed by data, nm.
    pub emission_range_nm: [f64; 2],
    /// Unit of the data that the bands were fitted to, and so of the bands. Default "photons".
    #[serde(default)]
    pub unit: YieldUnit,
    /// Photons out per photon in at the best excitation, at concentration 1.
    pub photon_yield: f64,
    /// Whether anti-Stokes emission is masked.
    pub stokes: Stokes,
    /// Fields that are assumed rather than measured.
    pub assumed: Vec<String>,
    /// What is published of a dye.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<PublishedDye>,
    /// How the model was fitted.
    pub fit: FluorophoreFit,
    /// The model: a sum of products of bands.
    #[serde(rename = "term")]
    pub terms: Vec<BandTerm>,
}

impl FluorophorePreset {
    /// The fluorophore at its stated yield and mask.
    pub fn fluorophore(&self) -> Fluorophore {
        self.fluorophore_with(self.photon_yield, self.stokes)
    }

    /// The fluorophore with another yield or mask.
    pub fn fluorophore_with(&self, photon_yield: f64, stokes: Stokes) -> Fluorophore {
        Fluorophore::from_bands(
            &self.name,
            &self.title,
            &self.terms,
            self.unit,
            stokes,
            photon_yield,
            self.excitation_range_nm.into(),
            self.emission_range_nm.into(),
            &self.source,
        )
    }
}

/// A fluorophore.
///
/// # Errors
/// When there is no such fluorophore.
pub fn fluorophore(name: &str) -> Result<FluorophorePreset, PresetError> {
    let kind = PresetKind::Fluorophore;
    let preset: FluorophorePreset = parse(kind, name)?;
    check_name(kind, name, &preset.name)?;
    let fault = |message: String| Err(damaged(kind, name, message));
    if !(preset.photon_yield > 0.0 && preset.photon_yield <= 1.0) {
        return fault(format!("photon_yield = {} is not between 0 and 1", preset.photon_yield));
    }
    for (field, [from, to]) in
        [("excitation_range_nm", preset.excitation_range_nm), ("emission_range_nm", preset.emission_range_nm)]
    {
        if !(200.0..to).contains(&from) || to > 1000.0 {
            return fault(format!("{field} = [{from}, {to}]"));
        }
    }
    if let Some(dye) = &preset.published
        && !((0.0..=1.0).contains(&dye.quantum_yield) && dye.molar_absorption_per_m_cm > 0.0)
    {
        return fault(format!("published = {dye:?}"));
    }
    if preset.terms.is_empty() {
        return fault("it has no terms".into());
    }
    for (index, term) in preset.terms.iter().enumerate() {
        for band in term.excitation.iter().chain(&term.emission) {
            let positive =
                [band.peak_nm, band.fwhm_per_cm, band.skew].iter().all(|v| *v > 0.0 && v.is_finite());
            if !(positive && band.weight >= 0.0 && band.weight.is_finite()) {
                return fault(format!("term[{index}]: {band:?}"));
            }
        }
    }
    Ok(preset)
}
