//! Tables and figures of photons traced through a tissue.

use fluorspar::tissue::monte_carlo::{Estimate, Ring};
use fluorspar_report::Figure;
use fluorspar_report::figures::{EstimatedCurve, light_by_depth, light_by_radius};

use super::monte_carlo::TracedTissue;
use crate::values::csv;

impl TracedTissue {
    /// Names and rings of the light that leaves.
    fn rings(&self) -> Vec<(&'static str, &[Ring])> {
        let mut rings = vec![
            ("reflected", self.light.reflected_rings.as_slice()),
            ("transmitted", &self.light.transmitted_rings),
        ];
        rings.extend(self.fluorescence.as_ref().map(|emission| ("fluorescence", emission.rings.as_slice())));
        rings
    }
}

/// Light by radius and by depth, as comma-separated values with units in their heads.
pub(super) fn tables(found: &TracedTissue) -> [(&'static str, String); 2] {
    let rings = found.rings();
    let heads = rings.iter().map(|(name, _)| format!(",{name}_per_mm2,{name}_standard_error_per_mm2"));
    let by_radius = found.light.reflected_rings.iter().enumerate().map(|(place, ring)| {
        let values = rings.iter().map(|(_, rings)| {
            let Estimate { mean, standard_error } = rings[place].exitance_per_mm2;
            format!(",{mean},{standard_error}")
        });
        format!("{},{}{}", ring.radii_mm[0], ring.radii_mm[1], values.collect::<String>())
    });
    let by_depth = found.light.slices.iter().map(|slice| {
        let ([upper, lower], Estimate { mean, standard_error }) = (slice.depths_mm, slice.fluence);
        format!("{},{upper},{lower},{mean},{standard_error}", slice.layer + 1)
    });
    let heads = format!("inner_mm,outer_mm{}", heads.collect::<String>());
    [
        ("radius", csv(&heads, by_radius)),
        ("depth", csv("layer,upper_mm,lower_mm,fluence,fluence_standard_error", by_depth)),
    ]
}

/// Light by radius and by depth, drawn.
pub(super) fn figures(found: &TracedTissue, thicknesses_mm: &[f64]) -> [(&'static str, Figure); 2] {
    let curve = |(name, rings): (&'static str, &[Ring])| {
        let point = |ring: &Ring| {
            let Estimate { mean, standard_error } = ring.exitance_per_mm2;
            [0.5 * (ring.radii_mm[0] + ring.radii_mm[1]), mean, standard_error]
        };
        EstimatedCurve { name: name.into(), points: rings.iter().map(point).collect() }
    };
    let rings: Vec<EstimatedCurve> = found.rings().into_iter().map(curve).collect();
    let slices = found.light.slices.iter().map(|slice| {
        let Estimate { mean, standard_error } = slice.fluence;
        [0.5 * (slice.depths_mm[0] + slice.depths_mm[1]), mean, standard_error]
    });
    let fluence = EstimatedCurve { name: "fluence".into(), points: slices.collect() };
    let mut bottom = 0.0;
    let bottoms = thicknesses_mm.iter().zip(&found.layers).map(|(thickness_mm, name)| {
        bottom += thickness_mm;
        (bottom, name.clone())
    });
    let bottoms: Vec<(f64, String)> = bottoms.collect();
    [("radius", light_by_radius(&rings)), ("depth", light_by_depth(&[fluence], &bottoms))]
}
