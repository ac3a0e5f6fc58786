//! Samples one path from the camera and keeps what the spectra need to run back along it.

use std::f32::consts::PI;

use glam::Vec3;

use super::compiled_scene::CompiledScene;
use super::integrator::Estimator;
use super::surface::SurfacePoint;
use crate::material::coat;
use crate::sampling::{SampleStream, warp};

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

/// A vertex of the path: everything is a scalar but the reflectance.
#[derive(Clone, Debug, Default)]
pub(super) struct Vertex {
    pub(super) material: usize,
    /// Diffuse reflectance, one value per band.
    pub(super) reflectance: Vec<f32>,
    /// Concentration of each fluorophore of the material.
    pub(super) concentration: Vec<f32>,
    /// Per source.
    pub(super) direct: Vec<DirectLight>,
    /// Factor on light that arrives along the continued path: times the reflectance.
    pub(super) diffuse: f32,
    /// Factor for the fluorescence operator.
    pub(super) fluorescent: f32,
    /// Achromatic factor of the coat.
    pub(super) gloss: f32,
    /// Emission seen along the continued path: source and factor (environment may hold several).
    pub(super) arriving: Vec<(usize, f32)>,
}

/// The vertices of one path; reused from path to path.
#[derive(Debug, Default)]
pub(super) struct Path {
    vertices: Vec<Vertex>,
    len: usize,
    /// Emission seen by the camera directly.
    pub(super) seen: Vec<(usize, f32)>,
}

/// From this vertex on, paths may end by Russian roulette.
const ROULETTE_FROM: u32 = 3;
/// Lowest chance to go on.
const ROULETTE_FLOOR: f32 = 0.05;

impl Path {
    /// Vertices from the camera on.
    pub(super) fn vertices(&self) -> &[Vertex] {
        &self.vertices[..self.len]
    }

    fn next_vertex(&mut self, sources: usize) -> &mut Vertex {
        if self.len == self.vertices.len() {
            self.vertices.push(Vertex::default());
        }
        let vertex = &mut self.vertices[self.len];
        self.len += 1;
        vertex.direct.clear();
        vertex.direct.resize(sources, DirectLight::default());
        vertex.arriving.clear();
        (vertex.diffuse, vertex.fluorescent, vertex.gloss) = (0.0, 0.0, 0.0);
        vertex
    }
}

/// The coat at a point, for one outgoing direction.
struct CoatAtPoint {
    index: f32,
    alpha: f32,
    /// Share of light that passes the coat on the way out.
    pass_out: f32,
    /// Mean share that the coat reflects.
    mean: f32,
    table: usize,
}

/// Throughput factors for one incident direction, cosine included, in 1/sr.
struct Scattering {
    diffuse: f32,
    fluorescent: f32,
    gloss: f32,
    pdf: f32,
}

struct Lobes {
    coat: Option<CoatAtPoint>,
    coat_probability: f32,
    outgoing: Vec3,
}

impl CompiledScene<'_> {
    fn lobes(&self, material: usize, point: &SurfacePoint, outgoing: Vec3) -> Lobes {
        let material = &self.materials[material];
        let coat = material.coat.as_ref().map(|(table, roughness)| {
            let alpha = roughness.at(point.uv).clamp(coat::MIN_ROUGHNESS, 1.0);
            let (albedo, mean) = self.coats[*table].at(outgoing.z, alpha);
            CoatAtPoint {
                index: self.coats[*table].refractive_index(),
                alpha,
                pass_out: 1.0 - albedo,
                mean,
                table: *table,
            }
        });
        let coat_probability = coat.as_ref().map_or(0.0, |c| {
            let (gloss, base) = (1.0 - c.pass_out, c.pass_out * material.albedo_bound.min(1.0));
            if base <= 0.0 { 1.0 } else { (gloss / (gloss + base)).clamp(0.1, 0.9) }
        });
        Lobes { coat, coat_probability, outgoing }
    }

    fn scatter(&self, lobes: &Lobes, incident: Vec3) -> Scattering {
        if incident.z <= 0.0 {
            return Scattering { diffuse: 0.0, fluorescent: 0.0, gloss: 0.0, pdf: 0.0 };
        }
        let lambert = incident.z / PI;
        let Some(c) = &lobes.coat else {
            return Scattering { diffuse: lambert, fluorescent: lambert, gloss: 0.0, pdf: lambert };
        };
        let pass_in = 1.0 - self.coats[c.table].at(incident.z, c.alpha).0;
        Scattering {
            diffuse: lambert * pass_in * c.pass_out / (1.0 - c.mean),
            fluorescent: lambert * pass_in,
            gloss: coat::eval_times_cos(lobes.outgoing, incident, c.alpha, c.index),
            pdf: lobes.coat_probability * coat::pdf(lobes.outgoing, incident, c.alpha)
                + (1.0 - lobes.coat_probability) * lambert,
        }
    }

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
        path.len = 0;
        path.seen.clear();
        let mut throughput = 1.0_f32;
        // Where the ray came from and with which density, for weighting the emission it meets.
        let mut previous: Option<(Vec3, Vec3, f32)> = None;

        for depth in 0..=max_depth {
            let hit = self.closest(origin, direction);

            // Emission met by chance.
            let mut met = Vec::new();
            match &hit {
                None => met.extend(self.environment.iter().map(|&source| (source, 1.0))),
                Some(hit) => {
                    let (position, normal) = previous.map_or((origin, direction), |(p, n, _)| (p, n));
                    if let Some((light, scale, light_pdf)) =
                        self.emission_along(position, normal, direction, hit.t, hit.target)
                    {
                        let weight = match (previous, estimator) {
                            (Some((_, _, pdf)), Estimator::MultipleImportance) => {
                                power_heuristic(pdf, light_pdf)
                            }
                            _ => 1.0,
                        };
                        let source = self.lights[light].source;
                        met.extend((source..source + self.slices).map(|source| (source, scale * weight)));
                    }
                }
            }
            if path.len == 0 {
                path.seen.extend(met);
            } else {
                let last = path.len - 1;
                path.vertices[last].arriving.extend(met);
            }

            let Some(hit) = hit else { return };
            let Some(point) = self.surface(origin, direction, &hit) else { return };
            if depth == max_depth {
                return;
            }

            let material_index = self.scene.objects[point.object].material;
            let material = &self.materials[material_index];
            let outgoing = point.to_local(-direction);
            let lobes = self.lobes(material_index, &point, outgoing);
            let start = point.leave(self.clearance);

            let bands = self.bands;
            let vertex = path.next_vertex(self.sources.len());
            vertex.material = material_index;
            vertex.reflectance.clear();
            vertex.reflectance.resize(bands, 0.0);
            for (spectrum, weight) in &material.reflectance {
                let weight = weight.at(point.uv);
                for (sum, value) in vertex.reflectance.iter_mut().zip(spectrum) {
                    *sum += weight * value;
                }
            }
            vertex.concentration.clear();
            vertex
                .concentration
                .extend(material.fluorophores.iter().map(|(_, texture)| texture.at(point.uv)));

            // Next-event estimation: one light of every group.
            let scattering_numbers = stream.next_4d();
            if estimator == Estimator::MultipleImportance {
                for group in 0..self.group_lights.len() {
                    let u = stream.next_4d();
                    let sample = self.sample_light(group, point.position, point.shading, [u[0], u[1], u[2]]);
                    let Some(sample) = sample else { continue };
                    if sample.direction.dot(point.geometric) <= 0.0 {
                        continue;
                    }
                    let s = self.scatter(&lobes, point.to_local(sample.direction));
                    if s.pdf <= 0.0 {
                        continue;
                    }
                    // Stop short of the light's own surface.
                    let reach = sample.distance - 2.0 * self.clearance.max(1e-5 * sample.distance);
                    let reach = if sample.distance.is_finite() { reach } else { f32::INFINITY };
                    if self.occluded(start, sample.direction, reach, sample.light) {
                        continue;
                    }
                    let weight = if sample.delta { 1.0 } else { power_heuristic(sample.pdf, s.pdf) };
                    let factor = weight * sample.scale / sample.pdf;
                    let direct = &mut vertex.direct[self.lights[sample.light].source];
                    direct.diffuse += factor * s.diffuse * PI;
                    direct.fluorescent += factor * s.fluorescent * PI;
                    direct.gloss += factor * s.gloss;
                }
            }

            if self.slices > 1 {
                // All excitation bins of a lamp shine from the same place.
                for bins in vertex.direct.chunks_mut(self.slices) {
                    let of_lamp = bins[0];
                    bins.fill(of_lamp);
                }
            }

            // Continue the path.
            let [choice, u0, u1, roulette] = scattering_numbers;
            let incident = if choice < lobes.coat_probability {
                match lobes.coat.as_ref().and_then(|c| coat::sample(outgoing, c.alpha, [u0, u1])) {
                    Some(sample) => sample.incident,
                    None => return,
                }
            } else {
                warp::cosine_hemisphere([u0, u1])
            };
            let world = point.to_world(incident).normalize();
            let s = self.scatter(&lobes, incident);
            if s.pdf <= 0.0 || world.dot(point.geometric) <= 0.0 {
                return;
            }
            let mut survival = 1.0;
            let strongest = (s.diffuse * material.albedo_bound.min(1.0) + s.gloss) / s.pdf;
            throughput *= strongest;
            if depth >= ROULETTE_FROM {
                survival = throughput.clamp(ROULETTE_FLOOR, 1.0);
                if roulette >= survival {
                    return;
                }
                throughput /= survival;
            }
            let factor = 1.0 / (s.pdf * survival);
            vertex.diffuse = s.diffuse * factor;
            vertex.fluorescent = s.fluorescent * factor;
            vertex.gloss = s.gloss * factor;

            previous = Some((point.position, point.shading, s.pdf));
            origin = start;
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
