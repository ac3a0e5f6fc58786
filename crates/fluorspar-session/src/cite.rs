//! What a run rests on, to be cited: the program, its methods, the sources of its data, the files that it read.

use std::collections::BTreeMap;
use std::path::Path;

use clap::ValueHint;
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_experiment::preset::{PresetKind, UsedPreset, used_presets};
use fluorspar_format::read_toml;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{Error, ExperimentSource, Job, Result, read_text};

/// What is cited.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct CiteOptions {
    /// The report.html of a run or its folder, an experiment file, or the name of a built-in one [default: the experiment that `run`
    /// takes].
    #[arg(value_name = "REPORT", value_hint = ValueHint::AnyPath)]
    pub report: Option<String>,
}

/// What a run rests on.
#[derive(Clone, Debug, Serialize)]
pub struct Citations {
    /// How the run was named.
    pub report: String,
    /// Version of the program that ran it; of a file, of this program.
    pub version: String,
    /// Digest of everything that decides the result.
    pub experiment_sha256: String,
    /// Whether that digest is no more what the run had: the catalogue or a file has changed since.
    pub has_changed: bool,
    /// The program, and the paper that it follows.
    pub program: Vec<String>,
    /// Papers of the methods that were used.
    pub methods: Vec<&'static str>,
    /// Sources of data, each with what came from it.
    pub data: Vec<CitedSource>,
    /// Files that were read, with the digests of their contents.
    pub files: BTreeMap<String, String>,
}

/// A source of data.
#[derive(Clone, Debug, Serialize)]
pub struct CitedSource {
    /// What the entries say of their source.
    pub source: String,
    /// Kinds and names of the entries.
    pub entries: Vec<String>,
}

/// Lists what a run rests on.
///
/// # Errors
/// What is no run and no experiment.
pub fn cite(options: &CiteOptions, job: &Job) -> Result<Citations> {
    let source = source_of(options.report.as_deref())?;
    let ResolvedExperiment { study, record } = source.resolve(&[])?;
    job.warn(&record.warnings);
    let sections: toml::Table = read_toml(&record.resolved_toml).unwrap_or_default();
    let fluorophores = study.scene.fluorophores.iter().map(|fluorophore| &*fluorophore.name);
    let used = used_presets(&sections, fluorophores)?;
    let results = source.file.as_deref().and_then(results_beside);
    let said = |key: &str| results.as_ref().and_then(|results| results.get(key)?.as_str());
    let version = said("version").unwrap_or(env!("CARGO_PKG_VERSION")).to_owned();
    let files = record.inputs.iter();
    Ok(Citations {
        report: options.report.clone().unwrap_or_else(|| source.name.clone()),
        has_changed: said("experiment_sha256").is_some_and(|sha256| sha256 != record.sha256),
        program: program(&version),
        version,
        methods: methods(&sections, &used),
        data: by_source(&used),
        files: files.map(|file| (file.path.display().to_string(), file.sha256.clone())).collect(),
        experiment_sha256: record.sha256,
    })
}

/// The experiment of a run's folder, of its page, or of anything else that is one.
fn source_of(report: Option<&str>) -> Result<ExperimentSource> {
    let Some(folder) = report.map(Path::new).filter(|path| path.is_dir()) else {
        return ExperimentSource::find(report);
    };
    let page = folder.join("report.html");
    if page.is_file() {
        return ExperimentSource::find(Some(&page.to_string_lossy()));
    }
    let folder = folder.display();
    Err(Error::Input(format!("{folder}: there is no report.html in this folder; give one that `run` wrote")))
}

/// The results.json beside the page of a run, if it can be read.
fn results_beside(page: &Path) -> Option<Value> {
    page.extension().filter(|ending| ending.eq_ignore_ascii_case("html"))?;
    serde_json::from_str(&read_text(&page.with_file_name("results.json")).ok()?).ok()
}

fn program(version: &str) -> Vec<String> {
    let paper = "Z. Lyu, H. Jiang, F. Xiao, J. Rong, T. Zhang, B. Wandell, J. Farrell, Simulations of fluorescence imaging in the \
                 oral cavity, Biomedical Optics Express 12(7), 4276-4292 (2021)";
    vec![format!("The Fluorspar developers, Fluorspar {version}"), paper.into()]
}

/// Papers of the methods that an experiment uses; docs/bibliography.md has the rest.
fn methods(sections: &toml::Table, used: &[UsedPreset]) -> Vec<&'static str> {
    let has_tissue =
        used.iter().any(|entry| entry.kind == PresetKind::Site) || sections.contains_key("tissue");
    let lens = sections.get("lens").and_then(|lens| lens.get("type")?.as_str());
    let has_sensor = sections.contains_key("sensor");
    let rows = [
        (true, "samples: B. Burley, Practical hash-based Owen scrambling, JCGT 9(4) (2020)"),
        (true, "light transport: E. Veach, Robust Monte Carlo methods for light transport simulation (1997)"),
        (
            has_tissue,
            "layered tissue: K. Stamnes et al., Appl. Opt. 27, 2502 (1988); W. J. Wiscombe, J. Atmos. Sci. 34, 1408 (1977)",
        ),
        (
            lens.is_some_and(|kind| kind != "ideal"),
            "traced lens: C. Kolb, D. Mitchell, P. Hanrahan, Proc. SIGGRAPH 95, 317-324",
        ),
        (
            has_sensor,
            "sensor: J. E. Farrell, P. B. Catrysse, B. A. Wandell, Appl. Opt. 51, A80 (2012); EMVA 1288",
        ),
    ];
    rows.into_iter().filter(|(is_used, _)| *is_used).map(|(_, paper)| paper).collect()
}

/// Sources in the order in which entries first name them.
fn by_source(used: &[UsedPreset]) -> Vec<CitedSource> {
    let mut found: Vec<CitedSource> = Vec::new();
    for entry in used {
        let name = format!("{} {}", entry.kind, entry.name);
        for source in &entry.sources {
            match found.iter_mut().find(|known| known.source == *source) {
                Some(known) => known.entries.push(name.clone()),
                None => found.push(CitedSource { source: source.clone(), entries: vec![name.clone()] }),
            }
        }
    }
    found
}
