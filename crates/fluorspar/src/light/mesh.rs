//! Emissive triangle meshes of a scene. Spectrum: radiance to both sides, or to the front, W/(sr m² nm).

use glam::Vec3;

use super::disc::emissive_patch_factor;
use super::emitter_sample::toward;
use super::{Emission, EmitterSample, LightBounds};
use crate::geometry::{OrientedPoint, TriangleMesh};
use crate::sampling::warp;

/// Irradiance per unit of radiance of triangles that emit to both sides, or to the front, each taken as one patch, sr.
pub(crate) fn emissive_triangles_factor(
    triangles: impl Iterator<Item = [Vec3; 3]>,
    is_one_sided: bool,
    at: OrientedPoint,
) -> f64 {
    let one = |corners: [Vec3; 3]| {
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let cross = (b - a).cross(c - a);
        let Some(normal) = cross.try_normalize() else { return 0.0 };
        emissive_patch_factor((a + b + c) / 3.0, normal, 0.5 * cross.length(), is_one_sided, at)
    };
    triangles.map(one).sum()
}

/// An emissive mesh ready for sampling. Its triangles stay with the renderer, which hands in their corners.
#[derive(Clone, Debug)]
pub(crate) struct PreparedMesh {
    /// Number of the first triangle in the list of the renderer.
    first_triangle: usize,
    /// Running sum of the areas, m².
    cumulative_area: Vec<f32>,
    /// Bounding sphere.
    center: Vec3,
    radius: f32,
    /// Whether only the side of the geometric normals emits.
    is_one_sided: bool,
}

impl PreparedMesh {
    pub(super) fn new(mesh: &TriangleMesh, first_triangle: usize, is_one_sided: bool) -> Self {
        let mut sum = 0.0_f64;
        let cumulative_area = mesh
            .triangles
            .iter()
            .map(|t| {
                sum += f64::from(mesh.triangle_cross(t).length()) * 0.5;
                sum as f32
            })
            .collect();
        let (low, high) = mesh.bounds();
        let (center, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
        Self { first_triangle, cumulative_area, center, radius, is_one_sided }
    }

    pub(super) fn bounds(&self) -> LightBounds {
        LightBounds::Local { center: self.center, radius: self.radius, lobe: None }
    }

    /// By area.
    pub(super) fn sample(
        &self,
        position: Vec3,
        u: [f32; 2],
        choice: f32,
        corners: impl Fn(usize) -> [Vec3; 3],
    ) -> Option<EmitterSample> {
        let sums = &self.cumulative_area;
        let total = *sums.last()?;
        // Choose a triangle by area and reuse the rest of the number.
        let target = u[0] * total;
        let index = sums.partition_point(|&a| a <= target).min(sums.len() - 1);
        let before = if index == 0 { 0.0 } else { sums[index - 1] };
        let rest = ((target - before) / (sums[index] - before)).clamp(0.0, 0.999_999_9);
        let [a, b, c] = corners(self.first_triangle + index);
        let [s, t] = warp::triangle([rest, u[1]]);
        let way = toward(position, a + (b - a) * s + (c - a) * t)?;
        let cos = self.facing(-way.0.dot((b - a).cross(c - a).normalize_or_zero()));
        EmitterSample::by_area(choice, way, cos, total, 1.0)
    }

    /// Cosine of emission; not positive on a dark side.
    #[inline]
    fn facing(&self, cos: f32) -> f32 {
        if self.is_one_sided { cos } else { cos.abs() }
    }

    pub(super) fn emission(&self, direction: Vec3, distance: f32, [a, b, c]: [Vec3; 3]) -> Option<Emission> {
        let cos = self.facing(-direction.dot((b - a).cross(c - a).normalize_or_zero()));
        let area = *self.cumulative_area.last()?;
        (cos > 0.0).then(|| Emission { scale: 1.0, density: distance * distance / (area * cos) })
    }
}
