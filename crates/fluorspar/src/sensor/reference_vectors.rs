//! Comparisons with numbers of ISETCam, kept in a folder beside the repository. Where it is absent, the tests say so
//! and pass.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::demosaic::Demosaic;
use super::isetcam::{self, IsetcamChain};
use super::*;
use crate::image::Mosaic;
use crate::spectral::{Curve, Irradiance, Spectrum, WavelengthGrid};

/// A file below the folder that `FLUORSPAR_REFERENCE` names, or below a folder `shared` beside any folder above this
/// crate. Prints a notice where there is none.
fn reference_file(path: &str) -> Option<PathBuf> {
    let found = match std::env::var_os("FLUORSPAR_REFERENCE") {
        Some(folder) => Some(PathBuf::from(folder).join(path)).filter(|file| file.exists()),
        None => Path::new(env!("CARGO_MANIFEST_DIR"))
            .ancestors()
            .map(|folder| folder.join("shared").join(path))
            .find(|file| file.exists()),
    };
    if found.is_none() {
        println!("skipped: no reference file {path}; set FLUORSPAR_REFERENCE to the folder that holds it");
    }
    found
}

fn vector(case: &str) -> Option<Value> {
    let text = std::fs::read_to_string(reference_file(&format!("vectors/pyisetcam/{case}.json"))?).unwrap();
    Some(serde_json::from_str::<Value>(&text).unwrap()["data"].take())
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

fn assert_close(actual: f64, expected: f64, relative: f64, what: &str) {
    let error = (actual - expected).abs();
    assert!(error <= relative * expected.abs(), "{what}: {actual}, ISETCam has {expected}");
}

/// ISETCam's default pixel: 2.8 um, fill factor 0.75, 0.1 mV/e-, 1 V, 10 bit, 1 mV/s, 1 mV, no fixed patterns.
fn default_pixel() -> SensorModel {
    SensorModel {
        columns: 64,
        rows: 64,
        mosaic: vec![vec!["mono".into()]],
        pixel_size_um: 2.8,
        fill_factor: 0.75,
        well_capacity_e: 10_000.0,
        voltage_swing_v: 1.0,
        conversion_gain_mv_per_e: Some(0.1),
        bit_depth: 10,
        read_noise_mv: Some(1.0),
        dsnu_mv: Some(0.0),
        prnu_percent: 0.0,
        dark_voltage_mv_per_s: Some(1.0),
        mode: SensorMode::Isetcam { noise_flag: 2 },
        ..SensorModel::default()
    }
}

/// Clipped volts of `pixels` pixels of a uniform field.
fn clipped_volts(model: &SensorModel, exposure: &Exposure, electrons: f64, pixels: u64) -> Vec<f64> {
    let chain = IsetcamChain::new(model, 2, exposure);
    let volts = |pixel| chain.noisy_volts(0, pixel, electrons).clamp(0.0, model.voltage_swing_v);
    (0..pixels).map(volts).collect()
}

fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt())
}

#[test]
fn energy_becomes_photons() {
    let Some(data) = vector("utility_energy_quanta_1d") else { return };
    let cases = numbers(&data["wave"]).into_iter().zip(numbers(&data["energy"]));
    for ((wave, energy), photons) in cases.zip(numbers(&data["photons"])) {
        // The file keeps eight digits.
        assert_close(energy * isetcam::photons_per_joule(wave), photons, 1e-7, "photons");
    }
}

#[test]
fn quantum_efficiency_is_the_product_of_its_filters() {
    let Some(data) = vector("sensor_filter_transmissivities_small") else { return };
    let wave = numbers(&data["wave"]);
    let grid = WavelengthGrid::from_centers(&wave).unwrap();
    for channel in 0..3 {
        let column =
            |key: &str| data[key].as_array().unwrap().iter().map(|row| number(&row[channel])).collect();
        let filter = Curve::new(wave.clone(), column("filters")).unwrap();
        let qe = SpectralQe::from_curves([("c", filter)]).unwrap().behind(&Curve::constant(1.0));
        let expected: Vec<f64> = column("spectral_qe");
        for (bin, weight) in qe.isetcam_electron_weights(0, &grid, 1.0).iter().enumerate() {
            let photons = isetcam::photons_per_joule(wave[bin]) * 10.0;
            assert_close(weight / photons, expected[bin], 1e-8, "quantum efficiency");
        }
    }
}

#[test]
fn a_uniform_scene_gives_its_current() {
    let Some(data) = vector("sensor_signal_current_uniform_small") else { return };
    // Equal energy at 1 cd/m2 on 400:10:700 nm: 1 / (683 * sum of ybar * 10 nm), with the CIE 1931 sum. Its image at
    // f/4 and f = 3.862755 mm from 1.2 m away.
    let radiance = 1.0 / (683.0 * 106.8148);
    let magnification = 3.862_755 / (1200.0 - 3.862_755);
    let solid_angle = std::f64::consts::PI / (1.0 + 64.0 * (1.0f64 + magnification).powi(2));
    let grid = WavelengthGrid::uniform(400.0, 700.0, 10.0).unwrap();
    let irradiance = Spectrum::<Irradiance>::constant(&grid, radiance * solid_angle);
    let qe = SpectralQe::from_curves([("mono", Curve::constant(1.0))]).unwrap();
    let sensor = Sensor::new(default_pixel(), qe).unwrap();
    let current_a = sensor.flat_electron_rate(&irradiance)[0] * crate::units::ISETCAM_ELEMENTARY_CHARGE_C;
    // Its optical image loses 0.01 to 0.13 % to the dark border through the diffraction that we leave out.
    let peak = number(&data["current_center"]["values"][2]);
    let loss = 1.0 - peak / current_a;
    assert!((0.0..0.0013).contains(&loss), "{current_a} A, ISETCam has {peak}");
}

#[test]
fn signal_to_noise_ratios_by_source() {
    let Some(data) = vector("sensor_snr_components_small") else { return };
    let model =
        SensorModel { read_noise_mv: Some(3.0), prnu_percent: 2.0, dsnu_mv: Some(5.0), ..default_pixel() };
    for (index, volts) in numbers(&data["volts"]).into_iter().enumerate() {
        let snr = isetcam::snr_db(&model, volts);
        let of = |key: &str| number(&data[key][index]);
        // Eight digits of the voltage are 4e-7 dB, of the ratio at most 5e-7 dB; 1e-5 dB covers their sum and its zero.
        for (actual, key) in [
            (snr.total, "snr"),
            (snr.shot, "snr_shot"),
            (snr.read, "snr_read"),
            (snr.dsnu, "snr_dsnu"),
            (snr.prnu, "snr_prnu"),
        ] {
            assert!((actual - of(key)).abs() < 1e-5, "{key} at {volts} V: {actual}, ISETCam has {}", of(key));
        }
    }
}

#[test]
fn volts_are_linear_in_time_until_the_swing() {
    let Some(data) = vector("sensor_exposure_bracket_small") else { return };
    let (times, volts) = (numbers(&data["integration_times"]), numbers(&data["center_pixel"]));
    let model = default_pixel();
    let electrons_per_s = volts[0] / 1e-4 / times[0];
    for (time_s, volts) in times.iter().zip(volts) {
        let exposure = Exposure { time_s: *time_s, ..Exposure::default() };
        let ours = isetcam::mean_volts(&model, 0, &exposure, electrons_per_s * time_s);
        // Its images are in single precision, from an optical image in single precision.
        assert_close(ours, volts, 1e-6, "volts");
    }
}

#[test]
fn dark_voltage_grows_with_time() {
    let Some(data) = vector("sensor_dark_voltage_small") else { return };
    let times = numbers(&data["exp_times"]);
    for (index, (time_s, expected)) in times.into_iter().zip(numbers(&data["mean_volts"])).enumerate() {
        let exposure = Exposure { time_s, frame: index as u64, ..Exposure::default() };
        // Both are means over about 3168 green pixels; 5 standard errors of their difference.
        let (mean, deviation) = mean_and_deviation(&clipped_volts(&default_pixel(), &exposure, 0.0, 3168));
        let tolerance = 5.0 * deviation * (2.0f64 / 3168.0).sqrt();
        assert!((mean - expected).abs() < tolerance, "{time_s} s: {mean} V, ISETCam has {expected}");
    }
}

#[test]
fn offsets_are_drawn_anew_and_clipped_at_zero() {
    let Some(data) = vector("sensor_dsnu_estimate_small") else { return };
    let model = SensorModel { dsnu_mv: Some(50.0), prnu_percent: 0.1, ..default_pixel() };
    // Mean over 25 frames of each of 4096 pixels; its signal is a third of an electron.
    let mut sums = vec![0.0; 4096];
    for frame in 0..25 {
        let exposure = Exposure { time_s: 1e-3, frame, ..Exposure::default() };
        for (sum, volts) in sums.iter_mut().zip(clipped_volts(&model, &exposure, 0.33, 4096)) {
            *sum += volts / 25.0;
        }
    }
    let (mean, deviation) = mean_and_deviation(&sums);
    let expected = number(&data["mean_offset_mean"]);
    // Standard error of each mean is deviation / 64, of each deviation about deviation / sqrt(2 * 4096); five of them
    // times sqrt(2) for the difference.
    assert!((mean - expected).abs() < 7.1 * deviation / 64.0, "mean {mean}, ISETCam has {expected}");
    assert_close(deviation, number(&data["mean_offset_std"]), 7.1 / (2.0f64 * 4096.0).sqrt(), "deviation");
}

#[test]
fn a_uniform_field_has_the_noise_of_isetcam() {
    let Some(data) = vector("sensor_monochrome_noise_stats") else { return };
    let expected_mean = number(&data["mean"]);
    let exposure = Exposure { time_s: 0.0, ..Exposure::default() };
    let volts = clipped_volts(&default_pixel(), &exposure, expected_mean / 1e-4, 20_000);
    let (mean, deviation) = mean_and_deviation(&volts);
    assert!((mean - expected_mean).abs() < 5.0 * deviation / 20_000f64.sqrt(), "{mean}");
    // Its deviation is over 72 * 88 pixels at most: a standard error of 1 / sqrt(2 * 6336) = 0.9 %; three of them.
    assert_close(deviation, number(&data["std"]), 0.027, "deviation");
}

#[test]
fn a_bayer_image_is_interpolated_the_same() {
    let Some(data) = vector("ip_default_pipeline") else { return };
    let rows = data["input"].as_array().unwrap();
    let values: Vec<f32> = rows.iter().flat_map(numbers).map(|v| v as f32).collect();
    let (width, height) = (values.len() / rows.len(), rows.len());
    let mosaic = Mosaic::bayer("grbg").unwrap();
    let (ours, _) = Demosaic::new(&mosaic).interpolate(&values, &vec![false; values.len()], width, height);
    let expected = data["sensorspace"].as_array().unwrap().iter().flat_map(|row| row.as_array().unwrap());
    for (ours, expected) in ours.chunks_exact(3).zip(expected) {
        for (ours, expected) in ours.iter().zip(numbers(expected)) {
            // Single precision: four additions of 2^-24 each.
            assert_close(f64::from(*ours), expected, 3e-7, "interpolated volts");
        }
    }
}
