//! Pictures of frames with the outlines of regions.

use fluorspar::analysis::PixelSelection;
use fluorspar::pipeline::Preview;

use crate::Raster;

/// Colors of outlines, by number of the region.
const COLORS: [[u8; 3]; 4] = [[255, 214, 0], [0, 190, 255], [255, 90, 160], [120, 230, 90]];
/// What people call them.
pub const OUTLINE_COLORS: [&str; 4] = ["yellow", "blue", "pink", "green"];

/// A picture of a frame, at most so many columns wide, with the outlines of regions, as PNG. `None` without pixels.
#[must_use]
pub fn outlined_preview(preview: &Preview, regions: &[&PixelSelection], columns: usize) -> Option<Vec<u8>> {
    let width = columns.min(preview.width).max(1);
    let scale = preview.width as f64 / width as f64;
    let height = ((preview.height as f64 / scale).round() as usize).max(1);
    let mut small = preview.fitted([width, height]);
    // Noise of the last bits would be most of the file
    small.rgb.iter_mut().for_each(|value| *value = (*value / 3 * 3).saturating_add(1));
    let mut raster = Raster::from_rgb8(small.width, small.height, &small.rgb)?;
    for (region, color) in regions.iter().zip(COLORS.iter().cycle()) {
        let mut inside = vec![false; width * height];
        for pixel in &region.pixels {
            let at = |value: usize, most: usize| ((value as f64 / scale) as usize).min(most - 1);
            inside[at(pixel / region.width, height) * width + at(pixel % region.width, width)] = true;
        }
        let is_edge = |at: usize| {
            let (row, col) = (at / width, at % width);
            let neighbors = [
                (col > 0).then(|| at - 1),
                (col + 1 < width).then(|| at + 1),
                (row > 0).then(|| at - width),
                (row + 1 < height).then(|| at + width),
            ];
            inside[at] && neighbors.iter().any(|near| near.is_none_or(|near| !inside[near]))
        };
        (0..inside.len()).filter(|at| is_edge(*at)).for_each(|at| raster.pixels[at] = *color);
    }
    raster.to_png()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_are_drawn_and_what_they_enclose_is_not() {
        let preview = Preview { width: 20, height: 10, rgb: vec![60; 600] };
        let pixels =
            (0..200).filter(|pixel| (2..8).contains(&(pixel / 20)) && (4..16).contains(&(pixel % 20)));
        let region = PixelSelection { width: 20, height: 10, pixels: pixels.collect() };
        let png = outlined_preview(&preview, &[&region], 10).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut rgb).unwrap();
        assert_eq!((reader.info().width, reader.info().height), (10, 5));
        let at = |row: usize, col: usize| &rgb[3 * (10 * row + col)..][..3];
        assert_eq!(
            (at(1, 2), at(2, 4), at(0, 0)),
            (&[255, 214, 0][..], &[61, 61, 61][..], &[61, 61, 61][..])
        );
    }
}
