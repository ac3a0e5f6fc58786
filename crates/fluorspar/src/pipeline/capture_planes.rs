//! The channel planes of all captures of a study.

use super::PipelineError;
use super::film_response::FilmResponse;
use crate::image::{ChannelPlanes, ComponentFactors, ComponentImage};
use crate::sensor::{CaptureFrame, FilmExtent, FilmRates};
use crate::study::Study;

/// Lens, filters and sensor of all captures of a study, those that captures share only once.
pub struct CaptureResponses {
    /// The different responses.
    pub responses: Vec<FilmResponse>,
    /// Number of the response of each capture.
    pub of_capture: Vec<usize>,
}

impl CaptureResponses {
    /// The responses of a study's captures. Of the component image only the labels count; it may be without values.
    ///
    /// # Errors
    /// A study without lens or sensor.
    pub fn new(study: &Study, components: &ComponentImage) -> Result<Self, PipelineError> {
        let mut responses: Vec<FilmResponse> = Vec::new();
        let mut of_capture = Vec::with_capacity(study.captures.len());
        for (number, capture) in study.captures.iter().enumerate() {
            let same = study.captures[..number].iter().position(|other| other.filter == capture.filter);
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
        let CaptureResponses { responses, of_capture } = CaptureResponses::new(study, components)?;
        let film = responses.first().ok_or(PipelineError::Missing("captures"))?.film();
        let all: Vec<&FilmResponse> = responses.iter().collect();
        let Ok(planes) = FilmResponse::planes(&all, |_| true, components);
        Ok(Self { planes, of_capture, film })
    }

    /// Electrons per second at the samples of the film in a capture, whose number is given, with the drives of a frame and
    /// factors on the components.
    pub fn film_rates(
        &self,
        capture: usize,
        frame: &CaptureFrame,
        components: &ComponentImage,
        factors: &ComponentFactors,
    ) -> FilmRates {
        let planes = &self.planes[self.of_capture[capture]];
        let drives = components.components.iter().map(|component| frame.drive(&component.light_group));
        let data = planes.weighted_sum(&factors.times(drives));
        FilmRates { width: planes.width, height: planes.height, data }
    }
}
