//! How large the program and its documents are. The budgets keep them from growing unnoticed: a change that raises one says in its
//! message what the lines are for, and one that saves much lowers it. The table is printed by
//! `cargo test -p fluorspar --test suite proportion -- --nocapture`.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use crate::architecture::{crates, is_test, plain_code, sources};

/// Crates of the physics, the mouth among them; the others are the shell around it: files, experiments, commands, pages.
const PHYSICS: [&str; 3] = ["fluorspar", "fluorspar-accel", "fluorspar-anatomy"];
/// Crates that no user gets.
const UNPUBLISHED: [&str; 1] = ["fluorspar-testkit"];

const MOST_LINES_OF_CODE: usize = 135_250;
const MOST_PERCENT_OF_SHELL: f64 = 60.4;
const MOST_WORDS_OF_DOCUMENTS: usize = 61_530;
/// Words in string literals of the physics: it holds numbers, and the fronts word them.
const MOST_WORDS_IN_PHYSICS: usize = 8_000;

/// Lines with code, without unit tests, comments and blank lines.
fn code_lines(code: &str) -> usize {
    plain_code(code).lines().filter(|line| !line.trim().is_empty()).count()
}

/// Words of the string literals of code without tests and comments.
fn words_in_strings(code: &str) -> usize {
    let code = plain_code(code).replace("\\\"", "'").replace("'\"'", "");
    code.split('"')
        .skip(1)
        .step_by(2)
        .map(|text| text.split_whitespace().count())
        .filter(|&words| words > 1)
        .sum()
}

/// Scripts of the pages that a crate serves, if it serves any.
fn scripts(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    entries
        .map(|entry| entry.unwrap().path())
        .filter(|file| file.extension().is_some_and(|e| e == "js"))
        .collect()
}

/// Words of the Markdown pages of a folder and those below it, but not of what is built or downloaded there.
fn words_of_pages(folder: &Path) -> usize {
    let words_of = |path: &Path| {
        let name = path.file_name().unwrap().to_string_lossy();
        if path.is_dir() {
            if name.starts_with('.') || name == "target" { 0 } else { words_of_pages(path) }
        } else if name.ends_with(".md") {
            fs::read_to_string(path).unwrap().split_whitespace().count()
        } else {
            0
        }
    };
    fs::read_dir(folder).unwrap().map(|entry| words_of(&entry.unwrap().path())).sum()
}

#[test]
fn the_program_and_its_documents_keep_within_their_budgets() {
    let mut folders: Vec<_> = fs::read_dir(crates()).unwrap().map(|entry| entry.unwrap().path()).collect();
    folders.sort();
    let (mut physics, mut shell, mut words) = (0, 0, 0);
    let mut table = format!("{:24} {:>8} {:>8}\n", "crate", "code", "words in strings");
    for folder in folders {
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        if UNPUBLISHED.contains(&name.as_str()) {
            continue;
        }
        let mut files = Vec::new();
        sources(&folder.join("src"), &mut files);
        files.extend(scripts(&folder.join("pages")));
        let texts: Vec<String> = files
            .iter()
            .filter(|file| !is_test(file))
            .map(|file| fs::read_to_string(file).unwrap())
            .collect();
        let lines: usize = texts.iter().map(|text| code_lines(text)).sum();
        let in_strings: usize = texts.iter().map(|text| words_in_strings(text)).sum();
        writeln!(table, "{name:24} {lines:8} {in_strings:8}").unwrap();
        if PHYSICS.contains(&name.as_str()) {
            physics += lines;
            words += in_strings;
        } else {
            shell += lines;
        }
    }
    let all = physics + shell;
    let percent = 100.0 * shell as f64 / all as f64;
    let documents = words_of_pages(&crates().join(".."));
    writeln!(table, "{:24} {all:8}, {percent:.1} % of it shell; {documents} words of documents", "all")
        .unwrap();
    println!("{table}");
    assert!(all > 50_000 && documents > 20_000, "too little was found:\n{table}");
    assert!(all <= MOST_LINES_OF_CODE, "{all} lines of code, more than {MOST_LINES_OF_CODE}:\n{table}");
    assert!(percent <= MOST_PERCENT_OF_SHELL, "more shell than {MOST_PERCENT_OF_SHELL} %:\n{table}");
    assert!(documents <= MOST_WORDS_OF_DOCUMENTS, "more words than {MOST_WORDS_OF_DOCUMENTS}:\n{table}");
    assert!(words <= MOST_WORDS_IN_PHYSICS, "{words} words in strings of the physics:\n{table}");
}

#[test]
fn code_is_counted_without_tests_comments_and_blank_lines() {
    let code = "//! Head.\n\nfn one() {\n    // Why.\n    say(\"two words\", \"one\");\n}\n\n#[cfg(test)]\nmod tests {\n    \"not this one\"\n}\n";
    assert_eq!(code_lines(code), 3);
    assert_eq!(words_in_strings(code), 2);
}
