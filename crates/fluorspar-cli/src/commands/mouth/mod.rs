//! `fluorspar mouth`: meshes, views and people.

mod generate;
mod person;
mod sample;
mod view;

use crate::commands::subcommands::subcommands;

subcommands! {
    /// Write the meshes of one mouth, and print its measured dimensions next to their sources.
    Generate(generate::Options) => generate::run,
    /// Draw a contact sheet of views and poses.
    View(view::Options) => view::run,
    /// Draw people from the population: one experiment file for each, and a table.
    Sample(sample::Options) => sample::run,
}
