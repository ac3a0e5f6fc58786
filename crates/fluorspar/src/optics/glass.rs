//! Refractive index of lens materials.

use serde::{Deserialize, Serialize};

use crate::units::number_text;

/// Fraunhofer d line (helium), nm: the wavelength of `n_d`.
pub const D_LINE_NM: f64 = 587.5618;
/// Fraunhofer F line (hydrogen), nm.
pub const F_LINE_NM: f64 = 486.1327;
/// Fraunhofer C line (hydrogen), nm.
pub const C_LINE_NM: f64 = 656.2725;

/// How the refractive index, relative to air, depends on the wavelength.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Dispersion {
    /// The same index at every wavelength.
    Constant {
        /// Refractive index, 1 to 4.
        index: f64,
    },
    /// `n² - 1 = sum_i b_i L² / (L² - c_i)`, `L` the wavelength in micrometers (Sellmeier 1871; the form of the glass
    /// makers' catalogues).
    Sellmeier {
        /// Strengths `b_i`.
        b: Vec<f64>,
        /// Squares of the resonance wavelengths `c_i`, um².
        c_um2: Vec<f64>,
    },
    /// Two-term Cauchy formula `n = A + B / L²` through `n_d` and `n_F - n_C = (n_d - 1) / V_d`. It stands for a glass of
    /// which only these two numbers are known (patents); normal glasses follow it to some 1e-3 between 400 and 700 nm.
    Abbe {
        /// Index at the d line.
        nd: f64,
        /// Abbe number `(n_d - 1) / (n_F - n_C)`.
        vd: f64,
    },
    /// Linear between samples, constant outside of them.
    Table {
        /// Wavelengths, nm, rising.
        wavelength_nm: Vec<f64>,
        /// One index per wavelength.
        index: Vec<f64>,
    },
}

impl Dispersion {
    /// Refractive index at a wavelength in nm.
    pub fn index(&self, wavelength_nm: f64) -> f64 {
        match self {
            Self::Constant { index } => *index,
            Self::Sellmeier { b, c_um2 } => {
                let square = (wavelength_nm * 1e-3).powi(2);
                let sum: f64 = b.iter().zip(c_um2).map(|(b, c)| b * square / (square - c)).sum();
                (1.0 + sum).sqrt()
            }
            Self::Abbe { nd, vd } => {
                let per_um2 = |nm: f64| (nm * 1e-3).powi(-2);
                let slope = (nd - 1.0) / vd / (per_um2(F_LINE_NM) - per_um2(C_LINE_NM));
                nd + slope * (per_um2(wavelength_nm) - per_um2(D_LINE_NM))
            }
            Self::Table { wavelength_nm: at, index } => {
                let right = at.partition_point(|nm| *nm < wavelength_nm);
                match (right.checked_sub(1).and_then(|left| at.get(left)), at.get(right)) {
                    (Some(x0), Some(x1)) => {
                        let t = (wavelength_nm - x0) / (x1 - x0);
                        index[right - 1] + t * (index[right] - index[right - 1])
                    }
                    (None, _) => index.first().copied().unwrap_or(1.0),
                    (_, None) => index.last().copied().unwrap_or(1.0),
                }
            }
        }
    }

    /// Whether the index depends on the wavelength.
    pub fn is_dispersive(&self) -> bool {
        (self.index(F_LINE_NM) - self.index(C_LINE_NM)).abs() > 1e-9
    }

    /// Checks the parameters.
    ///
    /// # Errors
    /// What is wrong, where, and how to fix it.
    pub fn validate(&self) -> Result<(), String> {
        if let Self::Sellmeier { b, c_um2 } = self
            && (b.is_empty() || b.len() != c_um2.len())
        {
            return Err(format!(
                "{} values b but {} values c_um2; give as many of each",
                b.len(),
                c_um2.len()
            ));
        }
        if let Self::Table { wavelength_nm, index } = self {
            if wavelength_nm.is_empty() || wavelength_nm.len() != index.len() {
                let (nm, n) = (wavelength_nm.len(), index.len());
                return Err(format!("{nm} wavelengths but {n} indices; give one index per wavelength"));
            }
            if wavelength_nm
                .windows(2)
                .any(|pair| pair[1].partial_cmp(&pair[0]) != Some(std::cmp::Ordering::Greater))
            {
                return Err("the wavelengths must rise; sort the table".into());
            }
        }
        if let Self::Abbe { vd, .. } = self
            && !(*vd > 5.0 && *vd < 200.0)
        {
            return Err(format!(
                "the Abbe number {} is not between 5 and 200; give (n_d - 1) / (n_F - n_C)",
                number_text(*vd)
            ));
        }
        for nm in [400.0, D_LINE_NM, 700.0] {
            let n = self.index(nm);
            if !(1.0..=4.0).contains(&n) {
                return Err(format!(
                    "the index at {nm} nm is {}, not between 1 and 4; check the coefficients",
                    number_text(n)
                ));
            }
        }
        Ok(())
    }
}

/// A named lens material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Glass {
    /// Name by which lenses refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Description and caveats.
    pub description: String,
    /// Where the numbers come from.
    pub source: String,
    /// Names under which other programs know it.
    #[serde(default)]
    pub also: Vec<String>,
    /// Published index at the d line.
    pub nd: f64,
    /// Published Abbe number.
    pub vd: f64,
    /// Wavelengths between which the formula holds, nm.
    pub valid_nm: [f64; 2],
    /// The formula.
    pub dispersion: Dispersion,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_abbe_formula_returns_its_parameters() {
        let glass = Dispersion::Abbe { nd: 1.62004, vd: 36.37 };
        assert!((glass.index(D_LINE_NM) - 1.62004).abs() < 1e-12);
        let dispersion = glass.index(F_LINE_NM) - glass.index(C_LINE_NM);
        assert!(((glass.index(D_LINE_NM) - 1.0) / dispersion - 36.37).abs() < 1e-9);
    }

    #[test]
    fn tables_are_linear_inside_and_constant_outside() {
        let glass = Dispersion::Table { wavelength_nm: vec![400.0, 500.0], index: vec![1.6, 1.5] };
        assert!((glass.index(450.0) - 1.55).abs() < 1e-12);
        assert_eq!((glass.index(300.0), glass.index(600.0)), (1.6, 1.5));
        assert_eq!((glass.index(400.0), glass.index(500.0)), (1.6, 1.5));
    }

    #[test]
    fn impossible_glasses_are_explained() {
        let of = |b: Vec<f64>, c: Vec<f64>| Dispersion::Sellmeier { b, c_um2: c }.validate().unwrap_err();
        assert!(of(vec![1.0], vec![]).contains("as many"));
        assert!(of(vec![99.0], vec![0.01]).contains("not between 1 and 4"));
        assert!(Dispersion::Abbe { nd: 1.5, vd: 0.0 }.validate().unwrap_err().contains("Abbe number"));
    }
}
