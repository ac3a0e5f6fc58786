//! The share of the porphyrin in the frames of a study whose region is tissue of a known site.

use super::analyze::frame_light;
use super::capture::behind_filter;
use super::tissue_family::{FamilyFrame, other_tissue_families, tissue_family};
use super::{CameraResponse, CapturedFrame, PipelineError};
use crate::analysis::{
    ChannelNoise, FamilyAverage, PixelMean, PixelSelection, SceneOnSensor, SharePosterior,
};
use crate::study::{AnalysisPlan, Study};

/// The estimate from the analyzed frame and the further ones, by all of their channels that see light; `None` without a prior or
/// where the region has no usable pixel.
pub(super) fn tissue_estimate(
    study: &Study,
    settings: &AnalysisPlan,
    frames: &[CapturedFrame],
    scene: Option<(SceneOnSensor<'_>, &PixelSelection)>,
    noise: ChannelNoise,
    is_lit: &dyn Fn(usize) -> bool,
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
        let camera = CameraResponse::new(&behind_filter(&lens, capture), sensor, grid, None);
        let channels = camera.seeing_channels();

        // Mean electrons over the pixels that are usable in both frames
        let (image, k) = (&frame.developed, frame.raw.dn_per_electron);
        let noise = ChannelNoise { dn_per_electron: k, ..noise };
        let noise = ChannelNoise { floor_dn: image.noise_floor_dn.max(noise.floor_dn), ..noise };
        let same_size = image.width == region.width && image.height == region.height;
        let usable = |pixel: &usize| same_size && is_lit(*pixel) && !image.saturated[*pixel];
        let pixels: Vec<usize> = region.pixels.iter().copied().filter(usable).collect();
        let Some(mean) = PixelMean::new(image, &channels, &pixels, &noise) else { return Ok(None) };
        electrons.extend(mean.dn.iter().map(|dn| dn / k));
        variance.extend(mean.variance_dn2.iter().map(|dn2| dn2 / (k * k)));

        family_frames.push(FamilyFrame {
            label: label.clone(),
            camera_of_reflected: CameraResponse::new(
                &behind_filter(&lens, capture),
                sensor,
                grid,
                Some(&irradiance),
            ),
            camera,
            channels,
            irradiance,
            time_s: frame.raw.exposure_s,
        });
    }
    let named = tissue_family(prior, &family_frames, grid)?;
    let others = other_tissue_families(prior, &family_frames, grid)?;
    let average =
        FamilyAverage { named: &named, others: &others, probability_of_named: prior.site_probability };
    Ok(average.posterior(&electrons, &variance))
}
