//! What a job takes is told before it begins, and true; what was not granted is refused.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::fs;

use crate::support::{fluorspar, tiny};

const SIZE: [&str; 3] = ["flat-patch", "--set=render.width_px=200", "--set=render.height_px=150"];

#[test]
fn memory_is_told_within_a_fifth() {
    let folder = tempfile::tempdir().unwrap();
    let mouth = tiny(&["oraleye-2021"]);
    for experiment in [&SIZE[..], &mouth[..]] {
        let args = [&["render"], experiment, &["--spp=1", "--components", "--json", "-q", "--out", "o.exr"]]
            .concat();
        let said = fluorspar(folder.path(), args).json();
        let Some(peak) = said["peak_memory_bytes"].as_f64() else {
            println!("skipped: this system does not tell the memory of a process");
            return;
        };
        let told = said["budget"]["memory_bytes"].as_f64().unwrap();
        let (peak_mib, told_mib) = (peak / f64::from(1 << 20), told / f64::from(1 << 20));
        assert!((peak / told - 1.0).abs() < 0.2, "told {told_mib:.1} MiB, peak {peak_mib:.1} MiB");
        let written = fs::metadata(folder.path().join("o.exr")).unwrap().len() as f64;
        assert!(written < said["budget"]["disk_bytes"].as_f64().unwrap(), "{written} bytes on the disk");
    }
}

#[test]
fn what_a_job_takes_is_told_by_check_and_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let line = " of memory (film ";
    let said = fluorspar(folder.path(), [&["check"], &SIZE[..]].concat()).well();
    assert!(said.stdout.contains("\nA run needs about ") && said.stdout.contains(line), "{}", said.stdout);
    assert!(
        said.stdout.contains(" of disk, about ") && said.stdout.contains(" for rendering\n"),
        "{}",
        said.stdout
    );
    let json = fluorspar(folder.path(), [&["check", "--json"], &SIZE[..]].concat()).json();
    assert!(json["render_seconds"].as_f64().unwrap() > 0.0, "{json}");
    let said = fluorspar(folder.path(), [&["render", "--spp=2"], &SIZE[..]].concat()).well();
    assert!(said.stderr.starts_with("Needs about ") && said.stderr.contains(line), "{}", said.stderr);
    assert!(said.stderr.contains("\nRendering takes about "), "{}", said.stderr);
    let limited = ["render", "--spp=1000000", "--time-limit=1s", "--preview=p.png"];
    let said = fluorspar(folder.path(), [&limited[..], &SIZE].concat()).well();
    assert!(said.stderr.contains("the time limit ends it after 1 s, with about "), "{}", said.stderr);
}

#[test]
fn what_was_not_granted_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["run", "render", "check"] {
        for (limit, why) in [
            (
                "--max-memory=20MiB",
                "error: --max-memory 20.0 MiB: 200 x 150 pixels with 81 bands need about ",
            ),
            ("--max-disk=300kB", "error: --max-disk 0.29 MiB: 200 x 150 pixels with 81 bands take up to "),
            ("--time-limit=0.000001", "one sample of every pixel takes about "),
            ("--max-memory=much", "for instance 8GiB"),
            ("--time-limit=-1", "for instance 20min"),
        ] {
            let said = fluorspar(folder.path(), [&[command, limit], &SIZE[..]].concat());
            assert_eq!(said.code, Some(2), "{command} {limit}: {said:?}");
            assert!(said.stderr.contains(why), "{command} {limit}: {}", said.stderr);
            let left: Vec<_> =
                fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
            assert!(left.is_empty(), "{command} {limit} left {left:?}");
        }
    }
    let granted = ["render", "--spp=1", "--max-memory=1GiB", "--max-disk=1GB", "--time-limit=1h", "-q"];
    fluorspar(folder.path(), [&granted[..], &SIZE].concat()).well();
}
