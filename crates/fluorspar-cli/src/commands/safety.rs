//! `fluorspar safety`: photobiological safety of an experiment's captures.

use fluorspar::pipeline::{CaptureSafety, PipelineError, SafetyReport, ViewerSafety, assess_safety};
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_session::{ExperimentArgs, ExperimentSource};

use super::table::{align, short};
use crate::args::Answer;
use crate::error::CliError;
use crate::message::Messages;
use crate::values::{self, Override};

/// Sections that the safety of captures does not rest on.
const IGNORED: [&str; 6] = ["analysis", "develop", "motion", "output", "spectroradiometer", "target"];

/// Options of `safety`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// Distance from the camera at which an eye, in a mouth the patient's, may look into the lights, mm.
    #[arg(long, value_name = "MM", value_parser = values::number, allow_negative_numbers = true)]
    patient_eye_mm: Option<f64>,
    /// Distance from the lit mouth or object to the operator's eye, mm.
    #[arg(long, value_name = "MM", value_parser = values::number, allow_negative_numbers = true)]
    operator_eye_mm: Option<f64>,
    #[command(flatten)]
    answer: Answer,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let source = ExperimentSource::find(options.experiment.experiment.as_deref())?;
    let mut overrides = options.experiment.overrides();
    let distance =
        |path: &str, mm: Option<f64>, option: &str| mm.map(|mm| Override::number(path, mm, option));
    overrides.extend(distance("safety.patient_eye_distance_mm", options.patient_eye_mm, "patient_eye_mm"));
    overrides.extend(distance("safety.operator_eye_distance_mm", options.operator_eye_mm, "operator_eye_mm"));
    let ResolvedExperiment { study, record } = source.resolve(&overrides)?;
    if let Some(change) = overrides.iter().find(|change| IGNORED.contains(&change.section())) {
        let (typed, section) = (change.typed(), change.section());
        return Err(CliError::Input(format!(
            "{typed}: `{section}` changes nothing of the safety of captures; leave this out"
        )));
    }
    Messages::default().warnings(&record.warnings);
    if study.captures.is_empty() {
        return Err(CliError::Input(format!(
            "{}: the experiment has no captures, so it is unknown which lights are on and for how long; add [[capture]] \
             sections",
            source.name
        )));
    }
    let report = assess_safety(&study, &[]).ok_or(PipelineError::Missing("safety"))?;
    if options.answer.json {
        let mut value = serde_json::to_value(&report)?;
        value["experiment_sha256"] = record.sha256.into();
        super::print_json(&value)
    } else {
        super::print_text(&describe(&record.title, &report))
    }
}

fn describe(title: &str, report: &SafetyReport) -> String {
    let mut text = format!("{title}\n{}\n{}\n", report.standard, report.caveat);
    if !report.has_light() {
        return text + "\nNo capture switches a light on.\n";
    }
    for capture in report.captures.iter().filter(|c| !c.viewers.is_empty()) {
        text += &describe_capture(capture, report.is_mouth);
    }
    text += "\nWhole sequence of captures, times in 8 hours:\n";
    for line in &report.program {
        let times = line.sequences_per_day.map_or_else(|| "not assessed".into(), |n| n.to_string());
        text += &format!("  {:<30} {times}\n", line.viewer.name(report.is_mouth));
    }
    if let Some(group) = report.risk_group {
        text += &format!("Risk group at 200 mm, continuous: {} ({})\n", group.name(), group.meaning());
    }
    text += "\nAssumed:\n";
    for line in &report.assumptions {
        text += &format!("  - {line}\n");
    }
    text
}

fn describe_capture(capture: &CaptureSafety, is_mouth: bool) -> String {
    let light_on_ms = short(1e3 * capture.light_on_s);
    let head = format!(
        "\nCapture \"{}\": lights on for {light_on_ms} ms ({})\n",
        capture.name, capture.light_on_from
    );
    let viewers = capture.viewers.iter().map(|viewer| describe_viewer(viewer, is_mouth));
    std::iter::once(head).chain(viewers).collect()
}

fn describe_viewer(viewer: &ViewerSafety, is_mouth: bool) -> String {
    let who = viewer.viewer.name(is_mouth);
    if let Some(reason) = &viewer.not_assessed {
        return format!("  {who}: not assessed: {reason}\n");
    }
    let mut text = format!(
        "  {who} at {} mm: {} W/m2\n",
        short(viewer.distance_mm.unwrap_or(0.0)),
        short(viewer.irradiance_w_per_m2.unwrap_or(0.0))
    );
    let head = ["    hazard", "quantity", "value", "limit", "unit", "margin", "per day"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for a in &viewer.hazards {
        let name = serde_json::to_value(a.hazard).ok().and_then(|v| v.as_str().map(String::from));
        rows.push(vec![
            format!("    {}", name.unwrap_or_default().replace('_', " ")),
            a.quantity.into(),
            short(a.value),
            short(a.limit),
            a.unit.into(),
            a.margin.map_or_else(|| "-".into(), short),
            match a.margin {
                Some(margin) if margin < 1.0 => "exceeded".into(),
                _ => a.exposures_per_day.map_or_else(|| "-".into(), |n| n.to_string()),
            },
        ]);
    }
    text += &align(&rows, &[1, 4]);
    text
}
