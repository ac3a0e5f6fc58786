//! What changes with a parameter.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Series, SeriesShape};

/// Spectra drawn of a sweep, more would not be told apart.
const MOST_SPECTRA: usize = 6;

/// A quantity over a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct SweptQuantity {
    /// Its name.
    pub label: String,
    /// Its unit; empty for a pure number.
    pub unit: String,
    /// Names, and points `[parameter, value]` by rising parameter.
    pub curves: Vec<(String, Vec<[f64; 2]>)>,
}

/// Each quantity over the parameter, two in a row; a gray line where the parameter has its typical value.
pub fn swept_quantities(title: &str, parameter: &str, typical: f64, quantities: &[SweptQuantity]) -> Figure {
    // One legend for all panels: no two lines look alike
    let mut number = 0;
    let panels = quantities.iter().map(|SweptQuantity { label, unit, curves }| {
        let points = || curves.iter().flat_map(|(_, points)| points);
        let [low, high] = points()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| [low.min(p[0]), high.max(p[0])]);
        let x = if low < high { [low, high] } else { [0.0, 1.0] };
        let y = Axis::from_zero(label.clone(), unit.clone(), points().map(|point| point[1]));
        let top = y.limits[1];
        let mut panel = Panel::new(Axis::linear(parameter, "", x), y).sized(400.0, 280.0);
        if (x[0]..=x[1]).contains(&typical) {
            let points = vec![[typical, 0.0], [typical, top]];
            let line = SeriesShape::Line { points, width: 1.0, dash: Dash::Dotted };
            panel = panel.with(Series::unnamed(Ink::Muted, line));
        }
        for (name, points) in curves {
            let (ink, dash) = (Ink::cycle(number), Dash::cycle(number));
            panel = panel.with(Series::dashed(name.clone(), ink, points.clone(), dash));
            number += 1;
        }
        panel
    });
    let panels = panels.collect();
    Figure::grid(format!("{title} by {parameter}"), panels, 2).explained(
        "Each number over the parameter; all others stay. The dotted gray line is the value that the site has. Reflectances are of diffuse \
         light without what the surface reflects at once, chromaticities those of CIE 1931.",
    )
}

/// Spectra by the value of a parameter, at most six, from the first to the last.
pub fn swept_spectra(title: &str, [quantity, unit]: [&str; 2], curves: &[PlotCurve]) -> Figure {
    let y = Axis::from_zero(quantity, unit, curves.iter().map(PlotCurve::peak));
    let mut panel = Panel::new(Axis::wavelength(wavelength_limits(curves)), y);
    let shown = curves.len().min(MOST_SPECTRA);
    for number in 0..shown {
        let curve = &curves[number * (curves.len() - 1) / (shown - 1).max(1)];
        let (ink, dash) = (Ink::cycle(number), Dash::cycle(number));
        panel = panel.with(Series::dashed(curve.name.clone(), ink, curve.points(), dash));
    }
    Figure::new(title, panel).explained("One line for each value of the parameter, as its name tells.")
}
