//! Samples one path from the camera and keeps what the spectra need to run back along it.

use std::f32::consts::PI;

use glam::Vec3;

use super::adjoint::{BINS, Importance};
use super::compiled_scene::CompiledScene;
use super::integrator::Estimator;
use super::scattering::ScatteringSample;
use crate::sampling::SampleStream;

/// Direct light of one source at a vertex: factors on the source's spectrum.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DirectLight {
    /// Irradiance that the diffuse base turns into radiance `R e / pi`.
    pub(super) diffuse: f32,
    /// Irradiance that reaches the fluorophores.
    pub(super) fluorescent: f32,
    /// Radiance reflected by the coat.
    pub(super) gloss: f32,
}

/// A vertex of the path: scalars only. What is a list lies in the path, and the vertex knows where.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Vertex {
    pub(super) material: u32,
    /// Start of its weights in [`Path::weights`]: reflectance terms of the material, then its concentrations.
    weights: u32,
    /// Start of its emission in [`Path::emission`], and how much there is.
    emission: (u32, u32),
    /// Factor on light that arrives along the continued path: times the reflectance.
    pub(super) diffuse: f32,
    /// Factor for the fluorescence operator.
    pub(super) fluorescent: f32,
    /// Achromatic factor of the coat.
    pub(super) gloss: f32,
}

/// The vertices of one path; reused from path to path.
#[derive(Debug, Default)]
pub(super) struct Path {
    vertices: Vec<Vertex>,
    /// Weights of reflectance terms and concentrations, vertex after vertex.
    weights: Vec<f32>,
    /// Direct light, one entry per source, vertex after vertex.
    direct: Vec<DirectLight>,
    /// Emission seen along the continued path: source and factor (surroundings may hold several).
    emission: Vec<(u32, f32)>,
    /// Emission seen by the camera directly.
    pub(super) seen: Vec<(u32, f32)>,
}

/// From this vertex on, paths may end by Russian roulette.
const ROULETTE_FROM: u32 = 3;
/// Lowest chance to go on.
const ROULETTE_FLOOR: f32 = 0.05;

impl Path {
    fn clear(&mut self) {
        self.vertices.clear();
        self.weights.clear();
        self.direct.clear();
        self.emission.clear();
        self.seen.clear();
    }

    /// Vertices from the camera on.
    pub(super) fn vertices(&self) -> &[Vertex] {
        &self.vertices
    }

    /// Weights of the reflectance terms, then concentrations of the fluorophores, of the vertex's material.
    #[inline(always)]
    pub(super) fn weights(&self, vertex: &Vertex) -> &[f32] {
        &self.weights[vertex.weights as usize..]
    }

    /// Direct light at a vertex, one entry per source.
    #[inline(always)]
    pub(super) fn direct(&self, vertex: usize, sources: usize) -> &[DirectLight] {
        &self.direct[vertex * sources..(vertex + 1) * sources]
    }

    /// Emission seen along the path continued from a vertex.
    #[inline(always)]
    pub(super) fn emission(&self, vertex: &Vertex) -> &[(u32, f32)] {
        let (start, count) = vertex.emission;
        &self.emission[start as usize..(start + count) as usize]
    }

    /// Notes emission that a ray met, from the last vertex or from the camera.
    fn meet(&mut self, source: usize, factor: f32) {
        let met = (source as u32, factor);
        match self.vertices.last_mut() {
            None => self.seen.push(met),
            Some(vertex) => {
                if vertex.emission.1 == 0 {
                    vertex.emission.0 = self.emission.len() as u32;
                }
                vertex.emission.1 += 1;
                self.emission.push(met);
            }
        }
    }
}

impl CompiledScene<'_> {
    /// Samples a path. `direction` is a unit vector from the camera.
    pub(super) fn trace(
        &self,
        path: &mut Path,
        mut origin: Vec3,
        mut direction: Vec3,
        stream: &mut SampleStream,
        max_depth: u32,
        estimator: Estimator,
    ) {
        path.clear();
        let mut importance = Importance::CAMERA;
        // Where the ray came from and with which density, for weighting the emission it meets.
        let mut previous: Option<(Vec3, Vec3, f32)> = None;

        for depth in 0..=max_depth {
            let hit = self.closest(origin, direction);

            // Emission met by chance.
            let (from, normal) = previous.map_or((origin, Vec3::ZERO), |(p, n, _)| (p, n));
            let weight = |light_pdf: f32| match (previous, estimator) {
                (Some((_, _, pdf)), Estimator::MultipleImportance) => power_heuristic(pdf, light_pdf),
                _ => 1.0,
            };
            match &hit {
                None => {
                    let add = |source, scale: f32, light_pdf| path.meet(source, scale * weight(light_pdf));
                    self.surroundings(from, normal, direction, add);
                }
                Some(hit) => {
                    if let Some((light, scale, light_pdf)) =
                        self.emission_along(from, normal, direction, hit.t, hit.target)
                    {
                        let (source, scale) = (self.lights[light].source, scale * weight(light_pdf));
                        for source in source..source + self.slices {
                            path.meet(source, scale);
                        }
                    }
                }
            }

            let Some(hit) = hit else { return };
            let Some(mut point) = self.surface(origin, direction, &hit) else { return };
            if depth == max_depth {
                return;
            }

            let [mut choice, u0, u1, roulette] = stream.next_4d();
            let outermost = self.scene.objects[point.object].material;
            let material_index = self.material_at(outermost, point.uv, point.front, &mut choice);
            let material = &self.materials[material_index];
            if let Some(map) = &material.normal_map {
                let along = self.texture_directions(hit.target, point.position);
                point.apply_normal_map(map.at(point.uv), along, -direction);
            }
            let bsdf = self.bsdf(material, point.uv, point.front, point.to_local(-direction));
            // Light may come from either side of a clear body.
            let light_normal = if bsdf.transmits() { Vec3::ZERO } else { point.shading };
            // A direction that the shading and the geometric normal put on different sides carries nothing.
            let is_consistent = |world: Vec3, local: Vec3| {
                world.dot(point.geometric) * local.z > 0.0 && (local.z > 0.0 || bsdf.transmits())
            };

            let weights = path.weights.len() as u32;
            let mut coarse = [0.0; BINS];
            let terms = material.reflectance.iter().zip(&material.coarse_reflectance);
            for (term, ((_, weight), coarse_spectrum)) in terms.enumerate() {
                let weight = bsdf.term_weight(term, weight.at(point.uv));
                path.weights.push(weight);
                for (sum, value) in coarse.iter_mut().zip(coarse_spectrum) {
                    *sum += weight * value;
                }
            }
            path.weights.extend(material.fluorophores.iter().map(|(_, texture)| texture.at(point.uv)));
            let first_direct = path.direct.len();
            path.direct.resize(first_direct + self.sources.len(), DirectLight::default());
            let direct = &mut path.direct[first_direct..];
            path.vertices.push(Vertex { material: material_index as u32, weights, ..Vertex::default() });

            // Next-event estimation: one light of every group.
            if estimator == Estimator::MultipleImportance {
                for group in 0..self.group_lights.len() {
                    let u = stream.next_4d();
                    let sample = self.sample_light(group, point.position, light_normal, [u[0], u[1], u[2]]);
                    let Some(sample) = sample else { continue };
                    let local = point.to_local(sample.direction);
                    if !is_consistent(sample.direction, local) {
                        continue;
                    }
                    let s = bsdf.evaluate(local);
                    if s.pdf <= 0.0 {
                        continue;
                    }
                    // Stop short of the light's own surface.
                    let reach = sample.distance - 2.0 * self.clearance.max(1e-5 * sample.distance);
                    let reach = if sample.distance.is_finite() { reach } else { f32::INFINITY };
                    let start = point.leave(sample.direction, self.clearance);
                    let visible = self.visibility(start, sample.direction, reach, sample.light);
                    if visible <= 0.0 {
                        continue;
                    }
                    let weight = if sample.delta { 1.0 } else { power_heuristic(sample.pdf, s.pdf) };
                    let factor = visible * weight / sample.pdf;
                    self.each_source(&sample, |source, scale| {
                        let direct = &mut direct[source];
                        direct.diffuse += factor * scale * s.diffuse * PI;
                        direct.fluorescent += factor * scale * s.fluorescent * PI;
                        direct.gloss += factor * scale * s.gloss;
                    });
                }
            }

            if self.slices > 1 {
                // All excitation bins of a lamp shine from the same place.
                for bins in direct.chunks_mut(self.slices) {
                    let of_lamp = bins[0];
                    bins.fill(of_lamp);
                }
            }

            // Continue the path.
            let Some(ScatteringSample { incident, scattering: s, delta }) = bsdf.sample(choice, [u0, u1])
            else {
                return;
            };
            let world = point.to_world(incident).normalize();
            if !is_consistent(world, incident) {
                return;
            }
            let mut survival = 1.0;
            self.adjoint.scatter(&mut importance, &s, &coarse, material.fluorophores.iter().map(|(f, _)| *f));
            if depth >= ROULETTE_FROM {
                survival = self.adjoint.reach(&importance).clamp(ROULETTE_FLOOR, 1.0);
                if roulette >= survival {
                    return;
                }
                importance.survive(survival);
            }
            let factor = 1.0 / (s.pdf * survival);
            if let Some(vertex) = path.vertices.last_mut() {
                vertex.diffuse = s.diffuse * factor;
                vertex.fluorescent = s.fluorescent * factor;
                vertex.gloss = s.gloss * factor;
            }

            previous = Some((point.position, light_normal, if delta { f32::INFINITY } else { s.pdf }));
            origin = point.leave(world, self.clearance);
            direction = world;
        }
    }
}

/// Power heuristic with exponent 2 (Veach 1997): weight of the technique with density `own`.
fn power_heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() {
        return 1.0;
    }
    let (a, b) = (own * own, other * other);
    if a + b > 0.0 { a / (a + b) } else { 0.0 }
}
