//! The channel planes of all captures of a study.

use super::film_response::FilmResponse;
use crate::image::{ChannelPlanes, Component, ComponentFactors, ComponentImage};
use crate::pipeline::PipelineError;
use crate::sensor::{FilmExtent, FilmRates};
use crate::study::{Capture, Study};

/// Lens, filters and sensor of all captures of a study, those that captures share only once.
pub struct CaptureResponses {
    /// The different responses.
    pub responses: Vec<FilmResponse>,
    /// Number of the response of each capture.
    pub of_capture: Vec<usize>,
}

impl CaptureResponses {
    /// The responses of captures of a study. Of the component image only the labels count; it may be without values.
    ///
    /// # Errors
    /// A study without lens or sensor.
    pub fn new(
        study: &Study,
        captures: &[Capture],
        components: &ComponentImage,
    ) -> Result<Self, PipelineError> {
        let mut responses: Vec<FilmResponse> = Vec::new();
        let mut of_capture = Vec::with_capacity(captures.len());
        for (number, capture) in captures.iter().enumerate() {
            let same = captures[..number].iter().position(|other| other.filter == capture.filter);
            let shared = same.map(|other| of_capture[other]);
            of_capture.push(match shared {
                Some(index) => index,
                None => {
                    responses.push(FilmResponse::new(study, capture, components)?);
                    responses.len() - 1
                }
            });
        }
        Ok(Self { responses, of_capture })
    }
}

/// Channel planes of all captures of a study: what frames with any drives, concentrations, exposures and gains are sums of.
#[derive(Clone, Debug, PartialEq)]
pub struct CapturePlanes {
    /// The different planes, one for each response.
    pub planes: Vec<ChannelPlanes>,
    /// Number of the planes of each capture.
    pub of_capture: Vec<usize>,
    /// Extent of the image on the film.
    pub film: FilmExtent,
}

impl CapturePlanes {
    /// The planes of a study's captures from one pass over the spectra of an image in memory.
    ///
    /// # Errors
    /// A study without lens, sensor or captures.
    pub fn new(study: &Study, components: &ComponentImage) -> Result<Self, PipelineError> {
        let CaptureResponses { responses, of_capture } =
            CaptureResponses::new(study, &study.captures, components)?;
        let film = responses.first().ok_or(PipelineError::Missing("captures"))?.film();
        let all: Vec<&FilmResponse> = responses.iter().collect();
        let Ok(planes) = FilmResponse::planes(&all, |_| true, components);
        Ok(Self { planes, of_capture, film })
    }
}

/// The components of a render as the captures of a study see them.
#[derive(Clone, Copy, Debug)]
pub struct SeenComponents<'a> {
    /// The component image, of which labels and feature maps count; it may be without values.
    pub image: &'a ComponentImage,
    /// Its electrons in the captures.
    pub planes: &'a CapturePlanes,
    /// Labels of the captures that the planes are of, in their order.
    pub captures: &'a [Capture],
    /// Factors on the components.
    pub factors: &'a ComponentFactors,
}

impl SeenComponents<'_> {
    /// Electrons per second at the samples of the film in a capture, of components times the weight that each shall have.
    pub fn film_rates(&self, capture: &Capture, weight: impl Fn(&Component) -> f64) -> FilmRates {
        let number = self.captures.iter().position(|other| other.frame.label == capture.frame.label);
        let planes = &self.planes.planes[self.planes.of_capture[number.unwrap_or(0)]];
        let factors = self.factors.times(self.image.components.iter().map(weight));
        FilmRates { width: planes.width, height: planes.height, data: planes.weighted_sum(&factors) }
    }
}
