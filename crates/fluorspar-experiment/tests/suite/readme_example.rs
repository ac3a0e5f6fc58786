use std::{path::Path, sync::atomic::AtomicBool};
use fluorspar::{pipeline, render};
use fluorspar_experiment::{parse, resolve};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let text = "format = 1\nbase = \"flat-patch\"";
    let study = resolve(&parse(text, "from code", Path::new("."), &[])?)?.study;
    let control = render::RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let components = render::render(&study.scene, &study.render, &control)?;
    let evaluation = pipeline::evaluate(&study, &components)?;
    println!("{:?}", evaluation.analysis.map(|a| a.analysis.counts));
    Ok(())
}
