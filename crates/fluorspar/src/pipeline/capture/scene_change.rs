//! Differences between a study and the one that a component image was rendered from.

use std::fmt::Display;

use crate::light::Light;
use crate::pipeline::PipelineError;
use crate::render::RenderSettings;
use crate::study::{Capture, Study};
use crate::units::number_text;

/// Refuses a study whose scene differs from the one that a component image was rendered from: the image would show
/// the old scene under the new name.
///
/// `rendered` is the study that the image carries. Lens, viewing filter, sensor, captures, analysis, the seed of the
/// noise and the limits of the render may differ. So may the field of view where the lens and the sensor give it: the
/// image keeps its own.
///
/// # Errors
/// The first part of the scene that differs.
pub fn check_same_scene(rendered: &Study, wanted: &Study) -> Result<(), PipelineError> {
    match difference(rendered, wanted) {
        None => Ok(()),
        Some(what) => Err(PipelineError::OtherScene(what)),
    }
}

/// First entry of two lists of named things that differs.
fn named<'a, T: PartialEq, N: Display>(
    what: &str,
    old: &'a [T],
    new: &'a [T],
    name: impl Fn(&'a T) -> N,
) -> Option<String> {
    let changed = new.iter().find(|item| !old.contains(item));
    let removed = || old.iter().find(|item| !new.contains(item));
    match changed.or_else(removed) {
        Some(item) => Some(format!("{what} \"{}\"", name(item))),
        None if old.len() != new.len() => Some(format!("the number of {what}s")),
        None => None,
    }
}

/// Lights that differ in strength alone: a drive of their captures does the same without a render.
fn stronger_light(rendered: &Study, wanted: &Study) -> Option<String> {
    let pairs = || rendered.scene.lights.iter().zip(&wanted.scene.lights);
    let mut changed = pairs().filter(|(old, new)| old != new);
    let (first_old, first_new) = changed.next()?;
    let ratio = first_new.spectrum.total() / first_old.spectrum.total();
    let is_stronger =
        |(old, new): (&Light, &Light)| old.group == first_old.group && is_scaled(old, new, ratio);
    let group = &rendered.scene.light_groups.get(first_old.group)?.name;
    let is_whole_group = pairs().filter(|(old, _)| old.group == first_old.group).all(|(old, new)| old != new);
    let is_it = rendered.scene.lights.len() == wanted.scene.lights.len()
        && is_whole_group
        && ratio.is_finite()
        && pairs().filter(|(old, new)| old != new).all(is_stronger);
    let captures = wanted.captures.iter().filter(|capture| capture.frame.drive(group) > 0.0);
    let drive = |capture: &Capture| {
        let drive = six_digits(capture.frame.drive(group) * ratio);
        format!("--set capture.{}.light_groups.{group}={drive}", capture.frame.label)
    };
    let drives: Vec<String> = captures.map(drive).collect();
    (is_it && !drives.is_empty()).then(|| {
        format!(
            "the strength of light \"{}\" (which {} changes without a render)",
            first_old.name,
            drives.join(" ")
        )
    })
}

/// Whether a light is another one times a factor.
fn is_scaled(old: &Light, new: &Light, factor: f64) -> bool {
    let scaled = old.spectrum.scaled(factor);
    let apart = |a: f64, b: f64| (a - b).abs() > 1e-9 * a.abs().max(b.abs());
    Light { spectrum: new.spectrum.clone(), ..old.clone() } == *new
        && new.spectrum.wavelengths_nm() == scaled.wavelengths_nm()
        && !new.spectrum.values().iter().zip(scaled.values()).any(|(a, b)| apart(*a, *b))
}

/// A number to six digits, however small, as short as it can be typed.
fn six_digits(value: f64) -> String {
    number_text(format!("{value:.5e}").parse().unwrap_or(value))
}

fn difference(rendered: &Study, wanted: &Study) -> Option<String> {
    let (old, new) = (&rendered.scene, &wanted.scene);
    if old.grid != new.grid {
        return Some("the wavelength grid ([spectral])".into());
    }
    let listed = stronger_light(rendered, wanted)
        .or_else(|| named("light", &old.lights, &new.lights, |light| &light.name))
        .or_else(|| named("light group", &old.light_groups, &new.light_groups, |group| &group.name))
        .or_else(|| named("fluorophore", &old.fluorophores, &new.fluorophores, |f| &f.name))
        .or_else(|| named("material", &old.materials, &new.materials, |material| &material.name))
        .or_else(|| named("object", &old.objects, &new.objects, |object| &object.name));
    if listed.is_some() {
        return listed;
    }
    let (a, b) = (&old.camera, &new.camera);
    if (a.position, a.forward, a.right, a.up) != (b.position, b.forward, b.right, b.up)
        || (a.parallel_half_width_m, a.center) != (b.parallel_half_width_m, b.center)
    {
        return Some("place or direction of the camera".into());
    }
    // Another f-number or focus of a lens keeps the blur of the render
    let has_lens = rendered.camera.lens.is_some() && wanted.camera.lens.is_some();
    if a.aperture.is_some() != b.aperture.is_some() || !has_lens && a.aperture != b.aperture {
        return Some("the aperture of the camera (camera.aperture_mm)".into());
    }
    if (a.lens.is_some() || b.lens.is_some()) && a.lens != b.lens {
        return Some(
            "the lens through which the image was rendered ([lens], or the size of the [sensor])".into(),
        );
    }
    if !(rendered.camera.field_from_lens && wanted.camera.field_from_lens)
        && a.tan_half_width != b.tan_half_width
    {
        return Some("the field of view (camera.horizontal_field_deg)".into());
    }
    if (a.width, a.height) != (b.width, b.height) {
        return Some("the size of the image (render.width_px, render.height_px)".into());
    }
    let (a, b) = (&rendered.render, &wanted.render);
    if a.samples_per_pixel != b.samples_per_pixel {
        return Some("render.samples_per_pixel".into());
    }
    if a.max_depth != b.max_depth {
        return Some("render.max_depth".into());
    }
    let relative_error = |of: &RenderSettings| of.error_target.as_ref().map(|target| target.relative_error);
    if relative_error(a) != relative_error(b) {
        return Some("render.relative_error".into());
    }
    if a.statistics != b.statistics {
        return Some("render.statistics".into());
    }
    if a.component_bands != b.component_bands {
        return Some("render.component_bands".into());
    }
    if a.regularize != b.regularize {
        return Some("render.regularize".into());
    }
    // A list that was only put into another order.
    (old.lights != new.lights || old.objects != new.objects || old.materials != new.materials)
        .then(|| "the order of lights, objects or materials".into())
}
