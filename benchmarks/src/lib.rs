//! Scenes for measuring whole renders, and their export for other renderers.
//!
//! | scene | what |
//! |---|---|
//! | [`BenchmarkScene::CornellBox`] | 32 triangles, one ceiling light, matte |
//! | [`BenchmarkScene::ClosedCavity`] | 230 thousand triangles, checkered and glossy, 16 teeth, two lights of 5 mm |
//! | [`BenchmarkScene::MatteCavity`] | the same without gloss, which every renderer models alike |
//! | [`BenchmarkScene::CavityThroughLens`] | the closed cavity through the 3.5 mm lens of the catalogue, traced |
//! | [`BenchmarkScene::Mouth`] | the parametric mouth with its default parameters, seen from outside |
//!
//! Scenes are generated, from the same few formulas every time; nothing is read from files.

mod cpu_time;
pub mod export;
mod meshes;
mod scenes;

pub use cpu_time::cpu_seconds;
pub use scenes::{BenchmarkScene, MOST_DYES, SceneOptions};
