//! Quantum efficiency of the sensor, bare and behind the filters.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Series};

/// Quantum efficiency of each channel (dotted) and the same behind the lens and its filters (solid, of further filters dashed): by name of
/// the filters, curves in the order of the bare ones. Without bare ones the names may be those of sensors.
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
    let is_one = filtered.iter().all(|(_, channels)| channels.len() == 1);
    for (place, (filter, channels)) in filtered.iter().enumerate() {
        for (index, channel) in channels.iter().enumerate() {
            // One channel has a color for each filter; of several each keeps its own
            let (index, dash) = if is_one { (place, Dash::Solid) } else { (index, Dash::cycle(place)) };
            let name = format!("{}, {filter}", channel.name);
            let ink = Ink::of_channel(&channel.name, index);
            panel = panel.with(Series::dashed(name, ink, channel.points(), dash));
        }
    }
    Figure::new("Sensor response", panel).explained(match bare {
        [] => "How many electrons each color channel collects per photon.",
        _ => {
            "How many electrons each color channel collects per photon, without (dotted) and with (solid) the filters before the \
             lens. Only what lies under the solid curves reaches the image."
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_keep_their_colors_and_sensors_their_dashes() {
        let curve = |name: &&str| PlotCurve::new(*name, vec![400.0, 500.0], vec![0.5, 1.0]);
        let sensor = |title: &str, names: &[&str]| (title.into(), names.iter().map(curve).collect());
        let figure =
            sensor_response(&[], &[sensor("Generic", &["R", "G", "B", "NIR"]), sensor("Big", &["R"])]);
        let series = &figure.panels[0].series;
        let inks: Vec<Ink> = series.iter().map(|series| series.ink).collect();
        assert!((1..4).all(|place| !inks[..place].contains(&inks[place])) && inks[4] == inks[0], "{inks:?}");
        assert_ne!(series[4].shape, series[0].shape);
        assert!(!figure.explanation.contains("filters"), "{}", figure.explanation);
    }
}
