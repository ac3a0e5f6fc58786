//! Radial profiles against photons traced at one wavelength.

use std::sync::atomic::AtomicBool;

use super::monte_carlo::{
    MonteCarloControl, MonteCarloSettings, Ring, ScoringGrid, simulate, simulate_fluorescence,
};
use super::radial_mixture::density_per_mm2;
use super::radial_profile::{RadialProfile, radial_profiles};
use super::site_tests::{any, lip, tongue, tooth};
use super::{Incidence, LayeredTissue, Site};

/// Radii between which light is compared, mm, and their ratio.
const RADII_MM: [f64; 2] = [0.1, 3.0];
const RATIO: f64 = 1.4;

fn layers(site: &Site) -> LayeredTissue {
    site.tissue(&any).unwrap()
}

/// Light within rings wide enough to count, relative to all that leaves: inner and outer radius, share, standard error.
fn wide_rings(rings: &[Ring], total: f64) -> Vec<([f64; 2], f64, f64)> {
    let mut wide = Vec::new();
    let mut inner = RADII_MM[0];
    while inner * RATIO <= RADII_MM[1] {
        let outer = inner * RATIO;
        let inside =
            rings.iter().filter(|ring| ring.radii_mm[0] >= inner - 1e-9 && ring.radii_mm[1] <= outer + 1e-9);
        let (mut share, mut variance) = (0.0, 0.0);
        let mut edges = [f64::INFINITY, 0.0_f64];
        for ring in inside {
            let [from, to] = ring.radii_mm;
            let area = std::f64::consts::PI * (to * to - from * from);
            share += area * ring.exitance_per_mm2.mean / total;
            variance += (area * ring.exitance_per_mm2.standard_error / total).powi(2);
            edges = [edges[0].min(from), edges[1].max(to)];
        }
        wide.push((edges, share, variance.sqrt()));
        inner = outer;
    }
    wide
}

/// Share of a profile's light between two radii.
fn between(profile: &RadialProfile, nm: f64, [inner, outer]: [f64; 2]) -> f64 {
    const STEPS: usize = 64;
    let shares = profile.at(nm);
    let width = (outer - inner) / STEPS as f64;
    let at = |step: usize| {
        let radius = inner + (step as f64 + 0.5) * width;
        2.0 * std::f64::consts::PI * radius * density_per_mm2(&shares, radius) * width
    };
    (0..STEPS).map(at).sum()
}

fn settings(photons: u64) -> MonteCarloSettings {
    let grid = ScoringGrid { radial_step_mm: 0.01, radial_bins: 2000, ..ScoringGrid::default() };
    MonteCarloSettings { photons, grid, seed: 3, ..MonteCarloSettings::default() }
}

/// Rings where a profile is off by more than `tolerance` and four standard errors, both of rings that hold what they hold.
fn faults(
    profile: &RadialProfile,
    nm: f64,
    rings: &[Ring],
    total: f64,
    tolerance: f64,
    place: &str,
) -> Vec<String> {
    let mut faults = Vec::new();
    for (edges, share, error) in wide_rings(rings, total) {
        let found = between(profile, nm, edges);
        if (found - share).abs() > tolerance * share + 4.0 * error {
            faults.push(format!(
                "{place}, {edges:.2?} mm: {found:.5} for {share:.5} (standard error {error:.5})"
            ));
        }
    }
    faults
}

/// With many photons, so that what is left is what the method gets wrong; the rings of the thick epithelium of a lip have a step that
/// mixtures of Gaussians round off.
#[test]
fn profiles_are_those_of_photons_traced_at_one_wavelength() {
    let control = MonteCarloControl { stop: &AtomicBool::new(false), progress: &|_| () };
    let mut wrong = Vec::new();
    for (name, site, tolerance) in
        [("tongue", tongue(), 0.03), ("lip", lip(), 0.08), ("tooth", tooth(), 0.03)]
    {
        let tissue = layers(&site);
        let profiles = radial_profiles(std::slice::from_ref(&tissue), 65_536);
        for nm in [450.0, 630.0] {
            let result =
                simulate(&tissue.optics(nm), Incidence::NORMAL, &settings(100_000), &control).unwrap();
            let (reflected, total) = (&profiles[0].reflected, result.diffuse_reflectance.mean);
            let place = format!("{name}, {nm} nm");
            wrong.extend(faults(reflected, nm, &result.reflected_rings, total, tolerance, &place));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn profiles_of_fluorescence_are_those_of_photons_traced() {
    let control = MonteCarloControl { stop: &AtomicBool::new(false), progress: &|_| () };
    let mut wrong = Vec::new();
    for (site, fluorophore) in [(tongue(), "collagen"), (tooth(), "dentin")] {
        let mut tissue = layers(&site);
        for layer in &mut tissue.layers {
            layer.fluorophores.retain(|held| held.fluorophore.name == fluorophore);
        }
        let profiles = radial_profiles(std::slice::from_ref(&tissue), 65_536);
        let (excitation_nm, emission_nm) = (385.0, 520.0);
        let strengths = tissue.strengths_per_mm_nm(excitation_nm, emission_nm);
        let [excitation, emission] = [excitation_nm, emission_nm].map(|nm| tissue.optics(nm));
        let (beam, settings) = (Incidence::NORMAL, settings(300_000));
        let result =
            simulate_fluorescence(&excitation, &emission, &strengths, beam, &settings, &control).unwrap();
        let profile = &profiles[0].fluorescence[0].1[0];
        wrong.extend(faults(profile, emission_nm, &result.rings, result.upward.mean, 0.05, fluorophore));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
