//! From developed frames to chromaticity and porphyrin.

use rayon::prelude::*;

use super::channel_analysis::{Measured, channel_analysis};
use super::frame_light::frame_light;
use super::region_light::region_light;
use super::spot_separations::compared_spots;
use super::targets::{TargetLabels, measured_targets, noise_of};
use super::tissue_estimate::FamiliesOfFrames;
use crate::analysis::{
    Analysis, AnalysisError, AnalysisSettings, Analyte, BudgetInput, ChannelNoise, ChromaticityMap,
    ErrorBudget, FluorophoreResponse, MixtureModel, PixelAnalysis, PixelSelection, PorphyrinMap, RegionError,
    RegionFraction, RegionLight, analyze_pixels, channel_response, rgb_channels,
};
use crate::image::{ChannelImage, ComponentFactors, ComponentImage};
use crate::pipeline::PipelineError;
use crate::pipeline::capture::film_irradiance::{behind_filter, on_sensor};
use crate::pipeline::capture::{CapturePlanes, CapturedFrame, SeenComponents};
use crate::render::direct_exitance;
use crate::sensor::Sensor;
use crate::spectral::{Curve, QuantumEfficiency, Radiance, Spectrum};
use crate::study::{AnalysisPlan, Capture, LineEnds, RegionPlan, Study};
use crate::tissue::Site;
use crate::warning::Warning;

/// The analyzed frame: summary and the maps that it was made from.
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
    /// Which target each pixel sees; `None` without targets.
    pub targets: Option<TargetLabels>,
}

/// A region beside that of the study's analysis, analyzed.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalyzedRegion {
    /// Its name.
    pub name: String,
    /// What its pixels say, or why no pixel shows it.
    pub analyzed: Result<AnalyzedFrame, RegionError>,
}

impl AnalyzedRegion {
    /// Its name and its analysis, or why no pixel shows it.
    pub fn analysis(&self) -> (&str, Result<&Analysis, &RegionError>) {
        (&self.name, self.analyzed.as_ref().map(|analyzed| &analyzed.analysis))
    }

    /// What its pixels say; `None` where none shows it.
    #[must_use]
    pub fn in_view(&self) -> Option<&AnalyzedFrame> {
        self.analyzed.as_ref().ok()
    }
}

/// Analyzes the frame that the study names. `None` without an analysis.
///
/// The responses of the fluorophores are predicted for the light that reaches the region directly under the lights of
/// the frame (those of a subtracted frame taken off), through the lens with its filters, to the sensor. A component image
/// tells where the region lies, gives the ends of the line the colors that they have at the sensor, by all ways of the light
/// ([`LineEnds::Scene`]), and tells the truth. Without one the light on the camera's axis in the plane of focus stands for that
/// on the region.
///
/// # Errors
/// A frame that is not there, a region without pixels.
pub fn analyze(
    study: &Study,
    components: Option<&ComponentImage>,
    frames: &[CapturedFrame],
) -> Result<Option<AnalyzedFrame>, PipelineError> {
    let Some(image) = components.filter(|_| !study.captures.is_empty()) else {
        return analyze_seen(study, None, frames);
    };
    let planes = CapturePlanes::new(study, image)?;
    let factors = ComponentFactors::ones(image.components.len());
    let seen = SeenComponents { image, planes: &planes, captures: &study.captures, factors: &factors };
    analyze_seen(study, Some(&seen), frames)
}

/// [`analyze`] with the channel planes of a component image.
///
/// # Errors
/// Those of [`analyze`].
pub fn analyze_seen(
    study: &Study,
    components: Option<&SeenComponents<'_>>,
    frames: &[CapturedFrame],
) -> Result<Option<AnalyzedFrame>, PipelineError> {
    study.analysis.as_ref().map(|plan| analyzed(study, plan, components, frames)).transpose()
}

/// Analyzes the regions beside that of the study's analysis, each as an analysis of it alone would. Where a person looks
/// elsewhere a region may be hidden: that is told of it, and the others are analyzed.
///
/// # Errors
/// Those of [`analyze`], with the name of the region, but parts that no pixel shows.
pub fn analyze_regions(
    study: &Study,
    components: Option<&SeenComponents<'_>>,
    frames: &[CapturedFrame],
) -> Result<Vec<AnalyzedRegion>, PipelineError> {
    let region = |region: &RegionPlan| match analyzed(study, &region.analysis, components, frames) {
        Ok(analyzed) => Ok(AnalyzedRegion { name: region.name.clone(), analyzed: Ok(analyzed) }),
        Err(PipelineError::Analysis(AnalysisError::Region(why))) if why.is_out_of_view() => {
            Ok(AnalyzedRegion { name: region.name.clone(), analyzed: Err(why) })
        }
        Err(error) => Err(PipelineError::Region { name: region.name.clone(), error: Box::new(error) }),
    };
    // One after the other: each finds the families of those before
    study.regions.iter().map(region).collect()
}

/// One analysis of the frames of a study.
fn analyzed(
    study: &Study,
    settings: &AnalysisPlan,
    components: Option<&SeenComponents<'_>>,
    frames: &[CapturedFrame],
) -> Result<AnalyzedFrame, PipelineError> {
    let sensor = study.camera.sensor.as_ref().ok_or(PipelineError::Missing("sensor"))?;
    let no_frame = || PipelineError::NoFrame {
        wanted: settings.frame.clone(),
        known: frames.iter().map(|f| f.raw.label.as_str()).collect::<Vec<_>>().join(", "),
    };
    let frame = frames.iter().find(|f| f.raw.label == settings.frame).ok_or_else(no_frame)?;
    let capture = study.capture(&settings.frame).ok_or_else(no_frame)?;

    let noise = noise_of(&frame.developed, &frame.raw, sensor);
    let analysis_settings =
        AnalysisSettings { region: settings.region(), noise, noise_threshold: settings.noise_threshold };
    let image = &frame.developed;
    let scene = components.and_then(|components| on_sensor(study, components.image));
    let region =
        analysis_settings.region.select(image.width, image.height, scene).map_err(AnalysisError::from)?;
    let on_region = scene.map(|scene| (scene, &region));
    let of_region = sensor.as_pixels_see(&region.pixels);
    let chromaticity = ChromaticityMap::of(image, settings.noise_threshold);
    // What is known of the region's light is known of the pixels that the estimate rests on: the others may be brighter or redder
    let measured = PixelSelection { pixels: chromaticity.measured(&region.pixels).collect(), ..region };
    // On the line that mixtures follow
    let by_line = || -> Result<_, PipelineError> {
        let light = frame_light(study, capture, on_region);
        let mut model = mixture_model(study, &of_region, capture, light.as_ref(), settings);
        let emitted = match (components, &settings.porphyrin) {
            (Some(components), Some(porphyrin)) => {
                region_light(study, components, capture, porphyrin, frame, &measured)?
            }
            _ => None,
        };
        if let (Some(model), Some(emitted), LineEnds::Scene) = (&mut model, &emitted, settings.line_ends) {
            model.ends = line_ends(model, emitted);
        }
        let mut found =
            analyze_pixels(image, &chromaticity, &region, model.as_ref(), None, &analysis_settings)?;
        let analysis = &mut found.analysis;
        let analyte = study.analyte(settings);
        analysis.truth = emitted.as_ref().and_then(|light| light.truth(&analyte));
        analysis.analyte = analyte;
        if let (Some(model), Some(emitted)) = (&model, &emitted) {
            analysis.budget = budget(analysis, model, emitted, image, &chromaticity, &region, noise);
        }
        Ok(found)
    };
    // Families of tissues take as long as all of that
    let (by_line, families) =
        rayon::join(by_line, || FamiliesOfFrames::new(study, settings, frames, on_region));
    let PixelAnalysis { mut analysis, porphyrin, of_line } = by_line?;
    analysis.exposure_s = Some(frame.raw.exposure_s);
    analysis.gain_is_assumed = frames.iter().any(|frame| frame.raw.gain_is_assumed);
    if rgb_channels(image).is_err() || image.channels.len() != 3 {
        let (sensor, plan, region) = (&*of_region, settings, &region);
        let signals = channel_analysis(&Measured { study, sensor, plan, frames, region, scene, components })?;
        analysis.warnings.extend(signals.warnings());
        analysis.signals = Some(signals);
    }
    let families = families?;
    let estimate = families.as_ref().and_then(|families| families.estimate(frames, &measured));
    if let Some(estimate) = &estimate {
        analysis.warnings.extend(estimate.warnings(&analysis.analyte));
        let known = families.as_ref().zip(analysis.truth.as_ref());
        let foreign = known.map(|(families, truth)| families.foreign_light(&truth.electrons));
        analysis.warnings.extend(foreign.into_iter().flatten());
    } else if analysis.mixture.is_some() {
        analysis.warnings.extend(of_line);
        analysis.warnings.extend(what_the_line_assumes(study, settings));
    }
    analysis.posterior = estimate;
    let spots = compared_spots(study, settings, frames, scene)?;
    analysis.spots = spots.found;
    analysis.warnings.extend(spots.warnings);
    let targets = measured_targets(study, settings, frames, components, scene)?;
    analysis.targets = targets.detections;
    analysis.warnings.extend(targets.warnings);
    Ok(AnalyzedFrame { analysis, chromaticity, porphyrin, region, targets: targets.labels })
}

/// What an estimate on the mixture line alone leaves out where the region is tissue, or may stand for it.
fn no_blood(analyte: &Analyte) -> Warning {
    let explanation = format!(
        "Blood moves the color of real tissue along the very line on which {analyte} is measured; give analysis.tissue the site of the \
         tissue for an estimate that knows."
    );
    Warning::explained(
        "The share on the mixture line assumes tissue without blood, as a phantom is",
        explanation,
    )
}

/// The same where the bulk is layered tissue of the scene.
fn one_tissue(analyte: &Analyte) -> Warning {
    let explanation = format!(
        "Other blood moves the color along the very line on which {analyte} is measured; give analysis.tissue a site of the catalogue for \
         an estimate that knows."
    );
    Warning::explained("The bulk is the tissue of the scene, as if its blood were known", explanation)
}

/// The warning about an estimate on the mixture line alone; none where the bulk holds nothing that fluoresces in tissue, as dyes of a
/// phantom do.
fn what_the_line_assumes(study: &Study, settings: &AnalysisPlan) -> Option<Warning> {
    let analyte = study.analyte(settings);
    // Blood lies on the line of the porphyrin; the analyte in a leaf or a dish has none in front of it
    if !analyte.is_porphyrin() {
        return None;
    }
    let held = |part: &String| study.tissues.iter().any(|tissue| tissue.parts.contains(part));
    if settings.parts.iter().any(held) {
        return Some(one_tissue(&analyte));
    }
    let of_tissue = |name: &str| Site::quantum_yield(name).is_some();
    settings.bulk.iter().any(|(name, amount)| *amount > 0.0 && of_tissue(name)).then(|| no_blood(&analyte))
}

/// Colors of the ends of the line as the light of the region has them at the sensor. A porphyrin that is not there has the color of
/// a flat sample.
fn line_ends(model: &MixtureModel, emitted: &RegionLight) -> Option<[[f64; 3]; 2]> {
    let lit = |rgb: [f64; 3]| rgb.iter().sum::<f64>() > 0.0;
    let rgb = |electrons: &[f64]| <[f64; 3]>::try_from(electrons).ok();
    let [bulk, of_porphyrin] = [rgb(&emitted.bulk)?, rgb(&emitted.porphyrin)?];
    let flat = model.responses.iter().find(|response| response.name == model.porphyrin)?.rgb_per_amount;
    let porphyrin = if lit(of_porphyrin) { of_porphyrin } else { flat };
    lit(bulk).then_some([bulk, porphyrin])
}

/// The error budget of the region on the line.
fn budget(
    analysis: &Analysis,
    model: &MixtureModel,
    emitted: &RegionLight,
    image: &ChannelImage,
    chromaticity: &ChromaticityMap,
    region: &PixelSelection,
    noise: ChannelNoise,
) -> Option<ErrorBudget> {
    let RegionFraction { mean_rgb_dn, variance_dn2, lines_dn2, .. } = analysis.mixture.as_ref()?.region?;
    ErrorBudget::new(&BudgetInput {
        line: &model.line().ok()?,
        direct_line: &model.direct_line().ok()?,
        mean_rgb_dn,
        variance_dn2: [0, 1, 2].map(|c| variance_dn2[c] - lines_dn2[c][c]),
        lines_dn2,
        subtracted: subtracted_mean(image, chromaticity, region),
        noise,
        inner_rgb_dn: inner_mean(image, chromaticity, region),
        light: emitted,
    })
}

/// Mean R, G, B of the light that was subtracted from the measured pixels of a region, DN, and the ratio of the exposure times.
fn subtracted_mean(
    image: &ChannelImage,
    chromaticity: &ChromaticityMap,
    region: &PixelSelection,
) -> ([f64; 3], f64) {
    let (Some(light), Ok(channels)) = (&image.subtracted, rgb_channels(image)) else {
        return ([0.0; 3], 0.0);
    };
    let measured = || chromaticity.measured(&region.pixels);
    let mean = |channel: usize| {
        let value = |pixel: usize| f64::from(light.dn[pixel * image.channels.len() + channel]);
        measured().map(value).sum::<f64>() / measured().count().max(1) as f64
    };
    (channels.map(mean), light.exposure_ratio)
}

/// Mean R, G, B of the measured pixels of a region whose eight neighbors belong to it as well, DN: where interpolation of colors saw
/// nothing else. `None` where there are none.
fn inner_mean(
    image: &ChannelImage,
    chromaticity: &ChromaticityMap,
    region: &PixelSelection,
) -> Option<[f64; 3]> {
    let (width, height) = (region.width, region.height);
    let mut inside = vec![false; width * height];
    region.pixels.iter().for_each(|&pixel| inside[pixel] = true);
    let is_inner = |pixel: usize| {
        let (row, col) = (pixel / width, pixel % width);
        let within = row > 0 && col > 0 && row + 1 < height && col + 1 < width;
        within && (row - 1..=row + 1).all(|row| (col - 1..=col + 1).all(|col| inside[row * width + col]))
    };
    let channels = rgb_channels(image).ok()?;
    let (mut sum, mut pixels) = ([0.0; 3], 0usize);
    for pixel in chromaticity.measured(&region.pixels).filter(|pixel| is_inner(*pixel)) {
        let value = |channel: usize| f64::from(image.data[pixel * image.channels.len() + channel]);
        sum.iter_mut().zip(channels).for_each(|(sum, channel)| *sum += value(channel));
        pixels += 1;
    }
    (pixels > 0).then(|| sum.map(|sum| sum / pixels as f64))
}

fn mixture_model(
    study: &Study,
    sensor: &Sensor,
    capture: &Capture,
    light: Option<&Curve>,
    settings: &AnalysisPlan,
) -> Option<MixtureModel> {
    let porphyrin = settings.porphyrin.clone()?;
    let (lens, light) = (study.camera.lens_behind_filters()?, light?);
    let grid = &study.scene.grid;
    let transmittance = behind_filter(&lens, capture).transmittance_on(grid);
    let qe = sensor.effective_qe();
    let channel =
        |name: &str| -> Option<Spectrum<QuantumEfficiency>> { Some(qe.on_grid(qe.find(name)?, grid)) };
    let [red, green, blue] = [channel("R")?, channel("G")?, channel("B")?];
    // Predict the response to each fluorophore at unit amount
    let responses = settings
        .fluorophores
        .par_iter()
        .filter_map(|fluorophore| {
            let exitance = direct_exitance(&fluorophore.eem, grid, light);
            let seen = exitance.iter().zip(transmittance.values()).map(|(m, t)| m * t).collect();
            let radiance = Spectrum::<Radiance>::from_parts(grid.clone(), seen);
            let rgb_per_amount = channel_response(&radiance, [&red, &green, &blue]).ok()?;
            Some(FluorophoreResponse { name: fluorophore.name.clone(), rgb_per_amount })
        })
        .collect();
    let analyte = study.analyte(settings);
    Some(MixtureModel { responses, bulk_weights: settings.bulk.clone(), porphyrin, analyte, ends: None })
}
