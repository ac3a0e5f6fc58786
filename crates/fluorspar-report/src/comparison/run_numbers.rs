//! The numbers of a finished run that an engineer decides by.

use fluorspar::analysis::Analyte;
use fluorspar::findings::{
    Caveat, Finding, FindingId, SafeCaptures, fewest, frame_findings, leak_findings, region_findings,
    safety_findings,
};

use super::finished_run::FinishedRun;
use crate::findings::{FindingWords, shown, value};

/// What numbers are compared, in the order in which they are listed.
const COMPARED: &[&[FindingId]] = &[
    &[
        FindingId::Share,
        FindingId::UpperLimitOverTruth,
        FindingId::WidthOverTruth,
        FindingId::LineShare,
        FindingId::TrueShare,
        FindingId::DetectionLimit,
        FindingId::LimitOverTruth,
        FindingId::UnmixedShare,
    ],
    &[
        FindingId::SpotSeparation,
        FindingId::TargetSeparation,
        FindingId::TargetSeparationOfPixel,
        FindingId::TargetCnr,
        FindingId::SmallestDiameter,
    ],
    &[FindingId::Leak],
    &[FindingId::MedianSignal, FindingId::MedianSignalPerMs, FindingId::PixelSnr, FindingId::RegionSnr],
    &[FindingId::Exposure, FindingId::Clipped],
    &[FindingId::SafeCaptures, FindingId::SafeSequences],
];

/// A number of a run.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RunNumber {
    pub(super) id: FindingId,
    /// Place of its kind among [`COMPARED`].
    pub(super) kind: usize,
    /// What it is, the same in all runs.
    pub(super) quantity: String,
    /// Its unit; empty for a pure number.
    pub(super) unit: &'static str,
    /// `None` where there is an interval only, or nothing.
    pub(super) value: Option<f64>,
    /// 95 %; the upper end may be infinite.
    pub(super) interval: Option<[f64; 2]>,
    /// The share that an estimate is of, which a simulation knows.
    pub(super) truth: Option<f64>,
    /// What is said instead of the number.
    pub(super) words: Option<String>,
    /// Whether the interval holds the sensor's noise and nothing else: neither that of the render nor what is assumed.
    pub(super) noise_alone: bool,
    /// The further region that it is of; `None` of the analysis and of frames.
    pub(super) region: Option<String>,
}

/// What the error of a share is called, after the share.
pub(super) const ERROR: &str = "less the true share";

/// Whether a number is a share of the light, which a simulation knows.
pub(super) fn is_share(id: FindingId) -> bool {
    matches!(id, FindingId::Share | FindingId::LineShare | FindingId::UnmixedShare)
}

/// All numbers of a run, those of its further regions last. `label` is how a frame of it is called beside those of the other run.
pub(super) fn run_numbers(run: &FinishedRun, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
    let mut findings = Vec::new();
    let exposure_of = |frame: &str| run.frames.iter().find(|f| f.name == frame).map(|f| f.exposure_s);
    if let Some(analysis) = &run.analysis {
        let mut analysis = analysis.clone();
        analysis.exposure_s = analysis.exposure_s.or_else(|| exposure_of(&analysis.frame));
        findings.extend(region_findings(&analysis));
    }
    findings.extend(leak_findings(&run.leaks));
    for frame in &run.frames {
        findings.extend(frame_findings(&frame.name, frame.exposure_s, frame.saturated_fraction));
    }
    if let Some(safety) = &run.safety {
        let lit = safety.captures.iter().filter(|capture| !capture.viewers.is_empty());
        let captures = lit.map(|capture| SafeCaptures {
            name: capture.name.clone(),
            light_on_s: capture.light_on_s,
            per_day: fewest(capture.viewers.iter().map(|viewer| (viewer.captures_per_day, viewer.viewer))),
        });
        let sequences = fewest(safety.program.iter().map(|line| (line.sequences_per_day, line.viewer)));
        findings.extend(safety_findings(&captures.collect::<Vec<_>>(), sequences, safety.is_mouth));
    }
    let mut numbers = numbers_of(&findings, &run.target, label);
    for region in &run.regions {
        let mut analysis = region.analysis.clone();
        analysis.exposure_s = analysis.exposure_s.or_else(|| exposure_of(&analysis.frame));
        let own = numbers_of(&region_findings(&analysis), &region.target, label);
        numbers.extend(own.into_iter().map(|n| RunNumber { region: Some(region.name.clone()), ..n }));
    }
    numbers
}

/// Findings that are compared, kind by kind, each estimate with what it errs by.
fn numbers_of(findings: &[Finding], target: &str, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
    let analyte = Analyte::new("", target);
    let words = FindingWords { analyte: &analyte, frame: label };
    let mut numbers = Vec::new();
    for finding in findings {
        let Some(kind) = COMPARED.iter().position(|ids| ids.contains(&finding.id)) else { continue };
        let number = number(finding, kind, &words);
        // What is no estimate has no error
        let error = number.truth.filter(|_| number.words.is_none()).map(|truth| RunNumber {
            quantity: format!("{} {ERROR}", number.quantity),
            value: number.value.map(|value| value - truth),
            interval: number.interval.map(|ends| ends.map(|end| end - truth)),
            truth: None,
            ..number.clone()
        });
        numbers.push(number);
        numbers.extend(error);
    }
    numbers.sort_by_key(|number| number.kind);
    numbers
}

fn number(finding: &Finding, kind: usize, words: &FindingWords<'_>) -> RunNumber {
    let in_words_of = value(finding);
    let finding = &shown(finding);
    let has = |caveats: &[Caveat]| finding.caveats.iter().any(|caveat| caveats.contains(caveat));
    let in_words = has(&[Caveat::NoEstimate, Caveat::NotDetected, Caveat::LowerLimit, Caveat::Unbounded]);
    let is_error = finding.id != FindingId::TrueShare;
    RunNumber {
        id: finding.id,
        kind,
        quantity: words.name(finding),
        unit: finding.unit,
        value: finding.value.filter(|_| !in_words),
        interval: finding.interval.filter(|_| is_error),
        truth: finding.reference.filter(|_| is_share(finding.id)),
        words: in_words.then_some(in_words_of),
        noise_alone: has(&[Caveat::SensorNoiseAlone]) && finding.interval.is_some(),
        region: None,
    }
}
