//! Regions, binning, crosstalk, shutters, defects and soft wells in whole frames.

use super::physical_chain::defect_pixels;
use super::*;
use crate::image::{SensorImage, SpectralImage};
use crate::spectral::{Curve, Irradiance, Spectrum, WavelengthGrid};

fn rgb() -> SpectralQe {
    let curve =
        |peak_nm: f64| Curve::from_fn(350.0, 750.0, |nm| 0.5 * (-((nm - peak_nm) / 60.0).powi(2)).exp());
    SpectralQe::from_curves([("R", curve(610.0)), ("G", curve(540.0)), ("B", curve(460.0))]).unwrap()
}

fn mono(model: SensorModel) -> Sensor {
    let model = SensorModel { mosaic: vec![vec!["mono".into()]], ..model };
    Sensor::new(model, SpectralQe::from_curves([("mono", Curve::constant(0.6))]).unwrap()).unwrap()
}

fn base(columns: usize, rows: usize) -> SensorModel {
    SensorModel { columns, rows, ..SensorModel::default() }
}

fn quiet(columns: usize, rows: usize) -> SensorModel {
    SensorModel { mode: SensorMode::NoiseFree, dark_current_e_per_s: Some(0.0), ..base(columns, rows) }
}

fn even(sensor: &Sensor, electrons: f64, frame: u64) -> SensorImage {
    let exposure = Exposure { time_s: 0.01, frame, seed: 5, ..Exposure::default() };
    sensor.expose_even(electrons / 0.01, &exposure).unwrap()
}

fn numbers(image: &SensorImage) -> Vec<f64> {
    image.data.iter().map(|&dn| f64::from(dn)).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)
}

fn pair_variance(sensor: &Sensor, electrons: f64) -> f64 {
    let (a, b) = (numbers(&even(sensor, electrons, 0)), numbers(&even(sensor, electrons, 1)));
    0.5 * variance(&a.iter().zip(&b).map(|(a, b)| a - b).collect::<Vec<_>>())
}

#[test]
fn a_region_is_the_crop_of_the_whole_frame() {
    let noisy = SensorModel {
        row_noise_mv: 0.5,
        column_noise_mv: 0.5,
        row_offset_mv: 0.3,
        column_gain_percent: 0.5,
        hot_pixels_per_million: 5e4,
        dark_current_log_spread: 0.4,
        ..base(40, 30)
    };
    for mode in [SensorMode::Physical, SensorMode::Isetcam { noise_flag: 2 }] {
        let model = match mode {
            SensorMode::Isetcam { .. } => base(40, 30),
            _ => noisy.clone(),
        };
        let whole = Sensor::new(SensorModel { mode, ..model }, rgb()).unwrap();
        let part = SensorModel { region_px: Some([7, 5, 20, 11]), ..whole.model().clone() };
        let part = Sensor::new(part, rgb()).unwrap();
        let mut light = SpectralImage::<Irradiance>::zeros(WavelengthGrid::default(), 40, 30);
        for (index, value) in light.data_mut().iter_mut().enumerate() {
            *value = 2e-5 * (index * 31 % 97) as f32;
        }
        let (whole, part) = (
            whole.expose(&light, &Exposure::default()).unwrap(),
            part.expose(&light, &Exposure::default()).unwrap(),
        );
        assert_eq!((part.width, part.height), (20, 11));
        for row in 0..11 {
            let from = (row + 5) * 40 + 7;
            assert_eq!(part.data[row * 20..][..20], whole.data[from..from + 20], "{mode:?} row {row}");
            assert!(
                (0..20).all(|col| part.mosaic.channel(row, col) == whole.mosaic.channel(row + 5, col + 7))
            );
        }
    }
}

#[test]
fn binning_adds_light_and_reads_once_or_often() {
    let binned = |kind| {
        let binning = Binning { kind, columns: 2, rows: 2, well_capacity_e: None };
        let model =
            SensorModel { prnu_percent: 0.0, dsnu_e: Some(0.0), binning: Some(binning), ..base(256, 256) };
        mono(model)
    };
    let single = mono(SensorModel { prnu_percent: 0.0, dsnu_e: Some(0.0), ..base(256, 256) });
    let k = single.model().base_dn_per_electron();
    let read_e2 = single.model().read_noise_electrons().powi(2);
    // 16 384 pixels: a variance has a relative standard error of 1.1 %, five of them.
    let close = |measured: f64, expected: f64| {
        assert!(
            (measured / expected - 1.0).abs() < 5.0 * (2.0f64 / 16_384.0).sqrt(),
            "{measured}, {expected}"
        );
    };
    let rounding = 1.0 / 12.0;
    let charge = binned(BinningKind::Charge);
    let image = even(&charge, 400.0, 0);
    assert_eq!((image.width, image.height, image.bit_depth), (128, 128, 12));
    assert!((mean(&numbers(&image)) - image.black_level - k * 1600.0).abs() < 5.0 * k * 43.0 / 128.0);
    close(pair_variance(&charge, 400.0), k * k * (1600.0 + read_e2) + rounding);
    close(pair_variance(&charge, 0.0), image.read_noise_dn.powi(2) + rounding);

    let sum = binned(BinningKind::DigitalSum);
    let image = even(&sum, 400.0, 0);
    assert_eq!((image.bit_depth, image.black_level, image.white_level), (14, 256.0, 4 * 4095));
    assert!((mean(&numbers(&image)) - 256.0 - k * 1600.0).abs() < 5.0 * k * 49.0 / 128.0);
    close(pair_variance(&sum, 400.0), k * k * (1600.0 + 4.0 * read_e2) + 4.0 * rounding);
    close(pair_variance(&sum, 0.0), image.read_noise_dn.powi(2) + 4.0 * rounding);

    let average = binned(BinningKind::DigitalAverage);
    let image = even(&average, 400.0, 0);
    assert_eq!((image.bit_depth, image.black_level), (12, 64.0));
    assert!((image.dn_per_electron - 0.25 * k).abs() < 1e-12);
    close(
        pair_variance(&average, 400.0),
        k * k * (1600.0 + 4.0 * read_e2) / 16.0 + rounding / 4.0 + rounding,
    );
}

#[test]
fn patch_and_image_agree_for_binned_sensors() {
    let light = Spectrum::<Irradiance>::constant(&WavelengthGrid::default(), 3e-4);
    let mut image = SpectralImage::zeros(light.grid().clone(), 8, 8);
    image.data_mut().fill(3e-4);
    for kind in [BinningKind::Charge, BinningKind::DigitalSum, BinningKind::DigitalAverage] {
        let binning = Binning { kind, columns: 2, rows: 2, well_capacity_e: None };
        let sensor = Sensor::new(SensorModel { binning: Some(binning), ..quiet(8, 8) }, rgb()).unwrap();
        for time_s in [0.0, 0.005, 0.2] {
            let exposure = Exposure { time_s, ..Exposure::default() };
            let raw = sensor.expose(&image, &exposure).unwrap();
            let patch = sensor.flat_response(&light, &exposure).unwrap();
            // Each of four reads is rounded.
            let limit = if kind == BinningKind::DigitalSum { 2.0 } else { 1.0 };
            for (pixel, dn) in raw.data.iter().enumerate() {
                let channel = raw.mosaic.channel(pixel / 4, pixel % 4);
                let expected = patch.dn[channel];
                assert!(
                    (f64::from(*dn) - expected).abs() <= limit + 1e-5 * expected,
                    "{kind:?} {dn} {expected}"
                );
            }
            assert!((raw.black_level - patch.black_level).abs() < 1e-9);
        }
    }
}

#[test]
fn crosstalk_mixes_colors_as_the_effective_efficiency_says() {
    let crosstalk = Crosstalk {
        optical_side_percent: 1.0,
        optical_corner_percent: 0.2,
        electrical_side_percent: vec![[450.0, 0.5], [650.0, 3.0]],
        electrical_corner_ratio: 0.3,
        ..Crosstalk::default()
    };
    let sensor = Sensor::new(SensorModel { crosstalk: Some(crosstalk), ..quiet(12, 12) }, rgb()).unwrap();
    let grid = WavelengthGrid::default();
    let mut image = SpectralImage::zeros(grid.clone(), 12, 12);
    let spectrum: Vec<f64> = (0..grid.len()).map(|b| 1e-4 * (1.0 + (b % 7) as f64)).collect();
    for pixel in image.data_mut().chunks_exact_mut(spectrum.len()) {
        for (value, light) in pixel.iter_mut().zip(&spectrum) {
            *value = *light as f32;
        }
    }
    let rate = sensor.electron_rate(&image);
    let light = Spectrum::<Irradiance>::from_parts(grid, spectrum);
    let flat = sensor.flat_electron_rate(&light);
    let alone = Sensor::new(quiet(12, 12), rgb()).unwrap().flat_electron_rate(&light);
    for (channel, expected) in flat.iter().enumerate() {
        // Away from the border; both greens of a cell, whose rates differ only by rounding.
        let of_channel: Vec<f64> = (2..10)
            .flat_map(|row| (2..10).map(move |col| (row, col)))
            .filter(|&(row, col)| sensor.mosaic().channel(row, col) == channel)
            .map(|(row, col)| f64::from(rate.data[row * 12 + col]))
            .collect();
        // The grid of the efficiency is 1 nm, its product with the share is not piecewise linear: 1e-4.
        assert!(
            (mean(&of_channel) / expected - 1.0).abs() < 1e-4,
            "{channel}: {} {expected}",
            mean(&of_channel)
        );
        assert!((expected / alone[channel] - 1.0).abs() > 1e-3, "crosstalk changes channel {channel}");
    }
    // Crosstalk loses nothing: two greens, a red and a blue.
    let cell = |rates: &[f64]| rates[0] + 2.0 * rates[1] + rates[2];
    assert!((cell(&flat) / cell(&alone) - 1.0).abs() < 1e-4);
}

#[test]
fn a_rolling_shutter_bands_pulsed_light_and_leaves_steady_light_alone() {
    let shutter = Shutter { kind: ShutterKind::Rolling, row_time_us: 1000.0, ..Shutter::default() };
    let strobe = Strobe { delay_ms: 5.0, duration_ms: Some(5.0), frequency_hz: None, duty: 1.0 };
    let steady = mono(SensorModel { shutter, ..quiet(4, 20) });
    let rows = |sensor: &Sensor| -> Vec<f64> {
        let image = even(sensor, 2000.0, 0);
        image.data.chunks_exact(4).map(|row| f64::from(row[0]) - image.black_level).collect()
    };
    let k = steady.model().base_dn_per_electron();
    // Rounding, spread over the pixels, moves a value by less than a code.
    assert!(rows(&steady).iter().all(|dn| (dn - k * 2000.0).abs() < 1.0));
    // Row r is open from r to r + 10 ms, the light is on from 5 to 10 ms.
    let pulsed = mono(SensorModel { shutter, strobe: Some(strobe), ..quiet(4, 20) });
    for (row, dn) in rows(&pulsed).into_iter().enumerate() {
        let on_ms = 10.0 - f64::max(5.0, row as f64).min(10.0);
        assert!((dn - k * 200.0 * on_ms).abs() < 1.0, "row {row}: {dn} DN, {on_ms} ms");
    }
    // With time resolved the same: rates that change at 5 and at 10 ms.
    let rate = |value: f32| ElectronRate { columns: 4, rows: 20, data: vec![value; 80] };
    let exposure = Exposure { time_s: 0.01, ..Exposure::default() };
    let (off, on) = (rate(0.0), rate(2e5));
    let steps = |times_s: &[f64]| {
        let rate_from = |index: usize| Ok(if index == 1 { on.clone() } else { off.clone() });
        steady.rate_over_time::<SensorProblem>(times_s, &exposure, rate_from)
    };
    let seen = steps(&[0.0, 0.005, 0.010]).unwrap();
    for (row, pixel) in seen.data.chunks_exact(4).enumerate() {
        let on_ms = 10.0 - f32::max(5.0, row as f32).min(10.0);
        assert!((pixel[0] - 2e4 * on_ms).abs() < 1.0, "row {row}: {} e-/s", pixel[0]);
    }
    assert_eq!(steps(&[]).unwrap_err().field, "times");
    assert_eq!(steps(&[1.0, 0.5]).unwrap_err().field, "times");
    assert_eq!(steps(&[0.0, f64::NAN]).unwrap_err().field, "times");
    let rule = AutoExposure::default();
    assert_eq!(pulsed.auto_exposure_s(&on, 1.0, &rule).unwrap_err().field, "auto_exposure");
}

#[test]
fn hot_and_dead_pixels_stay_where_they_are() {
    let model = SensorModel {
        hot_pixels_per_million: 2000.0,
        dead_pixels_per_million: 1000.0,
        hot_pixel_dark_current_e_per_s: 1e5,
        ..base(300, 300)
    };
    let sensor = mono(model);
    let (hot_pixels, dead_pixels) = defect_pixels(sensor.model());
    // Binomial: 180 and 90 of 90 000, five standard deviations.
    assert!((hot_pixels.len() as f64 - 180.0).abs() < 5.0 * 13.4, "{}", hot_pixels.len());
    assert!((dead_pixels.len() as f64 - 90.0).abs() < 5.0 * 9.5, "{}", dead_pixels.len());
    let (dark, bright) = (even(&sensor, 0.0, 0), even(&sensor, 3000.0, 0));
    let dn = |image: &SensorImage, pixel: usize| f64::from(image.data[pixel]) - image.black_level;
    let k = sensor.model().base_dn_per_electron();
    for &pixel in &dead_pixels {
        assert!(dn(&bright, pixel) < k * (7.0 * 14.0) || hot_pixels.contains(&pixel), "dead pixel {pixel}");
    }
    // Mean of 180 exponential draws of 1000 e- in 10 ms; standard error 1 / sqrt(180), five of them.
    let hot: Vec<f64> = hot_pixels.iter().map(|&pixel| dn(&dark, pixel) / k).collect();
    assert!((mean(&hot) / 1000.0 - 1.0).abs() < 5.0 / 180f64.sqrt(), "{}", mean(&hot));
    let warm = mono(SensorModel { temperature_c: 33.0, ..sensor.model().clone() });
    let twice: Vec<f64> = hot_pixels.iter().map(|&p| dn(&even(&warm, 0.0, 0), p) / k).collect();
    assert!((mean(&twice) / mean(&hot) - 2.0).abs() < 0.05, "{} and {}", mean(&twice), mean(&hot));
}

#[test]
fn line_noise_is_shared_by_a_line_and_changes_with_the_frame() {
    let silent = SensorModel {
        read_noise_e: Some(0.0),
        dsnu_e: Some(0.0),
        prnu_percent: 0.0,
        dark_current_e_per_s: Some(0.0),
        black_level_dn: 2000.0,
        row_noise_mv: 8.0,
        ..base(16, 512)
    };
    let rows = mono(silent.clone());
    let (a, b) = (even(&rows, 0.0, 0), even(&rows, 0.0, 1));
    assert!(a.data.chunks_exact(16).all(|row| row.iter().all(|dn| *dn == row[0])));
    let first =
        |image: &SensorImage| -> Vec<f64> { image.data.chunks_exact(16).map(|r| f64::from(r[0])).collect() };
    // 8 mV are 36 DN; 512 rows have a relative standard error of 1 / sqrt(1024).
    let set = 8e-3 / rows.model().volts_per_dn();
    assert!((variance(&first(&a)).sqrt() / set - 1.0).abs() < 5.0 / 32.0);
    let (x, y) = (first(&a), first(&b));
    let products: Vec<f64> = x.iter().zip(&y).map(|(p, q)| (p - mean(&x)) * (q - mean(&y))).collect();
    assert!((mean(&products) / set / set).abs() < 5.0 / 512f64.sqrt());
    assert!((a.read_noise_dn / set - 1.0).abs() < 1e-9);
    let columns =
        mono(SensorModel { row_noise_mv: 0.0, column_noise_mv: 8.0, columns: 512, rows: 16, ..silent });
    let image = even(&columns, 0.0, 0);
    assert!((0..512).all(|col| (1..16).all(|row| image.data[row * 512 + col] == image.data[col])));
}

#[test]
fn a_soft_well_bends_and_never_overflows() {
    let soft = mono(SensorModel { well_knee: 0.8, conversion_gain_mv_per_e: Some(0.09), ..quiet(2, 2) });
    let k = soft.model().base_dn_per_electron();
    let signal = |electrons: f64| (f64::from(even(&soft, electrons, 0).data[0]) - 64.0) / k;
    assert!((signal(7000.0) - 7000.0).abs() < 2.0);
    // 7200 + 1800 (1 - exp(-1)) at one knee width above the knee.
    assert!((signal(9000.0) - (7200.0 + 1800.0 * (1.0 - (-1.0f64).exp()))).abs() < 2.0, "{}", signal(9000.0));
    assert!((signal(1e6) - 9000.0).abs() < 2.0);
    let mut last = 0.0;
    for step in 0..200 {
        let now = signal(100.0 * f64::from(step));
        assert!(now >= last, "the response falls at {step}");
        last = now;
    }
}

#[test]
fn a_sensor_behind_a_filter_sees_less() {
    let sensor = Sensor::new(quiet(4, 4), rgb()).unwrap();
    let light = Spectrum::<Irradiance>::constant(&WavelengthGrid::default(), 1e-4);
    let through = sensor.behind(&Curve::constant(0.25)).flat_electron_rate(&light);
    for (a, b) in through.iter().zip(sensor.flat_electron_rate(&light)) {
        assert!((a / b - 0.25).abs() < 1e-9);
    }
}
