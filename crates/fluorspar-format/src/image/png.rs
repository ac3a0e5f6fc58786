//! PNG images: previews out, textures in.

use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use png::{BitDepth, ColorType};

use crate::FormatError;
use crate::frame::frame_judgement::orientation_of;
use crate::frame::tiff_directory::TiffBytes;
use crate::frame::tone_curve::profile_is_curved;
use crate::store::file::{MAX_IMAGE_BYTES, check_image_size, check_packing, guarded};
use crate::store::input::open_plain;
use crate::store::output::write_atomically;
use fluorspar::image::Orientation;

/// How stored numbers relate to light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// Proportionally.
    Linear,
    /// By the sRGB curve (IEC 61966-2-1): photographs and painted colors.
    Srgb,
}

/// A texture: values between 0 and 1, proportional to light, `[row, col, channel]`, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 1 gray, 2 gray and alpha, 3 RGB, 4 RGB and alpha.
    pub channels: usize,
    /// Values.
    pub data: Vec<f32>,
}

/// Writes an 8-bit RGB image from `[row, col, channel]`, rows from the top. The numbers are stored as they are.
///
/// # Errors
/// When the data do not fill the image or the file can't be written.
pub fn write_rgb_png(path: &Path, width: usize, height: usize, rgb: &[u8]) -> Result<(), FormatError> {
    if width.checked_mul(height).and_then(|n| n.checked_mul(3)) != Some(rgb.len()) {
        return Err(FormatError::unwritable(
            path,
            format!("{} numbers do not fill {height} rows and {width} columns of R, G, B", rgb.len()),
            "Give three numbers per pixel",
        ));
    }
    write_png(path, width, height, ColorType::Rgb, BitDepth::Eight, rgb)
}

/// Writes an 8-bit gray image of labels, `[row, col]`, rows from the top: the numbers as they are.
///
/// # Errors
/// When the labels do not fill the image or the file can't be written.
pub fn write_label_png(path: &Path, width: usize, height: usize, labels: &[u8]) -> Result<(), FormatError> {
    if width.checked_mul(height) != Some(labels.len()) {
        let what = format!("{} labels do not fill {height} rows and {width} columns", labels.len());
        return Err(FormatError::unwritable(path, what, "Give one label per pixel"));
    }
    write_png(path, width, height, ColorType::Grayscale, BitDepth::Eight, labels)
}

/// Writes an 8-bit image of labels, `[row, col]`, rows from the top, that viewers show in colors: label `n` in the color `palette[n]`.
///
/// # Errors
/// When the labels do not fill the image, one of them has no color, or the file can't be written.
pub fn write_indexed_png(
    path: &Path,
    width: usize,
    height: usize,
    labels: &[u8],
    palette: &[[u8; 3]],
) -> Result<(), FormatError> {
    let most = labels.iter().copied().max().unwrap_or(0);
    if width.checked_mul(height) != Some(labels.len()) || usize::from(most) >= palette.len() {
        let what = format!(
            "{} labels up to {most} do not fill {height} rows and {width} columns with {} colors",
            labels.len(),
            palette.len()
        );
        return Err(FormatError::unwritable(path, what, "Give one label per pixel and a color for each"));
    }
    write_colored_png(
        path,
        [width, height],
        ColorType::Indexed,
        BitDepth::Eight,
        palette.as_flattened(),
        labels,
    )
}

/// Writes a 16-bit gray image of values between 0 and 1, `[row, col]`, rows from the top; others are cut.
///
/// # Errors
/// When the values do not fill the image or the file can't be written.
pub fn write_gray_png(path: &Path, width: usize, height: usize, values: &[f32]) -> Result<(), FormatError> {
    if width.checked_mul(height) != Some(values.len()) {
        let what = format!("{} values do not fill {height} rows and {width} columns", values.len());
        return Err(FormatError::unwritable(path, what, "Give one value per pixel"));
    }
    let code = |value: &f32| (value.clamp(0.0, 1.0) * f32::from(u16::MAX)).round() as u16;
    let bytes: Vec<u8> = values.iter().flat_map(|value| code(value).to_be_bytes()).collect();
    write_png(path, width, height, ColorType::Grayscale, BitDepth::Sixteen, &bytes)
}

pub(crate) fn write_png(
    path: &Path,
    width: usize,
    height: usize,
    color: ColorType,
    depth: BitDepth,
    bytes: &[u8],
) -> Result<(), FormatError> {
    write_colored_png(path, [width, height], color, depth, &[], bytes)
}

/// Writes an image with its palette, which is empty but of indexed colors.
fn write_colored_png(
    path: &Path,
    [width, height]: [usize; 2],
    color: ColorType,
    depth: BitDepth,
    palette: &[u8],
    bytes: &[u8],
) -> Result<(), FormatError> {
    check_image_size(path, width as u64, height as u64, 1, MAX_IMAGE_BYTES).map_err(|_| {
        FormatError::unwritable(
            path,
            format!("an image can't have {height} rows and {width} columns"),
            "Give 1 to 100000 rows and columns",
        )
    })?;
    write_atomically(path, |writer| {
        let mut encoder = png::Encoder::new(writer, width as u32, height as u32);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if !palette.is_empty() {
            encoder.set_palette(palette.to_vec());
        }
        // A frame of a camera takes a tenth of the time of the usual setting, and a tenth more room.
        encoder.set_compression(png::Compression::Fast);
        encoder.add_text_chunk("Software".into(), "fluorspar".into()).map_err(io::Error::from)?;
        let mut writer = encoder.write_header().map_err(io::Error::from)?;
        writer.write_image_data(bytes).map_err(io::Error::from)?;
        writer.finish().map_err(io::Error::from)
    })
}

/// Colors of opaque pixels, from bytes of red, green, blue and opacity.
#[inline]
pub fn opaque_rgb(rgba: &[u8]) -> Vec<[u8; 3]> {
    let (pixels, _) = rgba.as_chunks::<4>();
    pixels.iter().map(|&[red, green, blue, _]| [red, green, blue]).collect()
}

/// Pixels of a PNG as stored, with palettes expanded.
pub(crate) struct RawPng {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) color: ColorType,
    pub(crate) depth: BitDepth,
    pub(crate) bytes: Vec<u8>,
    /// What of the file says that its numbers are not proportional to light.
    pub(crate) tone_curve: Option<&'static str>,
    /// How the image is to be shown.
    pub(crate) orientation: Orientation,
    /// Significant bits of a sample (sBIT), where these are fewer than it has.
    pub(crate) significant_bits: Option<u8>,
    /// Whether it shows 0 as white and 255 as black by a palette, as ImageJ may.
    pub(crate) is_inverted: bool,
}

/// Bytes of memory that the pixels of any PNG may take, whatever the size of its file.
const USUAL_PNG_BYTES: u64 = 1 << 29;
/// Bytes of memory for each byte of a large file: photographs shrink to a half, masks much further.
const PNG_PACKING: u64 = 32;

/// Refuses an image whose pixels would take more memory than its file can justify, before any pixel is decoded.
/// `bytes_per_pixel` counts all that a pixel takes: as stored, and as the numbers that are made from it.
pub(crate) fn check_memory(
    path: &Path,
    width: u32,
    height: u32,
    bytes_per_pixel: u64,
    length: u64,
) -> Result<(), FormatError> {
    let (width, height) = (u64::from(width), u64::from(height));
    check_image_size(path, width, height, bytes_per_pixel, MAX_IMAGE_BYTES)?;
    let (bytes, most) =
        (width * height * bytes_per_pixel, USUAL_PNG_BYTES.max(length.saturating_mul(PNG_PACKING)));
    if bytes > most {
        let what = format!("{width} x {height} pixels take {} MiB of memory", bytes >> 20);
        return Err(FormatError::too_large(path, what, format!("{} MiB", most >> 20)));
    }
    Ok(())
}

/// Reads a PNG. `value_bytes` is what the caller makes of each sample, bytes.
pub(crate) fn read_png(path: &Path, value_bytes: u64) -> Result<RawPng, FormatError> {
    let (file, length) = open_plain(path)?;
    guarded(path, "PNG", || {
        let damaged = |error| damaged_png(path, error);
        let limits = png::Limits { bytes: MAX_IMAGE_BYTES as usize };
        let mut decoder = png::Decoder::new_with_limits(BufReader::new(file), limits);
        decoder.set_transformations(png::Transformations::EXPAND);
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        let mut reader = decoder.read_info().map_err(damaged)?;
        let (width, height) = reader.info().size();
        let (color, depth) = reader.output_color_type();
        let tone_curve = tone_curve(path, reader.info());
        let (significant_bits, is_inverted) = (significant_bits(reader.info()), is_inverted(reader.info()));
        let samples = color.samples() as u64;
        let bytes_per_pixel = samples * if depth == BitDepth::Sixteen { 2 } else { 1 };
        check_memory(path, width, height, bytes_per_pixel + samples * value_bytes, length)?;
        // What is packed are rows as they are stored: numbers of a palette, maybe eight in a byte.
        let packed = reader.info().raw_row_length() as u64 * u64::from(height);
        check_packing(path, packed, length)?;
        let size = reader.output_buffer_size().unwrap_or(0);
        let mut bytes = vec![0; size];
        let frame = reader.next_frame(&mut bytes).map_err(damaged)?;
        bytes.truncate(frame.buffer_size());
        let orientation = orientation(path);
        let (width, height) = (width as usize, height as usize);
        Ok(RawPng {
            width,
            height,
            color,
            depth,
            bytes,
            tone_curve,
            orientation,
            significant_bits,
            is_inverted,
        })
    })
}

/// Most bytes of a chunk that describes an image.
const MAX_CHUNK_BYTES: u64 = 1 << 22;

/// The content of the first chunk of a name.
fn chunk(path: &Path, name: &[u8; 4]) -> Option<Vec<u8>> {
    let (file, _) = open_plain(path).ok()?;
    let mut file = BufReader::new(file);
    file.seek(SeekFrom::Start(8)).ok()?;
    loop {
        let mut head = [0; 8];
        file.read_exact(&mut head).ok()?;
        let [a, b, c, d, kind @ ..] = head;
        let length = u32::from_be_bytes([a, b, c, d]);
        if kind == *name {
            let mut bytes = Vec::new();
            file.take(u64::from(length).min(MAX_CHUNK_BYTES)).read_to_end(&mut bytes).ok()?;
            return Some(bytes);
        }
        // The check sum follows
        file.seek_relative(i64::from(length) + 4).ok()?;
    }
}

/// Bits of a sample that count, where the file has more.
fn significant_bits(info: &png::Info<'_>) -> Option<u8> {
    let most = info.sbit.as_ref()?.iter().copied().max();
    most.filter(|bits| *bits < info.bit_depth as u8)
}

/// Whether a palette shows 0 as white and 255 as black.
fn is_inverted(info: &png::Info<'_>) -> bool {
    let falls = |(of, code): (&[u8], u8)| of.iter().all(|value| *value == u8::MAX - code);
    info.trns.is_none()
        && info
            .palette
            .as_ref()
            .is_some_and(|colors| colors.len() == 768 && colors.chunks_exact(3).zip(0..=u8::MAX).all(falls))
}

/// What says that the numbers of an image lie on a curve: code points (cICP) before all others.
fn tone_curve(path: &Path, info: &png::Info<'_>) -> Option<&'static str> {
    const LINEAR: u8 = 8;
    const UNSPECIFIED: u8 = 2;
    match info.coding_independent_code_points.map(|points| points.transfer_function) {
        Some(LINEAR) => return None,
        None | Some(UNSPECIFIED) => {}
        Some(_) => return Some("its chunk cICP"),
    }
    let is_curved = |gamma: png::ScaledFloat| (gamma.into_value() - 1.0).abs() > 0.01;
    if info.color_type == ColorType::Indexed {
        return Some("a palette of colors");
    }
    if info.srgb.is_some() {
        return Some("sRGB");
    }
    if info.gama_chunk.is_some_and(is_curved) {
        return Some("a gamma");
    }
    // A name, a zero byte, the number of the compression, and the profile
    let packed = chunk(path, b"iCCP")?;
    let start = packed.iter().position(|byte| *byte == 0)? + 2;
    let mut profile = Vec::new();
    let mut unpacked = flate2::read::ZlibDecoder::new(packed.get(start..)?).take(MAX_CHUNK_BYTES);
    // What is damaged is read as far as it goes
    let _ = unpacked.read_to_end(&mut profile);
    profile_is_curved(&profile).then_some("its ICC profile")
}

/// The orientation that an Exif directory of the file tells.
fn orientation(path: &Path) -> Orientation {
    let exif = chunk(path, b"eXIf").unwrap_or_default();
    let exif = exif.strip_prefix(b"Exif\0\0").unwrap_or(&exif);
    orientation_of(TiffBytes::new(exif).map(|tiff| tiff.directories()).unwrap_or_default().first())
}

fn damaged_png(path: &Path, error: png::DecodingError) -> FormatError {
    match error {
        png::DecodingError::IoError(source) if source.kind() != io::ErrorKind::UnexpectedEof => {
            FormatError::io(path, "read", source)
        }
        error => {
            FormatError::malformed(path, format!("not a valid PNG file: {error}"), "Export the image again")
        }
    }
}

/// Reads an 8- or 16-bit gray or RGB image, with or without alpha, as values proportional to light. Alpha is
/// never decoded: it is a fraction. Embedded color profiles are ignored: `transfer` decides.
///
/// # Errors
/// A file that is not a valid PNG, or one whose pixels take more memory than 512 MiB and 32 bytes for each of its own.
pub fn read_texture_png(path: &Path, transfer: Transfer) -> Result<TextureImage, FormatError> {
    let raw = read_png(path, size_of::<f32>() as u64)?;
    let channels = raw.color.samples();
    let mut data: Vec<f32> = match raw.depth {
        BitDepth::Sixteen => raw
            .bytes
            .chunks_exact(2)
            .map(|pair| f32::from(u16::from_be_bytes([pair[0], pair[1]])) / 65535.0)
            .collect(),
        _ => raw.bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect(),
    };
    if transfer == Transfer::Srgb {
        let has_alpha = matches!(raw.color, ColorType::GrayscaleAlpha | ColorType::Rgba);
        let colors = channels - usize::from(has_alpha);
        for pixel in data.chunks_exact_mut(channels) {
            for value in &mut pixel[..colors] {
                *value = srgb_to_linear(*value);
            }
        }
    }
    Ok(TextureImage { width: raw.width, height: raw.height, channels, data })
}

/// A texture of bytes, `[row, col, channel]`, without opacity.
pub(crate) fn texture_of_bytes(
    [width, height, channels]: [usize; 3],
    samples: &[u8],
    transfer: Transfer,
) -> TextureImage {
    let light: Vec<f32> = (0..=u8::MAX)
        .map(|byte| {
            let value = f32::from(byte) / 255.0;
            if transfer == Transfer::Srgb { srgb_to_linear(value) } else { value }
        })
        .collect();
    let data = samples.iter().map(|byte| light[usize::from(*byte)]).collect();
    TextureImage { width, height, channels, data }
}

/// sRGB decoding: `v/12.92` below 0.04045, `((v + 0.055)/1.055)^2.4` above (IEC 61966-2-1).
fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2048² pixels of one bit are 524 288 bytes, which deflate packs into a thousandth; as colors they are 24 times as many.
    #[test]
    fn a_small_file_of_a_palette_holds_a_large_image() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lines.png");
        let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 2048, 2048);
        encoder.set_color(ColorType::Indexed);
        encoder.set_depth(BitDepth::One);
        encoder.set_palette(vec![255, 0, 0, 0, 0, 255]);
        encoder.set_compression(png::Compression::High);
        let mut pixels = vec![0; 2048 * 256];
        pixels[0] = 0b0100_0000;
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() < 2048 * 2048 * 3 / 2000);
        let image = read_texture_png(&path, Transfer::Linear).unwrap();
        assert_eq!((image.width, image.height, image.channels), (2048, 2048, 3));
        assert_eq!(image.data[..9], [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
    }
}
