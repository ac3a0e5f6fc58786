//! Drawing of SVG and PNG: marks in px from the top left corner, back to front.

use super::{Ink, Raster};

/// Where a text's anchor lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// One thing to draw. Dashes are cut into strokes before they come here, so that both show the same ones.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Mark {
    Text { at: [f64; 2], text: String, size: u32, anchor: Anchor, ink: Ink },
    Strokes { lines: Vec<Vec<[f64; 2]>>, width: f64, ink: Ink },
    Polygon { corners: Vec<[f64; 2]>, opacity: f64, ink: Ink },
    Rect { frame: Frame, opacity: f64, ink: Ink },
    Dots { points: Vec<[f64; 2]>, radius: f64, opacity: f64, ink: Ink },
    Ring { at: [f64; 2], radius: f64, width: f64, ink: Ink },
    Picture { frame: Frame, raster: Raster },
    Clip(Frame),
    Unclip,
}

/// A rectangle, px.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Frame {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Frame {
    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    pub(super) fn contains(&self, [x, y]: [f64; 2]) -> bool {
        (self.left..=self.right()).contains(&x) && (self.top..=self.bottom()).contains(&y)
    }

    /// Area that two rectangles share, px².
    pub(super) fn overlap(&self, other: &Self) -> f64 {
        let width = self.right().min(other.right()) - self.left.max(other.left);
        let height = self.bottom().min(other.bottom()) - self.top.max(other.top);
        width.max(0.0) * height.max(0.0)
    }
}

/// A finished layout.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Drawing {
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) marks: Vec<Mark>,
}

/// Cuts a line into the strokes of a dash pattern (stroke, gap, stroke, ... px); no pattern leaves it whole. All points must
/// be finite.
pub(super) fn dashed(points: &[[f64; 2]], pattern: &[f64]) -> Vec<Vec<[f64; 2]>> {
    if pattern.is_empty() || points.len() < 2 {
        return vec![points.to_vec()];
    }
    let mut strokes = Vec::new();
    let mut stroke = vec![points[0]];
    let (mut index, mut left) = (0, pattern[0]);
    for pair in points.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let at = [0, 1].map(|i| from[i] + (to[i] - from[i]) * done / length);
            if index % 2 == 0 {
                stroke.push(at);
                strokes.push(std::mem::take(&mut stroke));
            }
            stroke = vec![at];
            index = (index + 1) % pattern.len();
            left = pattern[index];
        }
        left -= length - done;
        if index % 2 == 0 {
            stroke.push(to);
        }
    }
    if index % 2 == 0 && stroke.len() > 1 {
        strokes.push(stroke);
    }
    strokes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_run_on_across_corners() {
        let corner = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]];
        let strokes = dashed(&corner, &[8.0, 4.0]);
        assert_eq!(strokes, [vec![[0.0, 0.0], [8.0, 0.0]], vec![[10.0, 2.0], [10.0, 10.0]]]);
        assert_eq!(dashed(&corner, &[]), [corner.to_vec()]);
        let bent = dashed(&corner, &[15.0, 4.0]);
        assert_eq!(bent[0], [[0.0, 0.0], [10.0, 0.0], [10.0, 5.0]]);
    }

    #[test]
    fn rectangles_overlap_in_what_they_share() {
        let frame = |left, top, width, height| Frame { left, top, width, height };
        assert_eq!(frame(0.0, 0.0, 4.0, 4.0).overlap(&frame(2.0, 3.0, 9.0, 9.0)), 2.0);
        assert_eq!(frame(0.0, 0.0, 4.0, 4.0).overlap(&frame(5.0, 0.0, 1.0, 1.0)), 0.0);
    }
}
