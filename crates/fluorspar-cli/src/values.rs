//! Numbers on the command line, and errors that name what was typed.

use std::fmt::Display;

use fluorspar::units::number_text;
use fluorspar_experiment::ExperimentError;

use crate::error::CliError;

/// A finite number.
pub(crate) fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err("give a finite number".into()),
        Err(_) => Err("give a number, for instance 0.5".into()),
    }
}

/// A whole number of a range, ends included.
pub(crate) fn whole<T: TryFrom<u64>, const LEAST: u64, const MOST: u64>(text: &str) -> Result<T, String> {
    let number = text.trim().parse::<u64>().ok().filter(|number| (LEAST..=MOST).contains(number));
    number
        .and_then(|number| T::try_from(number).ok())
        .ok_or_else(|| format!("give a whole number from {LEAST} to {MOST}"))
}

/// A seed that an experiment file can hold.
pub(crate) fn seed(text: &str) -> Result<u64, String> {
    whole::<u64, 0, { i64::MAX as u64 }>(text)
}

/// More threads only cost memory: no machine has as many cores.
pub(crate) const MOST_THREADS: u64 = 1024;

/// A number of threads.
pub(crate) fn threads(text: &str) -> Result<usize, String> {
    whole::<usize, 1, MOST_THREADS>(text)
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

/// The same error, with the options that were typed instead of the fields that they set.
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
    fn whole_numbers_outside_a_range_are_told_the_range() {
        assert_eq!(whole::<u32, 1, 9>("7"), Ok(7));
        for text in ["", "-1", "1.5", "1e9", "nan", "0", "10", "18446744073709551616"] {
            assert_eq!(whole::<u32, 1, 9>(text), Err("give a whole number from 1 to 9".into()), "{text}");
        }
    }

    #[test]
    fn numbers_are_finite_and_counts_fit() {
        for text in ["nan", "inf", "abc", "", "1e999"] {
            assert!(number(text).is_err(), "{text}");
        }
        assert!(seed("-1").is_err() && seed("9223372036854775808").is_err() && seed("7") == Ok(7));
        assert!(threads("0").is_err() && threads("1025").is_err() && threads("2") == Ok(2));
    }
}
