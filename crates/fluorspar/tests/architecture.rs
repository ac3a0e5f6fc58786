//! The order of the modules, read from their `use crate::` lines: nothing may reach upward.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Each module and the modules that it may use.
const ALLOWED: &[(&str, &[&str])] = &[
    ("digest", &[]),
    ("units", &[]),
    ("names", &[]),
    ("spectral", &["units"]),
    ("image", &["units", "spectral"]),
    ("sampling", &["units"]),
    ("geometry", &["units"]),
    ("safety", &["units", "spectral"]),
    ("material", &["units", "spectral", "image", "sampling", "geometry"]),
    ("light", &["units", "spectral", "image", "sampling", "geometry"]),
    ("optics", &["units", "spectral", "image", "sampling", "geometry"]),
    ("anatomy", &["units", "sampling", "geometry"]),
    (
        "scene",
        &["units", "spectral", "image", "sampling", "geometry", "material", "light", "optics", "anatomy"],
    ),
    (
        "render",
        &[
            "digest", "units", "spectral", "image", "sampling", "geometry", "material", "light", "optics",
            "scene",
        ],
    ),
    ("sensor", &["units", "spectral", "image", "sampling"]),
    ("analysis", &["units", "names", "spectral", "image"]),
    ("format", &["digest", "units", "spectral", "image", "geometry", "optics"]),
    ("preset", &["units", "names", "spectral", "optics", "sensor", "format"]),
    (
        "study",
        &[
            "units", "spectral", "image", "sampling", "geometry", "material", "light", "optics", "scene",
            "render", "safety", "sensor", "analysis",
        ],
    ),
    (
        "pipeline",
        &[
            "units", "spectral", "image", "sampling", "geometry", "material", "light", "optics", "scene",
            "render", "safety", "sensor", "analysis", "study",
        ],
    ),
    // A front: files become a study. No stage knows of it, nor of the formats and the catalogue below it.
    (
        "experiment",
        &[
            "digest", "units", "names", "spectral", "image", "sampling", "geometry", "material", "light",
            "optics", "anatomy", "scene", "render", "safety", "sensor", "analysis", "study", "format",
            "preset",
        ],
    ),
];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Code before the unit tests of a file: tests may borrow from anywhere.
fn without_tests(text: &str) -> &str {
    text.find("#[cfg(test)]\nmod tests").map_or(text, |end| &text[..end])
}

#[test]
fn modules_use_only_what_lies_below_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let known: BTreeSet<&str> = ALLOWED.iter().map(|(name, _)| *name).collect();
    let mut modules_seen = BTreeSet::new();
    let mut violations = Vec::new();
    for file in files {
        let relative = file.strip_prefix(&root).unwrap();
        let module = relative.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_string();
        // Tests in files of their own, and the crate's front page.
        let stem = file.file_stem().unwrap().to_str().unwrap();
        if module == "lib" || stem.ends_with("tests") || stem == "reference_vectors" {
            continue;
        }
        let Some((_, allowed)) = ALLOWED.iter().find(|(name, _)| *name == module) else {
            violations.push(format!("{}: module `{module}` has no place in the order", relative.display()));
            continue;
        };
        modules_seen.insert(module.clone());
        let text = fs::read_to_string(&file).unwrap();
        for (number, line) in without_tests(&text).lines().enumerate() {
            if line.trim_start().starts_with("//") {
                continue;
            }
            for (at, _) in line.match_indices("crate::") {
                let rest = &line[at + "crate::".len()..];
                let used: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                if known.contains(used.as_str()) && used != module && !allowed.contains(&used.as_str()) {
                    violations.push(format!("{}:{}: {module} uses {used}", relative.display(), number + 1));
                }
            }
        }
    }
    assert_eq!(modules_seen.len(), ALLOWED.len(), "a module of the order does not exist: {modules_seen:?}");
    assert!(violations.is_empty(), "\n{}", violations.join("\n"));
}

/// Enums of models: only the module of the model and what makes them from experiment files name their variants. All
/// else calls methods, so that a new variant is one file and a row of the schema.
const CLOSED_ENUMS: &[(&str, &[&str])] = &[
    (
        "Scattering",
        &[
            "crates/fluorspar/src/material/",
            "crates/fluorspar/src/experiment/schema/material.rs",
            "crates/fluorspar/src/experiment/resolve/material.rs",
        ],
    ),
    (
        "Emitter",
        &[
            "crates/fluorspar/src/light/",
            "crates/fluorspar/src/experiment/resolve/light.rs",
            // Writes scenes for other renderers.
            "benchmarks/src/export.rs",
        ],
    ),
    ("PreparedEmitter", &["crates/fluorspar/src/light/"]),
];

/// Whether a line of code names a variant of an enum, imports variants, or imports the enum under another name.
/// Functions and constants of the enum are no variants.
fn names_a_variant(line: &str, name: &str) -> bool {
    line.match_indices(name).any(|(at, _)| {
        let is_part_of_a_name = line[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let rest = &line[at + name.len()..];
        let Some(member) = rest.strip_prefix("::") else {
            return !is_part_of_a_name && rest.starts_with(" as ");
        };
        let mut chars = member.chars();
        let (first, second) = (chars.next(), chars.next());
        let is_variant = first.is_some_and(char::is_uppercase) && second.is_some_and(char::is_lowercase);
        !is_part_of_a_name && (is_variant || matches!(first, Some('*' | '{')))
    })
}

#[test]
fn variants_are_told_from_functions() {
    for variant in ["Emitter::Disc(disc) => 1,", "use crate::light::Emitter::*;", "Emitter as E,"] {
        assert!(names_a_variant(variant, "Emitter"), "{variant}");
    }
    for other in ["Emitter::exponent_from_half_angle(2.0)", "Emitter::MAX_EXPONENT", "PreparedEmitter::Disc"]
    {
        assert!(!names_a_variant(other, "Emitter"), "{other}");
    }
}

#[test]
fn variants_of_models_are_named_only_where_the_model_lives() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut files = Vec::new();
    for part in ["crates", "benchmarks"] {
        sources(&repository.join(part), &mut files);
    }
    let mut violations = Vec::new();
    for file in files {
        let path = file.strip_prefix(&repository).unwrap().to_str().unwrap().replace('\\', "/");
        // Tests and examples make models in code, as users of the library do.
        if !path.contains("/src/") || file.file_stem().unwrap().to_str().unwrap().ends_with("tests") {
            continue;
        }
        let text = fs::read_to_string(&file).unwrap();
        for (number, line) in without_tests(&text).lines().enumerate() {
            let code = line.split("//").next().unwrap();
            for (name, homes) in CLOSED_ENUMS {
                if names_a_variant(code, name) && !homes.iter().any(|home| path.starts_with(home)) {
                    violations.push(format!(
                        "{path}:{}: names a variant of {name}: {}",
                        number + 1,
                        line.trim()
                    ));
                }
            }
        }
    }
    assert!(violations.is_empty(), "\n{}", violations.join("\n"));
}
