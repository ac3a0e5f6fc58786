//! One photograph: its estimates, what they rest on, and how it looks.

use std::any::Any;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use fluorspar::analysis::PixelSelection;
use fluorspar::digest::sha256_hex;
use fluorspar::findings::{Caveat, Finding, FindingId, region_findings};
use fluorspar::pipeline::{AnalyzedFrame, CapturedFrame, ColorRendering, Preview, preview};
use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, Warning, preset};
use fluorspar_format::digest_bounded;
use fluorspar_report::outlined_preview;
use serde::{Deserialize, Serialize};

use super::pairing::Photograph;
use crate::analyze::{Regions, analyze_frames};
use crate::region_option::{RegionOption, region_options, regions_called};
use crate::{AnalyzeOptions, Error, Job, Left, Listener, Result};

/// Largest file that is read as a frame or a mask.
pub(super) const LARGEST_BYTES: u64 = 4 << 30;
/// Columns of the pictures of a page.
pub(super) const PICTURE_COLUMNS: usize = 320;
/// Verdict of a region that nobody looked at.
pub(super) const GUESS: &str = "guess";

/// What is estimated of each region.
const WANTED: [FindingId; 6] = [
    FindingId::RedShare,
    FindingId::Share,
    FindingId::LineShare,
    FindingId::ChromaticityR,
    FindingId::ChromaticityG,
    FindingId::MedianSignal,
];

/// What the interval of an estimate holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntervalKind {
    /// The number with 95 %.
    Estimate,
    /// The sensor's part of it alone.
    SensorNoise,
    /// A standard deviation of the pixels to both sides: the region, not what is known of its middle.
    Pixels,
    /// There is none.
    None,
}

/// A number of a region of a photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegionEstimate {
    /// Name of the region.
    pub region: String,
    /// What the number is.
    pub quantity: FindingId,
    /// The channel that it is of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<String>,
    /// The number; `None` where there is an upper limit only.
    pub value: Option<f64>,
    /// The interval.
    pub interval: Option<[f64; 2]>,
    /// What the interval holds.
    pub interval_kind: IntervalKind,
    /// Pixels of the region that count.
    pub pixels: usize,
    /// What makes it doubtful.
    pub warnings: Vec<String>,
}

/// A number of one of many photographs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PatientEstimate {
    /// Pseudonym of the person.
    pub patient: String,
    /// Visit of the person.
    pub visit: String,
    /// The analyzed capture.
    pub capture: String,
    /// Its file.
    pub frame: PathBuf,
    /// The number.
    #[serde(flatten)]
    pub number: RegionEstimate,
    /// Whether the number lies apart from those of the other photographs.
    #[serde(default)]
    pub lies_apart: bool,
}

/// A photograph that was analyzed, as the journal keeps it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct EstimatedPhotograph {
    /// Digest of its files and regions.
    pub(super) key: String,
    pub(super) estimates: Vec<PatientEstimate>,
    /// How it looks, with its regions: PNG in base 64.
    pub(super) picture: String,
}

/// Digest of what decides the estimates of a photograph: its files, frames of the camera, regions and masks.
///
/// # Errors
/// A file that can't be read.
pub(super) fn key_of(
    photograph: &Photograph,
    options: &AnalyzeOptions,
    regions: &[RegionOption],
) -> Result<String> {
    let options = options_of(photograph, options);
    let mut parts = vec![photograph.patient.clone(), photograph.visit.clone()];
    let frames = photograph.frames.iter().map(|(capture, file)| (capture.as_str(), file.as_path()));
    let dark = options.dark.iter().map(|file| ("dark", file.as_path()));
    let flat = options.flat.iter().map(|file| ("flat", file.as_path()));
    for (role, file) in frames.chain(dark).chain(flat) {
        parts.extend([role.to_owned(), file.display().to_string(), digest_bounded(file, LARGEST_BYTES)?]);
        let description = fluorspar_format::description_path(file);
        if description.is_file() {
            parts.push(digest_bounded(&description, LARGEST_BYTES)?);
        }
    }
    for region in regions {
        parts.push(format!("{region:?}"));
        for mask in region.masks() {
            parts.push(digest_bounded(Path::new(&mask), LARGEST_BYTES)?);
        }
    }
    parts.extend(photograph.regions.iter().map(|[_, _, verdict]| verdict.clone()));
    Ok(sha256_hex([serde_json::to_string(&parts)?]))
}

/// The regions of a photograph, those of the command line where it has none of its own; masks of its own lie below the folder of its table.
///
/// # Errors
/// A region that can't be read.
pub(super) fn regions_of(
    photograph: &Photograph,
    options: &AnalyzeOptions,
    table: Option<&Path>,
    experiment: &Experiment,
) -> Result<Vec<RegionOption>> {
    let site = |region: &RegionOption| site_of_region(&region.name, experiment);
    let of_site = |region: RegionOption| region.clone().of_site(site(&region).as_deref());
    if photograph.regions.is_empty() {
        return Ok(region_options(&options.named_region)?.into_iter().map(of_site).collect());
    }
    let texts: Vec<String> =
        photograph.regions.iter().map(|[name, place, _]| format!("{name}={place}")).collect();
    let folder = table.and_then(Path::parent).unwrap_or(Path::new(""));
    let called = |text: &str| {
        let place = table.map_or_else(String::new, |table| format!("{}: ", table.display()));
        format!("{place}region {text} of patient {}, visit {}", photograph.patient, photograph.visit)
    };
    Ok(regions_called(&texts, called)?.into_iter().map(|region| of_site(region.below(folder))).collect())
}

/// The tissue of a region that is called as a site is: "none" for teeth; nothing where no tissue is assumed at all.
pub(super) fn site_of_region(name: &str, experiment: &Experiment) -> Option<String> {
    let analysis = experiment.file.analysis.as_ref()?;
    let is_of_tissue = experiment.file.mouth.is_some() || analysis.tissue.is_some();
    if !is_of_tissue || analysis.tissue.as_deref() == Some("none") {
        return None;
    }
    let site = match name {
        "tongue" => "dorsal_tongue",
        "lips" => "lip",
        "teeth" => "tooth",
        other => other,
    };
    let is_mucosa = preset::site(site).ok()?.is_mucosa();
    Some(if is_mucosa { site } else { "none" }.to_owned())
}

/// The options of an analysis of one photograph.
pub(super) fn options_of(photograph: &Photograph, options: &AnalyzeOptions) -> AnalyzeOptions {
    let named = photograph.frames.iter().map(|(capture, file)| format!("{capture}={}", file.display()));
    let all =
        |own: &[PathBuf], shared: &[PathBuf]| if own.is_empty() { shared.to_vec() } else { own.to_vec() };
    AnalyzeOptions {
        frame: named.collect(),
        dark: all(&photograph.dark, &options.dark),
        flat: all(&photograph.flat, &options.flat),
        experiment: options.experiment.clone(),
        changes: options.changes.clone(),
        ..AnalyzeOptions::default()
    }
}

/// Analyzes one photograph. What is warned of belongs to it alone.
///
/// # Errors
/// Frames that can't be read or analyzed.
pub(super) fn estimate(
    photograph: &Photograph,
    options: &AnalyzeOptions,
    regions: &[RegionOption],
    key: String,
    job: &Job,
) -> Result<EstimatedPhotograph> {
    let heard = Arc::new(Heard::default());
    let own_job = Job::new(job.stop.clone(), heard.clone());
    let (mut estimates, mut picture) = (Vec::new(), None);
    let see = |study: &Study, frames: &[CapturedFrame], found: &[(&str, &AnalyzedFrame)]| {
        // Regions of the table stand beside that of [analysis], which is then the first of them
        let own: Vec<&(&str, &AnalyzedFrame)> =
            found.iter().filter(|(name, _)| regions.is_empty() == name.is_empty()).collect();
        for (name, analyzed) in &own {
            estimates.extend(estimates_of(photograph, name, analyzed));
        }
        let selections: Vec<&PixelSelection> = own.iter().map(|(_, analyzed)| &analyzed.region).collect();
        picture = shown(study, frames, &photograph.frames[0].0)
            .and_then(|image| outlined_preview(&image, &selections, PICTURE_COLUMNS));
        Ok(())
    };
    let given = Regions { main: regions.first(), beside: regions };
    analyze_frames(&options_of(photograph, options), &given, &own_job, see)?;
    let warnings = heard.warnings.lock().unwrap_or_else(PoisonError::into_inner);
    for estimate in &mut estimates {
        estimate.number.warnings.extend(warnings.iter().cloned());
    }
    Ok(EstimatedPhotograph { key, estimates, picture: STANDARD.encode(picture.unwrap_or_default()) })
}

/// How a frame looks.
pub(super) fn shown(study: &Study, frames: &[CapturedFrame], label: &str) -> Option<Preview> {
    let frame = frames.iter().find(|frame| frame.raw.label == label)?;
    Some(preview(&frame.developed, &ColorRendering::of_frame(study, study.capture(label)?)))
}

/// What is said of a region of the verdict `guess`.
pub const UNCONFIRMED: &str = "The region is a guess that nobody confirmed";

fn estimates_of(photograph: &Photograph, region: &str, analyzed: &AnalyzedFrame) -> Vec<PatientEstimate> {
    let analysis = &analyzed.analysis;
    let (capture, frame) = photograph.frames[0].clone();
    let is_guess = photograph.regions.iter().any(|[name, _, verdict]| name == region && verdict == GUESS);
    let unconfirmed = is_guess.then(|| UNCONFIRMED.to_owned());
    let warnings = analysis.warnings.iter().map(|warning| warning.summary().to_owned());
    let warnings: Vec<String> = warnings.chain(unconfirmed).collect();
    let is_wanted = |finding: &Finding| {
        WANTED.contains(&finding.id) && finding.frame.as_ref().is_none_or(|of| *of == capture)
    };
    let wanted = region_findings(analysis).into_iter().filter(is_wanted);
    let estimate = |finding: Finding| PatientEstimate {
        patient: photograph.patient.clone(),
        visit: photograph.visit.clone(),
        capture: capture.clone(),
        frame: frame.clone(),
        number: RegionEstimate {
            region: if region.is_empty() { "analysis".into() } else { region.into() },
            quantity: finding.id,
            channel: finding.channel.clone(),
            value: finding.value.filter(|value| value.is_finite()),
            interval: finding.interval.filter(|ends| ends.iter().all(|end| end.is_finite())),
            interval_kind: kind_of(&finding),
            pixels: analysis.counts.valid,
            warnings: warnings.clone(),
        },
        lies_apart: false,
    };
    wanted.map(estimate).collect()
}

fn kind_of(finding: &Finding) -> IntervalKind {
    let ranges = [Caveat::NineTenths, Caveat::StandardDeviation];
    if finding.interval.is_none() {
        IntervalKind::None
    } else if ranges.iter().any(|caveat| finding.has(caveat)) {
        IntervalKind::Pixels
    } else if finding.has(&Caveat::SensorNoiseAlone) {
        IntervalKind::SensorNoise
    } else {
        IntervalKind::Estimate
    }
}

/// Hears of one photograph among many: only warnings are kept.
#[derive(Default)]
pub(super) struct Heard {
    warnings: Mutex<Vec<String>>,
}

impl Listener for Heard {
    fn status(&self, _: &str) {}

    fn hears_status(&self) -> bool {
        false
    }

    fn warnings(&self, warnings: &[Warning]) {
        let mut all = self.warnings.lock().unwrap_or_else(PoisonError::into_inner);
        // Frames are found in the folder: nobody types them
        let without_options =
            |warning: &Warning| warning.summary().split(": ⟨").next().unwrap_or_default().to_owned();
        all.extend(warnings.iter().map(without_options));
    }

    fn begin(&self, _: &'static str, _: &'static str, _: Left) -> Box<dyn Fn(f64) + Sync> {
        Box::new(|_| ())
    }

    fn begin_writing(&self, _: &Path) -> Box<dyn Any> {
        Box::new(())
    }
}

/// A picture that the journal keeps.
///
/// # Errors
/// A journal that another program changed.
pub(super) fn picture_of(photograph: &EstimatedPhotograph) -> Result<Vec<u8>> {
    STANDARD
        .decode(&photograph.picture)
        .map_err(|error| Error::Failed(format!("the journal is damaged: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_holds_the_frames_of_the_command_line() {
        let folder = tempfile::tempdir().unwrap();
        let [frame, dark] = ["P1_blue.dng", "dark.dng"].map(|name| folder.path().join(name));
        std::fs::write(&frame, b"frame").unwrap();
        std::fs::write(&dark, b"dark").unwrap();
        let photograph = Photograph { frames: vec![("blue".into(), frame)], ..Photograph::default() };
        let key = |dark: &[PathBuf], flat: &[PathBuf]| {
            let options =
                AnalyzeOptions { dark: dark.into(), flat: flat.into(), ..AnalyzeOptions::default() };
            key_of(&photograph, &options, &[]).unwrap()
        };
        let dark = std::slice::from_ref(&dark);
        let keys = [key(&[], &[]), key(dark, &[]), key(&[], dark)];
        assert!(keys[0] != keys[1] && keys[1] != keys[2] && keys[0] != keys[2]);
        std::fs::write(&dark[0], b"another").unwrap();
        assert_ne!(key(dark, &[]), keys[1]);
    }
}
