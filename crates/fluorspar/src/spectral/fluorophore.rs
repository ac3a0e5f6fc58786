//! Named fluorophores: an excitation-emission matrix with its scale, range and source.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Curve, PhotonEem, SeparableTerm, Stokes};
use crate::units::wavenumber_per_cm;

/// A log-normal band in wavenumber, the usual shape of molecular absorption and emission bands.
///
/// `band(nu) = weight * exp(-ln 2 / ln^2 skew * ln^2((a - nu) / (a - nu0)))` where `a = nu0 + fwhm skew / (skew^2 - 1)`,
/// and a Gaussian where skew = 1 (Siano and Metzler, J. Chem. Phys. 51, 1856, 1969). Zero beyond `a`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LogNormalBand {
    /// Wavelength of the maximum, nm.
    pub peak_nm: f64,
    /// Full width at half maximum, 1/cm.
    pub fwhm_per_cm: f64,
    /// Ratio of the half widths on both sides; 1 is symmetric.
    #[serde(default = "symmetric")]
    pub skew: f64,
    /// Height of the maximum, relative to the other bands.
    pub weight: f64,
}

fn symmetric() -> f64 {
    1.0
}

impl LogNormalBand {
    /// Value at a wavelength.
    pub fn eval(&self, wavelength_nm: f64) -> f64 {
        let (nu, nu0) = (wavenumber_per_cm(wavelength_nm), wavenumber_per_cm(self.peak_nm));
        if (self.skew - 1.0).abs() < 1e-4 {
            let x = (nu - nu0) / self.fwhm_per_cm;
            return self.weight * (-4.0 * std::f64::consts::LN_2 * x * x).exp();
        }
        let a = nu0 + self.fwhm_per_cm * self.skew / (self.skew * self.skew - 1.0);
        let ratio = (a - nu) / (a - nu0);
        if ratio <= 0.0 {
            return 0.0;
        }
        let x = ratio.ln() / self.skew.ln();
        self.weight * (-std::f64::consts::LN_2 * x * x).exp()
    }
}

/// Unit of the values of a measured matrix or emission spectrum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum YieldUnit {
    /// Photons out per photon in.
    #[default]
    Photons,
    /// Energy out per energy in.
    Energy,
}

impl YieldUnit {
    /// What is counted.
    pub fn name(self) -> &'static str {
        match self {
            Self::Photons => "photons",
            Self::Energy => "energy",
        }
    }
}

/// One separable term of a modeled fluorophore: sums of bands for excitation and emission.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BandTerm {
    /// Excitation bands; their weights set the strength of the term.
    pub excitation: Vec<LogNormalBand>,
    /// Emission bands (photons or energy per nm), relative to each other.
    pub emission: Vec<LogNormalBand>,
}

/// Emission is looked for between these wavelengths, nm.
const EMISSION_SPAN_NM: (f64, f64) = (200.0, 1000.0);

/// A fluorophore at unit concentration.
#[derive(Clone, Debug, PartialEq)]
pub struct Fluorophore {
    /// Name by which materials and files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Photon yield density at concentration 1, 1/nm.
    pub eem: PhotonEem,
    /// Where the excitation spectrum is backed by data, nm.
    pub excitation_range_nm: (f64, f64),
    /// Where the emission spectrum is backed by data, nm.
    pub emission_range_nm: (f64, f64),
    /// Where the numbers come from.
    pub source: String,
}

impl Fluorophore {
    /// A fluorophore from band models, scaled so that the photon yield, before the Stokes mask and over all emission,
    /// is `photon_yield` at the best excitation wavelength within `excitation_range_nm`, at concentration 1. Bands of energy
    /// become photons by the factor emission over excitation wavelength.
    #[expect(clippy::too_many_arguments, reason = "one call site: the catalogue's file layout")]
    pub fn from_bands(
        name: &str,
        title: &str,
        terms: &[BandTerm],
        unit: YieldUnit,
        stokes: Stokes,
        photon_yield: f64,
        excitation_range_nm: (f64, f64),
        emission_range_nm: (f64, f64),
        source: &str,
    ) -> Self {
        let sum = |bands: &[LogNormalBand], nm: f64| bands.iter().map(|band| band.eval(nm)).sum::<f64>();
        let factor = |nm: f64| if unit == YieldUnit::Energy { nm } else { 1.0 };
        let terms: Vec<SeparableTerm> = terms
            .iter()
            .map(|term| {
                let emission = Curve::from_fn(EMISSION_SPAN_NM.0, EMISSION_SPAN_NM.1, |nm| {
                    factor(nm) * sum(&term.emission, nm)
                });
                let area = emission.total();
                let excitation = Curve::from_fn(EMISSION_SPAN_NM.0, EMISSION_SPAN_NM.1, |nm| {
                    area * sum(&term.excitation, nm) / factor(nm)
                });
                SeparableTerm { excitation, emission: emission.scaled(1.0 / area) }
            })
            .collect();
        let best = Curve::from_fn(excitation_range_nm.0, excitation_range_nm.1, |nm| {
            terms.iter().map(|term| term.excitation.at(nm)).sum()
        })
        .max();
        Self {
            name: name.into(),
            title: title.into(),
            eem: PhotonEem::separable(terms, stokes).scaled(photon_yield / best),
            excitation_range_nm,
            emission_range_nm,
            source: source.into(),
        }
    }

    /// Radiance at some wavelengths of a surface that holds it at concentration 1 under an irradiance, W/(m² nm): W/(sr m² nm). Light
    /// is emitted evenly in all directions, `L = M / pi`.
    pub fn radiance_under(&self, irradiance: &Curve, wavelengths_nm: &[f64]) -> Vec<f64> {
        let (Some(&first), Some(&last)) = (wavelengths_nm.first(), wavelengths_nm.last()) else {
            return Vec::new();
        };
        let (from_nm, to_nm) = irradiance.range_nm();
        // In units of 1/(h c): photons = energy * lambda.
        let photons = irradiance.times(&Curve::from_fn(from_nm, to_nm, |nm| nm));
        // Curves are sampled finely between their ends, which must differ.
        let exitance = self.eem.photon_exitance(&photons, (first - 1.0, last + 1.0));
        wavelengths_nm.iter().map(|nm| exitance.at(*nm) / (nm * std::f64::consts::PI)).collect()
    }

    /// Photons emitted between two wavelengths per photon of `excitation_nm`, at concentration 1.
    pub fn photon_yield(&self, excitation_nm: f64, from_nm: f64, to_nm: f64) -> f64 {
        self.eem.photon_yield(excitation_nm, from_nm, to_nm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_has_its_width_and_its_peak() {
        for skew in [0.7, 1.0, 1.4] {
            let band = LogNormalBand { peak_nm: 460.0, fwhm_per_cm: 4000.0, skew, weight: 2.0 };
            assert!((band.eval(460.0) - 2.0).abs() < 1e-12);
            let half_points: Vec<f64> = (3500..6500)
                .map(|i| f64::from(i) * 0.1)
                .collect::<Vec<_>>()
                .windows(2)
                .filter(|pair| (band.eval(pair[0]) - 1.0) * (band.eval(pair[1]) - 1.0) <= 0.0)
                .map(|pair| 1e7 / pair[0])
                .collect();
            assert_eq!(half_points.len(), 2, "skew {skew}");
            assert!((half_points[0] - half_points[1] - 4000.0).abs() < 10.0, "skew {skew}: {half_points:?}");
        }
    }

    #[test]
    fn the_best_excitation_has_the_stated_yield() {
        let band = |peak_nm, fwhm_per_cm| LogNormalBand { peak_nm, fwhm_per_cm, skew: 1.1, weight: 0.4 };
        let terms = [
            BandTerm { excitation: vec![band(380.0, 4000.0)], emission: vec![band(520.0, 3000.0)] },
            BandTerm { excitation: vec![band(430.0, 3000.0)], emission: vec![band(560.0, 2000.0)] },
        ];
        let of_unit = |unit| {
            let (excitation, emission) = ((300.0, 500.0), (450.0, 700.0));
            Fluorophore::from_bands("x", "X", &terms, unit, Stokes::Off, 1e-3, excitation, emission, "")
        };
        let [photons, energy] = [of_unit(YieldUnit::Photons), of_unit(YieldUnit::Energy)];
        for f in [&photons, &energy] {
            let best = (300..500).map(|nm| f.photon_yield(f64::from(nm), 200.0, 1000.0)).fold(0.0, f64::max);
            assert!((best / 1e-3 - 1.0).abs() < 1e-3, "{best}");
        }
        // Energy of the bands becomes photons: times emission over excitation wavelength.
        let ratio = |emission: f64, excitation: f64| {
            energy.eem.at(emission, excitation) / photons.eem.at(emission, excitation)
        };
        let expected = (560.0 / 430.0) / (500.0 / 380.0);
        assert!((ratio(560.0, 430.0) / ratio(500.0, 380.0) / expected - 1.0).abs() < 1e-6);
    }
}
