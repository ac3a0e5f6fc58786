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
    for (index, light) in lights.iter().enumerate() {
        above = above.with(Series::line(light.name.clone(), Ink::cycle(index), relative(light)));
    }
    let inks = Ink::of_fluorophores(excitation.iter().map(|curve| curve.name.as_str()));
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
    for (index, filter) in filters.iter().enumerate() {
        let ink = Ink::cycle(lights.len() + efficiency.len() + index);
        for panel in [&mut above, &mut below] {
            *panel =
                panel.clone().with(Series::dashed(filter.name.clone(), ink, filter.points(), Dash::Dashed));
        }
    }
    Figure::grid("From the light to the sensor", vec![above, below], 1).explained(
        "Above: the light behind its filters and what each fluorophore takes in, both relative to their own peaks. Below: what each \
         fluorophore gives off under the first light, relative to its peak, and how many electrons the sensor frees per photon. \
         Dashed: how much the filters let through.",
    )
}
