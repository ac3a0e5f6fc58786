//! A finished run as its results tell it.

use fluorspar::analysis::{Analysis, RegionOfInterest};
use fluorspar::pipeline::{FrameLeak, Viewer};
use serde::Deserialize;
use serde_json::Value;
use thiserror::Error;

/// What a finished `run`, `capture` or `analyze` left in its `results.json`, as far as runs are compared by it.
#[derive(Clone, Debug, PartialEq)]
pub struct FinishedRun {
    /// How messages and headings call it.
    pub name: String,
    /// Title of its experiment; empty where it is not known.
    pub title: String,
    /// Version of the program that wrote it; empty where it is not known.
    pub version: String,
    /// Digest of its experiment; empty where it is not known.
    pub experiment_sha256: String,
    /// The fluorophore whose share is looked for, in words; "porphyrin" where none is named.
    pub target: String,
    /// Pixels of its render; `None` of results without one.
    pub render_pixels: Option<u64>,
    /// Pixels of its analyzed frame, where they are known.
    pub frame_pixels: Option<u64>,
    /// Its frames.
    pub frames: Vec<FinishedFrame>,
    /// The analysis of the region.
    pub analysis: Option<Analysis>,
    /// Further regions of its frame that are in view.
    pub regions: Vec<FinishedRegion>,
    /// Reflected light against fluorescence, of frames with light.
    pub leaks: Vec<FrameLeak>,
    /// What eyes and tissue bear.
    pub safety: Option<FinishedSafety>,
}

/// A further region of a finished run.
#[derive(Clone, Debug, PartialEq)]
pub struct FinishedRegion {
    /// Its name.
    pub name: String,
    /// The fluorophore whose share is looked for there, in words.
    pub target: String,
    /// Its analysis.
    pub analysis: Analysis,
}

/// A region as results have it; without an analysis where it is not in view.
#[derive(Deserialize)]
struct RegionResults {
    name: String,
    analysis: Option<Analysis>,
}

/// A frame of a finished run.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct FinishedFrame {
    /// Its name.
    pub name: String,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Share of its pixels that are saturated, 0 to 1.
    pub saturated_fraction: f64,
}

fn is_true() -> bool {
    true
}

/// Safety of the captures of a finished run.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct FinishedSafety {
    /// Whether the lights shine into a mouth.
    #[serde(default = "is_true")]
    pub is_mouth: bool,
    /// Each capture.
    pub captures: Vec<FinishedCapture>,
    /// Whole sequences of captures, for each viewer.
    pub program: Vec<FinishedProgram>,
}

/// Safety of a capture.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct FinishedCapture {
    /// Its name.
    pub name: String,
    /// Time that the lights are on, s.
    pub light_on_s: f64,
    /// Those who are exposed; none where no light is on.
    pub viewers: Vec<FinishedViewer>,
}

/// Safety of one viewer of a capture.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct FinishedViewer {
    /// Who.
    pub viewer: Viewer,
    /// Captures in 8 hours; `None` where nothing is assessed.
    pub captures_per_day: Option<u64>,
}

/// Sequences that a viewer bears.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct FinishedProgram {
    /// Who.
    pub viewer: Viewer,
    /// Sequences in 8 hours; `None` where nothing is assessed.
    pub sequences_per_day: Option<u64>,
}

/// Why results can't be compared.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum UnreadableRun {
    /// Results of another command.
    #[error(
        "these are no results of `run`, `capture` or `analyze --out`; designs are compared by `fluorspar design compare`"
    )]
    OfAnotherCommand,
    /// A part that has another form.
    #[error("its `{part}` can't be read: {why}. Make it again with this version of the program")]
    Damaged {
        /// The part.
        part: &'static str,
        /// What is wrong.
        why: String,
    },
}

impl FinishedRun {
    /// Reads `results.json` of `run` and `capture`, or of `analyze`, which holds the analysis alone. `target` tells the fluorophore that is
    /// looked for, in words: in the region of a name, or in that of the analysis.
    ///
    /// # Errors
    /// Results of another command, or in another form.
    pub fn read(
        name: &str,
        target: &dyn Fn(Option<&str>) -> String,
        results: &Value,
    ) -> Result<Self, UnreadableRun> {
        let text = |key: &str| results.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
        let number = |key: &str| results.get(key).and_then(Value::as_u64).filter(|count| *count > 0);
        let is_analysis = results.get("counts").is_some() && results.get("region_description").is_some();
        let frames =
            if is_analysis { Some(Vec::new()) } else { part::<Vec<FinishedFrame>>(results, "frames")? };
        Ok(Self {
            name: name.into(),
            title: text("title"),
            version: text("version"),
            experiment_sha256: text("experiment_sha256"),
            target: target(None),
            render_pixels: number("width_px").zip(number("height_px")).map(|(columns, rows)| columns * rows),
            frame_pixels: None,
            frames: frames.ok_or(UnreadableRun::OfAnotherCommand)?,
            analysis: match is_analysis {
                true => Some(of_part(results, "analysis")?),
                false => part(results, "analysis")?,
            },
            regions: part::<Vec<RegionResults>>(results, "regions")?
                .unwrap_or_default()
                .into_iter()
                .filter_map(|RegionResults { name, analysis }| {
                    Some(FinishedRegion { target: target(Some(&name)), name, analysis: analysis? })
                })
                .collect(),
            leaks: part(results, "leaks")?.unwrap_or_default(),
            safety: part(results, "safety")?,
        })
    }

    /// The region of its analysis in words.
    pub(super) fn region(&self) -> Option<(&str, &RegionOfInterest)> {
        self.analysis.as_ref().map(|a| (a.region_description.as_str(), &a.settings.region))
    }
}

/// A part of results; `None` where it is absent or null.
fn part<T: for<'de> Deserialize<'de>>(
    results: &Value,
    key: &'static str,
) -> Result<Option<T>, UnreadableRun> {
    match results.get(key) {
        None | Some(Value::Null) => Ok(None),
        Some(value) => of_part(value, key).map(Some),
    }
}

fn of_part<T: for<'de> Deserialize<'de>>(value: &Value, part: &'static str) -> Result<T, UnreadableRun> {
    T::deserialize(value).map_err(|error| UnreadableRun::Damaged { part, why: error.to_string() })
}
