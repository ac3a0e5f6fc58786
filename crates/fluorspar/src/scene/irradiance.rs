//! Unoccluded direct irradiance of lights on points of the scene, without interreflections: weights with
//! which lights of different kinds, whose spectra have different units, are mixed.

use std::borrow::Cow;

use super::{Scene, Shape, SurfaceEmission};
use crate::geometry::OrientedPoint;
use crate::light::{emissive_disc_factor, emissive_sphere_factor, emissive_triangles_factor};
use crate::spectral::Curve;

/// Irradiance per unit of radiance of a surface that emits, sr.
pub(crate) fn emission_factor(shape: &Shape, emission: &SurfaceEmission, at: OrientedPoint) -> f64 {
    let is_one_sided = emission.is_one_sided;
    match shape {
        Shape::Sphere { center, radius_m } => emissive_sphere_factor(*center, *radius_m, at),
        Shape::Disc { center, normal, radius_m } => {
            emissive_disc_factor(*center, *normal, *radius_m, is_one_sided, at)
        }
        Shape::Mesh(mesh) => {
            let corners = |t: &[u32; 3]| t.map(|i| mesh.positions[i as usize]);
            emissive_triangles_factor(mesh.triangles.iter().map(corners), is_one_sided, at)
        }
        Shape::Instances(many) => emissive_triangles_factor(many.corners(), is_one_sided, at),
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
/// lights and objects that share it, averaged over the points.
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
        let spectra = light.spectra();
        let mut sums = vec![0.0; spectra.len()];
        for &point in points {
            sums.iter_mut()
                .zip(light.emitter.irradiance_factors(point))
                .for_each(|(sum, factor)| *sum += factor);
        }
        spectra.into_iter().zip(sums).for_each(|(spectrum, sum)| add(light.group, spectrum, sum));
    }
    for object in &scene.objects {
        if let Some(emission) = &object.emission {
            let one = |point: &OrientedPoint| emission_factor(&object.shape, emission, *point);
            let factor: f64 = points.iter().map(one).sum();
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
    Curve::weighted_sum(
        shining.into_iter().map(|part| (part.spectrum.clone(), weight(part))).filter(|(_, w)| *w > 0.0),
    )
}
