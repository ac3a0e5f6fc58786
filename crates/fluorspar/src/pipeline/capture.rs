//! From a component image to raw and developed frames.

use super::PipelineError;
use crate::experiment::ResolvedExperiment;
use crate::image::{ChannelImage, ComponentImage, SensorImage, SpectralImage};
use crate::optics::{FilterAutofluorescence, IdealLens};
use crate::sensor::{CaptureFrame, FilmExtent, develop, develop_with_ambient};
use crate::spectral::{Irradiance, Radiance, Transmittance};

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

/// Irradiance on the film from the radiance of a render, filters and their own light included.
fn film_irradiance(
    experiment: &ResolvedExperiment,
    lens: &IdealLens,
    radiance: &SpectralImage<Radiance>,
    film_width_mm: f64,
) -> SpectralImage<Irradiance> {
    let camera = &experiment.scene.camera;
    let mut irradiance = match &experiment.traced_lens {
        // A render through the lens holds lens radiance already.
        Some(traced) if camera.lens.is_none() => {
            lens.form_image(&traced.lens_radiance(radiance, f64::from(camera.tan_half_width)), film_width_mm)
        }
        _ => lens.form_image(radiance, film_width_mm),
    };
    if let Some(own) = &experiment.view_filters.autofluorescence {
        add_veil(experiment, lens, own, radiance, &mut irradiance);
    }
    irradiance
}

/// Adds the light of a fluorescing filter: excited by the mean radiance of the picture over the solid angle of its field,
/// spread evenly over the film.
fn add_veil(
    experiment: &ResolvedExperiment,
    lens: &IdealLens,
    own: &FilterAutofluorescence,
    radiance: &SpectralImage<Radiance>,
    irradiance: &mut SpectralImage<Irradiance>,
) {
    let camera = &experiment.scene.camera;
    let half_width = f64::from(camera.tan_half_width);
    let half_height = half_width * camera.height as f64 / camera.width as f64;
    let field_sr = projected_solid_angle(half_width, half_height);
    let grid = radiance.grid();
    let arriving: Vec<f64> = radiance.mean_spectrum().values().iter().map(|l| l * field_sr).collect();
    let passed = experiment.view_filter.on_grid::<Transmittance>(grid);
    let veil = own.veil_radiance(&arriving, passed.values(), grid);
    let solid_angle = lens.axial_solid_angle_sr();
    for pixel in irradiance.data_mut().chunks_exact_mut(veil.values().len()) {
        for (value, l) in pixel.iter_mut().zip(veil.values()) {
            *value += (solid_angle * l) as f32;
        }
    }
}

/// Irradiance on a plane per radiance of a rectangular field about its normal, `integral cos dOmega`, with the tangents of
/// half its width and height: `2 (x/sqrt(1+x²) atan(y/sqrt(1+x²)) + y/sqrt(1+y²) atan(x/sqrt(1+y²)))`.
pub(super) fn projected_solid_angle(x: f64, y: f64) -> f64 {
    let part = |a: f64, b: f64| {
        let root = (1.0 + a * a).sqrt();
        a / root * (b / root).atan()
    };
    2.0 * (part(x, y) + part(y, x))
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
    let film_width_mm = match &experiment.traced_lens {
        Some(traced) => traced.film_width_mm(),
        None => lens.film_width_mm(field_deg),
    };
    let film = FilmExtent::of_width(film_width_mm, components.width, components.height);
    let raws = sensor.expose_sequence(&experiment.capture_sequence(), experiment.render.seed, |frame| {
        let irradiance = film_irradiance(experiment, lens, &frame_radiance(frame, components), film_width_mm);
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
