use rand::SeedableRng;
use rand_distr::{Distribution, Normal, Poisson};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::analysis::LineNoise;
use crate::spectral::WavelengthGrid;

/// Chromaticities of elastin and porphyrins behind a 425 nm long-pass, porphyrin three times as bright per amount.
fn line() -> MixtureLine {
    MixtureLine::new([0.163, 0.412, 0.425], [2.436, 0.405, 0.159]).unwrap()
}

#[test]
fn mixtures_are_collinear() {
    let line = line();
    let (bulk, porphyrin) = (line.bulk_point(), line.porphyrin_point());
    for porphyrin_amount in [0.0, 0.01, 0.2, 1.0, 5.0, 100.0] {
        for light in [1e-3, 1.0, 4e3] {
            let [r, g] = sensor_chromaticity(line.rgb(light, porphyrin_amount * light)).unwrap();
            let cross = (porphyrin[0] - bulk[0]) * (g - bulk[1]) - (porphyrin[1] - bulk[1]) * (r - bulk[0]);
            assert!(cross.abs() < 1e-12, "{porphyrin_amount} {light}: {cross}");
        }
    }
}

#[test]
fn without_noise_the_fraction_is_recovered_exactly() {
    let line = line();
    for fraction in [0.0, 1e-3, 0.1, 0.5, 0.9, 1.0] {
        for light in [1e-3, 1.0, 4e3] {
            let rgb = line.rgb((1.0 - fraction) * light, fraction * light);
            let estimate = line.project(rgb, [1.0; 3]).unwrap();
            assert!((estimate.fraction - fraction).abs() < 1e-12);
            assert!(estimate.distance.abs() < 1e-12);
        }
    }
}

/// Normal noise in 4001 equally likely steps: intervals hold the truth in 95 % of them or more, at the ends of the line too, and are
/// nowhere narrower than one side of 1.96 standard errors.
#[test]
fn intervals_beyond_the_ends_hold_the_truth_and_stay_wide() {
    let normal = statrs::distribution::Normal::new(0.0, 1.0).unwrap();
    for standard_error in [0.01, 0.1, 0.4] {
        for truth in [0.0, 0.005, 0.05, 0.5, 0.97, 1.0] {
            let mut held = 0;
            for step in 0..4001 {
                let z = statrs::distribution::ContinuousCDF::inverse_cdf(
                    &normal,
                    (f64::from(step) + 0.5) / 4001.0,
                );
                let [low, high] = interval_on_line(truth + z * standard_error, standard_error);
                held += u32::from((low..=high).contains(&truth));
                assert!(high - low >= (Z_95 * standard_error).min(1.0) - 1e-12, "{low} {high}");
            }
            // Steps at both ends are rounded to whole ones.
            let missed = 4001 - held;
            assert!(missed <= 202, "{truth} {standard_error}: {missed} of 4001 missed");
        }
    }
}

#[test]
fn the_brighter_end_pulls_harder() {
    let line = line();
    let estimate = line.project(line.rgb(0.5, 0.5), [1e-6; 3]).unwrap();
    // Half and half by amount, but porphyrin gives three times the signal: three quarters of the way.
    assert!((estimate.position - 0.75).abs() < 1e-12 && (estimate.fraction - 0.5).abs() < 1e-12);
    assert!(!estimate.clamped);
}

#[test]
fn pixels_beyond_the_ends_are_clamped_and_say_so() {
    let line = line();
    let beyond = line.project([0.05, 0.5, 0.45], [1e-4; 3]).unwrap();
    assert!(beyond.position < 0.0 && beyond.clamped);
    assert_eq!(beyond.fraction, 0.0);
    assert!(beyond.fraction_interval[0] == 0.0 && beyond.fraction_interval[1] < 0.05);
}

#[test]
fn distance_is_signed_and_perpendicular() {
    let line = MixtureLine::new([0.2, 0.4, 0.4], [0.8, 0.1, 0.1]).unwrap();
    let above = line.project([0.5, 0.35, 0.15], [1e-6; 3]).unwrap();
    // The line is g = 0.5 - r/2; (0.5, 0.35) is 0.1 above it, so 0.1 cos(atan(1/2)) away.
    assert!((above.distance - 0.1 * 2.0 / 5f64.sqrt()).abs() < 1e-12, "{}", above.distance);
    let below = line.project([0.5, 0.15, 0.35], [1e-6; 3]).unwrap();
    assert!((below.distance + above.distance).abs() < 1e-12);
}

#[test]
fn no_chromaticity_no_estimate() {
    assert_eq!(line().project([0.0, 0.0, -1.0], [1.0; 3]), None);
}

/// Share of 95 % intervals of the fraction that hold the truth.
fn coverage(line: &MixtureLine, amounts: [f64; 2], noise: ChannelNoise, draws: usize, seed: u64) -> f64 {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mean = line.rgb(amounts[0], amounts[1]);
    let truth = amounts[1] / amounts.iter().sum::<f64>();
    let (dark, gain) =
        (Normal::new(0.0, noise.floor_dn).unwrap(), Normal::new(1.0, noise.gain_spread).unwrap());
    let mut hits = 0;
    for _ in 0..draws {
        let rgb = mean.map(|dn| {
            let electrons = Poisson::new(dn / noise.dn_per_electron).unwrap().sample(&mut random);
            electrons * noise.dn_per_electron * gain.sample(&mut random) + dark.sample(&mut random)
        });
        let variance = rgb.map(|value| noise.variance(value));
        let [low, high] = line.project(rgb, variance).unwrap().fraction_interval;
        hits += usize::from((low..=high).contains(&truth));
    }
    hits as f64 / draws as f64
}

#[test]
fn intervals_of_95_percent_hold_the_truth_93_to_97_times_in_100() {
    // The intervals are of first order, so the band of 2 % is for the model. Chance adds sqrt(0.95 * 0.05 / 20 000) =
    // 0.15 % to it: the band is 13 standard errors wide, and no seed will cross it.
    let noise = ChannelNoise {
        floor_dn: 6.25,
        dn_per_electron: 0.4496,
        gain_spread: 0.0229,
        lines: LineNoise::default(),
    };
    for (seed, amounts) in [[2000.0, 100.0], [800.0, 300.0], [400.0, 20.0], [100.0, 900.0]].iter().enumerate()
    {
        let covered = coverage(&line(), *amounts, noise, 20_000, 41 + seed as u64);
        assert!((0.93..=0.97).contains(&covered), "{amounts:?}: {covered:?}");
    }
}

#[test]
fn responses_count_photons() {
    let grid = WavelengthGrid::uniform(500.0, 600.0, 100.0).unwrap();
    let radiance = Spectrum::<Radiance>::new(grid.clone(), vec![1.0, 1.0]).unwrap();
    let ones = Spectrum::<QuantumEfficiency>::constant(&grid, 1.0);
    let red = Spectrum::new(grid.clone(), vec![0.0, 1.0]).unwrap();
    let green = Spectrum::new(grid, vec![1.0, 0.0]).unwrap();
    let [r, g, b] = channel_response(&radiance, [&red, &green, &ones]).unwrap();
    // The same energy is 600/500 as many photons at 600 nm.
    assert!((r / g - 1.2).abs() < 1e-12 && ((r + g) / b - 1.0).abs() < 1e-12);
    let other = Spectrum::<QuantumEfficiency>::constant(&WavelengthGrid::default(), 1.0);
    assert!(channel_response(&radiance, [&other, &green, &ones]).is_err());
}

#[test]
fn a_line_needs_two_lit_ends_apart() {
    let message = |result: Result<MixtureLine, MixtureError>| result.unwrap_err().to_string();
    assert_eq!(
        message(MixtureLine::new([0.0; 3], [1.0, 0.0, 0.0])),
        "the bulk response R, G, B = [0.0, 0.0, 0.0] has no positive sum, so it has no chromaticity; is its emission \
         outside the filter's pass band, or its weight zero?"
    );
    assert_eq!(
        message(MixtureLine::new([1.0, 2.0, 1.0], [2.0, 4.0, 2.0])),
        "bulk and porphyrin have the same sensor chromaticity (0.2500, 0.5000) through these filters and this sensor; \
         mixtures cannot be distinguished; change the filters or the sensor"
    );
    let responses = [("FAD", [1.0, 4.0, 1.0]), ("elastin", [1.0, 2.0, 3.0]), ("porphyrins", [8.0, 1.0, 1.0])]
        .map(|(name, rgb_per_amount)| FluorophoreResponse { name: name.into(), rgb_per_amount });
    let weights = [("FAD".into(), 0.5), ("elastin".into(), 2.0)];
    let line = MixtureLine::from_fluorophores(&responses, &weights, "porphyrins").unwrap();
    assert_eq!(line.rgb(1.0, 0.0), [2.5, 6.0, 6.5]);
    assert_eq!(
        message(MixtureLine::from_fluorophores(&responses, &weights, "porphyrin")),
        "there is no response for the fluorophore \"porphyrin\", only for: FAD, elastin, porphyrins"
    );
}

#[test]
fn known_reflected_light_is_subtracted() {
    let line = line();
    let rgb = line.rgb(900.0, 100.0);
    let leak = [0.0, 50.0, 400.0];
    let image = |values: [f64; 3]| ChannelImage {
        width: 1,
        height: 1,
        channels: ["R", "G", "B"].map(String::from).to_vec(),
        data: values.map(|v| v as f32).to_vec(),
        saturated: vec![false],
        noise_floor_dn: 1.0,
        full_scale_dn: 4000.0,
        shares: vec![0.25, 0.5, 0.25],
        interpolation: None,
        subtracted: None,
        calibration: None,
        label: "blue".into(),
    };
    let noise =
        ChannelNoise { floor_dn: 1.0, dn_per_electron: 0.5, gain_spread: 0.0, lines: LineNoise::default() };
    let region = PixelSelection { width: 1, height: 1, pixels: vec![0] };
    let sum = image(std::array::from_fn(|c| rgb[c] + leak[c]));
    let fraction = |reflected: Option<&ChannelImage>| {
        let map = PorphyrinMap::new(&sum, |_| true, &region, &line, &noise, reflected).unwrap();
        map.estimates[0].1.fraction
    };
    assert!((fraction(Some(&image(leak))) - 0.1).abs() < 1e-6);
    assert!(fraction(None) < 0.08);
    // Left in, the reflected light moves the pixel beside the line by more than noise explains.
    let with_leak = PorphyrinMap::new(&sum, |_| true, &region, &line, &noise, None).unwrap();
    assert!(with_leak.estimates[0].1.is_off_line());
    assert_eq!(with_leak.fractions_on_line(), [None]);
    let masked = PorphyrinMap::new(&sum, |_| false, &region, &line, &noise, None).unwrap();
    assert!(masked.estimates.is_empty());
}
