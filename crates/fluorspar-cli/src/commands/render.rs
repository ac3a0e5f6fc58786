//! `fluorspar render`: spectral radiance only, in one go, in parts, or in several processes.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use std::time::Duration;

use clap::{ValueEnum, ValueHint};
use fluorspar::pipeline::image_and_basis;
use fluorspar::render::{BasisSettings, FilmRenderer, RenderSettings, Share, memory_bytes};
use fluorspar::scene::{Scene, Shape};
use fluorspar::study::Study;
use fluorspar::units::{memory_text, memory_texts};
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_format::{Output, OutputSet, Outputs, Provenance, read_film, read_text_bounded};
use fluorspar_session::{
    ExperimentArgs, ExperimentSource, Keep, Left, ResourceLimits, ResourceNeeds, check_memory,
    check_nothing_painted, fill_film, film_file_bytes, image_room_bytes, render_with_excitation_basis,
};
use serde_json::json;

use super::image_output::ImageOutput;
use super::light_of_capture::{APART, CaptureLight, CaptureOption};
use super::pbrt_scene::PbrtArgs;
use super::row_bands;
use crate::args::Answer;
use crate::error::{CliError, STOPPED};
use crate::interrupt::interrupted;
use crate::message::Messages;
use crate::progress::WritingReport;
use crate::values;

/// Options of `render`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    experiment: ExperimentArgs,
    #[command(flatten)]
    pub(super) limits: ResourceLimits,
    #[command(flatten)]
    pub(super) output: ImageOutput,
    #[command(flatten)]
    pub(super) light: CaptureOption,
    /// Film of the render, which keeps its exact sums: saved while rendering and at the end.
    ///
    /// From a film the render can be resumed after any interruption, given more samples, or merged. Of an image that does not fit
    /// into the memory limit it is a folder of films, one for each band of rows.
    #[arg(long, value_name = "FILE.film", value_hint = ValueHint::AnyPath)]
    pub(super) film: Option<PathBuf>,
    /// Resume from the film if it exists: same scene, seed and depth. The result has the bits of an uninterrupted render.
    #[arg(long, requires = "film")]
    resume: bool,
    /// Seconds between saves of the film.
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, requires = "film", value_parser = values::number,
        allow_negative_numbers = true)]
    pub(super) checkpoint_s: f64,
    /// Part that is done, for one of several processes: part I of N into the film, and no image; `fluorspar merge` puts the N films together.
    #[arg(long, value_name = "I/N", requires = "film", conflicts_with_all = ["out", "storage"])]
    shard: Option<Shard>,
    /// How samples are divided among the parts.
    #[arg(long, value_enum, default_value_t, requires = "shard")]
    shard_by: ShardBy,
    #[command(flatten)]
    pbrt: PbrtArgs,
    #[command(flatten)]
    pub(super) answer: Answer,
}

/// `I/N`, I from 1 to N.
#[derive(Clone, Copy, Debug)]
struct Shard {
    index: u32,
    count: u32,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parsed {
            Some((index @ 1.., count)) if index <= count => Ok(Self { index: index - 1, count }),
            _ => Err("must be I/N with I from 1 to N, for instance 2/4".into()),
        }
    }
}

/// What a shard is a part of.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum ShardBy {
    /// Tiles of 16 x 16 pixels, every Nth one: any split, smallest films.
    #[default]
    Tiles,
    /// Runs of samples of all pixels: every film is a noisy image of the whole.
    Samples,
}

/// Refuses a film that holds more samples than are asked for: they can't be taken away.
fn check_has_fewer(path: &Path, held: u32, wanted: u32) -> Result<(), CliError> {
    if held <= wanted {
        return Ok(());
    }
    Err(CliError::Input(format!(
        "--film {}: it holds {held} samples per pixel, more than the {wanted} that are asked for; ask for {held} or more, or name another film",
        path.display()
    )))
}

impl Options {
    fn share(&self) -> Share {
        match (self.shard, self.shard_by) {
            (None, _) => Share::Whole,
            (Some(Shard { index, count }), ShardBy::Tiles) => Share::Tiles { index, count },
            (Some(Shard { index, count }), ShardBy::Samples) => Share::Samples { index, count },
        }
    }

    /// Whether a sum of components is written, now or on the way.
    fn sums(&self) -> bool {
        self.output.sums() && (self.shard.is_none() || self.output.preview.is_some())
    }

    /// The light of the image.
    fn light(&self, study: &Study) -> Result<CaptureLight, CliError> {
        let light = self.light.of_study(study)?;
        light.check_sums(self.sums())?;
        Ok(light)
    }

    /// Says what the render takes, and under which light its image is.
    pub(super) fn say_plan(&self, study: &Study, light: &CaptureLight, messages: Messages) {
        messages.status(format!("Needs {}", self.budget(study).text()));
        if self.sums() {
            light.say(messages, APART);
        }
    }

    /// What the render takes.
    pub(super) fn budget(&self, study: &Study) -> ResourceNeeds {
        ResourceNeeds::of_render(study, self.output.components, self.film.is_some())
    }

    /// The files that a render writes: the image when it is done, film and preview on the way.
    pub(super) fn declare(
        &self,
        source: &ExperimentSource,
        experiment: &ResolvedExperiment,
    ) -> Result<OutputSet, CliError> {
        let mut outputs = match self.shard {
            Some(_) => Outputs::new(),
            None => self.output.outputs(image_room_bytes(&experiment.study, self.output.components)),
        };
        match &self.film {
            // What is in it already is judged where it is read.
            Some(folder) if folder.is_dir() => {}
            Some(film) => {
                let bytes = film_file_bytes(&experiment.study);
                outputs = outputs.and(Output::continued("--film", film).of_bytes(bytes));
            }
            None => {}
        }
        Ok(outputs.reading(&source.files(&experiment.record)).declare()?)
    }

    fn check(&self) -> Result<(), CliError> {
        if self.shard.is_none() {
            self.output.check()?;
        }
        if let Some(path) = &self.film
            && path.exists()
            && !self.resume
        {
            return Err(CliError::Input(format!(
                "--film {}: this file is there already; add --resume to go on with it, or name another",
                path.display()
            )));
        }
        values::check_range("checkpoint_s", self.checkpoint_s, [0.1, 1e6], "seconds")
    }
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    options.check()?;
    let messages = Messages::default();
    let source = ExperimentSource::find(options.experiment.experiment.as_deref())?;
    let experiment = options.pbrt.resolve(&source, &options.experiment, &options.limits)?;
    let study = &experiment.study;
    check_nothing_painted(study)?;
    let light = options.light(study)?;
    let (scene, settings) = (&study.scene, &study.render);
    let needed = memory_bytes(scene, settings);
    let budget = options.budget(study);
    budget.check(&options.limits, study)?;
    let in_bands = needed > settings.memory_limit_bytes || options.film.as_deref().is_some_and(Path::is_dir);
    if let Some(basis) = &settings.excitation_basis {
        if options.shard.is_none() {
            options.output.check_for_basis()?;
        }
        match &options.film {
            None => return render_basis(options, &source, &experiment, (basis, &light)),
            Some(film) if in_bands => return Err(film_of_basis(film, basis, needed, settings)),
            Some(_) => {}
        }
    }
    if in_bands && options.shard.is_none() {
        return row_bands::render(options, &source, &experiment, &light);
    }
    check_memory(study, "or leave --shard out: without it, large images are rendered in bands of rows")?;
    let set = options.declare(&source, &experiment)?;
    options.say_plan(study, &light, messages);
    messages.warnings(&experiment.record.warnings);
    let renderer = FilmRenderer::new(scene, settings)?;
    say_surfaces(&renderer, scene, messages);
    let mut film = match options.film.as_deref().filter(|path| options.resume && path.exists()) {
        Some(path) => {
            let film = read_film(path)?.image;
            renderer
                .check(&film)
                .map_err(|error| CliError::Input(format!("--film {}: {error}", path.display())))?;
            check_has_fewer(path, film.least_samples(), settings.samples_per_pixel)?;
            film
        }
        None => renderer.new_film(),
    };
    let mut provenance = Provenance::new(
        &source.text,
        experiment.record.resolved_toml.clone(),
        settings.seed,
        settings.samples_per_pixel,
    );
    let keep = Keep {
        film: options.film.as_deref().map(|path| (path, Duration::from_secs_f64(options.checkpoint_s))),
        provenance: Some(&provenance),
        preview: options.output.preview.as_deref(),
        weight: &|component| light.weight(component),
        left: if options.shard.is_some() { Left::Film } else { Left::Image },
    };
    let share = options.share();
    let before = film.paths();
    let complete = fill_film(&renderer, &share, &mut film, study.time_limit_s, &messages.job(), &keep)?;
    drop(renderer);
    let code = if interrupted() && !complete { ExitCode::from(STOPPED) } else { ExitCode::SUCCESS };
    if options.shard.is_some() {
        if options.answer.json {
            super::print_json(
                &json!({ "film": options.film, "paths": film.paths(), "new_paths": film.paths() - before }),
            )?;
        } else if let Some(path) = &options.film {
            messages.status(format!("Wrote {}", path.display()));
        }
        return Ok(code);
    }
    if settings.excitation_basis.is_some() && film.least_samples() == 0 {
        let path = options.film.as_deref().unwrap_or(Path::new("the film"));
        return Err(CliError::Stopped(format!(
            "stopped before every pixel had a sample: an excitation basis needs them, and no image was written; go on with --resume \
             --film {}",
            path.display()
        )));
    }
    let (image, basis) = image_and_basis(film).map_err(|error| CliError::Input(error.to_string()))?;
    provenance.samples_per_pixel = image.samples_per_pixel;
    let writing = WritingReport::begin(&options.output.out, messages);
    options.output.write_with(&image, basis.as_ref(), &provenance, &light)?;
    drop(writing);
    set.finish()?;
    if options.answer.json {
        let mut answer = options.output.describe(&image, &light);
        answer["experiment_sha256"] = experiment.record.sha256.clone().into();
        answer["film_bytes"] = needed.into();
        answer["budget"] = json!(budget);
        answer["peak_memory_bytes"] = peak_memory_bytes().into();
        super::print_json(&answer)?;
    } else {
        messages.status(format!("Wrote {}", options.output.out.display()));
    }
    Ok(code)
}

/// A film of a render with an excitation basis that is no single file in memory.
fn film_of_basis(film: &Path, basis: &BasisSettings, needed: u64, settings: &RenderSettings) -> CliError {
    let [needed_text, limit] = memory_texts(needed, settings.memory_limit_bytes);
    let instead = if needed > settings.memory_limit_bytes {
        "raise render.memory_limit_gib, render fewer pixels, or leave --film out: then they are brought into a short form, some rows at a time"
    } else {
        "name a file, not a folder"
    };
    CliError::Input(format!(
        "--film {}: the film of a render with an excitation basis (render.excitation_basis_nm) keeps the sums of all {} wavelengths of \
         excitation in every pixel, here {needed_text}, and the limit is {limit}; {instead}",
        film.display(),
        basis.nodes.len()
    ))
}

/// Renders with an excitation basis and without a film, in bands of rows.
fn render_basis(
    options: &Options,
    source: &ExperimentSource,
    experiment: &ResolvedExperiment,
    (basis, light): (&BasisSettings, &CaptureLight),
) -> Result<ExitCode, CliError> {
    let (study, messages) = (&experiment.study, Messages::default());
    let budget = options.budget(study);
    let set = options.declare(source, experiment)?;
    options.say_plan(study, light, messages);
    messages.warnings(&experiment.record.warnings);
    let (image, kept) = render_with_excitation_basis(study, basis, &messages.job())?;
    let toml = experiment.record.resolved_toml.clone();
    let provenance = Provenance::new(&source.text, toml, study.render.seed, image.samples_per_pixel);
    options.output.write_with(&image, Some(&kept), &provenance, light)?;
    set.finish()?;
    if options.answer.json {
        let mut answer = options.output.describe(&image, light);
        answer["experiment_sha256"] = experiment.record.sha256.clone().into();
        answer["excitation_nodes_nm"] = basis.nodes.nodes_nm().into();
        answer["budget"] = json!(budget);
        answer["peak_memory_bytes"] = peak_memory_bytes().into();
        super::print_json(&answer)?;
    } else {
        messages.status(format!("Wrote {}", options.output.out.display()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Says what the surfaces take, where instances make that hard to guess.
pub(super) fn say_surfaces(renderer: &FilmRenderer, scene: &Scene, messages: Messages) {
    let many = scene.objects.iter().filter_map(|object| match &object.shape {
        Shape::Instances(many) => Some(many),
        _ => None,
    });
    let (instances, triangles) = many.fold((0, 0), |(instances, triangles), many| {
        (instances + many.instances.len(), triangles + many.triangle_count())
    });
    if instances > 0 {
        messages.status(format!(
            "Surfaces: {}; {instances} instances of {triangles} triangles in all",
            memory_text(renderer.surface_bytes())
        ));
    }
}

/// Most memory that this process held so far, where the system tells (Linux).
pub(super) fn peak_memory_bytes() -> Option<u64> {
    let status = read_text_bounded(Path::new("/proc/self/status"), 1 << 20).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib << 10)
}
