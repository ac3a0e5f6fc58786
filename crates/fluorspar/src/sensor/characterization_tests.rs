//! The closed loop: the estimator of EMVA 1288 recovers the values of a data sheet.

use super::*;
use crate::spectral::Curve;

fn sensor(model: SensorModel) -> Sensor {
    Sensor::new(model, SpectralQe::from_curves([("mono", Curve::constant(0.6))]).unwrap()).unwrap()
}

fn mono(columns: usize, rows: usize) -> SensorModel {
    SensorModel { columns, rows, mosaic: vec![vec!["mono".into()]], ..SensorModel::default() }
}

/// Relative errors by quantity.
fn errors(measured: &Characterization) -> impl Fn(&str) -> f64 {
    |quantity| {
        let found = measured.recovered.iter().find(|r| r.quantity == quantity);
        found
            .unwrap_or_else(|| panic!("{quantity} is not in {:?}", measured.recovered))
            .relative_error
            .unwrap()
    }
}

const SETTINGS: CharacterizationSettings = CharacterizationSettings {
    region: [320, 240],
    exposure_s: 0.01,
    gain: 1.0,
    levels: 30,
    stack: 24,
    seed: 3,
};

#[test]
fn a_data_sheet_is_recovered() {
    for (gain, noise, saturation, bits, black, dsnu, prnu, current, doubling) in [
        (0.37, 2.2, 10_300.0, 12, 64.0, 0.9, 0.6, 0.4, 7.0),
        (1.9, 24.0, 32_000.0, 16, 400.0, 12.0, 1.1, 300.0, 6.0),
        (0.08, 6.5, 9000.0, 10, 32.0, 4.0, 2.3, 20.0, 8.5),
    ] {
        let sheet = Emva1288 {
            gain_e_per_dn: None,
            gain_dn_per_e: Some(gain),
            dark_noise_e: Some(noise),
            dark_noise_dn: None,
            saturation_capacity_e: saturation,
            bit_depth: bits,
            black_level_dn: Some(black),
            dark_current_e_per_s: current,
            dark_current_temperature_c: 25.0,
            doubling_temperature_k: doubling,
            dsnu_e: Some(dsnu),
            dsnu_dn: None,
            prnu_percent: prnu,
            quantum_efficiency_percent: Some(60.0),
            quantum_efficiency_nm: Some(550.0),
            dynamic_range_db: None,
            snr_max_db: None,
            sensitivity_threshold_e: None,
        };
        let sensor = sensor(SensorModel { emva1288: Some(sheet), ..mono(320, 240) });
        let measured = characterize(&sensor, &SETTINGS).unwrap();
        let error = errors(&measured);
        assert!(measured.warnings.is_empty(), "{:?}", measured.warnings);
        // 76 800 pixels: each variance has a relative standard error of 0.5 %, a deviation of 0.26 %, the gain (about
        // 25 levels) of 0.1 %. The limits are the accuracy that is promised.
        assert!(error("system gain").abs() < 0.02, "{:?}", measured.recovered);
        assert!(error("temporal dark noise").abs() < 0.02, "{:?}", measured.recovered);
        assert!(error("PRNU").abs() < 0.02, "{:?}", measured.recovered);
        assert!(error("DSNU").abs() < 0.05, "{:?}", measured.recovered);
        assert!((measured.saturation_capacity_e / saturation - 1.0).abs() < 0.01, "{:?}", measured.recovered);
        assert!(error("full scale").abs() < 0.01, "{:?}", measured.recovered);
        // The mean of 153 600 values of `noise` electrons at a slope of 100 e- over the times: far below 1 %.
        assert!(error("dark current").abs() < 0.02, "{:?}", measured.recovered);
        assert!(error("doubling temperature").abs() < 0.02, "{:?}", measured.recovered);
        assert!(measured.linearity_error_percent < 0.1, "{}", measured.linearity_error_percent);
        assert!((measured.channels[0].quantum_efficiency_percent - 60.0).abs() < 1e-9);
    }
}

#[test]
fn table_1_ends_with_its_converter() {
    let measured = characterize(&sensor(mono(320, 240)), &SETTINGS).unwrap();
    let error = errors(&measured);
    // A black level of 64 DN leaves 4031 codes of 2.197 e-: 8857 e- of the 9000 e- in the well.
    assert!((measured.full_scale_e / 8857.0 - 1.0).abs() < 0.01, "{}", measured.full_scale_e);
    for (quantity, limit) in [
        ("system gain", 0.02),
        ("temporal dark noise", 0.02),
        ("PRNU", 0.02),
        ("DSNU", 0.05),
        ("saturation capacity", 0.01),
        ("full scale", 0.01),
    ] {
        assert!(error(quantity).abs() < limit, "{quantity}: {:?}", measured.recovered);
    }
    // 13.73 e-, 2.197 e- per code: sqrt(188.5 + 0.40 + 0.25) + 0.5 = 14.25 e-.
    assert!((measured.sensitivity_threshold_e - 14.25).abs() < 0.2, "{}", measured.sensitivity_threshold_e);
}

#[test]
fn patterns_are_split_into_rows_columns_and_pixels() {
    let model = SensorModel {
        read_noise_e: Some(2.0),
        dsnu_e: Some(3.0),
        row_offset_mv: 0.2,
        column_offset_mv: 0.4,
        prnu_percent: 1.0,
        column_gain_percent: 0.5,
        ..mono(320, 240)
    };
    let sensor = sensor(model);
    let measured = characterize(&sensor, &SETTINGS).unwrap();
    let electrons = |mv: f64| mv * 1e-3 / sensor.model().conversion_gain_v_per_e();
    // Deviations of 240 rows and 320 columns have relative standard errors of 1 / sqrt(480) and 1 / sqrt(640): five.
    let close = |measured: f64, set: f64, error: f64| {
        assert!((measured / set - 1.0).abs() < 5.0 * error, "{measured}, set {set}");
    };
    close(measured.dsnu_e.row, electrons(0.2), 0.046);
    close(measured.dsnu_e.column, electrons(0.4), 0.040);
    close(measured.dsnu_e.pixel, 3.0, 0.004);
    close(measured.prnu_percent.column, 0.5, 0.040);
    close(measured.prnu_percent.pixel, 1.0, 0.004);
    // Rows have offsets but no gains: what is found is what 240 row means of pixels and shot noise leave.
    assert!(measured.prnu_percent.row < 0.03, "{:?}", measured.prnu_percent);
}

#[test]
fn a_code_of_ten_thousand_electrons_and_a_dark_current_that_fills_the_well_are_measured() {
    let settings = CharacterizationSettings { region: [640, 480], levels: 20, stack: 8, ..SETTINGS };
    let wide = SensorModel { well_capacity_e: 9e5, bit_depth: 8, read_noise_mv: Some(2.0), ..mono(640, 480) };
    let measured = characterize(&sensor(wide.clone()), &settings).unwrap();
    // A dark variance of 0.4 DN² in 307 200 pixels is known to 0.001 DN², over signals about 80 DN: 5 % of the gain; three times that
    assert!(errors(&measured)("system gain").abs() < 0.15, "{:?}", measured.recovered);
    // Shot noise of 0.02 DN² beside 2 DN²
    let lost = SensorModel { well_capacity_e: 2e6, read_noise_mv: Some(5.0), ..wide };
    let said = characterize(&sensor(lost), &settings).unwrap_err().message;
    assert!(said.contains("or measure a larger region"), "{said}");

    // The well is full after 20 ms
    let warm = SensorModel { dark_current_e_per_s: Some(4.5e5), ..mono(320, 240) };
    let measured =
        characterize(&sensor(warm), &CharacterizationSettings { exposure_s: 1e-3, ..settings }).unwrap();
    let error = errors(&measured);
    assert!(error("dark current").abs() < 0.02, "{:?}", measured.recovered);
    assert!(error("doubling temperature").abs() < 0.02, "{:?}", measured.recovered);
}

#[test]
fn a_black_level_that_cuts_the_noise_is_told() {
    let low = SensorModel { black_level_dn: 5.0, ..mono(64, 64) };
    let settings = CharacterizationSettings { levels: 10, stack: 4, ..SETTINGS };
    let measured = characterize(&sensor(low), &settings).unwrap();
    assert!(measured.warnings[0].contains("raise black_level_dn"), "{:?}", measured.warnings);
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let isetcam = SensorModel { mode: SensorMode::Isetcam { noise_flag: 2 }, ..mono(64, 64) };
    assert_eq!(characterize(&sensor(isetcam), &SETTINGS).unwrap_err().field, "mode");
    let field = |settings: CharacterizationSettings| {
        characterize(&sensor(mono(64, 64)), &settings).unwrap_err().field
    };
    assert_eq!(field(CharacterizationSettings { levels: 3, ..SETTINGS }), "characterization.levels");
    assert_eq!(
        field(CharacterizationSettings { region: [4, 240], ..SETTINGS }),
        "characterization.region[0]"
    );
    assert_eq!(
        field(CharacterizationSettings { exposure_s: 0.0, ..SETTINGS }),
        "characterization.exposure_s"
    );
    assert_eq!(field(CharacterizationSettings { gain: -1.0, ..SETTINGS }), "exposure.gain");
}
