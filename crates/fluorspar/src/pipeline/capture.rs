//! From a component image to raw and developed frames.

use super::PipelineError;
use crate::experiment::ResolvedExperiment;
use crate::image::{ChannelImage, ComponentImage, SensorImage, SpectralImage};
use crate::sensor::{CaptureFrame, FilmExtent, develop, develop_with_ambient};
use crate::spectral::Radiance;

/// One exposure, raw and developed.
#[derive(Clone, Debug, PartialEq)]
pub struct CapturedFrame {
    /// Digital numbers on the mosaic.
    pub raw: SensorImage,
    /// Linear channels, black (and ambient, if the experiment says so) subtracted.
    pub developed: ChannelImage,
}

/// Radiance under the lights of one frame: components weighted by the drive of their light group.
pub fn frame_radiance(frame: &CaptureFrame, components: &ComponentImage) -> SpectralImage<Radiance> {
    components.recombine(|component| frame.drive(&component.light_group))
}

/// Takes all frames of an experiment: lights of the frame, lens, sensor, development.
///
/// # Errors
/// An experiment without lens, sensor or captures; an image of another experiment; exposures that can't be used.
pub fn capture(
    experiment: &ResolvedExperiment,
    components: &ComponentImage,
) -> Result<Vec<CapturedFrame>, PipelineError> {
    let lens = experiment.lens.as_ref().ok_or(PipelineError::Missing("lens", "[lens]"))?;
    let sensor = experiment.sensor.as_ref().ok_or(PipelineError::Missing("sensor", "[sensor]"))?;
    if experiment.captures.is_empty() {
        return Err(PipelineError::Missing("captures", "[[capture]]"));
    }
    if components.grid != experiment.scene.grid {
        let (image, experiment) = (components.grid.len(), experiment.scene.grid.len());
        return Err(PipelineError::OtherGrid { image, experiment });
    }
    let known = components.light_groups();
    for c in &experiment.captures {
        let frame = &c.frame;
        if let Some(group) = frame.lights.keys().find(|g| frame.drive(g) > 0.0 && !known.contains(g)) {
            let (frame, group) = (frame.label.clone(), group.clone());
            return Err(PipelineError::OtherLights { frame, group, known: known.join(", ") });
        }
    }
    let field_deg = 2.0 * f64::from(experiment.scene.camera.tan_half_width).atan().to_degrees();
    let film_width_mm = lens.film_width_mm(field_deg);
    let film = FilmExtent::of_width(film_width_mm, components.width, components.height);
    let raws = sensor.expose_sequence(&experiment.capture_sequence(), experiment.render.seed, |frame| {
        let irradiance = lens.form_image(&frame_radiance(frame, components), film_width_mm);
        let filter = experiment.captures.iter().find(|c| c.frame.label == frame.label);
        let filtered = filter.and_then(|c| c.filter.as_ref()).map(|filter| sensor.behind(filter));
        filtered
            .as_ref()
            .unwrap_or(sensor)
            .electron_rate_on_film(&irradiance, film)
            .map_err(PipelineError::from)
    })?;
    develop_frames(experiment, raws)
}

/// Develops raw frames, subtracting from each the frame that the experiment names for it.
///
/// # Errors
/// When a frame to subtract is missing or does not fit.
pub fn develop_frames(
    experiment: &ResolvedExperiment,
    raws: Vec<SensorImage>,
) -> Result<Vec<CapturedFrame>, PipelineError> {
    let find = |label: &str| raws.iter().find(|raw| raw.label == label);
    let mut frames = Vec::with_capacity(raws.len());
    for raw in &raws {
        let subtract = experiment
            .captures
            .iter()
            .find(|c| c.frame.label == raw.label)
            .and_then(|c| c.subtract.as_deref());
        let developed = match subtract {
            None => develop(raw),
            Some(label) => {
                let ambient = find(label).ok_or_else(|| PipelineError::NoFrame {
                    wanted: label.into(),
                    known: raws.iter().map(|r| r.label.as_str()).collect::<Vec<_>>().join(", "),
                })?;
                develop_with_ambient(raw, ambient)?
            }
        };
        frames.push(CapturedFrame { raw: raw.clone(), developed });
    }
    Ok(frames)
}
