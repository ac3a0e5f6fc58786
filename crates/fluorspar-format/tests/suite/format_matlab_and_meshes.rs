//! MATLAB files of the ISET toolboxes, PLY and OBJ meshes.
//!
//! The files in `data/` hold made-up numbers; SciPy, hdf5storage and h5py wrote them.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};

use fluorspar::geometry::TriangleMesh;
use fluorspar_format::{
    FormatError, LeftOutFaces, SpectrumOptions, read_iset_fluorophore, read_obj, read_ply,
    read_ply_leniently, read_spectra, read_stl, write_ply,
};
use glam::{Vec2, Vec3};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

#[test]
fn obj_attributes_are_kept_when_every_corner_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.obj");
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -3//1 -2//1 -1//1\n";
    fs::write(&path, text).unwrap();
    let mesh = read_obj(&path, 1.0).unwrap();
    assert!(mesh.uvs.is_empty() && mesh.normals.iter().all(|&normal| normal == Vec3::Z));
}

/// What a reader says about a file with this content, its folder left out.
fn complaint<T: std::fmt::Debug>(
    name: &str,
    content: &[u8],
    read: impl Fn(&Path) -> Result<T, FormatError>,
) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    let error = read(&path).expect_err("a bad file was read");
    error.to_string().replace(&format!("{}/", folder.path().display()), "")
}

const EXCITATION: [f64; 6] = [1.0, 0.8, 0.5, 0.2, 0.1, 0.0];
const EMISSION: [f64; 6] = [0.0, 0.1, 0.6, 1.0, 0.7, 0.3];

#[test]
fn fluorophores_of_every_matlab_format_are_the_same() {
    for (name, qe) in [("iset_v5.mat", 1.0), ("iset_v7_struct.mat", 0.5), ("iset_v73.mat", 0.5)] {
        let fl = read_iset_fluorophore(&data(name)).unwrap();
        assert_eq!((fl.name.as_str(), fl.solvent.as_str(), fl.qe), ("testphore", "PBS", Some(qe)), "{name}");
        assert_eq!(fl.wave_nm, [400.0, 420.0, 440.0, 460.0, 480.0, 500.0]);
        assert_eq!(fl.excitation.as_deref(), Some(&EXCITATION[..]));
        let emission = fl.emission.unwrap();
        assert!(emission.iter().zip(EMISSION).all(|(a, b)| (a - b).abs() < 1e-7), "{name}: {emission:?}");
        let eem = fl.eem.unwrap();
        for em in 0..6 {
            for ex in 0..6 {
                let expected = if em > ex { EMISSION[em] * EXCITATION[ex] } else { 0.0 };
                assert!((eem[em * 6 + ex] - expected).abs() < 1e-15, "{name}: {em} {ex}");
            }
        }
        assert!(fl.comment.contains("for tests") && !fl.emission_only);
    }
    assert!(read_iset_fluorophore(&data("iset_v73.mat")).unwrap().comment.contains('µ'));
}

#[test]
fn a_constant_excitation_is_no_excitation() {
    let fl = read_iset_fluorophore(&data("iset_emission_only.mat")).unwrap();
    assert!(fl.emission_only && fl.eem.is_none());
    assert_eq!(fl.excitation, Some(vec![1.0; 6]));
}

#[test]
fn matlab_spectra_are_columns() {
    for name in ["spectra_v5.mat", "spectra_v73.mat"] {
        let spectra = read_spectra(&data(name), &SpectrumOptions::default()).unwrap();
        assert_eq!(spectra.curves.len(), 2);
        assert_eq!(spectra.curves[0].curve.values(), EMISSION);
        assert_eq!(spectra.curves[1].curve.values(), EMISSION.map(|v| 2.0 * v + 1.0));
    }
}

#[test]
fn bad_matlab_files_are_explained() {
    let v5 = fs::read(data("iset_v5.mat")).unwrap();
    let v4 = fs::read(data("spectra_v4.mat")).unwrap();
    let mut no_order = v5.clone();
    no_order[126] = b'X';
    // The second `wave` value, 420 nm, becomes 400 nm as the first.
    let wave = v5.windows(4).position(|bytes| bytes == [0x90, 1, 0xa4, 1]).unwrap();
    let mut twice = v5.clone();
    twice[wave + 2] = 0x90;
    let cases: &[(&[u8], &str)] = &[
        (b"", "f.mat: the file is empty. Copy the file again"),
        (
            b"hello, this is text and nothing else",
            "f.mat: this is not a MATLAB file. Save it in MATLAB with save(..., '-v7'), or in Python with scipy.io.savemat",
        ),
        (&v4, "f.mat: this is a MATLAB version 4 file. Load it in MATLAB and save it with save(..., '-v7')"),
        (&v5[..100], "f.mat: the header has 100 of 128 bytes. Copy the file again"),
        (&v5[..132], "f.mat: the variable at byte 128 is cut off. Copy the file again"),
        (&v5[..150], "f.mat: the variable at byte 128 claims 64 bytes but 14 follow. Copy the file again"),
        (&no_order, "f.mat: the header names no byte order. Copy the file again"),
        (&v5[..128], "f.mat: there is no variable or field \"emission\". The file holds: nothing"),
        (&twice, "f.mat: the wavelength 400 nm appears twice. Keep one value per wavelength"),
        (
            &fs::read(data("spectra_v5.mat")).unwrap(),
            "f.mat: there is no variable or field \"emission\". The file holds: wavelength, data, comment",
        ),
    ];
    for (content, expected) in cases {
        assert_eq!(complaint("f.mat", content, read_iset_fluorophore), *expected);
    }
    assert_eq!(
        complaint("f.mat", &v5, |path| read_spectra(path, &SpectrumOptions::default())),
        "f.mat: there is no variable or field \"data\". \
         The file holds: name, type, solvent, wave, excitation, emission, qe, comment, eem"
    );
    let v73 = fs::read(data("iset_v73.mat")).unwrap();
    let said = complaint("f.mat", &v73[..700], read_iset_fluorophore);
    assert!(said.starts_with("f.mat: the MATLAB 7.3 data can't be read: "), "{said}");
}

const ASCII_PLY: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 5\nproperty float x\n\
    property float y\nproperty float z\nproperty uchar red\nproperty float s\nproperty float t\n\
    element face 2\nproperty list uchar int vertex_index\nend_header\n\
    0 0 0 255 0 0\n1000 0 0 255 1 0\n1000 1000 0 255 1 1\n0 1000 0 255 0 1\n500 500 500 255 0.5 0.5\n\
    4 0 1 2 3\n3 0 1 4\n";

#[test]
fn text_ply_in_millimeters_becomes_meters() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ply");
    fs::write(&path, ASCII_PLY).unwrap();
    let mesh = read_ply(&path, 0.001).unwrap();
    assert_eq!(mesh.positions[2], Vec3::new(1.0, 1.0, 0.0));
    assert_eq!(mesh.uvs[4], Vec2::splat(0.5));
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
    assert!(mesh.normals.is_empty());
}

/// As C prints and reads them, in all formats of text.
#[test]
fn numbers_without_digits_on_one_side_of_the_point_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n-.5 .25e1 0\n1. -1. +2.e-1\n.75 1 0.\n3 0 1 2\n";
    fs::write(path("m.ply"), ply).unwrap();
    fs::write(path("m.obj"), "v -.5 .25e1 0\nv 1. -1. +2.e-1\nv .75 1 0.\nf 1 2 3\n").unwrap();
    let stl = "solid s\nfacet normal 0 0 1\nouter loop\nvertex -.5 .25e1 0\nvertex 1. -1. +2.e-1\nvertex .75 1 0.\n\
        endloop\nendfacet\nendsolid s\n";
    fs::write(path("m.stl"), stl).unwrap();
    let expected = [Vec3::new(-0.5, 2.5, 0.0), Vec3::new(1.0, -1.0, 0.2), Vec3::new(0.75, 1.0, 0.0)];
    let meshes =
        [read_ply(&path("m.ply"), 1.0), read_obj(&path("m.obj"), 1.0), read_stl(&path("m.stl"), 1.0)];
    for mesh in meshes {
        assert_eq!(mesh.unwrap().positions, expected);
    }
    let dots = ply.replace("1. -1.", "1. .");
    let said = complaint("m.ply", dots.as_bytes(), |path| read_ply(path, 1.0));
    assert!(said.starts_with("m.ply:11: not a valid PLY file"), "{said}");
}

/// A square of side 2 without the triangle (1, 1), (0.9, -0.9), (-1, 1) of area 1.9, which a fan would cover.
#[test]
fn concave_polygons_are_covered_once() {
    let folder = tempfile::tempdir().unwrap();
    let (ply, obj) = (folder.path().join("m.ply"), folder.path().join("m.obj"));
    let corners = "-1 -1 0\n1 -1 0\n1 1 0\n0.9 -0.9 0\n-1 1 0\n";
    let head = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 5\n\
        property float x\nproperty float y\nproperty float z\nend_header\n5 0 1 2 3 4\n";
    fs::write(&ply, format!("{head}{corners}")).unwrap();
    let vertices: String = corners.lines().map(|line| format!("v {line}\n")).collect();
    fs::write(&obj, format!("{vertices}f 1 2 3 4 5\nf 1 2 5\nl 1 2\np 3\n")).unwrap();
    let mesh = read_ply(&ply, 1.0).unwrap();
    assert!((mesh.area_m2() - 2.1).abs() < 1e-6, "{mesh:?}");
    let mesh = read_obj(&obj, 1.0).unwrap();
    assert!((mesh.area_m2() - 4.1).abs() < 1e-6, "{mesh:?}");
}

#[test]
fn faces_without_area_can_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ply");
    let faces =
        ASCII_PLY.replace("element face 2", "element face 4").replace("3 0 1 4\n", "0\n3 0 1 4\n2 0 1\n");
    fs::write(&path, &faces).unwrap();
    let read = read_ply_leniently(&path).unwrap();
    assert_eq!(read.mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
    assert_eq!(read.left_out, Some(LeftOutFaces { count: 2, first: 1, corners: 0 }));
    let said = complaint("m.ply", faces.as_bytes(), |path| read_ply(path, 1.0));
    assert!(said.starts_with("m.ply: face 1 has 0 corners. Faces need three or more"), "{said}");
    fs::write(
        &path,
        ASCII_PLY.replace("element face 2", "element face 0").replace("4 0 1 2 3\n3 0 1 4\n", ""),
    )
    .unwrap();
    let read = read_ply_leniently(&path).unwrap();
    assert!(read.mesh.triangles.is_empty() && read.left_out.is_none() && read_ply(&path, 1.0).is_err());
}

#[test]
fn binary_ply_is_read_in_both_byte_orders() {
    let folder = tempfile::tempdir().unwrap();
    for (order, big) in [("binary_big_endian", true), ("binary_little_endian", false)] {
        let mut bytes = format!(
            "ply\nformat {order} 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
             element face 1\nproperty list int uint vertex_indices\nend_header\n"
        )
        .into_bytes();
        for value in [0.0_f64, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0] {
            bytes.extend(if big { value.to_be_bytes() } else { value.to_le_bytes() });
        }
        for value in [3_u32, 0, 1, 2] {
            bytes.extend(if big { value.to_be_bytes() } else { value.to_le_bytes() });
        }
        let path = folder.path().join("m.ply");
        fs::write(&path, bytes).unwrap();
        let mesh = read_ply(&path, 1.0).unwrap();
        assert_eq!(
            (mesh.positions[2], mesh.triangles),
            (Vec3::new(0.0, 2.0, 0.0), vec![[0, 1, 2]]),
            "{order}"
        );
    }
}

#[test]
fn a_written_ply_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ply");
    let mut mesh = TriangleMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.1, 0.2, 0.3)],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE],
        triangles: vec![[0, 1, 2], [1, 3, 2]],
        ..TriangleMesh::default()
    };
    write_ply(&path, &mesh).unwrap();
    assert_eq!(read_ply(&path, 1.0).unwrap(), mesh);
    mesh.normals = vec![Vec3::Z; 4];
    write_ply(&path, &mesh).unwrap();
    assert_eq!(read_ply(&path, 1.0).unwrap(), mesh);
    mesh.triangles[0][0] = 9;
    let target = folder.path().join("new.ply");
    let error = write_ply(&target, &mesh).unwrap_err().to_string();
    assert!(error.ends_with(
        "new.ply: nothing was written: triangle 0 uses vertex 9, but the mesh has only 4 vertices (numbered from 0). \
         Fix the mesh first"
    ));
    assert!(!target.exists());
}

#[test]
fn bad_ply_files_are_explained() {
    let ply = |from: &str, to: &str| ASCII_PLY.replacen(from, to, 1);
    let cases = [
        ("solid".to_string(), "m.ply: this is not a PLY file. A PLY file begins with the line \"ply\""),
        (ply("property float y\n", ""), "m.ply: vertices have no x, y, z. Export positions"),
        (
            ply("element vertex 5", "element vertex 5000000000"),
            "m.ply: the header claims 5000000000 elements \"vertex\" in 345 bytes. Copy the file again",
        ),
        (
            ply("3 0 1 4", "3 0 1 9"),
            "m.ply: triangle 2 uses vertex 9, but the mesh has only 5 vertices (numbered from 0). Fix the mesh or export it again",
        ),
        (
            ply("3 0 1 4", "3 0 -1 4"),
            "m.ply: face 1 names vertex -1. Vertices are numbered from 0: export the mesh again",
        ),
        (
            ply("3 0 1 4", "2 0 1"),
            "m.ply: face 1 has 2 corners. Faces need three or more: triangulate the mesh before exporting it",
        ),
        (
            ply("500 500 500", "500 nan 500"),
            "m.ply:18: not a valid PLY file: Couldn't read element line. Copy the file again, or export the mesh again",
        ),
    ];
    for (content, expected) in cases {
        assert_eq!(complaint("m.ply", content.as_bytes(), |path| read_ply(path, 0.001)), expected);
    }
    let truncated = &ASCII_PLY.as_bytes()[..ASCII_PLY.len() - 22];
    let said = complaint("m.ply", truncated, |path| read_ply(path, 1.0));
    assert!(said.starts_with("m.ply:18: not a valid PLY file: "), "{said}");
    assert_eq!(
        complaint("m.ply", ASCII_PLY.as_bytes(), |path| read_ply(path, 0.0)),
        "m.ply: the unit of length is 0 m. Give a positive length, for instance 0.001 for millimeters"
    );
}

const OBJ: &str = "# two shapes\nmtllib no.mtl\no square\nv 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nvt 0 0\nvt 1 0\n\
    vt 1 1\nvt 0 1\nusemtl skin\nf 1/1 2/2 3/3 4/4\no roof\nv 5 5 5\nf -5/1 -4/2 -1/3\n";

#[test]
fn obj_shapes_are_merged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.obj");
    fs::write(&path, OBJ).unwrap();
    let mesh = read_obj(&path, 0.1).unwrap();
    assert_eq!((mesh.positions.len(), mesh.uvs.len(), mesh.triangles.len()), (7, 7, 3));
    assert!((mesh.area_m2() - (1.0 + 0.5 * f64::hypot(0.5, 0.5))).abs() < 1e-6);
}

#[test]
fn bad_obj_files_are_explained() {
    let obj = |from: &str, to: &str| OBJ.replacen(from, to, 1);
    let cases = [
        ("".to_string(), "m.obj: the file is empty. Copy the file again"),
        ("v 0 0 0\n".into(), "m.obj: the mesh has no triangles. Fix the mesh or export it again"),
        (
            obj("v 10 10 0", "v 10 x 0"),
            "m.obj:6: not a valid OBJ file: position parse error. Export the mesh again",
        ),
        (
            obj("f 1/1 2/2 3/3", "f 1/1 2/2 9/3"),
            "m.obj:13: not a valid OBJ file: face vertex index out of bounds. Export the mesh again",
        ),
    ];
    for (content, expected) in cases {
        assert_eq!(complaint("m.obj", content.as_bytes(), |path| read_obj(path, 1.0)), expected);
    }
}
