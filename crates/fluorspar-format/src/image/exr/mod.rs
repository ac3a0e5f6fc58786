//! OpenEXR images with a wavelength axis; [`write_spectral_exr`] and [`write_component_exr`] describe the layout.

mod component_file;
mod packing;
mod read;
mod rounded_rows;
mod write;

pub use component_file::ComponentFile;
pub(crate) use read::read_texture_exr;
pub use read::{is_component_exr, read_component_exr, read_spectral_exr};
pub use write::{ExrCompression, ExrOptions, write_component_exr, write_spectral_exr};
pub(crate) use write::{write_spooled_component_exr, write_spooled_spectral_exr};

const LAYOUT_VERSION: &str = "spectralLayoutVersion";
const FORMAT: &str = "fluorsparFormat";
const UNITS: &str = "emissiveUnits";
const EDGES: &str = "wavelengthEdges_nm";
const QUANTITY: &str = "fluorsparQuantity";
const PROVENANCE: &str = "fluorspar";
const COMPONENT: &str = "fluorsparComponent";
const SAMPLES: &str = "fluorsparSamplesPerPixel";
const PARTS: &str = "fluorsparParts";
const VIEW: &str = "fluorsparView";
const SCALE: &str = "fluorsparScale";
const STORAGE_ERROR: &str = "fluorsparStorageError";
const DENOISED: &str = "fluorsparDenoised";
const STATISTIC: &str = "fluorsparStatistic";
const MATERIALS: &str = "fluorsparMaterials";
const EXCITATION: &str = "fluorsparExcitation";
/// How all bands of a component follow from its coefficients.
const BASIS: &str = "fluorsparBasis";
const FEATURES: &str = "features";
const PREVIEW: &str = "preview";

/// Which plane of which statistic a part holds.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
struct StatisticLabel {
    of: fluorspar::image::StatisticsKind,
    name: String,
    holds: StatisticPlane,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
enum StatisticPlane {
    HalfA,
    HalfB,
    Variance,
}

/// Which component of which light group a part with an excitation basis holds, and its spectra.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
struct ExcitationLabel {
    light_group: String,
    light: fluorspar::image::LightPath,
    nodes_nm: Vec<f64>,
    rank: usize,
    error: f64,
    /// `[spectrum][node][band]`, 32-bit floats, the low byte first, in base 64.
    spectra: String,
}

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
    use fluorspar::spectral::{Irradiance, Quantity, Radiance, RadiantPower, Reflectance};

    #[test]
    fn units_are_written_as_the_layout_wants_them() {
        assert_eq!(layout_unit(Radiance::UNIT).as_deref(), Some("W.m^-2.sr^-1.nm^-1"));
        assert_eq!(layout_unit(Irradiance::UNIT).as_deref(), Some("W.m^-2.nm^-1"));
        assert_eq!(layout_unit(RadiantPower::UNIT).as_deref(), Some("W.nm^-1"));
        assert_eq!(layout_unit(Reflectance::UNIT), None);
    }
}
