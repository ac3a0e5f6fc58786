//! Lights on a logarithmic axis, with the filters in front of them and of the lens.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Series};

/// Decades shown below the peak. Reflected light is up to four decades stronger than fluorescence, so a light's tail matters down to
/// here.
pub const LIGHT_DECADES: i32 = 5;

/// Spectral power of each light relative to its peak, with filter transmittances over it. Powers are energy, not photons.
pub fn lights(lights: &[PlotCurve], filters: &[PlotCurve]) -> Figure {
    let x = Axis::wavelength(wavelength_limits(lights));
    let what =
        if filters.is_empty() { "relative spectral power" } else { "relative spectral power; transmittance" };
    let y = Axis::log10(what, "", [10f64.powi(-LIGHT_DECADES), 1.5]);
    let mut panel = Panel::new(x, y);
    for (index, light) in lights.iter().enumerate() {
        let peak = light.peak();
        let points = light.mapped(|value| if peak > 0.0 { value / peak } else { 0.0 });
        panel = panel.with(Series::line(light.name.clone(), Ink::cycle(index), points));
    }
    for (index, filter) in filters.iter().enumerate() {
        let series = Series::dashed(
            filter.name.clone(),
            Ink::cycle(lights.len() + index),
            filter.points(),
            Dash::Dashed,
        );
        panel = panel.with(series);
    }
    Figure::new("Lights", panel).explained(format!(
        "How much light each source sends out at each wavelength, relative to its own peak (solid lines), and how much the \
         filters let through (dashed lines). The vertical axis is logarithmic and spans {LIGHT_DECADES} powers of ten, because \
         fluorescence is so weak that a light's faint tail, reflected into the camera, can outshine it."
    ))
}
