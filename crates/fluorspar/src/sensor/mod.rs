//! From irradiance on the film to digital numbers, and back to linear channel images.
//!
//! | step | type or call | file |
//! |---|---|---|
//! | electrons per photon | [`SpectralQe`] | `quantum_efficiency.rs` |
//! | data sheet | [`SensorModel`], by default Table 1 of Lyu et al. 2021 | `model.rs` |
//! | film samples to pixels | [`Sensor::electron_rate`] | `pixel_integration.rs` |
//! | noise and conversion | [`Sensor::expose`] | `noise.rs`, `adc.rs`, `isetcam.rs` |
//! | numbers without an image | [`Sensor::flat_response`] | `flat_response.rs` |
//! | exposure time | [`AutoExposure`] | `auto_exposure.rs` |
//! | several frames | [`CaptureSequence`] | `capture.rs` |
//! | linear channels | [`develop`], [`develop_with_ambient`], [`Development`] | `develop.rs`, `demosaic.rs` |
//! | dark frames, flat fields, bad pixels | [`MasterFrame`], [`FlatField`], [`BadPixels`] | `calibration.rs` |
//! | a second instrument | [`Spectroradiometer`] | `spectroradiometer.rs` |
//! | exposures merged to one | [`merge_exposures`] | `develop.rs` |
//!
//! Out of scope: rolling shutter, crosstalk between pixels, lag and blooming.

mod adc;
mod auto_exposure;
mod calibration;
mod capture;
mod demosaic;
mod develop;
mod exposure;
mod flat_response;
pub mod isetcam;
mod model;
mod noise;
mod pixel_integration;
mod quantum_efficiency;
#[cfg(test)]
mod reference_vectors;
mod spectroradiometer;
#[cfg(test)]
mod statistics_tests;

pub use auto_exposure::AutoExposure;
pub use calibration::{BadPixels, FlatField, MasterFrame};
pub use capture::{CaptureFrame, CaptureSequence};
pub use demosaic::Demosaicing;
pub use develop::{DevelopError, Development, LinearMosaic, develop, develop_with_ambient, merge_exposures};
pub use exposure::{ElectronRate, Exposure, Sensor};
pub use flat_response::FlatResponse;
pub use model::{Emva1288, SensorMode, SensorModel, SensorProblem};
pub use pixel_integration::FilmExtent;
pub use quantum_efficiency::{ChannelQe, SpectralQe};
pub use spectroradiometer::{SpectralReading, Spectroradiometer};
