//! Predicts what a fluorescence camera records, before the camera is built.
//!
//! A scene with absolute lights, filters and fluorescent tissue goes in; spectral radiance, raw sensor images and the
//! numbers that are decided from come out. Every stage is a function from plain data to plain data:
//!
//! | stage | call | gives |
//! |---|---|---|
//! | description | [`study::Study`] from code, or from a file by `fluorspar-experiment` | [`study::Study`]: scene, camera, captures |
//! | light transport | [`render::render`] | [`image::ComponentImage`]: radiance, W/(sr m² nm), by light and fluorophore |
//! | any mixture of the parts | [`image::ComponentImage::recombine`] | [`image::SpectralImage`] of radiance |
//! | optics | [`optics::IdealLens::form_image`] | [`image::SpectralImage`] of irradiance, W/(m² nm) |
//! | sensor | [`sensor::Sensor::expose_rate`] | [`image::SensorImage`]: mosaic of digital numbers |
//! | development | [`sensor::Development`] | [`image::ChannelImage`]: linear channels, black subtracted |
//! | analysis | [`analysis::analyze_region`] | [`analysis::Analysis`]: chromaticity, porphyrin fraction, with intervals |
//!
//! [`pipeline::evaluate`] runs everything after the render at once; [`pipeline::predict`] does so for a flat sample without geometry.
//! [`design`] compares lights, filters and sensors by what they could prove. [`names`] suggests what a misspelled name may have meant. [`safety`] assesses light sources for the safety of eyes and skin.
//!
//! The physics knows no files. What lies around it:
//!
//! | crate | what |
//! |---|---|
//! | `fluorspar-experiment` | experiment files (TOML), and the catalogue of lights, filters, reflectances, sensors, fluorophores, lenses |
//! | `fluorspar-format` | images, films, raw frames, meshes, measured spectra and lenses, read and written |
//! | `fluorspar-anatomy` | a parametric mouth |
//!
//! Inside the library lengths are in meters, wavelengths in nanometers, power in watts; other units are in the name
//! (`pixel_size_um`, `exposure_s`). The same seed gives the same bits for any number of threads.
//!
//! Out of scope: fluorescence lifetime, polarization, coherent imaging, photobleaching, light that travels sideways
//! inside tissue.

pub mod analysis;
pub mod design;
pub mod digest;
pub mod findings;
pub mod geometry;
pub mod image;
pub mod interruption;
pub mod light;
pub mod material;
pub mod names;
pub mod optics;
pub mod pipeline;
pub mod quote;
pub mod render;
pub mod safety;
pub mod sampling;
pub mod scene;
pub mod sensor;
pub mod spectral;
pub mod study;
pub mod tissue;
pub mod units;
pub mod warning;
