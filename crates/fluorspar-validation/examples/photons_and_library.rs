//! How many photons and how good a library of spectra separate NADH, FAD, collagen and elastin: the table and the figure of docs/design.md.
//!
//! `cargo run --release -p fluorspar-validation --example photons_and_library -- FIGURE.svg`

#![allow(clippy::print_stdout, reason = "printing the table is what this is for")]

use std::error::Error;
use std::path::Path;

use fluorspar::design::DesignSpace;
use fluorspar_experiment::parse_design;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_report::{Axis, Dash, Figure, Ink, Panel, Series};

/// The problem, with LEDs at eight peaks and two exposures.
const PROBLEM: &str = "two-lights-tissue";
const LIGHTS: [&str; 2] = [
    "vary.light.led.peaks_nm=[340.0, 365.0, 385.0, 405.0, 420.0, 435.0, 450.0, 470.0]",
    "exposure.counts=[2]",
];
/// Sensors: name, centers and standard deviation of their bands.
const SENSORS: [(&str, Option<&str>); 2] = [
    ("RGB", None),
    (
        "eight bands",
        Some(
            "vary.sensor.bands=[{ centers_nm = [430.0, 465.0, 500.0, 535.0, 570.0, 605.0, 640.0, 675.0], sigma_nm = [14.0], \
             read_noise_e = 2.0, full_well_e = 60000.0 }]",
        ),
    ),
];
/// Errors of the library (shift, nm, and smooth error) and blood, um.
const LIBRARIES: [(&str, f64, f64, f64); 4] = [
    ("exact library, no blood", 0.0, 0.0, 0.0),
    ("1 nm and 1 %", 1.0, 0.01, 0.0),
    ("3 nm and 3 %", 3.0, 0.03, 0.0),
    ("3 nm, 3 %, 1 um of blood", 3.0, 0.03, 1.0),
];
const ELECTRONS: [f64; 5] = [1e3, 1e4, 1e5, 1e6, 1e8];
/// The fluorophores that are told apart; porphyrin is there as well.
const WANTED: [&str; 4] = ["nadh", "fad", "collagen", "elastin"];

/// The best pair of lights and its worst relative standard deviation of a wanted weight.
fn best(changes: &[String]) -> Result<(f64, String), Box<dyn Error>> {
    let resolved =
        parse_design(preset::text(PresetKind::Design, PROBLEM)?, PROBLEM, Path::new("."), changes)?;
    let space = DesignSpace::new(resolved.problem)?;
    let mut found = (f64::INFINITY, String::new());
    for number in 0..space.len() {
        let design = space.design(number);
        let (problem, merits) = (space.problem(), space.evaluate(&design));
        let named = problem.regions[0].response.fluorescence.iter().zip(&merits.regions[0].weights);
        let wanted = named.filter(|(part, _)| WANTED.contains(&part.name.as_str()));
        let loss = wanted.map(|(_, sd)| *sd).fold(0.0, f64::max);
        if loss < found.0 {
            let names: Vec<&str> =
                design.lights.iter().map(|light| problem.lights[*light].name.as_str()).collect();
            found = (loss, names.join(" + "));
        }
    }
    Ok(found)
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name the figure to write, for instance photons.svg")?;
    let mut panels = Vec::new();
    for (sensor, bands) in SENSORS {
        let axis = Axis::log10("worst relative standard deviation of four weights", "", [0.02, 2.0]);
        let mut panel =
            Panel::new(Axis::log10("electrons of a pixel in all exposures", "", [1e3, 1e8]), axis)
                .sized(300.0, 260.0)
                .titled(sensor);
        for (number, (library, shift_nm, error, blood_um)) in LIBRARIES.into_iter().enumerate() {
            let mut points = Vec::new();
            for electrons in ELECTRONS {
                let mut changes: Vec<String> = LIGHTS.map(String::from).into();
                changes.extend(bands.map(String::from));
                changes.extend([
                    format!("exposure.total.electrons={electrons:.1}"),
                    format!("unknown.emission_shift_nm={shift_nm:.1}"),
                    format!("unknown.excitation_shift_nm={shift_nm:.1}"),
                    format!("unknown.spectrum={error:.2}"),
                    format!("unknown.blood_um={blood_um:.1}"),
                ]);
                let (loss, lights) = best(&changes)?;
                println!("{sensor}, {electrons:.0e} electrons, {library}: {loss:.3} with {lights}");
                points.push([electrons, loss]);
            }
            panel = panel.with(Series::dashed(library, Ink::cycle(number), points, Dash::cycle(number)));
        }
        panels.push(panel);
    }
    let figure = Figure::grid("Four fluorophores under the best two of eight LEDs", panels, 2).explained(
        "Bounds for one pixel; those of a region of 1000 pixels are those of 1000 times as many electrons. The steps to the right are \
         what no light helps.",
    );
    std::fs::write(path, figure.to_svg())?;
    Ok(())
}
