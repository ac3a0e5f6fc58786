//! Quite OK images (.qoi; The Quite OK Image Format Specification 1.0, 2022).

use std::path::Path;

use super::png::{TextureImage, Transfer, check_memory, texture_of_bytes};
use crate::FormatError;
use crate::store::file::check_packing;

/// Reads an image; opacity is left out.
pub(crate) fn read_qoi(path: &Path, bytes: &[u8], transfer: Transfer) -> Result<TextureImage, FormatError> {
    let damaged = |what: &str| FormatError::malformed(path, what, "Export the image again");
    let Some((head, content)) = bytes.split_at_checked(14).filter(|(head, _)| head.starts_with(b"qoif"))
    else {
        return Err(damaged("this is not a QOI image"));
    };
    let [width, height] =
        [4, 8].map(|at| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]));
    let length = bytes.len() as u64;
    check_memory(path, width, height, 3 + 12, length)?;
    check_packing(path, 3 * u64::from(width) * u64::from(height), length)?;
    let samples = pixels(content, width as usize * height as usize)
        .ok_or_else(|| damaged("the image ends before its last pixel"))?;
    Ok(texture_of_bytes([width as usize, height as usize, 3], &samples, transfer))
}

/// Red, green and blue of so many pixels.
fn pixels(mut rest: &[u8], count: usize) -> Option<Vec<u8>> {
    let mut samples = Vec::with_capacity(3 * count);
    let mut seen = [[0_u8; 4]; 64];
    let mut pixel = [0, 0, 0, 255];
    while samples.len() < 3 * count {
        let (&first, others) = rest.split_first()?;
        rest = others;
        let mut repeats = 1;
        let low = first & 63;
        match (first, first >> 6) {
            (254 | 255, _) => {
                let (own, others) = rest.split_at_checked(usize::from(first) - 251)?;
                pixel[..own.len()].copy_from_slice(own);
                rest = others;
            }
            (_, 0) => pixel = seen[usize::from(low)],
            (_, 1) => {
                for (value, shift) in pixel.iter_mut().zip([4, 2, 0]) {
                    *value = value.wrapping_add(low >> shift & 3).wrapping_sub(2);
                }
            }
            (_, 2) => {
                let (&second, others) = rest.split_first()?;
                rest = others;
                let green = low.wrapping_sub(32);
                let parts = [
                    green.wrapping_add(second >> 4).wrapping_sub(8),
                    green,
                    green.wrapping_add(second & 15).wrapping_sub(8),
                ];
                pixel.iter_mut().zip(parts).for_each(|(value, part)| *value = value.wrapping_add(part));
            }
            _ => repeats = usize::from(low) + 1,
        }
        let [r, g, b, a] = pixel.map(usize::from);
        seen[(3 * r + 5 * g + 7 * b + 11 * a) % 64] = pixel;
        for _ in 0..repeats.min(count - samples.len() / 3) {
            samples.extend_from_slice(&pixel[..3]);
        }
    }
    Some(samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each kind of chunk, by hand.
    #[test]
    fn all_kinds_of_chunks_are_read() {
        let mut file = b"qoif\0\0\0\x04\0\0\0\x02\x04\0".to_vec();
        // 10 20 30; one more, the same, one less; then 12 more green, 4 more red than that, 8 less blue; a run of three.
        file.extend([254, 10, 20, 30, 0b0111_1001, 0b1010_1100, 0xc0, 0b1100_0010]);
        // 10 20 30 255 has the number (30 + 100 + 210 + 2805) mod 64 = 9; with opacity; black and clear has number 0.
        file.extend([9, 255, 1, 2, 3, 0]);
        let image = read_qoi(Path::new("a.qoi"), &file, Transfer::Linear).unwrap();
        let found: Vec<u8> = image.data.iter().map(|value| (value * 255.0).round() as u8).collect();
        let changed = [11 + 12 + 4, 20 + 12, 29 + 12 - 8];
        let expected =
            [[10, 20, 30], [11, 20, 29], changed, changed, changed, changed, [10, 20, 30], [1, 2, 3]]
                .concat();
        assert_eq!(found, expected);
        let said = read_qoi(Path::new("a.qoi"), &file[..24], Transfer::Linear).unwrap_err().to_string();
        assert!(said.contains("ends before its last pixel"), "{said}");
        assert!(read_qoi(Path::new("a.qoi"), b"qoi", Transfer::Linear).is_err());
    }
}
