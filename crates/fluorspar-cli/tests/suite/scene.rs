//! `fluorspar scene`: tree, get, set, insert, delete, check, convert, view.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;

use crate::support::{fluorspar, listing};

const MINE: &str = "format = 1\nbase = \"flat-patch\"\n# my lamp\n[[light]]\nname = \"blue\"\nstrength.irradiance_w_per_m2 = 20.0\n";

const PBRT: &str = "LookAt 0 0 1  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 20\n\
    Film \"image\" \"integer xresolution\" 8 \"integer yresolution\" 6\nSampler \"halton\" \"integer pixelsamples\" 1\nWorldBegin\n\
    LightSource \"distant\" \"point from\" [0 0 1] \"point to\" [0 0 0] \"rgb L\" [3 3 3]\n\
    MakeNamedMaterial \"wall\" \"string type\" \"matte\" \"rgb Kd\" [0.5 0.5 0.5]\nNamedMaterial \"wall\"\n\
    Shape \"trianglemesh\" \"integer indices\" [0 1 2] \"point P\" [-1 -1 0  3 -1 0  -1 3 0]\nWorldEnd\n";

#[test]
fn a_scene_is_listed_read_and_written_with_changes() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let light = fs::read_to_string(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../fluorspar-experiment/data/experiments/flat-patch.toml"
    ));
    assert!(light.is_ok_and(|text| text.contains("name = \"blue\"")), "the base has a light of this name");
    fs::write(here.join("mine.toml"), MINE).unwrap();
    let tree = fluorspar(here, ["scene", "tree", "mine.toml"]).well().stdout;
    assert!(tree.lines().any(|line| line.starts_with("light.blue ")), "{tree}");
    assert!(tree.lines().any(|line| line.starts_with("patch/ ") && line.contains("material")), "{tree}");
    let list = fluorspar(here, ["scene", "tree", "mine.toml", "--json"]).json();
    assert!(list.as_array().unwrap().iter().any(|node| node["path"] == "light.blue"));
    let got = fluorspar(here, ["scene", "get", "mine.toml", "light.*.strength", "render.seed"]).well().stdout;
    assert_eq!(got, "light.blue.strength = { irradiance_w_per_m2 = 20.0 }\nrender.seed = 1\n");
    let got =
        fluorspar(here, ["scene", "get", "mine.toml", "render.seed", "--set", "render.seed=5", "--json"])
            .json();
    assert_eq!(got, serde_json::json!([{ "path": "render.seed", "value": 5 }]));

    let args = [
        "scene",
        "set",
        "mine.toml",
        "light.*.strength.irradiance_w_per_m2=30",
        "--out",
        "new.toml",
        "--record",
        "script.toml",
    ];
    fluorspar(here, args).well();
    assert_eq!(fs::read_to_string(here.join("mine.toml")).unwrap(), MINE, "the file of the user stays");
    let new = fs::read_to_string(here.join("new.toml")).unwrap();
    assert!(
        new.contains("# my lamp")
            && new.contains("strength.irradiance_w_per_m2 = 30\n")
            && new.contains("written by fluorspar"),
        "{new}"
    );
    // The script does the same again, and a file of this program may be edited where it stands.
    let replayed = fluorspar(here, ["scene", "set", "mine.toml", "--script", "script.toml"]).well().stdout;
    assert_eq!(replayed, new);
    fluorspar(
        here,
        [
            "scene",
            "insert",
            "new.toml",
            "object.ball={ type = \"sphere\", radius_mm = 3.0, material = \"patch\" }",
            "--out",
            "new.toml",
            "-q",
        ],
    )
    .well();
    fluorspar(here, ["scene", "delete", "new.toml", "object.patch", "--out", "new.toml", "-q"]).well();
    let tree = fluorspar(here, ["scene", "tree", "new.toml"]).well().stdout;
    assert!(tree.contains("ball/ ") && !tree.contains("patch/ "), "{tree}");
    // --set of other commands takes the same paths.
    let said = fluorspar(here, ["check", "mine.toml", "-q", "--set", "patch/material.reflectance=3"]);
    assert!(said.code == Some(2) && said.stderr.contains("reflectance"), "{}", said.stderr);
    fluorspar(here, ["check", "mine.toml", "-q", "--set", "patch/material.reflectance=0.3"]).well();
}

#[test]
fn what_cannot_be_changed_is_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::write(here.join("mine.toml"), MINE).unwrap();
    fs::write(here.join("yours.toml"), "format = 1\n").unwrap();
    fs::create_dir(here.join("other")).unwrap();
    fs::write(here.join("relative.toml"), MINE.replace("flat-patch", "./mine.toml")).unwrap();
    fs::write(here.join("bad.toml"), "format = 1\n[[change]]\nput = 1\n").unwrap();
    fs::write(here.join("frame.toml"), b"\x89PNG\r\n\x1a\n").unwrap();
    fs::write(here.join("part.stl"), "solid part\nendsolid part\n").unwrap();
    let before = listing(here);
    let cases: [(&[&str], &str); 12] = [
        (&["scene", "check", "frame.toml"], "frame.toml: this is a picture, not a scene"),
        (&["run", "frame.toml"], "frame.toml: this is a picture, not a scene"),
        (&["scene", "check", "part.stl"], "part.stl: this is a mesh, not a scene"),
        (&["scene", "set", "mine.toml", "title=x", "--out", "new.txt"], "must end in .toml"),
        (&["scene", "set", "mine.toml"], "nothing is to be set"),
        (&["scene", "set", "mine.toml", "light.blu.power=3"], "did you mean \"blue\"?"),
        (&["scene", "set", "mine.toml", "title=x", "--out", "yours.toml"], "was not written by fluorspar"),
        (
            &["scene", "set", "relative.toml", "title=x", "--out", "other/new.toml"],
            "write the new file into that folder",
        ),
        (&["scene", "set", "mine.toml", "--script", "bad.toml"], "bad.toml:3"),
        (&["scene", "get", "mine.toml", "light.*.nothing"], "nothing"),
        (&["scene", "convert", "mine.toml", "--out", "new.toml"], "this is an experiment already"),
        (&["scene", "tree", "mine.toml", "--unit", "mm"], "--unit is for scenes of pbrt"),
    ];
    for (args, words) in cases {
        let said = fluorspar(here, args);
        assert!(said.code == Some(2) && said.stderr.contains(words), "{args:?}: {}", said.stderr);
    }
    assert_eq!(listing(here), before);
}

#[test]
fn a_scene_of_pbrt_is_listed_changed_and_converted() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::write(here.join("s.pbrt"), PBRT).unwrap();
    let tree = fluorspar(here, ["scene", "tree", "s.pbrt", "--unit", "m"]).well().stdout;
    assert!(tree.contains("material.wall ") && tree.contains("light.distant_0 "), "{tree}");
    assert_eq!(listing(here).len(), 1, "listing writes nothing");
    let args = ["scene", "convert", "s.pbrt", "--unit", "m", "--out", "s.toml"];
    fluorspar(here, args).well();
    assert!(here.join("s_files/trianglemesh_0.ply").exists());
    fluorspar(here, ["check", "s.toml", "-q"]).well();
    // A change of the scene and the same one of the experiment show the same light.
    let change = "*/material.reflectance=0.25";
    let render = |scene: &str, out: &str| {
        let mut args = vec!["render", scene, "--set", change, "--spp", "1", "--out", out, "-q"];
        args.extend((scene == "s.pbrt").then_some(["--unit", "m"]).into_iter().flatten());
        fluorspar(here, args).well();
        fs::read(here.join(out)).unwrap()
    };
    let (a, b) = (render("s.pbrt", "a.npy"), render("s.toml", "b.npy"));
    let value = |bytes: &[u8]| f32::from_le_bytes(bytes[bytes.len() - 4..].try_into().unwrap());
    assert!(value(&a) > 0.0 && (value(&a) / value(&b) - 1.0).abs() < 1e-5, "{} {}", value(&a), value(&b));
    let args = ["scene", "set", "s.pbrt", "--unit", "m", change, "--out", "dark.toml", "-q"];
    fluorspar(here, args).well();
    fluorspar(here, ["check", "dark.toml", "-q"]).well();
    let got = fluorspar(here, ["scene", "get", "dark.toml", "material.wall.reflectance"]).well().stdout;
    assert_eq!(got, "material.wall.reflectance = 0.25\n");
    let said = fluorspar(here, ["scene", "check", "s.pbrt"]).well();
    assert!(
        said.stdout.contains("1 objects, 1 materials, 1 lights") && said.stderr.contains("one unit"),
        "{said:?}"
    );
}

#[test]
fn shapes_are_drawn_without_light() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::write(here.join("s.pbrt"), PBRT).unwrap();
    for show in ["clay", "part", "depth", "uv"] {
        let out = format!("{show}.png");
        let args = ["scene", "view", "fluorescent-sphere", "--show", show, "--width", "64", "--out", &out];
        let said = fluorspar(here, args).well();
        assert!(here.join(&out).exists());
        match show {
            "part" => assert!(said.stdout.starts_with('#'), "{}", said.stdout),
            "depth" => assert!(said.stdout.starts_with("bright "), "{}", said.stdout),
            _ => assert!(said.stdout.is_empty(), "{}", said.stdout),
        }
    }
    assert_ne!(fs::read(here.join("clay.png")).unwrap(), fs::read(here.join("uv.png")).unwrap());
    fluorspar(here, ["scene", "view", "s.pbrt", "--out", "pbrt.png", "-q"]).well();
    let said = fluorspar(here, ["scene", "view", "s.pbrt", "--out", "pbrt.jpg"]);
    assert!(said.code == Some(2) && said.stderr.contains("must end in .png"));
}
