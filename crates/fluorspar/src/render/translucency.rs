//! Light that leaves translucent surfaces at some distance from where it entered: at the first vertex from the camera.
//!
//! The exitance at `o` is that of all entries `i`, `integral P(|i - o|) E(i) |n_o . n_i| dA(i)`, with the radial profile `P` of the
//! tissue: on a plane the flat reflectance or fluorescence, and symmetric in both points. One entry is drawn for all bands, from the
//! mean profile in the tangent plane, by a probe along the normal (Christensen, An Approximate Reflectance Profile for Efficient
//! Subsurface Scattering, SIGGRAPH Talks 2015; King et al., BSSRDF Importance Sampling, SIGGRAPH Talks 2013). The projection onto the
//! plane takes up `|n_o . n_i|`, so that weights `t = P / density` are bounded.
//!
//! With `E` the direct light, `R (E(o) + t (E(i) - E(o)))` has the same mean, since `t` is 1 on average, and no noise of `t` where light
//! is even: both points sample the same place on the same light. Indirect light hardly changes over a millimeter, and leaves where it
//! enters. The tissue is that of a random place between both points. Where the probe meets nothing, the surface ends, and the light has
//! entered here: on any shape under even light as much leaves as from a plane. Where it meets a surface that is not translucent, none
//! has entered there.

use fluorspar_accel::Ray;
use fluorspar_accel::bands::BandBlock;
use glam::Vec2;

use super::compiled_scene::CompiledScene;
use super::path::VertexSpread;
use super::surface::{Intersection, SurfacePoint, Target};

/// Radii at which profiles are known: the first one, mm, their ratio and their number. Beyond the last no light leaves.
const FIRST_MM: f64 = 0.01;
const RATIO: f64 = 1.2;
pub(super) const RADII: usize = 42;
/// How far above and below the plane a probe looks, by the distance along it and for bumps, m: what lies farther off is another surface
/// across a gap.
const SLOPE: f32 = 0.5;
const BUMPS_M: f32 = 1e-4;
/// Least cosine between the normals of both points.
const LEAST_COSINE: f32 = 0.5;
/// Texture coordinates farther apart than this belong to different sheets.
const SHEET: f32 = 0.25;

/// Millimeters per meter.
const MM: f32 = 1e3;

/// Radial profiles of a material.
#[derive(Debug)]
pub(super) struct MaterialSpread {
    /// Probability of distances up to each node.
    pub(super) cumulative: [f32; RADII],
    /// Reflectance times density, 1/mm², `[term][radius][block]`.
    pub(super) reflected: Vec<Vec<BandBlock>>,
    /// Density, 1/mm², `[fluorophore][radius][wavelength of emission]`; nothing of what lies on the surface.
    pub(super) emitted: Vec<Vec<f32>>,
}

/// Radius of a node, mm.
pub(super) fn radius_mm(node: usize) -> f64 {
    FIRST_MM * RATIO.powi(node as i32)
}

/// Area that each node stands for when densities are interpolated between them, mm².
pub(super) fn node_areas_mm2() -> [f64; RADII] {
    const STEPS: usize = 64;
    let mut areas = [0.0; RADII];
    areas[0] = std::f64::consts::PI * radius_mm(0).powi(2);
    for node in 0..RADII - 1 {
        let (inner, outer) = (radius_mm(node), radius_mm(node + 1));
        for step in 0..STEPS {
            let share = (step as f64 + 0.5) / STEPS as f64;
            let radius = inner * RATIO.powf(share);
            // dA = 2 pi r dr, dr = r ln(ratio) d(share)
            let area = std::f64::consts::TAU * radius * radius * (outer / inner).ln() / STEPS as f64;
            areas[node] += (1.0 - share) * area;
            areas[node + 1] += share * area;
        }
    }
    areas
}

/// Node below a distance, and the share of the way to the next; `None` beyond the last.
fn node_at(distance_mm: f32) -> Option<(usize, f32)> {
    let place = (distance_mm.max(FIRST_MM as f32) / FIRST_MM as f32).ln() / (RATIO as f32).ln();
    let node = place as usize;
    (node + 1 < RADII).then_some((node, place - node as f32))
}

impl MaterialSpread {
    /// Draws a distance along the plane, mm, and gives the density there, 1/mm². Distances rise with `u`, so that even numbers give
    /// evenly spread distances; the density is even within a ring between two nodes.
    fn sample(&self, u: f32) -> (f32, f32) {
        let ring = self.cumulative.partition_point(|sum| *sum <= u).min(RADII - 1);
        let below = if ring == 0 { 0.0 } else { self.cumulative[ring - 1] };
        let share = self.cumulative[ring] - below;
        let inner = if ring == 0 { 0.0 } else { radius_mm(ring - 1) as f32 };
        let area = radius_mm(ring).powi(2) as f32 - inner * inner;
        let distance_mm = (inner * inner + ((u - below) / share).clamp(0.0, 1.0) * area).sqrt();
        (distance_mm, share / (std::f32::consts::PI * area))
    }
}

/// A point where light leaves, while it is not known where it entered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probe {
    pub(super) ray: Ray,
    left: SurfacePoint,
    material: usize,
    density_per_mm2: f32,
}

/// Where light that leaves a point has entered.
#[derive(Clone, Copy, Debug)]
pub(super) enum Entry {
    /// There, below a material.
    Elsewhere { point: SurfacePoint, material: usize },
    /// Nowhere: there is something that lets no light through.
    Nowhere,
}

/// What is known of a translucent vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spread {
    pub(super) entry: Entry,
    /// The tissue that the light has passed: its material, and where.
    pub(super) material: usize,
    pub(super) uv: Vec2,
    /// Weights of its profiles.
    pub(super) weights: VertexSpread,
}

impl CompiledScene {
    /// Looks for where light entered that leaves toward a viewer; `None` where it leaves where it enters. `u` are random numbers.
    pub(super) fn probe(&self, ray: &Ray, hit: &Intersection, u: [f32; 4], lobe: f32) -> Option<Probe> {
        let left = self.surface(ray.origin, ray.direction, hit)?;
        let mut choice = lobe;
        let chosen =
            self.materials.choose(self.object_material[left.object], left.uv, left.front, &mut choice);
        let spread = self.material_spectra[chosen.index].spread.as_ref()?;
        let (distance_mm, density_per_mm2) = spread.sample(u[0]);
        let (sin, cos) = (std::f32::consts::TAU * u[1]).sin_cos();
        let (along, across) = crate::sampling::warp::tangents(left.geometric);
        let aside = (along * cos + across * sin) * (distance_mm / MM);
        let height = SLOPE * distance_mm / MM + BUMPS_M;
        let ray = Ray {
            origin: left.position + aside + left.geometric * height,
            direction: -left.geometric,
            t_min: 0.0,
            t_max: 2.0 * height,
        };
        Some(Probe { ray, left, material: chosen.index, density_per_mm2 })
    }

    /// What a probe has met; `None` where light has entered where it leaves.
    pub(super) fn spread(&self, probe: &Probe, met: Option<&Intersection>, u: [f32; 4]) -> Option<Spread> {
        let &Probe { ray, left, material, density_per_mm2 } = probe;
        let met = met.filter(|hit| hit.t <= ray.t_max && !matches!(hit.target, Target::Light(_)));
        let mut point = met.and_then(|hit| self.surface(ray.origin, ray.direction, hit))?;
        if point.front != left.front || point.geometric.dot(left.geometric) < LEAST_COSINE {
            return None;
        }
        let beyond = VertexSpread { node: 0, fraction: 0.0, inverse_density: 0.0, choice: u[3] };
        let weights =
            node_at(MM * left.position.distance(point.position)).map_or(beyond, |(node, fraction)| {
                VertexSpread { node, fraction, inverse_density: 1.0 / density_per_mm2, choice: u[3] }
            });
        let mut choice = u[2];
        let outermost = self.object_material[point.object];
        let chosen = self.materials.choose(outermost, point.uv, point.front, &mut choice);
        let there = chosen.index;
        if self.material_spectra[there].spread.is_none() {
            return Some(Spread { entry: Entry::Nowhere, material, uv: left.uv, weights });
        }
        if let (Some(map), Some(hit)) = (chosen.normal_map, met) {
            let along = self.texture_directions(hit.target, point.position);
            point.apply_normal_map(map.at(point.uv), along, left.geometric);
        }
        // The tissue between both: on a sheet at any place on the way, otherwise one of the two
        let entry = Entry::Elsewhere { point, material: there };
        let is_one_sheet = there == material
            && point.object == left.object
            && (point.uv - left.uv).abs().max_element() < SHEET;
        let (material, uv) = match u[2] {
            share if is_one_sheet => (material, left.uv.lerp(point.uv, share)),
            share if share < 0.5 => (material, left.uv),
            _ => (there, point.uv),
        };
        Some(Spread { entry, material, uv, weights })
    }
}
