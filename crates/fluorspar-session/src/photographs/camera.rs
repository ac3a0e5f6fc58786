//! Photographs of a camera that are looked at and drawn upon one by one, before a table of them is analyzed.

use std::path::{Path, PathBuf};

use fluorspar::pipeline::{
    AnalyzedFrame, Calibration, CapturedFrame, ColorRendering, RawExposures, develop_frames,
    subtract_what_is_given,
};
use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, resolve, resolve_captures};

use super::known;
use super::pairing::{KnownCapture, capture_of, person_told};
use crate::analyze::{Regions, analyze_frames, read_raw};
use crate::region_option::region_options;
use crate::values::quoted;
use crate::{AnalyzeOptions, Error, ExperimentSource, Job, Result};

/// The camera and the lights that photographs are taken for: an experiment without its surfaces.
pub struct PhotographCamera {
    name: String,
    parsed: Experiment,
    study: Study,
}

/// Name of the region whose estimate is asked for.
const DRAWN: &str = "drawn";

/// The camera, lights and captures of an experiment, without its surfaces where these are not needed.
///
/// # Errors
/// An experiment that can't be resolved, or has no sensor, lens or capture.
pub(crate) fn camera_study(source: &ExperimentSource, parsed: &Experiment) -> Result<Study> {
    let concentrations: Vec<&str> = parsed.file.concentration.keys().map(String::as_str).collect();
    let study = match resolve_captures(parsed, parsed, &concentrations)? {
        Some(found) => found.into_resolved(parsed).study,
        None => resolve(parsed)?.study,
    };
    if study.captures.is_empty() || study.camera.sensor.is_none() || study.camera.lens.is_none() {
        let why =
            "frames of a camera need an experiment with lens, sensor and captures; give one that has them";
        return Err(Error::Input(format!("{}: {why}", source.name)));
    }
    Ok(study)
}

impl PhotographCamera {
    /// Opens an experiment by file name or built-in name.
    ///
    /// # Errors
    /// An experiment that can't be read, or has no sensor, lens or capture.
    pub fn open(experiment: &str) -> Result<Self> {
        let source = ExperimentSource::find(Some(experiment))?;
        let parsed = source.parse(&[])?;
        let study = camera_study(&source, &parsed)?;
        Ok(Self { name: experiment.into(), parsed, study })
    }

    /// Names of its captures.
    pub fn captures(&self) -> Vec<&str> {
        self.study.captures.iter().map(|capture| capture.frame.label.as_str()).collect()
    }

    /// The capture that is analyzed, if any is.
    pub fn analyzed(&self) -> Option<&str> {
        self.parsed.file.analysis.as_ref().map(|section| section.frame.as_str())
    }

    /// Parts that its analysis, regions and objects name: what a drawn region may show.
    pub fn parts(&self) -> Vec<&str> {
        let file = &self.parsed.file;
        let of_analysis = file.analysis.iter().flat_map(|section| {
            let of_regions = section.region.iter().flat_map(|region| &region.place.parts);
            section.place.parts.iter().chain(of_regions)
        });
        let of_objects = file.object.iter().map(|object| &object.name);
        let mut parts: Vec<&str> = Vec::new();
        for part in of_analysis.chain(of_objects) {
            if !parts.contains(&part.as_str()) {
                parts.push(part);
            }
        }
        parts
    }

    /// Capture, person and visit of a frame: by the folders between `below` and it, by its name or, of the capture, what it tells of itself;
    /// the analyzed capture and no person where nothing tells one, so that frames of one visit stay together.
    pub fn told_by(&self, file: &Path, below: &Path) -> [String; 3] {
        let captures: Vec<KnownCapture> = self.parsed.file.capture.iter().map(known).collect();
        let capture = capture_of(file, &captures).ok();
        let capture = capture.or_else(|| self.analyzed().map(str::to_owned));
        let capture =
            capture.or_else(|| self.captures().first().map(|name| (*name).to_owned())).unwrap_or_default();
        let [patient, visit] = person_told(file, below, &capture).unwrap_or_default();
        [capture, patient, visit]
    }

    /// The frame in a file, developed as one of a capture, and how its colors are shown. Nothing is subtracted from it.
    ///
    /// # Errors
    /// A file that is no raw frame, a frame that lacks a number, a capture that is not there.
    pub fn developed(&self, file: &Path, capture: &str) -> Result<(CapturedFrame, ColorRendering)> {
        let mut study = self.study.clone();
        subtract_what_is_given(&mut study, |label| label == capture);
        let settings = study.capture(capture).ok_or_else(|| {
            Error::Input(format!(
                "there is no capture \"{capture}\"; there are {}",
                self.captures().join(", ")
            ))
        })?;
        let raw = read_raw(&study, file, Some(capture))?.image;
        let calibration = Calibration::of_frames(study.develop.demosaicing, Vec::new(), Vec::new(), None)?;
        let rendering = ColorRendering::of_frame(&study, settings);
        let exposures = vec![RawExposures { raw, bracket: Vec::new() }];
        let frame = develop_frames(&study, exposures, &calibration)?.pop();
        Ok((
            frame.ok_or_else(|| Error::Failed(format!("{}: no frame came of it", file.display())))?,
            rendering,
        ))
    }

    /// What the pixels of a region say, as `analyze --named-region` has it. `frames` are the captures and files of one visit, `place` is
    /// where the region lies, as fields of `[analysis]`.
    ///
    /// # Errors
    /// Those of [`analyze`].
    pub fn estimate(
        &self,
        frames: &[(String, PathBuf)],
        place: &[(&str, String)],
        job: &Job,
    ) -> Result<AnalyzedFrame> {
        let fields: Vec<String> = place.iter().map(|(field, value)| format!("{field} = {value}")).collect();
        let regions = region_options(&[format!("{DRAWN}={{ {} }}", fields.join(", "))])?;
        let options = AnalyzeOptions {
            frame: frames.iter().map(|(capture, file)| format!("{capture}={}", file.display())).collect(),
            experiment: Some(self.name.clone()),
            ..AnalyzeOptions::default()
        };
        let mut found = None;
        let see = |_: &Study, _: &[CapturedFrame], seen: &[(&str, &AnalyzedFrame)]| {
            found = seen.first().map(|(_, analyzed)| (*analyzed).clone());
            Ok(())
        };
        analyze_frames(&options, &Regions { main: regions.first(), beside: &[] }, job, see)?;
        found
            .ok_or_else(|| Error::Input(format!("{} has no [analysis] section; add one", quoted(&self.name))))
    }
}
