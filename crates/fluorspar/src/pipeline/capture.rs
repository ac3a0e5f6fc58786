//! From a component image to raw and developed frames.

use super::PipelineError;
use crate::analysis::SceneOnSensor;
use crate::experiment::ResolvedExperiment;
use crate::image::{ChannelImage, ComponentImage, SensorImage, SpectralImage};
use crate::optics::IdealLens;
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

/// How large a rendered image lies on the film behind a lens: its field of view is that of the camera that rendered it,
/// whatever lens or sensor the experiment has now.
pub(super) fn film_extent(
    experiment: &ResolvedExperiment,
    components: &ComponentImage,
    lens: &IdealLens,
) -> FilmExtent {
    let tan_half =
        components.features.view.map_or(experiment.scene.camera.tan_half_width, |v| v.tan_half_width);
    let field_deg = 2.0 * f64::from(tan_half).atan().to_degrees();
    FilmExtent::of_width(lens.film_width_mm(field_deg), components.width, components.height)
}

/// The image on the film, relative to the sensor.
pub(super) fn on_sensor<'a>(
    experiment: &ResolvedExperiment,
    components: &'a ComponentImage,
) -> Option<SceneOnSensor<'a>> {
    let film = film_extent(experiment, components, experiment.lens.as_ref()?);
    let sensor = experiment.sensor.as_ref()?.film_extent();
    let film_over_sensor = [film.width_mm / sensor.width_mm, film.height_mm / sensor.height_mm];
    Some(SceneOnSensor { components, film_over_sensor })
}

/// Takes all frames of an experiment: lights of the frame, lens, sensor, development.
///
/// Lens and sensor may be others than those that the image was rendered for: the sensor then sees more or less of it.
/// What lies beyond the rendered field is dark.
///
/// # Errors
/// An experiment without lens, sensor or captures; an image of another experiment or from another place; exposures that
/// can't be used.
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
    if let Some(view) = &components.features.view {
        let now = experiment.scene.camera.view();
        let apart = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-6);
        if apart(view.position_m, now.position_m)
            || apart(view.forward, now.forward)
            || apart(view.right, now.right)
        {
            return Err(PipelineError::OtherCamera);
        }
    }
    let film = film_extent(experiment, components, lens);
    let raws = sensor.expose_sequence(&experiment.capture_sequence(), experiment.render.seed, |frame| {
        let irradiance = lens.form_image(&frame_radiance(frame, components), film.width_mm);
        sensor.electron_rate_on_film(&irradiance, film).map_err(PipelineError::from)
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
