//! Sensors in files: data sheets, mosaics, efficiencies by channel, filter wheels, and what reaches the raw image.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::pipeline;
use fluorspar::render::{RenderControl, render};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{ResolvedExperiment, parse, parse_sensor, resolve};

fn experiment(text: &str, overrides: &[&str]) -> ResolvedExperiment {
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).into()).collect();
    resolve(&parse(text, "test.toml", Path::new("."), &overrides).unwrap()).unwrap()
}

#[test]
fn every_sensor_of_the_catalogue_comes_back_from_its_resolved_file() {
    for name in preset::names(PresetKind::Sensor) {
        let text = format!("format = 1\n[sensor]\npreset = \"{name}\"\n");
        let first = parse_sensor(&text, name, Path::new("."), &[]).unwrap();
        let again = parse_sensor(&first.resolved_toml, name, Path::new("."), &[]).unwrap();
        assert_eq!(first.sensor, again.sensor, "{name}");
        assert_eq!(first.resolved_toml, again.resolved_toml, "{name}");
    }
}

#[test]
fn a_data_sheet_replaces_the_electronics_of_a_preset() {
    let sheet = "[sensor]\npreset = \"monochrome_4_8um\"\n[sensor.emva1288]\ngain_dn_per_e = 0.3\ndark_noise_e = 3.0\n\
        saturation_capacity_e = 12000\nbit_depth = 12\ndsnu_e = 1.0\nprnu_percent = 0.7\n";
    let sensor =
        parse_sensor(&format!("format = 1\n{sheet}"), "sheet.toml", Path::new("."), &[]).unwrap().sensor;
    let model = sensor.model();
    assert_eq!((model.columns, model.pixel_size_um, model.bit_depth), (1280, 4.8, 12));
    assert!((model.base_dn_per_electron() - 0.3).abs() < 1e-12);
    assert!((model.read_noise_electrons() - 3.0).abs() < 1e-12);
    // In an experiment too, and its resolved file has the fields in place of the sheet.
    let text = format!(
        "format = 1\nbase = \"flat-patch\"\n{}",
        sheet.replace("preset = \"monochrome_4_8um\"\n", "")
    );
    let resolved = experiment(&text, &[]);
    assert!(!resolved.record.resolved_toml.contains("emva1288"), "{}", resolved.record.resolved_toml);
    let again = experiment(&resolved.record.resolved_toml, &[]);
    assert_eq!(resolved.study.camera.sensor, again.study.camera.sensor);
}

#[test]
fn the_sensor_of_an_experiment_is_read_alone() {
    let sensor = parse_sensor("format = 1\nbase = \"oraleye-pi-2025\"\n", "x.toml", Path::new("."), &[])
        .unwrap()
        .sensor;
    assert_eq!(sensor.model().pixel_size_um, 2.8);
    let overrides = ["sensor.mosaic=rgnb".to_string(), "sensor.quantum_efficiency=rgb_nir_cmos".to_string()];
    let nir = parse_sensor("format = 1\nbase = \"oraleye-pi-2025\"\n", "x.toml", Path::new("."), &overrides)
        .unwrap()
        .sensor;
    assert_eq!(nir.model().mosaic, [["R", "G"], ["NIR", "B"]]);
}

/// 0.25 A/W at 500 nm are 0.62 electrons a photon: 0.25 * 1239.84 / 500.
#[test]
fn responsivities_in_amperes_per_watt_become_efficiencies() {
    let folder = tempfile::tempdir().unwrap();
    let table = "wavelength_nm,mono (A/W)\n400,0.2\n500,0.25\n600,0.3\n";
    std::fs::write(folder.path().join("qe.csv"), table).unwrap();
    let head = "format = 1\n[sensor]\npreset = \"monochrome_4_8um\"\n";
    for form in ["\"./qe.csv\"", "{ mono = { csv = \"qe.csv\" } }"] {
        let text = format!("{head}quantum_efficiency = {form}\n");
        let sensor = parse_sensor(&text, "qe.toml", folder.path(), &[]).unwrap().sensor;
        let found = sensor.qe().channels()[0].curve.at(500.0);
        assert!((found - 0.25 * 1239.84 / 500.0).abs() < 1e-4, "{form}: {found}");
    }
}

/// A file in percent whose header does not say so: all channels are meant.
#[test]
fn a_table_of_channels_may_have_a_unit_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("qe.csv"), "wavelength_nm,R,G,B\n400,2,3,30\n500,5,60,20\n").unwrap();
    let text = "format = 1\n[sensor]\nmosaic = \"rggb\"\nquantum_efficiency = { csv = \"qe.csv\", unit = \"percent\" }\n";
    let sensor = parse_sensor(text, "qe.toml", folder.path(), &[]).unwrap().sensor;
    let found: Vec<f64> = sensor.qe().channels().iter().map(|channel| channel.curve.at(500.0)).collect();
    assert!(
        found.iter().zip([0.05, 0.6, 0.2]).all(|(found, wanted)| (found - wanted).abs() < 1e-12),
        "{found:?}"
    );
}

#[test]
fn a_filter_wheel_turns_between_captures() {
    // Colors are analyzed, a monochrome sensor has none.
    let patch =
        preset::text(PresetKind::Experiment, "flat-patch").unwrap().split("[analysis]").next().unwrap();
    let captures = "[[capture]]\nname = \"open\"\nlight_groups = { blue = 1.0 }\nexposure_ms = 200\n\
        [[capture]]\nname = \"half\"\nlight_groups = { blue = 1.0 }\nexposure_ms = 200\nfilters = [0.5]\n\
        [[capture]]\nname = \"red\"\nlight_groups = { blue = 1.0 }\nexposure_ms = 200\n\
        filters = [{ type = \"bands\", base = 0.0, bands = [{ peak_nm = 635.0, fwhm_short_nm = 20.0, fwhm_long_nm = 20.0, \
        weight = 0.9 }] }]\n";
    let overrides = [
        "render.width_px=4",
        "render.height_px=3",
        "render.samples_per_pixel=1",
        "sensor.columns=8",
        "sensor.rows=6",
        "sensor.pixel_size_um=100",
        "sensor.fill_factor=0.0001",
        "sensor.mosaic=mono",
        "sensor.mode={ type = \"noise_free\" }",
        "sensor.quantum_efficiency={ mono = 0.5 }",
    ];
    let study = experiment(&format!("{patch}{captures}"), &overrides).study;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let components = render(&study.scene, &study.render, &control).unwrap();
    let frames = pipeline::capture(&study, &components).unwrap();
    let signal = |name: &str| {
        let raw = &frames.iter().find(|frame| frame.raw.label == name).unwrap().raw;
        f64::from(raw.data[0]) - raw.black_level
    };
    assert!(signal("open") > 100.0, "{}", signal("open"));
    // Both are rounded.
    assert!((signal("half") - 0.5 * signal("open")).abs() <= 0.75, "{} {}", signal("half"), signal("open"));
    assert!(
        signal("red") > 2.0 && signal("red") < 0.4 * signal("open"),
        "{} {}",
        signal("red"),
        signal("open")
    );
}

#[test]
fn a_region_and_binning_shrink_the_raw_image() {
    let text = "format = 1\nbase = \"flat-patch\"\n[render]\nwidth_px = 4\nheight_px = 3\nsamples_per_pixel = 1\n\
        [sensor]\ncolumns = 16\nrows = 12\npixel_size_um = 50\nfill_factor = 0.004\nregion_px = [4, 4, 8, 8]\n\
        [sensor.binning]\ntype = \"charge\"\ncolumns = 2\nrows = 2\n[analysis]\nparts = []\nrectangle_px = [0, 0, 4, 4]\n";
    let study = experiment(text, &[]).study;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let components = render(&study.scene, &study.render, &control).unwrap();
    let frames = pipeline::capture(&study, &components).unwrap();
    assert!(frames.iter().all(|frame| (frame.raw.width, frame.raw.height) == (4, 4)));
    assert!(pipeline::analyze(&study, Some(&components), &frames).unwrap().is_some());
}
