//! Points that the camera sees: lights are weighted by their irradiance there.

use fluorspar_accel::Ray;

use super::geometry::Geometry;
use crate::geometry::OrientedPoint;
use crate::render::compiled_scene::AnalyticShape;
use crate::scene::Scene;

/// Rays along each side of the image.
pub(super) const VIEW_RAYS: usize = 12;

/// Visible points, with normals to the side of the camera: those on surfaces that fluoresce, or all if none does. Holes
/// and light sources are looked through.
pub(super) fn on_fluorescent_surfaces(scene: &Scene, geometry: &Geometry) -> Vec<OrientedPoint> {
    // Intersect a grid of camera rays with triangles, instances and shapes
    let hits: Vec<(usize, OrientedPoint)> = (scene.camera.ray_grid(VIEW_RAYS))
        .filter_map(|(origin, direction)| {
            let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
            let mut nearest = geometry.bvh.closest(&ray).map(|hit| {
                let [a, b, c] = geometry.corners(hit.triangle);
                (hit.t, geometry.triangles[hit.triangle as usize].object as usize, (b - a).cross(c - a))
            });
            let within = Ray { t_max: nearest.map_or(f32::INFINITY, |(t, ..)| t), ..ray };
            if let Some(instances) = &geometry.instances
                && let Some((t, instance, triangle, ..)) = instances.closest(&within)
            {
                let [a, b, c] = instances.corners(instance, triangle);
                nearest = Some((t, instances.object_of(instance), (b - a).cross(c - a)));
            }
            for shape in &geometry.shapes {
                let limit = nearest.map_or(f32::INFINITY, |(t, ..)| t);
                if let Some(t) = shape.shape.intersect(origin, direction, limit) {
                    let normal = match &shape.shape {
                        AnalyticShape::Sphere { center, .. } => origin + direction * t - *center,
                        AnalyticShape::Disc { normal, .. } => *normal,
                    };
                    nearest = Some((t, shape.object, normal));
                }
            }
            let (t, object, normal) = nearest?;
            let normal = normal.as_dvec3().try_normalize()?;
            let normal = if normal.dot(direction.as_dvec3()) > 0.0 { -normal } else { normal };
            Some((object, OrientedPoint { position: (origin + direction * t).as_dvec3(), normal }))
        })
        .collect();

    // Keep the points on surfaces that fluoresce, if there are any
    let fluoresces = |object: usize| {
        let material = &scene.materials[scene.objects[object].material];
        material.any(&scene.materials, |part| !part.fluorophores.is_empty())
    };
    let any = hits.iter().any(|(object, _)| fluoresces(*object));
    hits.into_iter().filter(|(object, _)| !any || fluoresces(*object)).map(|(_, point)| point).collect()
}
