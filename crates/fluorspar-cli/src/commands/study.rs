//! `fluorspar study`: photographs of people over time, norms, exports.

use std::process::ExitCode;

use fluorspar::units::counted;
use fluorspar_report::{percentile_of, verdict_of};
use fluorspar_session::FailedPhotograph;
use fluorspar_session::values::short;
use fluorspar_study::{
    AgainstNormOptions, AnalyzeStudyOptions, AnalyzedStudy, ComparedPeople, Drift, DriftOptions,
    ExportOptions, ExportedStudy, ImportOptions, ImportedStudy, InitOptions, NormOptions, NormReport,
    QueriedRow, QueryOptions, Separation, StudyArgs, VerifiedStudy, WithdrawOptions,
};

use super::Answering;
use super::analyze::no_answer;
use super::subcommands::subcommands;
use super::table::align;
use crate::error::CliError;
use crate::message::Messages;

subcommands! {
    /// Begin a study in a new folder, with a copy of the experiment of its camera.
    Init(Answering<InitOptions>) => |options: &Answering<InitOptions>| {
        options.answer(fluorspar_study::init, |begun| format!("{} begins in {}", begun.name, begun.folder.display()))
    },
    /// Take photographs, people and outcomes in: each file once, with its digest.
    Import(Answering<ImportOptions>) => import,
    /// Estimate the regions that have no estimate; after an upgrade, with --missing, again beside those that are there.
    Analyze(Answering<AnalyzeStudyOptions>) => analyze,
    /// Print the last numbers of people.
    Query(Answering<QueryOptions>) => |options: &Answering<QueryOptions>| {
        options.answer(fluorspar_study::query, |rows| describe_rows(rows))
    },
    /// Say what is normal: of a study, of simulated people, or of several sites from their norms alone.
    Norm(Answering<NormOptions>) => |options: &Answering<NormOptions>| options.answer(fluorspar_study::norm, describe_norm),
    /// Hold people against norms: inside, outside, or can't tell.
    Compare(Answering<AgainstNormOptions>) => |options: &Answering<AgainstNormOptions>| {
        options.answer(fluorspar_study::compare, describe_compared)
    },
    /// Write what may leave the clinic: people by codes, frames anew from their pixels, numbers.
    Export(Answering<ExportOptions>) => export,
    /// Check every file, every line of the log, and the index.
    Verify(Answering<StudyArgs>) => verify,
    /// Make the index anew from the log.
    Reindex(Answering<StudyArgs>) => |options: &Answering<StudyArgs>| {
        options.answer(fluorspar_study::reindex, |made| format!("{} lines, {} files", made.lines, made.files))
    },
    /// Say how much a new version of the program or of camera.toml changed, and who crosses a limit.
    Drift(Answering<DriftOptions>) => |options: &Answering<DriftOptions>| options.answer(fluorspar_study::drift, describe_drift),
    /// Take a person out of all later norms and exports.
    Withdraw(Answering<WithdrawOptions>) => |options: &Answering<WithdrawOptions>| {
        options.answer(fluorspar_study::withdraw, |subject| format!("{subject} withdrew"))
    },
}

/// Does a task, prints its answer, and fails for photographs that have none.
fn with_failures<O: clap::Args, A: serde::Serialize>(
    options: &Answering<O>,
    task: impl FnOnce(&O, &fluorspar_session::Job) -> Result<A, CliError>,
    text: impl FnOnce(&A) -> String,
    failures: impl FnOnce(&A) -> &[FailedPhotograph],
) -> Result<(), CliError> {
    let answer = task(&options.task, &Messages::default().job())?;
    options.print(&answer, text)?;
    no_answer(failures(&answer))
}

fn import(options: &Answering<ImportOptions>) -> Result<(), CliError> {
    let text = |of: &ImportedStudy| {
        let tables =
            [(of.subjects, "line of people", "lines of people"), (of.outcomes, "outcome", "outcomes")];
        let tables = tables.into_iter().filter(|(count, ..)| *count > 0);
        let tables: String =
            tables.map(|(count, one, many)| format!("; {}", counted(count, one, many))).collect();
        format!(
            "{}, {} known; {}{tables}",
            counted(of.photographs, "new photograph", "new photographs"),
            of.known,
            counted(of.regions, "region", "regions"),
        )
    };
    with_failures(options, fluorspar_study::import, text, |of| &of.failures)
}

fn analyze(options: &Answering<AnalyzeStudyOptions>) -> Result<(), CliError> {
    let text = |of: &AnalyzedStudy| {
        let rest = match of.without_region {
            0 => String::new(),
            count => format!("; {count} photographs have no region (import a table with region and where)"),
        };
        format!("{} estimated, {} had estimates{rest}", counted(of.regions, "region", "regions"), of.known)
    };
    with_failures(options, fluorspar_study::analyze, text, |of| &of.failures)
}

fn export(options: &Answering<ExportOptions>) -> Result<(), CliError> {
    let exported = fluorspar_study::export(&options.task, &Messages::default().job())?;
    options.print(&exported, |of: &ExportedStudy| {
        format!(
            "{}, {} files, {} numbers in {}; {} without consent left out",
            counted(of.subjects, "person", "people"),
            of.files,
            of.estimates,
            of.folder.display(),
            counted(of.left_out, "person", "people")
        )
    })?;
    if exported.failures.is_empty() {
        return Ok(());
    }
    Err(CliError::Input(format!(
        "these files can't be written anew and stay here:\n  {}",
        exported.failures.join("\n  ")
    )))
}

fn verify(options: &Answering<StudyArgs>) -> Result<ExitCode, CliError> {
    let found = fluorspar_study::verify(&options.task, &Messages::default().job())?;
    options.print(&found, |of: &VerifiedStudy| {
        let defects: String = of.defects.iter().map(|defect| format!("\n  {defect}")).collect();
        format!("{} lines of the log and {} files are whole{defects}", of.lines, of.files)
    })?;
    if found.defects.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    Err(CliError::Input(format!(
        "{} defects; take these files from a copy of the study",
        found.defects.len()
    )))
}

fn interval(ends: Option<[f64; 2]>) -> String {
    ends.map_or_else(|| "-".into(), |[low, high]| format!("{} to {}", short(low), short(high)))
}

fn describe_rows(rows: &[QueriedRow]) -> String {
    let heads = ["subject", "visit", "region", "quantity", "value", "interval", "of", "version"];
    let row = |of: &QueriedRow| {
        vec![
            of.subject.clone(),
            of.session.clone(),
            of.region.clone(),
            format!("{} {}", of.quantity, of.channel).trim_end().to_owned(),
            of.value.map_or_else(|| "-".into(), short),
            interval(of.interval),
            of.interval_kind.clone(),
            of.version.clone(),
        ]
    };
    let cells: Vec<Vec<String>> =
        std::iter::once(heads.map(String::from).to_vec()).chain(rows.iter().map(row)).collect();
    align(&cells, &[0, 1, 2, 3, 6])
}

fn describe_norm(report: &NormReport) -> String {
    let norm = &report.norm;
    let mut text =
        format!("{} {} of the {}, {} people\n", norm.quantity, norm.channel, norm.region, norm.origin);
    for of in &report.ranges {
        let site = if of.site.is_empty() { String::new() } else { format!(" at {}", of.site) };
        let age = of.age.map_or_else(String::new, |age| format!(", {age} years old"));
        text += &format!(
            "95 % of people{site}{age} lie within {} to {} (95 % confidence; {} people)\n",
            short(of.range[0]),
            short(of.range[1]),
            of.people
        );
    }
    if let Some(ranks) = &norm.ranks {
        text += &format!(
            "By order statistics, whatever the distribution: {} to {}\n",
            short(ranks.low),
            short(ranks.high)
        );
    }
    text
}

fn describe_compared(compared: &ComparedPeople) -> String {
    let heads = [
        "subject",
        "visit",
        "region",
        "quantity",
        "value",
        "interval",
        "norm",
        "range",
        "percentile",
        "verdict",
    ];
    let mut cells = vec![heads.map(String::from).to_vec()];
    for of in &compared.people {
        let own = if of.has_error { interval(Some(of.interval)) } else { "error not known".into() };
        cells.push(vec![
            of.subject.clone(),
            of.session.clone(),
            of.region.clone(),
            of.quantity.clone(),
            of.value.map_or_else(|| "-".into(), short),
            own,
            of.norm.clone(),
            interval(Some(of.place.range)),
            percentile_of(of.place.percentile),
            verdict_of(of.place.standing).into(),
        ]);
    }
    let mut text = align(&cells, &[0, 1, 2, 3, 6, 9]);
    for left in &compared.left_out {
        text += &format!("left out: {left}\n");
    }
    text.extend(compared.separations.iter().map(describe_separation));
    text
}

/// How well a number tells people with a lesion.
fn describe_separation(of: &Separation) -> String {
    let [low, high] = of.area.interval;
    let size = of
        .group_size
        .map_or_else(String::new, |size| format!("; {size} people in each group give it to 0.05"));
    let way = if of.is_lower { "lower" } else { "higher" };
    let [with, without] = of.area.n;
    format!(
        "{} of the {} is {way} with a lesion: area under the ROC curve {:.3} (95 %: {low:.3} to {high:.3}; DeLong error {:.3}; {with} and {without} \
         people){size}\n",
        of.of[1], of.of[0], of.area.area, of.area.standard_error
    )
}

fn describe_drift(drift: &Drift) -> String {
    let name =
        |[analysis, version]: &[String; 2]| format!("{version} ({})", &analysis[..8.min(analysis.len())]);
    let mut cells = vec![
        ["region", "number", "regions", "median change", "95 % change by at most"].map(String::from).to_vec(),
    ];
    for of in &drift.quantities {
        cells.push(vec![
            of.region.clone(),
            of.quantity.clone(),
            of.n.to_string(),
            short(of.median),
            short(of.largest),
        ]);
    }
    let mut crossing: String = drift.crossing.iter().map(|line| format!("{line}\n")).collect();
    crossing.extend(drift.left_out.iter().map(|left| format!("left out: {left}\n")));
    format!("From {} to {}\n{}{crossing}", name(&drift.from), name(&drift.to), align(&cells, &[0, 1]))
}
