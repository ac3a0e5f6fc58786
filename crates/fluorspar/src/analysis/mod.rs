//! Analysis of developed sensor images: sensor chromaticity, regions of interest, and the share of
//! porphyrin in the fluorescence.
//!
//! | call | gives |
//! |---|---|
//! | [`sensor_chromaticity`] | `(r, g)` of one pixel, Eq. (7) of the paper |
//! | [`ChromaticityMap::new`] | `(r, g)` of every pixel, and why a pixel has none |
//! | [`RegionOfInterest::select`] | the pixels of named parts, of a rectangle, a [`Polygon`], a [`PixelMask`], or of several at once |
//! | [`RegionStatistics::new`] | mean, spread, percentiles, covariance ellipse of a region |
//! | [`MixtureLine`] | the bulk-porphyrin line, and per pixel where on it a measurement lies |
//! | [`RegionLight`] | where the light of a region was emitted, as a simulation knows it, and the true share of the porphyrin |
//! | [`ErrorBudget`] | what moves the estimate, its blank and its detection limit |
//! | [`LightFamily::posterior`] | the share of the porphyrin in tissue of which only a family is known, as a [`SharePosterior`] |
//! | [`FamilyAverage::posterior`] | the same where the tissue may be another than the named one |
//! | [`LightFamily::visible_share`] | the smallest share of the porphyrin that is told from none |
//! | [`SpectralMixture`] | a measured spectrum as a sum of known ones, with intervals, and the sets of them that describe it as well |
//! | [`spectral_overlap`] | how alike two spectra are |
//! | [`SpotSeparation::new`] | how well the pixels of two spots are told apart |
//! | [`d_prime_of_rates`], [`d_prime_of_scores`], [`RocArea::of`] | how well scores tell two groups apart |
//! | [`ToleranceInterval::of`] | the range that holds 95 % of people |
//! | [`guess_mouth`], [`other_tissue_share`], [`surrounding_share`] | where tongue, lips and teeth may lie, whether a region holds two tissues, how much lies around a mouth |
//! | [`NormSums::of`], [`Norm::place`] | the same by age and site, pooled over sites, and where a person stands in it |
//! | [`lie_apart`] | values apart from the others |
//! | [`Agreement::of`] | estimates against their truth |
//! | [`ChannelSignal`], [`SignalRatio`], [`Unmixing`] | levels of any channels of any frames, their ratios, and the fluorophores that they are made of |
//! | [`TargetDetection::new`] | how well a target is told from what lies around it: contrast, d', smallest diameter, frames |
//! | [`interval_of_difference`] | whether two estimates differ by more than their intervals leave open |
//! | [`analyze_region`] | all of it at once, as an [`Analysis`] that goes to `results.json` |
//!
//! Out of scope: telling the four bulk fluorophores apart. Under one excitation light their chromaticities are too
//! close, and three channels leave no room for five unknowns.

mod agreement;
mod analyte;
mod channel_noise;
mod channel_signals;
mod chromaticity;
mod detection;
mod difference;
mod error_budget;
mod family_average;
mod light_family;
mod mixture_line;
mod mouth_guess;
mod norm;
mod outlier;
mod pattern_table;
mod pixel_mean;
mod red_pattern;
mod region_blocks;
mod region_light;
mod region_of_interest;
mod region_shape;
mod share_posterior;
mod spectral_mixture;
mod spectral_overlap;
mod spot_separation;
mod statistics;
mod summary;
mod target_detection;
mod tolerance;
mod visible_share;

pub use agreement::{Agreement, EstimateOfTruth};
pub use analyte::Analyte;
pub use channel_noise::{ChannelNoise, LineNoise};
pub use channel_signals::{
    ChannelSignal, OtherLight, SignalRatio, SignalSummary, UnmixedTerm, Unmixing, UnmixingTerm,
};
pub use chromaticity::{
    ChromaticityMap, DEFAULT_NOISE_THRESHOLD, ExclusionCounts, MissingChannel, PixelValidity,
    chromaticity_covariance, rgb_channels, sensor_chromaticity,
};
pub use detection::{
    RocArea, auc_of_d_prime, auc_of_scores, d_prime_of_rates, d_prime_of_scores, group_size_for_area,
    roc_curve,
};
pub use difference::interval_of_difference;
pub use error_budget::{BudgetInput, BudgetItem, ErrorBudget};
pub use family_average::{FamilyAverage, TissueDoubt, TissueEvidence};
pub use light_family::{CubicTerms, FamilyCoordinate, FamilySource, LightFamily, NuisanceGroup};
pub use mixture_line::{
    DETECTION_Z, FluorophoreResponse, LineEstimate, MixtureEnd, MixtureError, MixtureLine, PorphyrinLayers,
    PorphyrinMap, channel_response,
};
pub use mouth_guess::{GuessedRegion, guess_mouth, other_tissue_share, surrounding_share};
pub use norm::{Norm, NormError, NormPerson, NormPlace, NormSums, SiteSums, Standing};
pub use outlier::lie_apart;
pub use pixel_mean::{PixelMean, mean_of_pixels};
pub use region_blocks::{BlockShare, BlockShares, LEAST_BLOCKS, RegionBlock, block_side_px};
pub use region_light::{PorphyrinTruth, RegionLight};
pub use region_of_interest::{PixelSelection, Rectangle, RegionError, RegionOfInterest, SceneOnSensor};
pub use region_shape::{PixelMask, Polygon};
pub use share_posterior::{
    BlindDirection, IntervalWithout, RedShare, ShareInterval, ShareOfMean, SharePosterior,
};
pub use spectral_mixture::{
    BloodBefore, ComponentSet, ComponentSets, FitChiSquare, FitError, FittedBlood, FittedWeight,
    MixtureComponent, MixtureFit, ResidualCorrelation, ResidualScatter, SetMembership, SpectralMixture,
};
pub use spectral_overlap::spectral_overlap;
pub use spot_separation::{SpotScale, SpotSeparation};
pub use statistics::{ChannelStatistics, CovarianceEllipse, RegionStatistics, Statistics, median};
pub use summary::{
    Analysis, AnalysisError, AnalysisSettings, MedianLevel, MixtureModel, MixtureSummary,
    PredictedFluorophore, RegionFraction, analyze_region,
};
pub(crate) use summary::{PixelAnalysis, analyze_pixels};
pub use target_detection::{ChannelContrast, RenderNoise, TargetDetection};
pub use tolerance::{ToleranceInterval, ToleranceMethod, ValueRange};
pub use visible_share::{PorphyrinSpread, SignalLevel, VisibleShare};
