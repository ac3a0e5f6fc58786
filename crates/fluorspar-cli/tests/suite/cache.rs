//! The cache: a second run makes no mesh again, and gives the same.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::support::listing;

/// `mouth generate` with the cache that `set` names, by its environment.
fn generate(folder: &Path, out: &str, set: &[(&str, &Path)], more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fluorspar"));
    command.args(["mouth", "generate", "--detail=0.25", "-q", "--out", out]).args(more);
    command.env_remove("XDG_CACHE_HOME").env_remove("HOME").envs(set.iter().copied());
    command.current_dir(folder).stdout(Stdio::null());
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
    let run = |out: &str, set: &[(&str, &Path)], more: &[&str]| {
        assert!(generate(folder, out, set, more).status().unwrap().success());
        fs::read(at(out)).unwrap()
    };
    // Nothing is kept, and nothing in other places.
    let made = run("a.glb", &[("HOME", &at("home"))], &["--no-cache"]);
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
        assert!(run("b.glb", set, &[]) == made, "{place}");
        let files = kept(&at(place));
        // This mouth, and that of the default experiment, whose colors it has; and the maps of its tissues.
        assert_eq!(mouths(&files), 2, "{place}: {files:?}");
        // What is read back is not written again.
        let written =
            || files.iter().map(|file| fs::metadata(file).unwrap().created().ok()).collect::<Vec<_>>();
        let first = written();
        assert!(run("b.glb", set, &[]) == made, "{place}, again");
        assert_eq!(written(), first, "{place}");
        for file in &files {
            let mut bytes = fs::read(file).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            fs::write(file, bytes).unwrap();
        }
        assert!(run("b.glb", set, &[]) == made, "{place}, damaged");
        assert_eq!(kept(&at(place)), files, "{place}, damaged");
    }
    // A place that can't be written is no hindrance.
    fs::write(at("file"), "").unwrap();
    assert!(run("b.glb", &[("XDG_CACHE_HOME", &at("file"))], &[]) == made);
}

/// How many of the kept files are meshes of mouths.
fn mouths(files: &[PathBuf]) -> usize {
    let is_mouth = |file: &&PathBuf| file.file_name().unwrap().to_string_lossy().starts_with("mouth-");
    files.iter().filter(is_mouth).count()
}

#[test]
fn two_runs_at_once_share_a_cache() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let cache = folder.join("cache");
    let start = |out: &str| generate(folder, out, &[("XDG_CACHE_HOME", &cache)], &[]).spawn().unwrap();
    let mut running = ["a.glb", "b.glb", "c.glb"].map(start);
    for child in &mut running {
        assert!(child.wait().unwrap().success());
    }
    let [a, b, c] = ["a.glb", "b.glb", "c.glb"].map(|name| fs::read(folder.join(name)).unwrap());
    assert!(a == b && b == c);
    let files = kept(&cache);
    assert_eq!(mouths(&files), 2, "{files:?}");
}
