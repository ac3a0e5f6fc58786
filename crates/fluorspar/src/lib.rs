//! Predicts what a fluorescence camera records.

pub mod analysis;
pub mod anatomy;
pub mod experiment;
pub mod format;
pub mod geometry;
pub mod image;
pub mod light;
pub mod material;
pub mod optics;
pub mod pipeline;
pub mod preset;
pub mod render;
pub mod safety;
pub mod sampling;
pub mod scene;
pub mod sensor;
pub mod spectral;
pub mod units;
