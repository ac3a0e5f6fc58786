//! What a job takes, told and judged before it begins.

use fluorspar::image::StatisticsKind;
use fluorspar::render::{memory_bytes, whole_image_bytes};
use fluorspar::study::Study;

/// Bytes of the packed sums in a film file for each byte of them in memory, at most: of the eight bytes of a sum, seven are in
/// use after 2^17 samples of the largest quantum, and fewer before.
const FILM_PACKING: f64 = 7.0 / 8.0;

/// Room of a rendered image on the disk, bytes: all values as they are in memory, which packing only makes less.
pub(crate) fn image_bytes(study: &Study, components: bool) -> u64 {
    let (scene, settings) = (&study.scene, &study.render);
    let film = memory_bytes(scene, settings);
    if !components {
        let pixels = (scene.camera.width * scene.camera.height) as u64;
        return 4 * pixels * scene.grid.len() as u64;
    }
    // Four bytes instead of eight for a value, and three planes of statistics instead of two.
    let values = match settings.film_statistics() {
        StatisticsKind::None => film / 2,
        _ => film / 4 * 3,
    };
    values + whole_image_bytes(scene)
}

/// Room of a film on the disk while it is renewed, bytes: the earlier one stays until the new one is complete.
pub(crate) fn film_file_bytes(study: &Study) -> u64 {
    let film = memory_bytes(&study.scene, &study.render) as f64;
    2 * ((film * FILM_PACKING) as u64 + whole_image_bytes(&study.scene))
}

/// Room of the frames of all captures on the disk, bytes: 16 bits a pixel for a raw frame, 24 for a preview.
pub(crate) fn frame_bytes(study: &Study) -> u64 {
    let sensor = study.camera.sensor.as_ref();
    let pixels = sensor.map_or(0, |sensor| (sensor.model().columns * sensor.model().rows) as u64);
    let frames: usize = study.captures.iter().map(|capture| 1 + capture.bracket_ev.len()).sum();
    pixels * (2 * frames as u64 + 3 * study.captures.len() as u64)
}

/// Room of the folder of a run on the disk, bytes: components, the radiance of each frame with light, frames, and a few
/// megabytes of figures and report.
pub(crate) fn run_bytes(study: &Study) -> u64 {
    const REPORT: u64 = 16 << 20;
    let lit = study.captures.iter().filter(|c| c.frame.lights.values().any(|&drive| drive > 0.0)).count();
    image_bytes(study, true) + lit as u64 * image_bytes(study, false) + frame_bytes(study) + REPORT
}
