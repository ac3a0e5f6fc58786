//! Experiment files with a traced lens, from text to frames: both ways of image formation, filters, their own light.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::pipeline::{capture, read_spectroradiometers};
use fluorspar::render::{RenderControl, render};
use fluorspar::study::Study;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, resolve};

/// The flat patch, small and without noise, with another lens section.
fn experiment(lens: &str, changes: &[&str]) -> Study {
    let mut overrides: Vec<String> = [
        "sensor.mode.type=\"noise_free\"",
        "capture.blue.exposure_ms=40",
        "render.width_px=16",
        "render.height_px=12",
        "render.samples_per_pixel=512",
        "sensor.columns=32",
        "sensor.rows=24",
    ]
    .map(String::from)
    .to_vec();
    overrides.extend(changes.iter().map(|c| (*c).to_owned()));
    let text = preset::text(PresetKind::Experiment, "flat-patch").unwrap();
    let ideal = "focal_length_mm = 3.0\nf_number = 4.0\nvignetting = \"none\"\n";
    assert!(text.contains(ideal));
    let text = text.replace(ideal, lens);
    resolve(&parse(&text, "flat-patch", Path::new("."), &overrides).unwrap()).unwrap().study
}

/// Mean signal of the channels of the blue frame, DN.
fn signal(study: &Study) -> [f64; 3] {
    let stop = AtomicBool::new(false);
    let control = RenderControl { stop: &stop, progress: &|_| {} };
    let image = render(&study.scene, &study.render, &control).unwrap();
    let frames = capture(study, &image).unwrap();
    let data = &frames.iter().find(|f| f.raw.label == "blue").unwrap().developed.data;
    [0, 1, 2].map(|channel| {
        let values = data.iter().skip(channel).step_by(3);
        values.map(|v| f64::from(*v)).sum::<f64>() / (data.len() / 3) as f64
    })
}

const TRACED: &str = "type = \"traced\"\nprescription = \"wide_3_5mm\"\n";

#[test]
fn both_ways_and_the_camera_equation_give_the_same_signal() {
    let rendered = signal(&experiment(TRACED, &[]));
    let spread = signal(&experiment(TRACED, &["lens.image_formation=\"point_spread\""]));
    let traced = experiment(TRACED, &[]);
    assert!(traced.scene.camera.lens.is_some() && traced.camera.traced_lens().is_some());
    // An ideal lens of the same focal length, working f-number and no falloff: the film is small beside the focal length.
    let ideal = "focal_length_mm = 3.502\nf_number = 4.002\nvignetting = \"none\"\n";
    let ideal = signal(&experiment(ideal, &[]));
    println!("{rendered:?} {spread:?} {ideal:?}");
    for channel in 0..3 {
        assert!((spread[channel] / rendered[channel] - 1.0).abs() < 0.01, "{rendered:?} {spread:?}");
        // f (1 + |m|) of an ideal lens has pupils of the same size; this one has larger exit than entrance pupils: 3 %.
        assert!((ideal[channel] / rendered[channel] - 1.0).abs() < 0.05, "{rendered:?} {ideal:?}");
    }
}

#[test]
fn filters_act_at_the_angles_of_the_lens_and_add_their_own_light() {
    let spread = "lens.image_formation=\"point_spread\"";
    let fixed = signal(&experiment(TRACED, &[spread]));
    // Behind an f/4 lens the cone is 7 degrees wide, so the edge of the long-pass at 475 nm moves by less than 1 nm; in front
    // of it the middle of the image stays where it is and the corner moves.
    let at_edge = |changes: &[&str]| {
        let lens = experiment(TRACED, changes).camera.lens_behind_filters().unwrap();
        let corner = lens.field_transmittance.last().map(|(_, curve)| curve.at(474.0));
        [lens.transmittance.at(474.0), corner.unwrap_or_else(|| lens.transmittance.at(474.0))]
    };
    let (lens, rear) = ("view_filter.angles=\"lens\"", "view_filter.position=\"rear\"");
    let (still, front, behind) =
        (at_edge(&[spread]), at_edge(&[spread, lens]), at_edge(&[spread, lens, rear]));
    println!("{still:?} {front:?} {behind:?}");
    assert!(behind[0] > 1.01 * still[0] && behind[0] < 1.5 * still[0], "{still:?} {behind:?}");
    // The corner sees through it at the angle of its chief ray: the edge moves by 475 sin² / 2 n², and its slope is
    // (1 - T / 0.95) T / s, with s = 8 nm / 2 ln 9.
    let traced = experiment(TRACED, &[]).camera.lens.unwrap().traced.unwrap();
    let corner_mm = 0.5 * traced.film_width_mm().hypot(traced.film_height_mm());
    let sine2 = traced.middle().chief_ray(corner_mm).unwrap().object_tangent.atan().sin().powi(2);
    let moved_nm = 475.0 * sine2 / (2.0 * 1.8_f64.powi(2));
    let expected = (1.0 - front[0] / 0.95) * moved_nm * 2.0 * 9_f64.ln() / 8.0;
    let found = front[1] / still[0] - 1.0;
    assert!((found / expected - 1.0).abs() < 0.2, "{found} {expected}");
    assert!((front[0] / still[0] - 1.0).abs() < 0.001, "{still:?} {front:?}");
    // The field is 2 degrees wide, so little light reaches the filter: yields of a half and of one make it visible, in the
    // blue. The veil is as strong as its yield, but for the rounding of the converter.
    let own = |photon_yield: &str| {
        let field = format!(
            "view_filter.autofluorescence={{ photon_yield = {photon_yield}, spectrum = \"led_450\" }}"
        );
        signal(&experiment(TRACED, &[spread, &field]))[2] - fixed[2]
    };
    let (half, whole) = (own("0.5"), own("1.0"));
    println!("veils {half} {whole}");
    assert!(half > 2.0 && (whole - 2.0 * half).abs() < 1.0, "{half} {whole}");
    // In front of the lens it passes the glass, as the image does
    let dim = |photon_yield: &str| {
        let field = format!(
            "view_filter.autofluorescence={{ photon_yield = {photon_yield}, spectrum = \"led_450\" }}"
        );
        signal(&experiment(TRACED, &[spread, &field, "lens.transmittance=0.5"]))[2]
    };
    let through_glass = dim("1.0") - dim("0.0");
    assert!((through_glass - 0.5 * whole).abs() < 1.0, "{through_glass} {whole}");
}

/// An instrument beside the camera does not see what a lens that is rendered takes off at the corners.
#[test]
fn a_spectroradiometer_sees_the_scene_before_the_lens() {
    let read = |formation: &str| {
        let text = format!(
            "format = 1\nbase = \"flat-patch\"\nunset = [\"analysis\", \"lens\"]\nrender = {{ width_px = 24, height_px = 18, samples_per_pixel = 256 }}\n\
             camera = {{ horizontal_field_deg = \"from_lens\", position_mm = [0.0, 0.0, 60.0] }}\n\
             sensor = {{ columns = 320, rows = 240, pixel_size_um = 14.0 }}\n\
             lens = {{ type = \"traced\", prescription = \"wide_3_5mm\", f_number = 5.6, image_formation = \"{formation}\" }}\n\
             [[spectroradiometer]]\nname = \"corner\"\ncapture = \"blue\"\naim = [0.1, 0.1]\nacceptance_deg = 8.0\nnoise_floor_w_per_sr_m2_nm = 0.0\n"
        );
        let study = resolve(&parse(&text, "corner", Path::new("."), &[]).unwrap()).unwrap().study;
        let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
        let image = render(&study.scene, &study.render, &control).unwrap();
        let reading = &read_spectroradiometers(&study, &image).unwrap()[0].reading;
        reading.expected.iter().sum::<f64>()
    };
    let (rendered, spread) = (read("rendered"), read("point_spread"));
    // 256 samples on some ten pixels through a pupil of which half is cut off there: 2 %
    assert!((rendered / spread - 1.0).abs() < 0.05, "{rendered} {spread}");
}
