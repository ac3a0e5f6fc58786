//! Pixels of plain TIFF images.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use super::tiff_directory::{Directory, TiffBytes};
use super::tone_curve::{is_bent, profile_is_curved, tone_curve_error};
use crate::FormatError;
use crate::store::file::{MAX_IMAGE_BYTES, check_image_size, check_packing, guarded};
use fluorspar::quote::shell_word;

/// Most pages that are counted.
const MOST_PAGES: usize = 10_000;

/// Pixels of a gray or RGB image of 8 or 16 bits.
pub(crate) struct TiffPixels {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// 1 or 3.
    pub(crate) samples: usize,
    /// 8 or 16.
    pub(crate) bits: u8,
    /// `[row, col, sample]`.
    pub(crate) data: Vec<u16>,
}

/// An error of the decoder in words.
pub(crate) fn damaged_tiff(path: &Path, error: tiff::TiffError) -> FormatError {
    match error {
        // Decoders of compressed rows have errors of this kind, too, with no system behind them, and a place before the begin of the file
        // is refused by the system
        tiff::TiffError::IoError(source)
            if source.raw_os_error().is_some() && source.kind() != io::ErrorKind::InvalidInput =>
        {
            FormatError::io(path, "read", source)
        }
        tiff::TiffError::IoError(source) if source.kind() == io::ErrorKind::InvalidInput => {
            let what = "not a valid TIFF file: it tells of a place outside the file";
            FormatError::malformed(path, what, "Copy the file again")
        }
        tiff::TiffError::IoError(source) if source.kind() == io::ErrorKind::UnexpectedEof => {
            let what = "the TIFF file is cut short: it ends amid its pixels or the tags that describe them";
            FormatError::malformed(path, what, "Copy the file again")
        }
        tiff::TiffError::UnsupportedError(kind) => {
            let what = format!("this kind of TIFF is not read ({kind})");
            FormatError::unsupported(path, what, python_copy(path, ""))
        }
        error => {
            FormatError::malformed(path, format!("not a valid TIFF file: {error}"), "Copy the file again")
        }
    }
}

/// What a shell takes for a file as it was named, and for one beside it whose name ends otherwise.
pub(crate) fn names(path: &Path, ending: &str) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let copy = path.with_file_name(format!("{stem}{ending}"));
    [path, &copy].map(|path| shell_word(&path.to_string_lossy())).join(" ")
}

/// How to make a form of a file that is read, of what LibTIFF knows.
fn plain_copy(path: &Path, options: &str) -> String {
    let names = names(path, "_plain.tif");
    format!(
        "Save it uncompressed, gray or RGB of 8 or 16 bits, for instance with LibTIFF: tiffcp {options}-c none {names}"
    )
}

/// The same of what LibTIFF does not copy; `change` is what becomes of the array.
fn python_copy(path: &Path, change: &str) -> String {
    python_tiff(path, ["imagecodecs", ""], &format!("t.imread(sys.argv[1]){change}"))
}

/// The same of an array that a further package, or module, of Python reads.
pub(crate) fn python_tiff(path: &Path, [package, module]: [&str; 2], array: &str) -> String {
    let names = names(path, "_plain.tif");
    format!(
        "Save it uncompressed, gray or RGB of 8 or 16 bits, for instance in Python (pip install tifffile {package}): \
         python -c \"import sys, tifffile as t{module}; t.imwrite(sys.argv[2], {array})\" {names}"
    )
}

/// Compressions of TIFF by the numbers of tag 259 that are not read here, and whether LibTIFF makes a plain copy.
const COMPRESSIONS: [(u64, &str, bool); 11] = [
    (6, "JPEG as of TIFF 6.0 (old-style)", true),
    (34_712, "JPEG 2000", false),
    (34_887, "LERC", false),
    (34_892, "lossy JPEG of DNG", false),
    (34_925, "LZMA", true),
    (34_926, "ZSTD", true),
    (50_000, "ZSTD", true),
    (50_001, "WebP", false),
    (50_002, "JPEG XL", false),
    (52_546, "JPEG XL", false),
    (32_809, "ThunderScan", true),
];

/// The name of a compression of TIFF, else its number.
pub(crate) fn compression_name(number: u64) -> String {
    let known = COMPRESSIONS.iter().find(|(known, ..)| *known == number);
    known.map_or_else(|| format!("TIFF compression {number}"), |(_, name, _)| (*name).into())
}

/// Photometric interpretations of TIFF (tag 262) that no frame has: what its numbers are.
const PHOTOMETRICS: [(u64, &str); 9] = [
    (4, "a mask of transparency"),
    (5, "CMYK, amounts of ink"),
    (6, "YCbCr, brightness and color on a tone curve"),
    (8, "CIE L*a*b*, on a tone curve"),
    (9, "ICC L*a*b*, on a tone curve"),
    (10, "ITU L*a*b*, on a tone curve"),
    (32_844, "logarithms of luminance"),
    (32_845, "logarithms of luminance"),
    (34_892, "linear raw values of a DNG without its version"),
];
/// Photometric interpretation of a mosaic.
const CFA: u64 = 32_803;

/// Refuses TIFFs that are valid but of a kind that is not read, by its name: of frames more kinds than of masks.
///
/// # Errors
/// Such a file.
pub(crate) fn check_kind(path: &Path, bytes: &[u8], is_frame: bool) -> Result<(), FormatError> {
    let Some(tiff) = TiffBytes::new(bytes) else { return Ok(()) };
    let directories = tiff.directories();
    let Some(first) = directories.first() else { return Ok(()) };
    let compression = first.first(259).unwrap_or(1);
    // What JPEG is, is no frame in whatever form
    let known =
        COMPRESSIONS.iter().find(|(number, ..)| *number == compression && !(is_frame && *number == 6));
    let (what, hint) = if let Some((_, name, is_copied)) = known {
        let hint = if *is_copied { plain_copy(path, "") } else { python_copy(path, "") };
        (format!("its pixels are compressed with {name}, which is not read"), hint)
    } else if compression == 5 && has_old_lzw(first, bytes) {
        let what = "its pixels are compressed with old-style LZW (bits in reverse order, of before TIFF 6.0), which is not read";
        (what.into(), plain_copy(path, ""))
    } else if first.first(266) == Some(2) {
        let what = "the bits of its bytes are stored in reverse order (FillOrder 2), which is not read";
        (what.into(), plain_copy(path, "-f msb2lsb "))
    } else if first.first(262) == Some(3) {
        let what = "its pixels are indices of a palette, not numbers of light";
        (what.into(), "Give the file that it was made from, or save it as gray or RGB".into())
    } else if first.first(284) == Some(2) && first.samples() > 1 {
        let what = "its channels are stored in separate planes (planar configuration 2), which are not read";
        (what.into(), python_copy(path, ".transpose(1, 2, 0), photometric='rgb'"))
    } else {
        return if is_frame { check_numbers(path, first) } else { Ok(()) };
    };
    Err(FormatError::unsupported(path, what, hint))
}

/// Refuses images whose numbers are none of light.
fn check_numbers(path: &Path, first: &Directory<'_>) -> Result<(), FormatError> {
    let photometric = first.first(262);
    let bits = first.first(258).unwrap_or(1);
    let tables = first.unsigned(301);
    let samples = first.samples() as usize;
    // One for all samples, or one for each
    let of_sample =
        if tables.len().is_multiple_of(3) && samples > 1 { tables.len() / 3 } else { tables.len() };
    let (what, hint): (String, String) = if matches!(first.first(259), Some(6 | 7)) {
        let what = "its pixels are compressed with JPEG, which does not keep the numbers of a camera";
        (what.into(), "Give the frame as the camera wrote it, uncompressed or losslessly compressed".into())
    } else if photometric == Some(CFA) {
        let what = "it holds a mosaic as TIFF/EP does, and is no DNG";
        let gray = python_copy(path, ", photometric='minisblack'");
        (what.into(), format!("{gray}, and describe that with --mosaic"))
    } else if let Some((_, name)) = PHOTOMETRICS.iter().find(|(number, _)| Some(*number) == photometric) {
        let hint = "Give the raw frame of the camera, or its linear gray or RGB numbers";
        (format!("its numbers are {name}"), hint.into())
    } else if photometric == Some(0) {
        let what = "its zero is white (PhotometricInterpretation 0): numbers fall where light rises";
        (what.into(), python_copy(path, ".__invert__(), photometric='minisblack'"))
    } else if let Some(format @ (2 | 3)) = first.first(339) {
        let kind = if format == 2 { "signed" } else { "floating-point" };
        let whole = python_copy(path, ".round().clip(0, 65535).astype('uint16')");
        (
            format!("its numbers are {kind} ones of {bits} bits"),
            format!("{whole}, of digital numbers as the camera tells them"),
        )
    } else if bits > 16 {
        let whole = python_copy(path, ".clip(0, 65535).astype('uint16')");
        (format!("its numbers have {bits} bits"), whole)
    } else if tables.chunks(of_sample.max(1)).any(is_bent) {
        return Err(tone_curve_error(path, "its TransferFunction"));
    } else if first.data(34_675).is_some_and(profile_is_curved) {
        return Err(tone_curve_error(path, "its ICC profile"));
    } else {
        return Ok(());
    };
    Err(FormatError::unsupported(path, what, hint))
}

/// Whether rows begin with the clear code from the lowest bit on, by which LibTIFF knows them, too.
fn has_old_lzw(first: &Directory<'_>, bytes: &[u8]) -> bool {
    let offset = first.first(273).or_else(|| first.first(324)).and_then(|at| usize::try_from(at).ok());
    let start = offset.and_then(|at| bytes.get(at..at.checked_add(2)?));
    start.is_some_and(|start| start[0] == 0 && start[1] & 1 == 1)
}

/// A decoder that takes no more memory than an image may.
pub(crate) fn bounded_decoder(
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
pub(crate) fn check_single_page(
    path: &Path,
    decoder: &mut Decoder<BufReader<File>>,
) -> Result<(), FormatError> {
    let stacked = stacked_images(decoder);
    let mut pages = 1;
    while decoder.more_images() && pages < MOST_PAGES {
        let before = decoder.ifd_pointer();
        // A page of a kind that is not read here is one, too, but not what lies where nothing can be read.
        let is_read = decoder.next_image().is_ok();
        if decoder.ifd_pointer() == before {
            break;
        }
        let kind = if is_read { decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType) } else { Ok(None) };
        let is_smaller = kind.ok().flatten().is_some_and(|kind| kind & 5 != 0);
        pages += usize::from(!is_smaller && (is_read || !is_exif_thumbnail(decoder)));
    }
    let pages = pages.max(stacked);
    if pages == 1 {
        return Ok(());
    }
    let what = format!("it holds {pages} images (pages), and nothing says which one is meant");
    let hint = "Save the one as a file of its own; frames of a series each as one, colors on pages of their own as one RGB image";
    Err(FormatError::unsupported(path, what, hint))
}

/// Images of a stack of ImageJ, which tells their number in its description and may have a directory for the first alone.
fn stacked_images(decoder: &mut Decoder<BufReader<File>>) -> usize {
    let text = decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
    let mut lines = text.lines().filter(|_| text.starts_with("ImageJ="));
    lines.find_map(|line| line.strip_prefix("images=")?.trim().parse().ok()).unwrap_or(1)
}

/// Whether the present directory is the thumbnail that Exif has: a JPEG without a size of its own.
fn is_exif_thumbnail(decoder: &mut Decoder<BufReader<File>>) -> bool {
    let directory = decoder.ifd_pointer().and_then(|at| decoder.read_directory(at).ok());
    let has = |tag| directory.as_ref().is_some_and(|directory| directory.contains(tag));
    has(Tag::Unknown(513)) && !has(Tag::ImageWidth)
}

/// Reads a gray or RGB image of 8 or 16 bits, packed in any way that the decoder knows.
///
/// # Errors
/// Other images, damaged files.
pub(crate) fn read_tiff_pixels(path: &Path, file: File, bytes: &[u8]) -> Result<TiffPixels, FormatError> {
    let length = bytes.len() as u64;
    guarded(path, "TIFF", || {
        check_kind(path, bytes, true)?;
        let damaged = |error| damaged_tiff(path, error);
        let mut decoder = bounded_decoder(path, BufReader::new(file), length)?;
        let (width, height) = decoder.dimensions().map_err(damaged)?;
        let color = decoder.colortype().map_err(damaged)?;
        let (samples, bits) = match color {
            tiff::ColorType::Gray(bits @ (8 | 16)) => (1, bits),
            tiff::ColorType::RGB(bits @ (8 | 16)) => (3, bits),
            _ => {
                let (of_pixel, bits) = (color.num_samples(), color.bit_depth());
                let what = format!(
                    "its pixels have {of_pixel} numbers of {bits} bits, where frames have 1 or 3 of 8 or 16"
                );
                let hint = match color {
                    tiff::ColorType::Gray(_) | tiff::ColorType::RGB(_) => python_copy(path, ""),
                    tiff::ColorType::RGBA(_) => python_copy(path, "[..., :3], photometric='rgb'"),
                    _ if of_pixel == 2 => python_copy(path, "[..., 0]"),
                    _ => "Give a gray mosaic or linear RGB".into(),
                };
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
