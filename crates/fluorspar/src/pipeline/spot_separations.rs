//! Two spots of the frames of a study, compared.

use super::{CapturedFrame, PipelineError};
use crate::analysis::{AnalysisError, PixelSelection, SceneOnSensor, SpotSeparation};
use crate::image::ChannelImage;
use crate::study::{AnalysisPlan, Study};

/// Most pixels of a spot that are compared; of larger ones some, evenly spread.
const MOST_PIXELS: usize = 600;

/// How well the pixels of the two regions that an analysis compares are told apart: green alone and all channels of every frame with
/// light, and of all these frames together. Empty where nothing is compared. `scene` serves to find parts by name.
///
/// Pixels are compared by the logarithms of their channels, every second one in both directions, as neighbors share raw values.
/// What spots hold of structure of their own counts as noise.
///
/// # Errors
/// A region that does not fit the frames.
pub fn spot_separations(
    study: &Study,
    plan: &AnalysisPlan,
    frames: &[CapturedFrame],
    scene: Option<SceneOnSensor<'_>>,
) -> Result<Vec<SpotSeparation>, PipelineError> {
    let Some(spots) = &plan.compared else { return Ok(Vec::new()) };
    let lit: Vec<&ChannelImage> = frames
        .iter()
        .filter(|frame| {
            let capture = study.capture(&frame.raw.label);
            capture.is_some_and(|capture| capture.frame.lights.values().any(|drive| *drive > 0.0))
        })
        .map(|frame| &frame.developed)
        .collect();
    let Some([width, height]) = lit.first().map(|image| [image.width, image.height]) else {
        return Ok(Vec::new());
    };
    let select = |spot: usize| spots[spot].select(width, height, scene).map_err(AnalysisError::from);
    let spots = [select(0)?, select(1)?];
    let mut found = Vec::new();
    let mut compare = |images: &[&ChannelImage], channels: &[String]| {
        let groups = [0, 1].map(|spot| cases(images, channels, &spots[spot]));
        let labels = images.iter().map(|image| image.label.clone()).collect();
        found.extend(SpotSeparation::new(labels, channels.to_vec(), &groups));
    };
    for image in &lit {
        let green: Vec<String> = image.channels.iter().filter(|name| *name == "G").cloned().collect();
        if !green.is_empty() {
            compare(&[image], &green);
        }
        if green != image.channels {
            compare(&[image], &image.channels);
        }
    }
    if let [first, _, ..] = lit.as_slice() {
        compare(&lit, &first.channels);
    }
    Ok(found)
}

/// Logarithms of channels of the pixels of a spot; pixels that are saturated or not positive in any of them are left out.
fn cases(images: &[&ChannelImage], channels: &[String], spot: &PixelSelection) -> Vec<Vec<f64>> {
    let value = |image: &ChannelImage, pixel: usize, name: &str| {
        let channel = image.channels.iter().position(|other| other == name)?;
        let value = *image.data.get(pixel * image.channels.len() + channel)?;
        (value > 0.0 && image.saturated.get(pixel) == Some(&false)).then(|| f64::from(value).ln())
    };
    let case_of = |pixel: usize| {
        let of_image = |image: &&ChannelImage| {
            channels.iter().map(|name| value(image, pixel, name)).collect::<Option<Vec<f64>>>()
        };
        Some(images.iter().map(of_image).collect::<Option<Vec<_>>>()?.concat())
    };
    // Every second pixel in both directions, from the first row and column of the spot on
    let (width, pixels) = (spot.width, spot.pixels.iter());
    let left = pixels.clone().map(|pixel| pixel % width).min().unwrap_or(0);
    let top = pixels.clone().map(|pixel| pixel / width).min().unwrap_or(0);
    let is_second =
        |pixel: usize| (pixel % width - left).is_multiple_of(2) && (pixel / width - top).is_multiple_of(2);
    let all: Vec<Vec<f64>> =
        pixels.filter(|pixel| is_second(**pixel)).filter_map(|&pixel| case_of(pixel)).collect();
    let step = all.len().div_ceil(MOST_PIXELS).max(1);
    all.into_iter().step_by(step).collect()
}
