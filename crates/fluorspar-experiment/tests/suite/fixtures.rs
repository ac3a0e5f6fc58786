//! Stored experiments, flat samples and sensor files of every format: complete ones, with every default written out.
//!
//! A fixture is called `NAME-VERSION.toml`. Where that of the present version is missing, the test writes it and fails once:
//! look at it, then add it to the repository. Those of former versions are never written again.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use fluorspar_experiment::{ExperimentError, parse, parse_sample, parse_sensor, preset, resolve};
use fluorspar_format::FileFormat;

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

#[test]
fn files_of_every_format_are_read() {
    let forms: [(&str, Complete, &str); 3] = [
        ("experiment", experiment, preset::experiment("flat-patch").unwrap().text),
        ("sample", sample, preset::sample("tongue-385nm").unwrap().text),
        ("sensor", sensor, "format = 1\nname = \"stored\"\nsensor.preset = \"lyu_2021_table_1\"\n"),
    ];
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    for version in 1..=FileFormat::EXPERIMENT.version() {
        for (name, complete, source) in forms {
            let path = folder.join(format!("{name}-{version}.toml"));
            if !path.exists() && version == FileFormat::EXPERIMENT.version() {
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
}
