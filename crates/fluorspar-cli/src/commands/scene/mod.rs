//! `fluorspar scene`: tree, get, set, insert, delete, check, convert, view.

mod check;
mod convert;
mod edit;
mod get;
mod source;
mod tree;
mod view;

use std::process::ExitCode;

use clap::Subcommand;

use crate::error::CliError;

/// Options of `scene`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    /// List everything that has a name: lights, materials, tissues, parts, captures.
    Tree(tree::Options),
    /// Print the values at paths, defaults included.
    Get(get::Options),
    /// Set values by path, and write the scene as a new file.
    Set(edit::SetOptions),
    /// Add entries: lights, objects, materials, lesions; write the scene as a new file.
    Insert(edit::InsertOptions),
    /// Delete entries and fields by path, and write the scene as a new file.
    Delete(edit::DeleteOptions),
    /// Check a scene without rendering it, and name what of a scene of pbrt has no counterpart.
    Check(check::Options),
    /// Write a scene of pbrt as an experiment file, with its meshes.
    Convert(convert::Options),
    /// Draw a scene without its lights: as clay, by part, by depth, or with the lines of its texture coordinates.
    View(view::Options),
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    match &options.action {
        Action::Tree(options) => tree::run(options)?,
        Action::Get(options) => get::run(options)?,
        Action::Set(options) => edit::set(options)?,
        Action::Insert(options) => edit::insert(options)?,
        Action::Delete(options) => edit::delete(options)?,
        Action::Check(options) => check::run(options)?,
        Action::Convert(options) => convert::run(options)?,
        Action::View(options) => view::run(options)?,
    }
    Ok(ExitCode::SUCCESS)
}
