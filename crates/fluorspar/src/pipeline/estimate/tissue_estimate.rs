//! The share of the porphyrin in the frames of a study whose region is tissue of a known site.

use std::collections::BTreeMap;

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::frame_light::frame_light;
use super::region_signal::CameraResponse;
use super::targets::noise_of;
use super::tissue_family::{FamilyFrame, other_tissue_families, tissue_family};
use crate::analysis::{
    FamilyAverage, LightFamily, NuisanceGroup, PixelMean, PixelSelection, RegionBlock, RegionLight,
    SceneOnSensor, SharePosterior, block_side_px,
};
use crate::pipeline::PipelineError;
use crate::pipeline::capture::CapturedFrame;
use crate::pipeline::capture::film_irradiance::behind_filter;
use crate::sensor::Sensor;
use crate::spectral::Curve;
use crate::study::{AnalysisPlan, Capture, Study};
use crate::warning::Warning;

/// What the camera of a study sees of the tissues that its region may be of, in the analyzed frame and the further ones. It rests on
/// lights, camera and exposure times, and not on what the frames show.
pub(super) struct FamiliesOfFrames<'a> {
    frames: Vec<FamilyFrame>,
    /// Irradiance of each over that of its family.
    levels: Vec<f64>,
    named: LightFamily,
    others: Vec<LightFamily>,
    settings: &'a AnalysisPlan,
    sensor: &'a Sensor,
    probability_of_named: f64,
}

impl<'a> FamiliesOfFrames<'a> {
    /// The families of a study; `None` without a prior, a camera or light.
    pub(super) fn new(
        study: &'a Study,
        settings: &'a AnalysisPlan,
        frames: &[CapturedFrame],
        scene: Option<(SceneOnSensor<'_>, &PixelSelection)>,
    ) -> Result<Option<Self>, PipelineError> {
        let (Some(prior), Some(sensor)) = (&settings.tissue, &study.camera.sensor) else { return Ok(None) };
        let Some(lens) = study.camera.lens_behind_filters() else { return Ok(None) };
        let grid = &study.scene.grid;
        let (mut family_frames, mut levels) = (Vec::new(), Vec::new());
        for label in labels(settings) {
            let (frame, capture) = frame_called(label, study, frames)?;
            let Some(irradiance) = frame_light(study, capture, scene) else { return Ok(None) };
            let (level, irradiance) = at_unit_level(&irradiance);
            levels.push(level);
            let lens = behind_filter(&lens, capture);
            let camera = CameraResponse::new(&lens, sensor, grid, None);
            family_frames.push(FamilyFrame {
                label: label.clone(),
                camera_of_reflected: CameraResponse::new(&lens, sensor, grid, Some(&irradiance)),
                channels: camera.seeing_channels(),
                camera,
                irradiance,
                time_s: sensor.frame_light_s(frame.raw.exposure_s),
            });
        }
        let named = tissue_family(prior, &family_frames, grid)?;
        let others = other_tissue_families(prior, &family_frames, grid)?;
        let probability_of_named = prior.site_probability;
        Ok(Some(Self {
            frames: family_frames,
            levels,
            named,
            others,
            settings,
            sensor,
            probability_of_named,
        }))
    }

    /// The estimate from all channels that see light, by their means over the pixels of a region that no frame saturates; `None` where
    /// there are none.
    pub(super) fn estimate(
        &self,
        frames: &[CapturedFrame],
        region: &PixelSelection,
    ) -> Option<SharePosterior> {
        let find = |label: &String| frames.iter().find(|frame| frame.raw.label == *label);
        let frames: Vec<&CapturedFrame> = labels(self.settings).map(find).collect::<Option<_>>()?;
        let usable = |CapturedFrame { developed: image, .. }: &CapturedFrame| -> Vec<usize> {
            let same_size = image.width == region.width && image.height == region.height;
            let usable = |pixel: &usize| same_size && !image.saturated[*pixel];
            region.pixels.iter().copied().filter(usable).collect()
        };
        let [electrons, variance] = self.means(&frames, &usable)?;
        let average = FamilyAverage {
            named: &self.named,
            others: &self.others,
            probability_of_named: self.probability_of_named,
        };
        let (blocks, side_px) = self.blocks(&frames, region).unwrap_or_default();
        average.posterior_of_blocks(&electrons, &variance, &blocks, side_px)
    }

    /// Light of a region that is not its own and more than the estimate allows for, where a simulation knows it: it looks like bulk.
    pub(super) fn foreign_light(&self, light: &RegionLight) -> Vec<Warning> {
        let all: f64 = light.all().iter().sum();
        let of = |(group, electrons, what): (NuisanceGroup, &Vec<f64>, &str)| {
            let (share, most) = (electrons.iter().sum::<f64>() / all, self.named.largest_share_of(group));
            (share > most).then(|| {
                Warning::explained(
                    format!(
                        "{:.0} % of the region's light is {what}, and the estimate allows for {:.0} % at most",
                        100.0 * share,
                        100.0 * most
                    ),
                    "The share may lie outside of its interval. Shade the region, subtract a frame without the excitation, or filter better.",
                )
            })
        };
        [
            (NuisanceGroup::Surroundings, &light.other_parts, "light of other parts, as of teeth"),
            (NuisanceGroup::Leak, &light.reflected, "reflected"),
        ]
        .into_iter()
        .filter_map(of)
        .collect()
    }

    /// Mean electrons of each datum over some pixels of its frame, and their covariance: frames have noise of their own.
    fn means(
        &self,
        frames: &[&CapturedFrame],
        pixels: &dyn Fn(&CapturedFrame) -> Vec<usize>,
    ) -> Option<[Vec<f64>; 2]> {
        let (mut electrons, mut covariance) = (Vec::new(), DMatrix::zeros(0, 0));
        for ((frame, of_family), level) in frames.iter().zip(&self.frames).zip(&self.levels) {
            let (image, k) = (&frame.developed, frame.raw.dn_per_electron * level);
            let noise = noise_of(image, &frame.raw, self.sensor);
            let mean = PixelMean::new(image, &of_family.channels, &pixels(frame), &noise)?;
            let (first, count) = (electrons.len(), mean.dn.len());
            electrons.extend(mean.dn.iter().map(|dn| dn / k));
            covariance = covariance.resize(first + count, first + count, 0.0);
            covariance.view_mut((first, first), (count, count)).copy_from(&(mean.covariance_dn2() / (k * k)));
        }
        Some([electrons, covariance.iter().copied().collect()])
    }

    /// Squares that lie in the region for more than half, with the means of all frames, and their side in pixels.
    fn blocks(
        &self,
        frames: &[&CapturedFrame],
        region: &PixelSelection,
    ) -> Option<(Vec<RegionBlock>, usize)> {
        let fits = |frame: &&CapturedFrame| {
            [frame.developed.width, frame.developed.height] == [region.width, region.height]
        };
        if !frames.iter().all(fits) || region.pixels.is_empty() {
            return None;
        }
        // Sort the pixels of the region into squares
        let side = block_side_px(region.pixels.len() as f64);
        let mut squares: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
        let usable = |pixel: usize| frames.iter().all(|frame| !frame.developed.saturated[pixel]);
        for &pixel in region.pixels.iter().filter(|pixel| usable(**pixel)) {
            let place = [pixel / region.width / side, pixel % region.width / side];
            squares.entry(place).or_default().push(pixel);
        }
        let found: Vec<([usize; 2], Vec<usize>)> =
            squares.into_iter().filter(|(_, pixels)| 2 * pixels.len() > side * side).collect();
        let block = |([row, col], pixels): &([usize; 2], Vec<usize>)| {
            let [electrons, variance] = self.means(frames, &|_| pixels.clone())?;
            Some(RegionBlock {
                corner_px: [col * side, row * side],
                pixels: pixels.len(),
                electrons,
                variance,
            })
        };
        Some((found.par_iter().filter_map(block).collect(), side))
    }
}

/// The level of an irradiance, the mean of its values, and its shape, as regions share it that one light meets at different levels: to 30
/// digits of two, so that rounding makes no two of it.
fn at_unit_level(irradiance: &Curve) -> (f64, Curve) {
    const LAST_DIGITS: u64 = (1 << 22) - 1;
    let values = irradiance.values();
    let level = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let rounded = |value: f64| f64::from_bits((value.to_bits() + LAST_DIGITS / 2) & !LAST_DIGITS);
    (level, irradiance.scaled(level.recip()).mapped(rounded))
}

/// A captured frame and its capture.
fn frame_called<'a>(
    label: &str,
    study: &'a Study,
    frames: &'a [CapturedFrame],
) -> Result<(&'a CapturedFrame, &'a Capture), PipelineError> {
    let found = frames.iter().find(|frame| frame.raw.label == *label).zip(study.capture(label));
    found.ok_or_else(|| {
        let known = frames.iter().map(|frame| frame.raw.label.as_str()).collect::<Vec<_>>();
        PipelineError::NoFrame { wanted: label.into(), known: known.join(", ") }
    })
}

/// Labels of the frames that enter the estimate, the analyzed one first.
fn labels(settings: &AnalysisPlan) -> impl Iterator<Item = &String> {
    std::iter::once(&settings.frame).chain(&settings.further_frames)
}
