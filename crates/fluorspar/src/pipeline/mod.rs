//! Whole chains: a flat sample in numbers, a study from scene to analysis.
//!
//! | stage | call | gives |
//! |---|---|---|
//! | light transport | [`crate::render::render`] | [`crate::image::ComponentImage`] |
//! | lens, filters, quantum efficiency as weights | [`FilmResponse`] | [`crate::image::ChannelPlanes`] |
//! | planes of all captures | [`CapturePlanes`] | [`crate::sensor::FilmRates`] |
//! | excitation kept apart by wavelength, and other light spectra in a finished render | [`crate::render::choose_basis`], [`render_with_basis`], [`relight_with_basis`] | [`crate::image::ExcitationImage`] |
//! | regions of such renders, for the design of a camera | [`rendered_regions`] | [`crate::design::RegionModel`]s |
//! | other concentrations in a finished render | [`concentration_factors`], [`scale_multiple`] | [`crate::image::ComponentFactors`] |
//! | lens, sensor, development | [`capture`], [`capture_from_planes`] | [`CapturedFrame`]s |
//! | dark frames, flat field, bad pixels | [`Calibration`] | |
//! | spectroradiometers | [`read_spectroradiometers`] | [`SpectroradiometerReading`]s |
//! | photobiological safety | [`assess_safety`] | [`SafetyReport`] |
//! | chromaticity, porphyrin | [`analyze`] | [`AnalyzedFrame`] |
//! | the same of further regions of the frame | [`analyze_regions`] | [`AnalyzedRegion`]s |
//! | targets, told from what lies around them | [`analyze`] | [`TargetLabels`], [`crate::analysis::TargetDetection`]s |
//! | two spots, told apart | [`analyze`] | [`crate::analysis::SpotSeparation`]s |
//! | less noise, for display | [`denoise`] | [`crate::image::ComponentImage`], labeled |
//! | a frame for the screen, less noisy | [`for_display`] | [`DisplayImage`] |
//! | previews | [`preview`] | 8-bit sRGB |
//! | a scene without its light: clay, parts, depth | [`surface_view`] of [`crate::render::visible_surfaces`] | 8-bit sRGB |
//! | reflected light against fluorescence behind filters | [`filter_leak`] | [`FilterLeak`] |
//! | the same for the frames of a study, in electrons | [`frame_leak`] | [`FrameLeak`] |
//! | depths from which the fluorescence of tissue comes | [`depths_of_light`] | [`DepthOfLight`]s |
//! | a camera and its lights against their description, from known targets | [`target_rates`], [`CameraScales::of`] | |
//! | one region for one design, in about a microsecond | [`estimate_porphyrin`] | [`PorphyrinEstimate`] |
//! | the same region, should it be other tissue | [`other_tissue_families`] | [`crate::analysis::LightFamily`], each |
//! | a region of tissue of a known site, its share of porphyrin with everything unknown | [`tissue_family`] | [`crate::analysis::LightFamily`] |
//! | fluorophores of layered tissue as components of a measured spectrum | [`tissue_mixture`] | [`crate::analysis::SpectralMixture`] |
//! | images larger than the memory | [`render_row_bands`] | rows for a [`BandStore`] |
//! | everything after the render, each result once | [`evaluate`] | [`Evaluation`] |
//! | all of it for a flat sample | [`predict`] | [`Prediction`] |

mod capture;
mod display;
mod error;
mod estimate;
mod evaluate;
mod safety;

pub use capture::{
    BandPlanes, BandStore, BandedRender, BitFit, Calibration, CapturePlanes, CaptureResponses, CapturedFrame,
    ChannelLight, FilmResponse, FinishedBands, IncompleteRaw, MultipleUncertainty, RawExposures,
    RecentExposures, RelitImage, RowBandError, SeenComponents, SpectroradiometerReading, bracket_label,
    capture, capture_from_planes, capture_irradiance, capture_one, channel_light, check_captures,
    check_same_scene, columns_per_column_to_render, columns_per_render_column, complete_raw,
    concentration_factors, develop_frames, frame_radiance, image_and_basis, on_sensor,
    read_spectroradiometers, relight_with_basis, render_row_bands, render_with_basis, row_bands,
    scale_multiple, subtract_what_is_given, tile_rows_at_once, turned_alike,
};
pub use display::{
    CameraColor, ColorRendering, DenoiseError, DenoiseSettings, DisplayImage, LiveCapture, LivePlane,
    LiveView, Preview, SurfaceView, bright_level_dn, denoise, depth_range_m, for_display,
    light_group_preview, part_color, preview, preview_white, preview_with_white, radiance_preview,
    reduce_to_preview, surface_view,
};
pub use error::{LightOutsideBasis, PipelineError};
pub use estimate::{
    AnalyzedFrame, AnalyzedRegion, BasisRender, CameraResponse, CameraScales, ChannelLeak, ChannelPrediction,
    Chromaticity, DepthOfLight, DesignEstimate, EfficiencyScale, FamilyFrame, FilterLeak, FilterLeakage,
    FrameLeak, KnownTarget, LayerShare, LeakAtAngle, LeakBehindFilters, LightScale, MixtureSpectra,
    PorphyrinEstimate, PredictError, PredictedPorphyrin, Prediction, RadianceSplit, RecordedTarget,
    RegionRadiance, TISSUE_BLOOD, TargetLabels, TissueView, analyze, analyze_regions, analyze_seen,
    depths_of_light, design_estimate, estimate_porphyrin, filter_leak, frame_leak, noise_of,
    other_tissue_families, predict, rendered_regions, target_labels, target_rates, tissue_family,
    tissue_mixture,
};
pub use evaluate::{Evaluation, evaluate, evaluate_frames, evaluate_from_planes};
pub use safety::{
    CaptureSafety, ProgramSafety, SafetyReport, Viewer, ViewerSafety, assess_safety, eye_before_group,
};
