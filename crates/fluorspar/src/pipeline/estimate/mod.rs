//! From frames to numbers with their intervals: signals of regions, leak, targets, tissue; for a flat sample, too.

pub(super) mod analyze;
mod camera_scales;
mod channel_analysis;
mod depth_of_light;
mod design_estimate;
mod filter_leak;
mod frame_leak;
pub(super) mod frame_light;
mod predict;
mod region_light;
mod region_radiance;
mod region_signal;
mod rendered_regions;
mod spot_separations;
mod targets;
mod tissue_estimate;
mod tissue_family;
mod tissue_mixture;

pub use analyze::{AnalyzedFrame, AnalyzedRegion, analyze, analyze_regions, analyze_seen};
pub use camera_scales::{
    CameraScales, EfficiencyScale, FilterLeakage, KnownTarget, LightScale, RecordedTarget, target_rates,
};
pub use depth_of_light::{DepthOfLight, LayerShare, depths_of_light};
pub use design_estimate::{DesignEstimate, design_estimate};
pub use filter_leak::{FilterLeak, LeakAtAngle, LeakBehindFilters, filter_leak};
pub use frame_leak::{ChannelLeak, FrameLeak, frame_leak};
pub use predict::{
    ChannelPrediction, Chromaticity, PredictError, PredictedPorphyrin, Prediction, RadianceSplit, predict,
};
pub use region_radiance::RegionRadiance;
pub use region_signal::{CameraResponse, MixtureSpectra, PorphyrinEstimate, estimate_porphyrin};
pub use rendered_regions::{BasisRender, rendered_regions};
pub use targets::{TargetLabels, noise_of, target_labels};
pub use tissue_family::{FamilyFrame, other_tissue_families, tissue_family};
pub use tissue_mixture::{TISSUE_BLOOD, TissueView, tissue_mixture};
