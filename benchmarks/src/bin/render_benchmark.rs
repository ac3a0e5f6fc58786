//! Renders a benchmark scene several times with different seeds and prints CPU seconds as one line of JSON.
//!
//! `render_benchmark SCENE [--bands N] [--fluorophores N] [--side N] [--spp N] [--runs N] [--seed N] [--threads N] [--depth N]`
//! `[--images FOLDER] [--export FOLDER]`
//!
//! Bands: 31 (395-705 nm by 10), 69 (365-705 by 5), or N bins of 5 nm centered from 350 nm on. Times are net of
//! set-up: those of N samples less those of one sample, per path of the difference. From two runs on, the relative
//! variance of the pixels of each component, all bands added, is printed as well, mean over pixels, and its product with
//! the CPU seconds: the cost of a component, which does not depend on the number of samples. `--images` writes the image of
//! each run, all components added, as raw little-endian f32 `[row][col][band]`; `--export` writes the scene for other
//! renderers and renders nothing.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

use std::error::Error;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use fluorspar::image::{Component, ComponentImage};
use fluorspar::render::{RenderControl, RenderSettings, render};
use fluorspar::scene::Scene;
use fluorspar::spectral::WavelengthGrid;
use fluorspar_accel::Allocator;
use fluorspar_benchmarks::{BenchmarkScene, MOST_DYES, SceneOptions, cpu_seconds, export};
use serde_json::{Value, json};

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

struct Arguments {
    scene: BenchmarkScene,
    options: SceneOptions,
    samples: u32,
    depth: u32,
    runs: u64,
    seed: u64,
    threads: usize,
    images: Option<PathBuf>,
    export: Option<PathBuf>,
}

fn parse() -> Result<Arguments, Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let names = BenchmarkScene::ALL.map(BenchmarkScene::name).join(", ");
    let name = words.next().ok_or_else(|| format!("name a scene: {names}"))?;
    let scene = BenchmarkScene::ALL.into_iter().find(|s| s.name() == name);
    let scene = scene.ok_or_else(|| format!("there is no scene '{name}'; there are {names}"))?;
    let (mut bands, mut fluorophores, mut side) = (31_usize, 0, 128);
    let (mut samples, mut depth, mut runs, mut seed, mut threads) = (64, 8, 4, 1, 1);
    let (mut images, mut export) = (None, None);
    while let Some(word) = words.next() {
        let value = words.next().ok_or_else(|| format!("{word} needs a value"))?;
        match word.as_str() {
            "--bands" => bands = value.parse()?,
            "--fluorophores" => fluorophores = value.parse()?,
            "--side" => side = value.parse()?,
            "--spp" => samples = value.parse()?,
            "--runs" => runs = value.parse()?,
            "--seed" => seed = value.parse()?,
            "--threads" => threads = value.parse()?,
            "--depth" => depth = value.parse()?,
            "--images" => images = Some(PathBuf::from(value)),
            "--export" => export = Some(PathBuf::from(value)),
            _ => return Err(format!("there is no option {word}").into()),
        }
    }
    if bands == 0 || side == 0 || samples < 2 || runs == 0 || fluorophores > MOST_DYES {
        return Err(
            format!("bands, side and runs start at 1, spp at 2; there are {MOST_DYES} fluorophores").into()
        );
    }
    let grid = match bands {
        31 => WavelengthGrid::uniform(400.0, 700.0, 10.0)?,
        69 => WavelengthGrid::uniform(365.0, 705.0, 5.0)?,
        _ => WavelengthGrid::uniform(350.0, 350.0 + 5.0 * (bands - 1) as f64, 5.0)?,
    };
    let options = SceneOptions { grid, fluorophores, side };
    Ok(Arguments { scene, options, samples, depth, runs, seed, threads, images, export })
}

/// Most memory so far, MiB; 0 where the system does not tell.
fn peak_mib() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}

/// CPU seconds and wall seconds of one render, and its images.
fn measure(
    scene: &Scene,
    arguments: &Arguments,
    samples: u32,
    seed: u64,
) -> Result<(f64, f64, ComponentImage), Box<dyn Error>> {
    let settings = RenderSettings {
        samples_per_pixel: samples,
        max_depth: arguments.depth,
        seed,
        ..RenderSettings::default()
    };
    let stop = AtomicBool::new(false);
    let control = RenderControl { stop: &stop, progress: &|_| {} };
    let wall = Instant::now();
    let before = cpu_seconds(wall);
    let image = render(scene, &settings, &control)?;
    let times = (cpu_seconds(wall) - before, wall.elapsed().as_secs_f64());
    Ok((times.0, times.1, image))
}

/// Sums over runs, for the relative variance of the pixels of each component.
#[derive(Default)]
struct Scatter {
    runs: f64,
    labels: Vec<String>,
    /// `[component][pixel]`: sum and sum of squares.
    sums: Vec<(f64, f64)>,
}

impl Scatter {
    fn add(&mut self, image: &ComponentImage) {
        self.runs += 1.0;
        self.labels = image.components.iter().map(Component::label).collect();
        let bands = image.grid.len();
        let values: Vec<f64> = (0..self.labels.len())
            .flat_map(|component| {
                let all = image.component(component);
                let sum = |pixel: &[f32]| pixel.iter().map(|&v| f64::from(v)).sum();
                all.chunks(bands).map(sum).collect::<Vec<f64>>()
            })
            .collect();
        self.sums.resize(values.len(), (0.0, 0.0));
        for ((sum, squares), value) in self.sums.iter_mut().zip(values) {
            *sum += value;
            *squares += value * value;
        }
    }

    /// Variance of a pixel in one run over the square of its mean, mean over the pixels that are lit.
    fn relative_variance(&self) -> Vec<(&str, f64)> {
        let of_pixel = |&(sum, squares): &(f64, f64)| {
            let mean = sum / self.runs;
            (squares / self.runs - mean * mean) * self.runs / (self.runs - 1.0) / (mean * mean)
        };
        let pixels = self.sums.len() / self.labels.len();
        self.labels
            .iter()
            .zip(self.sums.chunks(pixels))
            .map(|(label, sums)| {
                let lit: Vec<f64> = sums.iter().filter(|(sum, _)| *sum > 0.0).map(of_pixel).collect();
                (label.as_str(), lit.iter().sum::<f64>() / lit.len().max(1) as f64)
            })
            .collect()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = parse()?;
    rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build_global()?;
    let scene = arguments.scene.build(&arguments.options);
    if let Some(folder) = &arguments.export {
        return Ok(export::export(&scene, folder)?);
    }
    let (mut cpu, mut wall, mut setup) = (Vec::new(), Vec::new(), Vec::new());
    let mut scatter = Scatter::default();
    for run in 0..arguments.runs {
        let (base_cpu, base_wall, _) = measure(&scene, &arguments, 1, arguments.seed + 1_000_000 + run)?;
        let (run_cpu, run_wall, image) =
            measure(&scene, &arguments, arguments.samples, arguments.seed + run)?;
        let whole = f64::from(arguments.samples) / f64::from(arguments.samples - 1);
        cpu.push((run_cpu - base_cpu) * whole);
        wall.push((run_wall - base_wall) * whole);
        setup.push(base_cpu);
        scatter.add(&image);
        if let Some(folder) = &arguments.images {
            fs::create_dir_all(folder)?;
            let picture = image.recombine(|_| 1.0);
            let bytes: Vec<u8> = picture.data().iter().copied().flat_map(f32::to_le_bytes).collect();
            fs::write(folder.join(format!("{run}.f32")), bytes)?;
        }
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let paths = f64::from(arguments.samples) * (arguments.options.side * arguments.options.side) as f64;
    let (cpu, wall) = (median(&mut cpu), median(&mut wall));
    let mut report = json!({
            "scene": arguments.scene.name(), "bands": arguments.options.grid.len(),
            "fluorophores": scene.fluorophores.len(), "samples": arguments.samples,
            "side": arguments.options.side, "threads": arguments.threads,
            "cpu_s": cpu, "wall_s": wall, "setup_cpu_s": median(&mut setup),
            "us_per_path": 1e6 * cpu / paths, "peak_mib": peak_mib(),
    });
    if arguments.runs > 1 {
        let variances = scatter.relative_variance();
        let map = |factor: f64| variances.iter().map(|(l, v)| ((*l).into(), json!(v * factor))).collect();
        report["relative_variance"] = Value::Object(map(1.0));
        report["cost"] = Value::Object(map(cpu));
    }
    println!("{report}");
    Ok(())
}
