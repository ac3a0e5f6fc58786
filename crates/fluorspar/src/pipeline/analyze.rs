//! From developed frames to chromaticity and porphyrin.

use super::{CapturedFrame, PipelineError};
use crate::analysis::{
    Analysis, AnalysisSettings, ChannelNoise, ChromaticityMap, FluorophoreResponse, MixtureModel,
    PixelSelection, PorphyrinMap, Rectangle, RegionOfInterest, analyse, channel_response,
};
use crate::experiment::{Capture, ResolvedAnalysis, ResolvedExperiment};
use crate::image::ComponentImage;
use crate::render::direct_exitance;
use crate::sensor::Sensor;
use crate::spectral::{Curve, QuantumEfficiency, Radiance, Spectrum};

/// The analysed frame: summary and the maps that it was made from.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalyzedFrame {
    /// Summary.
    pub analysis: Analysis,
    /// Chromaticity of every pixel of the frame.
    pub chromaticity: ChromaticityMap,
    /// Porphyrin fraction of the pixels of the region.
    pub porphyrin: Option<PorphyrinMap>,
    /// The region.
    pub region: PixelSelection,
}

/// Analyses the frame that the experiment names. `None` when it asks for no analysis.
///
/// The responses of the fluorophores are predicted for light that reaches them directly, through the lens with its
/// filters, to the sensor: no image is needed for them.
///
/// # Errors
/// A frame that is not there, a region without pixels, a sensor without R, G and B.
pub fn analyze(
    experiment: &ResolvedExperiment,
    components: Option<&ComponentImage>,
    frames: &[CapturedFrame],
) -> Result<Option<AnalyzedFrame>, PipelineError> {
    let Some(settings) = &experiment.analysis else { return Ok(None) };
    let sensor = experiment.sensor.as_ref().ok_or(PipelineError::Missing("sensor", "[sensor]"))?;
    let no_frame = || PipelineError::NoFrame {
        wanted: settings.frame.clone(),
        known: frames.iter().map(|f| f.raw.label.as_str()).collect::<Vec<_>>().join(", "),
    };
    let frame = frames.iter().find(|f| f.raw.label == settings.frame).ok_or_else(no_frame)?;
    let capture =
        experiment.captures.iter().find(|c| c.frame.label == settings.frame).ok_or_else(no_frame)?;

    let (k, model) = (frame.raw.dn_per_electron, sensor.model());
    let (gain_spread, dark_spread) = (model.image_prnu_percent() / 100.0, k * model.image_dsnu_electrons());
    let noise = ChannelNoise::of_image(&frame.developed, k, gain_spread, dark_spread);
    let mut region = RegionOfInterest::of_parts(settings.parts.iter().cloned());
    if let Some([col, row, width, height]) = settings.rectangle_px.map(|r| r.map(|v| v as usize)) {
        region = region.within(Rectangle { col, row, width, height });
    }
    let analysis_settings = AnalysisSettings { region, noise, noise_threshold: settings.noise_threshold };
    let model = mixture_model(experiment, sensor, capture, settings);
    let image = &frame.developed;
    let (analysis, chromaticity, porphyrin) =
        analyse(image, components, model.as_ref(), None, &analysis_settings)?;
    let region = analysis_settings
        .region
        .select(image.width, image.height, components)
        .map_err(crate::analysis::AnalysisError::from)?;
    Ok(Some(AnalyzedFrame { analysis, chromaticity, porphyrin, region }))
}

/// Spectrum of all lights of a frame, weighted by their drive, any scale; `None` when it is dark.
pub(crate) fn frame_lamp(experiment: &ResolvedExperiment, capture: &Capture) -> Option<Curve> {
    let mut lamp: Option<Curve> = None;
    for light in &experiment.scene.lights {
        let drive = capture.frame.drive(&experiment.scene.light_groups[light.group].name);
        if drive <= 0.0 {
            continue;
        }
        let scaled = light.spectrum.scaled(drive);
        lamp = Some(match lamp {
            None => scaled,
            Some(sum) => {
                let (a, b) = (sum.range_nm(), scaled.range_nm());
                Curve::from_fn(a.0.min(b.0), a.1.max(b.1), |nm| sum.at(nm) + scaled.at(nm))
            }
        });
    }
    lamp
}

fn mixture_model(
    experiment: &ResolvedExperiment,
    sensor: &Sensor,
    capture: &Capture,
    settings: &ResolvedAnalysis,
) -> Option<MixtureModel> {
    let lens = experiment.lens.as_ref()?;
    let lamp = frame_lamp(experiment, capture)?;
    let grid = &experiment.scene.grid;
    let transmittance = lens.transmittance_on(grid);
    let qe = match &capture.filter {
        Some(filter) => sensor.behind(filter).effective_qe(),
        None => sensor.effective_qe(),
    };
    let channel =
        |name: &str| -> Option<Spectrum<QuantumEfficiency>> { Some(qe.on_grid(qe.find(name)?, grid)) };
    let [red, green, blue] = [channel("R")?, channel("G")?, channel("B")?];
    let responses = experiment
        .scene
        .fluorophores
        .iter()
        .filter_map(|fluorophore| {
            let exitance = direct_exitance(&fluorophore.eem, grid, &lamp);
            let seen = exitance.iter().zip(transmittance.values()).map(|(m, t)| m * t).collect();
            let radiance = Spectrum::<Radiance>::from_parts(grid.clone(), seen);
            let rgb_per_amount = channel_response(&radiance, [&red, &green, &blue]).ok()?;
            Some(FluorophoreResponse { name: fluorophore.name.clone(), rgb_per_amount })
        })
        .collect();
    Some(MixtureModel {
        responses,
        bulk_weights: settings.bulk.clone(),
        porphyrin: settings.porphyrin.clone(),
    })
}
