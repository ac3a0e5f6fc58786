//! A small problem with everything in it: two dyes, three lights, an ideal sensor of two bands.

use super::*;
use crate::safety::RetinalObserver;
use crate::sensor::{Sensor, SensorModel, SpectralQe};
use crate::spectral::{Curve, WavelengthGrid};

fn bell(center_nm: f64, width_nm: f64) -> Curve {
    Curve::from_fn(300.0, 800.0, |nm| (-((nm - center_nm) / width_nm).powi(2)).exp())
}

fn region() -> RegionModel {
    let grid = WavelengthGrid::uniform(420.0, 700.0, 5.0).unwrap();
    let excitation = ExcitationBasis::every(340.0, 460.0, 4.0);
    let dye = |name: &str, em: f64, ex: f64| {
        let (absorbed, emitted) = (bell(ex, 30.0), bell(em, 35.0));
        let mut radiance = Vec::new();
        for nm in grid.centers_nm() {
            radiance.extend(excitation.centers_nm().iter().map(|x| 1e-5 * emitted.at(nm) * absorbed.at(*x)));
        }
        FluorescenceResponse { name: name.into(), amount: 1.0, radiance }
    };
    let fluorescence = vec![dye("green", 520.0, 380.0), dye("red", 600.0, 420.0)];
    RegionModel::known(RegionResponse {
        name: "patch".into(),
        grid: grid.clone(),
        excitation: excitation.clone(),
        fluorescence,
        reflected: Curve::constant(0.1),
    })
}

fn light(peak_nm: f64) -> LightChoice {
    let curve = bell(peak_nm, 8.0);
    LightChoice {
        name: format!("{peak_nm} nm"),
        spectrum: curve.scaled(1.0 / curve.total()),
        light: 10.0,
        power_w: 0.1,
        peak_nm,
        cost: peak_nm / 100.0,
    }
}

fn problem() -> DesignProblem {
    let region = region();
    let curves = [("short", bell(520.0, 40.0)), ("long", bell(600.0, 40.0))];
    let qe = SpectralQe::from_curves(curves.map(|(name, curve)| (name, curve.scaled(0.5)))).unwrap();
    let model = SensorModel {
        columns: 2,
        rows: 1,
        mosaic: vec![vec!["short".into(), "long".into()]],
        read_noise_mv: None,
        read_noise_e: Some(3.0),
        prnu_percent: 0.0,
        dsnu_mv: None,
        dsnu_e: Some(0.0),
        ..SensorModel::default()
    };
    let sensor = Sensor::new(model, qe).unwrap();
    let bands = FineBands::of(&region.response.grid);
    let long_pass = LongPass { edge: LongPassEdge::At(470.0), width_nm: 8.0, optical_density: 5.0 };
    let filter = |name: &str, nm: f64| FilterChoice {
        name: name.into(),
        fixed: Curve::constant(1.0),
        long_pass: Some(LongPass { edge: LongPassEdge::At(nm), ..long_pass }),
        cost: 1.0,
    };
    DesignProblem {
        regions: vec![region],
        geometries: Vec::new(),
        eye: None,
        cohort: None,
        lights: [365.0, 385.0, 405.0, 430.0].map(light).into(),
        exposures: vec![1, 2],
        filters: vec![filter("470", 470.0), filter("500", 500.0)],
        cameras: vec![DesignCamera::new("two", &sensor, 1.0, &Curve::constant(1.0), &bands)],
        lenses: vec![LensChoice { f_number: 4.0, solid_angle_sr: 0.05 }],
        drives: vec![1.0, 2.0],
        splits: vec![Split::EqualTime, Split::EqualElectrons, Split::First(0.2)],
        budget: Budget::Electrons(20_000.0),
        white: None,
        library: LibraryError::default(),
        assumptions: Assumptions { pixels: 1.0, ..Assumptions::default() },
        weights: Vec::new(),
        contrasts: vec![ContrastDefinition {
            name: "red share".into(),
            part: vec!["red".into()],
            whole: vec!["green".into(), "red".into()],
        }],
        criterion: Criterion::Minimax,
        limits: Limits::default(),
        tissue_safety_factor: 1.0,
    }
}

#[test]
fn designs_are_numbered_without_gaps_and_doubles() {
    let space = DesignSpace::new(problem()).unwrap();
    // Four lights alone, and six pairs with three splits; two filters, two drives
    assert_eq!(space.len(), (4 + 6 * 3) * 2 * 2);
    let mut seen = std::collections::HashSet::new();
    for number in 0..space.len() {
        let design = space.design(number);
        assert_eq!(space.number(&design), Some(number));
        assert!(seen.insert(space.describe(&design)));
    }
    assert_eq!(space.design(space.len()), space.design(0));
    // Of one exposure no split makes another design
    let one = space.design(0);
    assert_eq!(space.number(&Design { split: 2, ..one.clone() }), Some(0));
    assert_eq!(space.number(&Design { split: 3, ..one }), None);
    for (exposures, designs) in
        [(vec![1], 4 * 2 * 2), (vec![2], 6 * 2 * 2 * 3), (vec![3, 1], (4 + 4 * 3) * 2 * 2)]
    {
        assert_eq!(DesignSpace::new(DesignProblem { exposures, ..problem() }).unwrap().len(), designs);
    }
    let missing =
        Design { lights: vec![2, 1], filter: 0, camera: 0, lens: 0, drive: 0, split: 0, geometry: 0 };
    assert_eq!(space.number(&missing), None);
    let empty = DesignProblem { filters: Vec::new(), ..problem() };
    assert!(DesignSpace::new(empty).unwrap_err().to_string().contains("no viewing filter"));
    let many = DesignProblem { exposures: vec![9], ..problem() };
    assert!(DesignSpace::new(many).is_err());
}

#[test]
fn a_budget_is_kept_and_splits_share_it() {
    let space = DesignSpace::new(problem()).unwrap();
    for number in 0..space.len() {
        let merits = space.evaluate(&space.design(number));
        assert!((merits.electrons / 20_000.0 - 1.0).abs() < 1e-9, "{}", merits.electrons);
        let design = space.design(number);
        let of_exposure = |k: usize| merits.regions[0].electrons[k].iter().sum::<f64>();
        match (&space.problem().splits[design.split], design.lights.len()) {
            (Split::EqualElectrons, 2) => assert!((of_exposure(0) / of_exposure(1) - 1.0).abs() < 1e-9),
            (Split::First(share), 2) => {
                assert!((merits.times_s[0] / merits.time_s - share).abs() < 1e-12);
            }
            _ => assert!(merits.times_s.windows(2).all(|t| t[0] == t[1])),
        }
    }
    let timed = DesignProblem { budget: Budget::Time(0.06), ..problem() };
    let space = DesignSpace::new(timed).unwrap();
    let merits = space.evaluate(&space.design(space.len() - 1));
    assert!((merits.time_s - 0.06).abs() < 1e-12);
}

/// Weights estimated from single noisy pixels by maximum likelihood (Fisher scoring of Poisson and normal noise) scatter as
/// the bound says. Of 4000 draws a variance is known to `sqrt(2 / 4000)` = 2.2 %; four of those are 9 %.
#[test]
fn maximum_likelihood_estimates_scatter_as_the_bound_says() {
    const DRAWS: usize = 4000;
    let space = DesignSpace::new(problem()).unwrap();
    for number in [space.len() - 1, 3] {
        let design = space.design(number);
        let merits = space.evaluate(&design);
        let bound = &merits.regions[0].weights;
        let pixels = space.sample_electrons(&design, 0, DRAWS, 7);
        let rows = derivatives(&space, &design);
        let (mut sums, mut squares) = ([0.0; 2], [0.0; 2]);
        for draw in 0..DRAWS {
            let data: Vec<f64> = pixels.iter().flatten().map(|patch| patch[draw]).collect();
            let weights = most_likely(&rows, &data, space.problem().cameras[0].dark_variance_e2);
            for k in 0..2 {
                sums[k] += weights[k];
                squares[k] += weights[k] * weights[k];
            }
        }
        for k in 0..2 {
            let mean = sums[k] / DRAWS as f64;
            let variance = squares[k] / DRAWS as f64 - mean * mean;
            let ratio = variance / (bound[k] * bound[k]);
            assert!((ratio - 1.0).abs() < 0.09, "{number} {k}: {ratio}");
            assert!(
                (mean - 1.0).abs() < 4.0 * bound[k] / (DRAWS as f64).sqrt() + bound[k] * bound[k],
                "{mean}"
            );
        }
    }
}

/// Electrons of each datum per weight: what lets no light but one dye's fluoresce; the last is what weighs nothing.
fn derivatives(space: &DesignSpace, design: &Design) -> Vec<[f64; 3]> {
    // Times are those of the whole problem, so electrons of one dye are scaled by time
    let all = space.evaluate(design);
    let seconds = &all.times_s;
    let alone = |dye: Option<usize>| {
        let mut p = space.problem().clone();
        for (k, part) in p.regions[0].response.fluorescence.iter_mut().enumerate() {
            if dye != Some(k) {
                part.radiance.iter_mut().for_each(|value| *value *= 1e-12);
            }
        }
        if dye.is_some() {
            p.regions[0].response.reflected = Curve::constant(0.0);
        }
        p.budget = Budget::Time(1.0);
        p.splits = vec![Split::EqualTime];
        let one = DesignSpace::new(p).unwrap();
        let merits = one.evaluate(&Design { split: 0, ..design.clone() });
        let per_second = merits.regions[0].electrons.iter().zip(&merits.times_s);
        let scaled = per_second.zip(seconds).flat_map(|((electrons, time), wanted)| {
            electrons.iter().map(move |e| e / time * wanted).collect::<Vec<f64>>()
        });
        scaled.collect::<Vec<f64>>()
    };
    let (a, b, leak) = (alone(Some(0)), alone(Some(1)), alone(None));
    (0..a.len()).map(|k| [a[k], b[k], leak[k]]).collect()
}

/// Weights of two dyes by Fisher scoring.
fn most_likely(rows: &[[f64; 3]], data: &[f64], read_e2: f64) -> [f64; 2] {
    let mut weights = [1.0, 1.0];
    for _ in 0..6 {
        let (mut aa, mut ab, mut bb, mut a, mut b) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (row, y) in rows.iter().zip(data) {
            let mean = weights[0] * row[0] + weights[1] * row[1] + row[2];
            let variance = mean.max(1.0) + read_e2;
            aa += row[0] * row[0] / variance;
            ab += row[0] * row[1] / variance;
            bb += row[1] * row[1] / variance;
            a += row[0] * (y - mean) / variance;
            b += row[1] * (y - mean) / variance;
        }
        let determinant = aa * bb - ab * ab;
        weights[0] += (bb * a - ab * b) / determinant;
        weights[1] += (aa * b - ab * a) / determinant;
    }
    weights
}

#[test]
fn limits_are_named_where_they_are_broken() {
    let limits = Limits {
        tissue_margin: Some(1e9),
        eye_margin: Some(1e12),
        leak: Some(0.0),
        saturation: Some(1e-9),
        time_s: Some(1e-9),
        cost: Some(1.0),
    };
    let eye = Some(ExposedEye::before_source(1.0, 0.1, RetinalObserver::Normal));
    let space = DesignSpace::new(DesignProblem { limits, eye, ..problem() }).unwrap();
    let design = space.design(0);
    assert_eq!(
        space.evaluate(&design).broken,
        ["tissue_margin", "eye_margin", "leak", "saturation", "time", "cost"]
    );
    assert!(space.score(&design).loss.is_infinite());
    let free = DesignSpace::new(problem()).unwrap();
    assert!(free.evaluate(&design).broken.is_empty() && free.score(&design).loss.is_finite());
    // Doses add: a light that is as strong for twice as long leaves half of the margin.
    let timed = |seconds: f64| {
        let p = DesignProblem { budget: Budget::Time(seconds), ..problem() };
        DesignSpace::new(p).unwrap().evaluate(&design).tissue_margin.unwrap()
    };
    assert!(timed(20.0) < timed(10.0));
}

/// Unknown leak, gain and drives never make anything better, and a white frame helps against an unknown gain.
#[test]
fn what_is_not_known_costs_and_a_white_frame_pays() {
    let loss = |assumptions: Assumptions, white: Option<WhiteFrame>| {
        let space = DesignSpace::new(DesignProblem { assumptions, white, ..problem() }).unwrap();
        space.evaluate(&space.design(space.len() - 1)).loss
    };
    let known = Assumptions { pixels: 1.0, ..Assumptions::default() };
    let best = loss(known, None);
    for (gain, drive, leak) in [(0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 5.0)] {
        assert!(loss(Assumptions { gain, drive, leak, ..known }, None) > best, "{gain} {drive} {leak}");
    }
    let lost = Assumptions { gain: 10.0, leak: 0.3, ..known };
    let white = WhiteFrame { light: light(550.0), filter: Curve::constant(1.0), level: 0.5 };
    assert!(loss(lost, None) > 1.0 && loss(lost, Some(white)) < 0.05, "{}", loss(lost, None));
}

#[test]
fn a_front_holds_what_nothing_dominates() {
    let score = |loss, time_s, cost, exposures| Score { loss, time_s, cost, exposures };
    let scores = [
        score(0.1, 2.0, 1.0, 1),
        score(0.2, 1.0, 1.0, 1),
        score(0.2, 2.0, 1.0, 1),
        score(f64::INFINITY, 0.1, 0.1, 1),
        score(0.1, 2.0, 1.0, 1),
        score(0.05, 3.0, 2.0, 2),
    ];
    assert_eq!(pareto_front(&scores), [5, 0, 1]);
}

#[test]
fn exchange_finds_the_best_and_is_the_same_for_any_threads() {
    let space = DesignSpace::new(problem()).unwrap();
    let all = score_all(&space, 0..space.len());
    let best = all.iter().map(|s| s.loss).fold(f64::INFINITY, f64::min);
    let found = exchange(&space, 3, 60);
    assert!(found.evaluated.len() <= 60);
    assert!((found.score.loss / best - 1.0).abs() < 1e-12, "{} {best}", found.score.loss);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(pool.install(|| exchange(&space, 3, 60)), found);
    assert_eq!(pool.install(|| score_all(&space, 0..space.len())), all);
    assert_eq!(exchange(&space, 3, 1_000_000).evaluated.len() as u64, space.len());
}

/// Electrons fall as the square of the f-number, so noise limited by photons rises with it; more of an unknown costs more.
#[test]
fn sensitivities_and_tolerances_have_their_signs() {
    let p = DesignProblem {
        budget: Budget::Time(0.02),
        assumptions: Assumptions { gain: 0.1, pixels: 100.0, ..Assumptions::default() },
        ..problem()
    };
    let space = DesignSpace::new(p.clone()).unwrap();
    let design = space.design(space.len() - 1);
    let found = sensitivities(&p, std::slice::from_ref(&design)).unwrap();
    let change = |name: &str| found.iter().find(|s| s.assumption.contains(name)).unwrap().loss_change;
    assert!(change("unknown gain") > 0.0);
    assert!(change("time") < 0.0 && change("pixels") < 0.0);
    assert!(change("read noise") > 0.0);
    // A quarter less of what helps hurts, by more than a quarter more helps: losses fall ever more slowly
    for helps in ["time", "pixels"] {
        let of = found.iter().find(|s| s.assumption.contains(helps)).unwrap();
        assert!(of.loss_change_of_less > -of.loss_change, "{of:?}");
    }
    assert!(found.iter().all(|s| !s.other_best));
    let none = Tolerances { light_nm: 0.0, filter_nm: 0.0, angle_deg: 0.0, effective_index: 1.8 };
    let as_meant = space.evaluate(&design).loss;
    assert!((worst_case(&p, &design, &none).unwrap().loss / as_meant - 1.0).abs() < 1e-6);
    let real = Tolerances { light_nm: 3.0, filter_nm: 2.0, angle_deg: 15.0, effective_index: 1.8 };
    let worst = worst_case(&p, &design, &real).unwrap();
    assert!(
        worst.loss > as_meant && worst.light_shifts_nm.len() == 2 && worst.broken.is_empty(),
        "{worst:?}"
    );
    // A limit that the design as meant keeps to and the one as made does not
    let merits = space.evaluate(&design);
    let limits = Limits { leak: Some(1.0001 * merits.leak), ..p.limits };
    let limited = DesignProblem { limits, ..p };
    assert!(DesignSpace::new(limited.clone()).unwrap().evaluate(&design).broken.is_empty());
    let worst = worst_case(&limited, &design, &real).unwrap();
    assert!(worst.leak > 1.01 * merits.leak && worst.broken == ["leak"], "{worst:?}");
    let [excess] = worst.excesses[..] else { panic!("{worst:?}") };
    assert_eq!((excess.limit, excess.value, Some(excess.allowed)), ("leak", worst.leak, limits.leak));
}

/// What a filter that passes half of all light keeps is half, and what one keeps that passes everything is all.
#[test]
fn the_share_of_fluorescence_that_a_filter_keeps() {
    let kept = |transmittance: f64| {
        let mut p = problem();
        p.filters.truncate(1);
        p.filters[0] =
            FilterChoice { fixed: Curve::constant(transmittance), long_pass: None, ..p.filters[0].clone() };
        let space = DesignSpace::new(p).unwrap();
        space.filtered_fluorescence(&space.design(0)).unwrap().kept
    };
    assert!((kept(1.0) - 1.0).abs() < 1e-12 && (kept(0.5) - 0.5).abs() < 1e-12);
    assert_eq!(kept(0.0), 0.0);
    let space = DesignSpace::new(problem()).unwrap();
    let design = space.design(0);
    let of_long_pass = space.filtered_fluorescence(&design).unwrap();
    assert!(of_long_pass.kept > 0.0 && of_long_pass.kept < 1.0, "{of_long_pass:?}");
    assert!((of_long_pass.shares.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{of_long_pass:?}");
}

/// A rendered region of twice the light is a flat one of twice the response, and each geometry is searched.
#[test]
fn rendered_regions_of_each_geometry_are_searched() {
    let mut problem = problem();
    problem.budget = Budget::Time(0.01);
    let flat = problem.regions.remove(0);
    let rendered = |scale: f64, irradiance_per_w: f64| {
        let mut response = flat.response.clone();
        response.fluorescence.iter_mut().for_each(|f| f.radiance.iter_mut().for_each(|v| *v *= scale));
        response.reflected = response.reflected.scaled(scale);
        RegionModel::rendered(response, irradiance_per_w)
    };
    let geometry = |name: &str, region| GeometryChoice {
        name: name.into(),
        regions: vec![region],
        lens_sr: Vec::new(),
        eye: None,
    };
    // 0.1 W at 100 W/m2 for each watt are the 10 W/m2 of the flat region
    problem.geometries =
        vec![geometry("far", rendered(25.0, 25.0)), geometry("near", rendered(100.0, 100.0))];
    let space = DesignSpace::new(problem.clone()).unwrap();
    assert_eq!(space.len(), 2 * (4 + 6 * 3) * 2 * 2);
    let of_flat =
        DesignSpace::new(DesignProblem { regions: vec![flat], geometries: Vec::new(), ..problem.clone() });
    let of_flat = of_flat.unwrap();
    for number in 0..of_flat.len() {
        let design = of_flat.design(number);
        let expected = of_flat.evaluate(&design);
        let far = space.evaluate(&design);
        let near = space.evaluate(&Design { geometry: 1, ..design });
        assert!((near.loss / expected.loss - 1.0).abs() < 1e-9 && far.loss > near.loss);
        assert!((near.electrons / far.electrons - 4.0).abs() < 1e-9);
        let margins = [expected.tissue_margin, near.tissue_margin, far.tissue_margin].map(Option::unwrap);
        assert!((margins[1] / margins[0] - 1.0).abs() < 1e-9 && margins[2] > 2.0 * margins[1], "{margins:?}");
    }
    let best = score_all(&space, 0..space.len()).iter().map(|s| s.loss).fold(f64::INFINITY, f64::min);
    let found = exchange(&space, 3, 120);
    assert!(
        found.score.loss <= best * (1.0 + 1e-12)
            && space.describe(&space.design(found.best)).contains("near")
    );
    problem.geometries[1].regions.clear();
    assert_eq!(DesignSpace::new(problem).unwrap_err(), DesignError::Regions);
}

/// A region without the part of a contrast says nothing about it; without any region that holds it no design can tell.
#[test]
fn a_contrast_counts_where_there_is_something_of_its_part() {
    let mut problem = problem();
    problem.criterion = Criterion::Contrast(0);
    let alone = DesignSpace::new(problem.clone()).unwrap();
    let mut without = region();
    without.response.name = "green only".into();
    without.response.fluorescence[1].amount = 0.0;
    problem.regions.push(without.clone());
    let both = DesignSpace::new(problem.clone()).unwrap();
    let design = alone.design(30);
    assert_eq!(alone.evaluate(&design).loss, both.evaluate(&design).loss);
    problem.regions = vec![without];
    let none = DesignSpace::new(problem).unwrap();
    assert_eq!(none.evaluate(&design).loss, f64::INFINITY);
}

/// What is known of a weight before counts as a datum of it: `C = (I + diag(1/s², 0))^-1` with the information `I` that the data alone
/// hold. Two dyes of one spectrum are told apart only so.
#[test]
fn what_is_known_of_a_weight_adds_to_what_is_measured() {
    let free = DesignSpace::new(problem()).unwrap();
    let prior = WeightPrior { fluorophore: "green".into(), relative: 0.02 };
    let told = DesignSpace::new(DesignProblem { weights: vec![prior.clone()], ..problem() }).unwrap();
    let design = free.design(30);
    let bound = free.evaluate(&design).regions.swap_remove(0).bound;
    let [g, r, both] = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|weights| bound.variance_of(&weights));
    let cross = 0.5 * (both - g - r);
    let determinant = g * r - cross * cross;
    // Information: the inverse of a two by two matrix
    let [a, b, c] = [r / determinant, -cross / determinant, g / determinant];
    let a = a + 1.0 / (prior.relative * prior.relative);
    let expected = [c / (a * c - b * b), a / (a * c - b * b)].map(f64::sqrt);
    let found = told.evaluate(&design).regions.swap_remove(0).weights;
    for (found, expected) in found.iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
    }
    assert!(found[0] < g.sqrt() && found[1] < r.sqrt());

    // Two dyes of one spectrum: of rank one without, and with the prior of rank two
    let narrow = |weights: Vec<WeightPrior>| {
        let mut problem = DesignProblem { weights, ..problem() };
        let dyes = &mut problem.regions[0].response.fluorescence;
        dyes[1].radiance = dyes[0].radiance.clone();
        let space = DesignSpace::new(problem).unwrap();
        space.evaluate(&space.design(30)).regions.swap_remove(0)
    };
    let (blind, seen) = (narrow(Vec::new()), narrow(vec![prior]));
    assert_eq!((blind.rank, seen.rank), (1, 2));
    assert!(blind.weights[0].is_infinite() && seen.weights.iter().all(|weight| weight.is_finite()));
}

/// A camera farther away has another solid angle and fewer pixels on the region: photons of a pixel follow the one, the bound both.
#[test]
fn a_working_distance_changes_the_solid_angle_and_the_pixels_of_a_region() {
    let mut problem = problem();
    problem.budget = Budget::Time(0.01);
    problem.assumptions.pixels = 1000.0;
    (problem.cameras[0].dark_variance_e2, problem.cameras[0].dark_e_per_s) = (0.0, 0.0);
    let flat = problem.regions.remove(0);
    let seen =
        |pixel_share: f64| RegionModel { pixel_share, ..RegionModel::rendered(flat.response.clone(), 100.0) };
    let geometry = |name: &str, share: f64, lens_sr: Vec<f64>| GeometryChoice {
        name: name.into(),
        regions: vec![seen(share)],
        lens_sr,
        eye: None,
    };
    problem.geometries = vec![
        geometry("near", 1.0, Vec::new()),
        geometry("far", 0.25, vec![0.04]),
        geometry("same", 1.0, vec![0.05]),
    ];
    let space = DesignSpace::new(problem).unwrap();
    let at = |geometry: usize| space.evaluate(&Design { geometry, ..space.design(7) });
    let [near, far, same] = [0, 1, 2].map(at);
    assert_eq!(near, same);
    // Without tolerances the worst case is the design, whichever aperture is its
    let none = Tolerances { light_nm: 0.0, filter_nm: 0.0, angle_deg: 0.0, effective_index: 1.8 };
    let mut two = space.problem().clone();
    two.lenses.push(LensChoice { f_number: 8.0, ..two.lenses[0].clone() });
    let of_second = Design { geometry: 1, lens: two.lenses.len() - 1, ..space.design(7) };
    two.geometries[1].lens_sr.resize(two.lenses.len(), 0.01);
    let as_meant = DesignSpace::new(two.clone()).unwrap().evaluate(&of_second).loss;
    let worst = worst_case(&two, &of_second, &none).unwrap().loss;
    assert!((worst / as_meant - 1.0).abs() < 1e-6, "{worst} {as_meant}");
    assert!((far.electrons / near.electrons - 0.04 / 0.05).abs() < 1e-9);
    // Photon noise alone: the variance of a mean goes with 1 / (electrons pixels)
    let ratio = far.regions[0].weights[0] / near.regions[0].weights[0];
    let expected = (0.05 / 0.04 / 0.25_f64).sqrt();
    assert!((ratio / expected - 1.0).abs() < 1e-9, "{ratio} {expected}");
}

/// An eye that sees the lights as the region does: margins of each hazard by its limit. Those of 365 and 385 nm
/// are limited by the dose of near ultraviolet, 1e4 J/m², and doses of two exposures add.
#[test]
fn an_eye_in_the_place_of_the_region_has_the_margins_of_the_standard() {
    let budget = Budget::Time(20.0);
    let eye = |share: f64| Some(ExposedEye::before_source(share, 0.1, RetinalObserver::Normal));
    let of = |share: f64| DesignSpace::new(DesignProblem { budget, eye: eye(share), ..problem() }).unwrap();
    let space = of(1.0);
    let ultraviolet = Design { lights: vec![0], ..space.design(0) };
    // J/m² at the eye from a light that is on for some seconds
    let near_uv = |light: usize, seconds: f64| {
        let light = &space.problem().lights[light];
        light.light
            * light.spectrum.integral(315.0, 400.0)
            * space.problem().drives[ultraviolet.drive]
            * seconds
    };
    let margin = space.evaluate(&ultraviolet).eye_margin.unwrap();
    // The actinic weight of 365 nm is 1.1e-4: its 30 J/m² are met at 2.7e5 J/m², long after 1e4 J/m²
    assert!((margin * near_uv(0, 20.0) / 1e4 - 1.0).abs() < 1e-3, "{margin}");
    assert!((of(0.25).evaluate(&ultraviolet).eye_margin.unwrap() / margin - 4.0).abs() < 1e-9);
    let both = space.evaluate(&Design { lights: vec![0, 1], split: 0, ..ultraviolet.clone() });
    let dose = near_uv(0, 10.0) + near_uv(1, 10.0);
    assert!((both.eye_margin.unwrap() * dose / 1e4 - 1.0).abs() < 1e-3, "{:?} {dose}", both.eye_margin);
    let blind = DesignSpace::new(problem()).unwrap();
    assert_eq!(blind.evaluate(&ultraviolet).eye_margin, None);
}

/// The design that leaks least is the best by leak, and one that sees no fluorescence is none.
#[test]
fn designs_are_ranked_by_leak() {
    let mut by_leak = DesignProblem { criterion: Criterion::Leak, ..problem() };
    // One edge lies within the light of 430 nm, the other 40 nm above it
    if let Some(long_pass) = &mut by_leak.filters[0].long_pass {
        long_pass.edge = LongPassEdge::At(440.0);
    }
    let space = DesignSpace::new(by_leak.clone()).unwrap();
    for (number, score) in score_all(&space, 0..space.len()).iter().enumerate() {
        let merits = space.evaluate(&space.design(number as u64));
        assert_eq!(score.loss, merits.leak);
        assert!(merits.leak > 0.0 && merits.leak.is_finite());
    }
    let of_edge = |filter| space.evaluate(&Design { lights: vec![3], filter, ..space.design(0) }).loss;
    assert!(of_edge(1) < 0.1 * of_edge(0), "{} {}", of_edge(1), of_edge(0));
    let mut dark = by_leak;
    dark.regions[0].response.fluorescence.iter_mut().for_each(|part| part.radiance.fill(0.0));
    let dark = DesignSpace::new(dark).unwrap();
    assert_eq!(dark.evaluate(&dark.design(0)).loss, f64::INFINITY);
}
