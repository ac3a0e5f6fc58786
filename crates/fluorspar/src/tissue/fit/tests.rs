use super::*;
use crate::sampling::random::Key;
use crate::spectral::{BandTerm, Curve, LogNormalBand, Stokes, YieldUnit};
use crate::tissue::site_tests::{lip, tongue};
use crate::tissue::{EffectiveTissue, Level, Site};

/// Bands of the fluorophores that a tongue holds, so different that spectra tell them apart.
fn find(name: &str) -> Option<Arc<Fluorophore>> {
    let peak = match name {
        "biofilm_porphyrin" => 635.0,
        "biofilm_chlorophyll" => 675.0,
        "lipopigment" => 570.0,
        "fad" => 530.0,
        _ => 500.0,
    };
    let band = |peak_nm, fwhm_per_cm| LogNormalBand { peak_nm, fwhm_per_cm, skew: 1.0, weight: 1.0 };
    let terms = [BandTerm { excitation: vec![band(405.0, 3000.0)], emission: vec![band(peak, 1200.0)] }];
    let (ex, em) = ((350.0, 450.0), (450.0, 720.0));
    let yields = YieldUnit::Photons;
    Some(Arc::new(Fluorophore::from_bands(name, name, &terms, yields, Stokes::Mask, 1e-3, ex, em, "")))
}

fn light(nm: f64) -> Curve {
    Curve::new(vec![nm - 10.0, nm, nm + 10.0], vec![0.0, 1.0, 0.0]).unwrap()
}

fn grid(from: f64, to: f64, step: f64) -> Vec<f64> {
    (0..=((to - from) / step) as usize).map(|i| from + step * i as f64).collect()
}

/// What is seen of a tissue, by way of its whole matrix.
fn seen(site: &Site, viewing: &Viewing, nm: &[f64]) -> Vec<f64> {
    let tissue = site.tissue(&find).unwrap();
    let tissue = EffectiveTissue::new(&tissue, &grid(380.0, 700.0, 5.0), DiscreteOrdinates::DIFFUSE).unwrap();
    let level = Level::AboveSurface;
    let parts = tissue.parts();
    let at = |&m: &f64| {
        let emitted = |&(x, photons): &(f64, f64)| {
            parts.iter().map(|part| photons / m * tissue.yield_density(*part, m, x, level)).sum::<f64>()
        };
        let emitted: f64 = viewing.photons().iter().map(emitted).sum();
        emitted * viewing.passed(m) + tissue.reflectance(level).at(m) * viewing.leaked(m)
    };
    nm.iter().map(at).collect()
}

fn fluorescence(site: &Site, viewing: &Viewing, nm: Vec<f64>, factor: f64) -> MeasuredFluorescence {
    let values = seen(site, viewing, &nm).iter().map(|value| factor * value).collect();
    MeasuredFluorescence {
        name: "light".into(),
        viewing: viewing.clone(),
        wavelengths_nm: nm,
        values,
        relative_error: 0.01,
        scale_uncertainty: f64::INFINITY,
    }
}

#[test]
fn a_tissue_of_the_population_comes_back_from_its_spectra() {
    let population = Population::of(&tongue());
    let fit = TissueFit { prior: &population, find: &find, solver: DiscreteOrdinates::DIFFUSE };
    let truth = population.draw(&mut Key::new(11).rng());
    let violet = Viewing::new(&light(405.0), Curve::constant(0.9))
        .unwrap()
        .with_leak(Curve::new(vec![500.0, 700.0], vec![2e-6, 1e-6]).unwrap());
    let measured = fluorescence(&truth, &violet, grid(500.0, 700.0, 10.0), 3.0);
    let tissue = truth.tissue(&find).unwrap();
    let nm = grid(400.0, 700.0, 10.0);
    let effective = EffectiveTissue::new(&tissue, &nm, fit.solver).unwrap();
    let reflectance = effective.reflectance(Level::AboveSurface);
    let white = MeasuredReflectance {
        name: "white".into(),
        values: nm.iter().map(|&nm| reflectance.at(nm)).collect(),
        wavelengths_nm: nm,
        error: 0.005,
    };
    let found = fit.fit(&[white], &[measured]).unwrap();
    assert!(found.converged, "{} steps", found.steps);
    // What is left is far below the stated errors, though the truth is no draw at the most probable point.
    for (spectrum, most) in found.spectra.iter().zip([0.01, 0.005]) {
        assert!(spectrum.relative_rms() < most, "{}: {}", spectrum.name, spectrum.relative_rms());
    }
    // Data without noise: the truth lies within the intervals but where linear models of 12 unknowns fail. 95 % of 13 is 12.35;
    // eleven or more have a probability of 0.97.
    let holds = |p: &&FittedParameter| {
        let value = truth.get(p.parameter).unwrap();
        (p.interval_95[0]..=p.interval_95[1]).contains(&value)
    };
    assert!(found.parameters.iter().filter(holds).count() >= 11, "{:#?}", found.parameters);
    let blood = found.parameters.iter().find(|p| p.name == "deep_blood_fraction").unwrap();
    assert!(blood.relative_deviation < 0.3, "{blood:#?}");
    let scale = found.spectra[1].scale_interval_95.unwrap();
    assert!((scale[0]..=scale[1]).contains(&3.0), "{scale:?}");

    // Another light of the same fluorescence: the truth lies within three standard deviations, or half a percent.
    let blue = Viewing::new(&light(430.0), Curve::constant(1.0)).unwrap();
    let nm = grid(500.0, 700.0, 20.0);
    let truth = seen(&truth, &blue, &nm);
    let predicted = fit.predict(&found, &blue, &nm).unwrap().shape(1);
    let nodes = grid(380.0, 700.0, 5.0);
    let whole = EffectiveTissue::new(&tissue, &nodes, fit.solver).unwrap();
    for (a, b) in blue.spectrum(&whole, &nm).iter().zip(&truth) {
        assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
    }
    for ((ratio, deviation), value) in predicted.iter().zip(&truth) {
        let off = ratio - value / truth[1];
        assert!(off.abs() < 3.0 * deviation + 0.005, "{off} {deviation}");
    }
}

#[test]
fn what_is_not_seen_keeps_its_prior() {
    let population = Population::of(&tongue())
        .restricted(|v| v.name == "biofilm_porphyrin_per_mm" || v.name == "keratin_per_mm");
    let fit = TissueFit { prior: &population, find: &find, solver: DiscreteOrdinates::DIFFUSE };
    let violet = Viewing::new(&light(405.0), Curve::constant(1.0)).unwrap();
    let typical = population.typical().clone();
    let mut bright = typical.clone();
    bright.set("biofilm_porphyrin_per_mm", 3.0 * typical.get("biofilm_porphyrin_per_mm").unwrap()).unwrap();
    let porphyrin = |to_nm: f64| {
        let measured = fluorescence(&bright, &violet, grid(480.0, to_nm, 10.0), 1.0);
        let found = fit.fit(&[], &[measured]).unwrap();
        found.parameters.into_iter().find(|p| p.name == "biofilm_porphyrin_per_mm").unwrap()
    };
    let (unseen, seen) = (porphyrin(540.0), porphyrin(700.0));
    assert!(unseen.relative_deviation > 0.98 && seen.relative_deviation < 0.2, "{unseen:?} {seen:?}");
    let truth = bright.get("biofilm_porphyrin_per_mm").unwrap();
    for parameter in [&unseen, &seen] {
        assert!((parameter.interval_95[0]..=parameter.interval_95[1]).contains(&truth), "{parameter:?}");
    }
}

#[test]
fn wrong_spectra_are_told() {
    let population = Population::of(&lip());
    let fit = TissueFit { prior: &population, find: &find, solver: DiscreteOrdinates::DIFFUSE };
    assert_eq!(fit.fit(&[], &[]), Err(TissueFitError::NothingMeasured));
    let nm = grid(400.0, 700.0, 10.0);
    let white = |values: f64, nm: &[f64]| MeasuredReflectance {
        name: "white.csv".into(),
        wavelengths_nm: nm.to_vec(),
        values: vec![values; nm.len()],
        error: 0.005,
    };
    let said = |record: MeasuredReflectance| fit.fit(&[record], &[]).unwrap_err().to_string();
    assert!(said(white(0.3, &nm[..3])).contains("white.csv: give at least 5 samples"));
    assert!(said(white(f64::NAN, &nm)).contains("finite"));
    assert!(said(MeasuredReflectance { error: 0.0, ..white(0.3, &nm) }).contains("the error is 0"));
    let none = population.restricted(|_| false);
    let held = TissueFit { prior: &none, ..fit };
    assert_eq!(held.fit(&[white(0.3, &nm)], &[]), Err(TissueFitError::NothingVaries));
    let dark = Curve::new(vec![400.0, 500.0], vec![0.0, -1.0]).unwrap();
    assert_eq!(Viewing::new(&dark, Curve::constant(1.0)), Err(TissueFitError::DarkLight));
}
