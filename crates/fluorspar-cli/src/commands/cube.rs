//! `fluorspar cube`: a written cube, in words.

use fluorspar::units::number_text;
use fluorspar_session::{CubeOptions, WrittenCube, cube};

use super::{Answering, print_json};
use crate::error::CliError;
use crate::message::Messages;

pub(crate) fn run(options: &Answering<CubeOptions>) -> Result<(), CliError> {
    let messages = Messages::default();
    let written = cube(&options.task, &messages.job())?;
    if options.form.json {
        return print_json(&written);
    }
    messages.status(in_words(&written));
    Ok(())
}

fn in_words(written: &WrittenCube) -> String {
    let WrittenCube { files, quantity, unit, size_px: [width, height], wavelength_nm, .. } = written;
    let files: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
    let [first, last] = [wavelength_nm.first(), wavelength_nm.last()]
        .map(|nm| nm.copied().map_or_else(String::new, number_text));
    let light =
        written.capture.as_ref().map_or_else(String::new, |name| format!(" of the capture \"{name}\""));
    let scale = written.mm_per_pixel.map_or_else(String::new, |mm| format!(", {mm:.3} mm per pixel"));
    format!(
        "Wrote {}: {quantity}{light} in {unit}, {width} x {height} pixels{scale}, {} bands from {first} to {last} nm",
        files.join(", "),
        wavelength_nm.len()
    )
}
