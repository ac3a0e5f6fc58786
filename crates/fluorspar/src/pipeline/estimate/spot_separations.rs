//! Two spots of the frames of a study, compared.

use crate::analysis::{AnalysisError, PixelSelection, SceneOnSensor, SpotScale, SpotSeparation};
use crate::image::ChannelImage;
use crate::pipeline::PipelineError;
use crate::pipeline::capture::CapturedFrame;
use crate::study::{AnalysisPlan, Study};
use crate::warning::Warning;

/// Most pixels of a spot that are compared; of larger ones some, evenly spread.
const MOST_PIXELS: usize = 600;

/// Two spots compared.
#[derive(Debug, Default)]
pub(super) struct ComparedSpots {
    /// How well they are told apart, by green and by all channels of each frame and of all together.
    pub(super) found: Vec<SpotSeparation>,
    /// Frames that do not tell it, or not of all pixels, with the reason.
    pub(super) warnings: Vec<Warning>,
}

/// How well the pixels of the two regions that an analysis compares are told apart: green alone and all channels of every frame with
/// light, and of all these frames together. Empty where nothing is compared. `scene` serves to find parts by name.
///
/// Pixels are compared by the logarithms of their channels, or where some are dark by their values ([`SpotScale`]); every second one in
/// both directions, as neighbors share raw values. What spots hold of structure of their own counts as noise.
///
/// # Errors
/// A region that does not fit the frames.
pub(super) fn compared_spots(
    study: &Study,
    plan: &AnalysisPlan,
    frames: &[CapturedFrame],
    scene: Option<SceneOnSensor<'_>>,
) -> Result<ComparedSpots, PipelineError> {
    let mut compared = ComparedSpots::default();
    let Some(spots) = &plan.compared else { return Ok(compared) };
    let lit: Vec<&ChannelImage> = frames
        .iter()
        .filter(|frame| {
            let capture = study.capture(&frame.raw.label);
            capture.is_some_and(|capture| capture.frame.lights.values().any(|drive| *drive > 0.0))
        })
        .map(|frame| &frame.developed)
        .collect();
    let Some([width, height]) = lit.first().map(|image| [image.width, image.height]) else {
        return Ok(compared);
    };
    let select = |spot: usize| spots[spot].select(width, height, scene).map_err(AnalysisError::from);
    let spots = [select(0)?, select(1)?];
    let ComparedSpots { found, warnings } = &mut compared;
    let mut compare = |images: &[&ChannelImage], channels: &[String], is_told: bool| {
        let (scale, groups) = compared_cases(images, channels, &spots);
        let labels = images.iter().map(|image| image.label.clone()).collect();
        let separation = SpotSeparation::new(labels, channels.to_vec(), scale, &groups);
        let is_found = separation.is_some();
        let warning = what_is_missing(images, &spots, is_found)
            .filter(|_| is_found || !is_told || any_saturated(images, &spots));
        warnings.extend(warning.filter(|warning| !warnings.contains(warning)));
        found.extend(separation);
        is_found
    };
    let mut any_tells = false;
    for image in &lit {
        let green: Vec<String> = image.channels.iter().filter(|name| *name == "G").cloned().collect();
        // Where some signal tells the spots apart, channels without light are no defect: a dye has its color
        let mut is_told = !green.is_empty() && compare(&[image], &green, false);
        if green != image.channels {
            is_told |= compare(&[image], &image.channels, is_told);
        }
        any_tells |= is_told;
    }
    if let [first, _, ..] = lit.as_slice() {
        compare(&lit, &first.channels, any_tells);
    }
    Ok(compared)
}

/// Whether a pixel of a spot is saturated in one of the frames.
fn any_saturated(images: &[&ChannelImage], spots: &[PixelSelection; 2]) -> bool {
    let is_saturated = |pixel: &usize| images.iter().any(|image| image.saturated.get(*pixel) == Some(&true));
    spots.iter().any(|spot| spot.pixels.iter().any(is_saturated))
}

/// Why frames tell no d' of the spots, or tell that of some of their pixels alone; `None` where nothing is missing.
fn what_is_missing(images: &[&ChannelImage], spots: &[PixelSelection; 2], is_found: bool) -> Option<Warning> {
    let labels: Vec<String> = images.iter().map(|image| format!("\"{}\"", image.label)).collect();
    let frames = format!("{} {}", if labels.len() == 1 { "frame" } else { "frames" }, labels.join(" and "));
    let saturated = |spot: &PixelSelection| {
        let is_saturated = |pixel: &&usize| images.iter().any(|i| i.saturated.get(**pixel) == Some(&true));
        spot.pixels.iter().filter(is_saturated).count()
    };
    // As many as the analysis of a region warns of
    let of_spot = |(spot, name): (&PixelSelection, &str)| {
        let (count, all) = (saturated(spot), spot.pixels.len());
        let percent = 100.0 * count as f64 / all as f64;
        (count * 100 > all).then(|| format!("{percent:.0} % of the {name} spot is saturated"))
    };
    let parts: Vec<String> = spots.iter().zip(["first", "second"]).filter_map(of_spot).collect();
    let shorten = "Shorten the exposure or lower the gain.";
    match (parts.is_empty(), is_found) {
        (true, true) => None,
        (true, false) => Some(Warning::explained(
            format!("d' of the spots in {frames}: none: too few pixels, or they do not vary"),
            "Make the spots larger, or add light.",
        )),
        (false, true) => Some(Warning::explained(
            format!("d' of the spots in {frames}: of their unsaturated pixels alone; {}", parts.join(", ")),
            shorten,
        )),
        (false, false) => Some(Warning::explained(
            format!("d' of the spots in {frames}: none; {}", parts.join(", ")),
            shorten,
        )),
    }
}

/// Standard deviations of dark noise above which all pixels must lie if their logarithms are compared: the logarithm of noise has no
/// finite spread, and to leave out the dark half of its pixels would move their mean.
const LIT: f64 = 3.0;

/// What is compared of two spots, and its cases.
fn compared_cases(
    images: &[&ChannelImage],
    channels: &[String],
    spots: &[PixelSelection; 2],
) -> (SpotScale, [Vec<Vec<f64>>; 2]) {
    let values = [0, 1].map(|spot| cases(images, channels, &spots[spot]));
    // A case holds the channels of one frame after the other
    let least = |number: usize| LIT * images[number / channels.len().max(1)].noise_floor_dn;
    let is_lit =
        |case: &Vec<f64>| case.iter().enumerate().all(|(number, value)| *value > least(number).max(0.0));
    if !values.iter().flatten().all(is_lit) {
        return (SpotScale::Values, values);
    }
    let logarithms = |spot: Vec<Vec<f64>>| {
        let of_case = |case: Vec<f64>| case.into_iter().map(f64::ln).collect();
        spot.into_iter().map(of_case).collect()
    };
    (SpotScale::Logarithms, values.map(logarithms))
}

/// Channels of the pixels of a spot; pixels that are saturated in any of the images are left out.
fn cases(images: &[&ChannelImage], channels: &[String], spot: &PixelSelection) -> Vec<Vec<f64>> {
    let value = |image: &ChannelImage, pixel: usize, name: &str| {
        let channel = image.channels.iter().position(|other| other == name)?;
        let value = *image.data.get(pixel * image.channels.len() + channel)?;
        (image.saturated.get(pixel) == Some(&false)).then_some(f64::from(value))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of 20 x 10 pixels whose left half is brighter.
    fn frame() -> ChannelImage {
        let (width, height) = (20, 10);
        let channels = vec!["R".to_owned(), "G".to_owned()];
        // Noise without a pattern along rows, columns and channels
        let noise = |at: usize| ((at * at * 7919 + at * 104_729) % 101) as f32;
        let level = |pixel: usize| if pixel % width < 10 { 500.0 } else { 300.0 };
        let data = (0..2 * width * height).map(|at| level(at / 2) + noise(at)).collect();
        ChannelImage {
            width,
            height,
            channels,
            data,
            saturated: vec![false; width * height],
            noise_floor_dn: 1.0,
            full_scale_dn: 4000.0,
            shares: vec![1.0; 2],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "green".into(),
        }
    }

    #[test]
    fn a_saturated_spot_is_named() {
        let mut image = frame();
        let half = |from: usize| {
            let pixels = (0..200).filter(|pixel| (from..from + 10).contains(&(pixel % 20))).collect();
            PixelSelection { width: 20, height: 10, pixels }
        };
        let spots = [half(0), half(10)];
        let told = |image: &ChannelImage| {
            let (scale, groups) = compared_cases(&[image], &image.channels, &spots);
            let found = SpotSeparation::new(vec!["green".into()], image.channels.clone(), scale, &groups);
            (found.is_some(), what_is_missing(&[image], &spots, found.is_some()))
        };
        assert_eq!(told(&image), (true, None));
        // Some pixels of a spot: its d' is that of the others
        spots[0].pixels.iter().take(20).for_each(|pixel| image.saturated[*pixel] = true);
        let (is_found, warning) = told(&image);
        let warning = warning.unwrap();
        assert!(is_found && warning.contains("20 % of the first spot is saturated"), "{warning}");
        assert!(warning.contains("unsaturated pixels alone") && !warning.contains("none"), "{warning}");
        // All of it
        spots[0].pixels.iter().for_each(|pixel| image.saturated[*pixel] = true);
        let (is_found, warning) = told(&image);
        let warning = warning.unwrap();
        let expected = "d' of the spots in frame \"green\": none; 100 % of the first spot is saturated. ";
        assert!(!is_found && warning.starts_with(expected), "{warning}");
        // Without light and unsaturated
        image.saturated.fill(false);
        image.data.fill(0.0);
        let (is_found, warning) = told(&image);
        assert!(!is_found && warning.unwrap().contains("none: too few"));
    }

    /// A spot of dark noise alone, as a blank: no pixel is left out, and d' is that of the values.
    #[test]
    fn a_dark_spot_is_compared_by_its_values() {
        let mut image = frame();
        let half = |from: usize| {
            let pixels = (0..200).filter(|pixel| (from..from + 10).contains(&(pixel % 20))).collect();
            PixelSelection { width: 20, height: 10, pixels }
        };
        let spots = [half(0), half(10)];
        let compared = |image: &ChannelImage| compared_cases(&[image], &image.channels, &spots);
        assert_eq!(compared(&image).0, SpotScale::Logarithms);
        // The second spot is dark: its noise, 0 to 100, about zero
        for pixel in &spots[1].pixels {
            for value in &mut image.data[2 * pixel..2 * pixel + 2] {
                *value -= 350.0;
            }
        }
        let (scale, groups) = compared(&image);
        assert_eq!((scale, groups[1].len()), (SpotScale::Values, 25));
        let mean = |cases: &[Vec<f64>]| cases.iter().map(|case| case[0]).sum::<f64>() / cases.len() as f64;
        let spread = |cases: &[Vec<f64>]| {
            let mean = mean(cases);
            cases.iter().map(|case| (case[0] - mean).powi(2)).sum::<f64>()
        };
        let first: Vec<Vec<Vec<f64>>> =
            groups.iter().map(|cases| cases.iter().map(|case| vec![case[0]]).collect()).collect();
        let first: [Vec<Vec<f64>>; 2] = first.try_into().unwrap();
        let by_hand =
            (mean(&groups[0]) - mean(&groups[1])) / ((spread(&groups[0]) + spread(&groups[1])) / 48.0).sqrt();
        let found = SpotSeparation::new(vec!["green".into()], vec!["R".into()], scale, &first).unwrap();
        assert!((found.d_prime / by_hand - 1.0).abs() < 1e-12, "{} {by_hand}", found.d_prime);
    }
}
