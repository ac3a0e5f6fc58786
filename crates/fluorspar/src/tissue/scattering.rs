//! How tissue scatters, against wavelength.

use std::sync::Arc;

use super::tissue_error::{TissueError, check};
use crate::spectral::Curve;

/// Reduced scattering coefficient at 500 nm, 1/mm. Soft tissue has 0.5 to 5 (Jacques 2013), enamel and dentin 0.3 to 3.
const REDUCED_PER_MM: [f64; 2] = [0.0, 10.0];
/// Scattering coefficient with an anisotropy of its own, 1/mm. Soft tissue has 3 to 30, dentin 26.
const SCATTERING_PER_MM: [f64; 2] = [0.0, 40.0];

/// Scattering coefficient and anisotropy.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerScattering {
    /// Coefficient against wavelength.
    pub coefficient: ScatteringCoefficient,
    /// Anisotropy factor of the phase function of Henyey and Greenstein; -0.99 to 0.995. The same at all wavelengths.
    pub anisotropy: f64,
}

/// A scattering coefficient against wavelength.
#[derive(Clone, Debug, PartialEq)]
pub enum ScatteringCoefficient {
    /// `scattering_per_mm (lambda / at_nm)^-power`.
    PowerLaw {
        /// Scattering coefficient `mus` at `at_nm`, 1/mm; 0 to 40.
        scattering_per_mm: f64,
        /// Wavelength of that value, nm; 200 to 1200.
        at_nm: f64,
        /// How steeply it falls; 0 to 4, 4 being Rayleigh's.
        power: f64,
    },
    /// `reduced_per_mm (lambda / at_nm)^-power / (1 - g)`.
    ReducedPowerLaw {
        /// Reduced scattering coefficient `mus' = mus (1 - g)` at `at_nm`, 1/mm; 0 to 10.
        reduced_per_mm: f64,
        /// Wavelength of that value, nm; 200 to 1200.
        at_nm: f64,
        /// How steeply it falls; 0 to 4.
        power: f64,
    },
    /// Scattering coefficient `mus`, 1/mm; 0 to 40. The ends are held.
    Curve {
        /// Samples.
        scattering_per_mm: Arc<Curve>,
    },
    /// Reduced scattering coefficient `mus'`, 1/mm; 0 to 10. The ends are held.
    ReducedCurve {
        /// Samples.
        reduced_per_mm: Arc<Curve>,
    },
}

impl LayerScattering {
    /// Scattering coefficient `mus`, 1/mm.
    #[must_use]
    pub fn scattering_per_mm(&self, wavelength_nm: f64) -> f64 {
        let held = |curve: &Curve| {
            let (first, last) = curve.range_nm();
            curve.at(wavelength_nm.clamp(first, last))
        };
        let forward = 1.0 - self.anisotropy;
        match &self.coefficient {
            ScatteringCoefficient::PowerLaw { scattering_per_mm, at_nm, power } => {
                scattering_per_mm * (wavelength_nm / at_nm).powf(-power)
            }
            ScatteringCoefficient::ReducedPowerLaw { reduced_per_mm, at_nm, power } => {
                reduced_per_mm * (wavelength_nm / at_nm).powf(-power) / forward
            }
            ScatteringCoefficient::Curve { scattering_per_mm } => held(scattering_per_mm),
            ScatteringCoefficient::ReducedCurve { reduced_per_mm } => held(reduced_per_mm) / forward,
        }
    }

    /// The same scattering times a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        match &mut self.coefficient {
            ScatteringCoefficient::PowerLaw { scattering_per_mm: value, .. }
            | ScatteringCoefficient::ReducedPowerLaw { reduced_per_mm: value, .. } => *value *= factor,
            ScatteringCoefficient::Curve { scattering_per_mm: curve }
            | ScatteringCoefficient::ReducedCurve { reduced_per_mm: curve } => {
                *curve = Arc::new(curve.scaled(factor));
            }
        }
        self
    }

    /// Refuses numbers outside their ranges.
    ///
    /// # Errors
    /// The first number that is outside its range, with the range; `place` says of which layer.
    pub fn validate(&self, place: &str) -> Result<(), TissueError> {
        let hint = "it is the mean cosine of the scattering angle";
        check(place, "anisotropy", self.anisotropy, super::ANISOTROPY, hint)?;
        let law = |at_nm: f64, power: f64| {
            check(place, "scattering.at_nm", at_nm, [200.0, 1200.0], "it is in nm")?;
            check(
                place,
                "scattering.power",
                power,
                [0.0, 4.0],
                "tissue has 0.5 to 2.5, Rayleigh scattering 4",
            )
        };
        let plain = |value: f64| {
            let hint = "it is in 1/mm (1/cm = 0.1/mm), not reduced; soft tissue has 3 to 30";
            check(place, "scattering_per_mm", value, SCATTERING_PER_MM, hint)
        };
        let reduced = |value: f64| {
            let hint = "it is in 1/mm (1/cm = 0.1/mm); soft tissue has 0.5 to 5";
            check(place, "reduced_per_mm", value, REDUCED_PER_MM, hint)
        };
        match &self.coefficient {
            ScatteringCoefficient::PowerLaw { scattering_per_mm, at_nm, power } => {
                plain(*scattering_per_mm)?;
                law(*at_nm, *power)
            }
            ScatteringCoefficient::ReducedPowerLaw { reduced_per_mm, at_nm, power } => {
                reduced(*reduced_per_mm)?;
                law(*at_nm, *power)
            }
            ScatteringCoefficient::Curve { scattering_per_mm } => {
                scattering_per_mm.values().iter().copied().try_for_each(plain)
            }
            ScatteringCoefficient::ReducedCurve { reduced_per_mm } => {
                reduced_per_mm.values().iter().copied().try_for_each(reduced)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reduced_law_and_a_plain_one_agree() {
        let reduced = LayerScattering {
            coefficient: ScatteringCoefficient::ReducedPowerLaw {
                reduced_per_mm: 2.246,
                at_nm: 500.0,
                power: 1.205,
            },
            anisotropy: 0.88,
        };
        let curve = Curve::new(vec![400.0, 420.0], vec![24.0, 23.1]).unwrap();
        let tabled = LayerScattering {
            coefficient: ScatteringCoefficient::Curve { scattering_per_mm: Arc::new(curve) },
            anisotropy: 0.88,
        };
        assert!((reduced.scattering_per_mm(420.0) - 23.09).abs() < 0.02);
        assert!((tabled.scattering_per_mm(420.0) - 23.1).abs() < 1e-12);
        assert_eq!(tabled.scattering_per_mm(500.0), tabled.scattering_per_mm(420.0));
        for scattering in [reduced, tabled] {
            let twice = scattering.clone().scaled(2.0).scattering_per_mm(450.0);
            assert!((twice / scattering.scattering_per_mm(450.0) - 2.0).abs() < 1e-12);
            assert_eq!(scattering.validate("layer 'x'"), Ok(()));
        }
    }

    #[test]
    fn values_in_1_per_cm_are_refused() {
        let law = |reduced_per_mm| LayerScattering {
            coefficient: ScatteringCoefficient::ReducedPowerLaw { reduced_per_mm, at_nm: 500.0, power: 1.2 },
            anisotropy: 0.88,
        };
        let said = law(22.46).validate("layer 'stroma'").unwrap_err().to_string();
        assert!(
            said.contains("reduced_per_mm is 22.46, outside 0 to 10; it is in 1/mm (1/cm = 0.1/mm)"),
            "{said}"
        );
        let mut steep = law(2.0);
        steep.coefficient =
            ScatteringCoefficient::PowerLaw { scattering_per_mm: 55.0, at_nm: 420.0, power: 2.0 };
        let said = steep.validate("layer 'epithelium'").unwrap_err().to_string();
        assert!(said.contains("scattering_per_mm is 55, outside 0 to 40"), "{said}");
    }
}
