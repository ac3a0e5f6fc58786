//! The sensor measured as a laboratory would: photon transfer, fixed patterns, distributions.

use fluorspar_testkit::{chi_square, sidak};

use super::isetcam::IsetcamChain;
use super::isetcam_formula_tests::volts_variance;
use super::physical_chain::poisson;
use super::*;
use crate::image::{SensorImage, SpectralImage};
use crate::sampling::random::Key;
use crate::spectral::{Curve, Irradiance, WavelengthGrid};

fn model(side: usize) -> SensorModel {
    SensorModel { columns: side, rows: side, mosaic: vec![vec!["mono".into()]], ..SensorModel::default() }
}

fn sensor(model: SensorModel) -> Sensor {
    Sensor::new(model, SpectralQe::from_curves([("mono", Curve::constant(0.6))]).unwrap()).unwrap()
}

/// A uniform exposure of `electrons` per pixel.
fn flat(sensor: &Sensor, electrons: f64, frame: u64) -> SensorImage {
    let exposure = Exposure { time_s: 0.01, frame, seed: 17, ..Exposure::default() };
    let (columns, rows) = (sensor.model().columns, sensor.model().rows);
    let data = vec![(electrons / exposure.time_s) as f32; columns * rows];
    sensor.expose_rate(&ElectronRate { columns, rows, data }, &exposure).unwrap()
}

fn values(image: &SensorImage) -> Vec<f64> {
    image.data.iter().map(|&dn| f64::from(dn)).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)
}

/// Temporal variance from two frames: half the variance of their difference.
fn pair_variance(a: &[f64], b: &[f64]) -> f64 {
    let difference: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    0.5 * variance(&difference)
}

fn mean_of_frames(sensor: &Sensor, electrons: f64, frames: std::ops::Range<u64>) -> Vec<f64> {
    let count = (frames.end - frames.start) as f64;
    let mut sum = vec![0.0; sensor.model().columns * sensor.model().rows];
    for frame in frames {
        for (sum, dn) in sum.iter_mut().zip(values(&flat(sensor, electrons, frame))) {
            *sum += dn / count;
        }
    }
    sum
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a), mean(b));
    let products: Vec<f64> = a.iter().zip(b).map(|(a, b)| (a - mean_a) * (b - mean_b)).collect();
    mean(&products) / (variance(a) * variance(b)).sqrt()
}

#[test]
fn counts_follow_the_poisson_distribution() {
    let draws = 40_000u64;
    let means_e = [0.1, 1.0, 10.0, 1000.0];
    for expected_e in means_e {
        let (mut observed, mut expected) = (vec![0.0; 2000], vec![0.0; 2000]);
        for pixel in 0..draws {
            observed[poisson(expected_e, Key::new(23).with(pixel)) as usize] += 1.0;
        }
        let mut ln_probability = -expected_e;
        for (k, count) in expected.iter_mut().enumerate() {
            if k > 0 {
                ln_probability += expected_e.ln() - (k as f64).ln();
            }
            *count = draws as f64 * ln_probability.exp();
        }
        chi_square(&observed, &expected).assert_accepted(sidak(1e-3, means_e.len()));
    }
}

#[test]
fn photon_transfer_recovers_gain_read_noise_and_fixed_patterns() {
    let sensor = sensor(SensorModel { mode: SensorMode::Physical, ..model(200) });
    let (n, frames) = (40_000.0f64, 32);
    let relative_error_of_variance = (2.0 / n).sqrt();
    let base_k = sensor.model().base_dn_per_electron();

    let dark: Vec<Vec<f64>> = (0..2).map(|frame| values(&flat(&sensor, 0.0, frame))).collect();
    let dark_variance = pair_variance(&dark[0], &dark[1]);
    let levels = [1000.0, 2000.0, 3000.0, 4000.0, 5000.0, 6000.0, 7000.0];
    let mut gains = Vec::new();
    for level in levels {
        let pair = [2, 3].map(|frame| values(&flat(&sensor, level, frame)));
        let signal = 0.5 * (mean(&pair[0]) + mean(&pair[1])) - mean(&dark[0]);
        gains.push((pair_variance(&pair[0], &pair[1]) - dark_variance) / signal);
    }
    // Each gain has the relative error of its variance, up to 1.19 of it where read noise still counts (1000 e-); they
    // share a dark frame whose own error is a fifth of that. Five standard errors of their mean.
    let tolerance = 5.0 * 1.25 * relative_error_of_variance / (levels.len() as f64).sqrt();
    assert!((mean(&gains) / base_k - 1.0).abs() < tolerance, "K {}, set {base_k}", mean(&gains));

    // Quantization adds 1/12 DN². A deviation has half the relative error of its variance.
    let read_e = (dark_variance - 1.0 / 12.0).sqrt() / base_k;
    let set_e = sensor.model().read_noise_electrons();
    assert!((read_e / set_e - 1.0).abs() < 2.5 * relative_error_of_variance, "{read_e} e-, set {set_e}");

    // Dark frames averaged: DSNU² and the temporal variance over `frames` remain, about equal, so the relative error of
    // their difference is twice that of a variance, and that of its root once.
    let dark_mean = mean_of_frames(&sensor, 0.0, 0..frames);
    let dsnu_dn2 = variance(&dark_mean) - dark_variance / frames as f64;
    let dsnu_e = dsnu_dn2.sqrt() / base_k;
    let set_e = sensor.model().dsnu_electrons();
    assert!((dsnu_e / set_e - 1.0).abs() < 5.0 * relative_error_of_variance, "{dsnu_e} e-, set {set_e}");

    // Flats averaged over 8 frames at 5000 e-: PRNU is 97 % of the variance that remains.
    let flat_mean = mean_of_frames(&sensor, 5000.0, 100..108);
    let temporal_dn2 = base_k * base_k * 5000.0 + dark_variance;
    let prnu_dn2 = variance(&flat_mean) - dsnu_dn2 - temporal_dn2 / 8.0;
    let prnu = 100.0 * prnu_dn2.sqrt() / (mean(&flat_mean) - mean(&dark_mean));
    let tolerance = 5.0 * 0.5 * relative_error_of_variance * 1.1;
    assert!((prnu / 2.29 - 1.0).abs() < tolerance, "PRNU {prnu} %, set 2.29 %");
}

#[test]
fn the_variance_of_one_frame_is_the_sum_of_its_sources() {
    let sensor =
        sensor(SensorModel { post_gain_noise_mv: 0.5, dark_current_e_per_s: Some(2000.0), ..model(200) });
    let sheet = sensor.model();
    let (k, prnu) = (sheet.base_dn_per_electron(), sheet.prnu_percent * 1e-2);
    let post_dn = 0.5e-3 / sheet.volts_per_dn();
    for electrons in [0.0, 50.0, 500.0, 4000.0] {
        let image = values(&flat(&sensor, electrons, 5));
        let dark_e = 2000.0 * 0.01;
        let variance_e2 = electrons
            + dark_e
            + (prnu * electrons).powi(2)
            + sheet.read_noise_electrons().powi(2)
            + sheet.dsnu_electrons().powi(2);
        let variance_dn2 = k * k * variance_e2 + post_dn * post_dn + 1.0 / 12.0;
        let tolerance = 5.0 * variance_dn2 * (2.0f64 / 40_000.0).sqrt();
        assert!((variance(&image) - variance_dn2).abs() < tolerance, "{electrons} e-: {}", variance(&image));
        let mean_dn = k * (electrons + dark_e) + 64.0;
        assert!((mean(&image) - mean_dn).abs() < 5.0 * (variance_dn2 / 40_000.0).sqrt(), "{electrons} e-");
    }
}

#[test]
fn fixed_patterns_stay_and_the_rest_does_not() {
    // PRNU 114.5 e- at 5000 e-, temporal noise 72 e- / 8 after 64 frames: an expected correlation of 0.994, with a
    // standard error of (1 - 0.994²) / 64 = 0.0002.
    let physical = sensor(model(64));
    let averages = [0..64, 64..128].map(|frames| mean_of_frames(&physical, 5000.0, frames));
    assert!(correlation(&averages[0], &averages[1]) > 0.99);
    let other_device = sensor(SensorModel { device_seed: 2, ..model(64) });
    let single = values(&flat(&physical, 5000.0, 0));
    // Standard error of no correlation: 1 / 64.
    assert!(correlation(&single, &values(&flat(&other_device, 5000.0, 1))).abs() < 5.0 / 64.0);
    let redrawn = sensor(SensorModel { mode: SensorMode::Isetcam { noise_flag: 2 }, ..model(64) });
    let frames = [0, 1].map(|frame| values(&flat(&redrawn, 5000.0, frame)));
    assert!(correlation(&frames[0], &frames[1]).abs() < 5.0 / 64.0);
}

#[test]
fn row_and_column_patterns_have_their_size() {
    let quiet = SensorModel {
        read_noise_e: Some(0.0),
        dsnu_e: Some(0.0),
        prnu_percent: 0.0,
        dark_current_e_per_s: Some(0.0),
        ..model(256)
    };
    let column_means = |image: &SensorImage| -> Vec<f64> {
        (0..256)
            .map(|col| mean(&(0..256).map(|row| f64::from(image.data[row * 256 + col])).collect::<Vec<_>>()))
            .collect()
    };
    // 8 mV are 36 DN: rounding is nothing. The deviation of 256 lines has a relative error of 1 / sqrt(512).
    let sigma_dn = 8e-3 / quiet.volts_per_dn();
    let columns = sensor(SensorModel { column_offset_mv: 8.0, black_level_dn: 2000.0, ..quiet.clone() });
    let deviation = variance(&column_means(&flat(&columns, 0.0, 0))).sqrt();
    assert!((deviation / sigma_dn - 1.0).abs() < 5.0 / 512f64.sqrt(), "{deviation} DN, set {sigma_dn}");
    let rows = sensor(SensorModel { row_offset_mv: 8.0, black_level_dn: 2000.0, ..quiet });
    let image = flat(&rows, 0.0, 0);
    assert!(variance(&column_means(&image)) < 1e-12);
    let deviation = variance(&values(&image)).sqrt();
    assert!((deviation / sigma_dn - 1.0).abs() < 5.0 / 512f64.sqrt(), "{deviation} DN, set {sigma_dn}");
}

#[test]
fn dark_currents_spread_around_their_mean() {
    let spread = 0.5f64;
    let hot = SensorModel {
        dark_current_e_per_s: Some(1e5),
        dark_current_log_spread: spread,
        dsnu_e: Some(0.0),
        ..model(200)
    };
    let hot = sensor(hot);
    let image = values(&flat(&hot, 0.0, 0));
    // 1000 e- in 10 ms; the log-normal variance exp(s²) - 1 of the squared mean, shot and read noise.
    let k = hot.model().base_dn_per_electron();
    let deviation = k * ((spread * spread).exp_m1() * 1e6 + 1000.0 + 189.0).sqrt();
    let error = (mean(&image) - 64.0 - 1000.0 * k).abs();
    assert!(error < 5.0 * deviation / 200.0, "{} DN", mean(&image));
    // Variance of a variance from the fourth moment of the log-normal: kurtosis 8.9 at s = 0.5, (8.9 - 1) / 40000.
    let relative = variance(&image) / (deviation * deviation) - 1.0;
    assert!(relative.abs() < 5.0 * (7.9f64 / 40_000.0).sqrt(), "{relative}");
}

#[test]
fn isetcam_volts_have_the_variance_of_their_formula() {
    let model = SensorModel { mode: SensorMode::Isetcam { noise_flag: 2 }, ..model(10) };
    let exposure = Exposure { time_s: 2.0, ..Exposure::default() };
    let chain = IsetcamChain::new(&model, 2, &exposure);
    for electrons in [2.0, 30.0, 500.0, 7000.0] {
        let volts: Vec<f64> = (0..100_000).map(|pixel| chain.noisy_volts(0, pixel, electrons)).collect();
        let g = model.conversion_gain_v_per_e();
        let mean_v = (electrons + model.dark_electrons_per_s() * 2.0) * g;
        let expected = volts_variance(&model, mean_v);
        assert!((mean(&volts) - mean_v).abs() < 5.0 * (expected / 1e5).sqrt(), "{electrons} e-");
        let tolerance = 5.0 * expected * (2.0f64 / 1e5).sqrt();
        assert!((variance(&volts) - expected).abs() < tolerance, "{electrons} e-: {}", variance(&volts));
    }
}

#[test]
fn isetcam_dark_frames_are_clipped_at_zero() {
    let model = SensorModel {
        mode: SensorMode::Isetcam { noise_flag: 2 },
        dark_current_e_per_s: Some(0.0),
        dsnu_e: Some(0.0),
        bit_depth: 15,
        ..model(200)
    };
    let step_v = model.volts_per_dn();
    let image = values(&flat(&sensor(model), 0.0, 0));
    // Half a normal distribution: mean sigma / sqrt(2 pi) = 0.5545 mV, variance sigma² (1/2 - 1 / (2 pi)).
    let (sigma, half) = (1.39e-3, 0.5 - 1.0 / std::f64::consts::TAU);
    let expected = sigma / std::f64::consts::TAU.sqrt();
    assert!((mean(&image) * step_v - expected).abs() < 5.0 * sigma * (half / 40_000.0f64).sqrt());
    // Codes of 0: half of the pixels and those within half a step, sqrt(n) / 2 standard error.
    let zeros = image.iter().filter(|&&dn| dn == 0.0).count() as f64;
    let near = 40_000.0 * 0.5 * step_v / sigma / std::f64::consts::TAU.sqrt();
    assert!((zeros - 20_000.0 - near).abs() < 5.0 * 100.0, "{zeros} zeros");
}

/// Means over pixels of a frame without noise are those of noisy frames, fractions of a code included: within five standard errors
/// of the noisy frames. The dither itself is even to a code over the square root of the pixels, at worst.
#[test]
fn a_frame_without_noise_is_the_mean_of_noisy_frames() {
    let (quiet, noisy) = (
        sensor(SensorModel { mode: SensorMode::NoiseFree, ..model(200) }),
        sensor(SensorModel { prnu_percent: 0.0, ..model(200) }),
    );
    for electrons in [10.25, 101.3, 1003.7] {
        let [a, b] = [&quiet, &noisy].map(|sensor| values(&flat(sensor, electrons, 0)));
        let error = (variance(&b) / b.len() as f64).sqrt();
        let off = mean(&a) - mean(&b);
        assert!(off.abs() < 5.0 * error + 0.005, "{electrons} e-: {off} DN, standard error {error}");
    }
}

#[test]
fn full_pixels_are_marked_in_every_mode() {
    for (mode, gain, code) in [
        (SensorMode::Physical, 1.0, 4095),
        (SensorMode::NoiseFree, 1.0, 4095),
        (SensorMode::Isetcam { noise_flag: 0 }, 1.0, 4096),
        (SensorMode::Isetcam { noise_flag: 2 }, 1.0, 4096),
    ] {
        let sensor = sensor(SensorModel { mode, analog_gain: gain, ..model(32) });
        let image = flat(&sensor, 1e5, 0);
        assert_eq!(image.white_level, code);
        assert!(image.data.iter().all(|&dn| dn == code), "{mode:?}");
        let saturated = |raw| Development::default().linearize(raw).unwrap().saturated;
        assert!(saturated(&image).iter().all(|&s| s));
        assert!(saturated(&flat(&sensor, 4000.0, 0)).iter().all(|&s| !s));
    }
    // A well that fills before the converter: noise is still there, the mark too.
    let small =
        sensor(SensorModel { well_capacity_e: 5000.0, conversion_gain_mv_per_e: Some(0.1), ..model(64) });
    let image = flat(&small, 1e5, 0);
    assert!(image.white_level < 2400, "{}", image.white_level);
    let below = image.data.iter().filter(|&&dn| dn < image.white_level).count();
    assert!(below <= 2, "{below} of 4096 full pixels below the white level; 0.13 expected");
    // Without clipping ISETCam's flag -1 passes the last code.
    let unclipped = sensor(SensorModel { mode: SensorMode::Isetcam { noise_flag: -1 }, ..model(4) });
    assert!(flat(&unclipped, 14_000.0, 0).data.iter().all(|&dn| dn == 6372));
}

#[test]
fn gain_beats_the_noise_behind_it() {
    let noisy_converter = SensorModel { post_gain_noise_mv: 2.0, ..model(100) };
    let floor_e = |gain| {
        let sensor = sensor(SensorModel { analog_gain: gain, ..noisy_converter.clone() });
        let image = flat(&sensor, 0.0, 0);
        image.read_noise_dn / image.dn_per_electron
    };
    let (read_e, post_e) = (13.732, 2e-3 / noisy_converter.conversion_gain_v_per_e());
    assert!((floor_e(1.0) - f64::hypot(read_e, post_e)).abs() < 1e-3);
    assert!((floor_e(8.0) - f64::hypot(read_e, post_e / 8.0)).abs() < 1e-3);
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let grid = WavelengthGrid::uniform(400.0, 700.0, 10.0).unwrap();
    let mut light = SpectralImage::<Irradiance>::zeros(grid, 37, 23);
    for (index, value) in light.data_mut().iter_mut().enumerate() {
        *value = 1e-3 * ((index * 31 % 97) as f32);
    }
    let color =
        SensorModel { columns: 101, rows: 67, row_offset_mv: 0.1, column_gain_percent: 0.1, ..model(1) };
    for mode in [SensorMode::Physical, SensorMode::Isetcam { noise_flag: 2 }] {
        let sensor = sensor(SensorModel { mode, ..color.clone() });
        let with_threads = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| sensor.expose(&light, &Exposure::default()).unwrap())
        };
        assert_eq!(with_threads(1), with_threads(2));
    }
}

#[test]
fn seed_frame_and_label_each_change_the_noise() {
    let sensor = sensor(model(16));
    let rate = ElectronRate { columns: 16, rows: 16, data: vec![1e4; 256] };
    let base = Exposure::default();
    let image = |exposure: &Exposure| sensor.expose_rate(&rate, exposure).unwrap().data;
    assert_eq!(image(&base), image(&base));
    assert_ne!(image(&base), image(&Exposure { seed: 1, ..base.clone() }));
    assert_ne!(image(&base), image(&Exposure { frame: 1, ..base.clone() }));
    assert_ne!(image(&base), image(&Exposure { label: "blue".into(), ..base.clone() }));
}

#[test]
fn the_numbers_of_a_seed_are_stable() {
    // A change here changes every noisy image ever made: say so in the release notes.
    let codes = |mode| flat(&sensor(SensorModel { mode, ..model(3) }), 300.0, 0).data;
    assert_eq!(codes(SensorMode::Physical), [200, 202, 215, 198, 198, 189, 193, 200, 201]);
    assert_eq!(codes(SensorMode::Isetcam { noise_flag: 2 }), [140, 138, 147, 135, 130, 126, 122, 131, 136]);
    assert_eq!(flat(&sensor(model(3)), 5.0, 0).data, [69, 60, 68, 55, 65, 56, 58, 68, 71]);
}
