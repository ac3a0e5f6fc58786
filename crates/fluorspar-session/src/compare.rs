//! Two finished runs side by side.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::analysis::Analyte;
use fluorspar::pipeline::{CapturedFrame, ColorRendering};
use fluorspar::study::Study;
use fluorspar_experiment::{
    Experiment, SettingDifference, parse, resolve, resolve_captures, setting_differences,
};
use fluorspar_format::{FileFormat, OutputFolder, read_bounded, read_start, write_atomically};
use fluorspar_report::{
    ComparedNumber, ComparedPictures, FinishedRun, FrameToCompare, HOW_JUDGED, ReportPicture, RunFolderError,
    compared_numbers, compared_pictures, comparison_figures, comparison_remarks, comparison_report,
    comparison_verdict, extract_experiment,
};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::analyze::developed_folder;
use crate::{Error, Job, Result, read_text};

/// What else there is to compare, at the end of the help.
const OTHER_COMPARISONS: &str = "\
This compares what two runs have found. Designs of lights, filters and sensors that nobody has run yet are compared by `design compare`; \
frames of one render by `sheet`; two spots of one frame by analysis.compared_px.";

/// Which finished runs are compared.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
#[command(after_help = OTHER_COMPARISONS)]
pub struct CompareOptions {
    /// Folder of a finished `run`, `capture` or `analyze --out`, or the results.json or report.html in it.
    #[arg(value_name = "A", value_hint = ValueHint::DirPath)]
    pub a: PathBuf,
    /// The other one.
    #[arg(value_name = "B", value_hint = ValueHint::DirPath)]
    pub b: PathBuf,
    /// Folder for report.html with frames side by side, its pictures and figures, and results.json [default: none].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// Two finished runs side by side.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Format of results.
    pub format: u32,
    /// "fluorspar".
    pub program: &'static str,
    /// Version of the program.
    pub version: &'static str,
    /// The runs.
    pub compared: ComparedRuns,
    /// Settings that differ; `None` where they are not compared.
    pub settings: Option<Vec<SettingDifference>>,
    /// Why settings are not compared.
    pub settings_not_compared: Option<String>,
    /// The numbers of both, and whether their intervals tell them apart.
    pub numbers: Vec<ComparedNumber>,
    /// How that is judged.
    pub judged: &'static str,
    /// Which run sees smaller amounts, in a sentence.
    pub verdict: Option<String>,
    /// What makes the comparison doubtful.
    pub warnings: Vec<String>,
}

/// The runs that are compared.
#[derive(Clone, Debug, Serialize)]
pub struct ComparedRuns {
    /// The first one.
    pub a: ComparedRun,
    /// The second one.
    pub b: ComparedRun,
}

/// A run that is compared.
#[derive(Clone, Debug, Serialize)]
pub struct ComparedRun {
    /// Its folder.
    pub folder: String,
    /// Title of its experiment, where it is known.
    pub title: Option<String>,
    /// Version of the program that wrote it, where it is known.
    pub version: Option<String>,
    /// Digest of its experiment, where it is known.
    pub experiment_sha256: Option<String>,
}

impl From<&FinishedRun> for ComparedRun {
    fn from(run: &FinishedRun) -> Self {
        let text = |text: &String| (!text.is_empty()).then(|| text.clone());
        Self {
            folder: run.name.clone(),
            title: text(&run.title),
            version: text(&run.version),
            experiment_sha256: text(&run.experiment_sha256),
        }
    }
}

/// Compares two finished runs, and writes a page with their frames into the folder of the options.
///
/// # Errors
/// A folder that holds no finished run; the same one twice; a folder that can't be written.
pub fn compare(options: &CompareOptions, job: &Job) -> Result<Comparison> {
    let sides = [Side::open(&options.a)?, Side::open(&options.b)?];
    let [a, b] = &sides;
    if let (Ok(of_a), Ok(of_b)) = (a.folder.canonicalize(), b.folder.canonicalize())
        && of_a == of_b
    {
        return Err(Error::Input(format!(
            "{} and {}: both are the same folder; give the folders of two runs (a run has a folder of its own with ⟨out⟩)",
            options.a.display(),
            options.b.display()
        )));
    }
    let folder = match &options.out {
        Some(out) => Some(OutputFolder::prepare(out, &[a.folder.clone(), b.folder.clone()], OUT_BYTES)?),
        None => None,
    };
    let settings = match (&a.experiment, &b.experiment) {
        (Ok(of_a), Ok(of_b)) => Ok(setting_differences(of_a, of_b)),
        (Err(why), _) | (_, Err(why)) => Err(why.clone()),
    };
    let numbers = compared_numbers(&a.run, &b.run);
    let runs = [&a.run, &b.run];
    let mut warnings = comparison_remarks(runs[0], runs[1]);
    if settings.as_ref().is_ok_and(Vec::is_empty) && a.run.experiment_sha256 != b.run.experiment_sha256 {
        warnings.push(
            "No setting differs, but what they name does: entries of the catalogue or files are others."
                .into(),
        );
    }
    let comparison = Comparison {
        format: FileFormat::RESULTS.version(),
        program: "fluorspar",
        version: env!("CARGO_PKG_VERSION"),
        compared: ComparedRuns { a: runs[0].into(), b: runs[1].into() },
        verdict: comparison_verdict(runs, &numbers, settings.as_deref().ok()),
        settings_not_compared: settings.as_ref().err().cloned(),
        settings: settings.ok(),
        numbers,
        judged: HOW_JUDGED,
        warnings,
    };
    if let Some(folder) = folder {
        write_folder(&folder, &comparison, runs, &frame_pairs(a, b))
            .map_err(|error| error.at_its_place(&folder))?;
        let place = folder.finish()?;
        job.status(format!("Open {}", place.join("report.html").display()));
    }
    Ok(comparison)
}

/// Page, pictures and results, at most.
const OUT_BYTES: u64 = 64 << 20;
/// Largest preview that is read.
const LARGEST_PREVIEW: u64 = 256 << 20;

/// A finished run in its folder.
struct Side {
    folder: PathBuf,
    run: FinishedRun,
    /// The experiment, or why there is none to compare.
    experiment: Result<Experiment, String>,
}

/// Two frames side by side.
struct FramePair {
    /// Name of its files.
    stem: String,
    titles: [String; 2],
    pictures: ComparedPictures,
}

impl Side {
    /// Opens the folder of a run, given by itself or by a file in it.
    fn open(path: &Path) -> Result<Self> {
        let refuse = |why: &str| Err(Error::Input(format!("{}: {why}", path.display())));
        let is_beside = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
        let folder = if path.is_dir() {
            path.to_path_buf()
        } else if !path.exists() {
            return refuse(
                "there is no such folder; give one that `run`, `capture` or `analyze --out` wrote",
            );
        } else if is_beside("json") || is_beside("html") {
            path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf()
        } else {
            return refuse(
                "not a folder of results; give one that `run`, `capture` or `analyze --out` wrote",
            );
        };
        let file = if is_beside("json") { path.to_path_buf() } else { folder.join("results.json") };
        if !file.is_file() {
            return refuse(
                "there is no results.json in this folder; give one that `run`, `capture` or `analyze --out` wrote to its end",
            );
        }
        let wrong = |why: String| Error::Input(format!("{}: {why}", file.display()));
        let results: Value =
            serde_json::from_str(&read_text(&file)?).map_err(|error| wrong(format!("not JSON ({error})")))?;
        // That of `analyze` is the analysis alone
        if results.get("counts").is_none() {
            let stated = results.get("format").and_then(Value::as_i64);
            FileFormat::RESULTS.check(stated).map_err(|other| wrong(other.to_string()))?;
        }
        let experiment = experiment_of(&folder);
        let target = |region: Option<&str>| match &experiment {
            Ok(experiment) => target(experiment, region),
            Err(_) => target_of_results(&results, region),
        };
        let run = FinishedRun::read(&path.display().to_string(), &target, &results)
            .map_err(|error| wrong(error.to_string()))?;
        let analyzed = run.analysis.as_ref().map(|analysis| analysis.frame.as_str());
        let frame_pixels = analyzed.and_then(|frame| pixels_of_preview(&folder, frame));
        // Results of frames don't tell the render behind them; its experiment does
        let rendered = || {
            let render = &experiment.as_ref().ok()?.file.render;
            Some(u64::from(render.width_px) * u64::from(render.height_px))
        };
        let render_pixels = run.render_pixels.or_else(rendered);
        let run = FinishedRun { frame_pixels, render_pixels, ..run };
        // The results of an analysis have no title
        let title = experiment.as_ref().map_or_else(|_| String::new(), |e| e.file.title.clone());
        let run = if run.title.is_empty() { FinishedRun { title, ..run } } else { run };
        Ok(Self { folder, run, experiment })
    }

    /// Frames of the folder as they were developed; `None` where the raw files are not there, or their experiment is not.
    fn developed(&self) -> Option<(Study, Vec<CapturedFrame>)> {
        let experiment = self.experiment.as_ref().ok()?;
        let held: Vec<&str> = experiment.file.concentration.keys().map(String::as_str).collect();
        // Without surfaces where that is enough
        let study = match resolve_captures(experiment, experiment, &held) {
            Ok(Some(found)) => found.study,
            _ => resolve(experiment).ok()?.study,
        };
        let frames = developed_folder(&study, &self.folder).ok()?;
        Some((study, frames))
    }

    /// The picture of a frame as its folder has it.
    fn preview(&self, label: &str) -> Option<Vec<u8>> {
        read_bounded(&self.folder.join(format!("preview_{label}.png")), LARGEST_PREVIEW).ok()
    }
}

/// Pixels of a frame, by the head of its picture: a preview has those of the frame.
fn pixels_of_preview(folder: &Path, frame: &str) -> Option<u64> {
    // Signature of PNG, length and name of the first chunk, width, height (PNG specification, 11.2.2)
    let head = read_start(&folder.join(format!("preview_{frame}.png")), 24).ok()?;
    let number =
        |start: usize| Some(u64::from(u32::from_be_bytes(head.get(start..start + 4)?.try_into().ok()?)));
    let pixels = number(16)?.checked_mul(number(20)?)?;
    (head.get(12..16)? == b"IHDR" && pixels > 0).then_some(pixels)
}

/// The experiment of a folder: its `experiment.toml`, else what its report carries.
fn experiment_of(folder: &Path) -> Result<Experiment, String> {
    let file = folder.join("experiment.toml");
    let text = if file.is_file() {
        read_text(&file).map_err(|error| error.to_string())?
    } else {
        let page = folder.join("report.html");
        let text = page.is_file().then(|| read_text(&page)).transpose().map_err(|error| error.to_string())?;
        text.as_deref().and_then(extract_experiment).ok_or_else(|| {
            format!("{}: neither experiment.toml nor report.html tells its experiment", folder.display())
        })?
    };
    let name = if file.is_file() { file } else { folder.join("report.html") };
    parse(&text, &name.display().to_string(), folder, &[]).map_err(|error| error.to_string())
}

/// The fluorophore whose share is looked for, in words: in a further region, or in that of the analysis.
fn target(experiment: &Experiment, region: Option<&str>) -> String {
    let file = &experiment.file;
    let analysis = file.analysis.as_ref();
    let regions = analysis.map_or(&[][..], |analysis| &analysis.region);
    let own = regions.iter().find(|other| Some(other.name.as_str()) == region);
    let name = own
        .and_then(|region| region.porphyrin.as_deref())
        .or_else(|| analysis.and_then(|analysis| analysis.porphyrin.as_deref()));
    match name.filter(|name| !Analyte::names_porphyrin(name) && *name != "none") {
        None => "porphyrin".into(),
        Some(name) => {
            let own = file.fluorophore.iter().find(|f| f.name == name).and_then(|f| f.title.clone());
            own.unwrap_or_else(|| name.replace('_', " "))
        }
    }
}

/// The same as the results tell it: they name what is no porphyrin.
fn target_of_results(results: &Value, region: Option<&str>) -> String {
    let regions = results["regions"].as_array();
    let own = regions.into_iter().flatten().find(|other| other["name"].as_str() == region);
    let analysis = match region {
        Some(_) => own.map_or(&Value::Null, |own| &own["analysis"]),
        None => results.get("analysis").unwrap_or(results),
    };
    // Older results say `sought`
    let analyte = analysis["analyte"].as_str().or(analysis["sought"].as_str());
    analyte.unwrap_or("porphyrin").to_owned()
}

/// The frames with light that both have, as pictures of one exposure; where names differ, those that are analyzed or the last ones.
fn frame_pairs(a: &Side, b: &Side) -> Vec<FramePair> {
    let developed = [a.developed(), b.developed()];
    let lit = |side: &Side, developed: &Option<(Study, Vec<CapturedFrame>)>| -> Vec<String> {
        let analyzed = side.run.analysis.iter().map(|analysis| analysis.frame.clone());
        let Some((study, _)) = developed else { return analyzed.collect() };
        let has_light = |c: &&fluorspar::study::Capture| c.frame.lights.values().any(|&drive| drive > 0.0);
        study.captures.iter().filter(has_light).map(|c| c.frame.label.clone()).collect()
    };
    let (of_a, of_b) = (lit(a, &developed[0]), lit(b, &developed[1]));
    let mut names: Vec<[String; 2]> =
        of_a.iter().filter(|name| of_b.contains(name)).map(|name| [name.clone(), name.clone()]).collect();
    let analyzed = |side: &Side| side.run.analysis.as_ref().map(|analysis| analysis.frame.clone());
    if let (Some(in_a), Some(in_b)) = (analyzed(a), analyzed(b))
        && in_a != in_b
    {
        names.insert(0, [in_a, in_b]);
    }
    if let (true, Some(in_a), Some(in_b)) = (names.is_empty(), of_a.last(), of_b.last()) {
        names.push([in_a.clone(), in_b.clone()]);
    }
    let pair = |names: [String; 2]| {
        let pictures = match (&developed[0], &developed[1]) {
            (Some(of_a), Some(of_b)) => pictures_of_frames([of_a, of_b], &names),
            _ => None,
        };
        let as_kept = || {
            Some(ComparedPictures {
                png: [a.preview(&names[0])?, b.preview(&names[1])?],
                caption:
                    "Each picture has a white of its own, as the folders hold previews and no raw frames."
                        .into(),
            })
        };
        let pictures = pictures.or_else(as_kept)?;
        let titles =
            [("A", &names[0]), ("B", &names[1])].map(|(run, name)| format!("{run}, frame \"{name}\"."));
        Some(FramePair { stem: names[0].clone(), titles, pictures })
    };
    names.into_iter().filter_map(pair).collect()
}

fn pictures_of_frames(
    developed: [&(Study, Vec<CapturedFrame>); 2],
    names: &[String; 2],
) -> Option<ComparedPictures> {
    let frame = |side: usize| -> Option<FrameToCompare<'_>> {
        let (study, frames) = developed[side];
        let frame = frames.iter().find(|frame| frame.raw.label == names[side])?;
        Some(FrameToCompare {
            developed: &frame.developed,
            dn_per_electron: frame.raw.dn_per_electron,
            exposure_s: frame.raw.exposure_s,
            rendering: ColorRendering::of_frame(study, study.capture(&names[side])?),
        })
    };
    compared_pictures(&frame(0)?, &frame(1)?)
}

/// Writes the page, its pictures and figures, and the numbers.
fn write_folder(
    folder: &OutputFolder,
    comparison: &Comparison,
    runs: [&FinishedRun; 2],
    pairs: &[FramePair],
) -> Result<()> {
    let put = |name: &str, bytes: &[u8]| -> Result<()> {
        Ok(write_atomically(&folder.path().join(name), |file| file.write_all(bytes))?)
    };
    let path = folder.path().join("figures");
    std::fs::create_dir_all(&path).map_err(|source| RunFolderError::Folder { path, source })?;
    put("results.json", &serde_json::to_vec_pretty(comparison)?)?;
    for pair in pairs {
        for (letter, png) in ["a", "b"].iter().zip(&pair.pictures.png) {
            put(&format!("{}_{letter}.png", pair.stem), png)?;
        }
    }
    for (stem, figure) in comparison_figures(&comparison.numbers) {
        put(&format!("figures/{stem}.svg"), figure.to_svg().as_bytes())?;
        put(&format!("figures/{stem}.png"), &figure.to_png()?)?;
        if let Some(csv) = figure.to_csv() {
            put(&format!("figures/{stem}.csv"), csv.as_bytes())?;
        }
    }
    let frames = pairs.iter().map(|pair| {
        let picture = |side: usize| ReportPicture {
            png: pair.pictures.png[side].clone(),
            title: pair.titles[side].clone(),
            caption: runs[side].name.clone(),
        };
        (pair.pictures.caption.clone(), picture(0), picture(1))
    });
    let why = comparison.settings_not_compared.as_deref().unwrap_or_default();
    let settings = comparison.settings.as_deref().ok_or(why);
    let page = comparison_report(runs, settings, &comparison.numbers, frames.collect());
    put("report.html", page.to_html().as_bytes())
}
