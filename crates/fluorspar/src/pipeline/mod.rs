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
//! | one region for one design, in about a microsecond | [`estimate_porphyrin`] | [`PorphyrinEstimate`] |
//! | the same region, should it be other tissue | [`other_tissue_families`] | [`crate::analysis::LightFamily`], each |
//! | a region of tissue of a known site, its share of porphyrin with everything unknown | [`tissue_family`] | [`crate::analysis::LightFamily`] |
//! | fluorophores of layered tissue as components of a measured spectrum | [`tissue_mixture`] | [`crate::analysis::SpectralMixture`] |
//! | images larger than the memory | [`render_row_bands`] | rows for a [`BandStore`] |
//! | everything after the render, each result once | [`evaluate`] | [`Evaluation`] |
//! | all of it for a flat sample | [`predict`] | [`Prediction`] |

mod analyze;
mod calibration;
mod camera_color;
mod capture;
mod capture_planes;
mod channel_analysis;
mod concentration;
mod denoise;
mod depth_of_light;
mod direct_light;
mod display;
mod evaluate;
mod excitation_basis;
mod film_response;
mod filter_leak;
mod frame_leak;
mod light_by_shape;
mod motion;
mod predict;
mod preview;
mod region_light;
mod region_radiance;
mod region_signal;
mod rendered_regions;
mod row_bands;
mod safety;
mod scene_change;
mod spectroradiometer;
mod spot_separations;
mod surface_view;
mod targets;
mod tissue_estimate;
mod tissue_family;
mod tissue_mixture;

pub use analyze::{AnalyzedFrame, AnalyzedRegion, analyze, analyze_regions, analyze_seen};
pub use calibration::Calibration;
pub use camera_color::CameraColor;
pub use capture::{
    CapturedFrame, RawExposures, bracket_label, capture, capture_from_planes, capture_irradiance,
    check_captures, columns_per_column_to_render, columns_per_render_column, complete_raw, develop_frames,
    frame_radiance, subtract_what_is_given, turned_alike,
};
pub use capture_planes::{CapturePlanes, CaptureResponses, SeenComponents};
pub use concentration::{MultipleUncertainty, concentration_factors, scale_multiple};
pub use denoise::{DenoiseError, DenoiseSettings, denoise};
pub use depth_of_light::{DepthOfLight, LayerShare, depths_of_light};
pub use display::{DisplayImage, for_display};
pub use evaluate::{Evaluation, evaluate, evaluate_frames, evaluate_from_planes};
pub use excitation_basis::{
    LightOutsideBasis, RelitImage, image_and_basis, relight_with_basis, render_with_basis,
};
pub use film_response::FilmResponse;
pub use filter_leak::{FilterLeak, LeakAtAngle, LeakBehindFilters, filter_leak};
pub use frame_leak::{ChannelLeak, FrameLeak, frame_leak};
pub use predict::{
    ChannelPrediction, Chromaticity, PredictError, PredictedPorphyrin, Prediction, RadianceSplit, predict,
};
pub use preview::{
    ColorRendering, Preview, bright_level_dn, light_group_preview, preview, preview_white,
    preview_with_white, radiance_preview,
};
pub use region_radiance::RegionRadiance;
pub use region_signal::{CameraResponse, MixtureSpectra, PorphyrinEstimate, estimate_porphyrin};
pub use rendered_regions::{BasisRender, rendered_regions};
pub use row_bands::{
    BandPlanes, BandStore, BandedRender, FinishedBands, RowBandError, render_row_bands, row_bands,
    tile_rows_at_once,
};
pub use safety::{
    CaptureSafety, ProgramSafety, SafetyReport, Viewer, ViewerSafety, assess_safety, eye_before_group,
};
pub use scene_change::{check_same_scene, relight};
pub use spectroradiometer::{SpectroradiometerReading, read_spectroradiometers};
pub use surface_view::{SurfaceView, depth_range_m, part_color, surface_view};
pub use targets::TargetLabels;
pub use tissue_family::{FamilyFrame, other_tissue_families, tissue_family};
pub use tissue_mixture::{TISSUE_BLOOD, TissueView, tissue_mixture};

use crate::analysis::AnalysisError;
use crate::image::SpectrumOutOfSpan;
use crate::sensor::{DevelopError, SensorProblem};
use crate::tissue::TissueError;

/// Why a stage of a study failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The study lacks something that the stage needs.
    #[error("the experiment has no {0}")]
    Missing(&'static str),
    /// The sensor can't take the frame.
    #[error(transparent)]
    Sensor(#[from] SensorProblem),
    /// A frame can't be developed.
    #[error(transparent)]
    Develop(#[from] DevelopError),
    /// A frame can't be analyzed.
    #[error(transparent)]
    Analysis(#[from] AnalysisError),
    /// The depths of the light can't be computed.
    #[error("the depths of the light: {0}")]
    Depths(TissueError),
    /// The tissue that is assumed can't be computed.
    #[error("the tissue that analysis.tissue assumes: {0}")]
    Tissue(#[from] TissueError),
    /// A region beside that of the analysis can't be analyzed.
    #[error("the region \"{name}\": {error}")]
    Region {
        /// Its name.
        name: String,
        /// Why.
        error: Box<Self>,
    },
    /// A frame that another refers to is not there.
    #[error("there is no frame \"{wanted}\"; the frames are: {known}")]
    NoFrame {
        /// The requested name.
        wanted: String,
        /// The names that exist.
        known: String,
    },
    /// A frame wants lights that were not rendered.
    #[error(
        "the frame \"{frame}\" switches on the light group \"{group}\", which the component image does not hold; it \
         holds: {known}. Render the experiment again"
    )]
    OtherLights {
        /// The frame.
        frame: String,
        /// The light group.
        group: String,
        /// The groups of the image.
        known: String,
    },
    /// A light spectrum that the excitation bins of the image can't give.
    #[error(transparent)]
    Spectrum(#[from] SpectrumOutOfSpan),
    /// A light spectrum that the excitation basis of the image can't give.
    #[error(transparent)]
    OutsideBasis(#[from] LightOutsideBasis),
    /// A change that only a new render can follow.
    #[error(
        "{0} has changed since the component image was rendered, and the image would not show it: run or render the \
         experiment again, or undo the change. Without a new render you can change the drive level of a light group \
         (capture.NAME.light_groups.GROUP), the concentration of a fluorophore (concentration.NAME) and, if the image was \
         rendered with render.excitation_basis_nm, the spectra of the lights"
    )]
    OtherScene(String),
    /// A mask that does not cover the image.
    #[error(
        "concentration.{name}: the mask has {} x {} pixels, the render {} x {}; paint it on an image of the same \
         proportions, for instance a preview", .mask[0], .mask[1], .image[0], .image[1]
    )]
    OtherProportions {
        /// The fluorophore.
        name: String,
        /// Columns and rows of the mask.
        mask: [usize; 2],
        /// Columns and rows of the image.
        image: [usize; 2],
    },
    /// Even light of which nothing reaches the sensor.
    #[error(
        "nothing of the light of the flat field passes the lens and its filters; give develop.flat_field.spectrum a light \
         that the camera sees"
    )]
    DarkFlatField,
    /// The image was seen from elsewhere.
    #[error(
        "the component image was rendered from another place or in another direction than the [camera] of this \
         experiment; a moved camera sees other light. Render the experiment again"
    )]
    OtherCamera,
    /// Images that belong together differ in their wavelengths.
    #[error(
        "the component image has {image} bands and the experiment {study}; they were made from different \
         experiments. Render again"
    )]
    OtherGrid {
        /// Bands of the image.
        image: usize,
        /// Bands of the study.
        study: usize,
    },
}
