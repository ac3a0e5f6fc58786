//! Quantum efficiency of the sensor, bare and behind the filters.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Series};

/// Quantum efficiency of each channel (dashed) and the same behind the lens and its filters (solid). Curves of both lists pair up
/// by place.
pub fn sensor_response(bare: &[PlotCurve], filtered: &[PlotCurve]) -> Figure {
    let x = Axis::wavelength(wavelength_limits(bare.iter().chain(filtered)));
    let peaks = bare.iter().chain(filtered).map(PlotCurve::peak);
    let y = Axis::from_zero("quantum efficiency", "electrons per photon", peaks);
    let mut panel = Panel::new(x, y);
    for (index, channel) in bare.iter().enumerate() {
        let (name, ink) = (format!("{}, bare", channel.name), Ink::of_channel(&channel.name, index));
        panel = panel.with(Series::dashed(name, ink, channel.points(), Dash::Dotted));
    }
    for (index, channel) in filtered.iter().enumerate() {
        let (name, ink) = (format!("{}, filtered", channel.name), Ink::of_channel(&channel.name, index));
        panel = panel.with(Series::line(name, ink, channel.points()));
    }
    Figure::new("Sensor response", panel).explained(
        "How many electrons each color channel collects per photon, without (dotted) and with (solid) the filters before the \
         lens. Only what lies under the solid curves reaches the image.",
    )
}
