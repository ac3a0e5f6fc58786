//! From irradiance on the film to digital numbers, and back to linear channel images.
//!
//! | step | type or call | file |
//! |---|---|---|
//! | electrons per photon | [`SpectralQe`] | `quantum_efficiency.rs` |
//! | data sheet | [`SensorModel`], by default Table 1 of Lyu et al. 2021; [`Emva1288`] | `model.rs`, `data_sheet.rs` |
//! | film samples to pixels | [`Sensor::electron_rate_on_film`], [`Sensor::electron_rate_of`] | `pixel_integration.rs`, `film_rates.rs` |
//! | fall-off, crosstalk | [`SensorModel::relative_illumination`], [`Crosstalk`] | `relative_illumination.rs`, `crosstalk.rs` |
//! | when rows collect light | [`Shutter`], [`Strobe`] | `shutter.rs` |
//! | noise and conversion | [`Sensor::expose_rate`] | `physical_chain.rs`, `adc.rs`, `isetcam.rs` |
//! | which pixels are read | [`SensorModel::region_px`], [`Binning`] | `readout.rs` |
//! | numbers without an image | [`Sensor::flat_response`] | `flat_response.rs` |
//! | exposure time | [`AutoExposure`] | `auto_exposure.rs` |
//! | several frames | [`CaptureSequence`] | `capture.rs` |
//! | linear channels | [`Development`], [`LinearMosaic::without`] | `develop.rs`, `demosaic.rs` |
//! | dark frames, flat fields, bad pixels | [`MasterFrame`], [`FlatField`], [`BadPixels`] | `calibration.rs` |
//! | a second instrument | [`Spectroradiometer`] | `spectroradiometer.rs` |
//! | exposures merged to one | [`merge_exposures`] | `develop.rs` |
//! | measuring a simulated sensor | [`characterize`] | `characterization.rs`, `photon_transfer.rs` |
//! | a camera from its frames | [`FrameStack::of`], [`calibrate_frames`] | `frame_stack.rs`, `frame_calibration.rs` |
//!
//! A uniform field, exposed and developed:
//!
//! ```
//! use fluorspar::image::{Mosaic, SpectralImage};
//! use fluorspar::sensor::{Demosaicing, Development, Exposure, Sensor, SensorModel, SpectralQe};
//! use fluorspar::spectral::{Curve, Irradiance, Spectrum, WavelengthGrid};
//!
//! let qe = SpectralQe::from_curves(["R", "G", "B"].map(|channel| (channel, Curve::constant(0.5))))?;
//! let sensor = Sensor::new(SensorModel { columns: 8, rows: 4, ..SensorModel::default() }, qe)?;
//! assert_eq!(*sensor.mosaic(), Mosaic::bayer("grbg").ok_or("a Bayer pattern")?);
//!
//! let light = Spectrum::<Irradiance>::constant(&WavelengthGrid::default(), 1e-4); // W/(m² nm)
//! let mut irradiance = SpectralImage::<Irradiance>::zeros(light.grid().clone(), 2, 1);
//! irradiance.data_mut().fill(light.values()[0] as f32);
//! let rate = sensor.electron_rate(&irradiance);
//! let raw = sensor.expose(&irradiance, &Exposure { time_s: 0.01, ..Exposure::default() })?;
//! assert_eq!((rate.data.len(), raw.data.len()), (32, 32));
//!
//! let image = Development::default().linearize(&raw)?.demosaic(Demosaicing::Bilinear)?;
//! assert_eq!(image.channels, ["R", "G", "B"]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Out of scope: lag, blooming, correlated noise other than that of rows and columns.

mod adc;
mod auto_exposure;
mod calibration;
mod capture;
mod characterization;
#[cfg(test)]
mod characterization_tests;
mod crosstalk;
mod data_sheet;
mod demosaic;
mod develop;
mod exposure;
mod film_rates;
mod flat_response;
mod frame_calibration;
#[cfg(test)]
mod frame_calibration_tests;
mod frame_stack;
mod frame_statistics;
mod isetcam;
#[cfg(test)]
mod isetcam_formula_tests;
mod model;
pub mod photon_transfer;
mod physical_chain;
mod pixel_integration;
mod quantum_efficiency;
mod readout;
#[cfg(test)]
mod readout_tests;
#[cfg(test)]
mod reference_vector_tests;
mod relative_illumination;
mod shutter;
mod spectroradiometer;
#[cfg(test)]
mod statistics_tests;

pub use auto_exposure::AutoExposure;
pub(crate) use calibration::is_same_setting;
pub use calibration::{BadPixels, FlatField, MasterFrame};
pub use capture::{CaptureFrame, CaptureSequence};
pub use characterization::{
    ChannelSensitivity, Characterization, CharacterizationSettings, NonUniformity, PhotonTransferPoint,
    Recovered, characterize,
};
pub use crosstalk::Crosstalk;
pub use data_sheet::Emva1288;
pub use demosaic::Demosaicing;
pub(crate) use develop::noise_floor_dn;
pub use develop::{DevelopError, Development, LinearMosaic, merge_exposures};
pub use exposure::{EXPOSURE_MS, ElectronRate, Exposure, Sensor};
pub use film_rates::FilmRates;
pub use flat_response::FlatResponse;
pub use frame_calibration::{
    CalibrationProblem, ChannelCalibration, FrameCalibration, TransferPoint, calibrate_frames,
};
pub use frame_stack::{FrameStack, StackNoise};
pub use frame_statistics::MeasuredNumber;
pub use model::{SensorMode, SensorModel, SensorProblem};
pub use pixel_integration::FilmExtent;
pub use quantum_efficiency::{ChannelQe, SpectralQe};
pub use readout::{Binning, BinningKind};
pub use shutter::{Shutter, ShutterKind, Strobe};
pub use spectroradiometer::{SpectralReading, Spectroradiometer};
