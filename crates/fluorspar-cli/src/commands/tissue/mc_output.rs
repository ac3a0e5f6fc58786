//! Tables, figures and text of a simulation.

use fluorspar::tissue::monte_carlo::{Ending, Estimate, Ring};
use fluorspar_experiment::ResolvedLayers;
use fluorspar_report::Figure;
use fluorspar_report::figures::{EstimatedCurve, light_by_depth, light_by_radius};

use super::mc::Found;
use crate::commands::table::{align, short};

impl Found {
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
pub(super) fn tables(found: &Found) -> [(&'static str, String); 2] {
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
pub(super) fn figures(found: &Found, layers: &ResolvedLayers) -> [(&'static str, Figure); 2] {
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
    let bottoms = layers.stack.layers.iter().zip(&layers.names).map(|(layer, name)| {
        bottom += layer.thickness_mm;
        (bottom, name.clone())
    });
    let bottoms: Vec<(f64, String)> = bottoms.collect();
    [("radius", light_by_radius(&rings)), ("depth", light_by_depth(&[fluence], &bottoms))]
}

/// The results in words and columns.
pub(super) fn describe(found: &Found, layers: &ResolvedLayers) -> String {
    let light = &found.light;
    let title = if found.title.is_empty() { String::new() } else { format!("{}\n", found.title) };
    let incidence = found
        .angle_deg
        .map_or_else(|| "diffuse light".to_string(), |angle| format!("a beam at {} degrees", short(angle)));
    let ending = match light.ending {
        Ending::Photons => "",
        Ending::Error => ", as many as the wanted error took",
        Ending::Interrupted => ", then interrupted",
    };
    let row = |name: String, Estimate { mean, standard_error }: Estimate| {
        let relative =
            if mean == 0.0 { "-".into() } else { format!("{} %", short(100.0 * standard_error / mean)) };
        vec![name, short(mean), short(standard_error), relative]
    };
    let mut rows =
        vec![["share of the incident light", "", "standard error", "relative"].map(String::from).to_vec()];
    rows.push(row("specular reflectance".into(), light.specular_reflectance));
    rows.push(row("diffuse reflectance".into(), light.diffuse_reflectance));
    rows.push(row("transmittance".into(), light.transmittance));
    rows.push(row("  of it unscattered".into(), light.unscattered_transmittance));
    if light.guided.mean > 0.0 {
        rows.push(row("guided sideways".into(), light.guided));
    }
    for (name, absorbed) in layers.names.iter().zip(&light.absorbed_by_layer) {
        rows.push(row(format!("absorbed in {name}"), *absorbed));
    }
    let unit =
        found.emission_nm.map_or_else(|| "photons".to_string(), |nm| format!("photons per nm at {nm} nm"));
    let by_layer = |upward: Estimate, parts: &[Estimate]| {
        let parts = layers.names.iter().zip(parts).filter(|(_, part)| part.mean > 0.0);
        let mut rows = vec![row(format!("fluorescence upward, {unit}"), upward)];
        rows.extend(parts.map(|(name, part)| row(format!("  from {name}"), *part)));
        rows
    };
    if let Some(emission) = &found.fluorescence {
        rows.extend(by_layer(emission.upward, &emission.upward_by_layer));
        rows.push(row(format!("fluorescence downward, {unit}"), emission.downward));
    }
    if let Some(reciprocity) = &found.reciprocity {
        rows.extend(by_layer(reciprocity.upward, &reciprocity.upward_by_layer));
    }
    format!(
        "{title}{incidence}, {} photons, seed {}{ending}\n\n{}",
        light.photons,
        light.seed,
        align(&rows, &[])
    )
}
