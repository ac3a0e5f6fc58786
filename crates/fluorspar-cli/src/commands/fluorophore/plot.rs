//! `fluorspar catalog plot fluorophore`.

use std::f64::consts::PI;
use std::io::Write;
use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::spectral::{Curve, Fluorophore};
use fluorspar_format::{Output, Outputs, write_atomically};
use fluorspar_report::Figure;
use fluorspar_report::figures::{EemMap, PlotCurve, eem_maps, emission};
use fluorspar_session::fluorophore::{FileOptions, load};

use crate::commands::{FigureFormat, beside};
use crate::error::CliError;
use crate::message::Messages;
use crate::named_spectra;

/// Width of a cell of a heat map, nm.
const CELL_NM: f64 = 2.5;
/// Irradiance for which emission is drawn, W/m².
const IRRADIANCE_W_PER_M2: f64 = 1000.0;

/// Options of `catalog plot fluorophore`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Names of the catalogue, or files: matrix CSV, excitation and emission CSV, ISET .mat, .toml with [[fluorophore]] sections.
    #[arg(value_name = "NAME|FILE", required = true)]
    names: Vec<String>,
    /// File of the figure, .svg or .png.
    #[arg(long, value_name = "FILE", default_value = "fluorophores.svg", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// Light that is marked, and under which the emission is drawn, as FILE_emission: a name of the catalogue or a CSV file.
    #[arg(long, value_name = "NAME|CSV")]
    light: Option<String>,
    #[command(flatten)]
    file: FileOptions,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let format = FigureFormat::of(&options.out)?;
    let emission_file = beside(&options.out, "_emission");
    let mut outputs = Outputs::new().and(Output::file("--out", &options.out));
    if options.light.is_some() {
        outputs = outputs.and(Output::file("--out", &emission_file));
    }
    let inputs: Vec<PathBuf> = options.names.iter().chain(&options.light).map(PathBuf::from).collect();
    let set = outputs.reading(&inputs).declare()?;
    let mut fluorophores: Vec<Fluorophore> = Vec::new();
    for name in &options.names {
        fluorophores.extend(load(name, &options.file)?.into_iter().map(|loaded| loaded.fluorophore));
    }
    let light = |name| named_spectra::light(name, &Messages::default().job());
    let light = options.light.as_deref().map(light).transpose()?;

    let mut figures = vec![(options.out.clone(), eem_figure(&fluorophores, light.as_ref()))];
    if let (Some(curve), Some(name)) = (&light, &options.light) {
        figures.push((emission_file, emission_figure(&fluorophores, curve, name)));
    }
    for (path, figure) in &figures {
        let bytes = format.bytes(figure)?;
        write_atomically(path, |file| file.write_all(&bytes))?;
    }
    set.finish()?;
    for (path, _) in &figures {
        Messages::default().status(format!("Wrote {}", path.display()));
    }
    Ok(())
}

/// Wavelengths that hold all ranges, on multiples of 10 nm.
fn hull(ranges: impl Iterator<Item = (f64, f64)>) -> [f64; 2] {
    let (low, high) = ranges.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (c, d)| (a.min(c), b.max(d)));
    [(low / 10.0).floor() * 10.0, (high / 10.0).ceil() * 10.0]
}

fn eem_figure(fluorophores: &[Fluorophore], light: Option<&Curve>) -> Figure {
    let excitation = hull(fluorophores.iter().map(|f| f.excitation_range_nm));
    let emission = hull(fluorophores.iter().map(|f| f.emission_range_nm));
    let cells = |[low, high]: [f64; 2]| ((high - low) / CELL_NM).round().clamp(1.0, 400.0) as usize;
    let size = [cells(excitation), cells(emission)];
    let maps: Vec<EemMap> = fluorophores.iter().map(|f| EemMap::of(f, excitation, emission, size)).collect();
    eem_maps(&maps, light.map(Curve::peak_nm))
}

/// Radiance of each fluorophore at concentration 1 under 1000 W/m² of a light.
fn emission_figure(fluorophores: &[Fluorophore], light: &Curve, name: &str) -> Figure {
    let (first, last) = light.range_nm();
    let light = light.scaled(IRRADIANCE_W_PER_M2 / light.total());
    // In units of 1/(h c): photons = energy * lambda.
    let photons = light.times(&Curve::from_fn(first, last, |nm| nm));
    let [low, high] = hull(fluorophores.iter().map(|f| f.emission_range_nm));
    let nm: Vec<f64> = (0..=(high - low) as usize).map(|i| low + i as f64).collect();
    let curve = |f: &Fluorophore| {
        let exitance = f.eem.photon_exitance(&photons, (low, high));
        let radiance = nm.iter().map(|&x| exitance.at(x) / (x * PI)).collect();
        PlotCurve::new(f.title.clone(), nm.clone(), radiance)
    };
    let curves: Vec<PlotCurve> = fluorophores.iter().map(curve).collect();
    let light = format!("{IRRADIANCE_W_PER_M2} W/m² of {}", named_spectra::label(name));
    let (amount, y) =
        ("each at concentration 1 (the unit of the catalogue)", ["spectral radiance", "W/(sr m² nm)"]);
    emission(&curves, &light, amount, y, None)
}
