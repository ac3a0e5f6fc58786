//! Times channel planes: the weighted sum of a frame, a whole frame of the sensor, the pass over the spectra, and region numbers.
//!
//! `planes_benchmark [--width N] [--height N] [--runs N] [--threads N]`
//!
//! The components are those of the default experiment with made-up radiance: two light groups, of each the reflected light, seven
//! fluorophores and light that fluoresced twice, in 81 bands. Prints one line of JSON: medians of the elapsed time, ms, and the
//! bytes that each step reads.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use fluorspar::image::{Component, ComponentFactors, ComponentImage, LightPath};
use fluorspar::pipeline::{CapturePlanes, SeenComponents};
use fluorspar::sensor::Exposure;
use fluorspar::study::Study;
use fluorspar_accel::Allocator;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, resolve};
use serde_json::json;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

struct Arguments {
    width: usize,
    height: usize,
    runs: usize,
    threads: usize,
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut found = Arguments { width: 320, height: 240, runs: 21, threads: 2 };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value: usize = words.next().ok_or_else(|| format!("{word} needs a value"))?.parse()?;
        match word.as_str() {
            "--width" => found.width = value,
            "--height" => found.height = value,
            "--runs" => found.runs = value.max(1),
            "--threads" => found.threads = value,
            _ => return Err(format!("there is no option {word}").into()),
        }
    }
    Ok(found)
}

/// The default experiment with a sensor of as many pixels as the render.
fn study(width: usize, height: usize) -> Result<Study, Box<dyn Error>> {
    let changes = [
        format!("render.width_px={width}"),
        format!("render.height_px={height}"),
        format!("sensor.columns={width}"),
        format!("sensor.rows={height}"),
        "mouth.detail=0.25".into(),
    ];
    let text = preset::text(PresetKind::Experiment, "oraleye-2021")?;
    Ok(resolve(&parse(text, "oraleye-2021", Path::new("."), &changes)?)?.study)
}

/// Radiance of the order of a mouth's, different in every value.
fn made_up(study: &Study) -> ComponentImage {
    let mut components = Vec::new();
    for group in &study.scene.light_groups {
        components.push(Component::of_group(&group.name, LightPath::Reflected));
        let names = study.scene.fluorophores.iter().map(|fluorophore| fluorophore.name.clone());
        components.extend(names.map(|name| Component::of_group(&group.name, LightPath::Fluorescence(name))));
        components.push(Component::of_group(&group.name, LightPath::MultipleFluorescence));
    }
    let camera = &study.scene.camera;
    let mut image = ComponentImage::zeros(study.scene.grid.clone(), camera.width, camera.height, components);
    for (index, value) in image.data.iter_mut().enumerate() {
        *value = 1e-4 * (1.0 + (index * 7919 % 613) as f32);
    }
    image
}

/// Median of the elapsed time of some runs, ms.
fn median_ms(runs: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            1e3 * start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[runs / 2]
}

fn main() -> Result<(), Box<dyn Error>> {
    let Arguments { width, height, runs, threads } = arguments()?;
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    let study = study(width, height)?;
    let image = made_up(&study);
    let sensor = study.camera.sensor.as_ref().ok_or("the experiment has no sensor")?;
    let planes = CapturePlanes::new(&study, &image)?;
    let factors = ComponentFactors::ones(image.components.len());
    let seen =
        SeenComponents { image: &image, planes: &planes, captures: &study.captures, factors: &factors };
    let capture = study.captures.last().ok_or("the experiment has no capture")?;
    let drive = |component: &Component| capture.frame.drive(&component.light_group);
    let all = |_: &Component| 1.0;
    let pass_ms = median_ms(runs.min(5), || drop(CapturePlanes::new(&study, &image)));
    let sum_ms = median_ms(runs, || drop(seen.film_rates(capture, drive)));
    let sum_all_ms = median_ms(runs, || drop(seen.film_rates(capture, all)));
    let exposure = Exposure { time_s: 0.03, label: "blue".into(), ..Exposure::default() };
    let mut failed = None;
    let frame_ms = median_ms(runs, || {
        let rate = sensor.electron_rate_of(&seen.film_rates(capture, drive), planes.film);
        failed = rate.and_then(|rate| sensor.expose_rate(&rate, &exposure)).err();
    });
    if let Some(error) = failed {
        return Err(error.into());
    }
    println!(
        "{}",
        json!({
            "width": width, "height": height, "threads": threads, "components": image.components.len(),
            "spectra_bytes": 4 * image.data.len(), "planes_bytes": 4 * planes.planes[0].data.len(),
            "pass_over_spectra_ms": pass_ms, "weighted_sum_ms": sum_ms, "weighted_sum_of_all_ms": sum_all_ms,
            "frame_ms": frame_ms,
        })
    );
    Ok(())
}
