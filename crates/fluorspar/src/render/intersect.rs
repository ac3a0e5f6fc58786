//! Rays in a compiled scene: the nearest surface or light, and visibility between two points.

use fluorspar_accel::{Hit, Ray, prefetch};
use glam::Vec3;

use super::compiled_scene::CompiledScene;
use super::surface::{Intersection, Target};
use crate::sampling::hash_u64;

/// Buffers of batches of rays.
#[derive(Debug, Default)]
pub(super) struct TraceBuffers {
    hits: Vec<Option<Hit>>,
    blocked: Vec<bool>,
}

impl CompiledScene {
    /// [`Self::closest`] of every ray, in their order.
    pub(super) fn closest_each(
        &self,
        rays: &[Ray],
        buffers: &mut TraceBuffers,
        found: &mut Vec<Option<Intersection>>,
    ) {
        found.clear();
        if !self.has_holes {
            self.bvh.closest_each(rays, &mut buffers.hits);
            found.extend(rays.iter().zip(&buffers.hits).map(|(ray, hit)| self.nearest_given(ray, *hit)));
        } else {
            found.extend(rays.iter().map(|ray| self.closest(ray.origin, ray.direction)));
        }
        // Prefetch the triangles and vertices that shading needs
        let triangles = || {
            found.iter().filter_map(|hit| match hit {
                Some(Intersection { target: Target::Triangle { triangle, .. }, .. }) => {
                    Some(*triangle as usize)
                }
                _ => None,
            })
        };
        triangles().for_each(|triangle| prefetch(&self.triangles, triangle));
        for triangle in triangles() {
            for vertex in self.triangles[triangle].vertices {
                prefetch(&self.vertices, vertex as usize);
            }
        }
    }

    /// [`Self::visibility`] of every shadow ray, in their order, toward the lights `aimed_at`.
    pub(super) fn visibility_each(
        &self,
        rays: &[Ray],
        aimed_at: impl Iterator<Item = usize>,
        buffers: &mut TraceBuffers,
        visible: &mut Vec<f32>,
    ) {
        visible.clear();
        let rays_to_lights = rays.iter().zip(aimed_at);
        if !self.has_holes {
            self.bvh.occluded_each(rays, &mut buffers.blocked);
            visible.extend(rays_to_lights.zip(&buffers.blocked).map(|((ray, light), blocked)| {
                if *blocked || self.occluded_elsewhere(ray, light) { 0.0 } else { 1.0 }
            }));
        } else {
            visible.extend(
                rays_to_lights
                    .map(|(ray, light)| self.visibility(ray.origin, ray.direction, ray.t_max, light)),
            );
        }
    }

    /// Nearest surface or light along a ray. A surface is accepted with the probability of its opacity, by a hash of the
    /// ray and the place (stochastic alpha test).
    pub(super) fn closest(&self, origin: Vec3, direction: Vec3) -> Option<Intersection> {
        let mut hit = self.nearest(origin, direction, f32::INFINITY)?;
        if !self.has_holes {
            return Some(hit);
        }
        let mut start = origin;
        let mut passed = 0.0;
        loop {
            let opacity = self.opacity(start, direction, &hit);
            if opacity >= 1.0 || chance(start, direction, hit.t) < opacity {
                return Some(Intersection { t: passed + hit.t, target: hit.target });
            }
            let step = hit.t + self.clearance.max(1e-6 * hit.t);
            passed += step;
            start += direction * step;
            hit = self.nearest(start, direction, f32::INFINITY)?;
        }
    }

    /// Opacity of a surface at an intersection; lights are opaque.
    fn opacity(&self, origin: Vec3, direction: Vec3, hit: &Intersection) -> f32 {
        let object = match hit.target {
            Target::Light(_) => return 1.0,
            Target::Triangle { triangle, .. } => self.object_of(triangle as usize),
            Target::Instance { instance, .. } => match &self.instances {
                Some(instances) => instances.object_of(instance),
                None => return 1.0,
            },
            Target::Shape(index) => self.shapes[index as usize].object,
        };
        let material = self.object_material[object];
        if !self.materials.has_opacity(material) {
            return 1.0;
        }
        match self.surface(origin, direction, hit) {
            Some(point) => self.materials.opacity(material, point.uv, point.front),
            None => 1.0,
        }
    }

    /// Transmittance of a shadow ray up to `t_max`: 0 behind opaque surfaces, between 0 and 1 behind those with an opacity.
    /// The light aimed at does not block.
    pub(super) fn visibility(&self, origin: Vec3, direction: Vec3, t_max: f32, aimed_at: usize) -> f32 {
        if !self.has_holes {
            return if self.occluded(origin, direction, t_max, aimed_at) { 0.0 } else { 1.0 };
        }
        let (mut start, mut left, mut share) = (origin, t_max, 1.0);
        while let Some(hit) = self.nearest(start, direction, left) {
            let aimed = matches!(hit.target, Target::Light(light) if light as usize == aimed_at);
            if !aimed {
                share *= 1.0 - self.opacity(start, direction, &hit);
            }
            if share <= 0.0 {
                return 0.0;
            }
            let step = hit.t + self.clearance.max(1e-6 * hit.t);
            start += direction * step;
            left -= step;
            if left <= 0.0 {
                break;
            }
        }
        share
    }

    /// Nearest surface or light along a ray within `t_max`, holes ignored.
    fn nearest(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<Intersection> {
        let ray = Ray { origin, direction, t_min: 0.0, t_max };
        self.nearest_given(&ray, self.bvh.closest(&ray))
    }

    /// Nearest surface or light along a ray whose nearest triangle is known.
    #[inline]
    fn nearest_given(&self, ray: &Ray, hit: Option<Hit>) -> Option<Intersection> {
        let Ray { origin, direction, t_max, .. } = *ray;
        let mut best = hit.map(|hit| Intersection {
            t: hit.t,
            target: Target::Triangle { triangle: hit.triangle, u: hit.u, v: hit.v },
        });
        let mut limit = best.map_or(t_max, |hit| hit.t);
        if let Some(instances) = &self.instances
            && let Some((t, instance, triangle, u, v)) = instances.closest(&Ray { t_max: limit, ..*ray })
        {
            limit = t;
            best = Some(Intersection { t, target: Target::Instance { instance, triangle, u, v } });
        }
        for (index, shape) in self.shapes.iter().enumerate() {
            if let Some(t) = shape.shape.intersect(origin, direction, limit) {
                limit = t;
                best = Some(Intersection { t, target: Target::Shape(index as u32) });
            }
        }
        if let Some((t, light)) = self
            .light_targets
            .closest(&Ray { t_max: limit, ..*ray }, |light, limit| self.distance_to(light, ray, limit))
        {
            best = Some(Intersection { t, target: Target::Light(light as u32) });
        }
        best
    }

    /// Distance along a ray to a light, within a limit.
    fn distance_to(&self, light: usize, ray: &Ray, limit: f32) -> Option<f32> {
        self.lights[light].emitter.intersect(ray.origin, ray.direction, limit)
    }

    /// Whether anything lies between a point and `t_max` along a direction; the light aimed at does not count.
    fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32, aimed_at: usize) -> bool {
        let ray = Ray { origin, direction, t_min: 0.0, t_max };
        self.bvh.occluded(&ray) || self.occluded_elsewhere(&ray, aimed_at)
    }

    /// Whether an instance, an analytic shape or a light other than the one aimed at is in the way.
    #[inline]
    fn occluded_elsewhere(&self, ray: &Ray, aimed_at: usize) -> bool {
        let Ray { origin, direction, t_max, .. } = *ray;
        self.instances.as_ref().is_some_and(|instances| instances.bvh.occluded(ray))
            || self.shapes.iter().any(|s| s.shape.intersect(origin, direction, t_max).is_some())
            || self.light_targets.occluded(ray, aimed_at, |light, limit| self.distance_to(light, ray, limit))
    }
}

/// A number in `[0, 1)` from the bits of a ray and a place along it.
fn chance(origin: Vec3, direction: Vec3, t: f32) -> f32 {
    let mut hash = u64::from(t.to_bits());
    for value in origin.to_array().into_iter().chain(direction.to_array()) {
        hash = hash_u64(hash ^ u64::from(value.to_bits()));
    }
    (hash >> 40) as f32 / 16_777_216.0
}
