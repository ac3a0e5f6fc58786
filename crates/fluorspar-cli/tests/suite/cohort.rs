//! Cohorts: the same numbers in one go, in shards and after a kill; tables, page and refusals.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::support::{fluorspar, listing};

/// Four people without tissue to be solved, some of them with a spot of blood on the lip.
pub(crate) const SMALL: &str = "format = 1\nbase = \"oraleye-2021-surface\"\n[people]\ncount = 4\nviews = [\"lips\"]\n\
                     [spectral]\nfirst_nm = 360.0\nlast_nm = 720.0\nstep_nm = 10.0\n\
                     [render]\nwidth_px = 32\nheight_px = 24\nsamples_per_pixel = 2\n\
                     [sensor]\ncolumns = 64\nrows = 48\npixel_size_um = 37.5\nfill_factor = 0.0044\n[mouth]\ndetail = 0.25\n\
                     [[mouth.lesion]]\nname = \"spot\"\npart = \"lower_lip\"\nsize_mm = [12.0, 6.0]\n\
                     blood_um = 40.0\n";

pub(crate) fn workshop() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("c.toml"), SMALL).unwrap();
    folder
}

/// Content of every file of a folder by its name.
pub(crate) fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = listing(folder).into_keys().filter(|path| path.is_file());
    files.map(|path| (path.strip_prefix(folder).unwrap().to_path_buf(), fs::read(&path).unwrap())).collect()
}

/// Finished views of the journals in a folder. Files that a running command takes away meanwhile are passed over.
pub(crate) fn finished(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let of_entry = |path: PathBuf| {
        if path.is_dir() {
            return finished(&path);
        }
        let text = path.extension().filter(|e| *e == "journal").and_then(|_| fs::read_to_string(&path).ok());
        text.map_or(0, |text| text.matches("\"person\":").count())
    };
    entries.map(of_entry).sum()
}

/// Starts a command whose journals lie in a folder, kills it after two views, and gives how many are finished.
pub(crate) fn kill_after_two_views(here: &Path, folder: &Path, words: [&str; 5]) -> usize {
    fs::create_dir(folder).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_fluorspar"))
        .args(words)
        .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
        .current_dir(here)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    while finished(folder) < 2 && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = finished(folder);
    assert!(before >= 2);
    before
}

#[test]
fn shards_kills_and_threads_give_the_same_files() {
    let folder = workshop();
    let here = folder.path();
    let said = fluorspar(here, ["cohort", "c.toml", "--out", "whole"]).well();
    assert!(said.stdout.contains("people are too few for a range of normal values"), "{}", said.stdout);
    let whole = contents(&here.join("whole"));
    // Nor are there ends of four people, or brackets in the page
    let page = String::from_utf8_lossy(&whole[Path::new("report.html")]);
    assert!(!said.stdout.contains("5 to 95 %") && !page.contains("in brackets"), "{}", said.stdout);
    for name in ["report.html", "results.json", "people.csv", "cohort.csv", "ranges.csv", "chromaticity.png"]
    {
        assert!(whole.contains_key(Path::new(name)), "{name}: {:?}", whole.keys());
    }
    let table = String::from_utf8(whole[Path::new("cohort.csv")].clone()).unwrap();
    let heads = "person,view,part,frame,channel,name,quantity,unit,has_lesion_here,value,low,high,reference,lesions,camera";
    assert_eq!(table.lines().next(), Some(heads));
    let with_lesion = |line: &&str| line.contains(",spot,target_contrast,,1,");
    assert!(
        table.lines().any(|line| with_lesion(&line)) && table.contains(",spot,target_contrast,,0,"),
        "{table}"
    );
    for wanted in ["1,lips,lower_lip,blue,,,chromaticity_r,", "4,lips,upper_gingiva,white,,,chromaticity_g,"]
    {
        assert!(table.lines().any(|line| line.starts_with(wanted)), "{wanted}");
    }
    // The place of the lesion is measured in everybody
    let contrasts =
        table.lines().filter(|line| line.contains(",G,spot,target_contrast,") && line.contains(",blue,"));
    assert_eq!(contrasts.count(), 4);

    // In two shards, one of them with one thread
    let shard = |part: &str, more: &[&str]| {
        let words = ["cohort", "c.toml", "-q", "--out", "parts", "--shard", part];
        fluorspar(here, words.iter().chain(more)).well()
    };
    shard("1/2", &["--threads", "1"]);
    shard("2/2", &[]);
    assert!(!here.join("parts").exists());
    let said = fluorspar(here, ["cohort", "c.toml", "--out", "parts"]).well();
    assert!(said.stderr.contains("4 of 4 views are finished"), "{}", said.stderr);
    assert!(contents(&here.join("parts")) == whole, "two shards differ from one run");

    // Killed after some views: these are not made again
    let killed = here.join("killed");
    let before = kill_after_two_views(here, &killed, ["cohort", "c.toml", "-q", "--out", "killed/c"]);
    let said = fluorspar(here, ["cohort", "c.toml", "--out", "killed/c"]).well();
    assert!(
        before == 4 || said.stderr.contains(&format!("{before} of 4 views are finished")),
        "{}",
        said.stderr
    );
    assert_eq!(finished(&killed), 4);
    assert!(contents(&killed.join("c")) == whole, "a killed run differs from one that was not");

    // Fewer people are a part of them
    let fewer = fluorspar(here, ["cohort", "c.toml", "--set=people.count=2", "--out", "whole"]).well();
    assert!(fewer.stderr.contains("2 of 2 views are finished"), "{}", fewer.stderr);
    // The page holds the cohort
    fs::copy(here.join("whole/report.html"), here.join("page.html")).unwrap();
    let said = fluorspar(here, ["cohort", "page.html", "--json", "--out", "whole"]).well();
    assert!(said.stderr.contains("2 of 2 views are finished"), "{}", said.stderr);
    let again: serde_json::Value = serde_json::from_str(&said.stdout).unwrap();
    assert_eq!(again["people"]["count"], 2);
}

#[test]
fn views_are_those_of_the_lesions_of_the_file() {
    let folder = workshop();
    let examined = |blood: &str| {
        let set = format!("--set=mouth.lesion.spot.blood_um={blood}");
        let words =
            ["cohort", "c.toml", "--set=people.count=1", "--set=people.prevalence=0", &set, "--out", "o"];
        fluorspar(folder.path(), words).stderr
    };
    examined("40");
    assert!(examined("40").contains("1 of 1 views are finished"));
    assert!(!examined("80").contains("are finished"));
}

#[test]
fn what_is_no_cohort_is_refused_before_the_work() {
    let folder = workshop();
    let refused = |words: &[&str]| {
        let said = fluorspar(folder.path(), ["cohort"].iter().chain(words));
        assert_eq!(said.code, Some(2), "{words:?}: {}", said.stderr);
        said.stderr
    };
    for (set, told) in [
        ("people.count=0", "must be a whole number between 1 and 100000"),
        ("people.prevalence=1.5", "must be between 0 and 1"),
        ("people.views=[\"throat\", \"tong\"]", "there is no view of this name"),
        ("render.time_limit_s=60", "depends on the machine"),
        ("mouth.lesion.spot.part=\"nose\"", "the mouth has no part of this name"),
    ] {
        let said = refused(&["c.toml", &format!("--set={set}")]);
        assert!(said.contains(told), "{set}: {said}");
    }
    // Known although nobody has the lesion
    let nobody = "--set=people.prevalence=0";
    assert!(refused(&["c.toml", nobody, "--set=mouth.lesion.spot.states=[\"nosuch\"]"]).contains("nosuch"));
    assert!(refused(&["flat-patch"]).contains("base it on an experiment with [mouth]"));
    assert!(refused(&["c.toml", "--shard", "3/2"]).contains("give I/N"));
    fs::create_dir(folder.path().join("mine")).unwrap();
    fs::write(folder.path().join("mine/notes.txt"), "mine").unwrap();
    assert!(
        refused(&["c.toml", "--out", "mine"]).contains("notes.txt")
            || folder.path().join("mine/notes.txt").exists()
    );
    assert_eq!(listing(folder.path()).len(), 3);
}
