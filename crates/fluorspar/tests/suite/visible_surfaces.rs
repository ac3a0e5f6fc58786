//! The depth buffer of previews against traced rays, with all kinds of shapes and cameras.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::sync::Arc;

use fluorspar::geometry::{MeshInstance, MeshInstances, TriangleMesh};
use fluorspar::light::{Emitter, Light, LightGroup};
use fluorspar::material::Material;
use fluorspar::optics::PerspectiveCamera;
use fluorspar::render::{RenderSettings, visible_surfaces};
use fluorspar::scene::{Object, Scene, Shape};
use fluorspar::spectral::{Curve, WavelengthGrid};
use glam::{Affine3, Vec2, Vec3};

use crate::support::run;

/// A bumpy sheet that reaches behind the camera, instances of it, a ball and a disc.
fn scene(camera: PerspectiveCamera) -> Scene {
    let side = 40_u32;
    let at = |i: u32| i as f32 / side as f32;
    let points = (0..=side).flat_map(|y| (0..=side).map(move |x| (x, y)));
    let positions = points
        .clone()
        .map(|(x, y)| {
            Vec3::new(at(x) - 0.5, 0.1 * (9.0 * at(x)).sin() * (7.0 * at(y)).cos() - 0.3, 2.0 * at(y) - 1.0)
        })
        .collect();
    let uvs = points.map(|(x, y)| Vec2::new(at(x), at(y))).collect();
    let corner = |x: u32, y: u32| y * (side + 1) + x;
    let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
    let triangles = cells
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x, y + 1), corner(x + 1, y + 1)];
            [[a, b, d], [a, d, c]]
        })
        .collect();
    let mut mesh = TriangleMesh { positions, normals: Vec::new(), uvs, triangles };
    mesh.compute_smooth_normals();
    let place = |x: f32| MeshInstance {
        mesh: 0,
        to_world: Affine3 {
            matrix3: glam::Mat3::from_rotation_z(0.5) * 0.4,
            translation: Vec3::new(x, 0.3, 0.2),
        },
    };
    let mesh = Arc::new(mesh);
    let many = MeshInstances { meshes: vec![mesh.clone()], instances: vec![place(-0.3), place(0.4)] };
    let object = |name: &str, shape| Object { name: name.into(), shape, material: 0, emission: None };
    Scene {
        grid: WavelengthGrid::uniform(500.0, 600.0, 50.0).unwrap(),
        objects: vec![
            object("sheet", Shape::Mesh(mesh)),
            object("many", Shape::Instances(Arc::new(many))),
            object("ball", Shape::Sphere { center: Vec3::new(0.1, 0.1, -0.2), radius_m: 0.15 }),
            object(
                "disc",
                Shape::Disc {
                    center: Vec3::new(-0.2, 0.0, -0.1),
                    normal: Vec3::new(0.3, 0.2, 0.9).normalize(),
                    radius_m: 0.2,
                },
            ),
        ],
        materials: vec![Material::lambertian("gray", Curve::constant(0.5))],
        fluorophores: Vec::new(),
        light_groups: vec![LightGroup { name: "sky".into() }],
        lights: vec![Light {
            name: "sky".into(),
            group: 0,
            spectrum: Curve::constant(1.0),
            crossed_polarizers: false,
            emitter: Emitter::Environment,
        }],
        camera,
    }
}

/// The depth buffer sees what traced rays see, but at outlines.
#[test]
fn pixels_show_what_traced_rays_meet() {
    let camera =
        PerspectiveCamera::look_at(Vec3::new(0.1, 0.2, 0.8), Vec3::ZERO, Vec3::Y, 60.0, 120, 90).unwrap();
    let parallel = PerspectiveCamera { parallel_half_width_m: Some(0.6), ..camera.clone() };
    for camera in [camera, parallel] {
        let scene = scene(camera);
        let drawn = visible_surfaces(&scene, &scene.camera);
        let settings = RenderSettings { samples_per_pixel: 1, max_depth: 1, ..RenderSettings::default() };
        let traced = run(&scene, &settings).features;
        let pixels = drawn.part.len();
        let same = (0..pixels).filter(|&i| drawn.part[i] == traced.part[i]).count();
        assert!(same * 1000 >= pixels * 995, "{same} of {pixels}");
        assert!((1..=4).all(|part| drawn.part.contains(&part)));
        for i in (0..pixels).filter(|&i| drawn.part[i] == traced.part[i] && drawn.part[i] > 0) {
            let (a, b) = (drawn.depth_m[i], traced.depth_m[i]);
            // Where a sheet folds, the two may see either fold.
            if (a - b).abs() > 1e-3 {
                continue;
            }
            let (n, m) = (Vec3::from(drawn.normal[i]), Vec3::from(traced.normal[i]));
            assert!((a - b).abs() < 1e-4 * b && n.dot(m).abs() > 0.999, "{i}: {a} {b} {n} {m}");
        }
        let near = (0..pixels).filter(|&i| (drawn.depth_m[i] - traced.depth_m[i]).abs() < 1e-4).count();
        let dark = (0..pixels).filter(|&i| drawn.part[i] == 0 && traced.part[i] == 0).count();
        assert!((near + dark) * 1000 >= pixels * 990, "{near} + {dark} of {pixels}");
    }
}
