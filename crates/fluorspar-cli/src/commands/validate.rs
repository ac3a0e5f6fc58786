//! `fluorspar validate`: the figures and tables of the paper, computed and compared.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueHint;
use fluorspar::names::did_you_mean;
use fluorspar_format::{FileFormat, OutputFolder, write_atomically};
use fluorspar_session::{Changes, ExperimentSource};
use fluorspar_validation::{
    Case, CaseResult, Setup, ValidationError, Verdict, cases, markdown_table, summary, validation_page,
};
use serde_json::{Value, json};

use super::table::align;
use super::{print_json, print_text};
use crate::args::Answer;
use crate::error::{CliError, FAILED};
use crate::interrupt::stop_flag;
use crate::message::Messages;
use crate::values::sets;

/// Folder of measured data of others, as the tests of this program take it.
const REFERENCE: &str = "FLUORSPAR_REFERENCE";

/// Room for the page and some thirty figures.
const FOLDER_BYTES: u64 = 64 << 20;

/// Options of `validate`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Case to run, for instance `figure-7c`. May be repeated [default: all].
    #[arg(long = "case", value_name = "NAME")]
    names: Vec<String>,
    /// List the cases instead of running them.
    #[arg(long)]
    list: bool,
    /// Leave out the cases that render a mouth.
    #[arg(long)]
    flat_only: bool,
    /// Folder of measured data of others [default: the environment variable FLUORSPAR_REFERENCE]; without it, cases that
    /// need them are skipped.
    #[arg(long, value_name = "FOLDER", value_hint = ValueHint::DirPath)]
    reference: Option<PathBuf>,
    #[command(flatten)]
    changes: Changes,
    /// Folder for the page, validation.json and the figures.
    #[arg(long, value_name = "DIR", default_value = "fluorspar-out/validation", value_hint = ValueHint::DirPath)]
    out: PathBuf,
    #[command(flatten)]
    answer: Answer,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let selected = selected(options)?;
    if options.list {
        list(options, &selected)?;
        return Ok(ExitCode::SUCCESS);
    }
    let reference = reference(options)?;
    let overrides = options.changes.overrides();
    // A change that can't be made is told in the words that were typed.
    ExperimentSource::find_sample(None)?.resolve_sample(&overrides)?;
    let changes = sets(&overrides);
    let inputs: Vec<PathBuf> = reference.iter().cloned().collect();
    let folder = OutputFolder::prepare(&options.out, &inputs, FOLDER_BYTES)?;
    let stop = stop_flag();
    let setup = Setup { changes: &changes, reference: reference.as_deref(), stop: &stop };
    let messages = Messages::default();
    let mut results = Vec::new();
    for case in &selected {
        messages.status(format!("{}: {}", case.name, case.title));
        results.push(case.run(&setup).map_err(not_computed)?);
    }
    let json = as_json(&results, &changes);
    write(&folder, &results, &json)?;
    let place = folder.finish()?;
    if options.answer.json {
        print_json(&json)?;
    } else {
        print_text(&describe(&results))?;
    }
    messages.status(format!("Open {}", place.join("validation.html").display()));
    let failed = results.iter().any(|result| result.verdict == Verdict::Failed);
    Ok(if failed { ExitCode::from(FAILED) } else { ExitCode::SUCCESS })
}

/// The cases that were asked for, in the order of the paper.
fn selected(options: &Options) -> Result<Vec<&'static Case>, CliError> {
    let known: Vec<&str> = cases().iter().map(|case| case.name).collect();
    if let Some(unknown) = options.names.iter().find(|name| !known.contains(&name.as_str())) {
        return Err(CliError::Input(format!(
            "--case {unknown}: there is no such case{} The cases are: {}",
            did_you_mean(unknown, known.iter().copied()),
            known.join(", ")
        )));
    }
    let wanted = |case: &&Case| {
        (options.names.is_empty() || options.names.iter().any(|name| name == case.name))
            && !(options.flat_only && case.is_rendered)
    };
    let selected: Vec<&Case> = cases().iter().filter(wanted).collect();
    if selected.is_empty() {
        return Err(CliError::Input("--flat-only leaves none of the named cases; leave it out".into()));
    }
    Ok(selected)
}

fn list(options: &Options, selected: &[&Case]) -> Result<(), CliError> {
    if options.answer.json {
        let entry = |case: &&Case| json!({ "name": case.name, "title": case.title, "paper": case.paper, "rendered": case.is_rendered });
        return print_json(&selected.iter().map(entry).collect::<Vec<Value>>());
    }
    let rows: Vec<Vec<String>> =
        selected.iter().map(|case| vec![case.name.to_owned(), case.title.to_owned()]).collect();
    print_text(&align(&rows, &[1]))
}

/// The folder of measured data, if one was named.
fn reference(options: &Options) -> Result<Option<PathBuf>, CliError> {
    let (folder, named_by) = match &options.reference {
        Some(folder) => (folder.clone(), "--reference"),
        None => match std::env::var_os(REFERENCE).filter(|value| !value.is_empty()) {
            Some(folder) => (PathBuf::from(folder), REFERENCE),
            None => return Ok(None),
        },
    };
    if folder.is_dir() {
        return Ok(Some(folder));
    }
    Err(CliError::Input(format!(
        "{named_by} {}: there is no such folder; give the folder of the measured data, or leave it out to skip the cases that need \
         them",
        folder.display()
    )))
}

fn as_json(results: &[CaseResult], changes: &[String]) -> Value {
    let count = |verdict: Verdict| results.iter().filter(|result| result.verdict == verdict).count();
    let counts: BTreeMap<&str, usize> =
        Verdict::ALL.iter().map(|&verdict| (verdict.key(), count(verdict))).collect();
    json!({
        "format": FileFormat::RESULTS.version(),
        "provenance": { "program": "fluorspar", "version": env!("CARGO_PKG_VERSION"), "changes": changes },
        "counts": counts,
        "cases": results.iter().map(CaseResult::to_json).collect::<Vec<_>>(),
    })
}

fn write(folder: &OutputFolder, results: &[CaseResult], json: &Value) -> Result<(), CliError> {
    let put = |name: &Path, bytes: &[u8]| {
        write_atomically(&folder.path().join(name), |file| file.write_all(bytes))
            .map_err(|error| folder.at_its_place(error))
    };
    put(Path::new("validation.html"), validation_page(results).as_bytes())?;
    put(Path::new("validation.json"), serde_json::to_string_pretty(json)?.as_bytes())?;
    put(Path::new("validation.md"), markdown_table(results).as_bytes())?;
    for figure in results.iter().flat_map(|result| &result.figures) {
        put(Path::new(&format!("{}.svg", figure.stem)), figure.figure.to_svg().as_bytes())?;
        put(Path::new(&format!("{}.png", figure.stem)), &figure.figure.to_png()?)?;
    }
    Ok(())
}

/// The verdicts as a table, what failed, and what was left out.
fn describe(results: &[CaseResult]) -> String {
    let mut rows = vec![["case", "verdict", "checks", ""].map(String::from).to_vec()];
    rows.extend(results.iter().map(|result| {
        let passed = result.checks.iter().filter(|check| check.passed()).count();
        let checks = format!("{passed}/{}", result.checks.len());
        vec![result.name.into(), result.verdict.name().into(), checks, result.title.into()]
    }));
    let mut text = format!("{}\n", align(&rows, &[1, 3]));
    for result in results {
        for check in result.checks.iter().filter(|check| !check.passed()) {
            text += &format!(
                "{}: {}: {} instead of {} ({})\n",
                result.name,
                check.what,
                check.computed_text(),
                check.accepted_text(),
                check.why
            );
        }
        for missing in &result.missing {
            text += &format!("{}: left out: {missing}\n", result.name);
        }
    }
    text + &summary(results)
}

/// Why a case was not computed.
fn not_computed(error: ValidationError) -> CliError {
    match error {
        ValidationError::Experiment(error) => error.into(),
        ValidationError::Preset(error) => error.into(),
        ValidationError::Predict(error) => error.into(),
        ValidationError::Pipeline(error) => error.into(),
        ValidationError::Render(error) => error.into(),
        ValidationError::Format(error) => error.into(),
        ValidationError::Interrupted => CliError::Stopped(error.to_string()),
        other => CliError::Input(other.to_string()),
    }
}
