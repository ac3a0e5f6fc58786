//! Why a stage fails.

use crate::analysis::AnalysisError;
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

/// A light spectrum that an excitation basis can't make up.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{percent:.1} % of the light of group \"{group}\" lies outside the {} to {} nm that the render kept apart; render with \
     render.excitation_basis_nm around its peak", .span_nm[0], .span_nm[1]
)]
pub struct LightOutsideBasis {
    /// The light group.
    pub group: String,
    /// Share outside, %.
    pub percent: f64,
    /// First and last node, nm.
    pub span_nm: [f64; 2],
}
