//! Masks: images in which everything but zero is inside.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use png::{BitDepth, ColorType};
use tiff::decoder::DecodingResult;
use tiff::tags::Tag;

use super::png::read_png;
use crate::FormatError;
use crate::frame::tiff_image::{bounded_decoder, check_kind, check_single_page, damaged_tiff};
use crate::npy_array::{NPY_MAGIC, read_npy_mask};
use crate::store::file::{
    MAX_IMAGE_BYTES, check_image_size, check_not_empty, check_packing, guarded, read_file,
};
use crate::store::input::open_plain;
use fluorspar::image::Orientation;

/// Which pixels of an image are meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Whether a pixel is inside, `[row, col]`, rows from the top.
    pub inside: Vec<bool>,
}

/// Reads a mask from a PNG, a TIFF (8 to 32 bits, gray or color) or a NumPy array `[row, col]`. A pixel is inside where any color is not
/// stored as zero and it is not wholly transparent.
///
/// # Errors
/// Other files, damaged ones, and masks in which nothing or everything is inside.
pub fn read_mask(path: &Path) -> Result<MaskImage, FormatError> {
    let failed = |source| FormatError::io(path, "read", source);
    let (mut file, length) = open_plain(path)?;
    let mut magic = Vec::new();
    check_not_empty(path, length)?;
    Read::by_ref(&mut file).take(8).read_to_end(&mut magic).map_err(failed)?;
    let mask = if magic.starts_with(b"\x89PNG") {
        png_mask(path)?
    } else if magic.starts_with(NPY_MAGIC) {
        npy_mask(path)?
    } else if magic.starts_with(b"II") || magic.starts_with(b"MM") {
        file.rewind().map_err(failed)?;
        tiff_mask(path, file, length)?
    } else {
        let what = "a mask is a PNG, a TIFF or a NumPy array, and this is none of them";
        return Err(FormatError::unsupported(path, what, "Save it as .png, .tiff or .npy"));
    };
    let (what, hint) = match [true, false].map(|side| mask.inside.contains(&side)) {
        [true, true] => return Ok(mask),
        [false, _] => {
            ("every pixel of the mask is zero: it selects nothing", "Paint the region white on black")
        }
        // A picture that was painted upon, or a white ground
        _ => (
            "no pixel of the mask is zero: it selects the whole image",
            "Paint the region on black; the whole image is a rectangle",
        ),
    };
    Err(FormatError::malformed(path, what, hint))
}

/// Whether a pixel of some samples is inside: the last one of `colors + 1` is its opacity.
fn is_inside<T: Copy + PartialOrd + Default>(pixel: &[T], colors: usize) -> bool {
    // What is no number is outside: ImageJ has it as background
    let is_some = |value: &T| *value < T::default() || *value > T::default();
    pixel[..colors].iter().any(is_some) && pixel.get(colors).is_none_or(is_some)
}

/// A mask as viewers show it, as frames are.
fn turned(orientation: Orientation, size: [usize; 2], stored: Vec<bool>) -> MaskImage {
    let [width, height] = Orientation::size(size, orientation);
    MaskImage { width, height, inside: orientation.turn(size, &stored) }
}

fn png_mask(path: &Path) -> Result<MaskImage, FormatError> {
    let mut raw = read_png(path, 1)?;
    if raw.is_inverted {
        raw.bytes.iter_mut().for_each(|byte| *byte = !*byte);
    }
    let samples = raw.color.samples();
    let has_alpha = matches!(raw.color, ColorType::GrayscaleAlpha | ColorType::Rgba);
    let colors = samples - usize::from(has_alpha);
    let inside = match raw.depth {
        BitDepth::Sixteen => {
            let values: Vec<u16> =
                raw.bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect();
            values.chunks_exact(samples).map(|pixel| is_inside(pixel, colors)).collect()
        }
        _ => raw.bytes.chunks_exact(samples).map(|pixel| is_inside(pixel, colors)).collect(),
    };
    Ok(turned(raw.orientation, [raw.width, raw.height], inside))
}

fn npy_mask(path: &Path) -> Result<MaskImage, FormatError> {
    let (shape, values) = read_npy_mask(path)?;
    let [height, width] = shape.as_slice() else {
        let what = format!("the array has the shape {shape:?}, a mask has rows and columns");
        return Err(FormatError::unsupported(path, what, "Save a[:, :, 0], for instance"));
    };
    check_image_size(path, *width, *height, 4, MAX_IMAGE_BYTES)?;
    if values.iter().any(|value| value.is_nan()) {
        return Err(FormatError::malformed(path, "a value of the mask is NaN", "Put 0 outside and 1 inside"));
    }
    let inside = values.iter().map(|value| is_inside(&[*value], 1)).collect();
    Ok(MaskImage { width: *width as usize, height: *height as usize, inside })
}

/// The numbers of a TIFF whose zero is white, which the decoder turns around: ImageJ stores 255 for what is selected, however it is shown.
fn as_stored(decoded: DecodingResult) -> DecodingResult {
    match decoded {
        DecodingResult::U8(values) => DecodingResult::U8(values.into_iter().map(|value| !value).collect()),
        DecodingResult::U16(values) => DecodingResult::U16(values.into_iter().map(|value| !value).collect()),
        DecodingResult::U32(values) => DecodingResult::U32(values.into_iter().map(|value| !value).collect()),
        DecodingResult::F32(values) => {
            DecodingResult::F32(values.into_iter().map(|value| 1.0 - value).collect())
        }
        other => other,
    }
}

/// Which pixels are inside; `None` of other kinds of numbers.
fn marked(image: &DecodingResult, samples: usize, colors: usize) -> Option<Vec<bool>> {
    fn of<T: Copy + PartialOrd + Default>(values: &[T], samples: usize, colors: usize) -> Vec<bool> {
        values.chunks_exact(samples).map(|pixel| is_inside(pixel, colors)).collect()
    }
    Some(match image {
        DecodingResult::U8(values) => of(values, samples, colors),
        DecodingResult::U16(values) => of(values, samples, colors),
        DecodingResult::U32(values) => of(values, samples, colors),
        DecodingResult::F32(values) => of(values, samples, colors),
        DecodingResult::I8(values) => of(values, samples, colors),
        DecodingResult::I16(values) => of(values, samples, colors),
        DecodingResult::I32(values) => of(values, samples, colors),
        _ => return None,
    })
}

fn tiff_mask(path: &Path, file: File, length: u64) -> Result<MaskImage, FormatError> {
    guarded(path, "TIFF", || {
        check_kind(path, &read_file(path, MAX_IMAGE_BYTES)?, false)?;
        let damaged = |error| damaged_tiff(path, error);
        let mut decoder = bounded_decoder(path, BufReader::new(file), length)?;
        let orientation = decoder.find_tag_unsigned::<u16>(Tag::Orientation).ok().flatten();
        let orientation = orientation.and_then(|tag| Orientation::of_tag(u64::from(tag))).unwrap_or_default();
        let described = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
        let is_of_imagej = described.starts_with("ImageJ=");
        let photometric = decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation).ok().flatten();
        let (width, height) = decoder.dimensions().map_err(damaged)?;
        let color = decoder.colortype().map_err(damaged)?;
        let (colors, samples, bits) = match color {
            tiff::ColorType::Gray(bits) => (1, 1, bits),
            tiff::ColorType::GrayA(bits) => (1, 2, bits),
            tiff::ColorType::RGB(bits) => (3, 3, bits),
            tiff::ColorType::RGBA(bits) => (3, 4, bits),
            _ => (0, 0, 0),
        };
        if ![8, 16, 32].contains(&bits) {
            let what = format!("the mask is stored as {color:?}");
            return Err(FormatError::unsupported(path, what, "Save it as an 8-bit gray image"));
        }
        let pixel_bytes = u64::from(bits / 8) * samples as u64;
        check_image_size(path, u64::from(width), u64::from(height), pixel_bytes, MAX_IMAGE_BYTES)?;
        check_packing(path, pixel_bytes * u64::from(width) * u64::from(height), length)?;
        let mut image = decoder.read_image().map_err(damaged)?;
        if photometric == Some(0) && is_of_imagej {
            image = as_stored(image);
        }
        let inside = marked(&image, samples, colors).ok_or_else(|| {
            let what = "its numbers are of another kind";
            FormatError::unsupported(path, what, "Save it as an 8-bit gray image")
        })?;
        check_single_page(path, &mut decoder)?;
        if inside.len() != width as usize * height as usize {
            return Err(FormatError::malformed(path, "rows of the image are missing", "Copy the file again"));
        }
        Ok(turned(orientation, [width as usize, height as usize], inside))
    })
}
