//! Meshes with parts and materials, written for other programs and read back.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use std::fs;

use fluorspar_anatomy::{MouthParameters, generate_mouth};
use fluorspar_format::{NamedMesh, read_gltf, read_obj, write_gltf, write_obj, write_pbrt};

#[test]
fn parts_and_materials_reach_other_programs() {
    let folder = tempfile::tempdir().unwrap();
    let mouth = generate_mouth(&MouthParameters { detail: 0.3, ..MouthParameters::default() }).unwrap();
    let meshes: Vec<NamedMesh<'_>> = mouth
        .parts
        .iter()
        .map(|part| NamedMesh {
            name: &part.name,
            material: part.tissue.name(),
            color: if part.name.starts_with("tooth") { [0.8, 0.7, 0.6] } else { [0.5, 0.2, 0.1] },
            mesh: &part.mesh,
        })
        .collect();
    let triangles: usize = mouth.parts.iter().map(|part| part.mesh.triangles.len()).sum();
    let path = |name: &str| folder.path().join(name);

    write_gltf(&path("mouth.glb"), &meshes).unwrap();
    let back = read_gltf(&path("mouth.glb"), 1.0).unwrap();
    assert_eq!(back.triangles.len(), triangles);
    assert_eq!(back.positions[0], mouth.parts[0].mesh.positions[0]);
    assert_eq!(back.uvs.len(), back.positions.len());
    let glb = fs::read(path("mouth.glb")).unwrap();
    let text = String::from_utf8_lossy(&glb);
    for what in ["\"tongue_dorsum\"", "\"tooth_11\"", "baseColorFactor", "0.8,0.7,0.6"] {
        assert!(text.contains(what), "{what}");
    }

    write_obj(&path("mouth.obj"), &meshes).unwrap();
    let back = read_obj(&path("mouth.obj"), 1.0).unwrap();
    assert_eq!(back.triangles.len(), triangles);
    assert_eq!(back.positions[0], mouth.parts[0].mesh.positions[0]);
    let obj = fs::read_to_string(path("mouth.obj")).unwrap();
    assert!(obj.contains("mtllib mouth.mtl") && obj.contains("o tooth_11\nusemtl tooth"));
    let library = fs::read_to_string(path("mouth.mtl")).unwrap();
    assert!(library.contains("newmtl tooth\nKd 0.8000 0.7000 0.6000"), "{library}");
    assert_eq!(library.matches("newmtl").count(), {
        let mut names: Vec<_> = meshes.iter().map(|m| m.material).collect();
        names.sort_unstable();
        names.dedup();
        names.len()
    });

    write_pbrt(&path("mouth.pbrt"), &meshes).unwrap();
    let pbrt = fs::read_to_string(path("mouth.pbrt")).unwrap();
    assert_eq!(pbrt.matches("Shape \"trianglemesh\"").count(), meshes.len());
    assert!(pbrt.contains("MakeNamedMaterial \"tooth\" \"string type\" [ \"diffuse\" ] \"rgb reflectance\" [ 0.8000 0.7000 0.6000 ]"));

    let bad = [NamedMesh { color: [1.5, 0.0, 0.0], ..meshes[0] }];
    let error = write_pbrt(&path("bad.pbrt"), &bad).unwrap_err().to_string();
    assert!(error.contains("not between 0 and 1") && !path("bad.pbrt").exists(), "{error}");
}
