//! What absorbs in tissue, by name.

use std::sync::Arc;

use super::tissue_error::{TissueError, check};
use crate::spectral::{Curve, blood_absorption_per_cm};

/// Largest absorption coefficient of a curve, 1/mm: whole blood without oxygen has 300/mm at 434 nm.
pub(super) const CURVE_PER_MM: [f64; 2] = [0.0, 400.0];
/// Absorption of tissue without blood and pigment, 1/mm. Soft tissue has 0.01 to 0.3, dentin 0.3 to 0.6.
const BACKGROUND_PER_MM: [f64; 2] = [0.0, 0.8];

/// Absorption of melanosomes at 500 nm, 1/mm, and the power of its fall (Jacques, Phys. Med. Biol. 58, R37, 2013:
/// `519 (lambda / 500)^-3.5` per cm).
const MELANOSOME_PER_MM: f64 = 51.9;
const MELANIN_POWER: f64 = 3.5;

/// Absorption of water, nm and 1/mm, linear between: Pope and Fry, Appl. Opt. 36, 8710 (1997) to 720 nm, Hale and Querry,
/// Appl. Opt. 12, 555 (1973) beyond. \[values from memory\] Under 1e-3/mm up to 700 nm, they do not matter in thin tissue.
const WATER: [[f64; 2]; 17] = [
    [350.0, 1.5e-5],
    [400.0, 6.63e-6],
    [420.0, 4.54e-6],
    [450.0, 9.22e-6],
    [480.0, 1.27e-5],
    [500.0, 2.04e-5],
    [520.0, 4.09e-5],
    [550.0, 5.65e-5],
    [580.0, 8.96e-5],
    [600.0, 2.224e-4],
    [620.0, 2.755e-4],
    [650.0, 3.40e-4],
    [680.0, 4.65e-4],
    [700.0, 6.24e-4],
    [720.0, 1.231e-3],
    [740.0, 2.4e-3],
    [760.0, 2.6e-3],
];

/// Bands of beta-carotene: nm, full width at half maximum nm, molar extinction 1/(cm M), base 10. Sum of Gaussians through the
/// maxima of the solution in hexane, 139 500 at 450 nm and 122 000 at 478 nm. \[from memory; widths assumed\]
const CAROTENE: [[f64; 3]; 3] = [[424.0, 34.0, 91_800.0], [449.0, 24.0, 119_200.0], [478.0, 24.0, 119_800.0]];

/// Blood in vessels.
///
/// `mua = fraction mub C` with `mub = ln(10) (hemoglobin_g_per_l / 64500) [S eps_HbO2 + (1 - S) eps_Hb]`. Light does not see all
/// blood of a vessel that absorbs much: `C = (1 - exp(-2 mub r)) / (2 mub r)` (Svaasand et al., Lasers Med. Sci. 10, 55, 1995;
/// Verkruysse et al., Phys. Med. Biol. 42, 51, 1997). Extinctions: the OMLC compilation of S. Prahl (1999), 350 to 750 nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blood {
    /// Volume of blood per volume of tissue, 0 to 1.
    pub volume_fraction: f64,
    /// Oxygen saturation, 0 to 1.
    pub saturation: f64,
    /// Hemoglobin in whole blood, g/l; 50 to 250. Adults have 120 to 170.
    pub hemoglobin_g_per_l: f64,
    /// Radius of the vessels, um; 0 to 1000. 0 spreads the blood evenly, capillaries have 3 to 5.
    pub vessel_radius_um: f64,
}

/// Something that absorbs.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Chromophore {
    /// Blood in vessels.
    Blood(Blood),
    /// Melanin: `fraction * 51.9 (lambda / 500 nm)^-3.5` per mm (Jacques 2013).
    Melanin {
        /// Volume of melanosomes per volume of tissue, 0 to 1. Fair skin has 0.01 to 0.06 in the basal epidermis.
        volume_fraction: f64,
    },
    /// Water.
    Water {
        /// Volume of water per volume of tissue, 0 to 1.
        volume_fraction: f64,
    },
    /// Beta-carotene, as in hexane.
    BetaCarotene {
        /// Concentration, umol/l; 0 to 100. Plasma has 0.1 to 2.
        concentration_umol_per_l: f64,
    },
    /// Everything else: `absorption_per_mm exp(-slope_per_nm (lambda - at_nm))`.
    Background {
        /// Absorption at `at_nm`, 1/mm; 0 to 0.8.
        absorption_per_mm: f64,
        /// Wavelength of that value, nm; 200 to 1200.
        at_nm: f64,
        /// How steeply it falls, 1/nm; 0 to 0.05.
        slope_per_nm: f64,
    },
    /// Any curve; nothing outside of its samples.
    Curve {
        /// Name for people.
        name: String,
        /// Absorption coefficient, 1/mm; 0 to 400.
        absorption_per_mm: Arc<Curve>,
    },
}

impl Blood {
    /// Absorption of tissue with this blood, 1/mm.
    #[must_use]
    pub fn absorption_per_mm(&self, wavelength_nm: f64) -> f64 {
        let whole = 0.1 * blood_absorption_per_cm(wavelength_nm, self.hemoglobin_g_per_l, self.saturation);
        let depth = 2.0 * whole * self.vessel_radius_um * 1e-3;
        let packaging = if depth > 1e-9 { -(-depth).exp_m1() / depth } else { 1.0 };
        self.volume_fraction * whole * packaging
    }
}

impl Chromophore {
    /// Absorption coefficient (natural logarithm), 1/mm.
    #[must_use]
    pub fn absorption_per_mm(&self, wavelength_nm: f64) -> f64 {
        match self {
            Self::Blood(blood) => blood.absorption_per_mm(wavelength_nm),
            Self::Melanin { volume_fraction } => {
                volume_fraction * MELANOSOME_PER_MM * (wavelength_nm / 500.0).powf(-MELANIN_POWER)
            }
            Self::Water { volume_fraction } => volume_fraction * water_per_mm(wavelength_nm),
            Self::BetaCarotene { concentration_umol_per_l } => {
                let extinction: f64 = CAROTENE
                    .iter()
                    .map(|[at, fwhm, peak]| {
                        let x = 2.0 * (wavelength_nm - at) / fwhm;
                        peak * (-std::f64::consts::LN_2 * x * x).exp()
                    })
                    .sum();
                0.1 * std::f64::consts::LN_10 * concentration_umol_per_l * 1e-6 * extinction
            }
            Self::Background { absorption_per_mm, at_nm, slope_per_nm } => {
                absorption_per_mm * (-slope_per_nm * (wavelength_nm - at_nm)).exp()
            }
            Self::Curve { absorption_per_mm, .. } => absorption_per_mm.at(wavelength_nm),
        }
    }

    /// Refuses numbers outside their ranges.
    ///
    /// # Errors
    /// The first number that is outside its range, with the range; `place` says of which layer.
    pub fn validate(&self, place: &str) -> Result<(), TissueError> {
        let share = "it is a share of the volume, between 0 and 1";
        match self {
            Self::Blood(blood) => {
                check(place, "blood.volume_fraction", blood.volume_fraction, [0.0, 1.0], share)?;
                let hint = "1 is fully oxygenated";
                check(place, "blood.saturation", blood.saturation, [0.0, 1.0], hint)?;
                let hint = "adults have 120 to 170 g/l (12 to 17 g/dl)";
                check(place, "blood.hemoglobin_g_per_l", blood.hemoglobin_g_per_l, [50.0, 250.0], hint)?;
                let hint = "it is in µm; capillaries have 3 to 5";
                check(place, "blood.vessel_radius_um", blood.vessel_radius_um, [0.0, 1000.0], hint)
            }
            Self::Melanin { volume_fraction } => {
                check(place, "melanin.volume_fraction", *volume_fraction, [0.0, 1.0], share)
            }
            Self::Water { volume_fraction } => {
                check(place, "water.volume_fraction", *volume_fraction, [0.0, 1.0], share)
            }
            Self::BetaCarotene { concentration_umol_per_l } => {
                let hint = "it is in µmol/l; plasma has 0.1 to 2";
                let name = "beta_carotene.concentration_umol_per_l";
                check(place, name, *concentration_umol_per_l, [0.0, 100.0], hint)
            }
            Self::Background { absorption_per_mm, at_nm, slope_per_nm } => {
                let hint = "it is in 1/mm (1/cm = 0.1/mm); soft tissue has 0.01 to 0.3";
                check(place, "background.absorption_per_mm", *absorption_per_mm, BACKGROUND_PER_MM, hint)?;
                check(place, "background.at_nm", *at_nm, [200.0, 1200.0], "it is in nm")?;
                let hint = "it is in 1/nm; tissue has about 0.008";
                check(place, "background.slope_per_nm", *slope_per_nm, [0.0, 0.05], hint)
            }
            Self::Curve { absorption_per_mm, .. } => {
                let hint = "the curve is in 1/mm (1/cm = 0.1/mm)";
                absorption_per_mm
                    .values()
                    .iter()
                    .try_for_each(|&v| check(place, "curve.absorption_per_mm", v, CURVE_PER_MM, hint))
            }
        }
    }
}

/// Linear between the rows of [`WATER`], whose ends are held.
fn water_per_mm(wavelength_nm: f64) -> f64 {
    let after = WATER.partition_point(|row| row[0] <= wavelength_nm).clamp(1, WATER.len() - 1);
    let ([x0, y0], [x1, y1]) = (WATER[after - 1], WATER[after]);
    y0 + (y1 - y0) * ((wavelength_nm - x0) / (x1 - x0)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blood_in_capillaries_on_a_background_is_that_of_published_stroma() {
        // Psych 221 tables: stroma absorbs 3.2 and 1.0 / cm more than epithelium at 420 and 450 nm.
        let blood = Blood {
            volume_fraction: 0.003,
            saturation: 0.933,
            hemoglobin_g_per_l: 150.0,
            vessel_radius_um: 4.0,
        };
        for (nm, per_cm) in [(420.0, 3.27), (450.0, 0.92), (560.0, 0.51)] {
            assert!((10.0 * blood.absorption_per_mm(nm) / per_cm - 1.0).abs() < 0.02, "{nm}");
        }
        let even = Blood { vessel_radius_um: 0.0, volume_fraction: 1.0, saturation: 1.0, ..blood };
        assert!((even.absorption_per_mm(420.0) / 257.3 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn pigments_have_their_published_values() {
        let at = |c: Chromophore, nm| c.absorption_per_mm(nm);
        assert!((at(Chromophore::Melanin { volume_fraction: 0.1 }, 500.0) - 5.19).abs() < 1e-12);
        assert!((at(Chromophore::Water { volume_fraction: 0.5 }, 700.0) - 3.12e-4).abs() < 1e-12);
        let carotene = Chromophore::BetaCarotene { concentration_umol_per_l: 1.0 };
        let molar = |nm| carotene.absorption_per_mm(nm) / (0.1 * std::f64::consts::LN_10 * 1e-6);
        assert!(
            (molar(450.0) / 139_500.0 - 1.0).abs() < 0.03 && (molar(478.0) / 122_000.0 - 1.0).abs() < 0.03
        );
        let background =
            Chromophore::Background { absorption_per_mm: 0.1544, at_nm: 420.0, slope_per_nm: 0.008_35 };
        assert!((10.0 * background.absorption_per_mm(700.0) / 0.149 - 1.0).abs() < 1e-2);
    }

    #[test]
    fn values_in_other_units_are_refused() {
        let blood = Blood {
            volume_fraction: 0.003,
            saturation: 0.9,
            hemoglobin_g_per_l: 150.0,
            vessel_radius_um: 4.0,
        };
        let curve = Curve::new(vec![400.0, 700.0], vec![2573.0, 1.0]).unwrap();
        let cases = [
            (
                Chromophore::Background { absorption_per_mm: 1.544, at_nm: 420.0, slope_per_nm: 0.008 },
                "in 1/mm",
            ),
            (Chromophore::Blood(Blood { hemoglobin_g_per_l: 15.0, ..blood }), "g/dl"),
            (Chromophore::Blood(Blood { saturation: 93.3, ..blood }), "outside 0 to 1"),
            (Chromophore::Blood(Blood { volume_fraction: -0.1, ..blood }), "share of the volume"),
            (Chromophore::Blood(Blood { vessel_radius_um: 4e3, ..blood }), "in µm"),
            (Chromophore::Melanin { volume_fraction: 5.0 }, "share"),
            (Chromophore::Water { volume_fraction: f64::NAN }, "share"),
            (Chromophore::BetaCarotene { concentration_umol_per_l: 1e3 }, "µmol/l"),
            (Chromophore::Curve { name: "blood".into(), absorption_per_mm: Arc::new(curve) }, "1/cm"),
        ];
        for (chromophore, words) in cases {
            let said = chromophore.validate("layer 'stroma'").unwrap_err().to_string();
            assert!(said.starts_with("layer 'stroma': ") && said.contains(words), "{said}");
        }
    }
}
