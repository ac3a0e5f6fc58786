//! Measured and computed shapes in one figure.

use fluorspar_report::figures::PlotCurve;
use fluorspar_report::{Axis, Dash, Figure, Ink, Panel, Series, SeriesShape};

use crate::reference::{Shape, wavelengths};

/// One panel: the measured shape, the range of people, and models.
pub(crate) struct Overlay {
    pub(crate) title: String,
    pub(crate) measured: Shape,
    /// Smallest and largest of all records; may be empty.
    pub(crate) range: Vec<[f64; 2]>,
    pub(crate) models: Vec<PlotCurve>,
    /// Interval of the first model; may be empty.
    pub(crate) band: Vec<[f64; 2]>,
}

fn band(ends: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let side = |end: usize| wavelengths().into_iter().zip(ends).map(move |(nm, ends)| [nm, ends[end]]);
    side(1).chain(side(0).collect::<Vec<_>>().into_iter().rev()).collect()
}

/// All panels, three in a row.
pub(crate) fn figure(title: &str, explanation: &str, overlays: &[Overlay]) -> Figure {
    let panels = overlays.iter().map(|overlay| {
        let top = overlay.range.iter().map(|ends| ends[1]).chain(overlay.measured.iter().copied());
        let y = Axis::from_zero("radiance over that at 520 nm", "", top.map(|value| value.min(1.6)));
        let mut panel =
            Panel::new(Axis::wavelength([500.0, 700.0]), y).sized(330.0, 230.0).titled(&overlay.title);
        for (ends, ink, name) in [
            (&overlay.range, Ink::Muted, "all records"),
            (&overlay.band, Ink::PALETTE[1], "interval of 95 %"),
        ] {
            if !ends.is_empty() {
                let shape = SeriesShape::Area { outline: band(ends), opacity: 0.22 };
                panel = panel.with(Series { name: Some(name.into()), ink, shape });
            }
        }
        let points = |values: &[f64]| wavelengths().into_iter().zip(values).map(|(nm, v)| [nm, *v]).collect();
        let shape = SeriesShape::Line { points: points(&overlay.measured), width: 2.5, dash: Dash::Solid };
        panel = panel.with(Series { name: Some("measured".into()), ink: Ink::Text, shape });
        for (i, model) in overlay.models.iter().enumerate() {
            let ink = [Ink::PALETTE[1], Ink::PALETTE[0], Ink::PALETTE[2]][i % 3];
            let dash = Dash::cycle(i + 1);
            panel = panel.with(Series::dashed(model.name.clone(), ink, points(&model.value), dash));
        }
        panel
    });
    Figure::grid(title, panels.collect(), 3).explained(explanation)
}
