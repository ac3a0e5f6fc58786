//! Light transport: paths are sampled once with scalar densities, then spectra run along them from the far end to
//! the camera, on whole band vectors and for every component at once.
//!
//! | file | what |
//! |---|---|
//! | `settings` | how much work a render does |
//! | `error` | why a render cannot start |
//! | `choose_basis` | which light groups are kept apart by excitation wavelength, and at which nodes |
//! | `share` | shards: which samples of which tiles one process renders |
//! | `memory` | memory estimates |
//! | `component_labels` | labels of the components, in the order of the film |
//! | `component_bases` | which bands of each component are worth storing |
//! | `scene_digest` | digest of everything that decides the value of a sample |
//! | `compiled_scene` | a scene as plain buffers |
//! | `compile` | makes these buffers: geometry, lights, materials, fluorescence operators |
//! | `instances` | meshes at many places |
//! | `fluorescence_operator` | an excitation-emission matrix applied to a band vector: Eq. 3 |
//! | `excitation` | what reflected light excites, on a basis of its spectra |
//! | `surface` | what a ray finds: frame, texture coordinates, side |
//! | `intersect` | the nearest surface or light along a ray, and visibility |
//! | `light_targets` | light sources as rays meet them, discs of rings together |
//! | `light_sampling` | directions toward lights, with densities |
//! | `survival_probability` | expected remaining contribution of a path, which decides its survival |
//! | `material_spread` | radial profiles of a material, and distances drawn from them |
//! | `translucency` | where light entered that leaves translucent tissue |
//! | `path` | the vertices of a path |
//! | `path_integrator` | samples paths: direct illumination, continuation, Russian roulette |
//! | `spread_spectra` | what of it arrives at the distance that a path has drawn |
//! | `spectral_accumulation` | runs spectra backwards along a path |
//! | `camera_sample` | one sample of one pixel, through pinhole or lens |
//! | `block_sum` | sums of a block of samples of a few pixels |
//! | `pilot` | pilot samples, which find the quanta of the film |
//! | `feature_maps` | geometry behind each pixel |
//! | `visible_surfaces` | the same at once, by a depth buffer, for previews |
//! | `adaptive` | when a tile has samples enough |
//! | `film_renderer` | progressive tile renderer: multithreaded, resumable |

mod adaptive;
mod basis_accumulation;
mod block_sum;
mod camera_sample;
mod choose_basis;
mod compile;
mod compiled_scene;
mod component_bases;
mod component_labels;
mod error;
mod excitation;
mod feature_maps;
mod film_renderer;
mod fluorescence_operator;
mod instances;
mod intersect;
mod light_sampling;
mod light_targets;
mod material_spread;
mod memory;
mod path;
mod path_integrator;
mod pilot;
mod scene_digest;
mod settings;
mod share;
mod spectral_accumulation;
mod spread_spectra;
mod surface;
mod survival_probability;
mod translucency;
#[cfg(test)]
mod translucency_tests;
mod visible_surfaces;

pub use adaptive::{ErrorChannel, ErrorTarget, ErrorTargetError, FIRST_ERROR_CHECK};
pub use choose_basis::{BasisError, choose_basis};
pub(crate) use choose_basis::{are_in_proportion, excitation_responses};
pub use error::RenderError;
pub use film_renderer::{Checkpoint, FilmRenderer, RenderControl, RenderProgress, render, render_sums};
pub use fluorescence_operator::FluorescenceOperator;
pub(crate) use fluorescence_operator::direct_exitance;
pub use memory::{basis_bytes, memory_bytes, surface_bytes, tile_row_bytes, whole_image_bytes};
pub use scene_digest::scene_digest;
pub use settings::{BasisSettings, ComponentBands, Estimator, RenderSettings};
pub use share::Share;
pub use visible_surfaces::visible_surfaces;
