//! Quantum efficiency of the sensor, bare and behind the filters.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Series};

/// Quantum efficiency of each channel (dotted) and the same behind the lens and its filters (solid, of further filters dashed): by name of
/// the filters, curves in the order of the bare ones.
pub fn sensor_response(bare: &[PlotCurve], filtered: &[(String, Vec<PlotCurve>)]) -> Figure {
    let all = || bare.iter().chain(filtered.iter().flat_map(|(_, curves)| curves));
    let x = Axis::wavelength(wavelength_limits(all()));
    let peaks = all().map(PlotCurve::peak);
    let y = Axis::from_zero("quantum efficiency", "electrons per photon", peaks);
    let mut panel = Panel::new(x, y);
    for (index, channel) in bare.iter().enumerate() {
        let (name, ink) = (format!("{}, bare", channel.name), Ink::of_channel(&channel.name, index));
        panel = panel.with(Series::dashed(name, ink, channel.points(), Dash::Dotted));
    }
    for (place, (filter, channels)) in filtered.iter().enumerate() {
        for (index, channel) in channels.iter().enumerate() {
            // One channel has a color for each filter; of several each keeps its own
            let (index, dash) =
                if channels.len() == 1 { (place, Dash::Solid) } else { (index, Dash::cycle(place)) };
            let name = format!("{}, {filter}", channel.name);
            let ink = Ink::of_channel(&channel.name, index);
            panel = panel.with(Series::dashed(name, ink, channel.points(), dash));
        }
    }
    Figure::new("Sensor response", panel).explained(
        "How many electrons each color channel collects per photon, without (dotted) and with (solid) the filters before the \
         lens. Only what lies under the solid curves reaches the image.",
    )
}
