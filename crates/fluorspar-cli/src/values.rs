//! Numbers on the command line, and errors that name what was typed.

use std::fmt::Display;
use std::str::FromStr;

use fluorspar::experiment::ExperimentError;

use crate::error::CliError;

/// A finite number.
pub(crate) fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err("give a finite number".into()),
        Err(_) => Err("give a number, for instance 0.5".into()),
    }
}

/// A number without sign and fraction.
pub(crate) fn whole<T: FromStr>(text: &str) -> Result<T, String> {
    let text = text.trim();
    text.parse::<T>().map_err(|_| {
        let digits = !text.is_empty() && text.chars().all(|c| c.is_ascii_digit());
        if digits { "this is too large".into() } else { "give a whole number, 0 or more".into() }
    })
}

/// More threads only cost memory: no machine has as many cores.
const MOST_THREADS: usize = 1024;

/// A number of threads.
pub(crate) fn threads(text: &str) -> Result<usize, String> {
    match whole(text) {
        Ok(threads @ 1..=MOST_THREADS) => Ok(threads),
        _ => Err(format!("give a whole number from 1 to {MOST_THREADS}")),
    }
}

/// A number as short as it can be typed.
pub(crate) fn as_text(value: f64) -> String {
    if value == 0.0 || (1e-4..1e9).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

/// Refuses a number outside a range.
pub(crate) fn check_range(
    option: &str,
    value: f64,
    [least, most]: [f64; 2],
    unit: &str,
) -> Result<(), CliError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let (value, least, most) = (as_text(value), as_text(least), as_text(most));
    Err(CliError::Input(format!("{option} {value}: must be between {least} and {most}{unit}")))
}

/// A change of an experiment or sample, and what was typed for it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Override {
    /// `PATH=VALUE`.
    pub(crate) set: String,
    /// The option, where it is not `--set`.
    typed: Option<String>,
}

impl Override {
    /// By `--set`.
    pub(crate) fn set(text: &str) -> Self {
        Self { set: text.into(), typed: None }
    }

    /// A field that has an option of its own.
    pub(crate) fn of_option(path: &str, value: impl Display, typed: String) -> Self {
        Self { set: format!("{path}={value}"), typed: Some(typed) }
    }

    /// A field with a number.
    pub(crate) fn number(path: &str, value: f64, option: &str) -> Self {
        Self::of_option(path, as_text(value), format!("{option} {}", as_text(value)))
    }
}

/// The changes in the form of `--set`.
pub(crate) fn sets(overrides: &[Override]) -> Vec<String> {
    overrides.iter().map(|one| one.set.clone()).collect()
}

/// The same error, about the options that were typed instead of the fields that they stand for.
pub(crate) fn as_typed(error: ExperimentError, overrides: &[Override]) -> ExperimentError {
    let mut details = error.details().clone();
    let of_error = overrides.iter().find(|one| details.source_name == format!("--set {}", one.set));
    let Some((set, typed)) = of_error.and_then(|one| Some((&one.set, one.typed.as_ref()?))) else {
        return error;
    };
    let path = set.split_once('=').map_or(set.as_str(), |(path, _)| path).replace('"', "");
    if details.field.as_ref().is_some_and(|field| field.starts_with(&path)) {
        (details.field, details.value) = (None, None);
    }
    details.source_name.clone_from(typed);
    details.message =
        details.message.replace("relative to the experiment file", "relative to where the program runs");
    details.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_shown_as_they_would_be_typed() {
        let shown = [0.0, 0.5, -3.0, 1e99, 1e-7, 1e6].map(as_text);
        assert_eq!(shown, ["0", "0.5", "-3", "1e99", "1e-7", "1000000"]);
        assert!(shown.iter().all(|text| format!("x = {text}").parse::<toml::Table>().is_ok()));
    }

    #[test]
    fn what_is_no_number_is_told_from_what_is_too_large() {
        assert_eq!(whole::<u32>("7"), Ok(7));
        assert!(whole::<u32>("4294967296").unwrap_err().contains("too large"));
        for text in ["-1", "1.5", "", "abc", "1e3"] {
            assert!(whole::<u32>(text).unwrap_err().contains("whole number"), "{text}");
        }
        for text in ["nan", "inf", "abc", "", "1e999"] {
            assert!(number(text).is_err(), "{text}");
        }
        assert!(threads("0").is_err() && threads("1025").is_err() && threads("2") == Ok(2));
    }
}
