//! A search of designs on the page against what the search wrote.

use std::fs;
use std::path::PathBuf;

use fluorspar_session::Changes;
use fluorspar_session::design::{FoundDesigns, OptimizeOptions, Place, ProblemOptions, optimize};
use fluorspar_web::{Workbench, WorkbenchOptions};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::correctness::ready;
use crate::support::{Served, job};

/// A search among a few lights, and its folder; by exchange it keeps no scores but those of its results.
fn search(exchange: bool) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("designs");
    let set = vec!["search.keep=4".into(), "vary.light.led.peaks_nm=[340.0, 385.0, 405.0, 420.0]".into()];
    let problem = ProblemOptions {
        design: Some("two-lights".into()),
        changes: Changes { set, unset: Vec::new() },
        ..Default::default()
    };
    let options = OptimizeOptions { problem, exchange, place: Place { out: Some(out.clone()) } };
    optimize(&options, &job()).unwrap();
    (folder, out)
}

#[test]
fn designs_are_those_of_the_search_and_each_is_told_as_by_its_report() {
    let (_folder, out) = search(false);
    let results: Value = serde_json::from_slice(&fs::read(out.join("results.json")).unwrap()).unwrap();
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    let served = Served::on(&out);
    let about = ready(&served);
    let told = about["designs"].as_array().unwrap();
    assert_eq!(told.len() as u64, results["feasible"].as_u64().unwrap(), "{about}");
    assert!(told.windows(2).all(|pair| pair[0]["loss"].as_f64() <= pair[1]["loss"].as_f64()));
    for (told, best) in told.iter().zip(results["best"].as_array().unwrap()) {
        assert_eq!((&told["name"], &told["loss"]), (&best["name"], &best["loss"]));
        assert_eq!(told["key"]["number"], best["number"]);
    }
    let recommended = &about["recommended"];
    assert_eq!(recommended["number"], results["recommended"]);
    let one = served.post("/api/design", &json!({ "designs": [recommended] })).json();
    let of = |told: &Value, k: usize| told["sections"][k]["html"].as_str().unwrap().to_owned();
    // The drawing of the spectra is that of the report
    let spectra = of(&one, 1);
    let (from, to) = (spectra.find("<path").unwrap(), spectra.find("</svg>").unwrap());
    assert!(report.contains(&spectra[from..to]), "{spectra}");
    let two = json!({ "designs": [recommended, { "compared": 0 }] });
    let both = of(&served.post("/api/design", &two).json(), 3);
    assert!(both.contains("385 nm alone") && both.contains("nothing bounds it"), "{both}");
    for (wrong, words) in
        [(json!({ "number": 10_000_000 }), "no such design"), (json!({ "compared": 7 }), "no such")]
    {
        let answer = served.post("/api/design", &json!({ "designs": [wrong] }));
        assert!(answer.status == 422 && answer.text().contains(words), "{}", answer.text());
    }
    assert_eq!(
        served.post("/api/picture", &json!({ "capture": "blue", "view": "raw", "set": [] })).status,
        503
    );
}

#[test]
fn a_search_without_scores_shows_what_its_results_hold_and_takes_no_changes() {
    let (_folder, out) = search(true);
    let about = ready(&Served::on(&out));
    assert!(about["drawn"].as_str().unwrap().contains("kept no others"), "{about}");
    let best = about["designs"].as_array().unwrap().iter().filter(|told| told["is_best"] == true).count();
    assert_eq!(best, 4);
    let changes = Changes { set: vec!["search.keep=9".into()], unset: Vec::new() };
    let options =
        WorkbenchOptions { subject: Some(out.display().to_string()), changes, ..Default::default() };
    let refused = Workbench::open(&options).err().unwrap().to_string();
    assert!(refused.contains("can't be changed"), "{refused}");
    // Each design that results name is judged: more than a search keeps would take for ever
    let path = out.join("results.json");
    let mut results: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    results["best"] = (0..5).map(|number| json!({ "number": number })).collect();
    fs::write(&path, results.to_string()).unwrap();
    let refused = FoundDesigns::open(&out, &job()).err().unwrap().to_string();
    assert!(refused.contains("names 5 designs, and its search kept at most 4"), "{refused}");
}
