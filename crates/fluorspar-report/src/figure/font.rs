//! The letters of figures: outlines and advance widths of DejaVu Sans, which is compiled in.
//!
//! It is among the widest of the usual fonts: what fits it fits the others that a browser may take for an SVG.

use std::sync::LazyLock;

use ttf_parser::{Face, GlyphId};

static FACE: LazyLock<Option<Face<'static>>> =
    LazyLock::new(|| Face::parse(include_bytes!("../../fonts/DejaVuSans-subset.ttf"), 0).ok());

/// Advance of a letter that the font lacks, in units of the font size: that of its empty box.
const MISSING_ADVANCE: f64 = 0.6;

/// Glyph of a letter; letters that the font lacks are an empty box.
fn glyph(face: &Face<'_>, letter: char) -> GlyphId {
    face.glyph_index(letter).unwrap_or_default()
}

/// Advance of a letter in units of the font size.
fn advance(face: &Face<'_>, letter: char) -> f64 {
    face.glyph_hor_advance(glyph(face, letter))
        .map_or(MISSING_ADVANCE, |units| f64::from(units) / f64::from(face.units_per_em()))
}

/// Width of a text, px, in letters of a size in px.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let Some(face) = FACE.as_ref() else { return MISSING_ADVANCE * size * text.chars().count() as f64 };
    size * text.chars().map(|letter| advance(face, letter)).sum::<f64>()
}

/// Part of the outline of a letter, in px, y downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Segment {
    Move([f32; 2]),
    Line([f32; 2]),
    Quadratic([[f32; 2]; 2]),
    Cubic([[f32; 2]; 3]),
    Close,
}

/// Outlines of the letters of a text that begins at `left` on a baseline, px.
pub(super) fn outlines(text: &str, size: f64, [left, baseline]: [f64; 2]) -> Vec<Segment> {
    let Some(face) = FACE.as_ref() else { return Vec::new() };
    let scale = size / f64::from(face.units_per_em());
    let mut pen = Pen { scale: scale as f32, origin: [left, baseline], segments: Vec::new() };
    for letter in text.chars() {
        // Letters without ink have no outline.
        let _ = face.outline_glyph(glyph(face, letter), &mut pen);
        pen.origin[0] += size * advance(face, letter);
    }
    pen.segments
}

struct Pen {
    scale: f32,
    origin: [f64; 2],
    segments: Vec<Segment>,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> [f32; 2] {
        [self.origin[0] as f32 + self.scale * x, self.origin[1] as f32 - self.scale * y]
    }
}

impl ttf_parser::OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.segments.push(Segment::Move(self.at(x, y)));
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.segments.push(Segment::Line(self.at(x, y)));
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.segments.push(Segment::Quadratic([self.at(x1, y1), self.at(x, y)]));
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.segments.push(Segment::Cubic([self.at(x1, y1), self.at(x2, y2), self.at(x, y)]));
    }

    fn close(&mut self) {
        self.segments.push(Segment::Close);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_add_up() {
        // DejaVu Sans: digits 1303, "i" 569, "W" 2025 of 2048 units.
        assert!((width("10", 10.0) - 12.724_609_375).abs() < 1e-9);
        assert!((width("iW", 2048.0) - (569.0 + 2025.0)).abs() < 1e-9);
        assert_eq!(width("", 10.0), 0.0);
    }

    #[test]
    fn letters_of_figures_have_outlines() {
        for letter in "Wg0²⁻⁴·×−µλ°Ωéñžß≤±→…".chars() {
            assert!(FACE.as_ref().unwrap().glyph_index(letter).is_some(), "{letter}");
            assert!(!outlines(&letter.to_string(), 12.0, [0.0, 0.0]).is_empty(), "{letter}");
        }
        assert!(outlines(" ", 12.0, [0.0, 0.0]).is_empty());
        // A box, not nothing, for what the font lacks.
        assert!(!outlines("🦷", 12.0, [0.0, 0.0]).is_empty());
    }

    #[test]
    fn outlines_begin_where_they_are_told_to() {
        // The stem of an "l" is 184 units wide and begins 193 units behind the origin.
        let points: Vec<[f32; 2]> = outlines("l", 2048.0, [100.0, 3000.0])
            .into_iter()
            .filter_map(|segment| match segment {
                Segment::Move(point) | Segment::Line(point) => Some(point),
                _ => None,
            })
            .collect();
        let (left, right) = points.iter().fold((f32::MAX, 0.0f32), |(l, r), p| (l.min(p[0]), r.max(p[0])));
        let bottom = points.iter().map(|p| p[1]).fold(0.0, f32::max);
        assert_eq!((left, right, bottom), (293.0, 477.0, 3000.0));
    }
}
