//! `fluorspar render` of scenes of pbrt.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use crate::support::{fluorspar, listing};

const SCENE: &str = "LookAt 0 0 1  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 20\n\
    Film \"image\" \"integer xresolution\" 6 \"integer yresolution\" 4 \"string filename\" \"x.exr\"\n\
    Sampler \"halton\" \"integer pixelsamples\" 4\nWorldBegin\n\
    LightSource \"distant\" \"point from\" [0 0 1] \"point to\" [0 0 0] \"rgb L\" [3 3 3]\n\
    Material \"matte\" \"rgb Kd\" [0.5 0.5 0.5]\nShape \"disk\" \"float radius\" 5\nWorldEnd\n";

/// The first value of a NumPy array and its shape.
fn array(path: &Path) -> (String, f32) {
    let bytes = fs::read(path).unwrap();
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8(bytes[10..10 + length].to_vec()).unwrap();
    let first = &bytes[10 + length..14 + length];
    (header, f32::from_le_bytes([first[0], first[1], first[2], first[3]]))
}

#[test]
fn a_scene_renders_to_an_array_with_its_description() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("s.pbrt"), SCENE).unwrap();
    let args = ["render", "s.pbrt", "--spp", "2", "--seed", "3", "--out", "image.npy"];
    let said = fluorspar(folder.path(), args).well();
    assert!(said.stderr.contains("one unit of the scene is taken as 1 m"), "{}", said.stderr);
    let (header, value) = array(&folder.path().join("image.npy"));
    assert!(header.contains("'<f4'") && header.contains("(4, 6, 81)"), "{header}");
    assert!((f64::from(value) - 0.5 * 3.0 / std::f64::consts::PI).abs() < 1e-4, "{value}");
    let description = fs::read_to_string(folder.path().join("image.npy.json")).unwrap();
    let description: serde_json::Value = serde_json::from_str(&description).unwrap();
    assert_eq!(description["unit"], "W/(sr m^2 nm)");
    assert_eq!(description["axes"], serde_json::json!(["row", "col", "band"]));
    assert_eq!(description["provenance"]["seed"], 3);
    assert_eq!(description["provenance"]["samples_per_pixel"], 2);
    // The same again, on other bands.
    let args = ["render", "s.pbrt", "--unit", "cm", "--bands", "400:700:10", "--out", "other.npy", "--json"];
    let answer = fluorspar(folder.path(), args).json();
    assert_eq!(answer["wavelength_nm"].as_array().unwrap().len(), 31);
    assert_eq!(answer["samples_per_pixel"], 4);
}

#[test]
fn what_has_no_counterpart_is_named_and_refused_when_strict() {
    let folder = tempfile::tempdir().unwrap();
    let scene = SCENE.replace("WorldEnd", "Shape \"curve\"\nWorldEnd");
    fs::write(folder.path().join("s.pbrt"), scene).unwrap();
    let line = "s.pbrt:9:1: Shape \"curve\" has no counterpart and is left out";
    let said = fluorspar(folder.path(), ["render", "s.pbrt", "--out", "a.npy", "--spp", "1"]).well();
    assert!(said.stderr.contains(&format!("warning: {line}")), "{}", said.stderr);
    let before = listing(folder.path());
    let said = fluorspar(folder.path(), ["render", "s.pbrt", "--strict", "--out", "b.npy"]);
    assert_eq!(said.code, Some(2));
    assert!(
        said.stderr.contains("--strict: the scene has 1 thing") && said.stderr.contains(line),
        "{}",
        said.stderr
    );
    assert_eq!(listing(folder.path()), before);
}

#[test]
fn mistakes_end_with_two_and_name_their_places() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("s.pbrt"), SCENE.replace("Shape", "Shpae")).unwrap();
    fs::write(folder.path().join("good.pbrt"), SCENE).unwrap();
    for (args, expected) in [
        (&["render", "s.pbrt"][..], "error: s.pbrt:8:1: Shpae is not a directive; did you mean \"Shape\"?"),
        (&["render", "none.pbrt"], "none.pbrt: can't read it"),
        (&["run", "good.pbrt"], "this is a scene of pbrt, no experiment; `fluorspar render` takes it"),
        (&["check", "good.pbrt"], "`fluorspar render` takes it"),
        (&["render", "flat-patch", "--unit", "mm"], "--unit is for scenes of pbrt"),
        (&["render", "good.pbrt", "--set", "render.sead=2"], "did you mean \"seed\"?"),
        (&["render", "good.pbrt", "--error", "0.1"], "--error is for experiment files"),
        (&["render", "good.pbrt", "--bands", "700:400:10"], "--bands"),
        (
            &["render", "good.pbrt", "--out", "good.pbrt"],
            "--out good.pbrt: the name must end in .exr or .npy",
        ),
        (
            &["render", "good.pbrt", "--components", "--out", "o.ome.zarr"],
            "`fluorspar cube FILE.exr --components --out o.ome.zarr`",
        ),
    ] {
        let said = fluorspar(folder.path(), args);
        assert_eq!(said.code, Some(2), "{args:?}: {said:?}");
        assert!(said.stderr.contains(expected), "{args:?}: {}", said.stderr);
    }
}

/// A part of a scene that others light goes all ways that the scene of pbrt goes, and is refused where light is needed.
#[test]
fn a_scene_without_lights_stays_readable_as_an_experiment() {
    let folder = tempfile::tempdir().unwrap();
    let unlit = "Camera \"perspective\"\nFilm \"image\" \"integer xresolution\" [6] \"integer yresolution\" [4]\nWorldBegin\n\
                 Material \"matte\"\nTranslate 0 0 5 Shape \"sphere\"\nWorldEnd\n";
    fs::write(folder.path().join("s.pbrt"), unlit).unwrap();
    let run = |args: &[&str]| fluorspar(folder.path(), args);
    run(&["scene", "convert", "s.pbrt", "--unit", "cm", "--out", "s.toml"]).well();
    let told = run(&["scene", "check", "s.toml"]).well();
    assert_eq!(told.stdout, "s.toml: valid. 1 objects, 1 materials, 0 lights, 0 fluorophores\n");
    assert!(told.stderr.contains("warning: the scene has no lights"), "{}", told.stderr);
    let left_out = unlit.replace("Material", "LightSource \"unheard\"\nMaterial");
    fs::write(folder.path().join("left_out.pbrt"), left_out).unwrap();
    let told = run(&["scene", "check", "left_out.pbrt", "--unit", "cm"]).well();
    assert!(told.stderr.contains("no lights left: those that it has are left out"), "{}", told.stderr);
    let radius = run(&["scene", "get", "s.toml", "object.sphere_0.radius_mm"]).well().stdout;
    let radius: f64 = radius.split(" = ").nth(1).unwrap().trim().parse().unwrap();
    assert!((radius - 10.0).abs() < 1e-5, "{radius}");
    run(&["scene", "tree", "s.toml"]).well();
    run(&["scene", "view", "s.toml", "--out", "view.png"]).well();
    run(&["scene", "convert", "s.toml", "--out", "again.toml"]);
    for command in ["render", "run", "check"] {
        let said = run(&[command, "s.toml"]);
        let what = "s.toml: the scene has no lights; add a [[light]] section";
        assert!(said.code == Some(2) && said.stderr.contains(what), "{command}: {said:?}");
    }
    // With a light it renders
    let sun = "light.sun={ type = \"environment\", spectrum = 1.0, strength.radiance_w_per_sr_m2 = 4.0 }";
    run(&["scene", "insert", "s.toml", sun, "--out", "lit.toml"]).well();
    let said = run(&["scene", "check", "lit.toml"]).well();
    assert!(said.stdout.contains("1 lights") && !said.stderr.contains("no lights"), "{said:?}");
    run(&["render", "lit.toml", "--spp=1", "--out", "lit.npy"]).well();
}
