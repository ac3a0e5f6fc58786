//! Irradiance that lights throw directly on a point of the scene, shadows and inter-reflections left out.

use std::f64::consts::PI;

use glam::DVec3;

use crate::analysis::{PixelSelection, SceneOnSensor};
use crate::experiment::{Capture, ResolvedExperiment};
use crate::light::Emitter;
use crate::scene::{Scene, Shape, SurfaceEmission};
use crate::sensor::CaptureFrame;
use crate::spectral::Curve;

/// A point of a surface, m, with the unit normal of its lit side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SurfacePoint {
    pub(crate) position: DVec3,
    pub(crate) normal: DVec3,
}

/// Points of a region that are looked at, at most: the mean over them is a mixing ratio, which needs no more.
const MOST_POINTS: usize = 256;

/// Rings of equal area, and points on each, at which a round emitter is sampled.
const RINGS: (usize, usize) = (3, 8);

/// Points along each side of a rectangle.
const SIDE: usize = 5;

/// Geometric factor of a flat emitter that is sampled at points: `E = sum P/n (g + 1) / (2 pi) cos^g cos' / r²`, per
/// watt of power, 1/m².
fn flat_factor(at: SurfacePoint, samples: &[DVec3], normal: DVec3, exponent: f64) -> f64 {
    let one = |sample: &DVec3| {
        let way = at.position - *sample;
        let Some(direction) = way.try_normalize() else { return 0.0 };
        let (leaving, arriving) = (direction.dot(normal).max(0.0), -direction.dot(at.normal));
        if leaving <= 0.0 || arriving <= 0.0 {
            return 0.0;
        }
        (exponent + 1.0) / (2.0 * PI) * leaving.powf(exponent) * arriving / way.length_squared()
    };
    samples.iter().map(one).sum::<f64>() / samples.len().max(1) as f64
}

fn disc_samples(center: DVec3, normal: DVec3, radius_m: f64) -> Vec<DVec3> {
    let (u, v) = normal.any_orthonormal_pair();
    let (rings, spokes) = RINGS;
    let mut samples = Vec::with_capacity(rings * spokes);
    for ring in 0..rings {
        let radius = radius_m * ((ring as f64 + 0.5) / rings as f64).sqrt();
        for spoke in 0..spokes {
            let angle = 2.0 * PI * (spoke as f64 + 0.5 * (ring % 2) as f64) / spokes as f64;
            samples.push(center + radius * (u * angle.cos() + v * angle.sin()));
        }
    }
    samples
}

/// Irradiance on a surface point per unit of the light's spectrum: 1/m² for spectra in W/nm, 1 for irradiance, sr for
/// radiance. Unoccluded; an environment fills the hemisphere.
pub(crate) fn emitter_factor(emitter: &Emitter, at: SurfacePoint) -> f64 {
    match emitter {
        Emitter::Disc { center, normal, radius_m, exponent } => {
            let normal = normal.as_dvec3();
            let samples = disc_samples(center.as_dvec3(), normal, f64::from(*radius_m));
            flat_factor(at, &samples, normal, f64::from(*exponent))
        }
        Emitter::Rectangle { corner, edge_u, edge_v, exponent } => {
            let (corner, u, v) = (corner.as_dvec3(), edge_u.as_dvec3(), edge_v.as_dvec3());
            let Some(normal) = u.cross(v).try_normalize() else { return 0.0 };
            let at_step = |step: usize| (step as f64 + 0.5) / SIDE as f64;
            let samples: Vec<DVec3> =
                (0..SIDE * SIDE).map(|i| corner + u * at_step(i % SIDE) + v * at_step(i / SIDE)).collect();
            flat_factor(at, &samples, normal, f64::from(*exponent))
        }
        // Exact for a sphere that lies wholly above the surface's horizon.
        Emitter::Sphere { center, .. } => point_factor(at, center.as_dvec3(), None),
        Emitter::Point { position, pattern } => point_factor(
            at,
            position.as_dvec3(),
            pattern.map(|(axis, exponent)| (axis.as_dvec3(), f64::from(exponent))),
        ),
        Emitter::Distant { direction } => (-direction.as_dvec3().dot(at.normal)).max(0.0),
        Emitter::Environment => PI,
    }
}

fn point_factor(at: SurfacePoint, source: DVec3, pattern: Option<(DVec3, f64)>) -> f64 {
    match pattern {
        Some((axis, exponent)) => flat_factor(at, &[source], axis, exponent),
        None => {
            let way = at.position - source;
            let Some(direction) = way.try_normalize() else { return 0.0 };
            (-direction.dot(at.normal)).max(0.0) / (4.0 * PI * way.length_squared())
        }
    }
}

/// Irradiance per unit of radiance of a surface that emits to both sides, sr.
pub(crate) fn emission_factor(shape: &Shape, at: SurfacePoint) -> f64 {
    // A patch of area A at `center`: L cos cos' A / r², A bounded by the distance so that a point on the emitter itself
    // gets no more than a hemisphere.
    let patch = |center: DVec3, normal: DVec3, area: f64| {
        let way = at.position - center;
        let Some(direction) = way.try_normalize() else { return 0.0 };
        let arriving = (-direction.dot(at.normal)).max(0.0);
        direction.dot(normal).abs() * arriving * area / way.length_squared().max(area / PI)
    };
    match shape {
        Shape::Sphere { center, radius_m } => {
            let way = at.position - center.as_dvec3();
            let radius = f64::from(*radius_m);
            let Some(direction) = way.try_normalize() else { return 0.0 };
            PI * radius * radius * (-direction.dot(at.normal)).max(0.0)
                / way.length_squared().max(radius * radius)
        }
        Shape::Disc { center, normal, radius_m } => {
            let (normal, radius) = (normal.as_dvec3(), f64::from(*radius_m));
            let samples = disc_samples(center.as_dvec3(), normal, radius);
            let area = PI * radius * radius / samples.len() as f64;
            samples.into_iter().map(|sample| patch(sample, normal, area)).sum()
        }
        Shape::Mesh(mesh) => mesh
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|i| mesh.positions[i as usize].as_dvec3());
                let cross = (b - a).cross(c - a);
                let Some(normal) = cross.try_normalize() else { return 0.0 };
                patch((a + b + c) / 3.0, normal, 0.5 * cross.length())
            })
            .sum(),
    }
}

/// Drives of a frame without those of the frame that is subtracted from it: development scales that frame to the same
/// exposure, so what remains of a light group is the difference of both drives.
fn remaining_drive(frame: &CaptureFrame, subtracted: Option<&CaptureFrame>, group: &str) -> f64 {
    (frame.drive(group) - subtracted.map_or(0.0, |other| other.drive(group))).max(0.0)
}

/// Mean irradiance spectrum on surface points under the lights that a developed frame holds, W/(m² nm); `None` when
/// none of them sends light there.
pub(crate) fn irradiance_on(
    experiment: &ResolvedExperiment,
    capture: &Capture,
    points: &[SurfacePoint],
) -> Option<Curve> {
    let scene = &experiment.scene;
    let subtracted = capture
        .subtract
        .as_ref()
        .and_then(|label| experiment.captures.iter().find(|c| c.frame.label == *label))
        .map(|c| &c.frame);
    let drive = |group: usize| remaining_drive(&capture.frame, subtracted, &scene.light_groups[group].name);
    direct_irradiance(scene, points, drive)
}

/// Spectrum of the light that one light group throws on a surface point, up to a factor: the irradiance where the camera's
/// axis meets the plane in focus, or of all lights at equal power where none reaches that place. `None` for a group without
/// light.
pub(crate) fn group_spectrum(experiment: &ResolvedExperiment, group: &str) -> Option<Curve> {
    let scene = &experiment.scene;
    let drive = |index: usize| if scene.light_groups[index].name == group { 1.0 } else { 0.0 };
    direct_irradiance(scene, &[axis_point(experiment)], drive).or_else(|| {
        let of_lights = scene.lights.iter().filter(|l| drive(l.group) > 0.0).map(|l| &l.spectrum);
        let of_objects = scene.objects.iter().filter_map(|o| o.emission.as_ref());
        let spectra: Vec<(&Curve, f64)> = of_lights
            .chain(of_objects.filter(|e| drive(e.group) > 0.0).map(|e| &e.radiance))
            .filter(|spectrum| spectrum.total() > 0.0)
            .map(|spectrum| (spectrum, 1.0 / spectrum.total()))
            .collect();
        weighted_sum(&spectra)
    })
}

/// Mean irradiance on points under the lights of a scene, with a drive for each light group.
fn direct_irradiance(scene: &Scene, points: &[SurfacePoint], drive: impl Fn(usize) -> f64) -> Option<Curve> {
    let mean = |factor: &dyn Fn(SurfacePoint) -> f64| {
        points.iter().map(|point| factor(*point)).sum::<f64>() / points.len().max(1) as f64
    };
    let mut parts: Vec<(&Curve, f64)> = Vec::new();
    let mut add = |spectrum, weight: f64| {
        if weight <= 0.0 {
            return;
        }
        // Emitters of one section share their spectrum.
        match parts.iter_mut().find(|(other, _)| *other == spectrum) {
            Some((_, sum)) => *sum += weight,
            None => parts.push((spectrum, weight)),
        }
    };
    for light in &scene.lights {
        let drive = drive(light.group);
        if drive > 0.0 {
            add(&light.spectrum, drive * mean(&|point| emitter_factor(&light.emitter, point)));
        }
    }
    for object in &scene.objects {
        let Some(SurfaceEmission { group, radiance }) = &object.emission else { continue };
        let drive = drive(*group);
        if drive > 0.0 {
            add(radiance, drive * mean(&|point| emission_factor(&object.shape, point)));
        }
    }
    weighted_sum(&parts)
}

fn weighted_sum(parts: &[(&Curve, f64)]) -> Option<Curve> {
    match parts {
        [] => None,
        [(spectrum, weight)] => Some(spectrum.scaled(*weight)),
        _ => {
            let first = parts.iter().map(|(s, _)| s.range_nm().0).fold(f64::INFINITY, f64::min);
            let last = parts.iter().map(|(s, _)| s.range_nm().1).fold(f64::NEG_INFINITY, f64::max);
            Some(Curve::from_fn(first, last, |nm| parts.iter().map(|(s, w)| w * s.at(nm)).sum()))
        }
    }
}

/// Where the camera's axis meets the plane in focus, facing the camera.
pub(crate) fn axis_point(experiment: &ResolvedExperiment) -> SurfacePoint {
    /// Where a lens is focused at infinity, or there is none.
    const FAR_M: f64 = 1.0;
    let camera = &experiment.scene.camera;
    let distance_m =
        experiment.lens.as_ref().and_then(|lens| lens.object_distance_mm).map_or(FAR_M, |mm| mm * 1e-3);
    let forward = camera.forward.as_dvec3();
    SurfacePoint { position: camera.position.as_dvec3() + forward * distance_m, normal: -forward }
}

/// Points of the scene that pixels of a sensor image show, by the depth and normals of the render.
pub(crate) fn region_points(
    experiment: &ResolvedExperiment,
    scene: SceneOnSensor<'_>,
    region: &PixelSelection,
) -> Vec<SurfacePoint> {
    let components = scene.components;
    let features = &components.features;
    let (width, height) = (components.width, components.height);
    if features.depth_m.len() != width * height || features.normal.len() != width * height {
        return Vec::new();
    }
    let camera = &experiment.scene.camera;
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
        Some(SurfacePoint { position: camera.position.as_dvec3() + direction * depth_m, normal })
    };
    pixels.iter().step_by(step).filter_map(point).collect()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::experiment::{parse, resolve};

    const UP: SurfacePoint = SurfacePoint { position: DVec3::ZERO, normal: DVec3::Z };

    #[test]
    fn factors_of_all_emitters_follow_closed_forms() {
        let close = |got: f64, expected: f64, tolerance: f64, what: &str| {
            assert!((got - expected).abs() <= tolerance * expected, "{what}: {got}, expected {expected}");
        };
        // A Lambertian disc on the axis: E = M R² / (R² + d²) with M = P / (pi R²). Twelve diameters away, and at one
        // radius, where three rings leave 2 %.
        for (radius_m, distance_m, tolerance) in [(0.0025f32, 0.06f32, 1e-4), (0.02, 0.02, 0.02)] {
            let disc =
                Emitter::Disc { center: Vec3::Z * distance_m, normal: Vec3::NEG_Z, radius_m, exponent: 1.0 };
            let (r2, d2) = (f64::from(radius_m).powi(2), f64::from(distance_m).powi(2));
            close(emitter_factor(&disc, UP), 1.0 / (PI * (r2 + d2)), tolerance, "disc");
        }
        // A small rectangle: P / (pi d²).
        let edge = 0.001f32;
        let rectangle = Emitter::Rectangle {
            corner: Vec3::new(-0.5 * edge, -0.5 * edge, 0.1),
            edge_u: Vec3::Y * edge,
            edge_v: Vec3::X * edge,
            exponent: 1.0,
        };
        close(emitter_factor(&rectangle, UP), 1.0 / (PI * 0.01), 1e-3, "rectangle");
        let sphere = Emitter::Sphere { center: Vec3::Z * 0.1, radius_m: 0.05 };
        close(emitter_factor(&sphere, UP), 1.0 / (4.0 * PI * 0.01), 1e-6, "sphere");
        let beam = Emitter::Point { position: Vec3::Z * 0.1, pattern: Some((Vec3::NEG_Z, 3.0)) };
        close(emitter_factor(&beam, UP), 4.0 / (2.0 * PI * 0.01), 1e-6, "point");
        let slant = Emitter::Distant { direction: Vec3::new(0.0, 0.6, -0.8) };
        close(emitter_factor(&slant, UP), 0.8, 1e-6, "distant");
        close(emitter_factor(&Emitter::Environment, UP), PI, 1e-12, "environment");
        // From below nothing arrives.
        let below = SurfacePoint { normal: DVec3::NEG_Z, ..UP };
        assert_eq!(emitter_factor(&beam, below), 0.0);
        assert_eq!(emitter_factor(&slant, below), 0.0);
        let shape = Shape::Sphere { center: Vec3::Z * 0.1, radius_m: 0.02 };
        close(emission_factor(&shape, UP), PI * 0.04, 1e-5, "emissive sphere");
        let shape = Shape::Disc { center: Vec3::Z * 0.1, normal: Vec3::Z, radius_m: 0.005 };
        close(emission_factor(&shape, UP), PI * 0.0025 / (1.0 + 0.0025), 1e-3, "emissive disc");
    }

    /// A patch 100 mm away under lights of three kinds, one of them an object that shines, one of them subtracted.
    #[test]
    fn lights_of_different_kinds_mix_by_their_irradiance() {
        let text = r#"
            base = "flat-patch"
            [[light]]
            name = "lamp"
            type = "point"
            spectrum = "led_405"
            position_mm = [0.0, 0.0, 100.0]
            power_mw = 1000.0
            [[light]]
            name = "room"
            type = "environment"
            spectrum = "led_450"
            radiance_w_per_sr_m2 = 2.0
            [[object]]
            name = "window"
            material = "patch"
            sphere = { center_mm = [0.0, 0.0, 200.0], radius_mm = 10.0 }
            emission = { group = "window", spectrum = "led_365", radiance_w_per_sr_m2 = 100.0 }
            [[capture]]
            name = "ambient"
            light_groups = { room = 1.0 }
            [[capture]]
            name = "blue"
            light_groups = { blue = 1.0, lamp = 2.0, room = 3.0, window = 1.0 }
        "#;
        let parsed = parse(text, "test", std::path::Path::new("."), &[]).unwrap();
        let experiment = resolve(&parsed).unwrap();
        let capture = experiment.captures.iter().find(|c| c.frame.label == "blue").unwrap();
        assert_eq!(capture.subtract.as_deref(), Some("ambient"));
        let lamp = irradiance_on(&experiment, capture, &[UP]).unwrap();
        // Parallel light as stated, 2 W evenly from 100 mm, pi L of two of three units of room light, a sphere of 10 mm
        // at 200 mm.
        let expected = 1000.0 + 2.0 / (4.0 * PI * 0.01) + 2.0 * PI * 2.0 + 100.0 * PI * 0.0025;
        // Sum resampled on 0.5 nm: nearly exact.
        assert!((lamp.total() - expected).abs() < 1e-3 * expected, "{}, {expected}", lamp.total());
        // Only the room and the subtracted ambient frame: nothing is left of equal drives.
        let mut dark = capture.clone();
        dark.frame.lights = [("room".to_string(), 1.0)].into();
        assert!(irradiance_on(&experiment, &dark, &[UP]).is_none());
    }
}
