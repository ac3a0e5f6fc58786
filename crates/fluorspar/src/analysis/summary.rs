//! Everything that is measured on one frame, gathered for `results.json`, tables and the report.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::mixture_line::DETECTION_Z;
use super::pixel_mean::{PixelMean, rgb_mean};
use super::{
    Analyte, ChannelNoise, ChannelStatistics, ChromaticityMap, CovarianceEllipse, DEFAULT_NOISE_THRESHOLD,
    ErrorBudget, ExclusionCounts, FluorophoreResponse, LineEstimate, MissingChannel, MixtureError,
    MixtureLine, PixelSelection, PorphyrinMap, PorphyrinTruth, RegionError, RegionOfInterest,
    RegionStatistics, SceneOnSensor, SharePosterior, SignalSummary, SpotSeparation, Statistics,
    TargetDetection,
};
use crate::image::ChannelImage;
use crate::warning::Warning;

/// Settings of an analysis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AnalysisSettings {
    /// Which pixels.
    pub region: RegionOfInterest,
    /// Noise of a channel value.
    pub noise: ChannelNoise,
    /// Least channel sum that counts as light, in standard deviations of the sum in the dark.
    pub noise_threshold: f64,
}

impl AnalysisSettings {
    /// A region with the default noise threshold.
    pub fn new(region: RegionOfInterest, noise: ChannelNoise) -> Self {
        Self { region, noise, noise_threshold: DEFAULT_NOISE_THRESHOLD }
    }
}

/// Which fluorophores make the bulk, and which one is the porphyrin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MixtureModel {
    /// Channel responses of all fluorophores per unit amount.
    pub responses: Vec<FluorophoreResponse>,
    /// Name and amount of the fluorophores that make one unit of bulk.
    pub bulk_weights: Vec<(String, f64)>,
    /// Name of the porphyrin.
    pub porphyrin: String,
    /// What texts call it.
    pub analyte: Analyte,
    /// R, G, B of the light of the bulk and of the porphyrin as they reach the sensor from the region, by all ways, at any
    /// scale: they give the ends of the line their colors. `None`: the ends are those of flat samples under direct light.
    pub ends: Option<[[f64; 3]; 2]>,
}

impl MixtureModel {
    /// The line that mixtures follow in the region.
    ///
    /// An end has the color of [`Self::ends`] and the brightness, R + G + B per unit amount, of the flat sample.
    ///
    /// # Errors
    /// When nothing forms the bulk, a name has no response, an end is dark or both have the same chromaticity.
    pub fn line(&self) -> Result<MixtureLine, MixtureError> {
        let direct = self.direct_line()?;
        match self.ends {
            None => Ok(direct),
            Some([bulk, porphyrin]) => {
                direct.with_colors(bulk, porphyrin).map_err(|error| error.of(&self.analyte))
            }
        }
    }

    /// The same for a flat sample under direct light.
    ///
    /// # Errors
    /// As [`Self::line`].
    pub fn direct_line(&self) -> Result<MixtureLine, MixtureError> {
        MixtureLine::from_fluorophores(&self.responses, &self.bulk_weights, &self.porphyrin)
            .map_err(|error| error.of(&self.analyte))
    }
}

/// Where one fluorophore alone is predicted to lie.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictedFluorophore {
    /// Name.
    pub name: String,
    /// `(r, g)`; none where it gives no light through the filters.
    pub chromaticity: Option<[f64; 2]>,
    /// R + G + B per unit amount.
    pub sum_per_amount: f64,
    /// Amount in one unit of bulk; none for the porphyrin and for fluorophores that are not part of it.
    pub bulk_weight: Option<f64>,
}

/// Porphyrin fraction of the region's mean R, G, B.
///
/// The standard error holds the sensor's noise only. That tissue differs from pixel to pixel shows in the spread of
/// the pixels' own fractions instead.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegionFraction {
    /// Mean R, G, B over the unsaturated pixels, DN, reflected light subtracted where known.
    pub mean_rgb_dn: [f64; 3],
    /// Variance of that mean by the sensor's noise, DN².
    pub variance_dn2: [f64; 3],
    /// Covariance of R, G and B by what rows and columns share, DN²; its diagonal is part of the variance.
    #[serde(default)]
    pub lines_dn2: [[f64; 3]; 3],
    /// Where it lies on the line.
    pub estimate: LineEstimate,
}

/// The region on the bulk-porphyrin line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MixtureSummary {
    /// `(r, g)` of bulk alone.
    pub bulk: [f64; 2],
    /// `(r, g)` of the porphyrin alone.
    pub porphyrin: [f64; 2],
    /// Distance between them in chromaticity.
    pub length: f64,
    /// The whole region as one measurement.
    pub region: Option<RegionFraction>,
    /// Porphyrin fraction of the pixels.
    pub fraction: Option<Statistics>,
    /// Standard error of one pixel's fraction: its statistics over the pixels.
    pub fraction_standard_error: Option<Statistics>,
    /// Distance of the pixels from the line in chromaticity.
    pub distance: Option<Statistics>,
    /// Pixels beyond an end of the line, counted as lying at that end.
    pub clamped: usize,
    /// Pixels farther off the line than three standard errors.
    pub off_line: usize,
    /// Angle between the long axis of the pixel cloud and the line, degrees, 0 to 90.
    pub angle_to_line_deg: Option<f64>,
}

/// Analysis of one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Analysis {
    /// Name of the frame.
    pub frame: String,
    /// Exposure time of the frame, s; `None` in results of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_s: Option<f64>,
    /// Whether a frame of the analysis did not tell its conversion gain, so that electrons, signal to noise and the noise in intervals are
    /// those of the sensor of the experiment.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub gain_is_assumed: bool,
    /// What texts call the fluorophore whose share is estimated; results leave the porphyrin out.
    #[serde(default, alias = "sought", skip_serializing_if = "Analyte::is_porphyrin")]
    pub analyte: Analyte,
    /// The region in words.
    pub region_description: String,
    /// The requested value.
    pub settings: AnalysisSettings,
    /// Least channel sum that counted as light, DN.
    pub least_sum_dn: f64,
    /// Pixels of the region with and without a chromaticity, by reason.
    pub counts: ExclusionCounts,
    /// Statistics of the channels.
    pub channels: Vec<ChannelStatistics>,
    /// Statistics of `r` over the valid pixels.
    pub r: Option<Statistics>,
    /// Statistics of `g` over the valid pixels.
    pub g: Option<Statistics>,
    /// Covariance of `(r, g)` over the valid pixels.
    pub ellipse: Option<CovarianceEllipse>,
    /// Predicted chromaticities.
    pub fluorophores: Vec<PredictedFluorophore>,
    /// The bulk-porphyrin line, where both ends are lit and apart.
    pub mixture: Option<MixtureSummary>,
    /// What a simulation knows of the light of the region: the truth beside the estimate.
    #[serde(default)]
    pub truth: Option<PorphyrinTruth>,
    /// What moves the estimate on the line, and by how much; in a simulation only.
    #[serde(default)]
    pub budget: Option<ErrorBudget>,
    /// The share of the porphyrin if the region is tissue of a known site.
    #[serde(default)]
    pub posterior: Option<SharePosterior>,
    /// How well two spots are told apart, if the analysis compares some.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spots: Vec<SpotSeparation>,
    /// All channels of all frames with light, of a camera that has others than R, G and B.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub signals: Option<SignalSummary>,
    /// How well targets are told from what lies around them, in each frame with light.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub targets: Vec<TargetDetection>,
    /// Warnings about the reliability of the numbers.
    pub warnings: Vec<Warning>,
}

/// Median level of a channel over a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MedianLevel {
    /// The level, DN.
    pub dn: f64,
    /// Whether half of the pixels or more are saturated, so that the light may be any stronger.
    pub is_lower_limit: bool,
}

impl Analysis {
    /// Median level of a channel over all pixels of the region, saturated ones included. `None` without pixels, and where results of
    /// older versions have it of the unsaturated pixels alone and more than one in a hundred is saturated.
    #[must_use]
    pub fn median_level(&self, channel: &ChannelStatistics) -> Option<MedianLevel> {
        let of_unsaturated = || channel.statistics.filter(|_| self.counts.saturated_share().is_none());
        let dn = channel.median_of_all.or_else(|| Some(of_unsaturated()?.median))?;
        let saturated = self.counts.saturated;
        Some(MedianLevel { dn, is_lower_limit: saturated > 0 && 2 * saturated >= self.counts.total() })
    }

    /// Smallest share on the mixture line that noise alone tells from the blank with errors of 5 % either way: that of the budget, counted
    /// from its blank, else that of the estimate's own noise (Currie 1968).
    #[must_use]
    pub fn detection_limit(&self) -> Option<f64> {
        match &self.budget {
            Some(budget) => Some(budget.detection_limit),
            None => {
                let estimate = self.mixture.as_ref()?.region?.estimate;
                Some(DETECTION_Z * estimate.position_standard_error)
            }
        }
    }
}

/// Why a frame cannot be analyzed.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum AnalysisError {
    /// The region selects nothing.
    #[error(transparent)]
    Region(#[from] RegionError),
    /// The image has no R, G or B.
    #[error(transparent)]
    Channel(#[from] MissingChannel),
    /// The mixture model names a fluorophore without a response.
    #[error(transparent)]
    Mixture(#[from] MixtureError),
    /// The reflected light is on an image of another size.
    #[error(
        "the image of reflected light has {} x {} pixels but the frame has {} x {}; develop both with the same sensor",
        .reflected[0], .reflected[1], .frame[0], .frame[1]
    )]
    ReflectedSize {
        /// Columns and rows of the reflected light.
        reflected: [usize; 2],
        /// Columns and rows of the frame.
        frame: [usize; 2],
    },
}

/// Measures a region of one developed frame. `scene` serves to find parts by name, `reflected` is known reflected light.
///
/// Returns the summary and the per-pixel maps it was made from. A line that cannot be drawn is a warning, not an error.
///
/// # Errors
/// A region without pixels, a model for an image without R, G and B, or one that names an unknown fluorophore.
pub fn analyze_region(
    image: &ChannelImage,
    scene: Option<SceneOnSensor<'_>>,
    model: Option<&MixtureModel>,
    reflected: Option<&ChannelImage>,
    settings: &AnalysisSettings,
) -> Result<(Analysis, ChromaticityMap, Option<PorphyrinMap>), AnalysisError> {
    let selection = settings.region.select(image.width, image.height, scene)?;
    let map = ChromaticityMap::of(image, settings.noise_threshold);
    let PixelAnalysis { mut analysis, porphyrin, of_line } =
        analyze_pixels(image, &map, &selection, model, reflected, settings)?;
    analysis.warnings.extend(of_line);
    Ok((analysis, map, porphyrin))
}

/// A region of which the pixels are analyzed.
pub(crate) struct PixelAnalysis {
    pub(crate) analysis: Analysis,
    pub(crate) porphyrin: Option<PorphyrinMap>,
    /// Warnings about the estimate on the mixture line, which are none where another estimate takes its place.
    pub(crate) of_line: Vec<Warning>,
}

/// [`analyze_region`] where the pixels of the region and the chromaticities of the frame are known.
pub(crate) fn analyze_pixels(
    image: &ChannelImage,
    map: &ChromaticityMap,
    selection: &PixelSelection,
    model: Option<&MixtureModel>,
    reflected: Option<&ChannelImage>,
    settings: &AnalysisSettings,
) -> Result<PixelAnalysis, AnalysisError> {
    if let Some(leak) = reflected.filter(|l| (l.width, l.height) != (image.width, image.height)) {
        return Err(AnalysisError::ReflectedSize {
            reflected: [leak.width, leak.height],
            frame: [image.width, image.height],
        });
    }
    // Compute the statistics of the chromaticities
    let statistics = RegionStatistics::new(image, map, selection);
    let (mut warnings, mut of_line) = (exclusion_warnings(&statistics.counts), Vec::new());
    let analyte = model.map_or_else(Analyte::default, |model| model.analyte.clone());

    // Predict the mixture line from the fluorophores
    let line = match model.map(MixtureModel::line) {
        None => None,
        Some(Ok(line)) => Some(line),
        Some(Err(error @ MixtureError::UnknownFluorophore { .. })) => return Err(error.into()),
        Some(Err(error)) => {
            warnings.push(format!("No {analyte} share on a mixture line: {error}").into());
            None
        }
    };
    // Estimate the porphyrin fraction per pixel and of the region's mean
    let mut porphyrin = None;
    let mut mixture = None;
    if let Some(line) = &line {
        let valid = |pixel| map.at(pixel).is_some();
        let estimates = PorphyrinMap::new(image, valid, selection, line, &settings.noise, reflected)?;
        let measured: Vec<usize> = map.measured(&selection.pixels).collect();
        let mean = rgb_mean(image, &measured, &settings.noise, reflected)?;
        let summary = summarize(line, &estimates, mean, statistics.ellipse.as_ref());
        warnings.extend(level_warnings(summary.region.as_ref(), image));
        of_line.extend(line_warnings(summary.region.as_ref(), &analyte));
        if summary.off_line * 20 > statistics.counts.valid {
            let statement = format!(
                "{} of {} valid pixels lie off the bulk-{analyte} line by more than noise explains",
                summary.off_line, statistics.counts.valid
            );
            of_line.push(Warning::explained(
                statement,
                "Their light contains something else: reflected light, or another bulk than assumed. Their shares on the line are biased.",
            ));
        }
        mixture = Some(summary);
        porphyrin = Some(estimates);
    }
    // Collect the results
    let analysis = Analysis {
        frame: image.label.clone(),
        exposure_s: None,
        gain_is_assumed: false,
        analyte,
        region_description: settings.region.describe(),
        settings: settings.clone(),
        least_sum_dn: map.least_sum_dn,
        counts: statistics.counts,
        channels: statistics.channels,
        r: statistics.r,
        g: statistics.g,
        ellipse: statistics.ellipse,
        fluorophores: model.map(predicted).unwrap_or_default(),
        mixture,
        truth: None,
        budget: None,
        posterior: None,
        spots: Vec::new(),
        signals: None,
        targets: Vec::new(),
        warnings,
    };
    Ok(PixelAnalysis { analysis, porphyrin, of_line })
}

fn exclusion_warnings(counts: &ExclusionCounts) -> Vec<Warning> {
    let total = counts.total();
    let mut warnings = Vec::new();
    let mut warn = |excluded: usize, reason: &str, advice: Option<&str>| {
        // One pixel in a hundred is more than hot pixels and highlights explain.
        if excluded * 100 > total {
            let percent = 100.0 * excluded as f64 / total as f64;
            let statement = format!("{percent:.0} % of the region's pixels are left out: {reason}");
            warnings.push(match advice {
                Some(advice) => Warning::explained(statement, advice),
                None => statement.into(),
            });
        }
    };
    warn(counts.saturated, "saturated", Some("Shorten the exposure or lower the gain."));
    let lost = "their light is lost in dark noise";
    warn(counts.below_noise_floor, lost, Some("Lengthen the exposure or add light."));
    warn(counts.undefined, "the sum of their channels is not positive: they are dark", None);
    warnings
}

/// How far from the line a region may lie by sampling noise of the render and by interpolation of colors at its rim, (r, g).
const LINE_TOLERANCE: f64 = 0.002;

/// Levels of a region that make any estimate doubtful.
fn level_warnings(region: Option<&RegionFraction>, image: &ChannelImage) -> Vec<Warning> {
    let Some(RegionFraction { mean_rgb_dn, .. }) = region else { return Vec::new() };
    let mut warnings = Vec::new();
    for (name, mean) in ["R", "G", "B"].iter().zip(mean_rgb_dn) {
        if *mean < 3.0 * image.noise_floor_dn {
            let statement = format!(
                "{name} of the region is {mean:.1} DN, below three times a pixel's read noise ({:.1} DN)",
                image.noise_floor_dn
            );
            warnings.push(Warning::explained(statement, "Lengthen the exposure or add light."));
        }
        if *mean > 0.95 * image.full_scale_dn {
            let statement =
                format!("{name} of the region is {mean:.0} DN, at full scale: its color can't be trusted");
            warnings.push(Warning::explained(statement, "Shorten the exposure."));
        }
    }
    warnings
}

/// What makes the estimate of a region on the mixture line doubtful.
fn line_warnings(region: Option<&RegionFraction>, analyte: &Analyte) -> Vec<Warning> {
    let Some(RegionFraction { estimate, .. }) = region else { return Vec::new() };
    let mut warnings = Vec::new();
    let allowed = (3.0 * estimate.distance_standard_error).max(LINE_TOLERANCE);
    if estimate.distance.abs() > allowed {
        let statement = format!(
            "The region lies {:.4} beside the bulk-{analyte} line, {:.0} times what noise explains: the share on that line is biased",
            estimate.distance.abs(),
            estimate.distance.abs() / estimate.distance_standard_error
        );
        let explanation = "Only an estimate for tissue that is not known (analysis.tissue) allows for that.";
        warnings.push(Warning::explained(statement, explanation));
    }
    if estimate.position < 0.0 {
        let text = format!(
            "The estimate lies below zero, at {:.4} (standard error {:.4}): the bulk is not as assumed, or there is no {analyte}",
            estimate.position, estimate.position_standard_error
        );
        warnings.push(text.into());
    }
    warnings
}

fn predicted(model: &MixtureModel) -> Vec<PredictedFluorophore> {
    let weight =
        |name: &str| model.bulk_weights.iter().find(|(bulk, _)| bulk == name).map(|(_, weight)| *weight);
    model
        .responses
        .iter()
        .map(|response| PredictedFluorophore {
            name: response.name.clone(),
            chromaticity: response.chromaticity(),
            sum_per_amount: response.rgb_per_amount.iter().sum(),
            bulk_weight: weight(&response.name),
        })
        .collect()
}

fn summarize(
    line: &MixtureLine,
    map: &PorphyrinMap,
    mean: Option<PixelMean>,
    ellipse: Option<&CovarianceEllipse>,
) -> MixtureSummary {
    let estimates: Vec<&LineEstimate> = map.estimates.iter().map(|(_, estimate)| estimate).collect();
    let statistics =
        |value: fn(&LineEstimate) -> f64| Statistics::of(estimates.iter().map(|estimate| value(estimate)));
    MixtureSummary {
        bulk: line.bulk_point(),
        porphyrin: line.porphyrin_point(),
        length: line.length(),
        region: mean.and_then(|mean| {
            let [mean_rgb_dn, variance_dn2] =
                [&mean.dn, &mean.variance_dn2].map(|of| [0, 1, 2].map(|c| of[c]));
            let lines_dn2 = [0, 1, 2].map(|row| [0, 1, 2].map(|col| mean.lines_dn2[(row, col)]));
            let own = [0, 1, 2].map(|c| variance_dn2[c] - lines_dn2[c][c]);
            let estimate = line.project_shared(mean_rgb_dn, own, lines_dn2)?;
            Some(RegionFraction { mean_rgb_dn, variance_dn2, lines_dn2, estimate })
        }),
        fraction: statistics(|e| e.fraction),
        fraction_standard_error: statistics(|e| e.fraction_standard_error),
        distance: statistics(|e| e.distance),
        clamped: estimates.iter().filter(|estimate| estimate.clamped).count(),
        off_line: estimates.iter().filter(|estimate| estimate.is_off_line()).count(),
        angle_to_line_deg: ellipse.map(|ellipse| angle_to_line_deg(line, ellipse)),
    }
}

/// Angle between the long axis of an ellipse and the mixture line, 0 to 90 degrees.
fn angle_to_line_deg(line: &MixtureLine, ellipse: &CovarianceEllipse) -> f64 {
    let (bulk, porphyrin) = (line.bulk_point(), line.porphyrin_point());
    let line_deg = (porphyrin[1] - bulk[1]).atan2(porphyrin[0] - bulk[0]).to_degrees();
    let turn = (ellipse.angle_deg - line_deg).rem_euclid(180.0);
    turn.min(180.0 - turn)
}

#[cfg(test)]
mod tests {
    use rand::RngExt;
    use rand_distr::StandardNormal;

    use super::*;
    use crate::analysis::{LineNoise, Rectangle};
    use crate::sampling::Z_95;
    use crate::sampling::random::Key;

    fn model() -> MixtureModel {
        let response = |name: &str, rgb_per_amount| FluorophoreResponse { name: name.into(), rgb_per_amount };
        MixtureModel {
            responses: vec![
                response("elastin", [0.163, 0.412, 0.425]),
                response("FAD", [0.189, 0.621, 0.19]),
                response("porphyrins", [0.812, 0.135, 0.053]),
            ],
            bulk_weights: vec![("elastin".into(), 0.8), ("FAD".into(), 0.2)],
            porphyrin: "porphyrins".into(),
            analyte: Analyte::default(),
            ends: None,
        }
    }

    fn settings() -> AnalysisSettings {
        let noise = ChannelNoise {
            floor_dn: 2.0,
            dn_per_electron: 0.45,
            gain_spread: 0.0,
            lines: LineNoise::default(),
        };
        AnalysisSettings::new(RegionOfInterest::default(), noise)
    }

    /// Pixels whose porphyrin fraction grows from 0 to 40 % along the columns, without noise.
    fn image(width: usize, light_dn: f64) -> ChannelImage {
        let model = model();
        let line =
            MixtureLine::from_fluorophores(&model.responses, &model.bulk_weights, "porphyrins").unwrap();
        let pixel = |col: usize| {
            let fraction = 0.4 * col as f64 / (width - 1) as f64;
            line.rgb((1.0 - fraction) * light_dn, fraction * light_dn).map(|v| v as f32)
        };
        ChannelImage {
            width,
            height: 1,
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            data: (0..width).flat_map(pixel).collect(),
            saturated: vec![false; width],
            noise_floor_dn: 2.0,
            full_scale_dn: 4000.0,
            shares: vec![0.25, 0.5, 0.25],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "blue".into(),
        }
    }

    #[test]
    fn a_noise_free_gradient_is_measured_as_it_was_made() {
        let (analysis, _, map) =
            analyze_region(&image(101, 1000.0), None, Some(&model()), None, &settings()).unwrap();
        let mixture = analysis.mixture.unwrap();
        // f32 pixel values: relative 6e-8.
        assert!((mixture.fraction.unwrap().median - 0.2).abs() < 1e-6);
        assert!((mixture.fraction.unwrap().max - 0.4).abs() < 1e-6);
        assert!(mixture.distance.unwrap().max < 1e-6 && mixture.angle_to_line_deg.unwrap() < 1e-3);
        assert!((mixture.region.unwrap().estimate.fraction - 0.2).abs() < 1e-6);
        assert_eq!(analysis.counts.valid, 101);
        assert_eq!(analysis.fluorophores[0].bulk_weight, Some(0.8));
        assert_eq!(analysis.warnings, Vec::<Warning>::new());
        assert!((map.unwrap().fractions_on_line()[100].unwrap() - 0.4).abs() < 1e-6);
    }

    #[test]
    fn json_holds_no_nan_and_reads_back_even_without_light() {
        for light_dn in [1000.0, 1.0, 0.0] {
            let (analysis, ..) =
                analyze_region(&image(3, light_dn), None, Some(&model()), None, &settings()).unwrap();
            let json = serde_json::to_string(&analysis).unwrap();
            let back: Analysis = serde_json::from_str(&json).unwrap();
            assert_eq!(back, analysis, "{light_dn}");
        }
        let one_pixel = Rectangle { col: 0, row: 0, width: 1, height: 1 };
        let settings = AnalysisSettings { region: RegionOfInterest::of_rectangle(one_pixel), ..settings() };
        let (analysis, ..) = analyze_region(&image(3, 1000.0), None, None, None, &settings).unwrap();
        let back: Analysis = serde_json::from_str(&serde_json::to_string(&analysis).unwrap()).unwrap();
        assert_eq!(back, analysis);
    }

    /// Pixels of which noise hides more or fewer: the region holds the same light.
    #[test]
    fn intervals_of_dim_regions_hold_the_truth() {
        const FRAMES: u64 = 400;
        const PIXELS: usize = 200;
        let (settings, model) = (settings(), model());
        let line =
            MixtureLine::from_fluorophores(&model.responses, &model.bulk_weights, "porphyrins").unwrap();
        // Pixels are lost below a sum of 5 sqrt(3) times the floor
        for light_dn in [14.0, 18.0, 40.0] {
            let exact = line.rgb(0.9 * light_dn, 0.1 * light_dn);
            let truth = line.project(exact, [1.0; 3]).unwrap().position;
            let held = |frame: &u64| {
                let mut rng = Key::new(5).with(*frame).with(light_dn as u64).rng();
                let mut noisy = |value: f64| {
                    let variance = settings.noise.floor_dn.powi(2) + settings.noise.dn_per_electron * value;
                    (value + variance.sqrt() * rng.sample::<f64, _>(StandardNormal)) as f32
                };
                let data = (0..3 * PIXELS).map(|place| noisy(exact[place % 3])).collect();
                let saturated = vec![false; PIXELS];
                let image =
                    ChannelImage { width: PIXELS, data, saturated, shares: vec![1.0; 3], ..image(2, 1.0) };
                let (analysis, ..) = analyze_region(&image, None, Some(&model), None, &settings).unwrap();
                let estimate = analysis.mixture.unwrap().region.unwrap().estimate;
                (estimate.position - truth).abs() < Z_95 * estimate.position_standard_error
            };
            let share = (0..FRAMES).filter(held).count() as f64 / FRAMES as f64;
            // Four standard errors of a binomial share
            let tolerance = 4.0 * (0.95 * 0.05 / FRAMES as f64).sqrt();
            assert!((share - 0.95).abs() < tolerance, "{light_dn} {share}");
        }
    }

    #[test]
    fn lost_pixels_are_warned_about() {
        let mut image = image(100, 1000.0);
        image.saturated[..30].fill(true);
        let (analysis, ..) = analyze_region(&image, None, None, None, &settings()).unwrap();
        assert_eq!(
            analysis.warnings,
            ["30 % of the region's pixels are left out: saturated. Shorten the exposure or lower the gain."]
        );
    }

    #[test]
    fn a_filter_that_blocks_the_porphyrin_costs_the_fraction_not_the_analysis() {
        let mut model = model();
        model.responses[2].rgb_per_amount = [0.0; 3];
        let (analysis, _, map) =
            analyze_region(&image(5, 1000.0), None, Some(&model), None, &settings()).unwrap();
        assert!(analysis.mixture.is_none() && map.is_none());
        assert!(
            analysis.warnings[0].starts_with("No porphyrin share on a mixture line: the porphyrin response")
        );
        assert_eq!(analysis.fluorophores[2].chromaticity, None);
    }

    #[test]
    fn no_bulk_is_not_blamed_on_the_filter() {
        let model = MixtureModel { bulk_weights: Vec::new(), ..model() };
        let (analysis, ..) =
            analyze_region(&image(5, 1000.0), None, Some(&model), None, &settings()).unwrap();
        let warning = &analysis.warnings[0];
        assert!(warning.contains("no fluorophore is named as the bulk"), "{warning}");
        assert!(!warning.contains("filter"), "{warning}");
    }

    #[test]
    fn reflected_light_of_another_size_is_refused() {
        let error = analyze_region(&image(5, 9.0), None, None, Some(&image(4, 9.0)), &settings())
            .unwrap_err()
            .to_string();
        assert_eq!(
            error,
            "the image of reflected light has 4 x 1 pixels but the frame has 5 x 1; develop both with the same sensor"
        );
    }
}
