//! Parts of long work, for several processes: each has a journal.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::Deserialize;

/// One of several processes that share work, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct WorkShard {
    /// Its number.
    pub number: u64,
    /// Number of all.
    pub of: u64,
}

/// Most processes that share work.
const MOST: u64 = 100_000;

impl FromStr for WorkShard {
    type Err = String;

    /// `2/8`, or `auto`: the task of an array of Slurm.
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Self::of_slurm(|name| std::env::var(name).ok());
        }
        let hint =
            "give I/N, the number of this process and of all, for instance 2/8, or auto in a Slurm array";
        let (number, of) = text.split_once('/').ok_or(hint)?;
        let whole = |text: &str| text.trim().parse::<u64>().map_err(|_| hint.to_owned());
        let shard = Self { number: whole(number)?, of: whole(of)? };
        let valid = (1..=MOST).contains(&shard.of) && (1..=shard.of).contains(&shard.number);
        if valid { Ok(shard) } else { Err(hint.into()) }
    }
}

impl WorkShard {
    /// The task of a Slurm array: numbers may start anywhere and have steps.
    fn of_slurm(variable: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        let number = |name: &str| -> Result<u64, String> {
            let text = variable(name).ok_or_else(|| {
                format!("auto takes the variables of a Slurm array, and {name} is not set; submit with --array, or give I/N")
            })?;
            text.trim().parse().map_err(|_| format!("{name} is \"{text}\", which is not a whole number"))
        };
        let optional = |name: &str| if variable(name).is_some() { number(name).map(Some) } else { Ok(None) };
        let (task, count) = (number("SLURM_ARRAY_TASK_ID")?, number("SLURM_ARRAY_TASK_COUNT")?);
        let first = optional("SLURM_ARRAY_TASK_MIN")?.unwrap_or(0);
        let step = optional("SLURM_ARRAY_TASK_STEP")?.unwrap_or(1).max(1);
        let place = task.checked_sub(first).map(|offset| offset / step + 1);
        match place.filter(|place| (1..=count).contains(place)) {
            Some(number) => Ok(Self { number, of: count }),
            None => {
                Err(format!("task {task} is not among the {count} tasks from {first} on by {step}; give I/N"))
            }
        }
    }

    /// Whether a part of the work, counted from 0, is this process's.
    pub(crate) fn holds(self, part: u64) -> bool {
        part % self.of == self.number - 1
    }

    /// The journal of this process beside a folder of results.
    pub(crate) fn journal(self, folder: &Path, sha256: &str) -> PathBuf {
        journal_beside(folder, sha256, &format!(".{}-of-{}", self.number, self.of))
    }
}

impl TryFrom<String> for WorkShard {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl fmt::Display for WorkShard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

/// The journal of work beside a folder of results: its name with an ending. Other work, or the same one changed, has another journal.
pub(crate) fn journal_beside(folder: &Path, sha256: &str, part: &str) -> PathBuf {
    let mut name = folder.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}{part}.journal", &sha256[..8]));
    folder.with_file_name(name)
}

/// The processes whose journals lie beside a folder of results.
pub(crate) fn shards_beside(folder: &Path, sha256: &str) -> Vec<WorkShard> {
    let around = folder.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let start = format!("{}.{}.", folder.file_name().unwrap_or_default().to_string_lossy(), &sha256[..8]);
    let of = |name: &str| -> Option<WorkShard> {
        let part = name.strip_prefix(&start)?.strip_suffix(".journal")?;
        part.replacen("-of-", "/", 1).parse().ok()
    };
    let entries = std::fs::read_dir(around).into_iter().flatten().flatten();
    let mut found: Vec<WorkShard> =
        entries.filter_map(|entry| of(&entry.file_name().to_string_lossy())).collect();
    found.sort_unstable_by_key(|shard| (shard.of, shard.number));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_read_from_text_and_from_slurm() {
        assert_eq!("2/8".parse(), Ok(WorkShard { number: 2, of: 8 }));
        for wrong in ["0/3", "4/3", "x", "1/0", "1/200000", "-1/2"] {
            assert!(wrong.parse::<WorkShard>().is_err(), "{wrong}");
        }
        let slurm = |pairs: &[(&str, &str)]| {
            WorkShard::of_slurm(|name| {
                pairs.iter().find(|(key, _)| name.ends_with(key)).map(|(_, v)| (*v).to_owned())
            })
        };
        assert_eq!(slurm(&[("_ID", "0"), ("_COUNT", "3")]), Ok(WorkShard { number: 1, of: 3 }));
        let strided = [("_ID", "14"), ("_COUNT", "3"), ("_MIN", "10"), ("_STEP", "2")];
        assert_eq!(slurm(&strided), Ok(WorkShard { number: 3, of: 3 }));
        assert!(slurm(&[("_COUNT", "3")]).unwrap_err().contains("SLURM_ARRAY_TASK_ID is not set"));
        assert!(slurm(&[("_ID", "7"), ("_COUNT", "3")]).unwrap_err().contains("not among"));
        let held = |number| (0..7).filter(move |&block| WorkShard { number, of: 3 }.holds(block)).count();
        assert_eq!((held(1), held(2), held(3)), (3, 2, 2));
    }
}
