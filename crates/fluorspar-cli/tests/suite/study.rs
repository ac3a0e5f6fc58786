//! A study from photographs to who is outside the norm, and what leaves it.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::frames::{VIOLET, copy};
use crate::support::{Said, fluorspar};

/// So many photographs of people under violet light, each with bytes of its own, their table with a region each, and an experiment of the
/// camera.
pub(crate) fn photographs(folder: &Path, people: usize) {
    fs::write(folder.join("violet.toml"), VIOLET).unwrap();
    fs::create_dir_all(folder.join("photos")).unwrap();
    copy("bggr_jpeg.dng", folder);
    let frame = fs::read(folder.join("bggr_jpeg.dng")).unwrap();
    let mut table = String::from("patient,capture,frame,region,where,verdict\n");
    for person in 1..=people {
        let name = format!("P{person:02}_violet.dng");
        fs::write(folder.join("photos").join(&name), [&frame[..], &person.to_le_bytes()].concat()).unwrap();
        table += &format!("P{person:02},violet,{name},tongue,\"{},12,12,12\",right\n", 10 + person % 9);
    }
    fs::write(folder.join("photos/photographs.csv"), table).unwrap();
}

pub(crate) fn study(folder: &Path, args: &[&str]) -> Said {
    fluorspar(folder, ["study", args[0], "st"].iter().chain(&args[1..]))
}

/// A study of so many people, analyzed.
fn analyzed(folder: &Path, people: usize) {
    photographs(folder, people);
    study(folder, &["init", "--experiment", "violet.toml", "--site", "north"]).well();
    study(folder, &["import", "photos"]).well();
    study(folder, &["analyze"]).well();
}

#[test]
fn people_become_a_norm_and_stand_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    analyzed(folder, 12);
    let rows = study(folder, &["query", "--quantity", "chromaticity_r", "--json"]).json();
    assert_eq!(rows.as_array().unwrap().len(), 12);
    let norm = ["norm", "--quantity", "chromaticity_r", "--out", "norm.json"];
    let said = study(folder, &norm).well();
    assert!(said.stdout.contains("95 % of people at north lie within 0."), "{}", said.stdout);
    let compared = study(folder, &["compare", "--norm", "norm.json", "--json"]).json();
    let people = compared["people"].as_array().unwrap();
    assert_eq!(people.len(), 12);
    let of_channel = study(folder, &["norm", "--quantity", "median_signal"]);
    assert!(
        of_channel.code == Some(2) && of_channel.stderr.contains("give --channel: B, G, R"),
        "{of_channel:?}"
    );
    assert!(people.iter().all(|person| person["standing"] != "outside" && person["has_error"] == false));
    let inside = people.iter().filter(|person| person["standing"] == "inside").count();
    assert!((6..12).contains(&inside), "of twelve it can't be told of those at the ends: {people:?}");
    // Options that name another norm than those that are pooled
    let pool = ["norm", "--pool", "norm.json", "--pool", "norm.json", "--quantity", "red_share"];
    let pooled = fluorspar(folder, ["study"].iter().chain(&pool));
    assert!(pooled.stderr.contains("this norm is of chromaticity_r, not of red_share"), "{pooled:?}");
    // Two withdraw, one refuses: nine are no norm
    study(folder, &["withdraw", "P01"]).well();
    let later = ["norm", "--quantity", "chromaticity_r", "--out", "later.json"];
    study(folder, &later).well();
    let pooled = fluorspar(folder, ["study", "norm", "--pool", "norm.json", "--pool", "later.json"]);
    assert!(pooled.stderr.contains("people must not count twice"), "{}", pooled.stderr);
    for (option, word) in [("--by-age", "--by-age is of a study"), ("--region-name=lips", "not of lips")] {
        let said =
            fluorspar(folder, ["study", "norm", "--pool", "norm.json", "--pool", "later.json", option]);
        assert!(said.code == Some(2) && said.stderr.contains(word), "{said:?}");
    }
    study(folder, &["withdraw", "P02"]).well();
    // An empty cell says nothing, and neither does a column that is missing
    let people = [
        "subject,age,consent\nP03,44,no\nP04,40,yes\n",
        "subject,sex\nP03,female\n",
        "subject,consent\nP03,\n",
    ];
    for people in people {
        fs::write(folder.join("people.csv"), people).unwrap();
        study(folder, &["import", "--subjects", "people.csv"]).well();
    }
    let few = study(folder, &norm);
    assert_eq!(few.code, Some(2));
    assert!(few.stderr.contains("9 people of the site \"north\" are too few"), "{}", few.stderr);
    // Outcomes give a curve
    fs::write(
        folder.join("outcomes.csv"),
        "subject,method,outcome\nP05,biopsy,dysplasia\nP06,biopsy,dysplasia\nP07,,healthy\nP08,,no lesion\nP09,,None\n",
    )
    .unwrap();
    let said = study(folder, &["import", "--outcomes", "outcomes.csv"]).well();
    assert!(
        said.stderr.contains("as a lesion: dysplasia; as no lesion: healthy, no lesion, none"),
        "{said:?}"
    );
    let against = ["compare", "--norm", "norm.json", "--json"];
    let compared = study(folder, &against).json();
    assert_eq!(
        compared["separations"][0]["area"]["n"],
        serde_json::json!([2, 3]),
        "of whom an outcome is known"
    );
    assert_eq!(compared["people"].as_array().unwrap().len(), 10);
    // The last outcome of a method counts, and none is no outcome
    let outcomes =
        |text: &str| fs::write(folder.join("outcomes.csv"), format!("subject,method,outcome\n{text}\n"));
    outcomes("P06,biopsy,").unwrap();
    let empty = study(folder, &["import", "--outcomes", "outcomes.csv"]);
    assert!(
        empty.code == Some(2) && empty.stderr.contains("the outcome of P06 is empty"),
        "{}",
        empty.stderr
    );
    outcomes("P06,biopsy,Benign").unwrap();
    let unclear = study(folder, &["import", "--outcomes", "outcomes.csv"]);
    assert!(
        unclear.code == Some(2) && unclear.stderr.contains("P06 is \"Benign\", which may be"),
        "{unclear:?}"
    );
    for (text, areas) in [("P06,biopsy,healthy", 0), ("P06,biopsy,dysplasia", 1)] {
        outcomes(text).unwrap();
        study(folder, &["import", "--outcomes", "outcomes.csv"]).well();
        assert_eq!(study(folder, &against).json()["separations"].as_array().unwrap().len(), areas, "{text}");
    }
    // The page says who, and of whom the norm should not know
    let said = study(folder, &["compare", "--norm", "norm.json", "--out", "who.html"]).well();
    assert!(
        said.stderr.contains("norm.json: this norm still holds 2 people who withdrew"),
        "{}",
        said.stderr
    );
    let page = fs::read_to_string(folder.join("who.html")).unwrap();
    let doubts = "10 regions: No porphyrin share on a mixture line";
    let others = "the range of the other people of the norm; the line";
    for words in
        ["nobody outside", "of 10 numbers inside; of ", "P12", "<svg", "normal range", doubts, others]
    {
        assert!(page.contains(words), "{words}");
    }
    let all: Vec<String> = (4..=12).map(|k| format!("P{k:02},,suspected")).collect();
    outcomes(&all.join("\n")).unwrap();
    study(folder, &["import", "--outcomes", "outcomes.csv"]).well();
    let nobody = study(folder, &norm);
    let words = "nobody is left for a norm: of 12 people with a chromaticity_r of a region \"tongue\" 3 withdrew or refuse, 9 have";
    assert!(nobody.code == Some(2) && nobody.stderr.contains(words), "{nobody:?}");
}

/// Who is in a norm is what the log said when it was made: of whoever refuses later the numbers are still held against the others.
#[test]
fn a_norm_holds_whom_it_held_when_it_was_made_and_no_guess() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    analyzed(folder, 12);
    let norm = ["norm", "--quantity", "chromaticity_r", "--out", "norm.json"];
    study(folder, &norm).well();
    let people = |norm: &str| -> Vec<Value> {
        let said = study(folder, &["compare", "--norm", norm, "--json"]).json();
        said["people"].as_array().unwrap().clone()
    };
    let before = people("norm.json");
    fs::write(folder.join("people.csv"), "subject,consent\nP03,no\n").unwrap();
    study(folder, &["import", "--subjects", "people.csv"]).well();
    let after = people("norm.json");
    assert_eq!(after[2], before[2]);
    // With the number itself in the norm the range is another
    let mut all: Value = serde_json::from_slice(&fs::read(folder.join("norm.json")).unwrap()).unwrap();
    all["logs"] = serde_json::json!([]);
    fs::write(folder.join("strange.json"), all.to_string()).unwrap();
    assert_ne!(people("strange.json")[2]["range"], before[2]["range"]);
    // A guess is analyzed, and decides nothing
    let table = folder.join("photos/photographs.csv");
    let guessed = fs::read_to_string(&table).unwrap().replacen("right", "guess", 3);
    fs::write(&table, guessed).unwrap();
    study(folder, &["import", "photos"]).well();
    let few = study(folder, &norm);
    assert!(
        few.code == Some(2) && few.stderr.contains("2 numbers are of regions that were guessed"),
        "{few:?}"
    );
    let compared = study(folder, &["compare", "--norm", "norm.json", "--json"]).json();
    assert!(compared["left_out"].to_string().contains("P01, visit 1: the region was guessed"), "{compared}");
    assert_eq!(compared["people"].as_array().unwrap().len(), 9);
}

/// After a change of the experiment old numbers stay, new ones stand beside them, and the change is told.
#[test]
fn numbers_of_another_analysis_stand_beside_the_old_ones() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    analyzed(folder, 3);
    let again = study(folder, &["analyze", "--json"]).json();
    assert_eq!((&again["regions"], &again["known"]), (&Value::from(0), &Value::from(3)));
    let camera = fs::read_to_string(folder.join("st/camera.toml")).unwrap();
    fs::write(folder.join("st/camera.toml"), camera + "noise_threshold = 20.0\n").unwrap();
    assert_eq!(study(folder, &["analyze", "--json"]).json()["regions"], 0);
    assert_eq!(study(folder, &["analyze", "--missing", "--json"]).json()["regions"], 3);
    let drift = study(folder, &["drift", "--json"]).json();
    let r =
        drift["quantities"].as_array().unwrap().iter().find(|of| of["quantity"] == "chromaticity_r").unwrap();
    assert_eq!(r["n"], 3);
    assert!(r["largest"].as_f64().unwrap() >= r["median"].as_f64().unwrap().abs());
    let log = fs::read_to_string(folder.join("st/log.jsonl")).unwrap();
    assert_eq!(log.matches("\"quantity\":\"chromaticity_r\"").count(), 6);
    // Simulated people are held against by the same camera alone
    let camera = folder.join("st/camera.toml").display().to_string();
    let source = fluorspar_session::ExperimentSource::find(Some(&camera)).unwrap();
    let own = fluorspar_session::camera_digest(&source, &source.parse(&[]).unwrap()).unwrap();
    for (camera, compared, doubt) in [(&own[..16], 3, false), ("0123456789abcdef", 0, false), ("", 3, true)] {
        let row = |k| format!("{k},tongue_dorsum,,,chromaticity_r,0,0.{k:02}1,{camera}\n");
        let rows: String = (1..=12).map(row).collect();
        let heads = "person,part,channel,name,quantity,has_lesion_here,value,camera";
        fs::write(folder.join("cohort.csv"), format!("{heads}\n{rows}")).unwrap();
        let norm =
            ["norm", "--cohort=cohort.csv", "--region-name=tongue_dorsum", "--quantity=chromaticity_r"];
        fluorspar(folder, ["study"].iter().chain(&norm).chain(&["--out=simulated.json"])).well();
        let said = study(folder, &["compare", "--norm", "simulated.json", "--json", "--out", "who.html"]);
        let page = fs::read_to_string(folder.join("who.html")).unwrap();
        assert_eq!(page.contains("the range of simulated people; the line"), compared > 0);
        assert_eq!(page.contains("no number can be held against them"), compared == 0);
        for told in [&said.stderr, &page] {
            assert_eq!(told.contains("nothing tells of which camera"), doubt, "{camera}: {told}");
        }
        let said = said.json();
        assert_eq!(said["people"].as_array().unwrap().len(), compared, "{said}");
        let others = said["left_out"].to_string().matches("another camera than the simulated").count();
        assert_eq!(others, 3 - compared, "{said}");
    }
    let pool = ["study", "norm", "--pool", "simulated.json", "--pool", "simulated.json"];
    let pooled = fluorspar(folder, pool);
    assert!(pooled.code == Some(2) && pooled.stderr.contains("people.count"), "{pooled:?}");
}

#[test]
fn every_changed_byte_is_found_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    analyzed(folder, 2);
    study(folder, &["verify"]).well();
    let photo = fs::read_dir(folder.join("st/sub-P01/ses-1/photo")).unwrap().next().unwrap().unwrap().path();
    let mut bytes = fs::read(&photo).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&photo, bytes).unwrap();
    // Nothing is estimated from it
    let camera = fs::read_to_string(folder.join("st/camera.toml")).unwrap();
    fs::write(folder.join("st/camera.toml"), format!("{camera}noise_threshold = 20.0\n")).unwrap();
    let again = study(folder, &["analyze", "--missing", "--json"]);
    assert!(
        again.stdout.contains("its bytes were changed") && again.stdout.contains("\"regions\": 1"),
        "{again:?}"
    );
    fs::write(folder.join("st/camera.toml"), camera).unwrap();
    // Files of no photograph, too
    for name in ["camera.toml", "dataset_description.json", ".bidsignore"] {
        let path = folder.join("st").join(name);
        let mut bytes = fs::read(&path).unwrap();
        bytes[3] ^= 1;
        fs::write(path, bytes).unwrap();
    }
    let said = study(folder, &["verify"]);
    assert_eq!(said.code, Some(2));
    for words in [
        "sub-P01",
        "dataset_description.json: its bytes",
        ".bidsignore: its bytes",
        "camera.toml: it was changed",
    ] {
        assert!(said.stdout.contains(words), "{}", said.stdout);
    }
    // An index that is gone or damaged is made anew
    fs::write(folder.join("st/.fluorspar/study.sqlite"), b"no index").unwrap();
    assert_eq!(
        study(folder, &["query", "--quantity", "chromaticity_r", "--json"]).json().as_array().unwrap().len(),
        2
    );
    let log = fs::read_to_string(folder.join("st/log.jsonl")).unwrap();
    fs::write(folder.join("st/log.jsonl"), log.replacen("tongue", "cheeks", 1)).unwrap();
    let said = study(folder, &["verify"]);
    assert!(said.stderr.contains("it was changed after it was written"), "{}", said.stderr);
}

#[test]
fn a_log_that_is_shorter_or_gone_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    analyzed(folder, 2);
    let path = folder.join("st/log.jsonl");
    let log = fs::read_to_string(&path).unwrap();
    fs::write(&path, &log[..=log.trim_end().rfind('\n').unwrap()]).unwrap();
    for command in ["verify", "query"] {
        let said = study(folder, &[command]);
        assert!(said.code == Some(2) && said.stderr.contains("was shortened or replaced"), "{said:?}");
    }
    fs::remove_file(&path).unwrap();
    for command in ["verify", "reindex"] {
        let said = study(folder, &[command]);
        assert!(said.code == Some(2) && said.stderr.contains("is gone or empty"), "{said:?}");
    }
    assert!(!path.exists());
    fs::write(&path, log).unwrap();
    study(folder, &["verify"]).well();
    // What a person who withdrew left may be removed
    study(folder, &["withdraw", "P01"]).well();
    fs::remove_dir_all(folder.join("st/sub-P01")).unwrap();
    study(folder, &["verify"]).well();
}

/// A card of the color of skin that fills the frame is taken for a face, whether fair or dark; one of the color of gums is not.
#[test]
fn an_export_warns_of_skin_that_fills_a_frame() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("people.csv"), "subject,consent\nP01,yes\n").unwrap();
    let dark = "{ type = \"blood_diffuse\", scattering_per_cm = 46.0, scattering_power = 1.421, background_per_cm = 0.6, \
                background_decay_nm = 110.0, blood_fraction = 0.008, saturation = 0.65, vessel_radius_um = 40.0, \
                superficial_blood_um = 0.25, hemoglobin_g_per_l = 150.0, refractive_index = 1.4, melanin_depth = 1.7 }";
    let cards = [("fair", "\"skin\"", true), ("dark", dark, true), ("gums", "\"gingiva\"", false)];
    for (color, reflectance, is_warned) in cards {
        let experiment = format!(
            "format = 1\nbase = \"flat-patch\"\nunset = [\"capture\", \"analysis\", \"material.patch.concentrations\"]\n\
             [render]\nwidth_px = 32\nheight_px = 24\nsamples_per_pixel = 4\n[view_filter]\nfilters = []\n[[light]]\nname = \"white\"\n\
             type = \"distant\"\naim.direction = [0.0, 0.0, -1.0]\nspectrum = \"white_led\"\nstrength.irradiance_w_per_m2 = 100.0\n\
             [[material]]\nname = \"patch\"\nreflectance = {reflectance}\n[[capture]]\nname = \"white\"\nlight_groups = {{ white = 1.0 }}\n\
             exposure_ms = \"auto\"\n[analysis]\nframe = \"white\"\nparts = [\"patch\"]\nporphyrin = \"none\"\n"
        );
        let file = format!("{color}.toml");
        fs::write(folder.join(&file), experiment).unwrap();
        fluorspar(folder, ["run", &file, "--out", color, "-q"]).well();
        let photos = folder.join(format!("photos-{color}"));
        fs::create_dir(&photos).unwrap();
        for ending in ["tiff", "tiff.json"] {
            let name = format!("raw_white.{ending}");
            fs::copy(folder.join(color).join(&name), photos.join(&name)).unwrap();
        }
        let table = "patient,capture,frame,region,where\nP01,white,raw_white.tiff,tongue,\"10,12,12,12\"\n";
        fs::write(photos.join("photographs.csv"), table).unwrap();
        let (st, share) = (format!("st-{color}"), format!("share-{color}"));
        fluorspar(folder, ["study", "init", &st, "--experiment", &file]).well();
        let photos = photos.to_string_lossy();
        fluorspar(folder, ["study", "import", &st, &photos, "--subjects", "people.csv"]).well();
        for more in [&[][..], &["--dicom"], &["--dicom", "--no-frames"]] {
            let said = fluorspar(folder, [&["study", "export", &st, "--out", &share], more].concat()).well();
            let warnings = said.stderr.matches("skin around the mouth takes").count();
            assert_eq!(warnings, usize::from(is_warned), "{color} {more:?}: {}", said.stderr);
        }
    }
}

/// A log that can't grow ends the import; what the next one finds is whole, and nothing is missing afterwards.
#[cfg(target_os = "linux")] // Other systems have no such limit on files.
#[test]
fn a_log_that_can_not_be_written_is_taken_up_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    photographs(folder, 8);
    let people: String = (0..600).map(|person| format!("Q{person},north,f,40,fair,no,yes\n")).collect();
    fs::write(folder.join("people.csv"), format!("subject,site,sex,age,skin,smoker,consent\n{people}"))
        .unwrap();
    study(folder, &["init", "--experiment", "violet.toml"]).well();
    study(folder, &["import", "--subjects", "people.csv"]).well();
    let before = fs::read(folder.join("st/log.jsonl")).unwrap();
    let largest = before.len() / 512 + 2;
    let said = crate::memory::limited(folder, &format!("-f {largest}"), &["study", "import", "st", "photos"]);
    let told = String::from_utf8_lossy(&said.stderr);
    assert!(said.status.code() == Some(1) && told.contains("log.jsonl"), "{said:?}");
    assert_eq!(fs::read(folder.join("st/log.jsonl")).unwrap(), before, "nothing half stays");
    study(folder, &["import", "photos"]).well();
    study(folder, &["verify"]).well();
    let log = fs::read_to_string(folder.join("st/log.jsonl")).unwrap();
    assert_eq!((1..=8).filter(|person| log.contains(&format!("sub-P{person:02}/"))).count(), 8);
}

/// Verdicts reach a study later, and masks in whatever form a table names them.
#[test]
fn regions_are_taken_back_and_masks_are_taken_in() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    analyzed(folder, 2);
    let table = folder.join("photos/photographs.csv");
    let rows = || study(folder, &["query", "--quantity", "chromaticity_r", "--json"]).json();
    let wrong = fs::read_to_string(&table).unwrap().replacen("right", "wrong", 1);
    let frame = fs::read(folder.join("photos/P01_violet.dng")).unwrap();
    fs::write(folder.join("photos/P09_violet.dng"), [frame, vec![9]].concat()).unwrap();
    let blurred =
        "P09,violet,P09_violet.dng,tongue,\"9,12,12,12\",wrong\nP10,,gone.dng,tongue,\"9,12,12,12\",wrong\n";
    fs::write(&table, format!("{wrong}{blurred}")).unwrap();
    let said = study(folder, &["import", "photos", "--json"]).json();
    assert_eq!((&said["photographs"], &said["regions"]), (&Value::from(0), &Value::from(1)));
    assert_eq!(study(folder, &["import", "photos", "--json"]).json()["regions"], 0);
    assert_eq!(rows().as_array().unwrap().len(), 1);
    // The workbench names masks so
    let drawn = wrong + "P01,violet,P01_violet.dng,tongue,\"{ mask = \"\"disc.png\"\" }\",right\n";
    fs::write(&table, drawn).unwrap();
    let said = study(folder, &["import", "photos"]);
    assert!(said.code == Some(2) && said.stderr.contains("this mask of a region is not there"), "{said:?}");
    copy("disc.png", &folder.join("photos"));
    study(folder, &["import", "photos"]).well();
    fs::remove_dir_all(folder.join("photos")).unwrap();
    study(folder, &["analyze"]).well();
    study(folder, &["verify"]).well();
    assert_eq!(rows().as_array().unwrap().len(), 2);
    let log = fs::read_to_string(folder.join("st/log.jsonl")).unwrap();
    assert!(log.contains("\"pixels\":193"), "{log}");
}

/// What a camera, a card and a hand get wrong.
#[test]
fn traps_of_names_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    analyzed(folder, 2);
    let frame = folder.join("photos/P01_violet.dng");
    let told = |table: &str| {
        fs::write(folder.join("photos/photographs.csv"), table).unwrap();
        let said = study(folder, &["import", "photos"]);
        assert_eq!(said.code, Some(2), "{said:?}");
        said.stderr
    };
    // The photograph of another person, a name, people whose files would be one
    let other = told("patient,frame\nP09,P01_violet.dng\n");
    assert!(other.contains("this very photograph as that of P01, visit 1"), "{other}");
    let name = told("patient,frame\nAnna Müller,P01_violet.dng\n");
    assert!(name.contains("is no pseudonym"), "{name}");
    fs::write(folder.join("photos/second_violet.dng"), [fs::read(&frame).unwrap(), vec![9]].concat())
        .unwrap();
    let dark = told("patient,frame,dark\nP01,P01_violet.dng,second_violet.dng\n");
    assert!(dark.contains("second_violet.dng: the study has this photograph without this dark"), "{dark}");
    let alike = told("patient,frame\nP-1,P01_violet.dng\nP_1,second_violet.dng\n");
    assert!(alike.contains("rename another"), "{alike}");
    let later = told("patient,frame\nP-02,second_violet.dng\n");
    assert!(later.contains("patient: \"P02\" and \"P-02\" differ in signs alone"), "{later}");
    let visits = told("patient,visit,frame\nP01,1.2,P01_violet.dng\nP01,12,second_violet.dng\n");
    assert!(visits.contains("visit of P01: \"1.2\" and \"12\" differ"), "{visits}");
    let visit = told("patient,visit,frame\nP01,März,second_violet.dng\n");
    assert!(visit.contains("is no label of a visit"), "{visit}");
    let twice = "frame,patient,region,where\nP01_violet.dng,P01,lip,\"1,2,9,9\"\nP01_violet.dng,P01,lip,\"3,2,9,9\"\n";
    assert!(told(twice).contains("two regions \"lip\" of this photograph; rename one"));
    // People: a cell that is no number, a line that contradicts another, one who is unknown or gone
    let subjects = |table: &str| {
        fs::write(folder.join("people.csv"), table).unwrap();
        study(folder, &["import", "--subjects", "people.csv"]).stderr
    };
    let comma = subjects("subject;age\nP01;41,5\n");
    assert!(comma.contains("line 2: age is \"41,5\": invalid float"), "{comma}");
    let both = subjects("subject,consent\nP_8,no\nP_8,yes\n");
    assert!(both.contains("P8 stands in it twice, with other cells"), "{both}");
    subjects("subject,consent\nP_8,yes\n");
    let nobody = study(folder, &["query", "--subject", "P99"]);
    assert!(nobody.code == Some(2) && nobody.stderr.contains("no person P99"), "{nobody:?}");
    study(folder, &["query", "--subject", "P_8"]).well();
    study(folder, &["withdraw", "P_8"]).well();
    let gone = told("patient,frame\nP_8,second_violet.dng\n");
    assert!(gone.contains("P8 withdrew, and nothing new"), "{gone}");
    // The same name on two cards is two photographs
    fs::create_dir_all(folder.join("cards/a")).unwrap();
    fs::create_dir_all(folder.join("cards/b")).unwrap();
    for (card, byte) in [("a", 1), ("b", 2)] {
        let bytes = [fs::read(&frame).unwrap(), vec![byte, byte]].concat();
        fs::write(folder.join(format!("cards/{card}/IMG_0001_violet.dng")), bytes).unwrap();
    }
    let said = study(folder, &["import", "cards", "--json"]).json();
    assert_eq!((&said["photographs"], &said["known"]), (&Value::from(2), &Value::from(0)));
    assert_eq!(study(folder, &["import", "cards", "--json"]).json()["known"], 2);
    let begun = study(folder, &["init", "--experiment", "violet.toml"]);
    assert!(begun.stderr.contains("this is a study already"), "{}", begun.stderr);
    let none = fluorspar(folder, ["study", "query", "photos"]);
    assert!(none.stderr.contains("this is no study"), "{}", none.stderr);
}

/// A JPEG with a comment, as far as a reader of tags goes.
const THUMBNAIL: &[u8] = b"\xff\xd8\xff\xfe\0\x13Zqplant-thumbnail\xff\xd9";

/// A TIFF of 16-bit gray with a thumbnail, and with any further tags in its directory and in one of EXIF.
fn tiff([width, height]: [u16; 2], tags: &[(u16, String)], exif: &[(u16, String)]) -> Vec<u8> {
    let mut bytes = b"II*\0\0\0\0\0".to_vec();
    let pixels = bytes.len() as u32;
    bytes.extend((0..u32::from(width) * u32::from(height)).flat_map(|k| (64 + k as u16 % 700).to_le_bytes()));
    let directory = |entries: Vec<(u16, u16, u32, Vec<u8>)>, bytes: &mut Vec<u8>| -> u32 {
        let mut rows = Vec::new();
        for (tag, kind, count, data) in entries {
            let mut cell = data.clone();
            if data.len() > 4 {
                cell = (bytes.len() as u32).to_le_bytes().to_vec();
                bytes.extend(&data);
                bytes.extend(vec![0; data.len() % 2]);
            }
            cell.resize(4, 0);
            rows.extend(
                [tag.to_le_bytes().to_vec(), kind.to_le_bytes().to_vec(), count.to_le_bytes().to_vec(), cell]
                    .concat(),
            );
        }
        let at = bytes.len() as u32;
        bytes.extend((rows.len() as u16 / 12).to_le_bytes());
        bytes.extend(rows);
        bytes.extend([0; 4]);
        at
    };
    let text = |(tag, value): &(u16, String)| {
        (*tag, 2u16, value.len() as u32 + 1, format!("{value}\0").into_bytes())
    };
    let exif_at = directory(exif.iter().map(text).collect(), &mut bytes);
    let thumbnail = bytes.len() as u32;
    bytes.extend(THUMBNAIL);
    let short = |tag: u16, value: u16| (tag, 3u16, 1, value.to_le_bytes().to_vec());
    let long = |tag: u16, value: u32| (tag, 4u16, 1, value.to_le_bytes().to_vec());
    let mut all = vec![
        short(256, width),
        short(257, height),
        short(258, 16),
        short(259, 1),
        short(262, 1),
        long(273, pixels),
        short(277, 1),
        short(278, height),
        long(279, 2 * u32::from(width) * u32::from(height)),
        long(34_665, exif_at),
        long(34_853, exif_at),
    ];
    all.extend(tags.iter().map(text));
    all.sort_by_key(|entry| entry.0);
    let count = all.len();
    let first = directory(all, &mut bytes);
    bytes[4..8].copy_from_slice(&first.to_le_bytes());
    let of_thumbnail = vec![short(259, 6), long(513, thumbnail), long(514, THUMBNAIL.len() as u32)];
    let second = directory(of_thumbnail, &mut bytes);
    let next = first as usize + 2 + 12 * count;
    bytes[next..next + 4].copy_from_slice(&second.to_le_bytes());
    bytes
}

/// A PNG with chunks of text after its first.
fn png_with_text(png: &[u8], words: &[&str]) -> Vec<u8> {
    let crc = |bytes: &[u8]| {
        !bytes.iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 }
            })
        })
    };
    let mut out = png[..33].to_vec();
    for (kind, word) in ["tEXt", "eXIf", "iTXt"].iter().zip(words) {
        let data = if *kind == "tEXt" { format!("Author\0{word}") } else { (*word).to_owned() };
        let body = [kind.as_bytes(), data.as_bytes()].concat();
        out.extend((data.len() as u32).to_be_bytes());
        out.extend(&body);
        out.extend(crc(&body).to_be_bytes());
    }
    [out, png[33..].to_vec()].concat()
}

/// Words planted wherever a file or a table has room for one are in no byte and no name of an export.
#[test]
fn nothing_that_was_planted_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let violet = VIOLET.replace("A frame of a camera", "Zqplant00");
    fs::write(folder.join("violet.toml"), format!("# Zqplant01\n{violet}")).unwrap();
    fs::create_dir_all(folder.join("photos")).unwrap();
    copy("disc.png", folder);
    let tags =
        [270, 271, 272, 305, 306, 315, 316, 700, 33_432, 33_723, 34_377, 50_708, 50_735, 50_740, 65_000];
    let exif = [29, 36_867, 36_868, 37_500, 37_510, 42_032, 42_033, 42_037];
    let planted = |tags: &[u16]| tags.iter().map(|tag| (*tag, format!("Zqplant{tag}"))).collect::<Vec<_>>();
    let (tags, exif) = (planted(&tags), planted(&exif));
    let mut frame = tiff([48, 40], &tags, &exif);
    frame.extend(b"Zqplant02 after the end");
    fs::write(folder.join("photos/Zqplant03_violet.tiff"), frame).unwrap();
    let describe = [
        "--capture=violet",
        "--mosaic=bggr",
        "--bit-depth=12",
        "--black-level=64",
        "--exposure-ms=40",
        "--gain=1",
    ];
    fluorspar(folder, ["describe", "photos/Zqplant03_violet.tiff"].iter().chain(&describe)).well();
    let mask = png_with_text(
        &fs::read(folder.join("disc.png")).unwrap(),
        &["Zqplant04", "Zqplant05", "en\0\0\0\0Zqplant06"],
    );
    fs::write(folder.join("photos/Zqplant07.png"), mask).unwrap();
    let table = "patient,visit,capture,frame,region,where\nZqplant08,Zqplant09,violet,Zqplant03_violet.tiff,Zqplant10,Zqplant07.png\n";
    fs::write(folder.join("photos/photographs.csv"), table).unwrap();
    let people = "subject,site,sex,age,skin,smoker,consent\nZqplant08,Zqplant11,Zqplant12,47,Zqplant13,Zqplant14,yes\n";
    fs::write(folder.join("people.csv"), people).unwrap();
    fs::write(folder.join("outcomes.csv"), "subject,method,outcome\nZqplant08,Zqplant15,Zqplant16\n")
        .unwrap();
    study(folder, &["init", "--experiment", "violet.toml", "--name", "Zqplant17", "--site", "Zqplant18"])
        .well();
    study(folder, &["import", "photos", "--subjects", "people.csv"]).well();
    study(folder, &["import", "--outcomes", "outcomes.csv"]).well();
    study(folder, &["analyze"]).well();
    let said = study(folder, &["export", "--out", "out", "--json"]).json();
    assert_eq!((&said["subjects"], &said["files"]), (&Value::from(1), &Value::from(2)));
    // What is looked for is there before
    let holds = |root: &str| -> Vec<String> {
        let files = crate::support::listing(&folder.join(root));
        let is_in = |bytes: &[u8]| String::from_utf8_lossy(bytes).to_lowercase().contains("zqplant");
        let found = files.keys().filter(|path| {
            is_in(path.strip_prefix(folder).unwrap().to_string_lossy().as_bytes())
                || fs::read(path).is_ok_and(|bytes| is_in(&bytes))
        });
        found.map(|path| path.display().to_string()).collect()
    };
    assert!(holds("st").len() >= 4, "{:?}", holds("st"));
    let other = ["export", "--out", "shown", "--no-frames", "--dicom", "--parquet", "--json"];
    assert_eq!(study(folder, &other).json()["files"], 1);
    for root in ["out", "shown"] {
        assert_eq!(holds(root), Vec::<String>::new());
    }
    let written = crate::support::listing(&folder.join("shown"));
    let ends = |ending: &str| written.keys().filter(|path| path.to_string_lossy().ends_with(ending)).count();
    assert_eq!([".dcm", ".parquet", ".csv", ".tiff"].map(ends), [1, 1, 0, 0], "{written:?}");
    let log = fs::read_to_string(folder.join("st/log.jsonl")).unwrap();
    let secret = log.split("\"secret\":\"").nth(1).and_then(|rest| rest.get(..64)).unwrap().to_owned();
    for path in crate::support::listing(&folder.join("out"))
        .keys()
        .chain(written.keys())
        .filter(|path| path.is_file())
    {
        assert!(!String::from_utf8_lossy(&fs::read(path).unwrap()).contains(&secret), "{path:?}");
    }
    let manifest: Value = serde_json::from_slice(&fs::read(folder.join("out/deid.json")).unwrap()).unwrap();
    let actions = manifest["files"].to_string();
    for part in ["\"what\":\"tag 37500\"", "Operators' Name (0008,1070)", "PNG tEXt"] {
        assert!(actions.contains(part), "{part}: {actions}");
    }
    // The pixels are the same
    let table = fs::read_to_string(folder.join("out/estimates.csv")).unwrap();
    assert!(table.contains(",region-1,chromaticity_r,,"), "{table}");
    // Who withdraws is in no export
    study(folder, &["withdraw", "Zqplant08"]).well();
    let none = study(folder, &["export", "--out", "none"]);
    assert!(none.stderr.contains("nobody consented") && !folder.join("none").exists(), "{}", none.stderr);
}

/// The command lines of the page, in its order. What a person does in between is done here: a region is drawn, people are listed, another
/// site sends its norm.
#[test]
fn the_page_of_studies_is_a_story_that_runs() {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/study.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    photographs(folder, 12);
    fs::rename(folder.join("violet.toml"), folder.join("camera.toml")).unwrap();
    fs::remove_file(folder.join("photos/photographs.csv")).unwrap();
    let people: String = (1..=12).map(|k| format!("P{k:02},{},yes\n", 30 + 7 * k % 12)).collect();
    fs::write(folder.join("people.csv"), format!("subject,age,consent\n{people}")).unwrap();
    fs::write(folder.join("outcomes.csv"), "subject,method,outcome\nP12,,suspected\n").unwrap();
    let cohort: String =
        (1..=12).map(|k| format!("{k},tongue_dorsum,,,chromaticity_r,0,0.{k:02}1\n")).collect();
    fs::write(
        folder.join("cohort.csv"),
        format!("person,part,channel,name,quantity,has_lesion_here,value\n{cohort}"),
    )
    .unwrap();
    // Words of no lesion are those of the help, and the help those that are taken so
    let help = fluorspar(folder, ["study", "import", "--help"]).well().stdout;
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let words = help.split("No lesion are: ").nth(1).and_then(|rest| rest.split(", 0").next()).unwrap();
    assert!(page.contains(&format!("no lesion are: {words}, 0)")), "{words}");
    let lines: Vec<&str> = page.lines().filter_map(|line| line.strip_prefix("    fluorspar ")).collect();
    for line in &lines {
        if line.contains("--pool") {
            // Another site has other people, and another log
            let norm = fs::read_to_string(folder.join("norm.json")).unwrap();
            let mut norm: Value = serde_json::from_str(&norm).unwrap();
            (norm["logs"], norm["studies"]) =
                (serde_json::json!(["another"]), serde_json::json!(["another"]));
            norm["sums"]["sites"][0]["site"] = "south".into();
            fs::write(folder.join("south.json"), norm.to_string()).unwrap();
        }
        // These frames have no tissue in which red light is estimated
        fluorspar(folder, line.replace("red_share", "chromaticity_r").split_whitespace()).well();
        if line.contains("--out look") {
            let table = fs::read_to_string(folder.join("look/photographs.csv")).unwrap();
            let drawn = |(number, row): (usize, &str)| match number {
                0 => format!("{row}\n"),
                _ => {
                    row.replacen(",,,,,", &format!(",,,tongue,\"{},12,12,12\",", 9 + 5 * number % 13), 1)
                        + "\n"
                }
            };
            let table: String = table.lines().enumerate().map(drawn).collect();
            assert_eq!(table.matches(",tongue,").count(), 12, "{table}");
            fs::write(folder.join("look/photographs.csv"), table).unwrap();
        }
    }
    assert!(lines.len() >= 10, "{lines:?}");
    // Nothing tells the order of people: codes are sorted, and photographs are counted within a visit
    let people = fs::read_to_string(folder.join("share/participants.tsv")).unwrap();
    let codes: Vec<&str> = people.lines().skip(1).collect();
    assert!(codes.len() == 12 && codes.is_sorted(), "{people}");
    let numbers = fs::read_to_string(folder.join("share/estimates.csv")).unwrap();
    assert!(numbers.lines().skip(1).map(|line| line.split(',').next()).is_sorted(), "{numbers}");
    let files: Value = serde_json::from_slice(&fs::read(folder.join("share/deid.json")).unwrap()).unwrap();
    let files = files["files"].as_array().unwrap();
    assert!(
        files.iter().all(|file| file["path"].as_str().unwrap().contains("_run-1_acq-violet_")),
        "{files:?}"
    );
    let both: Value = serde_json::from_slice(&fs::read(folder.join("both.json")).unwrap()).unwrap();
    assert_eq!(both["sums"]["sites"].as_array().unwrap().len(), 2);
    // A file of the user stays
    fs::write(folder.join("mine.json"), "{}").unwrap();
    let kept =
        fluorspar(folder, ["study", "norm", "gums", "--quantity", "chromaticity_r", "--out", "mine.json"]);
    assert_eq!(kept.code, Some(2), "{kept:?}");
    assert!(
        folder.join("share/deid.json").is_file()
            && fs::read_to_string(folder.join("mine.json")).unwrap() == "{}"
    );
}
