//! A small figure model: panels of axes and series, laid out once as marks, which `svg.rs` writes as SVG and
//! `canvas.rs` draws as pixels.

mod canvas;
mod color;
mod contact_sheet;
mod data;
mod drawing;
mod font;
mod labels;
mod layout;
mod raster;
mod scale;
mod svg;

pub use canvas::FigureError;
pub use color::{ColorMap, Ink};
pub use contact_sheet::ContactSheet;
pub use raster::Raster;
pub(crate) use raster::{png_size, rgba_png};
pub use scale::{Axis, Scale};

use canvas::Canvas;

/// Device pixels per px of a figure as PNG.
const PIXELS_PER_PX: f64 = 2.0;
/// Width of a panel on a telephone before its ticks are measured, px.
const NARROW_PANEL: f64 = 250.0;
/// What the edges take of the width of a panel's title, px.
const TITLE_ROOM: f64 = 44.0;

/// A figure: one or more panels under a title and one shared legend.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// Description in plain words, for captions and screen readers.
    pub explanation: String,
    /// Panels, row by row.
    pub panels: Vec<Panel>,
    /// Panels per row.
    pub columns: usize,
}

/// One pair of axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Title; may be empty.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Width and height of the area inside the axes, px.
    pub size: [f64; 2],
    /// Series, from back to front.
    pub series: Vec<Series>,
    /// A color bar to the right.
    pub color_bar: Option<ColorBar>,
}

/// Color scale of a heat map.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorBar {
    /// Label, unit and limits.
    pub axis: Axis,
    /// The colors.
    pub map: ColorMap,
}

/// Something drawn in a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend; none to leave it out.
    pub name: Option<String>,
    /// Color.
    pub ink: Ink,
    /// Shape of the series.
    pub shape: SeriesShape,
}

/// Shapes, in data coordinates. Points that are not finite are skipped and interrupt a line.
#[derive(Clone, Debug, PartialEq)]
pub enum SeriesShape {
    /// A line through points.
    Line {
        /// `[x, y]`.
        points: Vec<[f64; 2]>,
        /// Width, px.
        width: f64,
        /// Stroke pattern.
        dash: Dash,
    },
    /// Many small dots; above [`SeriesShape::MOST_DOTS`] an even random selection is drawn.
    Dots {
        /// `[x, y]`.
        points: Vec<[f64; 2]>,
        /// Radius, px.
        radius: f64,
        /// Opacity of one dot, 0 to 1.
        opacity: f64,
    },
    /// Few large, outlined markers.
    Markers {
        /// `[x, y]`.
        points: Vec<[f64; 2]>,
        /// Radius, px.
        radius: f64,
        /// Whether only the outline is drawn.
        hollow: bool,
    },
    /// A closed outline, filled.
    Area {
        /// Corners `[x, y]`.
        outline: Vec<[f64; 2]>,
        /// Opacity, 0 to 1.
        opacity: f64,
    },
    /// A range of x, over the full height.
    Span {
        /// From and to.
        x: [f64; 2],
        /// Opacity, 0 to 1.
        opacity: f64,
    },
    /// A picture that fills a rectangle in data coordinates.
    Picture {
        /// Left and right end.
        x: [f64; 2],
        /// Bottom and top end.
        y: [f64; 2],
        /// The pixels, first row at the top.
        raster: Raster,
    },
    /// Names beside points, placed where they cover least.
    Labels(Vec<Label>),
}

/// A text that belongs to a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// The point `[x, y]`.
    pub at: [f64; 2],
    /// The text.
    pub text: String,
}

/// Stroke patterns, to tell lines apart without color.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dash {
    /// Without gaps.
    #[default]
    Solid,
    /// Long strokes.
    Dashed,
    /// Short strokes.
    Dotted,
    /// Long and short strokes in turn.
    DashDotted,
}

impl Dash {
    /// The pattern of the `index`th of several lines.
    pub fn cycle(index: usize) -> Self {
        [Self::Solid, Self::Dashed, Self::Dotted, Self::DashDotted][index % 4]
    }

    fn lengths(self) -> &'static [f64] {
        match self {
            Self::Solid => &[],
            // Round ends add the line's width to each stroke and take it from each gap.
            Self::Dashed => &[7.0, 6.0],
            Self::Dotted => &[0.5, 5.0],
            Self::DashDotted => &[8.0, 5.5, 0.5, 5.5],
        }
    }
}

impl SeriesShape {
    /// Dots drawn at most; more of them only make a larger file.
    pub const MOST_DOTS: usize = 20_000;
}

impl Series {
    /// A solid line, 2 px wide.
    pub fn line(name: impl Into<String>, ink: Ink, points: Vec<[f64; 2]>) -> Self {
        Self::dashed(name, ink, points, Dash::Solid)
    }

    /// A line, 2 px wide.
    pub fn dashed(name: impl Into<String>, ink: Ink, points: Vec<[f64; 2]>, dash: Dash) -> Self {
        Self { name: Some(name.into()), ink, shape: SeriesShape::Line { points, width: 2.0, dash } }
    }

    /// A shape without a legend entry.
    pub fn unnamed(ink: Ink, shape: SeriesShape) -> Self {
        Self { name: None, ink, shape }
    }
}

impl Panel {
    /// An empty panel of 620 by 340 px.
    pub fn new(x: Axis, y: Axis) -> Self {
        Self { title: String::new(), x, y, size: [620.0, 340.0], series: Vec::new(), color_bar: None }
    }

    /// The panel with one more series on top.
    #[must_use]
    pub fn with(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// The panel with another size, px.
    #[must_use]
    pub fn sized(mut self, width: f64, height: f64) -> Self {
        self.size = [width, height];
        self
    }

    /// The panel with a title.
    #[must_use]
    pub fn titled(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }
}

impl Panel {
    /// Whether its height follows its width where it is made narrower: that of a picture, and of a square.
    fn keeps_shape(&self) -> bool {
        self.x.is_hidden || !self.x.names.is_empty() || self.size[0] == self.size[1]
    }
}

impl Figure {
    /// A figure of one panel.
    pub fn new(title: impl Into<String>, panel: Panel) -> Self {
        Self::grid(title, vec![panel], 1)
    }

    /// A figure of several panels.
    pub fn grid(title: impl Into<String>, panels: Vec<Panel>, columns: usize) -> Self {
        Self { title: title.into(), explanation: String::new(), panels, columns: columns.max(1) }
    }

    /// The figure with another title.
    #[must_use]
    pub fn titled(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// The figure with its explanation.
    #[must_use]
    pub fn explained(mut self, explanation: impl Into<String>) -> Self {
        self.explanation = explanation.into();
        self
    }

    /// The figure as SVG text, without external references. Whatever is drawn in the ink of a role carries a
    /// class, `ink-fill`, `grid-stroke` and so on, so that a page can restyle it for a dark background.
    pub fn to_svg(&self) -> String {
        svg::write(&layout::lay_out(self), &self.title, &self.explanation)
    }

    /// The figure as SVG text for a page that shows its title itself. A description of what is seen joins the explanation.
    pub(crate) fn to_page_svg(&self) -> String {
        let untitled = Self { title: String::new(), ..self.clone() };
        let description = format!("{} {}", self.explanation, self.seen());
        svg::write(&layout::lay_out(&untitled), &self.title, description.trim())
    }

    /// The figure as wide as a telephone: panels below each other, texts as large as before.
    pub(crate) fn narrow(&self, width: f64) -> Self {
        let mut narrow = Self { columns: 1, ..self.clone() };
        for panel in &mut narrow.panels {
            let [w, h] = panel.size;
            let scale = (NARROW_PANEL / w).min(1.0);
            let flat = if panel.keeps_shape() { scale } else { scale.max(0.7) };
            panel.size = [(w * scale).round(), (h * flat).round()];
            // Beside a narrow panel there is no room for the name of its color bar.
            if let Some(bar) = &mut panel.color_bar
                && panel.title.is_empty()
            {
                panel.title = bar.axis.title();
                (bar.axis.label, bar.axis.unit) = (String::new(), String::new());
            }
            // A long title would make the figure wide however narrow its panel is
            panel.title = layout::wrapped_title(&panel.title, width - TITLE_ROOM);
            for series in &mut panel.series {
                if let SeriesShape::Dots { points, .. } = &mut series.shape {
                    *points = points.iter().copied().step_by(3).collect();
                }
            }
        }
        // Ticks and color bars take room of their own, and other ticks fit a smaller panel
        for _ in 0..2 {
            narrow.shrink_to(width);
        }
        narrow
    }

    /// Makes the panels narrower by what the figure is too wide.
    fn shrink_to(&mut self, width: f64) {
        let untitled = Self { title: String::new(), ..self.clone() };
        let excess = (layout::lay_out(&untitled).width - width).max(0.0);
        for panel in &mut self.panels {
            let [w, h] = panel.size;
            let smaller = (w - excess).max(0.4 * w).floor();
            let flat = if panel.keeps_shape() { smaller / w } else { 1.0 };
            panel.size = [smaller, (h * flat).round()];
        }
    }

    /// The figure as a PNG file, two pixels per px.
    ///
    /// # Errors
    /// When the picture cannot be encoded, for instance because a panel has no size.
    pub fn to_png(&self) -> Result<Vec<u8>, FigureError> {
        self.to_raster()?.to_png().ok_or_else(|| FigureError::new("it has no pixels"))
    }

    /// The figure as pixels, two per px.
    fn to_raster(&self) -> Result<Raster, FigureError> {
        let drawing = layout::lay_out(self);
        let mut canvas = Canvas::new(drawing.width, drawing.height, PIXELS_PER_PX, Ink::Paper)?;
        drawing.marks.iter().for_each(|mark| canvas.draw(mark));
        Ok(canvas.into_raster())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of nine channels under a long title: on a telephone the row is as wide as the figure, and nothing is scaled down.
    #[test]
    fn a_long_title_does_not_make_a_narrow_figure_wide() {
        let channels = (0..9).map(|k| (450 + 30 * k).to_string());
        let (x, y) = (Axis::named("channel", channels), Axis::named("", ["405 nm".to_owned()]));
        let title = "405 nm + 450 nm, nine bands, long-pass 500 nm, f/2.8, equal times: dorsal tongue";
        let figure = Figure::new("Captures", Panel::new(x, y).sized(810.0, 90.0).titled(title));
        let narrow = figure.narrow(304.0);
        let drawing = layout::lay_out(&Figure { title: String::new(), ..narrow.clone() });
        assert!(drawing.width <= 305.0, "{}", drawing.width);
        assert!(narrow.panels[0].size[0] > 180.0, "{:?}", narrow.panels[0].size);
        let texts: Vec<&str> = drawing
            .marks
            .iter()
            .filter_map(|mark| match mark {
                drawing::Mark::Text { text, .. } => Some(text.as_str()),
                _ => None,
            })
            .collect();
        let is_named = |k: i32| texts.contains(&(450 + 30 * k).to_string().as_str());
        assert!((0..9).step_by(2).all(is_named), "{texts:?}");
        let lines: Vec<&str> = narrow.panels[0].title.lines().collect();
        assert!(lines.len() > 1 && lines.join(" ") == title, "{lines:?}");
    }
}
