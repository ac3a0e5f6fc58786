//! Tables and figures of a solved tissue.

use fluorspar_format::{csv_cell, eem_csv};
use fluorspar_report::Figure;
use fluorspar_report::figures::{EemMap, PlotCurve, eem_maps, emission, tissue_reflectance};

use super::solve::{SolvedFluorescence, SolvedTissue};
use crate::values::csv;

/// Shares below this are left out of the figures.
const LEAST_SHARE: f64 = 0.01;

impl SolvedTissue {
    /// Columns by wavelength: names and values.
    fn columns(&self) -> [(&'static str, &[f64]); 5] {
        [
            ("reflectance", &self.reflectance),
            ("reflectance_below_surface", &self.reflectance_below_surface),
            ("reflectance_of_beam", &self.reflectance_of_beam),
            ("fluence_at_surface", &self.fluence_at_surface),
            ("depth_of_1_over_e_um", &self.depth_of_1_over_e_um),
        ]
    }
}

/// Values by wavelength.
fn by_wavelength(nm: &[f64], columns: &[(String, &[f64])]) -> String {
    let heads: String = columns.iter().map(|(name, _)| format!(",{}", csv_cell(name))).collect();
    let values = |row: usize| columns.iter().map(move |(_, values)| format!(",{}", values[row]));
    csv(
        &format!("wavelength_nm{heads}"),
        nm.iter().enumerate().map(|(row, nm)| format!("{nm}{}", values(row).collect::<String>())),
    )
}

/// Spectra, fluorescence under the lights, and the matrix of all fluorophores, as comma-separated values.
pub(super) fn tables(found: &SolvedTissue) -> [(&'static str, String); 3] {
    let spectra: Vec<(String, &[f64])> =
        found.columns().into_iter().map(|(name, values)| (name.to_string(), values)).collect();
    let mut fluorescence: Vec<(String, &[f64])> = Vec::new();
    for under in &found.fluorescence {
        fluorescence.push((format!("{}_per_nm", under.light), &under.exitance_per_nm));
        fluorescence.extend(under.emitters.iter().map(|emitter| {
            let name = format!("{}_{}_in_{}_per_nm", under.light, emitter.fluorophore, emitter.layer);
            (name, emitter.exitance_per_nm.as_slice())
        }));
    }
    let eem = &found.eem;
    let of_all = |cell: usize| eem.fluorophores.iter().map(|(_, values)| values[cell]).sum::<f64>();
    let cells = eem.emission_nm.len() * eem.excitation_nm.len();
    let sums: Vec<f64> = (0..cells).map(of_all).collect();
    [
        ("spectra", by_wavelength(&found.wavelength_nm, &spectra)),
        ("fluorescence", by_wavelength(&found.wavelength_nm, &fluorescence)),
        ("eem", format!("# unit: photons\n{}", eem_csv(&eem.excitation_nm, &eem.emission_nm, &sums))),
    ]
}

/// Reflectance, matrices, and fluorescence under each light.
pub(super) fn figures(found: &SolvedTissue) -> Vec<(String, Figure)> {
    let nm = &found.wavelength_nm;
    let curve = |name: &str, values: &[f64]| PlotCurve::new(name, nm.clone(), values.to_vec());
    let reflectances = [
        curve("of diffuse light", &found.reflectance),
        curve("of a beam", &found.reflectance_of_beam),
        curve("below the surface", &found.reflectance_below_surface),
    ];
    let mut figures = vec![("reflectance".to_string(), tissue_reflectance(&found.title, &reflectances))];
    for under in &found.fluorescence {
        let name = under.light.replace(' ', "_");
        figures.push((format!("fluorescence_{name}"), fluorescence_figure(found, under)));
    }
    if !found.eem.fluorophores.is_empty() && found.eem.excitation_nm.len() > 1 {
        figures.push(("eem".into(), eem_figure(found)));
    }
    figures
}

fn fluorescence_figure(found: &SolvedTissue, under: &SolvedFluorescence) -> Figure {
    let nm = &found.wavelength_nm;
    let mut curves: Vec<PlotCurve> = Vec::new();
    for emitter in under.emitters.iter().filter(|emitter| emitter.share >= LEAST_SHARE) {
        let name = format!("{} in {}", emitter.fluorophore, emitter.layer);
        curves.push(PlotCurve::new(name, nm.clone(), emitter.exitance_per_nm.clone()));
    }
    curves.push(PlotCurve::new("all", nm.clone(), under.exitance_per_nm.clone()));
    let amount = "as much of each as the tissue holds, after it has come through the tissue";
    emission(&curves, &under.light, amount, ["radiant exitance per irradiance", "1/nm"], None)
}

fn eem_figure(found: &SolvedTissue) -> Figure {
    let eem = &found.eem;
    let edges = |nm: &[f64]| {
        let half = 0.5 * (nm[1] - nm[0]);
        [nm[0] - half, nm[nm.len() - 1] + half]
    };
    let map = |name: &str, values: Vec<f64>| EemMap {
        name: name.into(),
        excitation_nm: edges(&eem.excitation_nm),
        emission_nm: edges(&eem.emission_nm),
        columns: eem.excitation_nm.len(),
        values,
    };
    let mut sum = vec![0.0; eem.excitation_nm.len() * eem.emission_nm.len()];
    for (_, values) in &eem.fluorophores {
        sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
    }
    let mut maps = vec![map("all of the tissue", sum)];
    maps.extend(eem.fluorophores.iter().map(|(name, values)| map(name, values.clone())));
    eem_maps(&maps, None)
}
