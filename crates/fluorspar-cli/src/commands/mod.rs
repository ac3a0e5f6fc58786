//! One file or folder per command, and what several of them share.

pub(crate) mod analyze;
pub(crate) mod calibrate;
pub(crate) mod capture;
pub(crate) mod catalog;
pub(crate) mod check;
pub(crate) mod cite;
pub(crate) mod cohort;
pub(crate) mod compare;
pub(crate) mod completions;
pub(crate) mod cube;
pub(crate) mod dataset;
pub(crate) mod denoise;
pub(crate) mod describe;
pub(crate) mod design;
pub(crate) mod filter;
pub(crate) mod fluorophore;
pub(crate) mod image_output;
pub(crate) mod lens;
pub(crate) mod light_of_capture;
pub(crate) mod merge;
pub(crate) mod mouth;
pub(crate) mod new;
pub(crate) mod pbrt_scene;
pub(crate) mod plot;
pub(crate) mod predict;
pub(crate) mod presets;
pub(crate) mod render;
pub(crate) mod row_bands;
pub(crate) mod run;
pub(crate) mod safety;
pub(crate) mod scene;
pub(crate) mod schema;
pub(crate) mod sensor;
pub(crate) mod sheet;
pub(crate) mod spectra;
pub(crate) mod spectroradiometer;
pub(crate) mod study;
pub(crate) mod subcommands;
pub(crate) mod table;
pub(crate) mod tissue;
pub(crate) mod validate;
pub(crate) mod workbench;

use std::path::{Path, PathBuf};

pub(crate) use fluorspar::quote::shell_word;
pub(crate) use fluorspar_session::FigureFormat;
use fluorspar_session::Job;
pub(crate) use fluorspar_session::values::quoted;
use serde::Serialize;

use crate::args::Answer;
use crate::error::CliError;
use crate::message::{self, Messages};

/// Options of a task, and the form of its answer.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct Answering<O: clap::Args> {
    #[command(flatten)]
    pub(crate) task: O,
    #[command(flatten)]
    pub(crate) form: Answer,
}

impl<O: clap::Args> Answering<O> {
    /// Does a task and prints its answer, as JSON or as `text` has it.
    pub(crate) fn answer<A: Serialize>(
        &self,
        task: impl FnOnce(&O, &Job) -> Result<A, CliError>,
        text: impl FnOnce(&A) -> String,
    ) -> Result<(), CliError> {
        self.print(&task(&self.task, &Messages::default().job())?, text)
    }

    /// Prints an answer, as JSON or as `text` has it.
    pub(crate) fn print<A: Serialize>(
        &self,
        answer: &A,
        text: impl FnOnce(&A) -> String,
    ) -> Result<(), CliError> {
        if self.form.json { print_json(answer) } else { print_text(&text(answer)) }
    }
}

/// Prints a value as JSON on standard output.
pub(crate) fn print_json(value: &impl Serialize) -> Result<(), CliError> {
    let text = serde_json::to_string_pretty(value)?;
    print_text(&text)
}

/// Prints lines on standard output.
pub(crate) fn print_text(text: &str) -> Result<(), CliError> {
    message::answer(text)
        .map_err(|error| CliError::Failed(format!("can't write to standard output: {error}")))
}

/// The same file name with a suffix before its ending.
pub(crate) fn beside(path: &Path, suffix: &str) -> PathBuf {
    let part =
        |part: Option<&std::ffi::OsStr>| part.map(|p| p.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!("{}{suffix}.{}", part(path.file_stem()), part(path.extension())))
}
