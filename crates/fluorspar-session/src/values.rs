//! Values of options, and errors that name what was given.

use std::fmt::Display;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use fluorspar::units::{digits_text, number_text};
use fluorspar_experiment::{ExperimentError, PathsFrom};
use serde::Serialize;
use serde::de::value::Error as NoValue;
use serde::de::{DeserializeOwned, IntoDeserializer};

use crate::{Error, Result};

/// A finite number.
pub fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err("give a finite number".into()),
        Err(_) => Err("give a number, for instance 0.5".into()),
    }
}

/// A whole number of a range, ends included.
pub fn whole<T: TryFrom<u64>, const LEAST: u64, const MOST: u64>(text: &str) -> Result<T, String> {
    let number = text.trim().parse::<u64>().ok().filter(|number| (LEAST..=MOST).contains(number));
    number
        .and_then(|number| T::try_from(number).ok())
        .ok_or_else(|| format!("give a whole number from {LEAST} to {MOST}"))
}

/// A seed that an experiment file can hold.
pub fn seed(text: &str) -> Result<u64, String> {
    whole::<u64, 0, { i64::MAX as u64 }>(text)
}

/// More threads only cost memory: no machine has as many cores.
pub const MOST_THREADS: u64 = 1024;

/// One of some values by the name that files have for it.
pub fn choice<T: DeserializeOwned + Clone + Send + Sync + 'static>(
    names: &'static [&'static str],
) -> impl TypedValueParser<Value = T> {
    let value = |name: String| T::deserialize(name.into_deserializer()).map_err(|error: NoValue| error);
    PossibleValuesParser::new(names).try_map(value)
}

/// The name that files have for a value.
pub(crate) fn name_of(value: &impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|name| Some(name.as_str()?.to_owned())).unwrap_or_default()
}

/// A number of threads.
pub fn threads(text: &str) -> Result<usize, String> {
    whole::<usize, 1, MOST_THREADS>(text)
}

/// An amount of memory or of room on a disk, bytes: `8GiB`, `500 MB`, `1000000`.
pub fn size(text: &str) -> Result<u64, String> {
    const UNITS: [(&str, f64); 9] = [
        ("KiB", 1024.0),
        ("MiB", 1_048_576.0),
        ("GiB", 1_073_741_824.0),
        ("TiB", 1_099_511_627_776.0),
        ("kB", 1e3),
        ("MB", 1e6),
        ("GB", 1e9),
        ("TB", 1e12),
        ("B", 1.0),
    ];
    scaled(text, &UNITS)
        .filter(|bytes| (1.0..=1e18).contains(bytes))
        .map(|bytes| bytes as u64)
        .ok_or_else(|| "give a number with kB, MB, GB, TB, KiB, MiB, GiB or TiB, for instance 8GiB".into())
}

/// A time, seconds: `90`, `90s`, `20min`, `1.5h`.
pub fn time(text: &str) -> Result<f64, String> {
    const UNITS: [(&str, f64); 3] = [("min", 60.0), ("h", 3600.0), ("s", 1.0)];
    scaled(text, &UNITS)
        .filter(|seconds| (1e-6..=1e9).contains(seconds))
        .ok_or_else(|| "give seconds, or a number with s, min or h, for instance 20min".into())
}

/// A number with a unit, whose letters may be large or small, or without one.
fn scaled(text: &str, units: &[(&str, f64)]) -> Option<f64> {
    let text = text.trim();
    let of_unit = |(unit, factor): &(&str, f64)| {
        let at = text.len().checked_sub(unit.len())?;
        let (number, end) = text.split_at_checked(at)?;
        end.eq_ignore_ascii_case(unit).then_some((number, *factor))
    };
    let (number, factor) = units.iter().find_map(of_unit).unwrap_or((text, 1.0));
    Some(number.trim().parse::<f64>().ok()? * factor)
}

/// A text as TOML.
pub fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}

/// Four digits, whatever the size.
pub fn short(value: f64) -> String {
    digits_text(value, 4)
}

/// Seconds as people say them.
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round().max(0.0) as u64;
    match whole {
        0..120 => format!("{whole} s"),
        120..7200 => format!("{} min", (whole + 30) / 60),
        _ => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}

/// Comma-separated values: heads, then rows.
pub(crate) fn csv(heads: &str, rows: impl IntoIterator<Item = String>) -> String {
    std::iter::once(heads.to_owned()).chain(rows).map(|row| row + "\n").collect()
}

/// Refuses a number outside a range.
pub fn check_range(option: &str, value: f64, [least, most]: [f64; 2], unit: &str) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let (value, least, most) = (number_text(value), number_text(least), number_text(most));
    Err(Error::Input(format!("⟨{option}={value}⟩: must be between {least} and {most}{unit}")))
}

/// A change of an experiment or sample, and what was typed for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Override {
    /// `PATH=VALUE`, `insert PATH=VALUE` or `unset PATH`.
    pub set: String,
    /// The option, where it is not `--set`.
    typed: Option<String>,
}

impl Override {
    /// By `--set`.
    pub fn set(text: &str) -> Self {
        Self { set: text.into(), typed: None }
    }

    /// By `--unset`.
    pub fn unset(path: &str) -> Self {
        Self { set: format!("unset {path}"), typed: Some(format!("⟨unset={path}⟩")) }
    }

    /// A new entry of a list, by an option of its own.
    pub fn insert(path: &str, value: impl Display, typed: String) -> Self {
        Self { set: format!("insert {path}={value}"), typed: Some(typed) }
    }

    /// The section of the file that it changes.
    pub fn section(&self) -> &str {
        let path = self.set.trim_start_matches("insert ").trim_start_matches("unset ").trim_start();
        path.split(['.', '=', '[']).next().unwrap_or_default().trim_end()
    }

    /// The option that was typed.
    pub fn typed(&self) -> String {
        self.typed.clone().unwrap_or_else(|| format!("⟨set={}⟩", self.set))
    }

    /// A field that has an option of its own.
    pub fn of_option(path: &str, value: impl Display, typed: String) -> Self {
        Self { set: format!("{path}={value}"), typed: Some(typed) }
    }

    /// A field with a number.
    pub fn number(path: &str, value: f64, option: &str) -> Self {
        Self::of_option(path, number_text(value), format!("⟨{option}={}⟩", number_text(value)))
    }
}

/// The changes in the form of `--set`.
pub fn sets(overrides: &[Override]) -> Vec<String> {
    overrides.iter().map(|one| one.set.clone()).collect()
}

/// The same error, with the options that were typed instead of the fields that they set.
pub fn as_typed(error: ExperimentError, overrides: &[Override]) -> ExperimentError {
    let mut details = error.details().clone();
    let Some(blamed) = details.blamed_override else { return error };
    let Some(typed) = overrides.get(blamed.number).and_then(|one| one.typed.as_ref()) else { return error };
    if blamed.sets_field {
        (details.field, details.value) = (None, None);
    }
    details.source_name.clone_from(typed);
    details.paths_from = details.paths_from.map(|_| PathsFrom::WorkingFolder);
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
    fn sizes_and_times_have_units() {
        let sizes = ["8GiB", "1.5 kib", "500 MB", "1000000", "7b", "2tb"].map(|text| size(text).unwrap());
        assert_eq!(sizes, [8 << 30, 1536, 500_000_000, 1_000_000, 7, 2_000_000_000_000]);
        for text in ["", "GiB", "-1GiB", "0", "nan", "8 potatoes", "1e999", "8Gi", "µ"] {
            assert!(size(text).is_err(), "{text}");
        }
        let times = ["90", "90s", "20 min", "1.5h", "0.2"].map(|text| time(text).unwrap());
        assert_eq!(times, [90.0, 90.0, 1200.0, 5400.0, 0.2]);
        assert!(["", "h", "0", "-3s", "inf", "1d"].iter().all(|text| time(text).is_err()));
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
