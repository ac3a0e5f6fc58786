//! A measured spectrum as a sum of components.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Figure, Ink, Panel, Series, SeriesShape};

/// A measured spectrum, the sum that was fitted, and what that is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct MixturePlot {
    /// Name of the spectrum.
    pub title: String,
    /// Unit of the values.
    pub unit: String,
    /// As measured.
    pub measured: PlotCurve,
    /// As fitted.
    pub model: PlotCurve,
    /// What each component adds to the sum.
    pub parts: Vec<PlotCurve>,
    /// Measured less sum.
    pub residual: PlotCurve,
}

/// Above, the measured spectrum with the sum and its components; below, what the sum leaves.
pub fn mixture_fit(plot: &MixturePlot) -> Figure {
    let x = Axis::wavelength(wavelength_limits([&plot.measured]));
    let (label, unit) = match plot.unit.as_str() {
        "relative" => ("relative radiance", ""),
        unit => ("spectral radiance", unit),
    };
    let peaks = [&plot.measured, &plot.model].into_iter().chain(&plot.parts).map(|curve| 1.05 * curve.peak());
    let dots = SeriesShape::Dots { points: plot.measured.points(), radius: 2.2, opacity: 0.9 };
    let mut overlay = Panel::new(x.clone(), Axis::from_zero(label, unit, peaks))
        .sized(560.0, 300.0)
        .titled(plot.title.clone())
        .with(Series { name: Some(plot.measured.name.clone()), ink: Ink::Text, shape: dots })
        .with(Series::line(plot.model.name.clone(), Ink::Text, plot.model.points()));
    let inks = Ink::of_fluorophores(plot.parts.iter().map(|part| part.name.as_str()));
    for (part, ink) in plot.parts.iter().zip(inks) {
        let shape = SeriesShape::Line { points: part.points(), width: 1.4, dash: ink.fluorophore_dash() };
        overlay = overlay.with(Series { name: Some(part.name.clone()), ink, shape });
    }
    let values = plot.residual.value.iter().filter(|value| value.is_finite());
    let largest = values.fold(0.0f64, |largest, value| largest.max(value.abs()));
    let largest = if largest > 0.0 { rounded_up(largest) } else { 1.0 };
    let zero = x.limits.map(|nm| [nm, 0.0]).to_vec();
    let left = SeriesShape::Dots { points: plot.residual.points(), radius: 1.8, opacity: 0.9 };
    let residual = Panel::new(x, Axis::linear(plot.residual.name.clone(), unit, [-largest, largest]))
        .sized(560.0, 140.0)
        .with(Series::unnamed(
            Ink::Muted,
            SeriesShape::Line { points: zero, width: 1.0, dash: crate::Dash::Solid },
        ))
        .with(Series::unnamed(Ink::Text, left));
    Figure::grid(format!("Components of {}", plot.title), vec![overlay, residual], 1).explained(
        "Above: dots are what was measured, the black line is the nearest sum of components with weights that are not negative, colored \
         lines are what each adds to it; components at zero are left out. Below: what the sum leaves of the measurement.",
    )
}

/// The next of 1, 2 and 5 with zeros: its half is a tick.
fn rounded_up(value: f64) -> f64 {
    let decade = 10f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0]
        .map(|factor| factor * decade)
        .into_iter()
        .find(|round| value <= *round)
        .unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlay_and_residual_are_drawn_with_units() {
        let curve =
            |name: &str, value: [f64; 3]| PlotCurve::new(name, vec![500.0, 600.0, 700.0], value.to_vec());
        let plot = |value: [f64; 3]| MixturePlot {
            title: "tongue 1".into(),
            unit: "W/(sr m² nm)".into(),
            measured: curve("measured", value),
            model: curve("sum", value),
            parts: vec![curve("fad", value), curve("my own", value)],
            residual: curve("measured less sum", value.map(|v| 0.01 * v)),
        };
        let figure = mixture_fit(&plot([1.0, 2.0, 0.5]));
        let svg = figure.to_svg();
        for text in ["tongue 1", "W/(sr m² nm)", "my own", "measured less sum", "wavelength"] {
            assert!(svg.contains(text), "{text}");
        }
        // 2 % of 1 at most.
        assert!(
            (figure.panels[1].y.limits[1] - 0.02).abs() < 1e-12 && (rounded_up(0.021) - 0.05).abs() < 1e-12
        );
        assert_eq!(figure.panels[1].y.limits[0], -figure.panels[1].y.limits[1]);
        for odd in [[0.0; 3], [f64::NAN, -1.0, f64::INFINITY]] {
            let svg = mixture_fit(&plot(odd)).to_svg();
            assert!(!svg.contains("NaN\"") && !svg.contains("inf\""));
        }
    }
}
