//! A built-in experiment with a change: render, evaluate, print the porphyrin fraction.
//!
//! The patch holds 0.1 units of porphyrin beside one unit of bulk, so the fraction should be 0.1 / 1.1 = 0.091.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::pipeline::evaluate;
use fluorspar::render::{RenderControl, render};
use fluorspar_experiment::{parse, resolve};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let text =
        "format = 1\nbase = \"flat-patch\"\n[[light]]\nname = \"blue\"\nstrength.irradiance_w_per_m2 = 500.0";
    let study = resolve(&parse(text, "from code", Path::new("."), &[])?)?.study;

    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let components = render(&study.scene, &study.render, &control)?;
    let analyzed = evaluate(&study, &components)?.analysis.ok_or("no [analysis] section")?;
    let region = analyzed.analysis.mixture.and_then(|mixture| mixture.region).ok_or("no mixture line")?;
    let [low, high] = region.estimate.fraction_interval;
    #[expect(clippy::print_stdout, reason = "what an example is for")]
    {
        println!("porphyrin fraction {:.4} ({low:.4} to {high:.4})", region.estimate.fraction);
    }
    Ok(())
}
