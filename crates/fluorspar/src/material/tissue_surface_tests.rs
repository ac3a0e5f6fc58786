//! Layered tissue below its coat against the solver with the surface, by quadrature over directions.

use std::f64::consts::PI;
use std::sync::Arc;

use super::bsdf_tests::{direction, with_bsdf};
use super::{
    Coat, CoatAlbedo, FluorophoreAmount, Lambertian, MIN_ROUGHNESS, Material, ScalarTexture, StateGrid,
    TissueSurface,
};
use crate::spectral::{Curve, Fluorophore, PhotonEem, SeparableTerm, Stokes};
use crate::tissue::{
    Below, Chromophore, DiscreteOrdinates, EffectiveTissue, Incidence, LayerScattering, LayeredTissue, Level,
    ScatteringCoefficient, TissueFluorophore, TissueLayer,
};

/// A fluorophore of two terms.
pub(super) fn dye() -> Arc<Fluorophore> {
    let band = |center: f64| Curve::from_fn(400.0, 700.0, move |nm| (-((nm - center) / 40.0).powi(2)).exp());
    let terms = [(420.0, 520.0), (460.0, 600.0)].map(|(excitation, emission)| SeparableTerm {
        excitation: band(excitation),
        emission: band(emission).scaled(0.01),
    });
    Arc::new(Fluorophore {
        name: "dye".into(),
        title: "A dye".into(),
        eem: PhotonEem::separable(terms.to_vec(), Stokes::Mask),
        excitation_range_nm: (400.0, 700.0),
        emission_range_nm: (400.0, 700.0),
        source: String::new(),
    })
}

/// Two layers, the lower one with the dye, under a surface of refractive index 1.4.
pub(super) fn tissue(absorption_per_mm: f64) -> LayeredTissue {
    let layer = |name: &str, thickness_um, scattering_per_mm, anisotropy| TissueLayer {
        name: name.into(),
        thickness_um,
        scattering: LayerScattering {
            coefficient: ScatteringCoefficient::PowerLaw { scattering_per_mm, at_nm: 500.0, power: 1.0 },
            anisotropy,
        },
        absorption: vec![Chromophore::Background { absorption_per_mm, at_nm: 500.0, slope_per_nm: 0.003 }],
        fluorophores: Vec::new(),
        refractive_index: None,
    };
    let mut layers = vec![layer("epithelium", 200.0, 5.0, 0.97), layer("stroma", 3000.0, 18.0, 0.88)];
    layers[1].fluorophores.push(TissueFluorophore {
        fluorophore: dye(),
        strength_per_mm: 0.02,
        at_nm: 420.0,
        quantum_yield: None,
    });
    LayeredTissue { layers, refractive_index: 1.4, below: Below::Black }
}

/// The tissue at some wavelengths.
fn solved(absorption_per_mm: f64) -> EffectiveTissue {
    let nm: Vec<f64> = (0..=60).map(|i| 400.0 + 5.0 * f64::from(i)).collect();
    EffectiveTissue::new(&tissue(absorption_per_mm), &nm, DiscreteOrdinates::DIFFUSE).unwrap()
}

/// A fluorescent coated material of one reflectance; what [`super::bsdf::BsdfValue`] says of it is the same for all.
fn coated(roughness: f32) -> Material {
    let coat = Coat::new(1.4, ScalarTexture::Constant(roughness));
    let amount = FluorophoreAmount::new(0, ScalarTexture::Constant(1.0));
    let material = Material::with_base("tissue", Lambertian::uniform(Curve::constant(0.5)), Some(coat));
    Material { fluorophores: vec![amount], ..material }
}

/// Factor of the base toward a cosine, for light of unit irradiance: diffuse, or from one direction. Elastic and fluorescent.
fn base_factor(material: &Material, cos_out: f32, cos_in: Option<f32>) -> [f64; 2] {
    const STEPS: usize = 400;
    with_bsdf(material, true, cos_out, |bsdf, _| {
        let value = |cos: f32| {
            let value = bsdf.evaluate(direction(cos, 2.0));
            [value.diffuse, value.fluorescent].map(|v| f64::from(v) / f64::from(cos))
        };
        match cos_in {
            Some(cos) => value(cos),
            // The mean over all directions by their cosine: midpoints.
            None => (0..STEPS).fold([0.0; 2], |sum, step| {
                let cos = (step as f32 + 0.5) / STEPS as f32;
                let weight = 2.0 * f64::from(cos) / STEPS as f64;
                let value = value(cos);
                [0, 1].map(|kind| sum[kind] + weight * value[kind])
            }),
        }
    })
}

/// Exitance of the base per irradiance of diffuse light, per reflectance: elastic and fluorescent.
fn exitance_under_diffuse_light(material: &Material) -> [f64; 2] {
    const STEPS: usize = 200;
    (0..STEPS).fold([0.0; 2], |sum, step| {
        let cos = (step as f32 + 0.5) / STEPS as f32;
        let factor = base_factor(material, cos, None);
        [0, 1].map(|kind| sum[kind] + 2.0 * PI * f64::from(cos) / STEPS as f64 * factor[kind])
    })
}

/// Under diffuse light the material gives the solver's R and F with the surface, at every wavelength, to 1e-3: what is
/// left is the error of the table of the coat.
#[test]
fn tissue_under_its_coat_is_the_solved_tissue_with_its_surface() {
    let solved = solved(0.2);
    let surface = TissueSurface::new(StateGrid::default(), std::slice::from_ref(&solved)).unwrap();
    let [elastic, fluorescent] = exitance_under_diffuse_light(&coated(MIN_ROUGHNESS));
    let above = solved.reflectance(Level::AboveSurface);
    for nm in [400.0, 450.0, 520.0, 600.0, 700.0] {
        let (found, expected) = (elastic * surface.reflectances[0].at(nm), above.at(nm));
        assert!((found / expected - 1.0).abs() < 1e-3, "R at {nm} nm: {found}, solver {expected}");
    }
    let part = solved.parts()[0];
    let eem = &surface.emissions[0].states[0];
    for (emission, excitation) in [(520.0, 420.0), (600.0, 420.0), (620.0, 470.0)] {
        let found = fluorescent * eem.at(emission, excitation);
        let expected = solved.yield_density(part, emission, excitation, Level::AboveSurface);
        assert!(
            (found / expected - 1.0).abs() < 1e-3,
            "F at {emission}, {excitation} nm: {found}, solver {expected}"
        );
    }
}

/// White tissue, which scatters and absorbs nothing, on something white, gives back all light through any coat: the furnace.
#[test]
fn tissue_that_absorbs_nothing_is_white() {
    let mut white = tissue(0.0);
    white.layers[1].fluorophores.clear();
    // What is missing is what gets through to the black below.
    white.layers[1].thickness_um = 50_000.0;
    let nm = [500.0, 600.0];
    let solved = EffectiveTissue::new(&white, &nm, DiscreteOrdinates::DIFFUSE).unwrap();
    let lost = 1.0 - solved.specular_reflectance() - solved.reflectance(Level::AboveSurface).at(500.0);
    let through =
        DiscreteOrdinates::DIFFUSE.solve(&white.optics(500.0), Incidence::Lambertian).unwrap().transmittance;
    assert!(through > 0.0 && (lost - through).abs() < 1e-7, "lost {lost}, through {through}");
    let surface = TissueSurface::new(StateGrid::default(), &[solved]).unwrap();
    let reflectance = surface.reflectances[0].at(500.0);
    for roughness in [MIN_ROUGHNESS, 0.1, 0.4] {
        let [elastic, _] = exitance_under_diffuse_light(&coated(roughness));
        let mean = f64::from(CoatAlbedo::shared(1.4).at(1.0, roughness).1);
        let total = mean + elastic * reflectance;
        assert!((total - 1.0 + lost).abs() < 4e-3, "{roughness}: {total}, lost {lost}");
        assert!(total <= 1.0 + 1e-3, "{roughness}: {total}");
    }
}

/// Whatever the layers hold, a tissue and every mean of its states send back at most the photons that arrive.
#[test]
fn photons_are_conserved_in_every_state() {
    let surface = surface_with_a_map();
    let nm: Vec<f64> = (0..=30).map(|i| 400.0 + 10.0 * f64::from(i)).collect();
    for (state, reflectance) in surface.reflectances.iter().enumerate() {
        let yields = surface.emissions[0].states[state].total_yields(&nm);
        for (nm, photons) in nm.iter().zip(yields) {
            let sum = reflectance.at(*nm) + photons;
            assert!(photons >= 0.0 && sum < 1.0, "state {state}, {nm} nm: {sum}");
        }
    }
    for u in 0..20 {
        let weights = surface.grid.weights_at(glam::Vec2::new(u as f32 / 20.0, 0.3));
        assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
        assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
    }
}

/// A tissue whose absorption varies fourteenfold over the surface.
pub(super) fn surface_with_a_map() -> TissueSurface {
    let grid = crate::spectral::WavelengthGrid::uniform(400.0, 700.0, 20.0).unwrap();
    let map = ScalarTexture::Noise { cells: [3.0, 3.0], seed: 1, low: 0.05, high: 0.7 };
    let parameters = vec![super::MappedParameter::without_nodes("absorption".into(), map)];
    TissueSurface::varying(parameters, |values| Ok(tissue(values[0])), &grid, true).unwrap()
}

/// With gloss, light and view may change places: the BRDF of base and coat is the same for both, elastic and fluorescent.
#[test]
fn light_and_view_may_change_places() {
    for roughness in [MIN_ROUGHNESS, 0.2, 0.6] {
        let material = coated(roughness);
        for (first, second) in [(0.95, 0.4), (0.7, 0.15), (0.5, 0.3)] {
            let [forward, backward] = [(first, second), (second, first)]
                .map(|(cos_out, cos_in)| base_factor(&material, cos_out, Some(cos_in)));
            for kind in 0..2 {
                let ratio = forward[kind] / backward[kind];
                assert!((ratio - 1.0).abs() < 1e-5, "{roughness}, {first}, {second}: {ratio}");
            }
        }
    }
}

/// The states in which a tissue holds none of a fluorophore keep their places.
#[test]
fn states_without_a_fluorophore_emit_nothing() {
    let grid = crate::spectral::WavelengthGrid::uniform(400.0, 700.0, 20.0).unwrap();
    let map = ScalarTexture::Noise { cells: [3.0, 3.0], seed: 1, low: 0.0, high: 1.0 };
    let amount = super::MappedParameter {
        nodes: vec![0.0, 0.5, 1.0],
        ..super::MappedParameter::without_nodes("dye".into(), map)
    };
    let holding = |values: &[f64]| {
        let mut tissue = tissue(0.1);
        tissue.layers[1].fluorophores[0].strength_per_mm *= values[0];
        tissue.layers[1].fluorophores.retain(|held| held.strength_per_mm > 0.0);
        Ok(tissue)
    };
    let surface = TissueSurface::varying(vec![amount], holding, &grid, true).unwrap();
    let yields: Vec<f64> =
        surface.emissions[0].states.iter().map(|eem| eem.total_yields(&[420.0])[0]).collect();
    assert!(yields[0] == 0.0 && (yields[1] / yields[2] - 0.5).abs() < 1e-6, "{yields:?}");
    assert_eq!([surface.emissions[0].profiles.len(), surface.grid.profiles.len()], [3, 3]);
    let bytes = surface.to_bytes().unwrap();
    let parameters = vec![("dye".to_owned(), surface.grid.parameters[0].map.clone())];
    assert!(TissueSurface::from_bytes(&bytes, parameters, &|_| Some(dye())).unwrap() == surface);
}
