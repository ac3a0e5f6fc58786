//! Odd places to run in: read-only folders, few descriptors, odd names, others at the same time, a clock that jumps.

#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::support::{fluorspar, listing};

const RENDER: [&str; 6] =
    ["render", "flat-patch", "-q", "--spp=4", "--set=render.width_px=20", "--set=render.height_px=16"];

fn names(folder: &Path) -> Vec<OsString> {
    let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    names
}

fn stderr(said: &Output) -> String {
    String::from_utf8_lossy(&said.stderr).into_owned()
}

/// Runs a shell line in a folder, the program as `$0`.
fn shell(folder: &Path, line: &str) -> Output {
    let mut command = Command::new("sh");
    command.args(["-c", line, env!("CARGO_BIN_EXE_fluorspar")]).current_dir(folder).output().unwrap()
}

#[test]
fn a_read_only_folder_is_known_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("disk")).unwrap();
    // A disk that is mounted so holds for everybody, permissions do not.
    let line = "mount -t tmpfs none disk || exit 77; echo mine > disk/mine; mount -o remount,ro disk || exit 77; \
                for args in 'render flat-patch --spp=1 --out disk/o.exr' 'run flat-patch --spp=1 --out disk/out' \
                'render flat-patch --spp=1 --film disk/f.film' 'mouth generate --out disk/parts' \
                'mouth sample --out disk/people' 'lens report wide_3_5mm --out disk/l.svg' 'capture a.exr --out disk/c' \
                'sensor characterize pi_camera_3 --out disk/s' 'catalog plot fluorophore fad --out disk/f.svg'; \
                do \"$0\" $args; echo $?; done >told 2>&1; cat told >&2; ls -A disk";
    fluorspar(folder.path(), [&RENDER[..], &["--components", "--out", "a.exr"]].concat()).well();
    let said = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "sh", "-c", line, env!("CARGO_BIN_EXE_fluorspar")])
        .current_dir(folder.path())
        .output();
    let Some(said) = said.ok().filter(|said| said.status.success() && !stderr(said).starts_with("unshare"))
    else {
        println!("skipped: this system lets tests mount no disk");
        return;
    };
    let told = stderr(&said);
    assert_eq!(told.lines().filter(|line| *line == "2").count(), 9, "{told}");
    assert!(told.matches("Read-only file system").count() >= 9, "{told}");
    assert_eq!(String::from_utf8(said.stdout).unwrap(), "mine\n", "{told}");
}

#[test]
fn few_descriptors_end_with_a_result_or_an_error() {
    let mut done = 0;
    for args in [
        "render flat-patch --spp=1 --set=render.width_px=9 --out o.exr",
        "lens report wide_3_5mm --out o.svg",
    ] {
        for descriptors in [4, 5, 6, 7, 8, 10, 12, 16, 24] {
            let folder = tempfile::tempdir().unwrap();
            let line = format!("ulimit -n {descriptors} && exec \"$0\" {args}");
            let said = shell(folder.path(), &line);
            let told = stderr(&said);
            match said.status.code() {
                Some(0) => {
                    done += 1;
                    assert!(!names(folder.path()).is_empty(), "{descriptors}: {args}");
                    let unfinished = |name: &OsString| name.as_bytes().starts_with(b".");
                    assert!(!names(folder.path()).iter().any(unfinished), "{descriptors}: {args}");
                }
                Some(1 | 2) => {
                    assert!(
                        told.lines().any(|line| line.starts_with("error: ")),
                        "{descriptors}: {args}: {told}"
                    );
                    assert!(
                        names(folder.path()).is_empty(),
                        "{descriptors}: {args}: {:?}",
                        names(folder.path())
                    );
                }
                other => panic!("{descriptors}: {args}: {other:?} {told}"),
            }
        }
    }
    assert!(done > 6, "{done}");
}

#[test]
fn odd_names_are_names() {
    let folder = tempfile::tempdir().unwrap();
    let long = "x".repeat(200);
    let odd: [&[u8]; 6] =
        [b"a b.exr", b"quote\"'$HOME.exr", b"line\nbreak.exr", b"\xff\xfe.exr", b"-q.exr", long.as_bytes()];
    for name in odd {
        let place = folder.path().join(OsStr::from_bytes(name));
        fs::create_dir(&place).unwrap();
        let mut image = PathBuf::from(OsStr::from_bytes(name)).into_os_string();
        image.push(".exr");
        let said = Command::new(env!("CARGO_BIN_EXE_fluorspar"))
            .args(RENDER)
            .arg("--out")
            .arg(Path::new(".").join(&image))
            .current_dir(&place)
            .output()
            .unwrap();
        assert_eq!(said.status.code(), Some(0), "{name:?}: {}", stderr(&said));
        assert_eq!(names(&place), [image], "{name:?}");
    }
}

#[test]
fn several_at_once_give_what_one_gives() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let start = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fluorspar"));
        command.args(args).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let film = |film: &'static str, out: &'static str| {
        [&RENDER[..], &["--film", film, "--resume", "--checkpoint-s", "0.1", "--out", out]].concat()
    };
    let run = |out: &'static str| {
        let size = ["--spp=2", "--set=render.width_px=20", "--set=render.height_px=16"];
        [&["run", "flat-patch", "-q", "--out", out][..], &size].concat()
    };
    for args in [film("alone.film", "alone.exr"), run("alone")] {
        assert!(start(&args).wait().unwrap().success());
    }
    // Three renders on one film, and three runs into one folder.
    let all = [
        film("f.film", "f.exr"),
        film("f.film", "f.exr"),
        run("r"),
        film("f.film", "f.exr"),
        run("r"),
        run("r"),
    ];
    let running: Vec<_> = all.iter().map(|args| (args, start(args))).collect();
    for (args, child) in running {
        let said = child.wait_with_output().unwrap();
        assert_eq!(said.status.code(), Some(0), "{args:?}: {}", stderr(&said));
    }
    assert!(fs::read(folder.join("f.exr")).unwrap() == fs::read(folder.join("alone.exr")).unwrap());
    let of = |name: &str| -> Vec<(PathBuf, Vec<u8>)> {
        let place = folder.join(name);
        let files = listing(&place).into_keys().filter(|path| path.is_file());
        files.map(|path| (path.strip_prefix(&place).unwrap().into(), fs::read(&path).unwrap())).collect()
    };
    assert!(of("r") == of("alone"));
    assert_eq!(names(folder), ["alone", "alone.exr", "alone.film", "f.exr", "f.film", "r"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_clock_that_jumps_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/suite/jumping_clock.c");
    let library = folder.join("jumping_clock.so");
    let Ok(built) = Command::new("cc").args(["-shared", "-fPIC", "-o"]).args([&library, &source]).output()
    else {
        println!("skipped: this system has no C compiler (cc)");
        return;
    };
    assert!(built.status.success(), "{}", stderr(&built));
    for (args, out) in [
        (
            [
                &RENDER[..],
                &["--film", "f.film", "--checkpoint-s", "0.1", "--preview", "p.png", "--out", "o.exr"],
            ]
            .concat(),
            "o.exr",
        ),
        (vec!["mouth", "generate", "--detail=0.25", "-q", "--out", "g.glb"], "g.glb"),
    ] {
        fluorspar(folder, &args).well();
        let usual = fs::read(folder.join(out)).unwrap();
        for name in ["f.film", "p.png", out] {
            let _ = fs::remove_file(folder.join(name));
        }
        for _ in 0..2 {
            let said = Command::new(env!("CARGO_BIN_EXE_fluorspar"))
                .args(&args)
                .env("LD_PRELOAD", &library)
                .env("XDG_CACHE_HOME", folder.join("cache"))
                .current_dir(folder)
                .output()
                .unwrap();
            assert_eq!(said.status.code(), Some(0), "{args:?}: {}", stderr(&said));
            assert!(fs::read(folder.join(out)).unwrap() == usual, "{args:?}");
            let _ = fs::remove_file(folder.join("f.film"));
        }
    }
}
