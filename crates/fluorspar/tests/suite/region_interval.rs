//! Are the intervals of a region's porphyrin fraction as wide as the sensor's noise makes them? Whole chain: expose a
//! Bayer sensor, develop, analyze.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use fluorspar::analysis::{
    AnalysisSettings, Analyte, ChannelNoise, FluorophoreResponse, MixtureModel, RegionOfInterest,
    analyze_region,
};
use fluorspar::image::SensorImage;
use fluorspar::pipeline::Calibration;
use fluorspar::sensor::{Demosaicing, Development, ElectronRate, Exposure, Sensor, SensorModel, SpectralQe};
use fluorspar::spectral::Curve;

const SIDE: usize = 24;
const DEVICES: u64 = 240;

fn sensor(device_seed: u64) -> Sensor {
    let qe = ["R", "G", "B"].map(|name| (name, Curve::constant(0.5)));
    let model = SensorModel { columns: SIDE, rows: SIDE, device_seed, ..SensorModel::default() };
    Sensor::new(model, SpectralQe::from_curves(qe).unwrap()).unwrap()
}

/// The same electrons per second for all pixels of a channel.
fn rate(sensor: &Sensor, rgb: [f64; 3]) -> ElectronRate {
    let mosaic = sensor.mosaic();
    let data = (0..SIDE * SIDE).map(|i| {
        let name = &mosaic.channels[mosaic.channel(i / SIDE, i % SIDE)];
        let channel = ["R", "G", "B"].iter().position(|n| n == name).unwrap();
        rgb[channel] as f32
    });
    ElectronRate { columns: SIDE, rows: SIDE, data: data.collect() }
}

const TRUTH: f64 = 0.3;

/// Two responses, and the electrons per second of a mixture of them with the fraction [`TRUTH`].
fn mixture() -> (MixtureModel, [f64; 3]) {
    let (bulk, porphyrin) = ([0.2, 0.5, 0.3], [0.8, 0.15, 0.05]);
    let response = |name: &str, rgb: [f64; 3]| FluorophoreResponse { name: name.into(), rgb_per_amount: rgb };
    let model = MixtureModel {
        responses: vec![response("bulk", bulk), response("porphyrin", porphyrin)],
        bulk_weights: vec![("bulk".into(), 1.0)],
        porphyrin: "porphyrin".into(),
        analyte: Analyte::default(),
        ends: None,
    };
    (model, std::array::from_fn(|c| 40_000.0 * ((1.0 - TRUTH) * bulk[c] + TRUTH * porphyrin[c])))
}

/// Mean square of (estimate - truth) / standard error over many devices. The fluorescence is 0.3 of the way between bulk
/// and porphyrin.
fn mean_square_z(ambient_e_per_s: f64, subtract: bool) -> f64 {
    let (model, light) = mixture();
    let mut sum = 0.0;
    for device in 0..DEVICES {
        let sensor = sensor(device);
        let take = |label: &str, rgb: [f64; 3]| {
            let exposure = Exposure { seed: device, label: label.into(), ..Exposure::default() };
            sensor.expose_rate(&rate(&sensor, rgb), &exposure).unwrap()
        };
        let frame = take("blue", light.map(|v| v + ambient_e_per_s));
        let image = if subtract {
            let linear = |frame: &SensorImage| Development::default().linearize(frame).unwrap();
            let ambient = linear(&take("ambient", [ambient_e_per_s; 3]));
            linear(&frame).without(&ambient).unwrap().demosaic(Demosaicing::Bilinear).unwrap()
        } else {
            Development::default().linearize(&frame).unwrap().demosaic(Demosaicing::Bilinear).unwrap()
        };
        let k = frame.dn_per_electron;
        let sheet = sensor.model();
        let noise = ChannelNoise::of_image(&image, k, sheet.prnu_percent / 100.0, k * sheet.dsnu_electrons());
        let settings = AnalysisSettings::new(RegionOfInterest::default(), noise);
        let (analysis, ..) = analyze_region(&image, None, Some(&model), None, &settings).unwrap();
        let estimate = analysis.mixture.unwrap().region.unwrap().estimate;
        let z = (estimate.fraction - TRUTH) / estimate.fraction_standard_error;
        sum += z * z;
    }
    sum / DEVICES as f64
}

/// A mean square of n standard normal numbers has the standard deviation sqrt(2 / n); five of them, and 10 % for the
/// rim of the image, where the interpolation weighs raw values unevenly.
fn assert_honest(mean_square: f64) {
    let tolerance = 5.0 * (2.0 / DEVICES as f64).sqrt() + 0.1;
    assert!((mean_square - 1.0).abs() < tolerance, "mean square of z is {mean_square}");
}

#[test]
fn the_interval_of_a_region_is_as_wide_as_the_noise() {
    assert_honest(mean_square_z(0.0, false));
}

#[test]
fn the_interval_of_a_region_under_ambient_light_is_as_wide_as_the_noise() {
    assert_honest(mean_square_z(60_000.0, true));
}

const CALIBRATED_DEVICES: u64 = 1200;

/// Share of devices whose 95 % interval holds the truth, where `frames` dark frames of each exposure time, and as many frames of even light
/// of so many electrons in a pixel, calibrate them. The frame has 1000 e- of dark charge, the even light, in half the time, 500.
fn calibrated_coverage(frames: u64, flat_e: f64) -> f64 {
    let (model, light) = mixture();
    let mut held = 0;
    for device in 0..CALIBRATED_DEVICES {
        let qe = ["R", "G", "B"].map(|name| (name, Curve::constant(0.5)));
        let sheet = SensorModel {
            columns: SIDE,
            rows: SIDE,
            device_seed: device,
            dark_current_e_per_s: Some(1000.0 / 0.03),
            ..SensorModel::default()
        };
        let sensor = Sensor::new(sheet, SpectralQe::from_curves(qe).unwrap()).unwrap();
        let take = |time_s: f64, rgb: [f64; 3], label: &str, frame: u64| {
            let exposure =
                Exposure { time_s, seed: device, label: label.into(), frame, ..Exposure::default() };
            sensor.expose_rate(&rate(&sensor, rgb), &exposure).unwrap()
        };
        let series = |time_s: f64, rate: f64, label: &str| -> Vec<SensorImage> {
            (0..frames).map(|frame| take(time_s, [rate; 3], label, frame)).collect()
        };
        let darks = [series(0.03, 0.0, "dark"), series(0.015, 0.0, "dark of flat")].concat();
        let flats = series(0.015, flat_e / 0.015, "flat");
        let calibration = Calibration::of_frames(Demosaicing::Bilinear, darks, flats, None).unwrap();
        let frame = take(0.03, light, "blue", 0);
        let linear = calibration.development(&frame).unwrap().linearize(&frame).unwrap();
        let image = linear.demosaic(Demosaicing::Bilinear).unwrap();
        let noise = ChannelNoise::of_image(&image, frame.dn_per_electron, 0.0, 0.0);
        let settings = AnalysisSettings::new(RegionOfInterest::default(), noise);
        let (analysis, ..) = analyze_region(&image, None, Some(&model), None, &settings).unwrap();
        let estimate = analysis.mixture.unwrap().region.unwrap().estimate;
        let z = (estimate.fraction - TRUTH) / estimate.fraction_standard_error;
        held += u64::from(z.abs() < 1.959_964);
    }
    held as f64 / CALIBRATED_DEVICES as f64
}

/// Calibration frames have noise of their own, as dark charge has. A share of 95 % among so many devices has a standard deviation of
/// 0.0063; three of them.
#[test]
fn the_interval_of_a_calibrated_region_is_as_wide_as_the_noise() {
    let tolerance = 3.0 * (0.95 * 0.05 / CALIBRATED_DEVICES as f64).sqrt();
    for (frames, flat_e) in [(1, 1000.0), (1, 400.0), (3, 1000.0), (16, 1000.0)] {
        let coverage = calibrated_coverage(frames, flat_e);
        assert!((coverage - 0.95).abs() < tolerance, "{frames} frames, {flat_e} e-: {coverage}");
    }
}
