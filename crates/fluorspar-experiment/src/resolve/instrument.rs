//! Development, motion, spectroradiometers and safety.

use super::context::{Context, LENGTH_MM, Resolved};
use super::spectrum::Role;
use crate::error::steps;
use crate::preset::{self, PresetKind};
use crate::schema::{ExperimentFile, SafetySection};
use fluorspar::scene::Object;
use fluorspar::sensor::{Demosaicing, Sensor, Spectroradiometer};
use fluorspar::spectral::{Curve, WavelengthGrid};
use fluorspar::study::{
    Capture, Develop, FlatFieldPlan, Motion, SafetyPlan, SpectroradiometerPlan, SpectroradiometerTarget,
};

pub(super) fn motion(context: &Context<'_>, file: &ExperimentFile) -> Resolved<Option<Motion>> {
    let Some(section) = &file.motion else { return Ok(None) };
    for (index, drift) in section.drift_px_per_s.iter().enumerate() {
        context.within(
            &steps!["motion", "drift_px_per_s", index],
            *drift,
            [-1e6, 1e6],
            "pixels per second",
        )?;
    }
    context.within(&steps!["motion", "jitter_px"], section.jitter_px, [0.0, 1000.0], "pixels")?;
    context.within(&steps!["motion", "interval_ms"], section.interval_ms, [0.0, 1e6], "ms")?;
    Ok(Some(Motion {
        drift_px_per_s: section.drift_px_per_s,
        jitter_px: section.jitter_px,
        interval_ms: section.interval_ms,
    }))
}

pub(super) fn develop(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    sensor: Option<&Sensor>,
    grid: &WavelengthGrid,
) -> Resolved<Develop> {
    let Some(section) = &file.develop else { return Ok(Develop::default()) };
    let at = |key: &str| steps!["develop", key];
    context.whole_within(&at("dark_frames"), section.dark_frames.into(), [0, 1000])?;
    if let (Demosaicing::GradientCorrected, Some(sensor)) = (section.demosaic, sensor)
        && !sensor.mosaic().is_bayer()
    {
        let message = "the mosaic of the sensor is not a two by two Bayer array; use \"bilinear\"";
        return context.fail(&at("demosaic"), message);
    }
    let mut flat_field = None;
    if let Some(flat) = &section.flat_field {
        let inner = |key: &str| steps!["develop", "flat_field", key];
        context.whole_within(&inner("frames"), flat.frames.into(), [1, 1000])?;
        context.within(&inner("level"), flat.level, [0.01, 0.95], "of full scale")?;
        let spectrum = context.spectrum(&inner("spectrum"), &flat.spectrum, Role::Light, 0.0, grid)?;
        flat_field = Some(FlatFieldPlan { frames: flat.frames, level: flat.level, spectrum });
    }
    if let Some(sigma) = section.bad_pixel_sigma {
        context.within(&at("bad_pixel_sigma"), sigma, [1.0, 1000.0], "robust standard deviations")?;
        if section.dark_frames == 0 && flat_field.is_none() {
            let message = "bad pixels are found in dark frames or a flat field; set develop.dark_frames, or add \
                           [develop.flat_field]";
            return context.fail(&at("bad_pixel_sigma"), message);
        }
    }
    Ok(Develop {
        demosaicing: section.demosaic,
        dark_frames: section.dark_frames,
        flat_field,
        bad_pixel_sigma: section.bad_pixel_sigma,
    })
}

pub(super) fn spectroradiometers(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    captures: &[Capture],
    objects: &[Object],
    grid: &WavelengthGrid,
) -> Resolved<Vec<SpectroradiometerPlan>> {
    let mut list = Vec::new();
    for (index, section) in file.spectroradiometer.iter().enumerate() {
        let base = steps!["spectroradiometer", index];
        let at = |key: &str| steps!["spectroradiometer", index, key];
        let earlier = file.spectroradiometer[..index].iter().map(|other| other.name.as_str());
        context.unique_name(&base, &section.name, earlier)?;
        let known = captures.iter().map(|c| c.frame.label.as_str());
        let what = "there is no capture of this name";
        let capture = &captures[context.known(&at("capture"), &section.capture, known, what)?];
        let known = objects.iter().map(|object| object.name.as_str());
        context.check_names(&at("parts"), &section.parts, known, "the scene has no part of this name")?;
        if section.aim.is_some() && !section.parts.is_empty() {
            return context.fail(&at("aim"), "given together with parts; keep one of the two");
        }
        if section.aim.is_some_and(|aim| aim.iter().any(|share| !(0.0..=1.0).contains(share))) {
            let message = "both numbers must be between 0 and 1: fractions of the image width and height";
            return context.fail(&at("aim"), message);
        }
        context.within(&at("acceptance_deg"), section.acceptance_deg, [0.01, 60.0], "degrees")?;
        let mut filter = Curve::constant(1.0);
        for (number, reference) in section.filters.iter().enumerate() {
            let at = steps!["spectroradiometer", index, "filters", number];
            filter = filter.times(&context.spectrum(&at, reference, Role::Filter, 0.0, grid)?);
        }
        let instrument = Spectroradiometer {
            first_nm: section.first_nm,
            last_nm: section.last_nm,
            step_nm: section.step_nm,
            bandwidth_nm: section.bandwidth_nm,
            noise_floor: section.noise_floor_w_per_sr_m2_nm,
            dynamic_range: section.dynamic_range,
            stray_light: section.stray_light,
            readings: section.readings,
            filter,
        };
        instrument.validate().map_err(|problem| {
            let field =
                if problem.field == "noise_floor" { "noise_floor_w_per_sr_m2_nm" } else { &problem.field };
            context.error(&at(field), problem.message.clone())
        })?;
        let target = if section.parts.is_empty() {
            SpectroradiometerTarget::Spot {
                aim: section.aim.unwrap_or([0.5; 2]),
                acceptance_deg: section.acceptance_deg,
            }
        } else {
            SpectroradiometerTarget::Parts(section.parts.clone())
        };
        list.push(SpectroradiometerPlan {
            name: section.name.clone(),
            frame: capture.frame.clone(),
            target,
            instrument,
        });
    }
    Ok(list)
}

pub(super) fn safety(context: &Context<'_>, file: &ExperimentFile) -> Resolved<SafetyPlan> {
    let defaults = SafetySection::default();
    let section = file.safety.as_ref().unwrap_or(&defaults);
    let at = |key: &str| steps!["safety", key];
    for (key, value) in [
        ("patient_eye_distance_mm", section.patient_eye_distance_mm),
        ("operator_eye_distance_mm", section.operator_eye_distance_mm),
        ("mucosa_distance_mm", section.mucosa_distance_mm),
        ("lit_diameter_mm", Some(section.lit_diameter_mm)),
    ] {
        if let Some(value) = value {
            context.within(&at(key), value, LENGTH_MM, "millimeters")?;
        }
    }
    context.within(&at("reflectance"), section.reflectance, [0.0, 1.0], "")?;
    if let Some(factor) = section.mucosa_safety_factor {
        context.within(&at("mucosa_safety_factor"), factor, [1.0, 1000.0], "")?;
    }
    let is_mouth = section.mucosa_safety_factor.is_some() || holds_mucosa(file);
    Ok(SafetyPlan {
        patient_eye_distance_mm: section.patient_eye_distance_mm,
        operator_eye_distance_mm: section.operator_eye_distance_mm,
        mucosa_distance_mm: section.mucosa_distance_mm.unwrap_or_else(|| file.camera.distance_mm()),
        lit_diameter_mm: section.lit_diameter_mm,
        reflectance: section.reflectance,
        mucosa_safety_factor: section.mucosa_safety_factor.unwrap_or(if is_mouth {
            MUCOSA_FACTOR
        } else {
            1.0
        }),
        aphakic: section.aphakic,
        is_mouth,
    })
}

/// Limits for skin are divided by it where a mouth is lit (assumed).
const MUCOSA_FACTOR: f64 = 10.0;

/// Whether a scene has a mouth, or a material of one of its sites.
fn holds_mucosa(file: &ExperimentFile) -> bool {
    let is_site = |name: &str| match file.tissue.iter().find(|section| section.name == name) {
        None => preset::names(PresetKind::Site).contains(&name),
        Some(section) => section.site.is_some(),
    };
    file.mouth.is_some() || file.material.iter().filter_map(|material| material.tissue()).any(is_site)
}
