//! The examples, the templates of `new` and the task index of README.md run as they are written, in tiny images.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::fluorspar;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Words of a command line without the name of the program; quotes keep blanks.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut is_quoted = false;
    for c in line.chars() {
        match c {
            '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.push(String::new()),
            c => words.last_mut().unwrap().push(c),
        }
    }
    words.into_iter().filter(|word| !word.is_empty()).collect()
}

/// The same command on few pixels, in few samples, on coarse meshes.
fn tiny(words: &[String], folder: &Path) -> Vec<String> {
    let mut all = words.to_vec();
    let add = |all: &mut Vec<String>, more: &[&str]| all.extend(more.iter().map(|word| word.to_string()));
    let of_a_mouth = |file: &str| {
        let mouths = ["mouth", "monochrome", "room-light", "lesion"];
        mouths.iter().any(|name| file.contains(name))
    };
    match (words[0].as_str(), words.get(1).map(String::as_str)) {
        ("run" | "check", file) => {
            let file = file.filter(|file| file.ends_with(".toml"));
            add(&mut all, &["--set=render.width_px=16", "--set=render.height_px=12"]);
            add(&mut all, &["--set=render.samples_per_pixel=1"]);
            let text = file.map(|file| fs::read_to_string(folder.join(file)).unwrap()).unwrap_or_default();
            if file.is_none_or(of_a_mouth) || text.contains("\n[mouth]") {
                add(&mut all, &["--set=mouth.detail=0.25"]);
                // Spots that are compared lie at pixels of the whole sensor.
                if !text.contains("compared_px") {
                    let sensor = ["--set=sensor.columns=32", "--set=sensor.rows=24"];
                    add(&mut all, &sensor);
                    add(&mut all, &["--set=sensor.pixel_size_um=75"]);
                }
            }
        }
        ("cohort" | "dataset", _) => {
            add(&mut all, &["--set=people.count=1", "--set=render.width_px=32", "--set=render.height_px=24"]);
            add(&mut all, &["--set=render.samples_per_pixel=1", "--set=mouth.detail=0.25"]);
            add(&mut all, &["--set=analysis.inset_px=0", "--set=people.views=[\"dorsal-tongue\"]"]);
            add(&mut all, &["--set=sensor.columns=64", "--set=sensor.rows=48"]);
            add(&mut all, &["--set=sensor.pixel_size_um=37.5", "--set=sensor.fill_factor=0.0044"]);
        }
        ("render", _) => {
            add(&mut all, &["--set=render.width_px=16", "--set=render.height_px=12", "--spp=16"]);
        }
        ("safety", _) => add(&mut all, &["--set=mouth.detail=0.25"]),
        ("mouth", Some("generate")) => add(&mut all, &["--detail=0.25"]),
        ("mouth", Some("view")) => add(&mut all, &["--detail=0.25", "--width=64", "--spp=1"]),
        ("sensor", _) => add(&mut all, &["--region", "32", "24", "--levels=10", "--stack=4"]),
        ("tissue", Some("mc")) => add(&mut all, &["--photons=1000"]),
        ("tissue", Some("solve" | "fit")) => add(&mut all, &["--step-nm", "20"]),
        _ => {}
    }
    all
}

/// A folder with the examples, with a table of a dye and with a spectrum.
fn workshop() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("examples")).unwrap();
    for entry in fs::read_dir(root().join("examples")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            continue;
        }
        fs::copy(&path, folder.path().join("examples").join(path.file_name().unwrap())).unwrap();
    }
    let dye =
        "wavelength_nm,excitation,emission\n350,0.4,0\n400,1.0,0\n450,0.3,0.02\n520,0.0,1.0\n680,0.0,0.0\n";
    fs::write(folder.path().join("dye.csv"), dye).unwrap();
    let line = |nm: i32| format!("{nm},{}\n", (-(f64::from(nm - 530) / 40.0).powi(2)).exp());
    let spectrum: String = (480..=680).step_by(5).map(line).collect();
    fs::write(folder.path().join("spectrum.csv"), format!("wavelength_nm,leaf\n{spectrum}")).unwrap();
    folder
}

/// Command lines of the task index and of the page of the examples, without the name of the program.
fn task_lines() -> Vec<String> {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let index = readme.split("\n## I want to ...\n").nth(1).unwrap().split("\n## ").next().unwrap();
    let rows = index.lines().filter_map(|line| line.strip_prefix("| ")?.split('`').nth(1));
    let page = fs::read_to_string(root().join("examples/README.md")).unwrap();
    let of_page = page.lines().filter_map(|line| line.strip_prefix("    "));
    rows.chain(of_page).filter_map(|line| Some(line.strip_prefix("fluorspar ")?.to_owned())).collect()
}

#[test]
fn the_task_index_and_the_examples_run() {
    let lines = task_lines();
    let folder = workshop();
    let mut answers = BTreeMap::new();
    // The default experiment is run by other tests, and the workbench answers until it is ended
    for line in lines.iter().filter(|line| *line != "run" && !line.starts_with("workbench")) {
        if !answers.contains_key(line.as_str()) {
            let said = fluorspar(folder.path(), tiny(&words(line), folder.path()));
            assert_eq!(said.code, Some(0), "{line}: {}", said.stderr);
            answers.insert(line.as_str(), said.stdout);
        }
    }
    assert!(answers.len() >= 22, "{lines:?}");
    let examples = fs::read_dir(root().join("examples")).unwrap().map(|entry| entry.unwrap().file_name());
    let examples: Vec<String> = examples.map(|name| name.into_string().unwrap()).collect();
    let is_run = |name: &String| lines.iter().any(|line| line.contains(name.as_str()));
    assert!(examples.iter().filter(|name| name.ends_with(".toml")).count() >= 12);
    assert!(examples.iter().filter(|name| name.ends_with(".toml")).all(is_run), "{examples:?}");
    // What the answers are for.
    let answer = |line: &str| fluorspar(folder.path(), words(line)).well().stdout;
    let leds = &answers["design sweep examples/03-four-leds.toml"];
    assert!(leds.contains("compared with what the file names first\n"), "{leds}");
    // A file without designs to compare is refused, and told what to do
    let refused = fluorspar(folder.path(), words("design compare examples/03-four-leds.toml"));
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("[[compare]]") && refused.stderr.contains("design sweep"));
    // Electrons of fluorescence, not of what leaks, and what the tolerances of filters leave of the leak
    let passes = answer("design sweep examples/04-long-passes.toml --out passes --json");
    let passes: serde_json::Value = serde_json::from_str(&passes).unwrap();
    let of = |nm: &str| {
        let best = passes["best"].as_array().unwrap();
        best.iter().position(|design| design["view_filter"].as_str().unwrap().contains(nm)).unwrap()
    };
    let number = |nm: &str, key: &str| passes["best"][of(nm)][key].as_f64().unwrap();
    let share = number("430", "fluorescence_e") / number("430", "electrons");
    assert!((share * (1.0 + number("430", "leak")) - 1.0).abs() < 1e-9);
    assert!(number("430", "fluorescence_e") < 1.5 * number("470", "fluorescence_e"));
    let within = |nm: &str| passes["worst_cases"][of(nm)]["leak"].as_f64().unwrap();
    assert!(within("460") > 10.0 * number("460", "leak") && within("480") < 2.0 * number("480", "leak"));
    // The page recommends what is the best as it will be made
    let page = fs::read_to_string(folder.path().join("passes/report.html")).unwrap();
    let lead = page.split("Recommended is ").nth(1).unwrap();
    let (made, meant) = lead.split_once("As meant ").unwrap();
    assert!(
        made.contains("480 nm") && meant.starts_with(passes["best"][0]["name"].as_str().unwrap()),
        "{made}"
    );
    let best =
        fs::read_to_string(folder.path().join("fluorspar-out/design-03-four-leds/designs.csv")).unwrap();
    assert!(best.lines().nth(1).unwrap().contains("405"), "{best}");
    // A changed problem has a folder of its own
    let changed =
        fluorspar(folder.path(), words("design sweep examples/03-four-leds.toml --set search.keep=1")).well();
    let table = "fluorspar-out/design-03-four-leds/designs.csv";
    assert_eq!(fs::read_to_string(folder.path().join(table)).unwrap(), best);
    let place = changed.stderr.lines().find_map(|line| line.strip_prefix("Open ")).unwrap();
    assert!(place.starts_with("fluorspar-out/design-03-four-leds-"), "{}", changed.stderr);
    let own = fs::read_to_string(folder.path().join(place).with_file_name("designs.csv")).unwrap();
    assert_eq!(own.lines().count(), 2, "{own}");
}

/// Examples of `--help` that take long, wait for other processes or need frames of a camera: that they can be read another test holds.
const ONLY_READ: [&str; 13] = [
    "run velscope-like",
    "analyze --experiment",
    "analyze photos",
    "calibrate",
    "study",
    "design sweep tongue-camera",
    "design compare devices",
    "design scenes",
    "design merge",
    "mouth sample",
    "mouth view",
    "validate",
    "workbench",
];

#[test]
fn the_examples_of_help_run() {
    let folder = workshop();
    let put = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    // Excitation light in the cells where both wavelengths are the same
    let cell = |ex: i32, em: i32| match em - ex {
        0 => 0.5,
        gap if gap > 0 => (-(f64::from(em - 530) / 30.0).powi(2)).exp(),
        _ => 0.0,
    };
    let row = |em: i32| format!("{em},{},{},{}\n", cell(400, em), cell(410, em), cell(420, em));
    let rows: String = (400..=600).step_by(5).map(row).collect();
    put("raw.csv", &format!("em_nm\\ex_nm,400,410,420\n{rows}"));
    put(
        "kitchen.pbrt",
        "Camera \"perspective\" Film \"image\" \"integer xresolution\" 8 \"integer yresolution\" 8\nWorldBegin\n\
         LightSource \"infinite\"\nShape \"sphere\"\nWorldEnd\n",
    );
    let run = |line: &str| {
        let said = fluorspar(folder.path(), tiny(&words(line), folder.path()));
        assert_eq!(said.code, Some(0), "{line}: {}", said.stderr);
    };
    run("run");
    fs::copy(
        folder.path().join("fluorspar-out/oraleye-2021/raw_blue.tiff"),
        folder.path().join("IMG_0001.tiff"),
    )
    .unwrap();
    let lines = include_str!("../../src/examples.txt").lines();
    let mut lines: Vec<&str> = lines.map(|line| line.strip_prefix("fluorspar ").unwrap()).collect();
    // What the task index names is run for it
    let tasks = task_lines();
    lines.retain(|line| {
        !tasks.iter().any(|task| task == line) && !ONLY_READ.iter().any(|start| line.starts_with(start))
    });
    for line in lines {
        run(line);
        if line.contains("--shard 1/2") {
            run("render flat-patch --film 2.film --shard 2/2");
        }
    }
}

#[test]
fn templates_run_as_they_are_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let list = fluorspar(folder.path(), ["new", "--json"]).json();
    let list = list.as_array().unwrap();
    assert!(list.len() >= 6);
    for entry in list {
        let [name, command] = ["name", "command"].map(|key| entry[key].as_str().unwrap());
        let said = fluorspar(folder.path(), ["new", name]).well();
        assert!(said.stderr.contains(&format!("fluorspar {command} {name}.toml")), "{}", said.stderr);
        assert!(said.stdout.is_empty());
        let text = fs::read_to_string(folder.path().join(format!("{name}.toml"))).unwrap();
        // The same on standard output, and no second time over a file.
        assert_eq!(fluorspar(folder.path(), ["new", name, "-", "-q"]).well().stdout, text);
        let file = folder.path().join(format!("{name}.toml"));
        fs::write(&file, format!("# mine\n{text}")).unwrap();
        let refused = fluorspar(folder.path(), ["new", name]);
        assert!(
            refused.code == Some(2) && refused.stderr.contains("exists already and is kept"),
            "{refused:?}"
        );
        assert!(fs::read_to_string(&file).unwrap().starts_with("# mine"));
        let file = format!("{name}.toml");
        // Takes frames, which `calibrate.rs` makes
        if command == "calibrate" {
            continue;
        }
        fluorspar(
            folder.path(),
            tiny(&["check".into(), file.clone()][..1 + usize::from(command == "run")], folder.path()),
        );
        let run = match command {
            "run" => tiny(&["run".into(), file.clone()], folder.path()),
            _ => vec![command.into(), file],
        };
        let said = fluorspar(folder.path(), &run);
        assert_eq!(said.code, Some(0), "{name}: {}", said.stderr);
        assert!(!said.stderr.contains("warning: 1 spectrum is extrapolated"), "{name}: {}", said.stderr);
        assert!(!said.stderr.contains("none, too few of their pixels"), "{name}: {}", said.stderr);
    }
    let said = fluorspar(folder.path(), ["new", "laef"]);
    assert!(said.code == Some(2) && said.stderr.contains("did you mean \"leaf\"?"), "{said:?}");
    let said = fluorspar(folder.path(), ["new", "leaf", "leaf.txt"]);
    assert!(said.code == Some(2) && said.stderr.contains("must end in .toml"), "{said:?}");
}
