//! The share of the porphyrin in the frames of a study whose region is tissue of a known site.

use super::analyze::frame_light;
use super::capture::behind_filter;
use super::tissue_family::{FamilyFrame, tissue_family};
use super::{CameraResponse, CapturedFrame, PipelineError};
use crate::analysis::{
    Analysis, AnalysisError, ChannelNoise, ChromaticityMap, PixelSelection, SceneOnSensor, SharePosterior,
    mean_of_pixels,
};
use crate::study::{AnalysisPlan, Study};

/// The estimate from the analyzed frame and the further ones; `None` without a prior or where the region has no usable pixel.
pub(super) fn tissue_estimate(
    study: &Study,
    settings: &AnalysisPlan,
    frames: &[CapturedFrame],
    scene: Option<(SceneOnSensor<'_>, &PixelSelection)>,
    analysis: &Analysis,
    chromaticity: &ChromaticityMap,
    region: &PixelSelection,
) -> Result<Option<SharePosterior>, PipelineError> {
    let (Some(prior), Some(sensor)) = (&settings.tissue, &study.camera.sensor) else { return Ok(None) };
    let Some(lens) = study.camera.lens_behind_filters() else { return Ok(None) };
    let grid = &study.scene.grid;
    let (mut family_frames, mut electrons, mut variance) = (Vec::new(), Vec::new(), Vec::new());
    for label in std::iter::once(&settings.frame).chain(&settings.further_frames) {
        let found = frames.iter().find(|frame| frame.raw.label == *label).zip(study.capture(label));
        let Some((frame, capture)) = found else {
            let known = frames.iter().map(|frame| frame.raw.label.as_str()).collect::<Vec<_>>();
            return Err(PipelineError::NoFrame { wanted: label.clone(), known: known.join(", ") });
        };
        let Some(irradiance) = frame_light(study, capture, scene) else { return Ok(None) };

        // Mean electrons over the pixels that are usable in both frames
        let (image, k) = (&frame.developed, frame.raw.dn_per_electron);
        let noise = ChannelNoise { dn_per_electron: k, ..analysis.settings.noise };
        let noise = ChannelNoise { floor_dn: image.noise_floor_dn.max(noise.floor_dn), ..noise };
        let same_size = image.width == region.width && image.height == region.height;
        let usable =
            |&pixel: &usize| same_size && chromaticity.at(pixel).is_some() && !image.saturated[pixel];
        let pixels = region.pixels.iter().copied().filter(usable);
        let mean = mean_of_pixels(image, pixels, &noise, None).map_err(AnalysisError::from)?;
        let Some([mean, of_mean]) = mean else { return Ok(None) };
        electrons.extend(mean.map(|dn| dn / k));
        variance.extend(of_mean.map(|dn2| dn2 / (k * k)));

        let lens = behind_filter(&lens, capture);
        family_frames.push(FamilyFrame {
            label: label.clone(),
            camera: CameraResponse::new(&lens, sensor, grid, None),
            camera_of_reflected: CameraResponse::new(&lens, sensor, grid, Some(&irradiance)),
            irradiance,
            time_s: frame.raw.exposure_s,
        });
    }
    let family = tissue_family(prior, &family_frames, grid)?;
    Ok(family.posterior(&electrons, &variance))
}
