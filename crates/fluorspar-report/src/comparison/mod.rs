//! Two finished runs side by side: the settings that differ, the numbers that decide, their frames.

mod finished_run;
mod frame_pair;
mod page;
mod run_numbers;
mod verdict;

pub use finished_run::{
    FinishedCapture, FinishedFrame, FinishedProgram, FinishedRegion, FinishedRun, FinishedSafety,
    FinishedViewer, UnreadableRun,
};
pub use frame_pair::{ComparedPictures, FrameToCompare, compared_pictures};
pub use page::{comparison_figures, comparison_report, setting_cells};
pub use verdict::comparison_verdict;

use fluorspar::analysis::interval_of_difference;
use fluorspar::findings::FindingId;
use serde::{Serialize, Serializer};

use crate::findings::{ASSUMED_GAIN, digits_of, number as short};
use run_numbers::{RunNumber, run_numbers};

/// How numbers are judged, in words.
pub const HOW_JUDGED: &str = "Intervals are of 95 %. Each difference B - A has an interval from both (Zou and Donner 2008; the root of the sum of \
     the squares of their reaches, each toward the other); where it leaves out 0 the intervals tell A and B apart. Where a run has only an \
     upper limit they are told apart where the intervals do not touch. Errors are taken as independent; those that both have in \
     common, as of one seed, one tissue or one library of spectra, make this cautious. A number without an interval is not judged, nor one \
     whose interval holds the sensor's noise alone: the noise of the render and all that is assumed come on top.";

/// What a number of a run is, in one of the two runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparedSide {
    /// The number; `None` where there are words only.
    pub value: Option<f64>,
    /// Its interval of 95 %; an end that is open is null in JSON.
    #[serde(serialize_with = "finite_ends")]
    pub interval: Option<[f64; 2]>,
    /// The share that an estimate is of, which a simulation knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
    /// What is said instead of the number: a limit, or that there is none.
    pub words: Option<String>,
}

/// Whether two numbers are told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Distinction {
    /// The intervals tell them apart.
    Apart,
    /// They do not.
    NotApart,
    /// A number without an interval.
    NotJudged,
    /// The interval of one holds the sensor's noise alone.
    NoiseAlone,
    /// The same in both, to the last bit.
    Same,
    /// Only one of the runs has it.
    InOne,
}

impl Distinction {
    /// In words.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Apart => "yes",
            Self::NotApart => "no",
            Self::NotJudged => "not judged",
            Self::NoiseAlone => "sensor noise alone, not judged",
            Self::Same => "the same",
            Self::InOne => "in one only",
        }
    }
}

/// A number of two runs side by side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparedNumber {
    /// The further region of both runs that it is of; `None` of the analysis and of frames.
    pub region: Option<String>,
    /// What it is.
    pub id: FindingId,
    /// The same in words.
    pub quantity: String,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// In the first run.
    pub a: Option<ComparedSide>,
    /// In the second one.
    pub b: Option<ComparedSide>,
    /// `b - a`.
    pub difference: Option<f64>,
    /// Its interval of 95 %.
    #[serde(serialize_with = "finite_ends")]
    pub difference_interval: Option<[f64; 2]>,
    /// Whether the intervals tell them apart.
    pub told_apart: Distinction,
}

/// Ends of an interval as JSON has them: null for one that is open.
fn finite_ends<S: Serializer>(interval: &Option<[f64; 2]>, serializer: S) -> Result<S::Ok, S::Error> {
    interval.map(|ends| ends.map(|end| end.is_finite().then_some(end))).serialize(serializer)
}

/// The numbers of two runs side by side, those of estimates first, and behind them those of each region that both have. Where their analyzed frames have other names, these two frames stand
/// side by side.
#[must_use]
pub fn compared_numbers(a: &FinishedRun, b: &FinishedRun) -> Vec<ComparedNumber> {
    let (label_a, label_b) = frame_labels(a, b);
    let (of_a, of_b) = (run_numbers(a, &label_a), run_numbers(b, &label_b));
    let find = |list: &[RunNumber], wanted: &RunNumber| {
        let is_it = |n: &&RunNumber| {
            n.region == wanted.region && n.quantity == wanted.quantity && n.unit == wanted.unit
        };
        list.iter().find(is_it).cloned()
    };
    // Regions that only one run has are told in a sentence
    let shared = shared_regions(a, b);
    let place = |n: &RunNumber| match &n.region {
        None => Some((0, n.kind)),
        Some(region) => shared.iter().position(|name| name == region).map(|place| (place + 1, n.kind)),
    };
    let mut pairs: Vec<((usize, usize), ComparedNumber)> =
        of_a.iter().filter_map(|n| Some((place(n)?, compared(n, Some(n.clone()), find(&of_b, n))))).collect();
    let only_b = of_b.iter().filter(|n| find(&of_a, n).is_none());
    pairs.extend(only_b.filter_map(|n| Some((place(n)?, compared(n, None, Some(n.clone()))))));
    pairs.sort_by_key(|(place, _)| *place);
    pairs.into_iter().map(|(_, number)| number).collect()
}

/// Names of the further regions that both runs have, in the order of the first one.
fn shared_regions<'a>(a: &'a FinishedRun, b: &FinishedRun) -> Vec<&'a str> {
    let names = a.regions.iter().map(|region| region.name.as_str());
    names.filter(|name| b.regions.iter().any(|other| other.name == *name)).collect()
}

/// The numbers of further regions, region by region.
#[must_use]
pub fn numbers_by_region(numbers: &[ComparedNumber]) -> Vec<(&str, &[ComparedNumber])> {
    let blocks = numbers.chunk_by(|x, y| x.region == y.region);
    blocks.filter_map(|block| Some((block.first()?.region.as_deref()?, block))).collect()
}

/// How the frames of both runs are called: those that are analyzed stand for each other, whatever their names.
fn frame_labels<'a>(
    a: &'a FinishedRun,
    b: &'a FinishedRun,
) -> (impl Fn(&str) -> String + 'a, impl Fn(&str) -> String + 'a) {
    let of = |run: &'a FinishedRun| run.analysis.as_ref().map(|analysis| analysis.frame.as_str());
    let has = |run: &FinishedRun, frame: &str| run.frames.iter().any(|f| f.name == frame);
    let pair = of(a).zip(of(b)).filter(|(in_a, in_b)| in_a != in_b && !has(a, in_b) && !has(b, in_a));
    let label = move |own: fn((&'a str, &'a str)) -> &'a str| {
        move |frame: &str| match pair {
            Some(names) if own(names) == frame => format!("\"{}\" of A, \"{}\" of B", names.0, names.1),
            _ => format!("\"{frame}\""),
        }
    };
    (label(|names| names.0), label(|names| names.1))
}

/// A number of both runs, or of one. `it` is the one that is there.
fn compared(it: &RunNumber, a: Option<RunNumber>, b: Option<RunNumber>) -> ComparedNumber {
    let RunNumber { id, region, quantity, unit, .. } = it.clone();
    let values = a.as_ref().and_then(|n| n.value).zip(b.as_ref().and_then(|n| n.value));
    let intervals = a.as_ref().and_then(|n| n.interval).zip(b.as_ref().and_then(|n| n.interval));
    let noise_alone = [&a, &b].into_iter().flatten().any(|number| number.noise_alone);
    let difference_interval = values
        .zip(intervals)
        .filter(|_| !noise_alone)
        .map(|((a, b), (of_a, of_b))| interval_of_difference((a, of_a), (b, of_b)));
    let told_apart = match (&a, &b, intervals) {
        (Some(a), Some(b), _) if a == b => Distinction::Same,
        (Some(_), Some(_), Some(_)) if noise_alone => Distinction::NoiseAlone,
        (Some(_), Some(_), Some((of_a, of_b))) => {
            let apart = match difference_interval {
                Some([low, high]) => low > 0.0 || high < 0.0,
                None => of_a[1] < of_b[0] || of_b[1] < of_a[0],
            };
            if apart { Distinction::Apart } else { Distinction::NotApart }
        }
        (Some(_), Some(_), None) => Distinction::NotJudged,
        _ => Distinction::InOne,
    };
    ComparedNumber {
        region,
        id,
        quantity,
        unit,
        a: a.map(ComparedSide::from),
        b: b.map(ComparedSide::from),
        difference: values.map(|(a, b)| b - a),
        difference_interval,
        told_apart,
    }
}

/// What a reader should know of a comparison before the numbers are believed, a sentence each.
#[must_use]
pub fn comparison_remarks(a: &FinishedRun, b: &FinishedRun) -> Vec<String> {
    let mut remarks = Vec::new();
    if a.version != b.version && !a.version.is_empty() && !b.version.is_empty() {
        let (of_a, of_b) = (&a.version, &b.version);
        remarks.push(format!("A was made by version {of_a} of the program, B by version {of_b}: what differs may be the program."));
    }
    if !a.experiment_sha256.is_empty() && a.experiment_sha256 == b.experiment_sha256 {
        remarks.push("Both are runs of the same experiment with the same seed: their numbers are the same, to the last bit.".into());
    }
    for (letter, run) in [("A", a), ("B", b)] {
        if run.analysis.as_ref().is_some_and(|analysis| analysis.gain_is_assumed) {
            remarks.push(format!("Electrons and signal to noise of {letter} are {ASSUMED_GAIN}."));
        }
        if run.analysis.is_none() {
            remarks.push(format!(
                "{letter} has no analysis: it holds frames only. `fluorspar analyze {} --out FOLDER` analyzes them, and `capture --report` does \
                 so at once; an experiment without [analysis] has none.",
                run.name
            ));
        }
    }
    if let (Some((of_a, region_a)), Some((of_b, region_b))) = (a.region(), b.region())
        && (of_a != of_b || region_a != region_b)
    {
        remarks.push(match of_a == of_b {
            true => {
                format!("The regions lie elsewhere or have other sizes in pixels, though both are {of_a}.")
            }
            false => format!("The regions are others: {of_a} in A, {of_b} in B."),
        });
    }
    remarks.extend(remarks_on_regions(a, b));
    let truth =
        |run: &FinishedRun| run.analysis.as_ref().and_then(|a| a.truth.as_ref()).map(|truth| truth.share);
    if let (Some(in_a), Some(in_b)) = (truth(a), truth(b))
        && (in_a - in_b).abs() > 0.01 * in_a.abs().max(in_b.abs())
    {
        remarks.push(format!(
            "The true shares are others, {in_a:.4} in A and {in_b:.4} in B: another light, filter or tissue makes another share. What the \
             estimates err by, and limits and intervals over the true share, compare the designs."
        ));
    }
    remarks
}

/// Which further regions only one run has, and which of one name are others, a sentence each.
fn remarks_on_regions(a: &FinishedRun, b: &FinishedRun) -> Vec<String> {
    let mut remarks = Vec::new();
    for (letter, other, run, beside) in [("A", "B", a, b), ("B", "A", b, a)] {
        let only = regions_without_counterpart(run, beside);
        if !only.is_empty() {
            let noun = if only.len() == 1 { "region" } else { "regions" };
            let only = only.join(", ");
            remarks.push(format!("Only {letter} has the {noun} {only}: {other} has none of this name."));
        }
    }
    for region in &a.regions {
        let Some(other) = b.regions.iter().find(|other| other.name == region.name) else { continue };
        let (in_a, in_b) = (&region.analysis, &other.analysis);
        if in_a.region_description != in_b.region_description {
            remarks.push(format!(
                "The region \"{}\" is another one: {} in A, {} in B.",
                region.name, in_a.region_description, in_b.region_description
            ));
        }
    }
    remarks
}

/// The regions whose names another run has none of, in quotes.
fn regions_without_counterpart(run: &FinishedRun, beside: &FinishedRun) -> Vec<String> {
    let lacks = |name: &str| beside.regions.iter().all(|region| region.name != name);
    let only = run.regions.iter().filter(|region| lacks(&region.name));
    only.map(|region| format!("\"{}\"", region.name)).collect()
}

impl From<RunNumber> for ComparedSide {
    fn from(number: RunNumber) -> Self {
        Self { value: number.value, interval: number.interval, truth: number.truth, words: number.words }
    }
}

impl ComparedSide {
    /// The number with its interval, as tables have it.
    #[must_use]
    pub fn text(&self) -> String {
        let [low, high] = self.interval.unwrap_or([0.0; 2]);
        let digits = digits_of(low, high);
        let short = |value: f64| match digits {
            Some(digits) => format!("{value:.digits$}"),
            None => short(value),
        };
        let interval = self.interval.map(|[low, high]| match high.is_finite() {
            true => format!(" ({} to {})", short(low), short(high)),
            false => format!(" ({} or more)", short(low)),
        });
        match (&self.words, self.value) {
            (Some(words), _) => words.clone(),
            (None, Some(value)) => short(value) + &interval.unwrap_or_default(),
            (None, None) => "-".into(),
        }
    }
}

impl ComparedNumber {
    /// Its name with its unit.
    #[must_use]
    pub fn name(&self) -> String {
        if self.unit.is_empty() { self.quantity.clone() } else { format!("{}, {}", self.quantity, self.unit) }
    }

    /// Cells of a row of a table: both runs, the difference with its interval, the verdict.
    #[must_use]
    pub fn cells(&self) -> [String; 4] {
        let side = |side: &Option<ComparedSide>| side.as_ref().map_or_else(|| "-".into(), ComparedSide::text);
        let signed = |value: f64| if value > 0.0 { format!("+{}", short(value)) } else { short(value) };
        let difference = self.difference.map_or_else(|| "-".into(), signed);
        let interval = self.difference_interval.filter(|[low, high]| low.is_finite() && high.is_finite());
        let interval = interval.map(|[low, high]| format!(" ({} to {})", signed(low), signed(high)));
        [
            side(&self.a),
            side(&self.b),
            difference + &interval.unwrap_or_default(),
            self.told_apart.text().into(),
        ]
    }
}
