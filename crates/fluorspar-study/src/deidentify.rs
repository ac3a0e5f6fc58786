//! What of a person, a file or a word may leave the clinic: what is not listed here does not.

use std::path::Path;

use fluorspar::digest::sha256_hex;
use fluorspar::image::{Orientation, SensorImage};
use fluorspar_format::{
    LeftTags, left_tags, read_mask, read_sensor_image, write_label_png, write_sensor_tiff,
};
use fluorspar_session::Result;
use serde::Serialize;

/// What was done to a kind of data, by table E.1-1 of DICOM PS3.15.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Deidentified {
    /// What it was: a tag of the file by number, or a word.
    pub what: String,
    /// X removed, Z emptied, D replaced, C cleaned, K kept.
    pub action: char,
    /// The attribute of table E.1-1 that it is or resembles.
    pub clause: &'static str,
}

/// A file that left.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct DeidentifiedFile {
    /// Where it lies in the export.
    pub path: String,
    /// SHA-256 of the SHA-256 of the file in the study, by which the clinic finds it.
    pub from: String,
    /// What was done.
    pub actions: Vec<Deidentified>,
}

/// The numbers that a raw frame keeps: those that an analysis needs.
const KEPT: [&str; 9] = [
    "pixels",
    "mosaic",
    "black level",
    "white level",
    "bit depth",
    "exposure time",
    "gain",
    "noise",
    "name of the capture",
];

/// A code for a word that must not leave, the same in all exports of a study.
pub(crate) fn code(secret: &str, kind: &str, word: &str) -> String {
    sha256_hex([format!("{secret}\n{kind}\n{word}")])[..10].to_owned()
}

/// A word, where it is one of a list; otherwise nothing.
pub(crate) fn listed(word: &str, list: &[&str]) -> String {
    let word = word.to_lowercase();
    list.iter().find(|one| **one == word).map_or_else(String::new, |one| (*one).to_owned())
}

/// Decade of an age; from 90 on all are one (a single old person is known by age).
pub(crate) fn age_band(age: Option<f64>) -> String {
    match age {
        None => String::new(),
        Some(age) if age >= 90.0 => "90+".into(),
        Some(age) => {
            let decade = (age / 10.0).floor() * 10.0;
            format!("{decade}-{}", decade + 9.0)
        }
    }
}

/// A frame whose levels that differ by place or channel, and whose gain map, are in its numbers, to the nearest: a description has one
/// level for all.
fn evened(mut image: SensorImage) -> SensorImage {
    let is_even = image.black_offsets.is_empty() && image.white_levels.is_empty() && image.factors.is_empty();
    if is_even {
        return image;
    }
    let most = f64::from(image.white_level) - 1.0;
    let even = |value: usize| {
        let factor = image.factors.get(value).map_or(1.0, |factor| f64::from(*factor));
        let light = (f64::from(image.data[value]) - image.black_of(value)) * factor;
        if image.is_saturated(value) {
            image.white_level
        } else {
            (image.black_level + light).round().clamp(0.0, most) as u16
        }
    };
    image.data = (0..image.data.len()).map(even).collect();
    (image.black_offsets, image.white_levels, image.factors) = Default::default();
    image
}

/// What a channel is called outside: a color, or a wavelength, else its number.
pub(crate) fn channel_outside(channel: &str, number: usize) -> String {
    const COLORS: [&str; 9] = ["r", "g", "b", "w", "mono", "nir", "ir", "c", "y"];
    let lower = channel.to_lowercase();
    let is_between = |c: char| ['_', '-', ' '].contains(&c);
    let of_number = lower.trim_end_matches("nm").trim_end_matches(is_between);
    let digits = of_number.trim_start_matches(|c: char| !c.is_ascii_digit());
    let before = of_number[..of_number.len() - digits.len()].trim_end_matches(is_between);
    let is_band = ["", "b", "band", "ch", "channel", "l"].contains(&before)
        && digits.parse().is_ok_and(|nm: u32| (200..=1200).contains(&nm) || nm <= 99);
    if channel.is_empty() || COLORS.contains(&lower.as_str()) || is_band {
        channel.to_owned()
    } else {
        format!("channel{}", number + 1)
    }
}

/// Writes a raw frame anew from its pixels and the numbers that an analysis needs.
///
/// # Errors
/// A frame that can't be read, or whose levels a description can't hold.
pub(crate) fn write_frame(from: &Path, to: &Path, capture: &str) -> Result<Vec<Deidentified>> {
    let mut image = read_sensor_image(from)?.image;
    for (number, channel) in image.mosaic.channels.iter_mut().enumerate() {
        *channel = channel_outside(channel, number);
    }
    let plain =
        SensorImage { label: capture.into(), seed: 0, orientation: Orientation::default(), ..evened(image) };
    write_sensor_tiff(to, &plain, None)?;
    let mut actions: Vec<Deidentified> = left_tags(from)?.into_iter().map(of_tag).collect();
    actions.extend(KEPT.iter().map(|what| Deidentified {
        what: (*what).into(),
        action: 'K',
        clause: "Pixel Data (7FE0,0010) and attributes of the image, not in table E.1-1",
    }));
    actions.push(new_name());
    Ok(actions)
}

/// What becomes of a frame of which it is kept how it looks.
pub(crate) fn developed_actions() -> Vec<Deidentified> {
    let clause = "Pixel Data (7FE0,0010) and attributes of the image, not in table E.1-1";
    let kept = Deidentified { what: "how the frame looks".into(), action: 'K', clause };
    vec![kept, of_tag(LeftTags { number: None, name: "all tags".into() }), new_name()]
}

/// The name of a file, which another takes the place of.
fn new_name() -> Deidentified {
    Deidentified { what: "name of the file".into(), action: 'D', clause: "Patient ID (0010,0020)" }
}

/// Writes a mask anew.
///
/// # Errors
/// A mask that can't be read.
pub(crate) fn write_mask(from: &Path, to: &Path) -> Result<Vec<Deidentified>> {
    let mask = read_mask(from)?;
    let labels: Vec<u8> = mask.inside.iter().map(|is_in| if *is_in { u8::MAX } else { 0 }).collect();
    write_label_png(to, mask.width, mask.height, &labels)?;
    let mut actions: Vec<Deidentified> = left_tags(from)?.into_iter().map(of_tag).collect();
    actions.push(new_name());
    Ok(actions)
}

/// What becomes of a tag: all are left behind, what the numbers that are kept came from included.
fn of_tag(tag: LeftTags) -> Deidentified {
    let clause = match tag.number {
        Some(306 | 36_867 | 36_868 | 29) => "Acquisition DateTime (0008,002A)",
        Some(270 | 37_510) => "Image Comments (0020,4000)",
        Some(271 | 272 | 50_708) => "Manufacturer's model, kept in no form; Device Serial Number (0018,1000)",
        Some(315 | 33_432 | 42_032) => "Operators' Name (0008,1070)",
        Some(316 | 42_033 | 42_037 | 50_735) => "Device Serial Number (0018,1000)",
        Some(34_853) => "Curve Data and places are removed as Institution Address (0008,0081)",
        Some(37_500 | 50_740) => "Private attributes",
        Some(330 | 513 | 514) => "Icon Image Sequence (0088,0200)",
        Some(700 | 33_723 | 34_377) => "Original Attributes Sequence (0400,0561)",
        Some(number) if number >= 32_768 => "Private attributes",
        _ => "attributes that no row of table E.1-1 keeps",
    };
    Deidentified { what: tag.name, action: 'X', clause }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fluorspar::image::Mosaic;

    /// By hand: black 10 and 12, factors 1 and 2, white 100 and 80.
    #[test]
    fn channels_are_colors_wavelengths_or_numbers() {
        for name in ["R", "mono", "NIR", "525", "band_525", "b12", "450 nm"] {
            assert_eq!(channel_outside(name, 2), name);
        }
        for name in ["Anna Smith 1980-03-04", "Anna 450", "anna1", "2024", "R of Anna"] {
            assert_eq!(channel_outside(name, 2), "channel3");
        }
    }

    #[test]
    fn levels_of_places_and_channels_are_put_into_the_numbers() {
        let mosaic = Mosaic { rows: 1, cols: 2, pattern: vec![0, 1], channels: vec!["R".into(), "G".into()] };
        let frame = SensorImage {
            width: 2,
            height: 2,
            data: vec![30, 30, 100, 80],
            mosaic,
            black_level: 10.0,
            black_offsets: vec![0.0, 2.0, 0.0, 2.0],
            white_level: 100,
            white_levels: vec![100, 80],
            factors: vec![1.0, 2.0, 1.0, 2.0],
            orientation: Orientation::default(),
            bit_depth: 8,
            exposure_s: 0.01,
            gain: 1.0,
            dn_per_electron: 0.1,
            gain_is_assumed: false,
            read_noise_dn: 1.0,
            seed: 0,
            label: "blue".into(),
        };
        let even = evened(frame);
        assert_eq!(even.data, [30, 46, 100, 100]);
        assert!(even.factors.is_empty() && even.is_saturated(3) && !even.is_saturated(1));
    }

    #[test]
    fn what_is_not_listed_stays() {
        assert_eq!(listed("Female", &["female", "male"]), "female");
        assert_eq!(listed("Anna", &["female", "male"]), "");
        assert_eq!([age_band(Some(37.0)), age_band(Some(93.0)), age_band(None)], ["30-39", "90+", ""]);
        assert_ne!(code("a", "subject", "P1"), code("b", "subject", "P1"));
    }
}
