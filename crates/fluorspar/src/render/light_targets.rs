//! Light sources as rays meet them.

use fluorspar_accel::Ray;
use glam::Vec3;

use crate::light::{LightBounds, PreparedEmitter};

/// Discs that are tested together.
const LANES: usize = 8;

/// The light sources of a scene: round flat ones, of which rings of LEDs are made, some at a time, all others one by one.
#[derive(Debug, Default)]
pub(super) struct LightTargets {
    /// Corners of a box around those of finite size; `None` where there are none.
    bounds: Option<[Vec3; 2]>,
    discs: Vec<DiscBlock>,
    /// Numbers of those of other shapes.
    others: Vec<usize>,
}

/// Some discs, `[axis][disc]`. Lanes without a disc have a negative square of the radius.
#[derive(Debug)]
struct DiscBlock {
    center: [[f32; LANES]; 3],
    normal: [[f32; LANES]; 3],
    radius_squared: [f32; LANES],
    light: [usize; LANES],
}

impl LightTargets {
    /// Of light sources, each with its number.
    pub(super) fn new<'a>(sources: impl Iterator<Item = (usize, &'a PreparedEmitter)> + Clone) -> Self {
        let mut targets =
            Self { bounds: bounds(sources.clone().map(|(_, emitter)| emitter.bounds())), ..Self::default() };
        let mut used = LANES;
        for (number, emitter) in sources {
            let Some(disc) = emitter.as_disc() else {
                targets.others.push(number);
                continue;
            };
            if used == LANES {
                targets.discs.push(DiscBlock::EMPTY);
                used = 0;
            }
            if let Some(block) = targets.discs.last_mut() {
                block.set(used, number, disc);
            }
            used += 1;
        }
        targets
    }

    /// The nearest light source along a ray: its distance and its number. `other` gives the distance to one that is no disc, within a limit.
    #[inline]
    pub(super) fn closest(
        &self,
        ray: &Ray,
        other: impl Fn(usize, f32) -> Option<f32>,
    ) -> Option<(f32, usize)> {
        if !self.may_hit(ray) {
            return None;
        }
        let mut best = None;
        let mut limit = ray.t_max;
        for block in &self.discs {
            for (t, number) in block.distances(ray, limit).into_iter().zip(block.light) {
                if t < limit {
                    (limit, best) = (t, Some((t, number)));
                }
            }
        }
        for &number in &self.others {
            if let Some(t) = other(number, limit) {
                (limit, best) = (t, Some((t, number)));
            }
        }
        best
    }

    /// Whether a light source other than the one aimed at is in the way of a ray.
    #[inline]
    pub(super) fn occluded(
        &self,
        ray: &Ray,
        aimed_at: usize,
        other: impl Fn(usize, f32) -> Option<f32>,
    ) -> bool {
        let t_max = ray.t_max;
        let is_hit = |block: &DiscBlock| {
            let found = block.distances(ray, t_max).into_iter().zip(block.light);
            found.into_iter().any(|(t, number)| t < t_max && number != aimed_at)
        };
        let is_other_hit = |&number: &usize| number != aimed_at && other(number, t_max).is_some();
        self.may_hit(ray) && (self.discs.iter().any(is_hit) || self.others.iter().any(is_other_hit))
    }

    /// Whether a ray meets the box around the light sources (slab test; Majercik et al. 2018, JCGT 7(3)).
    #[inline]
    fn may_hit(&self, ray: &Ray) -> bool {
        let Some([low, high]) = self.bounds else { return false };
        let inverse = ray.direction.recip();
        let (a, b) = ((low - ray.origin) * inverse, (high - ray.origin) * inverse);
        // A ray along a side of the box gives NaN, which min and max pass over or which counts as a hit
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        !(enter > leave || leave < 0.0 || enter > ray.t_max)
    }
}

impl DiscBlock {
    const EMPTY: Self = Self {
        center: [[0.0; LANES]; 3],
        normal: [[0.0; LANES]; 3],
        radius_squared: [-1.0; LANES],
        light: [0; LANES],
    };

    fn set(&mut self, lane: usize, light: usize, (center, normal, radius): (Vec3, Vec3, f32)) {
        for axis in 0..3 {
            self.center[axis][lane] = center[axis];
            self.normal[axis][lane] = normal[axis];
        }
        self.radius_squared[lane] = radius * radius;
        self.light[lane] = light;
    }

    /// Distances along a ray, infinite where it misses a disc: what [`crate::geometry::intersect_disc`] finds of each.
    #[inline]
    fn distances(&self, ray: &Ray, limit: f32) -> [f32; LANES] {
        let Self { center: [cx, cy, cz], normal: [nx, ny, nz], radius_squared, .. } = self;
        let (o, d) = (ray.origin, ray.direction);
        std::array::from_fn(|i| {
            let cos = d.x * nx[i] + d.y * ny[i] + d.z * nz[i];
            let t = ((cx[i] - o.x) * nx[i] + (cy[i] - o.y) * ny[i] + (cz[i] - o.z) * nz[i]) / cos;
            let (x, y, z) = (o.x + d.x * t - cx[i], o.y + d.y * t - cy[i], o.z + d.z * t - cz[i]);
            // A ray along the plane has no distance, or an infinite one
            let is_hit = (t > 0.0) & (t < limit) & (x * x + y * y + z * z <= radius_squared[i]);
            if is_hit { t } else { f32::INFINITY }
        })
    }
}

/// A box around the lights that have a size, a little larger than they are.
fn bounds(lights: impl Iterator<Item = LightBounds>) -> Option<[Vec3; 2]> {
    let local = lights.filter_map(|light| {
        let (center, radius) = light.sphere()?;
        let margin = Vec3::splat(1.001 * radius + 1e-5 * center.abs().max_element());
        Some([center - margin, center + margin])
    });
    local.reduce(|[low, high], [other_low, other_high]| [low.min(other_low), high.max(other_high)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::intersect_disc;
    use crate::sampling::hash_u64;

    #[test]
    fn discs_are_met_together_as_one_by_one() {
        let value = |at: u64| (hash_u64(at) >> 40) as f32 / 8_388_608.0 - 1.0;
        let vector = |at: u64| Vec3::new(value(3 * at), value(3 * at + 1), value(3 * at + 2));
        let discs: Vec<(Vec3, Vec3, f32)> =
            (0..7).map(|at| (vector(at), vector(50 + at).normalize(), 0.1 + 0.2 * value(at).abs())).collect();
        let mut block = DiscBlock::EMPTY;
        discs.iter().enumerate().for_each(|(lane, disc)| block.set(lane, lane, *disc));
        let mut hits = 0;
        for number in 0..20_000 {
            let (origin, direction) = (vector(100 + 2 * number) * 2.0, vector(101 + 2 * number).normalize());
            let ray = Ray { origin, direction, t_min: 0.0, t_max: 2.5 };
            let together = block.distances(&ray, ray.t_max);
            for (lane, (center, normal, radius)) in discs.iter().enumerate() {
                let alone = intersect_disc(origin, direction, *center, *normal, *radius, ray.t_max);
                assert_eq!(together[lane], alone.unwrap_or(f32::INFINITY));
                hits += usize::from(alone.is_some());
            }
            assert_eq!(together[7], f32::INFINITY);
        }
        assert!(hits > 200, "{hits}");
        // Along the plane of a disc
        let [center, normal] = [Vec3::ZERO, Vec3::Z];
        block.set(0, 0, (center, normal, 1.0));
        let along = Ray { origin: -2.0 * Vec3::X, direction: Vec3::X, t_min: 0.0, t_max: f32::INFINITY };
        assert_eq!(block.distances(&along, f32::INFINITY)[0], f32::INFINITY);
    }
}
