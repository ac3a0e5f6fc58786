//! Mean of a texture over surfaces.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::Shape;
use crate::geometry::{MeshInstance, MeshInstances, TriangleMesh};
use crate::material::ScalarTexture;

/// Samples over one shape, about: enough to see every field of a coarse map, few enough to take no time.
const SAMPLES: f32 = 20_000.0;

/// Sums of a texture times area and of area, so that shapes can be added up.
#[derive(Clone, Copy, Debug, Default)]
struct Integral {
    value: f64,
    area: f64,
}

impl Integral {
    fn add(&mut self, texture: &ScalarTexture, uv: Vec2, area: f32) {
        self.value += f64::from(texture.at(uv)) * f64::from(area);
        self.area += f64::from(area);
    }
}

/// Mean of a texture over the area of shapes; over its unit square where there is no area.
pub fn surface_mean<'s>(texture: &ScalarTexture, shapes: impl Iterator<Item = &'s Shape>) -> f64 {
    let mut integral = Integral::default();
    for shape in shapes {
        match shape {
            Shape::Mesh(mesh) => over_samples(&mut integral, texture, mesh, SAMPLES),
            Shape::Instances(many) => over_instances(&mut integral, texture, many, MOST_TRIANGLES),
            Shape::Sphere { radius_m, .. } => over_sphere(&mut integral, texture, *radius_m),
            Shape::Disc { radius_m, .. } => over_disc(&mut integral, texture, *radius_m),
        }
    }
    if integral.area <= 0.0 {
        let side = SAMPLES.sqrt() as usize;
        for (i, j) in grid(side, side) {
            integral.add(texture, Vec2::new(i, j), 1.0);
        }
    }
    integral.value / integral.area
}

/// [`surface_mean`] from some two thousand triangles of each fine mesh, which stand for all of it by area: to a few per cent, in no time.
pub fn rough_surface_mean<'s>(
    texture: &ScalarTexture,
    shapes: impl Iterator<Item = &'s Shape> + Clone,
) -> f64 {
    const TRIANGLES: usize = 2000;
    let mut integral = Integral::default();
    for shape in shapes.clone() {
        let Shape::Mesh(mesh) = shape else { return surface_mean(texture, shapes) };
        let step = mesh.triangles.len() / TRIANGLES;
        if step < 2 {
            over_samples(&mut integral, texture, mesh, SAMPLES);
            continue;
        }
        for triangle in mesh.triangles.iter().step_by(step) {
            let uv = triangle.map(|vertex| mesh.uvs.get(vertex as usize).copied().unwrap_or_default());
            let area = step as f32 * area_of(mesh, triangle);
            integral.add(texture, (uv[0] + uv[1] + uv[2]) / 3.0, area);
        }
    }
    if integral.area > 0.0 { integral.value / integral.area } else { surface_mean(texture, shapes) }
}

fn area_of(mesh: &TriangleMesh, triangle: &[u32; 3]) -> f32 {
    let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
    0.5 * (b - a).cross(c - a).length()
}

/// Middles of the fields of a unit square.
fn grid(columns: usize, rows: usize) -> impl Iterator<Item = (f32, f32)> {
    let middle = |index: usize, n: usize| (index as f32 + 0.5) / n as f32;
    (0..rows).flat_map(move |row| (0..columns).map(move |col| (middle(col, columns), middle(row, rows))))
}

/// Every triangle is cut into `n²` equal ones, more of them where it is large.
fn over_samples(integral: &mut Integral, texture: &ScalarTexture, mesh: &TriangleMesh, samples: f32) {
    let total: f32 = mesh.triangles.iter().map(|triangle| area_of(mesh, triangle)).sum();
    if total <= 0.0 {
        return;
    }
    for triangle in &mesh.triangles {
        let area = area_of(mesh, triangle);
        let [a, b, c] = if mesh.uvs.is_empty() {
            [Vec2::ZERO; 3]
        } else {
            triangle.map(|vertex| mesh.uvs[vertex as usize])
        };
        let n = (area / total * samples).sqrt().ceil().max(1.0) as usize;
        let part = area / (n * n) as f32;
        let point = |i: f32, j: f32| a + (b - a) * (i / n as f32) + (c - a) * (j / n as f32);
        for row in 0..n {
            for col in 0..n - row {
                let (i, j) = (col as f32, row as f32);
                integral.add(texture, point(i + 1.0 / 3.0, j + 1.0 / 3.0), part);
                if col + row + 1 < n {
                    integral.add(texture, point(i + 2.0 / 3.0, j + 2.0 / 3.0), part);
                }
            }
        }
    }
}

/// Approximate number of sampled triangles of instances.
const MOST_TRIANGLES: usize = 10_000_000;

/// Every triangle by the mean of the texture over it and its area at its place. Of more than `most` triangles, every so
/// many of the instances of each mesh stand for all of that mesh, by what their maps do to areas.
fn over_instances(integral: &mut Integral, texture: &ScalarTexture, many: &MeshInstances, most: usize) {
    let step = (many.triangle_count() as usize).div_ceil(most).max(1);
    let mut places: Vec<Vec<&MeshInstance>> = vec![Vec::new(); many.meshes.len()];
    for instance in &many.instances {
        places[instance.mesh as usize].push(instance);
    }
    for (mesh, places) in many.meshes.iter().zip(&places) {
        let sampled = || places.iter().step_by(step);
        let growth_of_sampled: f64 = sampled().map(|place| area_growth(place)).sum();
        if growth_of_sampled <= 0.0 {
            continue;
        }
        let weight = places.iter().map(|place| area_growth(place)).sum::<f64>() / growth_of_sampled;
        let means = triangle_means(texture, mesh);
        for place in sampled() {
            for (triangle, mean) in mesh.triangles.iter().zip(&means) {
                let [a, b, c] = triangle.map(|v| place.to_world.matrix3 * mesh.positions[v as usize]);
                let area = weight * f64::from(0.5 * (b - a).cross(c - a).length());
                integral.value += mean * area;
                integral.area += area;
            }
        }
    }
}

/// By how much a map makes areas grow, as the root mean square over all orientations: `|cof M| / sqrt(3)`, exact where it
/// stretches all directions alike.
fn area_growth(place: &MeshInstance) -> f64 {
    let m = place.to_world.matrix3.as_dmat3();
    let (x, y, z) = (m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
    ((x.length_squared() + y.length_squared() + z.length_squared()) / 3.0).sqrt()
}

/// Means of a texture over the triangles of a mesh.
fn triangle_means(texture: &ScalarTexture, mesh: &TriangleMesh) -> Vec<f64> {
    let mean = |triangle: &[u32; 3]| {
        let mut integral = Integral::default();
        let alone = TriangleMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            uvs: if mesh.uvs.is_empty() {
                Vec::new()
            } else {
                triangle.map(|vertex| mesh.uvs[vertex as usize]).to_vec()
            },
            triangles: vec![[0, 1, 2]],
            ..TriangleMesh::default()
        };
        over_samples(&mut integral, texture, &alone, SAMPLES / mesh.triangles.len() as f32);
        integral.value / integral.area
    };
    mesh.triangles.iter().map(mean).collect()
}

/// Longitude is even over the area, and so is the height above the equator.
fn over_sphere(integral: &mut Integral, texture: &ScalarTexture, radius_m: f32) {
    let (columns, rows) = (200, 100);
    let part = 4.0 * PI * radius_m * radius_m / (columns * rows) as f32;
    for (u, height) in grid(columns, rows) {
        let v = 0.5 + (2.0 * height - 1.0).asin() / PI;
        integral.add(texture, Vec2::new(u, v), part);
    }
}

fn over_disc(integral: &mut Integral, texture: &ScalarTexture, radius_m: f32) {
    let side = SAMPLES.sqrt() as usize;
    let part = 4.0 * radius_m * radius_m / (side * side) as f32;
    for (u, v) in grid(side, side) {
        if (Vec2::new(u, v) - 0.5).length() <= 0.5 {
            integral.add(texture, Vec2::new(u, v), part);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Affine3;

    use super::*;
    use crate::material::ImageTexture;

    /// A map whose value is `1 - v`, from 0.9 at the bottom to 0.1 at the top: constant beyond the middles of its rows.
    fn falling() -> ScalarTexture {
        let image = ImageTexture::new(1, 5, vec![0.1, 0.3, 0.5, 0.7, 0.9]).unwrap();
        ScalarTexture::Image { image: Arc::new(image), low: 0.0, high: 1.0 }
    }

    #[test]
    fn the_mean_weighs_by_area() {
        // Two unit squares, the second one four times as large; checker fields of 0 and 1 by halves of u.
        let square = |side: f32, u: f32| TriangleMesh {
            positions: [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y].map(|p| (p * side).extend(0.0)).to_vec(),
            uvs: vec![Vec2::new(u, 0.1); 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..TriangleMesh::default()
        };
        let halves = ScalarTexture::Checker { columns: 2, rows: 1, low: 0.0, high: 1.0 };
        let shapes = [square(1.0, 0.2), square(2.0, 0.7)].map(|mesh| Shape::Mesh(Arc::new(mesh)));
        assert!((surface_mean(&halves, shapes.iter()) - 0.8).abs() < 1e-6);
        assert!((surface_mean(&halves, std::iter::empty()) - 0.5).abs() < 0.01);
        assert_eq!(surface_mean(&ScalarTexture::Constant(0.25), shapes.iter()), 0.25);
    }

    #[test]
    fn few_triangles_of_a_fine_mesh_stand_for_all_of_it() {
        // A strip of unit area in fine pieces, of value 0, and a square of the same area in two, of value 1
        let strip = |pieces: u32, u: f32| {
            let along = |place: u32| place as f32 / pieces as f32;
            TriangleMesh {
                positions: (0..=pieces)
                    .flat_map(|x| [0.0, 1.0].map(|y| Vec3::new(along(x), y, 0.0)))
                    .collect(),
                uvs: vec![Vec2::new(u, 0.1); 2 * pieces as usize + 2],
                triangles: (0..2 * pieces).map(|corner| [corner, corner + 1, corner + 2]).collect(),
                ..TriangleMesh::default()
            }
        };
        let halves = ScalarTexture::Checker { columns: 2, rows: 1, low: 0.0, high: 1.0 };
        for pieces in [1, 1999, 50_000] {
            let shapes = [strip(pieces, 0.2), strip(1, 0.7)].map(|mesh| Shape::Mesh(Arc::new(mesh)));
            let mean = rough_surface_mean(&halves, shapes.iter());
            assert!((mean - 0.5).abs() < 0.01, "{mean} of {pieces} pieces");
        }
        // Two triangles are seen at more than their middles, which lie in the first and the second of three fields
        let uvs = vec![Vec2::ZERO, Vec2::Y, 0.9 * Vec2::X, Vec2::new(0.9, 1.0)];
        let square = Shape::Mesh(Arc::new(TriangleMesh { uvs, ..strip(1, 0.0) }));
        let thirds = ScalarTexture::Checker { columns: 3, rows: 1, low: 0.0, high: 1.0 };
        let mean = rough_surface_mean(&thirds, std::iter::once(&square));
        assert!((mean - 1.0 / 2.7).abs() < 0.02, "{mean}");
    }

    #[test]
    fn instances_that_are_left_out_do_not_shift_the_mean() {
        // Squares in alternating fields of 0 and 1; the ones are twice as large, and every other one of them six times.
        let square = |u: f32| TriangleMesh {
            positions: [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y].map(|p| p.extend(0.0)).to_vec(),
            uvs: vec![Vec2::new(u, 0.1); 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..TriangleMesh::default()
        };
        let halves = ScalarTexture::Checker { columns: 2, rows: 1, low: 0.0, high: 1.0 };
        let place = |number: usize| MeshInstance {
            mesh: (number % 2) as u32,
            to_world: Affine3::from_scale(Vec3::splat([1.0, 2.0, 1.0, 6.0][number % 4])),
        };
        let many = MeshInstances {
            meshes: vec![Arc::new(square(0.2)), Arc::new(square(0.7))],
            instances: (0..600).map(place).collect(),
        };
        // Areas of four in a row: 1 + 1 of value 0, 4 + 36 of value 1.
        for most in [MOST_TRIANGLES, 700, 600, 400, 300, 100, 7, 1] {
            let mut integral = Integral::default();
            over_instances(&mut integral, &halves, &many, most);
            let mean = integral.value / integral.area;
            assert!((mean - 40.0 / 42.0).abs() < 1e-6, "{mean} of {most} triangles");
            let area = 150.0 * 42.0;
            assert!((integral.area - area).abs() < 1e-6 * area, "{} of {most} triangles", integral.area);
        }
    }

    #[test]
    fn symmetric_shapes_have_the_mean_of_their_middle() {
        // Every shape is symmetric about v = 0.5, and the map is antisymmetric about its value there, 0.5.
        let full = TriangleMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..TriangleMesh::default()
        };
        let shapes = [
            Shape::Mesh(Arc::new(full)),
            Shape::Sphere { center: Vec3::ZERO, radius_m: 2.0 },
            Shape::Disc { center: Vec3::ZERO, normal: Vec3::Z, radius_m: 2.0 },
        ];
        for shape in &shapes {
            let mean = surface_mean(&falling(), std::iter::once(shape));
            assert!((mean - 0.5).abs() < 1e-3, "{shape:?}: {mean}");
        }
    }

    #[test]
    fn the_caps_of_a_sphere_count_as_little_as_they_are() {
        // Fields by latitude: the northernmost tenth of v is the cap above 72 degrees, (1 - sin 72°) / 2 of the area.
        let mut rows = vec![0.0; 10];
        rows[0] = 1.0;
        let image = ImageTexture::new(1, 10, rows).unwrap();
        let cap = ScalarTexture::Image { image: Arc::new(image), low: 0.0, high: 1.0 };
        let sphere = Shape::Sphere { center: Vec3::ZERO, radius_m: 1.0 };
        let mean = surface_mean(&cap, std::iter::once(&sphere));
        // Bilinear between rows: integrate the same profile in closed steps of v, with weight pi/2 cos(pi (v - 1/2)).
        let expected: f64 = (0..100_000)
            .map(|i| {
                let v = (f64::from(i) + 0.5) / 100_000.0;
                let value = f64::from(cap.at(Vec2::new(0.5, v as f32)));
                value * std::f64::consts::FRAC_PI_2 * (std::f64::consts::PI * (v - 0.5)).cos() / 100_000.0
            })
            .sum();
        assert!((mean - expected).abs() < 0.01 * expected, "{mean} {expected}");
    }
}
