//! Irradiance under the lights of a capture, directly on the points of a region.

use crate::analysis::{PixelSelection, SceneOnSensor};
use crate::geometry::OrientedPoint;
use crate::scene::irradiance::{self, direct_irradiance};
use crate::sensor::CaptureFrame;
use crate::spectral::Curve;
use crate::study::{Capture, Study};

/// Largest number of sampled points of a region: the mean over them is a mixing ratio, which needs no more.
const MOST_POINTS: usize = 256;

/// Drives of a frame without those of the frame that is subtracted from it: development scales that frame to the same
/// exposure, so what remains of a light group is the difference of both drives.
fn remaining_drive(frame: &CaptureFrame, subtracted: Option<&CaptureFrame>, group: &str) -> f64 {
    (frame.drive(group) - subtracted.map_or(0.0, |other| other.drive(group))).max(0.0)
}

/// A frame with the drives that remain of its lights, see [`remaining_drive`].
pub(crate) fn less_subtracted(study: &Study, capture: &Capture) -> CaptureFrame {
    let subtracted = capture.subtract.as_ref().and_then(|label| study.capture(label)).map(|c| &c.frame);
    let mut frame = capture.frame.clone();
    for (group, drive) in &mut frame.lights {
        *drive = remaining_drive(&capture.frame, subtracted, group);
    }
    frame
}

/// Mean irradiance spectrum on surface points under the lights that a developed frame holds, W/(m² nm); `None` when
/// none of them sends light there.
pub(crate) fn irradiance_on(study: &Study, capture: &Capture, points: &[OrientedPoint]) -> Option<Curve> {
    let scene = &study.scene;
    let remaining = less_subtracted(study, capture);
    let drive = |group: usize| remaining.drive(&scene.light_groups[group].name);
    let parts = direct_irradiance(scene, points)
        .into_iter()
        .map(|part| (part.spectrum, part.factor * drive(part.group)))
        .filter(|(_, weight)| *weight > 0.0);
    Curve::weighted_sum(parts)
}

/// Spectrum of the irradiance of one light group on a surface point, up to a factor: the irradiance where the camera's
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

    use glam::{DVec3, Vec3};

    use super::*;
    use crate::light::{DistantEmitter, Emitter, Light, LightGroup, PointEmitter, PointPattern};
    use crate::material::Material;
    use crate::optics::PerspectiveCamera;
    use crate::scene::{Object, Scene, Shape, SurfaceEmission};
    use crate::spectral::WavelengthGrid;

    const UP: OrientedPoint = OrientedPoint { position: DVec3::ZERO, normal: DVec3::Z };

    /// The spectrum of an LED whose integral is `total`.
    fn led(peak_nm: f64, total: f64) -> Curve {
        let shape = Curve::from_fn(300.0, 800.0, |nm| (-0.5 * ((nm - peak_nm) / 8.0).powi(2)).exp());
        shape.scaled(total / shape.total())
    }

    /// A patch under parallel light of 1000 W/m², a point of 1 W 100 mm above it, a room of 2 W/(sr m²), and a ball of
    /// 10 mm that shines with 100 W/(sr m²) 200 mm above it.
    fn patch() -> Scene {
        let groups = ["blue", "lamp", "room", "window"];
        let light = |group: usize, spectrum: Curve, emitter: Emitter| Light {
            name: groups[group].into(),
            group,
            spectrum,
            crossed_polarizers: false,
            emitter,
        };
        let window = Object {
            name: "window".into(),
            shape: Shape::Sphere { center: 0.2 * Vec3::Z, radius_m: 0.01 },
            material: 0,
            emission: Some(SurfaceEmission { group: 3, radiance: led(365.0, 100.0), is_one_sided: false }),
        };
        Scene {
            grid: WavelengthGrid::uniform(350.0, 700.0, 10.0).unwrap(),
            objects: vec![window],
            materials: vec![Material::lambertian("patch", Curve::constant(0.5))],
            fluorophores: Vec::new(),
            light_groups: groups.map(|name| LightGroup { name: name.into() }).into(),
            lights: vec![
                light(0, led(385.0, 1000.0), DistantEmitter { direction: Vec3::NEG_Z }.into()),
                light(
                    1,
                    led(405.0, 1.0),
                    PointEmitter { position: 0.1 * Vec3::Z, pattern: PointPattern::Even }.into(),
                ),
                light(2, led(450.0, 2.0), Emitter::Environment),
            ],
            camera: PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 30.0, 4, 4).unwrap(),
        }
    }

    /// Lights of three kinds, one of them an object that shines, one of them subtracted.
    #[test]
    fn lights_of_different_kinds_mix_by_their_irradiance() {
        let ambient = CaptureFrame::fixed("ambient", [("room", 1.0)], 30.0);
        let drives = [("blue", 1.0), ("lamp", 2.0), ("room", 3.0), ("window", 1.0)];
        let blue = CaptureFrame::fixed("blue", drives, 30.0);
        let capture = Capture { subtract: Some("ambient".into()), ..Capture::from(blue) };
        let study = Study { captures: vec![Capture::from(ambient), capture.clone()], ..Study::new(patch()) };
        let light = irradiance_on(&study, &capture, &[UP]).unwrap();
        // Parallel light as stated, 2 W evenly from 100 mm, pi L of two of three units of room light, a sphere of 10 mm
        // at 200 mm.
        let expected = 1000.0 + 2.0 / (4.0 * PI * 0.01) + 2.0 * PI * 2.0 + 100.0 * PI * 0.0025;
        // Sum resampled on 0.5 nm: nearly exact.
        assert!((light.total() - expected).abs() < 1e-3 * expected, "{}, {expected}", light.total());
        // Only the room and the subtracted ambient frame: nothing is left of equal drives.
        let mut dark = capture;
        dark.frame.lights = [("room".to_string(), 1.0)].into();
        assert!(irradiance_on(&study, &dark, &[UP]).is_none());
    }
}
