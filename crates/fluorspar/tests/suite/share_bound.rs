//! How near the estimate of a light family comes to the Cramér-Rao bound, on a family of one coordinate and three channels.
//!
//! The bound holds for quantities without ends; a share near 0 or 1 has one. So tests keep it between, with porphyrin known to be
//! present, and compare the middle 68 % of the errors, which a few wild draws don't rule as they rule a mean square.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use fluorspar::analysis::{
    Analyte, FamilyAverage, FamilyCoordinate, FamilySource, LightFamily, NuisanceGroup,
};
use fluorspar::sampling::random::Key;
use nalgebra::DMatrix;

/// A normal deviate that belongs to a key (Box and Muller).
fn normal(key: Key) -> f64 {
    let uniform = |id: u64| (key.with(id).value() >> 11) as f64 / (1u64 << 53) as f64;
    (-2.0 * (1.0 - uniform(0)).ln()).sqrt() * (std::f64::consts::TAU * uniform(1)).cos()
}

/// Electrons of a unit amount, and how blood, the one coordinate, changes their logarithms.
fn source(name: &str, electrons: [f64; 3], by_blood: [f64; 3]) -> FamilySource {
    let direct = |c: usize| vec![f64::ln(electrons[c]), by_blood[c], 0.05 * by_blood[c], 0.0];
    FamilySource {
        name: name.into(),
        group: NuisanceGroup::Fluorophores,
        median: 1.0,
        log_sd: 0.3,
        fluorescent: true,
        direct: (0..3).map(direct).collect(),
        once_more: vec![vec![-50.0, 0.0, 0.0, 0.0]; 3],
    }
}

/// Bulk of two fluorophores, and a porphyrin with some 0.3 of the light: thousands of electrons in each channel.
fn family() -> LightFamily {
    let blood = FamilyCoordinate { name: "blood".into(), sd: 0.6 };
    LightFamily {
        tissue: "a test".into(),
        width: 1.0,
        prior: "a test".into(),
        coordinates: vec![blood],
        sources: vec![
            source("collagen", [1500.0, 4000.0, 2500.0], [-0.05, -0.2, -0.15]),
            source("flavin", [1200.0, 2500.0, 500.0], [-0.05, -0.2, -0.1]),
        ],
        porphyrin: FamilySource { log_sd: 0.5, ..source("porphyrin", [4000.0, 400.0, 200.0], [0.0; 3]) },
        probability_of_none: 0.0,
        indirect: None,
        frames: vec!["blue".into()],
        frame_of: vec![0; 3],
        channel_of: ["R", "G", "B"].map(String::from).to_vec(),
        counted: vec![true; 3],
        gain_log_sd: 0.5,
        lamp_log_sd: 0.0,
        model_error: vec![0.0; 3],
        layers: vec![],
        library: DMatrix::from_diagonal_element(3, 3, 0.02),
    }
}

/// A tissue with its light: nuisances, amount of porphyrin, share.
struct Truth {
    nuisances: Vec<f64>,
    amount: f64,
    share: f64,
    electrons: Vec<f64>,
}

fn truth(family: &LightFamily, key: Key) -> Truth {
    let nuisances: Vec<f64> =
        (0..family.nuisances().len()).map(|place| normal(key.with(place as u64))).collect();
    let amount = family.porphyrin.median * (family.porphyrin.log_sd * normal(key.with(100))).exp();
    let (share, electrons) = (family.share(&nuisances, amount), family.electrons(&nuisances, amount));
    Truth { nuisances, amount, share, electrons }
}

/// Log odds that are estimated from electrons with shot noise and a read noise of 14 e-, and the variances.
fn estimated(family: &LightFamily, electrons: &[f64], key: Key) -> (f64, Vec<f64>) {
    let variance: Vec<f64> = electrons.iter().map(|e| e + 196.0).collect();
    let noise = |(i, (e, v)): (usize, (&f64, &f64))| e + v.sqrt() * normal(key.with(i as u64));
    let measured: Vec<f64> = electrons.iter().zip(&variance).enumerate().map(noise).collect();
    (log_odds(family.share_interval(&measured, &variance).unwrap().median), variance)
}

fn log_odds(share: f64) -> f64 {
    (share / (1.0 - share)).ln()
}

/// Half the distance between the percentiles 15.87 and 84.13: the standard deviation of a normal distribution.
fn half_width(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[(share * values.len() as f64) as usize];
    0.5 * (at(0.8413) - at(0.1587))
}

/// Over tissues of the prior: the variance of the error over the bound of van Trees. A variance by these percentiles is known to
/// 1.92 / sqrt(draws), here 0.05, so that 0.20 is four standard errors.
#[test]
fn the_estimate_has_the_variance_of_the_bound() {
    let family = family();
    let key = Key::new(31);
    let mut errors = Vec::new();
    for draw in 0..1500 {
        let Truth { nuisances, amount, share, electrons } = truth(&family, key.with(draw));
        let (found, variance) = estimated(&family, &electrons, key.with(draw).with(200));
        let bound = family.bound_of_log_odds(&nuisances, amount, &variance).unwrap();
        if electrons.iter().all(|e| *e > 1000.0) && (0.05..0.95).contains(&share) {
            errors.push((found - log_odds(share)) / bound);
        }
    }
    assert!(errors.len() > 900, "{}", errors.len());
    let ratio = half_width(errors).powi(2);
    assert!((ratio - 1.0).abs() < 0.2, "{ratio}");
}

/// Noise that goes with the light of all channels is brightness, of which next to nothing is known: the interval stays. As much in channels by
/// themselves widens it.
#[test]
fn noise_that_channels_share_is_told_from_color() {
    let family = family();
    let Truth { electrons, .. } = truth(&family, Key::new(33));
    let own = |i: usize| electrons[i] + 196.0;
    let of = |i: usize, j: usize| {
        0.05f64.powi(2) * electrons[i] * electrons[j] + if i == j { own(i) } else { 0.0 }
    };
    let shared: Vec<f64> = (0..9).map(|number| of(number / 3, number % 3)).collect();
    let width = |variance: &[f64]| {
        let [low, high] = family.share_interval(&electrons, variance).unwrap().interval;
        high - low
    };
    let [alone, unshared] = [(0..3).map(own).collect::<Vec<f64>>(), (0..3).map(|i| of(i, i)).collect()];
    assert!((width(&shared) / width(&alone) - 1.0).abs() < 0.02, "{} {}", width(&shared), width(&alone));
    assert!(width(&unshared) > 1.1 * width(&alone), "{} {}", width(&unshared), width(&alone));
}

/// Repeated measurements of one tissue: their scatter over the bound for noise alone, for four tissues with 600 measurements each,
/// whose variances are known to 0.08; the mean of four to 0.04.
#[test]
fn repeated_estimates_of_a_tissue_scatter_as_the_bound_says() {
    let family = family();
    let key = Key::new(32);
    let mut ratios = Vec::new();
    for tissue in 0..4 {
        let Truth { nuisances, amount, electrons, .. } = truth(&family, key.with(tissue));
        let found: Vec<f64> = (0..600)
            .map(|repeat| estimated(&family, &electrons, key.with(tissue).with(300 + repeat)).0)
            .collect();
        let variance: Vec<f64> = electrons.iter().map(|e| e + 196.0).collect();
        let bound = family.bound_of_repeats(&nuisances, amount, &variance).unwrap();
        // What the prior takes away, noise does not give back
        assert!(bound < family.bound_of_log_odds(&nuisances, amount, &variance).unwrap());
        ratios.push((half_width(found) / bound).powi(2));
    }
    let mean = ratios.iter().sum::<f64>() / 4.0;
    assert!((mean - 1.0).abs() < 0.2, "{ratios:?}");
}

/// Tissue whose collagen is redder, in the direction of the porphyrin, and which holds no porphyrin in half of the draws, as the named one.
fn redder() -> [LightFamily; 2] {
    let named = LightFamily { probability_of_none: 0.5, ..family() };
    let mut other = named.clone();
    other.tissue = "another test".into();
    other.sources[0] = source("collagen", [2600.0, 3000.0, 2400.0], [-0.05, -0.2, -0.15]);
    [named, other]
}

/// Electrons of a draw from a family with their variances, and the share.
fn drawn(family: &LightFamily, key: Key) -> ([Vec<f64>; 2], f64) {
    let Truth { nuisances, amount, share, electrons } = truth(family, key);
    let is_none = key.with(7).value().is_multiple_of(2);
    let (electrons, share) = if is_none {
        (family.electrons(&nuisances, 0.0), 0.0)
    } else {
        (electrons, share * f64::from(amount > 0.0))
    };
    let variance: Vec<f64> = electrons.iter().map(|e| e + 196.0).collect();
    let noise = |(i, (e, v)): (usize, (&f64, &f64))| e + v.sqrt() * normal(key.with(300 + i as u64));
    let measured = electrons.iter().zip(&variance).enumerate().map(noise).collect();
    ([measured, variance], share)
}

/// The posterior over both families holds 95 % of draws of which nine in ten are of the named one, as was assumed; not of those of the
/// other one alone. 200 draws of each know a probability near 0.95 to 0.015, and 0.05 likewise.
#[test]
fn tissue_that_was_named_wrongly_is_averaged_over_and_told() {
    const DRAWS: u64 = 200;
    let [named, other] = redder();
    let others = [other.clone()];
    let average = FamilyAverage { named: &named, others: &others, probability_of_named: 0.9 };
    // Held by the named family alone, held by the average, warned
    let counts = |truth: &LightFamily| {
        let mut counts = [0.0; 3];
        for draw in 0..DRAWS {
            let ([electrons, variance], share) = drawn(truth, Key::new(51).with(draw));
            let alone = named.share_interval(&electrons, &variance).unwrap();
            let found = average.share_interval(&electrons, &variance).unwrap();
            let holds = |[low, high]: [f64; 2]| low <= share && share <= high;
            for (count, is) in
                counts.iter_mut().zip([holds(alone.interval), holds(found.interval), found.warned])
            {
                *count += f64::from(u8::from(is)) / DRAWS as f64;
            }
        }
        counts
    };
    let ([alone, of_other, _], [_, of_named, warned]) = (counts(&other), counts(&named));
    println!(
        "other tissue: named alone {alone}, average {of_other}; named tissue: {of_named}, warned {warned}"
    );
    assert!(0.9 * of_named + 0.1 * of_other >= 0.95 - 2.0 * 0.015, "{of_named}, {of_other}");
    // Three standard errors of a difference of two numbers near 0.5, which is the largest there is
    assert!(alone < 0.5 && of_other > alone + 3.0 * 0.05, "{alone}, {of_other}");
    // A Bayes factor of 20 comes in at most 5 % of measurements of the named family, a foreign color in 0.1 %
    assert!(warned <= 0.051 + 2.0 * 0.015, "{warned}");
}

/// Families that are the same can't be told apart: the average is the posterior of one, to the rounding of its sums.
#[test]
fn the_average_over_one_and_the_same_family_is_that_family() {
    let [named, _] = redder();
    let ([electrons, variance], _) = drawn(&named, Key::new(52));
    let others = [named.clone(), named.clone()];
    let average = FamilyAverage { named: &named, others: &others, probability_of_named: 0.8 };
    let (alone, found) =
        (named.posterior(&electrons, &variance).unwrap(), average.posterior(&electrons, &variance).unwrap());
    assert_eq!(alone.doubt, None);
    let doubt = found.doubt.as_ref().unwrap();
    let analyte = Analyte::default();
    assert!(
        (doubt.bayes_factor - 1.0).abs() < 1e-12
            && !doubt.is_strong
            && found.warnings(&analyte) == alone.warnings(&analyte)
    );
    for (evidence, probability) in doubt.tissues.iter().zip([0.8, 0.1, 0.1]) {
        assert!((evidence.probability - probability).abs() < 1e-12, "{doubt:?}");
    }
    // Bisection ends at 50 / 2^60 in the log odds.
    for (a, b) in [(alone.interval, found.interval), (alone.interval, doubt.interval_as_named)] {
        assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9, "{a:?}, {b:?}");
    }
    assert!((alone.median - found.median).abs() < 1e-9);
    // Drawn people lie around the typical one
    let typical = named.electrons(&vec![0.0; named.nuisances().len()], 0.0);
    let mean = |axis: usize| found.people.iter().map(|at| at[axis]).sum::<f64>() / found.people.len() as f64;
    let sum: f64 = typical.iter().sum();
    assert!(found.people.len() > 100 && found.people[0] != found.people[1]);
    assert!(
        (mean(0) - typical[0] / sum).abs() < 0.03 && (mean(1) - typical[1] / sum).abs() < 0.03,
        "{found:?}"
    );
}

/// The warning names both tissues.
#[test]
fn other_tissue_is_named_in_words() {
    let [named, mut other] = redder();
    // Blue light alone, far from what the named tissue has
    other.sources[0] = source("collagen", [300.0, 800.0, 9000.0], [0.0; 3]);
    let nuisances = vec![0.0; other.nuisances().len()];
    let electrons = other.electrons(&nuisances, 0.0);
    let variance: Vec<f64> = electrons.iter().map(|e| e + 196.0).collect();
    let others = [other];
    let average = FamilyAverage { named: &named, others: &others, probability_of_named: 0.9 };
    let found = average.posterior(&electrons, &variance).unwrap();
    let said: Vec<String> = found.warnings(&Analyte::default()).iter().map(ToString::to_string).collect();
    let said = said.join(" ");
    assert!(
        said.contains("not those of a test") && said.contains("another test explains its light"),
        "{said}"
    );
    assert!(found.doubt.unwrap().is_strong && found.interval[0] == 0.0);
}
