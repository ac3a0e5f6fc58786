//! A camera from its own frames: dark ones, flat ones, known targets.

mod calibration_file;
mod camera_file;

use std::cell::{Cell, OnceCell};
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::image::SensorImage;
use fluorspar::pipeline::{CameraScales, KnownTarget, RecordedTarget, target_rates};
use fluorspar::sensor::{FrameCalibration, FrameStack, calibrate_frames};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::Warning;
use fluorspar_format::{OutputFolder, read_described_frame};
use fluorspar_report::{CalibrationResults, calibration_report};
use serde::{Deserialize, Serialize};

pub use self::calibration_file::CalibrationText;
use self::calibration_file::{CalibrationFile, Target};
use self::camera_file::{CameraHead, camera_toml};
use crate::photographs::{camera_study, path_from};
use crate::{Error, ExperimentSource, Job, Left, Result};

/// Which frames a camera is calibrated from.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct CalibrateOptions {
    /// Calibration file (.toml): which frames are dark, flat, of known targets (`fluorspar new calibration` writes one to start from).
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub file: PathBuf,
    /// Folder for camera.toml, an experiment that every command takes, report.html and results.json
    /// [default: fluorspar-out/calibrate-FILE].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// A camera that was calibrated.
#[derive(Clone, Debug, Serialize)]
pub struct CalibratedCamera {
    /// Folder of the results.
    pub folder: PathBuf,
    /// What dark and flat frames tell.
    pub camera: FrameCalibration,
    /// What targets tell.
    pub scales: CameraScales,
    /// What makes it doubtful.
    pub warnings: Vec<Warning>,
}

/// Room of the results at most.
const OUT_BYTES: u64 = 8 << 20;

/// Frames of one exposure time and gain.
struct Setting {
    exposure_s: f64,
    gain: f64,
    files: Vec<PathBuf>,
}

/// The frames of a calibration, read one by one.
struct Frames<'a> {
    job: &'a Job,
    /// Called after each of them.
    done: &'a dyn Fn(),
    /// The first one without its pixels: all are turned as it is, and moved to its black level.
    first: OnceCell<SensorImage>,
}

/// Change of the light from frame to frame of one exposure time, relative, from which it was another light: the variance of frames that are
/// scaled to one level is off by its square, here 4 %. Share of the full scale from which there is light.
const LARGEST_FLICKER: f64 = 0.2;
const LEAST_LIT: f64 = 0.01;

/// A frame as if its black level had been that of another one. What is saturated stays so.
fn at_black_of(mut frame: SensorImage, first: &SensorImage) -> SensorImage {
    let is_same = frame.black_level == first.black_level && frame.black_offsets == first.black_offsets;
    if is_same || frame.black_level <= 0.0 || first.black_level <= 0.0 {
        return frame;
    }
    for value in 0..frame.data.len() {
        if !frame.is_saturated(value) {
            let moved = f64::from(frame.data[value]) + first.black_of(value) - frame.black_of(value);
            frame.data[value] = moved.round().clamp(0.0, f64::from(u16::MAX)) as u16;
        }
    }
    SensorImage { black_level: first.black_level, black_offsets: first.black_offsets.clone(), ..frame }
}

/// Calibrates a camera from its frames, and writes it as an experiment, a page and numbers.
///
/// # Errors
/// A file that can't be read or contradicts itself; frames that lack an exposure time, are of several cameras or gains, or tell no gain; a
/// folder that can't be written; a job that is stopped.
pub fn calibrate(options: &CalibrateOptions, job: &Job) -> Result<CalibratedCamera> {
    let file = CalibrationFile::read(&options.file, job)?;
    let source = ExperimentSource::find(Some(&file.experiment))?;
    let parsed = source.parse(&[])?;
    let study = camera_study(&source, &parsed)?;
    file.check(&study, &options.file)?;
    let stem = options.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let out = options.out.clone().unwrap_or_else(|| format!("fluorspar-out/calibrate-{stem}").into());
    let inputs: Vec<PathBuf> = file.files().chain([&options.file]).chain(&source.file).cloned().collect();
    let folder = OutputFolder::prepare(&out, &inputs, OUT_BYTES)?;
    let (mut answer, gain) = measured(&file, &study, &options.file, job)?;
    job.warn(&answer.warnings);
    let title = if file.title.is_empty() { &stem } else { &file.title };
    let base = source
        .file
        .as_ref()
        .map_or(source.stem.clone(), |file| path_from(&out, file).to_string_lossy().into_owned());
    let head = CameraHead { title, base: &base, folder: folder.path() };
    let text = camera_toml(&head, (&source, &parsed), &study, (&answer.camera, gain), &answer.scales)?;
    let results = CalibrationResults {
        title,
        experiment: &source.name,
        camera: &answer.camera,
        scales: &answer.scales,
        warnings: &answer.warnings,
        files: file.files().count(),
    };
    let page = calibration_report(&results).to_html();
    answer.folder = out;
    let json = serde_json::to_vec_pretty(&answer)?;
    answer.folder = folder.finish_with([
        ("camera.toml".to_owned(), text.into_bytes()),
        ("report.html".to_owned(), page.into_bytes()),
        ("results.json".to_owned(), json),
    ])?;
    job.status(format!("Open {}", answer.folder.join("report.html").display()));
    Ok(answer)
}

/// What the frames tell, without a folder, and their gain.
fn measured(
    file: &CalibrationFile,
    study: &Study,
    path: &Path,
    job: &Job,
) -> Result<(CalibratedCamera, f64)> {
    let share_done = job.listener.begin("Reading frames", "the frames", Left::Nothing);
    let (all, read) = (file.files().count() as f64, Cell::new(0.0));
    let done = || {
        read.set(read.get() + 1.0);
        share_done(read.get() / all);
    };
    let frames = Frames { job, done: &done, first: OnceCell::new() };
    let about = |why: &dyn std::fmt::Display| Error::Input(format!("{}: {why}", path.display()));
    let darks = frames.stacks(&file.dark, true)?;
    let flats = frames.stacks(&file.flat, false)?;
    let camera = calibrate_frames(&darks, &flats).map_err(|problem| about(&problem))?;
    check_channels(study, &camera).map_err(|why| about(&why))?;
    let targets = file.targets.iter().map(|target| frames.recorded(target, study, &camera, &darks[0]));
    let mut targets: Vec<RecordedTarget> = targets.collect::<Result<_>>()?;
    let mut warnings = camera.warnings.clone();
    warnings.extend(targets.iter().filter_map(|target| untold(target, &camera)));
    // Efficiencies are told of all channels or of none
    targets.retain(|target| {
        matches!(target.target, KnownTarget::Tile { .. }) || untold(target, &camera).is_none()
    });
    let scales = CameraScales::of(&targets, camera.gain_dn_per_e);
    warnings.extend(unknown_scale(&scales));
    warnings.extend(unmeasured(study, &scales));
    Ok((CalibratedCamera { folder: PathBuf::new(), camera, scales, warnings }, darks[0].gain))
}

/// Channels of which a target tells nothing.
fn untold(target: &RecordedTarget, camera: &FrameCalibration) -> Option<Warning> {
    let is_told = |name: &String| target.channels.iter().any(|(told, ..)| told == name);
    let names = camera.channels.iter().map(|channel| &channel.channel);
    let missing: Vec<&str> = names.filter(|name| !is_told(name)).map(String::as_str).collect();
    (!missing.is_empty()).then(|| {
        let statement = format!(
            "The target \"{}\" is saturated in {}, and tells nothing of it",
            target.name,
            missing.join(", ")
        );
        Warning::explained(statement, "Take it with a shorter exposure time, or name another region.")
    })
}

/// What only a known radiance would tell.
fn unknown_scale(scales: &CameraScales) -> Option<Warning> {
    let is_absolute = scales.efficiencies.first().is_some_and(|scale| scale.is_absolute);
    (!is_absolute).then(|| {
        let statement =
            "The absolute quantum efficiency is not measured: it takes a source of known radiance";
        Warning::explained(
            statement,
            "Where less was measured than is described, the strongest light counts as described and the sensor as less sensitive; where more, the light as stronger.",
        )
    })
}

/// Captures whose lights no target tells of.
fn unmeasured(study: &Study, scales: &CameraScales) -> Option<Warning> {
    let measured: Vec<&Capture> =
        scales.lights.iter().filter_map(|light| study.capture(&light.capture)).collect();
    let is_open = |capture: &&Capture| {
        let mut on = capture.frame.lights.iter().filter(|(_, drive)| **drive > 0.0);
        on.any(|(group, _)| !measured.iter().any(|other| other.frame.drive(group) > 0.0))
    };
    let open: Vec<&str> = study.captures.iter().filter(is_open).map(|of| of.frame.label.as_str()).collect();
    (!measured.is_empty() && !open.is_empty()).then(|| {
        let statement = format!("The lights of {} are not measured, and stay as described", open.join(", "));
        Warning::explained(statement, "Take a target in that capture.")
    })
}

/// Refuses frames of other channels than those of the experiment's sensor.
fn check_channels(study: &Study, camera: &FrameCalibration) -> Result<(), String> {
    let known = study.camera.sensor.iter().flat_map(|sensor| sensor.mosaic().channels.clone());
    let known: Vec<String> = known.collect();
    match camera.channels.iter().find(|channel| !known.contains(&channel.channel)) {
        Some(other) => Err(format!(
            "the frames have a channel \"{}\", the sensor of the experiment has {}; give the experiment the sensor's mosaic, or describe the \
             frames with theirs",
            other.channel,
            known.join(", ")
        )),
        None => Ok(()),
    }
}

impl Frames<'_> {
    /// A frame under the name of its file.
    fn read(&self, path: &Path) -> Result<SensorImage> {
        if self.job.is_stopped() {
            return Err(Error::Stopped("stopped before all frames were read; nothing was written".into()));
        }
        let image = read_described_frame(path)?.image;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if image.exposure_s <= 0.0 {
            return Err(Error::Input(format!(
                "{}: nothing tells its exposure time; give it with `fluorspar describe {} --exposure-ms MS`",
                path.display(),
                fluorspar::quote::shell_word(&path.to_string_lossy())
            )));
        }
        Ok(SensorImage { label: name, ..image })
    }

    /// Frames by exposure time and gain, each averaged.
    fn stacks(&self, files: &[PathBuf], is_dark: bool) -> Result<Vec<FrameStack>> {
        let mut settings: Vec<Setting> = Vec::new();
        let is_same = |a: f64, b: f64| (a - b).abs() <= 0.01 * a.abs().max(b.abs());
        for file in files {
            let SensorImage { exposure_s, gain, .. } = self.read(file)?;
            let of_it = |s: &&mut Setting| is_same(s.exposure_s, exposure_s) && is_same(s.gain, gain);
            match settings.iter_mut().find(of_it) {
                Some(setting) => setting.files.push(file.clone()),
                None => settings.push(Setting { exposure_s, gain, files: vec![file.clone()] }),
            }
        }
        settings.iter().map(|setting| self.stack(&setting.files, is_dark)).collect()
    }

    fn stack(&self, files: &[PathBuf], is_dark: bool) -> Result<FrameStack> {
        let frames = files.iter().map(|file| {
            let frame = self.read(file)?;
            (self.done)();
            let first = self.first.get_or_init(|| SensorImage { data: Vec::new(), ..frame.clone() });
            Ok::<_, Error>(at_black_of(frame.turned_as(first).0, first))
        });
        let stack = FrameStack::of(frames, is_dark)?;
        let is_lit = stack.level_dn > stack.master.black_level + LEAST_LIT * f64::from(stack.white_level);
        if is_lit && stack.flicker > LARGEST_FLICKER {
            return Err(Error::Input(format!(
                "{} and others of {} s: their light differs by {:.0} %; leave the light alone and vary the exposure time",
                files[0].display(),
                stack.exposure_s(),
                100.0 * stack.flicker
            )));
        }
        Ok(stack)
    }

    /// A target beside what the experiment says of it.
    fn recorded(
        &self,
        target: &Target,
        study: &Study,
        camera: &FrameCalibration,
        dark: &FrameStack,
    ) -> Result<RecordedTarget> {
        let about = |why: String| Error::Input(format!("target \"{}\": {why}", target.name));
        let stacks = self.stacks(&target.files, false)?;
        let [stack] = stacks.as_slice() else {
            return Err(about(
                "its frames have several exposure times or gains; give each a target of its own".into(),
            ));
        };
        let size = |stack: &FrameStack| [stack.master.width, stack.master.height];
        if size(stack) != size(dark) || stack.master.mosaic != dark.master.mosaic {
            return Err(about("its frames differ from the dark frames in size or color filter array".into()));
        }
        if (stack.gain / dark.gain - 1.0).abs() > 0.01 {
            return Err(about(format!(
                "its frames have a gain of {}, the dark frames of {}; take all with one gain (ISO)",
                stack.gain, dark.gain
            )));
        }
        let [width, height] = size(stack);
        let region =
            target.region_px.unwrap_or([width / 3, height / 3, width.div_ceil(3), height.div_ceil(3)]);
        let reaches = |from: usize, side: usize, end: usize| {
            side > 0 && from.checked_add(side).is_some_and(|last| last <= end)
        };
        if !reaches(region[0], region[2], width) || !reaches(region[1], region[3], height) {
            return Err(about(format!(
                "region_px = {region:?} leaves the frame of {width} x {height} pixels; give [column, row, width, height] within it"
            )));
        }
        let capture = study.capture(&target.capture).ok_or_else(|| about("its capture is gone".into()))?;
        let described = target_rates(study, capture, &target.known, target.has_filters).ok_or_else(|| {
            about(format!(
                "no light of the capture \"{}\" reaches the axis in the plane in focus; name a capture whose light_groups are on",
                target.capture
            ))
        })?;
        let names = study.camera.sensor.iter().flat_map(|sensor| sensor.mosaic().channels.clone());
        let described: Vec<(String, f64)> = names.zip(described).collect();
        let rates = camera.channels.iter().zip(camera.rates(stack, region));
        let of = |name: &str| described.iter().find(|(known, _)| known == name).map(|(_, rate)| *rate);
        let channels =
            rates.filter_map(|(channel, rate)| Some((channel.channel.clone(), rate?, of(&channel.channel)?)));
        Ok(RecordedTarget {
            name: target.name.clone(),
            capture: target.capture.clone(),
            target: target.known.clone(),
            uncertainty: target.uncertainty,
            has_filters: target.has_filters,
            channels: channels.collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use fluorspar::image::{Mosaic, Orientation};

    use super::*;

    #[test]
    fn frames_of_another_black_level_move_to_that_of_the_first() {
        let frame = |data: [u16; 2], black_level: f64| SensorImage {
            width: 2,
            height: 1,
            data: data.to_vec(),
            mosaic: Mosaic::default(),
            black_level,
            black_offsets: Vec::new(),
            white_level: 1000,
            white_levels: Vec::new(),
            factors: Vec::new(),
            orientation: Orientation::default(),
            bit_depth: 12,
            exposure_s: 0.01,
            gain: 1.0,
            dn_per_electron: 1.0,
            gain_is_assumed: false,
            read_noise_dn: 0.0,
            seed: 0,
            label: String::new(),
        };
        let moved = at_black_of(frame([64, 1000], 60.0), &frame([0, 0], 64.0));
        assert_eq!((moved.data, moved.black_level), (vec![68, 1000], 64.0));
        // What no file tells is not known to have moved
        assert_eq!(at_black_of(frame([64, 5], 0.0), &frame([0, 0], 64.0)).data, [64, 5]);
    }
}
