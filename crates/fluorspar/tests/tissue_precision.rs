//! Monte Carlo of layered tissue at standard errors of at most 0.1 %: some minutes on two cores. By hand:
//! `cargo test -p fluorspar --test tissue_precision`.

#[expect(dead_code, reason = "the light tests use the rest")]
mod tissue_benchmarks;

use tissue_benchmarks::{
    CHANDRASEKHAR, LAMBERTIAN, NORMAL, assert_agrees, fluorescing, isotropic_half_space, reflect, reflecting,
    settings, tongue,
};

/// Largest relative standard error.
const LARGEST_ERROR: f64 = 1e-3;

#[test]
fn reflectance_and_transmittance() {
    for (case, photons) in reflecting().iter().zip([8e6, 4e6, 2.2e6, 2.2e6, 5.5e6, 5.5e6]) {
        let result = reflect(&case.stack, case.incidence, &settings(101, photons as u64, 2.0));
        assert_agrees(case.name, result.diffuse_reflectance, case.reflectance, LARGEST_ERROR);
        if case.transmittance > 0.0 {
            assert_agrees(case.name, result.transmittance, case.transmittance, LARGEST_ERROR);
        }
    }
}

#[test]
fn half_spaces_of_chandrasekhar() {
    for ([albedo, normal, lambertian], photons) in
        CHANDRASEKHAR.into_iter().zip([6e6, 3e6, 2e6, 1e6, 5e5, 1e5])
    {
        for (incidence, reflectance) in [(NORMAL, normal), (LAMBERTIAN, lambertian)] {
            let asked = settings(102, photons as u64, 20.0);
            let result = reflect(&isotropic_half_space(albedo), incidence, &asked);
            assert_agrees(
                &format!("albedo {albedo}"),
                result.diffuse_reflectance,
                reflectance,
                LARGEST_ERROR,
            );
        }
    }
}

#[test]
fn fluorescence_forward() {
    for (case, photons) in fluorescing().iter().zip([8e6, 1.6e6, 1.6e6, 2e6]) {
        for (place, incidence) in [NORMAL, LAMBERTIAN].into_iter().enumerate() {
            let forward = case.forward(incidence, 103, photons as u64);
            assert_agrees(case.name, forward.upward, case.upward[place], LARGEST_ERROR);
        }
    }
}

#[test]
fn fluorescence_by_reciprocity() {
    for (case, photons) in fluorescing().iter().zip([5e6, 1e6, 8e5, 9e5]) {
        for (place, incidence) in [NORMAL, LAMBERTIAN].into_iter().enumerate() {
            let reciprocal = case.reciprocal(incidence, 105, photons as u64);
            assert_agrees(case.name, reciprocal.upward, case.upward[place], LARGEST_ERROR);
        }
    }
}

#[test]
fn forward_equals_reciprocity_in_a_tongue() {
    let tongue = tongue();
    let forward = tongue.forward(NORMAL, 107, 4_000_000);
    let reciprocal = tongue.reciprocal(NORMAL, 108, 1_000_000);
    let pairs = forward.upward_by_layer.iter().zip(&reciprocal.upward_by_layer);
    for (layer, (a, b)) in pairs.chain([(&forward.upward, &reciprocal.upward)]).enumerate() {
        let standard_error = a.standard_error.hypot(b.standard_error);
        assert!((a.mean - b.mean).abs() < 3.0 * standard_error, "layer {layer}: {a:?} {b:?}");
    }
    assert!(forward.upward.relative_error() < LARGEST_ERROR, "{:?}", forward.upward);
    assert!(reciprocal.upward.relative_error() < LARGEST_ERROR, "{:?}", reciprocal.upward);
}
