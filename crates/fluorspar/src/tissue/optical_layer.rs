//! Plane layers that absorb and scatter, at one wavelength: what the solvers of light transport in tissue start from.

use super::tissue_error::{TissueError, check};

/// Allowed thickness of a layer, mm. A layer of 1e4 mm stands for a half-space.
pub const THICKNESS_MM: [f64; 2] = [1e-6, 1e4];
/// Allowed absorption and scattering coefficient, 1/mm. Whole blood absorbs 257/mm at 420 nm.
pub const COEFFICIENT_PER_MM: [f64; 2] = [0.0, 1e4];
/// Allowed anisotropy factor.
pub const ANISOTROPY: [f64; 2] = [-0.99, 0.995];
/// Allowed refractive index.
pub const REFRACTIVE_INDEX: [f64; 2] = [1.0, 3.0];

/// A homogeneous plane layer at one wavelength.
///
/// Single scattering follows Henyey and Greenstein, `p(cos) = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^1.5)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpticalLayer {
    /// Thickness, mm; 1e-6 to 1e4.
    pub thickness_mm: f64,
    /// Absorption coefficient (natural logarithm), 1/mm; 0 to 1e4.
    pub absorption_per_mm: f64,
    /// Scattering coefficient, 1/mm, not reduced by the anisotropy; 0 to 1e4.
    pub scattering_per_mm: f64,
    /// Anisotropy factor `g`, the mean cosine of the scattering angle; -0.99 to 0.995.
    pub anisotropy: f64,
    /// Refractive index; 1 to 3.
    pub refractive_index: f64,
}

/// Plane layers upon each other between two half-spaces, at one wavelength.
///
/// All interfaces are smooth and follow Fresnel's equations for unpolarized light. Light that leaves does not come back: a
/// black bottom is an `index_below` equal to the index of the last layer, as is a matched one.
#[derive(Clone, Debug, PartialEq)]
pub struct OpticalStack {
    /// The layers, the uppermost (where light comes in) first; at least one.
    pub layers: Vec<OpticalLayer>,
    /// Refractive index of the medium above; 1 to 3.
    pub index_above: f64,
    /// Refractive index of the medium below; 1 to 3.
    pub index_below: f64,
}

impl OpticalLayer {
    /// Refuses numbers outside their ranges.
    ///
    /// # Errors
    /// The first number that is outside its range, with the range; `place` says of which layer.
    pub fn validate(&self, place: &str) -> Result<(), TissueError> {
        let hint = "thickness is in mm (1 mm = 1000 µm)";
        check(place, "thickness_mm", self.thickness_mm, THICKNESS_MM, hint)?;
        let hint = "coefficients are in 1/mm (1/cm = 0.1/mm)";
        check(place, "absorption_per_mm", self.absorption_per_mm, COEFFICIENT_PER_MM, hint)?;
        check(place, "scattering_per_mm", self.scattering_per_mm, COEFFICIENT_PER_MM, hint)?;
        let hint = "it is the mean cosine of the scattering angle";
        check(place, "anisotropy", self.anisotropy, ANISOTROPY, hint)?;
        check(place, "refractive_index", self.refractive_index, REFRACTIVE_INDEX, "tissue has 1.33 to 1.65")
    }

    /// Reduced scattering coefficient `mus (1 - g)`, 1/mm.
    #[must_use]
    pub fn reduced_scattering_per_mm(&self) -> f64 {
        self.scattering_per_mm * (1.0 - self.anisotropy)
    }
}

impl OpticalStack {
    /// Refuses a stack without layers and numbers outside their ranges.
    ///
    /// # Errors
    /// The first defect, with the layer (counted from 1, the uppermost) and the allowed range.
    pub fn validate(&self) -> Result<(), TissueError> {
        if self.layers.is_empty() {
            return Err(TissueError::NoLayers);
        }
        for (number, layer) in self.layers.iter().enumerate() {
            layer.validate(&format!("layer {}", number + 1))?;
        }
        let hint = "air has 1, water 1.33, tissue 1.4";
        check("medium above", "index_above", self.index_above, REFRACTIVE_INDEX, hint)?;
        check("medium below", "index_below", self.index_below, REFRACTIVE_INDEX, hint)
    }

    /// Thickness of all layers together, mm.
    #[must_use]
    pub fn thickness_mm(&self) -> f64 {
        self.layers.iter().map(|layer| layer.thickness_mm).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack() -> OpticalStack {
        let layer = OpticalLayer {
            thickness_mm: 0.2,
            absorption_per_mm: 0.1,
            scattering_per_mm: 10.0,
            anisotropy: 0.9,
            refractive_index: 1.4,
        };
        OpticalStack { layers: vec![layer, layer], index_above: 1.0, index_below: 1.4 }
    }

    #[test]
    fn a_plain_stack_is_valid() {
        assert_eq!(stack().validate(), Ok(()));
        assert!((stack().thickness_mm() - 0.4).abs() < 1e-15);
        assert!((stack().layers[0].reduced_scattering_per_mm() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn bad_numbers_are_refused_with_place_and_range() {
        type Change = fn(&mut OpticalStack);
        let changes: [(Change, &str); 7] = [
            (|s| s.layers[1].thickness_mm = 0.0, "layer 2: thickness_mm is 0, outside 1e-6 to 10000"),
            (
                |s| s.layers[0].absorption_per_mm = -1.0,
                "layer 1: absorption_per_mm is -1, outside 0 to 10000",
            ),
            (|s| s.layers[0].scattering_per_mm = f64::NAN, "layer 1: scattering_per_mm is NaN"),
            (|s| s.layers[1].anisotropy = 1.0, "layer 2: anisotropy is 1, outside -0.99 to 0.995"),
            (|s| s.layers[1].refractive_index = 0.9, "layer 2: refractive_index is 0.9, outside 1 to 3"),
            (|s| s.index_above = 4.0, "medium above: index_above is 4, outside 1 to 3"),
            (|s| s.layers.clear(), "a tissue needs at least one layer"),
        ];
        for (change, message) in changes {
            let mut stack = stack();
            change(&mut stack);
            let said = stack.validate().unwrap_err().to_string();
            assert!(said.contains(message), "{said}");
        }
    }
}
