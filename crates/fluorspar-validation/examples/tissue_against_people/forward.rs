//! Tissues of the catalogue against the medians of people: these spectra were what they were fitted to.

use fluorspar::tissue::{Level, Site};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_report::figures::PlotCurve;

use crate::figures::Overlay;
use crate::reference::{Fallible, Lamp, Measured, NORM, Reference, counts, normalized, wavelengths};
use crate::solved;

/// Wavelengths of the ratios, nm.
const RATIOS_NM: [f64; 5] = [540.0, 580.0, 600.0, 635.0, 675.0];
/// Deviation of a shape that is told, wavelength by wavelength.
const TOLD: f64 = 0.04;

fn rms(a: &[f64], b: &[f64], counts: impl Fn(usize) -> bool) -> f64 {
    let squares: Vec<f64> = (0..a.len()).filter(|&i| counts(i)).map(|i| (a[i] - b[i]).powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// One line for a lamp; returns how many ratios lie within the range of people, widened by 0.02.
fn compare(lamp: &Lamp, place: &str, model: &[f64], level: f64, people: &Measured) -> usize {
    let counts = |i: usize| counts(place, lamp.name, wavelengths()[i]);
    let ((votes, vote_level), (pooled, pooled_level)) = (people.votes(|_| true), people.pooled());
    let at = |nm: f64| ((nm - 500.0) / 5.0) as usize;
    let inside = |nm: &&f64| {
        let [low, high] = people.range(at(**nm));
        (low - 0.02..=high + 0.02).contains(&model[at(**nm)])
    };
    let count = RATIOS_NM.iter().filter(inside).count();
    println!(
        "  {} nm: rms {:.3} (all records {:.3}), F520 x {:.2} ({:.2}) of measured, {count} of 5 ratios within people",
        lamp.name,
        rms(model, &votes, counts),
        rms(model, &pooled, counts),
        level / vote_level,
        level / pooled_level,
    );
    let off: Vec<String> = (0..model.len())
        .filter(|&i| counts(i) && (model[i] - votes[i]).abs() > TOLD)
        .map(|i| format!("{} nm {:+.3}", wavelengths()[i], model[i] - votes[i]))
        .collect();
    if !off.is_empty() {
        println!("      off by more than {TOLD}: {}", off.join(", "));
    }
    count
}

/// Compares one site with its emitters, without the orange one, and in its states.
pub(crate) fn forward(
    reference: &Reference,
    name: &str,
    place: &str,
    files: &[String],
) -> Fallible<Vec<Overlay>> {
    let site = preset::site(name)?;
    let mut without = site.clone();
    without.set("superficial_lipopigment_per_mm", 0.0)?;
    without.set("deep_lipopigment_per_mm", 0.0)?;
    let mut overlays = Vec::new();
    for (site, what) in [(&site, ""), (&without, " without the orange emitter, all else unchanged")] {
        let tissue = solved(site)?;
        let nm: Vec<f64> = (0..=70).map(|i| 390.0 + 5.0 * f64::from(i)).collect();
        let reflectance = tissue.reflectance(Level::AboveSurface);
        let model: Vec<f64> = nm.iter().map(|&nm| reflectance.at(nm)).collect();
        let mean = reference.mean_reflectance(files, &nm)?;
        println!("{name}{what}: reflectance rms {:.4}", rms(&model, &mean, |_| true));
        let mut inside = 0;
        for lamp in &reference.lamps {
            let spectrum = lamp.viewing.spectrum(&tissue, &wavelengths());
            let people = reference.measured(place, lamp);
            let shape = normalized(&spectrum);
            inside += compare(lamp, place, &shape, spectrum[NORM], &people);
            if what.is_empty() {
                let title = format!("{place}, {} nm", lamp.name);
                let range = (0..shape.len()).map(|i| people.range(i)).collect();
                let measured = people.votes(|_| true).0;
                let model = PlotCurve::new(format!("{name} of the catalogue"), wavelengths(), shape);
                overlays.push(Overlay { title, measured, range, models: vec![model], band: Vec::new() });
            }
        }
        println!("  {inside} of 15 ratios within people");
    }
    states(reference, &site)?;
    Ok(overlays)
}

/// Fluorescence of the states relative to the normal tissue.
fn states(reference: &Reference, site: &Site) -> Fallible<()> {
    let normal = solved(site)?;
    for name in preset::names(PresetKind::State) {
        let mut changed = site.clone();
        changed.apply(&preset::state(name)?)?;
        let changed = solved(&changed)?;
        let at_520 = |lamp: &Lamp| {
            let [a, b] = [&changed, &normal].map(|tissue| lamp.without_leak.spectrum(tissue, &[520.0])[0]);
            format!("{:.2}", a / b)
        };
        let factors: Vec<String> = reference.lamps.iter().map(at_520).collect();
        println!("  {name}: fluorescence at 520 nm x {}", factors.join(", "));
    }
    Ok(())
}
