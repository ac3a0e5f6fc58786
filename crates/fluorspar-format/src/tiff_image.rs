//! Pixels of plain TIFF images.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use super::FormatError;
use super::file::{MAX_IMAGE_BYTES, check_image_size, check_packing, guarded, read_file};
use super::tiff_directory::{Directory, TiffBytes};

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
        // Decoders of compressed rows have errors of this kind, too, with no system behind them
        tiff::TiffError::IoError(source) if source.raw_os_error().is_some() => {
            FormatError::io(path, "read", source)
        }
        tiff::TiffError::UnsupportedError(kind) => {
            let what = format!("this kind of TIFF is not read ({kind})");
            FormatError::unsupported(path, what, plain_copy(path))
        }
        error => {
            FormatError::malformed(path, format!("not a valid TIFF file: {error}"), "Copy the file again")
        }
    }
}

/// How to make a form of a file that is read.
fn plain_copy(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    format!(
        "Save it uncompressed, gray or RGB of 8 or 16 bits, for instance with LibTIFF: tiffcp -c none -p contig {name} {stem}_plain.tif"
    )
}

/// Compressions of TIFF by the numbers of tag 259 that are not read here.
const COMPRESSIONS: [(u64, &str); 11] = [
    (6, "JPEG as of TIFF 6.0 (old-style)"),
    (34_712, "JPEG 2000"),
    (34_887, "LERC"),
    (34_892, "lossy JPEG of DNG"),
    (34_925, "LZMA"),
    (34_926, "ZSTD"),
    (50_000, "ZSTD"),
    (50_001, "WebP"),
    (50_002, "JPEG XL"),
    (52_546, "JPEG XL"),
    (32_809, "ThunderScan"),
];

/// Refuses TIFFs that are valid but of a kind that is not read, by its name.
///
/// # Errors
/// Such a file; one that can't be read.
pub(super) fn check_kind(path: &Path) -> Result<(), FormatError> {
    let bytes = read_file(path, MAX_IMAGE_BYTES)?;
    let Some(tiff) = TiffBytes::new(&bytes) else { return Ok(()) };
    let directories = tiff.directories();
    let Some(first) = directories.first() else { return Ok(()) };
    let compression = first.first(259).unwrap_or(1);
    let known = COMPRESSIONS.iter().find(|(number, _)| *number == compression);
    let what = if let Some((_, name)) = known {
        format!("its pixels are compressed with {name}, which is not read")
    } else if compression == 5 && has_old_lzw(first, &bytes) {
        "its pixels are compressed with old-style LZW (bits in reverse order, of before TIFF 6.0), which is not read".into()
    } else if first.first(262) == Some(3) {
        let what = "its pixels are indices of a palette, not numbers of light";
        let hint = "Give the file that it was made from, or save it as gray or RGB";
        return Err(FormatError::unsupported(path, what, hint));
    } else if first.first(284) == Some(2) && super::dng::samples(first) > 1 {
        "its channels are stored in separate planes (planar configuration 2), which are not read".into()
    } else {
        return Ok(());
    };
    Err(FormatError::unsupported(path, what, plain_copy(path)))
}

/// Whether rows begin with the clear code from the lowest bit on, by which LibTIFF knows them, too.
fn has_old_lzw(first: &Directory<'_>, bytes: &[u8]) -> bool {
    let offset = first.first(273).or_else(|| first.first(324)).and_then(|at| usize::try_from(at).ok());
    let start = offset.and_then(|at| bytes.get(at..at.checked_add(2)?));
    start.is_some_and(|start| start[0] == 0 && start[1] & 1 == 1)
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
        check_kind(path)?;
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
            return Err(FormatError::malformed(path, "rows of the image are missing", "Copy the file again"));
        }
        Ok(TiffPixels { width, height, samples, bits, data })
    })
}
