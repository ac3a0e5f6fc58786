//! Fit errors of the fluorophores, recomputed from the measured matrices where those are at hand.

use std::path::{Path, PathBuf};

use super::{FluorophorePreset, PresetKind, fluorophore, names};
use fluorspar::spectral::{Curve, Stokes, YieldDensity, YieldUnit};

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
        assert!(most > 0.0 && most < 0.1, "{name}: {most}");
    }
}

/// Peaks and yields of dyes as published, within 5 nm: what spectrometers, concentrations and buffers make the publications differ by.
#[test]
fn dyes_have_their_published_peaks_and_yields() {
    let mut dyes = Vec::new();
    for name in names(PresetKind::Fluorophore) {
        let preset = fluorophore(name).unwrap();
        let Some(dye) = &preset.published else { continue };
        let YieldDensity::Separable(terms) = preset.fluorophore().eem.density().clone() else {
            panic!("{name}: no model")
        };
        let [term] = terms.as_slice() else { panic!("{name}: {} terms", terms.len()) };
        let [from, to] = preset.excitation_range_nm;
        let best = |curve: &Curve, [from, to]: [f64; 2]| {
            let nodes = (0..=(2.0 * (to - from)) as usize).map(|step| from + 0.5 * step as f64);
            nodes.fold(from, |best, nm| if curve.at(nm) > curve.at(best) { nm } else { best })
        };
        let excitation_nm = best(&term.excitation, [from, to]);
        let emission_nm = best(&term.emission, preset.emission_range_nm);
        assert!((excitation_nm - dye.excitation_peak_nm).abs() <= 5.0, "{name}: excitation {excitation_nm}");
        assert!((emission_nm - dye.emission_peak_nm).abs() <= 5.0, "{name}: emission {emission_nm}");
        assert!(emission_nm > excitation_nm, "{name}");
        // The stored yield has five digits.
        let wanted = dye.photon_yield();
        assert!(
            (preset.photon_yield / wanted - 1.0).abs() < 1e-4,
            "{name}: {} for {wanted}",
            preset.photon_yield
        );
        // Without the mask, photons out of a thin layer per photon that it takes are the quantum yield.
        let unmasked = preset.fluorophore_with(preset.photon_yield, Stokes::Off);
        let taken = wanted / dye.quantum_yield;
        let found = unmasked.photon_yield(excitation_nm, 200.0, 1200.0) / taken;
        assert!((found / dye.quantum_yield - 1.0).abs() < 5e-3, "{name}: {found} for {}", dye.quantum_yield);
        dyes.push(name);
    }
    assert_eq!(dyes.len(), 8, "{dyes:?}");
    // Known by every laboratory: one micromole of fluorescein per liter takes 1.8 % of 490 nm light on a millimeter.
    let fluorescein = fluorophore("fluorescein").unwrap().published.unwrap();
    assert!((fluorescein.photon_yield() / fluorescein.quantum_yield - 0.0175).abs() < 2e-4);
}

#[test]
fn stored_fit_errors_of_dyes_are_those_of_the_models() {
    let Some(folder) = reference_folder() else {
        println!("skipped: no reference data (set FLUORSPAR_REFERENCE to their folder)");
        return;
    };
    let mut compared = 0;
    for name in names(PresetKind::Fluorophore) {
        let preset = fluorophore(name).unwrap();
        if !preset.fit.reference.starts_with("dyes/") {
            continue;
        }
        let text = std::fs::read_to_string(folder.join(&preset.fit.reference)).unwrap();
        let rows: Vec<Vec<f64>> = text
            .lines()
            .filter_map(|line| line.split(',').map(|cell| cell.trim().parse().ok()).collect())
            .collect();
        let YieldDensity::Separable(terms) = preset.fluorophore().eem.density().clone() else {
            panic!("{name}: no model")
        };
        // The error of a curve with its best scale, over every second row of its range.
        let error = |curve: &Curve, column: usize, [from, to]: [f64; 2]| {
            let used: Vec<&Vec<f64>> =
                rows.iter().filter(|row| (from..=to).contains(&row[0])).step_by(2).collect();
            let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
                used.iter().map(|row| f(curve.at(row[0]), row[column].max(0.0))).sum()
            };
            let (mm, md, dd) = (sum(&|m, _| m * m), sum(&|m, d| m * d), sum(&|_, d| d * d));
            (1.0 - md * md / (mm * dd)).max(0.0).sqrt()
        };
        let emission = error(&terms[0].emission, 2, preset.emission_range_nm);
        assert!((emission - preset.fit.relative_emission.unwrap()).abs() < 2e-3, "{name}: {emission}");
        // One band of riboflavin was scaled after the fit.
        if name != "riboflavin" {
            let excitation = error(&terms[0].excitation, 1, preset.excitation_range_nm);
            assert!(
                (excitation - preset.fit.relative_excitation.unwrap()).abs() < 2e-3,
                "{name}: {excitation}"
            );
        }
        compared += 1;
    }
    assert_eq!(compared, 5);
}
