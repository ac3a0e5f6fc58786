//! Digest of everything that decides the value of a sample.

use std::fmt;

use sha2::{Digest, Sha256};

use super::settings::RenderSettings;
use crate::digest::hex;
use crate::scene::Scene;

/// Number of the way in which paths are drawn: one more whenever the same scene and seed come to give other samples, so that
/// films of before are not continued with samples that do not fit theirs.
const SAMPLING: u32 = 7;

/// SHA-256 of everything that decides the value of a sample: the scene with all its numbers, seed, depth, estimator,
/// the version of the program and of its sampling. Lower-case hexadecimal.
pub fn scene_digest(scene: &Scene, settings: &RenderSettings) -> String {
    struct Writer(Sha256);
    impl fmt::Write for Writer {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0.update(text.as_bytes());
            Ok(())
        }
    }
    let mut writer = Writer(Sha256::new());
    // Debug output of floats is exact, that of meshes and images holds their digests, and it covers every field that anyone adds
    // to a scene. A digest can't fail.
    let _ = fmt::Write::write_fmt(
        &mut writer,
        format_args!(
            "{} {SAMPLING} {} {} {:?} []{}{} {scene:?}",
            env!("CARGO_PKG_VERSION"),
            settings.seed,
            settings.max_depth,
            settings.estimator,
            settings.excitation_basis.as_ref().map_or_else(String::new, |basis| format!(" {basis:?}")),
            if settings.regularize { " regularized" } else { "" }
        ),
    );
    hex(&writer.0.finalize())
}
