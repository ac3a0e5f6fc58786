//! Irradiance under the lights of a capture, directly on the points of a region.

use crate::analysis::{PixelSelection, SceneOnSensor};
use crate::geometry::OrientedPoint;
use crate::scene::irradiance::{self, direct_irradiance, sum_of_spectra};
use crate::sensor::CaptureFrame;
use crate::spectral::Curve;
use crate::study::{Capture, Study};

/// Points of a region that are looked at, at most: the mean over them is a mixing ratio, which needs no more.
const MOST_POINTS: usize = 256;

/// Drives of a frame without those of the frame that is subtracted from it: development scales that frame to the same
/// exposure, so what remains of a light group is the difference of both drives.
fn remaining_drive(frame: &CaptureFrame, subtracted: Option<&CaptureFrame>, group: &str) -> f64 {
    (frame.drive(group) - subtracted.map_or(0.0, |other| other.drive(group))).max(0.0)
}

/// Mean irradiance spectrum on surface points under the lights that a developed frame holds, W/(m² nm); `None` when
/// none of them sends light there.
pub(crate) fn irradiance_on(study: &Study, capture: &Capture, points: &[OrientedPoint]) -> Option<Curve> {
    let scene = &study.scene;
    let subtracted = capture.subtract.as_ref().and_then(|label| study.capture(label)).map(|c| &c.frame);
    let drive = |group: usize| remaining_drive(&capture.frame, subtracted, &scene.light_groups[group].name);
    let parts = direct_irradiance(scene, points)
        .into_iter()
        .map(|part| (part.spectrum, part.factor * drive(part.group)))
        .filter(|(_, weight)| *weight > 0.0);
    sum_of_spectra(parts)
}

/// Spectrum of the light that one light group throws on a surface point, up to a factor: the irradiance where the camera's
/// axis meets the plane in focus, or of all lights at equal power where none reaches that place. `None` for a group without
/// light.
pub(crate) fn group_spectrum(study: &Study, group: &str) -> Option<Curve> {
    let scene = &study.scene;
    let index = scene.light_groups.iter().position(|other| other.name == group)?;
    irradiance::group_spectrum(&direct_irradiance(scene, &[axis_point(study)]), index)
}

/// Where the camera's axis meets the plane in focus, facing the camera.
pub(crate) fn axis_point(study: &Study) -> OrientedPoint {
    /// Where a lens is focused at infinity, or there is none.
    const FAR_M: f64 = 1.0;
    let camera = &study.scene.camera;
    let distance_m = study
        .camera
        .lens
        .as_ref()
        .and_then(|lens| lens.equation.object_distance_mm)
        .map_or(FAR_M, |mm| mm * 1e-3);
    let forward = camera.forward.as_dvec3();
    OrientedPoint { position: camera.position.as_dvec3() + forward * distance_m, normal: -forward }
}

/// Points of the scene that pixels of a sensor image show, by the depth and normals of the render.
pub(crate) fn region_points(
    study: &Study,
    scene: SceneOnSensor<'_>,
    region: &PixelSelection,
) -> Vec<OrientedPoint> {
    let components = scene.components;
    let features = &components.features;
    let (width, height) = (components.width, components.height);
    if features.depth_m.len() != width * height || features.normal.len() != width * height {
        return Vec::new();
    }
    let camera = &study.scene.camera;
    let tan_half_width = features.view.map_or(camera.tan_half_width, |view| view.tan_half_width);
    let scale = 2.0 * f64::from(tan_half_width) / width as f64;
    let (forward, right, up) = (camera.forward.as_dvec3(), camera.right.as_dvec3(), camera.up.as_dvec3());
    let pixels = scene.scene_pixels(region);
    let step = pixels.len().div_ceil(MOST_POINTS).max(1);
    let point = |&pixel: &usize| {
        let (row, col) = (pixel / width, pixel % width);
        let depth_m = f64::from(features.depth_m[pixel]);
        let normal = glam::Vec3::from_array(features.normal[pixel]).as_dvec3().try_normalize()?;
        if !depth_m.is_finite() {
            return None;
        }
        let dx = (col as f64 + 0.5 - 0.5 * width as f64) * scale;
        let dy = (0.5 * height as f64 - row as f64 - 0.5) * scale;
        let direction = (forward + right * dx + up * dy).normalize();
        // Materials are two-sided: the side that the camera sees counts.
        let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
        Some(OrientedPoint { position: camera.position.as_dvec3() + direction * depth_m, normal })
    };
    pixels.iter().step_by(step).filter_map(point).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::DVec3;

    use super::*;
    use crate::experiment::{parse, resolve};

    const UP: OrientedPoint = OrientedPoint { position: DVec3::ZERO, normal: DVec3::Z };

    /// A patch 100 mm away under lights of three kinds, one of them an object that shines, one of them subtracted.
    #[test]
    fn lights_of_different_kinds_mix_by_their_irradiance() {
        let text = r#"
            format = 1
            base = "flat-patch"
            [[light]]
            name = "lamp"
            type = "point"
            spectrum = "led_405"
            position_mm = [0.0, 0.0, 100.0]
            strength.power_mw = 1000.0
            [[light]]
            name = "room"
            type = "environment"
            spectrum = "led_450"
            strength.radiance_w_per_sr_m2 = 2.0
            [[object]]
            name = "window"
            material = "patch"
            type = "sphere"
            center_mm = [0.0, 0.0, 200.0]
            radius_mm = 10.0
            emission = { group = "window", spectrum = "led_365", radiance_w_per_sr_m2 = 100.0 }
            [[capture]]
            name = "ambient"
            light_groups = { room = 1.0 }
            [[capture]]
            name = "blue"
            light_groups = { blue = 1.0, lamp = 2.0, room = 3.0, window = 1.0 }
        "#;
        let parsed = parse(text, "test", std::path::Path::new("."), &[]).unwrap();
        let study = resolve(&parsed).unwrap().study;
        let capture = study.captures.iter().find(|c| c.frame.label == "blue").unwrap();
        assert_eq!(capture.subtract.as_deref(), Some("ambient"));
        let light = irradiance_on(&study, capture, &[UP]).unwrap();
        // Parallel light as stated, 2 W evenly from 100 mm, pi L of two of three units of room light, a sphere of 10 mm
        // at 200 mm.
        let expected = 1000.0 + 2.0 / (4.0 * PI * 0.01) + 2.0 * PI * 2.0 + 100.0 * PI * 0.0025;
        // Sum resampled on 0.5 nm: nearly exact.
        assert!((light.total() - expected).abs() < 1e-3 * expected, "{}, {expected}", light.total());
        // Only the room and the subtracted ambient frame: nothing is left of equal drives.
        let mut dark = capture.clone();
        dark.frame.lights = [("room".to_string(), 1.0)].into();
        assert!(irradiance_on(&study, &dark, &[UP]).is_none());
    }
}
