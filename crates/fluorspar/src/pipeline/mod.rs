//! Whole chains: a flat sample in numbers, an experiment from scene to analysis.
//!
//! | stage | call | gives |
//! |---|---|---|
//! | light transport | [`crate::render::render`] | [`crate::image::ComponentImage`] |
//! | lens, sensor, development | [`capture`] | [`CapturedFrame`]s |
//! | chromaticity, porphyrin | [`analyze`] | [`AnalyzedFrame`] |
//! | less noise, for pictures | [`denoise`] | [`crate::image::ComponentImage`], labelled |
//! | pictures for people | [`preview`] | 8-bit sRGB |
//! | all of it for a flat sample | [`predict`] | [`Prediction`] |

mod analyze;
mod capture;
mod denoise;
mod predict;
mod preview;
mod region_radiance;

pub use analyze::{AnalyzedFrame, analyze};
pub use capture::{CapturedFrame, capture, develop_frames, frame_radiance};
pub use denoise::{DenoiseError, DenoiseSettings, denoise};
pub use predict::{
    ChannelPrediction, Chromaticity, FlatSample, FluorescenceModel, PredictError, Prediction, RadianceSplit,
    predict,
};
pub use preview::{ColorRendering, Preview, preview, radiance_preview};
pub use region_radiance::RegionRadiance;

use crate::analysis::AnalysisError;
use crate::sensor::{DevelopError, SensorProblem};

/// Why a stage of an experiment failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The experiment lacks something that the stage needs.
    #[error("the experiment has no {0}; add a {1} section, or start from `base = \"oraleye-2021\"`")]
    Missing(&'static str, &'static str),
    /// The sensor can't take the frame.
    #[error(transparent)]
    Sensor(#[from] SensorProblem),
    /// A frame can't be developed.
    #[error(transparent)]
    Develop(#[from] DevelopError),
    /// A frame can't be analysed.
    #[error(transparent)]
    Analysis(#[from] AnalysisError),
    /// A frame that another refers to is not there.
    #[error("there is no frame \"{wanted}\"; the frames are: {known}")]
    NoFrame {
        /// The name asked for.
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
    /// Images that belong together differ in their wavelengths.
    #[error(
        "the component image has {image} bands and the experiment {experiment}; they were made from different \
         experiments. Render again"
    )]
    OtherGrid {
        /// Bands of the image.
        image: usize,
        /// Bands of the experiment.
        experiment: usize,
    },
}
