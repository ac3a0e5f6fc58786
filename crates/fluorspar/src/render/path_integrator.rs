//! Path integrator: next-event estimation, multiple importance sampling and Russian roulette.
//!
//! Paths carry scalar densities and factors only; `spectral_accumulation` runs the spectra back along them. A batch of
//! paths advances vertex by vertex, a wavefront, so that the traversals of its rays are interleaved, which hides memory
//! latency. Each path is what it would be alone: the batch changes the order of work, not the results.

use std::f32::consts::PI;

use fluorspar_accel::Ray;
use glam::Vec3;

use super::compiled_scene::{CompiledScene, MaterialSpectra};
use super::intersect::TraceBuffers;
use super::light_sampling::{LightProbabilities, LightSample, LitPoint, RING_LIGHTS};
use super::path::Path;
use super::settings::Estimator;
use super::surface::{Intersection, SurfacePoint};
use super::survival_probability::{BINS, CoarseThroughput};
use super::translucency::{Entry, Probe, Spread};
use crate::material::{Bsdf, BsdfSample, BsdfValue, FilmFrame};
use crate::sampling::SampleStream;

/// Vertices before this one never end a path by Russian roulette.
const ROULETTE_FROM: u32 = 3;
/// Least survival probability of Russian roulette.
const LEAST_SURVIVAL: f32 = 0.05;

/// Roughness of coats after light was scattered, where the render regularizes: a lobe that directions of the diffuse surface before it
/// find without specks (path space regularization, Kaplanyan and Dachsbacher, Comput. Graph. Forum 32, 63, 2013). Where it
/// mirrors light to is blurred, and it mirrors less, most at grazing angles, where facets hide each other: the base below gets that light.
const REGULARIZED_ALPHA: f32 = 0.2;

/// Vertices of a path that weigh lights by what their surface mirrors: later ones add too little.
const MIRRORING_VERTICES: u32 = 3;

/// The random numbers of a vertex, each in `[0, 1)`.
#[derive(Clone, Copy, Debug, Default)]
struct VertexSamples {
    /// For the scattered direction.
    direction: [f32; 2],
    /// For the choice of the scattering lobe.
    lobe: f32,
    /// For Russian roulette.
    roulette: f32,
    /// For the choice of a light of a group, then for a point on it. Groups are components of their own, and may share
    /// their numbers.
    light: [f32; 3],
    /// Numbers of vertices to come, where several share their sets: direction, point on a light, roulette.
    next: ([f32; 2], [f32; 2], [f32; 3]),
}

impl VertexSamples {
    /// Draws the numbers of the next vertex. Set 0 of a stream belongs to the camera.
    ///
    /// Without discrete choices (of lobes or lights), two vertices share a set for their directions and one for their
    /// points on lights, and four vertices share one for roulette. With discrete choices every vertex has sets of its
    /// own, since a choice is best stratified together with what it chooses.
    fn advance(&mut self, stream: &SampleStream, depth: u32, has_discrete_choices: bool) {
        let first = 1 + 3 * depth;
        if has_discrete_choices {
            let [lobe, u, v, roulette] = stream.set_4d(first);
            let [which, s, t, _] = stream.set_4d(first + 1);
            (self.direction, self.lobe, self.roulette, self.light) = ([u, v], lobe, roulette, [which, s, t]);
            return;
        }
        if depth.is_multiple_of(2) {
            let [u, v, next_u, next_v] = stream.set_4d(first);
            let [s, t, next_s, next_t] = stream.set_4d(first + 1);
            (self.direction, self.light) = ([u, v], [0.0, s, t]);
            (self.next.0, self.next.1) = ([next_u, next_v], [next_s, next_t]);
        } else {
            let (direction, [s, t], _) = self.next;
            (self.direction, self.light) = (direction, [0.0, s, t]);
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

/// Set of the random numbers of a translucent vertex: the first vertex needs no third set of its own.
const SPREAD_SET: u32 = 3;

/// Where a path scattered last: what weights the emission that its ray meets.
#[derive(Clone, Copy, Debug)]
struct ScatteringOrigin {
    position: Vec3,
    /// Normal by which lights are chosen there; zero where light may arrive from either side.
    light_normal: Vec3,
    /// Density of the scattered direction, 1/sr; infinite for delta lobes.
    pdf: f32,
}

/// A path while it is being sampled.
#[derive(Debug)]
struct PathState {
    path: Path,
    stream: SampleStream,
    samples: VertexSamples,
    throughput: CoarseThroughput,
    /// Origin of the next ray, m.
    origin: Vec3,
    /// Unit direction of the next ray.
    direction: Vec3,
    /// `None` for rays of the camera.
    scattered: Option<ScatteringOrigin>,
    /// Least roughness of the coats that it meets.
    least_alpha: f32,
    /// Probabilities of lights at the last vertex.
    light_probabilities: LightProbabilities,
}

impl PathState {
    fn new(stream: SampleStream) -> Self {
        Self {
            path: Path::default(),
            stream,
            samples: VertexSamples::default(),
            throughput: CoarseThroughput::CAMERA,
            origin: Vec3::ZERO,
            direction: Vec3::Z,
            scattered: None,
            least_alpha: 0.0,
            light_probabilities: None,
        }
    }

    /// Where the lights that its next ray meets would have been chosen.
    fn lit_point(&self) -> LitPoint<'_> {
        let (position, normal) =
            self.scattered.map_or((self.origin, Vec3::ZERO), |s| (s.position, s.light_normal));
        LitPoint { position, normal, probabilities: &self.light_probabilities }
    }
}

/// Where direct light falls on the surface of a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Arrival {
    /// Where it leaves.
    Here,
    /// Where light entered that leaves a translucent surface elsewhere.
    Entry,
}

/// Direct light that a vertex receives unless its shadow ray is blocked.
#[derive(Clone, Copy, Debug)]
struct ShadowRay {
    /// Index of the path in the batch.
    path: u32,
    /// Index of the vertex on the path.
    vertex: u32,
    arrival: Arrival,
    light: LightSample,
    scattering: BsdfValue,
    /// Weight of multiple importance sampling.
    mis_weight: f32,
}

/// A wavefront of paths; reused from batch to batch.
#[derive(Debug, Default)]
pub(super) struct PathBatch {
    /// States of this and of earlier, larger batches; the first `len` count.
    states: Vec<PathState>,
    len: usize,
    /// Indices of the paths that have not ended.
    active: Vec<u32>,
    rays: Vec<Ray>,
    buffers: TraceBuffers,
    hits: Vec<Option<Intersection>>,
    shadow_rays: Vec<ShadowRay>,
    visibility: Vec<f32>,
    /// Probes of the paths whose first vertex is translucent, in the order of the paths.
    probes: Vec<Option<Probe>>,
    met: Vec<Option<Intersection>>,
    spreads: Vec<Option<Spread>>,
}

impl PathBatch {
    /// Removes all paths.
    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// Number of paths.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Adds a path that starts at the camera. `direction` is a unit vector.
    pub(super) fn start(&mut self, origin: Vec3, direction: Vec3, stream: SampleStream) {
        if self.states.len() == self.len {
            self.states.push(PathState::new(stream.clone()));
        }
        // The lists of an earlier path stay where they are
        let state = &mut self.states[self.len];
        state.path.clear();
        state.path.choices = stream.word();
        state.stream = stream;
        state.samples = VertexSamples::default();
        state.throughput = CoarseThroughput::CAMERA;
        (state.origin, state.direction) = (origin, direction);
        state.scattered = None;
        state.least_alpha = 0.0;
        state.light_probabilities = None;
        self.len += 1;
    }

    /// The paths, in the order in which they were started.
    pub(super) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.states[..self.len].iter().map(|state| &state.path)
    }
}

/// A vertex while light is scattered there.
struct ShadingPoint<'a> {
    point: SurfacePoint,
    /// Direction of the viewer, local.
    outgoing: Vec3,
    film: FilmFrame,
    spectra: &'a MaterialSpectra,
    bsdf: Bsdf<'a>,
    /// Random number for the lobe, rescaled after the choice of a mixture's material.
    lobe: f32,
    /// The chromatic spectrum of the vertex on coarse bins.
    coarse_spectrum: [f32; BINS],
    /// Normal by which lights are chosen; zero where light may arrive from either side.
    light_normal: Vec3,
}

impl ShadingPoint<'_> {
    /// Whether a direction lies on the same side of the shading and of the geometric normal: others carry no light.
    #[inline]
    fn is_consistent(&self, world: Vec3, local: Vec3) -> bool {
        world.dot(self.point.geometric) * local.z > 0.0 && (local.z > 0.0 || self.bsdf.transmits())
    }
}

impl CompiledScene {
    /// Samples all paths of a batch to their ends: at most `max_depth` vertices each.
    pub(super) fn sample_paths(&self, batch: &mut PathBatch, max_depth: u32, estimator: Estimator) {
        let PathBatch {
            states,
            len,
            active,
            rays,
            buffers,
            hits,
            shadow_rays,
            visibility,
            probes,
            met,
            spreads,
        } = batch;
        active.clear();
        active.extend(0..*len as u32);
        for depth in 0..=max_depth {
            if active.is_empty() {
                return;
            }

            // Intersect the ray of every active path with the scene
            rays.clear();
            rays.extend(active.iter().map(|&index| {
                let PathState { origin, direction, .. } = states[index as usize];
                Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
            }));
            self.closest_each(rays, buffers, hits);

            // Find where light entered that leaves translucent surfaces
            spreads.clear();
            if depth == 0 && self.has_translucency {
                let numbers = |index: &u32| states[*index as usize].stream.set_4d(SPREAD_SET);
                probes.clear();
                probes.extend(active.iter().zip(&*rays).zip(&*hits).map(|((index, ray), hit)| {
                    let lobe = states[*index as usize].stream.set_4d(1)[0];
                    self.probe(ray, hit.as_ref()?, numbers(index), lobe)
                }));
                rays.clear();
                rays.extend(probes.iter().flatten().map(|probe| probe.ray));
                self.closest_each(rays, buffers, met);
                let mut met = met.iter();
                spreads.extend(active.iter().zip(&*probes).map(|(index, probe)| {
                    let probe = probe.as_ref()?;
                    self.spread(probe, met.next()?.as_ref(), numbers(index))
                }));
            }

            // Add emission at the hits, queue shadow rays and sample the next directions
            rays.clear();
            shadow_rays.clear();
            let mut found = hits.iter();
            let mut spread = spreads.iter();
            active.retain(|&index| {
                let state = &mut states[index as usize];
                let spread = spread.next().and_then(Option::as_ref);
                let Some(Some(hit)) = found.next() else {
                    self.add_environment(state, estimator);
                    return false;
                };
                self.add_emission(state, hit, estimator);
                let queue = |ray: Ray, shadow_ray: ShadowRay| {
                    rays.push(ray);
                    shadow_rays.push(shadow_ray);
                };
                depth < max_depth && self.scatter(state, index, hit, spread, estimator, queue)
            });

            // Trace the shadow rays and add direct illumination
            let lights = shadow_rays.iter().map(|shadow_ray| shadow_ray.light.light);
            self.visibility_each(rays, lights, buffers, visibility);
            for (shadow_ray, &visibility) in shadow_rays.iter().zip(visibility.iter()) {
                if visibility > 0.0 {
                    self.add_direct(&mut states[shadow_ray.path as usize].path, shadow_ray, visibility);
                }
            }
        }
    }

    /// Adds the emission of the environment, for a ray that misses everything.
    fn add_environment(&self, state: &mut PathState, estimator: Estimator) {
        let mut path = std::mem::take(&mut state.path);
        let add = |source, scale: f32, light_pdf| {
            path.add_emission(source, scale * emission_weight(state.scattered, light_pdf, estimator));
        };
        self.surroundings(&state.lit_point(), state.direction, add);
        state.path = path;
    }

    /// Adds the emission of what a ray hits.
    fn add_emission(&self, state: &mut PathState, hit: &Intersection, estimator: Estimator) {
        let emission = self.emission_along(&state.lit_point(), state.direction, hit.t, hit.target);
        if let Some((light, scale, light_pdf)) = emission {
            if self.lights[light].crossed_polarizers && state.path.vertices().len() == 1 {
                return;
            }
            let scale = scale * emission_weight(state.scattered, light_pdf, estimator);
            state.path.add_emission(self.lights[light].source, scale);
        }
    }

    /// Adds a vertex to a path: samples direct illumination and the direction in which the path continues. Returns
    /// whether it does.
    #[inline]
    fn scatter(
        &self,
        state: &mut PathState,
        index: u32,
        hit: &Intersection,
        spread: Option<&Spread>,
        estimator: Estimator,
        mut queue: impl FnMut(Ray, ShadowRay),
    ) -> bool {
        // Find the surface, and the random numbers of the vertex
        let Some(point) = self.surface(state.origin, state.direction, hit) else { return false };
        let depth = state.path.vertices().len() as u32;
        state.samples.advance(&state.stream, depth, self.has_discrete_choices);

        let vertex = self.add_vertex(state, hit, point, spread);
        if estimator == Estimator::MultipleImportance {
            self.sample_direct(state, index, &vertex, Arrival::Here, &mut queue);
            if let Some(entry) = spread.and_then(|spread| self.entry(&vertex, spread)) {
                self.sample_direct(state, index, &entry, Arrival::Entry, queue);
            }
        }
        self.continue_path(state, &vertex)
    }

    /// The point where direct light entered that leaves a vertex elsewhere.
    fn entry<'a>(&'a self, vertex: &ShadingPoint<'a>, spread: &Spread) -> Option<ShadingPoint<'a>> {
        let Entry::Elsewhere { point, material } = spread.entry else { return None };
        // Light leaves where it leaves, through the film there
        let material = &self.materials[material];
        let film = material.film(point.film_frame());
        let outgoing = film.to_local(vertex.film.to_film(vertex.outgoing));
        let bsdf = material.bsdf(point.uv, point.front, outgoing, film, 0.0);
        Some(ShadingPoint { point, outgoing, film, bsdf, light_normal: point.shading, ..*vertex })
    }

    /// Prepares shading at a hit and appends the vertex to the path, with the weights of its reflectance terms and its
    /// concentrations.
    #[inline]
    fn add_vertex(
        &self,
        state: &mut PathState,
        hit: &Intersection,
        mut point: SurfacePoint,
        spread: Option<&Spread>,
    ) -> ShadingPoint<'_> {
        let PathState { path, samples, direction, least_alpha, .. } = state;
        let view = *direction;

        // Choose the material of mixtures, and bend the normal
        let mut lobe = samples.lobe;
        let outermost = self.object_material[point.object];
        let chosen = self.materials.choose(outermost, point.uv, point.front, &mut lobe);
        let material = &self.materials[chosen.index];
        if let Some(map) = chosen.normal_map {
            let along = self.texture_directions(hit.target, point.position);
            point.apply_normal_map(map.at(point.uv), along, -view);
        }
        let outgoing = point.to_local(-view);
        let film = material.film(point.film_frame());
        let bsdf = material.bsdf(point.uv, point.front, outgoing, film, *least_alpha);
        let light_normal = if bsdf.transmits() { Vec3::ZERO } else { point.shading };

        // Weight the reflectance terms and the fluorophores: of translucent tissue those on the way of the light
        let (index, uv) = spread.map_or((chosen.index, point.uv), |spread| (spread.material, spread.uv));
        path.push_vertex(index, self.sources.len());
        if let Some(spread) = spread {
            path.spread_first_vertex(spread.weights, self.sources.len());
        }
        let mut coarse_spectrum = [0.0; BINS];
        let (material, spectra) = (&self.materials[index], &self.material_spectra[index]);
        material.term_weights(uv, &bsdf, |index, weight| {
            path.push_weight(weight);
            for (sum, value) in coarse_spectrum.iter_mut().zip(&spectra.coarse_terms[index]) {
                *sum += weight * value;
            }
        });
        path.push_emitters(|weights, emitters| {
            material.concentrations(
                uv,
                |term| weights[term],
                |number, concentration| emitters.push((spectra.emitters[number], concentration)),
            );
        });
        ShadingPoint { point, outgoing, film, spectra, bsdf, lobe, coarse_spectrum, light_normal }
    }

    /// Next-event estimation: samples one light of every group and queues its shadow ray.
    #[inline]
    fn sample_direct(
        &self,
        state: &mut PathState,
        index: u32,
        vertex: &ShadingPoint<'_>,
        arrival: Arrival,
        mut queue: impl FnMut(Ray, ShadowRay),
    ) {
        let ShadingPoint { point, bsdf, .. } = vertex;
        let depth = state.path.vertices().len() as u32 - 1;
        // Weigh the lights where the surface mirrors; where light entered they are weighed as where it leaves, so that both points
        // choose the same one
        if arrival == Arrival::Here {
            state.light_probabilities = None;
        }
        if arrival == Arrival::Here && depth < MIRRORING_VERTICES && bsdf.has_gloss() {
            let reflectance = vertex.coarse_spectrum.iter().sum::<f32>() / BINS as f32;
            let scattered = |direction: Vec3| bsdf.estimate(point.to_local(direction), reflectance);
            let has_entry = depth == 0 && state.path.spread.is_some();
            let fewest = if has_entry { 2 } else { RING_LIGHTS };
            state.light_probabilities =
                self.light_probabilities(point.position, vertex.light_normal, scattered, fewest);
        }
        let lit = LitPoint {
            position: point.position,
            normal: vertex.light_normal,
            probabilities: &state.light_probabilities,
        };
        for group in 0..self.group_lights.len() {
            // Sample a light of the group
            let sample = self.sample_light(group, &lit, state.samples.light);
            let Some(light) = sample else { continue };
            let local = point.to_local(light.direction);
            if !vertex.is_consistent(light.direction, local) {
                continue;
            }

            // Evaluate the material for light from there
            let mut scattering = bsdf.evaluate(local);
            if scattering.pdf <= 0.0 {
                continue;
            }

            // Polarizers hold back what the first surface mirrors: no scattered ray finds the light then
            let is_crossed = depth == 0 && self.lights[light.light].crossed_polarizers;
            if is_crossed {
                scattering.gloss = 0.0;
            }

            // Queue a shadow ray that stops short of the light's own surface
            let short = light.distance - 2.0 * self.clearance.max(1e-5 * light.distance);
            let t_max = if light.distance.is_finite() { short } else { f32::INFINITY };
            let origin = point.leave(light.direction, self.clearance);
            let mis_weight =
                if light.delta || is_crossed { 1.0 } else { power_heuristic(light.pdf, scattering.pdf) };
            let ray = Ray { origin, direction: light.direction, t_min: 0.0, t_max };
            queue(ray, ShadowRay { path: index, vertex: depth, arrival, light, scattering, mis_weight });
        }
    }

    /// Samples the direction in which a path continues, unless the material absorbs it or Russian roulette ends it.
    /// Returns whether it continues.
    #[inline]
    fn continue_path(&self, state: &mut PathState, vertex: &ShadingPoint<'_>) -> bool {
        let depth = state.path.vertices().len() as u32 - 1;
        let ShadingPoint { point, spectra, bsdf, .. } = vertex;

        // Sample the material for the next direction
        let sampled = bsdf.sample(vertex.lobe, state.samples.direction);
        let Some(BsdfSample { incident, value: s, delta }) = sampled else { return false };
        let world = point.to_world(incident).normalize();
        if !vertex.is_consistent(world, incident) {
            return false;
        }

        // End the path by Russian roulette where little contribution is expected
        let mut survival = 1.0;
        let throughput = &mut state.throughput;
        self.roulette.scatter(throughput, &s, &vertex.coarse_spectrum, &spectra.fluorophores);
        if depth >= ROULETTE_FROM {
            survival = self.roulette.expected_contribution(throughput).clamp(LEAST_SURVIVAL, 1.0);
            if state.samples.roulette >= survival {
                return false;
            }
            throughput.survive(survival);
        }

        // Record the factors of the vertex and set the next ray
        let factor = 1.0 / (s.pdf * survival);
        state.path.continue_with(s.diffuse * factor, s.fluorescent * factor, s.gloss * factor);
        state.scattered = Some(ScatteringOrigin {
            position: point.position,
            light_normal: vertex.light_normal,
            pdf: if delta { f32::INFINITY } else { s.pdf },
        });
        if !delta && self.regularizes {
            state.least_alpha = REGULARIZED_ALPHA;
        }
        state.origin = point.leave(world, self.clearance);
        state.direction = world;
        true
    }

    /// Adds direct light, of which the share `visibility` arrives, to a vertex.
    fn add_direct(&self, path: &mut Path, shadow_ray: &ShadowRay, visibility: f32) {
        let s = &shadow_ray.scattering;
        let arriving = visibility / shadow_ray.light.pdf;
        if path.spread.is_some() && shadow_ray.vertex == 0 {
            // What more there is where light entered, whole: no scattered ray meets the lights there
            let more = if shadow_ray.arrival == Arrival::Entry { arriving } else { -arriving };
            self.each_source(&shadow_ray.light, |source, scale| {
                path.entered[source].diffuse += more * scale * s.diffuse * PI;
                path.entered[source].fluorescent += more * scale * s.fluorescent * PI;
            });
        }
        if shadow_ray.arrival == Arrival::Entry {
            return;
        }
        let factor = visibility * shadow_ray.mis_weight / shadow_ray.light.pdf;
        self.each_source(&shadow_ray.light, |source, scale| {
            let direct = path.direct_mut(shadow_ray.vertex as usize, self.sources.len(), source);
            direct.diffuse += factor * scale * s.diffuse * PI;
            direct.fluorescent += factor * scale * s.fluorescent * PI;
            direct.gloss += factor * scale * s.gloss;
        });
    }
}

/// Weight of emission that a scattered ray meets, where next-event estimation would have sampled the direction with
/// density `light_pdf`.
fn emission_weight(scattered: Option<ScatteringOrigin>, light_pdf: f32, estimator: Estimator) -> f32 {
    match (scattered, estimator) {
        (Some(origin), Estimator::MultipleImportance) => power_heuristic(origin.pdf, light_pdf),
        _ => 1.0,
    }
}

/// Power heuristic with exponent 2 (Veach 1997): weight of the technique with density `own`.
fn power_heuristic(own: f32, other: f32) -> f32 {
    if own.is_infinite() {
        return 1.0;
    }
    let (a, b) = (own * own, other * other);
    let sum = a + b;
    if sum.is_normal() {
        a / sum
    } else if own > 0.0 {
        // Squares that leave the range of numbers: light that grazes has densities of 1e20
        1.0 / (1.0 + (other / own).powi(2))
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec2;

    use super::*;
    use crate::geometry::TriangleMesh;
    use crate::light::{DiscEmitter, Emitter, Light, LightGroup};
    use crate::material::{Coat, Material, ScalarTexture};
    use crate::optics::PerspectiveCamera;
    use crate::render::RenderSettings;
    use crate::scene::{Object, Scene, Shape};
    use crate::spectral::{Curve, WavelengthGrid};

    #[test]
    fn the_power_heuristic_holds_where_squares_leave_the_range_of_numbers() {
        for scale in [1.0, 1e-25, 1e25] {
            assert!((power_heuristic(scale, scale) - 0.5).abs() < 1e-6, "{scale}");
            assert!((power_heuristic(2.0 * scale, scale) - 0.8).abs() < 1e-6, "{scale}");
        }
        assert_eq!([power_heuristic(1.0, 1e30), power_heuristic(1e30, 1.0)], [0.0, 1.0]);
        assert_eq!([power_heuristic(0.0, 1.0), power_heuristic(0.0, 0.0)], [0.0; 2]);
        assert_eq!([power_heuristic(f32::INFINITY, 1.0), power_heuristic(1.0, f32::INFINITY)], [1.0, 0.0]);
    }

    /// A closed room with wavy walls of 20 thousand triangles, glossy, with two lights.
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
        let coat = Coat::new(1.4, ScalarTexture::Constant(0.3));
        let wall = Material::coated("wall", Curve::constant(0.7), coat);
        let light = |x: f32| Light {
            name: format!("light at {x}").into(),
            group: 0,
            spectrum: Curve::constant(1.0),
            crossed_polarizers: false,
            emitter: Emitter::Disc(DiscEmitter {
                center: Vec3::new(x, 0.0, 0.5),
                normal: Vec3::NEG_Z,
                radius_m: 0.1,
                exponent: 1.0,
            }),
        };
        let shape = Shape::Mesh(Arc::new(mesh));
        Scene {
            grid: WavelengthGrid::uniform(500.0, 510.0, 5.0).unwrap(),
            objects: vec![Object { name: "room".into(), shape, material: 0, emission: None }],
            materials: vec![wall],
            fluorophores: Vec::new(),
            light_groups: vec![LightGroup { name: "g".into() }],
            lights: vec![light(-0.2), light(0.2)],
            camera: PerspectiveCamera::look_at(0.5 * Vec3::Z, Vec3::ZERO, Vec3::Y, 90.0, 16, 16).unwrap(),
        }
    }

    /// Interleaved traversal changes the order of work only.
    #[test]
    fn paths_are_the_same_in_batches_and_alone() {
        let scene = room();
        let compiled = CompiledScene::new(&scene, &RenderSettings::default()).unwrap();
        let paths = |batch_size: u32| -> Vec<String> {
            let mut batch = PathBatch::default();
            let mut texts = Vec::new();
            for first in (0..256).step_by(batch_size as usize) {
                batch.clear();
                for pixel in first..first + batch_size {
                    let mut stream = SampleStream::new(1, u64::from(pixel), 0);
                    let [x, y, ..] = stream.next_4d();
                    let (col, row) = (pixel % 16, pixel / 16);
                    let (origin, direction) = scene.camera.ray(col as f32 + x, row as f32 + y);
                    batch.start(origin, direction, stream);
                }
                compiled.sample_paths(&mut batch, 8, Estimator::MultipleImportance);
                // Debug output of floats is exact.
                texts.extend(batch.paths().map(|path| format!("{path:?}")));
            }
            texts
        };
        let alone = paths(1);
        let longest = alone.iter().map(|path| path.matches("Vertex").count()).max();
        assert_eq!(longest, Some(8), "paths that end early test little");
        for batch_size in [4, 64, 128] {
            assert_eq!(paths(batch_size), alone, "batches of {batch_size}");
        }
    }
}
