//! `fluorspar lens` and `fluorspar filter`.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;

use crate::support::{fluorspar, listing};

#[test]
fn lenses_are_listed_with_what_was_published() {
    let folder = tempfile::tempdir().unwrap();
    let list = fluorspar(folder.path(), ["catalog", "list", "lens", "--json"]).json();
    let gauss = list.as_array().unwrap().iter().find(|lens| lens["name"] == "double_gauss_100mm").unwrap();
    assert!((gauss["focal_length_mm"].as_f64().unwrap() / 100.1 - 1.0).abs() < 1e-3);
    assert!(gauss["source"].as_str().unwrap().contains("US 2,771,006"));
    let text = fluorspar(folder.path(), ["catalog", "list", "lens"]).well().stdout;
    assert_eq!(text.lines().count(), 1 + list.as_array().unwrap().len());
}

#[test]
fn a_report_draws_the_lens_and_prints_its_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["lens", "report", "wide_3_5mm", "--focus-distance-mm", "100", "--out", "wide.svg"];
    let text = fluorspar(folder.path(), args).well().stdout;
    assert!(text.contains("focal length") && text.contains("US 3,583,791"), "{text}");
    let files: Vec<String> = listing(folder.path())
        .into_keys()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(files, ["wide.svg", "wide_field.svg", "wide_mtf.svg", "wide_spots.svg"]);
    let drawing = fs::read_to_string(folder.path().join("wide.svg")).unwrap();
    assert!(drawing.contains("stop") && drawing.contains("film") && !drawing.contains("NaN"));
    let args = ["lens", "report", "wide_3_5mm", "--f-number", "8", "--image-height-mm", "1.5", "--json"];
    let report = fluorspar(folder.path(), args).json();
    assert!((report["f_number"].as_f64().unwrap() - 8.0).abs() < 1e-9);
    let field = report["field"].as_array().unwrap();
    assert!((field.last().unwrap()["height_mm"].as_f64().unwrap() - 1.5).abs() < 1e-12);
    assert!(report["mtf"]["diffraction_limit"][0].as_f64().unwrap() > 0.999);
}

#[test]
fn a_lens_file_is_reported_as_one_of_the_catalogue() {
    let folder = tempfile::tempdir().unwrap();
    let table = "# a plano-convex lens behind its stop\n0 2 0 6\n0 6 1.5168 20\n-25.84 0 1 20\n";
    fs::write(folder.path().join("singlet.dat"), table).unwrap();
    let report = fluorspar(folder.path(), ["lens", "report", "singlet.dat", "--json"]).json();
    assert!((report["paraxial"]["focal_length_mm"].as_f64().unwrap() - 50.0).abs() < 1e-9);
}

#[test]
fn the_leak_is_what_the_filters_let_through() {
    let folder = tempfile::tempdir().unwrap();
    let leak = |args: &[&str]| {
        fluorspar(folder.path(), ["filter", "leak", "--json"].iter().chain(args).copied()).json()
    };
    // Without filters behind and before are the same; a neutral filter changes both alike.
    let clear = leak(&["--view-filter", "none"]);
    let before = clear["ratio_before"].as_f64().unwrap();
    assert!((clear["as_stated"]["leak_ratio"].as_f64().unwrap() / before - 1.0).abs() < 1e-9);
    let gray = leak(&["--view-filter", "0.1"]);
    assert!((gray["as_stated"]["leak_ratio"].as_f64().unwrap() / before - 1.0).abs() < 1e-9);
    assert!((gray["as_stated"]["reflected_density"].as_f64().unwrap() - 1.0).abs() < 1e-9);
    // A long-pass takes orders of magnitude; tilted, it lets more of the fluorescence through.
    let cut = leak(&["--view-filter", "long_pass_500", "--angle-deg", "0", "--angle-deg", "40"]);
    assert!(cut["as_stated"]["leak_ratio"].as_f64().unwrap() < 0.01 * before);
    let [straight, tilted] = [0, 1].map(|i| cut["at_angles"][i]["fluorescent"].as_f64().unwrap());
    assert!(tilted > 1.02 * straight, "{straight} {tilted}");
    let text = fluorspar(folder.path(), ["filter", "leak", "--view-filter", "notch_405"]).well().stdout;
    assert!(text.contains("as stated") && text.contains("the light needs a filter of its own"), "{text}");
    let text = fluorspar(folder.path(), ["filter", "leak", "--view-filter", "dichroic_450"]).well().stdout;
    assert!(text.contains("the viewing filters lack an optical density of"), "{text}");
}
