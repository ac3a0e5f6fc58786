//! The cache: a second run makes no mesh again, and gives the same; nor does any command after a render.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

use crate::support::{listing, tiny};

/// `mouth generate` with the cache that `set` names, by its environment.
fn generate(folder: &Path, set: &[(&str, &Path)], more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fluorspar"));
    command.args(["mouth", "generate", "--detail=0.25", "-q"]).args(more);
    command.env_remove("XDG_CACHE_HOME").env_remove("HOME").envs(set.iter().copied());
    command.current_dir(folder);
    command
}

fn kept(folder: &Path) -> Vec<PathBuf> {
    listing(folder).into_keys().filter(|path| path.is_file()).collect()
}

#[test]
fn meshes_are_kept_where_the_environment_says_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let at = |name: &str| folder.join(name);
    // Without an output only the mesh is made, and measured.
    let run = |set: &[(&str, &Path)], more: &[&str]| {
        let output = generate(folder, set, more).arg("--json").output().unwrap();
        assert!(output.status.success());
        output.stdout
    };
    // Nothing is kept, and nothing in other places.
    let made = run(&[("HOME", &at("home"))], &["--no-cache"]);
    assert!(!at("home").exists());
    // The places, in their order, made for the occasion.
    for name in ["xdg", "home", "tmp"] {
        fs::create_dir(at(name)).unwrap();
    }
    let xdg: &[(&str, &Path)] = &[("XDG_CACHE_HOME", &at("xdg")), ("HOME", &at("home"))];
    let of: [(&str, &[(&str, &Path)]); 3] = [
        ("xdg/fluorspar", xdg),
        ("home/.cache/fluorspar", &[("HOME", &at("home"))]),
        ("tmp", &[("TMPDIR", &at("tmp"))]),
    ];
    for (place, set) in of {
        assert!(run(set, &[]) == made, "{place}");
        let files = kept(&at(place));
        assert_eq!(mouths(&files), 1, "{place}: {files:?}");
        // What is read back is not written again.
        let written =
            || files.iter().map(|file| fs::metadata(file).unwrap().created().ok()).collect::<Vec<_>>();
        let first = written();
        assert!(run(set, &[]) == made, "{place}, again");
        assert_eq!(written(), first, "{place}");
        damage(&files);
        assert!(run(set, &[]) == made, "{place}, damaged");
        assert_eq!(kept(&at(place)), files, "{place}, damaged");
    }
    // A place that can't be written is no hindrance.
    fs::write(at("file"), "").unwrap();
    assert!(run(&[("XDG_CACHE_HOME", &at("file"))], &[]) == made);
}

/// Changes one bit in the middle of every file.
fn damage(files: &[PathBuf]) {
    for file in files {
        let mut bytes = fs::read(file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(file, bytes).unwrap();
    }
}

/// Writes a mouth of one layered tissue among colored surfaces: it is solved in a quarter of the time of all of them.
fn one_tissue(folder: &Path) {
    let text = "format = 1\nbase = \"oraleye-2021-surface\"\nunset = [\"material.tongue_dorsum.concentrations\"]\n\
                [[material]]\nname = \"tongue_dorsum\"\ntype = \"tissue\"\ntissue = \"dorsal_tongue\"\n";
    fs::write(folder.join("one-tissue.toml"), text).unwrap();
}

/// How many of the kept files are meshes of mouths.
fn mouths(files: &[PathBuf]) -> usize {
    let is_mouth = |file: &&PathBuf| file.file_name().unwrap().to_string_lossy().starts_with("mouth-");
    files.iter().filter(is_mouth).count()
}

#[test]
fn two_runs_at_once_share_a_cache_and_a_damaged_one_is_made_anew() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let cache = folder.join("cache");
    one_tissue(folder);
    let start = |out: &'static str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fluorspar"));
        command.args(tiny(&["render", "one-tissue.toml", "--out", out, "-q"]));
        command.env("XDG_CACHE_HOME", &cache).current_dir(folder).spawn().unwrap()
    };
    let finish = |mut child: Child| assert!(child.wait().unwrap().success());
    for child in ["a.exr", "b.exr"].map(start) {
        finish(child);
    }
    // The mouth, its maps and its solved tissues
    let files = kept(&cache);
    assert_eq!(mouths(&files), 1, "{files:?}");
    assert!(files.len() > 2, "{files:?}");
    damage(&files);
    finish(start("c.exr"));
    let [a, b, c] = ["a.exr", "b.exr", "c.exr"].map(|name| fs::read(folder.join(name)).unwrap());
    assert!(a == b && b == c);
    assert_eq!(kept(&cache), files);
}

/// What is kept of meshes, maps and tissues, with the number that the disk gives each file: what is made anew gets another.
#[cfg(unix)]
fn made(cache: &Path) -> Vec<(PathBuf, u64)> {
    use std::os::unix::fs::MetadataExt;
    let is_made = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        ["mouth-", "map-", "tissue-", "light-"].iter().any(|kind| name.starts_with(kind))
    };
    kept(cache)
        .into_iter()
        .filter(is_made)
        .map(|path| (path.clone(), fs::metadata(&path).unwrap().ino()))
        .collect()
}

#[cfg(unix)]
#[test]
fn no_command_after_a_render_makes_its_mouth_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let cache = folder.join("cache");
    let fluorspar = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fluorspar"));
        let output = command.args(args).env("XDG_CACHE_HOME", &cache).current_dir(folder).output().unwrap();
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    one_tissue(folder);
    fluorspar(&tiny(&["run", "one-tissue.toml", "--out", "run", "-q"]));
    let first = made(&cache);
    assert!(mouths(&kept(&cache)) == 1 && first.len() > 5, "{first:?}");
    let filter = "view_filter.filters=[\"view_425_700\"]";
    let commands: [&[&str]; 7] = [
        &["capture", "run/components.exr", "--set", "capture.blue.exposure_ms=9", "--out", "dim", "-q"],
        &["capture", "run/components.exr", "--set", filter, "--out", "other", "-q"],
        &["capture", "run/components.exr", "--set", "sensor.bit_depth=10", "--out", "bits", "-q"],
        &["analyze", "dim", "--component-image", "run/components.exr", "-q"],
        &["sheet", "run/components.exr", "--width", "64", "--out", "sheet.png", "-q"],
        &["scene", "view", "run/experiment.toml", "--width", "64", "--out", "view.png", "-q"],
        &["check", "run/experiment.toml", "-q"],
    ];
    for command in commands {
        fluorspar(command);
        assert_eq!(made(&cache), first, "{command:?}");
    }
    // The planes of another filter are kept, and seen again the frames are the same.
    let planes = || kept(&cache).iter().filter(|path| path.to_string_lossy().contains("/planes-")).count();
    assert!(planes() > 0);
    let before = (planes(), fs::read(folder.join("other/raw_blue.tiff")).unwrap());
    fluorspar(commands[1]);
    assert_eq!((planes(), fs::read(folder.join("other/raw_blue.tiff")).unwrap()), before);
    fluorspar(&[&["--no-cache"], commands[1]].concat());
    assert_eq!(fs::read(folder.join("other/raw_blue.tiff")).unwrap(), before.1);
    // An analysis that looks at fewer frames takes those planes, too.
    fluorspar(&["analyze", "other", "--json", "-q"]);
    assert_eq!(planes(), before.0);
    // What an analysis asks of surfaces is kept: it gives the same numbers without a mouth to read.
    let weak = ["--set", "concentration.collagen=0.5", "--out", "weak", "-q"];
    fluorspar(&[&["capture", "run/components.exr"], weak.as_slice()].concat());
    for file in kept(&cache).iter().filter(|file| file.to_string_lossy().contains("/mouth-")) {
        fs::remove_file(file).unwrap();
    }
    for frames in ["dim", "weak"] {
        let analyze = ["analyze", frames, "--json", "-q"];
        let of_cached = fluorspar(&analyze);
        assert_eq!(mouths(&kept(&cache)), 0, "{frames}");
        assert!(String::from_utf8_lossy(&of_cached).contains("posterior"));
        assert!(fluorspar(&[&["--no-cache"], analyze.as_slice()].concat()) == of_cached, "{frames}");
    }
    // With regions, too
    let analyze = ["analyze", "dim", "--json", "-q", "--named-region", "lip=lower_lip"];
    let whole = fluorspar(&analyze);
    for file in kept(&cache).iter().filter(|file| file.to_string_lossy().contains("/mouth-")) {
        fs::remove_file(file).unwrap();
    }
    let of_cached = fluorspar(&analyze);
    assert_eq!(mouths(&kept(&cache)), 0);
    assert!(of_cached == whole && String::from_utf8_lossy(&of_cached).contains("\"regions\""));
}
