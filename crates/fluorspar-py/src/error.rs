//! Errors as exceptions.

use std::error::Error as _;
use std::fmt::Display;
use std::io;

use fluorspar_experiment::ExperimentError;
use fluorspar_session::{Error, ErrorKind, worded};
use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;
use pyo3::{create_exception, intern};

create_exception!(
    fluorspar,
    FluorsparError,
    PyException,
    "What Fluorspar can't do, and why. Its code is the exit code of the program: 2 where something that was given must be fixed, 1 where the machine or Fluorspar failed, 75 where a command was stopped."
);
create_exception!(
    fluorspar,
    ExperimentFailure,
    FluorsparError,
    "A defect of an experiment.

Attributes:
    path (str): what holds the defect: the file, the name of a built-in experiment, \"dict\", or the change (\"--set PATH=VALUE\").
    line (int | None): line in that file, from 1; None of a change and of what belongs to no line.
    entry (str | None): the entry of a list that holds the field, as messages have it: 'light[0] \"blue\"'.
    field (str | None): the whole path of what is wrong, as Experiment.set takes it: \"light.blue.strength.power_mw\". Of a field that is
        missing or unknown it ends with that one. None where the defect is of no field.
    value (str | None): the value that stands there, as the file has it (a text in quotes), shortened; None where there is none.
    message (str): what is wrong and how to fix it, without place and value.
    known (list[str]): the names that could stand there, where a name is wrong; otherwise empty.

str(error) has all of it in one line, as the program prints it."
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
    let error = py.get_type::<FluorsparError>();
    error.setattr("code", 2)?;
    module.add("FluorsparError", error)?;
    module.add("ExperimentError", experiment_error)?;
    module.add("RenderStopped", py.get_type::<RenderStopped>())
}

/// Any error of the physics or of a file.
pub(crate) fn failed(error: impl Display) -> PyErr {
    FluorsparError::new_err(error.to_string())
}

/// Why a task gives no answer, with the exit code of the program.
pub(crate) fn of_session(py: Python<'_>, error: Error) -> PyErr {
    let code = match error.kind() {
        ErrorKind::Input => 2,
        ErrorKind::Failed => 1,
        ErrorKind::Stopped => 75,
    };
    let raised = match error {
        Error::Experiment(error) => of_experiment(py, &error),
        other if is_missing(&other) => missing(py, as_arguments(&other.to_string())),
        other => failed(as_arguments(&other.to_string())),
    };
    match raised.value(py).setattr(intern!(py, "code"), code) {
        Ok(()) => raised,
        Err(other) => other,
    }
}

/// Whether a file is not there.
fn is_missing(error: &Error) -> bool {
    let sources = std::iter::successors(error.source(), |source| (*source).source());
    sources
        .filter_map(|source| source.downcast_ref::<io::Error>())
        .any(|source| source.kind() == io::ErrorKind::NotFound)
}

/// `fluorspar.MissingFile`, which is a FileNotFoundError, too.
fn missing(py: Python<'_>, message: String) -> PyErr {
    let class = py.import("fluorspar._given").and_then(|module| module.getattr("MissingFile"));
    match class.and_then(|class| class.call1((message,))) {
        Ok(error) => PyErr::from_value(error),
        Err(other) => other,
    }
}

/// A message with its options as arguments of a call.
pub(crate) fn as_arguments(message: &str) -> String {
    worded(message, |name, value| value.map_or_else(|| name.to_owned(), |value| format!("{name}={value}")))
}

/// A defect of an experiment, its parts as attributes.
pub(crate) fn of_experiment(py: Python<'_>, error: &ExperimentError) -> PyErr {
    let details = error.details();
    let raised = ExperimentFailure::new_err(as_arguments(&error.to_string()));
    let value = raised.value(py);
    let set = || -> PyResult<()> {
        value.setattr("path", as_arguments(&details.source_name))?;
        value.setattr("line", details.line)?;
        value.setattr("entry", details.entry.as_deref())?;
        value.setattr("field", details.path.as_deref())?;
        value.setattr("value", details.value.as_deref())?;
        value.setattr("message", &details.message)?;
        value.setattr("known", &details.known)
    };
    match set() {
        Ok(()) => raised,
        Err(other) => other,
    }
}
