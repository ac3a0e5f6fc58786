//! Figure 3: excitation-emission matrices, and what they give under the LED.

use std::collections::BTreeMap;

use fluorspar::analysis::spectral_overlap;
use fluorspar::pipeline::predict;
use fluorspar::spectral::{Fluorophore, Transmittance};
use fluorspar::study::FlatSample;

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{BULK, PORPHYRIN, Setup, ValidationError, fluorophore};
use fluorspar_report::Figure;
use fluorspar_report::figures::{EemMap, PlotCurve, eem_maps, emission};

/// Range and step of the maps, nm: those of the paper's renderer.
const RANGE_NM: [f64; 2] = [365.0, 705.0];
const STEP_NM: f64 = 5.0;

pub(super) fn run(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let names: Vec<&str> = BULK.iter().copied().chain([PORPHYRIN]).collect();
    let fluorophores = names.iter().map(|name| fluorophore(name)).collect::<Result<Vec<_>, _>>()?;
    let amounts: Vec<(&str, f64)> = names.iter().map(|&name| (name, 1.0)).collect();
    let sample = setup.glowing(&amounts)?;
    let prediction = predict(&sample)?;
    let seen = behind_filter(&sample, &prediction.radiance.fluorescence, &names);

    // Overlap of every pair behind the viewing filter
    let overlap = |a: usize, b: usize| spectral_overlap(&seen[a], &seen[b]).unwrap_or(f64::NAN);
    let last = BULK.len();
    let among: Vec<f64> =
        (0..last).flat_map(|a| (0..a).map(move |b| (a, b))).map(|(a, b)| overlap(a, b)).collect();
    let smallest = among.iter().copied().fold(f64::INFINITY, f64::min);
    let with_porphyrin = (0..last).map(|a| overlap(a, last)).fold(0.0, f64::max);
    let forbidden = fluorophores.iter().map(below_the_diagonal).fold(0.0, f64::max);
    let maps: Vec<EemMap> =
        fluorophores.iter().map(|f| EemMap::of(f, RANGE_NM, RANGE_NM, [cells(); 2])).collect();
    let peaks: Vec<f64> = maps.iter().map(|map| map.values.iter().copied().fold(0.0, f64::max)).collect();
    let ratio =
        peaks.iter().copied().fold(0.0, f64::max) / peaks.iter().copied().fold(f64::INFINITY, f64::min);

    let reason = format!(
        "The matrices are triangular. Behind the viewing filter the emission of porphyrin overlaps with that of the others by {} at \
         most, theirs among each other by {} at least. The paper scales every matrix to a peak of 1, since it knows no \
         absolute levels; here units of the catalogue have photon yields, and the peaks of the five differ by a factor of {}.",
        number(with_porphyrin),
        number(smallest),
        number(ratio)
    );
    let least_peak = peaks.iter().copied().fold(f64::INFINITY, f64::min);
    Ok(Outcome::new(Verdict::Reproduced, reason)
        .checks(checks(forbidden, [with_porphyrin, smallest], least_peak))
        .show("figure_3_eem", eem_maps(&maps, Some(sample.irradiance.peak_nm())))
        .show("figure_3_emission", emission_figure(&sample, &names, &prediction.radiance.fluorescence)))
}

fn checks(forbidden: f64, [with_porphyrin, smallest]: [f64; 2], least_peak: f64) -> [Check; 3] {
    let what = "largest yield at emission wavelengths below the excitation";
    let triangular = Check::at_most(what, 0.0, forbidden, "1/nm", "the Stokes mask is exact");
    let what = "largest overlap (cosine) of porphyrin with one of the other four";
    let why = "the smallest overlap among the other four: porphyrin can be told apart before any of them";
    let apart = Check::at_most(what, smallest, with_porphyrin, "", why);
    let why = "every fluorophore emits in this range";
    let emitting = Check::at_least("smallest peak of a matrix", f64::MIN_POSITIVE, least_peak, "1/nm", why);
    [
        triangular.said("the EEMs are triangular"),
        apart.said("porphyrin does not overlap with the others, which overlap much"),
        emitting.said("peak values are 1, in relative units"),
    ]
}

/// Radiance of each fluorophore behind the viewing filter, W/(sr m² nm), by bins.
pub(super) fn behind_filter(
    sample: &FlatSample,
    radiance: &BTreeMap<String, Vec<f64>>,
    names: &[&str],
) -> Vec<Vec<f64>> {
    let filter = sample.camera.view_filter.transmittance.on_grid::<Transmittance>(&sample.grid);
    let pass = |spectrum: &Vec<f64>| spectrum.iter().zip(filter.values()).map(|(l, t)| l * t).collect();
    names.iter().map(|name| radiance.get(*name).map(pass).unwrap_or_default()).collect()
}

fn cells() -> usize {
    ((RANGE_NM[1] - RANGE_NM[0]) / STEP_NM).round() as usize
}

fn center(cell: usize) -> f64 {
    RANGE_NM[0] + STEP_NM * (cell as f64 + 0.5)
}

/// Largest yield at emission wavelengths below the excitation.
fn below_the_diagonal(fluorophore: &Fluorophore) -> f64 {
    let pairs = (0..cells()).flat_map(|row| (row + 1..cells()).map(move |column| (row, column)));
    pairs.map(|(row, column)| fluorophore.eem.at(center(row), center(column))).fold(0.0, f64::max)
}

fn emission_figure(sample: &FlatSample, names: &[&str], radiance: &BTreeMap<String, Vec<f64>>) -> Figure {
    let nm = sample.grid.centers_nm();
    let curve =
        |name: &&str| PlotCurve::new(*name, nm.clone(), radiance.get(*name).cloned().unwrap_or_default());
    let curves: Vec<PlotCurve> = names.iter().map(curve).collect();
    let filter = sample.camera.view_filter.transmittance.bin_averages(&sample.grid);
    let half = 0.5 * filter.iter().copied().fold(0.0, f64::max);
    let passing = || nm.iter().zip(&filter).filter(|(_, t)| **t >= half).map(|(nm, _)| *nm);
    let band = passing().next().zip(passing().next_back()).map(|(first, last)| [first, last]);
    emission(
        &curves,
        "the 385 nm LED",
        "each at concentration 1",
        ["spectral radiance", "W/(sr m² nm)"],
        band,
    )
}
