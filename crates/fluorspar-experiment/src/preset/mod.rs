//! The catalogue: lights, filters, reflectances, quantum efficiencies, sensors, fluorophores and experiments that
//! ship with the library, one small file each, with source, assumptions and fit error. Entries of the user stand beside them
//! ([`use_catalogue`]).
//!
//! | what | list | one entry |
//! |---|---|---|
//! | light spectra | [`list`]`(PresetKind::Light)` | [`light_spectrum`] |
//! | filters | [`list`]`(PresetKind::Filter)` | [`filter`] |
//! | diffuse reflectances | [`list`]`(PresetKind::Reflectance)` | [`reflectance`] |
//! | metals | [`list`]`(PresetKind::Metal)` | [`metal`] |
//! | quantum efficiencies | [`list`]`(PresetKind::QuantumEfficiency)` | [`quantum_efficiency`] |
//! | sensors | [`list`]`(PresetKind::Sensor)` | [`sensor`] |
//! | fluorophores | [`list`]`(PresetKind::Fluorophore)` | [`fluorophore`] |
//! | glasses | [`list`]`(PresetKind::Glass)` | [`glass`] |
//! | lenses | [`list`]`(PresetKind::Lens)` | [`lens`], [`lens_or_file`] |
//! | tissue sites | [`list`]`(PresetKind::Site)` | [`site`], [`site_or_file`] |
//! | states of tissue | [`list`]`(PresetKind::State)` | [`state`] |
//! | experiments, flat samples, design problems | [`list`]`(PresetKind::Experiment)`, ... | [`text`]`(PresetKind::Experiment, ...)` |

mod catalogue;
mod curve_preset;
#[cfg(test)]
mod fluorophore_fit_tests;
mod fluorophore_preset;
mod kind;
mod lens_preset;
mod metal_preset;
mod sensor_preset;
mod site_preset;
mod sources;
mod state_preset;
mod user_catalogue;
mod user_entries;

pub use catalogue::{PresetSummary, list, names, text};
pub use curve_preset::{
    CurveFit, CurvePreset, CurveQuantity, QuantumEfficiencyPreset, SpectraPreset, filter, light_spectrum,
    quantum_efficiency, reflectance, reflectance_curves,
};
pub use fluorophore_preset::{FluorophoreFit, FluorophoreMask, FluorophorePreset, PublishedDye, fluorophore};
pub use kind::{PresetError, PresetKind};
pub use lens_preset::{LensError, LoadedLens, glass, lens, lens_or_file};
pub use metal_preset::{MetalPreset, metal};
pub use sensor_preset::{SensorPreset, sensor};
pub use site_preset::{compared_sites, site, site_of_text, site_or_file};
pub use sources::{UsedPreset, used_presets};
pub use state_preset::state;
pub use user_catalogue::{check_catalogue, use_catalogue};
pub(crate) use user_entries::{has_user_catalogue, user_entry};
