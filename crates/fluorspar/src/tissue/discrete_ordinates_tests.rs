//! The deterministic solver against published and independent values.
//!
//! B1 to B5 and F1 to F4 are media of van de Hulst (1980), Giovanelli (1955), Gardner et al. (1996), Chandrasekhar (1960) and
//! a three-layer mucosa; the digits are of an adding-doubling program with 64 to 144 nodes, which a Monte Carlo program
//! confirmed within its standard errors. Coefficients here are in 1/mm: a tenth of those in 1/cm.
#![allow(clippy::unwrap_used)]

use super::angular_quadrature::gauss_legendre;
use super::*;

const NORMAL: Incidence = Incidence::Collimated { cosine: 1.0 };
const TEST: (DiscreteOrdinates, f64) = (DiscreteOrdinates::PRECISE, 1e-4);
const WORKING: (DiscreteOrdinates, f64) = (DiscreteOrdinates::WORKING, 3e-4);

/// A layer from refractive index, absorption and scattering in 1/cm, anisotropy, thickness in cm.
fn layer([n, absorption, scattering, anisotropy, cm]: [f64; 5]) -> OpticalLayer {
    OpticalLayer {
        thickness_mm: 10.0 * cm,
        absorption_per_mm: 0.1 * absorption,
        scattering_per_mm: 0.1 * scattering,
        anisotropy,
        refractive_index: n,
    }
}

/// Layers with air above and air below.
fn in_air(layers: &[[f64; 5]]) -> OpticalStack {
    OpticalStack { layers: layers.iter().copied().map(layer).collect(), index_above: 1.0, index_below: 1.0 }
}

/// A layer of 100 cm on a medium of its own index.
fn half_space(n: f64, absorption: f64, scattering: f64) -> OpticalStack {
    let mut stack = in_air(&[[n, absorption, scattering, 0.0, 100.0]]);
    stack.index_below = n;
    stack
}

fn close(what: &str, got: f64, want: f64, relative: f64, digits: i32) {
    let tolerance = relative * want.abs() + 0.51 * 10f64.powi(-digits);
    assert!((got - want).abs() <= tolerance, "{what}: {got} is not {want} within {tolerance}");
}

/// `integral phi_x phi_m dz / (4 n^2)` over a layer, with absorption times quantum yield 1/cm: light of `x` that leaves above
/// as light of `m`.
fn fluorescence(excitation: &LightField, emission: &LightField, layer: usize, mm: f64, n: f64) -> f64 {
    let panels = [0.0, 0.02, 0.06, 0.15, 0.3, 0.5, 1.0].map(|edge| edge * mm);
    let sum: f64 = panels
        .windows(2)
        .flat_map(|p| gauss_legendre(8, p[1] - p[0]).into_iter().map(move |(z, w)| (p[0] + z, w)))
        .map(|(z, w)| w * excitation.layer_fluence(layer, z) * emission.layer_fluence(layer, z))
        .sum();
    0.1 * sum / (4.0 * n * n)
}

/// Solves with air above.
fn solve(stack: &OpticalStack, incidence: Incidence) -> LightField {
    DiscreteOrdinates::WORKING.solve(stack, incidence).unwrap()
}

/// Four layers: keratin, epithelium, stroma with little blood, stroma with blood.
fn tongue() -> OpticalStack {
    in_air(&[
        [1.4, 1.75, 180.0, 0.97, 0.004],
        [1.4, 1.75, 59.0, 0.97, 0.016],
        [1.4, 4.58, 241.0, 0.88, 0.03],
        [1.4, 25.5, 241.0, 0.88, 0.5],
    ])
}

#[test]
fn b1_slab_of_van_de_hulst() {
    let stack = in_air(&[[1.0, 10.0, 90.0, 0.75, 0.02]]);
    for (solver, tolerance) in [TEST, WORKING] {
        let [normal, diffuse] = [NORMAL, Incidence::Lambertian].map(|i| solver.solve(&stack, i).unwrap());
        close("R", normal.reflectance, 0.097_395, tolerance, 6);
        close("T", normal.transmittance, 0.660_958, tolerance, 6);
        close("diffuse R", diffuse.reflectance, 0.191_090, tolerance, 6);
        close("diffuse T", diffuse.transmittance, 0.501_816, tolerance, 6);
    }
}

#[test]
fn b2_half_space_of_giovanelli() {
    for (solver, tolerance) in [TEST, WORKING] {
        let stack = half_space(1.5, 10.0, 90.0);
        let [normal, diffuse] = [NORMAL, Incidence::Lambertian].map(|i| solver.solve(&stack, i).unwrap());
        close("R", normal.reflectance, 0.219_919, tolerance, 6);
        close("specular", normal.specular_reflectance, 0.04, 1e-12, 12);
        close("diffuse R", diffuse.reflectance, 0.216_113, tolerance, 6);
    }
}

#[test]
fn b3_three_layers_of_gardner() {
    let layers = [[1.37, 1.0, 100.0, 0.9, 0.1], [1.37, 1.0, 10.0, 0.0, 0.1], [1.37, 2.0, 10.0, 0.7, 0.2]];
    for (solver, tolerance) in [TEST, WORKING] {
        let [normal, diffuse] =
            [NORMAL, Incidence::Lambertian].map(|i| solver.solve(&in_air(&layers), i).unwrap());
        close("R", normal.reflectance, 0.237_857, tolerance, 6);
        close("T", normal.transmittance, 0.096_048, tolerance, 6);
        close("diffuse R", diffuse.reflectance, 0.243_71, tolerance, 5);
        close("diffuse T", diffuse.transmittance, 0.084_05, tolerance, 5);
        // Absorption by layer of MCML's sample run, 1e6 photons: a standard error below 1e-3.
        for (got, want) in normal.absorbed.iter().zip([0.2612, 0.1488, 0.2316]) {
            close("absorbed", *got, want, 4e-3, 4);
        }
    }
}

#[test]
fn b4_fluence_decays_as_in_the_asymptotic_regime() {
    // The decay length of MCML's manual is 1.73 to 1.74 / cm with g = 0.9; far inside it does not depend on the surface.
    for n in [1.0, 1.37] {
        let stack = OpticalStack {
            layers: vec![layer([n, 0.1, 100.0, 0.9, 20.0])],
            index_above: 1.0,
            index_below: n,
        };
        let field = DiscreteOrdinates::WORKING.solve(&stack, NORMAL).unwrap();
        let decay_per_cm = (field.fluence(20.0) / field.fluence(30.0)).ln();
        close("decay", decay_per_cm, 1.735, 5e-3, 3);
    }
}

#[test]
fn b5_half_space_of_chandrasekhar() {
    let known = [
        (0.5, 0.115_226, 0.146_544),
        (0.8, 0.285_255, 0.341_867),
        (0.9, 0.414_947, 0.478_024),
        (0.95, 0.535_541, 0.596_669),
        (0.99, 0.752_721, 0.794_564),
        (0.999, 0.912_845, 0.929_713),
    ];
    for (albedo, normal, diffuse) in known {
        let stack = half_space(1.0, 100.0 * (1.0 - albedo), 100.0 * albedo);
        let got = |i| DiscreteOrdinates::WORKING.solve(&stack, i).unwrap().reflectance;
        close("R", got(NORMAL), normal, 1e-4, 6);
        close("diffuse R", got(Incidence::Lambertian), diffuse, 1e-4, 6);
    }
}

#[test]
fn f1_absorbing_slab() {
    let stack = |absorption| in_air(&[[1.0, absorption, 0.0, 0.0, 0.1]]);
    for (solver, tolerance) in [TEST, WORKING] {
        let emission = solver.solve(&stack(2.0), Incidence::Lambertian).unwrap();
        let excited = |i| {
            let excitation = solver.solve(&stack(5.0), i).unwrap();
            fluorescence(&excitation, &emission, 0, 1.0, 1.0)
        };
        close("normal", excited(NORMAL), 0.029_774_7, tolerance, 7);
        close("diffuse", excited(Incidence::Lambertian), 0.043_222_4, tolerance, 7);
    }
}

#[test]
fn f2_half_space() {
    for (solver, tolerance) in [TEST, WORKING] {
        let emission = solver.solve(&half_space(1.0, 0.5, 9.5), Incidence::Lambertian).unwrap();
        let excited = |i| {
            let excitation = solver.solve(&half_space(1.0, 1.0, 9.0), i).unwrap();
            0.2 * fluorescence(&excitation, &emission, 0, 100.0, 1.0)
        };
        close("normal", excited(NORMAL), 0.048_237_3, tolerance, 7);
        close("diffuse", excited(Incidence::Lambertian), 0.047_457_9, tolerance, 7);
    }
}

#[test]
fn f3_scattering_slab() {
    let stack = |absorption, scattering| in_air(&[[1.4, absorption, scattering, 0.9, 0.2]]);
    for (solver, tolerance) in [TEST, WORKING] {
        let emission = solver.solve(&stack(0.5, 80.0), Incidence::Lambertian).unwrap();
        // The emitter's own absorption of 1 / cm is part of the 2 / cm.
        for (incidence, want) in [(NORMAL, 0.124_530), (Incidence::Lambertian, 0.119_921)] {
            let excitation = solver.solve(&stack(2.0, 100.0), incidence).unwrap();
            let f = fluorescence(&excitation, &emission, 0, 2.0, 1.4);
            close("F", f, want, tolerance, 6);
            if incidence == NORMAL {
                close("R", excitation.reflectance, 0.161_345, tolerance, 6);
            }
        }
    }
}

#[test]
fn f4_three_layers_of_mucosa() {
    let layers = |epithelium: [f64; 3], stroma: [f64; 3]| {
        let all = [(epithelium, 0.02), (stroma, 0.03), (stroma, 0.1)];
        in_air(&all.map(|([a, s, g], cm)| [1.4, a, s, g, cm]))
    };
    let excitation_stack = layers([3.0, 55.0, 0.97], [6.22, 267.0, 0.88]);
    let emission_stack = layers([1.5, 40.0, 0.97], [2.0, 200.0, 0.88]);
    let solve = |stack, incidence| DiscreteOrdinates::PRECISE.solve(stack, incidence).unwrap();
    let emission = solve(&emission_stack, Incidence::Lambertian);
    let normal = solve(&excitation_stack, NORMAL);
    let diffuse = solve(&excitation_stack, Incidence::Lambertian);
    close("normal F", fluorescence(&normal, &emission, 1, 0.3, 1.4), 0.020_710_3, 1e-4, 7);
    close("diffuse F", fluorescence(&diffuse, &emission, 1, 0.3, 1.4), 0.020_270_9, 1e-4, 7);
    close("R of excitation", normal.reflectance, 0.135_711, 1e-4, 6);
    close("R of emission", solve(&emission_stack, NORMAL).reflectance, 0.246_597, 1e-4, 6);
    for (mm, want) in [(0.0, 1.9327), (0.2, 1.9507), (0.5, 1.4812)] {
        close("fluence", normal.fluence(mm), want, 1e-4, 4);
    }
}

#[test]
fn photons_are_conserved_and_absorbed_where_the_light_is() {
    let mut tilted = tongue();
    tilted.layers[2].absorption_per_mm = 0.0;
    tilted.layers.truncate(3);
    for incidence in [NORMAL, Incidence::Lambertian, Incidence::Collimated { cosine: 0.4 }] {
        let field = solve(&tilted, incidence);
        let sum = field.specular_reflectance
            + field.reflectance
            + field.transmittance
            + field.absorbed.iter().sum::<f64>();
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        for (i, layer) in tilted.layers.iter().enumerate() {
            let nodes = gauss_legendre(12, layer.thickness_mm);
            let fluence: f64 = nodes.iter().map(|(z, w)| w * field.layer_fluence(i, *z)).sum();
            // The quadrature over the depth follows the grazing light near the surface to 1e-5.
            close("absorbed", field.absorbed[i], layer.absorption_per_mm * fluence, 2e-5, 9);
        }
    }
}

#[test]
fn reflection_is_reciprocal() {
    // Light that comes in under one angle and leaves anywhere is as much as diffuse light that leaves under that angle. The
    // beam is not one of the ordinates: the tolerance is the error of 32 of them with g = 0.97.
    let diffuse = solve(&tongue(), Incidence::Lambertian);
    for cosine in [1.0, 0.8, 0.5, 0.2] {
        let collimated = solve(&tongue(), Incidence::Collimated { cosine });
        let reciprocal = std::f64::consts::PI * diffuse.radiance_above(cosine);
        close("R", collimated.reflectance, reciprocal, 4e-4, 12);
    }
}

#[test]
fn splitting_a_layer_changes_nothing() {
    let whole = tongue();
    let mut split = whole.clone();
    for (i, share) in [(3, 0.02), (2, 0.7), (0, 0.5)] {
        let mm = split.layers[i].thickness_mm;
        split.layers.insert(i, OpticalLayer { thickness_mm: share * mm, ..split.layers[i] });
        split.layers[i + 1].thickness_mm = (1.0 - share) * mm;
    }
    for incidence in [NORMAL, Incidence::Lambertian] {
        let [a, b] = [&whole, &split].map(|stack| solve(stack, incidence));
        close("R", a.reflectance, b.reflectance, 1e-11, 14);
        for mm in [0.0, 0.03, 0.21, 0.6, 3.0] {
            close("fluence", a.fluence(mm), b.fluence(mm), 1e-10, 14);
        }
    }
}

#[test]
fn a_layer_of_its_own_index_under_glass() {
    // Photons are conserved through interfaces, and light that a clear plate passes is that of Fresnel's equations.
    let mut stack = tongue();
    stack.layers[0] = layer([1.5, 0.0, 0.0, 0.0, 0.1]);
    stack.layers[2].refractive_index = 1.35;
    stack.index_below = 1.45;
    for incidence in [NORMAL, Incidence::Lambertian, Incidence::Collimated { cosine: 0.3 }] {
        let field = solve(&stack, incidence);
        let inside: f64 = field.absorbed.iter().sum();
        let sum = field.specular_reflectance + field.reflectance + field.transmittance + inside;
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        assert!(field.absorbed[0].abs() < 1e-9, "{:?}", field.absorbed);
    }
    let clear = in_air(&[[1.5, 0.0, 0.0, 0.0, 0.1]]);
    let plate = solve(&clear, NORMAL);
    close("T", plate.transmittance, 0.96 / 1.04, 1e-9, 12);
    close("R", plate.reflectance + plate.specular_reflectance, 0.08 / 1.04, 1e-9, 12);
    // Its diffuse transmittance: integral 2 mu (1 - r) / (1 + r) dmu.
    let expected: f64 = gauss_legendre(64, 1.0)
        .into_iter()
        .map(|(mu, w)| {
            let r = fresnel_reflectance(mu, 1.0, 1.5);
            2.0 * mu * w * (1.0 - r) / (1.0 + r)
        })
        .sum();
    close("diffuse T", solve(&clear, Incidence::Lambertian).transmittance, expected, 1e-6, 9);
}

#[test]
fn indices_that_hardly_differ_change_hardly_anything() {
    let mut stack = tongue();
    stack.layers[3].refractive_index = 1.4 + 1e-7;
    for incidence in [NORMAL, Incidence::Lambertian] {
        let [a, b] = [&tongue(), &stack].map(|stack| solve(stack, incidence));
        // Four of the nodes lie between the two indices and are of no use to the others.
        close("R", a.reflectance, b.reflectance, 1e-3, 12);
        close("fluence", a.fluence(1.0), b.fluence(1.0), 1e-3, 12);
    }
}

#[test]
fn bad_settings_are_refused() {
    let said = DiscreteOrdinates::new(4).unwrap_err().to_string();
    assert!(said.contains("nodes_per_hemisphere is 4, outside 8 to 128"), "{said}");
    let grazing = Incidence::Collimated { cosine: 0.0 };
    let said = DiscreteOrdinates::WORKING.solve(&tongue(), grazing).err().unwrap().to_string();
    assert!(said.contains("cosine is 0, outside 0.01 to 1"), "{said}");
}
