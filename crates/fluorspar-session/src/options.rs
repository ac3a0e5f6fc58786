//! Options of tasks: structs whose fields the command line reads as words and other fronts give as values by name.

use std::any::TypeId;

use clap::{ArgAction, Command};
use serde::de::DeserializeOwned;

/// The options of a task: the command line reads them as words, other fronts deserialize them from values by name.
pub trait TaskOptions: clap::Args + DeserializeOwned + Send + Sync {
    /// What options there are.
    fn known() -> Vec<TaskOption> {
        let command = Self::augment_args(Command::new("task"));
        let known = command.get_arguments().map(|option| TaskOption {
            name: option.get_id().to_string(),
            is_list: matches!(option.get_action(), ArgAction::Append),
            is_text: option.get_value_parser().type_id() == TypeId::of::<String>(),
        });
        known.collect()
    }
}

impl<O: clap::Args + DeserializeOwned + Send + Sync> TaskOptions for O {}

/// An option of a task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TaskOption {
    /// Its name.
    pub name: String,
    /// Whether it has several values.
    pub is_list: bool,
    /// Whether its values are texts; a dictionary stands for texts `NAME=VALUE`.
    pub is_text: bool,
}

/// The options with their defaults, each of which stands at its field. What must be given is `-`.
pub(crate) fn defaults<O: clap::Args>() -> O {
    let command = O::augment_args(Command::new("task").no_binary_name(true));
    let required = command.get_positionals().filter(|option| option.is_required_set());
    let words: Vec<&str> = required.map(|_| "-").collect();
    match O::from_arg_matches(&command.get_matches_from(words)) {
        Ok(options) => options,
        Err(error) => error.exit(),
    }
}
