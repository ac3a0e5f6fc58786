//! Stored files of every text format: complete ones, with every default written out.
//!
//! A fixture is called `NAME-VERSION.toml`. Where that of the present version is missing, the test writes it and fails once:
//! look at it, then add it to the repository.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{
    ExperimentError, LayersFile, TissueFile, parse, parse_design, parse_layers, parse_sample, parse_script,
    parse_sensor, parse_tissue, resolve, script_text,
};
use fluorspar_format::{FileFormat, read_toml};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Text with every default written out, from a text that may lean on the catalogue.
type Complete = fn(&str) -> Result<String, ExperimentError>;

fn experiment(text: &str) -> Result<String, ExperimentError> {
    resolve(&parse(text, "stored", Path::new("."), &[])?).map(|resolved| resolved.record.resolved_toml)
}

fn sample(text: &str) -> Result<String, ExperimentError> {
    parse_sample(text, "stored", Path::new("."), &[]).map(|sample| sample.record.resolved_toml)
}

fn sensor(text: &str) -> Result<String, ExperimentError> {
    parse_sensor(text, "stored", Path::new("."), &[]).map(|sensor| sensor.resolved_toml)
}

fn design(text: &str) -> Result<String, ExperimentError> {
    parse_design(text, "stored", Path::new("."), &[]).map(|design| design.record.resolved_toml)
}

/// A text through the type of its file.
fn through<T: Serialize + DeserializeOwned>(text: &str) -> String {
    toml::to_string(&read_toml::<T>(text).unwrap()).unwrap()
}

fn tissue(text: &str) -> Result<String, ExperimentError> {
    parse_tissue(text, "stored", Path::new(".")).map(|_| through::<TissueFile>(text))
}

fn layers(text: &str) -> Result<String, ExperimentError> {
    parse_layers(text, "stored", Path::new("."), &[]).map(|_| through::<LayersFile>(text))
}

fn script(text: &str) -> Result<String, ExperimentError> {
    parse_script(text, "stored").map(|changes| script_text(&changes))
}

const TISSUE: &str = "format = 1\n[[tissue]]\nname = \"stored\"\nsite = \"lip\"\nstates = [\"inflammation\"]\n\
                      parameters = { oxygen_saturation = 0.7 }\n";
const LAYERS: &str = "format = 1\ntitle = \"Stored\"\nindex_above = 1.0\nindex_below = 1.0\n[[layer]]\nname = \"slab\"\n\
                      thickness_mm = 0.2\nrefractive_index = 1.4\nabsorption_per_mm = 1.0\nscattering_per_mm = 9.0\n\
                      anisotropy = 0.75\nemission = { strength_per_mm = 0.1, absorption_per_mm = 0.5, scattering_per_mm = 8.0 }\n";
const SCRIPT: &str = "format = 1\n[[change]]\nset = \"capture.blue.exposure_ms\"\nvalue = 60.0\n[[change]]\n\
                      insert = \"fluorophore.dye\"\nvalue = { source = \"fluorescein\" }\n[[change]]\ndelete = \"light.white\"\n";

#[test]
fn files_of_every_format_are_read() {
    let (one, two) = (FileFormat::EXPERIMENT.version(), FileFormat::DESIGN.version());
    let forms: [(&str, u32, Complete, &str); 7] = [
        ("experiment", one, experiment, preset::text(PresetKind::Experiment, "flat-patch").unwrap()),
        ("sample", one, sample, preset::text(PresetKind::Sample, "tongue-385nm").unwrap()),
        ("sensor", one, sensor, "format = 1\nname = \"stored\"\nsensor.preset = \"lyu_2021_table_1\"\n"),
        ("design", two, design, preset::text(PresetKind::Design, "two-lights").unwrap()),
        ("tissue", one, tissue, TISSUE),
        ("layers", one, layers, LAYERS),
        ("script", one, script, SCRIPT),
    ];
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    for (name, version, complete, source) in forms {
        let path = folder.join(format!("{name}-{version}.toml"));
        if !path.exists() {
            fs::create_dir_all(&folder).unwrap();
            fs::write(&path, complete(source).unwrap()).unwrap();
            panic!("{} was missing and is written: look at it, then add it", path.display());
        }
        // What is complete stays as it is: every field of the stored file is understood.
        let stored = fs::read_to_string(&path).unwrap();
        let read = complete(&stored).unwrap();
        for line in stored.lines() {
            assert!(read.lines().any(|now| now == line), "{}: {line} is lost", path.display());
        }
    }
}

/// A voltage per electron that nobody gave follows the well, in a result as in the experiment; one that was given stays, whatever it is.
#[test]
fn a_voltage_per_electron_by_default_follows_the_well() {
    let source = preset::text(PresetKind::Experiment, "flat-patch").unwrap();
    let gain = |text: &str, changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|change| (*change).to_owned()).collect();
        let resolved = resolve(&parse(text, "stored", Path::new("."), &changes).unwrap()).unwrap();
        (
            resolved.record.resolved_toml,
            resolved.study.camera.sensor.unwrap().model().conversion_gain_v_per_e(),
        )
    };
    let default = 0.911e3 / 9000.0;
    let stated = format!("sensor.conversion_gain_mv_per_e={default}");
    assert_eq!(gain(&gain(source, &[&stated]).0, &["sensor.well_capacity_e=4500"]).1, default * 1e-3);
    for text in [source, &gain(source, &[]).0] {
        assert_eq!(gain(text, &[]).1, 0.911 / 9000.0);
        assert_eq!(gain(text, &["sensor.well_capacity_e=4500"]).1, 0.911 / 4500.0);
        let given = ["sensor.conversion_gain_mv_per_e=0.2", "sensor.voltage_swing_v=0.5"];
        assert_eq!(gain(&gain(text, &given[..1]).0, &given[1..]).1, 0.2 * 1e-3);
    }
}
