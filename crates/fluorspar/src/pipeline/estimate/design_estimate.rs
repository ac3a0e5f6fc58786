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

/// The estimate of a region of a design, by its number, that holds a share of porphyrin: the function by which frames are analyzed.
/// White frames have no part in it. `None` where the camera sees nothing of the region.
///
/// # Errors
/// Those of [`tissue_family`].
pub fn design_estimate(
    space: &DesignSpace,
    design: &Design,
    (region, share): (usize, f64),
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
