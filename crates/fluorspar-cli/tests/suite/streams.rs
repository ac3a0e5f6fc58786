//! Standard error and standard output that are closed, full, or no longer read: the work is finished all the same.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::support::{fluorspar, tiny};

/// The program in a folder.
fn program<'a>(folder: &Path, args: impl IntoIterator<Item = &'a str>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fluorspar"));
    command.args(args).current_dir(folder).env_remove("COLUMNS");
    command
}

/// The same with its streams as a shell redirects them, such as `2>&-`.
fn redirected(folder: &Path, redirections: &str, args: &[&str]) -> Output {
    let line = format!("exec \"$0\" \"$@\" {redirections}");
    let mut command = Command::new("sh");
    command.args(["-c", &line, env!("CARGO_BIN_EXE_fluorspar")]).args(args).current_dir(folder);
    command.output().unwrap()
}

/// Every command that writes messages, with what it must leave behind. They write more than one message each.
fn talkative() -> Vec<(Vec<&'static str>, &'static str)> {
    let tiny_run = tiny(&["run", "oraleye-2021-surface", "--out", "out"]);
    let patch = ["--set=render.width_px=20", "--set=render.height_px=20", "--spp=8"];
    let render = [&["render", "flat-patch", "--out", "out.exr", "--film", "out.film"], &patch[..]].concat();
    let bands = [&render[..], &["--set=render.memory_limit_gib=0.006"]].concat();
    vec![
        (tiny_run, "out/report.html"),
        (render, "out.exr"),
        (bands, "out.exr"),
        (vec!["mouth", "sample", "--count", "2", "--out", "out"], "out/people.csv"),
        (vec!["lens", "report", "wide_3_5mm", "--out", "out.svg"], "out_field.svg"),
        (
            vec!["catalog", "plot", "fluorophore", "elastin", "--light", "led_385", "--out", "out.svg"],
            "out_emission.svg",
        ),
    ]
}

#[test]
fn work_is_finished_when_nobody_reads_the_messages() {
    for (args, result) in talkative() {
        let folder = tempfile::tempdir().unwrap();
        let mut child = program(folder.path(), args.iter().copied())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // A reader that goes before the first message; those of `head -1` and of a dead `tee` go a little later.
        drop(child.stderr.take());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{args:?}");
        assert!(folder.path().join(result).is_file(), "{args:?}");
    }
}

#[test]
fn a_reader_of_one_line_does_not_end_a_run() {
    let folder = tempfile::tempdir().unwrap();
    let args = tiny(&["run", "oraleye-2021-surface", "--out", "out"]);
    // As `2>&1 | head -1`: both streams are one pipe.
    let line = "{ \"$0\" \"$@\"; echo $? > code; } 2>&1 | head -1";
    let said = Command::new("sh")
        .args(["-c", line, env!("CARGO_BIN_EXE_fluorspar")])
        .args(&args)
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(String::from_utf8(said.stdout).unwrap().lines().count(), 1);
    assert_eq!(fs::read_to_string(folder.path().join("code")).unwrap(), "0\n");
    assert!(folder.path().join("out/report.html").is_file());
}

#[test]
fn closed_and_full_streams_of_messages_change_nothing() {
    for redirections in ["2>&-", ">&-", ">&- 2>&-", "<&- >&- 2>&-", "2> /dev/full"] {
        let folder = tempfile::tempdir().unwrap();
        let args =
            ["render", "flat-patch", "--set=render.width_px=20", "--set=render.height_px=20", "--spp=8"];
        let said = redirected(folder.path(), redirections, &args);
        assert_eq!(said.status.code(), Some(0), "{redirections}");
        assert!(folder.path().join("radiance.exr").is_file(), "{redirections}");
        // Nothing of the messages went into another file that got the number of a closed stream.
        let whole = fs::read(folder.path().join("radiance.exr")).unwrap();
        fluorspar(folder.path(), [&args[..], &["--out", "again.exr"]].concat()).well();
        assert!(whole == fs::read(folder.path().join("again.exr")).unwrap(), "{redirections}");
    }
}

#[test]
fn exit_codes_do_not_depend_on_a_reader_of_the_messages() {
    let folder = tempfile::tempdir().unwrap();
    for (args, code) in [
        (vec!["run", "missing.toml"], 2),
        (vec!["run", "--frobnicate"], 2),
        (vec!["check", "oraleye-2012"], 2),
        (vec!["--version"], 0),
    ] {
        for redirections in ["2>&-", "2> /dev/full"] {
            let said = redirected(folder.path(), redirections, &args);
            assert_eq!(said.status.code(), Some(code), "{args:?} {redirections}");
        }
        let mut child = program(folder.path(), args.iter().copied())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stderr.take());
        assert_eq!(child.wait().unwrap().code(), Some(code), "{args:?}");
    }
}

#[test]
fn an_answer_whose_reader_has_gone_ends_quietly() {
    for args in [
        vec!["catalog", "list", "--json"],
        vec!["completions", "bash"],
        vec!["schema"],
        vec!["--help"],
        vec!["predict", "--json"],
        vec!["catalog", "list", "sensor"],
        vec!["check", "flat-patch"],
    ] {
        let folder = tempfile::tempdir().unwrap();
        let mut child = program(folder.path(), args.iter().copied())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Closed before anything is read.
        drop(child.stdout.take());
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert!(!said.contains("error"), "{args:?}: {said}");
        assert_eq!(child.wait().unwrap().code(), Some(0), "{args:?}");
    }
}

#[test]
fn a_summary_whose_reader_has_gone_does_not_end_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["sensor", "characterize", "pi_camera_3", "--out", "c", "--levels=20", "--region", "64", "48"];
    let mut child =
        program(folder.path(), args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    // What comes behind the answer is said.
    assert!(said.contains("Wrote "), "{said}");
}

#[test]
fn an_answer_that_finds_no_room_is_an_error() {
    if File::options().write(true).open("/dev/full").is_err() {
        println!("skipped: this system has no /dev/full");
        return;
    }
    for args in
        [vec!["catalog", "list", "--json"], vec!["completions", "bash"], vec!["--help"], vec!["--version"]]
    {
        let folder = tempfile::tempdir().unwrap();
        let full = File::options().write(true).open("/dev/full").unwrap();
        let said = program(folder.path(), args.iter().copied()).stdout(full).output().unwrap();
        let message = String::from_utf8(said.stderr).unwrap();
        assert_eq!(said.status.code(), Some(1), "{args:?}: {message}");
        assert!(message.starts_with("error: can't write to standard output: No space left"), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
}
