//! Scenes of pbrt (versions 3 and 4, and pbrt-v3-spectral) as studies: a front beside that of experiment files.
//!
//! | file | what |
//! |---|---|
//! | `convert` | from the tree that `fluorspar-format` reads to a scene |
//! | `given` | parameters of a directive, and which of them were used |
//! | `rgb` | colors as smooth spectra |
//! | `spectrum` | spectra of parameters: pairs, files, names, black bodies, colors |
//! | `texture` | textures as sums of spectra with weights |
//! | `material` | materials |
//! | `photolumi` | fluorescence matrices of pbrt-v3-spectral |
//! | `shape` | shapes as meshes, spheres and discs |
//! | `light` | lights and what shapes emit |
//! | `experiment` | the scene as an experiment file, with its meshes |
//! | `camera` | camera, film, sampler, integrator |
//! | `write` | a scene as one of pbrt |
//! | `gltf` | what of a scene glTF holds |
//!
//! What has no counterpart is named with file and line in [`PbrtStudy::remarks`]. `docs/pbrt.md` has the whole table.

mod camera;
mod convert;
mod experiment;
mod given;
mod gltf;
mod light;
mod material;
mod photolumi;
mod rgb;
mod shape;
mod spectrum;
mod texture;
mod write;

pub use convert::{Emission, PbrtOptions, PbrtStudy, Remark, check_light, load};
pub use experiment::{ConvertedScene, to_experiment};
pub use gltf::{DrawnPart, DrawnScene, to_gltf};
pub use rgb::{color_spectrum, primaries};
pub use write::to_pbrt;
