//! A frame and its description: what must be told of pixels, and what of them is found.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::frame_judgement::{
    FrameRemark, FrameTags, StoredFrame, alignment_words, black_offsets_words, high_black_level,
    mark_plateaus, maybe_left_aligned, turned_words, unused_bits, white_levels_words,
};
use super::row_packing::PackedRows;
use crate::store::file::sidecar_path;
use crate::{FileFormat, FormatError, Provenance};
use fluorspar::digest::sha256_hex;
use fluorspar::image::{Mosaic, SensorImage};

/// What the numbers of a frame are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Samples {
    /// One number a pixel, of the channel that the mosaic has there: raw.
    #[default]
    Mosaic,
    /// Three linear numbers a pixel, interpolated from the mosaic: developed.
    Developed,
    /// Three linear numbers a pixel, each measured there, as sensors in layers and cameras of three sensors do: raw.
    Measured,
}

impl Samples {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Mosaic => "mosaic",
            Self::Developed => "developed",
            Self::Measured => "measured",
        }
    }

    fn is_mosaic(&self) -> bool {
        *self == Self::Mosaic
    }
}

/// Contents of the JSON description of a raw frame.
///
/// Of a real camera, gain, conversion gain and noise may be left out: the sensor of an experiment then tells them.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Description {
    pub(crate) format: u32,
    /// What wrote the file: it may be replaced where this program did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) program: Option<String>,
    pub(crate) label: String,
    pub(crate) width: u64,
    pub(crate) height: u64,
    pub(crate) mosaic: Mosaic,
    #[serde(default, skip_serializing_if = "Samples::is_mosaic")]
    pub(crate) samples: Samples,
    pub(crate) black_level: f64,
    pub(crate) white_level: u16,
    pub(crate) bit_depth: u8,
    /// Bits below those of the converter, all 0, in files that hold its values in the upper ones of 16.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub(crate) left_shift: u8,
    pub(crate) exposure_s: f64,
    #[serde(default = "unity")]
    pub(crate) gain: f64,
    #[serde(default, skip_serializing_if = "is_unknown")]
    pub(crate) dn_per_electron: f64,
    #[serde(default, skip_serializing_if = "is_unknown")]
    pub(crate) read_noise_dn: f64,
    #[serde(default)]
    pub(crate) seed: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) packing: Option<PackedRows>,
    /// Of the pixels as little-endian 16-bit numbers, row by row.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) pixels_sha256: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) provenance: Option<Provenance>,
}

/// Of a camera that does not tell.
fn is_unknown(value: &f64) -> bool {
    *value == 0.0
}

fn is_zero(value: &u8) -> bool {
    *value == 0
}

fn unity() -> f64 {
    1.0
}

/// A raw frame, and what was found of it.
#[derive(Clone, Debug)]
pub(crate) struct JudgedFrame {
    /// The frame, turned as viewers show it.
    pub(crate) image: SensorImage,
    pub(crate) provenance: Option<Provenance>,
    /// What it has otherwise than most frames.
    pub(crate) remarks: Vec<FrameRemark>,
}

/// Divides the values of a file that holds them in the upper bits, as its description tells, or as they themselves do where some need more
/// bits than described.
fn align(data: &mut [u16], d: &Description) -> Result<Option<FrameRemark>, String> {
    let wide = 16_u8.saturating_sub(d.bit_depth);
    let most = data.iter().copied().max().unwrap_or(0);
    let is_beyond = u32::from(most) >> d.bit_depth.min(16) > 0;
    let is_shifted = is_beyond && wide > 0 && unused_bits(data) >= u32::from(wide);
    let shift = match d.left_shift {
        0 if d.program.is_none() && is_shifted => wide,
        shift => shift,
    };
    if shift == 0 {
        return Ok(None);
    }
    if shift > 15 || data.iter().any(|value| value.trailing_zeros() < u32::from(shift)) {
        return Err(format!("\"left_shift\" is {shift}, but not all values are multiples of 2^{shift}"));
    }
    data.iter_mut().for_each(|value| *value >>= shift);
    Ok(Some(FrameRemark {
        key: "alignment",
        value: alignment_words(d.bit_depth, shift),
        remark: format!("all values are multiples of {}; levels are those after the division", 1u32 << shift),
        is_doubtful: false,
    }))
}

/// Joins pixels and their description, which must fit. What the pixels show that the description does not tell is found, and the frame is
/// turned as viewers show it.
pub(crate) fn image_of(
    path: &Path,
    stored: StoredFrame,
    d: &Description,
) -> Result<JudgedFrame, FormatError> {
    // The description of a DNG is inside.
    let beside = sidecar_path(path);
    let sidecar = if beside.exists() { beside } else { path.to_path_buf() };
    let wrong =
        |what: String| FormatError::malformed(&sidecar, what, "Keep the two files of one frame together");
    let (width, height) = (stored.width, stored.height);
    if (d.width, d.height) != (width as u64, height as u64) {
        return Err(wrong(format!(
            "{} rows and {} columns are described but the image has {height} and {width}",
            d.height, d.width
        )));
    }
    if let Some(expected) = &d.pixels_sha256
        && *expected != pixels_sha256(&stored.data)
    {
        return Err(wrong("the pixels are not those that were described (their SHA-256 differs)".into()));
    }
    judged(path, &sidecar, stored, d)
}

/// A frame that fits its description; where they contradict each other, `said_in` is to blame.
fn judged(
    path: &Path,
    said_in: &Path,
    stored: StoredFrame,
    d: &Description,
) -> Result<JudgedFrame, FormatError> {
    let cure = if said_in == path {
        "Give what is right of it, see fluorspar describe --help"
    } else {
        "Correct the description, or describe the frame anew with fluorspar describe FRAME --replace"
    };
    let wrong = |what: String| FormatError::malformed(said_in, what, cure);
    let StoredFrame { width, height, mut data, black_offsets, tags } = stored;
    let FrameTags { orientation, whites, factors, mut remarks, has_levels, .. } = tags;
    match align(&mut data, d).map_err(wrong)? {
        Some(remark) => remarks.push(remark),
        None if has_levels || d.program.is_some() => {}
        None => remarks.extend(maybe_left_aligned(&data, d.bit_depth)),
    }
    let mut image =
        SensorImage { black_offsets, factors, ..sensor_image(path, said_in, width, height, data, d)? };
    if let Some(problem) = contradiction(&image) {
        return Err(wrong(problem));
    }
    // A described level is for all
    if whites.iter().max() == Some(&image.white_level) {
        image.white_levels = whites;
    }
    remarks.extend(white_levels_words(&image));
    remarks.extend(black_offsets_words(&image));
    // Of a simulation, which has no noise where none is wanted, all levels are known
    if d.program.is_none() {
        remarks.extend(mark_plateaus(&mut image));
        remarks.extend(high_black_level(&image));
    }
    remarks.extend(turned_words(orientation));
    Ok(JudgedFrame { image: image.turned(orientation), provenance: d.provenance.clone(), remarks })
}

/// A frame from its pixels and what is said of them; where they contradict each other, `said_in` is to blame.
fn sensor_image(
    path: &Path,
    said_in: &Path,
    width: usize,
    height: usize,
    data: Vec<u16>,
    d: &Description,
) -> Result<SensorImage, FormatError> {
    let per_pixel = data.len() / (width * height).max(1);
    if (per_pixel == 1) != d.samples.is_mosaic() {
        return Err(FormatError::malformed(
            said_in,
            format!(
                "\"samples\" is \"{}\" but {} holds {per_pixel} numbers a pixel",
                d.samples.word(),
                path.display()
            ),
            "Write \"mosaic\" for one number a pixel; \"developed\" or \"measured\" for three",
        ));
    }
    let mosaic = match d.samples {
        Samples::Measured => {
            Mosaic { rows: 1, cols: 1, pattern: Vec::new(), channels: d.mosaic.channels.clone() }
        }
        _ => d.mosaic.clone(),
    };
    Ok(SensorImage {
        width,
        height,
        data,
        mosaic,
        black_level: d.black_level,
        black_offsets: Vec::new(),
        white_levels: Vec::new(),
        factors: Vec::new(),
        orientation: fluorspar::image::Orientation::default(),
        white_level: d.white_level,
        bit_depth: d.bit_depth,
        exposure_s: d.exposure_s,
        gain: d.gain,
        dn_per_electron: d.dn_per_electron,
        read_noise_dn: d.read_noise_dn,
        gain_is_assumed: false,
        seed: d.seed,
        label: d.label.clone(),
    })
}

/// Joins pixels and a description that is not written yet.
pub(crate) fn image_of_parts(
    path: &Path,
    stored: StoredFrame,
    d: &Description,
) -> Result<JudgedFrame, FormatError> {
    judged(path, path, stored, d)
}

pub(crate) fn description(
    path: &Path,
    image: &SensorImage,
    provenance: Option<&Provenance>,
) -> Result<Description, FormatError> {
    if let Some(problem) = contradiction(image) {
        return Err(FormatError::unwritable(path, problem, "Correct the frame before writing it"));
    }
    for (is_told_here, what) in [
        (image.black_offsets.is_empty(), "its black level differs by place"),
        (image.white_levels.is_empty(), "its white level differs by channel"),
        (image.factors.is_empty(), "it has a gain map"),
        (image.orientation.is_upright(), "it is turned from how its sensor was read out"),
    ] {
        if !is_told_here {
            let what = format!("{what}, which a description does not tell");
            return Err(FormatError::unwritable(path, what, "Keep the file that it was read from"));
        }
    }
    Ok(Description {
        format: FileFormat::RAW_FRAME.version(),
        program: Some("fluorspar".into()),
        label: image.label.clone(),
        width: image.width as u64,
        height: image.height as u64,
        mosaic: image.mosaic.clone(),
        black_level: image.black_level,
        white_level: image.white_level,
        bit_depth: image.bit_depth,
        exposure_s: image.exposure_s,
        gain: image.gain,
        dn_per_electron: image.dn_per_electron,
        read_noise_dn: image.read_noise_dn,
        seed: image.seed,
        pixels_sha256: Some(pixels_sha256(&image.data)),
        provenance: provenance.cloned(),
        ..Description::default()
    })
}

/// The first thing in a frame that can't be, if any.
fn contradiction(image: &SensorImage) -> Option<String> {
    let numbers = [
        ("black level", image.black_level),
        ("exposure", image.exposure_s),
        ("gain", image.gain),
        ("conversion gain", image.dn_per_electron),
        ("read noise", image.read_noise_dn),
    ];
    let mosaic = &image.mosaic;
    if image.width == 0 || image.height == 0 || image.width.max(image.height) > 100_000 {
        return Some(format!("a frame can't have {} rows and {} columns", image.height, image.width));
    }
    let pixels = image.width * image.height;
    let per_pixel = if image.has_all_channels() { mosaic.channels.len() } else { 1 };
    if image.data.len() != pixels * per_pixel {
        return Some(format!(
            "{} numbers do not fill {} rows and {} columns",
            image.data.len(),
            image.height,
            image.width
        ));
    }
    if let Some((name, value)) = numbers.iter().find(|(_, value)| !value.is_finite()) {
        return Some(format!("the {name} is {value}"));
    }
    let is_layered = mosaic.pattern.is_empty() && image.has_all_channels();
    let fits =
        !mosaic.pattern.is_empty() && mosaic.rows.checked_mul(mosaic.cols) == Some(mosaic.pattern.len());
    if !is_layered && !fits {
        return Some(format!(
            "the color filter array of {} by {} pixels names {} channels",
            mosaic.rows,
            mosaic.cols,
            mosaic.pattern.len()
        ));
    }
    let negative = [
        ("exposure", image.exposure_s),
        ("gain", image.gain),
        ("conversion gain", image.dn_per_electron),
        ("read noise", image.read_noise_dn),
    ];
    if let Some((name, value)) = negative.iter().find(|(_, value)| *value < 0.0) {
        return Some(format!("the {name} is {value}, below zero"));
    }
    if image.bit_depth < 16 && u32::from(image.white_level) >> image.bit_depth > 0 {
        return Some(format!(
            "a converter of {} bits has no white level of {}; its largest number is {}",
            image.bit_depth,
            image.white_level,
            (1u32 << image.bit_depth) - 1
        ));
    }
    if f64::from(image.white_level) <= image.black_level {
        return Some(format!(
            "the white level, {}, is not above the black level, {}",
            image.white_level, image.black_level
        ));
    }
    let wrong = mosaic.pattern.iter().find(|&&channel| usize::from(channel) >= mosaic.channels.len());
    wrong.map(|channel| format!("the color filter array uses channel {channel} of {}", mosaic.channels.len()))
}

fn pixels_sha256(data: &[u16]) -> String {
    sha256_hex(
        data.chunks(1 << 15).map(|block| -> Vec<u8> { block.iter().flat_map(|v| v.to_le_bytes()).collect() }),
    )
}
