//! The error at which a render is good enough, in the channels of captures or in a range of wavelengths.

use super::context::{Context, Resolved};
use crate::error::steps;
use crate::schema::RenderSection;
use fluorspar::light::LightGroup;
use fluorspar::optics::IdealLens;
use fluorspar::render::{ErrorChannel, ErrorTarget};
use fluorspar::scene::Scene;
use fluorspar::sensor::Sensor;
use fluorspar::study::{Camera, Capture};

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
    let optics = camera.lens_behind_filters().zip(camera.sensor.as_ref());
    let channels = match Counted::of(context, section)? {
        Counted::Captures(wanted) => {
            let Some((lens, sensor)) = &optics else {
                return context
                    .fail(&at("error_captures"), "needs a [lens] and a [sensor]; or give error_range_nm");
            };
            check_captures(context, wanted, captures)?;
            let channels = sensor_channels(
                |capture| wanted.contains(&capture.frame.label),
                scene,
                captures,
                lens,
                sensor,
            );
            if channels.is_empty() {
                return context.fail(&at("error_captures"), "no light is on in these captures; name others");
            }
            channels
        }
        Counted::Range(range_nm) => group_channels(context, range_nm, scene)?,
        Counted::All => {
            let seen = optics
                .map(|(lens, sensor)| sensor_channels(|_| true, scene, captures, &lens, sensor))
                .filter(|channels| !channels.is_empty());
            seen.map_or_else(|| group_channels(context, [0.0, f64::MAX], scene), Ok)?
        }
    };
    Ok(Some(ErrorTarget { relative_error, channels }))
}

/// What must reach the error.
enum Counted<'a> {
    /// The channels of all captures that have light; of light groups, where there are none.
    All,
    /// The channels of these captures.
    Captures(&'a [String]),
    /// The radiance of each light group in a range, nm.
    Range([f64; 2]),
}

impl<'a> Counted<'a> {
    fn of(context: &Context<'_>, section: &'a RenderSection) -> Resolved<Self> {
        let at = steps!["render", "error_range_nm"];
        match (&section.error_captures, section.error_range_nm) {
            (None, None) => Ok(Self::All),
            (Some(wanted), None) => Ok(Self::Captures(wanted)),
            (None, Some([low, high])) => {
                let is_wavelength = |nm: f64| (0.0..=1e5).contains(&nm);
                if is_wavelength(low) && is_wavelength(high) && low < high {
                    return Ok(Self::Range([low, high]));
                }
                let message = "must increase and lie between 0 and 100000: give [first, last] in nm, such as [500, 700]";
                context.fail(&at, message)
            }
            (Some(_), Some(_)) => context.fail(&at, "excludes error_captures; give one of the two"),
        }
    }
}

/// Captures that count toward the error must exist.
fn check_captures(context: &Context<'_>, wanted: &[String], captures: &[Capture]) -> Resolved<()> {
    let at = steps!["render", "error_captures"];
    if wanted.is_empty() {
        return context.fail(&at, "names no capture; leave it out for all of them");
    }
    let known = captures.iter().map(|capture| capture.frame.label.as_str());
    context.check_names(&at, wanted, known, "there is no capture of this name")
}

/// Signals of the channels of a sensor in the wanted captures that have light.
fn sensor_channels(
    is_wanted: impl Fn(&Capture) -> bool,
    scene: &Scene,
    captures: &[Capture],
    lens: &IdealLens,
    sensor: &Sensor,
) -> Vec<ErrorChannel> {
    let transmittance = lens.transmittance_on(&scene.grid);
    let mut channels = Vec::new();
    for capture in captures {
        let frame = &capture.frame;
        let drives: Vec<f64> = scene.light_groups.iter().map(|group| frame.drive(&group.name)).collect();
        if !is_wanted(capture) || drives.iter().all(|&drive| drive == 0.0) {
            continue;
        }
        for (channel, weights) in sensor.qe().channels().iter().zip(sensor.electron_weights(&scene.grid)) {
            let weights: Vec<f64> = weights.iter().zip(transmittance.values()).map(|(w, t)| w * t).collect();
            if weights.iter().any(|&w| w > 0.0) {
                let name = format!("{}.{}", frame.label, channel.name);
                channels.push(ErrorChannel { name, drives: drives.clone(), weights });
            }
        }
    }
    channels
}

/// Radiance of each light group in a range of wavelengths.
fn group_channels(
    context: &Context<'_>,
    [low, high]: [f64; 2],
    scene: &Scene,
) -> Resolved<Vec<ErrorChannel>> {
    let (grid, groups) = (&scene.grid, &scene.light_groups);
    let weights: Vec<f64> = (0..grid.len())
        .map(|band| if (low..=high).contains(&grid.center_nm(band)) { grid.width_nm(band) } else { 0.0 })
        .collect();
    if weights.iter().all(|&w| w == 0.0) {
        let [first, last] = [0, grid.len() - 1].map(|band| grid.center_nm(band));
        let message = format!("holds no band of the render; its bands lie between {first} and {last} nm");
        return context.fail(&steps!["render", "error_range_nm"], message);
    }
    let channel = |(index, group): (usize, &LightGroup)| {
        let drives = (0..groups.len()).map(|g| if g == index { 1.0 } else { 0.0 }).collect();
        ErrorChannel { name: group.name.clone(), drives, weights: weights.clone() }
    };
    Ok(groups.iter().enumerate().map(channel).collect())
}
