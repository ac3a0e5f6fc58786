//! docs/tissue.md has a table of what reaches each site by way of other surfaces of a mouth.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use fluorspar_experiment::preset::{self, PresetKind};

#[test]
fn the_documented_surroundings_are_those_of_the_sites() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/tissue.md");
    let text = std::fs::read_to_string(page).unwrap();
    let cells = |line: &str| -> Vec<String> {
        line.trim_matches('|').split('|').map(|cell| cell.trim().trim_matches('`').to_string()).collect()
    };
    let lines = text.lines().skip_while(|line| !line.starts_with("| site | indirect light |"));
    let rows: Vec<Vec<String>> = lines.skip(2).take_while(|line| line.starts_with('|')).map(cells).collect();
    for name in preset::names(PresetKind::Site) {
        let row = rows.iter().find(|row| row[0] == name).or(rows.iter().find(|row| row[0] == "all others"));
        let row = row.unwrap();
        let site = preset::site(name).unwrap();
        let around = site.surroundings();
        let known = [around.indirect[0], around.indirect[1], around.teeth[0], around.teeth[1]];
        let written: Vec<f64> = row[1..5].iter().map(|cell| cell.parse().unwrap()).collect();
        assert_eq!(known.as_slice(), written, "{name}");
        assert_eq!(row[5] == "assumed", around.assumed, "{name}");
    }
    assert_eq!(rows.len(), 5);
}
