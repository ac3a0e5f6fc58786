//! Masks as the annotations of COCO have them.

use serde::{Deserialize, Serialize};

/// A mask as a COCO annotation has it (Lin et al. 2014, "Microsoft COCO", arXiv:1405.0312): runs of pixels, their number, and the box
/// around them. `pycocotools` reads such runs without compression.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CocoMask {
    /// The pixels.
    pub segmentation: CocoRuns,
    /// Number of pixels inside.
    pub area: usize,
    /// First column and row that hold a pixel, then width and height of the box, pixels.
    pub bbox: [usize; 4],
}

/// Pixels by the lengths of runs along columns, from the left to the right: outside, inside, outside, ...
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CocoRuns {
    /// Rows and columns.
    pub size: [usize; 2],
    /// Lengths of the runs; the first is of pixels outside and may be 0.
    pub counts: Vec<u32>,
}

impl CocoMask {
    /// The mask of those of `width` times `height` pixels, `[row, col]`, that are inside; `None` where none is.
    ///
    /// ```
    /// use fluorspar_format::CocoMask;
    ///
    /// // The lower row of two by two pixels
    /// let mask = CocoMask::new(2, 2, |pixel| pixel >= 2).unwrap();
    /// assert_eq!(mask.segmentation.counts, [1, 1, 1, 1]);
    /// assert_eq!((mask.area, mask.bbox), (2, [0, 1, 2, 1]));
    /// ```
    pub fn new(width: usize, height: usize, is_inside: impl Fn(usize) -> bool) -> Option<Self> {
        let (mut counts, mut area) = (vec![0], 0);
        let [mut left, mut top, mut right, mut bottom] = [width, height, 0, 0];
        for (col, row) in (0..width).flat_map(|col| (0..height).map(move |row| (col, row))) {
            let inside = is_inside(row * width + col);
            // Runs with even numbers lie outside
            if inside == (counts.len() % 2 == 1) {
                counts.push(0);
            }
            if let Some(last) = counts.last_mut() {
                *last += 1;
            }
            if inside {
                area += 1;
                (left, right) = (left.min(col), right.max(col + 1));
                (top, bottom) = (top.min(row), bottom.max(row + 1));
            }
        }
        let segmentation = CocoRuns { size: [height, width], counts };
        (area > 0).then(|| Self { segmentation, area, bbox: [left, top, right - left, bottom - top] })
    }
}
