//! Layered media with known reflectance, transmittance and fluorescence, for both test programs of light in tissue.
//!
//! Where no other source is named, the values were computed by adding-doubling with 64 to 144 nodes a hemisphere, and are good to
//! the digits printed. They agree with the published ones of MCML's manual (Wang and Jacques 1992, tables 6.1, 6.2 and 6.7).
#![allow(clippy::unwrap_used)]

use std::sync::atomic::AtomicBool;

use fluorspar::tissue::monte_carlo::{
    Estimate, FluorescenceResult, MonteCarloControl, MonteCarloResult, MonteCarloSettings,
    ReciprocalFluorescence, ScoringGrid, fluorescence_by_reciprocity, simulate, simulate_fluorescence,
};
use fluorspar::tissue::{Incidence, OpticalLayer, OpticalStack};

pub(crate) const NORMAL: Incidence = Incidence::NORMAL;
pub(crate) const LAMBERTIAN: Incidence = Incidence::Lambertian;

/// Layers as papers give them, between air: refractive index, absorption and scattering in 1/cm, anisotropy, thickness in cm.
pub(crate) fn stack_of_cm(layers: &[[f64; 5]]) -> OpticalStack {
    let layer =
        |&[refractive_index, absorption, scattering, anisotropy, thickness]: &[f64; 5]| OpticalLayer {
            thickness_mm: 10.0 * thickness,
            absorption_per_mm: 0.1 * absorption,
            scattering_per_mm: 0.1 * scattering,
            anisotropy,
            refractive_index,
        };
    OpticalStack { layers: layers.iter().map(layer).collect(), index_above: 1.0, index_below: 1.0 }
}

/// Reflectance and transmittance, specular reflectance apart.
pub(crate) struct Reflecting {
    pub(crate) name: &'static str,
    pub(crate) stack: OpticalStack,
    pub(crate) incidence: Incidence,
    pub(crate) reflectance: f64,
    /// Zero for half-spaces.
    pub(crate) transmittance: f64,
}

/// B1 (van de Hulst 1980), B2 (Giovanelli 1955; the published .26 contains specular .04), B3 (Gardner 1992).
pub(crate) fn reflecting() -> Vec<Reflecting> {
    let slab = || stack_of_cm(&[[1.0, 10.0, 90.0, 0.75, 0.02]]);
    let half_space = || stack_of_cm(&[[1.5, 10.0, 90.0, 0.0, 100.0]]);
    let layers = || {
        stack_of_cm(&[[1.37, 1.0, 100.0, 0.9, 0.1], [1.37, 1.0, 10.0, 0.0, 0.1], [1.37, 2.0, 10.0, 0.7, 0.2]])
    };
    let case = |name, stack, incidence, reflectance, transmittance| Reflecting {
        name,
        stack,
        incidence,
        reflectance,
        transmittance,
    };
    vec![
        case("B1", slab(), NORMAL, 0.097_395, 0.660_958),
        case("B1 Lambertian", slab(), LAMBERTIAN, 0.191_090, 0.501_816),
        case("B2", half_space(), NORMAL, 0.219_919, 0.0),
        case("B2 Lambertian", half_space(), LAMBERTIAN, 0.216_113, 0.0),
        case("B3", layers(), NORMAL, 0.237_857, 0.096_048),
        case("B3 Lambertian", layers(), LAMBERTIAN, 0.243_71, 0.084_05),
    ]
}

/// B5: half-spaces with isotropic scattering and matched index. Albedo, reflectance at normal incidence `1 - sqrt(1 - a) H(1)`
/// (Chandrasekhar 1950) and under Lambertian light.
pub(crate) const CHANDRASEKHAR: [[f64; 3]; 6] = [
    [0.5, 0.115_226, 0.146_544],
    [0.8, 0.285_255, 0.341_867],
    [0.9, 0.414_947, 0.478_024],
    [0.95, 0.535_541, 0.596_669],
    [0.99, 0.752_721, 0.794_564],
    [0.999, 0.912_845, 0.929_713],
];

/// A half-space of extinction 1/mm that scatters isotropically.
pub(crate) fn isotropic_half_space(albedo: f64) -> OpticalStack {
    stack_of_cm(&[[1.0, 10.0 * (1.0 - albedo), 10.0 * albedo, 0.0, 1000.0]])
}

/// Fluorescence that leaves upward, in photons per incident photon.
pub(crate) struct Fluorescing {
    pub(crate) name: &'static str,
    pub(crate) excitation: OpticalStack,
    pub(crate) emission: OpticalStack,
    pub(crate) strengths_per_mm: Vec<f64>,
    /// Depth that holds all but 1e-6 of the emission.
    pub(crate) depth_mm: f64,
    /// At normal incidence and under Lambertian light.
    pub(crate) upward: [f64; 2],
}

/// F1 (closed form: exponential integrals), F2, F3, F4.
pub(crate) fn fluorescing() -> Vec<Fluorescing> {
    let case = |name, excitation: &[[f64; 5]], emission: &[[f64; 5]], strengths: &[f64], depth_mm, upward| {
        Fluorescing {
            name,
            excitation: stack_of_cm(excitation),
            emission: stack_of_cm(emission),
            strengths_per_mm: strengths.iter().map(|per_cm| 0.1 * per_cm).collect(),
            depth_mm,
            upward,
        }
    };
    vec![
        case(
            "F1",
            &[[1.0, 5.0, 0.0, 0.0, 0.1]],
            &[[1.0, 2.0, 0.0, 0.0, 0.1]],
            &[1.0],
            1.0,
            [0.029_774_7, 0.043_222_4],
        ),
        case(
            "F2",
            &[[1.0, 1.0, 9.0, 0.0, 100.0]],
            &[[1.0, 0.5, 9.5, 0.0, 100.0]],
            &[0.2],
            20.0,
            [0.048_237_3, 0.047_457_9],
        ),
        case(
            "F3",
            &[[1.4, 2.0, 100.0, 0.9, 0.2]],
            &[[1.4, 0.5, 80.0, 0.9, 0.2]],
            &[1.0],
            2.0,
            [0.124_530, 0.119_921],
        ),
        case(
            "F4",
            &[[1.4, 3.0, 55.0, 0.97, 0.02], [1.4, 6.22, 267.0, 0.88, 0.03], [1.4, 6.22, 267.0, 0.88, 0.1]],
            &[[1.4, 1.5, 40.0, 0.97, 0.02], [1.4, 2.0, 200.0, 0.88, 0.03], [1.4, 2.0, 200.0, 0.88, 0.1]],
            &[0.0, 1.0, 0.0],
            1.5,
            [0.020_710_3, 0.020_270_9],
        ),
    ]
}

/// A tongue at 405 nm, seen at 635 nm: keratin, epithelium, superficial and deep stroma, with fluorophores in each.
pub(crate) fn tongue() -> Fluorescing {
    let excitation = [
        [1.4, 1.75, 182.8, 0.97, 0.004],
        [1.4, 1.75, 59.15, 0.97, 0.016],
        [1.4, 4.58, 241.0, 0.88, 0.03],
        [1.4, 25.5, 241.0, 0.88, 0.1],
    ];
    let emission = [
        [1.4, 0.26, 74.4, 0.97, 0.004],
        [1.4, 0.26, 24.06, 0.97, 0.016],
        [1.4, 0.27, 140.0, 0.88, 0.03],
        [1.4, 0.72, 140.0, 0.88, 0.1],
    ];
    Fluorescing {
        name: "four-layer tongue",
        excitation: stack_of_cm(&excitation),
        emission: stack_of_cm(&emission),
        strengths_per_mm: vec![0.05, 0.01, 0.04, 0.03],
        depth_mm: 1.5,
        upward: [f64::NAN; 2],
    }
}

/// Seed and photons; bins for the whole depth of a fluorescing medium.
pub(crate) fn settings(seed: u64, photons: u64, depth_mm: f64) -> MonteCarloSettings {
    let depth_step_mm = depth_mm / 400.0;
    let grid = ScoringGrid { depth_step_mm, depth_limit_mm: depth_mm, radial_step_mm: 0.05, radial_bins: 20 };
    MonteCarloSettings { seed, photons, target: None, grid }
}

/// Runs to the end.
pub(crate) fn uninterrupted<R>(job: impl FnOnce(&MonteCarloControl<'_>) -> R) -> R {
    job(&MonteCarloControl { stop: &AtomicBool::new(false), progress: &|_| () })
}

pub(crate) fn reflect(
    stack: &OpticalStack,
    incidence: Incidence,
    settings: &MonteCarloSettings,
) -> MonteCarloResult {
    uninterrupted(|control| simulate(stack, incidence, settings, control).unwrap())
}

impl Fluorescing {
    pub(crate) fn forward(&self, incidence: Incidence, seed: u64, photons: u64) -> FluorescenceResult {
        let settings = settings(seed, photons, self.depth_mm);
        let Self { excitation, emission, strengths_per_mm, .. } = self;
        uninterrupted(|control| {
            simulate_fluorescence(excitation, emission, strengths_per_mm, incidence, &settings, control)
                .unwrap()
        })
    }

    pub(crate) fn reciprocal(&self, incidence: Incidence, seed: u64, photons: u64) -> ReciprocalFluorescence {
        let excitation = reflect(&self.excitation, incidence, &settings(seed, photons, self.depth_mm));
        let emission = reflect(&self.emission, LAMBERTIAN, &settings(seed + 1, photons, self.depth_mm));
        fluorescence_by_reciprocity(&excitation, &emission, &self.strengths_per_mm).unwrap()
    }
}

/// Holds an estimate to a value that is good to its last printed digit: within three standard errors, which must be at most
/// `relative_error` of the value.
#[track_caller]
pub(crate) fn assert_agrees(what: &str, estimate: Estimate, value: f64, relative_error: f64) {
    let Estimate { mean, standard_error } = estimate;
    let z = (mean - value) / standard_error;
    assert!(z.abs() < 3.0, "{what}: {mean} is {z:.2} standard errors of {standard_error} from {value}");
    assert!(estimate.relative_error() <= relative_error, "{what}: standard error {standard_error} of {mean}");
}
