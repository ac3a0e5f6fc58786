//! Comparisons with numbers of ISETCam, kept in a folder next to the repository. Where it is absent, the tests say so
//! and pass.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::demosaic::Demosaic;
use super::isetcam::IsetcamChain;
use super::isetcam_formula_tests as isetcam;
use super::*;
use crate::image::Mosaic;
use crate::optics::IdealLens;
use crate::spectral::{
    Curve, CurveModel, Irradiance, Spectrum, StandardObserver, WavelengthGrid, daylight_d65,
};

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
    // Elementary charge of ISETCam, C.
    let current_a = sensor.flat_electron_rate(&irradiance)[0] * 1.602_177e-19;
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

/// Filters of ISETCam's default sensor: the file has red at 0.2 and blue at 0.5 of them.
fn default_filters() -> Option<SpectralQe> {
    let data = vector("sensor_filter_transmissivities_small")?;
    let wave = numbers(&data["wave"]);
    let curve = |(channel, scale): (usize, f64)| {
        let values = data["filters"].as_array().unwrap().iter().map(|row| number(&row[channel]) / scale);
        Curve::new(wave.clone(), values.collect()).unwrap()
    };
    let curves = ["R", "G", "B"].into_iter().zip([(0, 0.2), (1, 1.0), (2, 0.5)].map(curve));
    Some(SpectralQe::from_curves(curves).unwrap())
}

#[test]
fn a_color_chart_gives_its_volts() {
    let (Some(qe), Some(optical), Some(sensor)) =
        (default_filters(), vector("oi_diffraction_limited_default"), vector("sensor_bayer_noiseless"))
    else {
        return;
    };
    let wave = numbers(&optical["wave"]);
    let grid = WavelengthGrid::from_centers(&wave).unwrap();
    let model = SensorModel {
        mosaic: [["G", "R"], ["B", "G"]].map(|row| row.map(String::from).to_vec()).to_vec(),
        mode: SensorMode::Isetcam { noise_flag: 0 },
        ..default_pixel()
    };
    let camera = Sensor::new(model.clone(), qe).unwrap();
    let exposure = Exposure { time_s: number(&sensor["integration_time"]), ..Exposure::default() };
    let rows: Vec<Vec<f64>> = sensor["volts"].as_array().unwrap().iter().map(numbers).collect();
    let mosaic = Mosaic::bayer("grbg").unwrap();
    // The chart has 16 samples of 7.041 um per patch; the 88 x 72 pixels of 2.8 um see the four patches in its middle.
    let samples_per_pixel = 7.041 / 2.8;
    for (patch_row, patch_col) in [(1, 2), (1, 3), (2, 2), (2, 3)] {
        let photons = numbers(&optical["photons"]["values"][patch_row * 6 + patch_col]);
        let energy = photons.iter().zip(&wave).map(|(n, nm)| n / isetcam::photons_per_joule(*nm));
        let irradiance = Spectrum::<Irradiance>::from_parts(grid.clone(), energy.collect());
        let patch = camera.flat_response(&irradiance, &exposure).unwrap();
        let center = |patch: usize, chart: f64, pixels: f64| {
            ((patch as f64 * 16.0 + 8.0 - 0.5 * chart) * samples_per_pixel + 0.5 * pixels) as usize
        };
        let (row, col) = (center(patch_row, 64.0, 72.0), center(patch_col, 96.0, 88.0));
        for channel in 0..3 {
            let pixels = (row - 4..row + 4).flat_map(|r| (col - 4..col + 4).map(move |c| (r, c)));
            let seen: Vec<f64> =
                pixels.filter(|&(r, c)| mosaic.channel(r, c) == channel).map(|(r, c)| rows[r][c]).collect();
            // The tolerance of the file; light within a patch varies by the fall-off of the lens.
            let (mean, _) = mean_and_deviation(&seen);
            assert_close(patch.volts[channel], mean, 1e-3, "volts");
        }
    }
}

#[test]
fn signal_to_noise_ratios_of_pixels_of_any_size() {
    let Some(data) = vector("metrics_snr_pixel_size_luxsec_small") else { return };
    let list = |key: &str| numbers(&data[key]);
    for (index, read_mv) in list("read_noise_mv").into_iter().enumerate() {
        let model = SensorModel {
            voltage_swing_v: list("voltage_swing_v")[index],
            read_noise_mv: Some(read_mv),
            ..default_pixel()
        };
        let lux_s = numbers(&data["luxsec_curves"][index]);
        for (step, lux_s) in lux_s.into_iter().enumerate() {
            let snr = isetcam::snr_db(&model, lux_s * list("volts_per_lux_sec")[index]);
            for (actual, key) in [(snr.total, "snr_db"), (snr.shot, "snr_shot_db"), (snr.read, "snr_read_db")]
            {
                let expected = number(&data[key][index][step]);
                // 1e-3 of a ratio are 0.0043 dB.
                assert!((actual - expected).abs() < 0.0043, "{key}: {actual} dB, ISETCam has {expected}");
            }
        }
    }
}

#[test]
fn tables_of_energy_become_photons_and_back() {
    let Some(data) = vector("utility_energy_quanta_matrix") else { return };
    for (row, wave) in numbers(&data["wave"]).into_iter().enumerate() {
        let [energy, photons, back] =
            ["energy", "photons", "energy_roundtrip"].map(|key| numbers(&data[key][row]));
        for ((energy, photons), back) in energy.into_iter().zip(photons).zip(back) {
            assert_close(energy * isetcam::photons_per_joule(wave), photons, 1e-7, "photons");
            assert_close(photons / isetcam::photons_per_joule(wave), back, 1e-7, "energy");
        }
    }
}

/// Samples of a relative curve at wavelengths 10 nm apart, scaled to a luminance as ISETCam sums it.
fn scaled_to_luminance(relative: impl Fn(f64) -> f64, wave: &[f64], luminance: f64) -> Vec<f64> {
    // Bins of 1 nm hold the color-matching functions at whole wavelengths to 1e-5.
    let observer = StandardObserver::new(&WavelengthGrid::uniform(360.0, 830.0, 1.0).unwrap());
    let sampled = |f: &dyn Fn(f64) -> f64| {
        let mut spectrum = vec![0f32; 471];
        wave.iter().for_each(|nm| spectrum[(nm - 360.0) as usize] = 10.0 * f(*nm) as f32);
        observer.xyz(&spectrum)
    };
    let scale = luminance / sampled(&relative)[1];
    wave.iter().map(|nm| scale * relative(*nm)).collect()
}

#[test]
fn black_bodies_have_the_spectrum_of_isetcam() {
    for (case, key) in
        [("utility_blackbody_energy_small", "energy"), ("utility_blackbody_quanta_small", "photons")]
    {
        let Some(data) = vector(case) else { return };
        let wave = numbers(&data["wave"]);
        for (column, temperature_k) in numbers(&data["temperatures"]).into_iter().enumerate() {
            let model = CurveModel::Blackbody { temperature_k, reference_nm: 560.0 };
            let of_file = |row: usize| number(&data[key][row][column]);
            let photons = |nm: f64| if key == "photons" { isetcam::photons_per_joule(nm) } else { 1.0 };
            // Its scale is arbitrary; the shape is compared with that at 550 nm.
            let middle = wave.iter().position(|nm| *nm == 550.0).unwrap();
            let ours = |nm: f64| model.eval(nm) * photons(nm);
            for (row, nm) in wave.iter().enumerate() {
                let expected = of_file(row) / of_file(middle);
                // Its h c / k is 6.6e-6 above the exact one, in an exponent of at most 12: 8e-5.
                assert_close(ours(*nm) / ours(550.0), expected, 1e-4, "black body");
            }
        }
    }
}

#[test]
fn equal_energy_has_its_luminance() {
    let Some(data) = vector("scene_uniform_ee_small") else { return };
    let wave = numbers(&data["wave"]);
    let radiance = scaled_to_luminance(|_| 1.0, &wave, number(&data["mean_luminance"]));
    for ((nm, ours), photons) in wave.iter().zip(radiance).zip(numbers(&data["photons"]["values"])) {
        assert_close(ours * isetcam::photons_per_joule(*nm), photons, 1e-5, "photons");
    }
}

#[test]
fn illuminants_of_a_luminance() {
    let Some(data) = vector("scene_illuminant_small") else { return };
    let check =
        |name: &str, quantity: &str, relative: &dyn Fn(f64) -> f64, luminance: f64, tolerance: f64| {
            let wave = numbers(&data[format!("{name}_wave")]);
            let ours = scaled_to_luminance(relative, &wave, luminance);
            for ((nm, ours), expected) in
                wave.iter().zip(ours).zip(numbers(&data[format!("{name}_{quantity}")]))
            {
                let per_joule = if quantity == "photons" { isetcam::photons_per_joule(*nm) } else { 1.0 };
                assert_close(ours * per_joule, expected, tolerance, &format!("{name} at {nm} nm"));
            }
        };
    check("equal_energy", "energy", &|_| 1.0, 200.0, 1e-5);
    check("equal_photons", "energy", &|nm| 1.0 / nm, 200.0, 1e-5);
    check("equal_photons", "photons", &|nm| 1.0 / nm, 200.0, 1e-5);
    // Its daylight is a little redder than the table of CIE: a smooth tilt, 7e-4 less at 400 nm, 3e-4 more at 700 nm.
    let d65 = daylight_d65();
    check("d65_200", "photons", &|nm| d65.at(nm), 200.0, 8e-4);
    // Its h c / k is 6.6e-6 above the exact one, in an exponent of at most 7: 5e-5.
    let model = CurveModel::Blackbody { temperature_k: 5000.0, reference_nm: 560.0 };
    check("default_blackbody", "photons", &|nm| model.eval(nm), 100.0, 5e-5);
}

#[test]
fn noise_of_an_uneven_image_follows_from_its_mean() {
    let Some(data) = vector("sensor_noise_samples_small") else { return };
    // The variance of each pixel is linear in its mean, so the mean variance is that of the mean voltage, which the dark
    // voltage of 50 ms raises.
    let mean_v = number(&data["noise_free_mean"]) + 1e-3 * 0.05;
    let deviation_v = isetcam::volts_variance(&default_pixel(), mean_v).sqrt();
    // The tolerance of the file. Its image has dark pixels, whose noise is cut at zero.
    assert_close(deviation_v, number(&data["noise_distribution_stats"][0]), 0.05, "deviation");
    assert_close(
        deviation_v * 2f64.sqrt(),
        number(&data["pair_diff_stats"][0]),
        0.05,
        "deviation of a difference",
    );
}

#[test]
fn tristimulus_values() {
    if let Some(data) = vector("metrics_xyz_from_energy_1d") {
        let observer = StandardObserver::new(&WavelengthGrid::uniform(360.0, 830.0, 1.0).unwrap());
        let mut spectrum = vec![0f32; 471];
        for (nm, energy) in numbers(&data["wave"]).into_iter().zip(numbers(&data["energy"])) {
            spectrum[(nm - 360.0) as usize] = 10.0 * energy as f32;
        }
        for (ours, expected) in observer.xyz(&spectrum).into_iter().zip(numbers(&data["xyz"])) {
            // Means over 1 nm instead of samples, and tables rounded to five digits or more.
            assert_close(ours, expected, 1e-4, "XYZ");
        }
    }
}

#[test]
fn light_falls_off_from_the_axis() {
    let Some(data) = vector("oi_cos4th_small") else { return };
    for (name, focal_length_m) in [("default", "focal_length_default_m"), ("long", "focal_length_long_m")] {
        // Its fall-off is over the focal length, as for an object at infinity.
        let lens = IdealLens::new(number(&data[focal_length_m]) * 1e3, 4.0);
        let position = numbers(&data[&format!("pos_{name}_um")]);
        let light = numbers(&data[&format!("center_line_{name}_lux")]);
        let axis =
            (0..position.len()).min_by(|&a, &b| position[a].abs().total_cmp(&position[b].abs())).unwrap();
        for (um, lux) in position.iter().zip(&light).filter(|(_, lux)| **lux > 0.01) {
            let ours = lens.relative_illumination(um.abs() * 1e-3);
            // At f/4 its finite pupil keeps up to 3e-4 more light at 40 degrees than cos⁴ does; diffraction takes some
            // at the edge of the image, which is left out.
            if um.abs() < 0.95 * position.iter().copied().fold(0.0, f64::max) * 0.8 {
                assert_close(ours, lux / light[axis], 4e-4, "fall-off");
            }
        }
    }
}

#[test]
fn every_vector_is_listed_with_what_became_of_it() {
    let Some(index) = reference_file("vectors/pyisetcam/index.csv") else { return };
    let list = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/validation.md");
    let list = std::fs::read_to_string(list).unwrap();
    for line in std::fs::read_to_string(index).unwrap().lines().skip(1) {
        let case = line.split(',').next().unwrap();
        assert!(list.contains(&format!("| {case} |")), "{case} is not in docs/validation.md");
    }
}
