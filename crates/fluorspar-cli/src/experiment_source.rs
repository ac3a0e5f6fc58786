//! Finds experiments: files, reports, built-in ones.

use std::path::{Path, PathBuf};

use fluorspar::experiment::{DEFAULT_EXPERIMENT, ResolvedExperiment, parse, resolve};
use fluorspar::preset;
use fluorspar_report::extract_experiment;

use crate::args::Changes;
use crate::error::CliError;

/// Largest experiment file or report that is read.
const LARGEST_BYTES: u64 = 256 << 20;

/// An experiment as text.
pub(crate) struct ExperimentSource {
    /// How messages call it.
    pub(crate) name: String,
    /// Name for folders.
    pub(crate) stem: String,
    /// The text.
    pub(crate) text: String,
    /// Where relative paths start.
    pub(crate) base_dir: PathBuf,
}

impl ExperimentSource {
    /// Finds an experiment by file name or built-in name; the default one if none is given.
    pub(crate) fn find(experiment: Option<&str>) -> Result<Self, CliError> {
        let name = experiment.unwrap_or(DEFAULT_EXPERIMENT);
        let path = Path::new(name);
        let looks_like_file = path.extension().is_some() || name.contains(['/', '\\']);
        if experiment.is_none() || (!looks_like_file && !path.exists()) {
            let preset = preset::experiment(name)?;
            return Ok(Self {
                name: format!("built-in {name}"),
                stem: name.into(),
                text: preset.text.into(),
                base_dir: PathBuf::from("."),
            });
        }
        let text = read_text(path)?;
        let is_report = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("html"));
        let text = if is_report {
            extract_experiment(&text).ok_or_else(|| {
                CliError::Input(format!(
                    "{name}: this page carries no experiment; give a report.html that fluorspar wrote, or a .toml file"
                ))
            })?
        } else {
            text
        };
        let base_dir =
            path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf();
        let stem = path.file_stem().map_or_else(|| "experiment".into(), |s| s.to_string_lossy().into_owned());
        Ok(Self { name: name.into(), stem, text, base_dir })
    }

    /// Reads and resolves the experiment with its changes, and prints its warnings.
    pub(crate) fn resolve(&self, changes: &Changes, quiet: bool) -> Result<ResolvedExperiment, CliError> {
        let experiment = parse(&self.text, &self.name, &self.base_dir, &changes.overrides())?;
        let resolved = resolve(&experiment)?;
        if !quiet {
            for warning in &resolved.warnings {
                eprintln!("warning: {warning}");
            }
        }
        Ok(resolved)
    }
}

/// Reads a text file of bearable size.
pub(crate) fn read_text(path: &Path) -> Result<String, CliError> {
    let shown = path.display();
    let metadata = std::fs::metadata(path).map_err(|error| {
        CliError::Input(format!("{shown}: can't read this file: {error}. Check the path"))
    })?;
    if metadata.is_dir() {
        return Err(CliError::Input(format!("{shown}: this is a folder; give a file in it")));
    }
    if metadata.len() > LARGEST_BYTES {
        let mib = metadata.len() >> 20;
        return Err(CliError::Input(format!(
            "{shown}: {mib} MiB is no experiment file; the largest that is read has {} MiB",
            LARGEST_BYTES >> 20
        )));
    }
    let bytes = std::fs::read(path)
        .map_err(|error| CliError::Input(format!("{shown}: can't read this file: {error}")))?;
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        CliError::Input(format!("{shown}: byte {at} is not UTF-8 text; is this the right file?"))
    })
}
