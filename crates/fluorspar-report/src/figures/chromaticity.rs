//! Sensor chromaticity of the pixels of a region among the predicted fluorophores.

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
    /// `(r, g)` of bulk and of porphyrin: the ends of the line on which mixtures lie.
    pub mixture_line: Option<[[f64; 2]; 2]>,
    /// Outline of an ellipse that shows how the pixels spread; empty for none.
    pub ellipse: Vec<[f64; 2]>,
}

/// The plot of the paper's Figs. 7(c) and 8: r along x, g along y, both from 0 to 1.
pub fn chromaticity(plot: &ChromaticityPlot) -> Figure {
    let axis = |label: &str| Axis::linear(label, "", [0.0, 1.0]);
    let impossible = vec![[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let mut panel = Panel::new(axis("r = R / (R + G + B)"), axis("g = G / (R + G + B)"))
        .sized(500.0, 500.0)
        .with(Series::unnamed(Ink::Muted, SeriesShape::Area { outline: impossible, opacity: 0.16 }));
    if !plot.pixels.is_empty() {
        // A few dots must show one by one, many must not become one black patch.
        let opacity = (1500.0 / plot.pixels.len() as f64).clamp(0.15, 0.6);
        let drawn = if plot.pixels.len() > SeriesShape::MOST_DOTS { ", about 20 000 shown" } else { "" };
        panel = panel.with(Series {
            name: Some(format!("pixels of {} ({}{drawn})", plot.region, plot.pixels.len())),
            ink: Ink::Text,
            shape: SeriesShape::Dots { points: plot.pixels.clone(), radius: 1.1, opacity },
        });
    }
    if let Some([bulk, porphyrin]) = plot.mixture_line {
        let line =
            Series::dashed("mixtures of bulk and porphyrin", Ink::Muted, vec![bulk, porphyrin], Dash::Dashed);
        panel = panel.with(line);
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
    let inks = Ink::of_fluorophores(plot.fluorophores.iter().map(|(name, _)| name.as_str()));
    for ((_, point), ink) in plot.fluorophores.iter().zip(inks) {
        let shape = SeriesShape::Markers { points: vec![*point], radius: 5.0, hollow: false };
        panel = panel.with(Series::unnamed(ink, shape));
    }
    let label = |(name, at): &(String, [f64; 2])| Label { at: *at, text: name.clone() };
    let labels = plot.fluorophores.iter().map(label).collect();
    panel = panel.with(Series::unnamed(Ink::Text, SeriesShape::Labels(labels)));
    Figure::new("Sensor chromaticity", panel).explained(
        "Each small dot is one pixel. Its place shows which share of its signal is red (r) and which is green (g); how bright the \
         pixel is does not matter. Colored points show where each fluorophore alone would lie. Any mixture of two lies on the \
         straight line between them, so pixels that stretch toward the porphyrin point contain more porphyrin. No pixel can \
         lie in the gray corner, where r + g would exceed 1.",
    )
}
