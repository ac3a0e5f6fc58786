//! Tables and figures of photons traced through a tissue.

use fluorspar::tissue::monte_carlo::{Estimate, Ring};
use fluorspar_report::Figure;
use fluorspar_report::figures::{EstimatedCurve, light_by_depth, light_by_radius};

use super::monte_carlo::TracedTissue;

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
    let mut radius = "inner_mm,outer_mm".to_string();
    for (name, _) in &rings {
        radius += &format!(",{name}_per_mm2,{name}_standard_error_per_mm2");
    }
    radius.push('\n');
    for (place, ring) in found.light.reflected_rings.iter().enumerate() {
        radius += &format!("{},{}", ring.radii_mm[0], ring.radii_mm[1]);
        for (_, rings) in &rings {
            let Estimate { mean, standard_error } = rings[place].exitance_per_mm2;
            radius += &format!(",{mean},{standard_error}");
        }
        radius.push('\n');
    }
    let mut depth = "layer,upper_mm,lower_mm,fluence,fluence_standard_error\n".to_string();
    for slice in &found.light.slices {
        let ([upper, lower], Estimate { mean, standard_error }) = (slice.depths_mm, slice.fluence);
        depth += &format!("{},{upper},{lower},{mean},{standard_error}\n", slice.layer + 1);
    }
    [("radius", radius), ("depth", depth)]
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
