//! What is said on standard error: title first, warnings short and where they matter, all of them on request.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;

use crate::support::{fluorspar, tiny};

/// Longest line of a warning that is not asked for in full.
const LINE: usize = 140;

fn warnings(stderr: &str) -> Vec<&str> {
    stderr.lines().filter(|line| line.starts_with("warning: ")).collect()
}

#[test]
fn a_run_begins_with_its_title_and_warns_in_short_lines() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Blue light beyond 750 nm, and spectra that end before 900 nm: more to name than fits on a line.
    let wide = ["--set=spectral.last_nm=900", "--out=out"];
    let args = tiny(&[&["run", "oraleye-2021-surface"], &wide[..]].concat());
    let said = fluorspar(folder, &args).well();
    let lines: Vec<&str> = said.stderr.lines().collect();
    assert!(lines[0].contains("OralEye"), "{}", said.stderr);
    assert!(lines[1].starts_with("16 x 12 pixels"), "{}", said.stderr);
    let short = warnings(&said.stderr);
    assert!(!short.is_empty() && short.iter().all(|line| line.len() <= LINE), "{short:#?}");
    assert!(short.iter().any(|line| line.contains("spectra are extrapolated")), "{short:#?}");
    assert_eq!(lines.iter().filter(|line| line.starts_with("hint: --verbose")).count(), 1, "{lines:#?}");
    // Before the render and before what comes of it.
    let last = lines.iter().position(|line| line.starts_with("hint: ")).unwrap();
    let render = lines.iter().position(|line| line.starts_with("Render")).unwrap();
    assert!(last < render, "{lines:#?}");

    // In full: as `check` has them, in the report and in the results.
    let whole = fluorspar(folder, [&args[..], &["--verbose"]].concat()).well();
    let whole = warnings(&whole.stderr);
    assert_eq!(whole.len(), short.len(), "{whole:#?}");
    assert!(whole.iter().any(|line| line.contains("collagen")), "{whole:#?}");
    let changes: Vec<&str> = args.iter().copied().skip(1).filter(|arg| *arg != "--out=out").collect();
    let check = fluorspar(folder, [&["check"], &changes[..]].concat()).well();
    assert_eq!(warnings(&check.stderr)[..], whole[..check.stderr.matches("warning: ").count()]);
    assert!(!check.stderr.contains("hint: "), "{}", check.stderr);
    let results: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("out/results.json")).unwrap()).unwrap();
    let stored = results["warnings"].as_array().unwrap();
    assert!(whole.iter().any(|line| line.strip_prefix("warning: ") == stored[0].as_str()), "{stored:#?}");
    let report = fs::read_to_string(folder.join("out/report.html")).unwrap();
    assert!(report.contains("spectra are extrapolated or taken as zero: "), "the report lacks the text");

    let silent = fluorspar(folder, [&args[..], &["--quiet"]].concat()).well();
    assert_eq!(silent.stderr, "");

    // A sensor that is finer than the render, as large as before
    assert!(!whole.iter().any(|line| line.contains("pixel of the render covers")), "{whole:#?}");
    let finer = ["--set=sensor.columns=128", "--set=sensor.rows=96", "--set=sensor.pixel_size_um=18.75"];
    let said = fluorspar(folder, [&args[..], &finer].concat()).well();
    let wanted = "one pixel of the render covers 8.0 x 8.0 pixels of the sensor";
    assert!(warnings(&said.stderr).iter().any(|line| line.contains(wanted)), "{}", said.stderr);

    // The image that is advised is the smallest that is not warned of: 16 columns x 8 / 4
    let size = |width: u32, height: u32| {
        let (columns, rows) =
            (format!("--set=render.width_px={width}"), format!("--set=render.height_px={height}"));
        let check = [&["check"], &changes[..], &finer, &[&columns, &rows]].concat();
        fluorspar(folder, check).well().stderr
    };
    assert!(
        said.stderr.contains(wanted)
            && size(16, 12).contains("render.width_px=32 and render.height_px=24 or more")
    );
    assert!(size(31, 23).contains("pixel of the render covers"));
    let advised = size(32, 24);
    assert!(
        !advised.contains("pixel of the render covers") && !advised.contains("render.height_px"),
        "{advised}"
    );
    let check = fluorspar(folder, [&["check"], &changes[..], &finer].concat()).well();
    assert!(check.stderr.contains(wanted), "{}", check.stderr);
    assert!(fs::read_to_string(folder.join("out/report.html")).unwrap().contains(wanted));
}

#[test]
fn names_and_cells_can_not_steer_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let said = fluorspar(folder.path(), ["check", "red\u{1b}[31m.toml"]);
    assert_eq!(said.code, Some(2));
    assert!(said.stderr.starts_with("error: red\\u{1b}[31m.toml: "), "{}", said.stderr);
}

/// Files of text that hold one endless, unprintable word where something short belongs.
fn endless() -> Vec<(&'static str, String, Vec<&'static str>)> {
    let word = "\u{1b}[2J\u{7}word ".trim_end().repeat(10_000);
    let key = "k".repeat(100_000);
    let toml = |text: String| format!("format = 1\nbase = \"flat-patch\"\n{text}");
    let escaped = "\\u001b[2J\\u0007word".repeat(10_000);
    let check = |name| vec!["check", name];
    vec![
        ("a.dat", format!("40 6 1.6 20\n{word} 0 1 20\n"), vec!["lens", "report", "a.dat"]),
        ("a.zmx", format!("MODE SEQ\nUNIT {word}\n"), vec!["lens", "report", "a.zmx"]),
        (
            "a.json",
            format!("{{\"surfaces\": [{{\"radius\": \"{escaped}\"}}]}}"),
            vec!["lens", "report", "a.json"],
        ),
        ("a.csv", format!("wavelength_nm,power\n380,{word}\n"), vec!["predict", "--light", "a.csv"]),
        ("b.csv", format!("{word},power\n380,1\n"), vec!["predict", "--light", "b.csv"]),
        ("c.csv", format!("wavelength_nm,{word}\n380,x\n"), vec!["predict", "--light", "c.csv"]),
        (
            "d.csv",
            format!("# unit: {word}\nem_nm\\ex_nm,380,390\n500,1,2\n510,3,4\n"),
            vec!["fluorophore", "import", "d.csv"],
        ),
        ("base.toml", format!("format = 1\nbase = \"{escaped}\"\n"), check("base.toml")),
        ("path.toml", format!("format = 1\nbase = \"{escaped}/x.toml\"\n"), check("path.toml")),
        ("key.toml", toml(format!("{key} = 1\n")), check("key.toml")),
        ("keys.toml", toml(format!("render.{key}.{key} = 1\n")), check("keys.toml")),
        (
            "word.toml",
            toml(format!("[[light]]\nname = \"l\"\nspectrum = \"{escaped}\"\n")),
            check("word.toml"),
        ),
        ("type.toml", toml(format!("[[light]]\nname = \"l\"\ntype = \"{escaped}\"\n")), check("type.toml")),
        ("name.toml", toml(format!("[[light]]\nname = \"{escaped}\"\n")), check("name.toml")),
        (
            "drive.toml",
            toml(format!("[[capture]]\nname = \"c\"\nlight_groups = {{ \"{escaped}\" = 1 }}\n")),
            check("drive.toml"),
        ),
    ]
}

#[test]
fn quotes_from_files_are_short_and_printable() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text, args) in endless() {
        fs::write(folder.path().join(name), text).unwrap();
        let said = fluorspar(folder.path(), &args);
        assert_eq!(said.code, Some(2), "{name}: {:.300}", said.stderr);
        let length = said.stderr.chars().count();
        assert!(length < 1500, "{name}: {length} characters: {:.300}", said.stderr);
        let message = said.stderr.trim_end();
        assert!(!message.contains(char::is_control), "{name}: {message:?}");
    }
}

#[test]
fn a_quiet_command_keeps_its_answer() {
    let folder = tempfile::tempdir().unwrap();
    let commands = [
        "tissue depth lip",
        "filter leak",
        "design compare two-lights",
        "safety flat-patch",
        "catalog show sensor pi_camera_3",
        "scene view fluorescent-sphere --show part --width 64",
        "catalog list fluorophore",
    ];
    for line in commands {
        let words: Vec<&str> = line.split(' ').collect();
        let said = fluorspar(folder.path(), &words).well();
        let quiet = fluorspar(folder.path(), words.iter().copied().chain(["-q"])).well();
        assert!(!said.stdout.is_empty() && quiet.stdout == said.stdout, "{line}: {quiet:#?}");
        assert_eq!(quiet.stderr, "", "{line}");
    }
}
