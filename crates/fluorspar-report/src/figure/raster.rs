//! Images inside figures.

/// Pixels, `[row, col]`, first row at the top, 8-bit red, green, blue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Raster {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue.
    pub pixels: Vec<[u8; 3]>,
}

impl Raster {
    /// An image from a function of row and column.
    pub fn from_fn(width: usize, height: usize, mut color: impl FnMut(usize, usize) -> [u8; 3]) -> Self {
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            for col in 0..width {
                pixels.push(color(row, col));
            }
        }
        Self { width, height, pixels }
    }

    /// An image from interleaved bytes; `None` when they do not fill it.
    pub fn from_rgb8(width: usize, height: usize, bytes: &[u8]) -> Option<Self> {
        (bytes.len() == width * height * 3 && width > 0 && height > 0).then(|| {
            let pixels = bytes.chunks_exact(3).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
            Self { width, height, pixels }
        })
    }

    /// The color at a pixel.
    pub fn at(&self, row: usize, col: usize) -> [u8; 3] {
        self.pixels[row * self.width + col]
    }

    /// The image as a PNG file; `None` when it has no pixels.
    pub fn to_png(&self) -> Option<Vec<u8>> {
        let mut file = Vec::new();
        let mut encoder =
            png::Encoder::new(&mut file, u32::try_from(self.width).ok()?, u32::try_from(self.height).ok()?);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Balanced);
        // As small as the best of all filters for every line, without trying them
        encoder.set_filter(png::Filter::Up);
        // Colors for a screen are no measurement: readers of frames know by it
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.add_text_chunk("Software".into(), "fluorspar".into()).ok()?;
        let mut writer = encoder.write_header().ok()?;
        writer.write_image_data(self.pixels.as_flattened()).ok()?;
        writer.finish().ok()?;
        Some(file)
    }
}

/// Pixels with opacity, `[row, col]`, as a PNG file; `None` when they do not fill the image.
pub(crate) fn rgba_png(width: usize, height: usize, pixels: &[[u8; 4]]) -> Option<Vec<u8>> {
    if pixels.len() != width * height || pixels.is_empty() {
        return None;
    }
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, u32::try_from(width).ok()?, u32::try_from(height).ok()?);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(pixels.as_flattened()).ok()?;
    writer.finish().ok()?;
    Some(file)
}

/// Width and height that the header of a PNG file states.
pub(crate) fn png_size(file: &[u8]) -> Option<[u32; 2]> {
    let header = file.strip_prefix(b"\x89PNG\r\n\x1a\n")?.get(8..16)?;
    let word = |at: usize| header.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes);
    Some([word(0)?, word(4)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_becomes_a_png_of_its_size() {
        let raster = Raster::from_fn(3, 2, |row, col| [row as u8, col as u8, 7]);
        assert_eq!(raster.at(1, 2), [1, 2, 7]);
        assert_eq!(png_size(&raster.to_png().unwrap()), Some([3, 2]));
        assert_eq!(Raster::from_rgb8(1, 1, &[1, 2, 3]).unwrap().at(0, 0), [1, 2, 3]);
        assert_eq!(Raster::from_rgb8(2, 1, &[1, 2, 3]), None);
    }

    #[test]
    fn what_is_no_png_has_no_size() {
        assert_eq!(png_size(b"GIF89a"), None);
        assert_eq!(png_size(b"\x89PNG\r\n\x1a\n\0\0"), None);
    }
}
