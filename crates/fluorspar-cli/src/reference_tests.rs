//! The generated parts of the documents, from clap and from the schemas of files. Each stands between a marker and `<!-- end -->`:
//! `<!-- usage: COMMAND, ... -->` for commands with their options and examples, `<!-- options: COMMAND, ... -->` for what their own options
//! mean, `<!-- options: shared -->` for those of several, `<!-- fields: SECTION, PREFIX=SECTION, ... -->` for fields of files and what they
//! mean, `<!-- defaults: ... -->` for their names and defaults. With `FLUORSPAR_WRITE_DOCUMENTS` set the test writes them anew.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use clap::{Arg, ArgAction, Command};
use fluorspar_experiment::{
    CohortFile, LayersFile, SampleFile, design_json_schema, json_schema, json_schema_of,
};
use serde_json::{Map, Value};

use crate::args::Args;

/// What a marker stands for: its kind and its list.
type Marker = (String, Vec<String>);

fn pages() -> Vec<PathBuf> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    let mut pages: Vec<PathBuf> = fs::read_dir(docs).unwrap().map(|entry| entry.unwrap().path()).collect();
    pages.retain(|page| page.extension().is_some_and(|ending| ending == "md"));
    pages.sort();
    pages
}

fn marker(line: &str) -> Option<Marker> {
    let (kind, list) = line.strip_prefix("<!-- ")?.strip_suffix(" -->")?.split_once(": ")?;
    ["usage", "options", "fields", "defaults"]
        .contains(&kind)
        .then(|| (kind.into(), list.split(", ").map(String::from).collect()))
}

/// A page whose generated parts are what `made` makes of their markers.
fn renewed(text: &str, mut made: impl FnMut(&Marker) -> String) -> String {
    let (mut page, mut is_generated) = (String::new(), false);
    for line in text.lines() {
        is_generated &= line != "<!-- end -->";
        if !is_generated {
            page += &format!("{line}\n");
        }
        if let Some(marker) = marker(line) {
            page += &format!("\n{}\n\n", made(&marker).trim_matches('\n'));
            is_generated = true;
        }
    }
    assert!(!is_generated, "a marker without an end");
    page
}

/// The first sentence of a text, and what it says of the default. The rest is in the help of a command, and in the schema.
fn sentence(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let (text, default) = match text.split_once(" [default: ") {
        Some((before, after)) => {
            (before.to_string(), format!(" Default: {}.", after.split(']').next().unwrap()))
        }
        None => (text, String::new()),
    };
    let mut sentences = text.split_inclusive(". ").map(str::trim);
    let first = sentences.next().unwrap_or_default().to_string();
    let more: Vec<&str> = sentences.filter(|more| more.starts_with("Default")).collect();
    let first = if first.is_empty() || first.ends_with(['.', ':', '?']) { first } else { first + "." };
    let text = format!("{first}{default} {}", more.join(" ")).trim().to_string();
    let text = text.replace('*', "\\*");
    // Within code nothing is escaped
    let mut parts: Vec<String> = text.split('`').map(String::from).collect();
    for code in parts.iter_mut().skip(1).step_by(2) {
        *code = code.replace("\\*", "*");
    }
    parts.join("`")
}

fn is_shown(arg: &&Arg) -> bool {
    !arg.is_hide_set() && !arg.is_global_set() && !["help", "version"].contains(&arg.get_id().as_str())
}

/// An option or argument as a list item.
fn option_item(arg: &Arg) -> (String, String) {
    let choices: Vec<String> = arg
        .get_possible_values()
        .iter()
        .filter(|value| !value.is_hide_set())
        .map(|v| v.get_name().into())
        .collect();
    let is_switch = matches!(arg.get_action(), ArgAction::SetTrue | ArgAction::SetFalse | ArgAction::Count);
    let mut value: Vec<String> =
        arg.get_value_names().unwrap_or_default().iter().map(ToString::to_string).collect();
    if !choices.is_empty() && arg.get_long().is_some() {
        // The default comes first
        let default = arg.get_default_values().first().map(|value| value.to_string_lossy().into_owned());
        let (mut first, rest): (Vec<String>, Vec<String>) =
            choices.iter().cloned().partition(|c| Some(c) == default.as_ref());
        first.extend(rest);
        value = vec![first.join("|")];
    }
    let mut name = arg.get_long().map_or_else(String::new, |long| format!("--{long}"));
    if !is_switch {
        name = format!("{name} {}", value.join(" ")).trim().to_string();
    }
    let mut text = sentence(&arg.get_help().map(ToString::to_string).unwrap_or_default());
    if !choices.is_empty() && arg.get_long().is_none() {
        let quoted: Vec<String> = choices.iter().map(|choice| format!("`{choice}`")).collect();
        text += &format!(" One of {}.", quoted.join(", "));
    }
    let defaults: Vec<String> =
        arg.get_default_values().iter().map(|v| v.to_string_lossy().into_owned()).collect();
    if !is_switch && !defaults.is_empty() && !text.contains("efault") {
        text += &format!(" Default {}.", defaults.join(" "));
    }
    (name, text)
}

/// A command below the program, by its words.
fn command<'a>(root: &'a Command, words: &str) -> &'a Command {
    let find = |at: &'a Command, word: &str| {
        at.find_subcommand(word).unwrap_or_else(|| panic!("no command {words}"))
    };
    words.split(' ').fold(root, find)
}

fn items_of(command: &Command) -> Vec<(String, String)> {
    command.get_arguments().filter(is_shown).map(option_item).collect()
}

/// Options that go together, by the word that stands for all of them.
const BUNDLES: [(&str, &[&str]); 5] = [
    ("changes", &["set", "unset"]),
    ("effort", &["spp", "seed", "depth", "error", "statistics"]),
    ("limits", &["max-memory", "max-disk", "time-limit"]),
    ("pbrt", &["unit", "strict", "light-spectra", "bands", "single-scattering"]),
    (
        "measured",
        &[
            "sample",
            "yield-unit",
            "photon-yield",
            "stokes",
            "allow-negative",
            "allow-anti-stokes",
            "empty-cells",
        ],
    ),
];

type Item = (String, String);

/// `--name` of an option in a list.
fn flag((name, _): &Item) -> &str {
    name.split(' ').next().unwrap()
}

/// What several commands have word for word and stand for in their lines by one word.
fn shared_options(shared: &BTreeSet<Item>) -> String {
    let mut list = String::new();
    let line = |(name, text): &Item| format!("- `{name}`: {text}\n");
    let is_of = |item: &Item, names: &[&str]| names.iter().any(|name| flag(item) == format!("--{name}"));
    for (bundle, names) in BUNDLES {
        list += &format!("`[{bundle}]`\n\n");
        for name in names {
            list.extend(shared.iter().filter(|item| is_of(item, &[name])).map(line));
        }
        list += "\n";
    }
    list
}

/// Commands with the names of their options, and their examples.
fn usage(root: &Command, names: &[String]) -> String {
    // Commands of one parent with the same words stand in one line
    let mut synopses: Vec<(&str, Vec<&str>, Vec<String>)> = Vec::new();
    let mut examples = String::new();
    for name in names {
        let command = command(root, name);
        let (parent, own) = name.rsplit_once(' ').unwrap_or(("", name));
        let words = synopsis(command);
        match synopses
            .last_mut()
            .filter(|(of, _, same)| *of == parent && !parent.is_empty() && *same == words)
        {
            Some((_, alike, _)) => alike.push(own),
            None => synopses.push((parent, vec![own], words)),
        }
        let shown = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        examples.extend(shown.lines().filter_map(|line| Some(format!("    {}\n", line.strip_prefix("  ")?))));
    }
    let mut lines = String::new();
    for (parent, names, words) in synopses {
        let mut line = format!("    fluorspar {}", format!("{parent} {}", names.join("|")).trim());
        for word in words {
            if line.len() + word.len() > 128 {
                lines += &format!("{line}\n");
                line = format!("        {word}");
            } else {
                line += &format!(" {word}");
            }
        }
        lines += &format!("{line}\n");
    }
    format!("{lines}\n{}\n\n{examples}", abouts(root, names).trim_end())
}

/// Arguments and options of a command with their defaults, in brackets what may be left out.
fn synopsis(command: &Command) -> Vec<String> {
    let mut words = Vec::new();
    let options: Vec<&str> = command.get_arguments().filter(is_shown).filter_map(Arg::get_long).collect();
    let bundles: Vec<_> =
        BUNDLES.iter().filter(|(_, names)| names.iter().all(|name| options.contains(name))).collect();
    let is_bundled = |name: &str| bundles.iter().any(|(_, names)| names.contains(&name));
    for arg in command.get_arguments().filter(is_shown) {
        if arg.get_long().is_some_and(is_bundled) {
            continue;
        }
        let (item, _) = option_item(arg);
        let default: Vec<_> =
            arg.get_default_values().iter().map(|v| v.to_string_lossy().into_owned()).collect();
        let is_told = arg.get_action().takes_values() && arg.get_possible_values().is_empty();
        let default =
            if is_told && !default.is_empty() { format!("={}", default.join(" ")) } else { String::new() };
        let is_many = matches!(arg.get_action(), ArgAction::Append)
            || arg.get_num_args().is_some_and(|number| number.max_values() > 9);
        let word = format!("{item}{default}{}", if is_many { "..." } else { "" });
        words.push(if arg.is_required_set() { word } else { format!("[{word}]") });
    }
    words.extend(bundles.iter().map(|(bundle, _)| format!("[{bundle}]")));
    words
}

/// What commands do, in a sentence each.
fn abouts(root: &Command, names: &[String]) -> String {
    let about = |name: &String| {
        sentence(&command(root, name).get_about().map(ToString::to_string).unwrap_or_default())
    };
    let own = |name: &String| name.split_once(' ').map_or(name.clone(), |(_, own)| own.to_string());
    match names {
        [name] => about(name),
        _ => names.iter().map(|name| format!("- `{}`: {}\n", own(name), about(name))).collect(),
    }
}

/// What the options of some commands mean that no other command has.
fn options(root: &Command, names: &[String], shared: &BTreeSet<Item>) -> String {
    let commands: Vec<&Command> = names.iter().map(|name| command(root, name)).collect();
    let (mut list, mut said) = (String::new(), BTreeSet::new());
    for item in commands.iter().flat_map(|command| items_of(command)) {
        if shared.contains(&item) || !said.insert(item.clone()) {
            continue;
        }
        let having = names.iter().zip(&commands).filter(|(_, command)| items_of(command).contains(&item));
        let having: Vec<&str> = having.map(|(name, _)| name.rsplit(' ').next().unwrap()).collect();
        let of =
            if having.len() == names.len() { String::new() } else { format!(" ({})", having.join(", ")) };
        list += &format!("- `{}`{of}: {}\n", item.0, item.1);
    }
    list
}

/// Names of all commands that do something.
fn leaves(command: &Command, name: &str) -> Vec<String> {
    let below: Vec<&Command> =
        command.get_subcommands().filter(|sub| !sub.is_hide_set() && sub.get_name() != "help").collect();
    if below.is_empty() {
        return vec![name.to_string()];
    }
    below.iter().flat_map(|sub| leaves(sub, format!("{name} {}", sub.get_name()).trim())).collect()
}

/// Definitions of all schemas by name.
fn definitions() -> Map<String, Value> {
    let mut all = Map::new();
    for (name, schema) in [
        ("ExperimentFile", json_schema()),
        ("SampleFile", json_schema_of::<SampleFile>()),
        ("LayersFile", json_schema_of::<LayersFile>()),
        ("DesignFile", design_json_schema()),
        ("CohortFile", json_schema_of::<CohortFile>()),
    ] {
        let mut schema = schema.as_object().unwrap().clone();
        if let Some(Value::Object(definitions)) = schema.remove("$defs") {
            all.extend(definitions);
        }
        all.insert(name.into(), schema.into());
    }
    all
}

fn text_of(schema: &Value) -> String {
    let text = schema.get("description").and_then(Value::as_str).unwrap_or_default();
    text.split("\n\n").next().unwrap_or_default().to_string()
}

/// A field as a list item: its text, what of constants it may be, its default.
fn field_text(all: &Map<String, Value>, schema: &Value) -> String {
    let mut text = sentence(&text_of(schema)).replace(" Default: none.", "");
    let target = target(all, schema);
    let constants: Vec<String> = target
        .get("oneOf")
        .or(target.get("anyOf"))
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
        .filter_map(|choice| choice.get("const")?.as_str().map(|word| format!("`\"{word}\"`")))
        .collect();
    if constants.len() > 1 && !constants.iter().all(|word| text.contains(word.trim_matches(['`', '"']))) {
        text += &format!(" One of {}.", constants.join(", "));
    }
    let default = schema.get("default").filter(|value| !value.is_null() && !value.is_object());
    let default = default.filter(|value| value.as_array().is_none_or(|list| !list.is_empty()));
    if let Some(default) = default.filter(|_| !text.contains("efault")) {
        text += &format!(" Default {}.", default.to_string().trim_end_matches(".0"));
    }
    text
}

/// Sections by the prefix of their fields.
fn sections<'a>(all: &'a Map<String, Value>, list: &'a [String]) -> Vec<(&'a str, &'a Value)> {
    let section = |entry: &'a String| {
        let (prefix, name) = entry.split_once('=').unwrap_or(("", entry));
        (prefix, all.get(name).unwrap_or_else(|| panic!("no section {name}")))
    };
    list.iter().map(section).collect()
}

/// Names of the fields of sections, by type where there are types, each with its default where that is a value.
fn names_and_defaults(all: &Map<String, Value>, list: &[String]) -> String {
    let names = |schema: &Value| -> Vec<String> {
        let fields =
            target(all, schema).get("properties").and_then(Value::as_object).cloned().unwrap_or_default();
        let name = |(name, field): (&String, &Value)| {
            let said =
                text_of(field).split_once("Default ").map(|(_, said)| said.trim_end_matches('.').to_string());
            let default = field
                .get("default")
                .filter(|value| !value.is_array() && !value.is_object() && !value.is_null());
            let said = said.filter(|said| !said.contains('('));
            let default = said.or(default.map(|value| value.to_string().trim_end_matches(".0").to_string()));
            format!("`{name}`{}", default.map_or_else(String::new, |default| format!(" ({default})")))
        };
        fields.iter().filter(|(_, field)| field.get("const").is_none()).map(name).collect()
    };
    let mut text = String::new();
    for (prefix, section) in sections(all, list) {
        let variants = section.get("oneOf").and_then(Value::as_array);
        for variant in variants.into_iter().flatten() {
            let Some(kind) = variant.pointer("/properties/type/const").and_then(Value::as_str) else {
                continue;
            };
            let of = names(variant).join(", ");
            text += &format!(
                "- `{prefix}{}type = \"{kind}\"`{}\n",
                if prefix.is_empty() { "" } else { "." },
                if of.is_empty() { of } else { format!(": {of}") }
            );
        }
        let own = names(section);
        if !own.is_empty() {
            let lead = if prefix.is_empty() { String::new() } else { format!("`{prefix}`: ") };
            text += &format!("- {lead}{}\n", own.join(", "));
        }
    }
    text
}

/// Fields of sections, each with the variants that have it. `said` holds what the page has said before.
fn fields(all: &Map<String, Value>, list: &[String], said: &mut BTreeSet<Item>) -> String {
    let text = |(prefix, section): (&str, &Value)| {
        let prefix = if prefix.is_empty() { String::new() } else { format!("{prefix}.") };
        section_fields(all, &prefix, section, said)
    };
    sections(all, list).into_iter().map(text).collect()
}

/// The definition that a schema refers to, also beside null, or the schema itself.
fn target<'a>(all: &'a Map<String, Value>, schema: &'a Value) -> &'a Value {
    let path = schema.get("$ref").or_else(|| schema.pointer("/anyOf/0/$ref")).and_then(Value::as_str);
    path.and_then(|path| all.get(path.rsplit('/').next()?)).unwrap_or(schema)
}

fn section_fields(
    all: &Map<String, Value>,
    prefix: &str,
    section: &Value,
    said: &mut BTreeSet<Item>,
) -> String {
    let properties = |schema: &Value| -> Vec<(String, String)> {
        let found =
            target(all, schema).get("properties").and_then(Value::as_object).cloned().unwrap_or_default();
        let fields = found.iter().filter(|(_, schema)| schema.get("const").is_none());
        fields.map(|(name, schema)| (name.clone(), field_text(all, schema))).collect()
    };
    let variants: Vec<&Value> = section
        .get("oneOf")
        .or(section.get("anyOf"))
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
        .collect();
    let type_of = |variant: &Value| Some(variant.pointer("/properties/type/const")?.as_str()?.to_string());
    let types: Vec<String> = variants.iter().filter_map(|variant| type_of(variant)).collect();
    // Names of fields by what is said of them and by the variants that have them
    let mut found: Vec<(Vec<String>, String, Vec<String>)> = Vec::new();
    for (field, text) in properties(section) {
        found.push((vec![field], text, Vec::new()));
    }
    for variant in &variants {
        for (field, text) in properties(variant) {
            match found.iter_mut().find(|(names, other, _)| names[0] == field && *other == text) {
                Some((_, _, having)) => having.extend(type_of(variant)),
                None => found.push((vec![field], text, type_of(variant).into_iter().collect())),
            }
        }
    }
    let mut list = String::new();
    if !types.is_empty() {
        let meaning = |(name, variant): (&String, &&Value)| {
            format!("`\"{name}\"` {}", lowercase_first(sentence(&text_of(variant)).trim_end_matches('.')))
        };
        list += &format!(
            "- `{prefix}type`: {}.\n",
            types.iter().zip(&variants).map(meaning).collect::<Vec<_>>().join("; ")
        );
    }
    let mut items: Vec<(Vec<String>, String, Vec<String>)> = Vec::new();
    for (names, text, having) in found {
        let is_new = said.insert((names[0].clone(), text.clone()));
        let text = if is_new { text } else { "As above.".into() };
        match items.iter_mut().find(|(_, other, of)| *other == text && *of == having) {
            Some((known, _, _)) => known.extend(names),
            None => items.push((names, text, having)),
        }
    }
    for (names, text, having) in items {
        let of = if having.is_empty() || having.len() == types.len() {
            String::new()
        } else {
            format!(" ({})", having.join(", "))
        };
        let names: Vec<String> = names.iter().map(|name| format!("`{prefix}{name}`")).collect();
        list += &format!("- {}{of}: {text}\n", names.join(", "));
    }
    list
}

/// A text with a small first letter, where it begins with a word and no name.
fn lowercase_first(text: &str) -> String {
    let mut letters = text.chars();
    let (first, second) = (letters.next(), letters.clone().next());
    match first {
        Some(first) if second.is_none_or(|c| !c.is_uppercase()) => {
            first.to_lowercase().chain(letters).collect()
        }
        _ => text.to_string(),
    }
}

#[test]
fn the_documents_have_the_options_and_fields_of_the_program() {
    let mut root = Args::grouped();
    root.build();
    let all = definitions();
    let texts: BTreeMap<PathBuf, String> =
        pages().into_iter().map(|page| (page.clone(), fs::read_to_string(page).unwrap())).collect();
    let markers: Vec<Marker> = texts.values().flat_map(|text| text.lines().filter_map(marker)).collect();
    let groups: Vec<&Vec<String>> =
        markers.iter().filter(|(kind, _)| kind == "usage").map(|(_, list)| list).collect();

    // What several groups of commands have word for word is said once
    let mut times: BTreeMap<Item, usize> = BTreeMap::new();
    for group in &groups {
        let items: BTreeSet<_> = group.iter().flat_map(|name| items_of(command(&root, name))).collect();
        for item in items.into_iter().filter(|(name, _)| name.starts_with("--")) {
            *times.entry(item).or_default() += 1;
        }
    }
    let shared: BTreeSet<_> =
        times.into_iter().filter(|(_, times)| *times > 1).map(|(item, _)| item).collect();
    let mut named: Vec<String> = groups.into_iter().flatten().cloned().collect();
    let mut commands = leaves(&root, "");
    named.sort();
    commands.sort();
    assert_eq!(named, commands, "commands in docs/commands.md");

    let mut stale = Vec::new();
    for (page, text) in &texts {
        let mut said = BTreeSet::new();
        let now = renewed(text, |(kind, list)| match kind.as_str() {
            "usage" => usage(&root, list),
            "options" if list == &["shared"] => shared_options(&shared),
            "options" => options(&root, list, &shared),
            "defaults" => names_and_defaults(&all, list),
            _ => fields(&all, list, &mut said),
        });
        if now != *text {
            stale.push(page.display().to_string());
            if std::env::var_os("FLUORSPAR_WRITE_DOCUMENTS").is_some() {
                fs::write(page, now).unwrap();
            }
        }
    }
    assert!(stale.is_empty(), "run this test with FLUORSPAR_WRITE_DOCUMENTS=1: {stale:#?}");
}

/// All sections of a schema, by name: definitions, and their variants under the same name.
fn every_section(all: &Map<String, Value>) -> Vec<(&str, &Value)> {
    let mut found: Vec<(&str, &Value)> = Vec::new();
    for (name, section) in all {
        let variants =
            [section.get("oneOf"), section.get("anyOf")].into_iter().flatten().filter_map(Value::as_array);
        let variants = variants.flatten().filter(|variant| variant.get("properties").is_some());
        found.extend(variants.map(|variant| (name.as_str(), variant)));
        if section.get("properties").is_some() {
            found.push((name, section));
        }
    }
    found
}

#[test]
fn every_section_of_an_experiment_is_in_the_documents() {
    let all = definitions();
    let mut named: BTreeSet<String> = BTreeSet::new();
    for page in pages() {
        let text = fs::read_to_string(page).unwrap();
        let lists = text
            .lines()
            .filter_map(marker)
            .filter(|(kind, _)| ["fields", "defaults"].contains(&kind.as_str()));
        named.extend(
            lists.flat_map(|(_, list)| list).map(|entry| entry.rsplit('=').next().unwrap().to_string()),
        );
    }
    // Of a choice its variants
    let choices: Vec<&Value> = named.iter().filter_map(|name| all.get(name)?.get("anyOf")).collect();
    let variants = choices.into_iter().filter_map(Value::as_array).flatten();
    let variants =
        variants.filter_map(|variant| variant.get("$ref")?.as_str()?.rsplit('/').next().map(String::from));
    named.extend(variants.collect::<Vec<_>>());
    let schema = json_schema();
    let of_experiments = schema.get("$defs").and_then(Value::as_object).unwrap();
    let mut left: BTreeSet<&str> = every_section(of_experiments).into_iter().map(|(name, _)| name).collect();
    left.retain(|name| !named.contains(*name));
    // What tells of quantum efficiencies has the two fields of the first, the last is part of others
    assert_eq!(Vec::from_iter(left), ["EfficiencyColumns", "OutputSection", "SensorRegionSection"]);
}

/// What a text states as the default, where that is a value.
fn stated_default(text: &str) -> Option<Value> {
    let said = text.split_once("Default ").or_else(|| text.split_once("(default "))?.1.replace(" 000", "000");
    let end = match said.chars().next()? {
        '"' => said[1..].find('"')? + 2,
        '[' => said.find(']')? + 1,
        _ => said.find([' ', ',', ';', ')']).unwrap_or(said.len()),
    };
    serde_json::from_str(said[..end].trim_end_matches('.')).ok()
}

#[test]
fn texts_of_fields_state_their_defaults() {
    // A list of one may be said as its entry
    let as_numbers = |value: &Value| -> Vec<Value> {
        let items = value.as_array().cloned().unwrap_or_else(|| vec![value.clone()]);
        items.iter().map(|item| item.as_f64().map_or(item.clone(), Value::from)).collect()
    };
    let (all, mut checked) = (definitions(), 0);
    for (name, section) in every_section(&all) {
        for (field, schema) in section["properties"].as_object().unwrap() {
            let text = text_of(schema).replace('\n', " ");
            let (Some(said), Some(default)) =
                (stated_default(&text), schema.get("default").filter(|value| !value.is_object()))
            else {
                continue;
            };
            assert_eq!(as_numbers(&said), as_numbers(default), "{name}.{field}: {text}");
            checked += 1;
        }
    }
    assert!(checked > 150, "{checked}");
}
