//! Images with a wavelength axis, component images, raw mosaics and developed channel images.

mod component_image;
mod sensor_image;
mod spectral_image;

pub use component_image::{Component, ComponentImage, FeatureMaps, Light, View};
pub use sensor_image::{ChannelImage, Mosaic, SensorImage, SubtractedLight};
pub use spectral_image::{ImageShapeError, SpectralImage};
