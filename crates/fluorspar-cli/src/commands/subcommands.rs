//! Commands that consist of subcommands: `scene tree`, `scene get`.

use std::process::ExitCode;

use crate::error::CliError;

/// The options of a command and its `run`, from a list of its subcommands: the help of each, its name with its options, and what runs it.
macro_rules! subcommands {
    ($($(#[$help:meta])* $name:ident($options:ty) => $run:expr,)+) => {
        /// Options of the command.
        #[derive(Clone, Debug, clap::Args)]
        pub(crate) struct Options {
            #[command(subcommand)]
            action: Action,
        }

        #[derive(Clone, Debug, clap::Subcommand)]
        #[allow(clippy::large_enum_variant, reason = "a program holds one")]
        enum Action {
            $($(#[$help])* $name($options),)+
        }

        pub(crate) fn run(options: &Options) -> Result<std::process::ExitCode, $crate::error::CliError> {
            use $crate::commands::subcommands::Ended;
            let Ended(code) = match &options.action {
                $(Action::$name(options) => Ended::of($run, options)?,)+
            };
            Ok(code)
        }
    };
}

pub(crate) use subcommands;

/// How an action ended that did not fail: with an exit code of its own, or well.
pub(crate) struct Ended(pub(crate) ExitCode);

impl Ended {
    /// Runs an action.
    pub(crate) fn of<O, E: Into<Self>>(
        run: impl FnOnce(&O) -> Result<E, CliError>,
        options: &O,
    ) -> Result<Self, CliError> {
        run(options).map(Into::into)
    }
}

impl From<()> for Ended {
    fn from((): ()) -> Self {
        Self(ExitCode::SUCCESS)
    }
}

impl From<ExitCode> for Ended {
    fn from(code: ExitCode) -> Self {
        Self(code)
    }
}
