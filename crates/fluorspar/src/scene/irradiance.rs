//! Irradiance that lights throw directly on points of the scene, shadows and inter-reflections left out: weights with
//! which lights of different kinds, whose spectra have different units, are mixed.

use std::borrow::Cow;
use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::{Scene, Shape};
use crate::geometry::OrientedPoint;
use crate::light::{Emitter, Light};
use crate::spectral::Curve;

/// Rings of equal area, and points on each, at which a round emitter is sampled.
const RINGS: (usize, usize) = (3, 8);

/// Points along each side of a rectangle.
const SIDE: usize = 5;

/// Geometric factor of a flat emitter that is sampled at points: `E = sum P/n (g + 1) / (2 pi) cos^g cos' / r²`, per
/// watt of power, 1/m².
fn flat_factor(at: OrientedPoint, samples: &[DVec3], normal: DVec3, exponent: f64) -> f64 {
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
/// radiance. Unoccluded; an environment fills the hemisphere. Maps have a factor per layer, see [`light_factors`].
fn emitter_factor(emitter: &Emitter, at: OrientedPoint) -> f64 {
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
        Emitter::Environment | Emitter::EnvironmentMap(_) => PI,
    }
}

fn point_factor(at: OrientedPoint, source: DVec3, pattern: Option<(DVec3, f64)>) -> f64 {
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
pub(crate) fn emission_factor(shape: &Shape, at: OrientedPoint) -> f64 {
    // A patch of area A at `center`: L cos cos' A / r², A bounded by the distance so that a point on the emitter itself
    // gets no more than a hemisphere.
    let patch = |center: DVec3, normal: DVec3, area: f64| {
        let way = at.position - center;
        let Some(direction) = way.try_normalize() else { return 0.0 };
        let arriving = (-direction.dot(at.normal)).max(0.0);
        direction.dot(normal).abs() * arriving * area / way.length_squared().max(area / PI)
    };
    let triangle = |corners: [Vec3; 3]| {
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let cross = (b - a).cross(c - a);
        let Some(normal) = cross.try_normalize() else { return 0.0 };
        patch((a + b + c) / 3.0, normal, 0.5 * cross.length())
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
        Shape::Mesh(mesh) => {
            mesh.triangles.iter().map(|t| triangle(t.map(|i| mesh.positions[i as usize]))).sum()
        }
        Shape::Instances(many) => many.corners().map(triangle).sum(),
    }
}

/// Spectra of a light: one, and for an environment map one per layer.
pub(crate) fn light_spectra(light: &Light) -> Vec<Cow<'_, Curve>> {
    match &light.emitter {
        Emitter::EnvironmentMap(map) => {
            map.layers().iter().map(|layer| Cow::Owned(light.spectrum.times(&layer.spectrum))).collect()
        }
        _ => vec![Cow::Borrowed(&light.spectrum)],
    }
}

/// Irradiance on a surface point per unit of each of [`light_spectra`].
pub(crate) fn light_factors(light: &Light, at: OrientedPoint) -> Vec<f64> {
    match &light.emitter {
        Emitter::EnvironmentMap(map) => map.irradiance_factors(at.normal),
        emitter => vec![emitter_factor(emitter, at)],
    }
}

/// A spectrum of a light group and the mean irradiance on some points per unit of it.
#[derive(Clone, Debug)]
pub(crate) struct DirectIrradiance<'a> {
    pub(crate) group: usize,
    pub(crate) spectrum: Cow<'a, Curve>,
    pub(crate) factor: f64,
}

/// Everything that shines in a scene: each distinct spectrum of each light group, with the sum of the factors of all
/// lamps and objects that share it, averaged over the points.
pub(crate) fn direct_irradiance<'a>(scene: &'a Scene, points: &[OrientedPoint]) -> Vec<DirectIrradiance<'a>> {
    let mut parts: Vec<DirectIrradiance<'a>> = Vec::new();
    let share = 1.0 / points.len().max(1) as f64;
    let mut add = |group: usize, spectrum: Cow<'a, Curve>, factor: f64| {
        // Emitters of one section share their spectrum.
        match parts.iter_mut().find(|p| p.group == group && p.spectrum == spectrum) {
            Some(part) => part.factor += factor * share,
            None => parts.push(DirectIrradiance { group, spectrum, factor: factor * share }),
        }
    };
    for light in &scene.lights {
        let spectra = light_spectra(light);
        let mut sums = vec![0.0; spectra.len()];
        for &point in points {
            sums.iter_mut().zip(light_factors(light, point)).for_each(|(sum, factor)| *sum += factor);
        }
        spectra.into_iter().zip(sums).for_each(|(spectrum, sum)| add(light.group, spectrum, sum));
    }
    for object in &scene.objects {
        if let Some(emission) = &object.emission {
            let factor: f64 = points.iter().map(|&point| emission_factor(&object.shape, point)).sum();
            add(emission.group, Cow::Borrowed(&emission.radiance), factor);
        }
    }
    parts
}

/// Spectrum of the light of one group, up to a factor: the irradiance, or all at equal power where none reaches the
/// points. `None` for a group without light.
pub(crate) fn group_spectrum(parts: &[DirectIrradiance<'_>], group: usize) -> Option<Curve> {
    let shining: Vec<_> = parts.iter().filter(|p| p.group == group && p.spectrum.total() > 0.0).collect();
    let dark = shining.iter().all(|part| part.factor <= 0.0);
    let weight = |part: &DirectIrradiance<'_>| if dark { 1.0 / part.spectrum.total() } else { part.factor };
    sum_of_spectra(
        shining.into_iter().map(|part| (part.spectrum.clone(), weight(part))).filter(|(_, w)| *w > 0.0),
    )
}

/// Sum of spectra, each with its weight; `None` for no spectra.
pub(crate) fn sum_of_spectra<'a>(parts: impl Iterator<Item = (Cow<'a, Curve>, f64)>) -> Option<Curve> {
    let parts: Vec<(Cow<'a, Curve>, f64)> = parts.collect();
    match parts.as_slice() {
        [] => None,
        [(spectrum, weight)] => Some(spectrum.scaled(*weight)),
        _ => {
            let first = parts.iter().map(|(s, _)| s.range_nm().0).fold(f64::INFINITY, f64::min);
            let last = parts.iter().map(|(s, _)| s.range_nm().1).fold(f64::NEG_INFINITY, f64::max);
            Some(Curve::from_fn(first, last, |nm| parts.iter().map(|(s, w)| w * s.at(nm)).sum()))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::light::{EnvironmentLayer, EnvironmentMap};

    const UP: OrientedPoint = OrientedPoint { position: DVec3::ZERO, normal: DVec3::Z };

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
        let below = OrientedPoint { normal: DVec3::NEG_Z, ..UP };
        assert_eq!(emitter_factor(&beam, below), 0.0);
        assert_eq!(emitter_factor(&slant, below), 0.0);
        let shape = Shape::Sphere { center: Vec3::Z * 0.1, radius_m: 0.02 };
        close(emission_factor(&shape, UP), PI * 0.04, 1e-5, "emissive sphere");
        let shape = Shape::Disc { center: Vec3::Z * 0.1, normal: Vec3::Z, radius_m: 0.005 };
        close(emission_factor(&shape, UP), PI * 0.0025 / (1.0 + 0.0025), 1e-3, "emissive disc");
    }

    /// An even map is an environment; of one bright row the closed form is `pi (sin^2 b - sin^2 a)`.
    #[test]
    fn maps_follow_closed_forms() {
        let factor = |row: Option<usize>| {
            let factors =
                (0..16 * 8).map(|i| if row.is_none_or(|row| i / 16 == row) { 1.0 } else { 0.0 }).collect();
            let layer = EnvironmentLayer { spectrum: Curve::constant(1.0), factors };
            let map = EnvironmentMap::new(16, 8, vec![layer], 30.0).unwrap();
            let light = Light {
                name: "sky".into(),
                group: 0,
                spectrum: Curve::constant(2.0),
                emitter: Emitter::EnvironmentMap(Arc::new(map)),
            };
            let up = OrientedPoint { position: DVec3::ZERO, normal: DVec3::Y };
            assert_eq!(light_spectra(&light)[0].at(500.0), 2.0);
            light_factors(&light, up)[0]
        };
        // 32 strata along each axis, midpoint rule over a cosine that ends in a kink: better than 1 / 32^2 times 2 pi.
        assert!((factor(None) - PI).abs() < 6e-3, "{}", factor(None));
        for row in 0..4 {
            let sine2 = |edge: usize| (PI * edge as f64 / 8.0).sin().powi(2);
            let expected = PI * (sine2(row + 1) - sine2(row));
            assert!((factor(Some(row)) - expected).abs() < 1e-3 * expected, "{row}: {}", factor(Some(row)));
        }
        assert_eq!(factor(Some(5)), 0.0);
    }
}
