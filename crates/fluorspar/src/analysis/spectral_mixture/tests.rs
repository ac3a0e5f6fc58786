use rand::RngExt;
use rand_distr::StandardNormal;

use super::*;
use crate::sampling::random::Key;

fn wavelengths(step_nm: f64) -> Vec<f64> {
    (0..).map(|i| 500.0 + step_nm * f64::from(i)).take_while(|nm| *nm <= 700.0).collect()
}

fn band(nm: &[f64], center_nm: f64, deviation_nm: f64) -> Vec<f64> {
    nm.iter().map(|nm| (-0.5 * ((nm - center_nm) / deviation_nm).powi(2)).exp()).collect()
}

fn component(name: &str, values: Vec<f64>) -> MixtureComponent {
    MixtureComponent { name: name.into(), values }
}

/// Bands as broad as those of tissue: two that are much alike, two narrow ones, a broad one.
fn tissue_like(nm: &[f64]) -> SpectralMixture {
    let components = [
        ("green", 500.0, 40.0),
        ("yellow", 535.0, 35.0),
        ("porphyrin", 635.0, 9.0),
        ("chlorophyll", 675.0, 10.0),
        ("orange", 580.0, 60.0),
    ];
    let components = components.map(|(name, center, deviation)| component(name, band(nm, center, deviation)));
    SpectralMixture::new(nm.to_vec(), components.to_vec(), BloodBefore::None).unwrap()
}

const WEIGHTS: [f64; 5] = [1.0, 0.6, 0.15, 0.0, 0.3];

fn sum(mixture: &SpectralMixture, weights: &[f64]) -> Vec<f64> {
    let at = |i: usize| mixture.components.iter().zip(weights).map(|(c, w)| w * c.values[i]).sum();
    (0..mixture.wavelengths_nm.len()).map(at).collect()
}

/// Residuals of a correlation, standard deviation 1.
fn noise(nm: &[f64], correlation: ResidualCorrelation, draw: u64) -> Vec<f64> {
    let mut rng = Key::new(11).with(draw).rng();
    let mut normal = || rng.sample::<f64, _>(StandardNormal);
    let mut smooth = normal();
    let mut values = Vec::new();
    for i in 0..nm.len() {
        if i > 0 && correlation.length_nm > 0.0 {
            let fade = (-(nm[i] - nm[i - 1]) / correlation.length_nm).exp();
            smooth = fade * smooth + (1.0 - fade * fade).sqrt() * normal();
        }
        values.push(correlation.share.sqrt() * smooth + (1.0 - correlation.share).sqrt() * normal());
    }
    values
}

/// Two components that share no wavelength: weights are means, intervals those of Student.
#[test]
fn orthogonal_components_have_the_intervals_of_the_textbook() {
    let nm: Vec<f64> = (0..40).map(|i| 500.0 + 5.0 * f64::from(i)).collect();
    let half = |first: bool| (0..40).map(|i| f64::from(u8::from((i < 20) == first))).collect::<Vec<f64>>();
    let components = vec![component("low", half(true)), component("high", half(false))];
    let mixture = SpectralMixture::new(nm, components, BloodBefore::None).unwrap();
    // Residuals of alternating sign go together with nothing.
    let data: Vec<f64> =
        (0..40).map(|i| if i < 20 { 2.0 } else { 0.01 } + if i % 2 == 0 { 0.1 } else { -0.1 }).collect();
    let fit = mixture.fit(&data, None).unwrap();
    assert_eq!(fit.scatter.correlation, ResidualCorrelation::NONE);
    assert!((fit.scatter.effective_bands - 40.0).abs() < 1e-9);
    // s² = 40 x 0.01 / 38, variance of a mean of 20 s² / 20, Student's 97.5 % quantile of 38 degrees 2.024394.
    let error = (0.4f64 / 38.0 / 20.0).sqrt();
    for (weight, mean) in fit.weights.iter().zip([2.0, 0.01]) {
        assert!((weight.weight - mean).abs() < 1e-12);
        assert!((weight.standard_error.unwrap() - error).abs() < 1e-12, "{weight:?}");
        let ends = [(mean - 2.024_394 * error).max(0.0), mean + 2.024_394 * error];
        for (end, wanted) in weight.interval.iter().zip(ends) {
            assert!((end - wanted).abs() < 1e-6, "{weight:?} {ends:?}");
        }
    }
    assert_eq!(fit.weights[1].interval[0], 0.0, "the interval ends at the bound");
    assert!((fit.weights[0].share - 2.0 / 2.01).abs() < 1e-12);
}

#[test]
fn exact_sums_have_exact_weights() {
    let nm = wavelengths(5.0);
    let mixture = tissue_like(&nm);
    let fit = mixture.fit(&sum(&mixture, &WEIGHTS), None).unwrap();
    for (weight, truth) in fit.weights.iter().zip(WEIGHTS) {
        // Double precision, and a condition of the bands of some hundred; ends of intervals by the root of it.
        assert!((weight.weight - truth).abs() < 1e-10, "{weight:?}");
        assert!(weight.interval[0] <= truth + 1e-10 && weight.interval[1] - truth < 1e-5, "{weight:?}");
    }
    assert!(fit.relative_rms < 1e-12);
    let sets = mixture.sets(&sum(&mixture, &WEIGHTS), None, &fit, 4.0).unwrap();
    assert_eq!(sets.supported[0].components, ["green", "yellow", "porphyrin", "orange"]);
}

/// Coverage of all weights, and the median number of effective bands.
fn coverage(correlation: ResidualCorrelation, draws: u64) -> ([f64; 5], f64) {
    let nm = wavelengths(5.0);
    let mixture = tissue_like(&nm);
    let clean = sum(&mixture, &WEIGHTS);
    let (mut held, mut bands) = ([0.0; 5], Vec::new());
    for draw in 0..draws {
        let noise = noise(&nm, correlation, draw);
        let data: Vec<f64> = clean.iter().zip(noise).map(|(clean, noise)| clean + 0.01 * noise).collect();
        let fit = mixture.fit(&data, None).unwrap();
        bands.push(fit.scatter.effective_bands);
        for ((held, weight), truth) in held.iter_mut().zip(&fit.weights).zip(WEIGHTS) {
            let [low, high] = weight.interval;
            *held += f64::from(u8::from(low <= truth && truth <= high)) / draws as f64;
        }
    }
    bands.sort_by(f64::total_cmp);
    (held, bands[bands.len() / 2])
}

/// With 300 draws the standard error of a coverage of 95 % is 1.3 %; the mean over the four weights above zero, which share their
/// residuals, has at most that: four standard errors are 5 %. At the bound more is held: 97.5 % and up.
#[test]
fn intervals_hold_the_truth_as_often_as_they_say() {
    for (correlation, bands) in [
        (ResidualCorrelation::NONE, [40.9, 41.0 + 1e-9]),
        (ResidualCorrelation { share: 0.9, length_nm: 15.0 }, [12.0, 25.0]),
    ] {
        let (held, effective) = coverage(correlation, 300);
        let inside = (held[0] + held[1] + held[2] + held[4]) / 4.0;
        assert!(inside > 0.90, "{correlation:?}: {held:?}");
        assert!(correlation.share > 0.0 || inside < 0.995, "{held:?}");
        assert!(held[3] > 0.92, "{held:?}");
        assert!((bands[0]..=bands[1]).contains(&effective), "{correlation:?}: {effective}");
    }
}

/// Intervals for independent residuals hold too little where residuals are smooth: what the estimate of their correlation is for.
#[test]
fn smooth_residuals_widen_the_intervals() {
    let nm = wavelengths(5.0);
    let mixture = tissue_like(&nm);
    let smooth = ResidualCorrelation { share: 1.0, length_nm: 20.0 };
    let mut effects = Vec::new();
    let clean = sum(&mixture, &WEIGHTS);
    for draw in 0..20 {
        let noise = noise(&nm, smooth, draw);
        let data: Vec<f64> = clean.iter().zip(noise).map(|(clean, noise)| clean + 0.01 * noise).collect();
        let fit = mixture.fit(&data, None).unwrap();
        effects.push(fit.weights[0].design_effect.unwrap());
    }
    effects.sort_by(f64::total_cmp);
    assert!(effects[10] > 1.5, "{effects:?}");
}

#[test]
fn standard_errors_weigh_the_samples_and_are_a_floor() {
    let nm = wavelengths(5.0);
    let mixture = tissue_like(&nm);
    let errors: Vec<f64> = nm.iter().map(|nm| if *nm < 600.0 { 0.01 } else { 0.04 }).collect();
    let (noise, clean) = (noise(&nm, ResidualCorrelation::NONE, 3), sum(&mixture, &WEIGHTS));
    let noisy = |factor: f64| -> Vec<f64> {
        let noise = noise.iter().zip(&errors).map(|(noise, error)| factor * noise * error);
        clean.iter().zip(noise).map(|(clean, noise)| clean + noise).collect()
    };
    let [small, right, large] =
        [0.1, 1.0, 5.0].map(|factor| mixture.fit(&noisy(factor), Some(&errors)).unwrap());
    let errors_of = |fit: &MixtureFit| fit.weights[0].standard_error.unwrap();
    assert!((small.scatter.standard_deviation - 1.0).abs() < 1e-12);
    assert!(large.scatter.standard_deviation > 3.0 && errors_of(&large) > 3.0 * errors_of(&small));
    let [small, right, large] = [small, right, large].map(|fit| fit.chi_square.unwrap());
    // 36 degrees of freedom: a chi-square within four standard deviations, 34.
    assert!((right.chi_square - right.expected).abs() < 34.0, "{right:?}");
    assert!(right.probability > 1e-3 && small.probability > 0.999 && large.probability < 1e-9);
}

fn covered() -> (SpectralMixture, Vec<f64>) {
    let nm = wavelengths(2.0);
    let dip = |nm: f64, center: f64, width: f64| 0.1 * (-((nm - center) / width).powi(2)).exp();
    let extinction: Vec<f64> = nm.iter().map(|&nm| dip(nm, 545.0, 12.0) + dip(nm, 577.0, 9.0)).collect();
    let layer = BloodBefore::Layer { extinction: extinction.clone(), below: vec![0], largest: 40.0 };
    let components = vec![
        component("collagen", band(&nm, 520.0, 60.0)),
        component("fad", band(&nm, 530.0, 35.0)),
        component("porphyrin", band(&nm, 635.0, 9.0)),
    ];
    (SpectralMixture::new(nm, components, layer).unwrap(), extinction)
}

#[test]
fn an_absorber_in_front_of_one_component_is_found() {
    let (mixture, _) = covered();
    let spectra: Vec<Vec<f64>> = [[2.0, 0.1, 0.5], [0.3, 2.0, 0.0], [0.0, 1.0, 1.0]]
        .iter()
        .map(|weights| sum(&mixture.behind(7.3), weights))
        .collect();
    let fit = mixture.fit(&spectra[0], None).unwrap();
    let blood = fit.blood.unwrap();
    assert!((blood.amount - 7.3).abs() < 1e-4, "{blood:?}");
    assert!((fit.weights[0].weight - 2.0).abs() < 1e-3);
    // Spectra of other weights, and one that does not show the covered component, have the density in common.
    let spectra: Vec<(&[f64], Option<&[f64]>)> = spectra.iter().map(|data| (data.as_slice(), None)).collect();
    let common = mixture.common_blood(&spectra).unwrap();
    assert!((common - 7.3).abs() < 1e-4, "{common}");
}

#[test]
fn intervals_of_blood_and_of_what_lies_below_hold_the_truth() {
    let (mixture, _) = covered();
    let nm = &mixture.wavelengths_nm;
    let clean = sum(&mixture.behind(7.3), &[2.0, 0.3, 0.2]);
    let draws = 60;
    let (mut density, mut collagen) = (0, 0);
    for draw in 0..draws {
        let noise = noise(nm, ResidualCorrelation::NONE, draw);
        let data: Vec<f64> = clean.iter().zip(noise).map(|(clean, noise)| clean + 0.02 * noise).collect();
        let fit = mixture.fit(&data, None).unwrap();
        let holds = |[low, high]: [f64; 2], truth: f64| usize::from(low <= truth && truth <= high);
        density += holds(fit.blood.unwrap().interval, 7.3);
        collagen += holds(fit.weights[0].interval, 2.0);
    }
    // 95 % of 60 is 57; four standard errors are 6.8.
    assert!(density >= 50 && collagen >= 50, "{density} {collagen} of {draws}");
}

#[test]
fn blood_of_tissue_is_interpolated_and_found() {
    let (layer, extinction) = covered();
    let amounts: Vec<f64> = (0..9).map(|i| 0.25 * 2f64.powf(0.5 * f64::from(i))).collect();
    let values = amounts
        .iter()
        .map(|amount| layer.behind(4.0 * amount).components.into_iter().map(|c| c.values).collect());
    let blood = BloodBefore::Tissue { amounts: amounts.clone(), values: values.collect() };
    let tissue = SpectralMixture::new(layer.wavelengths_nm.clone(), layer.components.clone(), blood).unwrap();
    let fit = tissue.fit(&sum(&layer.behind(4.0 * 1.1), &[2.0, 0.1, 0.5]), None).unwrap();
    // Interpolated is exp(-x) over ln x: between nodes a factor 1.41 apart it is off by up to (ln 1.41)² / 8 of its exponent's change,
    // 1.5 %, of an exponent of 4.4 x 0.1 x 2.3 = 1.
    assert!((fit.blood.unwrap().amount / 1.1 - 1.0).abs() < 0.03, "{:?} {}", fit.blood, extinction[0]);
    assert!((fit.weights[0].weight / 2.0 - 1.0).abs() < 0.03, "{:?}", fit.weights[0]);
}

#[test]
fn sets_that_the_data_cannot_tell_apart_are_found() {
    let nm = wavelengths(5.0);
    let components = vec![
        component("green", band(&nm, 500.0, 40.0)),
        component("twin", band(&nm, 501.0, 40.0)),
        component("porphyrin", band(&nm, 635.0, 9.0)),
        component("chlorophyll", band(&nm, 675.0, 10.0)),
    ];
    let mixture = SpectralMixture::new(nm.clone(), components, BloodBefore::None).unwrap();
    let noise = noise(&nm, ResidualCorrelation::NONE, 5);
    let clean = sum(&mixture, &[1.0, 0.0, 0.2, 0.0]);
    let data: Vec<f64> = clean.iter().zip(noise).map(|(clean, noise)| clean + 0.02 * noise).collect();
    let fit = mixture.fit(&data, None).unwrap();
    let sets = mixture.sets(&data, None, &fit, 4.0).unwrap();
    let of = |name: &str| sets.components.iter().find(|member| member.name == name).unwrap();
    let count = sets.supported.len();
    assert_eq!(of("porphyrin").supported_sets, count, "{sets:?}");
    assert!(of("porphyrin").akaike_weight > 0.999);
    assert!(of("green").supported_sets < count && of("twin").supported_sets < count && count >= 2);
    assert_eq!(sets.interchangeable, [["green".to_string(), "twin".to_string()]]);
    assert!(of("chlorophyll").akaike_weight < 0.6, "{:?}", of("chlorophyll"));
    // Sets of 4: none with one of the two narrow bands alone is left out but by a weight of zero.
    assert!(sets.compared + sets.too_large <= 16 && sets.too_large == 0);
    let all: f64 = sets.supported.iter().map(|set| set.akaike_weight).sum();
    assert!(all > 0.8 && all <= 1.0 + 1e-12, "{all}");
    // Each alone may be all of the light, and either may be absent.
    let range = of("green").weight_range;
    assert!(range[0] == 0.0 && (range[1] - 1.0).abs() < 0.05, "{range:?}");
    assert_eq!(fit.weights[0].interval[0].min(fit.weights[1].interval[0]), 0.0);
}

/// The set that is true is rarely lost under smooth residuals and under independent ones: of 20 draws that lose it one time in ten, more
/// than four do with a probability of 0.04.
#[test]
fn the_true_set_is_supported_under_smooth_residuals() {
    let nm = wavelengths(5.0);
    let mixture = tissue_like(&nm);
    for correlation in [ResidualCorrelation::NONE, ResidualCorrelation { share: 0.95, length_nm: 20.0 }] {
        let found = (0..20).filter(|draw| {
            let noise = noise(&nm, correlation, 100 + draw);
            let clean = sum(&mixture, &WEIGHTS);
            let data: Vec<f64> = clean.iter().zip(noise).map(|(clean, n)| clean + 0.003 * n).collect();
            let fit = mixture.fit(&data, None).unwrap();
            let sets = mixture.sets(&data, None, &fit, 4.0).unwrap();
            sets.supported.iter().any(|set| set.components == ["green", "yellow", "porphyrin", "orange"])
        });
        let found = found.count();
        assert!(found >= 16, "{correlation:?}: {found} of 20");
    }
}

#[test]
fn what_cannot_be_fitted_is_told() {
    let nm = wavelengths(20.0);
    let flat = |value: f64| component("flat", vec![value; nm.len()]);
    let new = |components: Vec<MixtureComponent>, blood| {
        SpectralMixture::new(nm.clone(), components, blood).unwrap_err().to_string()
    };
    assert!(new(vec![], BloodBefore::None).contains("no component"));
    assert!(new(vec![flat(1.0); 9], BloodBefore::None).contains("11 samples can't fix 9 weights"));
    assert!(new(vec![flat(0.0)], BloodBefore::None).contains("flat sends no light"));
    assert!(new(vec![flat(f64::NAN)], BloodBefore::None).contains("not finite"));
    assert!(
        new(vec![component("short", vec![1.0])], BloodBefore::None).contains("component 0 has 1 samples")
    );
    let layer = |below, largest| BloodBefore::Layer { extinction: vec![1.0; nm.len()], below, largest };
    for blood in [layer(vec![], 40.0), layer(vec![1], 40.0), layer(vec![0], 0.0)] {
        assert!(new(vec![flat(1.0)], blood).contains("blood needs"));
    }
    let mixture = SpectralMixture::new(nm.clone(), vec![flat(1.0)], BloodBefore::None).unwrap();
    let says = |data: &[f64], errors: Option<&[f64]>| mixture.fit(data, errors).unwrap_err().to_string();
    let ones = vec![1.0; nm.len()];
    assert!(says(&[1.0; 2], None).contains("component 0 has 2 samples"));
    assert!(says(&vec![0.0; nm.len()], None).contains("zero throughout"));
    assert!(says(&vec![f64::INFINITY; nm.len()], None).contains("not finite"));
    assert!(says(&ones, Some(&vec![0.0; nm.len()])).contains("standard errors"));
    let fine = wavelengths(5.0);
    let many = (0..13).map(|i| component("many", band(&fine, 500.0 + 10.0 * f64::from(i), 8.0))).collect();
    let many = SpectralMixture::new(fine.clone(), many, BloodBefore::None).unwrap();
    let data: Vec<f64> = band(&fine, 600.0, 40.0);
    let fit = many.fit(&data, None).unwrap();
    let error = many.sets(&data, None, &fit, 4.0).unwrap_err().to_string();
    assert!(error.contains("13 components make 8192 sets"), "{error}");
}
