//! Numbers on the command line, and errors that name what was typed.

use std::fmt::Display;
use std::str::FromStr;

use fluorspar::experiment::ExperimentError;
use fluorspar::units::number_text;

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

/// A seed that an experiment file can hold.
pub(crate) fn seed(text: &str) -> Result<u64, String> {
    match whole(text) {
        Ok(seed) if i64::try_from(seed).is_ok() => Ok(seed),
        _ => Err(format!("give a whole number from 0 to {}", i64::MAX)),
    }
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
    let (value, least, most) = (number_text(value), number_text(least), number_text(most));
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
        Self::of_option(path, number_text(value), format!("{option} {}", number_text(value)))
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
    fn what_is_no_number_is_told_from_what_is_too_large() {
        assert_eq!(whole::<u32>("7"), Ok(7));
        assert!(whole::<u32>("4294967296").unwrap_err().contains("too large"));
        for text in ["-1", "1.5", "", "abc", "1e3"] {
            assert!(whole::<u32>(text).unwrap_err().contains("whole number"), "{text}");
        }
        for text in ["nan", "inf", "abc", "", "1e999"] {
            assert!(number(text).is_err(), "{text}");
        }
        assert!(seed("-1").is_err() && seed("9223372036854775808").is_err() && seed("7") == Ok(7));
        assert!(threads("0").is_err() && threads("1025").is_err() && threads("2") == Ok(2));
    }
}
