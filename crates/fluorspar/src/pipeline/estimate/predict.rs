//! A flat sample without geometry: light, filters, reflectance and fluorophores, filters, lens, sensor.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use serde::Serialize;

use super::region_signal::{CameraResponse, MixtureSpectra, PorphyrinEstimate, estimate_porphyrin};
use crate::analysis::sensor_chromaticity;
use crate::sensor::{ElectronRate, Exposure, FlatResponse, SensorProblem};
use crate::spectral::{Curve, Fluorophore, Irradiance, Spectrum, ToolboxEem, Transmittance};
use crate::study::{FlatSample, FluorescenceModel};

/// Radiance that leaves the sample, before any viewing filter, W/(sr m² nm), one value per wavelength.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RadianceSplit {
    /// Reflected light.
    pub reflected: Vec<f64>,
    /// Fluorescence of each fluorophore.
    pub fluorescence: BTreeMap<String, Vec<f64>>,
    /// Everything.
    pub total: Vec<f64>,
}

/// Mean response of one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelPrediction {
    /// Mean photo-electrons of a pixel, those that are joined together, e-, as the light frees them: where the well is full, more than it
    /// holds.
    pub electrons: f64,
    /// The part from reflected light, e-.
    pub electrons_reflected: f64,
    /// The part from each fluorophore, e-.
    pub electrons_fluorescence: BTreeMap<String, f64>,
    /// Mean voltage, V.
    pub volts: f64,
    /// Mean digital number, not rounded.
    pub dn: f64,
    /// Temporal noise of one pixel, DN rms; 0 where it is saturated.
    pub noise_dn: f64,
    /// Whether the mean is saturated.
    pub saturated: bool,
}

/// Sensor chromaticity, Eq. 7 of the paper, from mean photo-electrons.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Chromaticity {
    /// `R / (R + G + B)`.
    pub r: f64,
    /// `G / (R + G + B)`.
    pub g: f64,
}

/// The porphyrin fraction that one pixel's color would give, beside the true one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PredictedPorphyrin {
    /// Name of the porphyrin; all other fluorophores form one unit of bulk.
    pub name: String,
    /// Its true fraction, `a_p / (a_b + a_p)`.
    pub true_fraction: f64,
    /// Estimate from the mixture line; reflected light that leaks through the filters biases it.
    #[serde(flatten)]
    pub measured: PorphyrinEstimate,
}

/// Predicted response of the camera to a flat sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// Bin centers, nm.
    pub wavelength_nm: Vec<f64>,
    /// Irradiance on the sample, W/(m² nm).
    pub irradiance: Vec<f64>,
    /// Radiance from the sample, W/(sr m² nm).
    pub radiance: RadianceSplit,
    /// Irradiance on the sensor on the lens's axis, behind viewing filter and lens, W/(m² nm); null without a lens.
    pub sensor_irradiance: Option<Vec<f64>>,
    /// Exposure time, s; null without a sensor.
    pub exposure_s: Option<f64>,
    /// Response of each channel; empty without a sensor.
    pub channels: BTreeMap<String, ChannelPrediction>,
    /// Chromaticity of all light; null without R, G and B channels, without light or where one of them is saturated.
    pub chromaticity: Option<Chromaticity>,
    /// Chromaticity of each fluorophore alone.
    pub fluorophore_chromaticity: BTreeMap<String, Option<Chromaticity>>,
    /// Reflected over fluorescent electrons, all channels together; null without fluorescence.
    pub leak_ratio: Option<f64>,
    /// Porphyrin fraction from the chromaticity; null without R, G and B, without a porphyrin beside a bulk or where a channel
    /// is saturated.
    pub porphyrin: Option<PredictedPorphyrin>,
    /// Photons emitted between 500 and 700 nm per photon that arrives; null where the model has no physical yields.
    pub photon_yield_500_700: Option<f64>,
}

/// Emission band over which the yield of tissue is usually stated, nm.
const YIELD_BAND_NM: (f64, f64) = (500.0, 700.0);

/// Why a prediction can't be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PredictError {
    /// The exposure can't be used.
    #[error(transparent)]
    Sensor(#[from] SensorProblem),
    /// The toolbox model needs its own grid.
    #[error(
        "the toolbox compatibility mode is defined on 365 to 705 nm by 5 nm only; set spectral.first_nm = 365, \
         spectral.last_nm = 705, spectral.step_nm = 5"
    )]
    ToolboxGrid,
    /// An EEM vanishes on the toolbox's grid.
    #[error("fluorophore \"{0}\" has no emission on 365 to 705 nm, so it can't be normalized to peak 1")]
    NoEmission(String),
}

/// Time and gain of a sample's exposure. An automatic exposure becomes the time that suits the sensor's brightest channel.
fn exposure(sample: &FlatSample, parts: &Parts) -> Result<Exposure, PredictError> {
    let frame = &sample.exposure;
    let mut exposure = Exposure { gain: frame.gain, label: frame.label.clone(), ..Exposure::default() };
    if let Some(milliseconds) = frame.exposure_ms {
        exposure.time_s = milliseconds * 1e-3;
    } else if let (Some(rule), Some(sensor)) = (&frame.auto_exposure, &sample.camera.sensor)
        && let Some(light) = on_film(sample, parts.behind_filter())
    {
        let rates = sensor.flat_electron_rate(&light);
        let mosaic = sensor.mosaic();
        let data = mosaic.pattern.iter().map(|&channel| rates[usize::from(channel)] as f32).collect();
        let cell = ElectronRate { columns: mosaic.cols, rows: mosaic.rows, data };
        exposure.time_s = sensor.auto_exposure_s(&cell, frame.gain, rule)?;
    }
    Ok(exposure)
}

/// Carries light through a flat sample to mean sensor values.
///
/// # Errors
/// An exposure that can't be used, or a toolbox model that does not fit.
pub fn predict(sample: &FlatSample) -> Result<Prediction, PredictError> {
    let parts = parts(sample)?;
    let light = on_film(sample, parts.behind_filter());
    let mut prediction = without_sensor(sample, &parts, light.as_ref());
    let exposure = exposure(sample, &parts)?;
    if let (Some(sensor), Some(lens), Some(light)) = (&sample.camera.sensor, &sample.camera.lens, &light) {
        let mut response = sensor.flat_response(light, &exposure)?;
        let joined = sensor.model().binning.map_or(1.0, |binning| binning.pixels() as f64);
        response.electrons.iter_mut().for_each(|electrons| *electrons *= joined);
        let camera = CameraResponse::new(&lens.equation, sensor, &sample.grid, None);
        let light_s = sensor.frame_light_s(exposure.time_s);
        respond(&mut prediction, &camera, &parts, light_s, &response);
        prediction.exposure_s = Some(exposure.time_s);
        if !response.saturated.contains(&true) {
            prediction.porphyrin = porphyrin(sample, &camera, &parts, light_s);
        }
    }
    Ok(prediction)
}

/// What is known of a sample before a sensor sees it.
fn without_sensor(sample: &FlatSample, parts: &Parts, light: Option<&Spectrum<Irradiance>>) -> Prediction {
    Prediction {
        wavelength_nm: sample.grid.centers_nm(),
        irradiance: parts.irradiance.clone(),
        radiance: RadianceSplit {
            reflected: parts.reflected.clone(),
            fluorescence: parts.fluorescence.iter().cloned().collect(),
            total: parts.total(),
        },
        sensor_irradiance: light.map(|light| light.values().to_vec()),
        exposure_s: None,
        channels: BTreeMap::new(),
        chromaticity: None,
        fluorophore_chromaticity: BTreeMap::new(),
        leak_ratio: None,
        porphyrin: None,
        photon_yield_500_700: match sample.model {
            FluorescenceModel::Physical => photon_yield(sample, YIELD_BAND_NM),
            FluorescenceModel::Toolbox => None,
        },
    }
}

/// Fills in what the sensor makes of the light.
fn respond(
    prediction: &mut Prediction,
    camera: &CameraResponse,
    parts: &Parts,
    time_s: f64,
    response: &FlatResponse,
) {
    let electrons = |radiance: &[f64], view: &[f64]| camera.electrons(&filtered(radiance, view), time_s);
    // Separate reflected and fluorescent electrons
    let reflected_e = electrons(&parts.reflected, &parts.view_of_reflected);
    let fluorescent_e: Vec<(&String, Vec<f64>)> =
        parts.fluorescence.iter().map(|(name, values)| (name, electrons(values, &parts.view))).collect();
    let names = &response.channels;
    for (c, name) in names.iter().enumerate() {
        let channel = ChannelPrediction {
            electrons: response.electrons[c],
            electrons_reflected: reflected_e[c],
            electrons_fluorescence: fluorescent_e.iter().map(|(n, e)| ((*n).clone(), e[c])).collect(),
            volts: response.volts[c],
            dn: response.dn[c],
            noise_dn: if response.saturated[c] { 0.0 } else { response.noise_dn[c] },
            saturated: response.saturated[c],
        };
        prediction.channels.insert(name.clone(), channel);
    }
    // Compute chromaticities and the leak ratio
    let chromaticity = |electrons: &[f64]| {
        let pick = |name: &str| names.iter().position(|n| n == name).map(|c| electrons[c]);
        let [r, g] = sensor_chromaticity([pick("R")?, pick("G")?, pick("B")?])?;
        Some(Chromaticity { r, g })
    };
    let fluorescent_total: f64 = fluorescent_e.iter().flat_map(|(_, e)| e).sum();
    // A ratio of saturated values is wrong by an unknown amount.
    if !response.saturated.contains(&true) {
        prediction.chromaticity = chromaticity(&response.electrons);
    }
    prediction.fluorophore_chromaticity =
        fluorescent_e.iter().map(|(name, e)| ((*name).clone(), chromaticity(e))).collect();
    prediction.leak_ratio =
        (fluorescent_total > 0.0).then(|| reflected_e.iter().sum::<f64>() / fluorescent_total);
}

/// Porphyrin fraction that the color of one pixel gives: bulk and porphyrin as the sample holds them make the line.
fn porphyrin(
    sample: &FlatSample,
    camera: &CameraResponse,
    parts: &Parts,
    time_s: f64,
) -> Option<PredictedPorphyrin> {
    let name = sample.porphyrin.as_ref()?;
    let (_, amount) = sample.fluorophores.iter().find(|(fluorophore, _)| fluorophore.name == *name)?;
    if *amount <= 0.0 {
        return None;
    }
    let mut bulk = vec![0.0; parts.view.len()];
    for (_, radiance) in parts.fluorescence.iter().filter(|(other, _)| other != name) {
        bulk.iter_mut().zip(filtered(radiance, &parts.view)).for_each(|(sum, l)| *sum += l);
    }
    let (_, radiance) = parts.fluorescence.iter().find(|(other, _)| other == name)?;
    let porphyrin = filtered(radiance, &parts.view).into_iter().map(|l| l / amount).collect();
    let spectra = MixtureSpectra { bulk, porphyrin };
    // A line that can't be drawn gives no fraction; the chromaticities beside it show why.
    let measured = estimate_porphyrin(camera, &spectra, &parts.behind_filter(), time_s, 1.0).ok()??;
    Some(PredictedPorphyrin { name: name.clone(), true_fraction: amount / (1.0 + amount), measured })
}

/// A radiance behind a filter.
fn filtered(radiance: &[f64], transmittance: &[f64]) -> Vec<f64> {
    radiance.iter().zip(transmittance).map(|(l, t)| l * t).collect()
}

/// Irradiance on the film from a radiance behind the view filter; none without a lens.
fn on_film(sample: &FlatSample, filtered: Vec<f64>) -> Option<Spectrum<Irradiance>> {
    let lens = sample.camera.lens.as_ref()?;
    Some(lens.equation.axial_irradiance(&Spectrum::from_parts(sample.grid.clone(), filtered)))
}

/// Photons emitted within a band per photon that arrives within the grid, from fine samples.
fn photon_yield(sample: &FlatSample, band_nm: (f64, f64)) -> Option<f64> {
    let (start, end) = (sample.grid.start_nm(), sample.grid.end_nm());
    // In units of 1/(h c): photons = energy * lambda.
    let photons = sample.irradiance.clipped(start, end).times(&Curve::from_fn(start, end, |nm| nm));
    let incident = photons.total();
    let emitted = |(fluorophore, concentration): &(Fluorophore, f64)| {
        concentration * fluorophore.eem.photon_exitance(&photons, band_nm).total()
    };
    (incident > 0.0).then(|| sample.fluorophores.iter().map(emitted).sum::<f64>() / incident)
}

struct Parts {
    irradiance: Vec<f64>,
    reflected: Vec<f64>,
    fluorescence: Vec<(String, Vec<f64>)>,
    /// Transmittance of the view filter for even light in each band.
    view: Vec<f64>,
    /// The same for the reflected light, which has the spectral shape of its source.
    view_of_reflected: Vec<f64>,
}

impl Parts {
    fn fluorescent(&self) -> impl Iterator<Item = f64> {
        (0..self.reflected.len()).map(|b| self.fluorescence.iter().map(|(_, values)| values[b]).sum::<f64>())
    }

    fn total(&self) -> Vec<f64> {
        self.reflected.iter().zip(self.fluorescent()).map(|(r, f)| r + f).collect()
    }

    /// Radiance behind the view filter.
    fn behind_filter(&self) -> Vec<f64> {
        let fluorescent = self.fluorescent().zip(&self.view).map(|(l, t)| l * t);
        let reflected = self.reflected.iter().zip(&self.view_of_reflected).map(|(l, t)| l * t);
        reflected.zip(fluorescent).map(|(r, f)| r + f).collect()
    }
}

fn parts(sample: &FlatSample) -> Result<Parts, PredictError> {
    match sample.model {
        FluorescenceModel::Physical => Ok(physical_parts(sample)),
        FluorescenceModel::Toolbox => toolbox_parts(sample),
    }
}

/// Products that matter are formed on fine samples and averaged over bins once.
fn physical_parts(sample: &FlatSample) -> Parts {
    let grid = &sample.grid;
    let reflected_light = sample.irradiance.times(&sample.reflectance);
    let reflected = reflected_light.bin_averages(grid);
    let fluorescence = sample
        .fluorophores
        .iter()
        .map(|(fluorophore, concentration)| {
            let exitance = crate::render::direct_exitance(&fluorophore.eem, grid, &sample.irradiance);
            (fluorophore.name.clone(), exitance.iter().map(|m| concentration * m / PI).collect())
        })
        .collect();
    let filter = &sample.camera.view_filter.transmittance;
    Parts {
        irradiance: sample.irradiance.bin_averages(grid),
        reflected: reflected.iter().map(|v| v / PI).collect(),
        fluorescence,
        view: filter.bin_averages(grid),
        view_of_reflected: filter.on_grid_under::<Transmittance>(grid, &reflected_light).values().to_vec(),
    }
}

fn toolbox_parts(sample: &FlatSample) -> Result<Parts, PredictError> {
    let nodes = ToolboxEem::wavelengths_nm();
    let centers = sample.grid.centers_nm();
    if centers.len() != nodes.len() || centers.iter().zip(&nodes).any(|(a, b)| (a - b).abs() > 1e-9) {
        return Err(PredictError::ToolboxGrid);
    }
    let at = |curve: &Curve| -> Vec<f64> { nodes.iter().map(|&nm| curve.at(nm)).collect() };
    let irradiance = at(&sample.irradiance);
    let white = sample.irradiance.scaled(1.0 / PI);
    let reflectance = at(&sample.reflectance);
    let mut fluorescence = Vec::new();
    for (fluorophore, concentration) in &sample.fluorophores {
        let eem = ToolboxEem::from_density(|emission_nm, excitation_nm| {
            fluorophore.eem.unmasked(emission_nm, excitation_nm)
        })
        .ok_or_else(|| PredictError::NoEmission(fluorophore.name.clone()))?;
        let emission = eem.emission(&white).into_iter().map(|value| concentration * value).collect();
        fluorescence.push((fluorophore.name.clone(), emission));
    }
    Ok(Parts {
        reflected: irradiance.iter().zip(&reflectance).map(|(e, r)| e * r / PI).collect(),
        irradiance,
        fluorescence,
        // The toolbox knows spectra at points, not bands.
        view_of_reflected: at(&sample.camera.view_filter.transmittance),
        view: at(&sample.camera.view_filter.transmittance),
    })
}
