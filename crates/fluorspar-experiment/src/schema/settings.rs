//! Wavelengths and effort of a render.

use fluorspar::image::StatisticsKind;
use fluorspar::render::ComponentBands;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Wavelength bins: `first_nm`, `last_nm` and `step_nm`, or `edges_nm`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SpectralSection {
    /// Bins between edges.
    Edges(EdgeBins),
    /// Bins of one width.
    Uniform(UniformBins),
}

/// Bins between edges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EdgeBins {
    /// Edges of the bins, nm, increasing; one more than there are bins.
    pub edges_nm: Vec<f64>,
}

/// Bins of one width.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UniformBins {
    /// Center of the first bin, nm, 200 to 1200. Default 350.
    pub first_nm: f64,
    /// Center of the last bin, nm, 200 to 1200. Default 750.
    pub last_nm: f64,
    /// Width of a bin, nm. Default 5.
    pub step_nm: f64,
}

impl Default for UniformBins {
    fn default() -> Self {
        Self { first_nm: 350.0, last_nm: 750.0, step_nm: 5.0 }
    }
}

impl Default for SpectralSection {
    fn default() -> Self {
        Self::Uniform(UniformBins::default())
    }
}

fn is_none(kind: &StatisticsKind) -> bool {
    *kind == StatisticsKind::None
}

fn is_basis(bands: &ComponentBands) -> bool {
    *bands == ComponentBands::Basis
}

/// Image size, samples and limits of the render.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("x-renamed" = { "excitation_edges_nm": "excitation_basis_nm = [340, 500], the range of the peaks of lights" }))]
pub struct RenderSection {
    /// Columns of the radiance image, 1 to 16384. Default 320.
    #[schemars(range(min = 1, max = 16384))]
    pub width_px: u32,
    /// Rows of the radiance image, 1 to 16384. Default 240.
    #[schemars(range(min = 1, max = 16384))]
    pub height_px: u32,
    /// Light paths per pixel, 1 to 1 000 000. Default 64.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub samples_per_pixel: u32,
    /// Most surfaces that a path may meet, 1 to 1000. 1 is direct light only. Default 8.
    #[schemars(range(min = 1, max = 1000))]
    pub max_depth: u32,
    /// Seed of all random numbers of the render and of the noise. Default 1.
    pub seed: u64,
    /// Seconds after which rendering stops with the samples it has. Default: no limit.
    pub time_limit_s: Option<f64>,
    /// Most memory that the images of the render may take, GiB, 0.001 to 1024. Default 8.
    pub memory_limit_gib: f64,
    /// Statistics of the samples: `none`, `light_groups` or `components`. Two half-buffers and the
    /// variance of each; memory grows by 16 bytes per pixel and band for each. Default `none`.
    #[serde(skip_serializing_if = "is_none")]
    pub statistics: StatisticsKind,
    /// Relative error, 1e-4 to 0.5, at which a tile of 16 x 16 pixels gets no more samples; `samples_per_pixel` is the
    /// most that it gets. Default: none, all pixels get the same.
    pub relative_error: Option<f64>,
    /// Names of captures whose sensor channels must all reach `relative_error`. Default: all captures that have light.
    pub error_captures: Option<Vec<String>>,
    /// Range of wavelengths, nm, whose radiance must reach `relative_error`, for each light group alone. Instead of
    /// `error_captures`.
    pub error_range_nm: Option<[f64; 2]>,
    /// First and last peak wavelength, nm, of light sources that shall be exchangeable after the render, such as [340, 500]: light
    /// groups whose light lies there are kept apart by excitation wavelength, so that `capture` and `analyze` follow a change
    /// of their spectrum, filters and power. Default: none.
    pub excitation_basis_nm: Option<[f64; 2]>,
    /// How the spectra of each component are kept: `basis`, coefficients from which all bands follow to a tenth of a percent, in an eighth of
    /// the values, or `all` bands. With `statistics`, `relative_error` or `excitation_basis_nm` all are kept. Default `basis`.
    #[serde(skip_serializing_if = "is_basis")]
    pub component_bands: ComponentBands,
    /// Mirror light that was scattered before no sharper than a roughness of 0.2 would, as pbrt's integrator does by the same name: few
    /// specks from wet surfaces, whose caustics are blurred. Default false: without bias.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub regularize: bool,
}

impl Default for RenderSection {
    fn default() -> Self {
        Self {
            width_px: 320,
            height_px: 240,
            samples_per_pixel: 64,
            max_depth: 8,
            seed: 1,
            time_limit_s: None,
            memory_limit_gib: 8.0,
            statistics: StatisticsKind::None,
            relative_error: None,
            error_captures: None,
            error_range_nm: None,
            excitation_basis_nm: None,
            component_bands: ComponentBands::Basis,
            regularize: false,
        }
    }
}
