//! `fluorspar denoise`: less noise, for display.

use clap::ValueHint;
use fluorspar::pipeline::{DenoiseError, DenoiseSettings, denoise};
use fluorspar::units::number_text;
use fluorspar_format::{check_room, read_component_image};
use std::path::PathBuf;

use super::image_output::{ImageOutput, Storage};
use super::light_of_capture::CaptureLight;
use crate::args::Answer;
use crate::error::CliError;
use crate::message::Messages;
use crate::values;

/// Options of `denoise`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Component image with half-buffers: `render --components --statistics light_groups`. It is left as it is.
    #[arg(value_name = "COMPONENTS.exr", value_hint = ValueHint::FilePath)]
    image: PathBuf,
    /// Radius of the filter, pixels.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = values::whole::<usize, 1, 20>,
        allow_negative_numbers = true)]
    radius: usize,
    /// Differences count from this many standard deviations of the noise on: more is smoother.
    #[arg(long, value_name = "K", default_value_t = 0.45, value_parser = values::number, allow_negative_numbers = true)]
    strength: f64,
    /// File of the component image, .exr or .npy. It is marked as denoised.
    #[arg(long, value_name = "FILE", default_value = "denoised.exr", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// Also write an sRGB preview (PNG).
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    preview: Option<PathBuf>,
    #[command(flatten)]
    answer: Answer,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    // A sum would not say that it is denoised.
    let output = ImageOutput {
        out: options.out.clone(),
        components: true,
        storage: Storage::Full,
        preview: options.preview.clone(),
    };
    output.check()?;
    let set = output.outputs(0).reading(std::slice::from_ref(&options.image));
    let same =
        |a: &PathBuf, b: &PathBuf| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    if same(&options.image, &options.out) {
        return Err(CliError::Input(format!(
            "--out {}: this is the raw image, which must stay; name another file",
            options.out.display()
        )));
    }
    let set = set.declare()?;
    let loaded = read_component_image(&options.image)?;
    let Some(provenance) = loaded.provenance else {
        return Err(CliError::Input(format!(
            "{}: the image does not say where it comes from; render it again",
            options.image.display()
        )));
    };
    check_room(&options.out, 4 * loaded.image.data.len() as u64)?;
    let settings =
        DenoiseSettings { radius: options.radius, strength: options.strength, ..DenoiseSettings::default() };
    let image = denoise(&loaded.image, &settings).map_err(|error| match error {
        DenoiseError::Setting { name, value, low, high } => {
            CliError::Input(format!("--{name} {}: must be between {low} and {high}", number_text(value)))
        }
        error => CliError::Input(format!("{}: {error}", options.image.display())),
    })?;
    output.write(&image, &provenance)?;
    set.finish()?;
    if options.answer.json {
        let mut answer = output.describe(&image, &CaptureLight::default());
        answer["denoised"] = image.denoised.clone().into();
        super::print_json(&answer)?;
    } else {
        let what = format!("Wrote {}: denoised, for display only", options.out.display());
        Messages::default().status(what);
    }
    Ok(())
}
