//! Every stage from files, at a tiny size: run, render, capture, analyze, and what is printed for people and editors.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use crate::support::{fluorspar, keeps_format, listing, tiny, without_findings};
use serde_json::Value;

fn bytes(folder: &Path, name: &str) -> Vec<u8> {
    fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

const RAW: [&str; 3] = ["raw_ambient.tiff", "raw_white.tiff", "raw_blue.tiff"];

#[test]
fn every_stage_continues_from_the_files_of_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let said = fluorspar(folder, tiny(&["run", "oraleye-2021", "--out", "run"])).well();
    assert!(said.stdout.starts_with("Porphyrin: "), "{}", said.stdout);
    assert!(said.stderr.contains("Done in"), "{}", said.stderr);
    for name in ["report.html", "results.json", "experiment.toml", "components.exr", "radiance_blue.exr"] {
        assert!(!bytes(folder, &format!("run/{name}")).is_empty(), "{name}");
    }
    assert!(folder.join("run/figures/chromaticity.svg").is_file());
    let results: Value = serde_json::from_slice(&bytes(folder, "run/results.json")).unwrap();
    keeps_format("results", &results);
    assert!(
        results["analysis"]["counts"]["valid"].as_u64().unwrap() > 40,
        "{}",
        results["analysis"]["counts"]
    );

    // capture: the same frames from the component image, which carries its experiment.
    let args = ["capture", "run/components.exr", "--out", "frames", "--json"];
    let captured = fluorspar(folder, args).json();
    assert_eq!(captured["frames"].as_array().map(Vec::len), Some(3));
    keeps_format("capture-results", &serde_json::from_slice(&bytes(folder, "frames/results.json")).unwrap());
    for name in RAW {
        assert_eq!(bytes(folder, &format!("frames/{name}")), bytes(folder, &format!("run/{name}")), "{name}");
    }
    // ... and other frames, without rendering, when the camera changes.
    let args =
        ["capture", "run/components.exr", "--set", "capture.blue.exposure_ms=15", "--out", "dim", "-q"];
    fluorspar(folder, args).well();
    assert_eq!(bytes(folder, "dim/raw_ambient.tiff"), bytes(folder, "run/raw_ambient.tiff"));
    assert_ne!(bytes(folder, "dim/raw_blue.tiff"), bytes(folder, "run/raw_blue.tiff"));

    // analyze: the same numbers from the raw frames.
    let again = fluorspar(folder, ["analyze", "run", "--json"]).json();
    assert_eq!(without_findings(again), results["analysis"]);
    let args = ["analyze", "frames", "--component-image", "run/components.exr", "--json"];
    assert_eq!(without_findings(fluorspar(folder, args).json()), results["analysis"]);
    let said = fluorspar(folder, ["analyze", "run"]).well();
    assert!(said.stdout.starts_with("Frame \"blue\", tongue dorsum, tip and lateral\n"), "{}", said.stdout);

    // cite: what the run rests on, from the page in its folder; what is no run is refused.
    let cited = fluorspar(folder, ["cite", "run", "--json"]).json();
    assert_eq!(cited["experiment_sha256"], results["experiment_sha256"]);
    assert_eq!(cited["has_changed"], false);
    let of_collagen = |source: &&Value| source["entries"].to_string().contains("fluorophore collagen");
    let source = cited["data"].as_array().unwrap().iter().find(of_collagen).unwrap();
    assert!(source["source"].as_str().unwrap().starts_with("DaCosta"), "{source}");
    assert!(cited["methods"].to_string().contains("layered tissue"), "{cited}");
    let said = fluorspar(folder, ["cite", "frames"]);
    assert_eq!(said.code, Some(2));
    assert!(said.stderr.contains("there is no report.html in this folder"), "{}", said.stderr);

    // Maps of its pixels, and two spots compared.
    let args = [
        "analyze",
        "run",
        "--out",
        "maps",
        "--json",
        "--set",
        "analysis.compared_px=[[2, 2, 14, 20], [16, 2, 14, 20]]",
    ];
    let compared = fluorspar(folder, args).json();
    let spots = compared["spots"].as_array().unwrap();
    assert!(spots.iter().any(|spot| spot["d_prime"].as_f64().unwrap() > 0.0), "{compared}");
    for name in ["share", "low", "high", "limit"] {
        assert!(bytes(folder, &format!("maps/porphyrin_{name}.npy")).starts_with(b"\x93NUMPY"), "{name}");
    }
    assert!(folder.join("maps/porphyrin_limit_map.png").is_file());

    // The report is a scene, too: it is listed, read and changed by name.
    let tree = fluorspar(folder, ["scene", "tree", "run/report.html"]).well().stdout;
    assert!(tree.contains("tongue_dorsum/ ") && tree.contains("light.blue "), "{tree}");
    let get = ["scene", "get", "run/report.html", "render.samples_per_pixel", "capture.blue.gain"];
    let kept = fluorspar(folder, ["scene", "get", "run/experiment.toml", get[3], get[4]]).well().stdout;
    assert_eq!(fluorspar(folder, get).well().stdout, kept);
    let set = ["scene", "set", "run/report.html", "light.*.strength.power_mw=7", "--out", "seven.toml", "-q"];
    fluorspar(folder, set).well();
    let seven = fluorspar(folder, ["scene", "get", "seven.toml", "light.blue.strength"]).well().stdout;
    assert_eq!(seven, "light.blue.strength = { power_mw = 7.0 }\n");
    fluorspar(folder, ["scene", "check", "run/report.html", "-q"]).well();

    // The report, and the experiment beside it, make the run again to the last bit, on any number of threads.
    for (source, out, threads) in [("run/report.html", "second", "1"), ("run/experiment.toml", "third", "3")]
    {
        let said = fluorspar(folder, ["run", source, "--out", out, "--json", "--threads", threads]);
        let second = said.json();
        for name in RAW {
            assert_eq!(
                bytes(folder, &format!("{out}/{name}")),
                bytes(folder, &format!("run/{name}")),
                "{source}"
            );
        }
        assert_eq!(second, results, "{source}");
        assert_eq!(
            bytes(folder, &format!("{out}/components.exr")).len(),
            bytes(folder, "run/components.exr").len()
        );
    }

    // Results are replaced, and nothing unfinished stays.
    fluorspar(folder, ["capture", "run/components.exr", "--out", "frames", "-q"]).well();
    let hidden = |path: &std::path::PathBuf| path.file_name().unwrap().to_string_lossy().starts_with('.');
    let left: Vec<_> = listing(folder).into_keys().filter(hidden).collect();
    assert!(left.is_empty(), "{left:?}");
}

/// Another filter, sensor or concentration in a finished render: the frames of a new run of the same seed, or a refusal.
#[test]
fn a_finished_render_is_seen_by_other_cameras_and_with_other_concentrations() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fluorspar(folder, tiny(&["run", "oraleye-2021", "--out", "run", "-q"])).well();
    let other = ["--set", "view_filter.filters=[\"view_425_700\"]", "--set", "sensor.bit_depth=12"];
    let again: Vec<&str> = ["run", "oraleye-2021", "--out", "other", "-q"].into_iter().chain(other).collect();
    fluorspar(folder, tiny(&again)).well();
    let taken = ["capture", "run/components.exr", "--out", "taken", "-q"].into_iter().chain(other);
    fluorspar(folder, taken).well();
    for name in RAW {
        assert_eq!(
            bytes(folder, &format!("taken/{name}")),
            bytes(folder, &format!("other/{name}")),
            "{name}"
        );
    }

    // The render has 16 columns: one covers 2 of the sensor that it was made for, and 20 of this one
    let larger =
        ["--set", "sensor.columns=320", "--set", "sensor.rows=240", "--set", "sensor.pixel_size_um=7.5"];
    let args = ["capture", "run/components.exr", "--out", "larger"].into_iter().chain(larger);
    let said = fluorspar(folder, args).well();
    assert!(
        said.stderr.contains("one pixel of the render covers 20.0 x 20.0 pixels of the sensor"),
        "{}",
        said.stderr
    );
    assert!(said.stderr.contains("render.width_px=80 and render.height_px=60"), "{}", said.stderr);
    let same = fluorspar(folder, ["capture", "run/components.exr", "--out", "same"]).well();
    assert!(!same.stderr.contains("one pixel of the render"), "{}", same.stderr);
    let half = ["--set", "concentration.collagen=0.5"];
    let args = ["capture", "run/components.exr", "--out", "half"].into_iter().chain(half);
    let said = fluorspar(folder, args).well();
    assert!(said.stderr.contains("exact but for light that fluoresced twice"), "{}", said.stderr);
    let args = ["analyze", "half", "--component-image", "run/components.exr", "--json"];
    let analysis = fluorspar(folder, args).json();
    let before = fluorspar(folder, ["analyze", "run", "--json"]).json();
    let median = |analysis: &Value| analysis["channels"][1]["statistics"]["median"].as_f64().unwrap();
    assert!(median(&analysis) < median(&before), "less collagen is darker");

    fluorspar(folder, ["sheet", "run/components.exr", "--width", "64", "--out", "sheet.png", "-q"]).well();
    assert!(bytes(folder, "sheet.png").starts_with(b"\x89PNG"));
    let preview = "concentration.elastin={ mask = \"run/preview_blue.png\", inside = 2.0 }";
    let panel = format!("painted: {preview}");
    let args = ["sheet", "run/components.exr", "--panel", "as it is:", "--panel", &panel, "--out", "two.png"];
    assert!(fluorspar(folder, args).well().stderr.contains("A painted mask"));
    for (args, part) in [
        (vec!["run", "oraleye-2021", "--set", preview], "painted on a finished render"),
        (vec!["capture", "run/components.exr", "--set", "concentration.elastine=2"], "did you mean"),
        (vec!["capture", "run/components.exr", "--set", "mouth.seed=2"], "render the experiment again"),
        (
            vec!["capture", "run/components.exr", "--set", "light.blue.strength.power_mw=4000"],
            "(which --set capture.blue.light_groups.blue=2 changes without a render)",
        ),
        (vec!["sheet", "run/components.exr", "--panel", "no title"], "write a title, a colon"),
        (vec!["sheet", "run/components.exr", "--capture", "red"], "there is no capture"),
    ] {
        let said = fluorspar(folder, args);
        assert!(said.code == Some(2) && said.stderr.contains(part), "{}", said.stderr);
    }
}

#[test]
fn spectra_are_rendered_into_files_of_every_kind() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let render = |args: &[&str]| {
        let mut all = tiny(&["render", "oraleye-2021"]);
        all.extend(args);
        fluorspar(folder, all).well()
    };
    let sum = render(&["--out", "sum.exr", "--preview", "sum.png", "--json"]).json();
    assert_eq!((&sum["width_px"], &sum["unit"]), (&16.into(), &"W/(sr m^2 nm)".into()));
    assert_eq!(sum["mean_radiance"].as_array().map(Vec::len), Some(81));
    assert!(bytes(folder, "sum.exr").starts_with(&[0x76, 0x2f, 0x31, 0x01]));
    assert!(bytes(folder, "sum.png").starts_with(b"\x89PNG"));
    render(&["--out", "sum.npy", "-q"]);
    assert!(bytes(folder, "sum.npy").starts_with(b"\x93NUMPY"));
    let beside: Vec<_> =
        listing(folder).into_keys().filter(|p| p.extension().is_some_and(|e| e == "json")).collect();
    assert_eq!(beside.len(), 1, "{beside:?}");
    render(&["--out", "parts.npy", "--components", "-q"]);
    render(&["--out", "parts.exr", "--components", "-q"]);

    // Frames of a rendered component image are those of the run.
    fluorspar(folder, ["capture", "parts.exr", "--out", "frames", "-q"]).well();
    fluorspar(folder, tiny(&["run", "oraleye-2021", "--out", "run", "-q"])).well();
    for name in RAW {
        assert_eq!(bytes(folder, &format!("frames/{name}")), bytes(folder, &format!("run/{name}")), "{name}");
    }
}

#[test]
fn a_quiet_run_says_nothing_but_its_answer() {
    let folder = tempfile::tempdir().unwrap();
    let said = fluorspar(folder.path(), tiny(&["run", "--quiet"])).well();
    assert_eq!(said.stderr, "");
    assert!(said.stdout.starts_with("Porphyrin: "), "{}", said.stdout);
    assert!(folder.path().join("fluorspar-out/oraleye-2021/report.html").is_file());
}

#[test]
fn files_are_checked_without_being_run() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let said = fluorspar(folder, ["check", "flat-patch"]).well();
    assert!(said.stdout.starts_with("flat-patch: valid. "), "{}", said.stdout);
    // What a run may change, a check may
    let seconds = |samples: &str| {
        fluorspar(folder, ["check", "flat-patch", "--spp", samples, "--depth", "2", "--seed", "3", "--json"])
            .json()["render_seconds"]
            .clone()
    };
    assert!(seconds("4000").as_f64() > seconds("1").as_f64());
    let said = fluorspar(folder, ["check", "oraleye-2021", "--json", "--set", "render.seed=3"]).json();
    assert_eq!((&said["kind"], &said["valid"]), (&"experiment".into(), &true.into()));
    let said = fluorspar(folder, ["check"]).well();
    assert!(said.stdout.starts_with("built-in oraleye-2021: valid. "), "{}", said.stdout);
    assert_eq!(fluorspar(folder, ["check"]).well().stderr, "");
    let away =
        fluorspar(folder, ["check", "fluorescent-sphere", "--set", "camera.look_at_mm=[0, 500, 500]"]).well();
    assert!(away.stderr.contains("the camera sees no object"), "{}", away.stderr);
    let said = fluorspar(folder, ["check", "tongue-385nm"]).well();
    assert_eq!(said.stdout, "tongue-385nm: valid. A flat sample with 5 fluorophores, 81 bands\n");
    fs::write(
        folder.join("s.toml"),
        fluorspar(folder, ["catalog", "show", "sample", "tongue-385nm"]).well().stdout,
    )
    .unwrap();
    let said = fluorspar(folder, ["check", "s.toml", "--json", "--set", "spectral.step_nm=10"]).json();
    assert_eq!((&said["kind"], &said["bands"]), (&"sample".into(), &41.into()));
    assert_eq!(listing(folder).len(), 1);
}

#[test]
fn the_catalogue_is_listed_and_printed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let list = fluorspar(folder, ["catalog", "list", "--json"]).json();
    let kinds: Vec<&str> = list.as_array().unwrap().iter().filter_map(|e| e["kind"].as_str()).collect();
    for kind in ["light spectrum", "filter", "sensor", "fluorophore", "experiment", "flat sample"] {
        assert!(kinds.contains(&kind), "{kind}");
    }
    assert!(fluorspar(folder, ["catalog", "list"]).well().stdout.contains("  oraleye-2021 "));
    let text = fluorspar(folder, ["catalog", "show", "experiment", "oraleye-2021"]).well().stdout;
    fs::write(folder.join("mine.toml"), text).unwrap();
    fluorspar(folder, ["check", "mine.toml"]).well();
}

#[test]
fn schemas_and_completions_are_printed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let experiment = fluorspar(folder, ["schema"]).json();
    let sample = fluorspar(folder, ["schema", "sample"]).json();
    assert!(experiment["properties"]["capture"].is_object() && sample["properties"]["sample"].is_object());
    let calibration = fluorspar(folder, ["schema", "calibration"]).json();
    assert_eq!(calibration["required"], serde_json::json!(["format", "experiment", "dark", "flat"]));
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let said = fluorspar(folder, ["completions", shell]).well();
        assert!(said.stdout.contains("fluorspar") && said.stdout.contains("predict"), "{shell}");
    }
}

#[test]
fn help_names_every_command_and_option() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let help = |args: &[&str]| {
        let said = fluorspar(folder, args).well();
        assert_eq!(said.stderr, "", "{args:?}");
        said.stdout
    };
    let all = help(&["--help"]);
    for command in [
        "run",
        "render",
        "merge",
        "denoise",
        "capture",
        "analyze",
        "fluorophore",
        "predict",
        "safety",
        "spectroradiometer",
        "catalog",
        "check",
        "schema",
        "completions",
    ] {
        assert!(all.contains(&format!("\n  {command} ")), "{command}: {all}");
        assert!(help(&[command, "--help"]).contains("Usage: fluorspar "), "{command}");
        assert!(help(&["help", command]).contains("Usage: "), "{command}");
    }
    for words in [["catalog", "list"], ["catalog", "show"], ["catalog", "plot"], ["fluorophore", "import"]] {
        assert!(help(&[words[0], words[1], "--help"]).contains("Usage: "), "{words:?}");
    }
    let predict = help(&["predict", "-h"]);
    for option in
        ["--light", "--irradiance", "--light-filter", "--reflectance", "--concentration", "--view-filter"]
    {
        assert!(predict.contains(option), "{option}");
    }
    assert_eq!(help(&["--version"]), format!("fluorspar {}\n", env!("CARGO_PKG_VERSION")));
}
