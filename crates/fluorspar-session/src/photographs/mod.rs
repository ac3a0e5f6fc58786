//! Many photographs: paired to frames of captures, analyzed one by one, and told together. What fails is told, and the rest goes on.

mod camera;
mod estimate;
mod outcome;
mod pairing;
mod proposal;
mod table;

pub(crate) use camera::camera_study;
pub use camera::{PhotographCamera, camera_digest};
pub use estimate::{IntervalKind, PatientEstimate, RegionEstimate, UNCONFIRMED};
pub use pairing::Photograph;
pub(crate) use pairing::files_below;
pub(crate) use proposal::path_from;
pub use proposal::photograph_pictures;
pub use table::{PhotographRow, photographs_csv, read_photographs};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fluorspar::digest::sha256_hex;
use fluorspar::units::counted;
use fluorspar_experiment::Experiment;
use fluorspar_experiment::schema::ExposureTime;
use fluorspar_format::{Journal, OutputFolder, digest_bounded};
use serde::{Deserialize, Serialize};
use serde_json::json;

use self::estimate::{EstimatedPhotograph, LARGEST_BYTES, estimate, key_of, regions_of};
use self::outcome::{mark_apart, write_estimates, write_proposal};
use self::pairing::{
    KnownCapture, LeftOut, completed, holds_captures, holds_photographs, photographs_of, rows_of_folder,
};
use self::proposal::propose;
use self::table::WRONG;
use crate::region_option::{RegionOption, regions_called};
use crate::shard::journal_beside;
use crate::source::files_named;
use crate::{AnalyzeOptions, Error, ErrorKind, ExperimentSource, Job, Left, Result};

/// Name of the table of a folder of photographs.
const TABLE: &str = "photographs.csv";
/// Results of a photograph, and its share of the page, at most.
const PHOTOGRAPH_BYTES: u64 = 1 << 20;
/// A picture and three masks of a photograph, at most.
const PROPOSAL_BYTES: u64 = 64 << 20;

/// A photograph without an answer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FailedPhotograph {
    /// Its file.
    pub frame: PathBuf,
    /// What to mend.
    pub why: String,
}

impl FailedPhotograph {
    fn of(photograph: &Photograph, error: &Error) -> Self {
        Self { frame: photograph.frames[0].1.clone(), why: error.to_string() }
    }

    /// Photographs without an answer, a line each. Many messages begin with the file that they are about.
    pub fn list(failures: &[Self]) -> String {
        let line = |failed: &Self| {
            let frame = failed.frame.display().to_string();
            if failed.why.starts_with(&frame) {
                failed.why.clone()
            } else {
                format!("{frame}: {}", failed.why)
            }
        };
        let lines: Vec<String> = failures.iter().map(line).collect();
        let count = counted(lines.len(), "photograph has", "photographs have");
        format!("{count} no answer:\n  {}", lines.join("\n  "))
    }
}

/// What many photographs gave.
#[derive(Clone, Debug, Serialize)]
pub struct AnalyzedPhotographs {
    /// Folder of the results.
    pub folder: PathBuf,
    /// Photographs with an answer.
    pub photographs: usize,
    /// Their estimates; none where their regions are not placed yet.
    pub estimates: Vec<PatientEstimate>,
    /// Photographs without an answer.
    pub failures: Vec<FailedPhotograph>,
}

/// The photographs of a command, with what all of them share.
pub(crate) struct PhotographWork<'a> {
    options: &'a AnalyzeOptions,
    source: ExperimentSource,
    experiment: Experiment,
    /// The table that was read.
    table: Option<PathBuf>,
    photographs: Vec<Photograph>,
    left_out: Vec<LeftOut>,
    /// Folder of the results.
    folder: PathBuf,
}

/// Whether a folder or file is one of photographs, and not of frames that `run` or `capture` wrote.
pub(crate) fn is_of_photographs(path: &Path) -> bool {
    if !path.is_dir() {
        return path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
    }
    let of_run = ["experiment.toml", "results.json"].iter().any(|name| path.join(name).exists())
        || holds_captures(path);
    !of_run && (path.join(TABLE).is_file() || holds_photographs(path))
}

/// Analyzes the photographs of a folder or a table; without regions writes pictures and guesses to place them by. Goes on where it was
/// stopped or killed.
///
/// # Errors
/// Options without a meaning here, a table that can't be read, an experiment without an analysis, no photograph at all, files that can't
/// be written; a job that is stopped.
pub(crate) fn analyze_photographs(
    options: &AnalyzeOptions,
    path: &Path,
    job: &Job,
) -> Result<AnalyzedPhotographs> {
    let mut work = PhotographWork::prepare(options, path)?;
    work.leave_wrong_out(path)?;
    let regions = work.regions()?;
    let is_placed = |regions: &Vec<RegionOption>| !regions.is_empty();
    if work.has_place() || regions.iter().any(is_placed) {
        work.estimate(&regions, job)
    } else {
        let folder = OutputFolder::prepare(
            &work.folder,
            &work.inputs(),
            PROPOSAL_BYTES * work.photographs.len() as u64,
        )?;
        let (proposed, failures) = propose(&work, &folder, job)?;
        if proposed.is_empty() {
            return Err(Error::Input(FailedPhotograph::list(&failures)));
        }
        write_proposal(&work, folder, proposed, failures, job)
    }
}

/// The photographs of a folder or a table, with paths as the working folder has them, and the files that are none. Masks of regions lie
/// below the folder of the table.
///
/// # Errors
/// As the analysis of photographs.
pub fn find_photographs(
    options: &AnalyzeOptions,
    path: &Path,
) -> Result<(Vec<Photograph>, Vec<FailedPhotograph>)> {
    let work = PhotographWork::prepare(options, path)?;
    let failures = work.failures();
    let folder = work.table.as_deref().and_then(Path::parent).unwrap_or(Path::new("")).to_path_buf();
    let mut photographs = work.photographs;
    for region in photographs.iter_mut().flat_map(|photograph| &mut photograph.regions) {
        if let Some(mask) = region_mask(region)? {
            region[1] = region_with_mask(region, &folder.join(mask))?;
        }
    }
    Ok((photographs, failures))
}

/// The mask of a region (name, place and verdict), in whatever form its place is written.
///
/// # Errors
/// A region that can't be read.
pub fn region_mask([name, place, _]: &[String; 3]) -> Result<Option<PathBuf>> {
    Ok(region_of(name, place)?.masks().next().map(PathBuf::from))
}

/// The place of a region (name, place and verdict) with its mask, where it has one, at another path.
///
/// # Errors
/// A region that can't be read.
pub fn region_with_mask([name, place, _]: &[String; 3], mask: &Path) -> Result<String> {
    let region = region_of(name, place)?;
    let has_mask = region.masks().next().is_some();
    Ok(match place.trim_start().starts_with('{') {
        _ if !has_mask => place.clone(),
        true => region.masked(mask).table(),
        false => mask.to_string_lossy().into_owned(),
    })
}

fn region_of(name: &str, place: &str) -> Result<RegionOption> {
    Ok(regions_called(&[format!("{name}={place}")], |text| format!("region {text}"))?.remove(0))
}

/// The estimates of one photograph, whose regions have masks as the working folder has them.
///
/// # Errors
/// No region, frames that can't be read or analyzed.
pub fn estimate_photograph(
    options: &AnalyzeOptions,
    photograph: &Photograph,
    job: &Job,
) -> Result<Vec<PatientEstimate>> {
    let source = ExperimentSource::find(options.experiment.as_deref())?;
    let experiment = source.parse(&options.changes.overrides())?;
    let regions = regions_of(photograph, options, None, &experiment)?;
    if regions.is_empty() {
        return Err(Error::Input("it has no region".into()));
    }
    Ok(estimate(photograph, options, &regions, String::new(), job)?.estimates)
}

impl<'a> PhotographWork<'a> {
    fn prepare(options: &'a AnalyzeOptions, path: &Path) -> Result<Self> {
        let shown = path.display();
        if !path.exists() {
            return Err(Error::Input(format!("{shown}: there is no such folder or table of photographs")));
        }
        if !options.frame.is_empty() || options.component_image.is_some() {
            return Err(Error::Input(format!(
                "{shown}: of many photographs each file is found in the folder or its table, and none has a component image; leave ⟨frame⟩ and \
                 ⟨component_image⟩ out"
            )));
        }
        let Some(name) = &options.experiment else {
            return Err(Error::Input(format!(
                "{shown}: these are photographs, and what their camera, its lights and filters are stands in no file here; name the experiment \
                 with ⟨experiment⟩ (a file to begin with: fluorspar new own-camera)"
            )));
        };
        let source = ExperimentSource::find(Some(name))?;
        let overrides = options.changes.overrides();
        let experiment = source.parse(&overrides)?;
        let Some(analysis) = &experiment.file.analysis else {
            return Err(Error::Input(format!("{name}: the experiment has no [analysis] section; add one")));
        };
        let captures: Vec<KnownCapture> = experiment.file.capture.iter().map(known).collect();
        let table = if path.is_dir() { path.join(TABLE) } else { path.to_path_buf() };
        let table = table.is_file().then_some(table);
        let (mut photographs, left_out) =
            found_photographs(path, table.as_deref(), &captures, &analysis.frame)?;
        photographs.sort_by(|a, b| (&a.patient, &a.visit, &a.frames).cmp(&(&b.patient, &b.visit, &b.frames)));
        if photographs.is_empty() {
            let why: Vec<String> =
                left_out.iter().map(|(file, why)| format!("\n  {}: {why}", file.display())).collect();
            return Err(Error::Input(format!(
                "{shown}: there is no photograph here (DNG, TIFF or PNG with its description){}",
                why.concat()
            )));
        }
        let stem = std::path::absolute(path)
            .ok()
            .and_then(|path| Some(path.file_stem()?.to_string_lossy().into_owned()));
        let folder = options
            .out
            .clone()
            .unwrap_or_else(|| format!("fluorspar-out/analyze-{}", stem.unwrap_or_default()).into());
        Ok(Self { options, source, experiment, table, photographs, left_out, folder })
    }

    /// Leaves regions of the verdict `wrong` out, and photographs that have no others.
    fn leave_wrong_out(&mut self, path: &Path) -> Result<()> {
        self.photographs.retain_mut(|photograph| {
            let had_none = photograph.regions.is_empty();
            photograph.regions.retain(|[_, _, verdict]| verdict != WRONG);
            had_none || !photograph.regions.is_empty()
        });
        if self.photographs.is_empty() {
            let shown = path.display();
            return Err(Error::Input(format!(
                "{shown}: the verdict of every region is \"wrong\"; place one"
            )));
        }
        Ok(())
    }

    /// The regions of each photograph. Leaves those out whose own can't be read.
    fn regions(&mut self) -> Result<Vec<Vec<RegionOption>>> {
        let (mut placed, mut regions) = (Vec::new(), Vec::new());
        for photograph in std::mem::take(&mut self.photographs) {
            match regions_of(&photograph, self.options, self.table.as_deref(), &self.experiment) {
                Ok(found) => {
                    regions.push(found);
                    placed.push(photograph);
                }
                Err(error) if photograph.regions.is_empty() => return Err(error),
                Err(error) => self.left_out.push((photograph.frames[0].1.clone(), error.to_string())),
            }
        }
        self.photographs = placed;
        if self.photographs.is_empty() {
            return Err(Error::Input(FailedPhotograph::list(&self.failures())));
        }
        Ok(regions)
    }

    /// Whether the experiment itself says where the region lies.
    fn has_place(&self) -> bool {
        self.experiment.file.analysis.as_ref().is_some_and(|analysis| {
            let place = &analysis.place;
            place.rectangle_px.is_some() || place.polygon_px.is_some() || place.mask.is_some()
        })
    }

    /// Files that are read.
    fn inputs(&self) -> Vec<PathBuf> {
        let frames =
            self.photographs.iter().flat_map(|photograph| photograph.frames.iter().map(|(_, file)| file));
        self.table.iter().chain(&self.source.file).chain(frames).cloned().collect()
    }

    fn failures(&self) -> Vec<FailedPhotograph> {
        let failed = |(frame, why): &LeftOut| FailedPhotograph { frame: frame.clone(), why: why.clone() };
        self.left_out.iter().map(failed).collect()
    }

    /// Estimates all photographs, those in the journal without work.
    fn estimate(&self, regions: &[Vec<RegionOption>], job: &Job) -> Result<AnalyzedPhotographs> {
        let count = self.photographs.len();
        let folder = OutputFolder::prepare(&self.folder, &self.inputs(), PHOTOGRAPH_BYTES * count as u64)?;
        let changes = self.options.changes.overrides();
        let named = match &self.source.file {
            Some(file) => files_named(Path::new(""), file)?,
            None => Vec::new(),
        };
        let named: Vec<String> =
            named.iter().map(|file| digest_bounded(file, LARGEST_BYTES)).collect::<Result<_, _>>()?;
        let sha256 = sha256_hex([
            self.source.text.clone(),
            format!("{changes:?}"),
            self.source.base_dir.display().to_string(),
            named.concat(),
        ]);
        let head = json!({ "photographs_sha256": sha256, "version": env!("CARGO_PKG_VERSION") });
        let path = journal_beside(&self.folder, &sha256, "");
        let (mut journal, entries) = Journal::open(&path, &head)?;
        let read = |entry: serde_json::Value| EstimatedPhotograph::deserialize(entry).ok();
        let mut known: BTreeMap<String, EstimatedPhotograph> =
            entries.into_iter().filter_map(read).map(|entry| (entry.key.clone(), entry)).collect();
        let (mut done, mut failures) = (Vec::new(), self.failures());
        let share_done = job.listener.begin("Analyzing photographs", "the photographs", Left::Results);
        for (number, (photograph, regions)) in self.photographs.iter().zip(regions).enumerate() {
            let found = self.estimate_one(photograph, regions, &mut known, job);
            if job.is_stopped() {
                let text = format!(
                    "stopped after {number} of {count} photographs; the same command goes on from there"
                );
                return Err(Error::Stopped(text));
            }
            match found {
                Ok((found, is_new)) => {
                    if is_new {
                        journal.append(&serde_json::to_value(&found)?)?;
                    }
                    done.push((photograph, found));
                }
                Err(error) if error.kind() == ErrorKind::Input => {
                    failures.push(FailedPhotograph::of(photograph, &error))
                }
                Err(error) => return Err(error),
            }
            share_done((number + 1) as f64 / count as f64);
        }
        if done.is_empty() {
            // What was finished before stays, to go on from
            if known.is_empty() {
                journal.discard()?;
            }
            return Err(Error::Input(FailedPhotograph::list(&failures)));
        }
        mark_apart(&mut done);
        write_estimates(self, folder, &done, failures, job)
    }

    /// What a photograph gives, and whether that is not in the journal.
    fn estimate_one(
        &self,
        photograph: &Photograph,
        regions: &[RegionOption],
        known: &mut BTreeMap<String, EstimatedPhotograph>,
        job: &Job,
    ) -> Result<(EstimatedPhotograph, bool)> {
        if regions.is_empty() && !self.has_place() {
            return Err(Error::Input(format!(
                "{}: it has no region; write one into the table, or strike the line",
                photograph.frames[0].1.display()
            )));
        }
        let key = key_of(photograph, self.options, regions)?;
        match known.remove(&key) {
            Some(known) => Ok((known, false)),
            None => Ok((estimate(photograph, self.options, regions, key, job)?, true)),
        }
    }
}

/// A capture as frames are told by it.
fn known(capture: &fluorspar_experiment::schema::CaptureSection) -> KnownCapture {
    let exposure_s = match capture.exposure_ms {
        ExposureTime::Milliseconds(ms) => Some(1e-3 * ms),
        ExposureTime::Auto => None,
    };
    KnownCapture { name: capture.name.clone(), exposure_s }
}

/// The photographs of a table, or of a folder without one; frames of the camera found by name serve all of it.
fn found_photographs(
    path: &Path,
    table: Option<&Path>,
    captures: &[KnownCapture],
    analyzed: &str,
) -> Result<(Vec<Photograph>, Vec<LeftOut>)> {
    if let Some(table) = table {
        let (rows, mut left_out) = completed(read_photographs(table)?, table, captures);
        let (photographs, unpaired) = photographs_of(&rows, analyzed);
        left_out.extend(unpaired);
        return Ok((photographs, left_out));
    }
    let (rows, dark, flat, mut left_out) = rows_of_folder(path, captures);
    let (mut photographs, unpaired) = photographs_of(&rows, analyzed);
    left_out.extend(unpaired);
    for photograph in &mut photographs {
        (photograph.dark, photograph.flat) = (dark.clone(), flat.clone());
    }
    Ok((photographs, left_out))
}
