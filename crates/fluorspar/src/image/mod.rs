//! Images with a wavelength axis, component images, raw mosaics and developed channel images.

mod channel_planes;
mod component_image;
mod component_rows;
mod excitation_image;
pub mod film;
mod interpolation_taps;
mod orientation;
mod sensor_image;
mod spectral_basis;
mod spectral_image;

pub use channel_planes::{ChannelPlanes, ComponentFactors};
pub use component_image::{
    Component, ComponentBases, ComponentImage, FeatureMaps, LightPath, SampleStatistics, StatisticsKind, View,
};
pub use component_rows::{ComponentRows, PreparedRows};
pub(crate) use excitation_image::BasisBuilder;
pub use excitation_image::{BasisComponent, ExcitationImage, GroupBasis, RelitComponent, RelitRows};
pub use film::{Film, FilmLayout, MergeError};
pub use interpolation_taps::InterpolationTaps;
pub(crate) use interpolation_taps::Tap;
pub use orientation::Orientation;
pub use sensor_image::{CalibrationNoise, ChannelImage, Mosaic, SensorImage, SubtractedLight};
pub use spectral_basis::SpectralBasis;
pub(crate) use spectral_basis::{are_finite, representatives};
pub use spectral_image::{ImageShapeError, SpectralImage};
