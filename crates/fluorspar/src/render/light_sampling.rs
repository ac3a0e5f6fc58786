//! Choice among the lights of a group, for next-event estimation and its weighting. How each light is sampled, with which
//! density, is defined in [`crate::light`].

use std::f32::consts::PI;

use glam::Vec3;

use super::compiled_scene::{CompiledLight, CompiledScene};
use super::surface::Target;
use crate::light::{Emission, EmitterSample, LightBounds};

/// A light that was chosen, and a direction toward it.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightSample {
    /// Number of the light.
    pub(super) light: usize,
    /// Unit direction from the point to the light.
    pub(super) direction: Vec3,
    /// Distance to the light, m.
    pub(super) distance: f32,
    /// Factor on the source's spectrum: radiance for lights with area, radiance times solid angle for delta lights,
    /// 1 for environment maps, whose pixel holds the factors.
    pub(super) scale: f32,
    /// Pixel of an environment map.
    pub(super) pixel: usize,
    /// Density, 1/sr, choice of the light included; for delta lights the probability of the choice.
    pub(super) pdf: f32,
    /// Delta light: no scattered ray meets it.
    pub(super) delta: bool,
}

/// Lights of a group whose weights are kept while one is chosen.
const KNOWN_WEIGHTS: usize = 16;
/// Most lights of a scene that are weighted by what a surface scatters.
pub(super) const WEIGHTED_LIGHTS: usize = 32;
/// Fewest lights of a group that are, chosen: in a glossy cavity with two the relative variance falls by 3 %, and weighing them takes 4 % of
/// the time by a profile.
pub(super) const RING_LIGHTS: usize = 4;
/// Share of the choice by irradiance alone, which fluorescence follows: no light's share falls below half of that.
const BY_IRRADIANCE: f32 = 0.5;
/// A floor on the weight of any light, so that none is ever left out.
const LEAST_WEIGHT: f32 = 1e-3;

/// Probabilities with which the lights of a scene are chosen at a vertex, each among those of its group, by irradiance times
/// what the surface scatters; `None` where irradiance alone decides.
pub(super) type LightProbabilities = Option<[f32; WEIGHTED_LIGHTS]>;

/// A point that lights are chosen for.
#[derive(Clone, Copy)]
pub(super) struct LitPoint<'a> {
    pub(super) position: Vec3,
    /// Normal on the side that light arrives from; zero where that may be either side.
    pub(super) normal: Vec3,
    pub(super) probabilities: &'a LightProbabilities,
}

/// Irradiance of a light, on any scale, and from where it comes.
struct LightWeight {
    weight: f32,
    /// The cosine that is part of the weight.
    facing: f32,
    /// Unit direction to its center; `None` for light from everywhere.
    direction: Option<Vec3>,
}

impl LightWeight {
    fn new(weight: f32, facing: f32, direction: Option<Vec3>) -> Self {
        Self { weight, facing, direction }
    }

    /// Times what a surface scatters from there; from everywhere, what a white one does.
    fn times(&self, scattered: impl Fn(Vec3) -> f32) -> f32 {
        self.direction.map_or(self.weight / PI, |from| self.weight / self.facing * scattered(from))
    }
}

impl CompiledScene {
    /// Relative weight with which a light is chosen at a point: power over squared distance, and no more than a
    /// token for lights that lie behind the surface. A zero normal marks a surface that transmits light.
    #[inline]
    fn light_weight(&self, light: &CompiledLight, position: Vec3, normal: Vec3) -> LightWeight {
        let (center, radius, lobe) = match light.bounds {
            // The others' weight is 2 pi times their irradiance.
            LightBounds::Distant { direction } => {
                let cosine = if normal == Vec3::ZERO { 1.0 } else { -direction.dot(normal) };
                let facing = cosine.max(LEAST_WEIGHT);
                return LightWeight::new(2.0 * PI * light.power * facing, facing, Some(-direction));
            }
            LightBounds::Environment => return LightWeight::new(2.0 * PI * PI * light.power, 1.0, None),
            LightBounds::Local { center, radius, lobe } => (center, radius, lobe),
        };
        let to_light = center - position;
        let distance2 = to_light.length_squared().max(radius * radius).max(1e-12);
        let direction = to_light / distance2.sqrt();
        // The whole light may be lower than its center by its radius.
        let sine = radius / distance2.sqrt();
        let facing =
            if normal == Vec3::ZERO { 1.0 } else { (direction.dot(normal) + sine).clamp(LEAST_WEIGHT, 1.0) };
        let emission = lobe.map_or(1.0, |(axis, exponent)| {
            let cos = (-direction.dot(axis) + sine).min(1.0);
            // Most lights are Lambertian, and powf is slow.
            let lobe = if exponent == 1.0 { cos } else { cos.powf(exponent) };
            if cos <= 0.0 { LEAST_WEIGHT } else { lobe.max(LEAST_WEIGHT) * (exponent + 1.0) }
        });
        LightWeight {
            weight: light.power * facing * emission / distance2,
            facing,
            direction: Some(direction),
        }
    }

    /// Probabilities of all lights at a surface that scatters the share `scattered(direction)`, 1/sr, of the light from a
    /// direction: half by irradiance, half by irradiance times that. `None` where the lights are too many, or fewer than `fewest` in each
    /// group.
    ///
    /// Few lights of a ring are mirrored by a wet surface, and those that are count for most of its light.
    pub(super) fn light_probabilities(
        &self,
        position: Vec3,
        normal: Vec3,
        scattered: impl Fn(Vec3) -> f32,
        fewest: usize,
    ) -> LightProbabilities {
        if self.lights.len() > WEIGHTED_LIGHTS || self.group_lights.iter().all(|lights| lights.len() < fewest)
        {
            return None;
        }
        let (mut irradiances, mut products) = ([0.0; WEIGHTED_LIGHTS], [0.0; WEIGHTED_LIGHTS]);
        for lights in &self.group_lights {
            // Weigh the lights of the group
            let (mut irradiance, mut product) = (0.0, 0.0);
            for &light in lights {
                let of = self.light_weight(&self.lights[light], position, normal);
                irradiances[light] = of.weight;
                products[light] = of.times(&scattered);
                irradiance += irradiances[light];
                product += products[light];
            }
            // Mix both choices
            let irradiance = irradiance.max(f32::MIN_POSITIVE);
            for &light in lights {
                let by_irradiance = irradiances[light] / irradiance;
                irradiances[light] = if product.is_normal() {
                    BY_IRRADIANCE * by_irradiance + (1.0 - BY_IRRADIANCE) * products[light] / product
                } else {
                    by_irradiance
                };
            }
        }
        Some(irradiances)
    }

    /// Chooses one light of a group; returns it and the probability of the choice.
    #[inline]
    fn choose_light(&self, group: usize, point: &LitPoint<'_>, u: f32) -> Option<(usize, f32)> {
        let lights = &self.group_lights[group];
        match lights.as_slice() {
            [] => None,
            [only] => Some((*only, 1.0)),
            _ => {
                // Sum the weights of all lights; those of the first are kept for the second pass.
                let mut known = [0.0; KNOWN_WEIGHTS];
                let weight = |light: usize| match point.probabilities {
                    Some(probabilities) => probabilities[light],
                    None => self.light_weight(&self.lights[light], point.position, point.normal).weight,
                };
                let mut total = 0.0;
                for (index, &light) in lights.iter().enumerate() {
                    let w = weight(light);
                    total += w;
                    if let Some(known) = known.get_mut(index) {
                        *known = w;
                    }
                }
                // Invert the cumulative distribution; rounding may leave the last light.
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
    fn choice_probability(&self, light: usize, point: &LitPoint<'_>) -> f32 {
        let lights = &self.group_lights[self.lights[light].group];
        if lights.len() == 1 {
            return 1.0;
        }
        if let Some(probabilities) = point.probabilities {
            return probabilities[light];
        }
        let weight = |&l: &usize| self.light_weight(&self.lights[l], point.position, point.normal).weight;
        weight(&light) / lights.iter().map(weight).sum::<f32>()
    }

    /// A direction toward one light of a group. `None` when the chosen light does not shine there.
    pub(super) fn sample_light(
        &self,
        group: usize,
        point: &LitPoint<'_>,
        u: [f32; 3],
    ) -> Option<LightSample> {
        // Choose a light
        let (light, choice) = self.choose_light(group, point, u[0])?;

        // Sample a direction toward it
        let corners = |triangle| self.corners(triangle);
        let sample = self.lights[light].emitter.sample(point.position, [u[1], u[2]], choice, corners)?;
        let EmitterSample { direction, distance, scale, pixel, pdf, delta } = sample;
        Some(LightSample { light, direction, distance, scale, pixel, pdf, delta })
    }

    /// Calls `add` with every source of a sampled light and the factor on its spectrum.
    #[inline]
    pub(super) fn each_source(&self, sample: &LightSample, mut add: impl FnMut(usize, f32)) {
        let light = &self.lights[sample.light];
        match light.emitter.environment_map() {
            Some(map) => {
                for (source, layer) in light.sources.iter().zip(map.layers()) {
                    add(*source, sample.scale * layer.factors[sample.pixel]);
                }
            }
            None => add(light.source, sample.scale),
        }
    }

    /// Emission of the environment along a ray that leaves the scene: calls `add` with source, factor on its
    /// spectrum, and the density, 1/sr, with which [`Self::sample_light`] would have chosen this direction; zero where
    /// it never does.
    pub(super) fn surroundings(
        &self,
        point: &LitPoint<'_>,
        direction: Vec3,
        mut add: impl FnMut(usize, f32, f32),
    ) {
        for &source in &self.environment {
            add(source, 1.0, 0.0);
        }
        for &light in &self.environment_maps {
            let CompiledLight { emitter, sources, .. } = &self.lights[light];
            let Some(map) = emitter.environment_map() else { continue };
            let pixel = map.pixel(direction);
            let pdf = self.choice_probability(light, point) * map.pdf(direction);
            for (source, layer) in sources.iter().zip(map.layers()) {
                let factor = layer.factors[pixel];
                if factor > 0.0 {
                    add(*source, factor, pdf);
                }
            }
        }
    }

    /// Emission hit by a scattered ray: light, factor on its spectrum, and the density, 1/sr,
    /// with which [`Self::sample_light`] would have chosen this direction from `point`.
    pub(super) fn emission_along(
        &self,
        point: &LitPoint<'_>,
        direction: Vec3,
        distance: f32,
        target: Target,
    ) -> Option<(usize, f32, f32)> {
        // Find the light that was hit
        let light = match target {
            Target::Light(index) => index as usize,
            Target::Triangle { triangle, .. } => self.object_light[self.object_of(triangle as usize)]?,
            Target::Shape(index) => self.object_light[self.shapes[index as usize].object]?,
            // Emissive instances are flattened to triangles.
            Target::Instance { .. } => return None,
        };

        // Evaluate its emission and the density of next-event estimation
        let corners = || match target {
            Target::Triangle { triangle, .. } => Some(self.corners(triangle as usize)),
            _ => None,
        };
        let Emission { scale, density } =
            self.lights[light].emitter.emission(point.position, direction, distance, corners)?;
        Some((light, scale, self.choice_probability(light, point) * density))
    }
}

#[cfg(test)]
mod tests {
    use fluorspar_testkit::{chi_square_over_sphere, sidak};
    use glam::Vec2;

    use super::*;
    use crate::geometry::TriangleMesh;
    use crate::light::{
        DiscEmitter, Emitter, EnvironmentLayer, EnvironmentMap, Light, LightGroup, RectangleEmitter,
        SphereEmitter,
    };
    use crate::material::Material;
    use crate::optics::PerspectiveCamera;
    use crate::render::RenderSettings;
    use crate::sampling::hash_u64;
    use crate::scene::{Object, Scene, Shape, SurfaceEmission};
    use crate::spectral::{Curve, WavelengthGrid};

    fn scene(lights: Vec<Emitter>, objects: Vec<Shape>) -> Scene {
        let emission =
            Some(SurfaceEmission { group: 0, radiance: Curve::constant(1.0), is_one_sided: false });
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
                .map(|emitter| Light {
                    name: "l".into(),
                    group: 0,
                    spectrum: Curve::constant(1.0),
                    crossed_polarizers: false,
                    emitter,
                })
                .collect(),
            camera: PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 50.0, 4, 4).unwrap(),
        }
    }

    /// Draws directions toward the lights and compares them with the density that rays report on meeting them:
    /// the two must be the same function for multiple importance sampling to be unbiased.
    fn check(scene: &Scene, position: Vec3, normal: Vec3, is_glossy: bool, tests: usize) {
        let compiled = CompiledScene::new(scene, &RenderSettings::default()).unwrap();
        let lobe = |direction: Vec3| direction.dot(Vec3::new(0.6, 0.0, 0.8)).max(0.0).powi(20);
        let probabilities =
            is_glossy.then(|| compiled.light_probabilities(position, normal, lobe, RING_LIGHTS)).flatten();
        let point = LitPoint { position, normal, probabilities: &probabilities };
        chi_square_over_sphere(
            20_000,
            20,
            20,
            48,
            |i| {
                let (a, b) = (hash_u64(i as u64), hash_u64(i as u64 ^ 0xBEEF_0000_0000));
                let u = [a >> 40, a & 0xFF_FFFF, b >> 40].map(|bits| bits as f32 / 16_777_216.0);
                compiled
                    .sample_light(0, &point, u)
                    // A light in front of the environment occludes it.
                    .filter(|s| s.distance.is_finite() || compiled.closest(position, s.direction).is_none())
                    .map(|s| s.direction.as_dvec3().normalize().to_array())
            },
            |d| {
                let direction = Vec3::new(d[0] as f32, d[1] as f32, d[2] as f32);
                let Some(hit) = compiled.closest(position, direction) else {
                    let mut density = 0.0;
                    compiled.surroundings(&point, direction, |_, _, pdf| density = f64::from(pdf));
                    return density;
                };
                compiled
                    .emission_along(&point, direction, hit.t, hit.target)
                    .map_or(0.0, |(_, _, pdf)| f64::from(pdf))
            },
        )
        .assert_accepted(sidak(0.01, tests));
    }

    #[test]
    fn every_light_is_sampled_by_the_density_that_it_reports() {
        let disc = |center: Vec3, exponent| {
            Emitter::Disc(DiscEmitter { center, normal: -center.normalize(), radius_m: 1.5, exponent })
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
        // None before another one
        let around = |light: usize| {
            let (sin, cos) = (light as f32).sin_cos();
            let (center, normal) = (Vec3::new(1.5 * cos, 1.5 * sin, 2.0), Vec3::NEG_Z);
            Emitter::Disc(DiscEmitter { center, normal, radius_m: 0.4, exponent: 1.0 })
        };
        let ring = |count: usize| (0..count).map(around).collect::<Vec<_>>();
        let cases = vec![
            scene(vec![disc(Vec3::new(0.0, 0.0, 2.0), 1.0)], vec![]),
            scene(vec![disc(Vec3::new(0.5, 1.0, 2.0), 6.0)], vec![]),
            scene(
                vec![Emitter::Rectangle(RectangleEmitter {
                    corner: Vec3::new(-1.0, -1.0, 1.0),
                    edge_u: Vec3::new(0.0, 3.0, 0.0),
                    edge_v: Vec3::new(3.0, 0.0, 0.0),
                    exponent: 2.0,
                })],
                vec![],
            ),
            scene(
                vec![Emitter::Sphere(SphereEmitter { center: Vec3::new(0.0, 1.5, 0.5), radius_m: 1.0 })],
                vec![],
            ),
            scene(vec![], vec![Shape::Sphere { center: Vec3::ZERO, radius_m: 1.7 }]),
            scene(vec![], vec![Shape::Disc { center: Vec3::Y, normal: Vec3::Y, radius_m: 1.2 }]),
            scene(vec![], vec![Shape::Mesh(std::sync::Arc::new(quad))]),
            scene(vec![disc(Vec3::new(0.0, 0.0, 2.0), 1.0), disc(Vec3::new(3.0, 0.0, 0.5), 2.0)], vec![]),
            scene(vec![sky.clone()], vec![]),
            scene([vec![sky], ring(3)].concat(), vec![]),
            scene(ring(RING_LIGHTS), vec![]),
        ];
        for (case, is_glossy) in cases.iter().flat_map(|case| [(case, false), (case, true)]) {
            let normal = Vec3::new(0.2, 0.3, 1.0).normalize();
            check(case, Vec3::new(0.1, -0.2, 0.05), normal, is_glossy, 2 * cases.len());
        }
    }

    #[test]
    fn lights_that_a_surface_mirrors_are_chosen_more_often() {
        let disc = |x: f32| {
            let normal = Vec3::NEG_Z;
            Emitter::Disc(DiscEmitter {
                center: Vec3::new(x, 0.0, 2.0),
                normal,
                radius_m: 0.1,
                exponent: 1.0,
            })
        };
        let compiled = CompiledScene::new(
            &scene([-1.0, 0.0, 1.0, -2.0].map(disc).to_vec(), vec![]),
            &RenderSettings::default(),
        )
        .unwrap();
        // Nothing but light from the right is mirrored
        let mirrored = |direction: Vec3| if direction.x > 0.3 { 1.0 } else { 0.0 };
        let chosen = compiled.light_probabilities(Vec3::ZERO, Vec3::Z, mirrored, RING_LIGHTS).unwrap();
        let plain = compiled.light_probabilities(Vec3::ZERO, Vec3::Z, |_| 0.0, RING_LIGHTS).unwrap();
        for light in 0..RING_LIGHTS {
            let expected = 0.5 * plain[light] + if light == 2 { 0.5 } else { 0.0 };
            assert!((chosen[light] - expected).abs() < 1e-6, "{light}: {} {expected}", chosen[light]);
        }
        assert!((plain.iter().sum::<f32>() - 1.0).abs() < 1e-6 && plain[1] > plain[0]);
    }
}
