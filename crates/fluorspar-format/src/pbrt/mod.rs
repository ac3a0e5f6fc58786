//! Scenes of pbrt, versions 3 and 4, and of pbrt-v3-spectral: what the files say, as a plain tree.
//!
//! | file | what |
//! |---|---|
//! | `token` | words, with lines and columns |
//! | `parameter` | typed parameters |
//! | `transform` | matrices of directives |
//! | `reader` | directives, with their stack of attributes; files that include others |
//! | `scene` | the tree |

mod error;
mod parameter;
mod reader;
mod scene;
#[cfg(test)]
mod tests;
mod token;
mod transform;

pub use error::{PbrtError, PbrtPlace};
pub use parameter::{PbrtKind, PbrtParameter, PbrtValues};
pub use reader::read_pbrt;
pub use scene::{
    PbrtEntity, PbrtInstance, PbrtMaterial, PbrtPlaced, PbrtRemark, PbrtScene, PbrtSettings, PbrtShape,
    PbrtTexture, PbrtVersion,
};
