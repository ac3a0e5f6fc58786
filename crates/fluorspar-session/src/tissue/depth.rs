//! From how deep the fluorescence of a tissue comes.

use std::io::Write;
use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::spectral::Curve;
use fluorspar::tissue::{DepthProfile, DiscreteOrdinates, EffectiveTissue};
use fluorspar_format::{Output, Outputs, write_atomically};
use fluorspar_report::figures::light_sources_by_depth;
use serde::{Deserialize, Serialize};

use super::source::{SiteOptions, balanced, find};
use crate::figure_file::FigureFormat;
use crate::options::defaults;
use crate::values::{self, check_range};
use crate::{Error, Job, Result, named_spectra};

/// Wavelengths that are solved, nm.
pub(super) const RANGE_NM: [f64; 2] = [350.0, 750.0];
/// Step between them, nm.
pub(super) const STEP_NM: f64 = 5.0;
/// Shares of the light whose depths are told and drawn.
const SHARES: u32 = 100;

/// Which light of a tissue is looked at.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct DepthOptions {
    /// The tissue.
    #[command(flatten)]
    #[serde(flatten)]
    pub site: SiteOptions,
    /// Light: a name of the catalogue or a CSV file.
    #[arg(long, value_name = "NAME|CSV", default_value = "led_405")]
    pub light: String,
    /// Filter before the sensor: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long, alias = "filter", value_name = "NAME|CSV")]
    pub view_filter: Vec<String>,
    /// Quantum efficiency of the sensor, a name of the catalogue or a CSV file with a column for each channel: one result for each.
    #[arg(long, value_name = "NAME|CSV", default_value = "consumer_rgb_cmos")]
    pub qe: String,
    /// Light of one wavelength instead, nm.
    #[arg(long, value_name = "NM", conflicts_with = "light", value_parser = values::number, allow_negative_numbers = true)]
    pub excitation_nm: Option<f64>,
    /// Wavelength of the fluorescence instead of channels, nm. May be repeated.
    #[arg(long, value_name = "NM", conflicts_with_all = ["qe", "view_filter"], value_parser = values::number,
        allow_negative_numbers = true)]
    pub emission_nm: Vec<f64>,
    /// File of the figure, .svg or .png [default: none].
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,
}

/// Where the light of a tissue comes from.
#[derive(Clone, Debug, Serialize)]
#[serde(transparent)]
pub struct LightOrigins {
    /// Name of the tissue for people.
    #[serde(skip)]
    pub title: String,
    /// Name of the light.
    #[serde(skip)]
    pub light: String,
    /// By channel, or wavelength of the emission.
    pub channels: Vec<LightOrigin>,
}

/// Where the light of one channel comes from.
#[derive(Clone, Debug, Serialize)]
pub struct LightOrigin {
    /// Name of the channel.
    pub channel: String,
    /// Depth above which 5 % of the light arise, um; none without light.
    pub depth_5_um: Option<f64>,
    /// The same of 50 %.
    pub depth_50_um: Option<f64>,
    /// The same of 90 %.
    pub depth_90_um: Option<f64>,
    /// Mean depth, um.
    pub mean_depth_um: Option<f64>,
    /// Share of each layer.
    pub layers: Vec<(String, f64)>,
    /// Depth, um, and the share of the light from above it; not serialized.
    #[serde(skip)]
    pub cumulative: Vec<[f64; 2]>,
}

/// Finds from which depths and layers the fluorescence comes, and draws it into the file of the options.
///
/// # Errors
/// An option out of its range or without a meaning, a tissue that can't be solved, a file that can't be written.
pub fn depth(options: &DepthOptions, job: &Job) -> Result<LightOrigins> {
    for (option, nm) in options
        .excitation_nm
        .iter()
        .map(|nm| ("excitation_nm", nm))
        .chain(options.emission_nm.iter().map(|nm| ("emission_nm", nm)))
    {
        check_inside(option, *nm)?;
    }
    let (title, site) = options.site.resolve()?;
    let figure = options.out.as_deref().map(FigureFormat::of).transpose()?;
    let inputs = options.site.file().into_iter().chain(options.view_filter.iter().map(PathBuf::from));
    let inputs: Vec<PathBuf> = inputs.chain([PathBuf::from(&options.light)]).collect();
    let set = options
        .out
        .as_ref()
        .map(|out| Outputs::new().and(Output::file("--out", out)).reading(&inputs).declare());
    let set = set.transpose()?;

    let (light, channels) = (options.light(job)?, options.channels(job)?);
    let solved =
        EffectiveTissue::new(&balanced(site.tissue(&find)?)?, &wavelengths(), DiscreteOrdinates::DIFFUSE)?;
    let names: Vec<String> = solved.tissue().layers.iter().map(|layer| layer.name.clone()).collect();
    let origin = |(name, channel): &(String, Curve)| {
        origin(name, &solved.depth_of_fluorescence(&light, channel), &names)
    };
    let origins: Vec<LightOrigin> = channels.iter().map(origin).collect();
    if let (Some(out), Some(format), Some(set)) = (&options.out, figure, set) {
        let curves: Vec<(String, Vec<[f64; 2]>)> =
            origins.iter().map(|origin| (origin.channel.clone(), origin.cumulative.clone())).collect();
        let bytes = format.bytes(&light_sources_by_depth(&title, &curves, &solved.tissue().bottoms_um()))?;
        write_atomically(out, |file| file.write_all(&bytes))?;
        set.finish()?;
        job.status(format!("Wrote {}", out.display()));
    }
    Ok(LightOrigins { title, light: options.light_name(), channels: origins })
}

/// The wavelengths that are solved, nm.
pub(super) fn wavelengths() -> Vec<f64> {
    let number = ((RANGE_NM[1] - RANGE_NM[0]) / STEP_NM) as usize;
    (0..=number).map(|i| RANGE_NM[0] + STEP_NM * i as f64).collect()
}

/// Refuses a wavelength that has no room for a [`line`].
pub(super) fn check_inside(option: &str, nm: f64) -> Result<()> {
    check_range(option, nm, [RANGE_NM[0] + STEP_NM, RANGE_NM[1] - STEP_NM], "nm")
}

/// A narrow line.
pub(super) fn line(nm: f64) -> Result<Curve> {
    let curve = Curve::new(vec![nm - STEP_NM, nm, nm + STEP_NM], vec![0.0, 1.0, 0.0]);
    curve.map_err(|error| Error::Input(format!("{nm} nm: {error}")))
}

impl DepthOptions {
    fn light_name(&self) -> String {
        self.excitation_nm.map_or_else(|| named_spectra::label(&self.light), |nm| format!("{nm} nm"))
    }

    /// Photons of the light, of any scale.
    fn light(&self, job: &Job) -> Result<Curve> {
        let energy = self.excitation_nm.map_or_else(|| named_spectra::light(&self.light, job), line)?;
        let [first, last] = RANGE_NM;
        Ok(energy.times(&Curve::from_fn(first, last, |nm| nm)))
    }

    /// Names and weights of photons of the channels.
    fn channels(&self, job: &Job) -> Result<Vec<(String, Curve)>> {
        if !self.emission_nm.is_empty() {
            return self.emission_nm.iter().map(|nm| Ok((format!("{nm} nm"), line(*nm)?))).collect();
        }
        let filter = named_spectra::filters(&self.view_filter, job)?;
        let channels = named_spectra::quantum_efficiency(&self.qe, job)?;
        Ok(channels.into_iter().map(|(name, qe)| (name, qe.times(&filter))).collect())
    }
}

fn origin(channel: &str, profile: &DepthProfile, layers: &[String]) -> LightOrigin {
    let depth = |share: f64| profile.quantile_um(share);
    let cumulative: Vec<[f64; 2]> = (0..=SHARES)
        .filter_map(|i| {
            let share = f64::from(i) / f64::from(SHARES);
            Some([depth(share)?, share])
        })
        .collect();
    LightOrigin {
        channel: channel.into(),
        depth_5_um: depth(0.05),
        depth_50_um: depth(0.5),
        depth_90_um: depth(0.9),
        mean_depth_um: profile.mean_um(),
        layers: layers.iter().cloned().zip(profile.layer_shares.iter().copied()).collect(),
        cumulative,
    }
}
