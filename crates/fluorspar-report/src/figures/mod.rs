//! The figures of a report, from plain data.
//!
//! Each function chooses round axis limits, draws names and units, and writes an explanation that a reader who has seen only
//! the paper's abstract can follow.

mod chromaticity;
mod eem;
mod filters;
mod histogram;
mod lights;
mod picture;
mod radiance;
mod sensor;

pub use chromaticity::{ChromaticityPlot, chromaticity};
pub use eem::{EemMap, eem_maps, emission};
pub use filters::filters;
pub use histogram::{ChannelValues, histograms};
pub use lights::{LIGHT_DECADES, lights};
pub use picture::{picture, porphyrin_map};
pub use radiance::radiance_by_component;
pub use sensor::sensor_response;

/// A function of wavelength with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCurve {
    /// Name, as it shall stand in the legend.
    pub name: String,
    /// Wavelengths, nm, increasing.
    pub wavelength_nm: Vec<f64>,
    /// One value per wavelength.
    pub value: Vec<f64>,
}

impl NamedCurve {
    /// A curve from its samples.
    pub fn new(name: impl Into<String>, wavelength_nm: Vec<f64>, value: Vec<f64>) -> Self {
        Self { name: name.into(), wavelength_nm, value }
    }

    fn points(&self) -> Vec<[f64; 2]> {
        self.mapped(|value| value)
    }

    fn mapped(&self, f: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
        self.wavelength_nm.iter().zip(&self.value).map(|(&nm, &value)| [nm, f(value)]).collect()
    }

    fn peak(&self) -> f64 {
        self.value.iter().copied().filter(|value| value.is_finite()).fold(0.0, f64::max)
    }
}

/// Wavelength limits that hold all curves, on multiples of 10 nm.
fn wavelength_limits<'a>(curves: impl IntoIterator<Item = &'a NamedCurve>) -> [f64; 2] {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for nm in curves.into_iter().flat_map(|curve| &curve.wavelength_nm) {
        low = low.min(*nm);
        high = high.max(*nm);
    }
    if low < high { [(low / 10.0).floor() * 10.0, (high / 10.0).ceil() * 10.0] } else { [350.0, 750.0] }
}
