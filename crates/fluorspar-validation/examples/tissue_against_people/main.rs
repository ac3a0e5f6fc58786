//! Compares tissues of the catalogue, fits and drawn people with the reflectance and the fluorescence of four people.
//!
//! `cargo run --release -p fluorspar-validation --example tissue_against_people -- FOLDER [FIGURES]`
//!
//! FOLDER holds `tissue/`, `lights/` and `reflectance/` of the reference data, which do not ship; FIGURES is a folder for plots
//! of measured and computed shapes. The measured lamps excite the tissue, the Hoya K2 long-pass of the catalogue (often called a
//! 475 nm filter) stands before the instrument, and the lamp light that leaks through it is added as the tissue reflects it.
//! Spectra are compared from 500 to 700 nm every 5 nm, each divided by its value at 520 nm. Measured light is divided by that of
//! the lamp of the same current on a white target.
//!
//! 1. *Forward*: the sites against the median of people, one vote each over the days on which they were seen under all lamps, and
//!    against the median of all records.
//! 2. *Predictive*: each person is fitted under one lamp or two, with a prior from the other three, and predicted under another,
//!    beside three baselines: the shape does not change; own shape times the others' ratio of lamps; median of the others.
//! 3. *Spread*: chromaticity r of people drawn from the populations against that of the records.

#![allow(clippy::print_stdout, reason = "printing is what the example is for")]

mod figures;
mod forward;
mod predictive;
mod reference;
mod spread;

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use fluorspar::spectral::Fluorophore;
use fluorspar::tissue::{DiscreteOrdinates, EffectiveTissue, Site};
use fluorspar_experiment::preset;

use figures::Overlay;
use reference::{Fallible, Reference};

fn catalogue(name: &str) -> Option<Arc<Fluorophore>> {
    preset::fluorophore(name).ok().map(|known| Arc::new(known.fluorophore()))
}

fn solved_by(site: &Site, step_nm: f64) -> Fallible<EffectiveTissue> {
    let number = (380.0 / step_nm) as u32;
    let nm: Vec<f64> = (0..=number).map(|i| 370.0 + step_nm * f64::from(i)).collect();
    Ok(EffectiveTissue::new(&site.tissue(&catalogue)?, &nm, DiscreteOrdinates::DIFFUSE)?)
}

fn solved(site: &Site) -> Fallible<EffectiveTissue> {
    solved_by(site, 2.5)
}

/// Steps of 5 nm: shapes to some thousandths.
fn solved_coarsely(site: &Site) -> Fallible<EffectiveTissue> {
    solved_by(site, 5.0)
}

fn main() -> Fallible<()> {
    let folder: PathBuf = std::env::args().nth(1).ok_or("give the folder of the reference data")?.into();
    let figures: Option<PathBuf> = std::env::args().nth(2).map(PathBuf::from);
    let reference = Reference::read(&folder)?;
    println!("left out because of their flags: {}", reference.flagged().join(", "));
    let lips = ["s2", "s3", "s4"].map(|person| format!("oe_{person}_lip.csv"));
    let tongues = ["tongue_mean_350_780.csv".to_string()];
    let compared: [(&str, &str, &[String]); 3] = [
        ("dorsal_tongue", "tongue", &tongues),
        ("dorsal_tongue_b", "tongue", &tongues),
        ("lip", "lip", &lips),
    ];
    println!("\nFORWARD");
    let mut forward_overlays = Vec::new();
    for (site, place, files) in compared {
        forward_overlays.push(forward::forward(&reference, site, place, files)?);
    }
    println!("\nPREDICTIVE");
    let mut predicted = predictive::predictive(&reference, "dorsal_tongue", "tongue")?;
    predicted.extend(predictive::predictive(&reference, "lip", "lip")?);
    println!("\nSPREAD, chromaticity r behind the long-pass, 500 to 700 nm, percentiles 5 50 95");
    let mut held = 0;
    for (site, place) in [("dorsal_tongue", "tongue"), ("lip", "lip")] {
        held += spread::spread(&reference, site, place, 1.0)?;
    }
    println!("  {held} of 6 measured ranges are held by 80 %");
    if let Some(folder) = figures {
        write(&folder, forward_overlays, &predicted)?;
    }
    Ok(())
}

/// Draws what was compared.
fn write(folder: &std::path::Path, forward: Vec<Vec<Overlay>>, predicted: &[Overlay]) -> Fallible<()> {
    fs::create_dir_all(folder)?;
    let mut rows = forward.into_iter();
    let (Some(mut tongue), Some(second), Some(lip)) = (rows.next(), rows.next(), rows.next()) else {
        return Ok(());
    };
    for (overlay, other) in tongue.iter_mut().zip(second) {
        overlay.models.extend(other.models);
    }
    tongue.extend(lip);
    let explanation = "Fluorescence of tongues and lips of four people (black: median, one vote each; gray: all records) and of \
                       the tissues of the catalogue, which were fitted to these medians. Each is divided by its value at 520 nm.";
    let figure = figures::figure("Tissue of the catalogue and people", explanation, &tongue);
    fs::write(folder.join("tissue-forward.png"), figure.to_png()?)?;
    let explanation = "Each person was fitted under 405 nm alone and predicted under 450 nm, with a prior from the other three. \
                       Without a model one would take the shape under 405 nm (blue).";
    let figure = figures::figure("People predicted under another light", explanation, predicted);
    fs::write(folder.join("tissue-predicted.png"), figure.to_png()?)?;
    Ok(())
}
