//! Geometry behind each pixel: depth, normal, object, texture coordinates.

use rayon::prelude::*;

use super::compiled_scene::CompiledScene;
use super::surface::Target;
use crate::image::FeatureMaps;
use crate::scene::Scene;

/// Feature maps of the center of each pixel.
pub(super) fn feature_maps(compiled: &CompiledScene, scene: &Scene) -> FeatureMaps {
    let camera = &compiled.camera;
    let pixels = camera.width * camera.height;
    // In place: images rendered in bands of rows have no memory for these maps twice.
    let mut maps = FeatureMaps {
        depth_m: vec![f32::INFINITY; pixels],
        normal: vec![[0.0; 3]; pixels],
        part: vec![0; pixels],
        uv: vec![[0.0; 2]; pixels],
        part_names: scene.objects.iter().map(|o| o.name.clone()).collect(),
        material_names: scene.objects.iter().map(|o| scene.materials[o.material].name.clone()).collect(),
        view: camera.view(),
    };
    (&mut maps.depth_m, &mut maps.normal, &mut maps.part, &mut maps.uv).into_par_iter().enumerate().for_each(
        |(index, (depth_m, normal, part, uv))| {
            let (row, col) = (index / camera.width, index % camera.width);
            let (origin, direction) = camera.ray(col as f32 + 0.5, row as f32 + 0.5);
            let Some(hit) = compiled.closest(origin, direction) else { return };
            if matches!(hit.target, Target::Light(_)) {
                *depth_m = hit.t;
            } else if let Some(point) = compiled.surface(origin, direction, &hit) {
                *depth_m = hit.t;
                *normal = point.shading.to_array();
                *part = point.object as u16 + 1;
                *uv = point.uv.to_array();
            }
        },
    );
    maps
}
