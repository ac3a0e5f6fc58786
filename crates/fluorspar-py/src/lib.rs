//! The module `fluorspar._fluorspar`: experiments, renders, frames and commands for Python. Physics and checks are those of the
//! Rust crates; names, units and everything that draws or waits are those of the Python package around it.
//!
//! Every class is frozen, so that threads share its objects; the interpreter runs on while Rust works. Arrays are views of the
//! values where they lie (`view.rs`).

mod analysis;
mod command;
mod components;
mod error;
mod experiment;
mod frame;
mod mesh;
mod planes;
mod png;
mod process;
mod render;
mod task;
mod view;

use pyo3::prelude::*;

/// Simulator of fluorescence cameras: the part of the package `fluorspar` that is written in Rust.
#[pymodule(gil_used = false)]
fn _fluorspar(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    error::add_to(module)?;
    task::add_to(module)?;
    module.add_class::<experiment::Experiment>()?;
    module.add_class::<components::Components>()?;
    module.add_class::<frame::Frame>()?;
    module.add_class::<render::UnfinishedRender>()?;
    module.add_class::<planes::Planes>()?;
    module.add_class::<analysis::FrameAnalysis>()?;
    module.add_function(wrap_pyfunction!(render::render, module)?)?;
    module.add_function(wrap_pyfunction!(components::read_components, module)?)?;
    module.add_function(wrap_pyfunction!(frame::capture, module)?)?;
    module.add_function(wrap_pyfunction!(frame::check_capture, module)?)?;
    module.add_function(wrap_pyfunction!(frame::read_frame, module)?)?;
    module.add_function(wrap_pyfunction!(analysis::analyze, module)?)?;
    module.add_function(wrap_pyfunction!(planes::channel_planes, module)?)?;
    module.add_function(wrap_pyfunction!(mesh::read_mesh, module)?)?;
    module.add_function(wrap_pyfunction!(png::write_png, module)?)?;
    module.add_function(wrap_pyfunction!(experiment::word_of, module)?)?;
    module.add_function(wrap_pyfunction!(command::answer, module)?)?;
    module.add_function(wrap_pyfunction!(command::run_program, module)?)?;
    process::remember();
    Ok(())
}
