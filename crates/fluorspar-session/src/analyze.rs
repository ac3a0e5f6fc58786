//! Chromaticity and porphyrin from raw frames in files.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::analysis::{Analysis, PorphyrinLayers, PorphyrinMap, other_tissue_share};
use fluorspar::image::SensorImage;
use fluorspar::pipeline::{
    AnalyzedFrame, AnalyzedRegion, BitFit, Calibration, CapturedFrame, IncompleteRaw, PipelineError,
    RawExposures, SeenComponents, analyze_regions, analyze_seen, bracket_label, complete_raw, develop_frames,
    subtract_what_is_given, turned_alike,
};
use fluorspar::quote::shell_word;
use fluorspar::study::{AnalysisPlan, Capture, RegionPlan, Study};
use fluorspar::units::number_text;
use fluorspar_experiment::{
    CachedAnalysis, Experiment, ResolvedExperiment, Warning, cached_analysis, resolve, setting_differences,
};
use fluorspar_format::{
    DescribedFrame, FrameFact, OutputFolder, black_level_doubt, read_described_frame, read_sensor_image,
    write_atomically, write_map_npy,
};
use fluorspar_report::figures::porphyrin_maps;
use fluorspar_report::{FrameOrigin, analysis_json};
use rayon::prelude::*;
use serde::ser::Error as _;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::Value;

use crate::frame_report::{FrameReport, warn_of_darkness};
use crate::photographs::{AnalyzedPhotographs, analyze_photographs, is_of_photographs};
use crate::region_option::{RegionOption, region_options, with_regions};
use crate::values::{Override, as_typed, quoted};
use crate::{
    CaptureView, Changes, Error, ExperimentSource, FinishedRender, Job, Result, ShownExperiment, Wanted,
    read_text,
};

/// Which frames are analyzed, by which experiment.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct AnalyzeOptions {
    /// Folder with raw_NAME.tiff (or .png, .dng, .raw) and experiment.toml, as `run` and `capture` write it; or, with --experiment, a
    /// folder of photographs, or a table of them (photographs.csv).
    #[arg(value_name = "FOLDER", value_hint = ValueHint::AnyPath, required_unless_present = "frame")]
    pub folder: Option<PathBuf>,
    /// Raw frame of a capture, of a simulated or a real camera (DNG, or TIFF or PNG with its description); needs --experiment. May be
    /// repeated: one for the frame that is analyzed and one for each that is subtracted.
    #[arg(long, value_name = "CAPTURE=FILE", requires = "experiment")]
    pub frame: Vec<String>,
    /// Raw dark frame of the real camera; frames of one exposure are averaged. Of photographs it serves those without one. May be repeated.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, requires = "experiment")]
    pub dark: Vec<PathBuf>,
    /// Raw frame of even light of the real camera. May be repeated.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, requires = "experiment")]
    pub flat: Vec<PathBuf>,
    /// Experiment to use instead of the folder's experiment.toml.
    #[arg(long, value_name = "EXPERIMENT")]
    pub experiment: Option<String>,
    /// Component image that tells which part a pixel shows [default: components.exr of the folder]. Needed for regions
    /// by part name.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub component_image: Option<PathBuf>,
    /// Another region of the frame, by the name NAME, beside that of [analysis]: parts (lip=lower_lip,upper_lip), a rectangle
    /// (lip=COLUMN,ROW,WIDTH,HEIGHT), a polygon (lip=[[X,Y],[X,Y],[X,Y]]), a mask (lip=mask.png), or fields of [analysis]
    /// (lip={parts=["lower_lip"], inset_px=3}). May be repeated.
    #[arg(long, value_name = "NAME=WHERE")]
    pub named_region: Vec<String>,
    /// Folder for report.html, maps of the porphyrin share of each pixel on the mixture line, its interval and its detection limit (NumPy and PNG) and
    /// results.json; of photographs for report.html and patients.csv [default: fluorspar-out/analyze-FOLDER].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
}

/// What was analyzed.
#[derive(Serialize)]
#[serde(untagged)]
pub enum Analyzed {
    /// The frames of one photograph or one run.
    Frames(Box<AnalyzedFrames>),
    /// Many photographs.
    Photographs(AnalyzedPhotographs),
}

/// Frames and their analysis.
#[derive(Clone, Debug)]
pub struct AnalyzedFrames {
    /// The experiment by which they were analyzed.
    pub experiment: ResolvedExperiment,
    /// The region of the analysis.
    pub analysis: Analysis,
    /// The regions beside it.
    pub regions: Vec<AnalyzedRegion>,
}

impl Serialize for AnalyzedFrames {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let json = analysis_json(&self.analysis, self.regions.iter().map(AnalyzedRegion::analysis));
        json.map_err(S::Error::custom)?.serialize(serializer)
    }
}

/// Maps and results, at most.
const OUT_BYTES: u64 = 1 << 30;

/// Refuses what is not a folder of frames with their experiment.
fn check_folder(options: &AnalyzeOptions) -> Result<()> {
    if options.frame.is_empty() && !(options.dark.is_empty() && options.flat.is_empty()) {
        return Err(Error::Input(
            "⟨dark⟩ and ⟨flat⟩ belong to frames of a camera; name these with ⟨frame⟩, or give a folder of photographs".into(),
        ));
    }
    if let Some(folder) = options.folder.as_ref().filter(|folder| !folder.exists()) {
        return Err(Error::Input(format!(
            "{}: there is no such folder; give one that `run` or `capture` wrote, one of photographs, or name frames with ⟨frame⟩",
            folder.display()
        )));
    }
    if let Some(folder) = options.folder.as_ref().filter(|folder| !folder.is_dir()) {
        return Err(Error::Input(format!(
            "{}: not a folder; give one that `run` or `capture` wrote, or name frames with ⟨frame⟩",
            folder.display()
        )));
    }
    let has_experiment = |folder: &&PathBuf| folder.join("experiment.toml").exists();
    if let (None, Some(folder)) = (&options.experiment, options.folder.as_ref())
        && !has_experiment(&folder)
    {
        return Err(Error::Input(format!(
            "{}: this folder has no experiment.toml; give a folder that `run` or `capture` wrote, or an experiment with \
             ⟨experiment⟩",
            folder.display()
        )));
    }
    Ok(())
}

/// Refuses changes of what frames were taken of and with, which they do not follow.
fn check_taken(taken: &Experiment, now: &Experiment) -> Result<()> {
    const FREE: [&str; 7] =
        ["analysis", "develop", "safety", "target", "spectroradiometer", "output", "files"];
    let is_free = |path: &str| {
        FREE.iter().any(|section| path.split('.').next() == Some(section))
            || path.starts_with("capture.") && path.ends_with(".subtract")
            || path == "render.time_limit_s"
    };
    match setting_differences(taken, now).into_iter().find(|difference| !is_free(&difference.path)) {
        None => Ok(()),
        Some(difference) => Err(Error::Input(format!(
            "{} is what these frames were taken with, and they stay as they are. Take others: fluorspar capture COMPONENTS --report ⟨set⟩ \
             {}=...; or analyze them as those of another camera: ⟨experiment⟩",
            difference.path, difference.path
        ))),
    }
}

/// Analyzes frames, and writes a report and maps into the folder of the options.
///
/// # Errors
/// An option without a meaning, frames or an experiment that can't be read, an analysis that can't be done, a folder that can't be written.
pub fn analyze(options: &AnalyzeOptions, job: &Job) -> Result<Analyzed> {
    if let Some(folder) = options.folder.as_deref().filter(|folder| is_of_photographs(folder)) {
        return Ok(Analyzed::Photographs(analyze_photographs(options, folder, job)?));
    }
    check_folder(options)?;
    let regions = region_options(&options.named_region)?;
    let see = |_: &Study, _: &[CapturedFrame], _: &[(&str, &AnalyzedFrame)]| Ok(());
    let frames = analyze_frames(options, &Regions { main: None, beside: &regions }, job, see)?;
    warn_of_unused_frames(options, &frames.experiment.study, &frames.analysis, job);
    Ok(Analyzed::Frames(Box::new(frames)))
}

/// Where the regions of frames lie.
pub(crate) struct Regions<'a> {
    /// In place of the region of `[analysis]`: the first of those beside it.
    pub(crate) main: Option<&'a RegionOption>,
    /// Beside it.
    pub(crate) beside: &'a [RegionOption],
}

/// Analyzes frames of one photograph or one run; `see` has the frames and the regions in view before they are dropped.
pub(crate) fn analyze_frames(
    options: &AnalyzeOptions,
    regions: &Regions<'_>,
    job: &Job,
    see: impl FnOnce(&Study, &[CapturedFrame], &[(&str, &AnalyzedFrame)]) -> Result<()>,
) -> Result<AnalyzedFrames> {
    let beside = |name: &str| options.folder.as_ref().map(|folder| folder.join(name));
    let default = beside("experiment.toml").map(|path| path.display().to_string());
    let name = options.experiment.clone().or(default).unwrap_or_default();
    let source = ExperimentSource::find(Some(&name))?;
    let (plain, overrides) = parsed_for_frames(options, &source)?;
    if options.experiment.is_none() && options.frame.is_empty() {
        check_taken(&source.parse(&[])?, &plain)?;
    }
    let (parsed, overrides) = with_regions(&source, (&plain, &overrides), regions)?;
    let image = options
        .component_image
        .clone()
        .or_else(|| beside("components.exr").filter(|p| p.is_file()))
        .or_else(|| options.folder.as_ref().and_then(|folder| captured_from(folder)));
    // Frames and channel planes come while materials are resolved, unless what the analysis asks of these was kept
    let frames_at = options.folder.as_ref().filter(|_| options.frame.is_empty());
    let is_alone = options.out.is_none();
    let kept = frames_at.filter(|_| is_alone && image.is_some()).and_then(|_| cached_analysis(&parsed));
    let (resolved, (opened, seen)) = rayon::join(
        || kept.is_none().then(|| resolve(&parsed)),
        || {
            let opened = image.as_ref().map(|path| FinishedRender::open(path));
            let seen = match (&opened, frames_at) {
                (Some(Ok(image)), Some(folder)) => seen_early(&plain, folder, image, kept.as_ref()),
                _ => None,
            };
            (opened, seen)
        },
    );
    if let (Some(kept), Some(seen), Some(Ok(image))) = (kept, &seen, &opened)
        && let Some((experiment, analysis, regions)) = analyzed_without_surfaces(kept, seen, image)
    {
        warn_of_darkness(&experiment, &seen.frames, job);
        return Ok(AnalyzedFrames { experiment, analysis, regions });
    }
    let mut experiment =
        resolved.unwrap_or_else(|| resolve(&parsed)).map_err(|error| as_typed(error, &overrides))?;
    as_recorded(options, image.is_none(), &mut experiment, job);
    let study = &experiment.study;
    let Some(settings) = &study.analysis else {
        return Err(Error::Input(format!("{name}: the experiment has no [analysis] section; add one")));
    };
    let (Developed { frames, told }, view) =
        match seen.filter(|seen| seen.captures.len() == study.captures.len()) {
            Some(seen) => (Developed { frames: seen.frames, told: Vec::new() }, Some(seen.view)),
            None => (developed(options, study, &settings.frame, job)?, None),
        };
    if image.is_none() {
        check_pixels_known(&name, study)?;
    }
    let image = opened.transpose()?;
    let inputs = inputs(options);
    let out = options.out.as_ref().map(|out| OutputFolder::prepare(out, &inputs, OUT_BYTES)).transpose()?;
    let all = |components: Option<&_>| analyze_all(study, components, &frames, regions.main.is_some());
    let (main, others) = match &image {
        None => all(None)?,
        Some(image) => {
            let view = match view {
                Some(view) => view,
                None => {
                    let changes = image.changes(&parsed, &experiment, false)?;
                    image.seen_by(study, &study.captures, changes, Wanted::Lit)?
                }
            };
            let components = view.components(image);
            all(Some(&components))?
        }
    };
    let Some(analyzed) = main else {
        return Err(Error::Failed("the analysis gave nothing".into()));
    };
    let analyzed = without_render(options, analyzed, &frames);
    let of_frames = |region: AnalyzedRegion| AnalyzedRegion {
        analyzed: region.analyzed.map(|analyzed| without_render(options, analyzed, &frames)),
        ..region
    };
    let others: Vec<AnalyzedRegion> = others.into_iter().map(of_frames).collect();
    let in_view = others.iter().filter_map(|other| Some((other.name.as_str(), other.in_view()?)));
    see(study, &frames, &std::iter::once(("", &analyzed)).chain(in_view).collect::<Vec<_>>())?;
    warn_of_darkness(&experiment, &frames, job);
    let found = |experiment, analyzed: AnalyzedFrame, regions| AnalyzedFrames {
        experiment,
        analysis: analyzed.analysis,
        regions,
    };
    let Some(out) = out else { return Ok(found(experiment, analyzed, others)) };
    let report = FrameReport {
        live: None,
        experiment: &experiment,
        experiment_text: &source.text,
        frames,
        analysis: Some(analyzed.clone()),
        regions: others.clone(),
        components: None,
        frames_from: if options.frame.is_empty() { FrameOrigin::Simulated } else { FrameOrigin::Given },
        described_frames: told,
        raw_ending: None,
    };
    report.write(out.path()).map_err(|error| error.at_its_place(&out))?;
    let place = write_maps(options, out, &analyzed, &others)?;
    job.status(format!("Open {}", place.join("report.html").display()));
    Ok(found(experiment, analyzed, others))
}

/// The region of `[analysis]` and those beside it, the first of which may stand for it.
fn analyze_all(
    study: &Study,
    components: Option<&SeenComponents<'_>>,
    frames: &[CapturedFrame],
    is_first: bool,
) -> Result<(Option<AnalyzedFrame>, Vec<AnalyzedRegion>)> {
    let others = analyze_regions(study, components, frames)?;
    let main = match others.first().filter(|_| is_first).and_then(AnalyzedRegion::in_view) {
        Some(first) => Some(first.clone()),
        None => analyze_seen(study, components, frames)?,
    };
    Ok((main, others))
}

/// Refuses parts as regions of frames alone.
fn check_pixels_known(name: &str, study: &Study) -> Result<()> {
    let plans = study.analysis.iter().map(|plan| (String::new(), "analysis".to_owned(), plan));
    let of_region = |region: &RegionPlan| format!("analysis.region.{}", quoted(&region.name));
    let of_regions = study
        .regions
        .iter()
        .map(|region| (format!(" \"{}\"", region.name), of_region(region), &region.analysis));
    let named = |(called, path, plan): (String, String, &AnalysisPlan)| {
        Some((called, path, plan.parts.first()?.clone()))
    };
    let Some((called, path, part)) = plans.chain(of_regions).find_map(named) else { return Ok(()) };
    Err(Error::Input(format!(
        "{name}: the region{called} is the part \"{part}\", but its pixels are known only from the component image; give that of \
         the run with ⟨component_image⟩, or say where it lies: ⟨set={path}.mask=MASK.png⟩, \
         {path}.polygon_px=[[X,Y],[X,Y],[X,Y]] or {path}.rectangle_px=[COLUMN,ROW,WIDTH,HEIGHT]"
    )))
}

/// The experiment with all changes: those that real frames make of its sensor, and those of the command line.
pub(crate) fn parsed_for_frames(
    options: &AnalyzeOptions,
    source: &ExperimentSource,
) -> Result<(Experiment, Vec<Override>)> {
    let mut overrides: Vec<Override> =
        sensor_of_frames(options)?.into_iter().chain(options.changes.overrides()).collect();
    let mut parsed = source.parse(&overrides)?;
    let readout = readout_of_frames(options, &parsed)?;
    if !readout.is_empty() {
        overrides.splice(0..0, readout);
        parsed = source.parse(&overrides)?;
    }
    Ok((parsed, overrides))
}

/// Files and folders that are read.
fn inputs(options: &AnalyzeOptions) -> Vec<PathBuf> {
    let named = named_files(options).map(|(_, file)| PathBuf::from(file));
    let given =
        options.folder.iter().chain(&options.component_image).chain(&options.dark).chain(&options.flat);
    given.cloned().chain(named).collect()
}

/// The size of a real camera's frames, as changes of the experiment's sensor: what it knows of pixels counts for frames of any size.
fn sensor_of_frames(options: &AnalyzeOptions) -> Result<Vec<Override>> {
    let Some(first) = options.frame.first() else { return Ok(Vec::new()) };
    let (_, file) = named_frame(first)?;
    let image = read_sensor_image(Path::new(file))?.image;
    let side = |path: &str, value: usize| Override::of_option(path, value, format!("⟨frame={first}⟩"));
    let mut sides = vec![side("sensor.columns", image.width), side("sensor.rows", image.height)];
    if options.component_image.is_none() {
        // Nothing is rendered, and a render would show what the frame shows
        const WIDTH: usize = 320;
        let height = (WIDTH as f64 * image.height as f64 / image.width as f64).round().clamp(1.0, 16_384.0);
        sides.extend([side("render.width_px", WIDTH), side("render.height_px", height as usize)]);
    }
    Ok(sides)
}

/// Mosaic and black level of a real camera's frames, as changes of the experiment's sensor, whose own are those of another camera.
fn readout_of_frames(options: &AnalyzeOptions, parsed: &Experiment) -> Result<Vec<Override>> {
    let Some((_, file)) = named_files(options).next().filter(|(_, file)| !file.is_empty()) else {
        return Ok(Vec::new());
    };
    let raw = read_sensor_image(Path::new(file))?.image;
    if raw.black_level < 0.0 {
        return Err(Error::Input(format!(
            "{file}: its black level, {} DN, is below zero; describe the frame with ⟨black_level⟩, the mean of a frame with the cap on the \
             lens",
            raw.black_level
        )));
    }
    let model = parsed.file.sensor.as_ref().map(|section| section.model.clone()).unwrap_or_default();
    let typed = || format!("⟨frame={}⟩", options.frame[0]);
    let mut found = Vec::new();
    let mosaic = &raw.mosaic;
    let name = |channel: &u8| mosaic.channels.get(usize::from(*channel)).map_or("", String::as_str);
    let rows: Vec<Vec<&str>> =
        mosaic.pattern.chunks(mosaic.cols.max(1)).map(|row| row.iter().map(name).collect()).collect();
    let is_of_its_channels = |name: &&str| model.mosaic.iter().flatten().any(|own| own == name);
    if mosaic.is_bayer() && rows.iter().flatten().all(is_of_its_channels) {
        found.push(Override::of_option("sensor.mosaic", format!("{rows:?}"), typed()));
    }
    let (bits, black) = match &model.emva1288 {
        Some(sheet) => (sheet.bit_depth, "sensor.emva1288.black_level_dn"),
        None => (model.bit_depth, "sensor.black_level_dn"),
    };
    // Of a converter of other bits it is no level of this sensor
    if raw.bit_depth == bits {
        found.push(Override::of_option(black, number_text(raw.black_level), typed()));
    }
    Ok(found)
}

/// A frame of a camera is analyzed without one that its experiment subtracts, where that is not given; the user is told.
fn warn_of_missing_frames(options: &AnalyzeOptions, experiment: &mut ResolvedExperiment, job: &Job) {
    let is_given = |label: &str| named_files(options).any(|(name, _)| name == label);
    for (label, missing) in subtract_what_is_given(&mut experiment.study, is_given) {
        let text = format!(
            "Nothing is subtracted from \"{label}\" but the black level: the experiment subtracts \"{missing}\", which is not given. Room \
             light counts as light of the region; give the frame \"{missing}\", too"
        );
        job.warn(&[format!("{text}: ⟨frame={missing}=FILE⟩").into()]);
        experiment.record.warnings.push(Warning::from(text));
    }
}

/// Tells of frames that were given and that no analysis looks at. Where channels are taken apart or targets are sought, all frames with
/// light count.
fn warn_of_unused_frames(options: &AnalyzeOptions, study: &Study, analysis: &Analysis, job: &Job) {
    if analysis.signals.is_some() || !analysis.targets.is_empty() {
        return;
    }
    let plans: Vec<&AnalysisPlan> =
        study.analysis.iter().chain(study.regions.iter().map(|region| &region.analysis)).collect();
    let used = looked_at(study, &plans);
    let is_used = |label: &str| {
        let of_it =
            |name: &str| label == name || label.strip_prefix(name).is_some_and(|r| r.starts_with("_ev"));
        used.iter().any(|capture| of_it(&capture.frame.label))
    };
    let unused = named_files(options).filter(|(label, _)| !is_used(label));
    let texts: Vec<Warning> = unused
        .map(|(label, _)| {
            let frame = &analysis.frame;
            Warning::from(format!(
                "The frame \"{label}\" has no part in the analysis, which is of \"{frame}\""
            ))
        })
        .collect();
    job.warn(&texts);
}

/// Shares of the pixels of a frame that is subtracted which may be defect and full, and with which it is taken at all.
const FEW_SATURATED: [f64; 2] = [0.01, 0.5];

/// Tells of a frame that is subtracted where it is full: nothing is measured there.
///
/// # Errors
/// One that is full in most places.
fn check_subtracted(study: &Study, file: &str, raw: &SensorImage, job: &Job) -> Result<()> {
    let is_subtracted = study.captures.iter().any(|c| c.subtract.as_ref() == Some(&raw.label));
    let full = (0..raw.data.len()).filter(|value| raw.is_saturated(*value)).count();
    let share = full as f64 / raw.data.len().max(1) as f64;
    let (label, percent) = (&raw.label, 100.0 * share);
    if is_subtracted && share > FEW_SATURATED[1] {
        return Err(Error::Input(format!(
            "{file}: the frame \"{label}\", which is subtracted, is itself saturated in {percent:.0} % of its pixels; take it in less room \
             light, or all frames with a shorter exposure"
        )));
    }
    if is_subtracted && share > FEW_SATURATED[0] {
        let text = format!(
            "The frame \"{label}\", which is subtracted, is itself saturated in {percent:.0} % of its pixels: nothing is measured there"
        );
        job.warn(&[Warning::from(text)]);
    }
    Ok(())
}

/// Makes an experiment that of the frames that were given, or of frames whose component image is gone.
pub(crate) fn as_recorded(
    options: &AnalyzeOptions,
    is_without_image: bool,
    experiment: &mut ResolvedExperiment,
    job: &Job,
) {
    if is_without_image {
        leave_parts_to_shapes(&mut experiment.study);
    }
    warn_of_missing_frames(options, experiment, job);
    if !options.frame.is_empty() {
        // The size of the frames, and where the region lies, make no other experiment
        let title = &experiment.record.title;
        let title = title.strip_suffix(", changed").unwrap_or(title);
        let files: Vec<String> = named_files(options).map(|(_, file)| file_name(file)).collect();
        experiment.record.title = format!("{}, analyzed as by \"{title}\"", files.join(", "));
    }
}

/// The label and the file of a frame.
fn named_frame(text: &str) -> Result<(&str, &str)> {
    let named = text.split_once('=').filter(|(label, file)| !label.is_empty() && !file.is_empty());
    named.ok_or_else(|| {
        Error::Input(format!(
            "⟨frame={text}⟩: write the name of a capture and a file, for instance ⟨frame=blue=IMG_0001.dng⟩"
        ))
    })
}

/// Labels and files of the frames that were named, as far as they are pairs.
fn named_files(options: &AnalyzeOptions) -> impl Iterator<Item = (&str, &str)> {
    options.frame.iter().filter_map(|text| text.split_once('='))
}

/// The last part of a path.
fn file_name(path: &str) -> String {
    Path::new(path).file_name().map_or_else(|| path.to_owned(), |name| name.to_string_lossy().into_owned())
}

/// Without a component image no part is found in a frame. Where a shape tells where the region lies, its parts only tell what it shows.
fn leave_parts_to_shapes(study: &mut Study) {
    let of_regions = study.regions.iter_mut().map(|region| &mut region.analysis);
    for plan in study.analysis.iter_mut().chain(of_regions) {
        if plan.rectangle_px.is_some() || plan.polygon.is_some() || plan.mask.is_some() {
            plan.parts.clear();
            plan.inset_px = 0;
        }
    }
}

/// Frames of another origin may show another mouth than the component image, whose truth is none of theirs, and what their regions hold
/// is known from their colors alone.
fn without_render(
    options: &AnalyzeOptions,
    mut analyzed: AnalyzedFrame,
    frames: &[CapturedFrame],
) -> AnalyzedFrame {
    if options.frame.is_empty() {
        return analyzed;
    }
    let analysis = &mut analyzed.analysis;
    (analysis.truth, analysis.budget) = (None, None);
    let frame = frames.iter().find(|frame| frame.raw.label == analysis.frame);
    if let Some(share) = frame.and_then(|frame| other_tissue_share(&frame.developed, &analyzed.region)) {
        analysis.warnings.push(Warning::explained(
            format!("{:.0} % of the region looks like another tissue than the rest", 100.0 * share),
            "An estimate is of one tissue: draw the region within it, tongue without throat, lip without skin",
        ));
    }
    analyzed
}

/// The component image that the frames of a folder were captured from, as `capture` wrote it down; none where it is gone.
fn captured_from(folder: &Path) -> Option<PathBuf> {
    let text = read_text(&folder.join("results.json")).ok()?;
    let results: Value = serde_json::from_str(&text).ok()?;
    let path = PathBuf::from(results.get("components_file")?.as_str()?);
    path.is_file().then_some(path)
}

/// Frames that were developed, and what the image shows of them, without surfaces.
struct Early {
    experiment: ResolvedExperiment,
    /// Captures of the frames.
    captures: Vec<Capture>,
    frames: Vec<CapturedFrame>,
    view: CaptureView,
}

/// Frames of a folder and what the image shows of them, where neither needs surfaces: those that a kept analysis looks at, otherwise
/// all. `None` where they do, or where something is wrong, of which the usual way tells.
fn seen_early(
    parsed: &Experiment,
    folder: &Path,
    image: &FinishedRender,
    kept: Option<&CachedAnalysis>,
) -> Option<Early> {
    let ShownExperiment { experiment, changes } = image.shown_without_surfaces(parsed).ok()??;
    let study = &experiment.study;
    let captures = match kept {
        Some(kept) => looked_at(study, &kept.plans().collect::<Vec<_>>()),
        None => study.captures.clone(),
    };
    let frames = || {
        let exposures = frames_of_folder(study, &captures, folder).ok()?;
        let calibration = Calibration::of_study(study, exposures.iter().flat_map(RawExposures::all)).ok()?;
        develop_frames(study, exposures, &calibration).ok()
    };
    let (frames, view) = rayon::join(frames, || image.seen_by(study, &captures, changes, Wanted::Lit).ok());
    let (frames, view) = frames.zip(view)?;
    Some(Early { experiment, captures, frames, view })
}

/// The captures that analyses look at, with those that are subtracted from them. All where it compares spots, and where frames are
/// calibrated, which takes the longest of all exposures.
pub(crate) fn looked_at(study: &Study, plans: &[&AnalysisPlan]) -> Vec<Capture> {
    let develop = &study.develop;
    if plans.iter().any(|plan| plan.compared.is_some())
        || develop.dark_frames > 0
        || develop.flat_field.is_some()
    {
        return study.captures.clone();
    }
    let is_named =
        |label: &String| plans.iter().any(|plan| *label == plan.frame || plan.further_frames.contains(label));
    let subtracted: Vec<&String> = study
        .captures
        .iter()
        .filter(|c| is_named(&c.frame.label))
        .filter_map(|c| c.subtract.as_ref())
        .collect();
    let wanted = |c: &&Capture| is_named(&c.frame.label) || subtracted.contains(&&c.frame.label);
    study.captures.iter().filter(wanted).cloned().collect()
}

/// The analysis with what was kept of it. `None` where it has no estimate from a family of tissues, which nothing was kept for, or fails:
/// the usual way tells of that.
fn analyzed_without_surfaces(
    kept: CachedAnalysis,
    seen: &Early,
    image: &FinishedRender,
) -> Option<(ResolvedExperiment, Analysis, Vec<AnalyzedRegion>)> {
    let ResolvedExperiment { study, record } = seen.experiment.clone();
    let study = kept.complete(study);
    let components = seen.view.components(image);
    let analysis = analyze_seen(&study, Some(&components), &seen.frames).ok()??.analysis;
    analysis.posterior.as_ref()?;
    let regions = analyze_regions(&study, Some(&components), &seen.frames).ok()?;
    Some((ResolvedExperiment { study, record }, analysis, regions))
}

/// What frames are, by file.
type DescribedFiles = Vec<(String, Vec<FrameFact>)>;

/// Frames, and what those are that were given.
pub(crate) struct Developed {
    pub(crate) frames: Vec<CapturedFrame>,
    told: DescribedFiles,
}

/// The frames that are analyzed, developed with what calibrates them.
pub(crate) fn developed(
    options: &AnalyzeOptions,
    study: &Study,
    wanted: &str,
    job: &Job,
) -> Result<Developed> {
    if options.frame.is_empty() {
        let Some(folder) = &options.folder else {
            return Err(Error::Input("give a folder, or frames with ⟨frame=CAPTURE=FILE⟩".into()));
        };
        return Ok(Developed { frames: developed_folder(study, folder)?, told: Vec::new() });
    }
    let (mut exposures, told) = named_frames(options, study, wanted, job)?;
    let turned: Vec<Warning> = turned_alike(&mut exposures).into_iter().map(Warning::from).collect();
    job.warn(&turned);
    let read = |paths: &[PathBuf]| -> Result<Vec<SensorImage>> {
        let turned = |raw: DescribedFrame| match exposures.first() {
            Some(first) => raw.image.turned_as(&first.raw).0,
            None => raw.image,
        };
        paths.iter().map(|path| Ok(turned(read_raw(study, path, None)?))).collect()
    };
    let develop = &study.develop;
    let (dark, flat) = (read(&options.dark)?, read(&options.flat)?);
    let cut: Vec<Warning> = options.dark.iter().zip(&dark).filter_map(cut_at_zero).collect();
    job.warn(&cut);
    let calibration = Calibration::of_frames(develop.demosaicing, dark, flat, develop.bad_pixel_sigma)?;
    let frames = develop_frames(study, exposures, &calibration)?;
    let all = frames.iter().flat_map(|frame| std::iter::once(&frame.raw).chain(&frame.bracket));
    let remarks: Vec<Warning> =
        calibration.remarks(all).map_err(PipelineError::from)?.into_iter().map(Warning::from).collect();
    job.warn(&remarks);
    Ok(Developed { frames, told })
}

/// What is said of a dark frame whose noise is cut at 0.
fn cut_at_zero((file, dark): (&PathBuf, &SensorImage)) -> Option<Warning> {
    /// Share of the values from which they are no few.
    const NO_FEW: f64 = 0.01;
    let share = |is: fn(&u16) -> bool| {
        dark.data.iter().filter(|dn| is(dn)).count() as f64 / dark.data.len().max(1) as f64
    };
    let zero = share(|dn| *dn == 0);
    // Noise within a step of the converter has no half that is cut
    (zero > NO_FEW && share(|dn| *dn > 1) > NO_FEW).then(|| {
        let statement = format!(
            "{}: {:.0} % of its values are 0, which cuts its noise: the dark level comes out too high, light too low",
            file.display(),
            100.0 * zero
        );
        Warning::explained(statement, "Raise the black level (offset) of the camera, or take raw frames.")
    })
}

/// The frames of a folder that `run` or `capture` wrote, developed with what calibrates them.
pub(crate) fn developed_folder(study: &Study, folder: &Path) -> Result<Vec<CapturedFrame>> {
    let exposures = frames_of_folder(study, &study.captures, folder)?;
    let calibration = Calibration::of_study(study, exposures.iter().flat_map(RawExposures::all))?;
    Ok(develop_frames(study, exposures, &calibration)?)
}

/// Writes the numbers of the region and its maps.
fn write_maps(
    options: &AnalyzeOptions,
    out: OutputFolder,
    analyzed: &AnalyzedFrame,
    regions: &[AnalyzedRegion],
) -> Result<PathBuf> {
    let mut results = analysis_json(&analyzed.analysis, regions.iter().map(AnalyzedRegion::analysis))?;
    if !options.frame.is_empty() {
        let files = named_files(options).map(|(label, file)| (label.to_owned(), file.into()));
        results["recorded_frames"] = Value::Object(files.collect());
    }
    let mut files = vec![("results.json".to_owned(), serde_json::to_vec_pretty(&results)?)];
    if let Some(porphyrin) = &analyzed.porphyrin {
        for (stem, figure) in porphyrin_maps(porphyrin, &analyzed.analysis.analyte, None) {
            files.push((format!("{stem}.png"), figure.to_png()?));
        }
        write_layers(&out, porphyrin)?;
    }
    for (name, bytes) in files {
        write_atomically(&out.path().join(name), |file| file.write_all(&bytes))
            .map_err(|error| out.at_its_place(error))?;
    }
    Ok(out.finish()?)
}

/// Writes the numbers of the map, each kind as an array.
fn write_layers(out: &OutputFolder, porphyrin: &PorphyrinMap) -> Result<()> {
    let PorphyrinLayers { share, low, high, detection_limit } = porphyrin.layers();
    for (name, values) in [("share", share), ("low", low), ("high", high), ("limit", detection_limit)] {
        let path = out.path().join(format!("porphyrin_{name}.npy"));
        write_map_npy(&path, &[porphyrin.height, porphyrin.width], &values)
            .map_err(|error| out.at_its_place(error))?;
    }
    Ok(())
}

/// The raw frame in a file under the name of a capture. What a real camera does not tell of its conversion gain and noise, the
/// sensor of the experiment does.
pub(crate) fn read_raw(study: &Study, path: &Path, label: Option<&str>) -> Result<DescribedFrame> {
    let mut told = read_described_frame(path)?;
    let raw = &mut told.image;
    if let Some(label) = label {
        raw.label = label.into();
    }
    complete_raw(study, raw).map_err(|lack| {
        Error::Input(format!("{}: {lack}{}", path.display(), remedy(&lack, path, raw.exposure_s)))
    })?;
    Ok(told)
}

/// How a frame is described so that it lacks nothing.
fn remedy(lack: &IncompleteRaw, path: &Path, exposure_s: f64) -> String {
    let describe = format!("fluorspar describe {}", shell_word(&path.to_string_lossy()));
    match lack {
        IncompleteRaw::NoExposure => format!("; give it with `{describe} --exposure-ms MS`"),
        IncompleteRaw::OtherBits { of_frame, of_sensor, fit } => {
            let further = fit.map(|fit| match fit {
                BitFit::AsTheyAre => String::new(),
                BitFit::WhiteLevel(level) => format!(" --white-level {level}"),
                BitFit::LeftAligned => " --left-aligned".into(),
            });
            let ms = (1e9 * exposure_s).round() / 1e6;
            let again = further.map(|further| {
                format!(
                    "Where the frame holds numbers of {of_sensor} bits: `{describe} --bit-depth {of_sensor}{further} --exposure-ms {ms} \
                     --replace`, and what else was given. "
                )
            });
            format!(
                ". {}Where the sensor has {of_frame} bits: ⟨set=sensor.bit_depth={of_frame}⟩. Or describe the frame with ⟨dn_per_electron⟩",
                again.unwrap_or_default()
            )
        }
        _ => String::new(),
    }
}

fn frames_of_folder(study: &Study, captures: &[Capture], folder: &Path) -> Result<Vec<RawExposures>> {
    let find = |label: &str| -> Result<SensorImage> {
        let candidates =
            ["tiff", "tif", "png", "dng", "raw"].map(|ending| folder.join(format!("raw_{label}.{ending}")));
        match candidates.iter().find(|path| path.is_file()) {
            Some(path) => Ok(read_raw(study, path, Some(label))?.image),
            None => Err(Error::Input(format!(
                "{}: there is no raw_{label}.tiff for the capture \"{label}\"",
                folder.display()
            ))),
        }
    };
    let all = |c: &Capture| {
        let label = &c.frame.label;
        let bracket = (0..c.bracket_ev.len()).map(|index| find(&bracket_label(label, &c.bracket_ev, index)));
        Ok(RawExposures { raw: find(label)?, bracket: bracket.collect::<Result<_>>()? })
    };
    // Of several errors that of the first capture is told, whichever thread is first
    let found: Vec<Result<RawExposures>> = captures.par_iter().map(all).collect();
    found.into_iter().collect()
}

/// The frames that were named, and what each file is.
fn named_frames(
    options: &AnalyzeOptions,
    study: &Study,
    wanted: &str,
    job: &Job,
) -> Result<(Vec<RawExposures>, DescribedFiles)> {
    let known: Vec<&str> = study.captures.iter().map(|c| c.frame.label.as_str()).collect();
    let mut frames: Vec<RawExposures> = Vec::new();
    let mut told = Vec::new();
    for text in &options.frame {
        let (label, file) = named_frame(text)?;
        // Exposures of a bracket bear the name of their capture.
        let capture = known
            .iter()
            .find(|name| **name == label || label.strip_prefix(**name).is_some_and(|r| r.starts_with("_ev")));
        let Some(capture) = capture else {
            return Err(Error::Input(format!(
                "⟨frame={text}⟩: the experiment has no capture \"{label}\"; its captures are {}",
                known.join(", ")
            )));
        };
        let DescribedFrame { image: raw, facts } = read_raw(study, Path::new(file), Some(label))?;
        // Dark frames take the place of a black level
        let counts = |fact: &&FrameFact| options.dark.is_empty() || fact.key != "black level";
        let doubtful = facts.iter().filter(|fact| fact.is_doubtful).filter(counts);
        let doubts: Vec<Warning> =
            doubtful.map(|fact| Warning::from(format!("{file}: {}", fact.sentence()))).collect();
        job.warn(&doubts);
        check_subtracted(study, file, &raw, job)?;
        told.push((file_name(file), facts));
        if options.dark.is_empty()
            && let Some(doubt) = black_level_doubt(&raw.data, raw.black_level, raw.white_level)
        {
            let what = "Describe the frame with ⟨black_level⟩, or give dark frames with ⟨dark⟩";
            job.warn(&[Warning::from(format!("{file}: {doubt}. {what}"))]);
        }
        match frames.iter_mut().find(|frame| frame.raw.label == **capture) {
            Some(frame) if label != *capture => frame.bracket.push(raw),
            Some(_) => {
                return Err(Error::Input(format!("⟨frame={text}⟩: \"{label}\" is given twice; keep one")));
            }
            None if label != *capture => {
                return Err(Error::Input(format!(
                    "⟨frame={text}⟩: give the main exposure before it, ⟨frame={capture}=FILE⟩"
                )));
            }
            None => frames.push(RawExposures { raw, bracket: Vec::new() }),
        }
    }
    if !frames.iter().any(|frame| frame.raw.label == wanted) {
        return Err(Error::Input(format!(
            "the analysis is of the capture \"{wanted}\"; give its file with ⟨frame={wanted}=FILE⟩"
        )));
    }
    Ok((frames, told))
}
