//! Light transport: paths are sampled once with scalar densities, then spectra run along them from the far end to
//! the camera, on whole band vectors and for every component at once.
//!
//! | file | what |
//! |---|---|
//! | `compiled_scene` | a scene as plain buffers: what rays and spectra need |
//! | `compile` | makes these buffers: geometry, lights, materials, fluorescence operators |
//! | `instances` | meshes at many places |
//! | `intersect` | the nearest surface or light along a ray, and visibility |
//! | `fluorescence_operator` | an excitation-emission matrix applied to a band vector |
//! | `light_sampling` | directions towards lights, with densities |
//! | `surface` | what a ray finds: frame, texture coordinates, side |
//! | `scattering` | what a material does to light at a point |
//! | `adjoint` | what a path can still carry, for Russian roulette |
//! | `path` | samples one path and keeps its vertices |
//! | `spectral_accumulation` | runs spectra backwards along a path |
//! | `camera_sample` | one sample of one pixel, through pinhole or lens |
//! | `integrator` | all pixels on all cores: passes, shards, progress, interruption |
//! | `adaptive` | when a tile has samples enough |

mod adaptive;
mod adjoint;
mod camera_sample;
mod compile;
mod compiled_scene;
mod fluorescence_operator;
mod instances;
mod integrator;
mod intersect;
mod light_sampling;
mod path;
mod path_batch;
mod scattering;
mod spectral_accumulation;
mod surface;

pub use adaptive::{ErrorChannel, ErrorTarget};
pub use fluorescence_operator::FluorescenceOperator;
pub(crate) use fluorescence_operator::direct_exitance;
pub use integrator::{
    Estimator, FilmRenderer, FilmWatch, RenderControl, RenderError, RenderProgress, RenderSettings, Share,
    memory_bytes, render, scene_digest, tile_row_bytes, whole_image_bytes,
};
