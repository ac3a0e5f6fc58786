//! Errors as exceptions.

use std::fmt::Display;

use fluorspar_cli::CommandFailure;
use fluorspar_experiment::ExperimentError;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;
use pyo3::{create_exception, intern};

create_exception!(fluorspar, FluorsparError, PyException, "What Fluorspar can't do, and why.");
create_exception!(
    fluorspar,
    ExperimentFailure,
    FluorsparError,
    "A defect of an experiment, with path, line, field, value, message and known names."
);
create_exception!(
    fluorspar,
    RenderStopped,
    PyKeyboardInterrupt,
    "A render that Ctrl-C ended; `partial` holds what it has."
);

pub(crate) fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    let experiment_error = py.get_type::<ExperimentFailure>();
    experiment_error.setattr("__name__", "ExperimentError")?;
    experiment_error.setattr("__qualname__", "ExperimentError")?;
    module.add("FluorsparError", py.get_type::<FluorsparError>())?;
    module.add("ExperimentError", experiment_error)?;
    module.add("RenderStopped", py.get_type::<RenderStopped>())
}

/// Any error of the physics or of a file.
pub(crate) fn failed(error: impl Display) -> PyErr {
    FluorsparError::new_err(error.to_string())
}

/// The exit code of a command is the attribute `code`.
pub(crate) fn of_command(py: Python<'_>, failure: &CommandFailure) -> PyErr {
    let error = failed(failure);
    match error.value(py).setattr(intern!(py, "code"), failure.code) {
        Ok(()) => error,
        Err(other) => other,
    }
}

/// A defect of an experiment, its parts as attributes.
pub(crate) fn of_experiment(py: Python<'_>, error: &ExperimentError) -> PyErr {
    let details = error.details();
    let raised = ExperimentFailure::new_err(error.to_string());
    let value = raised.value(py);
    let set = || -> PyResult<()> {
        value.setattr("path", &details.source_name)?;
        value.setattr("line", details.line)?;
        value.setattr("entry", details.entry.as_deref())?;
        value.setattr("field", details.field.as_deref())?;
        value.setattr("value", details.value.as_deref())?;
        value.setattr("message", &details.message)?;
        value.setattr("known", &details.known)
    };
    match set() {
        Ok(()) => raised,
        Err(other) => other,
    }
}
