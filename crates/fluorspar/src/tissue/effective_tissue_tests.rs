//! Reflectance and fluorescence of a layered tissue against direct solutions.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use super::angular_quadrature::gauss_legendre;
use super::*;
use crate::spectral::{BandTerm, Curve, Fluorophore, LogNormalBand, Stokes, WavelengthGrid, YieldUnit};

fn band(peak_nm: f64, fwhm_per_cm: f64) -> LogNormalBand {
    LogNormalBand { peak_nm, fwhm_per_cm, skew: 1.1, weight: 1.0 }
}

/// Two species, so that the emission slides with the excitation.
fn emitter() -> Arc<Fluorophore> {
    let terms = [
        BandTerm { excitation: vec![band(370.0, 4000.0)], emission: vec![band(460.0, 4000.0)] },
        BandTerm { excitation: vec![band(420.0, 5000.0)], emission: vec![band(540.0, 4000.0)] },
    ];
    let range = (350.0, 520.0);
    Arc::new(Fluorophore::from_bands(
        "e",
        "E",
        &terms,
        YieldUnit::Photons,
        Stokes::Mask,
        1e-3,
        range,
        (400.0, 700.0),
        "",
    ))
}

fn layer(name: &str, thickness_um: f64, scattering_per_mm: f64, anisotropy: f64, blood: f64) -> TissueLayer {
    let vessels =
        Blood { volume_fraction: blood, saturation: 0.9, hemoglobin_g_per_l: 150.0, vessel_radius_um: 10.0 };
    TissueLayer {
        name: name.to_string(),
        thickness_um,
        scattering: LayerScattering {
            coefficient: ScatteringCoefficient::PowerLaw { scattering_per_mm, at_nm: 500.0, power: 1.2 },
            anisotropy,
        },
        absorption: vec![
            Chromophore::Background { absorption_per_mm: 0.1, at_nm: 450.0, slope_per_nm: 0.008 },
            Chromophore::Blood(vessels),
        ],
        fluorophores: vec![TissueFluorophore {
            fluorophore: emitter(),
            strength_per_mm: 2e-3,
            at_nm: 405.0,
            quantum_yield: None,
        }],
        refractive_index: None,
    }
}

/// Keratin, epithelium, superficial and deep stroma.
fn tongue() -> LayeredTissue {
    let layers = vec![
        layer("keratin", 40.0, 12.0, 0.97, 0.0),
        layer("epithelium", 160.0, 4.0, 0.97, 0.0),
        layer("superficial stroma", 300.0, 19.0, 0.88, 0.003),
        layer("deep stroma", 5000.0, 19.0, 0.88, 0.1),
    ];
    LayeredTissue { layers, refractive_index: 1.4, below: Below::Black }
}

fn solved(tissue: &LayeredTissue) -> EffectiveTissue {
    let nm: Vec<f64> = (0..=20).map(|i| 400.0 + 15.0 * f64::from(i)).collect();
    EffectiveTissue::new(tissue, &nm, DiscreteOrdinates::DIFFUSE).unwrap()
}

#[test]
fn yields_are_those_of_finely_integrated_fluence() {
    let tissue = tongue();
    let effective = solved(&tissue);
    let [excitation_nm, emission_nm] = [415.0, 595.0];
    let solve = |nm| DiscreteOrdinates::WORKING.solve(&tissue.optics(nm), Incidence::Lambertian).unwrap();
    let (excitation, emission) = (solve(excitation_nm), solve(emission_nm));
    let eem = &emitter().eem;
    let whole = eem.clone().with_stokes(Stokes::Off).total_yields(&[405.0])[0];
    for (number, layer) in tissue.layers.iter().enumerate() {
        let h = layer.thickness_um * 1e-3;
        let edges: Vec<f64> = (0..=40).map(|i| h * (f64::from(i) / 40.0).powi(3)).collect();
        let overlap: f64 = edges
            .windows(2)
            .flat_map(|e| gauss_legendre(6, e[1] - e[0]).into_iter().map(move |(z, w)| (e[0] + z, w)))
            .map(|(z, w)| w * excitation.layer_fluence(number, z) * emission.layer_fluence(number, z))
            .sum();
        let want = overlap / (4.0 * 1.96) * 2e-3 * eem.at(emission_nm, excitation_nm) / whole;
        let part = LayerFluorophore { layer: number, fluorophore: 0 };
        let got = effective.yield_density(part, emission_nm, excitation_nm, Level::AboveSurface);
        // Of 16 directions 3e-5, the rest is of the depths.
        assert!((got / want - 1.0).abs() < 1e-4, "{}: {}", layer.name, got / want - 1.0);
    }
}

#[test]
fn compressed_matrices_are_short_and_keep_their_error() {
    let effective = solved(&tongue());
    for part in effective.parts() {
        for level in [Level::AboveSurface, Level::BelowSurface] {
            let eem = effective.eem(part, level).unwrap();
            let crate::spectral::YieldDensity::Separable(terms) = eem.density() else { panic!("a table") };
            assert!(terms.len() <= 8, "{part:?}: {} terms", terms.len());
            let (mut error, mut total) = (0.0, 0.0);
            for x in 0..30 {
                for m in 0..60 {
                    let (excitation_nm, emission_nm) =
                        (401.0 + 5.0 * f64::from(x), 410.5 + 4.7 * f64::from(m));
                    let exact = effective.yield_density(part, emission_nm, excitation_nm, level);
                    error += (eem.at(emission_nm, excitation_nm) - exact).powi(2);
                    total += exact * exact;
                }
            }
            // Beside the compression, curves are linear between samples of 1 nm.
            assert!((error / total).sqrt() < 2.0 * COMPRESSION_ERROR, "{part:?}: {}", (error / total).sqrt());
        }
    }
}

#[test]
fn a_surface_gives_back_what_was_taken_off() {
    let tissue = tongue();
    let effective = solved(&tissue);
    let (external, internal) = (diffuse_reflectance(1.0, 1.4), diffuse_reflectance(1.4, 1.0));
    let reflectance = |level, nm| effective.reflectance(level).at(nm);
    let between = |nm| 1.0 - internal * reflectance(Level::BelowSurface, nm);
    for nm in [400.0, 550.0, 700.0] {
        let below = reflectance(Level::BelowSurface, nm);
        let above = (1.0 - external) * (1.0 - internal) * below / between(nm);
        assert!((above - reflectance(Level::AboveSurface, nm)).abs() < 1e-12);
    }
    let part = LayerFluorophore { layer: 2, fluorophore: 0 };
    let [x, m] = [415.0, 550.0];
    let inner = effective.yield_density(part, m, x, Level::BelowSurface);
    let outer = (1.0 - external) / between(x) * inner * (1.0 - internal) / between(m);
    assert!((outer / effective.yield_density(part, m, x, Level::AboveSurface) - 1.0).abs() < 1e-12);
}

#[test]
fn light_comes_from_where_the_fluorophore_is() {
    let mut tissue = tongue();
    let excitation = Curve::new(vec![404.0, 405.0, 406.0], vec![0.0, 1.0, 0.0]).unwrap();
    let channel = Curve::new(vec![500.0, 700.0], vec![1.0, 1.0]).unwrap();
    let profile = solved(&tissue).depth_of_fluorescence(&excitation, &channel);
    assert!((profile.layer_shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    let median = profile.quantile_um(0.5).unwrap();
    assert!((200.0..400.0).contains(&median), "{median}");
    assert!(profile.quantile_um(0.9).unwrap() > median);
    for (number, layer) in tissue.layers.iter_mut().enumerate() {
        if number != 1 {
            layer.fluorophores.clear();
        }
    }
    let profile = solved(&tissue).depth_of_fluorescence(&excitation, &channel);
    assert_eq!(profile.layer_shares[1], 1.0);
    assert!((40.0..200.0).contains(&profile.quantile_um(0.5).unwrap()));
    let dark = Curve::new(vec![300.0, 310.0], vec![1.0, 1.0]).unwrap();
    assert_eq!(solved(&tissue).depth_of_fluorescence(&dark, &channel).quantile_um(0.5), None);
}

#[test]
fn what_a_fluorophore_absorbs_is_missing() {
    let mut tissue = tongue();
    let plain = tissue.layers[1].absorption_per_mm(405.0);
    let f = &mut tissue.layers[1].fluorophores[0];
    f.quantum_yield = Some(0.1);
    assert!((tissue.layers[1].absorption_per_mm(405.0) - plain - 0.02).abs() < 1e-6);
    let [with, without] = [&tissue, &tongue()].map(|t| solved(t).reflectance(Level::AboveSurface).at(400.0));
    assert!(with < without, "{with} {without}");
    assert!(solved(&tissue).largest_photon_return() < 1.0);
}

#[test]
fn bad_tissues_are_refused() {
    type Change = fn(&mut LayeredTissue);
    let changes: [(Change, &str); 7] = [
        (|t| t.layers[1].name = "keratin".into(), "two layers are named 'keratin'"),
        (
            |t| t.layers[0].thickness_um = 0.04,
            "layer 'keratin': thickness_um is 0.04, outside 0.1 to 1000000",
        ),
        (|t| t.below = Below::Index(0.5), "medium below: refractive_index is 0.5"),
        (|t| t.layers[0].refractive_index = Some(5.0), "layer 'keratin': refractive_index is 5"),
        (
            |t| t.layers[0].fluorophores[0].strength_per_mm = 1430.0,
            "fluorophore 'e': strength_per_mm is 1430, outside 0 to 400; absorption times quantum yield is in 1/mm",
        ),
        (|t| t.layers[0].fluorophores[0].at_nm = 1100.0, "not excited at 1100 nm"),
        (|t| t.layers.clear(), "at least one layer"),
    ];
    let grid = WavelengthGrid::uniform(400.0, 500.0, 50.0).unwrap();
    for (change, words) in changes {
        let mut tissue = tongue();
        change(&mut tissue);
        let said = EffectiveTissue::for_grid(&tissue, &grid).unwrap_err().to_string();
        assert!(said.contains(words), "{said}");
    }
    let said = EffectiveTissue::new(&tongue(), &[500.0, 400.0], DiscreteOrdinates::DIFFUSE).unwrap_err();
    assert_eq!(said, TissueError::Wavelengths);
    let effective = solved(&tongue());
    assert_eq!(
        effective.eem(LayerFluorophore { layer: 9, fluorophore: 0 }, Level::AboveSurface),
        Err(TissueError::NoSuchPart)
    );
}

#[test]
fn layers_that_emit_more_than_they_absorb_are_told() {
    let nm = [400.0, 405.0, 420.0];
    let mut tissue = tongue();
    tissue.check_photon_balance(&nm).unwrap();
    let held = &mut tissue.layers[2].fluorophores[0];
    held.strength_per_mm = 2.0;
    let said = tissue.check_photon_balance(&nm).unwrap_err().to_string();
    assert!(said.starts_with("layer 'superficial stroma', fluorophore 'e': under "), "{said}");
    // With its own absorption it can't, even if it emits all that it absorbs
    tissue.layers[2].fluorophores[0].quantum_yield = Some(1.0);
    tissue.check_photon_balance(&nm).unwrap();
    assert!(solved(&tissue).largest_photon_return() < 1.0);
}

/// Photons under several lines are the sum of those under each.
#[test]
fn emission_under_lines_is_the_sum_of_yields() {
    let effective = solved(&tongue());
    let (light, nm) = ([(400.0, 2.0), (411.0, 0.5)], [500.0, 603.0]);
    for part in effective.parts() {
        for (found, m) in effective.emission(part, &light, &nm, Level::BelowSurface).iter().zip(nm) {
            let yields = |(x, photons): &(f64, f64)| {
                photons * effective.yield_density(part, m, *x, Level::BelowSurface)
            };
            let expected: f64 = light.iter().map(yields).sum();
            assert!((found - expected).abs() <= 1e-12 * expected, "{found} {expected}");
        }
    }
    assert_eq!(
        effective.emission(LayerFluorophore { layer: 9, fluorophore: 0 }, &light, &nm, Level::AboveSurface),
        [0.0; 2]
    );
}
