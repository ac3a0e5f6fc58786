//! Diffuse reflectances over one another.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Series};

/// Diffuse reflectance of some surfaces.
pub fn reflectances(curves: &[PlotCurve]) -> Figure {
    let y = Axis::from_zero("diffuse reflectance", "", curves.iter().map(PlotCurve::peak));
    let mut panel = Panel::new(Axis::wavelength(wavelength_limits(curves)), y);
    for (index, curve) in curves.iter().enumerate() {
        let (ink, dash) = (Ink::cycle(index), Dash::cycle(index));
        panel = panel.with(Series::dashed(curve.name.clone(), ink, curve.points(), dash));
    }
    Figure::new("Reflectances", panel).explained(
        "The share of light that each surface sends back in all directions, without the gloss of its surface. Dips around 415, 540 and \
         580 nm are those of blood.",
    )
}
