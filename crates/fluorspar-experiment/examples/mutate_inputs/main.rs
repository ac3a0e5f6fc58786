//! Feeds damaged files to every reader: `cargo run --release -p fluorspar-experiment --example mutate_inputs`.
//!
//! | option | meaning | default |
//! |---|---|---|
//! | `--executions N` | inputs over all readers | 100 000 |
//! | `--each N` | inputs of each reader, however long it takes to read one | as `--executions` shares them |
//! | `--seed N` | where the random numbers start; equal seeds give equal inputs | 1 |
//! | `--reader TEXT` | only readers whose names contain this text | all |
//! | `--seconds N` | when to stop, done or not | never |
//! | `--keep FOLDER` | where inputs that break a bound are written | nowhere |
//!
//! Each reader starts from valid files. An input is one of them after one to four changes: flipped bits, other bytes, sizes at
//! their extremes, numbers at theirs, ranges removed, repeated, moved or taken from another file, the end cut off. The program
//! counts panics (also those that readers turn into errors), the time on the processor and the memory of each input, prints a
//! table and ends with code 1 where an input panicked, took 3 seconds or 1 GiB.

#![allow(unsafe_code, reason = "an allocator that counts is an unsafe trait")]

mod damage;
mod readers;
mod trials;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use readers::{Outcome, Subjects};
use trials::{Plan, feed};

/// Most time of an input on the processor, seconds.
const MOST_S: f64 = 3.0;

struct Options {
    executions: u64,
    each: Option<u64>,
    seed: u64,
    reader: String,
    seconds: u64,
    keep: Option<PathBuf>,
}

fn options() -> Outcome<Options> {
    let mut options = Options {
        executions: 100_000,
        each: None,
        seed: 1,
        reader: String::new(),
        seconds: u64::MAX,
        keep: None,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or_else(|| format!("{word} needs a value"))?;
        match word.as_str() {
            "--executions" => options.executions = value.parse()?,
            "--each" => options.each = Some(value.parse()?),
            "--seed" => options.seed = value.parse()?,
            "--reader" => options.reader = value,
            "--seconds" => options.seconds = value.parse()?,
            "--keep" => options.keep = Some(value.into()),
            _ => return Err(format!("unknown option {word}").into()),
        }
    }
    Ok(options)
}

#[expect(clippy::print_stdout, reason = "what the example is for")]
fn main() -> Outcome<ExitCode> {
    let options = options()?;
    let folder = tempfile::tempdir()?;
    let mut subjects = Subjects::all(folder.path())?.list;
    subjects.retain(|subject| subject.name.contains(&options.reader));
    let plan = Plan {
        executions: options.executions,
        each: options.each,
        most_s: MOST_S,
        seed: options.seed,
        most_time: Duration::from_secs(options.seconds),
    };
    let reports = feed(&subjects, folder.path(), &plan, options.keep.as_deref())?;

    println!("| reader | executions | read | panics | panics caught | slowest, s | most memory, MiB |");
    println!("|---|---|---|---|---|---|---|");
    for (subject, report) in subjects.iter().zip(&reports) {
        println!(
            "| {} | {} | {} | {} | {} | {:.2} | {} |",
            subject.name,
            report.executions,
            report.read,
            report.panics_escaped,
            report.panics_caught,
            report.slowest_s,
            report.most_bytes >> 20
        );
    }
    println!("{} inputs", reports.iter().map(|report| report.executions).sum::<u64>());
    for (subject, report) in subjects.iter().zip(&reports) {
        report.broken.iter().for_each(|line| println!("{}: {line}", subject.name));
    }
    let good = reports.iter().all(|report| report.broken.is_empty());
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
