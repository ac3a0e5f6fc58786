//! Sensor chromaticity of the pixels of a region among the predicted fluorophores.

use fluorspar::analysis::Analyte;

use crate::{Axis, Dash, Figure, Ink, Label, Panel, Series, SeriesShape};

/// Contents of a chromaticity plot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChromaticityPlot {
    /// The region in words.
    pub region: String,
    /// `(r, g)` of its pixels.
    pub pixels: Vec<[f64; 2]>,
    /// Name and predicted `(r, g)` of each fluorophore.
    pub fluorophores: Vec<(String, [f64; 2])>,
    /// The fluorophore at the end of the line.
    pub target: Analyte,
    /// `(r, g)` of bulk and of the target: the ends of the line on which mixtures lie.
    pub mixture_line: Option<[[f64; 2]; 2]>,
    /// Outline of an ellipse that shows how the pixels spread; empty for none.
    pub ellipse: Vec<[f64; 2]>,
    /// `(r, g)` of people drawn from the family that the estimate assumes, without the target; empty for none.
    pub people: Vec<[f64; 2]>,
    /// Whether some of these hold pigment of plants, which is as red.
    pub people_hold_pigment: bool,
}

impl ChromaticityPlot {
    /// Who the people are.
    fn people(&self) -> String {
        let pigment = if self.people_hold_pigment { ", some with plant pigment" } else { "" };
        format!("people without {}{pigment}", self.target)
    }
}

/// Pixels drawn in the whole plane, where they lie one over another.
const DOTS_OF_PLANE: usize = 1250;
/// Pixels drawn in the enlarged part.
const DOTS_OF_PART: usize = 4000;

/// The plot of the paper's Figs. 7(c) and 8, r along x and g along y: the whole plane, and the part where the pixels lie.
pub fn chromaticity(plot: &ChromaticityPlot) -> Figure {
    let mut panels = vec![panel(plot, [[0.0, 1.0]; 2], DOTS_OF_PLANE, true).titled("all chromaticities")];
    if let Some(limits) = part(plot) {
        panels.push(panel(plot, limits, DOTS_OF_PART, false).titled("where the pixels lie"));
    }
    let target = &plot.target;
    let fluorophores = match (plot.mixture_line, plot.fluorophores.is_empty()) {
        (Some(_), _) => format!(
            "Colored points show where each fluorophore alone would lie. Any mixture of two lies on the straight line between them, so \
             pixels that stretch toward the {target} point contain more {target}. "
        ),
        (None, false) => "Colored points show where each fluorophore alone would lie. ".into(),
        (None, true) => String::new(),
    };
    let people = match plot.people.is_empty() {
        true => String::new(),
        false => format!(
            "Larger dots are {}, drawn from the family of tissues that the estimate assumes, under this light and by this camera: what lies \
             among them needs no {target}. ",
            plot.people()
        ),
    };
    Figure::grid("Sensor chromaticity", panels, 2).explained(format!(
        "Each small dot is one pixel, of many an even selection. Its place shows which share of its signal is red (r) and which is \
         green (g); how bright the pixel is does not matter. {fluorophores}{people}Light cannot bring a pixel into the gray corner, where r + g would \
         exceed 1; noise can. The second plot enlarges the part where the pixels lie.",
    ))
}

/// Limits of r and g that hold nearly all pixels, and most people, square; `None` where there are too few, or they fill the plane.
fn part(plot: &ChromaticityPlot) -> Option<[[f64; 2]; 2]> {
    let ends = [0, 1].map(|axis| {
        let ends = |points: &[[f64; 2]], beyond: f64| {
            let mut values: Vec<f64> = points.iter().map(|p| p[axis]).filter(|v| v.is_finite()).collect();
            values.sort_by(f64::total_cmp);
            let at = |share: f64| values.get((share * values.len() as f64) as usize).copied();
            at(beyond).zip(at(1.0 - beyond))
        };
        let (low, high) = ends(&plot.pixels, 0.005)?;
        let (of_people, to_people) = ends(&plot.people, 0.025).unwrap_or((low, high));
        Some((low.min(of_people), high.max(to_people)))
    });
    let [(r0, r1), (g0, g1)] = [ends[0]?, ends[1]?];
    let side = 1.3 * (r1 - r0).max(g1 - g0).max(0.02);
    let around = |low: f64, high: f64| {
        let start = (0.5 * (low + high - side)).clamp(0.0, 1.0 - side.min(1.0));
        [start, start + side].map(|v| (v * 100.0).round() / 100.0)
    };
    (side < 0.7 && plot.pixels.len() > 20).then(|| [around(r0, r1), around(g0, g1)])
}

fn panel(plot: &ChromaticityPlot, [x, y]: [[f64; 2]; 2], most: usize, is_whole: bool) -> Panel {
    let impossible = vec![[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let mut panel =
        Panel::new(Axis::linear("r = R / (R + G + B)", "", x), Axis::linear("g = G / (R + G + B)", "", y))
            .sized(380.0, 380.0)
            .with(Series::unnamed(Ink::Muted, SeriesShape::Area { outline: impossible, opacity: 0.16 }));
    if !plot.pixels.is_empty() {
        let step = plot.pixels.len().div_ceil(most).max(1);
        let points: Vec<[f64; 2]> = plot.pixels.iter().copied().step_by(step).collect();
        // A few dots must show one by one, many must not become one black patch.
        let opacity = (1500.0 / points.len() as f64).clamp(0.15, 0.6);
        panel = panel.with(Series {
            name: Some(format!("pixels of {}", plot.region)),
            ink: Ink::Text,
            shape: SeriesShape::Dots { points, radius: 1.1, opacity },
        });
    }
    let target = &plot.target;
    let inks = Ink::of_fluorophores(plot.fluorophores.iter().map(|(name, _)| name.as_str()));
    if !plot.people.is_empty() {
        // Besides the colors of ellipse and pixels
        let ink = Ink::besides(&inks, 3)[2];
        let points = plot.people.clone();
        let shape = SeriesShape::Dots { points, radius: 2.2, opacity: 0.75 };
        panel = panel.with(Series { name: Some(format!("people without {target}")), ink, shape });
    }
    if let Some([bulk, end]) = plot.mixture_line {
        let name = format!("mixtures of bulk and {target}");
        panel = panel.with(Series::dashed(name, Ink::Muted, vec![bulk, end], Dash::Dashed));
    }
    if plot.ellipse.len() > 2 {
        let points = plot.ellipse.iter().chain(plot.ellipse.first()).copied().collect();
        panel = panel.with(Series {
            name: Some("spread of the pixels".into()),
            ink: Ink::PALETTE[3],
            shape: SeriesShape::Line { points, width: 1.5, dash: Dash::Solid },
        });
    }
    if let Some([bulk, _]) = plot.mixture_line {
        let shape = SeriesShape::Markers { points: vec![bulk], radius: 6.0, hollow: true };
        panel = panel.with(Series { name: Some("bulk, weighted sum".into()), ink: Ink::Muted, shape });
    }
    let inside = |point: &[f64; 2]| (x[0]..=x[1]).contains(&point[0]) && (y[0]..=y[1]).contains(&point[1]);
    for ((_, point), ink) in plot.fluorophores.iter().zip(inks) {
        let shape = SeriesShape::Markers { points: vec![*point], radius: 5.0, hollow: false };
        panel = panel.with(Series::unnamed(ink, shape));
    }
    let label = |(name, at): &(String, [f64; 2])| Label { at: *at, text: name.clone() };
    let shown = plot.fluorophores.iter().filter(|(_, point)| is_whole || inside(point));
    panel.with(Series::unnamed(Ink::Text, SeriesShape::Labels(shown.map(label).collect())))
}
