//! Textures from images of several formats.

use std::path::Path;

use super::exr::read_texture_exr;
use super::jpeg::read_jpeg;
use super::qoi::read_qoi;
use super::radiance_hdr::read_hdr;
use super::tga::read_tga;
use crate::store::file::{MAX_IMAGE_BYTES, check_image_size};
use crate::store::input::read_bounded;
use crate::{FormatError, TextureImage, Transfer, read_texture_png};

/// Reads a gray or color image by its ending: `.png`, `.jpg`, `.tga`, `.qoi`, whose numbers relate to light as `transfer` says;
/// `.exr` (channels R, G, B or Y), `.hdr`, `.pfm`, which hold light as it is, of any amount.
///
/// # Errors
/// Other endings, damaged files, values that are not finite.
pub fn read_texture(path: &Path, transfer: Transfer) -> Result<TextureImage, FormatError> {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let image = match ending.as_deref() {
        Some("png") => read_texture_png(path, transfer)?,
        Some("exr") => read_texture_exr(path)?,
        Some("pfm") => read_pfm(path)?,
        Some("hdr") => read_hdr(path, &read_bounded(path, MAX_IMAGE_BYTES)?)?,
        Some("tga") => read_tga(path, &read_bounded(path, MAX_IMAGE_BYTES)?, transfer)?,
        Some("qoi") => read_qoi(path, &read_bounded(path, MAX_IMAGE_BYTES)?, transfer)?,
        Some("jpg" | "jpeg") => read_jpeg(path, &read_bounded(path, MAX_IMAGE_BYTES)?, transfer)?,
        _ => {
            let what = "this is not an image that is read here";
            return Err(FormatError::unsupported(
                path,
                what,
                "Save it as .png, .jpg, .tga, .qoi, .exr, .hdr or .pfm",
            ));
        }
    };
    match image.data.iter().find(|value| !value.is_finite()) {
        None => Ok(image),
        Some(value) => {
            Err(FormatError::malformed(path, format!("a pixel is {value}"), "Paint over such pixels"))
        }
    }
}

/// Portable float map: `PF` (color) or `Pf` (gray), size, scale (negative: little-endian), then rows from the bottom.
fn read_pfm(path: &Path) -> Result<TextureImage, FormatError> {
    let bytes = read_bounded(path, MAX_IMAGE_BYTES)?;
    let damaged = |what: &str| FormatError::malformed(path, what, "Export the image again");
    // Four words, then one blank.
    let mut rest = bytes.as_slice();
    let mut word = || {
        let start = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
        let length = rest[start..].iter().take(64).position(u8::is_ascii_whitespace)?;
        let word = std::str::from_utf8(&rest[start..start + length]).ok()?;
        rest = &rest[start + length + 1..];
        Some(word.to_string())
    };
    let [Some(kind), Some(width), Some(height), Some(scale)] = [word(), word(), word(), word()] else {
        return Err(damaged("this is not a PFM image"));
    };
    let channels = match kind.as_str() {
        "PF" => 3,
        "Pf" => 1,
        _ => return Err(damaged("this is not a PFM image")),
    };
    let (Ok(width), Ok(height), Ok(scale)) =
        (width.parse::<u64>(), height.parse::<u64>(), scale.parse::<f32>())
    else {
        return Err(damaged("the size or scale of this PFM image is no number"));
    };
    check_image_size(path, width, height, 4 * channels, MAX_IMAGE_BYTES)?;
    let row_bytes = (4 * width * channels) as usize;
    if rest.len() < row_bytes * height as usize {
        return Err(damaged("the image ends before its last row"));
    }
    let value = |four: &[u8]| {
        let four = [four[0], four[1], four[2], four[3]];
        scale.abs() * if scale < 0.0 { f32::from_le_bytes(four) } else { f32::from_be_bytes(four) }
    };
    let rows = rest[..row_bytes * height as usize].chunks_exact(row_bytes).rev();
    let data = rows.flat_map(|row| row.chunks_exact(4)).map(value).collect();
    Ok(TextureImage { width: width as usize, height: height as usize, channels: channels as usize, data })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float_maps_are_read_from_the_bottom_in_either_order_of_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pfm");
        for (scale, bytes) in [("-2.0", f32::to_le_bytes as fn(f32) -> [u8; 4]), ("2", f32::to_be_bytes)] {
            let mut content = format!("PF\n1 2\n{scale}\n").into_bytes();
            content.extend((0..6).flat_map(|i| bytes(i as f32)));
            std::fs::write(&path, &content).unwrap();
            let image = read_texture(&path, Transfer::Linear).unwrap();
            assert_eq!((image.width, image.height, image.channels), (1, 2, 3));
            assert_eq!(image.data, [6.0, 8.0, 10.0, 0.0, 2.0, 4.0]);
            content.pop();
            std::fs::write(&path, &content).unwrap();
            let said = read_texture(&path, Transfer::Linear).unwrap_err().to_string();
            assert!(said.contains("ends before its last row"), "{said}");
        }
        for (content, expected) in
            [("PF\n1000000 1000000\n1\n", "claims"), ("P6", "not a PFM"), ("Pf 1 1 x ", "no number")]
        {
            std::fs::write(&path, content).unwrap();
            let said = read_texture(&path, Transfer::Linear).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
    }

    #[test]
    fn the_color_of_an_openexr_image_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        ::exr::prelude::write_rgb_file(&path, 2, 1, |x, _| (x as f32, 2.5_f32, 0.25_f32)).unwrap();
        let image = read_texture(&path, Transfer::Srgb).unwrap();
        assert_eq!((image.width, image.height, image.channels), (2, 1, 3));
        assert_eq!(image.data, [0.0, 2.5, 0.25, 1.0, 2.5, 0.25]);
        assert!(read_texture(&folder.path().join("a.bmp"), Transfer::Srgb).is_err());
    }
}
