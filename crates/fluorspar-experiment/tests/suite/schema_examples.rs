//! Fields of files that no experiment of the catalogue, no example and no template shows: nobody learns of them by looking.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use fluorspar_experiment::{DesignFile, SampleFile, SensorFile, json_schema, json_schema_of};
use serde_json::Value;

/// Fields without an example, at most. A new field comes with one; an example more lowers it.
const MOST_UNSHOWN: usize = 136;

/// Names of all properties of a schema.
fn fields(schema: &Value, found: &mut BTreeSet<String>) {
    match schema {
        Value::Object(entries) => {
            if let Some(Value::Object(properties)) = entries.get("properties") {
                found.extend(properties.keys().cloned());
            }
            entries.values().for_each(|inner| fields(inner, found));
        }
        Value::Array(items) => items.iter().for_each(|inner| fields(inner, found)),
        _ => {}
    }
}

fn keys_of_files(folder: &Path, found: &mut BTreeSet<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            keys_of_files(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "toml") {
            keys(&fs::read_to_string(path).unwrap().parse::<toml::Table>().unwrap().into(), found);
        }
    }
}

fn keys(value: &toml::Value, found: &mut BTreeSet<String>) {
    match value {
        toml::Value::Table(table) => {
            found.extend(table.keys().cloned());
            table.values().for_each(|inner| keys(inner, found));
        }
        toml::Value::Array(items) => items.iter().for_each(|inner| keys(inner, found)),
        _ => {}
    }
}

#[test]
fn most_fields_have_an_example() {
    let (mut known, mut shown) = (BTreeSet::new(), BTreeSet::new());
    for schema in [
        json_schema(),
        json_schema_of::<SampleFile>(),
        json_schema_of::<SensorFile>(),
        json_schema_of::<DesignFile>(),
    ] {
        fields(&schema, &mut known);
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    for folder in ["examples", "crates/fluorspar-experiment/data", "crates/fluorspar-cli/templates"] {
        keys_of_files(&root.join(folder), &mut shown);
    }
    let unshown: Vec<&String> = known.difference(&shown).collect();
    assert!(known.len() > 300, "{} fields", known.len());
    assert!(
        unshown.len() <= MOST_UNSHOWN,
        "{} of {} fields have no example: {unshown:?}",
        unshown.len(),
        known.len()
    );
}
