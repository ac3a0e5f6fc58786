//! Tissues of the catalogue with its fluorophores: what their states do, and the measured reflectance of tongues and lips.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fluorspar::spectral::Fluorophore;
use fluorspar::tissue::{DiscreteOrdinates, EffectiveTissue, Level, Site};
use fluorspar_experiment::preset::{self, PresetKind};

fn catalogue(name: &str) -> Option<Arc<Fluorophore>> {
    preset::fluorophore(name).ok().map(|known| Arc::new(known.fluorophore()))
}

/// Every 5 nm from 390 to 740 nm.
fn solved(site: &Site) -> EffectiveTissue {
    let nm: Vec<f64> = (0..=70).map(|i| 390.0 + 5.0 * f64::from(i)).collect();
    EffectiveTissue::new(&site.tissue(&catalogue).unwrap(), &nm, DiscreteOrdinates::DIFFUSE).unwrap()
}

#[test]
fn superficial_blood_darkens_fluorescence_most_under_violet_light() {
    let normal = preset::site("dorsal_tongue").unwrap();
    let mut bloody = normal.clone();
    bloody.apply(&preset::state("hyperemia").unwrap()).unwrap();
    let [normal, bloody] = [&normal, &bloody].map(solved);
    // Lamps that are sold as 405, 415 and 450 nm, as measured: three lines for their width of 15 nm.
    for (peak_nm, expected) in [(408.0, 0.40), (416.0, 0.41), (444.0, 0.51)] {
        let light = |tissue: &EffectiveTissue| -> f64 {
            let lines = [(peak_nm - 8.0, 0.25), (peak_nm, 0.5), (peak_nm + 8.0, 0.25)];
            let emitted = |nm: f64| -> f64 {
                let parts = tissue.parts().into_iter();
                parts.map(|part| tissue.yield_density(part, 520.0, nm, Level::AboveSurface)).sum()
            };
            lines.iter().map(|(nm, weight)| weight * emitted(*nm)).sum()
        };
        let factor = light(&bloody) / light(&normal);
        assert!((factor - expected).abs() <= 0.03, "{peak_nm} nm: {factor}");
    }
    // White light sees it, too.
    let green = |tissue: &EffectiveTissue| tissue.reflectance(Level::AboveSurface).at(540.0);
    assert!(green(&bloody) < 0.7 * green(&normal));
}

#[test]
fn no_tissue_returns_more_light_than_it_gets() {
    for name in preset::names(PresetKind::Site) {
        let returned = solved(&preset::site(name).unwrap()).largest_photon_return();
        assert!(returned > 0.3 && returned < 0.9, "{name}: {returned}");
    }
}

/// The folder of reference data: `FLUORSPAR_REFERENCE`, or `shared/reference` beside the repository.
pub(crate) fn reference_folder() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os("FLUORSPAR_REFERENCE") {
        return Some(folder.into());
    }
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().map(|folder| folder.join("shared/reference")).find(|folder| folder.is_dir())
}

/// The first column of values of a file, at some wavelengths.
fn measured(path: &Path, at_nm: &[f64]) -> Vec<f64> {
    let text = std::fs::read_to_string(path).unwrap();
    let number = |cell: &str| cell.trim().parse::<f64>().ok();
    let samples: Vec<(f64, f64)> = text
        .lines()
        .filter_map(|line| {
            let mut cells = line.split(',');
            Some((number(cells.next()?)?, number(cells.next()?)?))
        })
        .collect();
    let (nm, value) = samples.into_iter().unzip();
    let curve = fluorspar::spectral::Curve::new(nm, value).unwrap();
    at_nm.iter().map(|&nm| curve.at(nm)).collect()
}

#[test]
fn fitted_sites_have_the_measured_reflectance() {
    let Some(folder) = reference_folder() else {
        println!("skipped: no reference data (set FLUORSPAR_REFERENCE to their folder)");
        return;
    };
    let nm: Vec<f64> = (0..=70).map(|i| 390.0 + 5.0 * f64::from(i)).collect();
    let lips = ["oe_s2_lip.csv", "oe_s3_lip.csv", "oe_s4_lip.csv"];
    let cases: [(&str, &[&str], f64); 3] = [
        ("dorsal_tongue", &["tongue_mean_350_780.csv"], 0.006),
        ("dorsal_tongue_b", &["tongue_mean_350_780.csv"], 0.005),
        ("lip", &lips, 0.010),
    ];
    for (name, files, largest) in cases {
        let columns: Vec<Vec<f64>> =
            files.iter().map(|file| measured(&folder.join("reflectance").join(file), &nm)).collect();
        let reflectance = solved(&preset::site(name).unwrap()).reflectance(Level::AboveSurface);
        let squares: f64 = nm
            .iter()
            .enumerate()
            .map(|(i, &nm)| {
                let mean = columns.iter().map(|column| column[i]).sum::<f64>() / columns.len() as f64;
                (reflectance.at(nm) - mean).powi(2)
            })
            .sum();
        let rms = (squares / nm.len() as f64).sqrt();
        assert!(rms <= largest, "{name}: {rms}");
    }
}
