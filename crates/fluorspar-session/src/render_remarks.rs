//! What is said of finished renders, and the experiments that they carry.

use std::path::Path;

use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, parse};

use crate::values::{Override, as_typed, sets};
use crate::{CaptureView, Error, FinishedRender, Job, Result};

/// Warns of an image that proves nothing.
pub fn warn_of_denoised(render: &FinishedRender, job: &Job) {
    if render.labels().denoised.is_some() {
        let warning = format!("{}: this image is denoised: its frames are for display only", render.name());
        job.warn(&[warning.into()]);
    }
}

/// Text of the experiment that an image carries, and the experiment with changes.
///
/// # Errors
/// An image that carries none; a change that can't be made.
pub fn experiment_of(render: &FinishedRender, overrides: &[Override]) -> Result<(String, Experiment)> {
    let text = render.experiment_text()?.to_owned();
    let name = format!("experiment in {}", render.name());
    let parsed = parse(&text, &name, Path::new("."), &sets(overrides));
    Ok((text, parsed.map_err(|error| as_typed(error, overrides))?))
}

/// An error of an experiment with changes, which names them as they were typed.
pub fn as_typed_in_session(error: Error, overrides: &[Override]) -> Error {
    match error {
        Error::Experiment(error) => as_typed(error, overrides).into(),
        other => other,
    }
}

/// Says how exact changed lights and concentrations are.
pub fn say_uncertainty(view: &CaptureView, study: &Study, job: &Job) {
    for (group, error) in &view.light_errors {
        job.status(format!(
            "Light of \"{group}\" changed without a new render: fluorescence within {:.2} % of one, reflected light exact",
            100.0 * error
        ));
    }
    if let Some(found) = &view.uncertainty {
        job.status(format!(
            "Concentrations changed without a new render: exact but for light that fluoresced twice, {:.2} % of the light of its \
             light sources, which may be off by {:.2} % of that light at the very most",
            100.0 * found.share,
            100.0 * found.largest_error
        ));
    }
    if study.concentrations.iter().any(|change| change.painted.is_some()) {
        job.status(
            "A painted mask also scales light that was emitted elsewhere and reflected in its pixels: inside of a mouth some \
             percent (docs/theory.md)",
        );
    }
}
