//! Pixels of plain TIFF images.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use super::FormatError;
use super::file::{MAX_IMAGE_BYTES, check_image_size, check_packing, guarded};

/// Most pages that are counted.
const MOST_PAGES: usize = 10_000;

/// Pixels of a gray or RGB image of 8 or 16 bits.
pub(super) struct TiffPixels {
    pub(super) width: usize,
    pub(super) height: usize,
    /// 1 or 3.
    pub(super) samples: usize,
    /// 8 or 16.
    pub(super) bits: u8,
    /// `[row, col, sample]`.
    pub(super) data: Vec<u16>,
}

/// An error of the decoder in words.
pub(super) fn damaged_tiff(path: &Path, error: tiff::TiffError) -> FormatError {
    match error {
        tiff::TiffError::IoError(source) if source.kind() != io::ErrorKind::UnexpectedEof => {
            FormatError::io(path, "read", source)
        }
        error => {
            FormatError::malformed(path, format!("not a valid TIFF file: {error}"), "Copy the file again")
        }
    }
}

/// A decoder that takes no more memory than an image may.
pub(super) fn bounded_decoder(
    path: &Path,
    file: BufReader<File>,
    length: u64,
) -> Result<Decoder<BufReader<File>>, FormatError> {
    let decoder = Decoder::new(file).map_err(|error| damaged_tiff(path, error))?;
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_IMAGE_BYTES as usize;
    limits.intermediate_buffer_size = MAX_IMAGE_BYTES as usize;
    limits.ifd_value_size = limits.ifd_value_size.max(length.min(MAX_IMAGE_BYTES) as usize);
    Ok(decoder.with_limits(limits))
}

/// Refuses a file of several pages: frames of a series, or the colors of one. Smaller forms of an image do not count.
///
/// # Errors
/// Several pages, with their number.
pub(super) fn check_single_page(
    path: &Path,
    decoder: &mut Decoder<BufReader<File>>,
) -> Result<(), FormatError> {
    let mut pages = 1;
    while decoder.more_images() && pages < MOST_PAGES {
        let before = decoder.ifd_pointer();
        // A page of a kind that is not read here is one, too, but not what lies where nothing can be read.
        let is_read = decoder.next_image().is_ok();
        if decoder.ifd_pointer() == before {
            break;
        }
        let kind = if is_read { decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType) } else { Ok(None) };
        pages += usize::from(kind.ok().flatten().is_none_or(|kind| kind & 5 == 0));
    }
    if pages == 1 {
        return Ok(());
    }
    let what = format!("it holds {pages} images (pages), and nothing says which one is meant");
    let hint = "Save the one as a file of its own; frames of a series each as one, colors on pages of their own as one RGB image";
    Err(FormatError::unsupported(path, what, hint))
}

/// Reads a gray or RGB image of 8 or 16 bits, packed in any way that the decoder knows.
///
/// # Errors
/// Other images, damaged files.
pub(super) fn read_tiff_pixels(path: &Path, file: File, length: u64) -> Result<TiffPixels, FormatError> {
    guarded(path, "TIFF", || {
        let damaged = |error| damaged_tiff(path, error);
        let mut decoder = bounded_decoder(path, BufReader::new(file), length)?;
        let (width, height) = decoder.dimensions().map_err(damaged)?;
        let color = decoder.colortype().map_err(damaged)?;
        let (samples, bits) = match color {
            tiff::ColorType::Gray(bits @ (8 | 16)) => (1, bits),
            tiff::ColorType::RGB(bits @ (8 | 16)) => (3, bits),
            _ => {
                let what = format!("the image is stored as {color:?}");
                let hint = "Raw frames are gray mosaics or linear RGB of 8 or 16 bits; export it as such";
                return Err(FormatError::unsupported(path, what, hint));
            }
        };
        let pixel_bytes = samples as u64 * u64::from(bits / 8);
        check_image_size(path, u64::from(width), u64::from(height), 2 * samples as u64, MAX_IMAGE_BYTES)?;
        check_packing(path, pixel_bytes * u64::from(width) * u64::from(height), length)?;
        let data: Vec<u16> = match decoder.read_image().map_err(damaged)? {
            DecodingResult::U16(data) => data,
            DecodingResult::U8(data) => data.into_iter().map(u16::from).collect(),
            _ => {
                return Err(FormatError::unsupported(
                    path,
                    "its samples are not unsigned integers",
                    "Save it with 16 bits",
                ));
            }
        };
        check_single_page(path, &mut decoder)?;
        let (width, height) = (width as usize, height as usize);
        if data.len() != width * height * samples {
            let what =
                "the channels are stored in separate planes (planar configuration 2), or rows are missing";
            return Err(FormatError::unsupported(path, what, "Save it with interleaved channels"));
        }
        Ok(TiffPixels { width, height, samples, bits, data })
    })
}
