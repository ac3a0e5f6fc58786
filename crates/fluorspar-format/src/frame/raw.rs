//! Raw sensor frames: TIFF or PNG, or packed, with a JSON description next to them; DNG with it inside.

use std::io::{self, Read, Seek};
use std::path::Path;

use png::{BitDepth, ColorType};
use tiff::encoder::{TiffEncoder, colortype::Gray16};
use tiff::tags::Tag;

use super::camera_raw::{no_frame, refuse_camera_raw};
use super::described_frame::{Description, JudgedFrame, description, image_of};
use super::dng::{is_dng, read_dng};
use super::frame_judgement::{FrameTags, StoredFrame, orientation_of};
use super::packed_raw::read_packed;
use super::tiff_directory::TiffBytes;
use super::tiff_image::{TiffPixels, read_tiff_pixels};
use super::tone_curve::tone_curve_error;
use crate::image::png::{read_png, write_png};
use crate::store::file::{
    MAX_IMAGE_BYTES, check_not_empty, read_file, read_sidecar, sidecar_path, write_sidecar,
};
use crate::store::input::open_plain;
use crate::store::output::write_atomically;
use crate::{FileFormat, FormatError, Loaded, Provenance};
use fluorspar::image::SensorImage;

/// Writes a raw frame as 16-bit gray TIFF, and its description to `PATH.json`.
///
/// # Errors
/// When fields of the frame contradict each other or a file can't be written.
pub fn write_sensor_tiff(
    path: &Path,
    image: &SensorImage,
    provenance: Option<&Provenance>,
) -> Result<(), FormatError> {
    let description = description(path, image, provenance)?;
    write_atomically(path, |writer| {
        let result = TiffEncoder::new(writer).and_then(|mut encoder| {
            let mut frame = encoder.new_image::<Gray16>(image.width as u32, image.height as u32)?;
            frame.encoder().write_tag(Tag::Software, concat!("Fluorspar ", env!("CARGO_PKG_VERSION")))?;
            frame.encoder().write_tag(Tag::ImageDescription, tiff_description(image).as_str())?;
            frame.write_data(&image.data)
        });
        result.map_err(|error| match error {
            tiff::TiffError::IoError(source) => source,
            other => io::Error::other(other),
        })
    })?;
    write_sidecar(path, &description)
}

/// What a viewer shows of a raw frame: its name, mosaic and levels in ASCII.
fn tiff_description(image: &SensorImage) -> String {
    let pattern = image.mosaic.pattern.chunks(image.mosaic.cols.max(1));
    let rows: Vec<String> = pattern
        .map(|row| {
            let names = row.iter().filter_map(|&c| image.mosaic.channels.get(usize::from(c)));
            names.map(String::as_str).collect::<Vec<_>>().join(" ")
        })
        .collect();
    let text = format!(
        "raw frame {}; mosaic {}; black {} DN, white {} DN; {} ms, gain {}; more in the .json file beside it",
        image.label,
        rows.join(" / "),
        image.black_level,
        image.white_level,
        1e3 * image.exposure_s,
        image.gain
    );
    text.chars()
        .map(|letter| if letter.is_ascii() && !letter.is_ascii_control() { letter } else { '?' })
        .collect()
}

/// Writes a raw frame as 16-bit gray PNG, and its description to `PATH.json`.
///
/// # Errors
/// When fields of the frame contradict each other or a file can't be written.
pub fn write_sensor_png(
    path: &Path,
    image: &SensorImage,
    provenance: Option<&Provenance>,
) -> Result<(), FormatError> {
    let description = description(path, image, provenance)?;
    let bytes: Vec<u8> = image.data.iter().flat_map(|value| value.to_be_bytes()).collect();
    write_png(path, image.width, image.height, ColorType::Grayscale, BitDepth::Sixteen, &bytes)?;
    write_sidecar(path, &description)
}

/// Reads what [`write_sensor_tiff`], [`write_sensor_png`], [`crate::write_sensor_dng`] or [`crate::write_packed_raw`] wrote, and raw
/// frames of cameras: DNG, or the other forms with a description beside them.
///
/// Unknown conversion gain and noise of a camera are 0.
///
/// # Errors
/// A missing or mismatched description, another kind of image, damaged files.
pub fn read_sensor_image(path: &Path) -> Result<Loaded<SensorImage>, FormatError> {
    read_judged_frame(path).map(|frame| Loaded { image: frame.image, provenance: frame.provenance })
}

/// Reads a raw frame as [`read_sensor_image`] does, with what was found of it.
pub(crate) fn read_judged_frame(path: &Path) -> Result<JudgedFrame, FormatError> {
    let failed = |source| FormatError::io(path, "read", source);
    let (mut file, length) = open_plain(path)?;
    let mut magic = Vec::new();
    check_not_empty(path, length)?;
    Read::by_ref(&mut file).take(16).read_to_end(&mut magic).map_err(failed)?;
    let stored = if magic.starts_with(b"\x89PNG") {
        read_frame_png(path)?
    } else if magic.starts_with(b"II") || magic.starts_with(b"MM") {
        let named = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dng"));
        let bytes = read_file(path, MAX_IMAGE_BYTES)?;
        if named || (!sidecar_path(path).exists() && is_dng(&bytes)) {
            return read_dng(path, &bytes);
        }
        refuse_camera_raw(path, &bytes)?;
        file.rewind().map_err(failed)?;
        let TiffPixels { width, height, data, .. } = read_tiff_pixels(path, file, &bytes)?;
        StoredFrame { width, height, data, tags: tiff_tags(&bytes), ..StoredFrame::default() }
    } else {
        return read_by_description(path, &magic);
    };
    let description: Description = read_sidecar(path, &FileFormat::RAW_FRAME)?;
    image_of(path, stored, &description)
}

/// What the tags of a TIFF tell beside the description of its frame.
pub(crate) fn tiff_tags(bytes: &[u8]) -> FrameTags {
    let directories = TiffBytes::new(bytes).map(|tiff| tiff.directories()).unwrap_or_default();
    FrameTags { orientation: orientation_of(directories.first()), ..FrameTags::default() }
}

/// A file that does not tell its format: its description does.
fn read_by_description(path: &Path, start: &[u8]) -> Result<JudgedFrame, FormatError> {
    if !sidecar_path(path).exists() {
        return Err(no_frame(path, start));
    }
    let description: Description = read_sidecar(path, &FileFormat::RAW_FRAME)?;
    match description.packing {
        Some(rows) => read_packed(path, description, rows),
        None => Err(no_frame(path, start)),
    }
}

/// Samples without what scaled them to 16 bits, below those that count: the format has it so, by repeating the upper bits or by a factor. Of
/// files that store numbers of fewer bits as they are nothing is taken.
fn unscaled(mut samples: Vec<u16>, significant: Option<u8>) -> Vec<u16> {
    let Some(bits @ 1..16) = significant else { return samples };
    let below = u16::MAX >> bits;
    let is_scaled = |value: &u16| u32::from(value & below) <= (u32::from(*value) + (1 << (bits - 1))) >> bits;
    if samples.iter().all(is_scaled) {
        samples.iter_mut().for_each(|value| *value &= !below);
    }
    samples
}

/// A frame as PNG: one number or three a pixel.
pub(crate) fn read_frame_png(path: &Path) -> Result<StoredFrame, FormatError> {
    let raw = read_png(path, size_of::<u16>() as u64)?;
    if ![ColorType::Grayscale, ColorType::Rgb].contains(&raw.color) {
        let what = format!("the image is stored as {:?}", raw.color);
        let hint = "Raw frames are gray mosaics or linear RGB of 8 or 16 bits; export it as such";
        return Err(FormatError::unsupported(path, what, hint));
    }
    if let Some(told_by) = raw.tone_curve {
        return Err(tone_curve_error(path, told_by));
    }
    let (orientation, bits) = (raw.orientation, raw.significant_bits);
    let data = match raw.depth {
        BitDepth::Sixteen => {
            let values = raw.bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]]));
            unscaled(values.collect(), bits)
        }
        _ => raw.bytes.iter().map(|&byte| u16::from(byte)).collect(),
    };
    let tags = FrameTags { orientation, bits, ..FrameTags::default() };
    Ok(StoredFrame { width: raw.width, height: raw.height, data, tags, ..StoredFrame::default() })
}
