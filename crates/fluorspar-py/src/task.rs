//! Tasks of the session: keyword arguments to options, answers to records.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use fluorspar_experiment::Warning;
use fluorspar_session::{
    CalibrateOptions, CohortOptions, CompareOptions, CubeOptions, DatasetOptions, Error, Job, Left, Listener,
    PredictOptions, RunOptions, TaskOption, TaskOptions, design, fluorophore, tissue,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::Value;

use crate::error::{as_arguments, of_session};
use crate::experiment::toml_value;
use crate::process::work;

/// Functions that do a task: its name, the struct of its options and what does it.
macro_rules! tasks {
    ($($(#[$help:meta])* $name:ident($options:ty) => $run:path,)+) => {
        $(
            $(#[$help])*
            #[pyfunction]
            #[pyo3(signature = (*, threads = None, **options))]
            fn $name<'py>(
                py: Python<'py>,
                threads: Option<usize>,
                options: Option<&Bound<'py, PyDict>>,
            ) -> PyResult<Bound<'py, PyAny>> {
                let options: $options = options_of(stringify!($name), options)?;
                let answer = done(py, threads, |job| $run(&options, job))?;
                python_value(py, &serde_json::to_value(&answer).map_err(|error| of_session(py, error.into()))?)
            }
        )+

        pub(crate) fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
            $(module.add_function(wrap_pyfunction!($name, module)?)?;)+
            Ok(())
        }
    };
}

tasks! {
    /// Runs an experiment from scene to report.
    run(RunOptions) => fluorspar_session::run,
    /// Calibrates a camera from its frames.
    calibrate(CalibrateOptions) => fluorspar_session::calibrate,
    /// Compares two finished runs.
    compare(CompareOptions) => fluorspar_session::compare,
    /// Examines many people.
    cohort(CohortOptions) => fluorspar_session::cohort,
    /// Writes the light of a capture as a spectral cube.
    cube(CubeOptions) => fluorspar_session::cube,
    /// Writes images of many people with their truth.
    dataset(DatasetOptions) => fluorspar_session::dataset,
    /// Evaluates the designs that a file names.
    design_compare(design::ProblemOptions) => design::compare,
    /// Evaluates all designs of a problem.
    design_sweep(design::SweepOptions) => design::sweep,
    /// Finds the best design.
    design_optimize(design::OptimizeOptions) => design::optimize,
    /// Makes one result of shards of a sweep.
    design_merge(design::MergeOptions) => design::merge,
    /// Writes the scenes that a problem renders as experiments.
    design_scenes(design::ProblemOptions) => design::scenes,
    /// Predicts a flat sample.
    predict(PredictOptions) => fluorspar_session::predict,
    /// Solves a tissue.
    tissue_solve(tissue::SolveOptions) => tissue::solve,
    /// Solves a tissue at several values of a parameter.
    tissue_sweep(tissue::TissueSweepOptions) => tissue::sweep,
    /// Tells from which depths the light of a tissue comes.
    tissue_depth(tissue::DepthOptions) => tissue::depth,
    /// Traces photons through a tissue.
    tissue_monte_carlo(tissue::MonteCarloOptions) => tissue::monte_carlo,
    /// Fits a tissue to spectra.
    tissue_fit(tissue::TissueFitOptions) => tissue::fit,
    /// Fits spectra as sums of fluorophores.
    fit_spectra(fluorophore::FitOptions) => fluorophore::fit,
    /// Begins a study.
    study_init(fluorspar_study::InitOptions) => fluorspar_study::init,
    /// Takes photographs, people and outcomes into a study.
    study_import(fluorspar_study::ImportOptions) => fluorspar_study::import,
    /// Estimates what has no estimate.
    study_analyze(fluorspar_study::AnalyzeStudyOptions) => fluorspar_study::analyze,
    /// The last numbers of people.
    study_query(fluorspar_study::QueryOptions) => fluorspar_study::query,
    /// Says what is normal.
    study_norm(fluorspar_study::NormOptions) => fluorspar_study::norm,
    /// Holds people against norms.
    study_compare(fluorspar_study::AgainstNormOptions) => fluorspar_study::compare,
    /// Writes what may leave the clinic.
    study_export(fluorspar_study::ExportOptions) => fluorspar_study::export,
    /// Checks every file, the log and the index.
    study_verify(fluorspar_study::StudyArgs) => fluorspar_study::verify,
    /// Says what a change of the analysis changed.
    study_drift(fluorspar_study::DriftOptions) => fluorspar_study::drift,
    /// Takes a person out.
    study_withdraw(fluorspar_study::WithdrawOptions) => fluorspar_study::withdraw,
}

/// Keeps the warnings of a task. What is done it does not say: a call returns when it is.
#[derive(Default)]
struct Warnings(Mutex<Vec<Warning>>);

impl Listener for Warnings {
    fn status(&self, _: &str) {}

    fn hears_status(&self) -> bool {
        false
    }

    fn warnings(&self, warnings: &[Warning]) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(warnings);
    }

    fn begin(&self, _: &'static str, _: &'static str, _: Left) -> Box<dyn Fn(f64) + Sync> {
        Box::new(|_| {})
    }
}

/// Does a task while the interpreter goes on, and warns of what it warns of. An exception of a signal stops this task and no other.
pub(crate) fn done<A: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    task: impl FnOnce(&Job) -> Result<A, Error> + Send,
) -> PyResult<A> {
    let (stop, warnings) = (Arc::new(AtomicBool::new(false)), Arc::new(Warnings::default()));
    let job = Job::new(stop.clone(), warnings.clone());
    let (answer, raised) =
        work(py, threads, || task(&job), || stop.store(true, Ordering::SeqCst), |_| Ok(()))?;
    if let Some(raised) = raised {
        return Err(raised);
    }
    let warnings = std::mem::take(&mut *warnings.0.lock().unwrap_or_else(PoisonError::into_inner));
    if !warnings.is_empty() {
        let texts: Vec<String> = warnings.iter().map(|warning| as_arguments(warning.text())).collect();
        py.import("fluorspar._warning")?.call_method1("warn_of", (texts,))?;
    }
    answer.map_err(|error| of_session(py, error))
}

/// The options that keyword arguments give; `None` is as left out.
fn options_of<O: TaskOptions>(task: &str, arguments: Option<&Bound<'_, PyDict>>) -> PyResult<O> {
    let known = O::known();
    let mut table = toml::Table::new();
    for (name, value) in arguments.into_iter().flatten().filter(|(_, value)| !value.is_none()) {
        let name: String = name.extract()?;
        let Some(option) = known.iter().find(|option| option.name == name) else {
            let names: Vec<&str> = known.iter().map(|option| option.name.as_str()).collect();
            return Err(PyTypeError::new_err(format!(
                "{task}() has no argument {name:?}; it has {}",
                names.join(", ")
            )));
        };
        table.insert(name.clone(), as_option(toml_value(&value, &name)?, option));
    }
    let options = |table: &toml::Table| O::deserialize(toml::Value::Table(table.clone()));
    options(&table).map_err(|error| {
        let alone = |(name, value): &(&String, &toml::Value)| {
            options(&toml::Table::from_iter([((*name).clone(), (*value).clone())])).is_err()
        };
        let name = table.iter().find(alone).map_or(task, |(name, _)| name);
        PyTypeError::new_err(format!("{name}: {}", in_words(error.message())))
    })
}

/// A refusal of a value, as those of the package are.
fn in_words(message: &str) -> String {
    let parts = message.strip_prefix("invalid type: ").and_then(|rest| rest.split_once(", expected "));
    let Some((came, wanted)) = parts else { return message.to_owned() };
    let wanted = match wanted {
        "f64" => "a number",
        "u32" | "u64" | "usize" => "a whole number",
        "a boolean" => "True or False",
        "a string" => "a text",
        other => other,
    };
    format!("give {wanted}, not the {came}")
}

/// A value as its option has it: one where a list is wanted is a list of one, a number where a text is wanted its digits, and a
/// dictionary where texts are wanted `NAME=VALUE` for each entry.
fn as_option(value: toml::Value, option: &TaskOption) -> toml::Value {
    let plain = |value: toml::Value| match value {
        toml::Value::String(_) | toml::Value::Table(_) | toml::Value::Array(_) => value,
        other if option.is_text => toml::Value::String(other.to_string()),
        other => other,
    };
    let word = |value: toml::Value| match value {
        toml::Value::String(text) => text,
        other => other.to_string(),
    };
    let entry = |(name, value)| toml::Value::String(format!("{name}={}", word(value)));
    match value {
        toml::Value::Table(table) if option.is_list => {
            toml::Value::Array(table.into_iter().map(entry).collect())
        }
        toml::Value::Array(values) if option.is_list => {
            toml::Value::Array(values.into_iter().map(plain).collect())
        }
        one if option.is_list => toml::Value::Array(vec![plain(one)]),
        other => plain(other),
    }
}

/// An answer in Python: objects are records.
pub(crate) fn python_value<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Null => py.None().into_bound(py),
        Value::Bool(is) => is.into_pyobject(py)?.to_owned().into_any(),
        Value::Number(number) => match (number.as_i64(), number.as_u64()) {
            (Some(whole), _) => whole.into_pyobject(py)?.into_any(),
            (None, Some(whole)) => whole.into_pyobject(py)?.into_any(),
            _ => number.as_f64().into_pyobject(py)?,
        },
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        Value::Array(items) => {
            let items: Vec<_> = items.iter().map(|item| python_value(py, item)).collect::<PyResult<_>>()?;
            PyList::new(py, items)?.into_any()
        }
        Value::Object(entries) => {
            let table = PyDict::new(py);
            for (key, value) in entries {
                table.set_item(key, python_value(py, value)?)?;
            }
            py.import("fluorspar._record")?.getattr("Record")?.call1((table,))?
        }
    })
}
