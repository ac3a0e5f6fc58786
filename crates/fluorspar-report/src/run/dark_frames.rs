//! Frames that say little: they see next to nothing, or reflected light.

use fluorspar::pipeline::{CapturedFrame, FrameLeak};
use fluorspar_experiment::ResolvedExperiment;

use super::words::Words;

/// A pixel sees light when the sum of its channels is so many standard deviations of its dark noise.
const SEEN: f64 = 5.0;
/// Share of the pixels below which a frame is called dark.
const LEAST_LIT: f64 = 0.01;

/// Reflected over fluorescent electrons from which a frame is called one of reflected light.
pub const LEAKING: f64 = 0.1;

/// Warnings of frames of fluorescence to which their filters let reflected light through.
pub fn leaking_frames(leaks: &[FrameLeak]) -> Vec<String> {
    let warning = |leak: &FrameLeak| {
        let ratio = leak.leak_ratio.filter(|ratio| *ratio > LEAKING && !leak.is_reflectance())?;
        Some(format!(
            "Frame \"{}\": reflected excitation light is {:.0} % of the fluorescence. Every number takes it for fluorescence: block more of \
             the light before the lens, or make the light narrower",
            leak.frame,
            100.0 * ratio
        ))
    };
    leaks.iter().filter_map(warning).collect()
}

/// Warnings of frames whose lights hardly reach what the camera sees, one sentence or two each.
pub fn dark_frames(experiment: &ResolvedExperiment, frames: &[CapturedFrame]) -> Vec<String> {
    let study = &experiment.study;
    let warning = |frame: &CapturedFrame| {
        let capture = study.capture(&frame.raw.label)?;
        let groups = &study.scene.light_groups;
        study.scene.lights.iter().find(|light| capture.frame.drive(&groups[light.group].name) != 0.0)?;
        let developed = &frame.developed;
        let n = developed.channels.len().max(1);
        let least = SEEN * developed.noise_floor_dn * (n as f64).sqrt();
        let sums = developed.data.chunks_exact(n).map(|pixel| f64::from(pixel.iter().sum::<f32>()));
        let all = developed.data.len() / n;
        // Of a frame with light few pixels are looked at
        let enough = (LEAST_LIT * all as f64) as usize + 1;
        let lit = sums.filter(|sum| *sum > least).take(enough).count();
        (lit < enough).then(|| {
            let lights = Words::of(experiment).lights(capture);
            format!(
                "Frame \"{}\": hardly any light reaches the camera: {lit} of {all} pixels rise above the noise after {:.1} ms. Does \
                 the light ({lights}) reach what the camera sees, and do the filters pass what comes from there?",
                frame.raw.label,
                1e3 * frame.raw.exposure_s
            )
        })
    };
    frames.iter().filter_map(warning).collect()
}
