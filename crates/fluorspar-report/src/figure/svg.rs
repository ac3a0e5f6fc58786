//! Figures as SVG.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use fluorspar_format::WRITTEN_BY;

use super::Ink;
use super::drawing::{Anchor, Drawing, Frame, Mark};
use crate::page::escape;

/// Dots of one path do not darken each other where they overlap; this many paths are enough that it does not show.
const DOT_LAYERS: usize = 64;

pub(super) fn write(drawing: &Drawing, title: &str, explanation: &str) -> String {
    let (width, height) = (number(drawing.width), number(drawing.height));
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         role=\"img\" font-family=\"DejaVu Sans, Verdana, Helvetica, Arial, sans-serif\">\n<!-- {WRITTEN_BY} -->\n<title>{}</title>\n",
        escape(title)
    );
    if !explanation.is_empty() {
        let _ = writeln!(svg, "<desc>{}</desc>", escape(explanation));
    }
    let _ = writeln!(svg, "<rect width=\"{width}\" height=\"{height}\"{}/>", paint("fill", Ink::Paper));
    for mark in &drawing.marks {
        write_mark(&mut svg, mark);
    }
    svg.push_str("</svg>\n");
    svg
}

/// A color as attribute; roles also get a class, which a style sheet may override.
fn paint(attribute: &str, ink: Ink) -> String {
    let [r, g, b] = ink.rgb();
    let class = ink.class().map(|class| format!(" class=\"{class}-{attribute}\"")).unwrap_or_default();
    format!("{class} {attribute}=\"#{r:02x}{g:02x}{b:02x}\"")
}

/// A coordinate to a tenth of a px, as short as possible.
fn number(value: f64) -> String {
    let tenths = (value * 10.0).round() as i64;
    let (sign, tenths) = (if tenths < 0 { "-" } else { "" }, tenths.abs());
    if tenths % 10 == 0 {
        format!("{sign}{}", tenths / 10)
    } else {
        format!("{sign}{}.{}", tenths / 10, tenths % 10)
    }
}

fn opacity_attribute(attribute: &str, opacity: f64) -> String {
    if opacity >= 1.0 { String::new() } else { format!(" {attribute}=\"{opacity:.2}\"") }
}

fn path(points: &[[f64; 2]]) -> String {
    let mut path = String::with_capacity(points.len() * 12);
    for (index, point) in points.iter().enumerate() {
        path.push(if index == 0 { 'M' } else { 'L' });
        let _ = write!(path, "{} {}", number(point[0]), number(point[1]));
    }
    path
}

fn frame_attributes(frame: &Frame) -> String {
    format!(
        "x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"",
        number(frame.left),
        number(frame.top),
        number(frame.width),
        number(frame.height)
    )
}

fn write_mark(svg: &mut String, mark: &Mark) {
    let _ = match mark {
        Mark::Text { at, text, size, anchor, ink } => {
            let anchor = match anchor {
                Anchor::Start => "",
                Anchor::Middle => " text-anchor=\"middle\"",
                Anchor::End => " text-anchor=\"end\"",
            };
            let (x, y) = (number(at[0]), number(at[1]));
            let paint = paint("fill", *ink);
            writeln!(
                svg,
                "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\"{anchor}{paint}>{}</text>",
                escape(text)
            )
        }
        Mark::Strokes { lines, .. } if lines.is_empty() => Ok(()),
        Mark::Strokes { lines, width, ink } => {
            let path: String = lines.iter().map(|line| path(line)).collect();
            let paint = paint("stroke", *ink);
            writeln!(
                svg,
                "<path d=\"{path}\" fill=\"none\"{paint} stroke-width=\"{width}\" stroke-linejoin=\"round\" \
                 stroke-linecap=\"round\"/>"
            )
        }
        Mark::Polygon { corners, opacity, ink } => {
            let opacity = opacity_attribute("fill-opacity", *opacity);
            writeln!(svg, "<path d=\"{}Z\"{}{opacity}/>", path(corners), paint("fill", *ink))
        }
        Mark::Rect { frame, opacity, ink } => {
            let opacity = opacity_attribute("fill-opacity", *opacity);
            writeln!(svg, "<rect {}{}{opacity}/>", frame_attributes(frame), paint("fill", *ink))
        }
        Mark::Dots { points, radius, opacity, ink } => {
            dots(svg, points, *radius, *opacity, *ink);
            Ok(())
        }
        Mark::Ring { at, radius, width, ink } => {
            let (x, y, paint) = (number(at[0]), number(at[1]), paint("stroke", *ink));
            writeln!(
                svg,
                "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" fill=\"none\"{paint} stroke-width=\"{width}\"/>"
            )
        }
        Mark::Picture { frame, raster } => {
            let data = raster.to_png().map(|png| STANDARD.encode(png)).unwrap_or_default();
            writeln!(
                svg,
                "<image {} preserveAspectRatio=\"none\" image-rendering=\"pixelated\" \
                 href=\"data:image/png;base64,{data}\"/>",
                frame_attributes(frame)
            )
        }
        // A nested svg element clips to its frame and, unlike a clip path, needs no name: several figures share a page.
        Mark::Clip(frame) => {
            let box_of = [frame.left, frame.top, frame.width, frame.height].map(number).join(" ");
            writeln!(svg, "<svg {} viewBox=\"{box_of}\" overflow=\"hidden\">", frame_attributes(frame))
        }
        Mark::Unclip => writeln!(svg, "</svg>"),
    };
}

/// Dots as round caps of strokes without length: a fifth of the text that circles need.
fn dots(svg: &mut String, points: &[[f64; 2]], radius: f64, opacity: f64, ink: Ink) {
    let layers = if opacity >= 1.0 { 1 } else { DOT_LAYERS.min(points.len()) };
    for layer in 0..layers {
        let mut path = String::new();
        for point in points.iter().skip(layer).step_by(layers.max(1)) {
            let _ = write!(path, "M{} {}h0", number(point[0]), number(point[1]));
        }
        let _ = writeln!(
            svg,
            "<path d=\"{path}\" fill=\"none\"{} stroke-width=\"{}\" stroke-linecap=\"round\"{}/>",
            paint("stroke", ink),
            number(2.0 * radius),
            opacity_attribute("stroke-opacity", opacity)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Axis, Figure, Panel, Series};

    #[test]
    fn coordinates_are_short() {
        assert_eq!([3.0, -0.04, 12.34, -1.25].map(number), ["3", "0", "12.3", "-1.3"]);
    }

    #[test]
    fn names_are_escaped_and_axes_carry_units() {
        let panel = Panel::new(Axis::wavelength([400.0, 700.0]), Axis::from_zero("L", "W/(sr m² nm)", [1.0]))
            .with(Series::line("<b>R&D</b>", Ink::Text, vec![[400.0, 0.0], [500.0, f64::NAN], [600.0, 1.0]]));
        let svg = Figure::new("a < b", panel).to_svg();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        assert!(svg.contains("<title>a &lt; b</title>") && svg.contains("&lt;b&gt;R&amp;D&lt;/b&gt;"));
        assert!(svg.contains("wavelength (nm)") && svg.contains("L (W/(sr m² nm))"));
        assert!(!svg.contains("NaN") && !svg.contains("<b>"));
    }
}
