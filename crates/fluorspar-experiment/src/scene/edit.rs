//! Changes written into the text of an experiment file: its comments and its order stay.

use std::path::Path;

use toml_edit::{Array, ArrayOfTables, DocumentMut, Item, Table, TableLike, Value};

use crate::change::scene_change::SceneChange;
use crate::document::shape::{Schema, Shape};
use crate::document::tree::{Content, Document, Node, TextSource};
use crate::error::{ExperimentError, Step, step_text};
use crate::read::{change_document, experiment_schema, parse, read_merged};
use crate::resolve::check_settings;
use fluorspar_format::read_toml_document;

/// The text of an experiment file after some changes. Everything that they do not touch stays as it was typed. Files of base
/// experiments stay too: what they say is overridden, or removed by `remove = true`.
///
/// # Errors
/// The first defect found: of the text, of a change, of what it leads to; a change that can't be written on top of a base.
pub fn edit_experiment(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    changes: &[SceneChange],
) -> Result<String, ExperimentError> {
    let schema = experiment_schema();
    let source = TextSource { name: source_name.into(), overriding: None, folder: None };
    let mut edited = editable(text, &source)?;
    let mut document = read_merged(schema, text, source_name, base_dir)?;
    let before = document.root.clone();
    change_document(&mut document, schema, changes, base_dir)?;
    Writer { schema }.table(edited.as_table_mut(), Some(schema.root()), &before, &document.root);
    remove_from_bases(&mut edited, schema, source_name, base_dir, &document)?;
    let edited = edited.to_string();
    check_same(schema, &edited, source_name, base_dir, &document)?;
    // A scene that is not whole yet may be built step by step
    let was_sound =
        parse(text, source_name, base_dir, &[]).is_ok_and(|before| check_settings(&before).is_ok());
    let now = parse(&edited, source_name, base_dir, &[])?;
    if was_sound { check_settings(&now).map(|()| edited) } else { Ok(edited) }
}

/// The text as a document that keeps what was typed.
fn editable(text: &str, source: &TextSource) -> Result<DocumentMut, ExperimentError> {
    read_toml_document(text).map_err(|error| {
        let invalid = source.error(format!("invalid TOML: {}", error.message().trim()));
        match error.line() {
            Some(line) => invalid.at_line(line),
            None => invalid,
        }
    })
}

/// What comes from a base and is no longer wanted: entries get `remove = true`, fields and sections go to `unset`.
fn remove_from_bases(
    edited: &mut DocumentMut,
    schema: &Schema,
    source_name: &str,
    base_dir: &Path,
    wanted: &Document,
) -> Result<(), ExperimentError> {
    if edited.get("base").is_none() {
        return Ok(());
    }
    let now = read_merged(schema, &edited.to_string(), source_name, base_dir)?;
    let mut gone = Vec::new();
    surplus_entries(&now.root, &wanted.root, &mut Vec::new(), &mut gone);
    for (list, name) in gone {
        let mut entry = Table::new();
        entry.insert("name", Item::Value(name.into()));
        entry.insert("remove", Item::Value(true.into()));
        append(edited.as_table_mut(), &list, entry);
    }
    let mut gone = Vec::new();
    surplus_fields(&now.root, &wanted.root, &mut Vec::new(), &mut gone);
    if !gone.is_empty() {
        unset(edited, gone);
    }
    Ok(())
}

/// Adds fields to the list `unset`, those that it lacks.
fn unset(edited: &mut DocumentMut, gone: Vec<String>) {
    let list = edited.entry("unset").or_insert_with(|| Item::Value(Value::Array(Array::new())));
    let Some(list) = list.as_array_mut() else { return };
    for path in gone {
        if !list.iter().any(|known| known.as_str() == Some(&path)) {
            list.push(path);
        }
    }
}

/// Paths of fields and sections of a tree that another tree lacks; entries of lists are matched by their names.
fn surplus_fields(now: &Node, wanted: &Node, path: &mut Vec<String>, found: &mut Vec<String>) {
    let Content::Table(entries) = &now.content else { return };
    for (key, inner) in entries {
        path.push(step_text(key));
        match (wanted.get(key), &inner.content) {
            (None, _) => found.push(path.join(".")),
            (Some(other), Content::Array(items)) => {
                for item in items {
                    let Some(name) = item.name() else { continue };
                    let Content::Array(others) = &other.content else { continue };
                    if let Some(other) = others.iter().find(|other| other.name() == Some(name)) {
                        path.push(step_text(name));
                        surplus_fields(item, other, path, found);
                        path.pop();
                    }
                }
            }
            (Some(other), _) => surplus_fields(inner, other, path, found),
        }
        path.pop();
    }
}

/// Named entries of the lists that two trees have, which the second one lacks: the list, and the name.
fn surplus_entries(
    now: &Node,
    wanted: &Node,
    path: &mut Vec<String>,
    found: &mut Vec<(Vec<String>, String)>,
) {
    match &now.content {
        Content::Table(entries) => {
            for (key, inner) in entries {
                // A list that goes as a whole is a field that goes.
                let Some(wanted) = wanted.get(key) else { continue };
                path.push(key.clone());
                surplus_entries(inner, wanted, path, found);
                path.pop();
            }
        }
        Content::Array(items) => {
            let names = items.iter().filter_map(Node::name);
            let is_wanted = |name: &str| match &wanted.content {
                Content::Array(items) => items.iter().any(|item| item.name() == Some(name)),
                _ => false,
            };
            found.extend(names.filter(|name| !is_wanted(name)).map(|name| (path.clone(), name.to_string())));
        }
        Content::Leaf(_) => {}
    }
}

/// Refuses a text that does not say what the changes wanted, with the place where it differs.
fn check_same(
    schema: &Schema,
    text: &str,
    source_name: &str,
    base_dir: &Path,
    wanted: &Document,
) -> Result<(), ExperimentError> {
    let now = read_merged(schema, text, source_name, base_dir)?;
    let Some(place) = first_difference(&now.root, &wanted.root, &mut Vec::new()) else { return Ok(()) };
    let message = "this comes from the base of the file and can't be taken back on top of it; change the base, or give \
                   another value";
    Err(wanted.error(&place, message).without_value())
}

fn first_difference(now: &Node, wanted: &Node, path: &mut Vec<Step>) -> Option<Vec<Step>> {
    let is_same = match (&now.content, &wanted.content) {
        (Content::Table(a), Content::Table(b)) => {
            for (key, inner) in a {
                path.push(Step::from(key));
                let found = match wanted.get(key) {
                    Some(other) => first_difference(inner, other, path),
                    None => Some(path.clone()),
                };
                if found.is_some() {
                    return found;
                }
                path.pop();
            }
            b.iter().all(|(key, _)| now.get(key).is_some())
        }
        (Content::Array(a), Content::Array(b)) if a.len() == b.len() => {
            for (number, (inner, other)) in a.iter().zip(b).enumerate() {
                path.push(Step::from(number));
                if let Some(found) = first_difference(inner, other, path) {
                    return Some(found);
                }
                path.pop();
            }
            true
        }
        (a, b) => a == b,
    };
    (!is_same).then(|| path.clone())
}

/// Writes into a text what a tree says otherwise than before. What only bases say stays there.
struct Writer<'a> {
    schema: &'a Schema,
}

impl Writer<'_> {
    fn table(&self, text: &mut dyn TableLike, shape: Option<&Shape>, before: &Node, after: &Node) {
        let Content::Table(fields) = &after.content else { return };
        let is_gone = |key: &str| after.get(key).is_none() && !["base", "remove", "unset"].contains(&key);
        let gone: Vec<String> =
            text.iter().map(|(key, _)| key.to_string()).filter(|key| is_gone(key)).collect();
        for key in gone {
            text.remove(&key);
        }
        let table = shape.and_then(|shape| self.schema.table(shape));
        for (key, value) in fields {
            let shape = table.and_then(|table| table.shape(table.variant_or_default(after), key));
            let is_whole = shape.is_some_and(|shape| self.schema.is_whole(shape));
            let old = before.get(key);
            match (&value.content, old.map(|old| &old.content)) {
                (_, Some(_))
                    if old.is_some_and(|old| first_difference(old, value, &mut Vec::new()).is_none()) => {}
                (Content::Table(_), Some(Content::Table(_))) if !is_whole => {
                    if !text.get(key).is_some_and(Item::is_table_like) {
                        let mut new = Table::new();
                        new.set_dotted(true);
                        text.insert(key, Item::Table(new));
                    }
                    let inner = text.get_mut(key).and_then(Item::as_table_like_mut);
                    inner.into_iter().for_each(|inner| self.table(inner, shape, old.unwrap_or(value), value));
                }
                (Content::Array(entries), old) if is_list_of_entries(entries) => {
                    let old = match old {
                        Some(Content::Array(old)) => old.as_slice(),
                        _ => &[],
                    };
                    self.entries(text, key, shape.and_then(|shape| self.schema.items(shape)), old, entries);
                }
                (Content::Table(inner), None) if inner.len() == 1 => {
                    let mut new = table_of(value);
                    new.set_dotted(true);
                    text.insert(key, Item::Table(new));
                }
                _ => put_value(text, key, &value.to_value()),
            }
        }
    }

    /// Entries of a list, which have names: the numbers of texts and merged trees differ.
    fn entries(
        &self,
        text: &mut dyn TableLike,
        key: &str,
        shape: Option<&Shape>,
        before: &[Node],
        after: &[Node],
    ) {
        for entry in after {
            let old = before.iter().find(|old| old.name() == entry.name());
            if old.is_some_and(|old| first_difference(old, entry, &mut Vec::new()).is_none()) {
                continue;
            }
            match (old, entry_of(text, key, entry.name())) {
                (Some(old), Some(found)) => self.table(found, shape, old, entry),
                (Some(old), None) => {
                    let mut new = Table::new();
                    new.insert("name", Item::Value(entry.name().unwrap_or_default().into()));
                    self.table(&mut new, shape, old, entry);
                    // What is gone alone is left to `unset`
                    if new.len() > 1 {
                        append(text, &[key.to_owned()], new);
                    }
                }
                (None, _) => append(text, &[key.to_owned()], table_of(entry)),
            }
        }
        let is_gone = |table: &dyn TableLike| {
            let name = table.get("name").and_then(Item::as_str);
            !after.iter().any(|entry| entry.name() == name)
        };
        match text.get_mut(key) {
            Some(Item::ArrayOfTables(tables)) => tables.retain(|table| !is_gone(table)),
            Some(Item::Value(Value::Array(items))) => {
                items.retain(|item| !item.as_inline_table().is_some_and(|table| is_gone(table)));
            }
            _ => {}
        }
    }
}

/// Whether a list holds entries with names.
fn is_list_of_entries(items: &[Node]) -> bool {
    !items.is_empty() && items.iter().all(|item| item.name().is_some())
}

/// The entry of a list of a text that has a name.
fn entry_of<'t>(text: &'t mut dyn TableLike, key: &str, name: Option<&str>) -> Option<&'t mut dyn TableLike> {
    let has_name = |table: &dyn TableLike| table.get("name").and_then(Item::as_str) == name;
    match text.get_mut(key)? {
        Item::ArrayOfTables(tables) => {
            tables.iter_mut().find(|table| has_name(*table)).map(|table| table as &mut dyn TableLike)
        }
        Item::Value(Value::Array(items)) => {
            let tables = items.iter_mut().filter_map(Value::as_inline_table_mut);
            tables.into_iter().find(|table| has_name(*table)).map(|table| table as &mut dyn TableLike)
        }
        _ => None,
    }
}

/// Sets a key; the comment behind an old value stays.
fn put_value(table: &mut dyn TableLike, key: &str, value: &toml::Value) {
    let mut new = as_value(value);
    match table.get_mut(key) {
        Some(Item::Value(old)) => {
            *new.decor_mut() = old.decor().clone();
            *old = new;
        }
        Some(other) => *other = Item::Value(new),
        None => {
            table.insert(key, Item::Value(new));
        }
    }
}

/// A value as it is written in a line.
fn as_value(value: &toml::Value) -> Value {
    match value {
        toml::Value::String(text) => text.as_str().into(),
        toml::Value::Integer(number) => (*number).into(),
        toml::Value::Float(number) => float(*number),
        toml::Value::Boolean(flag) => (*flag).into(),
        toml::Value::Datetime(datetime) => datetime.to_string().into(),
        toml::Value::Array(items) => Value::Array(items.iter().map(as_value).collect::<Array>()),
        toml::Value::Table(fields) => {
            Value::InlineTable(fields.iter().map(|(key, value)| (key.as_str(), as_value(value))).collect())
        }
    }
}

/// A number as it would be typed: large and small ones with an exponent.
fn float(number: f64) -> Value {
    let text = fluorspar::units::number_text(number);
    match text.parse::<Value>() {
        Ok(value) if value.as_float() == Some(number) => value,
        _ => number.into(),
    }
}

/// An entry as a section of its own.
fn table_of(entry: &Node) -> Table {
    let mut table = Table::new();
    if let toml::Value::Table(fields) = entry.to_value() {
        for (key, value) in &fields {
            table.insert(key, Item::Value(as_value(value)));
        }
    }
    table
}

/// Adds an entry at the end of a list, in place of one of the same name.
fn append(table: &mut dyn TableLike, list: &[String], entry: Table) {
    let Some((key, rest)) = list.split_first() else { return };
    if !rest.is_empty() {
        if table.get(key).is_none_or(|item| !item.is_table_like()) {
            let mut around = Table::new();
            around.set_implicit(true);
            table.insert(key, Item::Table(around));
        }
        if let Some(inner) = table.get_mut(key).and_then(Item::as_table_like_mut) {
            append(inner, rest, entry);
        }
        return;
    }
    if let Some(Item::Value(Value::Array(items))) = table.get_mut(key)
        && !items.is_empty()
    {
        items.push(Value::InlineTable(entry.into_inline_table()));
        return;
    }
    if table.get(key).is_none_or(|item| !item.is_array_of_tables()) {
        table.remove(key);
        table.insert(key, Item::ArrayOfTables(ArrayOfTables::new()));
    }
    if let Some(tables) = table.get_mut(key).and_then(Item::as_array_of_tables_mut) {
        let name = |table: &Table| table.get("name").and_then(Item::as_str).map(String::from);
        let wanted = name(&entry);
        tables.retain(|other| wanted.is_none() || name(other) != wanted);
        tables.push(entry);
    }
}
