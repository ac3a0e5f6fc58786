//! Traversal against brute force in double precision, watertightness, agreement of kernels, and errors.

#![allow(clippy::unwrap_used, reason = "a panic is how a test fails")]

use crate::common::{Mesh, Random, closed_surface, grid, ray, soup};
use fluorspar_accel::{BuildError, BuildOptions, Hit, Kernel, Ray, TriangleBvh};
use glam::Vec3;

fn build(mesh: &Mesh) -> TriangleBvh {
    TriangleBvh::build(&mesh.positions, &mesh.triangles).unwrap()
}

/// One tree per kernel that this machine runs.
fn build_each(mesh: &Mesh) -> Vec<TriangleBvh> {
    let with = |kernel| {
        let options = BuildOptions { kernel: Some(kernel) };
        TriangleBvh::build_with(&mesh.positions, &mesh.triangles, &options).unwrap()
    };
    Kernel::available().into_iter().map(with).collect()
}

fn bits(hit: Option<Hit>) -> Option<(u32, u32, u32, u32)> {
    hit.map(|hit| (hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.triangle))
}

/// Batched traversal agrees with single rays.
fn check_in_turns(bvh: &TriangleBvh, rays: &[Ray]) {
    let (mut hits, mut answers) = (Vec::new(), Vec::new());
    bvh.closest_each(rays, &mut hits);
    bvh.occluded_each(rays, &mut answers);
    assert_eq!((hits.len(), answers.len()), (rays.len(), rays.len()));
    for ((ray, hit), answer) in rays.iter().zip(hits).zip(answers) {
        assert_eq!(bits(hit), bits(bvh.closest(ray)), "{}: {ray:?}", bvh.kernel());
        assert_eq!(answer, bvh.occluded(ray), "{}: {ray:?}", bvh.kernel());
    }
}

/// Weights of the three corners and distance, in double precision (Moeller and Trumbore 1997); `None` if parallel.
fn meet_line(ray: &Ray, corners: [Vec3; 3]) -> Option<([f64; 3], f64)> {
    let [p0, p1, p2] = corners.map(Vec3::as_dvec3);
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (e1, e2) = (p1 - p0, p2 - p0);
    let p = direction.cross(e2);
    let determinant = e1.dot(p);
    if determinant.abs() < 1e-30 {
        return None;
    }
    let s = origin - p0;
    let u = s.dot(p) / determinant;
    let q = s.cross(e1);
    let v = direction.dot(q) / determinant;
    Some(([1.0 - u - v, u, v], e2.dot(q) / determinant))
}

/// A ray aimed so that it has a fair chance to meet something.
fn aimed_ray(random: &mut Random, mesh: &Mesh) -> Ray {
    let origin = 1.5 * random.cube();
    let target = match random.below(3) {
        0 => random.cube(),
        _ => {
            let [p0, p1, p2] = mesh.corners(random.below(mesh.triangles.len()));
            let (u, v) = (random.unit(), random.unit());
            if u + v < 1.0 {
                p0 + u * (p1 - p0) + v * (p2 - p0)
            } else {
                p1 + (1.0 - u) * (p0 - p1) + (1.0 - v) * (p2 - p1)
            }
        }
    };
    let mut ray = ray(origin, target - origin);
    if random.below(2) == 0 {
        ray.t_max = 2.0 * random.unit();
        ray.t_min = 0.5 * random.unit();
    }
    ray
}

fn meshes() -> Vec<(&'static str, Mesh)> {
    let mut degenerate = soup(300, 0.3, 5);
    for number in 0..300 {
        let [p0, p1, _] = degenerate.corners(number);
        degenerate.add([p0, p1, p0]);
        degenerate.add([p0, p0, p0]);
    }
    let mut planes = grid(16, 0, 0.25);
    planes.append(&grid(16, 1, -0.5));
    planes.append(&grid(16, 2, 0.0));
    vec![
        ("single triangle", soup(1, 1.0, 1)),
        ("five triangles", soup(5, 1.0, 2)),
        ("large triangles", soup(200, 1.0, 3)),
        ("small triangles", soup(3000, 0.02, 4)),
        ("degenerate", degenerate),
        ("planes", planes),
        ("sphere", closed_surface(Vec3::ZERO, 24, |_| 1.0)),
    ]
}

#[test]
fn agrees_with_brute_force_in_double_precision() {
    // Single precision decides on points this close to an edge, in barycentric units, as rounding falls.
    const MARGIN: f64 = 1e-4;
    for (name, mesh) in meshes() {
        let bvh = build(&mesh);
        let mut random = Random(17);
        let mut hits = 0;
        for _ in 0..3000 {
            let ray = aimed_ray(&mut random, &mesh);
            let found = bvh.closest(&ray);
            assert_eq!(bvh.occluded(&ray), found.is_some(), "{name}: {ray:?}");
            // The nearest triangle that is hit beyond doubt bounds what may be found.
            let mut sure = f64::INFINITY;
            for number in 0..mesh.triangles.len() {
                let corners = mesh.corners(number);
                let Some((weights, t)) = meet_line(&ray, corners) else { continue };
                let tolerance = 1e-4 * (1.0 + t.abs());
                if weights.iter().all(|&weight| weight > MARGIN)
                    && t > f64::from(ray.t_min) + tolerance
                    && t < f64::from(ray.t_max) - tolerance
                {
                    sure = sure.min(t);
                }
            }
            let Some(hit) = found else {
                assert_eq!(sure, f64::INFINITY, "{name}: {ray:?} missed a triangle at {sure}");
                continue;
            };
            hits += 1;
            assert!(hit.t > ray.t_min && hit.t < ray.t_max, "{name}: {ray:?} gave {hit:?}");
            let corners = mesh.corners(hit.triangle as usize).map(Vec3::as_dvec3);
            let (u, v) = (f64::from(hit.u), f64::from(hit.v));
            let on_triangle = (1.0 - u - v) * corners[0] + u * corners[1] + v * corners[2];
            let on_ray = ray.origin.as_dvec3() + f64::from(hit.t) * ray.direction.as_dvec3();
            // Both points carry a few roundings, of 1e-7 each, of distances up to 4.
            assert!(on_triangle.distance(on_ray) < 2e-6, "{name}: {hit:?}: {on_triangle} but {on_ray}");
            assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6, "{name}: {hit:?}");
            assert!(f64::from(hit.t) <= sure + 1e-4 * (1.0 + sure), "{name}: {hit:?}, nearest at {sure}");
        }
        assert!(hits > 100, "{name}: only {hits} hits test little");
    }
}

#[test]
fn kernels_agree_bit_for_bit() {
    for (name, mesh) in meshes() {
        let each = build_each(&mesh);
        let mut random = Random(23);
        let rays: Vec<Ray> = (0..4000).map(|_| aimed_ray(&mut random, &mesh)).collect();
        for ray in &rays {
            let expected = bits(each[0].closest(ray));
            for bvh in &each {
                assert_eq!(bits(bvh.closest(ray)), expected, "{name}, {}: {ray:?}", bvh.kernel());
                assert_eq!(bvh.occluded(ray), expected.is_some(), "{name}, {}: {ray:?}", bvh.kernel());
            }
        }
        each.iter().for_each(|bvh| check_in_turns(bvh, &rays));
    }
}

/// From inside a closed surface every ray hits, in particular through vertices, edges, and close by them.
#[test]
fn closed_surfaces_are_watertight() {
    let bumpy = |d: Vec3| 1.0 + 0.15 * (11.0 * d.x).sin() * (7.0 * d.y).cos() * (9.0 * d.z).sin();
    let far_away = Vec3::new(1000.0, -300.0, 70.0);
    for (name, center, mesh) in [
        ("sphere", Vec3::ZERO, closed_surface(Vec3::ZERO, 32, |_| 1.0)),
        ("bumpy", Vec3::ZERO, closed_surface(Vec3::ZERO, 40, bumpy)),
        ("far from the origin", far_away, closed_surface(far_away, 32, |_| 1.0)),
        ("small", Vec3::ZERO, closed_surface(Vec3::ZERO, 32, |_| 1e-6)),
        ("tiny", Vec3::ZERO, closed_surface(Vec3::ZERO, 32, |_| 1e-15)),
        ("huge", Vec3::ZERO, closed_surface(Vec3::ZERO, 32, |_| 1e17)),
    ] {
        let size = mesh.positions[0].distance(center);
        for bvh in build_each(&mesh) {
            let mut random = Random(31);
            let mut rays = Vec::new();
            for source in 0..6 {
                let origin = if source == 0 { center } else { center + 0.4 * size * random.cube() };
                let mut aim = |target: Vec3| {
                    let ray = ray(origin, target - origin);
                    assert!(bvh.closest(&ray).is_some(), "{name}, {}: {ray:?}", bvh.kernel());
                    assert!(bvh.occluded(&ray), "{name}, {}: {ray:?}", bvh.kernel());
                    rays.push(ray);
                };
                for &vertex in &mesh.positions {
                    aim(vertex);
                }
                for number in 0..mesh.triangles.len() {
                    let [p0, p1, p2] = mesh.corners(number);
                    for (from, to) in [(p0, p1), (p1, p2), (p2, p0)] {
                        aim(0.5 * (from + to));
                        aim(from + random.unit() * (to - from));
                    }
                }
            }
            check_in_turns(&bvh, &rays);
        }
    }
}

/// The same from close to the surface, where the triangle around the origin is large compared with the distance to it.
#[test]
fn watertight_next_to_the_surface() {
    // The test places vertices to 6 roundings of the extent, here 2; closer origins may as well be outside.
    const CLOSEST: f32 = 6.0 * f32::EPSILON;
    // A box of twelve triangles, so that edges are long; origins in its corners and along its edges.
    let corner = |n: u32| Vec3::new((n & 1) as f32, (n >> 1 & 1) as f32, (n >> 2) as f32) * 2.0 - 1.0;
    let mesh = Mesh {
        positions: (0..8).map(corner).collect(),
        triangles: vec![
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ],
    };
    for bvh in build_each(&mesh) {
        let mut random = Random(37);
        for step in 0..60_000 {
            let mut origin = random.cube();
            for axis in 0..3 {
                if random.below(2) == 0 {
                    let gap = 10_f32.powi(-(1 + (step % 7))) * (0.1 + random.unit());
                    origin[axis] = (1.0 - gap.max(CLOSEST)) * origin[axis].signum();
                }
            }
            let ray = ray(origin, random.direction());
            assert!(bvh.occluded(&ray), "{}: {ray:?}", bvh.kernel());
        }
    }
}

#[test]
fn axis_parallel_rays() {
    for axis in 0..3 {
        let mesh = grid(8, axis, 0.5);
        for bvh in build_each(&mesh) {
            let mut rays = Vec::new();
            for negative_zeros in [false, true] {
                // Over vertices, edges, diagonals and cells, from both sides.
                for row in -8..=8 {
                    for column in -8..=8 {
                        for sign in [-1.0, 1.0] {
                            let mut origin = Vec3::ZERO;
                            origin[axis] = 0.5 - 2.0 * sign;
                            origin[(axis + 1) % 3] = row as f32 / 8.0;
                            origin[(axis + 2) % 3] = column as f32 / 8.0;
                            let mut direction = if negative_zeros { -Vec3::ZERO } else { Vec3::ZERO };
                            direction[axis] = sign;
                            let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
                            let hit = bvh.closest(&ray).unwrap_or_else(|| panic!("missed by {ray:?}"));
                            assert_eq!(hit.t, 2.0);
                            rays.extend([ray, Ray { t_max: 2.0, ..ray }, Ray { t_min: 2.0, ..ray }]);
                            assert!(!bvh.occluded(&Ray { t_max: 2.0, ..ray }), "t_max is excluded");
                            assert!(!bvh.occluded(&Ray { t_min: 2.0, ..ray }), "t_min is excluded");
                            assert!(bvh.closest(&Ray { direction: -direction, ..ray }).is_none());
                        }
                    }
                }
                // Within the plane: seen from the edge, a triangle has no area.
                let mut origin = Vec3::splat(0.5);
                origin[(axis + 1) % 3] = -3.0;
                let mut direction = Vec3::ZERO;
                direction[(axis + 1) % 3] = 1.0;
                assert_eq!(bvh.closest(&ray(origin, direction)), None);
                rays.push(ray(origin, direction));
            }
            check_in_turns(&bvh, &rays);
        }
    }
}

#[test]
fn equal_distances_go_to_the_lowest_number() {
    // The same grid over and over, each time with its triangles in another order.
    let mut mesh = Mesh::default();
    let mut random = Random(41);
    for _ in 0..8 {
        let mut layer = grid(8, 2, 0.0);
        for number in (1..layer.triangles.len()).rev() {
            layer.triangles.swap(number, random.below(number + 1));
        }
        mesh.append(&layer);
    }
    for bvh in build_each(&mesh) {
        let mut rays = Vec::new();
        for _ in 0..500 {
            let target = random.cube() * Vec3::new(1.0, 1.0, 0.0);
            let ray = ray(target + Vec3::new(0.1, 0.2, 1.0), Vec3::new(-0.1, -0.2, -1.0));
            let hit = bvh.closest(&ray).unwrap();
            let same = |number: &usize| mesh.corners(*number) == mesh.corners(hit.triangle as usize);
            let copies: Vec<usize> = (0..mesh.triangles.len()).filter(same).collect();
            assert_eq!(copies.len(), 8);
            assert_eq!(hit.triangle as usize, copies[0]);
            rays.push(ray);
        }
        check_in_turns(&bvh, &rays);
    }
}

#[test]
fn triangles_without_area_are_never_hit() {
    let mut mesh = Mesh::default();
    let line = |t: f32| Vec3::new(t, 2.0 * t, -0.5 * t);
    mesh.add([line(0.0), line(0.5), line(1.0)]);
    mesh.add([Vec3::ONE; 3]);
    mesh.add([Vec3::ZERO, Vec3::X, Vec3::X]);
    for bvh in build_each(&mesh) {
        let mut random = Random(43);
        for _ in 0..2000 {
            let origin = 2.0 * random.cube();
            let target = match random.below(3) {
                0 => line(random.unit()),
                1 => Vec3::ONE,
                _ => Vec3::X * random.unit(),
            };
            assert_eq!(bvh.closest(&ray(origin, target - origin)), None);
        }
        assert_eq!(bvh.triangle_count(), 3);
        assert_eq!(bvh.bounds(), Some((Vec3::new(0.0, 0.0, -0.5), Vec3::new(1.0, 2.0, 1.0))));
    }
}

#[test]
fn rays_that_make_no_sense_hit_nothing() {
    let mesh = soup(100, 1.0, 3);
    let sane = ray(Vec3::ZERO, Vec3::X);
    for bvh in build_each(&mesh) {
        let mut senseless = vec![
            Ray { direction: Vec3::ZERO, ..sane },
            Ray { t_max: f32::NAN, ..sane },
            Ray { t_min: f32::NAN, ..sane },
            Ray { t_max: -1.0, ..sane },
            Ray { t_min: f32::INFINITY, ..sane },
        ];
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            senseless.push(Ray { origin: Vec3::splat(bad), ..sane });
            senseless.push(Ray { direction: Vec3::splat(bad), ..sane });
        }
        for ray in &senseless {
            assert_eq!(bvh.closest(ray), None, "{ray:?}");
        }
        check_in_turns(&bvh, &senseless);
        let behind = Ray { t_min: -10.0, ..sane };
        assert_eq!(bvh.closest(&behind), bvh.closest(&sane), "a ray has nothing behind its origin");
    }
}

/// Shapes on which builders have been known to take quadratic time or produce deep trees.
#[test]
fn awkward_shapes_build_and_are_found() {
    let mut copies = Mesh::default();
    let mut strip = Mesh::default();
    let mut concentric = Mesh::default();
    let mut nested = Mesh::default();
    for number in 0..20_000 {
        copies.add([Vec3::ZERO, Vec3::X, Vec3::Y]);
        let x = number as f32;
        strip.add([Vec3::X * x, Vec3::X * (x + 1.0), Vec3::new(x, 1.0, 0.0)]);
        let size = x + 1.0;
        concentric.add([Vec3::new(-size, -size, x), Vec3::new(size, -size, x), Vec3::new(0.0, size, x)]);
    }
    for power in -120..59 {
        let size = 2_f32.powi(power);
        nested.add([Vec3::ZERO, Vec3::X * size, Vec3::Y * size]);
    }
    for bvh in build_each(&copies) {
        let hit = bvh.closest(&ray(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z)).unwrap();
        assert_eq!(hit.triangle, 0);
    }
    for bvh in build_each(&strip) {
        for number in 0..20_000 {
            let hit = bvh.closest(&ray(Vec3::new(number as f32 + 0.25, 0.25, 1.0), Vec3::NEG_Z)).unwrap();
            assert_eq!(hit.triangle, number);
        }
    }
    for bvh in build_each(&concentric) {
        let hit = bvh.closest(&ray(Vec3::new(0.0, 0.0, -1.0), Vec3::Z)).unwrap();
        assert_eq!(hit.triangle, 0);
    }
    for bvh in build_each(&nested) {
        for power in -120..59 {
            let size = 2_f32.powi(power);
            let hit = bvh.closest(&ray(Vec3::new(0.3, 0.3, 1.0) * size, Vec3::NEG_Z)).unwrap();
            assert_eq!(hit.triangle, (power + 120) as u32, "the smallest triangle that reaches so far");
        }
    }
}

#[test]
fn empty_input() {
    for bvh in build_each(&Mesh::default()) {
        let ray = ray(Vec3::ZERO, Vec3::X);
        assert_eq!(bvh.closest(&ray), None);
        assert!(!bvh.occluded(&ray));
        assert_eq!(bvh.bounds(), None);
        assert_eq!(bvh.triangle_count(), 0);
    }
    assert!(TriangleBvh::build(&[Vec3::ZERO], &[]).unwrap().bounds().is_none());
}

#[test]
fn errors_name_the_culprit() {
    let good = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let message = |positions: &[Vec3], triangles: &[[u32; 3]]| {
        TriangleBvh::build(positions, triangles).unwrap_err().to_string()
    };
    assert_eq!(
        message(&good, &[[0, 1, 2], [0, 3, 1]]),
        "triangle 1 uses vertex 3, but there are only 3 vertices (numbered from 0)"
    );
    let mut bad = good;
    bad[2].y = f32::NAN;
    assert!(message(&bad, &[]).starts_with("vertex 2 has a coordinate that is not finite"));
    bad[2].y = -2e18;
    assert!(matches!(TriangleBvh::build(&bad, &[]), Err(BuildError::TooFar { vertex: 2, .. })));
    assert!(message(&bad, &[]).contains("1e18"));
}

#[test]
fn the_fastest_kernel_is_chosen() {
    let bvh = build(&soup(10, 1.0, 1));
    assert_eq!(Some(&bvh.kernel()), Kernel::available().last());
    assert!(Kernel::available().contains(&Kernel::Portable));
    let options = BuildOptions { kernel: Some(Kernel::Avx2) };
    let forced = TriangleBvh::build_with(&[], &[], &options);
    assert_eq!(forced.is_ok(), Kernel::available().contains(&Kernel::Avx2));
}

#[test]
fn memory_is_within_reason() {
    let mesh = closed_surface(Vec3::ZERO, 64, |_| 1.0);
    let bvh = build(&mesh);
    let per_triangle = bvh.memory_bytes() / bvh.triangle_count();
    assert!((36..160).contains(&per_triangle), "{per_triangle} bytes per triangle");
    assert_eq!(bvh.triangle_count(), mesh.triangles.len());
    fn shared<T: Send + Sync>(_: &T) {}
    shared(&bvh);
}
