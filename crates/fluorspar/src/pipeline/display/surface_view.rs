//! Pictures of a scene without its light: clay, parts, depth, texture coordinates.

use glam::Vec3;
use rayon::prelude::*;

use serde::Deserialize;

use super::preview::Preview;
use crate::image::FeatureMaps;

/// What a picture of surfaces shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceView {
    /// Gray clay, lit from beside the camera.
    Clay,
    /// Every part in a color of its own, see [`part_color`].
    Part,
    /// Distance from the camera: near is bright.
    Depth,
    /// Texture coordinates: u in red, v in green, lines at every tenth.
    Uv,
}

/// Color where nothing is seen.
const BACKGROUND: [u8; 3] = [24, 26, 30];

/// Draws the surfaces behind each pixel, `width` columns of them.
pub fn surface_view(maps: &FeatureMaps, width: usize, view: SurfaceView) -> Preview {
    let [nearest, farthest] = depth_range_m(maps).unwrap_or([0.0, 1.0]);
    let forward = maps.view.map_or(Vec3::NEG_Z, |view| Vec3::from(view.forward));
    let right = maps.view.map_or(Vec3::X, |view| Vec3::from(view.right));
    // Above the left shoulder of the one who looks.
    let light = (-forward - 0.35 * right + 0.5 * right.cross(forward)).normalize_or(Vec3::Z);
    let color = |pixel: usize| -> [u8; 3] {
        if maps.part[pixel] == 0 {
            return BACKGROUND;
        }
        let shade = 0.25 + 0.75 * Vec3::from(maps.normal[pixel]).dot(light).max(0.0);
        match view {
            SurfaceView::Clay => [shade; 3].map(|value| byte(0.9 * value)),
            SurfaceView::Part => part_color(usize::from(maps.part[pixel]) - 1)
                .map(|value| byte(f32::from(value) / 255.0 * shade)),
            SurfaceView::Depth => {
                let share = (maps.depth_m[pixel] - nearest) / (farthest - nearest).max(f32::MIN_POSITIVE);
                [byte(1.0 - 0.85 * share); 3]
            }
            SurfaceView::Uv => uv_color(maps.uv[pixel], shade),
        }
    };
    let colors: Vec<[u8; 3]> = (0..maps.part.len()).into_par_iter().map(color).collect();
    Preview { width, height: maps.part.len() / width.max(1), rgb: colors.into_flattened() }
}

/// Least and largest distance from the camera that is seen, m; `None` where nothing is.
pub fn depth_range_m(maps: &FeatureMaps) -> Option<[f32; 2]> {
    let seen = maps.depth_m.iter().zip(&maps.part).filter(|(_, part)| **part > 0).map(|(depth, _)| *depth);
    let range = seen.fold([f32::INFINITY, 0.0_f32], |[low, high], depth| [low.min(depth), high.max(depth)]);
    (range[0] <= range[1]).then_some(range)
}

/// The color of a part by its number: hues a golden section apart, in three strengths.
pub fn part_color(part: usize) -> [u8; 3] {
    let hue = (part as f32 * 0.618_034).fract() * 6.0;
    let strength = [0.75, 0.5, 0.95][part % 3];
    let channel = |offset: f32| {
        let distance = ((hue + offset) % 6.0 - 3.0).abs() - 1.0;
        byte(1.0 - strength * (1.0 - distance.clamp(0.0, 1.0)))
    };
    [channel(0.0), channel(4.0), channel(2.0)]
}

fn uv_color([u, v]: [f32; 2], shade: f32) -> [u8; 3] {
    let line = |x: f32| {
        let tenth = (10.0 * x).rem_euclid(1.0);
        !(0.06..=0.94).contains(&tenth)
    };
    if line(u) || line(v) {
        return [byte(0.1); 3];
    }
    [u.rem_euclid(1.0), v.rem_euclid(1.0), 0.35].map(|value| byte((0.15 + 0.85 * value) * shade.max(0.5)))
}

fn byte(value: f32) -> u8 {
    (255.0 * value.clamp(0.0, 1.0)).round() as u8
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn parts_that_follow_each_other_differ_in_color() {
        let colors: BTreeSet<[u8; 3]> = (0..100).map(part_color).collect();
        assert!(colors.len() >= 99, "{}", colors.len());
        for part in 0..99 {
            let (a, b) = (part_color(part), part_color(part + 1));
            let apart: i32 = a.iter().zip(b).map(|(a, b)| (i32::from(*a) - i32::from(b)).abs()).sum();
            assert!(apart > 100, "{part}: {a:?} {b:?}");
        }
    }

    #[test]
    fn pictures_show_what_the_maps_hold() {
        let maps = FeatureMaps {
            depth_m: vec![1.0, 3.0, f32::INFINITY, 2.0],
            normal: vec![[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0]],
            part: vec![1, 2, 0, 1],
            uv: vec![[0.05, 0.05], [0.1, 0.5], [0.0; 2], [0.95, 0.35]],
            part_names: vec!["a".into(), "b".into()],
            material_names: vec!["m".into(); 2],
            view: None,
        };
        let draw = |view| surface_view(&maps, 2, view).rgb.as_chunks::<3>().0.to_vec();
        assert_eq!(depth_range_m(&maps), Some([1.0, 3.0]));
        let depth = draw(SurfaceView::Depth);
        assert_eq!((depth[0], depth[1], depth[2]), ([255; 3], [38; 3], BACKGROUND));
        assert!(depth[3][0] > depth[1][0] && depth[3][0] < depth[0][0]);
        let clay = draw(SurfaceView::Clay);
        assert!(clay[0] == clay[3] && clay[0][0] > clay[1][0]);
        let uv = draw(SurfaceView::Uv);
        assert!(uv[1] == [26; 3] && uv[3][0] > uv[0][0] && uv[3][1] > uv[0][1], "{uv:?}");
        let parts = draw(SurfaceView::Part);
        assert!(parts[0] == parts[3] && parts[0] != parts[1]);
    }
}
