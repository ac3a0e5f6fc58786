//! Two finished runs side by side: settings, numbers with intervals, frames; and what is refused.

#![allow(clippy::unwrap_used, reason = "a helper that fails is a failed test")]

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::report_pages::{browser, fits};
use super::support::{fluorspar, keeps_format};

const SIZE: [&str; 5] = [
    "--set=render.width_px=16",
    "--set=render.height_px=12",
    "--set=sensor.columns=32",
    "--set=sensor.rows=24",
    "--set=render.samples_per_pixel=2",
];

fn run(folder: &Path, name: &str, changes: &[&str]) {
    let args = [&["run", "flat-patch", "-q", "--out", name][..], changes, &SIZE];
    fluorspar(folder, args.concat()).well();
}

fn compare(folder: &Path, a: &str, b: &str) -> Value {
    fluorspar(folder, ["compare", a, b, "--json"]).json()
}

/// A share as comparisons have it.
fn percent(share: &Value) -> f64 {
    100.0 * share.as_f64().unwrap()
}

/// The row of a quantity.
fn row<'a>(found: &'a Value, quantity: &str) -> &'a Value {
    let rows = found["numbers"].as_array().unwrap();
    let named = |row: &&Value| row["quantity"].as_str().unwrap().starts_with(quantity);
    rows.iter().find(named).unwrap_or_else(|| panic!("no {quantity}: {found}"))
}

#[test]
fn runs_are_compared_by_settings_numbers_and_frames() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    run(folder, "a", &[]);
    run(folder, "b", &["--set=light.blue.spectrum=led_405"]);
    let found = compare(folder, "a", "b/report.html");
    keeps_format("compare-results", &found);
    let paths: Vec<&str> =
        found["settings"].as_array().unwrap().iter().map(|s| s["path"].as_str().unwrap()).collect();
    assert_eq!(paths, ["light.blue.spectrum"]);
    assert_eq!(found["settings"][0]["a"], "led_385");
    assert_eq!(found["settings"][0]["b"], "led_405");
    // The numbers are those of both files
    let results = |name: &str| -> Value {
        serde_json::from_str(&fs::read_to_string(folder.join(name).join("results.json")).unwrap()).unwrap()
    };
    let share = row(&found, "Porphyrin share on the mixture line");
    for side in ["a", "b"] {
        let budget = &results(side)["analysis"]["budget"];
        assert_eq!(share[side]["value"], percent(&budget["share"]));
        for end in [0, 1] {
            assert_eq!(share[side]["interval"][end], percent(&budget["total_interval"][end]));
        }
        assert_eq!(row(&found, "Detection limit of")[side]["value"], percent(&budget["detection_limit"]));
        let leak = row(&found, "Leak of frame \"blue\"")[side]["value"].as_f64().unwrap();
        assert!((leak - 100.0 * results(side)["leak_ratio"].as_f64().unwrap()).abs() < 1e-9);
    }
    // The share of the light of the same porphyrin is half as large again under 405 nm, far beyond either interval
    let [low, _] = [0, 1].map(|end| share["difference_interval"][end].as_f64().unwrap());
    assert!(share["told_apart"] == "apart" && low > 0.0, "{share}");
    let error = row(&found, "Porphyrin share on the mixture line less the true share");
    let truth = results("b")["analysis"]["truth"]["share"].as_f64().unwrap();
    let expected = share["b"]["value"].as_f64().unwrap() - 100.0 * truth;
    assert!((error["b"]["value"].as_f64().unwrap() - expected).abs() < 1e-12, "{error}");
    assert_eq!(row(&found, "Median signal in R")["told_apart"], "not_judged");
    assert!(found["warnings"][0].as_str().unwrap().contains("true shares are others"), "{found}");
    // The design with the smaller detection limit, in units of what is there, is named
    let [of_a, of_b] = ["a", "b"]
        .map(|side| row(&found, "Detection limit over the true share")[side]["value"].as_f64().unwrap());
    assert!(of_b < 0.9 * of_a, "{of_a} {of_b}");
    let verdict = found["verdict"].as_str().unwrap();
    assert!(
        verdict.starts_with("B sees smaller amounts of porphyrin than A.") && verdict.contains("noise alone"),
        "{verdict}"
    );
    assert!(verdict.contains("by the noise of sensor and render"), "{verdict}");
    // Another seed of the same experiment is no other camera
    run(folder, "seed", &["--set=render.seed=7"]);
    let repeated = compare(folder, "a", "seed");
    let same = repeated["verdict"].as_str().unwrap();
    assert!(same.starts_with("A and B are not told apart by the smallest amounts of porphyrin"), "{same}");
    // Without the picture of the frame it is not known how many pixels of the render lie behind the region
    fs::remove_file(folder.join("seed/preview_blue.png")).unwrap();
    let unknown = compare(folder, "b", "seed");
    let unknown = unknown["verdict"].as_str().unwrap();
    assert!(
        unknown.contains("is not known, so neither is called better: of B preview_blue.png is missing"),
        "{unknown}"
    );
    assert!(unknown.contains("compare the whole folder"), "{unknown}");
    let said = fluorspar(folder, ["compare", "a", "b", "--out", "ab"]).well();
    assert!(said.stdout.contains(verdict), "{}", said.stdout);
    for part in ["light.blue.spectrum", "led_405", "told apart", "Intervals are of 95 %", "Safe captures"] {
        assert!(said.stdout.contains(part), "{part}: {}", said.stdout);
    }
    for file in ["report.html", "results.json", "blue_a.png", "blue_b.png", "figures/shares.svg"] {
        assert!(folder.join("ab").join(file).is_file(), "{file}");
    }
    let page = fs::read_to_string(folder.join("ab/report.html")).unwrap();
    assert!(page.contains("Both pictures have one scale") && !page.contains("Run it again"));
    assert_eq!(page.matches("data:image/png").count(), 2);
    if let Some(browser) = browser() {
        for screen in [[390, 844], [1280, 800]] {
            fits(&browser, "a comparison", &folder.join("ab"), screen);
        }
    }
    // The same experiment again: nothing differs
    run(folder, "again", &[]);
    let found = compare(folder, "a", "again/results.json");
    assert_eq!(found["settings"], Value::Array(Vec::new()));
    let verdicts = found["numbers"].as_array().unwrap().iter().map(|row| &row["told_apart"]);
    assert!(verdicts.clone().count() > 10 && verdicts.clone().all(|v| v == "same"), "{found}");
    assert!(found["warnings"][0].as_str().unwrap().contains("the same experiment"), "{found}");
}

#[test]
fn frames_of_captures_and_cameras_with_other_channels_are_compared() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    run(folder, "a", &[]);
    let shots = ["capture", "a/components.exr", "-q", "--set=capture.blue.exposure_ms=60", "--out", "shots"];
    fluorspar(folder, shots).well();
    let found = compare(folder, "a", "shots");
    assert_eq!(found["settings"][0]["unit"], "ms");
    assert_eq!(row(&found, "Exposure of frame \"blue\"")["difference"], 30.0);
    assert_eq!(row(&found, "Porphyrin share")["told_apart"], "in_one");
    assert!(found["warnings"][0].as_str().unwrap().contains("B has no analysis"), "{found}");
    // With the analysis of the frames, whose folder has a preview and no raw frames
    fluorspar(folder, ["analyze", "shots", "-q", "--out", "analyzed"]).well();
    let found = compare(folder, "a", "analyzed");
    assert_eq!(found["settings"][0]["path"], "capture.blue.exposure_ms", "{found}");
    assert_eq!(row(&found, "Porphyrin share on the mixture line")["told_apart"], "not_apart");
    // Twice the exposure: twice the signal, of a millisecond the same but for noise of the median, below 1 % of 16 e- over 768 pixels
    let side = |quantity: &str, side: &str| row(&found, quantity)[side]["value"].as_f64().unwrap();
    let per_ms = "Median signal per ms of exposure in G, frame \"blue\"";
    assert!((side(per_ms, "a") * 30.0 / side("Median signal in G", "a") - 1.0).abs() < 1e-12);
    assert!((side(per_ms, "b") / side(per_ms, "a") - 1.0).abs() < 0.01, "{}", row(&found, per_ms));
    assert_eq!(row(&found, per_ms)["unit"], "e-/ms");
    fluorspar(folder, ["compare", "a", "analyzed", "-q", "--out", "previews"]).well();
    let page = fs::read_to_string(folder.join("previews/report.html")).unwrap();
    assert!(page.contains("a white of its own") && page.matches("data:image/png").count() == 2);
    // Another camera
    let mono = ["--set=sensor.preset=monochrome_3_45um"];
    let args = [&["capture", "a/components.exr", "-q", "--report", "--out", "mono"][..], &mono, &SIZE[2..4]];
    fluorspar(folder, args.concat()).well();
    let found = compare(folder, "a", "mono");
    let signal = row(&found, "Median signal, frame");
    assert!(signal["a"].is_null() && signal["b"]["value"].is_f64(), "{signal}");
    // What both have: the signal to noise of the region in the capture, and the name of the sensor
    let region = row(&found, "Signal to noise of the region's mean, all channels of frame \"blue\"");
    assert!(["a", "b"].iter().all(|side| region[side]["value"].as_f64().unwrap() > 10.0), "{region}");
    let sensor = &found["settings"].as_array().unwrap()[0];
    assert!(sensor["path"] == "sensor.preset" && sensor["b"] == "monochrome_3_45um", "{sensor}");
    assert!(row(&found, "Signal to noise of a pixel, frame")["a"].is_null());
    assert!(row(&found, "Signal to noise of a pixel in G")["b"].is_null());
    let verdict = found["verdict"].as_str().unwrap();
    assert!(verdict.starts_with("Which run sees smaller amounts of porphyrin is not told"), "{verdict}");
    assert!(row(&found, "Leak of frame \"blue\"")["difference"].is_f64());
    // Noise of another seed is no other design, and an interval of nothing but noise tells none apart
    let again = [&args.concat()[..], &["--seed", "2"]].concat();
    let again: Vec<&str> = again.into_iter().map(|arg| if arg == "mono" { "mono-2" } else { arg }).collect();
    fluorspar(folder, again).well();
    let signal = row(&compare(folder, "mono", "mono-2"), "Median signal, frame").clone();
    assert!(signal["told_apart"] == "not_judged" && signal["difference_interval"].is_null(), "{signal}");
    fluorspar(folder, ["compare", "a", "mono", "-q", "--out", "other-camera"]).well();
    assert!(folder.join("other-camera/blue_b.png").is_file());
    // What a comparison wrote is no run
    let refused = fluorspar(folder, ["compare", "a", "other-camera"]);
    assert!(refused.code == Some(2) && refused.stderr.contains("no results of `run`"), "{refused:?}");
}

const REGIONS: &str = r#"format = 1
base = "flat-patch"
[[analysis.region]]
name = "middle"
parts = ["patch"]
rectangle_px = [8, 6, 16, 12]
[[analysis.region]]
name = "left"
parts = ["patch"]
polygon_px = [[0, 0], [12, 0], [0, 20]]
"#;

/// A part behind the patch.
const HIDDEN: &str = r#"
[[material]]
name = "grey"
reflectance = 0.3
[[object]]
name = "hidden"
material = "grey"
type = "quad"
corner_mm = [-10.0, -10.0, -1.0]
edge_u_mm = [20.0, 0.0, 0.0]
edge_v_mm = [0.0, 20.0, 0.0]
[[analysis.region]]
name = "behind"
parts = ["hidden"]
"#;

#[test]
fn a_region_out_of_view_is_told_beside_the_others() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    fs::write(folder.join("regions.toml"), format!("{REGIONS}{HIDDEN}")).unwrap();
    let run =
        |name: &str| fluorspar(folder, [&["run", "regions.toml", "--out", name][..], &SIZE].concat()).well();
    let said = run("a");
    let why = "no pixel of the region shows hidden; the parts in view are: patch";
    let behind = said.stdout.lines().find(|line| line.starts_with("behind")).unwrap();
    let cells: Vec<&str> = behind.split_whitespace().collect();
    assert_eq!(cells[..4], ["behind", "not", "in", "view"], "{said:?}");
    assert!(cells[4..].iter().all(|cell| *cell == "-"), "{behind}");
    assert!(said.stderr.contains("warning: Region \"behind\": not in view"), "{said:?}");
    let read = fs::read_to_string(folder.join("a/results.json")).unwrap();
    let regions = serde_json::from_str::<Value>(&read).unwrap()["regions"].clone();
    assert_eq!(regions[2], serde_json::json!({ "name": "behind", "not_in_view": why }));
    assert!([0, 1].iter().all(|k| regions[k]["analysis"]["counts"]["valid"].as_u64() > Some(0)), "{regions}");
    let page = fs::read_to_string(folder.join("a/report.html")).unwrap();
    assert!(page.contains("not in view") && page.contains("1 patch, 2 middle, 3 left</p>"));
    let analyzed = fluorspar(folder, ["analyze", "a"]).well().stdout;
    assert!(analyzed.contains(&format!("Region \"behind\". Not in view: {why}\n")), "{analyzed}");
    assert_eq!(fluorspar(folder, ["analyze", "a", "--json"]).json()["regions"], regions);
    // A comparison tells the regions that both saw
    run("b");
    let found = compare(folder, "a", "b");
    let regions = found["numbers"].as_array().unwrap().iter().filter_map(|row| row["region"].as_str());
    assert!(regions.clone().any(|name| name == "left") && regions.clone().all(|name| name != "behind"));
}

#[test]
fn regions_of_both_runs_stand_row_by_row() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    fs::write(folder.join("regions.toml"), REGIONS).unwrap();
    let run = |name: &str, changes: &[&str]| {
        fluorspar(folder, [&["run", "regions.toml", "-q", "--out", name][..], changes, &SIZE].concat()).well()
    };
    let checked = fluorspar(folder, [&["check", "regions.toml"][..], &SIZE].concat()).well();
    let named = "Further regions of frame \"blue\": \"middle\" (patch";
    assert!(checked.stdout.contains(named) && checked.stdout.contains("\"left\" (patch"), "{checked:?}");
    // A run prints a row for each region, and writes what an analysis of its frames finds
    let said = run("a", &[]);
    let lines: Vec<&str> =
        said.stdout.lines().filter(|l| l.starts_with("patch") || l.starts_with("middle")).collect();
    assert!(said.stdout.contains("Regions of frame \"blue\"") && lines.len() >= 2, "{said:?}");
    assert!(said.stdout.contains("share, % (95 % in all)"), "{said:?}");
    let read = |name: &str| -> Value {
        serde_json::from_str(&fs::read_to_string(folder.join(name).join("results.json")).unwrap()).unwrap()
    };
    let results = read("a");
    assert_eq!([0, 1].map(|k| results["regions"][k]["name"].clone()), ["middle", "left"]);
    let analyzed = fluorspar(folder, ["analyze", "a", "--json"]).json();
    assert_eq!(analyzed["regions"], results["regions"]);
    let page = fs::read_to_string(folder.join("a/report.html")).unwrap();
    assert!(
        page.contains("Regions of frame") && page.matches("<span class=\"name\"").count() == 3,
        "regions"
    );
    assert!(page.contains("<p class=\"names\">1 patch, 2 middle, 3 left</p>"));
    if let Some(browser) = browser() {
        for screen in [[390, 844], [1280, 800], [2560, 1440]] {
            fits(&browser, "regions", &folder.join("a"), screen);
        }
    }
    // The folded section tells the estimates
    let note =
        page.split("<h2>Regions</h2> <span class=\"note\">").nth(1).unwrap().split('<').next().unwrap();
    assert!(note.starts_with("porphyrin share, %: middle ") && note.contains("; left "), "{note}");
    // Captures of its image have the same regions, and reports of them
    fluorspar(folder, ["capture", "a/components.exr", "-q", "--report", "--out", "shots"]).well();
    assert_eq!(read("shots")["regions"], results["regions"]);
    let left_out = ["--unset=analysis.region.left", "--set=light.blue.spectrum=led_405"];
    run("b", &left_out);
    let found = compare(folder, "a", "b");
    let rows: Vec<&Value> =
        found["numbers"].as_array().unwrap().iter().filter(|row| row["region"] == "middle").collect();
    let of = |quantity: &str| {
        rows.iter().find(|row| row["quantity"].as_str().unwrap().starts_with(quantity)).unwrap()
    };
    for side in ["a", "b"] {
        let budget = &read(side)["regions"][0]["analysis"]["budget"];
        let share = of("Porphyrin share on the mixture line");
        assert_eq!(share[side]["value"], percent(&budget["share"]));
        assert_eq!(share[side]["interval"][1], percent(&budget["total_interval"][1]));
        assert_eq!(of("Detection limit of")[side]["value"], percent(&budget["detection_limit"]));
    }
    assert_eq!(of("Porphyrin share on the mixture line")["told_apart"], "apart");
    assert!(of("Median signal in R")["a"]["value"].is_f64() && of("Signal to noise")["b"]["value"].is_f64());
    // That of only one run is told in words
    assert!(found["numbers"].as_array().unwrap().iter().all(|row| row["region"] != "left"), "{found}");
    let warnings = found["warnings"].to_string();
    assert!(warnings.contains("Only A has the region \\\"left\\\""), "{warnings}");
    let said = fluorspar(folder, ["compare", "b", "a", "--out", "ba"]).well();
    assert!(
        said.stdout.contains("\nRegion \"middle\"\n") && said.stdout.contains("Only B has the region"),
        "{said:?}"
    );
    let page = fs::read_to_string(folder.join("ba/report.html")).unwrap();
    assert!(page.contains("middle: Porphyrin share on the mixture line"), "no region in the figure");
    if let Some(browser) = browser() {
        fits(&browser, "regions", &folder.join("ba"), [390, 844]);
    }
}

#[test]
fn what_is_no_finished_run_is_refused() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    for name in ["empty", "later", "broken", "other"] {
        fs::create_dir(folder.join(name)).unwrap();
    }
    let results = "{\"format\": 1, \"frames\": []}";
    fs::create_dir(folder.join("a")).unwrap();
    fs::write(folder.join("a/results.json"), results).unwrap();
    fs::write(folder.join("later/results.json"), "{\"format\": 7, \"frames\": []}").unwrap();
    fs::write(folder.join("broken/results.json"), "{\"format\": 1, \"frames\": [{}]}").unwrap();
    fs::write(folder.join("other/results.json"), "{\"format\": 1, \"best\": []}").unwrap();
    fs::write(folder.join("plain.toml"), "format = 1\n").unwrap();
    for (b, said) in [
        ("a", "both are the same folder"),
        ("missing", "there is no such folder"),
        ("plain.toml", "not a folder of results"),
        ("empty", "there is no results.json"),
        ("later", "has format 7; this program reads format 1"),
        ("broken", "`frames` can't be read"),
        ("other", "design compare"),
    ] {
        let refused = fluorspar(folder, ["compare", "a", b]);
        assert!(refused.code == Some(2) && refused.stderr.contains(said), "{b}: {refused:?}");
    }
    // Runs whose experiments are gone, or of another version, still have numbers
    fs::create_dir(folder.join("b")).unwrap();
    fs::write(folder.join("b/results.json"), results).unwrap();
    fs::write(folder.join("b/experiment.toml"), "format = 9\n").unwrap();
    let said = fluorspar(folder, ["compare", "b", "a"]).well();
    assert!(
        said.stdout.contains("settings are not compared") && said.stdout.contains("format 9"),
        "{said:?}"
    );
    let help = fluorspar(folder, ["compare", "--help"]).well();
    assert!(help.stdout.contains("design compare"), "{}", help.stdout);
}

const MONO: &str = r#"format = 1
base = "flat-patch"
unset = ["sensor", "capture", "analysis"]
[sensor]
preset = "monochrome_3_45um"
columns = 32
rows = 24
[[capture]]
name = "green_band"
light_groups = { blue = 1.0 }
filters = ["band_pass_525_45"]
exposure_ms = 2.0
[[capture]]
name = "red_band"
light_groups = { blue = 1.0 }
filters = ["band_pass_635_50"]
exposure_ms = 2.0
[analysis]
frame = "red_band"
parts = ["patch"]
further_frames = ["green_band"]
tissue = "lip"
"#;

/// One light shows more porphyrin beside the bulk than the other: runs of a monochrome camera are judged as those of a color camera are, and so
/// are reports of captures.
#[test]
fn runs_of_a_monochrome_camera_are_judged() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    fs::write(folder.join("mono.toml"), MONO).unwrap();
    let run = |name: &str, changes: &[&str]| {
        let args = ["run", "mono.toml", "-q", "--set=render.width_px=16", "--set=render.height_px=12"];
        fluorspar(folder, [&args[..], changes, &["--out", name]].concat()).well()
    };
    run("a", &[]);
    run("b", &["--set=light.blue.spectrum=led_405"]);
    let page = fs::read_to_string(folder.join("a/report.html")).unwrap();
    // Each frame is seen through its own filter
    assert!(
        page.contains("through a filter that passes 502 to 548 nm")
            && page.contains("mono, frame &quot;red_band&quot;")
    );
    assert!(page.contains("optical density 5 (band_pass_525_45, band_pass_635_50"));
    assert!(page.contains("red_band over green_band"));
    let shots = ["capture", "a/components.exr", "-q", "--report", "--out", "shots"];
    fluorspar(folder, shots).well();
    let results: Value =
        serde_json::from_str(&fs::read_to_string(folder.join("shots/results.json")).unwrap()).unwrap();
    assert_eq!((&results["width_px"], &results["height_px"]), (&16.into(), &12.into()));
    for name in ["a", "shots"] {
        let found = compare(folder, name, "b");
        let verdict = found["verdict"].as_str().unwrap();
        assert!(
            verdict.starts_with("Both runs have an upper limit only: neither tells the porphyrin from none."),
            "{verdict}"
        );
        assert!(verdict.contains("by the noise of sensor and render"), "{verdict}");
        // A patch is no lip
        assert!(verdict.contains("A limit below 100 % is less than what is there"), "{verdict}");
    }
    // Without a tissue the least share that noise lets see decides
    run("flat-a", &["--unset=analysis.tissue"]);
    run("flat-b", &["--unset=analysis.tissue", "--set=light.blue.spectrum=led_405"]);
    let found = compare(folder, "flat-a", "flat-b");
    let verdict = found["verdict"].as_str().unwrap();
    assert!(verdict.starts_with("B sees smaller amounts of porphyrin than A."), "{verdict}");
    // A run that looks for another fluorophore is told as such
    run("fad", &["--unset=analysis.tissue", "--set=analysis.porphyrin=fad"]);
    let found = compare(folder, "fad", "flat-b");
    let verdict = found["verdict"].as_str().unwrap();
    assert_eq!(verdict, "Which run sees smaller amounts is not told: A looks for fad, B for porphyrin.");
}
