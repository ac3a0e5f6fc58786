//! Light on the film: where a rendered image lies there, and the irradiance behind lens and filters.

use std::borrow::Cow;

use super::light_by_shape::{ShapedRadiance, light_by_shape};
use crate::analysis::SceneOnSensor;
use crate::image::{ComponentImage, SpectralImage};
use crate::optics::{FilterAutofluorescence, IdealLens};
use crate::pipeline::PipelineError;
use crate::sensor::FilmExtent;
use crate::spectral::{Irradiance, Radiance, Transmittance};
use crate::study::{Capture, Study};

/// Irradiance on the film from the radiance of a render, filters and their own light included.
pub(in crate::pipeline) fn film_irradiance(
    study: &Study,
    lens: &IdealLens,
    light: &ShapedRadiance,
    tan_half_width: f64,
    film_width_mm: f64,
) -> SpectralImage<Irradiance> {
    let (radiance, shape) = (&light.radiance, light.shape.as_ref());
    let mut irradiance = match study.camera.traced_lens() {
        // A render through the lens holds lens radiance already.
        Some(traced) if study.scene.camera.lens.is_none() => {
            let lens_radiance = traced.lens_radiance(radiance, tan_half_width);
            lens.form_image_under(&lens_radiance, film_width_mm, shape)
        }
        _ => lens.form_image_under(radiance, film_width_mm, shape),
    };
    if let Some(own) = &study.camera.view_filter.stack.autofluorescence {
        add_veil(study, lens, own, light, tan_half_width, &mut irradiance);
    }
    irradiance
}

/// Irradiance on the film under an image of the same radiance everywhere, without the filters' own light.
pub(super) fn flat_film_irradiance(
    study: &Study,
    lens: &IdealLens,
    radiance: &SpectralImage<Radiance>,
    film_width_mm: f64,
) -> SpectralImage<Irradiance> {
    match study.camera.traced_lens() {
        Some(traced) => {
            let mut darkened = radiance.clone();
            traced.darken(&mut darkened, film_width_mm);
            lens.form_image(&darkened, film_width_mm)
        }
        None => lens.form_image(radiance, film_width_mm),
    }
}

/// Adds the light of a fluorescing filter: excited by the mean radiance of the image over the solid angle of its field,
/// spread evenly over the film.
fn add_veil(
    study: &Study,
    lens: &IdealLens,
    own: &FilterAutofluorescence,
    light: &ShapedRadiance,
    tan_half_width: f64,
    irradiance: &mut SpectralImage<Irradiance>,
) {
    let radiance = &light.radiance;
    let tan_half_height = tan_half_width * radiance.height() as f64 / radiance.width() as f64;
    let field_sr = projected_solid_angle(tan_half_width, tan_half_height);
    let grid = radiance.grid();
    let arriving: Vec<f64> = radiance.mean_spectrum().values().iter().map(|l| l * field_sr).collect();
    let filter = &study.camera.view_filter.transmittance;
    let passed = match &light.shape {
        Some(shape) => filter.on_grid_under::<Transmittance>(grid, shape),
        None => filter.on_grid(grid),
    };
    let veil = own.veil_radiance(&arriving, passed.values(), grid);
    let glass = study.camera.lens_before_filters().bin_averages(grid);
    let solid_angle = lens.axial_solid_angle_sr();
    let veil: Vec<f64> = veil.values().iter().zip(glass).map(|(l, t)| solid_angle * l * t).collect();
    for pixel in irradiance.data_mut().chunks_exact_mut(veil.len()) {
        for (value, e) in pixel.iter_mut().zip(&veil) {
            *value += *e as f32;
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

/// Tangent of half the horizontal field of the pinhole that rendered an image.
pub(in crate::pipeline) fn tan_half_width(study: &Study, components: &ComponentImage) -> f64 {
    let camera = &study.scene.camera;
    f64::from(components.features.view.map_or(camera.tan_half_width, |view| view.tan_half_width))
}

/// Size of a rendered image on the film behind a lens: its field of view is that of the camera that rendered it,
/// whatever lens or sensor the study has now.
pub(in crate::pipeline) fn film_extent(
    study: &Study,
    components: &ComponentImage,
    lens: &IdealLens,
) -> FilmExtent {
    if let Some(traced) = study.camera.traced_lens() {
        return FilmExtent::of_width(traced.film_width_mm(), components.width, components.height);
    }
    let field_deg = 2.0 * tan_half_width(study, components).atan().to_degrees();
    FilmExtent::of_width(lens.film_width_mm(field_deg), components.width, components.height)
}

/// The lens with the filters of one capture.
pub(in crate::pipeline) fn behind_filter<'a>(lens: &'a IdealLens, capture: &Capture) -> Cow<'a, IdealLens> {
    match &capture.filter {
        Some(filter) => {
            let mut lens = lens.clone();
            lens.transmittance = lens.transmittance.times(filter);
            for (_, transmittance) in &mut lens.field_transmittance {
                *transmittance = transmittance.times(filter);
            }
            Cow::Owned(lens)
        }
        None => Cow::Borrowed(lens),
    }
}

/// The image on the film, relative to the sensor. `None` without lens or sensor.
pub fn on_sensor<'a>(study: &'a Study, components: &'a ComponentImage) -> Option<SceneOnSensor<'a>> {
    let film = film_extent(study, components, &study.camera.lens.as_ref()?.equation);
    let sensor = study.camera.sensor.as_ref()?.film_extent();
    let film_over_sensor = [film.width_mm / sensor.width_mm, film.height_mm / sensor.height_mm];
    let lens = study.camera.traced_lens().filter(|_| study.scene.camera.lens.is_none());
    let lens = lens.map(|lens| (&**lens, tan_half_width(study, components)));
    Some(SceneOnSensor { components, film_over_sensor, lens })
}

/// Columns of the frames for each column of a rendered image. Of the image only size and place count. `None` without lens or sensor.
pub fn columns_per_render_column(study: &Study, components: &ComponentImage) -> Option<f64> {
    let scene = on_sensor(study, components)?;
    Some(frame_columns(study)? * scene.film_over_sensor[0] / components.width as f64)
}

/// Columns of the frames for each column of the image that a study renders, before it is rendered. `None` without lens or sensor.
pub fn columns_per_column_to_render(study: &Study) -> Option<f64> {
    let (camera, view) = (&study.camera, &study.scene.camera);
    let film_mm = match camera.traced_lens() {
        Some(traced) => traced.film_width_mm(),
        None => {
            let field_deg = 2.0 * f64::from(view.tan_half_width).atan().to_degrees();
            camera.lens.as_ref()?.equation.film_width_mm(field_deg)
        }
    };
    let sensor_mm = camera.sensor.as_ref()?.film_extent().width_mm;
    Some(frame_columns(study)? * film_mm / sensor_mm / view.width.max(1) as f64)
}

/// Columns of the frames of a study, binned as they are.
fn frame_columns(study: &Study) -> Option<f64> {
    let model = study.camera.sensor.as_ref()?.model();
    Some(model.columns as f64 / model.binning.map_or(1.0, |binning| binning.columns as f64))
}

/// Irradiance on the film in one capture, in all bands, W/(m² nm): the light of its lights behind lens and filters, and the
/// extent of the image. Frames are made of [`CapturePlanes`](crate::pipeline::capture::CapturePlanes), which join this with the sensor.
///
/// # Errors
/// A study without a lens.
pub fn capture_irradiance(
    study: &Study,
    capture: &Capture,
    components: &ComponentImage,
) -> Result<(SpectralImage<Irradiance>, FilmExtent), PipelineError> {
    let lens = study.camera.lens_behind_filters().ok_or(PipelineError::Missing("lens"))?;
    let film = film_extent(study, components, &lens);
    let lens = behind_filter(&lens, capture);
    let tan_half_width = tan_half_width(study, components);
    let mut irradiance = SpectralImage::zeros(components.grid.clone(), components.width, components.height);
    for light in light_by_shape(study, &capture.frame, components) {
        irradiance.add(&film_irradiance(study, &lens, &light, tan_half_width, film.width_mm));
    }
    Ok((irradiance, film))
}
