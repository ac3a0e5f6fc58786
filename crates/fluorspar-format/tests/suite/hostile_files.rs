//! Files made to take a reader's time or memory: each is refused, or read, quickly and in little memory.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "these are tests")]

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use fluorspar_format::{
    FormatError, SpectrumColumns, SpectrumOptions, Transfer, read_gltf, read_gltf_instances, read_lens,
    read_obj, read_spectra, read_texture_png,
};

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn file(folder: &tempfile::TempDir, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    path
}

/// Largest memory of this process so far, bytes; `None` where the system does not tell.
fn peak_bytes() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? << 10)
}

/// What a reader says about a file, its folder left out; time and memory are bounded.
fn complaint<T: std::fmt::Debug>(path: &Path, read: impl FnOnce(&Path) -> Result<T, FormatError>) -> String {
    let begun = Instant::now();
    let said = read(path).map(|_| "nothing").expect_err("a hostile file was read").to_string();
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
    assert!(peak_bytes().is_none_or(|peak| peak < 1 << 30), "{:?}", peak_bytes());
    said.replace(&format!("{}/", path.parent().unwrap().display()), "")
}

/// A triangle in one buffer: three positions.
fn gltf(nodes: &str, buffer: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{nodes}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}}],"buffers":[{{"byteLength":36{buffer}}}]}}"#
    )
}

/// `[0 0 0], [1 0 0], [0 1 0]` in single precision, as base64.
const TRIANGLE: &str =
    r#","uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA""#;

#[test]
fn a_node_with_two_parents_is_refused() {
    let folder = folder();
    let twice = |i: usize| match i {
        59 => r#"{"mesh":0}"#.to_string(),
        i => format!(r#"{{"children":[{0},{0}]}}"#, i + 1),
    };
    let diamond: Vec<String> = (0..60).map(twice).collect();
    let circle = r#"{"children":[1]},{"children":[0]}"#;
    for (nodes, number) in [(diamond.join(","), 59), (circle.into(), 0)] {
        let path = file(&folder, "m.gltf", gltf(&nodes, TRIANGLE));
        let expected =
            format!("m.gltf: node {number} appears twice in its tree of nodes. Give every node one parent");
        assert_eq!(complaint(&path, |path| read_gltf(path, 1.0)), expected);
        assert_eq!(complaint(&path, |path| read_gltf_instances(path, 1.0)), expected);
    }
}

#[test]
fn embedded_buffers_are_read_and_missing_ones_named() {
    let folder = folder();
    let mesh = read_gltf(&file(&folder, "m.gltf", gltf(r#"{"mesh":0}"#, TRIANGLE)), 1.0).unwrap();
    assert_eq!((mesh.positions.len(), mesh.positions[1].x, mesh.positions[2].y), (3, 1.0, 1.0));
    for (buffer, expected) in [
        (r#","uri":"none.bin""#, "the file \"none.bin\" of buffer 0 is missing. Put it next to this file"),
        ("", "buffer 0 has no content: it has no URI, and there is no binary part for it"),
        (r#","uri":"data:;base64,A*""#, "buffer 0 is not valid base64: "),
        (r#","uri":"data:text/plain,abc""#, "buffer 0 is a data URI without base64"),
        (r#","uri":"../x.bin""#, "the file \"../x.bin\" of buffer 0 is not next to the file"),
    ] {
        let path = file(&folder, "m.gltf", gltf(r#"{"mesh":0}"#, buffer));
        let said = complaint(&path, |path| read_gltf(path, 1.0));
        assert!(said.starts_with(&format!("m.gltf: {expected}")), "{said}");
    }
}

#[test]
fn elements_lie_one_after_the_other_in_their_buffer() {
    let folder = folder();
    let good = gltf(r#"{"mesh":0}"#, TRIANGLE);
    for (from, to) in [
        (r#""byteLength":36}]"#, r#""byteLength":36,"byteStride":0}]"#),
        (r#""count":3"#, r#""count":4000000000"#),
        (r#""bufferView":0"#, r#""bufferView":0,"byteOffset":18446744073709551615"#),
    ] {
        let path = file(&folder, "m.gltf", good.replacen(from, to, 1));
        assert_eq!(
            complaint(&path, |path| read_gltf(path, 1.0)),
            "m.gltf: accessor 0 is damaged or compressed. Export the mesh again, uncompressed"
        );
    }
}

#[test]
fn indices_beyond_all_meshes_are_not_computed_with() {
    let folder = folder();
    for corner in [
        "9223372036854775807",
        "-9223372036854775808",
        "1//9223372036854775807",
        "99999999999",
        "-1//-11",
        "-1/-1",
        "-4",
    ] {
        let path = file(&folder, "m.obj", format!("v 0 0 0\nv 1 0 0\nv 1 1 0\nvn 0 0 1\nf 1 2 {corner}\n"));
        assert_eq!(
            complaint(&path, |path| read_obj(path, 1.0)),
            "m.obj:5: not a valid OBJ file: face vertex index out of bounds. Export the mesh again"
        );
    }
}

/// A PNG whose header says how large it is, and hardly more.
fn png_of(width: u32, height: u32, filler: usize) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |kind: &[u8; 4], content: &[u8]| {
        bytes.extend((content.len() as u32).to_be_bytes());
        let start = bytes.len();
        bytes.extend(kind);
        bytes.extend(content);
        let crc = bytes[start..].iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 }
            })
        });
        bytes.extend((!crc).to_be_bytes());
    };
    let size = [width.to_be_bytes(), height.to_be_bytes()].concat();
    chunk(b"IHDR", &[&size[..], &[8, 2, 0, 0, 0]].concat());
    chunk(b"IDAT", &vec![0; filler]);
    chunk(b"IEND", &[]);
    bytes
}

#[test]
fn a_png_is_judged_by_its_header() {
    let folder = folder();
    let path = file(&folder, "t.png", png_of(18_000, 18_000, 1 << 20));
    assert_eq!(
        complaint(&path, |path| read_texture_png(path, Transfer::Linear)),
        "t.png: 18000 x 18000 pixels take 4634 MiB of memory; the limit is 512 MiB. \
         Check that this is the right file and that it is complete"
    );
}

#[test]
fn long_tables_are_read_line_by_line_and_not_slower() {
    let folder = folder();
    let mut text = String::from("wavelength_nm,a\n");
    for line in 0..100_000 {
        writeln!(text, "{},\"0.5\"", 400.0 + f64::from(line) * 1e-3).unwrap();
    }
    let path = file(&folder, "long.csv", &text);
    let begun = Instant::now();
    let read = read_spectra(&path, &SpectrumOptions::default()).unwrap();
    assert_eq!(read.curves[0].curve.values().len(), 100_000);
    assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());

    text.push_str("900,\"0.5,1\n901,0.5\n");
    let path = file(&folder, "long.csv", &text);
    assert_eq!(
        complaint(&path, |path| read_spectra(path, &SpectrumOptions::default())),
        "long.csv:100002: column \"a\" holds \"0.5,1\", which is not a number. Write decimals with a point"
    );
    let wide = vec!["1"; 10_001].join(",");
    let path = file(&folder, "wide.csv", format!("{wide}\n{wide}\n"));
    assert!(
        complaint(&path, |path| read_spectra(path, &SpectrumOptions::default()))
            .starts_with("wide.csv: the header has 10001 columns; the limit is 10000 columns")
    );
}

#[cfg(unix)]
#[test]
fn a_link_to_an_endless_device_is_refused() {
    let folder = folder();
    let link = |name: &str| {
        let path = folder.path().join(name);
        std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
        path
    };
    let refused = ": this is a device; give a file";
    assert!(complaint(&link("s.csv"), |p| read_spectra(p, &SpectrumOptions::default())).ends_with(refused));
    assert!(
        complaint(&link("s.mat"), |path| read_spectra(path, &SpectrumOptions::default())).ends_with(refused)
    );
    assert!(complaint(&link("m.obj"), |path| read_obj(path, 1.0)).ends_with(refused));
    assert!(complaint(&link("t.png"), |path| read_texture_png(path, Transfer::Linear)).ends_with(refused));
    assert!(read_lens(&link("l.dat")).unwrap_err().to_string().ends_with(refused));
}

/// The bounds and the area of a glTF file of four whole-number corners of a unit square, with fields of accessor and primitive.
fn square(accessor: &str, primitive: &str) -> Result<(f32, f32), FormatError> {
    let folder = folder();
    let corners: Vec<u8> = [[0u16, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0]]
        .iter()
        .flat_map(|corner| corner.iter().flat_map(|value| value.to_le_bytes()).chain([0, 0]))
        .collect();
    std::fs::write(folder.path().join("my mesh.bin"), corners).unwrap();
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"scale":[0.5,0.5,0.5]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}{primitive}}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5123,"count":4,"type":"VEC3"{accessor}}}],
        "bufferViews":[{{"buffer":0,"byteLength":32,"byteStride":8}}],"buffers":[{{"byteLength":32,"uri":"my%20mesh.bin"}}]}}"#
    );
    let mesh = read_gltf(&file(&folder, "m.gltf", text), 1.0)?;
    let corner = |index: u32| mesh.positions[index as usize];
    let area = |t: &[u32; 3]| 0.5 * (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).z;
    let most = mesh.positions.iter().fold(0.0f32, |most, p| most.max(p.max_element()));
    Ok((most, mesh.triangles.iter().map(area).sum()))
}

/// Whole numbers are themselves unless they are said to be parts of the largest; strips and fans share corners; both face one way.
#[test]
fn gltf_shares_corners_and_keeps_whole_numbers() {
    assert_eq!(square("", r#","mode":5"#).unwrap(), (1.0, 1.0));
    // A fan over these corners goes over the square and back over half of it
    assert_eq!(square("", r#","mode":6"#).unwrap(), (1.0, 0.0));
    let (most, area) = square(r#","normalized":true"#, r#","mode":5"#).unwrap();
    assert!((most * 65535.0 - 1.0).abs() < 1e-3 && area > 0.0, "{most} {area}");
    let sparse = square(r#","sparse":{"count":1}"#, "").unwrap_err().to_string();
    assert!(sparse.contains("accessor 0 is sparse"), "{sparse}");
}

/// Words of a text STL lie in lines as they like, in any case; a name is any word.
#[test]
fn words_of_stl_lie_in_any_line() {
    let text = "SOLID vertex of mine\nfacet normal 0 0 1 outer loop vertex 0 0 0\nVERTEX 1 0\n0 vertex 0 1 0 endloop endfacet ENDSOLID vertex\n";
    let mesh = fluorspar_format::read_stl(&file(&folder(), "m.stl", text), 1.0).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.positions[1].to_array()), (1, [1.0, 0.0, 0.0]));
    let plain = "solid\nfacet normal 0 0 1\nvertex 0 0 0 # first\nvertex 1 0 0\nvertex 0 1 0\nendfacet\n";
    let mesh = fluorspar_format::read_stl(&file(&folder(), "m.stl", plain), 1.0).unwrap();
    assert_eq!(mesh.triangles.len(), 1);
    let folder = folder();
    let colored = file(&folder, "m.stl", plain.replace("1 0 0", "1 0 0 0.5 0.5 0.5"));
    assert!(complaint(&colored, |path| fluorspar_format::read_stl(path, 1.0)).contains("is not a vertex"));
}

#[test]
fn a_backslash_continues_a_line_of_obj() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 \\\r\n 2 \\\n 3\n";
    let mesh = fluorspar_format::read_obj(&file(&folder(), "m.obj", text), 1.0).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    // A comment ends with its line, and lines behind keep their numbers
    let text = "# from C:\\scans\\\nv 5 5 5\nv 1 0 0\nv 0 1 0\nf 1 \\\n2 3\nf 1 x 3\n";
    let folder = folder();
    let path = file(&folder, "m.obj", text);
    assert!(complaint(&path, |path| fluorspar_format::read_obj(path, 1.0)).starts_with("m.obj:7:"));
}

#[test]
fn what_is_no_number_is_refused_in_a_mask() {
    let folder = folder();
    let path = folder.path().join("m.npy");
    let mut bytes =
        b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }".to_vec();
    bytes.resize(127, b' ');
    bytes.push(b'\n');
    bytes.extend([f32::NAN, 1.0].iter().flat_map(|value| value.to_le_bytes()));
    std::fs::write(&path, bytes).unwrap();
    let said = fluorspar_format::read_mask(&path).unwrap_err().to_string();
    assert!(said.contains("m.npy: a value of the mask is NaN") && said.contains("Put 0"), "{said}");
}

/// A megabyte of TM-27 in one line took half a minute: its line was counted anew for each sample.
#[test]
fn a_long_line_of_tm_27_is_counted_once() {
    let samples: String = (0..40_000)
        .map(|k| format!("<SpectralData wavelength=\"{}\">0.5</SpectralData>", 400.0 + 0.01 * f64::from(k)))
        .collect();
    let text = format!(
        "<?xml version=\"1.0\"?>\n<IESTM2714 xmlns=\"iestm2714\" version=\"1.0\"><SpectralDistribution>\
         <SpectralQuantity>irradiance</SpectralQuantity>{samples}</SpectralDistribution></IESTM2714>"
    );
    let folder = folder();
    let begun = Instant::now();
    let options = SpectrumOptions { columns: SpectrumColumns::One, ..SpectrumOptions::default() };
    let read = read_spectra(&file(&folder, "s.spdx", text), &options).unwrap();
    assert_eq!(read.curves[0].curve.values().len(), 40_000);
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
}
