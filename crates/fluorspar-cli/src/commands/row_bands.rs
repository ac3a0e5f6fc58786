//! Images that do not fit into memory: rendered band of rows by band of rows.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use fluorspar::image::{Component, FeatureMaps, Film, FilmLayout};
use fluorspar::pipeline::{
    BandPlanes, BandStore, BandedRender, RowBandError, render_row_bands, row_bands, tile_rows_at_once,
};
use fluorspar::render::{FilmRenderer, Share, memory_bytes};
use fluorspar::units::{memory_text, memory_texts};
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_format::{Provenance, SpooledImage, read_film_layout, read_film_rows, write_film};
use fluorspar_session::{ExperimentSource, Keep, Left, fill_film, say_time, seconds_of};

use super::light_of_capture::CaptureLight;
use super::render::{Options, peak_memory_bytes, say_surfaces};
use crate::error::{CliError, STOPPED};
use crate::message;
use crate::message::Messages;
use crate::progress::WritingReport;

/// The film of a folder that holds no samples but what belongs to the whole image.
const WHOLE: &str = "picture.film";

/// Renders an image whose film is larger than the memory limit: bands of tile rows one after the other, each with all
/// its samples. Finished rows wait in a temporary file beside the output. The result is the same image as that of a render
/// in one go, bit for bit. So is an image rendered whose `--film` is a folder already.
pub(super) fn render(
    options: &Options,
    source: &ExperimentSource,
    experiment: &ResolvedExperiment,
    light: &CaptureLight,
) -> Result<ExitCode, CliError> {
    let (scene, settings) = (&experiment.study.scene, &experiment.study.render);
    let messages = Messages::default();
    let (needed, limit) = (memory_bytes(scene, settings), settings.memory_limit_bytes);
    check_options(options, experiment, needed > limit)?;
    let rows_at_once =
        tile_rows_at_once(scene, settings).map_err(|error| in_bands(options, &error, needed))?;
    // What follows takes minutes for a large image.
    let set = options.declare(source, experiment)?;
    options.say_plan(&experiment.study, light, messages);
    let renderer = FilmRenderer::for_rows(scene, settings)?;
    if let Some(folder) = options.film.as_deref().filter(|folder| folder.is_dir()) {
        check_folder(&renderer, folder)?;
    }
    let layout = renderer.layout();
    let mut features = renderer.features();
    let begun = match &options.film {
        Some(folder) if folder.is_dir() => bands_begun(folder)?,
        _ => Vec::new(),
    };
    let bands = row_bands(layout.tile_rows(), rows_at_once, begun)
        .map_err(|error| in_bands(options, &error, needed))?;
    let rows = layout.pixel_rows(0..1).len();
    let planes = if options.output.components { BandPlanes::Components } else { BandPlanes::Sum };
    let stored = planes.stored(&layout);
    let [film, most] = memory_texts(needed, limit);
    messages.status(format!(
        "Memory: the film takes {film}, {} of {most}{}: {} bands of up to {} rows, one after the other; {} of \
         finished rows wait beside {}",
        if needed > limit { "more than the limit" } else { "and fits into the limit" },
        if needed > limit { "" } else { ", but --film is a folder" },
        bands.len(),
        bands.iter().map(|band| band.len() * rows).max().unwrap_or(0),
        memory_text(4 * (layout.width * layout.height * stored.iter().sum::<usize>()) as u64),
        options.output.out.display()
    ));
    if !messages.is_quiet() {
        say_time(
            seconds_of(&renderer, &Share::Whole, None),
            settings.samples_per_pixel,
            None,
            &messages.job(),
        )?;
    }
    messages.warnings(&experiment.record.warnings);
    say_surfaces(&renderer, scene, messages);
    let mut provenance = Provenance::new(
        &source.text,
        experiment.record.resolved_toml.clone(),
        settings.seed,
        settings.samples_per_pixel,
    );
    if let Some(folder) = &options.film {
        features = write_whole_film(folder, &layout, features, &provenance)?;
    }
    let beside = options.output.out.parent().filter(|parent| !parent.as_os_str().is_empty());
    let size = (layout.width, layout.height);
    let mut store = Store {
        options,
        renderer: &renderer,
        provenance: &provenance,
        spool: SpooledImage::create(beside.unwrap_or(Path::new(".")), size, layout.grid.clone(), &stored)?,
    };
    let weight = |component: &Component| light.weight(component);
    let rendered =
        render_row_bands(&layout, settings.samples_per_pixel, &bands, (planes, &weight), &mut store)?;
    let spool = store.spool;
    let finished = match rendered {
        BandedRender::Finished(finished) => finished,
        BandedRender::Stopped(rows) => {
            let hint = match &options.film {
                Some(folder) => format!("go on with --resume --film {}", folder.display()),
                None => "what was rendered is lost; with --film FOLDER it is kept".into(),
            };
            message::notice(format!(
                "stopped within rows {} to {} of {}: no image was written; {hint}",
                rows.start,
                rows.end - 1,
                layout.height
            ));
            return Ok(ExitCode::from(STOPPED));
        }
    };
    drop(renderer);
    let mean = finished.mean_spectrum();
    let labels = finished.into_labels(layout, features);
    provenance.samples_per_pixel = labels.samples_per_pixel;
    let writing = WritingReport::begin(&options.output.out, messages);
    options.output.write_spooled(&spool, &labels, &provenance)?;
    drop(writing);
    set.finish()?;
    if options.answer.json {
        let mut answer = options.output.describe_with(&labels, &mean, light);
        answer["experiment_sha256"] = experiment.record.sha256.clone().into();
        answer["film_bytes"] = needed.into();
        answer["memory_limit_bytes"] = settings.memory_limit_bytes.into();
        answer["peak_memory_bytes"] = peak_memory_bytes().into();
        super::print_json(&answer)?;
    } else {
        messages.status(format!("Wrote {}", options.output.out.display()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses options that an image in bands of rows can't follow.
fn check_options(
    options: &Options,
    experiment: &ResolvedExperiment,
    over_the_limit: bool,
) -> Result<(), CliError> {
    let (why, instead) = if over_the_limit {
        ("the image does not fit into render.memory_limit_gib", "raise render.memory_limit_gib")
    } else {
        ("--film names a folder", "name a file with --film")
    };
    options.output.check_for_bands(why, instead)?;
    if experiment.study.time_limit_s.is_some() {
        return Err(CliError::Input(format!(
            "render.time_limit_s: {why}, so that the image is rendered in bands of rows and would lack rows if it were cut \
             short; leave the time limit out, or {instead}"
        )));
    }
    match &options.film {
        Some(path) if path.exists() && !path.is_dir() => Err(CliError::Input(format!(
            "--film {}: this is one film of the whole image, and the image is rendered in bands of rows; raise \
             render.memory_limit_gib, or name another place for a folder of films",
            path.display()
        ))),
        _ => Ok(()),
    }
}

/// Makes the folder of films. The maps of all pixels ride on a film without samples; it is the first that a merge reads.
fn write_whole_film(
    folder: &Path,
    layout: &FilmLayout,
    features: FeatureMaps,
    provenance: &Provenance,
) -> Result<FeatureMaps, CliError> {
    fs::create_dir_all(folder).map_err(|error| {
        CliError::Failed(format!("--film {}: can't make this folder: {error}", folder.display()))
    })?;
    let empty = Film::of_tile_rows(layout.clone(), features, 0..0);
    write_film(&folder.join(WHOLE), &empty, Some(provenance))?;
    Ok(empty.into_features())
}

/// Films in a folder, finished rows in a temporary file, progress on standard error.
struct Store<'a> {
    options: &'a Options,
    renderer: &'a FilmRenderer,
    provenance: &'a Provenance,
    spool: SpooledImage,
}

impl Store<'_> {
    fn film_of(&self, band: &Range<usize>) -> Option<PathBuf> {
        self.options.film.as_deref().map(|folder| folder.join(film_name(band)))
    }
}

impl BandStore for Store<'_> {
    type Error = CliError;

    fn load(&mut self, band: &Range<usize>) -> Result<Option<Film>, CliError> {
        let layout = self.renderer.layout();
        let rows = layout.pixel_rows(band.clone());
        let what = format!("Rows {} to {} of {}", rows.start, rows.end - 1, layout.height);
        Messages::default().status(what);
        let Some(path) = self.film_of(band).filter(|path| path.exists()) else { return Ok(None) };
        let film = read_film_rows(&path, band.clone())?.image;
        self.renderer.check(&film).map_err(|error| in_film(&path, &error))?;
        Ok(Some(film))
    }

    fn fill(&mut self, band: &Range<usize>, share: &Share, film: &mut Film) -> Result<bool, CliError> {
        let path = self.film_of(band);
        let interval = Duration::from_secs_f64(self.options.checkpoint_s);
        let keep = Keep {
            film: path.as_deref().map(|path| (path, interval)),
            provenance: Some(self.provenance),
            left: if path.is_some() { Left::Film } else { Left::Nothing },
            ..Keep::default()
        };
        fill_film(self.renderer, share, film, None, &Messages::default().job(), &keep)
    }

    fn store_rows(&mut self, plane: usize, first_row: usize, values: &[f32]) -> Result<(), CliError> {
        Ok(self.spool.add_rows(plane, first_row, values)?)
    }
}

/// Why the image can't be rendered in bands, in the words of the options.
fn in_bands(options: &Options, error: &RowBandError, film_bytes: u64) -> CliError {
    let folder = options.film.as_deref().unwrap_or(Path::new("")).display();
    CliError::Input(match error {
        // Of few components and bands: one film is smaller than the maps that bands need beside theirs.
        RowBandError::Memory { needed, limit } => {
            let [need, most] = memory_texts(*needed, *limit);
            format!(
                "--film {folder}: this is a folder, for films of bands of rows, which need {need}, more than the limit of \
                 {most}; name a file, as the whole film takes {}, or raise render.memory_limit_gib",
                memory_text(film_bytes)
            )
        }
        RowBandError::Overlap(band) => format!(
            "--film {folder}: {} does not match the others: the folder holds films of several renders. Name another one",
            film_name(band)
        ),
        RowBandError::TooTall { band, fit } => format!(
            "--film {folder}: {} holds {} rows of tiles, and {fit} fit into the limit; raise render.memory_limit_gib to what \
             the film was begun with",
            film_name(band),
            band.len()
        ),
        other => format!("--film {folder}: {other}"),
    })
}

/// Refuses a folder with films of another render or with other files only, before anything in it is changed.
fn check_folder(renderer: &FilmRenderer, folder: &Path) -> Result<(), CliError> {
    let films = films_in(folder)?;
    if films.is_empty() && fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(CliError::Input(format!(
            "--film {}: this folder holds files, none of which is a film; name an empty or a new folder",
            folder.display()
        )));
    }
    for path in films {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name != WHOLE && band_of(&name).is_none() {
            continue;
        }
        let (layout, holds_samples) = read_film_layout(&path)?;
        renderer.check_layout(&layout).map_err(|error| in_film(&path, &error))?;
        if name == WHOLE && holds_samples {
            return Err(CliError::Input(format!(
                "{}: this film holds samples, and a film of this name without samples belongs in a folder of films; move it \
                 elsewhere, or name another folder",
                path.display()
            )));
        }
    }
    Ok(())
}

fn in_film(path: &Path, error: &impl std::fmt::Display) -> CliError {
    CliError::Input(format!("{}: {error}", path.display()))
}

/// `rows-FIRST-END.film`: rows of tiles, the end excluded.
fn film_name(band: &Range<usize>) -> String {
    format!("rows-{:06}-{:06}.film", band.start, band.end)
}

fn band_of(name: &str) -> Option<Range<usize>> {
    let (start, end) = name.strip_prefix("rows-")?.strip_suffix(".film")?.split_once('-')?;
    Some(start.parse().ok()?..end.parse().ok()?)
}

/// Bands of tile rows for which films are in a folder.
fn bands_begun(folder: &Path) -> Result<Vec<Range<usize>>, CliError> {
    let films = films_in(folder)?;
    Ok(films.iter().filter_map(|path| band_of(&path.file_name()?.to_string_lossy())).collect())
}

fn films_in(folder: &Path) -> Result<Vec<PathBuf>, CliError> {
    let failed =
        |error: std::io::Error| CliError::Failed(format!("{}: can't read it: {error}", folder.display()));
    let mut films = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|ending| ending == "film") {
            films.push(path);
        }
    }
    films.sort();
    Ok(films)
}

/// Films by name, with folders replaced by the films in them.
pub(super) fn films_of(paths: &[PathBuf]) -> Result<Vec<PathBuf>, CliError> {
    let mut films = Vec::new();
    for path in paths {
        if !path.is_dir() {
            films.push(path.clone());
            continue;
        }
        let inside = films_in(path)?;
        if inside.is_empty() {
            return Err(CliError::Input(format!("{}: there are no films in this folder", path.display())));
        }
        films.extend(inside);
    }
    Ok(films)
}
