//! `fluorspar tissue depth`.

use std::io::Write;
use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::spectral::Curve;
use fluorspar::tissue::{DepthProfile, DiscreteOrdinates, EffectiveTissue};
use fluorspar_experiment::preset;
use fluorspar_format::{Output, Outputs, write_atomically};
use fluorspar_report::figures::light_sources_by_depth;
use serde::Serialize;

use super::source::{SiteArgs, find};
use crate::args::Answer;
use crate::commands::table::{align, short};
use crate::commands::{FigureFormat, print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;
use crate::named_spectra;
use crate::values::{self, check_range};

/// Wavelengths that are solved, nm.
const RANGE_NM: [f64; 2] = [350.0, 750.0];
/// Step between them, nm.
const STEP_NM: f64 = 5.0;
/// Shares of the light whose depths are told and drawn.
const SHARES: u32 = 100;

/// Options of `tissue depth`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    #[command(flatten)]
    site: SiteArgs,
    /// Light: a name of the catalogue or a CSV file.
    #[arg(long, value_name = "NAME|CSV", default_value = "led_405")]
    light: String,
    /// Filter before the sensor: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long = "view-filter", alias = "filter", value_name = "NAME|CSV")]
    filter: Vec<String>,
    /// Quantum efficiency of the sensor, a name of the catalogue: one result for each channel.
    #[arg(long, value_name = "NAME", default_value = "consumer_rgb_cmos")]
    qe: String,
    /// Light of one wavelength instead, nm.
    #[arg(long, value_name = "NM", conflicts_with = "light", value_parser = values::number, allow_negative_numbers = true)]
    excitation_nm: Option<f64>,
    /// Wavelength of the fluorescence instead of channels, nm. May be repeated.
    #[arg(long, value_name = "NM", conflicts_with_all = ["qe", "filter"], value_parser = values::number,
        allow_negative_numbers = true)]
    emission_nm: Vec<f64>,
    /// File of the figure, .svg or .png [default: none].
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    out: Option<PathBuf>,
    #[command(flatten)]
    answer: Answer,
}

/// Where the light of one channel comes from.
#[derive(Clone, Debug, Serialize)]
struct Origin {
    channel: String,
    /// Depths above which 5, 50, 90 % of the light arise, um; none without light.
    depth_5_um: Option<f64>,
    depth_50_um: Option<f64>,
    depth_90_um: Option<f64>,
    /// Mean depth, um.
    mean_depth_um: Option<f64>,
    /// Share of each layer.
    layers: Vec<(String, f64)>,
    /// Depth, um, and the share of the light from above it.
    #[serde(skip)]
    cumulative: Vec<[f64; 2]>,
}

pub(super) fn run(options: &Options) -> Result<(), CliError> {
    for (option, nm) in options
        .excitation_nm
        .iter()
        .map(|nm| ("--excitation-nm", nm))
        .chain(options.emission_nm.iter().map(|nm| ("--emission-nm", nm)))
    {
        check_range(option, *nm, [RANGE_NM[0] + STEP_NM, RANGE_NM[1] - STEP_NM], "nm")?;
    }
    let (title, site) = options.site.resolve()?;
    let figure = options.out.as_deref().map(FigureFormat::of).transpose()?;
    let inputs = options.site.file().into_iter().chain(options.filter.iter().map(PathBuf::from));
    let inputs: Vec<PathBuf> = inputs.chain([PathBuf::from(&options.light)]).collect();
    let set = options
        .out
        .as_ref()
        .map(|out| Outputs::new().and(Output::file("--out", out)).reading(&inputs).declare());
    let set = set.transpose()?;

    let (light, channels) = (options.light()?, options.channels()?);
    let number = ((RANGE_NM[1] - RANGE_NM[0]) / STEP_NM) as usize;
    let nm: Vec<f64> = (0..=number).map(|i| RANGE_NM[0] + STEP_NM * i as f64).collect();
    let solved = EffectiveTissue::new(&site.tissue(&find)?, &nm, DiscreteOrdinates::DIFFUSE)?;
    let names: Vec<String> = solved.tissue().layers.iter().map(|layer| layer.name.clone()).collect();
    let origin = |(name, channel): &(String, Curve)| {
        origin(name, &solved.depth_of_fluorescence(&light, channel), &names)
    };
    let origins: Vec<Origin> = channels.iter().map(origin).collect();
    if let (Some(out), Some(format), Some(set)) = (&options.out, figure, set) {
        let curves: Vec<(String, Vec<[f64; 2]>)> =
            origins.iter().map(|origin| (origin.channel.clone(), origin.cumulative.clone())).collect();
        let bytes = format.bytes(&light_sources_by_depth(&title, &curves, &solved.tissue().bottoms_um()))?;
        write_atomically(out, |file| file.write_all(&bytes))?;
        set.finish()?;
        Messages::default().status(format!("Wrote {}", out.display()));
    }
    if options.answer.json {
        print_json(&origins)
    } else {
        print_text(&describe(&title, &options.light_name(), &origins))
    }
}

/// A narrow line.
fn line(nm: f64) -> Result<Curve, CliError> {
    let curve = Curve::new(vec![nm - STEP_NM, nm, nm + STEP_NM], vec![0.0, 1.0, 0.0]);
    curve.map_err(|error| CliError::Input(format!("{nm} nm: {error}")))
}

impl Options {
    fn light_name(&self) -> String {
        self.excitation_nm.map_or_else(|| named_spectra::label(&self.light), |nm| format!("{nm} nm"))
    }

    /// Photons of the light, of any scale.
    fn light(&self) -> Result<Curve, CliError> {
        let energy = self.excitation_nm.map_or_else(|| named_spectra::light(&self.light), line)?;
        let [first, last] = RANGE_NM;
        Ok(energy.times(&Curve::from_fn(first, last, |nm| nm)))
    }

    /// Names and weights of photons of the channels.
    fn channels(&self) -> Result<Vec<(String, Curve)>, CliError> {
        if !self.emission_nm.is_empty() {
            return self.emission_nm.iter().map(|nm| Ok((format!("{nm} nm"), line(*nm)?))).collect();
        }
        let filter = named_spectra::filters(&self.filter)?;
        let channels = preset::quantum_efficiency(&self.qe)?.channels()?;
        Ok(channels.into_iter().map(|(name, qe)| (name, qe.times(&filter))).collect())
    }
}

fn origin(channel: &str, profile: &DepthProfile, layers: &[String]) -> Origin {
    let depth = |share: f64| profile.quantile_um(share);
    let cumulative: Vec<[f64; 2]> = (0..=SHARES)
        .filter_map(|i| {
            let share = f64::from(i) / f64::from(SHARES);
            Some([depth(share)?, share])
        })
        .collect();
    Origin {
        channel: channel.into(),
        depth_5_um: depth(0.05),
        depth_50_um: depth(0.5),
        depth_90_um: depth(0.9),
        mean_depth_um: profile.mean_um(),
        layers: layers.iter().cloned().zip(profile.layer_shares.iter().copied()).collect(),
        cumulative,
    }
}

fn describe(title: &str, light: &str, origins: &[Origin]) -> String {
    let mut head: Vec<String> = ["channel", "mean, um", "5 %", "50 %", "90 %"].map(String::from).to_vec();
    head.extend(
        origins.first().into_iter().flat_map(|origin| origin.layers.iter().map(|(name, _)| name.clone())),
    );
    let mut rows = vec![head];
    for origin in origins {
        let cell = |depth: Option<f64>| depth.map_or_else(|| "-".into(), short);
        let depths = [origin.mean_depth_um, origin.depth_5_um, origin.depth_50_um, origin.depth_90_um];
        let mut row = vec![origin.channel.clone()];
        row.extend(depths.map(cell));
        row.extend(origin.layers.iter().map(|(_, share)| format!("{:.0} %", 100.0 * share)));
        rows.push(row);
    }
    format!(
        "{title}: where the fluorescence of each channel arises under {light}\n\
         Depths, um, above which that share of the light arises; shares by layer\n\n{}",
        align(&rows, &[])
    )
}
