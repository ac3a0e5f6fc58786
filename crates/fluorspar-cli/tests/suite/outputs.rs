//! What commands write: nothing of the user's is replaced, sets of files appear together, full disks leave nothing.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::support::{fluorspar, listing};

/// A render of a few pixels.
const RENDER: [&str; 7] = [
    "render",
    "flat-patch",
    "-q",
    "--spp=16",
    "--set=render.width_px=8",
    "--set=render.height_px=6",
    "--statistics=light_groups",
];

/// Every file below a folder with its content.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = listing(folder).into_keys().filter(|path| path.is_file());
    files.map(|path| (path.clone(), fs::read(&path).unwrap())).collect()
}

/// Runs and expects a refusal with exit code 2 that leaves everything as it was.
fn refused(folder: &Path, args: &[&str], why: &str) {
    let before = contents(folder);
    let said = fluorspar(folder, args);
    assert_eq!(said.code, Some(2), "{args:?}: {said:?}");
    assert!(said.stderr.contains(why), "{args:?}: {}", said.stderr);
    assert!(contents(folder) == before, "{args:?} changed something");
}

/// Every command that writes files that its options name, with the files that it writes. `a.exr` and `a.film` are inputs.
const WRITERS: &[(&[&str], &[&str])] = &[
    (&["render", "--out", "o.exr", "--preview", "p.png"], &["o.exr", "p.png"]),
    (&["render", "--out", "o.npy"], &["o.npy", "o.npy.json"]),
    (&["merge", "a.film", "-q", "--out", "m.exr", "--film", "m.film"], &["m.exr", "m.film"]),
    (&["denoise", "a.exr", "-q", "--out", "d.exr", "--preview", "d.png"], &["d.exr", "d.png"]),
    (&["spectroradiometer", "tongue-385nm", "-q", "--out", "r.csv"], &["r.csv"]),
    (&["spectroradiometer", "tongue-385nm", "-q", "--out", "r.png"], &["r.png"]),
    (
        &["lens", "report", "wide_3_5mm", "--out", "l.svg"],
        &["l.svg", "l_spots.svg", "l_mtf.svg", "l_field.svg"],
    ),
    (
        &["catalog", "plot", "fluorophore", "fad", "--light", "led_385", "--out", "f.svg"],
        &["f.svg", "f_emission.svg"],
    ),
    (
        &["mouth", "generate", "--detail=0.25", "-q", "--out", "g.glb", "--out", "g.obj", "--out", "g.pbrt"],
        &["g.glb", "g.obj", "g.mtl", "g.pbrt"],
    ),
    (
        &["mouth", "view", "--views=lips", "--width=64", "--spp=1", "--detail=0.25", "-q", "--out", "v.png"],
        &["v.png"],
    ),
];

fn arguments<'a>(args: &[&'a str]) -> Vec<&'a str> {
    if args[0] == "render" { [&RENDER[..], &args[1..]].concat() } else { args.to_vec() }
}

#[test]
fn every_command_replaces_its_own_files_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fluorspar(folder, [&RENDER[..], &["--components", "--film", "a.film", "--out", "a.exr"]].concat()).well();
    for (args, files) in WRITERS {
        let args = arguments(args);
        for file in *files {
            fs::write(folder.join(file), "years of work\n").unwrap();
            refused(folder, &args, &format!("{file}: this file was not written by fluorspar, and stays"));
            fs::remove_file(folder.join(file)).unwrap();
        }
        fluorspar(folder, &args).well();
        let first = contents(folder);
        for file in *files {
            assert!(first.contains_key(&folder.join(file)), "{args:?} wrote no {file}");
        }
        fluorspar(folder, &args).well();
        assert!(contents(folder) == first, "{args:?} differs the second time");
    }
}

/// Films of a render with an excitation basis: two shards, a resumed render and one in bands of rows give the same bytes. A film that does
/// not fit, and images that can't hold a basis, are refused.
#[test]
fn films_keep_an_excitation_basis_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let small = &RENDER[..RENDER.len() - 1];
    let basis = ["--components", "--set=render.excitation_basis_nm=[380, 400]"];
    let render = |args: &[&str]| fluorspar(folder, [small, &basis, args].concat());
    render(&["--out", "whole.exr"]).well();
    render(&["--film", "1.film", "--shard", "1/2", "--shard-by", "samples"]).well();
    render(&["--film", "2.film", "--shard", "2/2", "--shard-by", "samples"]).well();
    fluorspar(folder, ["merge", "2.film", "1.film", "--components", "--out", "merged.exr"]).well();
    render(&["--film", "f.film", "--out", "filmed.exr", "--preview", "p.png"]).well();
    let bytes = |name: &str| fs::read(folder.join(name)).unwrap();
    assert!(bytes("whole.exr") == bytes("merged.exr") && bytes("whole.exr") == bytes("filmed.exr"));
    // Both know the same of another LED
    for name in ["whole", "merged"] {
        let image = format!("{name}.exr");
        let change = "--set=light.blue.spectrum={ type = \"led\", peak_nm = 390.0, fwhm_short_nm = 12.0, fwhm_long_nm = 12.0 }";
        let said = fluorspar(folder, ["capture", &image, change, "--out", name]);
        assert!(said.code == Some(0), "{said:?}");
    }
    assert!(bytes("whole/raw_blue.tiff") == bytes("merged/raw_blue.tiff"));
    refused(
        folder,
        &["merge", "1.film", "2.film", "--out", "sum.exr"],
        "kept beside the components of an .exr file",
    );
    refused(
        folder,
        &["merge", "1.film", "--components", "--out", "m.exr"],
        "a shard is missing or not finished",
    );
    let args = ["--film", "g.film", "--out", "o.exr", "--set=render.memory_limit_gib=0.001"];
    refused(folder, &[small, &basis, &args[..]].concat(), "raise render.memory_limit_gib");
}

#[test]
fn folders_of_others_stay_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("mine")).unwrap();
    fs::write(folder.join("mine/face.ply"), "my scan\n").unwrap();
    for args in [
        vec!["mouth", "generate", "--detail=0.25", "-q", "--out", "mine"],
        vec!["mouth", "generate", "--detail=0.25", "-q", "--out", "a.glb", "--out", "mine"],
        vec!["mouth", "sample", "--count=2", "--out", "mine"],
        vec![
            "sensor",
            "characterize",
            "pi_camera_3",
            "-q",
            "--levels=10",
            "--region",
            "16",
            "16",
            "--out",
            "mine",
        ],
    ] {
        refused(folder, &args, "mine: this");
    }
    // One that it wrote itself is replaced as a whole.
    for detail in ["--detail=0.3", "--detail=0.25"] {
        fluorspar(folder, ["mouth", "generate", detail, "-q", "--out", "parts"]).well();
    }
    let parts = fs::read_dir(folder.join("parts")).unwrap().count();
    fs::write(folder.join("parts/notes.txt"), "mine").unwrap();
    refused(
        folder,
        &["mouth", "generate", "--detail=0.25", "-q", "--out", "parts"],
        "notes.txt, which is not a result",
    );
    assert_eq!(fs::read_dir(folder.join("parts")).unwrap().count(), parts + 1);
}

#[test]
fn outputs_that_are_one_file_and_outputs_that_are_inputs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("sub")).unwrap();
    fluorspar(folder, [&RENDER[..], &["--components", "--film", "a.film", "--out", "a.exr"]].concat()).well();
    fluorspar(folder, ["lens", "report", "wide_3_5mm", "--out", "l.svg"]).well();
    let mut same = vec![
        (
            vec!["render", "--film", "x.exr", "--out", "x.exr"],
            "--out x.exr would be written to the same place",
        ),
        (vec!["render", "--film", "sub/../x.exr", "--out", "./x.exr"], "would be written to the same place"),
        (vec!["render", "--preview", "x.png", "--film", "./x.png"], "--preview x.png would be written"),
        (vec!["merge", "a.film", "--film", "a.film"], "a file that is read here"),
        (vec!["merge", "a.film", "--out", "m.exr", "--film", "m.exr"], "would be written to the same place"),
        (
            vec!["mouth", "generate", "--detail=0.25", "--out", "g.glb", "--out", "./g.glb"],
            "to the same place",
        ),
        (vec!["mouth", "generate", "--detail=0.25", "--out", "p", "--out", "./p"], "to the same place"),
        (
            vec!["mouth", "generate", "--detail=0.25", "--out", "sub", "--out", "sub/x.glb"],
            "to the same place",
        ),
        (vec!["lens", "report", "l.svg", "--out", "l.svg"], "a file that is read here"),
    ];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("x.exr", folder.join("link.film")).unwrap();
        same.push((
            vec!["render", "--film", "link.film", "--out", "x.exr"],
            "would be written to the same place",
        ));
        fs::hard_link(folder.join("a.film"), folder.join("hard.film")).unwrap();
        same.push((vec!["merge", "a.film", "--film", "hard.film"], "a file that is read here"));
        std::os::unix::fs::symlink("/dev/null", folder.join("null.svg")).unwrap();
        same.push((
            vec!["catalog", "plot", "fluorophore", "fad", "--out", "null.svg"],
            "this is a device or a pipe",
        ));
        same.push((vec!["catalog", "plot", "fluorophore", "fad", "--out", "/proc/f.svg"], "can't create it"));
    }
    for (args, why) in same {
        refused(folder, &arguments(&args), why);
    }
}

/// Runs a shell line with a disk of one megabyte at `disk`, if this system lets tests mount one.
fn with_small_disk(folder: &Path, line: &str) -> Option<std::process::Output> {
    fs::create_dir_all(folder.join("disk")).unwrap();
    let inner = format!("mount -t tmpfs -o size=1m none disk || exit 77; {line}");
    let shell = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "sh", "-c", &inner, env!("CARGO_BIN_EXE_fluorspar")])
        .current_dir(folder)
        .output();
    match shell {
        Ok(said) if said.status.code() != Some(77) && !said.stderr.starts_with(b"unshare") => Some(said),
        _ => {
            println!("skipped: this system lets tests mount no disk");
            None
        }
    }
}

#[test]
fn a_full_disk_leaves_nothing_and_the_message_names_what_the_user_named() {
    let folder = tempfile::tempdir().unwrap();
    for (args, named) in [
        ("mouth generate --detail=0.4 -q --out disk/parts", "disk/parts/"),
        ("mouth generate --detail=0.4 -q --out disk/g.obj --out g.glb", "disk/g.obj: can't write it"),
        ("mouth sample --count=1000 --out disk/people", "disk/people: the disk has"),
    ] {
        let line = format!(
            "echo mine > disk/mine; echo mine > mine; \"$0\" {args}; code=$?; ls -A disk . >&2; exit $code"
        );
        let Some(said) = with_small_disk(folder.path(), &line) else { return };
        let told = String::from_utf8(said.stderr).unwrap();
        assert_eq!(said.status.code(), Some(1), "{args}: {told}");
        assert!(told.starts_with("error: ") && told.contains(named), "{args}: {told}");
        // The file of the user, here and on the disk, and nothing else.
        assert!(told.ends_with(".:\ndisk\nmine\n\ndisk:\nmine\n"), "{args}: {told}");
    }
}

#[test]
fn a_disk_without_room_is_known_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let line = "\"$0\" render flat-patch --spp=1 --set=render.width_px=400 --set=render.height_px=300 --out disk/o.exr";
    let Some(said) = with_small_disk(folder.path(), line) else { return };
    let told = String::from_utf8(said.stderr).unwrap();
    assert_eq!(said.status.code(), Some(1), "{told}");
    let message = "error: disk/o.exr: the disk has 1.00 MiB left, and up to 37.1 MiB will be written. ";
    assert!(told.starts_with(message), "{told}");
    // Nothing is too large for any disk to be refused with numbers.
    let huge =
        ["render", "--set=render.width_px=8000", "--set=render.height_px=6000", "--components", "--spp=4096"];
    let huge = fluorspar(folder.path(), [&huge[..], &["--out", "big.exr"]].concat());
    let room = fluorspar_format::free_bytes(folder.path()).unwrap();
    assert!(room > 200 << 30 || huge.code == Some(1), "{huge:?}");
    assert!(huge.code != Some(1) || huge.stderr.contains(" GiB will be written"), "{huge:?}");
}

/// The numbers of a NumPy file of 32 bits.
fn npy(path: &Path) -> Vec<f32> {
    let bytes = fs::read(path).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[start..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// A picture has the light of one capture: components of its light groups at its drives, and nothing else.
#[test]
fn an_image_has_the_light_of_one_capture() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    fs::write(
        folder.join("e.toml"),
        "format = 1\nbase = \"flat-patch\"\n[[capture]]\nname = \"both\"\nlight_groups = { white = 0.5, blue = 2.0 }\n\
         exposure_ms = 5.0\n[[light]]\nname = \"white\"\ntype = \"distant\"\naim.direction = [0.0, 0.0, -1.0]\n\
         spectrum = \"white_led\"\nstrength.irradiance_w_per_m2 = 100.0\n",
    )
    .unwrap();
    let render = |more: &[&str]| {
        let args = ["render", "e.toml", "--spp=2", "--set=render.width_px=12", "--set=render.height_px=8"];
        fluorspar(folder, [&args[..], more].concat())
    };
    render(&["--components", "--film", "e.film", "--out", "components.npy"]).well();
    let described: Value =
        serde_json::from_str(&fs::read_to_string(folder.join("components.npy.json")).unwrap()).unwrap();
    let labels: Vec<String> = described["components"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c["light_group"].as_str().unwrap().to_owned())
        .collect();
    let components = npy(&folder.join("components.npy"));
    let size = components.len() / labels.len();
    let expected = |drive: &dyn Fn(&str) -> f32| -> Vec<f32> {
        let mut sum = vec![0.0f32; size];
        for (label, values) in labels.iter().zip(components.chunks(size)) {
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += drive(label) * value);
        }
        sum
    };
    let same = |file: &str, wanted: &[f32]| {
        let found = npy(&folder.join(file));
        assert_eq!(found.len(), wanted.len());
        let top = wanted.iter().copied().fold(0.0, f32::max);
        let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(top > 0.0 && worst <= 1e-5 * top, "{file}: {worst} of {top}");
    };
    let blue = |group: &str| f32::from(u8::from(group == "blue"));
    let both = |group: &str| if group == "blue" { 2.0 } else { 0.5 };
    assert!(labels.iter().any(|label| label == "white") && labels.iter().any(|label| label == "blue"));
    // The first capture of the base is dark, the second is its first with light
    let said = render(&["--out", "first.npy"]).well().stderr;
    let line = "Light of the capture \"blue\": light group \"blue\"; others: --capture ambient or both, all lights apart: --components";
    assert!(said.contains(line), "{said}");
    same("first.npy", &expected(&blue));
    let answer = render(&["--capture", "both", "--out", "both.npy", "--json"]).json();
    assert_eq!(
        answer["capture"],
        serde_json::json!({ "name": "both", "light_groups": { "blue": 2.0, "white": 0.5 } })
    );
    same("both.npy", &expected(&both));
    let mean = |values: &[f32]| values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64;
    let told: Vec<f64> =
        answer["mean_radiance"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let told = told.iter().sum::<f64>() / told.len() as f64;
    assert!((told / mean(&expected(&both)) - 1.0).abs() < 1e-4);
    // A film remembers its captures
    fluorspar(folder, ["merge", "e.film", "--capture", "both", "--out", "merged.npy"]).well();
    same("merged.npy", &expected(&both));
    for (more, message) in [
        (
            &["--capture", "bleu"][..],
            "--capture bleu: there is no such capture; the captures are ambient, blue, both",
        ),
        (&["--capture", "blue", "--components"], "with --components every light group stands apart"),
        (&["--unset=capture", "--unset=analysis", "--capture", "blue"], "the experiment has no captures"),
    ] {
        let said = render(&[more, &["--out", "no.npy"]].concat());
        assert!(said.code == Some(2) && said.stderr.contains(message), "{said:?}");
    }
}
