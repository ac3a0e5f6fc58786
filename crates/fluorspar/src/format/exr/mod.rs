//! OpenEXR images with a wavelength axis, in the layout of Fichet, Pacanowski and Wilkie[^fichet2021].
//!
//! One channel per band: `S0.385,000000nm` for radiometric quantities, `T.385,000000nm` for ratios. Text attributes
//! keep what the layout has no place for, so that an image comes back as it was:
//!
//! | attribute | content |
//! |---|---|
//! | `spectralLayoutVersion` | `1.0` |
//! | `emissiveUnits` | for instance `W.m^-2.sr^-1.nm^-1` |
//! | `wavelengthEdges_nm` | edges of the bins, separated by commas |
//! | `fluorsparQuantity` | `radiance`, `irradiance`, ... |
//! | `fluorspar` | provenance, JSON |
//! | `fluorsparComponent`, `fluorsparSamplesPerPixel` | label of a component (JSON), paths per pixel |
//! | `fluorsparParts` | names of the parts and their materials (JSON), in the part `features` |
//!
//! A component image is a multi-part file: one spectral part per component, named by its label, then `features` with
//! `Z` (depth, m), `N.X`, `N.Y`, `N.Z`, `id`, `U` and `V`.
//!
//! [^fichet2021]: J. Computer Graphics Techniques 10(3), 1-18 (2021), <http://jcgt.org/published/0010/03/01/>.

mod read;
mod write;

pub use read::{read_component_exr, read_spectral_exr};
pub use write::{ExrCompression, ExrOptions, write_component_exr, write_spectral_exr};

const LAYOUT_VERSION: &str = "spectralLayoutVersion";
const UNITS: &str = "emissiveUnits";
const EDGES: &str = "wavelengthEdges_nm";
const QUANTITY: &str = "fluorsparQuantity";
const PROVENANCE: &str = "fluorspar";
const COMPONENT: &str = "fluorsparComponent";
const SAMPLES: &str = "fluorsparSamplesPerPixel";
const PARTS: &str = "fluorsparParts";
const FEATURES: &str = "features";
const PREVIEW: &str = "preview";

/// `W/(sr m^2 nm)` as the layout writes it, `W.m^-2.sr^-1.nm^-1`; `None` for ratios.
fn layout_unit(unit: &str) -> Option<String> {
    let (numerator, denominator) = unit.split_once('/')?;
    if numerator != "W" {
        return None;
    }
    let mut factors: Vec<String> = denominator
        .trim_matches(['(', ')'])
        .split_whitespace()
        .map(|factor| match factor.split_once('^') {
            Some((base, power)) => format!("{base}^-{power}"),
            None => format!("{factor}^-1"),
        })
        .collect();
    // The order of the layout's authors: area, solid angle, then wavelength.
    factors.sort_by_key(|factor| ["m^-2", "sr^-1", "nm^-1"].iter().position(|known| known == factor));
    Some(format!("W.{}", factors.join(".")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::{Irradiance, Quantity, Radiance, RadiantPower, Reflectance};

    #[test]
    fn units_are_written_as_the_layout_wants_them() {
        assert_eq!(layout_unit(Radiance::UNIT).as_deref(), Some("W.m^-2.sr^-1.nm^-1"));
        assert_eq!(layout_unit(Irradiance::UNIT).as_deref(), Some("W.m^-2.nm^-1"));
        assert_eq!(layout_unit(RadiantPower::UNIT).as_deref(), Some("W.nm^-1"));
        assert_eq!(layout_unit(Reflectance::UNIT), None);
    }
}
