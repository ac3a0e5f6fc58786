//! How long the functions of all crates are: most fit on a screen, none is longer than clippy's `too_many_lines` allows.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;

use crate::architecture::{crates, is_test, plain_code, sources};

/// Nine of ten functions have at most this many lines, from `fn` to the closing brace.
const MOST_LINES_OF_NINE_IN_TEN: usize = 30;
const MOST_LINES: usize = 110;

/// Lines of each function of formatted code, with its name.
fn function_lengths(code: &str) -> Vec<(usize, String)> {
    let lines: Vec<&str> = code.lines().collect();
    let mut found = Vec::new();
    for (first, line) in lines.iter().enumerate() {
        let code = line.trim_start();
        let indent = &line[..line.len() - code.len()];
        let words = ["pub ", "pub(crate) ", "pub(super) ", "const ", "unsafe "];
        let head = words.iter().fold(code, |code, word| code.strip_prefix(word).unwrap_or(code));
        let Some(rest) = head.strip_prefix("fn ") else { continue };
        let name = rest.split(['(', '<']).next().unwrap_or_default().to_string();
        // The end of a body, or the semicolon of a declaration without one.
        let end = (first..lines.len()).find(|&at| {
            let is_outer = at == first || lines[at].strip_prefix(indent).is_some_and(|l| !l.starts_with(' '));
            is_outer && lines[at].ends_with(['}', ';'])
        });
        if let Some(end) = end.filter(|end| lines[*end].ends_with('}')) {
            found.push((end - first + 1, name));
        }
    }
    found
}

#[test]
fn functions_fit_on_a_screen() {
    let mut files = Vec::new();
    for entry in fs::read_dir(crates()).unwrap() {
        sources(&entry.unwrap().path().join("src"), &mut files);
    }
    let mut lengths: Vec<(usize, String, String)> = Vec::new();
    for file in files.iter().filter(|file| !is_test(file)) {
        let code = plain_code(&fs::read_to_string(file).unwrap());
        let path = file.strip_prefix(crates()).unwrap().display().to_string();
        lengths.extend(function_lengths(&code).into_iter().map(|(lines, name)| (lines, path.clone(), name)));
    }
    lengths.sort();
    assert!(lengths.len() > 2500, "only {} functions were found", lengths.len());
    let longest = lengths.last().unwrap();
    assert!(longest.0 <= MOST_LINES, "divide {longest:?}");
    let (most, ..) = lengths[lengths.len() * 9 / 10];
    assert!(
        most <= MOST_LINES_OF_NINE_IN_TEN,
        "a tenth of the functions has {most} lines or more; divide some whose steps have names, for instance {:?}",
        &lengths[lengths.len() - 10..]
    );
}

#[test]
fn lengths_are_counted_from_the_head_to_the_closing_brace() {
    let code = "fn one() {}\n\ntrait T {\n    fn none(\n        &self,\n    ) -> f64;\n\n    fn three(&self) {\n        self.none();\n    }\n}\n\n\
                pub(crate) fn five(\n    a: f64,\n) -> f64 {\n    a\n}\n";
    let lengths = function_lengths(code);
    assert_eq!(lengths, [(1, "one".into()), (3, "three".into()), (5, "five".into())]);
}
