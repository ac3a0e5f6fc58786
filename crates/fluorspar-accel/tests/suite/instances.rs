//! Instances against the same triangles carried to their places one by one.

#![allow(clippy::unwrap_used, reason = "a panic is how a test fails")]

use std::sync::Arc;

use crate::common::{Mesh, Random, closed_surface, grid, ray, soup};
use fluorspar_accel::{
    BuildError, BuildOptions, Instance, InstanceBvh, InstanceHit, Kernel, LARGEST_COORDINATE, Ray,
    TriangleBvh,
};
use glam::{Affine3, Mat3, Quat, Vec3};

/// Meshes, their trees and their placements.
struct Placed {
    meshes: Vec<Mesh>,
    trees: Vec<Arc<TriangleBvh>>,
    instances: Vec<Instance>,
}

impl Placed {
    fn build(&self, kernel: Option<Kernel>) -> InstanceBvh {
        InstanceBvh::build_with(self.trees.clone(), &self.instances, &BuildOptions { kernel }).unwrap()
    }

    /// Corners of a triangle of an instance at its place.
    fn corners(&self, instance: u32, triangle: u32) -> [Vec3; 3] {
        let Instance { mesh, to_world } = self.instances[instance as usize];
        self.meshes[mesh as usize].corners(triangle as usize).map(|p| to_world.transform_point3(p))
    }

    /// All triangles at their places, and the instance and triangle of each.
    fn flattened(&self) -> (Mesh, Vec<(u32, u32)>) {
        let (mut flat, mut origin) = (Mesh::default(), Vec::new());
        for (number, instance) in self.instances.iter().enumerate() {
            for triangle in 0..self.meshes[instance.mesh as usize].triangles.len() as u32 {
                flat.add(self.corners(number as u32, triangle));
                origin.push((number as u32, triangle));
            }
        }
        (flat, origin)
    }
}

fn placed(meshes: Vec<Mesh>, instances: Vec<Instance>) -> Placed {
    let build = |mesh: &Mesh| Arc::new(TriangleBvh::build(&mesh.positions, &mesh.triangles).unwrap());
    Placed { trees: meshes.iter().map(build).collect(), meshes, instances }
}

/// A map with different scales along its axes, mirrored every other time, sheared every third.
fn map(random: &mut Random, number: usize, size: f32) -> Affine3 {
    let turn = |random: &mut Random| Quat::from_axis_angle(random.direction(), 6.0 * random.unit());
    let mut scale = size * (Vec3::splat(0.3) + 1.4 * Vec3::new(random.unit(), random.unit(), random.unit()));
    if number.is_multiple_of(2) {
        scale.x = -scale.x;
    }
    let mut linear = Mat3::from_quat(turn(random)) * Mat3::from_diagonal(scale);
    if number.is_multiple_of(3) {
        linear *= Mat3::from_quat(turn(random));
    }
    Affine3 { matrix3: linear, translation: random.cube() }
}

fn scenes() -> Vec<(&'static str, Placed)> {
    let meshes = || vec![closed_surface(Vec3::ZERO, 12, |_| 1.0), soup(60, 0.5, 3), grid(4, 1, 0.0)];
    let many = |count: usize, size: f32, seed: u64| {
        let mut random = Random(seed);
        let instances = (0..count).map(|number| Instance {
            mesh: random.below(3) as u32,
            to_world: map(&mut random, number, size),
        });
        placed(meshes(), instances.collect())
    };
    vec![("one", many(1, 0.8, 1)), ("few, overlapping", many(7, 0.6, 2)), ("many small", many(500, 0.08, 3))]
}

fn rays(random: &mut Random, scene: &Placed, count: usize) -> Vec<Ray> {
    (0..count)
        .map(|_| {
            let origin = 1.8 * random.cube();
            let instance = random.below(scene.instances.len());
            let mesh = &scene.meshes[scene.instances[instance].mesh as usize];
            let [a, b, c] = scene.corners(instance as u32, random.below(mesh.triangles.len()) as u32);
            let target = a + 0.6 * random.unit() * (b - a) + 0.4 * random.unit() * (c - a);
            let mut ray = ray(origin, target - origin);
            if random.below(3) == 0 {
                ray.t_min = 0.4 * random.unit();
                ray.t_max = 3.0 * random.unit();
            }
            ray
        })
        .collect()
}

/// The same hits as the flattened scene's. Positions are off by a few units in the last place (2^-24) of coordinates up
/// to 4, maps stretch one way up to six times as much as another, and a ray that grazes a triangle moves along it: a
/// hit that only one of the two finds lies at an edge, within 1e-3 in barycentric units, or where two triangles cross or
/// lie in each other: at the same distance, up to 1e-5.
#[test]
fn instances_are_hit_as_their_triangles_at_their_places() {
    for (name, scene) in scenes() {
        let (flat, origin) = scene.flattened();
        let whole = TriangleBvh::build(&flat.positions, &flat.triangles).unwrap();
        let bvh = scene.build(None);
        let (mut hits, mut doubtful) = (0, 0);
        for ray in rays(&mut Random(11), &scene, 4000) {
            let (found, expected) = (bvh.closest(&ray), whole.closest(&ray));
            assert_eq!(bvh.occluded(&ray), found.is_some(), "{name}: {ray:?}");
            if let Some(InstanceHit { instance, hit }) = found {
                // Where it says, on the triangle that it names.
                let [a, b, c] = scene.corners(instance, hit.triangle);
                let on_triangle = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
                let on_ray = ray.origin + ray.direction * hit.t;
                let size = (b - a).length().max((c - a).length());
                let cos = (b - a).cross(c - a).normalize_or_zero().dot(ray.direction).abs().max(1e-3);
                let off = (on_triangle - on_ray).length();
                assert!(off < 1e-5 / cos * (1.0 + size), "{name}: {ray:?}: {off} off");
                assert!(hit.t > ray.t_min && hit.t < ray.t_max);
            }
            let same = match (found, expected) {
                (None, None) => true,
                (Some(found), Some(expected)) => {
                    let (instance, triangle) = origin[expected.triangle as usize];
                    (found.instance, found.hit.triangle) == (instance, triangle)
                        && (found.hit.t - expected.t).abs() < 1e-4 * (1.0 + expected.t)
                }
                _ => false,
            };
            hits += usize::from(found.is_some());
            if !same {
                let margin = |u: f32, v: f32| u.min(v).min(1.0 - u - v).abs() < 1e-3;
                let near_edge = found.is_some_and(|f| margin(f.hit.u, f.hit.v))
                    || expected.is_some_and(|e| margin(e.u, e.v));
                let coincide = found.zip(expected).is_some_and(|(f, e)| (f.hit.t - e.t).abs() < 1e-5);
                assert!(near_edge || coincide, "{name}: {ray:?} found {found:?}, not {expected:?}");
                doubtful += 1;
            }
        }
        assert!(hits > 1500, "{name}: {hits} hits test little");
        assert!(doubtful <= 8, "{name}: {doubtful} hits differ");
    }
}

#[test]
fn all_kernels_give_the_same_bits() {
    let bits = |hit: Option<InstanceHit>| {
        hit.map(|h| (h.instance, h.hit.t.to_bits(), h.hit.u.to_bits(), h.hit.v.to_bits(), h.hit.triangle))
    };
    for (name, scene) in scenes() {
        let rays = rays(&mut Random(23), &scene, 3000);
        let reference = scene.build(Some(Kernel::Portable));
        for kernel in Kernel::available() {
            let bvh = scene.build(Some(kernel));
            assert_eq!(bvh.kernel(), kernel);
            for ray in &rays {
                let hit = bvh.closest(ray);
                assert_eq!(bits(hit), bits(reference.closest(ray)), "{name}, {kernel}: {ray:?}");
                assert_eq!(bvh.occluded(ray), hit.is_some(), "{name}, {kernel}: {ray:?}");
            }
        }
    }
}

/// Of instances at the same place the first is hit, wherever they are in the tree.
#[test]
fn ties_go_to_the_lowest_number() {
    let mut random = Random(5);
    let here = |mesh| Instance { mesh, to_world: Affine3::from_translation(Vec3::X) };
    let mut instances: Vec<Instance> =
        (0..40).map(|n| Instance { mesh: 1, to_world: map(&mut random, n, 0.1) }).collect();
    for at in [7, 13, 29] {
        instances[at] = here(0);
    }
    let scene = placed(vec![grid(4, 0, 0.0), soup(20, 0.5, 3)], instances);
    for kernel in Kernel::available() {
        let bvh = scene.build(Some(kernel));
        for _ in 0..200 {
            let target = Vec3::new(1.0, 0.9 * random.cube().y, 0.9 * random.cube().z);
            let ray = Ray { t_min: 2.0, ..ray(target + 3.0 * Vec3::X, Vec3::NEG_X + 0.1 * random.cube()) };
            if let Some(hit) = bvh.closest(&ray) {
                assert!(hit.instance == 7 || !matches!(hit.instance, 13 | 29), "{kernel}: {hit:?}");
            }
        }
        let hit = bvh.closest(&ray(Vec3::new(5.0, 0.123, 0.321), Vec3::NEG_X)).unwrap();
        assert_eq!((hit.instance, hit.hit.t), (7, 4.0), "{kernel}");
    }
}

/// No ray leaves a closed mesh, however it is stretched, turned and mirrored.
#[test]
fn instances_are_watertight() {
    let mut random = Random(9);
    let instances = (0..20).map(|n| Instance { mesh: 0, to_world: map(&mut random, n, 0.5) }).collect();
    let scene = placed(vec![closed_surface(Vec3::ZERO, 10, |_| 1.0)], instances);
    for number in 0..20 {
        let alone = placed(vec![scene.meshes[0].clone()], vec![scene.instances[number]]);
        let bvh = alone.build(None);
        for index in 0..1000 {
            let origin = alone.instances[0].to_world.transform_point3(0.3 * random.cube());
            // At vertices, edges and inner points.
            let [a, b, c] = alone.corners(0, random.below(alone.meshes[0].triangles.len()) as u32);
            let target = match index % 3 {
                0 => a,
                1 => a + random.unit() * (b - a),
                _ => (a + b + c) / 3.0,
            };
            let ray = ray(origin, target - origin);
            assert!(bvh.closest(&ray).is_some() && bvh.occluded(&ray), "{ray:?} leaves instance {number}");
        }
    }
}

#[test]
fn a_million_instances_take_a_few_hundred_megabytes() {
    let mesh = closed_surface(Vec3::ZERO, 5, |_| 1.0);
    let mut random = Random(1);
    let instances: Vec<Instance> = (0..1_000_000)
        .map(|n| {
            let mut to_world = map(&mut random, n, 0.003);
            to_world.translation *= 5.0;
            Instance { mesh: 0, to_world }
        })
        .collect();
    let scene = placed(vec![mesh], instances);
    let bvh = scene.build(None);
    let mib = bvh.memory_bytes() as f64 / f64::from(1 << 20);
    assert!(mib < 220.0, "{mib:.0} MiB");
    // Of rays aimed at instances, all end there or before.
    for ray in rays(&mut random, &scene, 500).into_iter().filter(|ray| ray.t_max.is_infinite()) {
        assert!(bvh.closest(&ray).is_some(), "{ray:?}");
    }
}

#[test]
fn nothing_is_found_where_nothing_is() {
    let empty = InstanceBvh::build(Vec::new(), &[]).unwrap();
    let one = ray(Vec3::ZERO, Vec3::Z);
    assert!(empty.closest(&one).is_none() && !empty.occluded(&one) && empty.bounds().is_none());
    // Meshes without triangles, among others.
    let instance =
        |mesh, x: f32| Instance { mesh, to_world: Affine3::from_translation(Vec3::new(x, 0.0, 2.0)) };
    let scene = placed(
        vec![Mesh::default(), grid(2, 2, 0.0)],
        vec![instance(0, 0.0), instance(0, 0.1), instance(1, 0.0), instance(0, 3.0)],
    );
    let bvh = scene.build(None);
    let hit = bvh.closest(&ray(Vec3::new(0.3, 0.2, 0.0), Vec3::Z)).unwrap();
    assert_eq!((hit.instance, hit.hit.t), (2, 2.0));
    let (low, high) = bvh.bounds().unwrap();
    assert_eq!((low, high), (Vec3::new(-1.0, -1.0, 2.0), Vec3::new(1.0, 1.0, 2.0)));
}

#[test]
fn bad_instances_are_refused() {
    let scene = placed(vec![grid(2, 2, 0.0)], Vec::new());
    let build = |mesh, to_world| {
        let good = Instance { mesh: 0, to_world: Affine3::IDENTITY };
        InstanceBvh::build(scene.trees.clone(), &[good, Instance { mesh, to_world }]).err()
    };
    let missing = BuildError::MeshOutOfRange { instance: 1, mesh: 4, count: 1 };
    assert_eq!(build(4, Affine3::IDENTITY), Some(missing));
    let flat = BuildError::NotInvertible { instance: 1 };
    for to_world in [
        Affine3::from_scale(Vec3::new(1.0, 0.0, 1.0)),
        Affine3::from_translation(Vec3::new(0.0, f32::NAN, 0.0)),
        Affine3 { matrix3: Mat3::from_cols(Vec3::X, Vec3::Y, Vec3::X + Vec3::Y), ..Affine3::IDENTITY },
        Affine3::from_scale(Vec3::splat(f32::INFINITY)),
    ] {
        assert_eq!(build(0, to_world), Some(flat.clone()), "{to_world:?}");
    }
    let far = Affine3::from_translation(Vec3::X * 2.0 * LARGEST_COORDINATE);
    assert_eq!(build(0, far), Some(BuildError::InstanceTooFar { instance: 1 }));
    // Thin is not flat.
    assert_eq!(build(0, Affine3::from_scale(Vec3::new(1e-9, 1.0, 1e6))), None);
}
