//! `fluorspar design`: what it tells, and that work is neither lost nor repeated.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{fluorspar, keeps_format, listing};
use serde_json::Value;

/// 780 designs: pairs of LEDs, five edges, two apertures and splits.
const SMALL: [&str; 6] = [
    "--set",
    "vary.light.led.peaks_nm=[340.0, 365.0, 385.0, 405.0, 420.0, 435.0]",
    "--set",
    "vary.long-pass.long_pass.after_peak_nm=[20.0, 30.0, 40.0, 50.0]",
    "--set",
    "vary.aperture.values=[2.0, 2.8, 4.0, 5.6, 8.0]",
];

fn design(folder: &Path, args: &[&str]) -> Value {
    let all = ["design"].iter().chain(args).chain(&SMALL).chain(&["--json", "-q"]);
    fluorspar(folder, all).json()
}

/// The journal beside a folder of results, whose name carries the digest of the problem.
fn journal(folder: &Path, name: &str) -> PathBuf {
    let is_journal = |path: &PathBuf| {
        let file = path.file_name().unwrap().to_string_lossy().into_owned();
        file.starts_with(&format!("{name}.")) && file.ends_with(".journal")
    };
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).find(is_journal).unwrap()
}

/// All but the description of the search and of what is written.
fn without_provenance(mut results: Value) -> Value {
    results.as_object_mut().unwrap().remove("provenance");
    results
}

#[test]
fn a_killed_sweep_goes_on_without_losing_or_repeating_work() {
    let folder = tempfile::tempdir().unwrap();
    let whole = design(folder.path(), &["sweep", "two-lights", "--out", "a"]);
    assert_eq!((whole["designs"].as_u64(), whole["evaluated"].as_u64()), (Some(420), Some(420)));
    keeps_format("design-results", &whole);
    let of_whole = journal(folder.path(), "a");
    let lines = fs::read_to_string(&of_whole).unwrap();
    let ending = of_whole.file_name().unwrap().to_string_lossy().split_once('.').unwrap().1.to_owned();
    let named = |name: &str| folder.path().join(format!("{name}.{ending}"));
    assert_eq!(lines.lines().count(), 3, "{lines}");
    // A kill in the middle of the second block: half of a line stays, as the journal was before
    let second = lines.match_indices('\n').nth(1).unwrap().0 + 1;
    fs::write(named("b"), &lines[..second + 40]).unwrap();
    let again = design(folder.path(), &["sweep", "two-lights", "--out", "b", "--threads", "1"]);
    assert_eq!(without_provenance(again), without_provenance(whole.clone()));
    assert_eq!(fs::read_to_string(named("b")).unwrap(), lines);
    // What is finished is not evaluated again: a number in the journal that was changed stays changed
    let changed = lines.replacen("\"block\":0", "\"block\":0,\"kept\":true", 1);
    fs::write(named("c"), &changed).unwrap();
    let kept = design(folder.path(), &["sweep", "two-lights", "--out", "c"]);
    assert_eq!(fs::read_to_string(named("c")).unwrap(), changed);
    assert_eq!(kept["best"], whole["best"]);
    for name in ["results.json", "designs.csv", "designs.jsonl", "report.html"] {
        assert!(folder.path().join("a").join(name).is_file(), "{name}");
    }
    let csv = fs::read_to_string(folder.path().join("a/designs.csv")).unwrap();
    assert!(csv.starts_with("number,lights,times_ms,view_filter,") && csv.lines().count() == 51, "{csv}");
    let html = fs::read_to_string(folder.path().join("a/report.html")).unwrap();
    for part in [
        "The recommended design",
        "What is least told apart",
        "Simulated captures",
        "What it rests on",
        "singular",
    ] {
        assert!(html.contains(part), "{part}");
    }
}

#[test]
fn shards_merge_to_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let whole = design(folder.path(), &["optimize", "two-lights", "--out", "whole"]);
    let lacking =
        fluorspar(folder.path(), ["design", "merge", "two-lights", "--out", "parts"].iter().chain(&SMALL));
    assert!(lacking.code == Some(2) && lacking.stderr.contains("--shard I/N"), "{lacking:?}");
    design(folder.path(), &["sweep", "two-lights", "--out", "parts", "--shard", "2/2"]);
    let half =
        fluorspar(folder.path(), ["design", "merge", "two-lights", "--out", "parts"].iter().chain(&SMALL));
    assert!(half.code == Some(2) && half.stderr.contains("1 of 2 blocks are missing"), "{half:?}");
    design(folder.path(), &["sweep", "two-lights", "--out", "parts", "--shard", "1/2"]);
    let merged = design(folder.path(), &["merge", "two-lights", "--out", "parts", "--wait-for", "2"]);
    assert_eq!(without_provenance(merged), without_provenance(whole));
}

#[test]
fn one_light_is_told_as_singular_and_wrong_input_with_its_cure() {
    let folder = tempfile::tempdir().unwrap();
    let said = fluorspar(folder.path(), ["design", "compare", "two-lights"]).well();
    assert!(said.stdout.contains("singular: 3 of 5 seen"), "{}", said.stdout);
    // What a standard deviation is to be judged by
    assert!(said.stdout.contains("redox: its standard deviation of a value of 0."), "{}", said.stdout);
    let before = listing(folder.path());
    for (args, words) in [
        (vec!["two-light"], "did you mean \"two-lights\""),
        (vec!["--set", "vary.light.led.fwhm_nm=0"], "must be between 1 and 100 nm"),
        (vec!["--unset", "vary.sensor"], "there is no sensor; add [sensor]"),
        (vec!["--set", "criterion=\"detection\""], "add [cohort]"),
        (vec!["--set", "criterion=\"minmax\""], "minimax"),
        (vec!["--set", "criterion=kept"], "unknown value \"kept\". Known: minimax"),
        (vec!["--set", "contrast.redox.part=[\"nadhh\"]"], "did you mean"),
        (vec!["--set", "exposure.counts=[7]"], "must be between 1 and 6"),
        (vec!["--set", "exposure.total_ms=30"], "write total.ms"),
        (vec!["--set", "vary.aperture.values=[0.1]"], "f/0.5"),
        (vec!["--set", "capture.blue.exposure_ms=2"], "changes nothing of this design"),
        (vec!["--set", "exposure.splits=[\"equal\"]"], "splits"),
        (vec!["--shard", "3/2"], "I/N"),
        (vec!["--shard", "auto"], "SLURM_ARRAY_TASK_ID"),
    ] {
        let said = fluorspar(folder.path(), ["design", "sweep"].iter().chain(&args));
        assert!(said.code == Some(2) && said.stderr.contains(words), "{args:?}: {said:?}");
    }
    assert_eq!(listing(folder.path()), before);
    // A folder of somebody else is refused before the work begins.
    fs::create_dir(folder.path().join("mine")).unwrap();
    fs::write(folder.path().join("mine/notes.txt"), "mine").unwrap();
    let said = fluorspar(folder.path(), ["design", "sweep", "--out", "mine"]);
    assert!(
        said.code == Some(2)
            && listing(folder.path()).keys().all(|name| name.extension().is_none_or(|end| end != "journal")),
        "{said:?}"
    );
    assert_eq!(fs::read_to_string(folder.path().join("mine/notes.txt")).unwrap(), "mine");
}

/// Three tasks of an array that begins at 4 and counts by 3, each with the variables that Slurm sets, and a merge that waits for them.
#[test]
fn a_slurm_array_shares_a_sweep() {
    let folder = tempfile::tempdir().unwrap();
    let command = |args: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_fluorspar"));
        command.arg("design").args(args).args(SMALL).args(["two-lights", "-q", "--json"]);
        command.current_dir(folder.path()).stdout(std::process::Stdio::piped());
        command
    };
    let waiting = command(&["merge", "--out", "parts", "--wait-for", "2"]).spawn().unwrap();
    for task in ["4", "7"] {
        let said = command(&["sweep", "--out", "parts", "--shard", "auto"])
            .env("SLURM_ARRAY_TASK_ID", task)
            .env("SLURM_ARRAY_TASK_MIN", "4")
            .env("SLURM_ARRAY_TASK_STEP", "3")
            .env("SLURM_ARRAY_TASK_COUNT", "2")
            .env("SLURM_CPUS_PER_TASK", "1")
            .output()
            .unwrap();
        let said: Value = serde_json::from_slice(&said.stdout).unwrap();
        assert_eq!(said["shard"], if task == "4" { "1/2" } else { "2/2" });
    }
    let merged = waiting.wait_with_output().unwrap();
    assert!(merged.status.success());
    let merged: Value = serde_json::from_slice(&merged.stdout).unwrap();
    let whole = design(folder.path(), &["sweep", "two-lights", "--out", "whole"]);
    assert_eq!(without_provenance(merged), without_provenance(whole));
}

/// Two places of a light, so two scenes to render.
const RENDERED: &str = r#"
format = 2
base = "fluorescent-sphere"
spectral = { first_nm = 330.0, last_nm = 700.0, step_nm = 10.0 }
render = { width_px = 16, height_px = 12, samples_per_pixel = 4 }
lens = { focal_length_mm = 3.0 }
sensor.preset = "lyu_2021_table_1"

[[region]]
name = "porphyrin"
rendered = { parts = ["porphyrin_sphere"] }

[[vary]]
field = "light.violet.position_mm"
values = [[-60.0, 160.0, 80.0], [60.0, 200.0, 120.0]]

[[vary]]
field = "light.violet"
led.peaks_nm = [375.0, 405.0]

[[compare]]
name = "first choices"
lights = ["375 nm"]
"#;

fn renders(folder: &Path) -> Vec<(PathBuf, std::time::SystemTime)> {
    let Ok(entries) = fs::read_dir(folder.join("kept")) else { return Vec::new() };
    let found = entries.map(|entry| entry.unwrap().path());
    let of_time = |path: PathBuf| (path.clone(), fs::metadata(path).unwrap().modified().unwrap());
    let mut found: Vec<_> =
        found.filter(|path| path.extension().is_some_and(|end| end == "exr")).map(of_time).collect();
    found.sort();
    found
}

#[test]
fn scenes_are_rendered_once_whoever_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("d.toml"), RENDERED).unwrap();
    let command = |out: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_fluorspar"));
        command
            .args(["design", "optimize", "d.toml", "--renders", "kept", "--out", out])
            .current_dir(folder.path())
            .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
            .stderr(std::process::Stdio::piped())
            .stdout(std::process::Stdio::piped());
        command
    };
    // Killed when the first scene is there
    let mut child = command("a").spawn().unwrap();
    let started = std::time::Instant::now();
    while renders(folder.path()).is_empty() {
        assert!(started.elapsed().as_secs() < 120 && child.try_wait().unwrap().is_none());
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let before = renders(folder.path());
    // Two processes at once finish the rest
    let children = [command("a").spawn().unwrap(), command("b").spawn().unwrap()];
    let said = children.map(|child| child.wait_with_output().unwrap());
    let rendered = |output: &std::process::Output| {
        String::from_utf8_lossy(&output.stderr)
            .lines()
            .filter(|line| line.starts_with("Rendering position_mm"))
            .count()
    };
    for output in &said {
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let after = renders(folder.path());
    assert_eq!(after.len(), 2);
    assert!(before.iter().all(|render| after.contains(render)), "{before:?} {after:?}");
    assert_eq!(said.iter().map(rendered).sum::<usize>(), 2 - before.len(), "a scene was rendered twice");
    // The same results from both, and nothing is rendered any more
    let results = |name: &str| -> Value {
        let text = fs::read_to_string(folder.path().join(name).join("results.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    };
    assert_eq!(results("a")["best"], results("b")["best"]);
    assert!(results("a")["best"][0]["geometry"].as_str().unwrap().starts_with("position_mm ["));
    let again = fluorspar(folder.path(), ["design", "compare", "d.toml", "--renders", "kept"]).well();
    assert!(!again.stderr.contains("Rendering"), "{}", again.stderr);
    assert_eq!(renders(folder.path()), after);
    assert!(listing(folder.path()).keys().all(|path| path.extension().is_none_or(|end| end != "lock")));
}

/// Scenes that are rendered in shards and merged give the same answer as those that the design renders itself.
#[test]
fn scenes_are_rendered_in_shards() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("d.toml"), RENDERED).unwrap();
    let own = fluorspar(folder, ["design", "compare", "d.toml", "--renders", "own", "--json"]).well();
    let told = fluorspar(folder, ["design", "scenes", "d.toml", "--renders", "parts", "--json"]).well();
    let told: Value = serde_json::from_str(&told.stdout).unwrap();
    let scenes = told["scenes"].as_array().unwrap();
    assert_eq!(scenes.len(), 2);
    for scene in scenes {
        let [experiment, image] = ["experiment", "image"].map(|key| scene[key].as_str().unwrap());
        assert_eq!(scene["is_rendered"], false);
        for (film, shard) in [("1.film", "1/2"), ("2.film", "2/2")] {
            let _ = fs::remove_file(folder.join(film));
            fluorspar(folder, ["render", experiment, "-q", "--film", film, "--shard", shard]).well();
        }
        fluorspar(folder, ["merge", "1.film", "2.film", "-q", "--components", "--out", image]).well();
    }
    let merged = fluorspar(folder, ["design", "compare", "d.toml", "--renders", "parts", "--json"]).well();
    assert!(!merged.stderr.contains("Rendering"), "{}", merged.stderr);
    assert_eq!(own.stdout, merged.stdout);
    let shown = fluorspar(folder, ["design", "scenes", "d.toml", "--renders", "parts"]).well();
    assert_eq!(shown.stdout.matches("rendered  ").count(), 2, "{}", shown.stdout);
    let flat = fluorspar(folder, ["design", "scenes", "two-lights"]);
    assert!(flat.code == Some(2) && flat.stderr.contains("renders no scene"), "{flat:?}");
}

/// Tables of the user beside the catalogue: listed, used by designs, and refused with place and cure.
#[test]
fn a_folder_of_the_user_stands_beside_the_catalogue() {
    let folder = tempfile::tempdir().unwrap();
    let mine = folder.path().join("mine");
    for kind in ["lights", "filters", "qe"] {
        fs::create_dir_all(mine.join(kind)).unwrap();
    }
    fs::write(mine.join("lights/lab_led.csv"), "wavelength_nm,power\n395,0\n400,5\n410,0\n").unwrap();
    fs::write(mine.join("filters/lab_glass.csv"), "wavelength_nm,T\n400,0\n480,0\n500,0.9\n700,0.9\n")
        .unwrap();
    fs::write(mine.join("qe/lab_camera.csv"), "wavelength_nm,R,G\n400,0.1,0.2\n700,0.5,0.1\n").unwrap();
    let run = |args: &[&str]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_fluorspar"))
            .args(args)
            .current_dir(folder.path())
            .env("FLUORSPAR_CATALOGUE", "mine")
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    let (_, listed, _) = run(&["catalog", "list"]);
    for name in ["lab_led", "lab_glass", "lab_camera", "led_385"] {
        assert!(listed.contains(name), "{name}");
    }
    let light = "vary.light.values=[{ spectrum = \"lab_led\" }]";
    let filter = "view_filter.filters=[\"lab_glass\"]";
    let compare = [
        "design",
        "optimize",
        "two-lights",
        "--set",
        light,
        "--set",
        filter,
        "--set",
        "vary.light.led.peaks_nm=[365.0]",
    ];
    let set = ["--set", "compare=[]", "--unset", "vary.long-pass", "--out", "a", "-q"];
    let (code, _, said) = run(&[&compare[..], &set[..]].concat());
    assert_eq!(code, Some(0), "{said}");
    let csv = fs::read_to_string(folder.path().join("a/designs.csv")).unwrap();
    assert!(csv.contains("365 nm + lab_led"), "{csv}");
    // Without the folder there is no such light
    let said = fluorspar(folder.path(), compare);
    assert!(said.code == Some(2) && said.stderr.contains("lab_led"), "{said:?}");
    // Results are of the table that they were made from
    let light = ["--set", "light.blue.spectrum=\"lab_led\"", "--set", "light.blue.filters=[]"];
    let small = ["--set", "render.width_px=20", "--set", "render.height_px=16", "--out", "b", "-q"];
    let (code, _, said) = run(&[&["run", "flat-patch", "--quick"][..], &light, &small].concat());
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(run(&["check", "b/experiment.toml"]).0, Some(0));
    fs::write(mine.join("lights/lab_led.csv"), "wavelength_nm,power\n395,0\n401,5\n410,0\n").unwrap();
    let (code, _, said) = run(&["check", "b/experiment.toml"]);
    assert!(code == Some(2) && said.contains("mine/lights/lab_led.csv has changed since"), "{said}");
    // Entries are named: where the folder lies is no matter
    let made = folder.path().join("b/experiment.toml");
    assert!(fs::read_to_string(&made).unwrap().contains("\"catalogue/lights/lab_led\" = "));
    for (file, content, words) in [
        ("filters/bad.csv", "wavelength_nm,T\n400,0.5\n500,1.5\n", "more than 1"),
        ("lights/bad.csv", "wavelength_nm,a,b\n400,1,1\n500,1,1\n", "one column"),
        ("lights/led_385.csv", "wavelength_nm,a\n400,1\n500,1\n", "rename the file"),
        ("lights/bad.toml", "name = \"bad\"\n", "missing field"),
    ] {
        fs::write(mine.join(file), content).unwrap();
        let (code, _, said) = run(&["catalog", "list"]);
        assert!(code == Some(2) && said.contains(words) && said.contains(file), "{file}: {said}");
        fs::remove_file(mine.join(file)).unwrap();
    }
}

/// Designs of one light each: the page names the command that was typed, the figure of the lights names the lights, and marks stand in
/// the order of their loss where nothing else tells designs apart.
#[test]
fn a_sweep_of_single_lights_names_them() {
    let folder = tempfile::tempdir().unwrap();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/03-four-leds.toml");
    fluorspar(folder.path(), ["design", "sweep", example.to_str().unwrap(), "--out", "a", "-q"]).well();
    let read = |name: &str| fs::read_to_string(folder.path().join("a").join(name)).unwrap();
    let page = read("report.html");
    assert!(page.contains("fluorspar design sweep report.html"));
    // Nothing has a price, and a leak has its unit
    assert!(!page.contains("price 0") && page.contains(" %, "), "{page}");
    // The page runs again as it says; what an analysis would say is asked for the best alone
    let again = ["design", "sweep", "a/report.html", "--set", "search.keep=1", "--out", "b", "-q"];
    fluorspar(folder.path(), again).well();
    let of = |run: &str| fs::read_to_string(folder.path().join(run).join("designs.csv")).unwrap();
    let best = |table: &str| table.lines().take(2).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(best(&of("a")), best(&of("b")));
    let lights = read("lights.svg");
    for name in ["365 nm: ", "385 nm: ", "405 nm: ", "450 nm: ", "peak of the light"] {
        assert!(lights.contains(name), "{name}");
    }
    // What the filter lets pass, where one is chosen
    let csv = read("designs.csv");
    let column = csv.lines().next().unwrap().split(',').position(|name| name == "fluorescence_kept").unwrap();
    for line in csv.lines().skip(1) {
        let kept: f64 = line.split(',').nth(column).unwrap().parse().unwrap();
        assert!((0.3..1.0).contains(&kept), "{line}");
    }
    // Why the best is best: it picks out what is looked for
    let results: Value = serde_json::from_str(&read("results.json")).unwrap();
    let share = |design: &Value| design["fluorescence_shares"]["biofilm_porphyrin"].as_f64().unwrap();
    let best: Vec<f64> = results["best"].as_array().unwrap().iter().map(share).collect();
    assert!(best[0] > 0.03 && best[1..].iter().all(|&other| other < 0.7 * best[0]), "{best:?}");
    assert!(page.contains(" % is biofilm_porphyrin; of the other 3 of the best designs "), "{page}");
    assert!(!lights.contains("shorter") && !lights.contains("number of"));
    let designs = read("designs.svg");
    for name in ["within tolerances", "365 nm", "385 nm", "405 nm", "450 nm"] {
        assert!(designs.contains(name), "{name}");
    }
}

/// The map of pairs of lights names them at its sides, not in its cells, and an axis of exposures has no fractions.
#[test]
fn a_map_of_pairs_of_lights_names_them_at_its_sides() {
    let folder = tempfile::tempdir().unwrap();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/03-four-leds.toml");
    // What an analysis would say is asked for the best alone
    let changes = ["--set=exposure.counts=[1,2]", "--set=search.keep=1", "--out=a", "-q"];
    fluorspar(folder.path(), [&["design", "sweep", example.to_str().unwrap()], &changes[..]].concat()).well();
    let read = |name: &str| fs::read_to_string(folder.path().join("a").join(name)).unwrap();
    let lights = read("lights.svg");
    for name in ["365 nm", "385 nm", "405 nm", "450 nm"] {
        assert!(lights.matches(&format!(">{name}<")).count() == 2, "{name}");
    }
    assert!(lights.contains(">one light<") && lights.contains(">the other light<"));
    let designs = read("designs.svg");
    assert!([">exposures<", ">1<", ">2<"].iter().all(|text| designs.contains(text)));
    assert!(!designs.contains(">0.2<") && !designs.contains(">1.0<"));
}

/// A design whose leak passes its limit within tolerances is left out for that and not for its loss there, which is smaller.
#[test]
fn the_reason_why_a_design_is_not_recommended_is_the_true_one() {
    let folder = tempfile::tempdir().unwrap();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/04-long-passes.toml");
    let sweep = |changes: &[&str]| {
        let args = [&["design", "sweep", example.to_str().unwrap(), "--out", "a"][..], changes].concat();
        fluorspar(folder.path(), args).well().stdout
    };
    // Here the worst loss of 460 nm is the smallest of all
    let exact =
        ["--set=limit.leak=0.01", "--set=criterion=contrast", "--set=unknown.leak=0", "--set=unknown.gain=0"];
    let said = sweep(&exact);
    let results = fs::read_to_string(folder.path().join("a/results.json")).unwrap();
    let results: Value = serde_json::from_str(&results).unwrap();
    let worst = |place: usize| results["worst_cases"][place]["loss"].as_f64().unwrap();
    assert!(worst(0) < worst(1), "{results}");
    let excess = &results["worst_cases"][0]["excesses"][0];
    assert!(
        excess["limit"] == "leak" && excess["allowed"] == 0.01 && excess["value"].as_f64().unwrap() > 0.1
    );
    let page = fs::read_to_string(folder.path().join("a/report.html")).unwrap();
    for text in [&said, &page] {
        assert!(
            text.contains("Recommended is 405 nm, long-pass 470 nm: of the 5 best 4 keep to all limits"),
            "{text}"
        );
        assert!(text.contains("within tolerances its leak rises to 1"), "{text}");
        assert!(text.contains(" %, beyond limit.leak = 0.01 (1 %)."), "{text}");
        // What is not known is nothing, and what ranks rest on
        assert!(text.contains("Nothing but the weights is unknown"), "{text}");
        assert!(text.contains("1e-5 (assumed, optical_density = 5)"), "{text}");
    }
    assert!(said.contains("breaks leak within tolerances") && said.contains("tissue margin"), "{said}");
    let usual = sweep(&[]);
    assert!(!usual.contains("Nothing but the weights") && usual.contains("optical_density = 5"), "{usual}");
    // A second time there is nothing to evaluate
    let again = fluorspar(folder.path(), ["design", "sweep", example.to_str().unwrap(), "--out", "a"]).well();
    assert!(again.stderr.contains("all designs are evaluated already"), "{}", again.stderr);
}

/// Designs of one exposure do not differ in how exposures share the time.
#[test]
fn designs_of_one_exposure_are_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let one = "--set=exposure.counts=[1]";
    let coarse = "--set=spectral.step_nm=10";
    let said =
        fluorspar(folder.path(), ["design", "optimize", "tongue-camera", one, coarse, "--out", "a"]).well();
    assert!(said.stdout.contains("72 designs, 72 evaluated"), "{}", said.stdout);
    let csv = fs::read_to_string(folder.path().join("a/designs.csv")).unwrap();
    let designs: Vec<&str> = csv.lines().skip(1).map(|line| line.split_once(',').unwrap().1).collect();
    let distinct: std::collections::BTreeSet<&str> = designs.iter().copied().collect();
    assert!(distinct.len() == designs.len() && designs.len() > 10, "{csv}");
    let recommended = said.stdout.lines().find_map(|line| line.strip_prefix("Recommended is "));
    if let Some((made, meant)) = recommended.and_then(|line| line.split_once(" As meant ")) {
        let made = made.split_once(": of the").unwrap().0;
        assert!(!meant.starts_with(&format!("{made} is the best")), "{}", said.stdout);
    }
}

/// One light and three channels do not tell seven fluorophores apart: the answer says which field helps, and it does.
#[test]
fn what_is_not_seen_is_told_with_its_cure() {
    let folder = tempfile::tempdir().unwrap();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/03-four-leds.toml");
    let text = fs::read_to_string(example).unwrap();
    let apart = "apart = [\"biofilm_porphyrin\"]";
    fs::write(folder.path().join("leds.toml"), text.replacen(apart, "", 1)).unwrap();
    let sweep = |changes: &[&str]| {
        let args = [&["design", "sweep", "leds.toml", "--out", "a"][..], changes].concat();
        fluorspar(folder.path(), args).well().stdout
    };
    let said = sweep(&[]);
    let cure = format!(
        "No design tells more than 3 of the 7 fluorophores of tongue apart: give {apart} in its [[region]]"
    );
    assert!(said.contains("4 of 4 designs are left out: 4 do not see") && said.contains(&cure), "{said}");
    let page = fs::read_to_string(folder.path().join("a/report.html")).unwrap();
    assert!(page.contains("No design tells more than 3 of the 7 fluorophores of tongue apart"));
    let cured = sweep(&[&format!("--set=region.tongue.{apart}").replace(" = ", "="), "--set=search.keep=1"]);
    assert!(cured.contains("4 feasible"), "{cured}");
    let limited = sweep(&["--set=exposure.total.ms=100000"]);
    assert!(limited.contains("Relax limit.saturation."), "{limited}");
}

/// A design that saturates is none, unless the file lets it, and then the answer says so first; what is left out is told with its reason.
#[test]
fn a_saturated_design_is_left_out_or_told() {
    let folder = tempfile::tempdir().unwrap();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/03-four-leds.toml");
    let sweep = |changes: &[&str]| {
        let args = [&["design", "sweep", example.to_str().unwrap(), "--out", "a"][..], changes].concat();
        fluorspar(folder.path(), args).well()
    };
    let bright = "--set=exposure.total.ms=100000";
    let said = sweep(&[bright]).stdout;
    assert!(said.contains("4 of 4 designs are left out: 4 break the limit of saturation"), "{said}");
    assert!(said.contains("No design keeps to all limits"), "{said}");
    let page = fs::read_to_string(folder.path().join("a/report.html")).unwrap();
    assert!(page.contains("4 break the limit of saturation"));
    let said = sweep(&[bright, "--set=limit.saturation=1e6", "--set=search.keep=1"]).stdout;
    assert!(said.contains("But it saturates: its brightest pixel collects"), "{said}");
    let page = fs::read_to_string(folder.path().join("a/report.html")).unwrap();
    assert!(page.contains("But it saturates: its brightest pixel collects"));
}

/// What a design says of porphyrin comes from the estimate that analyzes frames: an interval around the share, limits, what limits them.
#[test]
fn designs_say_what_their_frames_would_be_analyzed_to() {
    let folder = tempfile::tempdir().unwrap();
    let said = fluorspar(folder.path(), ["design", "compare", "tongue-camera", "--json"]).well();
    let found: Value = serde_json::from_str(&said.stdout).unwrap();
    let estimate = &found["designs"][0]["estimate"];
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{estimate}"));
    let [low, high] = [0, 1].map(|end| number(&estimate["interval"][end]));
    let share = number(&estimate["share"]);
    assert!(low <= share && share <= high && high - low > 0.02, "{estimate}");
    let patches = number(&estimate["visible"]["in_patches"]);
    assert!(0.005 < patches && patches < 0.15, "{estimate}");
    assert!(estimate["visible"]["limited_by"].is_string(), "{estimate}");
}
