//! Commands of the program.

use std::ffi::OsString;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use pyo3::prelude::*;

use crate::error::of_session;
use crate::process::{name_program, work};

/// Runs a command of the program in this process and returns what it prints on standard output: `answer(["predict", "--json"])`.
#[pyfunction]
#[pyo3(signature = (arguments, *, threads = None))]
pub(crate) fn answer(
    py: Python<'_>,
    arguments: Vec<OsString>,
    threads: Option<usize>,
) -> PyResult<(String, bool)> {
    let stop = Arc::new(AtomicBool::new(false));
    let own = stop.clone();
    let (ended, raised) = work(
        py,
        threads,
        move || fluorspar_cli::answer_of(arguments, own),
        || stop.store(true, Ordering::SeqCst),
        |_| Ok(()),
    )?;
    match raised.map_or(Ok(ended), Err)? {
        Ok(answer) => Ok((answer.text, answer.succeeded)),
        Err(error) => Err(of_session(py, error)),
    }
}

/// The program `fluorspar` with the arguments of this process; returns its exit code.
#[pyfunction]
pub(crate) fn run_program(py: Python<'_>, arguments: Vec<OsString>) -> PyResult<u8> {
    name_program(py)?;
    let code = py.detach(|| fluorspar_cli::main(arguments, || {}));
    Ok((0..=u8::MAX).find(|number| std::process::ExitCode::from(*number) == code).unwrap_or(1))
}
