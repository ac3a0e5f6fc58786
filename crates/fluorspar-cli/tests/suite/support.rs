//! Runs the program and looks at what it leaves behind.

#![allow(
    dead_code,
    clippy::unwrap_used,
    reason = "each test uses its part; a helper that fails is a failed test"
)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What a run of the program said.
#[derive(Debug)]
pub(crate) struct Said {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Said {
    /// The same, if it succeeded.
    pub(crate) fn well(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:#?}");
        self
    }

    /// Standard output as JSON, if it succeeded.
    pub(crate) fn json(self) -> serde_json::Value {
        let said = self.well();
        serde_json::from_str(&said.stdout).unwrap_or_else(|error| panic!("{error}: {}", said.stdout))
    }
}

/// Runs the program in a folder.
pub(crate) fn fluorspar<S: AsRef<std::ffi::OsStr>>(folder: &Path, args: impl IntoIterator<Item = S>) -> Said {
    let output = Command::new(env!("CARGO_BIN_EXE_fluorspar"))
        .args(args)
        .current_dir(folder)
        // Help is wrapped to this width.
        .env_remove("COLUMNS")
        // Meshes of mouths are made once for all tests of this program.
        .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Said { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// Every file below a folder with its length, hidden ones and folders included.
pub(crate) fn listing(folder: &Path) -> BTreeMap<PathBuf, u64> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let entry = entry.unwrap();
            let metadata = entry.metadata().unwrap();
            if metadata.is_dir() {
                open.push(entry.path());
            }
            found.insert(entry.path(), if metadata.is_dir() { 0 } else { metadata.len() });
        }
    }
    found
}

/// The default experiment in a few thousand paths: a small image and a sensor of 32 x 24 pixels that are as wide as
/// the real sensor together and as sensitive as real pixels each.
pub(crate) const TINY: [&str; 15] = [
    "--set",
    "render.width_px=16",
    "--set",
    "render.height_px=12",
    "--set",
    "render.samples_per_pixel=1",
    "--set",
    "sensor.columns=32",
    "--set",
    "sensor.rows=24",
    "--set",
    "sensor.pixel_size_um=75",
    "--set",
    "sensor.fill_factor=0.0011",
    "--set=mouth.detail=0.25",
];

/// Arguments of a command on the tiny experiment.
pub(crate) fn tiny<'a>(args: &[&'a str]) -> Vec<&'a str> {
    let mut all = args.to_vec();
    all.extend(TINY);
    all
}

/// A file that belongs to the tests of the file formats.
pub(crate) fn library_test_data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fluorspar-format/tests/data").join(name)
}

/// The folder of reference data: `FLUORSPAR_REFERENCE`, or `shared/reference` beside the repository.
pub(crate) fn reference() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os("FLUORSPAR_REFERENCE") {
        return Some(folder.into());
    }
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().map(|folder| folder.join("shared/reference")).find(|folder| folder.is_dir())
}

/// Checks that results still have what the fixture of their format lists: keys with the types of their values. New keys are
/// no new format; keys that go or change their type are. A missing fixture is written once, to be looked at and added.
pub(crate) fn keeps_format(name: &str, results: &serde_json::Value) {
    let version = results["format"].as_u64().unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/fixtures/{name}-{version}.txt"));
    let mut found = BTreeMap::new();
    collect_keys(results, String::new(), &mut found);
    if !file.exists() {
        let lines: Vec<String> = found.iter().map(|(key, kind)| format!("{key} {kind}\n")).collect();
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, lines.concat()).unwrap();
        panic!("{} was missing and is written: look at it, then add it", file.display());
    }
    for line in fs::read_to_string(&file).unwrap().lines() {
        let (key, kind) = line.rsplit_once(' ').unwrap();
        let now = found.get(key).copied();
        // A list may be empty.
        let is_empty = now.is_none() && key.contains("[]");
        assert!(
            is_empty || now == Some(kind) || now == Some("null") || kind == "null",
            "{key} is {now:?}, was {kind}"
        );
    }
}

/// Every key below a value, as `a.b[].c`, with the type of what it holds; of a list the first entry counts.
fn collect_keys(value: &serde_json::Value, at: String, found: &mut BTreeMap<String, &'static str>) {
    use serde_json::Value::{Array, Bool, Null, Number, Object, String as Text};
    match value {
        Object(entries) => {
            for (key, inner) in entries {
                collect_keys(inner, if at.is_empty() { key.clone() } else { format!("{at}.{key}") }, found);
            }
        }
        Array(items) => {
            if let Some(first) = items.first() {
                collect_keys(first, format!("{at}[]"), found);
            }
        }
        Null => drop(found.insert(at, "null")),
        Bool(_) => drop(found.insert(at, "boolean")),
        Number(_) => drop(found.insert(at, "number")),
        Text(_) => drop(found.insert(at, "text")),
    }
}

/// The analysis that `analyze --json` prints, as the results of a run have it: there the findings of all regions stand beside it.
pub(crate) fn without_findings(mut analysis: serde_json::Value) -> serde_json::Value {
    let findings = analysis.as_object_mut().unwrap().remove("findings");
    assert!(findings.is_some_and(|findings| findings.as_array().unwrap().len() > 10));
    analysis
}
