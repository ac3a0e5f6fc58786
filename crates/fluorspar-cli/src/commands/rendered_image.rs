//! Finished renders, in the words of the command line.

use std::path::Path;

use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, parse};
use fluorspar_session::{CaptureView, FinishedRender, SessionError};

use crate::error::CliError;
use crate::message::Messages;
use crate::values::{Override, as_typed, sets};

/// Warns of an image that proves nothing.
pub(super) fn warn_of_denoised(render: &FinishedRender, messages: Messages) {
    if render.labels().denoised.is_some() {
        let warning = format!("{}: this image is denoised: its frames are for display only", render.name());
        messages.warnings(&[warning.into()]);
    }
}

/// Text of the experiment that an image carries, and the experiment with changes.
pub(super) fn experiment_of(
    render: &FinishedRender,
    overrides: &[Override],
) -> Result<(String, Experiment), CliError> {
    let text = render.experiment_text()?.to_owned();
    let name = format!("experiment in {}", render.name());
    let parsed = parse(&text, &name, Path::new("."), &sets(overrides));
    Ok((text, parsed.map_err(|error| as_typed(error, overrides))?))
}

/// An error of an experiment with changes, which names them as they were typed.
pub(super) fn as_typed_in_session(error: SessionError, overrides: &[Override]) -> CliError {
    match error {
        SessionError::Experiment(error) => as_typed(error, overrides).into(),
        other => other.into(),
    }
}

/// Says how exact changed lights and concentrations are.
pub(super) fn say_uncertainty(view: &CaptureView, study: &Study, messages: Messages) {
    for (group, error) in &view.light_errors {
        messages.status(format!(
            "Light of \"{group}\" changed without a new render: fluorescence within {:.2} % of one, reflected light exact",
            100.0 * error
        ));
    }
    if let Some(found) = &view.uncertainty {
        messages.status(format!(
            "Concentrations changed without a new render: exact but for light that fluoresced twice, {:.2} % of the light of its \
             light sources, which may be off by {:.2} % of that light at the very most",
            100.0 * found.share,
            100.0 * found.largest_error
        ));
    }
    if study.concentrations.iter().any(|change| change.painted.is_some()) {
        messages.status(
            "A painted mask also scales light that was emitted elsewhere and reflected in its pixels: inside of a mouth some \
             percent (docs/theory.md)",
        );
    }
}
