//! `fluorspar analyze`: chromaticity and porphyrin from raw frames.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueHint;
use fluorspar::format::{read_component_exr, read_sensor_image};
use fluorspar::pipeline::{analyze, develop_frames};

use crate::args::{Changes, Talk};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;

/// Options of `analyze`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Folder with raw_*.tiff (or .png) and experiment.toml, as `run` and `capture` write it.
    #[arg(value_name = "FOLDER", value_hint = ValueHint::DirPath)]
    folder: PathBuf,
    /// Experiment to use instead of the folder's experiment.toml.
    #[arg(long, value_name = "EXPERIMENT")]
    experiment: Option<String>,
    /// Component image that tells which part a pixel shows [default: components.exr of the folder]. Needed for regions
    /// by part name.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    components: Option<PathBuf>,
    #[command(flatten)]
    changes: Changes,
    #[command(flatten)]
    talk: Talk,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let folder = &options.folder;
    if !folder.is_dir() {
        return Err(CliError::Input(format!(
            "{}: this is no folder; give one that `run` or `capture` wrote",
            folder.display()
        )));
    }
    let default = folder.join("experiment.toml");
    let name = options.experiment.clone().unwrap_or_else(|| default.display().to_string());
    let source = ExperimentSource::find(Some(&name))?;
    let experiment = source.resolve(&options.changes.set, true)?;
    if experiment.analysis.is_none() {
        return Err(CliError::Input(format!(
            "{name}: the experiment asks for no analysis; add an [analysis] section"
        )));
    }

    let mut raws = Vec::new();
    for capture in &experiment.captures {
        let label = &capture.frame.label;
        let candidates = ["tiff", "tif", "png"].map(|ending| folder.join(format!("raw_{label}.{ending}")));
        match candidates.iter().find(|path| path.is_file()) {
            Some(path) => raws.push(read_sensor_image(path)?.image),
            None => {
                return Err(CliError::Input(format!(
                    "{}: there is no raw_{label}.tiff for the capture \"{label}\"",
                    folder.display()
                )));
            }
        }
    }
    let beside = folder.join("components.exr");
    let image = options.components.clone().or_else(|| beside.is_file().then_some(beside));
    if let (None, Some([part, ..])) = (&image, experiment.analysis.as_ref().map(|a| a.parts.as_slice())) {
        return Err(CliError::Input(format!(
            "{}: the region is the part \"{part}\", and nothing here tells which pixels show it; name the component image of \
             the run with --components",
            folder.display()
        )));
    }
    let components = image.map(|path| read_component_exr(&path)).transpose()?.map(|loaded| loaded.image);
    let frames = develop_frames(&experiment, raws)?;
    let Some(analyzed) = analyze(&experiment, components.as_ref(), &frames)? else {
        return Err(CliError::Failed("the analysis gave nothing".into()));
    };
    if options.talk.json {
        super::print_json(&analyzed.analysis)?;
    } else if !options.talk.quiet {
        super::print_text(&describe(&analyzed.analysis))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn describe(analysis: &fluorspar::analysis::Analysis) -> String {
    let mut text = format!("Frame \"{}\", {}\n", analysis.frame, analysis.region_description);
    text += &format!(
        "{} pixels: {} valid, {} saturated, {} below the noise floor, {} undefined\n",
        analysis.counts.total(),
        analysis.counts.valid,
        analysis.counts.saturated,
        analysis.counts.below_noise_floor,
        analysis.counts.undefined
    );
    for channel in &analysis.channels {
        if let Some(s) = &channel.statistics {
            text += &format!(
                "{}: median {:.1} DN, mean {:.1} DN, sd {:.1} DN\n",
                channel.name,
                s.median,
                s.mean,
                s.sd.unwrap_or(0.0)
            );
        }
    }
    if let (Some(r), Some(g)) = (&analysis.r, &analysis.g) {
        text += &format!(
            "r: median {:.4}, sd {:.4}; g: median {:.4}, sd {:.4}\n",
            r.median,
            r.sd.unwrap_or(0.0),
            g.median,
            g.sd.unwrap_or(0.0)
        );
    }
    if let Some(region) = analysis.mixture.as_ref().and_then(|m| m.region) {
        let e = region.estimate;
        text += &format!(
            "porphyrin fraction of the region: {:.4} ({:.4} to {:.4})\n",
            e.fraction, e.fraction_interval[0], e.fraction_interval[1]
        );
    }
    for warning in &analysis.warnings {
        text += &format!("warning: {warning}\n");
    }
    text
}
