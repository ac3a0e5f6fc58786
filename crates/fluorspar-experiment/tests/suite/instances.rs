//! Meshes at many places: the image of the flattened scene, files, and what they refuse.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;
use std::sync::Arc;

use crate::support::{
    camera, coated, dye, flat, gaussian, light, object, quad, run, scene, settings, with_dyes,
};
use fluorspar::geometry::{MeshInstance, MeshInstances, TriangleMesh};
use fluorspar::image::ComponentImage;
use fluorspar::light::{DiscEmitter, Emitter};
use fluorspar::material::{Material, ScalarTexture};
use fluorspar::scene::{Object, Scene, Shape, SurfaceEmission};
use fluorspar::spectral::WavelengthGrid;
use fluorspar_experiment::{ResolvedExperiment, parse, resolve};
use fluorspar_format::{NamedMesh, read_gltf, read_gltf_instances, read_placements, write_gltf, write_ply};
use glam::{Affine3, Mat3, Quat, Vec2, Vec3};

/// A smooth bumpy ball with texture coordinates.
fn ball() -> Arc<TriangleMesh> {
    let (rows, columns) = (12, 24);
    let mut mesh = TriangleMesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
            let (sin_phi, cos_phi) = (std::f32::consts::TAU * u).sin_cos();
            let (sin_theta, cos_theta) = (std::f32::consts::PI * v).sin_cos();
            let direction = Vec3::new(sin_theta * cos_phi, cos_theta, sin_theta * sin_phi);
            mesh.positions.push(direction * (1.0 + 0.1 * (3.0 * direction.x).sin()));
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let a = row * (columns + 1) + column;
            let c = a + columns + 1;
            mesh.triangles.extend([[a, a + 1, c + 1], [a, c + 1, c]]);
        }
    }
    mesh.compute_smooth_normals();
    Arc::new(mesh)
}

/// Without normals and texture coordinates.
fn wedge() -> Arc<TriangleMesh> {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    Arc::new(TriangleMesh { positions, triangles, ..TriangleMesh::default() })
}

/// Stretched, turned, mirrored and sheared.
fn places() -> Vec<MeshInstance> {
    let at = |mesh, x: f32, y: f32, z: f32, linear: Mat3| MeshInstance {
        mesh,
        to_world: Affine3 { matrix3: linear, translation: Vec3::new(x, y, z) },
    };
    let turn = |angle: f32| Mat3::from_quat(Quat::from_axis_angle(Vec3::new(0.6, 0.8, 0.0), angle));
    let stretch = |x, y, z| Mat3::from_diagonal(Vec3::new(x, y, z));
    vec![
        at(0, -0.5, -0.6, 0.0, stretch(0.3, 0.3, 0.3)),
        at(0, 0.4, -0.5, 0.2, turn(0.7) * stretch(0.2, 0.5, 0.3)),
        at(0, -0.2, 0.3, -0.4, turn(2.0) * stretch(-0.3, 0.2, 0.4)),
        at(1, 0.3, 0.1, -0.3, turn(1.1) * stretch(0.6, -0.4, 0.5)),
        at(1, -0.7, -0.2, 0.3, turn(4.0) * stretch(0.5, 0.3, 0.3) * turn(0.4)),
    ]
}

fn many(places: Vec<MeshInstance>) -> MeshInstances {
    MeshInstances { meshes: vec![ball(), wedge()], instances: places }
}

/// An open box with things in it; `shape` makes their shape.
fn still_life(shape: impl Fn(MeshInstances) -> Shape, emission: Option<SurfaceEmission>) -> Scene {
    let grid = WavelengthGrid::uniform(380.0, 620.0, 20.0).unwrap();
    let mut scene = scene(grid, camera(Vec3::new(0.0, 0.0, 3.2), Vec3::ZERO, 42.0, 48));
    scene.fluorophores = vec![dye("dye", 390.0, 500.0, 0.3)];
    let checker = ScalarTexture::Checker { columns: 8, rows: 4, low: 0.2, high: 1.0 };
    let mut spotted = with_dyes(coated(0.5, 0.2), &[(0, 0.6)]);
    spotted.diffuse_mut().unwrap().reflectance[0].weight = checker.clone();
    let net = Material {
        opacity: Some(ScalarTexture::Checker { columns: 6, rows: 6, low: 0.3, high: 1.0 }),
        ..Material::lambertian("net", flat(0.5))
    };
    scene.materials = vec![Material::lambertian("wall", flat(0.6)), spotted, net];
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let low = Vec3::splat(-1.0);
    scene.objects = vec![
        object("floor", quad(low, z, x), 0),
        object("back", quad(low, x, y), 0),
        object("left", quad(low, y, z), 0),
    ];
    let (things, nets) = (places()[..4].to_vec(), places()[4..].to_vec());
    let emits = emission.is_some();
    scene.objects.push(Object { emission, ..object("things", shape(many(things)), usize::from(!emits)) });
    scene.objects.push(object("nets", shape(many(nets)), 0));
    if !emits {
        let disc = Emitter::Disc(DiscEmitter {
            center: Vec3::new(0.2, 0.95, 0.6),
            normal: Vec3::NEG_Y,
            radius_m: 0.5,
            exponent: 1.0,
        });
        scene.lights.push(light(gaussian(390.0, 15.0, 1.0), disc));
    }
    scene
}

fn instanced(many: MeshInstances) -> Shape {
    Shape::Instances(Arc::new(many))
}

fn flattened(many: MeshInstances) -> Shape {
    Shape::Mesh(Arc::new(many.flattened()))
}

/// Same paths up to rounding: nearly all pixels have nearly the same values, and the mean of the image agrees. A bounce
/// off a small ball makes a difference in direction about ten times as large, so single precision may have become 1e-3
/// after four of them. A path
/// whose rounding decides otherwise (an edge, a hole, the end by roulette) moves its pixel by about a sample, one of 16.
/// If that happens in 0.5 % of 48² pixels, with samples that scatter by four times their mean `m`, the mean of the image
/// moves by `sqrt(12) sqrt(2) 4 m / 16 / 48² = 5e-4 m`, and by 2e-3 `m` in less than one of 1000 cases.
fn assert_same_image(a: &ComponentImage, b: &ComponentImage) {
    assert_eq!(a.components, b.components);
    let parts = a.features.part.iter().zip(&b.features.part).filter(|(a, b)| a != b).count();
    assert!(parts <= 8, "{parts} pixels show another part");
    for component in 0..a.components.len() {
        let (a, b) = (a.component(component), b.component(component));
        let mean = a.iter().map(|&v| f64::from(v)).sum::<f64>() / a.len() as f64;
        let off = |(x, y): (&f32, &f32)| f64::from((x - y).abs()) > 1e-2 * f64::from(x.abs()) + 1e-3 * mean;
        let different = a.iter().zip(b.iter()).filter(|&pair| off(pair)).count() as f64 / a.len() as f64;
        assert!(different < 0.005, "component {component}: {different} of the values differ");
        let other = b.iter().map(|&v| f64::from(v)).sum::<f64>() / b.len() as f64;
        assert!((other - mean).abs() <= 2e-3 * mean, "component {component}: {mean} {other}");
    }
}

#[test]
fn instances_look_like_the_flattened_scene() {
    let settings = settings(16, 6);
    let placed = run(&still_life(instanced, None), &settings);
    let flat = run(&still_life(flattened, None), &settings);
    assert!(placed.component(1).iter().any(|&v| v > 0.0), "nothing fluoresces");
    assert!(placed.features.part.iter().filter(|&&part| part == 4).count() > 100);
    assert_same_image(&placed, &flat);
    let close = |(a, b): (&f32, &f32)| a == b || (a - b).abs() < 1e-5 * a.abs();
    let maps = (&placed.features, &flat.features);
    let depths = maps.0.depth_m.iter().zip(&maps.1.depth_m).filter(|&pair| close(pair)).count();
    assert!(depths + 4 >= 48 * 48, "{depths} of {} depths agree", 48 * 48);
    let normals = maps.0.normal.iter().zip(&maps.1.normal);
    let turned = normals.filter(|(a, b)| Vec3::from(**a).dot(Vec3::from(**b)) < 0.9999 && **a != **b).count();
    assert!(turned <= 8, "{turned} normals differ");
}

/// A mesh modeled far from its origin and carried back is lit as one modeled where it stands: rays leave it without
/// hitting the triangle they start from.
#[test]
fn meshes_far_from_their_origin_do_not_shadow_themselves() {
    let picture = |mesh: TriangleMesh, origin: Vec3| {
        // Maps by powers of two: what carries the mesh back is exact.
        let place = |scale: Vec3, at: Vec3| MeshInstance {
            mesh: 0,
            to_world: Affine3 { matrix3: Mat3::from_diagonal(scale), translation: at - scale * origin },
        };
        let instances = vec![
            place(Vec3::ONE, Vec3::new(-0.75, 0.0, 0.0)),
            place(Vec3::new(-0.5, 0.5, 0.5), Vec3::new(1.0, 0.25, 0.5)),
        ];
        let many = MeshInstances { meshes: vec![Arc::new(mesh)], instances };
        let grid = WavelengthGrid::uniform(500.0, 520.0, 20.0).unwrap();
        let mut scene = scene(grid, camera(Vec3::new(0.0, 0.0, 6.0), Vec3::ZERO, 40.0, 32));
        scene.materials = vec![Material::lambertian("white", flat(0.8))];
        scene.objects = vec![object("things", instanced(many), 0)];
        scene.lights = vec![light(flat(1.0), Emitter::Environment)];
        run(&scene, &settings(16, 4))
    };
    for distance in [50.0, 200.0, 1000.0] {
        let origin = distance * Vec3::new(1.0, -0.5, 1.0);
        let mut far = (*ball()).clone();
        far.positions.iter_mut().for_each(|p| *p += origin);
        let mut near = far.clone();
        // No rounding: the coordinates are smaller and as coarse.
        near.positions.iter_mut().for_each(|p| *p -= origin);
        assert_same_image(&picture(far, origin), &picture(near, Vec3::ZERO));
    }
}

/// Where a hole is, the bits of the ray decide: only means agree.
#[test]
fn instances_with_holes_let_as_much_light_through() {
    let with_holes = |shape: fn(MeshInstances) -> Shape| {
        let mut scene = still_life(shape, None);
        scene.objects[3].material = 2;
        let image = run(&scene, &settings(64, 4));
        let sum: f64 = image.component(0).iter().map(|&v| f64::from(v)).sum();
        (sum, image.features.part.iter().filter(|&&part| part == 4).count() as f64)
    };
    let ((a, part), (b, other)) = (with_holes(instanced), with_holes(flattened));
    // About 300 pixels of which each shows the thing or what is behind it: a standard deviation of 12 on the difference.
    assert!((part - other).abs() < 60.0, "{part} {other} pixels");
    // Paths differ where the thing is met: the error of the image's mean is far below a percent.
    assert!((a - b).abs() < 0.01 * a, "{a} {b}");
}

#[test]
fn lights_at_many_places_are_each_a_light() {
    let emission =
        Some(SurfaceEmission { group: 0, radiance: gaussian(390.0, 15.0, 0.3), is_one_sided: false });
    let placed = still_life(instanced, emission.clone());
    // Sampled triangle by triangle, so that even the bits agree.
    let image = run(&placed, &settings(16, 4));
    let flat = run(
        &still_life(
            |many| match many.instances.len() {
                4 => flattened(many),
                _ => instanced(many),
            },
            emission,
        ),
        &settings(16, 4),
    );
    assert_eq!(image.data, flat.data);
    assert!(image.component(0).iter().any(|&v| v > 0.0));
}

#[test]
fn objects_share_their_meshes_and_bad_instances_are_refused() {
    let mut scene = still_life(instanced, None);
    let Shape::Instances(good) = scene.objects[3].shape.clone() else { panic!() };
    for (bad, message) in [
        (MeshInstance { mesh: 7, to_world: Affine3::IDENTITY }, "only 2 meshes"),
        (
            MeshInstance { mesh: 0, to_world: Affine3::from_scale(Vec3::new(1.0, 0.0, 1.0)) },
            "flattens the mesh",
        ),
    ] {
        let mut many = (*good).clone();
        many.instances.push(bad);
        scene.objects[3].shape = Shape::Instances(Arc::new(many));
        let error = scene.check().unwrap_err().to_string();
        assert!(error.contains("object \"things\"") && error.contains(message), "{error}");
    }
    // A light of very many triangles.
    let place = MeshInstance { mesh: 0, to_world: Affine3::from_scale(Vec3::splat(0.01)) };
    let crowd = many(vec![place; 40_000]);
    scene.objects[3].shape = Shape::Instances(Arc::new(crowd));
    assert!(scene.check().is_ok());
    scene.objects[3].emission = Some(SurfaceEmission { group: 0, radiance: flat(1.0), is_one_sided: false });
    let error = scene.check().unwrap_err().to_string();
    assert!(error.contains("23040000 triangles") && error.contains("fewer instances"), "{error}");
}

fn experiment(folder: &Path, object: &str) -> Result<ResolvedExperiment, String> {
    let text = format!(
        "format = 1\nbase = \"flat-patch\"\n[[material]]\nname = \"gray\"\nreflectance = 0.2\n[[material]]\nname = \"white\"\n\
         reflectance = 0.8\n[[object]]\nname = \"crowd\"\nmaterial = \"gray\"\n{object}"
    );
    let parsed = parse(&text, "t.toml", folder, &[]).map_err(|error| error.to_string())?;
    resolve(&parsed).map_err(|error| error.to_string())
}

fn instances_of<'s>(scene: &'s Scene, name: &str) -> (&'s MeshInstances, &'s str) {
    let object = scene.objects.iter().find(|object| object.name == name).unwrap();
    let Shape::Instances(many) = &object.shape else { panic!("{name} is not a crowd") };
    (many, &scene.materials[object.material].name)
}

#[test]
fn experiments_place_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_ply(&folder.join("ball.ply"), &ball()).unwrap();
    fs::write(
        folder.join("places.csv"),
        "# rows of matrices, mm\nxx,xy,xz,x,yx,yy,yz,y,zx,zy,zz,z\n1,0,0,10, 0,1,0,20, 0,0,1,30\n2;0;0;0;0;2;0;0;0;0;-2;5\n",
    )
    .unwrap();
    let text = "type = \"mesh\"\nfile = \"ball.ply\"\nunit_mm = 2.0\ninstance_file = \"places.csv\"\n\
                transform = { translate_mm = [1, 0, 0] }\n\
                [[object.instance]]\ntranslate_mm = [0, 5, 0]\nrotate_deg = [0, 0, 90]\nstretch = [3, 1, -1]\n\
                [[object.instance]]\npart = \"odd\"\nmaterial = \"white\"\n\
                matrix = [[1, 0, 0, 7], [0, 1, 0.5, 0], [0, 0, 1, 0]]\n";
    let resolved = experiment(folder, text).unwrap();
    let ((crowd, gray), (odd, white)) =
        (instances_of(&resolved.study.scene, "crowd"), instances_of(&resolved.study.scene, "odd"));
    assert_eq!((gray, white), ("gray", "white"));
    assert!(Arc::ptr_eq(&crowd.meshes[0], &odd.meshes[0]), "the mesh is there once");
    let map = |many: &MeshInstances, number: usize, p: Vec3| {
        many.instances[number].to_world.transform_point3(p) * 1e3
    };
    let near = |a: Vec3, b: Vec3| assert!((a - b).length() < 1e-4, "{a} {b}");
    assert_eq!((crowd.instances.len(), odd.instances.len()), (3, 1));
    // Stretched, turned, moved, then moved with all.
    near(map(crowd, 0, Vec3::new(1e-3, 0.0, 1e-3)), Vec3::new(1.0, 8.0, -1.0));
    near(map(crowd, 1, Vec3::ZERO), Vec3::new(11.0, 20.0, 30.0));
    near(map(crowd, 2, Vec3::splat(1e-3)), Vec3::new(3.0, 2.0, 3.0));
    near(map(odd, 0, Vec3::new(0.0, 0.0, 1e-3)), Vec3::new(8.0, 0.5, 1.0));
    // Written out and read again, it is the same experiment.
    let again = parse(&resolved.record.resolved_toml, "again", Path::new("/"), &[]).unwrap();
    assert_eq!(resolve(&again).unwrap().record.sha256, resolved.record.sha256);
    assert!(resolved.record.inputs.iter().any(|input| input.path.ends_with("places.csv")));

    for (object, message) in [
        (
            "type = \"sphere\"\nradius_mm = 1\n[[object.instance]]\n",
            "use a type that has it: mesh, quad, box",
        ),
        (
            "type = \"box\"\nsize_mm = [1, 1, 1]\n[[object.instance]]\nstretch = [1, 0, 1]\n",
            "every factor must be between",
        ),
        ("type = \"box\"\nsize_mm = [1, 1, 1]\n[[object.instance]]\nscale = 0\n", "must be between 1e-6"),
        (
            "type = \"box\"\nsize_mm = [1, 1, 1]\n[[object.instance]]\nmaterial = \"whit\"\n",
            "did you mean \"white\"?",
        ),
        (
            "type = \"box\"\nsize_mm = [1, 1, 1]\n[[object.instance]]\nmatrix = [[1,0,0,0],[0,1,0,0],[1,1,0,0]]\n",
            "its axes must span a volume",
        ),
        (
            "type = \"box\"\nsize_mm = [1, 1, 1]\n[[object.instance]]\nscale = 2\n\
             matrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0]]\n",
            "remove the other fields",
        ),
        (
            "type = \"box\"\nsize_mm = [1, 1, 1]\n[[object.instance]]\n[[object.instance]]\nmaterial = \"white\"\n",
            "give this one a `part` of its own",
        ),
        ("type = \"box\"\nsize_mm = [1, 1, 1]\ninstance_file = \"none.csv\"\n", "there is no such file"),
    ] {
        let error = experiment(folder, object).unwrap_err();
        assert!(error.contains(message) && error.contains("\"crowd\""), "{error}");
    }
}

#[test]
fn lists_of_places_are_read_and_explained() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut array = b"\x93NUMPY\x01\x00".to_vec();
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 4), }";
    let header = format!("{header:<117}\n");
    array.extend((header.len() as u16).to_le_bytes());
    array.extend(header.as_bytes());
    let row = |number: f32| [1.0, 0.0, 0.0, number, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0];
    array.extend([row(5.0), row(6.0)].as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    fs::write(path("p.npy"), array).unwrap();
    let places = read_placements(&path("p.npy"), 1e-3).unwrap();
    let second = Affine3 {
        matrix3: Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0)),
        translation: Vec3::new(0.006, 0.0, 0.0),
    };
    assert_eq!((places.len(), places[1]), (2, second));
    let twelve = "1 0 0 0 0 1 0 0 0 0 1 0\n";
    for (name, text, message) in [
        ("a.csv", "1,2,3\n".to_string(), "a.csv:1: a place has 12 numbers; this line has 3"),
        (
            "b.csv",
            format!("{twelve}{}", twelve.replace("0 0 1 0", "0 x 1 0")),
            "b.csv:2: \"x\" is not a number",
        ),
        ("c.csv", format!("{twelve}\n{}", twelve.replace("0 0 1 0", "0 inf 1 0")), "c.csv:3: place 1"),
        ("d.txt", "# nothing\n".into(), "holds no placements"),
        ("e.json", String::new(), "not a list of placements"),
    ] {
        fs::write(path(name), text).unwrap();
        let error = read_placements(&path(name), 1e-3).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// A file written by us, with more nodes.
fn with_nodes(folder: &Path, name: &str, change: impl Fn(&mut serde_json::Value, &mut Vec<u8>)) {
    let mesh = ball();
    let named = NamedMesh { name: "ball", material: "m", color: [0.5; 3], mesh: &mesh };
    write_gltf(&folder.join("plain.glb"), &[named]).unwrap();
    let bytes = fs::read(folder.join("plain.glb")).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut document: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let mut blob = bytes[20 + length + 8..].to_vec();
    change(&mut document, &mut blob);
    document["buffers"] = serde_json::json!([{ "uri": "b.bin", "byteLength": blob.len() }]);
    fs::write(folder.join("b.bin"), blob).unwrap();
    fs::write(folder.join(name), document.to_string()).unwrap();
}

#[test]
fn gltf_meshes_of_several_nodes_are_kept_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let json = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap();
    with_nodes(folder, "nodes.gltf", |document, _| {
        document["nodes"] = json(
            r#"[{ "mesh": 0, "translation": [1, 2, 3] },
                { "mesh": 0, "scale": [-1, 2, 0.5], "children": [2] },
                { "mesh": 0, "translation": [1, 2, 3] }]"#,
        );
        document["scenes"] = json(r#"[{ "nodes": [0, 1] }]"#);
    });
    let many = read_gltf_instances(&folder.join("nodes.gltf"), 0.1).unwrap();
    assert_eq!((many.meshes.len(), many.instances.len()), (1, 3));
    assert!(many.instances[1].mirrors());
    let flat = read_gltf(&folder.join("nodes.gltf"), 0.1).unwrap();
    let ours = many.flattened();
    assert_eq!(ours.triangles, flat.triangles);
    assert!(ours.positions.iter().zip(&flat.positions).all(|(a, b)| (*a - *b).length() < 1e-6));
    assert!(ours.normals.iter().zip(&flat.normals).all(|(a, b)| (*a - *b).length() < 1e-5));

    // A list of places.
    with_nodes(folder, "list.gltf", |document, blob| {
        let places: Vec<f32> = (0..30).map(|i| i as f32).collect();
        let start = blob.len();
        blob.extend(places.iter().flat_map(|v| v.to_le_bytes()));
        let views = document["bufferViews"].as_array_mut().unwrap();
        views.push(serde_json::json!({ "buffer": 0, "byteOffset": start, "byteLength": 120 }));
        let view = views.len() - 1;
        let accessors = document["accessors"].as_array_mut().unwrap();
        accessors.push(
            serde_json::json!({ "bufferView": view, "componentType": 5126, "count": 10, "type": "VEC3" }),
        );
        let accessor = accessors.len() - 1;
        document["nodes"] = serde_json::json!([{ "mesh": 0, "scale": [2, 2, 2], "extensions": {
            "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": accessor } } } }]);
    });
    let many = read_gltf_instances(&folder.join("list.gltf"), 1.0).unwrap();
    assert_eq!((many.meshes.len(), many.instances.len()), (1, 10));
    assert_eq!(many.instances[9].to_world.translation, 2.0 * Vec3::new(27.0, 28.0, 29.0));
    assert_eq!(
        read_gltf(&folder.join("list.gltf"), 1.0).unwrap().triangles.len(),
        10 * ball().triangles.len()
    );

    // One mesh at one place stays a mesh; several are a crowd.
    let shape = |file: &str| {
        let resolved =
            experiment(folder, &format!("type = \"mesh\"\nfile = \"{file}\"\nunit_mm = 1\n")).unwrap();
        resolved.study.scene.objects.iter().find(|object| object.name == "crowd").unwrap().shape.clone()
    };
    assert!(matches!(shape("plain.glb"), Shape::Mesh(_)));
    let Shape::Instances(many) = shape("nodes.gltf") else { panic!() };
    assert_eq!(many.instances.len(), 3);
}
