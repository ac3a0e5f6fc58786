//! The program where newer system calls are refused, as on older kernels and in sandboxes: the same results.

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{fluorspar, listing};

/// Builds the program that refuses calls, if this system has a C compiler and takes filters.
fn refuse_calls(folder: &Path) -> Option<PathBuf> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/suite/refuse_calls.c");
    let program = folder.join("refuse_calls");
    let Ok(built) = Command::new("cc").arg("-o").args([&program, &source]).output() else {
        println!("skipped: this system has no C compiler (cc)");
        return None;
    };
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let tried = Command::new(&program).arg("true").output().unwrap();
    match tried.status.code() {
        Some(0) => Some(program),
        Some(77) => {
            println!("skipped: this system takes no filter of system calls");
            None
        }
        _ => panic!("{tried:?}"),
    }
}

#[test]
fn the_program_does_the_same_without_newer_system_calls() {
    let folder = tempfile::tempdir().unwrap();
    let Some(refuse_calls) = refuse_calls(folder.path()) else { return };
    let size = ["--set=render.width_px=24", "--set=render.height_px=20", "--spp=4", "-q", "--threads=2"];
    for args in [
        [&["run", "flat-patch", "--out", "out"], &size[..]].concat(),
        [&["render", "flat-patch", "--components", "--out", "out.exr", "--film", "out.film"], &size[..]]
            .concat(),
        vec!["mouth", "generate", "--detail", "0.25", "--out", "out.glb", "-q"],
    ] {
        let [usual, old] = ["usual", "old"].map(|name| folder.path().join(name));
        for place in [&usual, &old] {
            fs::create_dir(place).unwrap();
        }
        let expected = fluorspar(&usual, &args).well();
        let said = Command::new(&refuse_calls)
            .arg(env!("CARGO_BIN_EXE_fluorspar"))
            .args(&args)
            .current_dir(&old)
            .output()
            .unwrap();
        assert_eq!(said.status.code(), Some(0), "{args:?}: {}", String::from_utf8_lossy(&said.stderr));
        assert_eq!(String::from_utf8(said.stdout).unwrap(), expected.stdout, "{args:?}");
        let names = |place: &Path| -> Vec<PathBuf> {
            listing(place).into_keys().map(|path| path.strip_prefix(place).unwrap().to_path_buf()).collect()
        };
        assert_eq!(names(&old), names(&usual), "{args:?}");
        for name in names(&usual).iter().filter(|name| usual.join(name).is_file()) {
            let same = fs::read(usual.join(name)).unwrap() == fs::read(old.join(name)).unwrap();
            assert!(same, "{args:?}: {}", name.display());
        }
        for place in [&usual, &old] {
            fs::remove_dir_all(place).unwrap();
        }
    }
}
