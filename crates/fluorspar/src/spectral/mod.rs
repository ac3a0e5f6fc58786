//! Wavelength grids, spectra that know their quantity, excitation-emission matrices, fluorophores and color.
//!
//! | type | what it is |
//! |---|---|
//! | [`WavelengthGrid`] | bins with explicit edges; every image and every band vector uses one |
//! | [`Curve`] | a function of wavelength, piecewise linear on its own (fine) samples |
//! | [`CurveModel`] | an analytic spectrum with named parameters, evaluated into a [`Curve`] |
//! | [`Spectrum`] | bin averages of one [`Quantity`] on a grid |
//! | [`PhotonEem`], [`EnergyEem`] | excitation-emission (Donaldson) matrices, never mixed silently |
//! | [`Fluorophore`] | a named photon yield density with source, range and scale |

mod cie_tables;
mod colorimetry;
mod curve;
mod curve_model;
mod eem;
mod eem_toolbox;
mod excitation_nodes;
mod fluorophore;
mod hemoglobin;
mod quantity;
mod spectrum;
mod tables;
mod wavelength_grid;

pub use colorimetry::{StandardObserver, daylight_d65, encode_srgb, linear_srgb};
pub(crate) use curve::Lookup;
pub use curve::{Curve, CurveError, FINE_STEP_NM};
pub use curve_model::*;
pub use eem::{EemError, EemTable, EnergyEem, PhotonEem, SeparableTerm, Stokes, YieldDensity};
pub use eem_toolbox::{TOOLBOX_SAMPLES, TOOLBOX_START_NM, TOOLBOX_STEP_NM, ToolboxEem};
pub(crate) use excitation_nodes::power_and_moment;
pub use excitation_nodes::{ExcitationNodes, NodesError};
pub use fluorophore::{BandTerm, Fluorophore, LogNormalBand, YieldUnit};
pub(crate) use hemoglobin::absorption_per_cm as blood_absorption_per_cm;
pub use hemoglobin::{blood_transmittance, oxyhemoglobin_extinction};
pub use quantity::{
    Dimensionless, Irradiance, Quantity, QuantumEfficiency, Radiance, RadiantPower, Reflectance,
    Transmittance,
};
pub use spectrum::{GridMismatch, Spectrum};
pub(crate) use tables::{TableReader, TableWriter};
pub use wavelength_grid::{GridError, MAX_BINS, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, WavelengthGrid};
