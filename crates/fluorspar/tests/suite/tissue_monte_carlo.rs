//! Monte Carlo of layered tissue against published and computed values, at standard errors near 0.3 %. Those at 0.1 % are in
//! `tests/tissue_precision.rs`.
#![allow(clippy::unwrap_used)]

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use fluorspar::tissue::monte_carlo::{
    Ending, Estimate, MonteCarloControl, MonteCarloResult, MonteCarloSettings, Ring, ScoredQuantity,
    ScoringGrid, StandardErrorTarget, fluorescence_by_reciprocity, simulate, simulate_fluorescence,
};
use fluorspar::tissue::{Incidence, OpticalStack, TissueError};

use crate::tissue_benchmarks::{
    CHANDRASEKHAR, LAMBERTIAN, NORMAL, assert_agrees, fluorescing, isotropic_half_space, reflect, reflecting,
    settings, stack_of_cm, tongue, uninterrupted,
};

#[test]
fn reflectance_and_transmittance_of_published_media() {
    for case in reflecting() {
        let photons = if case.name.starts_with("B1") { 1_000_000 } else { 200_000 };
        let result = reflect(&case.stack, case.incidence, &settings(1, photons, 2.0));
        assert_agrees(case.name, result.diffuse_reflectance, case.reflectance, 4e-3);
        if case.transmittance > 0.0 {
            assert_agrees(case.name, result.transmittance, case.transmittance, 6e-3);
        }
    }
}

#[test]
fn unscattered_light_and_specular_reflection_are_told_apart() {
    let slab = reflect(&reflecting()[0].stack, NORMAL, &settings(2, 400_000, 2.0));
    assert_agrees("B1 unscattered", slab.unscattered_transmittance, (-2.0_f64).exp(), 5e-3);
    for (incidence, specular) in [(NORMAL, 0.04), (LAMBERTIAN, 0.091_78)] {
        let half_space = reflect(&reflecting()[2].stack, incidence, &settings(2, 40_000, 2.0));
        let Estimate { mean, standard_error } = half_space.specular_reflectance;
        // The external diffuse reflectance of n = 1.5 is printed to 5e-6.
        assert!((mean - specular).abs() < 3.0 * standard_error + 5e-6, "{mean} {standard_error}");
    }
}

#[test]
fn half_spaces_of_chandrasekhar() {
    for [albedo, normal, lambertian] in CHANDRASEKHAR {
        let photons = if albedo < 0.99 { 100_000 } else { 20_000 };
        for (incidence, reflectance) in [(NORMAL, normal), (LAMBERTIAN, lambertian)] {
            let result = reflect(&isotropic_half_space(albedo), incidence, &settings(3, photons, 20.0));
            assert_agrees(&format!("albedo {albedo}"), result.diffuse_reflectance, reflectance, 8e-3);
        }
    }
}

#[test]
fn deep_fluence_falls_as_transport_theory_says() {
    // B4 of MCML's manual, figure 6.4: fluence falls by 1.74/cm deep in a medium of 0.1 and 100 per cm, g = 0.9. Between 0.5 cm
    // and 1.5 cm, by slices of 0.1 cm: the logarithm of the mean over a slice has the slope of the fluence.
    let stack = stack_of_cm(&[[1.37, 0.1, 100.0, 0.9, 100.0]]);
    let grid = ScoringGrid { depth_step_mm: 1.0, depth_limit_mm: 20.0, radial_step_mm: 1.0, radial_bins: 1 };
    let asked = MonteCarloSettings { seed: 4, photons: 12_000, target: None, grid };
    let result = reflect(&stack, NORMAL, &asked);
    let [upper, lower] = [&result.slices[5], &result.slices[15]].map(|slice| slice.fluence);
    let per_cm = (upper.mean / lower.mean).ln();
    let standard_error = upper.relative_error().hypot(lower.relative_error());
    assert!(standard_error < 0.05, "{standard_error}");
    assert!((per_cm - 1.74).abs() < 3.0 * standard_error + 0.005, "{per_cm} {standard_error}");
}

#[test]
fn fluorescence_of_benchmark_media_forward_and_by_reciprocity() {
    for (case, photons) in fluorescing().iter().zip([400_000, 100_000, 40_000, 40_000]) {
        let forward = case.forward(NORMAL, 5, photons);
        assert_agrees(case.name, forward.upward, case.upward[0], 8e-3);
        let reciprocal = case.reciprocal(LAMBERTIAN, 6, photons);
        assert_agrees(case.name, reciprocal.upward, case.upward[1], 8e-3);
    }
}

#[test]
fn forward_fluorescence_is_reciprocal_for_every_layer_of_a_tongue() {
    let tongue = tongue();
    let forward = tongue.forward(NORMAL, 8, 100_000);
    let reciprocal = tongue.reciprocal(NORMAL, 9, 50_000);
    let layers = forward.upward_by_layer.iter().zip(&reciprocal.upward_by_layer);
    for (layer, (a, b)) in layers.chain([(&forward.upward, &reciprocal.upward)]).enumerate() {
        let standard_error = a.standard_error.hypot(b.standard_error);
        assert!((a.mean - b.mean).abs() < 3.0 * standard_error, "layer {layer}: {a:?} {b:?}");
        assert!(standard_error < 0.03 * b.mean, "layer {layer}: {a:?} {b:?}");
    }
}

#[test]
fn rings_hold_all_light_and_lie_where_it_leaves() {
    let grid = ScoringGrid { radial_step_mm: 10.0, radial_bins: 10, ..ScoringGrid::default() };
    let asked = MonteCarloSettings { photons: 10_000, grid, ..MonteCarloSettings::default() };
    let tongue = tongue();
    let result = uninterrupted(|control| {
        let [x, m] = [&tongue.excitation, &tongue.emission];
        simulate_fluorescence(x, m, &tongue.strengths_per_mm, NORMAL, &asked, control).unwrap()
    });
    let all = |rings: &[Ring]| -> f64 {
        rings.iter().map(|ring| ring.exitance_per_mm2.mean * ring_area(ring.radii_mm)).sum()
    };
    for (rings, total) in [
        (&result.excitation.reflected_rings, result.excitation.diffuse_reflectance),
        (&result.excitation.transmitted_rings, result.excitation.transmittance),
        (&result.rings, result.upward),
    ] {
        assert!((all(rings) / total.mean - 1.0).abs() < 1e-12, "{} {total:?}", all(rings));
    }
}

#[test]
fn a_clear_plate_follows_geometry() {
    // A beam at 60 degrees leaves a plate of n = 1.5 and 1 mm below at tan(asin(sin 60 / 1.5)) = 0.7071 mm, and after each
    // pair of reflections 1.4142 mm farther; it leaves above at 1.4142 mm first.
    let plate = stack_of_cm(&[[1.5, 0.0, 0.0, 0.0, 0.1]]);
    let grid = ScoringGrid { radial_step_mm: 0.1, radial_bins: 50, ..ScoringGrid::default() };
    let asked = MonteCarloSettings { photons: 20_000, grid, ..MonteCarloSettings::default() };
    let result = reflect(&plate, Incidence::Collimated { cosine: 0.5 }, &asked);
    let lit = |rings: &[Ring]| -> Vec<usize> {
        (0..30).filter(|&ring| rings[ring].exitance_per_mm2.mean > 0.0).collect()
    };
    assert_eq!(lit(&result.transmitted_rings), [7, 21]);
    assert_eq!(lit(&result.reflected_rings), [14, 28]);
    // Fresnel at 60 degrees: R = 0.0892; then T = (1 - R)^2 / (1 - R^2).
    let reflectance = result.specular_reflectance.mean;
    assert!((reflectance - 0.0892).abs() < 5e-5, "{reflectance}");
    assert_agrees("plate", result.transmittance, (1.0 - reflectance) / (1.0 + reflectance), 4e-3);
    // What has entered crosses 1 / (1 - R) times on average: a fluence of (1 - R) / (1 - R) / cos.
    let cos = (1.0 - 0.75 / 2.25_f64).sqrt();
    assert_agrees("fluence in the plate", result.slices[0].fluence, 1.0 / cos, 4e-3);
}

fn ring_area([inner, outer]: [f64; 2]) -> f64 {
    std::f64::consts::PI * (outer * outer - inner * inner)
}

/// Enamel on dentin under an angle, a clear layer of saliva above.
fn tooth() -> OpticalStack {
    stack_of_cm(&[[1.33, 0.0, 0.0, 0.0, 0.01], [1.63, 0.5, 60.0, 0.96, 0.05], [1.54, 3.0, 280.0, 0.93, 0.05]])
}

#[test]
fn photons_are_conserved_where_indices_differ() {
    let grid = ScoringGrid { depth_step_mm: 0.05, ..ScoringGrid::default() };
    let asked = MonteCarloSettings { photons: 50_000, grid, ..MonteCarloSettings::default() };
    let result = reflect(&tooth(), Incidence::Collimated { cosine: 0.5 }, &asked);
    let absorbed: f64 = result.absorbed_by_layer.iter().map(|layer| layer.mean).sum();
    let out = [result.specular_reflectance, result.diffuse_reflectance, result.transmittance];
    let sum: f64 = out.iter().map(|share| share.mean).sum::<f64>() + absorbed;
    // Russian roulette keeps the weight on average: at most one packet in two ends by it, with 1e-4 ten times over.
    let roulette = 3.0 * 1e-4 * (10.0 / 50_000.0_f64).sqrt();
    assert!((sum - 1.0).abs() < roulette, "{sum}");
    assert_eq!(result.absorbed_by_layer[0].mean, 0.0);
    // What the layers absorb is their fluence times their absorption.
    for (layer, absorption) in [(1, 0.05), (2, 0.3)] {
        let slices = result.slices.iter().filter(|slice| slice.layer == layer);
        let fluence: f64 = slices.map(|s| s.fluence.mean * (s.depths_mm[1] - s.depths_mm[0])).sum();
        let expected = result.absorbed_by_layer[layer].mean;
        assert!((absorption * fluence / expected - 1.0).abs() < 1e-9, "{fluence} {expected}");
    }
    // In the clear layer the fluence is even: light only crosses it.
    let clear: Vec<f64> = result.slices[..2].iter().map(|slice| slice.fluence.mean).collect();
    assert!((clear[0] / clear[1] - 1.0).abs() < 1e-12, "{clear:?}");
}

#[test]
fn splitting_a_layer_changes_nothing() {
    let whole = reflect(&reflecting()[4].stack, NORMAL, &settings(10, 100_000, 2.0));
    let mut stack = reflecting()[4].stack.clone();
    let mut half = stack.layers[1];
    half.thickness_mm *= 0.5;
    stack.layers[1] = half;
    stack.layers.insert(1, half);
    let split = reflect(&stack, NORMAL, &settings(11, 100_000, 2.0));
    let absorbed = |result: &MonteCarloResult, layers: &[usize]| -> f64 {
        layers.iter().map(|&layer| result.absorbed_by_layer[layer].mean).sum()
    };
    let pairs = [
        (whole.diffuse_reflectance, split.diffuse_reflectance),
        (whole.transmittance, split.transmittance),
        (whole.absorbed_by_layer[2], split.absorbed_by_layer[3]),
    ];
    for (a, b) in pairs {
        assert!((a.mean - b.mean).abs() < 3.0 * a.standard_error.hypot(b.standard_error), "{a:?} {b:?}");
    }
    let difference = absorbed(&whole, &[1]) - absorbed(&split, &[1, 2]);
    assert!(difference.abs() < 3.0 * 1.5 * whole.absorbed_by_layer[1].standard_error, "{difference}");
}

/// All numbers of a result as text: equal only for equal bits.
fn digits(result: &MonteCarloResult) -> String {
    format!("{result:?}")
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let run = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let tongue = tongue();
            let result = tongue.forward(LAMBERTIAN, seed, 5_000);
            format!("{} {:?} {:?}", digits(&result.excitation), result.upward_by_layer, result.rings)
        })
    };
    let alone = run(1, 1);
    assert!(run(2, 1) == alone);
    assert!(run(5, 1) == alone);
    assert!(run(1, 2) != alone);
}

#[test]
fn a_target_of_error_ends_the_simulation() {
    let target = StandardErrorTarget { quantity: ScoredQuantity::Absorbed(2), relative_standard_error: 0.01 };
    let asked = MonteCarloSettings { photons: 10_000_000, target: Some(target), ..settings(12, 1, 2.0) };
    let result = reflect(&reflecting()[4].stack, NORMAL, &asked);
    assert_eq!(result.ending, Ending::Error);
    let error = result.absorbed_by_layer[2].relative_error();
    // Rounds are planned from an error that is itself good to 4 %; photons go with its square.
    assert!((0.008..=0.01).contains(&error), "{error} after {} photons", result.photons);
    let few = MonteCarloSettings { photons: 1000, ..asked };
    let result = reflect(&reflecting()[4].stack, NORMAL, &few);
    assert_eq!((result.ending, result.photons), (Ending::Photons, 1024));
}

#[test]
fn an_interruption_returns_the_complete_rounds() {
    let stop = AtomicBool::new(false);
    let seen = AtomicU64::new(0);
    let control = MonteCarloControl {
        stop: &stop,
        progress: &|progress| {
            assert_eq!(progress.photons_total, 1_000_192);
            seen.fetch_max(progress.photons_done, Ordering::Relaxed);
            stop.store(progress.photons_done > 20_000, Ordering::Relaxed);
        },
    };
    let stack = &reflecting()[0].stack;
    let asked = settings(13, 1_000_000, 2.0);
    let result = simulate(stack, NORMAL, &asked, &control).unwrap();
    assert_eq!(result.ending, Ending::Interrupted);
    assert!(result.photons > 4000 && result.photons < seen.into_inner());
    // The same photons as a simulation that was asked for no more.
    let whole = reflect(stack, NORMAL, &settings(13, result.photons, 2.0));
    assert_eq!(result.diffuse_reflectance, whole.diffuse_reflectance);
    stop.store(true, Ordering::Relaxed);
    let none = MonteCarloControl { stop: &stop, progress: &|_| () };
    assert_eq!(simulate(stack, NORMAL, &asked, &none).unwrap_err(), TissueError::Interrupted);
}

#[test]
fn light_trapped_in_a_clear_layer_is_told() {
    // Fluorescence of a clear slab of n = 1.5 in air: 1 - sqrt(1 - 1/n^2) of each hemisphere escapes after any number of
    // reflections; the rest is guided, and leaves nowhere.
    let excitation = stack_of_cm(&[[1.5, 20.0, 0.0, 0.0, 0.1]]);
    let emission = stack_of_cm(&[[1.5, 0.0, 0.0, 0.0, 0.1]]);
    let result = uninterrupted(|control| {
        simulate_fluorescence(&excitation, &emission, &[2.0], NORMAL, &settings(14, 3_000, 1.0), control)
            .unwrap()
    });
    let absorbed = result.excitation.absorbed_by_layer[0];
    let escaped = result.upward.mean + result.downward.mean;
    let expected = absorbed.mean * (1.0 - (1.0 - 1.0 / 2.25_f64).sqrt());
    // The choice between escape and not: at most the standard deviation of a coin.
    assert!((escaped - expected).abs() < 3.0 * 0.5 / 3_000.0_f64.sqrt(), "{escaped} {expected}");
}

#[test]
fn wrong_input_is_refused_with_its_range() {
    let stack = stack_of_cm(&[[1.4, 1.0, 100.0, 0.9, 0.1]]);
    let refused = |stack: &OpticalStack, incidence, asked: &MonteCarloSettings| {
        uninterrupted(|control| simulate(stack, incidence, asked, control).unwrap_err().to_string())
    };
    let usual = settings(1, 1000, 1.0);
    let target = |quantity, relative_standard_error| MonteCarloSettings {
        target: Some(StandardErrorTarget { quantity, relative_standard_error }),
        ..usual
    };
    let grid = |grid| MonteCarloSettings { grid, ..usual };
    let reflectance = ScoredQuantity::DiffuseReflectance;
    let wrong = [
        (MonteCarloSettings { photons: 0, ..usual }, "photons is 0, outside 1 to 1e13"),
        (target(reflectance, 0.0), "relative_standard_error is 0, outside 1e-5 to 0.5"),
        (target(ScoredQuantity::Absorbed(1), 0.1), "names layer 2, but there are 1"),
        (target(ScoredQuantity::Fluorescence, 0.1), "none is simulated"),
        (
            grid(ScoringGrid { depth_step_mm: -1.0, ..usual.grid }),
            "depth_step_mm is -1, outside 1e-6 to 10000",
        ),
        (grid(ScoringGrid { radial_step_mm: f64::NAN, ..usual.grid }), "radial_step_mm is NaN"),
        (
            grid(ScoringGrid { radial_bins: 1_000_000, ..usual.grid }),
            "bins of depth and radius are more than 50000",
        ),
        (
            grid(ScoringGrid { depth_step_mm: 1e-6, ..usual.grid }),
            "bins of depth and radius are more than 50000",
        ),
    ];
    for (asked, message) in wrong {
        let said = refused(&stack, NORMAL, &asked);
        assert!(said.contains(message), "{said}");
    }
    let said = refused(&stack, Incidence::Collimated { cosine: 0.0 }, &usual);
    assert!(said.contains("cosine is 0, outside 0.01 to 1"), "{said}");
    let mut empty = stack;
    empty.layers.clear();
    assert!(refused(&empty, NORMAL, &usual).contains("at least one layer"));
}

#[test]
fn fluorescence_of_layers_that_do_not_match_is_refused() {
    let stack = stack_of_cm(&[[1.4, 1.0, 100.0, 0.9, 0.1]]);
    let thicker = stack_of_cm(&[[1.4, 1.0, 100.0, 0.9, 0.2]]);
    let asked = settings(1, 1000, 1.0);
    let refused = |emission: &OpticalStack, strengths: &[f64]| {
        uninterrupted(|control| {
            simulate_fluorescence(&stack, emission, strengths, NORMAL, &asked, control)
                .unwrap_err()
                .to_string()
        })
    };
    assert!(refused(&thicker, &[0.1]).contains("the same thicknesses"));
    assert!(refused(&stack, &[]).contains("0 fluorophore strengths for 1 layers"));
    assert!(refused(&stack, &[0.2]).contains("strength_per_mm is 0.2, outside 0 to 0.1"));
    assert!(refused(&stack, &[f64::NAN]).contains("layer 1: fluorophore strength_per_mm is NaN"));

    let [first, same_seed, other] = [(1, 1.0), (1, 1.0), (2, 1.0)]
        .map(|(seed, depth)| reflect(&stack, LAMBERTIAN, &settings(seed, 1000, depth)));
    let slices = reflect(&stack, LAMBERTIAN, &settings(3, 1000, 0.9));
    let normal = reflect(&stack, NORMAL, &settings(4, 1000, 1.0));
    assert!(fluorescence_by_reciprocity(&first, &other, &[0.1]).is_ok());
    for (emission, error) in [
        (&same_seed, TissueError::SameSeed { seed: 1 }),
        (&slices, TissueError::SlicesDiffer),
        (&normal, TissueError::EmissionNotLambertian),
    ] {
        assert_eq!(fluorescence_by_reciprocity(&first, emission, &[0.1]).unwrap_err(), error);
    }
}
