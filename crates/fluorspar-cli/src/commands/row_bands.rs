//! Pictures that do not fit into memory: rendered band of rows by band of rows.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use fluorspar::experiment::ResolvedExperiment;
use fluorspar::format::{
    FormatError, Provenance, SpooledImage, read_film_layout, read_film_rows, write_film,
};
use fluorspar::image::{ComponentImage, FeatureMaps, Film, FilmLayout, SampleStatistics};
use fluorspar::render::{FilmRenderer, Share, memory_bytes, tile_row_bytes, whole_image_bytes};
use fluorspar::units::{memory_text, memory_texts};

use super::render::{Options, peak_memory_bytes, say_surfaces};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;
use crate::progress::{Keep, fill_with_progress};

/// The film of a folder that holds no samples but what belongs to the whole picture.
const WHOLE: &str = "picture.film";

/// Renders a picture whose film is larger than the memory limit: bands of tile rows one after the other, each with all
/// its samples. Finished rows wait in a temporary file beside the output. The result is the same image as that of a render
/// in one go, bit for bit. So is a picture rendered whose `--film` is a folder already.
pub(super) fn render(
    options: &Options,
    source: &ExperimentSource,
    experiment: &ResolvedExperiment,
) -> Result<ExitCode, CliError> {
    let (scene, settings, quiet) = (&experiment.study.scene, &experiment.study.render, options.talk.quiet);
    let (needed, limit) = (memory_bytes(scene, settings), settings.memory_limit_bytes);
    let (why, instead) = if needed > limit {
        ("the image does not fit into render.memory_limit_gib", "raise render.memory_limit_gib")
    } else {
        ("--film names a folder", "name a file with --film")
    };
    options.output.check_for_bands(why, instead)?;
    if experiment.study.time_limit_s.is_some() {
        return Err(CliError::Input(format!(
            "render.time_limit_s: {why}, so that the image is rendered in bands of rows and would lack rows if it were cut \
             short; leave the time limit away, or {instead}"
        )));
    }
    if let Some(path) = &options.film
        && path.exists()
        && !path.is_dir()
    {
        return Err(CliError::Input(format!(
            "--film {}: this is one film of the whole picture, and the picture is rendered in bands of rows; raise \
             render.memory_limit_gib, or name another place for a folder of films",
            path.display()
        )));
    }
    let whole = whole_image_bytes(scene);
    let per_row = tile_row_bytes(scene, settings);
    if whole + per_row > limit {
        // Of few components and bands: one film is smaller than the maps that bands need beside theirs.
        let [need, most] = memory_texts(whole + per_row, limit);
        return Err(CliError::Input(format!(
            "--film {}: this is a folder, for films of bands of rows, which need {need}, more than the limit of {most}; \
             name a file, as the whole film takes {}, or raise render.memory_limit_gib",
            options.film.as_deref().unwrap_or(Path::new("")).display(),
            memory_text(needed)
        )));
    }
    let rows_at_once = ((limit - whole) / per_row.max(1)) as usize;
    let renderer = FilmRenderer::for_rows(scene, settings)?;
    if let Some(folder) = options.film.as_deref().filter(|folder| folder.is_dir()) {
        check_folder(&renderer, folder)?;
    }
    let layout = renderer.layout();
    let mut features = renderer.features();
    let bands = bands(options, &layout, rows_at_once)?;
    let rows = layout.pixel_rows(0..1).len();
    let images = images(&layout, options.output.components);
    if !quiet {
        let [film, most] = memory_texts(needed, limit);
        eprintln!(
            "Memory: the film takes {film}, {} of {most}{}: {} bands of up to {} rows, one after the other; {} \
             of finished rows wait beside {}",
            if needed > limit { "more than the limit" } else { "and fits into the limit" },
            if needed > limit { "" } else { ", but --film is a folder" },
            bands.len(),
            bands.iter().map(|band| band.len() * rows).max().unwrap_or(0),
            memory_text(4 * (layout.width * layout.height * layout.grid.len() * images) as u64),
            options.output.out.display()
        );
    }
    say_surfaces(&renderer, scene, quiet);
    let mut provenance = Provenance::new(
        &source.text,
        experiment.record.resolved_toml.clone(),
        settings.seed,
        settings.samples_per_pixel,
    );
    if let Some(folder) = &options.film {
        fs::create_dir_all(folder).map_err(|error| {
            CliError::Failed(format!("--film {}: can't make this folder: {error}", folder.display()))
        })?;
        // The maps of all pixels ride on a film without samples; it is the first that a merge reads.
        let empty = Film::of_tile_rows(layout.clone(), features, 0..0);
        write_film(&folder.join(WHOLE), &empty, Some(&provenance))?;
        features = empty.into_features();
    }
    let beside = options.output.out.parent().filter(|parent| !parent.as_os_str().is_empty());
    let size = (layout.width, layout.height);
    let mut picture = Picture {
        spool: SpooledImage::create(beside.unwrap_or(Path::new(".")), size, layout.grid.clone(), images)?,
        components: options.output.components,
        samples: vec![0; layout.width * layout.height],
        sums: vec![0.0; layout.grid.len()],
    };
    for band in &bands {
        let pixel_rows = layout.pixel_rows(band.clone());
        if !quiet {
            eprintln!("Rows {} to {} of {}", pixel_rows.start, pixel_rows.end - 1, layout.height);
        }
        let path = options.film.as_deref().map(|folder| folder.join(film_name(band)));
        let mut film = match path.as_deref().filter(|path| path.exists()) {
            Some(path) => {
                let film = read_film_rows(path, band.clone())?.image;
                renderer.check(&film).map_err(|error| in_film(path, &error))?;
                film
            }
            None => Film::of_tile_rows(layout.clone(), FeatureMaps::default(), band.clone()),
        };
        let tiles = layout.tiles_of_rows(band.clone());
        let wanted = settings.samples_per_pixel;
        let held = |film: &Film| {
            film.tiles()
                .skip(tiles.start)
                .take(tiles.len())
                .all(|(tile, _)| matches!(tile.samples.as_slice(), [held] if *held == (0..wanted)))
        };
        if !held(&film) {
            let keep = Keep {
                film: path.as_deref().map(|path| (path, Duration::from_secs_f64(options.checkpoint_s))),
                provenance: Some(&provenance),
                preview: None,
            };
            let share = Share::TileRange(tiles.clone());
            if !fill_with_progress(&renderer, &share, &mut film, None, quiet, &keep)? {
                let mend = match &options.film {
                    Some(folder) => format!("go on with --resume --film {}", folder.display()),
                    None => "what was rendered is lost; with --film FOLDER it is kept".into(),
                };
                eprintln!(
                    "stopped within rows {} to {} of {}: no image was written; {mend}",
                    pixel_rows.start,
                    pixel_rows.end - 1,
                    layout.height
                );
                return Ok(ExitCode::from(1));
            }
        }
        picture.add(film, pixel_rows)?;
    }
    drop(renderer);
    picture.write(options, experiment, layout, features, &mut provenance)?;
    Ok(ExitCode::SUCCESS)
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
                "{}: this film holds samples, and a film of this name without samples belongs into a folder of films; move it \
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

/// Images that wait: the components with three for each statistic, or their sum.
fn images(layout: &FilmLayout, components: bool) -> usize {
    if components { layout.components.len() + 3 * layout.statistic_members().len() } else { 1 }
}

/// Rows that are finished.
struct Picture {
    spool: SpooledImage,
    components: bool,
    samples: Vec<u32>,
    /// Sum of all pixels and components, one per wavelength bin.
    sums: Vec<f64>,
}

impl Picture {
    fn add(&mut self, film: Film, rows: Range<usize>) -> Result<(), FormatError> {
        let image = film.into_rows(rows.clone());
        let own = &mut self.samples[rows.start * image.width..rows.end * image.width];
        if image.samples.is_empty() {
            own.fill(image.samples_per_pixel);
        } else {
            own.copy_from_slice(&image.samples);
        }
        if self.components {
            let count = image.components.len();
            for component in 0..count {
                self.spool.add_rows(component, rows.start, image.component(component))?;
            }
            if let Some(statistics) = &image.statistics {
                let (names, plane) = (statistics.names.len(), image.data.len() / count.max(1));
                let kinds = [&statistics.half_a, &statistics.half_b, &statistics.variance];
                for (kind, data) in kinds.into_iter().enumerate() {
                    for (index, data) in data.chunks_exact(plane).enumerate() {
                        self.spool.add_rows(count + kind * names + index, rows.start, data)?;
                    }
                }
            }
        }
        let sum = image.recombine(|_| 1.0);
        drop(image);
        for pixel in sum.data().chunks_exact(self.sums.len()) {
            self.sums.iter_mut().zip(pixel).for_each(|(sum, &value)| *sum += f64::from(value));
        }
        if !self.components {
            self.spool.add_rows(0, rows.start, sum.data())?;
        }
        Ok(())
    }

    fn write(
        self,
        options: &Options,
        experiment: &ResolvedExperiment,
        layout: FilmLayout,
        features: FeatureMaps,
        provenance: &mut Provenance,
    ) -> Result<(), CliError> {
        let pixels = (layout.width * layout.height).max(1) as f64;
        let mean: Vec<f64> = self.sums.iter().map(|sum| sum / pixels).collect();
        let names: Vec<String> = layout.statistic_members().into_iter().map(|(name, _)| name).collect();
        let statistics = (!names.is_empty()).then(|| SampleStatistics {
            of: layout.statistics,
            names,
            half_a: Vec::new(),
            half_b: Vec::new(),
            variance: Vec::new(),
        });
        let least = self.samples.iter().copied().min().unwrap_or(0);
        let even = self.samples.iter().all(|&samples| samples == least);
        let labels = ComponentImage {
            grid: layout.grid,
            width: layout.width,
            height: layout.height,
            components: layout.components,
            data: Vec::new(),
            samples_per_pixel: least,
            samples: if even { Vec::new() } else { self.samples },
            features,
            statistics,
            denoised: None,
        };
        provenance.samples_per_pixel = least;
        options.output.write_spooled(&self.spool, &labels, provenance)?;
        if options.talk.json {
            let mut answer = options.output.describe_with(&labels, &mean);
            answer["experiment_sha256"] = experiment.record.sha256.clone().into();
            answer["film_bytes"] = memory_bytes(&experiment.study.scene, &experiment.study.render).into();
            answer["memory_limit_bytes"] = experiment.study.render.memory_limit_bytes.into();
            answer["peak_memory_bytes"] = peak_memory_bytes().into();
            super::print_json(&answer)?;
        } else if !options.talk.quiet {
            eprintln!("Wrote {}", options.output.out.display());
        }
        Ok(())
    }
}

/// `rows-FIRST-END.film`: rows of tiles, the end excluded.
fn film_name(band: &Range<usize>) -> String {
    format!("rows-{:06}-{:06}.film", band.start, band.end)
}

fn band_of(name: &str) -> Option<Range<usize>> {
    let (start, end) = name.strip_prefix("rows-")?.strip_suffix(".film")?.split_once('-')?;
    Some(start.parse().ok()?..end.parse().ok()?)
}

/// The bands of tile rows: those for which films are there, and between them bands that fit into the memory.
fn bands(options: &Options, layout: &FilmLayout, rows_at_once: usize) -> Result<Vec<Range<usize>>, CliError> {
    let all = layout.tile_rows();
    let mut known = match &options.film {
        Some(folder) if folder.is_dir() => films_in(folder)?
            .iter()
            .filter_map(|path| band_of(&path.file_name()?.to_string_lossy()))
            .collect(),
        _ => Vec::new(),
    };
    known.sort_by_key(|band| band.start);
    let folder = options.film.as_deref().unwrap_or(Path::new("")).display();
    let mut bands: Vec<Range<usize>> = Vec::new();
    let mut next = 0;
    for band in known.into_iter().chain(std::iter::once(all..all)) {
        let last = band.start == all;
        if band.start < next || band.end > all || (band.is_empty() && !last) {
            return Err(CliError::Input(format!(
                "--film {folder}: {} does not fit to the others: the folder holds films of several renders. Name another one",
                film_name(&band)
            )));
        }
        while next < band.start {
            let end = (next + rows_at_once.max(1)).min(band.start);
            bands.push(next..end);
            next = end;
        }
        if band.len() > rows_at_once.max(1) {
            return Err(CliError::Input(format!(
                "--film {folder}: {} holds {} rows of tiles, and {} fit into the limit; raise render.memory_limit_gib to what \
                 the film was begun with",
                film_name(&band),
                band.len(),
                rows_at_once
            )));
        }
        if !last {
            next = band.end;
            bands.push(band);
        }
    }
    Ok(bands)
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
