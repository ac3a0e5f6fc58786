//! Truevision TGA images, plain and run-length encoded: gray, color and palette (TGA File Format Specification 2.0, 1991).

use std::path::Path;

use super::png::{TextureImage, Transfer, check_memory, texture_of_bytes};
use crate::FormatError;
use crate::store::file::check_packing;

const HEADER: usize = 18;

struct Header {
    is_packed: bool,
    is_gray: bool,
    /// Colors of a palette, their bytes, and the number of the first one.
    palette: Option<[usize; 3]>,
    width: usize,
    height: usize,
    pixel_bytes: usize,
    from_top: bool,
    from_right: bool,
    /// Where palette and pixels begin.
    content: usize,
}

fn header(path: &Path, bytes: &[u8]) -> Result<Header, FormatError> {
    let Some(head) = bytes.get(..HEADER) else {
        return Err(damaged(path, "the file ends within its header"));
    };
    let word = |at: usize| usize::from(u16::from_le_bytes([head[at], head[at + 1]]));
    let (kind, pixel_bits) = (head[2] & 7, head[16]);
    let has_palette = head[1] == 1 && kind == 1;
    let bits = if has_palette { head[7] } else { pixel_bits };
    let fits = match kind {
        1 => has_palette && pixel_bits == 8 && matches!(bits, 15 | 16 | 24 | 32),
        2 => matches!(bits, 15 | 16 | 24 | 32),
        3 => bits == 8,
        _ => false,
    };
    if !fits || head[2] & !8 > 3 {
        let what = format!("a TGA image of type {} with {pixel_bits} bits a pixel is not read here", head[2]);
        return Err(FormatError::unsupported(
            path,
            what,
            "Save it with 8 bits of gray, or 24 or 32 of color",
        ));
    }
    Ok(Header {
        is_packed: head[2] & 8 != 0,
        is_gray: kind == 3,
        palette: (head[1] == 1).then(|| [word(5), usize::from(head[7]).div_ceil(8), word(3)]),
        width: word(12),
        height: word(14),
        pixel_bytes: usize::from(pixel_bits).div_ceil(8),
        from_top: head[17] & 0x20 != 0,
        from_right: head[17] & 0x10 != 0,
        content: HEADER + usize::from(head[0]),
    })
}

fn damaged(path: &Path, what: &str) -> FormatError {
    FormatError::malformed(path, what, "Export the image again")
}

/// Reads an image; opacity is left out.
pub(crate) fn read_tga(path: &Path, bytes: &[u8], transfer: Transfer) -> Result<TextureImage, FormatError> {
    let head = header(path, bytes)?;
    let channels = if head.is_gray { 1 } else { 3 };
    check_memory(path, head.width as u32, head.height as u32, (8 + 4 * channels) as u64, bytes.len() as u64)?;
    check_packing(path, (head.width * head.height * head.pixel_bytes) as u64, bytes.len() as u64)?;
    let short = || damaged(path, "the image ends before its last pixel");
    let [colors, color_bytes, first] = head.palette.unwrap_or_default();
    let content = bytes.get(head.content..).ok_or_else(short)?;
    let (palette, pixels) = content.split_at_checked(colors * color_bytes).ok_or_else(short)?;
    let count = head.width * head.height;
    let unpacked;
    let pixels = if head.is_packed {
        unpacked = runs(pixels, head.pixel_bytes, count).ok_or_else(short)?;
        &unpacked
    } else {
        pixels.get(..count * head.pixel_bytes).ok_or_else(short)?
    };
    let mut samples = Vec::with_capacity(count * channels);
    for row in 0..head.height {
        let row = if head.from_top { row } else { head.height - 1 - row };
        for column in 0..head.width {
            let column = if head.from_right { head.width - 1 - column } else { column };
            let at = (row * head.width + column) * head.pixel_bytes;
            let pixel = &pixels[at..at + head.pixel_bytes];
            if head.is_gray {
                samples.push(pixel[0]);
            } else if head.pixel_bytes == 1 {
                let number = usize::from(pixel[0]).checked_sub(first).filter(|number| *number < colors);
                let number = number.ok_or_else(|| damaged(path, "a pixel is beyond the palette"))?;
                samples.extend(rgb(&palette[number * color_bytes..(number + 1) * color_bytes]));
            } else {
                samples.extend(rgb(pixel));
            }
        }
    }
    Ok(texture_of_bytes([head.width, head.height, channels], &samples, transfer))
}

/// Red, green, blue of a stored color: blue first, or five bits each.
fn rgb(stored: &[u8]) -> [u8; 3] {
    match *stored {
        [low, high] => {
            let word = u16::from_le_bytes([low, high]);
            [10, 5, 0].map(|shift| {
                let five = (word >> shift) as u8 & 31;
                five << 3 | five >> 2
            })
        }
        _ => [stored[2], stored[1], stored[0]],
    }
}

/// Unpacks runs: a byte with its highest bit set repeats the pixel behind it, others count pixels as they are.
fn runs(mut packed: &[u8], pixel_bytes: usize, count: usize) -> Option<Vec<u8>> {
    let mut pixels = Vec::with_capacity(count * pixel_bytes);
    while pixels.len() < count * pixel_bytes {
        let (&start, rest) = packed.split_first()?;
        let length = usize::from(start & 127) + 1;
        let (own, rest) =
            rest.split_at_checked(if start > 127 { pixel_bytes } else { length * pixel_bytes })?;
        let repeats = if start > 127 { length } else { 1 };
        (0..repeats).for_each(|_| pixels.extend_from_slice(own));
        packed = rest;
    }
    Some(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Result<TextureImage, FormatError> {
        read_tga(Path::new("a.tga"), bytes, Transfer::Linear)
    }

    /// A header: type, palette (colors, bits), width, height, bits, descriptor.
    fn head(kind: u8, palette: [u8; 2], size: [u8; 2], bits: u8, descriptor: u8) -> Vec<u8> {
        let has_palette = u8::from(palette[0] > 0);
        let [colors, color_bits] = palette;
        let [w, h] = size;
        vec![
            2,
            has_palette,
            kind,
            0,
            0,
            colors,
            0,
            color_bits,
            0,
            0,
            0,
            0,
            w,
            0,
            h,
            0,
            bits,
            descriptor,
            b'i',
            b'd',
        ]
    }

    fn bytes_of(image: &TextureImage) -> Vec<u8> {
        image.data.iter().map(|value| (value * 255.0).round() as u8).collect()
    }

    #[test]
    fn all_kinds_are_read_from_either_corner() {
        // Blue, green, red in the file; rows from below.
        let two = [[head(2, [0; 2], [1, 2], 24, 0), vec![3, 2, 1, 6, 5, 4]].concat()];
        let image = read(&two[0]).unwrap();
        assert_eq!((image.width, image.height, image.channels), (1, 2, 3));
        assert_eq!(bytes_of(&image), [4, 5, 6, 1, 2, 3]);
        let cases: [(Vec<u8>, &[u8], &[u8]); 6] = [
            (head(2, [0; 2], [2, 1], 32, 0x28), &[3, 2, 1, 0, 6, 5, 4, 0], &[1, 2, 3, 4, 5, 6]),
            (head(2, [0; 2], [2, 1], 24, 0x30), &[3, 2, 1, 6, 5, 4], &[4, 5, 6, 1, 2, 3]),
            (head(3, [0; 2], [2, 1], 8, 0), &[7, 8], &[7, 8]),
            // Red of 31, green of 1, blue of 16, of 31 each.
            (head(2, [0; 2], [1, 1], 16, 0), &[0x30, 0x7c], &[255, 8, 132]),
            // A run of two, then one as it is.
            (head(10, [0; 2], [3, 1], 24, 0), &[0x81, 3, 2, 1, 0, 6, 5, 4], &[1, 2, 3, 1, 2, 3, 4, 5, 6]),
            (
                head(9, [2, 24], [3, 1], 8, 0),
                &[3, 2, 1, 6, 5, 4, 0x81, 1, 0, 0],
                &[4, 5, 6, 4, 5, 6, 1, 2, 3],
            ),
        ];
        for (head, content, expected) in cases {
            let file = [head.as_slice(), content].concat();
            assert_eq!(bytes_of(&read(&file).unwrap()), expected, "{file:?}");
            let said = read(&file[..file.len() - 1]).unwrap_err().to_string();
            assert!(said.contains("ends before its last pixel"), "{said}");
        }
    }

    #[test]
    fn what_is_no_image_is_named() {
        for (file, expected) in [
            (vec![0; 17], "ends within its header"),
            (head(4, [0; 2], [1, 1], 24, 0), "type 4 with 24 bits"),
            (head(2, [0; 2], [0, 1], 24, 0), "1 rows and 0 columns"),
            ([head(1, [1, 24], [1, 1], 8, 0), vec![1, 2, 3, 1]].concat(), "beyond the palette"),
        ] {
            let said = read(&file).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
    }
}
