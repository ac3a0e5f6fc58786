//! Times a design search: preparing the signals of a problem, and designs per second.
//!
//! `design_benchmark [--threads N] [--seconds N]`
//!
//! The problems are those of the catalogue, the ideal one with more edges and apertures. Prints one line of JSON for each: seconds to
//! read the file and solve its tissues, seconds to prepare the signals, designs, designs per second, seconds of a search by exchange with 1000 evaluations.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use fluorspar::design::{DesignSpace, exchange, score_all};
use fluorspar_accel::Allocator;
use fluorspar_experiment::parse_design;
use fluorspar_experiment::preset::{self, PresetKind};
use serde_json::json;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

/// Designs between looks at the clock.
const BATCH: u64 = 256;

/// More choices for the problems of few designs.
const CHANGES: [&str; 2] = [
    "vary.long-pass.long_pass.after_peak_nm=[20.0, 30.0, 40.0, 50.0, 60.0]",
    "vary.aperture.values=[2.0, 2.8, 4.0, 5.6, 8.0]",
];

fn main() -> Result<(), Box<dyn Error>> {
    let (mut threads, mut seconds) = (2usize, 2usize);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value: usize = words.next().ok_or_else(|| format!("{word} needs a value"))?.parse()?;
        match word.as_str() {
            "--threads" => threads = value,
            "--seconds" => seconds = value.max(1),
            _ => return Err(format!("there is no option {word}").into()),
        }
    }
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    for name in preset::names(preset::PresetKind::Design) {
        let changes: Vec<String> =
            if name.starts_with("two-lights") { CHANGES.map(String::from).into() } else { Vec::new() };
        let started = Instant::now();
        let resolved = parse_design(preset::text(PresetKind::Design, name)?, name, Path::new("."), &changes)?;
        let read_s = started.elapsed().as_secs_f64();
        if !resolved.rendered.renders.is_empty() {
            // What takes time there is rendering
            continue;
        }
        let started = Instant::now();
        let space = DesignSpace::new(resolved.problem)?;
        let prepare_s = started.elapsed().as_secs_f64();
        let started = Instant::now();
        let (mut done, mut next) = (0, 0);
        while started.elapsed().as_secs_f64() < seconds as f64 {
            let last = (next + BATCH).min(space.len());
            done += score_all(&space, next..last).len();
            next = if last == space.len() { 0 } else { last };
        }
        let rate = done as f64 / started.elapsed().as_secs_f64();
        let started = Instant::now();
        let searched = exchange(&space, 1, 1000).evaluated.len();
        let exchange_s = started.elapsed().as_secs_f64();
        println!(
            "{}",
            json!({ "problem": name, "threads": threads, "read_s": read_s, "prepare_s": prepare_s, "designs": space.len(),
                "designs_per_s": rate, "exchange_evaluations": searched, "exchange_s": exchange_s })
        );
    }
    Ok(())
}
