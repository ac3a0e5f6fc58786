//! The examples of ARCHITECTURE.md and of the documents: the Rust code compiles, the TOML files are valid.

use std::fs;
use std::path::{Path, PathBuf};

use fluorspar_experiment::{parse, parse_design, parse_sample};

/// The Rust example of ARCHITECTURE.md, word for word.
#[allow(clippy::print_stdout, reason = "the example prints its result")]
mod readme_example {
    include!("readme_example.rs");

    /// Holds the signature of the example; rendering is left to other tests.
    pub(super) const MAIN: fn() -> Result<(), Box<dyn std::error::Error>> = main;
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Contents of the fenced blocks of a language, each with the number of its first line.
fn blocks(text: &str, language: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let mut open: Option<(usize, Vec<&str>)> = None;
    for (number, line) in text.lines().enumerate() {
        match &mut open {
            Some((start, lines)) if line == "```" => {
                found.push((*start, lines.join("\n") + "\n"));
                open = None;
            }
            Some((_, lines)) => lines.push(line),
            None if line == format!("```{language}") => open = Some((number + 2, Vec::new())),
            None => {}
        }
    }
    found
}

#[test]
fn the_rust_example_of_the_architecture_page_is_compiled() {
    let page = fs::read_to_string(repository().join("ARCHITECTURE.md")).unwrap();
    let examples = blocks(&page, "rust");
    assert_eq!(examples.len(), 1, "one Rust block; compile further ones here, too");
    assert!(
        examples[0].1 == include_str!("readme_example.rs"),
        "ARCHITECTURE.md and readme_example.rs differ: copy the block to the file"
    );
    let _ = readme_example::MAIN;
}

/// Sections without a `format` are parts of a file: they are read on top of the default experiment.
#[test]
fn the_toml_examples_of_the_documents_are_valid() {
    let documents = fs::read_dir(repository().join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let documents = documents.filter(|path| path.extension().is_some_and(|ending| ending == "md"));
    let mut read = 0;
    for path in documents.chain([repository().join("README.md")]) {
        for (line, block) in blocks(&fs::read_to_string(&path).unwrap(), "toml") {
            let whole = block.lines().any(|line| line.starts_with("format = "));
            let text = if whole { block } else { format!("format = 1\nbase = \"oraleye-2021\"\n{block}") };
            let name = format!("{}:{line}", path.display());
            let folder = repository();
            let result = if text.contains("\n[[region]]") {
                parse_design(&text, &name, &folder, &[]).map(|_| ())
            } else if text.contains("\n[sample]") {
                parse_sample(&text, &name, &folder, &[]).map(|_| ())
            } else {
                parse(&text, &name, &folder, &[]).map(|_| ())
            };
            assert!(result.is_ok(), "{}", result.unwrap_err());
            read += 1;
        }
    }
    assert!(read >= 10, "{read} examples");
}
