//! Processes that get less memory or smaller files than they need: one line, exit code 1, nothing left behind.

#![cfg(target_os = "linux")] // Other systems have no such limit on addresses.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the program with a limit of the shell, such as `-v 100000` (KiB of addresses).
pub(crate) fn limited(folder: &Path, limit: &str, args: &[&str]) -> Output {
    let line = format!("ulimit {limit} && exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &line, env!("CARGO_BIN_EXE_fluorspar"), "--threads", "2"]).args(args);
    command.current_dir(folder).output().unwrap()
}

fn stderr(said: &Output) -> String {
    String::from_utf8(said.stderr.clone()).unwrap()
}

#[test]
fn too_little_memory_is_an_error_that_names_images_and_surfaces() {
    let folder = tempfile::tempdir().unwrap();
    // 1.6 GiB of images.
    let size =
        ["width_px=600", "height_px=600", "component_bands=all"].map(|size| format!("--set=render.{size}"));
    let size = [size.each_ref().map(String::as_str).as_slice(), &["--spp=1", "-q"]].concat();
    let said = limited(folder.path(), "-v 500000", &[&["render", "flat-patch"], &size[..]].concat());
    let message = stderr(&said);
    assert_eq!(said.status.code(), Some(1), "{message}");
    assert!(
        message.starts_with("error: not enough memory: the images take 1.57 GiB (600 x 600 pixels"),
        "{message}"
    );
    assert!(message.contains("the surfaces about") && message.contains("bands of rows"), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn whatever_memory_is_refused_the_end_is_an_exit_code_and_one_line() {
    let small = ["--set=render.width_px=60", "--set=render.height_px=60", "--spp=1", "-q", "--out", "o.exr"];
    let render = [&["render", "flat-patch"], &small[..]].concat();
    let mut refused = 0;
    for args in [&render[..], &["lens", "report", "wide_3_5mm"], &["check", "flat-patch", "-q"]] {
        for mib in [24, 32, 40, 48, 64, 80, 96, 112, 128, 160] {
            let folder = tempfile::tempdir().unwrap();
            let limit = format!("-v {}", mib << 10);
            // Below the size of the program itself the system does not even begin it.
            if !limited(folder.path(), &limit, &["--version"]).status.success() {
                continue;
            }
            let said = limited(folder.path(), &limit, args);
            // With too little memory for one more thread the program runs without its own answer to Ctrl-C, and says so.
            let lines = stderr(&said);
            let lines =
                lines.lines().filter(|line| !line.starts_with("warning: Ctrl-C will end the program"));
            let message: String = lines.map(|line| format!("{line}\n")).collect();
            match said.status.code() {
                Some(0) => assert_eq!(message, "", "{args:?} {mib}"),
                Some(1) => {
                    refused += 1;
                    assert!(message.starts_with("error: "), "{args:?} {mib}: {message}");
                    assert_eq!(message.lines().count(), 1, "{args:?} {mib}: {message}");
                }
                other => panic!("{args:?} {mib}: {other:?} {:?}: {message}", said.status),
            }
            assert!(!folder.path().join("o.exr").exists() || said.status.success(), "{args:?} {mib}");
        }
    }
    assert!(refused > 3, "{refused}");
}

#[test]
fn a_limit_on_the_size_of_files_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let size = ["--set=render.width_px=60", "--set=render.height_px=60", "--spp=1", "-q"];
    // Blocks of 512 or 1024 bytes; the image has more than a megabyte.
    let args = [&["render", "flat-patch", "--out", "o.npy"], &size[..]].concat();
    let said = limited(folder.path(), "-f 100", &args);
    let message = stderr(&said);
    assert_eq!(said.status.code(), Some(1), "{message}");
    assert!(message.starts_with("error: o.npy: can't write it: File too large"), "{message}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn threads_beyond_all_reason_are_not_begun() {
    let folder = tempfile::tempdir().unwrap();
    let said = Command::new(env!("CARGO_BIN_EXE_fluorspar"))
        .args(["catalog", "list", "--json"])
        .env("RAYON_NUM_THREADS", "99999999999")
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(said.status.code(), Some(0), "{}", stderr(&said));
}
