//! Filter transmittance, and its optical density where a plot of transmittance shows nothing.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Series};

/// Least optical density at the top of the axis, so that weak filters do not look like strong ones.
const LEAST_DENSITY: f64 = 4.0;

/// Transmittance and, beside or below it, optical density, `-log10 T`, of each filter.
pub fn filters(filters: &[PlotCurve]) -> Figure {
    let limits = wavelength_limits(filters);
    // A transmittance of exactly zero has no density; the line leaves through the top instead.
    let density = |transmittance: f64| -transmittance.max(1e-30).log10();
    let floors = filters.iter().flat_map(|filter| &filter.value).filter(|value| **value > 0.0);
    let highest = floors.map(|&value| density(value)).fold(LEAST_DENSITY, f64::max).min(8.0).ceil() + 0.2;
    let mut linear = Panel::new(Axis::wavelength(limits), Axis::linear("transmittance", "", [0.0, 1.04]))
        .sized(340.0, 280.0);
    let mut blocking =
        Panel::new(Axis::wavelength(limits), Axis::linear("optical density", "", [0.0, highest]))
            .sized(340.0, 280.0);
    for (index, filter) in filters.iter().enumerate() {
        let (ink, dash) = (Ink::cycle(index), Dash::cycle(index));
        linear = linear.with(Series::dashed(filter.name.clone(), ink, filter.points(), dash));
        blocking = blocking.with(Series::dashed(filter.name.clone(), ink, filter.mapped(density), dash));
    }
    Figure::grid("Filters", vec![linear, blocking], 2).explained(
        "The first plot shows the share of light that each filter lets through. The second shows the same as optical density, the number \
         of powers of ten by which light is weakened: 4 means that one part in ten thousand gets through. Only the second shows how well \
         a filter blocks.",
    )
}
