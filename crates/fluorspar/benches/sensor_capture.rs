//! A 12-megapixel capture of an 81-band irradiance image, beside a plain copy of the same bytes.
//!
//!     cargo bench -p fluorspar --bench sensor_capture
//!
//! `--megapixels N` and `--runs N` (after `--`) change the size and the number of runs. Needs about 8 GiB at 12
//! megapixels: the image and its copy. Peak memory and processor time are read from `/proc/self` and left out where there
//! is none. On a machine with other work the processor time over the number of cores is what the capture itself needs.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "this is a benchmark")]

use std::time::Instant;

use fluorspar::image::SpectralImage;
use fluorspar::sensor::{Exposure, Sensor, SensorModel, SpectralQe};
use fluorspar::spectral::{Curve, Irradiance, WavelengthGrid};
use rayon::prelude::*;

fn argument(name: &str, default: usize) -> usize {
    let mut arguments = std::env::args();
    arguments.find(|a| a == name).and_then(|_| arguments.next()).map_or(default, |n| n.parse().unwrap())
}

/// A line of `/proc/self/status`, MiB.
fn memory_mib(field: &str) -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with(field))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

/// Processor time of all threads of this process so far, s.
fn processor_s() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name, in brackets, may hold spaces; user and system time are the 12th and 13th field behind it, in ticks of
    // 10 ms as the kernel tells them.
    let fields: Vec<&str> = status.rsplit(')').next()?.split_whitespace().collect();
    Some((fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?) / 100.0)
}

fn median(mut seconds: Vec<f64>) -> f64 {
    seconds.sort_by(f64::total_cmp);
    seconds[seconds.len() / 2]
}

/// Medians over runs.
struct Times {
    wall_s: f64,
    processor_s: Option<f64>,
    runs: usize,
}

impl Times {
    fn of(runs: usize, mut run: impl FnMut(usize)) -> Self {
        let (mut wall, mut processor) = (Vec::new(), Vec::new());
        for index in 0..runs {
            let (start, processor_start) = (Instant::now(), processor_s());
            run(index);
            wall.push(start.elapsed().as_secs_f64());
            processor.extend(processor_s().zip(processor_start).map(|(end, start)| end - start));
        }
        let processor_s = (!processor.is_empty()).then(|| median(processor));
        Self { wall_s: median(wall), processor_s, runs }
    }
}

impl std::fmt::Display for Times {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.3} s (median of {})", self.wall_s, self.runs)?;
        match self.processor_s {
            Some(seconds) => write!(f, ", {seconds:.3} s of processor time"),
            None => Ok(()),
        }
    }
}

fn main() {
    let (megapixels, runs) = (argument("--megapixels", 12), argument("--runs", 5).max(1));
    // Four columns to three rows, even numbers.
    let rows = (megapixels as f64 * 1e6 / 12.0).sqrt().round() as usize / 2 * 6;
    let columns = rows / 3 * 4;
    let grid = WavelengthGrid::default();
    let mut light = SpectralImage::<Irradiance>::zeros(grid.clone(), columns, rows);
    let bands = light.bands();
    // Around 1000 electrons in 30 ms, rising along each row.
    light.data_mut().par_chunks_exact_mut(bands).enumerate().for_each(|(pixel, spectrum)| {
        spectrum.fill(5e-4 * (0.5 + (pixel % columns) as f32 / columns as f32));
    });

    let curve =
        |peak_nm: f64| Curve::from_fn(350.0, 750.0, |nm| 0.5 * (-((nm - peak_nm) / 60.0).powi(2)).exp());
    let qe =
        SpectralQe::from_curves([("R", curve(610.0)), ("G", curve(540.0)), ("B", curve(460.0))]).unwrap();
    let model = SensorModel {
        columns,
        rows,
        post_gain_noise_mv: 0.1,
        column_offset_mv: 0.1,
        column_gain_percent: 0.1,
        row_offset_mv: 0.1,
        column_noise_mv: 0.1,
        row_noise_mv: 0.1,
        hot_pixels_per_million: 100.0,
        dead_pixels_per_million: 10.0,
        dark_current_log_spread: 0.5,
        ..SensorModel::default()
    };
    let sensor = Sensor::new(model, qe).unwrap();
    let bytes = light.data().len() * 4;
    let threads = rayon::current_num_threads();
    println!("{columns} x {rows} pixels, {bands} bands, {:.2} GB, {threads} threads", bytes as f64 / 1e9);

    let before = memory_mib("VmHWM");
    let capture = Times::of(runs, |frame| {
        let raw = sensor.expose(&light, &Exposure { frame: frame as u64, ..Exposure::default() }).unwrap();
        assert!(raw.data.iter().any(|&dn| dn > 64));
    });
    println!("capture with all noise   {capture}");
    if let (Some(before), Some(after)) = (before, memory_mib("VmHWM")) {
        let output = (columns * rows * 2) as f64 / f64::from(1 << 20);
        println!(
            "memory of the capture    {:.1} MiB beside the input of {before:.0} MiB; the output has {output:.1} MiB",
            after - before
        );
    }
    let mut copy = vec![0f32; light.data().len()];
    let chunk = 1 << 20;
    let plain = Times::of(runs, |_| {
        copy.par_chunks_mut(chunk)
            .zip(light.data().par_chunks(chunk))
            .for_each(|(to, from)| to.copy_from_slice(from));
    });
    assert_eq!(copy[copy.len() / 2], light.data()[copy.len() / 2]);
    println!("plain copy               {plain}");
    println!("ratio                    {:.2}", capture.wall_s / plain.wall_s);
}
