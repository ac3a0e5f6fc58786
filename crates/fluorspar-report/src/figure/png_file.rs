//! Figures as PNG, rasterised by kuva with its built-in font.

use kuva::RasterBackend;
use kuva::render::color::Color;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor};
use thiserror::Error;

use super::drawing::{Anchor, Drawing, Frame, Mark};
use super::{Ink, Raster};

/// Device pixels per px.
const SCALE: f64 = 2.0;

/// Why a figure could not be drawn.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("the figure could not be drawn: {0}")]
pub struct FigureError(String);

impl FigureError {
    pub(super) fn new(message: impl Into<String>) -> Self {
        Self(message.into())
    }
}

/// Width and height that the header of a PNG file states.
pub(crate) fn png_size(file: &[u8]) -> Option<[u32; 2]> {
    let header = file.strip_prefix(b"\x89PNG\r\n\x1a\n")?.get(8..16)?;
    let word = |at: usize| header.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes);
    Some([word(0)?, word(4)?])
}

pub(super) fn write(drawing: &Drawing) -> Result<Vec<u8>, FigureError> {
    let mut scene = Scene::new(drawing.width, drawing.height);
    for mark in &drawing.marks {
        add(&mut scene.elements, mark);
    }
    RasterBackend { scale: SCALE as f32 }.render_scene(&scene).map_err(FigureError)
}

pub(super) fn color(ink: Ink) -> Color {
    let [r, g, b] = ink.rgb();
    Color::Rgb(r, g, b)
}

fn add(elements: &mut Vec<Primitive>, mark: &Mark) {
    match mark {
        Mark::Text { at, text, size, anchor, ink } => elements.push(Primitive::Text {
            x: at[0],
            y: at[1],
            content: text.clone(),
            size: *size,
            anchor: match anchor {
                Anchor::Start => TextAnchor::Start,
                Anchor::Middle => TextAnchor::Middle,
                Anchor::End => TextAnchor::End,
            },
            rotate: None,
            bold: false,
            color: Some(color(*ink)),
        }),
        Mark::Strokes { lines, width, ink } => {
            elements.extend(lines.iter().map(|line| Primitive::PolyLine {
                points: line.iter().map(|&[x, y]| (x, y)).collect(),
                stroke: color(*ink),
                stroke_width: *width,
                stroke_dasharray: None,
            }));
        }
        Mark::Polygon { corners, opacity, ink } => {
            let path: Vec<String> = corners.iter().map(|[x, y]| format!("{x:.3} {y:.3}")).collect();
            elements.push(Primitive::Path(Box::new(PathData {
                d: format!("M {} Z", path.join(" L ")),
                fill: Some(color(*ink)),
                stroke: Color::None,
                stroke_width: 0.0,
                opacity: Some(*opacity),
                stroke_dasharray: None,
            })));
        }
        Mark::Rect { frame, opacity, ink } => elements.push(Primitive::Rect {
            x: frame.left,
            y: frame.top,
            width: frame.width,
            height: frame.height,
            fill: color(*ink),
            stroke: None,
            stroke_width: None,
            opacity: Some(*opacity),
        }),
        Mark::Dots { points, radius, opacity, ink } => {
            elements.extend(points.iter().map(|&[cx, cy]| Primitive::Circle {
                cx,
                cy,
                r: *radius,
                fill: color(*ink),
                fill_opacity: Some(*opacity),
                stroke: None,
                stroke_width: None,
            }));
        }
        Mark::Ring { at, radius, width, ink } => elements.push(Primitive::Circle {
            cx: at[0],
            cy: at[1],
            r: *radius,
            fill: Color::None,
            fill_opacity: None,
            stroke: Some(color(*ink)),
            stroke_width: Some(*width),
        }),
        Mark::Picture { frame, raster } => elements.push(picture(frame, raster)),
        Mark::Clip(frame) => elements.push(Primitive::ClipStart {
            x: frame.left,
            y: frame.top,
            width: frame.width,
            height: frame.height,
            id: String::new(),
        }),
        Mark::Unclip => elements.push(Primitive::ClipEnd),
    }
}

/// A picture as rectangles that begin and end on device pixels, so that no seams show between them. Neighbours of one
/// colour in a row become one rectangle.
fn picture(frame: &Frame, raster: &Raster) -> Primitive {
    let (left, top) = ((frame.left * SCALE).round(), (frame.top * SCALE).round());
    let columns = ((frame.right() * SCALE).round() - left).max(0.0) as usize;
    let rows = ((frame.bottom() * SCALE).round() - top).max(0.0) as usize;
    let (mut x, mut y, mut w, mut h, mut fills) = (vec![], vec![], vec![], vec![], vec![]);
    let mut row = 0;
    while row < rows && columns > 0 {
        let source_row = row * raster.height / rows;
        let next_row = (row + 1..rows).find(|r| r * raster.height / rows != source_row).unwrap_or(rows);
        let mut col = 0;
        while col < columns {
            let fill = raster.at(source_row, col * raster.width / columns);
            let next_col = (col + 1..columns)
                .find(|c| raster.at(source_row, c * raster.width / columns) != fill)
                .unwrap_or(columns);
            x.push((left + col as f64) / SCALE);
            y.push((top + row as f64) / SCALE);
            w.push((next_col - col) as f64 / SCALE);
            h.push((next_row - row) as f64 / SCALE);
            fills.push(Color::Rgb(fill[0], fill[1], fill[2]));
            col = next_col;
        }
        row = next_row;
    }
    Primitive::RectBatch { x, y, w, h, fills }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Axis, Figure, Panel, Series, Shape};

    #[test]
    fn a_picture_has_no_seams() {
        // Seven columns over 100 px: no edge of a source pixel falls on a device pixel.
        let raster = Raster::from_fn(7, 7, |_, _| [200, 40, 90]);
        let shape = Shape::Picture { x: [0.0, 1.0], y: [0.0, 1.0], raster };
        let panel = Panel::new(Axis::hidden([0.0, 1.0]), Axis::hidden([0.0, 1.0]))
            .sized(100.0, 100.0)
            .with(Series::unnamed(Ink::Text, shape));
        let file = Figure::new("", panel).to_png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&file)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!(png_size(&file), Some([info.width, info.height]));
        let inside = pixels.chunks_exact(4).filter(|pixel| pixel[..3] == [200, 40, 90]).count();
        let other = pixels.chunks_exact(4).filter(|pixel| pixel[..3] != [255; 3]).count();
        assert_eq!((inside, other), (200 * 200, 200 * 200));
    }

    #[test]
    fn what_is_no_png_has_no_size() {
        assert_eq!(png_size(b"GIF89a"), None);
        assert_eq!(png_size(b"\x89PNG\r\n\x1a\n\0\0"), None);
    }
}
