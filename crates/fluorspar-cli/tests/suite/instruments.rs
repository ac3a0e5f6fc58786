//! Other forms of raw frames, frames of other cameras, changed scenes, safety and the spectroradiometer.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use crate::support::{fluorspar, listing, without_findings};
use fluorspar_format::{RawPacking, read_sensor_image, write_packed_raw};

/// A run of the flat patch, which takes a second.
fn patch(folder: &Path, more: &[&str]) {
    let mut args = vec![
        "run",
        "flat-patch",
        "--out",
        "run",
        "-q",
        "--set",
        "render.samples_per_pixel=1",
        "--set",
        "render.width_px=16",
        "--set",
        "render.height_px=12",
        "--set",
        "sensor.columns=64",
        "--set",
        "sensor.rows=48",
    ];
    args.extend(more);
    fluorspar(folder, args).well();
}

#[test]
fn a_changed_scene_needs_a_new_render() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    patch(folder, &[]);
    let capture = |change: &[&str]| {
        let mut args = vec!["capture", "run/components.exr", "--out", "frames", "-q"];
        args.extend(change);
        fluorspar(folder, args)
    };
    for (change, what) in [
        (&["--set", "light.blue.strength.irradiance_w_per_m2=500"][..], "light \"blue\""),
        (&["--set", "material.patch.concentrations.fad=0.9"], "material \"patch\""),
        (&["--set", "render.samples_per_pixel=8"], "render.samples_per_pixel"),
        (&["--experiment", "oraleye-2021"], "light"),
    ] {
        let said = capture(change);
        assert_eq!(said.code, Some(2), "{change:?}: {}", said.stderr);
        assert!(said.stderr.contains(what) && said.stderr.contains("render"), "{change:?}: {}", said.stderr);
        assert!(!folder.join("frames").exists());
    }
    capture(&["--set", "capture.blue.light_groups.blue=0.5"]).well();
    capture(&["--seed", "5"]).well();
    // The image keeps its field of view: behind twice the focal length the sensor sees its middle.
    capture(&["--set", "lens.focal_length_mm=6"]).well();
    let help = fluorspar(folder, ["capture", "--help"]).well().stdout;
    assert!(!help.contains("light.blue.strength.power_mw"), "{help}");
}

#[test]
fn frames_in_every_form_give_the_same_analysis() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    patch(folder, &[]);
    let expected = fluorspar(folder, ["analyze", "run", "--json"]).json();
    for format in ["tiff", "dng", "raw12"] {
        fluorspar(folder, ["capture", "run/components.exr", "--format", format, "--out", format, "-q"])
            .well();
        let args = ["analyze", format, "--component-image", "run/components.exr", "--json"];
        assert_eq!(fluorspar(folder, args).json(), expected, "{format}");
    }
    let said = fluorspar(folder, ["capture", "run/components.exr", "--format", "raw10", "--out", "r", "-q"]);
    assert_eq!(said.code, Some(2));
    assert!(said.stderr.contains("10 bits"), "{}", said.stderr);
    assert!(!folder.join("r").exists());
}

#[test]
fn frames_of_another_camera_are_analyzed_by_a_description() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    patch(folder, &[]);
    // As a camera module would deliver them: packed, and nothing known of gain and noise.
    for label in ["ambient", "blue"] {
        let image = read_sensor_image(&folder.join(format!("run/raw_{label}.tiff"))).unwrap().image;
        let path = folder.join(format!("capture_{label}.raw"));
        write_packed_raw(&path, &image, RawPacking::Raw12, None).unwrap();
        let sidecar = folder.join(format!("capture_{label}.raw.json"));
        let mut description: serde_json::Value =
            serde_json::from_slice(&fs::read(&sidecar).unwrap()).unwrap();
        let table = description.as_object_mut().unwrap();
        for key in ["gain", "dn_per_electron", "read_noise_dn", "seed"] {
            table.remove(key);
        }
        fs::write(&sidecar, description.to_string()).unwrap();
    }
    let analyze = |more: &[&str]| {
        let mut args = vec!["analyze", "--experiment", "flat-patch", "--set", "analysis.parts=[]"];
        args.extend(["--set", "sensor.columns=64", "--set", "sensor.rows=48"]);
        args.extend(["--set", "analysis.rectangle_px=[8, 8, 40, 30]", "--set", "analysis.bulk=patch"]);
        args.extend(more);
        fluorspar(folder, args)
    };
    let frames = ["--frame", "blue=capture_blue.raw", "--frame", "ambient=capture_ambient.raw", "--json"];
    let found = analyze(&frames).json();
    let args = [
        "analyze",
        "run",
        "--json",
        "--set",
        "analysis.parts=[]",
        "--set",
        "analysis.rectangle_px=[8, 8, 40, 30]",
        "--set",
        "analysis.bulk=patch",
    ];
    let expected = fluorspar(folder, args).json();
    assert_eq!(found["r"], expected["r"]);
    let region = |of: &serde_json::Value, key: &str| of["mixture"]["region"][key].clone();
    for key in ["mean_rgb_dn", "variance_dn2"] {
        assert_eq!(region(&found, key), region(&expected, key), "{key}");
    }
    // A run knows the light of its scene, and draws the line through what reaches the sensor.
    let estimate = |of: &serde_json::Value, key: &str| region(of, "estimate")[key].as_f64().unwrap();
    let (error, apart) = (
        estimate(&expected, "fraction_standard_error"),
        estimate(&found, "fraction") - estimate(&expected, "fraction"),
    );
    assert!(apart.abs() < 0.05 * error, "{apart} apart, standard error {error}");
    assert_eq!(found["counts"], expected["counts"]);

    // Without the frame that is subtracted room light counts as light of the region.
    let said = analyze(&["--frame", "blue=capture_blue.raw"]).well();
    assert!(said.stderr.contains("--frame ambient=FILE"), "{}", said.stderr);
    for (wrong, word) in [
        (&["--frame", "ambient=capture_ambient.raw"][..], "--frame blue=FILE"),
        (&["--frame", "green=capture_blue.raw"], "no capture \"green\""),
        (&["--frame", "capture_blue.raw"], "write the name"),
        (&["--frame", "blue=missing.dng"], "missing.dng"),
        (&["--frame", "blue=capture_blue.raw", "--frame", "blue=capture_blue.raw"], "twice"),
    ] {
        let said = analyze(wrong);
        assert_eq!(said.code, Some(2), "{wrong:?}: {}", said.stderr);
        assert!(said.stderr.contains(word), "{wrong:?}: {}", said.stderr);
    }
    // Another depth than the sensor's: its conversion gain says nothing.
    let said = analyze(&["--set", "sensor.bit_depth=10", frames[0], frames[1], frames[2], frames[3]]);
    assert!(said.stderr.contains("sensor.bit_depth"), "{}", said.stderr);
    // Dark frames of the camera in place of the black level: the ambient frame is one.
    let mut dark = frames.to_vec();
    dark.extend(["--dark", "capture_ambient.raw"]);
    let found = analyze(&dark).json();
    let (a, b) = (found["r"]["mean"].as_f64().unwrap(), expected["r"]["mean"].as_f64().unwrap());
    assert!((a - b).abs() < 0.01, "{a} {b}");
}

#[test]
fn brackets_and_calibration_run_from_file_to_analysis() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let changes = [
        "--set",
        "capture.blue.bracket_ev=[-2, 1]",
        "--set",
        "develop.dark_frames=4",
        "--set",
        "develop.flat_field={ frames = 8 }",
        "--set",
        "develop.bad_pixel_sigma=8",
        "--set",
        "develop.demosaic=gradient_corrected",
        "--set",
        "motion.jitter_px=0.5",
    ];
    patch(folder, &changes);
    for name in ["raw_blue.tiff", "raw_blue_ev-2.tiff", "raw_blue_ev+1.tiff"] {
        assert!(folder.join("run").join(name).is_file(), "{name}: {:?}", listing(&folder.join("run")));
    }
    let results: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("run/results.json")).unwrap()).unwrap();
    assert!(results["analysis"]["counts"]["valid"].as_u64().unwrap() > 1000);
    let again = fluorspar(folder, ["analyze", "run", "--json"]).json();
    assert_eq!(without_findings(again), results["analysis"]);
    fs::remove_file(folder.join("run/raw_blue_ev-2.tiff")).unwrap();
    let said = fluorspar(folder, ["analyze", "run"]);
    assert!(said.code == Some(2) && said.stderr.contains("raw_blue_ev-2"), "{}", said.stderr);
}

#[test]
fn safety_is_told_for_every_capture_and_only_with_a_distance() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let report = fluorspar(folder, ["safety", "oraleye-2021", "--json"]).json();
    let blue = report["captures"].as_array().unwrap().iter().find(|c| c["name"] == "blue").unwrap();
    assert_eq!(blue["light_on_s"], 0.03);
    let viewers = blue["viewers"].as_array().unwrap();
    assert_eq!(viewers.len(), 3);
    let hazard = |viewer: usize, name: &str| {
        let list = viewers[viewer]["hazards"].as_array().unwrap();
        list.iter().find(|h| h["hazard"] == name).unwrap_or_else(|| panic!("{name}")).clone()
    };
    // The comment of the experiment: 1.6 kW/m² for 30 ms is 48 J/m² of UV-A on the patient's eye.
    let dose = hazard(0, "near_uv")["value"].as_f64().unwrap();
    assert!((45.0..52.0).contains(&dose), "{dose}");
    let margin = hazard(0, "near_uv")["margin"].as_f64().unwrap();
    assert!((margin - 1e4 / dose).abs() < 1e-6 * margin);
    assert!(report["risk_group"].is_string());

    let said = fluorspar(folder, ["safety", "oraleye-2021"]).well();
    for word in ["patient's eye at 100", "operator's eye at 300", "mucosa", "near uv", "not a certificate"] {
        assert!(said.stdout.contains(word), "{word}: {}", said.stdout);
    }
    // A file that tells no distance gets no assessment of eyes.
    let said = fluorspar(folder, ["safety", "flat-patch"]).well();
    assert!(said.stdout.contains("not assessed: its distance is not known"), "{}", said.stdout);
    assert!(
        said.stdout.contains("--patient-eye-mm") || said.stdout.contains("safety.patient_eye_distance_mm")
    );
    let said = fluorspar(folder, ["safety", "flat-patch", "--patient-eye-mm", "100"]).well();
    assert!(said.stdout.contains("eye that looks into the lights at 100"), "{}", said.stdout);
    // No mouth is lit: neither words nor the factor of one.
    for word in ["patient", "mucosa", "divided"] {
        assert!(!said.stdout.contains(word), "{word}: {}", said.stdout);
    }
    for (args, word) in [
        (&["safety", "flat-patch", "--patient-eye-mm", "-5"][..], "between 1e-6 and"),
        (&["safety", "fluorescent-sphere"], "[[capture]]"),
        (&["safety", "tongue-385nm"], "tongue-385nm"),
    ] {
        let said = fluorspar(folder, args);
        assert_eq!(said.code, Some(2), "{args:?}");
        assert!(said.stderr.contains(word), "{args:?}: {}", said.stderr);
    }
}

#[test]
fn a_spectroradiometer_reads_images_and_samples() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let spot =
        "spectroradiometer=[{ name = \"spot\", capture = \"blue\", filters = [\"long_pass_441_y44\"] }]";
    patch(folder, &["--set", spot]);
    let results: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("run/results.json")).unwrap()).unwrap();
    let read = |args: &[&str]| {
        let mut all = vec!["spectroradiometer", "run/components.exr"];
        all.extend(args);
        fluorspar(folder, all)
    };
    let own = read(&["--json"]).json();
    assert_eq!(own, results["spectroradiometers"]);
    assert!(
        fs::read_to_string(folder.join("run/report.html"))
            .unwrap()
            .contains("What a spectroradiometer reads")
    );

    // Without the filter 385 nm light outshines everything; behind it, it does not.
    let peak = |value: &serde_json::Value| {
        let numbers = |key: &str| -> Vec<f64> {
            value[0][key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
        };
        let (nm, expected) = (numbers("wavelength_nm"), numbers("expected"));
        let best = (0..nm.len()).max_by(|a, b| expected[*a].total_cmp(&expected[*b])).unwrap();
        (nm[best], numbers("reading").len())
    };
    let bare = read(&["--capture", "blue", "--json"]).json();
    assert!((380.0..400.0).contains(&peak(&bare).0), "{:?}", peak(&bare));
    let parts = read(&["--capture", "blue", "--parts", "patch", "--readings", "4", "--json"]).json();
    assert_eq!(parts[0]["target"], "patch");

    // The flat patch is the flat sample: same light, same radiance within the noise of an image without any.
    read(&["--out", "spectrum.csv"]).well();
    let csv = fs::read_to_string(folder.join("spectrum.csv")).unwrap();
    assert!(csv.lines().count() > 100 && csv.contains("wavelength_nm,expected,reading"), "{csv}");
    read(&["--out", "spectrum.svg", "-q"]).well();
    assert!(fs::read_to_string(folder.join("spectrum.svg")).unwrap().contains("<svg"));

    let sample =
        fluorspar(folder, ["spectroradiometer", "tongue-385nm", "--filter", "long_pass_441_y44", "--json"]);
    assert!(peak(&sample.json()).0 > 430.0);
    for (args, word) in [
        (&["spectroradiometer", "run/components.exr", "--aim", "0.5,0.5"][..], "--capture"),
        (&["spectroradiometer", "run/components.exr", "--capture", "green"], "no capture"),
        (&["spectroradiometer", "run/components.exr", "--bandwidth-nm", "4"], "--capture"),
        (
            &[
                "spectroradiometer",
                "run/components.exr",
                "--set",
                "light.blue.strength.irradiance_w_per_m2=2",
            ],
            "light",
        ),
        (&["spectroradiometer", "tongue-385nm", "--bandwidth-nm", "0"], "bandwidth"),
        (&["spectroradiometer", "tongue-385nm", "--capture", "blue"], "sample"),
        (&["spectroradiometer", "tongue-385nm", "--out", "a.txt"], ".csv"),
    ] {
        let said = fluorspar(folder, args);
        assert_eq!(said.code, Some(2), "{args:?}: {}", said.stderr);
        assert!(said.stderr.contains(word), "{args:?}: {}", said.stderr);
    }
}
