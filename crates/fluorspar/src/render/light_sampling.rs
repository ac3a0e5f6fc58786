//! Directions towards lights, with their densities, for next-event estimation and its weighting.

use std::f32::consts::PI;

use glam::Vec3;

use super::compiled_scene::{AnalyticShape, CompiledEmitter, CompiledLight, CompiledScene};
use super::surface::Target;
use crate::sampling::{SphericalEllipse, SphericalRectangle, warp};

/// Light that may arrive at a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    pub(super) light: usize,
    /// Unit direction from the point to the light.
    pub(super) direction: Vec3,
    /// Distance to the light, m.
    pub(super) distance: f32,
    /// Factor on the source's spectrum: radiance for lights with area, radiance times solid angle for point-like ones,
    /// 1 for environment maps, whose pixel holds the factors.
    pub(super) scale: f32,
    /// Pixel of an environment map.
    pub(super) pixel: usize,
    /// Density, 1/sr, choice of the light included; for point-like lights the probability of the choice.
    pub(super) pdf: f32,
    /// Point-like: no ray finds it by chance.
    pub(super) delta: bool,
}

/// A sphere that emits.
struct SphereLight {
    center: Vec3,
    radius: f32,
    /// Radiance per unit of the source's spectrum.
    scale: f32,
    both_sides: bool,
}

impl SphereLight {
    /// A lamp given by its power, emitting outward: `L = P / (pi 4 pi r^2)`.
    fn lamp(center: Vec3, radius: f32) -> Self {
        Self { center, radius, scale: 1.0 / (4.0 * PI * PI * radius * radius), both_sides: false }
    }

    /// An object given by its radiance, emitting to both sides.
    fn object(center: Vec3, radius: f32) -> Self {
        Self { center, radius, scale: 1.0, both_sides: true }
    }
}

/// Lights of a group whose weights are kept while one is chosen.
const KNOWN_WEIGHTS: usize = 16;
/// A floor on the weight of any light, so that none is ever left out.
const LEAST_WEIGHT: f32 = 1e-3;

impl CompiledScene {
    /// Relative weight with which a light is chosen at a point: power over squared distance, and no more than a
    /// token for lights that lie behind the surface. A normal of zero stands for a surface that light passes.
    #[inline]
    fn light_weight(&self, light: &CompiledLight, position: Vec3, normal: Vec3) -> f32 {
        let (center, reach, pattern) = match &light.emitter {
            // The others' weight is 2 pi times their irradiance.
            CompiledEmitter::Distant { direction } => {
                let facing = if normal == Vec3::ZERO { 1.0 } else { -direction.dot(normal) };
                return 2.0 * PI * light.power * facing.max(LEAST_WEIGHT);
            }
            CompiledEmitter::Environment { .. } => return 2.0 * PI * PI * light.power,
            CompiledEmitter::Disc { center, normal, radius, exponent, .. } => {
                (*center, *radius, Some((*normal, *exponent)))
            }
            CompiledEmitter::Rectangle { shape, exponent } => {
                (shape.center(), shape.radius(), Some((shape.normal(), *exponent)))
            }
            CompiledEmitter::Sphere { center, radius } => (*center, *radius, None),
            CompiledEmitter::Point { position, pattern } => (*position, 0.0, *pattern),
            CompiledEmitter::Mesh { center, radius, .. } => (*center, *radius, None),
            CompiledEmitter::ShapeObject { shape } => match &self.shapes[*shape].shape {
                AnalyticShape::Sphere { center, radius } | AnalyticShape::Disc { center, radius, .. } => {
                    (*center, *radius, None)
                }
            },
        };
        let to_light = center - position;
        let distance2 = to_light.length_squared().max(reach * reach).max(1e-12);
        let direction = to_light / distance2.sqrt();
        // The whole light may be lower than its centre by its reach.
        let sine = reach / distance2.sqrt();
        let facing =
            if normal == Vec3::ZERO { 1.0 } else { (direction.dot(normal) + sine).clamp(LEAST_WEIGHT, 1.0) };
        let emission = pattern.map_or(1.0, |(axis, exponent)| {
            let cos = (-direction.dot(axis) + sine).min(1.0);
            // Lambertian lamps are the common ones, and powf is slow.
            let lobe = if exponent == 1.0 { cos } else { cos.powf(exponent) };
            if cos <= 0.0 { LEAST_WEIGHT } else { lobe.max(LEAST_WEIGHT) * (exponent + 1.0) }
        });
        light.power * facing * emission / distance2
    }

    /// Chooses one light of a group; returns it and the probability of the choice.
    #[inline]
    fn choose_light(&self, group: usize, position: Vec3, normal: Vec3, u: f32) -> Option<(usize, f32)> {
        let lights = &self.group_lights[group];
        match lights.as_slice() {
            [] => None,
            [only] => Some((*only, 1.0)),
            _ => {
                // Weights of the first lights are kept between the two passes over them.
                let mut known = [0.0; KNOWN_WEIGHTS];
                let weight = |l: usize| self.light_weight(&self.lights[l], position, normal);
                let mut total = 0.0;
                for (index, &light) in lights.iter().enumerate() {
                    let w = weight(light);
                    total += w;
                    if let Some(known) = known.get_mut(index) {
                        *known = w;
                    }
                }
                let mut left = u * total;
                let mut last = None;
                for (index, &light) in lights.iter().enumerate() {
                    let w = known.get(index).copied().unwrap_or_else(|| weight(light));
                    if w > 0.0 {
                        last = Some((light, w / total));
                        if left < w {
                            break;
                        }
                        left -= w;
                    }
                }
                last
            }
        }
    }

    /// Probability with which [`Self::choose_light`] takes this light.
    fn choice_probability(&self, light: usize, position: Vec3, normal: Vec3) -> f32 {
        let lights = &self.group_lights[self.lights[light].group];
        if lights.len() == 1 {
            return 1.0;
        }
        let weight = |&l: &usize| self.light_weight(&self.lights[l], position, normal);
        weight(&light) / lights.iter().map(weight).sum::<f32>()
    }

    /// A direction towards one light of a group. `None` when the chosen light does not shine there.
    pub(super) fn sample_light(
        &self,
        group: usize,
        position: Vec3,
        normal: Vec3,
        u: [f32; 3],
    ) -> Option<LightSample> {
        let (light, choice) = self.choose_light(group, position, normal, u[0])?;
        let u = [u[1], u[2]];
        let toward = |point: Vec3| {
            let offset = point - position;
            let distance = offset.length();
            (distance > 0.0).then(|| (offset / distance, distance))
        };
        let area_sample = |direction: Vec3, distance: f32, cos: f32, area: f32, scale: f32| {
            (cos > 0.0 && scale > 0.0).then(|| LightSample {
                light,
                direction,
                distance,
                scale,
                pdf: choice * distance * distance / (area * cos),
                delta: false,
                pixel: 0,
            })
        };
        let solid_angle_sample = |direction: Vec3, distance: f32, pdf: f32, scale: f32| {
            (scale > 0.0).then_some(LightSample {
                light,
                direction,
                distance,
                scale,
                pdf,
                delta: false,
                pixel: 0,
            })
        };
        match &self.lights[light].emitter {
            CompiledEmitter::Disc { center, normal, tangents, radius, exponent } => {
                let area = PI * radius * radius;
                if let Some(view) = SphericalEllipse::new(*center, *normal, *radius, position) {
                    let (direction, density) = view.sample(u);
                    let cos = -direction.dot(*normal);
                    let distance = -(*center - position).dot(*normal) / cos;
                    let scale = lobe_radiance(cos, *exponent, area);
                    return solid_angle_sample(direction, distance, choice * density, scale);
                }
                let d = warp::concentric_disc(u) * *radius;
                let (direction, distance) = toward(*center + tangents.0 * d.x + tangents.1 * d.y)?;
                let cos = -direction.dot(*normal);
                area_sample(direction, distance, cos, area, lobe_radiance(cos, *exponent, area))
            }
            CompiledEmitter::Rectangle { shape, exponent } => {
                let (normal, area) = (shape.normal(), shape.area());
                // Nothing is sent backwards.
                if (position - shape.corner()).dot(normal) <= 0.0 {
                    return None;
                }
                if let Some(view) = SphericalRectangle::new(shape, position) {
                    let offset = view.sample(u);
                    let distance = offset.length();
                    let direction = offset / distance;
                    let scale = lobe_radiance(-direction.dot(normal), *exponent, area);
                    return solid_angle_sample(direction, distance, choice / view.solid_angle(), scale);
                }
                let (direction, distance) = toward(shape.at(u))?;
                let cos = -direction.dot(normal);
                area_sample(direction, distance, cos, area, lobe_radiance(cos, *exponent, area))
            }
            CompiledEmitter::Sphere { center, radius } => {
                self.sample_sphere(light, choice, position, &SphereLight::lamp(*center, *radius), u)
            }
            CompiledEmitter::Point { position: at, pattern } => {
                let (direction, distance) = toward(*at)?;
                let intensity = match pattern {
                    None => 1.0 / (4.0 * PI),
                    Some((axis, exponent)) => {
                        let cos = (-direction.dot(*axis)).max(0.0);
                        (exponent + 1.0) / (2.0 * PI) * cos.powf(*exponent)
                    }
                };
                let scale = intensity / (distance * distance);
                (scale > 0.0).then_some(LightSample {
                    light,
                    direction,
                    distance,
                    scale,
                    pdf: choice,
                    delta: true,
                    pixel: 0,
                })
            }
            CompiledEmitter::Distant { direction } => Some(LightSample {
                light,
                direction: -*direction,
                distance: f32::INFINITY,
                scale: 1.0,
                pdf: choice,
                delta: true,
                pixel: 0,
            }),
            CompiledEmitter::Environment { map, .. } => {
                let (direction, pixel, density) = map.sample(u);
                Some(LightSample {
                    light,
                    direction,
                    distance: f32::INFINITY,
                    scale: 1.0,
                    pdf: choice * density,
                    delta: false,
                    pixel,
                })
            }
            CompiledEmitter::Mesh { first_triangle, cumulative_area, .. } => {
                let total = *cumulative_area.last()?;
                // Choose a triangle by area and reuse the rest of the number.
                let target = u[0] * total;
                let index = cumulative_area.partition_point(|&a| a <= target).min(cumulative_area.len() - 1);
                let before = if index == 0 { 0.0 } else { cumulative_area[index - 1] };
                let rest = ((target - before) / (cumulative_area[index] - before)).clamp(0.0, 0.999_999_9);
                let [a, b, c] = self.corners(first_triangle + index);
                let [s, t] = warp::triangle([rest, u[1]]);
                let (direction, distance) = toward(a + (b - a) * s + (c - a) * t)?;
                let cos = direction.dot((b - a).cross(c - a).normalize_or_zero()).abs();
                area_sample(direction, distance, cos, total, 1.0)
            }
            CompiledEmitter::ShapeObject { shape } => match &self.shapes[*shape].shape {
                AnalyticShape::Sphere { center, radius } => {
                    self.sample_sphere(light, choice, position, &SphereLight::object(*center, *radius), u)
                }
                AnalyticShape::Disc { center, normal, tangents, radius } => {
                    if let Some(view) = SphericalEllipse::new(*center, *normal, *radius, position) {
                        let (direction, density) = view.sample(u);
                        let distance = (*center - position).dot(*normal) / direction.dot(*normal);
                        return solid_angle_sample(direction, distance, choice * density, 1.0);
                    }
                    let d = warp::concentric_disc(u) * *radius;
                    let (direction, distance) = toward(*center + tangents.0 * d.x + tangents.1 * d.y)?;
                    area_sample(direction, distance, direction.dot(*normal).abs(), PI * radius * radius, 1.0)
                }
            },
        }
    }

    /// From outside by the cone that the sphere fills, from inside (or on it) by its area.
    fn sample_sphere(
        &self,
        light: usize,
        choice: f32,
        position: Vec3,
        sphere: &SphereLight,
        u: [f32; 2],
    ) -> Option<LightSample> {
        let SphereLight { center, radius, scale, both_sides } = *sphere;
        let offset = center - position;
        let distance2 = offset.length_squared();
        if distance2 > radius * radius * 1.000_1 {
            let axis = offset / distance2.sqrt();
            let drop_max = cone_drop(radius, distance2);
            // 1 - cos, kept apart from 1: small and far spheres would lose their digits.
            let drop = u[0] * drop_max;
            let sin2 = drop * (2.0 - drop);
            let (sin_phi, cos_phi) = (2.0 * PI * u[1]).sin_cos();
            let (t0, t1) = warp::tangents(axis);
            let direction = (t0 * cos_phi + t1 * sin_phi) * sin2.sqrt() + axis * (1.0 - drop);
            let distance =
                (1.0 - drop) * distance2.sqrt() - (radius * radius - sin2 * distance2).max(0.0).sqrt();
            let pdf = choice / (2.0 * PI * drop_max);
            return Some(LightSample { light, direction, distance, scale, pdf, delta: false, pixel: 0 });
        }
        let normal = warp::uniform_sphere(u);
        let to_point = center + normal * radius - position;
        let distance = to_point.length();
        let direction = to_point.try_normalize()?;
        let cos = if both_sides { direction.dot(normal).abs() } else { -direction.dot(normal) };
        let area = 4.0 * PI * radius * radius;
        (cos > 0.0).then(|| LightSample {
            light,
            direction,
            distance,
            scale,
            pdf: choice * distance * distance / (area * cos),
            delta: false,
            pixel: 0,
        })
    }

    /// Calls `add` with every source of a sampled light and the factor on its spectrum; of its excitation bins with the
    /// first.
    #[inline]
    pub(super) fn each_source(&self, sample: &LightSample, mut add: impl FnMut(usize, f32)) {
        let light = &self.lights[sample.light];
        match &light.emitter {
            CompiledEmitter::Environment { map, sources } => {
                for (source, layer) in sources.iter().zip(map.layers()) {
                    add(*source, sample.scale * layer.factors[sample.pixel]);
                }
            }
            _ => add(light.source, sample.scale),
        }
    }

    /// Emission of the surroundings met by a ray that leaves the scene: calls `add` with source, factor on its
    /// spectrum, and the density, 1/sr, with which [`Self::sample_light`] would have chosen this direction; zero where
    /// it never does.
    pub(super) fn surroundings(
        &self,
        position: Vec3,
        normal: Vec3,
        direction: Vec3,
        mut add: impl FnMut(usize, f32, f32),
    ) {
        for &source in &self.environment {
            add(source, 1.0, 0.0);
        }
        for &light in &self.environment_maps {
            let CompiledEmitter::Environment { map, sources } = &self.lights[light].emitter else { continue };
            let pixel = map.pixel(direction);
            let pdf = self.choice_probability(light, position, normal) * map.pdf(direction);
            for (source, layer) in sources.iter().zip(map.layers()) {
                let factor = layer.factors[pixel];
                if factor > 0.0 {
                    (*source..*source + self.slices).for_each(|source| add(source, factor, pdf));
                }
            }
        }
    }

    /// Emission met by a ray that was not aimed at a light: light, factor on its spectrum, and the density, 1/sr,
    /// with which [`Self::sample_light`] would have chosen this direction from `position`.
    pub(super) fn emission_along(
        &self,
        position: Vec3,
        normal: Vec3,
        direction: Vec3,
        distance: f32,
        target: Target,
    ) -> Option<(usize, f32, f32)> {
        let (light, scale, cos, area, density) = match target {
            Target::Light(index) => {
                let light = index as usize;
                match &self.lights[light].emitter {
                    CompiledEmitter::Disc { center, normal, radius, exponent, .. } => {
                        let (cos, area) = (-direction.dot(*normal), PI * radius * radius);
                        let view = SphericalEllipse::new(*center, *normal, *radius, position);
                        let density = view.map(|view| view.pdf(direction));
                        (light, lobe_radiance(cos, *exponent, area), cos, area, density)
                    }
                    CompiledEmitter::Rectangle { shape, exponent } => {
                        let (cos, area) = (-direction.dot(shape.normal()), shape.area());
                        let scale = lobe_radiance(cos, *exponent, area);
                        if scale <= 0.0 {
                            return None;
                        }
                        let view = SphericalRectangle::new(shape, position);
                        let density = view.map(|view| 1.0 / view.solid_angle());
                        (light, scale, cos, area, density)
                    }
                    CompiledEmitter::Sphere { center, radius } => {
                        let sphere = SphereLight::lamp(*center, *radius);
                        return self.sphere_emission(light, position, normal, direction * distance, &sphere);
                    }
                    _ => return None,
                }
            }
            Target::Triangle { triangle, .. } => {
                let light = self.object_light[self.object_of(triangle as usize)]?;
                let CompiledEmitter::Mesh { cumulative_area, .. } = &self.lights[light].emitter else {
                    return None;
                };
                let [a, b, c] = self.corners(triangle as usize);
                let cos = direction.dot((b - a).cross(c - a).normalize_or_zero()).abs();
                (light, 1.0, cos, *cumulative_area.last()?, None)
            }
            // Instances of lamps are triangles of their own.
            Target::Instance { .. } => return None,
            Target::Shape(index) => {
                let shape = &self.shapes[index as usize];
                let light = self.object_light[shape.object]?;
                match &shape.shape {
                    AnalyticShape::Sphere { center, radius } => {
                        let sphere = SphereLight::object(*center, *radius);
                        return self.sphere_emission(light, position, normal, direction * distance, &sphere);
                    }
                    AnalyticShape::Disc { center, normal, radius, .. } => {
                        let view = SphericalEllipse::new(*center, *normal, *radius, position);
                        let density = view.map(|view| view.pdf(direction));
                        (light, 1.0, direction.dot(*normal).abs(), PI * radius * radius, density)
                    }
                }
            }
        };
        if cos <= 0.0 || scale <= 0.0 {
            return None;
        }
        let density = density.unwrap_or_else(|| distance * distance / (area * cos));
        Some((light, scale, self.choice_probability(light, position, normal) * density))
    }

    fn sphere_emission(
        &self,
        light: usize,
        position: Vec3,
        normal: Vec3,
        offset: Vec3,
        sphere: &SphereLight,
    ) -> Option<(usize, f32, f32)> {
        let SphereLight { center, radius, scale, both_sides } = *sphere;
        let distance = offset.length();
        let cos = -offset.dot(position + offset - center) / (distance * radius);
        if cos <= 0.0 && !both_sides {
            return None;
        }
        let choice = self.choice_probability(light, position, normal);
        let distance2 = (center - position).length_squared();
        let pdf = if distance2 > radius * radius * 1.000_1 {
            1.0 / (2.0 * PI * cone_drop(radius, distance2))
        } else {
            distance * distance / (4.0 * PI * radius * radius * cos.abs().max(1e-6))
        };
        Some((light, scale, choice * pdf))
    }
}

/// `1 - cos` of the cone that a sphere fills from a squared distance, without cancellation.
fn cone_drop(radius: f32, distance2: f32) -> f32 {
    let sin2 = radius * radius / distance2;
    sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt())
}

/// Radiance per unit power of a flat source with intensity `I0 cos^g`: `(g+1)/(2 pi A) cos^(g-1)`, 1/(sr m²).
fn lobe_radiance(cos: f32, exponent: f32, area: f32) -> f32 {
    if cos <= 0.0 {
        return 0.0;
    }
    let shape = if exponent == 1.0 { 1.0 } else { cos.powf(exponent - 1.0) };
    (exponent + 1.0) / (2.0 * PI * area) * shape
}

#[cfg(test)]
mod tests {
    use fluorspar_testkit::{chi_square_over_sphere, sidak};
    use glam::Vec2;

    use super::*;
    use crate::geometry::TriangleMesh;
    use crate::light::{Emitter, EnvironmentLayer, EnvironmentMap, Light, LightGroup};
    use crate::material::Material;
    use crate::optics::PerspectiveCamera;
    use crate::sampling::hash_u64;
    use crate::scene::{Object, Scene, Shape, SurfaceEmission};
    use crate::spectral::{Curve, WavelengthGrid};

    fn scene(lights: Vec<Emitter>, objects: Vec<Shape>) -> Scene {
        let emission = Some(SurfaceEmission { group: 0, radiance: Curve::constant(1.0) });
        Scene {
            grid: WavelengthGrid::uniform(500.0, 510.0, 5.0).unwrap(),
            objects: objects
                .into_iter()
                .map(|shape| Object { name: "o".into(), shape, material: 0, emission: emission.clone() })
                .collect(),
            materials: vec![Material::lambertian("m", Curve::constant(0.5))],
            fluorophores: Vec::new(),
            light_groups: vec![LightGroup { name: "g".into() }],
            lights: lights
                .into_iter()
                .map(|emitter| Light { name: "l".into(), group: 0, spectrum: Curve::constant(1.0), emitter })
                .collect(),
            camera: PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 50.0, 4, 4).unwrap(),
        }
    }

    /// Draws directions towards the lights and compares them with the density that rays report on meeting them:
    /// the two must be the same function for multiple importance sampling to be unbiased.
    fn check(scene: &Scene, position: Vec3, normal: Vec3, tests: usize) {
        let compiled = CompiledScene::new(scene, &[]).unwrap();
        chi_square_over_sphere(
            20_000,
            20,
            20,
            48,
            |i| {
                let (a, b) = (hash_u64(i as u64), hash_u64(i as u64 ^ 0xBEEF_0000_0000));
                let u = [a >> 40, a & 0xFF_FFFF, b >> 40].map(|bits| bits as f32 / 16_777_216.0);
                compiled
                    .sample_light(0, position, normal, u)
                    // A lamp in front of the surroundings hides them.
                    .filter(|s| s.distance.is_finite() || compiled.closest(position, s.direction).is_none())
                    .map(|s| s.direction.as_dvec3().normalize().to_array())
            },
            |d| {
                let direction = Vec3::new(d[0] as f32, d[1] as f32, d[2] as f32);
                let Some(hit) = compiled.closest(position, direction) else {
                    let mut density = 0.0;
                    compiled.surroundings(position, normal, direction, |_, _, pdf| density = f64::from(pdf));
                    return density;
                };
                compiled
                    .emission_along(position, normal, direction, hit.t, hit.target)
                    .map_or(0.0, |(_, _, pdf)| f64::from(pdf))
            },
        )
        .assert_accepted(sidak(0.01, tests));
    }

    #[test]
    fn every_light_is_sampled_by_the_density_that_it_reports() {
        let disc = |center: Vec3, exponent| Emitter::Disc {
            center,
            normal: -center.normalize(),
            radius_m: 1.5,
            exponent,
        };
        let quad = TriangleMesh {
            positions: vec![
                Vec3::new(-2.0, -1.0, -2.0),
                Vec3::new(2.0, -1.5, -2.0),
                Vec3::new(2.0, 2.0, -2.5),
                Vec3::new(-2.0, 2.0, -2.0),
            ],
            uvs: vec![Vec2::ZERO; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..TriangleMesh::default()
        };
        let layer = EnvironmentLayer {
            spectrum: Curve::constant(1.0),
            factors: (0..32).map(|i| if i == 11 { 40.0 } else { (i % 3) as f32 }).collect(),
        };
        let sky = EnvironmentMap::new(8, 4, vec![layer], 20.0).unwrap();
        let sky = Emitter::EnvironmentMap(std::sync::Arc::new(sky));
        let cases = vec![
            scene(vec![disc(Vec3::new(0.0, 0.0, 2.0), 1.0)], vec![]),
            scene(vec![disc(Vec3::new(0.5, 1.0, 2.0), 6.0)], vec![]),
            scene(
                vec![Emitter::Rectangle {
                    corner: Vec3::new(-1.0, -1.0, 1.0),
                    edge_u: Vec3::new(0.0, 3.0, 0.0),
                    edge_v: Vec3::new(3.0, 0.0, 0.0),
                    exponent: 2.0,
                }],
                vec![],
            ),
            scene(vec![Emitter::Sphere { center: Vec3::new(0.0, 1.5, 0.5), radius_m: 1.0 }], vec![]),
            scene(vec![], vec![Shape::Sphere { center: Vec3::ZERO, radius_m: 1.7 }]),
            scene(vec![], vec![Shape::Disc { center: Vec3::Y, normal: Vec3::Y, radius_m: 1.2 }]),
            scene(vec![], vec![Shape::Mesh(std::sync::Arc::new(quad))]),
            scene(vec![disc(Vec3::new(0.0, 0.0, 2.0), 1.0), disc(Vec3::new(3.0, 0.0, 0.5), 2.0)], vec![]),
            scene(vec![sky.clone()], vec![]),
            scene(vec![sky, disc(Vec3::new(0.0, 0.5, 2.0), 1.0)], vec![]),
        ];
        for case in &cases {
            check(case, Vec3::new(0.1, -0.2, 0.05), Vec3::new(0.2, 0.3, 1.0).normalize(), cases.len());
        }
    }
}
