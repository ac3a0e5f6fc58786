//! What the estimate of a tissue family would say of the region of a design, before its camera is built.

use serde::Serialize;

use super::region_signal::CameraResponse;
use super::tissue_family::{FamilyFrame, tissue_family};
use crate::analysis::{PorphyrinSpread, SignalLevel, VisibleShare, block_side_px};
use crate::design::{Design, DesignSpace, LitExposure};
use crate::study::TissuePrior;
use crate::tissue::TissueError;

/// What an analysis of the frames of a design would find in the typical tissue of a site.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DesignEstimate {
    /// What is assumed of the tissue.
    pub prior: String,
    /// Share of the porphyrin that the region of the design holds.
    pub share: f64,
    /// The 95 % interval that the estimate would give of it, lying as in mouths of the catalogue.
    pub interval: [f64; 2],
    /// The smallest shares that are told from none.
    pub visible: VisibleShare,
}

/// The estimate of a region of a design, by its number: the function by which frames are analyzed. White frames have no part in it. `None`
/// where the camera sees nothing of the region, or no porphyrin beside other light, which `is_porphyrin` tells by name.
///
/// # Errors
/// Those of [`tissue_family`].
pub fn design_estimate(
    space: &DesignSpace,
    design: &Design,
    region: usize,
    is_porphyrin: impl Fn(&str) -> bool,
    prior: &TissuePrior,
) -> Result<Option<DesignEstimate>, TissueError> {
    let Some(model) = space.problem().regions_of(design.geometry).nth(region) else { return Ok(None) };
    let exposures = space.lit_exposures(design, region);
    let frame = |exposure: &LitExposure| {
        let camera = CameraResponse::of_exposure(exposure, false);
        FamilyFrame {
            label: exposure.light.clone(),
            irradiance: exposure.irradiance.clone(),
            channels: camera.seeing_channels(),
            camera,
            camera_of_reflected: CameraResponse::of_exposure(exposure, true),
            time_s: exposure.time_s,
        }
    };
    let frames: Vec<FamilyFrame> = exposures.iter().map(frame).collect();
    let (Some(first), Some(lit)) = (frames.first(), exposures.first()) else { return Ok(None) };
    // The share is that of the first frame, in the channels that count there
    let counted = first.camera.rgb().map_or_else(|| first.channels.clone(), |rgb| rgb.to_vec());
    let electrons = |light: &[f64]| -> f64 {
        counted.iter().map(|channel| first.camera.channel_electrons(*channel, light, first.time_s)).sum()
    };
    let parts = model.response.fluorescence.iter().zip(model.response.fluorescence_under(&lit.irradiance));
    let (mut porphyrin, mut all) = (0.0, 0.0);
    for (part, light) in parts {
        let electrons = electrons(&light);
        all += electrons;
        porphyrin += if is_porphyrin(&part.name) { electrons } else { 0.0 };
    }
    let share = porphyrin / all;
    if !(share > 0.0 && share < 1.0) {
        return Ok(None);
    }
    let family = tissue_family(prior, &frames, &model.response.grid)?;
    let of_data = |of: &dyn Fn(&LitExposure) -> &Vec<f64>| -> Vec<f64> {
        let seen = exposures.iter().zip(&frames);
        seen.flat_map(|(exposure, frame)| frame.channels.iter().map(|c| of(exposure)[*c])).collect()
    };
    let pixels = space.pixels_of(design, region);
    let level = SignalLevel {
        electrons: of_data(&|exposure| &exposure.electrons),
        variance: of_data(&|exposure| &exposure.variance),
        blocks: (pixels / (block_side_px(pixels) as f64).powi(2)) as usize,
    };
    let interval = family.expected_interval(&level, share, PorphyrinSpread::Usual);
    Ok(interval.zip(family.visible_share(&level)).map(|(interval, visible)| DesignEstimate {
        prior: family.prior.clone(),
        share,
        interval,
        visible,
    }))
}
