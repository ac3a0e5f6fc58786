//! `fluorspar tissue solve`.

use fluorspar_session::tissue::SolvedTissue;

use crate::commands::table::{align, short};

/// Wavelengths that the text tells, nm.
const TOLD_NM: [f64; 11] = [365.0, 385.0, 405.0, 420.0, 450.0, 470.0, 500.0, 560.0, 600.0, 635.0, 700.0];
/// Shares below this are left out of the text.
const LEAST_SHARE: f64 = 0.01;

/// The results in words and columns.
pub(super) fn describe(found: &SolvedTissue) -> String {
    let head = ["nm", "R diffuse", "R beam", "R below surface", "fluence at surface", "1/e depth, um"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for (row, nm) in found.wavelength_nm.iter().enumerate() {
        if TOLD_NM.contains(nm) {
            let values = [
                found.reflectance[row],
                found.reflectance_of_beam[row],
                found.reflectance_below_surface[row],
                found.fluence_at_surface[row],
            ];
            let mut cells = vec![nm.to_string()];
            cells.extend(values.map(|value| format!("{value:.4}")));
            cells.push(format!("{:.0}", found.depth_of_1_over_e_um[row]));
            rows.push(cells);
        }
    }
    let mut text =
        format!("{} ({}), below it {}\n\n{}", found.title, found.site, found.below, align(&rows, &[]));
    for under in &found.fluorescence {
        let peak = (0..found.wavelength_nm.len())
            .max_by(|&a, &b| under.exitance_per_nm[a].total_cmp(&under.exitance_per_nm[b]))
            .map_or(0.0, |at| found.wavelength_nm[at]);
        let exitance = short(under.exitance);
        text += &format!(
            "\nUnder {}: {exitance} of the energy returns as fluorescence, most near {peak} nm\n",
            under.light
        );
        let mut rows = Vec::new();
        for emitter in under.emitters.iter().filter(|emitter| emitter.share >= LEAST_SHARE) {
            let share = format!("{:.0} %", 100.0 * emitter.share);
            rows.push(vec![format!("  {} in {}", emitter.fluorophore, emitter.layer), share]);
        }
        text += &align(&rows, &[]);
    }
    let own = found.own_absorption;
    text += &format!(
        "\nThe fluorophores' own absorption is part of the background. Added to it (quantum yields assumed), reflectance would \
         change by up to {:+.1} %, fluorescence by {:+.1} %.\n",
        100.0 * own.change_of_reflectance,
        100.0 * own.change_of_fluorescence
    );
    text
}
