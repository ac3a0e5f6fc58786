//! Many photographs at once: found, paired, analyzed, told.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use crate::frames::{VIOLET, copy};
use crate::support::fluorspar;

/// Two people under violet light, and an experiment of the camera.
pub(crate) fn clinic(folder: &Path) {
    fs::write(folder.join("violet.toml"), VIOLET).unwrap();
    fs::create_dir_all(folder.join("photos")).unwrap();
    copy("bggr_jpeg.dng", folder);
    copy("disc.png", folder);
    for person in ["P1", "P2"] {
        fs::copy(folder.join("bggr_jpeg.dng"), folder.join(format!("photos/{person}_violet.dng"))).unwrap();
    }
}

fn analyze(folder: &Path, more: &[&str]) -> crate::support::Said {
    fluorspar(folder, [&["analyze", "photos", "--experiment", "violet.toml"], more].concat())
}

#[test]
fn a_folder_without_regions_gives_pictures_and_a_table_to_complete() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    clinic(folder);
    let unknown = fluorspar(folder, ["analyze", "photos"]);
    assert_eq!(unknown.code, Some(2));
    assert!(unknown.stderr.contains("name the experiment with --experiment"), "{}", unknown.stderr);
    let said = analyze(folder, &[]).well();
    assert_eq!(said.stdout.trim(), "2 photographs, no region placed");
    let out = folder.join("fluorspar-out/analyze-photos");
    let table = fs::read_to_string(out.join("photographs.csv")).unwrap();
    assert!(table.contains("\nP2,1,violet,../../photos/P2_violet.dng,"), "{table}");
    assert!(out.join("previews/001_P1_violet.png").is_file() && out.join("report.html").is_file());
    // The table leads back to the files, wherever it lies
    let region = "--named-region=spot=22,12,17,17";
    let given =
        ["analyze", "fluorspar-out/analyze-photos/photographs.csv", "--experiment", "violet.toml", region];
    let said = fluorspar(folder, given.iter().chain(&["--out", "seen"])).well();
    assert!(said.stdout.starts_with("2 photographs, "), "{}", said.stdout);
}

#[test]
fn a_proposed_table_has_all_frames_of_the_camera() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    clinic(folder);
    for name in ["dark_1", "dark_2", "dark_3"] {
        fs::copy(folder.join("bggr_jpeg.dng"), folder.join(format!("photos/{name}.dng"))).unwrap();
    }
    analyze(folder, &[]).well();
    let table = fs::read_to_string(folder.join("fluorspar-out/analyze-photos/photographs.csv")).unwrap();
    for name in ["dark_1", "dark_2", "dark_3"] {
        let of_one = |row: &&str| row.starts_with("P1,") && row.contains(&format!("photos/{name}.dng"));
        assert!(table.lines().any(|row| of_one(&row)), "{name}: {table}");
    }
}

/// A frame that fails is named at the end, the others are answered; the same command again takes them from the journal.
#[test]
fn what_fails_is_told_and_the_rest_is_analyzed_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    clinic(folder);
    fs::write(folder.join("photos/P3_violet.jpg"), b"\xff\xd8\xff\xe0 a picture").unwrap();
    fs::write(folder.join("photos/P4_violet.nef"), b"II*\0\x08\0\0\0\0\0\0\0\0\0").unwrap();
    // A picture beside a frame is left to it
    fs::write(folder.join("photos/P1_violet.jpg"), b"\xff\xd8\xff\xe0 a picture").unwrap();
    let region = ["--named-region", "spot=disc.png", "--out", "out"];
    let said = analyze(folder, &region);
    assert_eq!(said.code, Some(2), "{said:?}");
    for part in
        ["2 photographs have no answer", "P3_violet.jpg: this is a JPEG", "dnglab convert", "P4_violet.nef"]
    {
        assert!(said.stderr.contains(part), "{part}: {}", said.stderr);
    }
    let table = fs::read_to_string(folder.join("out/patients.csv")).unwrap();
    let rows: Vec<&str> = table.lines().skip(1).collect();
    assert!(
        rows.iter().any(|row| row.starts_with("P1,1,violet,photos/P1_violet.dng,spot,chromaticity_r,,,0.")),
        "{table}"
    );
    assert!(rows.iter().any(|row| row.starts_with("P2,1,")) && !table.contains("P3"));
    let journal = || {
        let mut all = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        fs::read_to_string(all.find(|path| path.extension().is_some_and(|e| e == "journal")).unwrap())
            .unwrap()
    };
    let lines = journal();
    assert_eq!(lines.lines().count(), 3);
    assert_eq!(analyze(folder, &region).code, Some(2));
    assert_eq!((journal(), fs::read_to_string(folder.join("out/patients.csv")).unwrap()), (lines, table));
    // What the experiment names decides, too
    fs::write(folder.join("lab.toml"), "format = 1\nbase = \"violet.toml\"\n").unwrap();
    let by_lab =
        ["analyze", "photos", "--experiment", "lab.toml", "--named-region", "spot=disc.png", "--out", "lab"];
    assert!(fluorspar(folder, by_lab).stderr.contains("2 photographs have no answer"));
    fs::write(folder.join("violet.toml"), format!("{VIOLET}\n[nosuch]\n")).unwrap();
    let said = fluorspar(folder, by_lab);
    assert!(said.code == Some(2) && said.stderr.contains("nosuch"), "{said:?}");
    fs::write(folder.join("violet.toml"), VIOLET).unwrap();
    // Where none has an answer nothing is written
    fs::create_dir(folder.join("pictures")).unwrap();
    fs::copy(folder.join("disc.png"), folder.join("pictures/P5_violet.dng")).unwrap();
    for out in ["look", "numbers"] {
        let place = if out == "look" { &[][..] } else { &region[..2] };
        let words = ["analyze", "pictures", "--experiment", "violet.toml", "--out", out];
        let said = fluorspar(folder, words.iter().chain(place));
        assert!(said.code == Some(2) && said.stderr.contains("P5_violet.dng"), "{said:?}");
        assert!(!folder.join(out).exists(), "{out}");
    }
    // A frame that changed is another photograph
    fs::copy(folder.join("disc.png"), folder.join("photos/P1_violet.dng")).unwrap();
    let said = analyze(folder, &region);
    assert!(said.stderr.contains("3 photographs have no answer"), "{}", said.stderr);
}

#[test]
fn a_table_says_whose_regions_lie_where_and_which_are_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    clinic(folder);
    fs::copy(folder.join("disc.png"), folder.join("photos/disc.png")).unwrap();
    let table = "patient,visit,capture,frame,region,where,verdict\n\
                 anna,2,violet,P1_violet.dng,spot,disc.png,right\n\
                 anna,2,violet,P1_violet.dng,rest,\"[[22,12],[39,12],[39,29]]\",guess\n\
                 bert,1,,P2_violet.dng,spot,\"22,12,17,17\",wrong\n\
                 bert,1,violet,P2_violet.dng,rest,\"22,12,17,17\",right\n";
    fs::write(folder.join("photos/photographs.csv"), table).unwrap();
    let said = analyze(folder, &["--json"]);
    assert!(said.stderr.contains("rest: 1 of these regions are guesses"), "{}", said.stderr);
    let found = said.json();
    assert_eq!(found["photographs"], 2);
    let of = |region: &str| {
        let all = found["estimates"].as_array().unwrap().iter();
        all.filter(|e| e["region"] == region && e["patient"] == "anna" && e["visit"] == "2")
            .cloned()
            .collect::<Vec<_>>()
    };
    assert_eq!(of("spot")[0]["pixels"], 193);
    let warnings = of("rest")[0]["warnings"].to_string();
    assert!(
        warnings.contains("a guess that nobody confirmed")
            && !of("spot")[0]["warnings"].to_string().contains("a guess")
    );
    // A region twice is of one photograph
    let doubled = table.replace("rest,\"[[22,12],[39,12],[39,29]]\",guess", "spot,\"1,1,9,9\",right");
    fs::write(folder.join("photos/photographs.csv"), doubled).unwrap();
    let said = analyze(folder, &[]);
    assert!(said.code == Some(2) && said.stdout.starts_with("1 photographs, "), "{said:?}");
    let told = "photos/photographs.csv: region spot=1,1,9,9 of patient anna, visit 2: there are two regions";
    assert!(said.stderr.contains(told), "{}", said.stderr);
    fs::write(folder.join("photos/photographs.csv"), "frame,capture\nP1_violet.dng,green\n").unwrap();
    let said = analyze(folder, &["--named-region=spot=22,12,17,17"]);
    assert_eq!(said.code, Some(2));
    assert!(said.stderr.contains("no capture \"green\"; its captures are "), "{}", said.stderr);
}
