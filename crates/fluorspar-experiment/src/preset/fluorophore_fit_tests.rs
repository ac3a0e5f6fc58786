//! Fit errors of the fluorophores, recomputed from the measured matrices where those are at hand.

use std::path::{Path, PathBuf};

use super::{FluorophorePreset, PresetKind, fluorophore, names};
use fluorspar::spectral::YieldUnit;

/// The folder of reference data: `FLUORSPAR_REFERENCE`, or `shared/reference` beside the repository.
fn reference_folder() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os("FLUORSPAR_REFERENCE") {
        return Some(folder.into());
    }
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().map(|folder| folder.join("shared/reference")).find(|folder| folder.is_dir())
}

/// Cells of a matrix file: emission, excitation, value.
fn cells(path: &Path) -> Vec<(f64, f64, f64)> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let number = |cell: &str| cell.trim().parse::<f64>().ok();
    let excitation: Vec<f64> = lines.next().unwrap().split(',').skip(1).filter_map(number).collect();
    let mut cells = Vec::new();
    for line in lines {
        let mut row = line.split(',');
        let emission = number(row.next().unwrap()).unwrap();
        for (excitation, value) in excitation.iter().zip(row) {
            if let Some(value) = number(value) {
                cells.push((emission, *excitation, value));
            }
        }
    }
    cells
}

/// `||s model - data|| / ||data||` with the best scale, and the number of cells that count.
fn relative_error(preset: &FluorophorePreset, data: &[(f64, f64, f64)], stokes_gap_nm: f64) -> (f64, usize) {
    let second_order_gap_nm = preset.fit.mask.unwrap().second_order_gap_nm;
    let eem = preset.fluorophore().eem;
    let (mut mm, mut md, mut dd, mut count) = (0.0, 0.0, 0.0, 0);
    for &(emission, excitation, value) in data {
        let counts = value > 0.0
            && emission - excitation >= stokes_gap_nm
            && (emission - 2.0 * excitation).abs() >= second_order_gap_nm;
        if counts {
            let photons = eem.unmasked(emission, excitation);
            let model = match preset.unit {
                YieldUnit::Photons => photons,
                YieldUnit::Energy => photons * excitation / emission,
            };
            mm += model * model;
            md += model * value;
            dd += value * value;
            count += 1;
        }
    }
    ((1.0 - md * md / (mm * dd)).max(0.0).sqrt(), count)
}

#[test]
fn stored_fit_errors_are_those_of_the_models() {
    let Some(folder) = reference_folder() else {
        println!("skipped: no reference data (set FLUORSPAR_REFERENCE to their folder)");
        return;
    };
    let mut compared = 0;
    for name in names(PresetKind::Fluorophore) {
        let preset = fluorophore(name).unwrap();
        if !(preset.fit.reference.contains("webfluor") && preset.fit.quantity == "eem") {
            continue;
        }
        let data = cells(&folder.join(&preset.fit.reference));
        let (error, count) = relative_error(&preset, &data, preset.fit.mask.unwrap().stokes_gap_nm);
        assert_eq!(count, preset.fit.cells, "{name}");
        assert!(error <= 0.06, "{name}: {error}");
        assert!((error - preset.fit.relative_frobenius).abs() < 1e-3, "{name}: {error} {:?}", preset.fit);
        let (error, _) = relative_error(&preset, &data, 20.0);
        let stored = preset.fit.relative_frobenius_gap20.unwrap();
        assert!((error - stored).abs() < 1e-3, "{name}: {error} against {stored} with a gap of 20 nm");
        compared += 1;
    }
    assert_eq!(compared, 5, "NADH, FAD, collagen, elastin and protoporphyrin have a measured matrix");
}

#[test]
fn every_fluorophore_loads_and_conserves_photons() {
    for name in names(PresetKind::Fluorophore) {
        let fluorophore = fluorophore(name).unwrap().fluorophore();
        let most =
            (300..700).map(|nm| fluorophore.photon_yield(f64::from(nm), 200.0, 1000.0)).fold(0.0, f64::max);
        assert!(most > 0.0 && most < 0.05, "{name}: {most}");
    }
}
