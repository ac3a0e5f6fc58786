//! Two spots of the frames of a study, compared.

use super::CapturedFrame;
use crate::analysis::SpotSeparation;
use crate::image::ChannelImage;
use crate::study::Study;

/// Most pixels of a spot that are compared; of larger ones some, evenly spread.
const MOST_PIXELS: usize = 600;

/// How well the pixels of the two rectangles of the analysis are told apart: green alone and all channels of every frame with light,
/// and of all these frames together. Empty without rectangles.
///
/// Pixels are compared by the logarithms of their channels, every second one in both directions, as neighbors share raw values.
/// What spots hold of structure of their own counts as noise.
pub fn spot_separations(study: &Study, frames: &[CapturedFrame]) -> Vec<SpotSeparation> {
    let Some(spots) = study.analysis.as_ref().and_then(|plan| plan.compared_px) else { return Vec::new() };
    let lit: Vec<&ChannelImage> = frames
        .iter()
        .filter(|frame| {
            let capture = study.capture(&frame.raw.label);
            capture.is_some_and(|capture| capture.frame.lights.values().any(|drive| *drive > 0.0))
        })
        .map(|frame| &frame.developed)
        .collect();
    let mut found = Vec::new();
    let mut compare = |images: &[&ChannelImage], channels: &[String]| {
        let groups = spots.map(|spot| cases(images, channels, spot));
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
    found
}

/// Logarithms of channels of the pixels of a spot; pixels that are saturated or not positive in any of them are left out.
fn cases(images: &[&ChannelImage], channels: &[String], spot: [u32; 4]) -> Vec<Vec<f64>> {
    let value = |image: &ChannelImage, pixel: usize, name: &str| {
        let channel = image.channels.iter().position(|other| other == name)?;
        let value = *image.data.get(pixel * image.channels.len() + channel)?;
        (value > 0.0 && !image.saturated[pixel]).then(|| f64::from(value).ln())
    };
    let pixel_at = |row: usize, col: usize| {
        let of_image = |image: &&ChannelImage| {
            let pixel = row * image.width + col;
            channels.iter().map(|name| value(image, pixel, name)).collect::<Option<Vec<f64>>>()
        };
        Some(images.iter().map(of_image).collect::<Option<Vec<_>>>()?.concat())
    };
    let Some(size) = images.first().map(|image| [image.width, image.height]) else { return Vec::new() };
    let [col, row, width, height] = spot.map(|n| n as usize);
    let columns = col..(col + width).min(size[0]);
    let rows = (row..(row + height).min(size[1])).step_by(2);
    let all: Vec<Vec<f64>> = rows
        .flat_map(|row| columns.clone().step_by(2).map(move |col| (row, col)))
        .filter_map(|(row, col)| pixel_at(row, col))
        .collect();
    let step = all.len().div_ceil(MOST_PIXELS).max(1);
    all.into_iter().step_by(step).collect()
}
