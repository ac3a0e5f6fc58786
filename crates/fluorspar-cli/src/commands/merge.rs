//! `fluorspar merge`: one image from the films of several processes.

use clap::ValueHint;
use fluorspar::image::Film;
use fluorspar::pipeline::image_and_basis;
use fluorspar::render::FIRST_ERROR_CHECK;
use fluorspar_format::{Output, Provenance, check_room, read_film, write_film};
use std::path::PathBuf;

use super::image_output::ImageOutput;
use super::light_of_capture::{APART, CaptureOption, experiment_of_film};
use super::row_bands;
use crate::args::Answer;
use crate::error::CliError;
use crate::message::Messages;

/// Options of `merge`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Films that `render --film` wrote: all shards of one render. A folder means the films in it.
    #[arg(value_name = "FILM", required = true, value_hint = ValueHint::FilePath)]
    films: Vec<PathBuf>,
    /// Film of the whole render, written besides the image, to be given more samples or merged further.
    #[arg(long, value_name = "FILE.film", value_hint = ValueHint::FilePath)]
    film: Option<PathBuf>,
    /// Accept missing shards: pixels without samples stay black, and the bits are not those of the whole.
    #[arg(long)]
    incomplete: bool,
    #[command(flatten)]
    output: ImageOutput,
    #[command(flatten)]
    light: CaptureOption,
    #[command(flatten)]
    answer: Answer,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    options.output.check()?;
    let mut merged: Option<(Film, Option<Provenance>)> = None;
    let films = row_bands::films_of(&options.films)?;
    let mut outputs = options.output.outputs(0).reading(&films);
    if let Some(path) = &options.film {
        outputs = outputs.and(Output::file("--film", path));
    }
    let set = outputs.declare()?;
    let mut wanted = 0;
    for path in &films {
        let next = read_film(path)?;
        wanted = next.provenance.iter().map(|of| of.samples_per_pixel).fold(wanted, u32::max);
        match &mut merged {
            None => merged = Some((next.image, next.provenance)),
            Some((film, _)) => film
                .merge(&next.image)
                .map_err(|error| CliError::Input(format!("{}: {error}", path.display())))?,
        }
    }
    let Some((film, Some(mut provenance))) = merged else {
        return Err(CliError::Input("the films do not say where they come from; render them again".into()));
    };
    let light = options.light.of_film(&provenance)?;
    light.check_sums(options.output.sums())?;
    if !options.incomplete {
        check_complete(&film, (&provenance, wanted), &films)?;
    }
    let has_basis = film.layout().components.iter().any(|c| c.node_nm.is_some());
    if has_basis {
        options.output.check_for_basis()?;
    }
    // Values of an image take half of those of its film.
    check_room(&options.output.out, film.layout().memory_bytes() / 2)?;
    if let Some(path) = &options.film {
        write_film(path, &film, Some(&provenance))?;
    }
    if options.output.sums() {
        light.say(Messages::default(), APART);
    }
    let (image, basis) = image_and_basis(film).map_err(|error| CliError::Input(error.to_string()))?;
    provenance.samples_per_pixel = image.samples_per_pixel;
    options.output.write_with(&image, basis.as_ref(), &provenance, &light)?;
    set.finish()?;
    if options.answer.json {
        super::print_json(&options.output.describe(&image, &light))?;
    } else {
        Messages::default().status(format!("Wrote {}", options.output.out.display()));
    }
    Ok(())
}

/// Every tile must hold samples from the first one on, without a gap, and as many as were wanted of any film unless an error target
/// decided, which it does from some samples on.
fn check_complete(
    film: &Film,
    (provenance, wanted): (&Provenance, u32),
    paths: &[PathBuf],
) -> Result<(), CliError> {
    let experiment = experiment_of_film(provenance)?;
    let adaptive = experiment.is_some_and(|experiment| experiment.file.render.relative_error.is_some());
    let wanted = if adaptive { wanted.min(FIRST_ERROR_CHECK) } else { wanted };
    for (tile, _) in film.tiles() {
        let what = match tile.samples.as_slice() {
            [] => "holds no samples".into(),
            [first, ..] if first.start > 0 => format!("lacks samples 0 to {}", first.start - 1),
            [first, second, ..] => format!("lacks samples {} to {}", first.end, second.start - 1),
            [only] if only.end < wanted => format!("lacks samples {} to {}", only.end, wanted - 1),
            [_] => continue,
        };
        let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
        return Err(CliError::Input(format!(
            "{}: the tile at row {}, column {} {what}: a shard is missing or not finished. Give all of them, finish them with \
             `render --resume`, or add --incomplete",
            names.join(", "),
            tile.row,
            tile.col
        )));
    }
    Ok(())
}
