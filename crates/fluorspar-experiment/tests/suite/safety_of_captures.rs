//! Photobiological safety of captures: a ring of LEDs by hand, missing distances, a lamp that is too bright.
#![allow(clippy::unwrap_used, clippy::panic, reason = "these are tests")]

use std::f64::consts::PI;

use fluorspar::pipeline::{ViewerSafety, assess_safety};
use fluorspar::safety::{Assessment, Hazard, RiskGroup};
use fluorspar::study::Study;
use fluorspar_experiment::{parse, resolve};

fn study(text: &str) -> Study {
    resolve(&parse(text, "test", std::path::Path::new("."), &[]).unwrap()).unwrap().study
}

fn find(viewer: &ViewerSafety, hazard: Hazard) -> &Assessment {
    viewer.hazards.iter().find(|a| a.hazard == hazard).unwrap()
}

/// Eight discs of 1 W on a circle of 35 mm, 100 mm away: `N P d² / (pi (d² + rho²)²)` = 202 W/m² per watt each.
const RING: &str = r#"
    format = 1
    base = "flat-patch"
    light = [
        { name = "blue", remove = true },
        { name = "ring", type = "ring", frame = "camera", spectrum = { type = "led", peak_nm = 385.0, fwhm_short_nm = 2.0, fwhm_long_nm = 2.0 }, ring_radius_mm = 35.0, radius_mm = 2.5, strength.power_mw = 1000.0 },
    ]
    [[capture]]
    name = "blue"
    light_groups = { ring = 1.0 }
"#;

fn ring(safety: &str) -> Study {
    study(&format!("{RING}\n{safety}"))
}

#[test]
fn a_ring_of_leds_by_hand() {
    let report = assess_safety(
        &ring(
            "[safety]\npatient_eye_distance_mm = 100.0\noperator_eye_distance_mm = 300.0\nmucosa_safety_factor = 10.0",
        ),
        &[],
    )
    .unwrap();
    assert!(report.is_mouth);
    let capture = report.captures.iter().find(|c| c.name == "blue").unwrap();
    assert_eq!((capture.light_on_s, capture.light_on_from.as_str()), (0.03, "exposure time"));
    let [patient, operator, mucosa] = capture.viewers.as_slice() else { panic!("{capture:?}") };
    let near = |got: f64, expected: f64, tolerance: f64| {
        assert!((got / expected - 1.0).abs() < tolerance, "{got}, expected {expected}");
    };
    // The extent of a disc (2.5 mm at 106 mm) changes the irradiance by less than 1e-3.
    let irradiance = 8.0 * 0.01 / (PI * (0.01 + 0.035 * 0.035_f64).powi(2));
    near(irradiance, 202.1, 1e-3);
    near(patient.irradiance_w_per_m2.unwrap(), irradiance, 1e-3);
    near(find(patient, Hazard::NearUv).value, irradiance * 0.03, 1e-3);
    // 1e4 J/m² over 6.06 J/m².
    assert_eq!(find(patient, Hazard::NearUv).exposures_per_day, Some((1e4 / (irradiance * 0.03)) as u64));
    // Radiance of a Lambertian disc: P / (pi A); weight 0.013 within the 2 nm of the line.
    let radiance = 1.0 / (PI * PI * 0.0025 * 0.0025);
    near(find(patient, Hazard::BlueLight).value, 0.0133 * radiance * 0.03, 0.03);
    near(patient.source_subtense_mrad.unwrap(), 5.0 / 105.95 * 1e3, 1e-3);
    // The operator: L = E / pi whatever the distance, E_eye = L pi r² / (r² + d²).
    let eye = irradiance / PI * PI * 900.0 / (900.0 + 9e4);
    near(operator.irradiance_w_per_m2.unwrap(), eye, 1e-3);
    near(find(operator, Hazard::BlueLight).value, 0.0133 * irradiance / PI * 0.03, 0.03);
    // Mucosa at the distance to which the camera looks, 100 mm; a tenth of 2e4 t^0.25.
    assert_eq!(mucosa.distance_mm, Some(100.0));
    near(find(mucosa, Hazard::SkinThermal).value, irradiance * 0.03, 1e-3);
    near(find(mucosa, Hazard::SkinThermal).limit, 2e3 * 0.03f64.powf(0.25), 1e-9);
    // At 200 mm: 8 * 0.04 / (pi (0.04 + 0.001225)²) = 60 W/m² of UV-A: group 2.
    let uva = report.risk_quantities.iter().find(|q| q.quantity == "E_UVA").unwrap();
    near(uva.value, 8.0 * 0.04 / (PI * 0.041_225f64.powi(2)), 2e-3);
    assert_eq!(report.risk_group, Some(RiskGroup::Moderate));
    // The dark capture has no viewers, and the sequence is as the one lit capture.
    assert!(report.captures[0].viewers.is_empty());
    assert_eq!(report.program[0].sequences_per_day, patient.captures_per_day);
}

#[test]
fn without_a_distance_there_is_no_margin() {
    let report = assess_safety(&ring(""), &[]).unwrap();
    let capture = report.captures.iter().find(|c| c.name == "blue").unwrap();
    for (index, field) in ["patient_eye_distance_mm", "operator_eye_distance_mm"].into_iter().enumerate() {
        let viewer = &capture.viewers[index];
        assert!(viewer.not_assessed.as_ref().unwrap().contains(field));
        assert!(viewer.hazards.is_empty() && viewer.smallest_margin.is_none());
        assert_eq!(report.program[index].sequences_per_day, None);
    }
    assert!(capture.viewers[2].not_assessed.is_none());
}

/// A patch is no mouth: limits for skin as they are, and no word of mucosa or of a patient.
#[test]
fn only_a_mouth_divides_the_limits_for_skin() {
    let limit = |text: &str| {
        let report = assess_safety(&study(text), &[]).unwrap();
        let capture = report.captures.iter().find(|c| !c.viewers.is_empty()).unwrap();
        let burn = find(&capture.viewers[2], Hazard::SkinThermal).limit;
        (report.is_mouth, burn / capture.light_on_s.powf(0.25), report.assumptions.join("; "))
    };
    let (is_mouth, skin, said) = limit(RING);
    assert!(!is_mouth && (skin / 2e4 - 1.0).abs() < 1e-9, "{skin}");
    assert!(!said.contains("mucosa") && !said.contains("patient") && !said.contains("divided"), "{said}");
    let (is_mouth, mucosa, said) = limit("format = 1\nbase = \"oraleye-2021\"");
    assert!(is_mouth && (mucosa / 2e3 - 1.0).abs() < 1e-9, "{mucosa}");
    assert!(said.contains("mucosa") && said.contains("divided by 10"), "{said}");
}

#[test]
fn too_bright_a_lamp_allows_no_capture() {
    let mut bright = ring("[safety]\npatient_eye_distance_mm = 100.0");
    for light in &mut bright.scene.lights {
        light.spectrum = light.spectrum.scaled(1e5);
    }
    let report = assess_safety(&bright, &[]).unwrap();
    let patient = &report.captures[1].viewers[0];
    assert!(patient.smallest_margin.unwrap() < 1.0);
    assert_eq!(patient.captures_per_day, Some(0));
    assert_eq!(report.program[0].sequences_per_day, Some(0));
    assert_eq!(report.risk_group, Some(RiskGroup::High));
}

/// Rows that begin one after the other need the lamp for longer, pulses for less.
#[test]
fn lamps_are_on_for_the_pulse_or_until_the_last_row_ends() {
    let lit = |more: &str| {
        let report = assess_safety(&ring(more), &[]).unwrap();
        let capture = report.captures.into_iter().find(|capture| !capture.viewers.is_empty()).unwrap();
        (capture.light_on_s, capture.light_on_from)
    };
    let near = |more: &str, seconds: f64, from: &str| {
        let (got, source) = lit(more);
        assert!((got - seconds).abs() < 1e-9 && source == from, "{more}: {got} {source}");
    };
    near("", 0.03, "exposure time");
    let rolling =
        "[sensor]\ncolumns = 320\nrows = 240\nshutter = { type = \"rolling\", row_time_us = 400.0 }\n";
    near(rolling, 0.03 + 239.0 * 4e-4, "exposure time, all rows");
    near(&format!("{rolling}strobe = {{ duration_ms = 2.0 }}"), 0.002, "strobe");
    near(
        &format!("{rolling}strobe = {{ duration_ms = 10.0, frequency_hz = 1e3, duty = 0.1 }}"),
        0.001,
        "strobe",
    );
    near(&format!("{rolling}strobe = {{ delay_ms = 20.0 }}"), 0.01 + 239.0 * 4e-4, "strobe");
}
