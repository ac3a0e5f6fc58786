//! The two solvers of light in layered tissue against each other, on random stacks.
#![allow(clippy::unwrap_used)]

use fluorspar::sampling::random::Key;
use fluorspar::tissue::monte_carlo::{Estimate, MonteCarloResult, MonteCarloSettings, ScoringGrid};
use fluorspar::tissue::{DiscreteOrdinates, Incidence, LightField, OpticalLayer, OpticalStack};
use fluorspar_testkit::{sidak, z_limit};
use rand::RngExt;

use crate::tissue_benchmarks::reflect;

/// Relative discretization error that the deterministic solver states at this order, with the absolute one of shares that are
/// nearly zero.
const SOLVER: DiscreteOrdinates = DiscreteOrdinates::PRECISE;
const SOLVER_ERROR: f64 = 3e-4;

/// One to four layers with any refractive index, from clear to strongly scattering, under a beam or diffuse light.
fn random_case(seed: u64) -> (OpticalStack, Incidence) {
    let mut rng = Key::new(seed).with_text("random stack").rng();
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let layers = (0..1 + seed % 4)
        .map(|_| OpticalLayer {
            thickness_mm: between(-4.0, 0.0).exp(),
            absorption_per_mm: between(-4.0, 1.0).exp(),
            scattering_per_mm: between(-1.0, 3.0).exp(),
            anisotropy: between(-0.3, 0.95),
            refractive_index: between(1.33, 1.63),
        })
        .collect();
    let stack = OpticalStack { layers, index_above: 1.0, index_below: between(1.0, 1.5) };
    let beam = Incidence::Collimated { cosine: between(0.3, 1.0) };
    (stack, if seed.is_multiple_of(3) { Incidence::Lambertian } else { beam })
}

/// Pairs of an estimate and the deterministic value: what leaves, what is absorbed, fluence of eight slices a layer.
fn pairs(
    photons: &MonteCarloResult,
    field: &LightField,
    stack: &OpticalStack,
) -> Vec<(String, Estimate, f64)> {
    let mut pairs = vec![
        ("specular".to_string(), photons.specular_reflectance, field.specular_reflectance),
        ("reflectance".to_string(), photons.diffuse_reflectance, field.reflectance),
        ("transmittance".to_string(), photons.transmittance, field.transmittance),
    ];
    for (layer, (estimate, value)) in photons.absorbed_by_layer.iter().zip(&field.absorbed).enumerate() {
        pairs.push((format!("absorbed in layer {layer}"), *estimate, *value));
    }
    for slice in &photons.slices {
        let top: f64 = stack.layers[..slice.layer].iter().map(|layer| layer.thickness_mm).sum();
        let [upper, lower] = slice.depths_mm.map(|depth| depth - top);
        let at = |place: f64| field.layer_fluence(slice.layer, upper + place * (lower - upper));
        // Simpson's rule on eight panels: slices are at most some tenths of a decay length wide.
        let weights = [1.0, 4.0, 2.0, 4.0, 2.0, 4.0, 2.0, 4.0, 1.0];
        let mean = weights.iter().enumerate().map(|(k, w)| w * at(k as f64 / 8.0)).sum::<f64>() / 24.0;
        pairs.push((format!("fluence at {:?} mm", slice.depths_mm), slice.fluence, mean));
    }
    pairs
}

#[test]
fn monte_carlo_agrees_with_discrete_ordinates_on_random_stacks() {
    let mut compared = Vec::new();
    for seed in 0..12 {
        let (stack, incidence) = random_case(seed);
        let thinnest = stack.layers.iter().map(|layer| layer.thickness_mm).fold(f64::INFINITY, f64::min);
        let grid = ScoringGrid {
            depth_step_mm: thinnest.max(stack.thickness_mm() / 16.0),
            ..ScoringGrid::default()
        };
        let asked = MonteCarloSettings { seed, photons: 30_000, target: None, grid };
        let photons = reflect(&stack, incidence, &asked);
        let field = SOLVER.solve(&stack, incidence).unwrap();
        for (what, estimate, value) in pairs(&photons, &field, &stack) {
            compared.push((format!("stack {seed}, {what}"), estimate, value));
        }
    }
    let limit = z_limit(sidak(1e-3, compared.len()));
    for (what, Estimate { mean, standard_error }, value) in compared {
        let distance = (mean - value).abs() - SOLVER_ERROR * value.abs() - 1e-6;
        assert!(distance < limit * standard_error, "{what}: {mean} +- {standard_error}, {value}");
    }
}
