//! Samples paths from the camera: several in step, each what it would be alone.

use std::f32::consts::PI;

use fluorspar_accel::Ray;
use glam::Vec3;

use super::adjoint::{BINS, Importance};
use super::compiled_scene::CompiledScene;
use super::intersect::TraceBuffers;
use super::light_sampling::LightSample;
use super::path::Path;
use super::scattering::{Scattering, ScatteringSample};
use super::settings::Estimator;
use super::surface::Intersection;
use crate::sampling::SampleStream;

/// From this vertex on, paths may end by Russian roulette.
const ROULETTE_FROM: u32 = 3;
/// Lowest chance to go on.
const ROULETTE_FLOOR: f32 = 0.05;

/// The random numbers of a vertex.
#[derive(Clone, Copy, Debug, Default)]
struct VertexNumbers {
    /// For the direction in which the path goes on.
    direction: [f32; 2],
    /// For the lobe that it follows.
    lobe: f32,
    /// For Russian roulette.
    roulette: f32,
    /// For the lamp of a group, then for a point on it. Groups are components of their own, and may share their numbers.
    lamp: [f32; 3],
    /// Numbers of vertices to come, where several share their sets: direction, point on a lamp, roulette.
    next: ([f32; 2], [f32; 2], [f32; 3]),
}

impl VertexNumbers {
    /// The numbers of the vertex after this one. Set 0 of a stream belongs to the camera. Where a path never `chooses`
    /// between lobes and lamps, two vertices share a set for their directions and one for their points on lamps, and four
    /// one for roulette; else choices are best even together with what they choose.
    fn advance(&mut self, stream: &SampleStream, depth: u32, chooses: bool) {
        let first = 1 + 3 * depth;
        if chooses {
            let [lobe, u, v, roulette] = stream.set_4d(first);
            let [which, s, t, _] = stream.set_4d(first + 1);
            (self.direction, self.lobe, self.roulette, self.lamp) = ([u, v], lobe, roulette, [which, s, t]);
            return;
        }
        if depth.is_multiple_of(2) {
            let [u, v, next_u, next_v] = stream.set_4d(first);
            let [s, t, next_s, next_t] = stream.set_4d(first + 1);
            (self.direction, self.lamp) = ([u, v], [0.0, s, t]);
            (self.next.0, self.next.1) = ([next_u, next_v], [next_s, next_t]);
        } else {
            let (direction, [s, t], _) = self.next;
            (self.direction, self.lamp) = (direction, [0.0, s, t]);
        }
        match depth.checked_sub(ROULETTE_FROM).map(|since| since as usize % 4) {
            None => {}
            Some(0) => {
                [self.roulette, self.next.2[0], self.next.2[1], self.next.2[2]] = stream.set_4d(first + 2)
            }
            Some(place) => self.roulette = self.next.2[place - 1],
        }
    }
}

/// A path while it is being sampled.
#[derive(Debug)]
struct Walk {
    path: Path,
    stream: SampleStream,
    numbers: VertexNumbers,
    importance: Importance,
    /// The ray to follow next; the direction is a unit vector.
    origin: Vec3,
    direction: Vec3,
    /// Where the ray starts, the normal there, and the density of its direction, for weighting the emission it meets.
    previous: Option<(Vec3, Vec3, f32)>,
}

/// Light that a vertex gets if nothing is in the way.
#[derive(Clone, Copy, Debug)]
struct Aim {
    /// Number of the path among those of the batch, and of the vertex on it.
    walk: u32,
    vertex: u32,
    light: LightSample,
    scattering: Scattering,
    /// Of multiple importance sampling.
    weight: f32,
}

/// Several paths that are sampled in step, vertex by vertex, so that their rays can be traced in turns: some move while
/// others wait. Reused from batch to batch.
#[derive(Debug, Default)]
pub(super) struct PathBatch {
    /// All walks there ever were; the first `len` count.
    walks: Vec<Walk>,
    len: usize,
    /// Numbers of those that go on.
    going: Vec<u32>,
    rays: Vec<Ray>,
    buffers: TraceBuffers,
    found: Vec<Option<Intersection>>,
    aims: Vec<Aim>,
    visible: Vec<f32>,
}

impl PathBatch {
    /// Forgets all paths.
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// How many paths there are.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Adds a path that starts at the camera. `direction` is a unit vector.
    pub(super) fn start(&mut self, origin: Vec3, direction: Vec3, stream: SampleStream) {
        let walk = Walk {
            path: Path::default(),
            stream,
            numbers: VertexNumbers::default(),
            importance: Importance::CAMERA,
            origin,
            direction,
            previous: None,
        };
        match self.walks.get_mut(self.len) {
            Some(old) => {
                let mut path = std::mem::take(&mut old.path);
                path.clear();
                *old = Walk { path, ..walk };
            }
            None => self.walks.push(walk),
        }
        self.len += 1;
    }

    /// The paths, in the order in which they were started.
    pub(super) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.walks[..self.len].iter().map(|walk| &walk.path)
    }
}

impl CompiledScene {
    /// Samples all paths of a batch to their ends.
    pub(super) fn trace(&self, batch: &mut PathBatch, max_depth: u32, estimator: Estimator) {
        let PathBatch { walks, len, going, rays, buffers, found, aims, visible } = batch;
        going.clear();
        going.extend(0..*len as u32);
        for depth in 0..=max_depth {
            if going.is_empty() {
                return;
            }
            rays.clear();
            rays.extend(going.iter().map(|&walk| {
                let Walk { origin, direction, .. } = walks[walk as usize];
                Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
            }));
            self.closest_each(rays, buffers, found);

            rays.clear();
            aims.clear();
            let mut hits = found.iter();
            going.retain(|&number| {
                let walk = &mut walks[number as usize];
                let Some(Some(hit)) = hits.next() else {
                    self.leave_scene(walk, estimator);
                    return false;
                };
                self.meet_light(walk, hit, estimator);
                let aim = |ray: Ray, aim: Aim| {
                    rays.push(ray);
                    aims.push(aim);
                };
                depth < max_depth && self.visit(walk, number, hit, depth, estimator, aim)
            });

            let lights = aims.iter().map(|aim| aim.light.light);
            self.visibility_each(rays, lights, buffers, visible);
            for (aim, &visible) in aims.iter().zip(visible.iter()) {
                if visible > 0.0 {
                    self.add_direct(&mut walks[aim.walk as usize].path, aim, visible);
                }
            }
        }
    }

    /// Notes what a ray that misses everything sees.
    fn leave_scene(&self, walk: &mut Walk, estimator: Estimator) {
        let Walk { path, origin, direction, previous, .. } = walk;
        let (from, normal) = previous.map_or((*origin, Vec3::ZERO), |(p, n, _)| (p, n));
        let add = |source, scale: f32, light_pdf| {
            path.meet(source, scale * emission_weight(*previous, light_pdf, estimator));
        };
        self.surroundings(from, normal, *direction, add);
    }

    /// Notes the emission of what a ray hits.
    fn meet_light(&self, walk: &mut Walk, hit: &Intersection, estimator: Estimator) {
        let Walk { path, origin, direction, previous, .. } = walk;
        let (from, normal) = previous.map_or((*origin, Vec3::ZERO), |(p, n, _)| (p, n));
        let met = self.emission_along(from, normal, *direction, hit.t, hit.target);
        if let Some((light, scale, light_pdf)) = met {
            let scale = scale * emission_weight(*previous, light_pdf, estimator);
            let source = self.lights[light].source;
            for source in source..source + self.slices {
                path.meet(source, scale);
            }
        }
    }

    /// A vertex of the path of a number: next-event estimation towards one light of every group, and the direction in which the path
    /// goes on. Returns whether it does.
    fn visit(
        &self,
        walk: &mut Walk,
        number: u32,
        hit: &Intersection,
        depth: u32,
        estimator: Estimator,
        mut aim: impl FnMut(Ray, Aim),
    ) -> bool {
        let Walk { path, stream, numbers, importance, origin, direction, previous } = walk;
        let (from, view) = (*origin, *direction);
        let Some(mut point) = self.surface(from, view, hit) else { return false };

        numbers.advance(stream, depth, self.chooses);
        let mut choice = numbers.lobe;
        let outermost = self.object_material[point.object];
        let material_index = self.material_at(outermost, point.uv, point.front, &mut choice);
        let material = &self.materials[material_index];
        if let Some(map) = &material.normal_map {
            let along = self.texture_directions(hit.target, point.position);
            point.apply_normal_map(map.at(point.uv), along, -view);
        }
        let bsdf = self.bsdf(material, point.uv, point.front, point.to_local(-view));
        // Light may come from either side of a clear body.
        let light_normal = if bsdf.transmits() { Vec3::ZERO } else { point.shading };
        // A direction that the shading and the geometric normal put on different sides carries nothing.
        let is_consistent = |world: Vec3, local: Vec3| {
            world.dot(point.geometric) * local.z > 0.0 && (local.z > 0.0 || bsdf.transmits())
        };

        let vertex = path.vertices().len() as u32;
        path.push_vertex(material_index, self.sources.len());
        let mut coarse = [0.0; BINS];
        let terms = material.reflectance.iter().zip(&material.coarse_reflectance);
        for (term, ((_, weight), coarse_spectrum)) in terms.enumerate() {
            let weight = bsdf.term_weight(term, weight.at(point.uv));
            path.push_weight(weight);
            for (sum, value) in coarse.iter_mut().zip(coarse_spectrum) {
                *sum += weight * value;
            }
        }
        for (_, concentration) in &material.fluorophores {
            path.push_weight(concentration.at(point.uv));
        }

        if estimator == Estimator::MultipleImportance {
            for group in 0..self.group_lights.len() {
                let sample = self.sample_light(group, point.position, light_normal, numbers.lamp);
                let Some(light) = sample else { continue };
                let local = point.to_local(light.direction);
                if !is_consistent(light.direction, local) {
                    continue;
                }
                let scattering = bsdf.evaluate(local);
                if scattering.pdf <= 0.0 {
                    continue;
                }
                // Stop short of the light's own surface.
                let reach = light.distance - 2.0 * self.clearance.max(1e-5 * light.distance);
                let t_max = if light.distance.is_finite() { reach } else { f32::INFINITY };
                let origin = point.leave(light.direction, self.clearance);
                let weight = if light.delta { 1.0 } else { power_heuristic(light.pdf, scattering.pdf) };
                let ray = Ray { origin, direction: light.direction, t_min: 0.0, t_max };
                aim(ray, Aim { walk: number, vertex, light, scattering, weight });
            }
        }

        // Continue the path.
        let Some(ScatteringSample { incident, scattering: s, delta }) =
            bsdf.sample(choice, numbers.direction)
        else {
            return false;
        };
        let world = point.to_world(incident).normalize();
        if !is_consistent(world, incident) {
            return false;
        }
        let mut survival = 1.0;
        self.adjoint.scatter(importance, &s, &coarse, material.fluorophores.iter().map(|(f, _)| *f));
        if depth >= ROULETTE_FROM {
            survival = self.adjoint.reach(importance).clamp(ROULETTE_FLOOR, 1.0);
            if numbers.roulette >= survival {
                return false;
            }
            importance.survive(survival);
        }
        let factor = 1.0 / (s.pdf * survival);
        path.continue_with(s.diffuse * factor, s.fluorescent * factor, s.gloss * factor);
        *previous = Some((point.position, light_normal, if delta { f32::INFINITY } else { s.pdf }));
        *origin = point.leave(world, self.clearance);
        *direction = world;
        true
    }

    /// Adds light whose share `visible` arrives at a vertex.
    fn add_direct(&self, path: &mut Path, aim: &Aim, visible: f32) {
        let s = &aim.scattering;
        let factor = visible * aim.weight / aim.light.pdf;
        self.each_source(&aim.light, |source, scale| {
            // All excitation bins of a lamp shine from the same place.
            for source in source..source + self.slices {
                let direct = path.direct_mut(aim.vertex as usize, self.sources.len(), source);
                direct.diffuse += factor * scale * s.diffuse * PI;
                direct.fluorescent += factor * scale * s.fluorescent * PI;
                direct.gloss += factor * scale * s.gloss;
            }
        });
    }
}

/// Weight of emission that a scattered ray met by chance, where aiming at lights would have found it with density
/// `light_pdf`.
fn emission_weight(previous: Option<(Vec3, Vec3, f32)>, light_pdf: f32, estimator: Estimator) -> f32 {
    match (previous, estimator) {
        (Some((_, _, pdf)), Estimator::MultipleImportance) => power_heuristic(pdf, light_pdf),
        _ => 1.0,
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec2;

    use super::*;
    use crate::geometry::TriangleMesh;
    use crate::light::{Emitter, Light, LightGroup};
    use crate::material::{Coat, Material, ScalarTexture};
    use crate::optics::PerspectiveCamera;
    use crate::scene::{Object, Scene, Shape};
    use crate::spectral::{Curve, WavelengthGrid};

    /// A closed room with wavy walls of 20 thousand triangles, glossy, with two lamps.
    fn room() -> Scene {
        const RINGS: u32 = 100;
        let mut mesh = TriangleMesh::default();
        for ring in 0..=RINGS {
            for segment in 0..=RINGS {
                let (u, v) = (segment as f32 / RINGS as f32, ring as f32 / RINGS as f32);
                let ((sin_theta, cos_theta), (sin_phi, cos_phi)) =
                    ((PI * v).sin_cos(), (2.0 * PI * u).sin_cos());
                let radius = 1.0 + 0.1 * (9.0 * cos_theta).sin() * (2.0 * PI * 5.0 * u).cos();
                mesh.positions.push(radius * Vec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta));
                mesh.uvs.push(Vec2::new(u, v));
            }
        }
        for corner in (0..RINGS * RINGS).map(|cell| cell / RINGS * (RINGS + 1) + cell % RINGS) {
            let below = corner + RINGS + 1;
            mesh.triangles.extend([[corner, below + 1, below], [corner, corner + 1, below + 1]]);
        }
        let mut wall = Material::lambertian("wall", Curve::constant(0.7));
        wall.coat = Some(Coat { refractive_index: 1.4, roughness: ScalarTexture::Constant(0.3) });
        let lamp = |x: f32| Light {
            name: format!("lamp at {x}"),
            group: 0,
            spectrum: Curve::constant(1.0),
            emitter: Emitter::Disc {
                center: Vec3::new(x, 0.0, 0.5),
                normal: Vec3::NEG_Z,
                radius_m: 0.1,
                exponent: 1.0,
            },
        };
        let shape = Shape::Mesh(Arc::new(mesh));
        Scene {
            grid: WavelengthGrid::uniform(500.0, 510.0, 5.0).unwrap(),
            objects: vec![Object { name: "room".into(), shape, material: 0, emission: None }],
            materials: vec![wall],
            fluorophores: Vec::new(),
            light_groups: vec![LightGroup { name: "g".into() }],
            lights: vec![lamp(-0.2), lamp(0.2)],
            camera: PerspectiveCamera::look_at(0.5 * Vec3::Z, Vec3::ZERO, Vec3::Y, 90.0, 16, 16).unwrap(),
        }
    }

    /// Paths in step, whose rays take turns, change the order of work only.
    #[test]
    fn paths_are_the_same_in_step_and_alone() {
        let scene = room();
        let compiled = CompiledScene::new(&scene, &[]).unwrap();
        let paths = |in_step: u32| -> Vec<String> {
            let mut batch = PathBatch::default();
            let mut said = Vec::new();
            for first in (0..256).step_by(in_step as usize) {
                batch.clear();
                for pixel in first..first + in_step {
                    let mut stream = SampleStream::new(1, u64::from(pixel), 0);
                    let [x, y, ..] = stream.next_4d();
                    let (col, row) = (pixel % 16, pixel / 16);
                    let (origin, direction) = scene.camera.ray(col as f32 + x, row as f32 + y);
                    batch.start(origin, direction, stream);
                }
                compiled.trace(&mut batch, 8, Estimator::MultipleImportance);
                // Debug output of floats is exact.
                said.extend(batch.paths().map(|path| format!("{path:?}")));
            }
            said
        };
        let alone = paths(1);
        let longest = alone.iter().map(|path| path.matches("Vertex").count()).max();
        assert_eq!(longest, Some(8), "paths that end early test little");
        for in_step in [4, 64, 128] {
            assert_eq!(paths(in_step), alone, "{in_step} in step");
        }
    }
}
