//! Lights, filters, fluorophores and sensor over one axis of wavelengths.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Series};

/// The chain from the light to the sensor: above the lights, what fluorophores take in and the filters; below what they emit, the
/// filters and the quantum efficiency of the sensor. Lights, excitation and emission are relative to their own peaks.
pub fn chain(
    lights: &[PlotCurve],
    filters: &[PlotCurve],
    excitation: &[PlotCurve],
    emission: &[PlotCurve],
    efficiency: &[PlotCurve],
) -> Figure {
    let limits = wavelength_limits([lights, filters, excitation, emission, efficiency].into_iter().flatten());
    let panel = |what: &str| {
        Panel::new(Axis::wavelength(limits), Axis::linear(what, "", [0.0, 1.04])).sized(620.0, 240.0)
    };
    let relative = |curve: &PlotCurve| {
        let peak = curve.peak();
        curve.mapped(|value| if peak > 0.0 { value / peak } else { 0.0 })
    };
    let (mut above, mut below) = (panel("light, excitation"), panel("emission, sensor"));
    // Fluorophores and channels have colors of their own in every figure; lights and filters take others
    let inks = Ink::of_fluorophores(excitation.iter().map(|curve| curve.name.as_str()));
    let channel_inks =
        efficiency.iter().enumerate().map(|(index, channel)| Ink::of_channel(&channel.name, index));
    let taken: Vec<Ink> = inks.iter().copied().chain(channel_inks).collect();
    let free = Ink::besides(&taken, lights.len() + filters.len());
    let (light_inks, filter_inks) = free.split_at(lights.len());
    for (light, ink) in lights.iter().zip(light_inks) {
        above = above.with(Series::line(light.name.clone(), *ink, relative(light)));
    }
    for ((taken, emitted), ink) in excitation.iter().zip(emission).zip(inks) {
        above = above.with(Series::dashed(taken.name.clone(), ink, relative(taken), ink.fluorophore_dash()));
        below =
            below.with(Series::dashed(emitted.name.clone(), ink, relative(emitted), ink.fluorophore_dash()));
    }
    for (index, channel) in efficiency.iter().enumerate() {
        below = below.with(Series::line(
            channel.name.clone(),
            Ink::of_channel(&channel.name, index),
            channel.points(),
        ));
    }
    for (filter, ink) in filters.iter().zip(filter_inks) {
        for panel in [&mut above, &mut below] {
            *panel =
                panel.clone().with(Series::dashed(filter.name.clone(), *ink, filter.points(), Dash::Dashed));
        }
    }
    Figure::grid("From the light to the sensor", vec![above, below], 1).explained(
        "Above: the light behind its filters and what each fluorophore takes in, both relative to their own peaks. Below: what each \
         fluorophore gives off under the first light, relative to its peak, and how many electrons the sensor frees per photon. \
         Dashed: how much the filters let through.",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_curves_of_a_panel_have_one_color() {
        let curve = |name: &str| PlotCurve::new(name, vec![400.0, 500.0], vec![0.5, 1.0]);
        let curves = |names: &[&str]| names.iter().map(|name| curve(name)).collect::<Vec<_>>();
        let lights = curves(&["led_365", "led_385", "led_405", "led_450"]);
        let filters = curves(&["long_pass_475", "short_pass_450"]);
        let dyes = curves(&["Protoporphyrin IX", "FAD"]);
        let figure = chain(&lights, &filters, &dyes, &dyes, &curves(&["R", "G", "B"]));
        for panel in &figure.panels {
            let inks: Vec<Ink> = panel.series.iter().map(|series| series.ink).collect();
            assert!(inks.iter().enumerate().all(|(place, ink)| !inks[..place].contains(ink)), "{inks:?}");
        }
    }
}
