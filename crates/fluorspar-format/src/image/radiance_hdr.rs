//! Radiance images (.hdr): 8 bits of each color with a common exponent (Ward, Graphics Gems II, 1991).

use std::path::Path;

use super::png::{TextureImage, check_memory};
use crate::FormatError;

/// Sides of which rows may be packed.
const PACKED: std::ops::Range<usize> = 8..0x8000;

/// Reads an image whose rows run from the top and from the left. A value is `mantissa 2^(exponent - 136)`; the exposure of the header
/// is no part of it, as in pbrt.
pub(crate) fn read_hdr(path: &Path, bytes: &[u8]) -> Result<TextureImage, FormatError> {
    let damaged = |what: &str| FormatError::malformed(path, what, "Export the image again");
    if !bytes.starts_with(b"#?") {
        return Err(damaged("this is not a Radiance image"));
    }
    let mut rest = bytes;
    let mut line = || {
        let end = rest.iter().take(4096).position(|byte| *byte == b'\n')?;
        let line = std::str::from_utf8(&rest[..end]).ok()?.trim_end();
        rest = &rest[end + 1..];
        Some(line)
    };
    loop {
        match line().ok_or_else(|| damaged("the header of this Radiance image has no end"))? {
            "" => break,
            text => {
                if let Some(format) = text.strip_prefix("FORMAT=").filter(|f| *f != "32-bit_rle_rgbe") {
                    let what = format!("a Radiance image of format {}", fluorspar::quote::excerpt(format));
                    return Err(FormatError::unsupported(path, what, "Save it as 32-bit_rle_rgbe"));
                }
            }
        }
    }
    let size = line().unwrap_or_default();
    let words: Vec<&str> = size.split_ascii_whitespace().collect();
    let ["-Y", height, "+X", width] = words[..] else {
        let what = "the rows of this Radiance image do not run from the top left";
        return Err(FormatError::unsupported(path, what, "Save it upright, as -Y ROWS +X COLUMNS"));
    };
    let (Ok(width), Ok(height)) = (width.parse::<u32>(), height.parse::<u32>()) else {
        return Err(damaged("the size of this Radiance image is no number"));
    };
    // Four bytes as stored, three numbers.
    check_memory(path, width, height, 16, bytes.len() as u64)?;
    let (width, height) = (width as usize, height as usize);
    let mut data = Vec::with_capacity(3 * width * height);
    for _ in 0..height {
        let row = row(&mut rest, width).ok_or_else(|| damaged("the image ends before its last row"))?;
        for [r, g, b, exponent] in row {
            let scale = if exponent == 0 { 0.0 } else { 2.0_f32.powi(i32::from(exponent) - 136) };
            data.extend([r, g, b].map(|mantissa| f32::from(mantissa) * scale));
        }
    }
    Ok(TextureImage { width, height, channels: 3, data })
}

/// The next row: as it is, or each of the four bytes of all pixels by itself in runs.
fn row(rest: &mut &[u8], width: usize) -> Option<Vec<[u8; 4]>> {
    let is_packed = PACKED.contains(&width)
        && rest.len() >= 4
        && rest[..2] == [2, 2]
        && usize::from(u16::from_be_bytes([rest[2], rest[3]])) == width;
    if !is_packed {
        let (own, others) = rest.split_at_checked(4 * width)?;
        *rest = others;
        return Some(own.as_chunks::<4>().0.to_vec());
    }
    *rest = &rest[4..];
    let mut pixels = vec![[0; 4]; width];
    for part in 0..4 {
        let mut column = 0;
        while column < width {
            let (&start, others) = rest.split_first()?;
            let repeats = start > 128;
            let length = usize::from(if repeats { start - 128 } else { start });
            let (own, others) = others.split_at_checked(if repeats { 1 } else { length })?;
            *rest = others;
            if length == 0 {
                return None;
            }
            for (index, pixel) in pixels.get_mut(column..column + length)?.iter_mut().enumerate() {
                pixel[part] = own[if repeats { 0 } else { index }];
            }
            column += length;
        }
    }
    Some(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "#?RADIANCE\n# made by hand\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n";

    fn read(head: &str, content: &[u8]) -> Result<TextureImage, FormatError> {
        read_hdr(Path::new("a.hdr"), &[head.as_bytes(), content].concat())
    }

    #[test]
    fn plain_and_packed_rows_are_read() {
        // 128 2^(129 - 136) = 1, 64 2^(131 - 136) = 2; an exponent of 0 is black.
        let plain = read(&format!("{HEAD}-Y 1 +X 2\n"), &[128, 64, 0, 129, 9, 64, 9, 0]).unwrap();
        assert_eq!((plain.width, plain.height, plain.channels), (2, 1, 3));
        assert_eq!(plain.data, [1.0, 0.5, 0.0, 0.0, 0.0, 0.0]);
        let head = format!("{HEAD}-Y 1 +X 8\n");
        let packed = [2, 2, 0, 8, 136, 64, 3, 1, 2, 3, 133, 4, 136, 0, 136, 131];
        let image = read(&head, &packed).unwrap();
        let greens: Vec<f32> = image.data.chunks(3).map(|pixel| pixel[1] * 32.0).collect();
        assert_eq!(image.data[0], 2.0);
        assert_eq!(greens, [1.0, 2.0, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0]);
        for (packed, expected) in [(&packed[..15], "ends before"), (&[2, 2, 0, 8, 137, 1], "ends before")] {
            let said = read(&head, packed).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
    }

    #[test]
    fn what_is_no_image_is_named() {
        for (head, expected) in [
            ("P6", "not a Radiance image"),
            ("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n", "format 32-bit_rle_xyze"),
            ("#?RGBE\n", "has no end"),
            ("#?RGBE\n\n+Y 1 +X 1\n", "top left"),
            ("#?RGBE\n\n-Y x +X 1\n", "no number"),
            ("#?RGBE\n\n-Y 100000 +X 100000\n", "takes"),
        ] {
            let said = read(head, &[]).unwrap_err().to_string();
            assert!(said.contains(expected) || (expected == "takes" && said.contains("claims")), "{said}");
        }
    }
}
