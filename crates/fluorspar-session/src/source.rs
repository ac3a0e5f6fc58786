//! Finds experiments and flat samples: files, reports, built-in ones.

use std::path::{Path, PathBuf};

use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{
    DEFAULT_DESIGN, DEFAULT_EXPERIMENT, DEFAULT_SAMPLE, Experiment, FileRecord, ResolvedExperiment,
    ResolvedSample, is_experiment, is_sample, parse, parse_sample, resolve,
};
use fluorspar_format::{read_bounded, read_start, read_text_bounded, read_toml};
use fluorspar_report::extract_experiment;

use crate::values::{Override, as_typed, sets};
use crate::{Error, Result};

/// Largest experiment file or report that is read.
const LARGEST_BYTES: u64 = 256 << 20;

/// Largest scene of pbrt that is read.
const LARGEST_SCENE_BYTES: u64 = 1 << 30;

/// An experiment as text.
pub struct ExperimentSource {
    /// How messages call it.
    pub name: String,
    /// Name for folders.
    pub stem: String,
    /// The text.
    pub text: String,
    /// Where relative paths start.
    pub base_dir: PathBuf,
    /// The file, unless it is built in.
    pub file: Option<PathBuf>,
}

/// What a file is that is taken for a scene by mistake, by its first bytes or its ending.
fn other_kind(path: &Path) -> Option<&'static str> {
    const BEGINNINGS: [(&[u8], &str); 8] = [
        (b"\x89PNG", "picture"),
        (b"\xff\xd8\xff", "picture"),
        (b"II*\0", "picture"),
        (b"MM\0*", "picture"),
        (b"v/1\x01", "picture"),
        (b"\x93NUM", "NumPy array"),
        (b"ply", "mesh"),
        (b"glTF", "mesh"),
    ];
    if !path.is_file() {
        return None;
    }
    let start = read_start(path, 4).ok()?;
    let of_start = BEGINNINGS.iter().find(|(mark, _)| start.starts_with(mark)).map(|(_, kind)| *kind);
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    of_start.or(match ending.as_deref() {
        Some("obj" | "stl" | "gltf") => Some("mesh"),
        Some("hdr" | "pfm" | "pgm" | "ppm" | "tga" | "qoi" | "gif" | "bmp" | "webp") => Some("picture"),
        _ => None,
    })
}

impl ExperimentSource {
    /// Finds an experiment by file name or built-in name; the default one if none is given.
    pub fn find(experiment: Option<&str>) -> Result<Self> {
        Self::find_as(experiment, DEFAULT_EXPERIMENT, PresetKind::Experiment)
    }

    /// Finds a flat sample by file name or built-in name; the default one if none is given.
    pub fn find_sample(sample: Option<&str>) -> Result<Self> {
        Self::find_as(sample, DEFAULT_SAMPLE, PresetKind::Sample)
    }

    /// Finds a design problem by file name or built-in name; the default one if none is given.
    pub fn find_design(design: Option<&str>) -> Result<Self> {
        Self::find_as(design, DEFAULT_DESIGN, PresetKind::Design)
    }

    /// Finds an experiment or a flat sample.
    pub fn find_either(name: Option<&str>) -> Result<Self> {
        let Some(name) = name else { return Self::find(None) };
        if preset::names(PresetKind::Sample).contains(&name) && !Path::new(name).exists() {
            Self::find_sample(Some(name))
        } else {
            Self::find(Some(name))
        }
    }

    fn find_as(given: Option<&str>, default: &str, kind: PresetKind) -> Result<Self> {
        let name = given.unwrap_or(default);
        let path = Path::new(name);
        let looks_like_file = path.extension().is_some() || name.contains(['/', '\\']);
        if given.is_none() || (!looks_like_file && !path.exists()) {
            return Ok(Self {
                name: format!("built-in {name}"),
                stem: name.into(),
                text: preset::text(kind, name)?.into(),
                base_dir: PathBuf::from("."),
                file: None,
            });
        }
        Self::from_file(name, path)
    }

    /// A file, or the experiment that a report carries.
    fn from_file(name: &str, path: &Path) -> Result<Self> {
        if let Some(kind) = other_kind(path) {
            return Err(Error::Input(format!(
                "{name}: this is a {kind}, not a scene; give an experiment (.toml) or a scene of pbrt (.pbrt), which may name it"
            )));
        }
        let text = if is_pbrt(path) {
            String::from_utf8_lossy(&read_bounded(path, LARGEST_SCENE_BYTES)?).into_owned()
        } else {
            read_text(path)?
        };
        let is_report = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("html"));
        let text = if is_report {
            extract_experiment(&text).ok_or_else(|| {
                Error::Input(format!(
                    "{name}: this page holds no experiment; give a report.html that fluorspar wrote, or a .toml file"
                ))
            })?
        } else {
            text
        };
        let base_dir =
            path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf();
        let stem = path.file_stem().map_or_else(|| "experiment".into(), |s| s.to_string_lossy().into_owned());
        Ok(Self { name: name.into(), stem, text, base_dir, file: Some(path.to_path_buf()) })
    }

    /// The file, if it is a scene of pbrt.
    pub fn pbrt_scene(&self) -> Option<&Path> {
        self.file.as_deref().filter(|path| is_pbrt(path))
    }

    /// Every file that an experiment was read from: its own, its bases, and the data that they name.
    pub fn files(&self, record: &FileRecord) -> Vec<PathBuf> {
        let inputs = record.inputs.iter().map(|input| &input.path);
        self.file.iter().chain(&record.base_files).chain(inputs).cloned().collect()
    }

    /// Reads and resolves the experiment with its changes. Its warnings are the caller's to print.
    pub fn resolve(&self, overrides: &[Override]) -> Result<ResolvedExperiment> {
        Ok(resolve(&self.parse(overrides)?).map_err(|error| as_typed(error, overrides))?)
    }

    /// Reads the experiment with its changes.
    pub fn parse(&self, overrides: &[Override]) -> Result<Experiment> {
        if self.pbrt_scene().is_some() {
            return Err(Error::Input(format!(
                "{}: this is a scene of pbrt, no experiment; `fluorspar render` takes it",
                self.name
            )));
        }
        if is_sample(&self.text) {
            return Err(Error::Input(format!(
                "{}: this is a flat sample without a scene; `fluorspar predict` takes it",
                self.name
            )));
        }
        Ok(parse(&self.text, &self.name, &self.base_dir, &sets(overrides))
            .map_err(|error| as_typed(error, overrides))?)
    }

    /// Reads and resolves the flat sample with its changes. Its warnings are the caller's to print.
    pub fn resolve_sample(&self, overrides: &[Override]) -> Result<ResolvedSample> {
        if is_experiment(&self.text) {
            return Err(Error::Input(format!(
                "{}: this is an experiment with a scene; `fluorspar run` takes it. A flat sample has the sections [light] \
                 and [sample]: `fluorspar catalog show sample {DEFAULT_SAMPLE}` prints one",
                self.name
            )));
        }
        Ok(parse_sample(&self.text, &self.name, &self.base_dir, &sets(overrides))
            .map_err(|error| as_typed(error, overrides))?)
    }
}

/// Whether a file is a scene of pbrt, by its name.
fn is_pbrt(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("pbrt"))
}

/// Reads a text file of bearable size.
pub fn read_text(path: &Path) -> Result<String> {
    Ok(read_text_bounded(path, LARGEST_BYTES)?)
}

/// An experiment, and the files that it and the experiments among them name, as seen from a folder.
///
/// # Errors
/// An experiment that can't be read.
pub fn files_named(folder: &Path, experiment: &Path) -> Result<Vec<PathBuf>> {
    let mut files = vec![experiment.to_path_buf()];
    let mut next = 0;
    while next < files.len() {
        let file = files[next].clone();
        next += 1;
        if file.extension().is_none_or(|ending| ending != "toml") {
            continue;
        }
        let Ok(table) = read_toml::<toml::Table>(&read_text(&folder.join(&file))?) else { continue };
        let mut names = Vec::new();
        strings_of(&toml::Value::Table(table), &mut names);
        for name in names {
            let named = file.parent().unwrap_or(Path::new("")).join(name);
            if folder.join(&named).is_file() && !files.contains(&named) {
                files.push(named);
            }
        }
    }
    Ok(files)
}

/// Every string of a table.
fn strings_of(value: &toml::Value, found: &mut Vec<String>) {
    match value {
        toml::Value::String(text) => found.push(text.clone()),
        toml::Value::Array(values) => values.iter().for_each(|value| strings_of(value, found)),
        toml::Value::Table(table) => table.values().for_each(|value| strings_of(value, found)),
        _ => {}
    }
}
