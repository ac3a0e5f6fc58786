//! `fluorspar filter`: what viewing filters are for.

mod leak;

use crate::commands::subcommands::subcommands;

subcommands! {
    /// Compare reflected light with fluorescence behind the viewing filters of a flat sample.
    Leak(leak::Options) => leak::run,
}
