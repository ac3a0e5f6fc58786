//! Raw frames as Adobe Digital Negatives (DNG 1.4): one file that raw converters open.
//!
//! The mosaic lies uncompressed in the first directory. The complete description of the frame (that of the TIFF form, with
//! its provenance) rides in `DNGPrivateData`, so that what is written is read back whole; other programs find black and
//! white level, color filter array, color matrix, neutral, exposure and noise in their own tags.

use std::io::{self, BufWriter};
use std::path::Path;

use tiff::encoder::{Rational, TiffEncoder, TiffValue};
use tiff::tags::{Tag, Type};

use super::described_frame::{Description, JudgedFrame, Samples, description, image_of};
use super::dng_pixels::{DngPixels, read_dng_pixels};
use super::frame_judgement::{
    FrameRemark, FrameTags, StoredFrame, alignment_words, left_aligned_bits, orientation_of,
};
use super::opcodes::opcodes_of;
use super::tiff_directory::{Directory, TiffBytes};
use crate::store::file::{read_sidecar, sidecar_path};
use crate::store::output::write_atomically;
use crate::{FileFormat, FormatError, Provenance};
use fluorspar::image::{Mosaic, SensorImage};

/// Name that opens our private data; a zero byte ends it.
const PRIVATE_MARK: &[u8] = b"Fluorspar\0";
const CFA: u16 = 32_803;
const LINEAR_RAW: u16 = 34_892;

/// How a raw converter shall make colors of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DngColor {
    /// Camera R, G, B from CIE 1931 XYZ under D65: `ColorMatrix1`, rows first.
    pub xyz_to_camera: [[f64; 3]; 3],
    /// R, G, B that a neutral surface gives under the light of the frame, largest 1: `AsShotNeutral`.
    pub neutral: [f64; 3],
}

impl Default for DngColor {
    /// Camera primaries as those of sRGB (IEC 61966-2-1), neutral where R, G and B are equal.
    fn default() -> Self {
        Self {
            xyz_to_camera: [
                [3.240_97, -1.537_383, -0.498_611],
                [-0.969_244, 1.875_968, 0.041_555],
                [0.055_63, -0.203_977, 1.056_972],
            ],
            neutral: [1.0; 3],
        }
    }
}

/// Values of type RATIONAL.
struct Rationals(Vec<u8>);
/// Values of type SRATIONAL.
struct SignedRationals(Vec<u8>);

/// A number as a fraction with six digits, whole numbers exactly.
fn fraction(value: f64) -> [i32; 2] {
    if value.fract() == 0.0 && value.abs() < f64::from(i32::MAX) {
        return [value as i32, 1];
    }
    let mut denominator = 1_000_000.0;
    while (value * denominator).abs() > f64::from(i32::MAX) && denominator > 1.0 {
        denominator /= 10.0;
    }
    [(value * denominator).round() as i32, denominator as i32]
}

fn fractions(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|&value| fraction(value)).flat_map(i32::to_ne_bytes).collect()
}

macro_rules! rational_values {
    ($name:ident, $kind:ident) => {
        impl TiffValue for $name {
            const BYTE_LEN: u8 = 8;
            const FIELD_TYPE: Type = Type::$kind;
            fn count(&self) -> usize {
                self.0.len() / 8
            }
            fn data(&self) -> std::borrow::Cow<'_, [u8]> {
                (&self.0).into()
            }
        }
    };
}
rational_values!(Rationals, RATIONAL);
rational_values!(SignedRationals, SRATIONAL);

/// Color codes of TIFF/EP for the channels of a mosaic; `None` when it has others than R, G and B.
fn color_codes(mosaic: &Mosaic) -> Option<Vec<u8>> {
    let code = |name: &String| match name.as_str() {
        "R" => Some(0),
        "G" => Some(1),
        "B" => Some(2),
        _ => None,
    };
    mosaic.channels.iter().map(code).collect()
}

/// Writes a raw frame as DNG. A monochrome frame becomes a `LinearRaw` image of one channel.
///
/// # Errors
/// When fields of the frame contradict each other, its channels are neither one nor R, G and B, or the file can't be
/// written.
pub fn write_sensor_dng(
    path: &Path,
    image: &SensorImage,
    color: &DngColor,
    provenance: Option<&Provenance>,
) -> Result<(), FormatError> {
    let description = description(path, image, provenance)?;
    let codes = color_codes(&image.mosaic);
    let is_color = match (&codes, image.mosaic.channels.len()) {
        (Some(codes), 3) if (0..3).all(|c| codes.contains(&c)) => true,
        (_, 1) => false,
        _ => {
            return Err(FormatError::unwritable(
                path,
                format!(
                    "DNG knows the channels R, G and B or one alone, not {}",
                    image.mosaic.channels.join(", ")
                ),
                "Write a .tiff",
            ));
        }
    };
    if image.mosaic.rows.max(image.mosaic.cols) > 64 {
        let what = "the cell of the color filter array is larger than 64 x 64 pixels";
        return Err(FormatError::unwritable(path, what, "Write a .tiff"));
    }
    let mut private = PRIVATE_MARK.to_vec();
    serde_json::to_writer(&mut private, &description)
        .map_err(|error| FormatError::io(path, "write", io::Error::other(error)))?;
    let pattern: Vec<u8> = match (&codes, is_color) {
        (Some(codes), true) => {
            image.mosaic.pattern.iter().map(|&channel| codes[usize::from(channel)]).collect()
        }
        _ => Vec::new(),
    };
    write_atomically(path, |writer| {
        let result = encode(writer, image, color, is_color, &pattern, &private);
        result.map_err(|error| match error {
            tiff::TiffError::IoError(source) => source,
            other => io::Error::other(other),
        })
    })
}

fn encode(
    writer: &mut BufWriter<std::fs::File>,
    image: &SensorImage,
    color: &DngColor,
    is_color: bool,
    pattern: &[u8],
    private: &[u8],
) -> tiff::TiffResult<()> {
    let tag = Tag::Unknown;
    let mut encoder = TiffEncoder::new(writer)?;
    let mut exif = encoder.extra_directory()?;
    exif.write_tag(tag(EXPOSURE_TIME), Rationals(fractions(&[image.exposure_s])))?;
    // Base gain is called ISO 100: a name, not a measured sensitivity.
    exif.write_tag(tag(ISO), (100.0 * image.gain).round().clamp(1.0, 65_535.0) as u16)?;
    let exif = exif.finish_with_offsets()?;

    let (width, height) = (image.width as u32, image.height as u32);
    let mut main = encoder.image_directory()?;
    let pixels = main.write_data(&image.data[..])?;
    main.write_tag(Tag::NewSubfileType, 0u32)?;
    main.write_tag(Tag::ImageWidth, width)?;
    main.write_tag(Tag::ImageLength, height)?;
    main.write_tag(Tag::BitsPerSample, 16u16)?;
    main.write_tag(Tag::SampleFormat, 1u16)?;
    main.write_tag(Tag::Compression, 1u16)?;
    main.write_tag(Tag::PhotometricInterpretation, if is_color { CFA } else { LINEAR_RAW })?;
    main.write_tag(Tag::Make, "Fluorspar")?;
    main.write_tag(Tag::Model, "simulated sensor")?;
    main.write_tag(Tag::StripOffsets, pixels as u32)?;
    main.write_tag(Tag::Orientation, 1u16)?;
    main.write_tag(Tag::SamplesPerPixel, 1u16)?;
    main.write_tag(Tag::RowsPerStrip, height)?;
    main.write_tag(Tag::StripByteCounts, 2 * width * height)?;
    main.write_tag(Tag::XResolution, Rational { n: 1, d: 1 })?;
    main.write_tag(Tag::YResolution, Rational { n: 1, d: 1 })?;
    main.write_tag(Tag::PlanarConfiguration, 1u16)?;
    main.write_tag(Tag::ResolutionUnit, 1u16)?;
    main.write_tag(Tag::Software, concat!("Fluorspar ", env!("CARGO_PKG_VERSION")))?;
    main.write_tag(Tag::ImageDescription, image.label.as_str())?;
    if is_color {
        main.write_tag(tag(33_421), &[image.mosaic.rows as u16, image.mosaic.cols as u16][..])?;
        main.write_tag(tag(33_422), pattern)?;
        main.write_tag(tag(50_710), &[0u8, 1, 2][..])?;
        main.write_tag(tag(50_711), 1u16)?;
        let matrix: Vec<f64> = color.xyz_to_camera.concat();
        main.write_tag(tag(50_721), SignedRationals(fractions(&matrix)))?;
        main.write_tag(tag(50_728), Rationals(fractions(&color.neutral)))?;
        main.write_tag(tag(50_778), 21u16)?; // D65
    }
    main.write_tag(Tag::ExifDirectory, exif.pointer.0 as u32)?;
    main.write_tag(tag(50_706), &[1u8, 4, 0, 0][..])?;
    main.write_tag(tag(50_707), &[1u8, 1, 0, 0][..])?;
    main.write_tag(tag(50_708), "Fluorspar simulated sensor")?;
    main.write_tag(tag(50_713), &[1u16, 1][..])?;
    main.write_tag(tag(50_714), Rationals(fractions(&[image.black_level.max(0.0)])))?;
    main.write_tag(tag(50_717), u32::from(image.white_level))?;
    main.write_tag(tag(50_718), Rationals(fractions(&[1.0, 1.0])))?;
    main.write_tag(tag(50_719), &[0u32, 0][..])?;
    main.write_tag(tag(50_720), &[width, height][..])?;
    main.write_tag(tag(50_829), &[0u32, 0, height, width][..])?;
    // NoiseProfile: variance = S x + O of values on 0 to 1.
    let range = f64::from(image.white_level) - image.black_level;
    let profile = [image.dn_per_electron / range, (image.read_noise_dn / range).powi(2)];
    if profile.iter().all(|v| *v > 0.0) {
        main.write_tag(tag(51_041), &profile[..])?;
    }
    main.write_tag(tag(50_740), private)?;
    main.finish()
}

/// Whether bytes are a DNG: a TIFF whose first directory tells a DNG version.
pub(crate) fn is_dng(bytes: &[u8]) -> bool {
    TiffBytes::new(bytes).is_some_and(|tiff| tiff.directories().iter().any(|d| d.data(50_706).is_some()))
}

/// Reads a DNG: ours whole, another camera's as far as its tags tell. What they do not tell (`dn_per_electron`,
/// `read_noise_dn`) is 0. A description beside it wins over its tags.
pub(crate) fn read_dng(path: &Path, bytes: &[u8]) -> Result<JudgedFrame, FormatError> {
    let DngFrame { description: inner, stored, .. } = read_dng_description(path, bytes)?;
    let description = match sidecar_path(path).exists() {
        true => read_sidecar(path, &FileFormat::RAW_FRAME)?,
        false => inner,
    };
    image_of(path, stored, &description)
}

/// What a DNG tells of itself, and its pixels.
pub(crate) struct DngFrame {
    pub(crate) description: Description,
    pub(crate) stored: StoredFrame,
    pub(crate) told: Told,
}

/// Which values the tags of a DNG tell; the others are those that the format has without them.
pub(crate) struct Told {
    pub(crate) black_level: bool,
    pub(crate) white_level: bool,
    pub(crate) gain: bool,
}

/// Reads a DNG without what may be described beside it.
pub(crate) fn read_dng_description(path: &Path, bytes: &[u8]) -> Result<DngFrame, FormatError> {
    let damaged = |what: &str| FormatError::malformed(path, what, "Copy the file again");
    let tiff = TiffBytes::new(bytes).ok_or_else(|| damaged("this does not begin like a DNG file"))?;
    let directories = tiff.directories();
    let first = directories.first().ok_or_else(|| damaged("the file has no directory"))?;
    let raw = raw_directory(path, &directories)?;
    let pixels = read_dng_pixels(path, &tiff, raw)?;
    let private = first.data(50_740).and_then(|data| data.strip_prefix(PRIVATE_MARK));
    if let Some(json) = private {
        let description = own_description(path, json, [pixels.width as u64, pixels.height as u64])?;
        let told = Told { black_level: true, white_level: true, gain: true };
        let stored = stored_frame(pixels, FrameTags::default());
        return Ok(DngFrame { description, stored, told });
    }
    let label = path.file_stem().map_or_else(|| "raw".into(), |s| s.to_string_lossy().into_owned());
    let (mut description, told) = from_tags(path, &tiff, first, raw, &pixels, label)?;
    let mut pixels = pixels;
    let whites = white_levels(path, raw, &description)?;
    if let Some(highest) = whites.iter().max() {
        description.white_level = *highest;
    }
    let orientation = orientation_of([first, raw]);
    let mut tags = FrameTags { orientation, whites, has_levels: true, ..FrameTags::default() };
    if raw.data(50_712).is_none() {
        let told_white = if told.white_level { description.white_level } else { 0 };
        tags.remarks.extend(right_aligned(&mut pixels, &mut description, &mut tags.whites, told_white));
    }
    let (mosaic, samples, width) = (&description.mosaic, pixels.samples, pixels.width);
    let channel = |value: usize| match samples {
        1 => mosaic.channel(value / width, value % width),
        _ => value % samples,
    };
    let opcodes = opcodes_of(raw, &pixels, channel);
    tags.factors = opcodes.factors;
    tags.remarks.extend(opcodes.remarks);
    Ok(DngFrame { description, stored: stored_frame(pixels, tags), told })
}

fn stored_frame(pixels: DngPixels, tags: FrameTags) -> StoredFrame {
    let DngPixels { width, height, data, black_offsets, .. } = pixels;
    StoredFrame { width, height, data, black_offsets, tags }
}

/// White levels by channel, where they differ: told by plane, or by place in the cell of a mosaic, of which the lowest counts.
fn white_levels(path: &Path, raw: &Directory<'_>, d: &Description) -> Result<Vec<u16>, FormatError> {
    let whites: Vec<u16> =
        raw.unsigned(50_717).iter().map(|white| (*white).clamp(1, 65_535) as u16).collect();
    if whites.iter().all(|white| *white == whites[0]) {
        return Ok(Vec::new());
    }
    let (is_mosaic, mosaic) = (d.samples == Samples::Mosaic, &d.mosaic);
    let planes = if is_mosaic { mosaic.channels.len() } else { 3 };
    if whites.len() == planes {
        return Ok(whites);
    }
    if is_mosaic && whites.len() == mosaic.pattern.len() {
        let lowest = |channel: usize| {
            let places = mosaic.pattern.iter().zip(&whites).filter(|(of, _)| usize::from(**of) == channel);
            places.map(|(_, white)| *white).min().unwrap_or(d.white_level)
        };
        return Ok((0..planes).map(lowest).collect());
    }
    let what = format!("its tag WhiteLevel has {} numbers where 1 or {planes} belong", whites.len());
    Err(FormatError::malformed(path, what, "Convert the raw file of the camera to DNG again"))
}

/// Divides values that stand in the upper bits, and all levels with them.
fn right_aligned(
    pixels: &mut DngPixels,
    description: &mut Description,
    whites: &mut [u16],
    told_white: u16,
) -> Option<FrameRemark> {
    let bits = left_aligned_bits(&pixels.data, told_white).filter(|bits| *bits < description.bit_depth)?;
    let shift = 16 - bits;
    let by = f64::from(1u32 << shift);
    for value in pixels.data.iter_mut().chain(whites) {
        *value >>= shift;
    }
    pixels.black_offsets.iter_mut().for_each(|offset| *offset /= by as f32);
    description.white_level = (description.white_level >> shift).max(1);
    description.bit_depth = bits;
    for number in
        [&mut description.black_level, &mut description.dn_per_electron, &mut description.read_noise_dn]
    {
        *number /= by;
    }
    Some(FrameRemark {
        key: "alignment",
        value: alignment_words(bits, shift),
        remark: format!("all values are multiples of {by}; the levels of the tags are divided, too"),
        is_doubtful: true,
    })
}

/// The description that our own files carry, of an image of this width and height.
fn own_description(path: &Path, json: &[u8], size: [u64; 2]) -> Result<Description, FormatError> {
    let json = json.trim_ascii_end().strip_suffix(b"\0").unwrap_or(json);
    FileFormat::RAW_FRAME.check_json(path, json)?;
    let description: Description = serde_json::from_slice(json).map_err(|_| {
        let what = "its description (DNGPrivateData) is damaged";
        FormatError::malformed(path, what, "Copy the file again")
    })?;
    if [description.width, description.height] != size {
        let [width, height] = size;
        let what = format!(
            "it is described as {} x {} pixels and has {width} x {height}",
            description.width, description.height
        );
        return Err(FormatError::malformed(path, what, "Was it changed by another program?"));
    }
    Ok(description)
}

/// The largest directory with a mosaic or with linear channels that is a frame itself, and neither a small nor an enhanced form of it
/// (NewSubFileType).
fn raw_directory<'a, 'b>(
    path: &Path,
    directories: &'b [Directory<'a>],
) -> Result<&'b Directory<'a>, FormatError> {
    let is_raw = |d: &&Directory<'_>| {
        let kind = d.first(262);
        kind == Some(u64::from(CFA)) || (kind == Some(u64::from(LINEAR_RAW)) && [1, 3].contains(&d.samples()))
    };
    let size = |d: &Directory<'_>| d.first(256).unwrap_or(0).saturating_mul(d.first(257).unwrap_or(0));
    let raw: Vec<&Directory<'_>> = directories.iter().filter(is_raw).collect();
    let mut frames: Vec<_> = raw.iter().copied().filter(|d| d.first(254).unwrap_or(0) == 0).collect();
    if frames.is_empty() {
        frames = raw;
    }
    let largest = frames.iter().map(|d| size(d)).max();
    frames.retain(|d| Some(size(d)) == largest);
    match frames.as_slice() {
        [] => {
            let what = "no directory of it holds a mosaic or a linear raw image";
            let hint = "Give the raw file of the camera, not an image made of it";
            Err(FormatError::unsupported(path, what, hint))
        }
        [one] => Ok(one),
        several => {
            let what = format!("it holds {} raw images, and nothing says which one is meant", several.len());
            let hint = "Save each frame of a burst or of shifted pixels as a DNG of its own";
            Err(FormatError::unsupported(path, what, hint))
        }
    }
}

/// The frame as the tags of another camera describe it.
fn from_tags(
    path: &Path,
    tiff: &TiffBytes<'_>,
    first: &Directory<'_>,
    raw: &Directory<'_>,
    pixels: &DngPixels,
    label: String,
) -> Result<(Description, Told), FormatError> {
    let stored_bits = raw.first(258).unwrap_or(16).clamp(1, 16) as u8;
    // By plane where they differ
    let white_tag = raw.unsigned(50_717).into_iter().max().map(|white| white.clamp(1, 65_535) as u16);
    let white_level = white_tag.unwrap_or(((1u32 << stored_bits) - 1) as u16);
    // Many cameras store 12 bits in 16; a table that linearizes makes larger numbers than the stored ones
    let is_linearized = raw.data(50_712).is_some();
    let most_bits = if is_linearized { 16 } else { stored_bits };
    let bits = white_tag.map_or(stored_bits, |white| bits_of(white).min(most_bits));
    let black_level = pixels.black_level;
    let exposure_s = camera_number(tiff, &[raw, first], EXPOSURE_TIME).unwrap_or(0.0);
    let gain = camera_number(tiff, &[raw, first], ISO).and_then(gain_of_iso);
    let told = Told {
        black_level: raw.data(50_714).is_some(),
        white_level: white_tag.is_some(),
        gain: gain.is_some(),
    };
    let range = f64::from(white_level) - black_level;
    let profile = [raw, first].map(|d| d.numbers(51_041)).into_iter().find(|p| p.len() >= 2);
    let noise = |index: usize| profile.as_ref().map_or(0.0, |p| p[index]).max(0.0);
    // Channels that lie ready were interpolated from a Bayer array, in most cameras.
    let (mosaic, samples) = if raw.first(262) == Some(u64::from(CFA)) {
        (mosaic_of(path, raw)?, Samples::Mosaic)
    } else if pixels.samples == 1 {
        (Mosaic::monochrome(), Samples::Mosaic)
    } else {
        (Mosaic::bayer("rggb").unwrap_or_default(), Samples::Developed)
    };
    let description = Description {
        format: FileFormat::RAW_FRAME.version(),
        label,
        width: pixels.width as u64,
        height: pixels.height as u64,
        mosaic,
        samples,
        black_level,
        white_level,
        bit_depth: bits,
        exposure_s,
        gain: gain.unwrap_or(1.0),
        dn_per_electron: noise(0) * range,
        read_noise_dn: noise(1).sqrt() * range,
        ..Description::default()
    };
    Ok((description, told))
}

/// Exposure time, s, and sensitivity (ISO 12232).
pub(crate) const EXPOSURE_TIME: u16 = 33_434;
pub(crate) const ISO: u16 = 34_855;

/// Gain of a sensitivity, base gain being ISO 100. The largest number of the tag says that other tags tell it (Exif 2.3).
pub(crate) fn gain_of_iso(iso: f64) -> Option<f64> {
    (iso < 65_535.0).then_some(iso / 100.0)
}

/// A number above 0 that a camera tells of its frame: in the Exif directory that one of the directories points to, as most do, else
/// among their own tags, as TIFF/EP (ISO 12234-2) has it.
pub(crate) fn camera_number(tiff: &TiffBytes<'_>, directories: &[&Directory<'_>], tag: u16) -> Option<f64> {
    let number = |directory: &Directory<'_>| {
        let value = directory.numbers(tag).first().copied();
        value.filter(|value| value.is_finite() && *value > 0.0)
    };
    let in_exif = directories.iter().find_map(|d| number(&tiff.directory(d.first(34_665)?)?));
    in_exif.or_else(|| directories.iter().find_map(|d| number(d)))
}

/// The fewest bits that hold a number.
pub(crate) fn bits_of(value: u16) -> u8 {
    (u16::BITS - value.leading_zeros()).max(1) as u8
}

/// Names of the channels of color frames.
const COLORS: [&str; 3] = ["R", "G", "B"];

/// The color filter array of a directory, whose first pixel is that of the active area.
pub(crate) fn mosaic_of(path: &Path, raw: &Directory<'_>) -> Result<Mosaic, FormatError> {
    let size = raw.unsigned(33_421);
    let pattern = raw.data(33_422).unwrap_or_default();
    let (rows, cols) = match size.as_slice() {
        [rows @ 1..=64, cols @ 1..=64] => (*rows as usize, *cols as usize),
        _ => (0, 0),
    };
    if rows == 0 || pattern.len() != rows * cols || pattern.iter().any(|&code| code > 2) {
        let what = "its color filter array is missing or has other colors than red, green and blue";
        return Err(FormatError::unsupported(path, what, "Give a frame of an RGB or a monochrome sensor"));
    }
    Ok(Mosaic { rows, cols, pattern: pattern.to_vec(), channels: COLORS.map(String::from).to_vec() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_keep_whole_numbers_and_six_digits() {
        assert_eq!(fraction(64.0), [64, 1]);
        assert_eq!(fraction(-0.25), [-250_000, 1_000_000]);
        assert_eq!(fraction(0.03), [30_000, 1_000_000]);
        let [n, d] = fraction(123_456.789);
        assert!((f64::from(n) / f64::from(d) - 123_456.789).abs() < 1e-3);
    }
}
