//! docs/commands.md agrees with `--help`: its lists are generated (`reference_tests.rs`), its words name no option that does not exist. The
//! command lines of all documents name commands and options that exist.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::support::fluorspar;

/// Commands, and those within them.
fn commands(within: &[&str]) -> Vec<Vec<String>> {
    let help = help(within);
    let list = help.split("\nOptions").next().unwrap();
    let names = list.lines().filter_map(|line| {
        let name = line.strip_prefix("  ")?.split(' ').next()?;
        (name.starts_with(|c: char| c.is_ascii_lowercase()) && name != "help").then(|| name.to_string())
    });
    let names: Vec<String> = names.collect();
    if names.is_empty() {
        return vec![within.iter().map(|word| word.to_string()).collect()];
    }
    names.into_iter().flat_map(|name| commands(&[within, &[&name]].concat())).collect()
}

fn help(command: &[&str]) -> String {
    let args: Vec<&str> = command.iter().copied().chain(["--help"]).collect();
    fluorspar(Path::new("."), args).well().stdout
}

/// Words that begin with two dashes, in their order.
fn options_in_order(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in text.match_indices("--") {
        let before = text[..at].chars().next_back();
        let name: String = text[at + 2..]
            .chars()
            .take_while(|c| c.is_ascii_lowercase() || *c == '-' || c.is_ascii_digit())
            .collect();
        let begins = before.is_none_or(|c| !c.is_alphanumeric() && c != '-');
        if begins && name.starts_with(|c: char| c.is_ascii_lowercase()) {
            found.push(format!("--{}", name.trim_end_matches('-')));
        }
    }
    found
}

fn options(text: &str) -> BTreeSet<String> {
    options_in_order(text).into_iter().collect()
}

/// Options of all commands.
const OF_ALL: [&str; 6] = ["--help", "--version", "--threads", "--verbose", "--quiet", "--no-cache"];

/// Options of a command by its help, those of all commands left out. Only the lines that name them: explanations mention
/// options of other commands.
fn options_of(command: &[&str]) -> BTreeSet<String> {
    let help = help(command);
    let lines = help.lines().filter(|line| {
        let line = line.trim_start();
        line.starts_with("--")
            || (line.starts_with('-') && line.get(2..).is_some_and(|rest| rest.starts_with(", --")))
    });
    let named: BTreeSet<String> =
        lines.filter_map(|line| options_in_order(line).into_iter().next()).collect();
    named.into_iter().filter(|option| !OF_ALL.contains(&option.as_str())).collect()
}

#[test]
fn the_page_of_commands_names_no_option_that_none_has() {
    let text =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/commands.md")).unwrap();
    let mut all: BTreeSet<String> = OF_ALL.map(String::from).into();
    for command in commands(&[]) {
        all.extend(options_of(&command.iter().map(String::as_str).collect::<Vec<_>>()));
    }
    // Options of cargo, in the words about a checkout.
    all.insert("--release".into());
    let invented: Vec<String> = options(&text).difference(&all).cloned().collect();
    assert!(invented.is_empty(), "docs/commands.md names {invented:?}, which no command has");
}

/// Options of a command by its help: name, alternatives of its value, and the words that explain it.
fn explained_options(command: &[&str]) -> Vec<(String, Vec<String>, String)> {
    let help = help(command);
    let raw: Vec<&str> = help.lines().collect();
    let lines: Vec<&str> = raw.iter().map(|line| line.trim()).collect();
    let mut found = Vec::new();
    for (number, line) in lines.iter().enumerate() {
        // Explanations are indented further.
        if raw[number].len() - raw[number].trim_start().len() > 6 {
            continue;
        }
        let long = line.split_once(", --").filter(|(short, _)| short.len() == 2).map(|(_, long)| long);
        let Some(rest) = line.strip_prefix("--").or(long) else { continue };
        let end = rest.find(|c: char| !c.is_ascii_lowercase() && c != '-' && !c.is_ascii_digit());
        let (name, rest) = rest.split_at(end.unwrap_or(rest.len()));
        let (value, words) = match rest.trim_start().strip_prefix('<').and_then(|rest| rest.split_once('>')) {
            Some((value, words)) => (value, words.trim_start_matches("...").trim()),
            None => ("", rest.trim()),
        };
        let words = if words.is_empty() { lines.get(number + 1).copied().unwrap_or_default() } else { words };
        let alternatives = value.split('|').map(String::from).collect();
        found.push((format!("--{name}"), alternatives, words.to_string()));
    }
    found
}

/// An option takes the same kind of value in all commands that have it, and its explanation begins with the same word. Switches that
/// concern every command are explained by the same sentence.
#[test]
fn no_flag_means_two_things() {
    // What a file is depends on its ending, and a folder takes several: `--out` is where files go.
    let places = ["DIR", "FILE", "FILE.toml", "FILE.png", "NAME.toml", "PATH"];
    let mut known: BTreeMap<String, (Vec<String>, String, String)> = BTreeMap::new();
    let mut wrong = Vec::new();
    for command in commands(&[]) {
        let words: Vec<&str> = command.iter().map(String::as_str).collect();
        for (option, value, said) in explained_options(&words) {
            let name = words.join(" ");
            let first = |text: &str| {
                text.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default().to_string()
            };
            if option == "--out" {
                let is_place = value.iter().all(|value| places.contains(&value.as_str()));
                if !is_place || !["File", "Folder"].contains(&first(&said).as_str()) {
                    wrong.push(format!("{name} --out <{}>: {said}", value.join("|")));
                }
                continue;
            }
            let Some((other_value, other_said, other)) = known.get(&option) else {
                known.insert(option, (value, said, name));
                continue;
            };
            let is_within = |a: &[String], b: &[String]| a.iter().all(|value| b.contains(value));
            let is_same_value = is_within(&value, other_value) || is_within(other_value, &value);
            let is_same = match option.as_str() {
                // Explanations are wrapped at different places.
                "--json" | "--quiet" | "--verbose" => {
                    let [a, b] = [&said, other_said].map(|text| text.trim_end_matches('.'));
                    a.starts_with(b) || b.starts_with(a)
                }
                _ => first(&said) == first(other_said),
            };
            if !is_same_value || !is_same {
                wrong.push(format!(
                    "{option}: {other}: {other_value:?} {other_said}; {name}: {value:?} {said}"
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(known.len() > 80 && known.contains_key("--json"), "{} options", known.len());
}

/// Command lines of a document: in indented blocks and in blocks of a shell, continued lines joined, comments cut off.
/// What precedes the name of the program is left out.
fn command_lines(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    let (mut shell, mut continued) = (false, false);
    for line in text.lines() {
        if line.starts_with("```") {
            shell = line == "```sh";
            continue;
        }
        if !shell && !line.starts_with("    ") {
            continued = false;
            continue;
        }
        let line =
            line.split(" # ").next().unwrap_or(line).split("   ").filter(|part| !part.trim().is_empty());
        let line = line.take(1).collect::<String>();
        let line = line.trim();
        match lines.last_mut().filter(|_| continued) {
            Some(last) => *last += &format!(" {}", line.trim_end_matches('\\')),
            None => lines.push(line.trim_end_matches('\\').into()),
        }
        continued = line.ends_with('\\');
    }
    let program = |line: String| {
        let rest = line.strip_prefix("cargo run --release -- ").or_else(|| line.strip_prefix("fluorspar "));
        rest.map(str::to_string)
    };
    lines
        .into_iter()
        .flat_map(|line| line.split(" && ").map(String::from).collect::<Vec<_>>())
        .filter_map(program)
        .collect()
}

#[test]
fn the_command_lines_of_the_documents_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let known: BTreeMap<String, BTreeSet<String>> = commands(&[])
        .into_iter()
        .map(|words| {
            let options = options_of(&words.iter().map(String::as_str).collect::<Vec<_>>());
            (words.join(" "), options)
        })
        .collect();
    let documents = fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let documents = documents.filter(|path| path.extension().is_some_and(|ending| ending == "md"));
    let (mut wrong, mut read) = (Vec::new(), 0);
    for path in documents.chain([root.join("README.md")]) {
        for line in command_lines(&fs::read_to_string(&path).unwrap()) {
            // A synopsis has brackets; it is generated
            if line.starts_with('[') || line.contains(" [") {
                continue;
            }
            // Of alternatives the first
            let words: Vec<&str> =
                line.split_whitespace().filter_map(|word| word.split('|').next()).collect();
            let named = (1..=3).rev().filter_map(|count| known.get(&words.get(..count)?.join(" "))).next();
            let Some(options) = named else {
                wrong.push(format!("{}: no such command: {line}", path.display()));
                continue;
            };
            let unknown = self::options(&line)
                .into_iter()
                .filter(|o| !options.contains(o) && !OF_ALL.contains(&o.as_str()));
            wrong.extend(unknown.map(|option| format!("{}: no option {option}: {line}", path.display())));
            read += 1;
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(read >= 40, "{read} command lines");
}

/// Names of the tests of the workspace, each with the paths of the files that have one of this name.
fn tests_by_name() -> BTreeMap<String, Vec<String>> {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut open = vec![crates];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                for after in text.split("#[test]").skip(1) {
                    let name = after.split_once("fn ").and_then(|(_, rest)| rest.split_once('('));
                    let Some((name, _)) = name else { continue };
                    found.entry(name.into()).or_default().push(path.display().to_string());
                }
            }
        }
    }
    found
}

#[test]
fn every_outcome_of_the_reliability_page_names_tests_that_exist() {
    let text =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reliability.md")).unwrap();
    let tests = tests_by_name();
    let (mut with_tests, mut rows) = (false, 0);
    for line in text.lines() {
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").collect();
        if !line.starts_with('|') {
            with_tests = false;
        } else if cells.last().is_some_and(|cell| cell.trim().starts_with("test")) {
            with_tests = true;
        } else if with_tests && !line.starts_with("|---") {
            rows += 1;
            let named: Vec<&str> = cells.last().unwrap().split('`').skip(1).step_by(2).collect();
            let named: Vec<&&str> = named.iter().filter(|name| !name.starts_with("fluorspar-")).collect();
            assert!(!named.is_empty(), "no test: {line}");
            for name in named {
                let mut path: Vec<&str> = name.split("::").collect();
                let test = path.pop().unwrap();
                // `long_experiments` alone names a file of tests.
                let file = path.iter().rfind(|module| **module != "tests").copied().unwrap_or(test);
                let in_file = |place: &String| {
                    place.ends_with(&format!("/{file}.rs")) || place.contains(&format!("/{file}/"))
                };
                let exists = match tests.get(test) {
                    Some(places) => path.is_empty() || places.iter().any(in_file),
                    None => path.is_empty() && tests.values().flatten().any(in_file),
                };
                assert!(exists, "there is no test {name}: {line}");
            }
        }
    }
    assert!(rows > 30, "{rows} rows");
}
