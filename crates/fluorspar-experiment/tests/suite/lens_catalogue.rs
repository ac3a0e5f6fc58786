//! Every lens of the catalogue: first-order optics against exact rays near the axis, and its report against closed forms.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::f64::consts::PI;

use fluorspar::optics::{LensRay, LensReport, LensReportSettings, LensSetting, LensState, diffraction_mtf};
use fluorspar_experiment::preset::{self, PresetKind};
use glam::DVec3;

fn state(name: &str, setting: LensSetting) -> LensState {
    LensState::new(&preset::lens(name).unwrap().lens, setting).unwrap()
}

/// The limit of an even function of the height, from three heights: its error falls with the sixth power.
fn limit(f: impl Fn(f64) -> f64, height: f64) -> f64 {
    let [a, b, c] = [f(height), f(0.5 * height), f(0.25 * height)];
    let (ab, bc) = ((4.0 * b - a) / 3.0, (4.0 * c - b) / 3.0);
    (16.0 * bc - ab) / 15.0
}

#[test]
fn matrices_are_the_limit_of_exact_rays() {
    let mut largest = 0.0_f64;
    for name in preset::names(PresetKind::Lens) {
        let state = state(name, LensSetting::default());
        let p = state.paraxial;
        let trace = state.trace(state.lens.design_wavelength_nm);
        let f = p.focal_length_mm;
        let out = |height: f64| {
            let ray = LensRay { origin: DVec3::new(height, 0.0, -1.0), direction: DVec3::Z };
            trace.forward(ray).unwrap()
        };
        // Heights of 4 % of the focal length and less: the sixth power of that is below 1e-8, rounding far below 1e-12.
        let height = 0.04 * f;
        let focal = limit(|h| -h * out(h).direction.z / out(h).direction.x, 0.25 * height);
        let rear = limit(
            |h| {
                let ray = out(h);
                ray.origin.z - ray.origin.x * ray.direction.z / ray.direction.x
            },
            0.25 * height,
        );
        // A ray aimed at the entrance pupil meets the middle of the stop and leaves from the exit pupil.
        let pupil = DVec3::new(0.0, 0.0, p.entrance_pupil_mm);
        let chief = |slope: f64| {
            let direction = DVec3::new(slope, 0.0, 1.0).normalize();
            LensRay { origin: pupil - direction * (p.entrance_pupil_mm + f), direction }
        };
        let at_stop = limit(|slope| trace.to_stop(chief(slope)).unwrap().x / slope, 0.01);
        let exit = limit(
            |slope| {
                let ray = trace.forward(chief(slope)).unwrap();
                ray.origin.z - ray.origin.x * ray.direction.z / ray.direction.x
            },
            0.01,
        );
        let errors = [
            ("focal length", focal / f - 1.0),
            ("rear focus", (rear - p.rear_focus_mm) / f),
            ("entrance pupil", at_stop / f),
            ("exit pupil", (exit - p.exit_pupil_mm) / f),
        ];
        for (what, error) in errors {
            println!("{name:<20} {what:<15} {error:+.1e}");
            assert!(error.abs() < 1e-9, "{name}: {what} {error:e}");
            largest = largest.max(error.abs());
        }
    }
    println!("largest departure {largest:.1e}");
}

#[test]
fn a_stigmatic_lens_out_of_focus_has_the_mtf_of_its_disc() {
    // An evenly filled disc of radius a has the MTF 2 J1(x) / x, x = 2 pi nu a.
    let setting = LensSetting { f_number: Some(16.0), film_shift_mm: 0.5, ..LensSetting::default() };
    let settings =
        LensReportSettings { image_height_mm: Some(2.0), frequency_per_mm: 20.0, wavelength_nm: None };
    let report = LensReport::new(&state("descartes_50mm", setting), &settings);
    // At the film: tan u' of the marginal ray times the shift.
    let sine = 0.5 / report.working_f_number;
    // The working f-number is that of the shifted film; its cone begins at the same rim 50 mm - sag before the focus.
    let radius = 0.5 * sine / (1.0 - sine * sine).sqrt() * (report.film_mm / (report.film_mm - 0.5));
    let bessel1 = |x: f64| {
        let n = 400;
        (0..n).map(|i| PI * (f64::from(i) + 0.5) / f64::from(n)).map(|t| (t - x * t.sin()).cos()).sum::<f64>()
            / f64::from(n)
    };
    let axis = &report.mtf.fields[0];
    for (nu, mtf) in report.mtf.frequency_per_mm.iter().zip(&axis.tangential).skip(1) {
        let x = 2.0 * PI * nu * radius;
        let closed = (2.0 * bessel1(x) / x).abs();
        assert!((mtf - closed).abs() < 0.01, "{nu}: {mtf} {closed}");
    }
    // Back in the focus nothing is left of it: the rays meet in a point.
    let sharp = LensReport::new(&state("descartes_50mm", LensSetting::default()), &settings);
    assert!(sharp.spots[0].rms_radius_mm.unwrap() < 1e-8);
    assert!(sharp.mtf.fields[0].sagittal.iter().all(|mtf| (mtf - 1.0).abs() < 1e-9));
    assert!(sharp.mtf.best_axial_focus_mm.abs() < 1e-12 && sharp.field[0].distortion_percent == Some(0.0));
    // Out of focus an image is larger, and not distorted: near the axis both have none
    let [moved, still] = [&report, &sharp].map(|report| report.field[1].distortion_percent.unwrap());
    assert!((moved - still).abs() < 1e-3, "{moved} {still}");
}

#[test]
fn diffraction_ends_at_the_cut_off() {
    // 1 / (lambda N): 550 nm at f/4, 454.5 cycles per mm; half of it passes 0.391.
    assert_eq!(diffraction_mtf(455.0, 550.0, 4.0), 0.0);
    assert!((diffraction_mtf(0.0, 550.0, 4.0) - 1.0).abs() < 1e-12);
    assert!((diffraction_mtf(0.5 / (550e-6 * 4.0), 550.0, 4.0) - 0.391_002_2).abs() < 1e-6);
}

#[test]
fn narrow_beams_focus_where_a_small_stop_is_sharpest() {
    let setting = LensSetting { f_number: Some(40.0), ..LensSetting::default() };
    let settings =
        LensReportSettings { image_height_mm: Some(12.0), frequency_per_mm: 20.0, wavelength_nm: None };
    let report = LensReport::new(&state("doublet_100mm", setting), &settings);
    let edge = report.field.last().unwrap();
    let step = report.mtf.focus_shift_mm[1] - report.mtf.focus_shift_mm[0];
    let sharpest = |curve: &[f64]| {
        let best = (0..curve.len()).fold(0, |a, b| if curve[b] > curve[a] { b } else { a });
        report.mtf.focus_shift_mm[best]
    };
    let mtf = report.mtf.fields.last().unwrap();
    let (t, s) = (edge.tangential_focus_mm.unwrap(), edge.sagittal_focus_mm.unwrap());
    assert!((sharpest(&mtf.through_focus_tangential) - t).abs() < step, "{t}");
    assert!((sharpest(&mtf.through_focus_sagittal) - s).abs() < step, "{s}");
    // Thin lenses at the stop: the tangential field is curved about (3 + P) / (1 + P) as much as the sagittal one, with the
    // Petzval sum P = 1 / n = 0.6 to 0.7 of a single glass.
    assert!(t < s && s < 0.0 && (t / s - 3.65 / 1.65).abs() < 0.25, "{t} {s}");
}

#[test]
fn the_report_repeats_what_the_lens_is() {
    for name in preset::names(PresetKind::Lens) {
        let state = state(name, LensSetting::default());
        let report = LensReport::new(&state, &LensReportSettings::default());
        assert_eq!(report.paraxial, state.paraxial);
        assert!((report.field[0].relative_illumination - 1.0).abs() < 0.005, "{name}");
        assert!(
            (report.entrance_pupil_diameter_mm * report.f_number / report.paraxial.focal_length_mm - 1.0)
                .abs()
                < 0.05
        );
        assert!(!report.drawing.elements.is_empty() && report.drawing.fans[0].rays.len() >= 5, "{name}");
        // The field of a report that nobody set has light everywhere.
        assert!(report.spots.iter().all(|spot| spot.rms_radius_mm.is_some()), "{name}");
        let film = report.drawing.film[0];
        for ray in report.drawing.fans.iter().flat_map(|fan| &fan.rays) {
            assert!((ray.last().unwrap()[0] - film).abs() < 1e-9 && ray[0][0] < ray[1][0]);
        }
    }
}
