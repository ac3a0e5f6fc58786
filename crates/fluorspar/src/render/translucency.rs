//! Light that leaves translucent surfaces at some distance from where it entered: at the first vertex from the camera.
//!
//! The exitance at `o` is that of all entries `i`, `integral P(|i - o|) E(i) |n_o . n_i| dA(i)`, with the radial profile `P` of the
//! tissue: on a plane the flat reflectance or fluorescence, and symmetric in both points. One entry is drawn for all bands, from the
//! root mean square of the profiles in the tangent plane, by a probe along the normal (Christensen, An Approximate Reflectance Profile
//! for Efficient Subsurface Scattering, SIGGRAPH Talks 2015; King et al., BSSRDF Importance Sampling, SIGGRAPH Talks 2013). The
//! projection onto the plane takes up `|n_o . n_i|`, so that weights `t = P / density` are bounded.
//!
//! With `E` the direct light, `R (E(o) + t (E(i) - E(o)))` has the same mean, since `t` is 1 on average, and no noise of `t` where light
//! is even: both points sample the same place on the same light. Indirect light hardly changes over a millimeter, and leaves where it
//! enters. The tissue is that of a random place between both points. Where the probe meets nothing, the surface ends, and the light has
//! entered here: on any shape under even light as much leaves as from a plane. Where it meets a surface that is not translucent, light
//! has entered there, or here as well, by the share that the surface reflects: a white tooth passes light on to the gum, black paint
//! none.

use fluorspar_accel::Ray;
use glam::{Vec2, Vec3};

use super::compiled_scene::CompiledScene;
use super::material_spread::node_at;
use super::path::VertexSpread;
use super::surface::{Intersection, SurfacePoint, Target};
use super::survival_probability::BINS;
use crate::material::FilmFrame;

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

    /// Mean diffuse reflectance of a surface, 0 to 1.
    fn mean_reflectance(&self, material: usize, point: &SurfacePoint) -> f32 {
        let prepared = &self.materials[material];
        let bsdf = prepared.bsdf(point.uv, point.front, Vec3::Z, FilmFrame::default(), 0.0);
        let mut sum = 0.0;
        prepared.term_weights(point.uv, &bsdf, |term, weight| {
            sum += weight * self.material_spectra[material].coarse_terms[term].iter().sum::<f32>();
        });
        sum / BINS as f32
    }

    /// Whether two materials meet at a boundary: what light has passed is then taken for the body that it leaves.
    fn are_apart(&self, a: usize, b: usize) -> bool {
        let index = |material: usize| self.materials[material].coat_index();
        index(a).zip(index(b)).is_some_and(|(a, b)| (a - b).abs() > 0.1)
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
            // What stands off the surface covers nothing of it
            let height = left.geometric.dot(point.position - left.position);
            if height > BUMPS_M || choice < self.mean_reflectance(there, &point) {
                return None;
            }
            return Some(Spread { entry: Entry::Nowhere, material, uv: left.uv, weights });
        }
        if let (Some(map), Some(hit)) = (chosen.normal_map, met) {
            let along = self.texture_directions(hit.target, point.position);
            point.apply_normal_map(map.at(point.uv), along, left.geometric);
        }
        // The tissue between both: on a sheet at any place on the way, otherwise one of the two; bodies of another refractive index,
        // as tooth and gum, end at each other
        let entry = Entry::Elsewhere { point, material: there };
        let is_one_sheet = there == material
            && point.object == left.object
            && (point.uv - left.uv).abs().max_element() < SHEET;
        let (material, uv) = match choice {
            share if is_one_sheet => (material, left.uv.lerp(point.uv, share)),
            share if share < 0.5 || self.are_apart(material, there) => (material, left.uv),
            _ => (there, point.uv),
        };
        Some(Spread { entry, material, uv, weights })
    }
}
