//! `fluorspar scene`: tree, get, set, insert, delete, check, convert, view.

mod check;
mod convert;
mod edit;
mod get;
mod source;
mod tree;
mod view;

use crate::commands::subcommands::subcommands;

subcommands! {
    /// List everything that has a name: lights, materials, tissues, parts, captures.
    Tree(tree::Options) => tree::run,
    /// Print the values at paths, defaults included.
    Get(get::Options) => get::run,
    /// Set values by path, and write the scene as a new file.
    Set(edit::SetOptions) => edit::set,
    /// Add entries: lights, objects, materials, lesions; write the scene as a new file.
    Insert(edit::InsertOptions) => edit::insert,
    /// Delete entries and fields by path, and write the scene as a new file.
    Delete(edit::DeleteOptions) => edit::delete,
    /// Check a scene without rendering it, and name what of a scene of pbrt has no counterpart.
    Check(check::Options) => check::run,
    /// Write a scene in the form of another program: as an experiment one of pbrt, for pbrt or glTF any.
    Convert(convert::Options) => convert::run,
    /// Draw a scene without its lights: as clay, by part, by depth, or with the lines of its texture coordinates.
    View(view::Options) => view::run,
}
