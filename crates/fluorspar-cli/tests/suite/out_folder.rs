//! The folder of results: it replaces earlier results and nothing else.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{fluorspar, listing, tiny};

/// Every file below a folder with its content.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = listing(folder).into_keys().filter(|path| path.is_file());
    files.map(|path| (path.clone(), fs::read(&path).unwrap())).collect()
}

/// Runs and expects a refusal that leaves everything as it was.
fn refused(folder: &Path, args: &[&str], why: &str) {
    let before = contents(folder);
    let said = fluorspar(folder, tiny(args));
    assert_eq!(said.code, Some(2), "{args:?}: {said:?}");
    assert!(said.stderr.contains(why), "{args:?}: {}", said.stderr);
    assert!(contents(folder) == before, "{args:?} changed something");
}

#[test]
fn a_folder_of_the_user_is_never_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir_all(folder.join("study/data")).unwrap();
    fs::create_dir_all(folder.join("bases")).unwrap();
    fs::write(folder.join("bases/base.toml"), "format = 1\nbase = \"oraleye-2021-surface\"\n").unwrap();
    fs::write(folder.join("study/experiment.toml"), "format = 1\nbase = \"../bases/base.toml\"\n").unwrap();
    fs::write(folder.join("study/results.json"), "{}\n").unwrap();
    fs::write(folder.join("study/data/notes.txt"), "years of work\n").unwrap();

    refused(
        folder,
        &["run", "study/experiment.toml", "--out", "study"],
        "experiment.toml, a file that is read",
    );
    refused(folder, &["run", "study/experiment.toml", "--out", "bases"], "base.toml, a file that is read");
    refused(folder, &["run", "--out", "study"], "not results of fluorspar");
    for out in [".", "./", "..", "study/..", "study/data/../.."] {
        refused(folder, &["run", "--out", out], "the folder you are in");
    }
    let study = folder.join("study");
    refused(&study, &["run", "experiment.toml", "--out", "../study"], "the folder you are in");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&study, folder.join("link")).unwrap();
        refused(folder, &["run", "study/experiment.toml", "--out", "link"], "a file that is read");
    }
}

#[test]
fn only_untouched_results_are_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let run = |args: &[&str]| {
        let mut all = tiny(&["run", "oraleye-2021-surface", "--quiet", "--out", "done"]);
        all.extend(args);
        fluorspar(folder, all).well()
    };
    run(&[]);
    let first = fs::read(folder.join("done/results.json")).unwrap();
    run(&["--seed", "5"]);
    assert_ne!(fs::read(folder.join("done/results.json")).unwrap(), first);
    let beside: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(beside, ["done"]);

    refused(folder, &["run", "done/experiment.toml", "--out", "done"], "a file that is read");
    refused(folder, &["run", "done/report.html", "--out", "done"], "a file that is read");
    refused(folder, &["capture", "done/components.exr", "--out", "done"], "");

    fs::write(folder.join("done/figures/notes.txt"), "mine").unwrap();
    refused(folder, &["run", "--out", "done"], "figures/notes.txt, which is not a result");
    fs::remove_file(folder.join("done/figures/notes.txt")).unwrap();

    let experiment = fs::read_to_string(folder.join("done/experiment.toml")).unwrap();
    fs::write(folder.join("done/experiment.toml"), experiment.replace("seed = 5", "seed = 6")).unwrap();
    refused(folder, &["run", "--out", "done"], "experiment.toml in this folder was changed");
    fs::write(folder.join("done/experiment.toml"), &experiment).unwrap();

    // A list that names files elsewhere deletes nothing there.
    fs::write(folder.join("precious.txt"), "precious").unwrap();
    let list = fs::read_to_string(folder.join("done/fluorspar-folder.json")).unwrap();
    let list = list.replacen("\"files\": {", "\"files\": { \"../precious.txt\": { \"bytes\": 8 },", 1);
    fs::write(folder.join("done/fluorspar-folder.json"), list).unwrap();
    run(&[]);
    assert!(folder.join("precious.txt").is_file() && folder.join("done/report.html").is_file());
}

/// A quick run of the flat patch.
const QUICK: [&str; 10] = [
    "--set",
    "render.samples_per_pixel=2",
    "--set",
    "sensor.columns=32",
    "--set",
    "sensor.rows=24",
    "--set",
    "sensor.pixel_size_um=15",
    "--set",
    "capture.blue.exposure_ms=3",
];

#[test]
fn a_render_is_kept_when_a_later_stage_fails() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // In front of the camera, but behind the patch: only the render finds out.
    let hidden = "format = 1\nbase = \"flat-patch\"\n[[object]]\nname = \"hidden\"\nmaterial = \"patch\"\n\
                  type = \"sphere\"\ncenter_mm = [0.0, 0.0, -50.0]\nradius_mm = 5.0\n[analysis]\nparts = [\"hidden\"]\n";
    fs::write(folder.join("hidden.toml"), hidden).unwrap();
    for kept in ["out", "out-unfinished-1"] {
        let said = fluorspar(folder, [&["run", "hidden.toml", "--out", "out"], &QUICK[..]].concat());
        assert_eq!(said.code, Some(2), "{said:?}");
        assert!(said.stderr.contains("no pixel of the region shows hidden"), "{}", said.stderr);
        let hint =
            format!("The render is kept. Fix the experiment and continue from it: fluorspar capture {kept}");
        assert!(said.stderr.contains(&hint), "{}", said.stderr);
        assert!(folder.join(kept).join("components.exr").is_file());
        assert!(!folder.join(kept).join("report.html").exists());
    }
    fluorspar(folder, ["capture", "out/components.exr", "--out", "frames", "-q"]).well();
    let said = fluorspar(
        folder,
        ["analyze", "frames", "--component-image", "out/components.exr", "--set=analysis.parts=[\"patch\"]"],
    );
    assert!(said.well().stdout.contains("Ratio of amounts a_p/(a_b+a_p)"));
}

#[test]
fn a_control_without_porphyrin_has_a_fraction_of_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let fraction = |change: &str| {
        let run = ["run", "flat-patch", "--json", "-q", "--out", "out", "--set", change];
        let results = fluorspar(folder.path(), [&run[..], &QUICK[..]].concat()).json();
        results["analysis"]["mixture"]["region"]["estimate"]["fraction"].as_f64().unwrap()
    };
    let with = fraction("render.seed=1");
    for none in ["0", "{ dorsal_tongue = { peak = 0.0 } }"] {
        let control = fraction(&format!("material.patch.concentrations.protoporphyrin_ix={none}"));
        // Leaked excitation light is part of the color, with porphyrin as without.
        assert!((0.0..0.01).contains(&control) && with > control + 0.02, "{none}: {control}, {with}");
    }
}

/// An experiment that options change goes beside the results of the unchanged one, and to the same place again.
#[test]
fn changed_settings_keep_the_results_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("patch.toml"), "format = 1\nbase = \"flat-patch\"\n").unwrap();
    fluorspar(folder, ["run", "patch.toml", "-q"]).well();
    let usual = folder.join("fluorspar-out/patch");
    let before = contents(&usual);
    let folders = || fs::read_dir(folder.join("fluorspar-out")).unwrap().count();
    let changed = ["run", "patch.toml", "--set", "capture.blue.exposure_ms=7"];
    for _ in 0..2 {
        let said = fluorspar(folder, changed).well();
        assert!(said.stderr.contains("holds results of other settings and is kept"), "{}", said.stderr);
        assert!(contents(&usual) == before, "the results of the unchanged experiment changed");
        assert_eq!(folders(), 2);
    }
    // Without options the usual folder is that of the file
    fluorspar(folder, ["run", "patch.toml", "-q"]).well();
    assert_eq!(folders(), 2);
}
