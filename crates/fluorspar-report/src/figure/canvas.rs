//! Draws marks as pixels.

use fluorspar_format::opaque_rgb;
use thiserror::Error;
use tiny_skia::{
    Color, ColorU8, FillRule, LineCap, LineJoin, Mask, Paint, Path, PathBuilder, Pixmap, Rect, Stroke,
    Transform,
};

use super::drawing::{Anchor, Frame, Mark};
use super::font::{self, Segment};
use super::{Ink, Raster};

/// Why a figure could not be drawn.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("the figure could not be drawn: {0}")]
pub struct FigureError(String);

impl FigureError {
    pub(super) fn new(message: impl Into<String>) -> Self {
        Self(message.into())
    }
}

/// Longest side of a picture, pixels.
const MAX_SIDE: f64 = 32_768.0;

/// An opaque picture in the making.
pub(super) struct Canvas {
    pixels: Pixmap,
    /// Device pixels per px.
    scale: f64,
    /// Where marks may be drawn; everywhere without it.
    clip: Option<Mask>,
}

impl Canvas {
    /// A canvas of one color.
    ///
    /// # Errors
    /// A size without area, or too large.
    pub(super) fn new(width: f64, height: f64, scale: f64, ground: Ink) -> Result<Self, FigureError> {
        let [columns, rows] = [width, height].map(|side| (side * scale).ceil());
        let pixels = (columns <= MAX_SIDE && rows <= MAX_SIDE)
            .then(|| Pixmap::new(columns as u32, rows as u32))
            .flatten()
            .ok_or_else(|| FigureError::new(format!("it is {columns} by {rows} pixels")))?;
        let mut canvas = Self { pixels, scale, clip: None };
        let [r, g, b] = ground.rgb();
        canvas.pixels.fill(Color::from_rgba8(r, g, b, 255));
        Ok(canvas)
    }

    /// The finished picture.
    pub(super) fn into_raster(self) -> Raster {
        let (width, height) = (self.pixels.width() as usize, self.pixels.height() as usize);
        // The paper is opaque: premultiplied bytes are those of the colors
        Raster { width, height, pixels: opaque_rgb(self.pixels.data()) }
    }

    /// Draws a mark over what is there.
    pub(super) fn draw(&mut self, mark: &Mark) {
        match mark {
            Mark::Text { at, text, size, anchor, ink } => {
                let size = f64::from(*size);
                let before = match anchor {
                    Anchor::Start => 0.0,
                    Anchor::Middle => 0.5 * font::width(text, size),
                    Anchor::End => font::width(text, size),
                };
                self.fill(text_path(text, size, [at[0] - before, at[1]]), *ink, 1.0);
            }
            Mark::Strokes { lines, width, ink } => {
                for line in lines {
                    self.stroke(polyline(line, false), *width, *ink);
                }
            }
            Mark::Polygon { corners, opacity, ink } => self.fill(polyline(corners, true), *ink, *opacity),
            Mark::Rect { frame, opacity, ink } => self.fill(rectangle(frame), *ink, *opacity),
            Mark::Dots { points, radius, opacity, ink } => {
                for point in points {
                    self.fill(circle(*point, *radius), *ink, *opacity);
                }
            }
            Mark::Ring { at, radius, width, ink } => self.stroke(circle(*at, *radius), *width, *ink),
            Mark::Picture { frame, raster } => self.picture(frame, raster),
            Mark::Clip(frame) => {
                let mask = Mask::new(self.pixels.width(), self.pixels.height());
                self.clip = mask.zip(rectangle(frame)).map(|(mut mask, path)| {
                    mask.fill_path(&path, FillRule::Winding, true, self.transform());
                    mask
                });
            }
            Mark::Unclip => self.clip = None,
        }
    }

    fn transform(&self) -> Transform {
        Transform::from_scale(self.scale as f32, self.scale as f32)
    }

    fn fill(&mut self, path: Option<Path>, ink: Ink, opacity: f64) {
        if let Some(path) = path {
            let (rule, to_device) = (FillRule::Winding, self.transform());
            self.pixels.fill_path(&path, &paint(ink, opacity), rule, to_device, self.clip.as_ref());
        }
    }

    fn stroke(&mut self, path: Option<Path>, width: f64, ink: Ink) {
        if let Some(path) = path {
            let stroke = Stroke {
                width: width as f32,
                line_cap: LineCap::Round,
                line_join: LineJoin::Round,
                ..Stroke::default()
            };
            let to_device = self.transform();
            self.pixels.stroke_path(&path, &paint(ink, 1.0), &stroke, to_device, self.clip.as_ref());
        }
    }

    /// Fills the device pixels of a frame with the nearest pixels of a picture, so that no seams show between them.
    fn picture(&mut self, frame: &Frame, raster: &Raster) {
        let edge = |px: f64, most: u32| (px * self.scale).round().clamp(0.0, f64::from(most)) as usize;
        let (width, height) = (self.pixels.width(), self.pixels.height());
        let (left, right) = (edge(frame.left, width), edge(frame.right(), width));
        let (top, bottom) = (edge(frame.top, height), edge(frame.bottom(), height));
        let (left_px, top_px) = (frame.left * self.scale, frame.top * self.scale);
        let per_column = raster.width as f64 / (frame.width * self.scale);
        let per_row = raster.height as f64 / (frame.height * self.scale);
        for row in top..bottom {
            let source_row = ((row as f64 + 0.5 - top_px) * per_row).max(0.0) as usize;
            for column in left..right {
                let source_column = ((column as f64 + 0.5 - left_px) * per_column).max(0.0) as usize;
                let at = row * width as usize + column;
                if self.clip.as_ref().is_some_and(|mask| mask.data()[at] < 128) {
                    continue;
                }
                let [r, g, b] =
                    raster.at(source_row.min(raster.height - 1), source_column.min(raster.width - 1));
                self.pixels.pixels_mut()[at] = ColorU8::from_rgba(r, g, b, 255).premultiply();
            }
        }
    }
}

fn paint(ink: Ink, opacity: f64) -> Paint<'static> {
    let [r, g, b] = ink.rgb();
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, (255.0 * opacity.clamp(0.0, 1.0)).round() as u8);
    paint
}

fn polyline(points: &[[f64; 2]], closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (index, [x, y]) in points.iter().enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if index == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
    }
    if closed {
        path.close();
    }
    path.finish()
}

fn rectangle(frame: &Frame) -> Option<Path> {
    let [x, y, width, height] = [frame.left, frame.top, frame.width, frame.height].map(|v| v as f32);
    Rect::from_xywh(x, y, width, height).map(PathBuilder::from_rect)
}

fn circle([x, y]: [f64; 2], radius: f64) -> Option<Path> {
    PathBuilder::from_circle(x as f32, y as f32, radius as f32)
}

fn text_path(text: &str, size: f64, at: [f64; 2]) -> Option<Path> {
    let mut path = PathBuilder::new();
    for segment in font::outlines(text, size, at) {
        match segment {
            Segment::Move([x, y]) => path.move_to(x, y),
            Segment::Line([x, y]) => path.line_to(x, y),
            Segment::Quadratic([[x1, y1], [x, y]]) => path.quad_to(x1, y1, x, y),
            Segment::Cubic([[x1, y1], [x2, y2], [x, y]]) => path.cubic_to(x1, y1, x2, y2, x, y),
            Segment::Close => path.close(),
        }
    }
    path.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Axis, Figure, Panel, Series, SeriesShape};

    fn canvas(width: f64, height: f64) -> Canvas {
        Canvas::new(width, height, 2.0, Ink::Paper).unwrap()
    }

    #[test]
    fn a_picture_has_no_seams() {
        // Seven columns over 100 px: no edge of a source pixel falls on a device pixel.
        let raster = Raster::from_fn(7, 7, |_, _| [200, 40, 90]);
        let shape = SeriesShape::Picture { x: [0.0, 1.0], y: [0.0, 1.0], raster };
        let panel = Panel::new(Axis::hidden([0.0, 1.0]), Axis::hidden([0.0, 1.0]))
            .sized(100.0, 100.0)
            .with(Series::unnamed(Ink::Text, shape));
        let picture = Figure::new("", panel).to_raster().unwrap();
        let inside = picture.pixels.iter().filter(|pixel| **pixel == [200, 40, 90]).count();
        let other = picture.pixels.iter().filter(|pixel| **pixel != [255; 3]).count();
        assert_eq!((inside, other), (200 * 200, 200 * 200));
    }

    #[test]
    fn shapes_cover_their_area() {
        let covered = |mark: Mark| {
            let mut canvas = canvas(40.0, 40.0);
            canvas.draw(&mark);
            // Darkness in px²: four device pixels each.
            let ink = |p: &[u8; 3]| 1.0 - f64::from(p[0]) / 255.0;
            canvas.into_raster().pixels.iter().map(ink).sum::<f64>() / 4.0
        };
        let ink = Ink::Rgb(0, 0, 0);
        let points = vec![[20.0, 20.0]];
        let frame = Frame { left: 5.3, top: 6.1, width: 10.0, height: 4.0 };
        let circle = std::f64::consts::PI * 36.0;
        for (mark, area) in [
            (Mark::Rect { frame, opacity: 1.0, ink }, 40.0),
            (Mark::Rect { frame, opacity: 0.25, ink }, 10.0),
            (Mark::Dots { points, radius: 6.0, opacity: 1.0, ink }, circle),
            (Mark::Ring { at: [20.0, 20.0], radius: 6.0, width: 2.0, ink }, 24.0 * std::f64::consts::PI),
            // A line with its two round ends.
            (
                Mark::Strokes { lines: vec![vec![[10.0, 10.0], [30.0, 10.0]]], width: 2.0, ink },
                40.0 + std::f64::consts::PI,
            ),
            (
                Mark::Polygon { corners: vec![[10.0, 10.0], [30.0, 10.0], [10.0, 30.0]], opacity: 1.0, ink },
                200.0,
            ),
        ] {
            let drawn = covered(mark.clone());
            // Edges are drawn in 16 steps of coverage per device pixel.
            assert!((drawn - area).abs() < 0.02 * area + 0.3, "{mark:?}: {drawn}, expected {area}");
        }
    }

    #[test]
    fn nothing_is_drawn_outside_a_clip() {
        let mut canvas = canvas(20.0, 20.0);
        canvas.draw(&Mark::Clip(Frame { left: 5.0, top: 5.0, width: 10.0, height: 10.0 }));
        let everything = Frame { left: 0.0, top: 0.0, width: 20.0, height: 20.0 };
        canvas.draw(&Mark::Rect { frame: everything, opacity: 1.0, ink: Ink::Rgb(0, 0, 0) });
        canvas.draw(&Mark::Picture { frame: everything, raster: Raster::from_fn(1, 1, |_, _| [1, 2, 3]) });
        canvas.draw(&Mark::Unclip);
        let picture = canvas.into_raster();
        assert_eq!(picture.pixels.iter().filter(|p| **p == [1, 2, 3]).count(), 400);
        assert_eq!(picture.pixels.iter().filter(|p| **p == [255; 3]).count(), 1600 - 400);
        assert_eq!(
            (picture.at(10, 10), picture.at(9, 9), picture.at(29, 29)),
            ([1, 2, 3], [255; 3], [1, 2, 3])
        );
    }

    #[test]
    fn sizes_without_area_and_absurd_ones_are_refused() {
        for (width, height) in [(0.0, 10.0), (10.0, f64::NAN), (1e9, 1.0)] {
            assert!(Canvas::new(width, height, 1.0, Ink::Paper).is_err());
        }
    }
}
