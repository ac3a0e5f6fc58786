//! Shapes that are drawn on a sensor image: polygons and masks.

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::RegionError;

/// A mask of the size of a sensor image: which of its pixels are meant.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelMask {
    /// Name for people, for instance that of its file.
    pub name: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Whether a pixel is meant, `[row, col]`. Not written out: results name the mask.
    #[serde(skip)]
    pub inside: Arc<[bool]>,
}

impl fmt::Display for PixelMask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the mask {}", self.name)
    }
}

impl PixelMask {
    /// Checks that the mask has the size of an image.
    ///
    /// # Errors
    /// Another size.
    pub fn check(&self, width: usize, height: usize) -> Result<(), RegionError> {
        if (self.width, self.height) == (width, height) && self.inside.len() == width * height {
            return Ok(());
        }
        Err(RegionError::MaskSize {
            name: self.name.clone(),
            mask: [self.width, self.height],
            image: [width, height],
        })
    }
}

/// A polygon on a sensor image: corners `[x, y]` in pixels, x to the right and y downward from the upper left corner of the image. The
/// center of the upper left pixel is at `[0.5, 0.5]`. Its rim may cross itself: what is enclosed an odd number of times is inside.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Polygon(pub Vec<[f64; 2]>);

impl fmt::Display for Polygon {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let extent = |axis: usize| {
            let values = || self.0.iter().map(move |corner| corner[axis]);
            [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]
        };
        let [[left, right], [top, bottom]] = [extent(0), extent(1)];
        write!(
            f,
            "a polygon of {} corners in columns {left:.0} to {right:.0}, rows {top:.0} to {bottom:.0}",
            self.0.len()
        )
    }
}

impl Polygon {
    /// Checks that the polygon has corners enough and lies in an image.
    ///
    /// # Errors
    /// Fewer than three corners, a corner that is no number or lies outside of the image.
    pub fn check(&self, width: usize, height: usize) -> Result<(), RegionError> {
        if self.0.len() < 3 {
            return Err(RegionError::FewCorners(self.0.len()));
        }
        let lies_in = |corner: &[f64; 2]| {
            (0.0..=width as f64).contains(&corner[0]) && (0.0..=height as f64).contains(&corner[1])
        };
        match self.0.iter().find(|corner| !lies_in(corner)) {
            None => Ok(()),
            Some(&corner) => Err(RegionError::CornerOutside { corner, width, height }),
        }
    }

    /// Which pixels of an image have their center inside.
    pub(super) fn fill(&self, width: usize, height: usize) -> Vec<bool> {
        let mut inside = vec![false; width * height];
        let mut crossings = Vec::new();
        for (row, pixels) in inside.chunks_exact_mut(width.max(1)).enumerate() {
            // Places where the rim crosses the centers of the row
            let y = row as f64 + 0.5;
            crossings.clear();
            for (from, to) in self.0.iter().zip(self.0.iter().cycle().skip(1)) {
                if (from[1] <= y) != (to[1] <= y) {
                    crossings.push(from[0] + (y - from[1]) / (to[1] - from[1]) * (to[0] - from[0]));
                }
            }
            crossings.sort_unstable_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let first = (pair[0] - 0.5).ceil().max(0.0) as usize;
                let end = ((pair[1] - 0.5).ceil().max(0.0) as usize).min(width);
                if let Some(run) = pixels.get_mut(first..end) {
                    run.fill(true);
                }
            }
        }
        inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(corners: &[[f64; 2]], width: usize, height: usize) -> Vec<usize> {
        let inside = Polygon(corners.to_vec()).fill(width, height);
        (0..inside.len()).filter(|&pixel| inside[pixel]).collect()
    }

    #[test]
    fn pixels_belong_to_a_polygon_by_their_centers() {
        // A rectangle on the borders of pixels holds them all, whichever way around it is drawn.
        let around = [[1.0, 1.0], [3.0, 1.0], [3.0, 3.0], [1.0, 3.0]];
        assert_eq!(filled(&around, 4, 4), [5, 6, 9, 10]);
        let back: Vec<[f64; 2]> = around.iter().rev().copied().collect();
        assert_eq!(filled(&back, 4, 4), [5, 6, 9, 10]);
        // A triangle: the centers (0.5, 0.5), (1.5, 0.5), (0.5, 1.5) lie inside, those of the diagonal x + y = 3 do not.
        assert_eq!(filled(&[[0.0, 0.0], [2.9, 0.0], [0.0, 2.9]], 3, 3), [0, 1, 3]);
        // Two loops, one within the other, leave a hole.
        let hole = [
            [0.0, 0.0],
            [5.0, 0.0],
            [5.0, 5.0],
            [0.0, 5.0],
            [0.0, 0.0],
            [2.0, 2.0],
            [3.0, 2.0],
            [3.0, 3.0],
            [2.0, 3.0],
            [2.0, 2.0],
        ];
        assert_eq!(filled(&hole, 5, 5).len(), 24);
    }

    /// Area of a disc by its pixels: the number of centers in a circle of radius R differs from pi R² by less than 8 R (Gauss).
    #[test]
    fn a_many_sided_polygon_has_the_area_of_its_disc() {
        let corners: Vec<[f64; 2]> = (0..720)
            .map(|i| f64::from(i).to_radians() / 2.0)
            .map(|a| [50.3 + 40.0 * a.cos(), 49.1 + 40.0 * a.sin()])
            .collect();
        let count = filled(&corners, 100, 100).len() as f64;
        assert!((count - std::f64::consts::PI * 1600.0).abs() < 40.0, "{count}");
    }

    #[test]
    fn polygons_and_masks_that_do_not_fit_are_refused() {
        let wrong = |corners: &[[f64; 2]]| Polygon(corners.to_vec()).check(10, 8).unwrap_err().to_string();
        assert!(wrong(&[[0.0, 0.0], [1.0, 1.0]]).contains("2 corners"));
        assert!(wrong(&[[0.0, 0.0], [11.0, 1.0], [0.0, 8.0]]).contains("[11.0, 1.0]"));
        assert!(wrong(&[[0.0, f64::NAN], [1.0, 1.0], [0.0, 8.0]]).contains("NaN"));
        let mask = PixelMask { name: "a.png".into(), width: 4, height: 2, inside: vec![true; 8].into() };
        assert!(mask.check(4, 2).is_ok());
        let said = mask.check(8, 4).unwrap_err().to_string();
        assert!(said.contains("a.png") && said.contains("4 x 2") && said.contains("8 x 4"), "{said}");
    }
}
