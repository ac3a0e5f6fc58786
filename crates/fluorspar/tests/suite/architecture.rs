//! The order of the crates and of the modules of the library, read from their `use` lines: nothing may reach upward.
#![allow(clippy::unwrap_used)]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Each module of the library and the modules that it may use.
const MODULES: &[(&str, &[&str])] = &[
    ("digest", &[]),
    ("units", &[]),
    ("quote", &[]),
    ("names", &["quote"]),
    ("warning", &[]),
    ("interruption", &[]),
    ("spectral", &["digest", "units"]),
    ("image", &["units", "spectral"]),
    ("sampling", &["units"]),
    ("geometry", &["digest", "units"]),
    ("safety", &["units", "spectral"]),
    ("material", &["digest", "units", "spectral", "image", "sampling", "geometry", "tissue"]),
    ("light", &["units", "spectral", "image", "sampling", "geometry"]),
    ("optics", &["units", "spectral", "image", "sampling", "geometry"]),
    ("tissue", &["units", "quote", "names", "interruption", "spectral", "sampling"]),
    ("scene", &["units", "spectral", "image", "sampling", "geometry", "material", "light", "optics"]),
    (
        "render",
        &[
            "digest",
            "units",
            "interruption",
            "spectral",
            "image",
            "sampling",
            "geometry",
            "material",
            "light",
            "optics",
            "tissue",
            "scene",
        ],
    ),
    ("sensor", &["units", "warning", "spectral", "image", "sampling"]),
    ("analysis", &["units", "names", "warning", "spectral", "image", "sampling", "optics"]),
    (
        "study",
        &[
            "units", "spectral", "image", "sampling", "geometry", "material", "light", "optics", "tissue",
            "scene", "render", "safety", "sensor", "analysis",
        ],
    ),
    ("design", &["units", "spectral", "image", "sampling", "optics", "safety", "sensor"]),
    (
        "pipeline",
        &[
            "digest", "units", "warning", "spectral", "image", "sampling", "geometry", "material", "light",
            "optics", "tissue", "scene", "render", "safety", "sensor", "analysis", "study", "design",
        ],
    ),
    ("findings", &["sampling", "safety", "analysis", "pipeline"]),
];

/// Crates above the library, or folders of them: the modules of the library that they may use, and the other crates of
/// this workspace. What stands first is looked up first.
const FRONTS: &[(&str, &[&str], &[&str])] = &[
    ("fluorspar-anatomy/src/", &["units", "interruption", "sampling", "geometry"], &["fluorspar_accel"]),
    (
        "fluorspar-format/src/",
        &["digest", "units", "quote", "names", "spectral", "image", "geometry", "optics"],
        &[],
    ),
    (
        "fluorspar-experiment/src/preset/",
        &["units", "quote", "names", "spectral", "optics", "sensor", "tissue"],
        &["fluorspar_format"],
    ),
    // Files become a study. What is done with a study is none of its business.
    (
        "fluorspar-experiment/src/",
        &[
            "digest", "units", "quote", "names", "warning", "spectral", "image", "sampling", "geometry",
            "material", "light", "optics", "tissue", "scene", "render", "safety", "sensor", "analysis",
            "study", "design",
        ],
        &["fluorspar_anatomy", "fluorspar_format"],
    ),
    (
        "fluorspar-pbrt/src/",
        &[
            "units", "quote", "spectral", "geometry", "material", "light", "optics", "scene", "render",
            "study",
        ],
        &["fluorspar_experiment", "fluorspar_format"],
    ),
    (
        "fluorspar-session/src/",
        &[
            "digest",
            "units",
            "quote",
            "names",
            "interruption",
            "spectral",
            "image",
            "sensor",
            "light",
            "tissue",
            "scene",
            "render",
            "analysis",
            "study",
            "design",
            "pipeline",
            "findings",
        ],
        &["fluorspar_experiment", "fluorspar_format", "fluorspar_report"],
    ),
    (
        "fluorspar-study/src/",
        &["digest", "image", "analysis", "findings", "units"],
        &["fluorspar_format", "fluorspar_report", "fluorspar_session"],
    ),
];

/// Each crate and the crates of this workspace that its manifest may name; tests included, but for `fluorspar-testkit`.
const CRATES: &[(&str, &[&str])] = &[
    ("fluorspar-accel", &[]),
    ("fluorspar-testkit", &[]),
    ("fluorspar", &["fluorspar-accel"]),
    ("fluorspar-anatomy", &["fluorspar-accel", "fluorspar"]),
    ("fluorspar-format", &["fluorspar"]),
    ("fluorspar-experiment", &["fluorspar", "fluorspar-anatomy", "fluorspar-format"]),
    ("fluorspar-pbrt", &["fluorspar", "fluorspar-format", "fluorspar-experiment"]),
    ("fluorspar-report", &["fluorspar", "fluorspar-format", "fluorspar-experiment"]),
    ("fluorspar-session", &["fluorspar", "fluorspar-format", "fluorspar-experiment", "fluorspar-report"]),
    ("fluorspar-study", &["fluorspar", "fluorspar-format", "fluorspar-report", "fluorspar-session"]),
    ("fluorspar-validation", &["fluorspar", "fluorspar-format", "fluorspar-experiment", "fluorspar-report"]),
    (
        "fluorspar-web",
        &["fluorspar", "fluorspar-experiment", "fluorspar-format", "fluorspar-report", "fluorspar-session"],
    ),
    (
        "fluorspar-cli",
        &[
            "fluorspar-accel",
            "fluorspar",
            "fluorspar-anatomy",
            "fluorspar-format",
            "fluorspar-experiment",
            "fluorspar-pbrt",
            "fluorspar-report",
            "fluorspar-session",
            "fluorspar-study",
            "fluorspar-validation",
            "fluorspar-web",
        ],
    ),
    (
        "fluorspar-py",
        &[
            "fluorspar",
            "fluorspar-cli",
            "fluorspar-experiment",
            "fluorspar-format",
            "fluorspar-report",
            "fluorspar-session",
            "fluorspar-study",
        ],
    ),
];

pub(crate) fn crates() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

pub(crate) fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
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
    text.find("#[cfg(test)]\nmod tests {").map_or(text, |end| &text[..end])
}

/// Code without unit tests and comments, line for line.
pub(crate) fn plain_code(text: &str) -> String {
    let plain =
        |line: &str| if line.trim_start().starts_with("//") { String::new() } else { line.to_string() };
    without_tests(text).lines().map(plain).collect::<Vec<_>>().join("\n")
}

/// The paths that a file names: in `use` statements, each item of a tree by itself, and in its code.
fn paths_named(code: &str) -> Vec<Vec<String>> {
    let mut paths: Vec<Vec<String>> = use_paths(code).into_iter().map(|(_, path)| path).collect();
    paths.extend(paths_in_code(code));
    paths
}

/// What of a file reaches out of its place: modules of the library (named from `root` on) that are not among `modules`,
/// and crates of this workspace that are not among `others`.
fn uses_outside(code: &str, root: &str, modules: &[&str], others: &[&str]) -> BTreeSet<String> {
    let mut outside = BTreeSet::new();
    for path in paths_named(code) {
        let [first, rest @ ..] = path.as_slice() else { continue };
        if first == root {
            let module = rest.first().map_or("", String::as_str);
            if MODULES.iter().any(|(known, _)| *known == module) && !modules.contains(&module) {
                outside.insert(module.to_string());
            }
        } else if first.starts_with("fluorspar") && !others.contains(&first.as_str()) {
            outside.insert(first.clone());
        }
    }
    outside
}

/// Tests in files of their own, and what they share.
pub(crate) fn is_test(file: &Path) -> bool {
    let stem = file.file_stem().unwrap().to_str().unwrap();
    stem.ends_with("tests")
}

#[test]
fn modules_use_only_what_lies_below_them() {
    let root = crates().join("fluorspar/src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut modules_seen = BTreeSet::new();
    let mut violations = Vec::new();
    for file in files {
        let relative = file.strip_prefix(&root).unwrap();
        let module = relative.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_string();
        // The crate's front page only declares.
        if module == "lib" || is_test(&file) {
            continue;
        }
        let Some((_, below)) = MODULES.iter().find(|(name, _)| *name == module) else {
            violations.push(format!("{}: module `{module}` has no place in the order", relative.display()));
            continue;
        };
        let allowed: Vec<&str> = below.iter().copied().chain([module.as_str()]).collect();
        let code = plain_code(&fs::read_to_string(&file).unwrap());
        let outside = uses_outside(&code, "crate", &allowed, &["fluorspar_accel"]);
        violations.extend(outside.iter().map(|used| format!("{}: uses {used}", relative.display())));
        modules_seen.insert(module);
    }
    assert_eq!(modules_seen.len(), MODULES.len(), "a module of the order does not exist: {modules_seen:?}");
    assert!(violations.is_empty(), "\n{}", violations.join("\n"));
}

#[test]
fn fronts_use_only_what_lies_below_them() {
    let mut violations = Vec::new();
    let mut seen = BTreeSet::new();
    for (place, _, _) in FRONTS {
        let mut files = Vec::new();
        sources(&crates().join(place), &mut files);
        for file in files {
            let relative = file.strip_prefix(crates()).unwrap().to_str().unwrap().replace('\\', "/");
            let home = FRONTS.iter().find(|(place, _, _)| relative.starts_with(place)).unwrap();
            if home.0 == *place && !is_test(&file) {
                let code = plain_code(&fs::read_to_string(&file).unwrap());
                let outside = uses_outside(&code, "fluorspar", home.1, home.2);
                violations.extend(outside.iter().map(|used| format!("{relative}: uses {used}")));
                seen.insert(*place);
            }
        }
    }
    assert_eq!(seen.len(), FRONTS.len(), "a front of the order does not exist: {seen:?}");
    assert!(violations.is_empty(), "\n{}", violations.join("\n"));
}

#[test]
fn imports_of_what_lies_above_are_found() {
    let outside = |code: &str| {
        let found = uses_outside(&plain_code(code), "crate", &["units", "light"], &["fluorspar_accel"]);
        found.into_iter().collect::<Vec<_>>().join(" ")
    };
    assert_eq!(outside("use crate::units::X;\nuse crate::{\n    light::{A, B},\n    render,\n};"), "render");
    assert_eq!(outside("fn f() { crate::scene::g() }\nuse fluorspar_accel::Ray;"), "scene");
    assert_eq!(outside("pub use fluorspar_above::{parse, resolve};"), "fluorspar_above");
    assert_eq!(outside("// crate::scene::g()\n#[cfg(test)]\nmod tests {\n    use crate::scene::S;\n}"), "");
}

/// Names of the crates of this workspace in the tables of dependencies of a manifest.
fn workspace_dependencies(manifest: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut in_dependencies = false;
    for line in manifest.lines() {
        if line.starts_with('[') {
            in_dependencies = line.trim_end_matches(']').ends_with("dependencies");
        } else if in_dependencies && line.starts_with("fluorspar") {
            let name = |c: char| c.is_ascii_alphanumeric() || c == '-';
            found.insert(line.chars().take_while(|c| name(*c)).collect());
        }
    }
    found
}

#[test]
fn crates_depend_only_on_what_lies_below_them() {
    let mut violations = Vec::new();
    for entry in fs::read_dir(crates()).unwrap() {
        let folder = entry.unwrap().path();
        let name = folder.file_name().unwrap().to_str().unwrap();
        let Some((_, allowed)) = CRATES.iter().find(|(known, _)| *known == name) else {
            violations.push(format!("{name} has no place in the order"));
            continue;
        };
        for used in workspace_dependencies(&fs::read_to_string(folder.join("Cargo.toml")).unwrap()) {
            if used != "fluorspar-testkit" && !allowed.contains(&used.as_str()) {
                violations.push(format!("{name} depends on {used}"));
            }
        }
    }
    assert!(violations.is_empty(), "\n{}", violations.join("\n"));
    let manifest =
        "[package]\nname = \"fluorspar-x\"\n[dev-dependencies]\nfluorspar-y.workspace = true\nglam = 1\n";
    assert_eq!(Vec::from_iter(workspace_dependencies(manifest)), ["fluorspar-y"]);
}

/// Enums of models: only the module of the model and what makes them from experiment files name their variants. All
/// else calls methods, so that a new variant is one file and a row of the schema.
const CLOSED_ENUMS: &[(&str, &[&str])] = &[
    (
        "Scattering",
        &[
            "crates/fluorspar/src/material/",
            "crates/fluorspar-experiment/src/schema/material.rs",
            "crates/fluorspar-experiment/src/resolve/material.rs",
            "crates/fluorspar-pbrt/src/experiment.rs",
            "crates/fluorspar-pbrt/src/material.rs",
            // Write scenes for other programs.
            "crates/fluorspar-pbrt/src/write.rs",
            "crates/fluorspar-pbrt/src/gltf.rs",
        ],
    ),
    (
        "Emitter",
        &[
            "crates/fluorspar/src/light/",
            "crates/fluorspar-experiment/src/resolve/light.rs",
            "crates/fluorspar-pbrt/src/experiment.rs",
            "crates/fluorspar-pbrt/src/light.rs",
            // Write scenes for other programs.
            "crates/fluorspar-pbrt/src/write.rs",
            "crates/fluorspar-pbrt/src/gltf.rs",
            "benchmarks/src/export.rs",
        ],
    ),
    ("PreparedEmitter", &["crates/fluorspar/src/light/"]),
    ("FlatPattern", &["crates/fluorspar/src/light/"]),
    // The sampling of lights builds its tree of what has a place.
    ("LightBounds", &["crates/fluorspar/src/light/", "crates/fluorspar/src/render/light_sampling.rs"]),
    ("PreparedScattering", &["crates/fluorspar/src/material/"]),
    ("Bsdf", &["crates/fluorspar/src/material/"]),
    ("Lobe", &["crates/fluorspar/src/material/"]),
    ("Dispersion", &["crates/fluorspar/src/optics/", "crates/fluorspar-format/src/lens/"]),
    ("FocusMechanism", &["crates/fluorspar/src/optics/", "crates/fluorspar-format/src/lens/"]),
];

/// Whether a line of code names a variant of an enum, imports variants, or imports the enum under another name.
/// Functions and constants of the enum are not variants.
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

/// The public type that a line of code declares.
fn declared_type(line: &str) -> Option<&str> {
    let declaration = line.trim_start().strip_prefix("pub ")?;
    let name =
        ["struct ", "enum ", "trait ", "type "].iter().find_map(|kind| declaration.strip_prefix(kind))?;
    let name = &name[..name.find(|c: char| !c.is_alphanumeric()).unwrap_or(name.len())];
    // A macro names its types later
    (!name.is_empty()).then_some(name)
}

#[test]
fn no_two_public_types_share_a_name() {
    let mut files = Vec::new();
    sources(&crates(), &mut files);
    let mut homes: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in files {
        let path = file.strip_prefix(crates()).unwrap().to_str().unwrap().replace('\\', "/");
        let text = fs::read_to_string(&file).unwrap();
        if path.contains("/src/") {
            // An associated type bears the name of its trait's item.
            for name in
                without_tests(&text).lines().filter(|line| !line.contains(" = ")).filter_map(declared_type)
            {
                homes.entry(name.into()).or_default().push(path.clone());
            }
        }
    }
    assert!(homes.len() > 300, "only {} public types found", homes.len());
    let shared = homes.iter().filter(|(_, files)| files.len() > 1);
    let shared: Vec<String> = shared.map(|(name, files)| format!("{name}: {}", files.join(", "))).collect();
    assert!(shared.is_empty(), "\n{}", shared.join("\n"));
    assert_eq!(declared_type("    pub struct Film<'a> {"), Some("Film"));
    assert_eq!(declared_type("pub(crate) struct Film {"), None);
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
    let repository = crates().join("..");
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

/// Ways to open a file for reading.
const OPENING: &[&str] = &["fs::read(", "fs::read_to_string(", "File::open("];

/// Files that may open files: the input layer, and what locks folders.
const MAY_OPEN: &[&str] = &[
    "fluorspar-format/src/store/input.rs",
    "fluorspar-format/src/store/output/disk.rs",
    "fluorspar-format/src/store/output/folder.rs",
];

/// Ways to make, replace or remove a file.
const WRITING: &[&str] = &[
    "fs::write(",
    "File::create(",
    "OpenOptions::new(",
    "tempfile_in(",
    "fs::rename(",
    "fs::remove_file(",
    "fs::remove_dir",
    "fs::create_dir(",
];

/// Files that may do so: the output layer, the cache, and rows that wait in a file without a name.
const MAY_WRITE: &[&str] = &[
    "fluorspar-format/src/store/output/claim.rs",
    "fluorspar-format/src/store/output/file.rs",
    "fluorspar-format/src/store/output/folder.rs",
    "fluorspar-format/src/store/output/lines.rs",
    "fluorspar-format/src/store/output/set.rs",
    "fluorspar-format/src/store/cache.rs",
    "fluorspar-format/src/store/spooled_image.rs",
    // SQLite opens its own files
    "fluorspar-study/src/index.rs",
];

#[test]
fn files_are_opened_and_written_in_one_place() {
    only_in(OPENING, MAY_OPEN, "read files with `fluorspar_format::read_bounded` and its like");
    only_in(WRITING, MAY_WRITE, "write files with `fluorspar_format::write_atomically` and its like");
}

/// Ways to parse TOML, which end the stack where brackets are deep.
const PARSING_TOML: &[&str] = &[
    "toml::from_str",
    "toml::de::from_str",
    "DeTable::parse",
    "DocumentMut::from_str",
    "parse::<toml::",
    "parse::<DocumentMut>",
];

#[test]
fn toml_is_parsed_in_one_place() {
    only_in(
        PARSING_TOML,
        &["fluorspar-format/src/toml_text.rs"],
        "read TOML with `fluorspar_format::read_toml`",
    );
    // `parse` without a type is TOML where the type of its result is: in files that know such types, each says its own.
    let mut files = Vec::new();
    for (name, _) in CRATES {
        sources(&crates().join(name).join("src"), &mut files);
    }
    let untyped: Vec<PathBuf> = files
        .into_iter()
        .filter(|file| !is_test(file))
        .filter(|file| parses_unknown_types_beside_toml(&plain_code(&fs::read_to_string(file).unwrap())))
        .collect();
    assert!(untyped.is_empty(), "write `parse::<f64>()` or the like beside types of TOML: {untyped:?}");
}

fn parses_unknown_types_beside_toml(code: &str) -> bool {
    ["toml::", "toml_edit::"].iter().any(|known| code.contains(known))
        && [".parse()", "str::parse)", "FromStr::from_str"].iter().any(|way| code.contains(way))
}

#[test]
fn parsing_without_a_type_is_found_beside_types_of_toml() {
    let table = "fn read(text: &str) -> Option<toml::Table> {\n    text.parse().ok()\n}\n";
    assert!(parses_unknown_types_beside_toml(table));
    let imported =
        "use toml_edit::DocumentMut;\nfn read(t: &str) { let d: DocumentMut = t.parse().unwrap(); }";
    assert!(parses_unknown_types_beside_toml(imported));
    assert!(!parses_unknown_types_beside_toml("fn read(text: &str) -> Option<f64> { text.parse().ok() }"));
    assert!(!parses_unknown_types_beside_toml("toml::Value::Float(text.parse::<f64>()?)"));
}

/// Looks for code in other files than those that may have it.
fn only_in(ways: &[&str], homes: &[&'static str], instead: &str) {
    let mut files = Vec::new();
    for (name, _) in CRATES {
        sources(&crates().join(name).join("src"), &mut files);
    }
    let mut violations = Vec::new();
    let mut seen = BTreeSet::new();
    for file in files {
        let path = file.strip_prefix(crates()).unwrap().to_str().unwrap().replace('\\', "/");
        if is_test(&file) {
            continue;
        }
        let code = plain_code(&fs::read_to_string(&file).unwrap());
        for (number, line) in code.lines().enumerate() {
            // A longer name that ends alike is another one.
            let begins = |at: usize| !line[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
            if !ways.iter().any(|way| line.match_indices(way).any(|(at, _)| begins(at))) {
                continue;
            }
            match homes.iter().find(|home| path == **home) {
                Some(home) => {
                    seen.insert(*home);
                }
                None => violations.push(format!("{path}:{}: {}", number + 1, line.trim())),
            }
        }
    }
    assert!(violations.is_empty(), "{instead}\n{}", violations.join("\n"));
    assert_eq!(seen.len(), homes.len(), "a file that may does not: {seen:?}");
}

/// Modules of crates whose files must import each other without circles; a whole crate has no name.
const WITHOUT_CIRCLES: &[(&str, &str)] = &[
    ("fluorspar", "render"),
    ("fluorspar", "material"),
    ("fluorspar", "light"),
    ("fluorspar", "pipeline"),
    ("fluorspar-experiment", ""),
    ("fluorspar-format", "frame"),
];

/// The files of one module: what each of them imports from the others.
struct ModuleFiles<'a> {
    /// Name of the module, under the crate's root; empty for a whole crate.
    module: &'a str,
    /// Path inside the module, `["compile", "lights"]`, to the code of the file; of a `mod.rs` the path of its folder,
    /// of a `lib.rs` none.
    code: BTreeMap<Vec<String>, String>,
}

/// The paths that the trees of `use` statements name: `a::{b, c::D}` is `a::b` and `a::c::D`.
fn expand(tree: &str) -> Vec<Vec<String>> {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        let path = tree.split(" as ").next().unwrap_or("");
        return vec![path.split("::").map(|segment| segment.trim().to_string()).collect()];
    };
    let close = tree.rfind('}').unwrap();
    let (mut depth, mut start, mut parts) = (0, open + 1, Vec::new());
    for (at, letter) in tree[..close].char_indices().skip_while(|(at, _)| *at <= open) {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&tree[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&tree[start..close]);
    let head = tree[..open].trim_end_matches("::");
    let joined = |part: &&str| !part.trim().is_empty();
    parts.iter().filter(|part| joined(part)).flat_map(|part| expand(&format!("{head}::{part}"))).collect()
}

/// `use` statements of a file: whether they export what they import, and the paths that they name.
fn use_paths(code: &str) -> Vec<(bool, Vec<String>)> {
    let mut found = Vec::new();
    for (number, statement) in code.split_inclusive(';').enumerate() {
        // A semicolon within a text ends no line: what follows it is no statement.
        let file_start = (number == 0).then_some(0);
        let line =
            statement.rfind("use ").and_then(|at| statement[..at].rfind('\n').map(|n| n + 1).or(file_start));
        let Some(text) = line.map(|start| statement[start..].trim()) else { continue };
        let exports = text.starts_with("pub");
        let Some((before, tree)) = text.split_once("use ") else { continue };
        if before.is_empty() || exports {
            let tree = tree.trim_end_matches(';');
            found.extend(expand(tree).into_iter().map(|path| (exports, path)));
        }
    }
    found
}

/// Paths in the code of a file besides its `use` statements.
fn paths_in_code(code: &str) -> Vec<Vec<String>> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut paths = Vec::new();
    for line in code.lines().filter(|line| !line.contains("use ")) {
        // A visibility such as `pub(in crate::render)` uses nothing.
        let visibility = line.trim_start().strip_prefix("pub(in ").and_then(|rest| rest.split_once(')'));
        let line = visibility.map_or(line, |(_, item)| item);
        let words = line.split(|c| !is_name(c) && c != ':').filter(|word| word.contains("::"));
        paths.extend(words.map(|word| word.split("::").map(String::from).collect()));
    }
    paths
}

impl<'a> ModuleFiles<'a> {
    /// Reads a module's files from its folder.
    fn read(root: &Path, module: &'a str) -> Self {
        let folder = root.join(module);
        let mut files = Vec::new();
        sources(&folder, &mut files);
        let mut code = BTreeMap::new();
        for file in files {
            let stem = file.file_stem().unwrap().to_str().unwrap().to_string();
            if stem.ends_with("tests") {
                continue;
            }
            let relative = file.strip_prefix(&folder).unwrap();
            let mut path: Vec<String> =
                relative.iter().map(|part| part.to_str().unwrap().trim_end_matches(".rs").into()).collect();
            if stem == "mod" || path == ["lib"] {
                path.pop();
            }
            code.insert(path, fs::read_to_string(&file).unwrap());
        }
        Self::new(module, code)
    }

    fn new(module: &'a str, mut code: BTreeMap<Vec<String>, String>) -> Self {
        for text in code.values_mut() {
            *text = plain_code(text);
        }
        Self { module, code }
    }

    /// A path as it is written in a file, from the module's root on; `None` where it leads out of the module.
    fn absolute(&self, file: &[String], path: &[String]) -> Option<Vec<String>> {
        let mut at: Vec<String> = file.to_vec();
        let mut rest = path;
        match path.first()?.as_str() {
            "crate" if path.get(1).is_some_and(|name| name == self.module) => {
                (at, rest) = (Vec::new(), &path[2..]);
            }
            "crate" if self.module.is_empty() => (at, rest) = (Vec::new(), &path[1..]),
            "super" => {
                while let Some(("super", after)) =
                    rest.split_first().map(|(name, after)| (name.as_str(), after))
                {
                    at.pop()?;
                    rest = after;
                }
            }
            "self" => rest = &path[1..],
            // A module below the one of the file.
            name => {
                let mut below = at.clone();
                below.push(name.into());
                self.code.contains_key(&below).then_some(())?;
            }
        }
        at.extend(rest.iter().cloned());
        Some(at)
    }

    /// The file that defines what a path from the module's root names, looked up through re-exports.
    fn definition(&self, path: &[String]) -> Option<Vec<String>> {
        let length = (0..=path.len()).rev().find(|&length| self.code.contains_key(&path[..length]))?;
        let (file, rest) = path.split_at(length);
        if let Some(item) = rest.first() {
            for (exports, exported) in use_paths(&self.code[file]) {
                if exports && exported.last() == Some(item) {
                    let target = self.absolute(file, &exported)?;
                    return if target == path { Some(file.to_vec()) } else { self.definition(&target) };
                }
            }
        }
        Some(file.to_vec())
    }

    /// The files that a file uses, itself left out: by `use` statements and by paths in its code.
    fn used_by(&self, file: &[String]) -> BTreeSet<Vec<String>> {
        let code = &self.code[file];
        let mut paths: Vec<Vec<String>> =
            use_paths(code).into_iter().filter(|(exports, _)| !exports).map(|(_, path)| path).collect();
        paths.extend(paths_in_code(code));
        let mut used: BTreeSet<Vec<String>> = paths
            .iter()
            .filter_map(|path| self.absolute(file, path))
            .filter_map(|path| self.definition(&path))
            .collect();
        used.remove(file);
        used
    }

    /// Circles among the files, and among the folders and files directly below the module: each as the names in it.
    fn circles(&self) -> BTreeSet<Vec<String>> {
        let edges: Vec<(Vec<String>, Vec<String>)> = self
            .code
            .keys()
            .flat_map(|file| self.used_by(file).into_iter().map(|used| (file.clone(), used)))
            .collect();
        let mut found = BTreeSet::new();
        for depth in [1, usize::MAX] {
            let name = |path: &[String]| {
                let shown = &path[..path.len().min(depth)];
                if shown.is_empty() { "mod".to_string() } else { shown.join("/") }
            };
            let mut reached: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
            for (file, used) in &edges {
                if name(file) != name(used) {
                    reached.entry(name(file)).or_default().insert(name(used));
                }
            }
            // What a file reaches through others
            loop {
                let longer = reached.iter().map(|(file, used)| {
                    let through = used.iter().filter_map(|other| reached.get(other)).flatten();
                    (file.clone(), used.iter().chain(through).cloned().collect())
                });
                let longer: BTreeMap<String, BTreeSet<String>> = longer.collect();
                if longer == reached {
                    break;
                }
                reached = longer;
            }
            // Files that reach themselves, with those that reach them in turn
            for (file, used) in reached.iter().filter(|(file, used)| used.contains(*file)) {
                let back = |other: &&String| reached.get(*other).is_some_and(|used| used.contains(file));
                found.insert(used.iter().filter(back).cloned().collect());
            }
        }
        found
    }
}

#[test]
fn files_of_a_module_import_each_other_without_circles() {
    let mut found = Vec::new();
    for (name, module) in WITHOUT_CIRCLES {
        let circles = ModuleFiles::read(&crates().join(name).join("src"), module).circles();
        found.extend(circles.iter().map(|circle| format!("{name} {module}: {}", circle.join(", "))));
    }
    assert!(found.is_empty(), "circles of imports\n{}", found.join("\n"));
}

#[test]
fn circles_of_imports_are_found() {
    let circles = |files: &[(&str, &str)]| {
        let path = |name: &str| name.split('/').filter(|part| !part.is_empty()).map(String::from).collect();
        let code = files.iter().map(|(name, text)| (path(name), (*text).to_string())).collect();
        Vec::from_iter(ModuleFiles::new("render", code).circles())
    };
    let facade = ("", "mod a;\nmod b;\npub use a::A;\npub use b::{B, C as D};\n");
    // What a façade exports belongs to the file that defines it.
    assert!(circles(&[facade, ("a", "struct A;"), ("b", "use super::A;\nstruct B;")]).is_empty());
    assert_eq!(
        circles(&[facade, ("a", "use super::{\n    B,\n};"), ("b", "use super::a::A;")]),
        [["a", "b"]]
    );
    // Paths in code count, those of tests and comments do not.
    assert_eq!(
        circles(&[facade, ("a", "fn f() { super::b::g() }"), ("b", "use crate::render::A;")]),
        [["a", "b"]]
    );
    let tests = "// super::b::g()\n#[cfg(test)]\nmod tests {\n    use super::super::b::B;\n}";
    assert!(circles(&[facade, ("a", tests), ("b", "use super::a::A;")]).is_empty());
    // A file that needs an item of the module's own page, which uses the file.
    assert_eq!(circles(&[("", "mod a;\nfn f() { a::g() }"), ("a", "use super::f;")]), [["a", "mod"]]);
    // Folders: no circle of files, but one of rooms.
    let rooms = [("c", ""), ("c/one", "use super::super::d;"), ("c/two", ""), ("d", "use super::c::two::X;")];
    assert_eq!(circles(&rooms), [["c", "d"]]);
}

/// The paths of files and folders that a page names in backticks: with a slash, and without spaces or wildcards.
fn named_paths(page: &str) -> Vec<&str> {
    let quoted = page.lines().filter(|line| !line.starts_with("    ")).flat_map(|line| {
        // Every second piece between backticks is quoted.
        line.split('`').skip(1).step_by(2)
    });
    let is_file = |name: &str| [".rs", ".md", ".toml", ".py"].iter().any(|end| name.ends_with(end));
    let is_path = |name: &&str| (name.contains('/') || is_file(name)) && !name.contains([' ', '*', '{', '<']);
    quoted.filter(is_path).collect()
}

#[test]
fn files_that_the_architecture_page_names_exist() {
    let root = crates().join("..");
    let mut bases = vec![root.clone()];
    for entry in fs::read_dir(root.join("crates")).unwrap() {
        let folder = entry.unwrap().path();
        bases.extend([folder.join("src"), folder]);
    }
    bases.push(root.join("crates"));
    let exists = |name: &str| bases.iter().any(|base| base.join(name).exists());
    let page = fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let paths = named_paths(&page);
    assert!(paths.len() > 50, "only {} paths were found on the page", paths.len());
    let missing: Vec<&&str> = paths.iter().filter(|name| !exists(name)).collect();
    assert!(missing.is_empty(), "ARCHITECTURE.md names what does not exist: {missing:?}");
    // A file that is not there is found missing.
    assert!(!exists("render/integrator.rs"));
}
