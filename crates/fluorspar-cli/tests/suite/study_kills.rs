//! Studies whose commands are killed at random moments lose nothing and hold nothing twice.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::kills::Random;
use crate::study::{photographs, study};

const PEOPLE: usize = 8;

/// What a study says, without times.
fn said(folder: &Path) -> (String, usize) {
    let rows = study(folder, &["query", "--json"]).well().stdout;
    let files = crate::support::listing(&folder.join("st")).into_keys();
    let files: Vec<_> =
        files.filter(|path| path.is_file() && !path.to_string_lossy().contains(".fluorspar")).collect();
    (rows, files.len())
}

/// Import, analyze and reindex, each killed and repeated: the log only grows, and in the end the study says what one says that nobody
/// disturbed.
#[test]
fn killed_studies_lose_nothing() {
    let kills: usize = std::env::var("FLUORSPAR_KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(12);
    let work = tempfile::tempdir().unwrap();
    photographs(work.path(), PEOPLE);
    study(work.path(), &["init", "--experiment", "violet.toml"]).well();
    let steps = [&["import", "photos"][..], &["analyze"], &["reindex"]];
    let times: Vec<Duration> = steps
        .iter()
        .map(|step| {
            let begun = Instant::now();
            study(work.path(), step).well();
            begun.elapsed()
        })
        .collect();
    let whole = said(work.path());
    let mut random = Random(7);
    let mut hit = 0;
    let mut folder = tempfile::tempdir_in(work.path()).unwrap();
    let mut begin = true;
    for turn in 0.. {
        assert!(turn < 30 * kills.max(1), "the commands are too fast to be hit");
        if hit >= kills {
            break;
        }
        if begin {
            folder = tempfile::tempdir_in(work.path()).unwrap();
            photographs(folder.path(), PEOPLE);
            study(folder.path(), &["init", "--experiment", "violet.toml"]).well();
        }
        begin = false;
        let step = turn % 3;
        let before = fs::read(folder.path().join("st/log.jsonl")).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_fluorspar"))
            .args(["-q", "study", steps[step][0], "st"].iter().chain(&steps[step][1..]))
            .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(times[step].mul_f64(random.share()));
        hit += usize::from(child.try_wait().unwrap().is_none());
        child.kill().unwrap();
        child.wait().unwrap();
        let after = fs::read(folder.path().join("st/log.jsonl")).unwrap();
        assert!(after.starts_with(&before), "{:?} lost lines", steps[step]);
        study(folder.path(), &["verify"]).well();
        if step == 2 {
            // Everything again to its end
            steps.iter().for_each(|step| drop(study(folder.path(), step).well()));
            study(folder.path(), &["verify"]).well();
            assert_eq!(said(folder.path()), whole);
            begin = true;
        }
    }
}
