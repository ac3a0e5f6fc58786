//! The error at which a render is good enough, in the channels of captures or in a range of wavelengths.

use super::context::{Context, Resolved};
use crate::error::steps;
use crate::schema::{RenderSection, StatisticsChoice};
use fluorspar::image::StatisticsKind;
use fluorspar::names::did_you_mean;
use fluorspar::render::{ErrorChannel, ErrorTarget};
use fluorspar::scene::Scene;
use fluorspar::study::{Camera, Capture};

pub(super) fn statistics(section: &RenderSection) -> StatisticsKind {
    match section.statistics {
        StatisticsChoice::None => StatisticsKind::None,
        StatisticsChoice::LightGroups => StatisticsKind::LightGroups,
        StatisticsChoice::Components => StatisticsKind::Components,
    }
}

pub(super) fn error_target(
    context: &Context<'_>,
    section: &RenderSection,
    scene: &Scene,
    captures: &[Capture],
    camera: &Camera,
) -> Resolved<Option<ErrorTarget>> {
    let at = |key: &str| steps!["render", key];
    let Some(error) = section.relative_error else {
        for (key, given) in [
            ("error_captures", section.error_captures.is_some()),
            ("error_range_nm", section.error_range_nm.is_some()),
        ] {
            if given {
                return context.fail(&at(key), "has an effect only with relative_error; give both");
            }
        }
        return Ok(None);
    };
    let relative_error = context.within(&at("relative_error"), error, [1e-4, 0.5], "")?;
    let grid = &scene.grid;
    let groups = &scene.light_groups;
    let optics = camera.lens_behind_filters().zip(camera.sensor.as_ref());
    if section.error_captures.is_some() && section.error_range_nm.is_some() {
        return context.fail(&at("error_range_nm"), "excludes error_captures; give one of the two");
    }
    if let Some(wanted) = &section.error_captures {
        if optics.is_none() {
            return context
                .fail(&at("error_captures"), "needs a [lens] and a [sensor]; or give error_range_nm");
        }
        let known = || captures.iter().map(|capture| capture.frame.label.as_str());
        if wanted.is_empty() {
            return context.fail(&at("error_captures"), "names no capture; leave it out for all of them");
        }
        for (index, name) in wanted.iter().enumerate() {
            if !known().any(|label| label == name) {
                let hint = did_you_mean(name, known());
                let list = known().collect::<Vec<_>>().join(", ");
                let message = format!("there is no capture of this name{hint} Known: {list}");
                return context.fail(&steps!["render", "error_captures", index], message);
            }
        }
    }
    let mut channels = Vec::new();
    if let (Some((lens, sensor)), None) = (&optics, section.error_range_nm) {
        let transmittance = lens.transmittance_on(grid);
        for capture in captures {
            let frame = &capture.frame;
            let drives: Vec<f64> = groups.iter().map(|group| frame.drive(&group.name)).collect();
            let wanted = section.error_captures.as_ref().is_none_or(|names| names.contains(&frame.label));
            if !wanted || drives.iter().all(|&drive| drive == 0.0) {
                continue;
            }
            for (channel, weights) in sensor.qe().channels().iter().zip(sensor.electron_weights(grid)) {
                let weights: Vec<f64> =
                    weights.iter().zip(transmittance.values()).map(|(w, t)| w * t).collect();
                if weights.iter().any(|&w| w > 0.0) {
                    let name = format!("{}.{}", frame.label, channel.name);
                    channels.push(ErrorChannel { name, drives: drives.clone(), weights });
                }
            }
        }
    }
    if channels.is_empty() && section.error_captures.is_some() {
        return context.fail(&at("error_captures"), "no light is on in these captures; name others");
    }
    if channels.is_empty() {
        let [low, high] = section.error_range_nm.unwrap_or([0.0, f64::MAX]);
        let is_wavelength = |nm: f64| (0.0..=1e5).contains(&nm);
        if section.error_range_nm.is_some() && !(is_wavelength(low) && is_wavelength(high) && low < high) {
            let message = "must rise, between 0 and 100000: [first, last] in nm, such as [500, 700]";
            return context.fail(&at("error_range_nm"), message);
        }
        let weights: Vec<f64> = (0..grid.len())
            .map(|band| if (low..=high).contains(&grid.center_nm(band)) { grid.width_nm(band) } else { 0.0 })
            .collect();
        if weights.iter().all(|&w| w == 0.0) {
            let [first, last] = [0, grid.len() - 1].map(|band| grid.center_nm(band));
            let message = format!("holds no band of the render; they lie between {first} and {last} nm");
            return context.fail(&at("error_range_nm"), message);
        }
        for (index, group) in groups.iter().enumerate() {
            let drives = (0..groups.len()).map(|g| if g == index { 1.0 } else { 0.0 }).collect();
            channels.push(ErrorChannel { name: group.name.clone(), drives, weights: weights.clone() });
        }
    }
    Ok(Some(ErrorTarget { relative_error, channels }))
}
