//! Experiments.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use fluorspar_experiment::{
    Experiment as Parsed, ResolvedExperiment, check_settings, json_schema, parse, resolve, scene_nodes,
    scene_values,
};
use fluorspar_session::{ExperimentSource, warnings_before_run};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};

use crate::error::{failed, of_experiment, of_session};
use crate::process::{prepare, work_through};

/// An experiment: a text in TOML with changes on top. It never changes; `set` gives another one.
#[pyclass(frozen, module = "fluorspar._fluorspar")]
pub(crate) struct Experiment {
    /// The text, how messages call it, where its relative paths start, and changes `PATH=VALUE`.
    text: String,
    name: String,
    base_dir: PathBuf,
    changes: Vec<String>,
    pub(crate) parsed: Arc<Parsed>,
    /// Whether its settings were checked and found right.
    is_right: AtomicBool,
    /// Made when it is first needed.
    resolved: Mutex<Option<Arc<ResolvedExperiment>>>,
}

/// Values of Python may be nested this deep.
const MOST_LEVELS: usize = 100;

/// What an experiment is made of: text, name, folder and changes.
type Parts = (String, String, PathBuf, Vec<String>);

impl Experiment {
    /// An experiment whose settings are checked: what is found wrong within milliseconds is told now.
    fn checked(
        py: Python<'_>,
        text: String,
        name: String,
        base_dir: PathBuf,
        changes: Vec<String>,
    ) -> PyResult<Self> {
        Self::new(py, text, name, base_dir, changes)?.check_now(py)
    }

    fn check_now(self, py: Python<'_>) -> PyResult<Self> {
        let parsed = &self.parsed;
        py.detach(|| check_settings(parsed)).map_err(|error| of_experiment(py, &error))?;
        self.is_right.store(true, Ordering::Relaxed);
        Ok(self)
    }

    /// Whether another experiment has the same settings: it differs in concentrations and words at most.
    fn has_settings_of(&self, made: &Self) -> bool {
        let mut other = made.parsed.file.clone();
        let own = &self.parsed.file;
        other.concentration.clone_from(&own.concentration);
        other.title.clone_from(&own.title);
        other.description.clone_from(&own.description);
        other == *own
    }

    /// An experiment that is read, and checked when it is first used: what was kept of another process may name files that are gone.
    pub(crate) fn new(
        py: Python<'_>,
        text: String,
        name: String,
        base_dir: PathBuf,
        changes: Vec<String>,
    ) -> PyResult<Self> {
        prepare(py)?;
        let parsed = py.detach(|| parse(&text, &name, &base_dir, &changes));
        let parsed = Arc::new(parsed.map_err(|error| of_experiment(py, &error))?);
        Ok(Self {
            text,
            name,
            base_dir,
            changes,
            parsed,
            is_right: AtomicBool::new(false),
            resolved: Mutex::new(None),
        })
    }

    /// What the experiment means. The first call reads its files and makes its mouth.
    pub(crate) fn resolved(
        &self,
        py: Python<'_>,
        threads: Option<usize>,
    ) -> PyResult<Arc<ResolvedExperiment>> {
        let held = || self.resolved.lock().ok().and_then(|held| held.clone());
        if let Some(resolved) = held() {
            return Ok(resolved);
        }
        let parsed = self.parsed.clone();
        let resolved = work_through(py, threads, move || resolve(&parsed))?;
        let resolved = Arc::new(resolved.map_err(|error| of_experiment(py, &error))?);
        if let Ok(mut held) = self.resolved.lock() {
            *held = Some(resolved.clone());
        }
        Ok(resolved)
    }

    /// The same experiment with more changes.
    fn changed(&self, py: Python<'_>, changes: &[String]) -> PyResult<Self> {
        let changes = [self.changes.as_slice(), changes].concat();
        let made = Self::new(py, self.text.clone(), self.name.clone(), self.base_dir.clone(), changes)?;
        // In a loop over concentrations the settings are checked once
        let is_same = self.has_settings_of(&made);
        if is_same && self.is_right.load(Ordering::Relaxed) {
            made.is_right.store(true, Ordering::Relaxed);
            return Ok(made);
        }
        let made = made.check_now(py)?;
        self.is_right.fetch_or(is_same, Ordering::Relaxed);
        Ok(made)
    }

    pub(crate) fn text(&self) -> &str {
        &self.text
    }
}

#[pymethods]
impl Experiment {
    /// An experiment from its text.
    #[staticmethod]
    #[pyo3(signature = (text, name = "experiment", base_dir = None, changes = None))]
    fn of_text(
        py: Python<'_>,
        text: String,
        name: &str,
        base_dir: Option<PathBuf>,
        changes: Option<Vec<String>>,
    ) -> PyResult<Self> {
        Self::new(py, text, name.into(), base_dir.unwrap_or_else(|| ".".into()), changes.unwrap_or_default())
    }

    /// A built-in experiment by its name, an experiment file, or the experiment in a report.html.
    #[staticmethod]
    fn find(py: Python<'_>, name: &str) -> PyResult<Self> {
        let found = py.detach(|| ExperimentSource::find(Some(name)));
        let found = found.map_err(|error| of_session(py, error))?;
        let base_dir = std::path::absolute(&found.base_dir).unwrap_or_else(|_| Path::new(".").into());
        Self::checked(py, found.text, found.name, base_dir, Vec::new())
    }

    /// An experiment from nested dictionaries, as the file has them.
    #[staticmethod]
    fn of_dict(py: Python<'_>, sections: &Bound<'_, PyDict>) -> PyResult<Self> {
        let value = toml_value(sections.as_any(), "")?;
        let text = toml::to_string(&value).map_err(failed)?;
        // Another process may work elsewhere
        let here = std::path::absolute(".").unwrap_or_else(|_| Path::new(".").into());
        Self::checked(py, text, "dict".into(), here, Vec::new())
    }

    /// The same experiment with one more change, as `--set PATH=VALUE` of the commands.
    fn set(&self, py: Python<'_>, path: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let value = toml_value(value, path)?;
        self.changed(py, &[format!("{path}={value}")])
    }

    /// The same experiment with more changes, as several `--set PATH=VALUE`. They count as one change.
    fn set_all(&self, py: Python<'_>, values: Vec<(String, Bound<'_, PyAny>)>) -> PyResult<Self> {
        let change =
            |(path, value): &(String, Bound<'_, PyAny>)| Ok(format!("{path}={}", toml_value(value, path)?));
        self.changed(py, &values.iter().map(change).collect::<PyResult<Vec<String>>>()?)
    }

    /// The same experiment with the values of nested dictionaries: tables are merged where there are tables, and replace what else
    /// there is. All of them count as one change: what is between them is not checked.
    fn with_sections(&self, py: Python<'_>, sections: &Bound<'_, PyDict>) -> PyResult<Self> {
        let given = toml_value(sections.as_any(), "")?;
        let now = toml::Value::try_from(&self.parsed.file).map_err(failed)?;
        let mut changes = Vec::new();
        changes_of(&given, Some(&now), "", &mut changes);
        self.changed(py, &changes)
    }

    /// The same experiment without what its text or its base has at a path, as `--unset PATH` of the commands.
    fn unset(&self, py: Python<'_>, path: &str) -> PyResult<Self> {
        self.changed(py, &[format!("unset {path}")])
    }

    /// The values at a path, which may hold wildcards, as (path, value) pairs with defaults filled in.
    fn values<'py>(&self, py: Python<'py>, path: &str) -> PyResult<Vec<(String, Bound<'py, PyAny>)>> {
        let found = scene_values(&self.parsed, path).map_err(|error| of_experiment(py, &error))?;
        found.into_iter().map(|found| Ok((found.path, python_value(py, &found.value)?))).collect()
    }

    /// Everything that has a name: (path, kind, summary).
    fn tree(&self, py: Python<'_>) -> PyResult<Vec<(String, String, String)>> {
        let parsed = self.parsed.clone();
        let nodes = work_through(py, None, move || scene_nodes(&parsed))?;
        let nodes = nodes.map_err(|error| of_experiment(py, &error))?;
        Ok(nodes.into_iter().map(|node| (node.path, node.kind, node.summary)).collect())
    }

    /// Checks all that can be checked before rendering, and returns what the experiment warns of.
    fn check(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let resolved = self.resolved(py, None)?;
        Ok(warnings_before_run(&resolved).iter().map(|warning| warning.text().to_string()).collect())
    }

    /// What is odd about the experiment, whatever is done with it.
    #[getter]
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let resolved = self.resolved(py, None)?;
        Ok(resolved.record.warnings.iter().map(|warning| warning.text().to_string()).collect())
    }

    /// The whole experiment as a file: base, changes and defaults written out, paths absolute.
    #[getter]
    fn toml(&self, py: Python<'_>) -> PyResult<String> {
        Ok(self.resolved(py, None)?.record.resolved_toml.clone())
    }

    /// Digest of everything that decides the result.
    #[getter]
    fn sha256(&self, py: Python<'_>) -> PyResult<String> {
        Ok(self.resolved(py, None)?.record.sha256.clone())
    }

    /// Names of its captures.
    #[getter]
    fn captures(&self) -> Vec<String> {
        self.parsed.file.capture.iter().map(|capture| capture.name.clone()).collect()
    }

    /// Name for people.
    #[getter]
    fn title(&self) -> &str {
        &self.parsed.file.title
    }

    /// How messages call it: its file, or the built-in one.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// Changes on top of the text.
    #[getter]
    fn changes(&self) -> Vec<String> {
        self.changes.clone()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts)> {
        let make = py.get_type::<Self>().getattr("of_text")?;
        Ok((make, (self.text.clone(), self.name.clone(), self.base_dir.clone(), self.changes.clone())))
    }

    /// JSON schema of experiment files.
    #[staticmethod]
    fn schema() -> String {
        json_schema().to_string()
    }
}

/// Values of nested tables as changes `PATH=VALUE`. A table goes on where there is one, or nothing, or a list of what has names;
/// anything else it replaces.
fn changes_of(given: &toml::Value, now: Option<&toml::Value>, path: &str, changes: &mut Vec<String>) {
    let is_open = now.is_none_or(|now| match now {
        toml::Value::Array(entries) => entries.iter().all(toml::Value::is_table),
        now => now.is_table(),
    });
    let Some(table) = given.as_table().filter(|table| is_open && (path.is_empty() || !table.is_empty()))
    else {
        changes.push(format!("{path}={given}"));
        return;
    };
    for (key, inner) in table {
        let named = |entry: &&toml::Value| entry.get("name").and_then(toml::Value::as_str) == Some(key);
        let below = now.and_then(|now| match now {
            toml::Value::Array(entries) => entries.iter().find(named),
            _ => now.get(key),
        });
        let dot = if path.is_empty() { "" } else { "." };
        changes_of(inner, below, &format!("{path}{dot}{key}"), changes);
    }
}

/// A value as the command line has it: a text by itself, anything else as in an experiment file.
#[pyfunction]
pub(crate) fn word_of(value: &Bound<'_, PyAny>, name: &str) -> PyResult<String> {
    Ok(match toml_value(value, name)? {
        toml::Value::String(text) => text,
        other => other.to_string(),
    })
}

/// A value of Python as TOML. `path` is for messages.
pub(crate) fn toml_value(value: &Bound<'_, PyAny>, path: &str) -> PyResult<toml::Value> {
    nested_value(value, path, MOST_LEVELS)
}

/// The same within so many levels: a list can contain itself.
fn nested_value(value: &Bound<'_, PyAny>, path: &str, levels: usize) -> PyResult<toml::Value> {
    let Some(levels) = levels.checked_sub(1) else {
        let name = path.split('[').next().unwrap_or_default();
        return Err(PyTypeError::new_err(format!(
            "{name}: it is nested in more than {MOST_LEVELS} levels; a list must not contain itself"
        )));
    };
    if let Some(plain) = scalar(value, path)? {
        return Ok(plain);
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let item = |(i, item): (usize, PyResult<_>)| nested_value(&item?, &format!("{path}[{i}]"), levels);
        return Ok(toml::Value::Array(value.try_iter()?.enumerate().map(item).collect::<PyResult<_>>()?));
    }
    if let Ok(table) = value.cast::<PyDict>() {
        let mut entries = toml::Table::new();
        for (key, value) in table {
            let Ok(key) = key.extract::<String>() else {
                return Err(PyTypeError::new_err(format!("{path}{{{key}: ...}}: give a text as key")));
            };
            let inner = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            entries.insert(key, nested_value(&value, &inner, levels)?);
        }
        return Ok(toml::Value::Table(entries));
    }
    // Paths, arrays and numbers of NumPy, of which a long one gives itself
    for method in ["__fspath__", "tolist"] {
        if let Ok(plain) = value.call_method0(method)
            && !plain.get_type().is(value.get_type())
        {
            return nested_value(&plain, path, levels);
        }
    }
    if value.is_instance(&value.py().import("numbers")?.getattr("Real")?)? {
        return Ok(toml::Value::Float(value.extract()?));
    }
    let kind = value.get_type().name()?;
    Err(PyTypeError::new_err(format!(
        "{path}: a {kind} is no value of an experiment; give a number, a text, a list or a dict"
    )))
}

/// A truth value, a number or a text as TOML; `None` of anything else.
fn scalar(value: &Bound<'_, PyAny>, path: &str) -> PyResult<Option<toml::Value>> {
    Ok(Some(if value.is_instance_of::<PyBool>() {
        toml::Value::Boolean(value.extract()?)
    } else if value.is_instance_of::<PyInt>() {
        let range = || format!("{path} = {value}: must be between {} and {}", i64::MIN, i64::MAX);
        toml::Value::Integer(value.extract().map_err(|_| PyValueError::new_err(range()))?)
    } else if value.is_instance_of::<PyFloat>() {
        toml::Value::Float(value.extract()?)
    } else if let Ok(text) = value.cast::<PyString>() {
        toml::Value::String(text.to_str()?.into())
    } else {
        return Ok(None);
    }))
}

/// A value of TOML in Python.
fn python_value<'py>(py: Python<'py>, value: &toml::Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        toml::Value::String(text) => text.into_pyobject(py)?.into_any(),
        toml::Value::Integer(number) => number.into_pyobject(py)?.into_any(),
        toml::Value::Float(number) => number.into_pyobject(py)?.into_any(),
        toml::Value::Boolean(is) => is.into_pyobject(py)?.to_owned().into_any(),
        toml::Value::Datetime(time) => time.to_string().into_pyobject(py)?.into_any(),
        toml::Value::Array(items) => {
            let items: Vec<_> = items.iter().map(|item| python_value(py, item)).collect::<PyResult<_>>()?;
            PyList::new(py, items)?.into_any()
        }
        toml::Value::Table(entries) => {
            let table = PyDict::new(py);
            for (key, value) in entries {
                table.set_item(key, python_value(py, value)?)?;
            }
            table.into_any()
        }
    })
}
