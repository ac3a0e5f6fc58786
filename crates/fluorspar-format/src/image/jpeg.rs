//! JPEG images of 8 bits.

use std::path::Path;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::png::{TextureImage, Transfer, check_memory, texture_of_bytes};
use crate::FormatError;
use crate::store::file::{check_packing, guarded};

/// Reads an image, gray ones as colors too. A profile of colors is passed over.
pub(crate) fn read_jpeg(path: &Path, bytes: &[u8], transfer: Transfer) -> Result<TextureImage, FormatError> {
    guarded(path, "JPEG", || {
        let damaged = |what: String| {
            FormatError::malformed(path, format!("not a valid JPEG file: {what}"), "Export the image again")
        };
        // The decoder fills in what a file lacks that was cut off.
        let last = |marker: [u8; 2]| bytes.windows(2).rposition(|pair| pair == marker);
        if last([0xff, 0xd9]) <= last([0xff, 0xda]) {
            return Err(damaged("it ends within its pixels".into()));
        }
        let options = DecoderOptions::default()
            .jpeg_set_out_colorspace(ColorSpace::RGB)
            .set_strict_mode(true)
            .set_max_width(usize::from(u16::MAX))
            .set_max_height(usize::from(u16::MAX));
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers().map_err(|error| damaged(format!("{error:?}")))?;
        let Some(info) = decoder.info() else { return Err(damaged("it has no size".into())) };
        let (width, height) = (info.width, info.height);
        let length = bytes.len() as u64;
        check_memory(path, width.into(), height.into(), 3 + 12, length)?;
        check_packing(path, 3 * u64::from(width) * u64::from(height), length)?;
        let samples = decoder.decode().map_err(|error| damaged(format!("{error:?}")))?;
        let size = [usize::from(width), usize::from(height), 3];
        if samples.len() != size.iter().product::<usize>() {
            return Err(damaged(format!("{} bytes are no {width} x {height} pixels", samples.len())));
        }
        Ok(texture_of_bytes(size, &samples, transfer))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight by eight pixels of one color: luma 192, blue 128, red 160, each a single coefficient of 1/2 a level above 128.
    /// By JFIF red is `192 + 1.402 * 32 = 236.9`, green `192 - 0.714 * 32 = 169.1`, blue 192.
    fn file() -> Vec<u8> {
        let mut file = vec![0xff, 0xd8, 0xff, 0xdb, 0, 67, 0];
        file.extend([16; 64]);
        file.extend([0xff, 0xc0, 0, 17, 8, 0, 8, 0, 8, 3, 1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0]);
        // Lengths of steps: 6 bits is 0, none is 10, 5 bits is 110; 0 ends a block.
        file.extend([0xff, 0xc4, 0, 22, 0, 1, 1, 1]);
        file.extend([0; 13]);
        file.extend([6, 0, 5, 0xff, 0xc4, 0, 20, 0x10, 1]);
        file.extend([0; 16]);
        file.extend([0xff, 0xda, 0, 12, 3, 1, 0, 2, 0, 3, 0, 0, 63, 0]);
        // 0 100000 0, 10 0, 110 10000 0.
        file.extend([0b0100_0000, 0b1001_1010, 0b0000_1111, 0xff, 0xd9]);
        file
    }

    #[test]
    fn colors_of_an_image_are_read() {
        let image = read_jpeg(Path::new("a.jpg"), &file(), Transfer::Linear).unwrap();
        assert_eq!((image.width, image.height, image.channels), (8, 8, 3));
        for pixel in image.data.chunks_exact(3) {
            for (value, expected) in pixel.iter().zip([236.9, 169.1, 192.0]) {
                assert!((value * 255.0 - expected).abs() < 1.5, "{pixel:?}");
            }
        }
        let dark = read_jpeg(Path::new("a.jpg"), &file(), Transfer::Srgb).unwrap();
        // ((192 / 255 + 0.055) / 1.055)^2.4
        assert!((dark.data[2] - 0.527).abs() < 0.01, "{}", dark.data[2]);
    }

    #[test]
    fn damaged_images_are_named() {
        let file = file();
        for length in 0..file.len() {
            let said = read_jpeg(Path::new("a.jpg"), &file[..length], Transfer::Linear);
            assert!(said.is_err_and(|error| error.to_string().starts_with("a.jpg: ")), "{length}");
        }
        let mut large = file.clone();
        large[76..80].copy_from_slice(&[0xff; 4]);
        let said = read_jpeg(Path::new("a.jpg"), &large, Transfer::Linear).unwrap_err().to_string();
        assert!(said.contains("claims 65535 rows and 65535 columns"), "{said}");
    }
}
