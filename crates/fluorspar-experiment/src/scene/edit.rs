//! Changes written into the text of an experiment file: its comments and its order stay.

use std::path::Path;

use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value};

use crate::change::scene_change::{Edit, SceneChange};
use crate::document::shape::Schema;
use crate::document::tree::{Content, Document, Node, TextSource};
use crate::error::{ExperimentError, Step, step_text};
use crate::read::{change_document, experiment_schema, parse, read_merged};
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
    for change in changes {
        let before = document.clone();
        let edits = change_document(&mut document, schema, std::slice::from_ref(change), base_dir)?;
        for edit in edits.iter().flatten() {
            let writer = Writer { before: &before.root, after: &document.root };
            writer
                .write(edited.as_table_mut(), edit)
                .map_err(|problem| source.error(format!("{change}: {problem}")))?;
        }
        remove_from_bases(&mut edited, schema, source_name, base_dir, &document)?;
    }
    let text = edited.to_string();
    check_same(schema, &text, source_name, base_dir, &document)?;
    parse(&text, source_name, base_dir, &[])?;
    Ok(text)
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

/// Writes edits into a text.
struct Writer<'a> {
    /// What the text and its bases said, and say after the edit.
    before: &'a Node,
    after: &'a Node,
}

impl Writer<'_> {
    fn write(&self, root: &mut dyn TableLike, edit: &Edit) -> Result<(), String> {
        match edit {
            Edit::Put { path, value } => put(root, self.after, path, &value.to_value()),
            Edit::Append { list, entry } => {
                let names: Vec<String> = list
                    .iter()
                    .filter_map(|step| match step {
                        Step::Key(key) => Some(key.clone()),
                        Step::Index(_) => None,
                    })
                    .collect();
                if names.len() != list.len() {
                    return Err("only lists of whole sections can be added to".into());
                }
                append(root, &names, table_of(entry));
                Ok(())
            }
            Edit::Remove { path } => {
                remove(root, self.before, path);
                Ok(())
            }
        }
    }
}

/// Puts a value at a place; `after` is the tree that the text is to say.
fn put(table: &mut dyn TableLike, after: &Node, path: &[Step], value: &toml::Value) -> Result<(), String> {
    let Some((Step::Key(key), rest)) = path.split_first() else { return Ok(()) };
    // Fields that the value takes the place of
    let gone: Vec<String> =
        table.iter().map(|(key, _)| key.to_string()).filter(|key| is_gone(after, key)).collect();
    for key in gone {
        table.remove(&key);
    }
    let Some(inner) = after.get(key) else { return Ok(()) };
    if rest.is_empty() {
        put_value(table, key, value);
        return Ok(());
    }
    if !is_container(table.get(key), rest) {
        table.remove(key);
        let new = container(rest, table.is_dotted());
        table.insert(key, new);
    }
    let Some(item) = table.get_mut(key) else { return Ok(()) };
    match rest.split_first() {
        Some((Step::Index(index), rest)) => put_in_list(item, inner, *index, rest, value),
        _ => match item.as_table_like_mut() {
            Some(table) => put(table, inner, rest, value),
            None => Ok(()),
        },
    }
}

/// Whether a key of a text is not wanted any more. What only texts say, and no merged tree, stays.
fn is_gone(after: &Node, key: &str) -> bool {
    after.get(key).is_none() && !["base", "remove", "unset"].contains(&key)
}

fn is_container(item: Option<&Item>, rest: &[Step]) -> bool {
    match (item, rest.first()) {
        (Some(item), Some(Step::Index(_))) => item.is_array_of_tables() || item.is_array(),
        (Some(item), _) => item.is_table_like(),
        (None, _) => false,
    }
}

/// What holds the rest of a path.
fn container(rest: &[Step], is_within_dots: bool) -> Item {
    match rest.first() {
        Some(Step::Index(_)) => Item::ArrayOfTables(ArrayOfTables::new()),
        _ => {
            let mut table = Table::new();
            table.set_dotted(is_within_dots || rest.len() == 1);
            Item::Table(table)
        }
    }
}

/// Puts a value into an entry of a list, which it finds by its name: the numbers of texts and merged trees differ.
fn put_in_list(
    item: &mut Item,
    list: &Node,
    index: usize,
    rest: &[Step],
    value: &toml::Value,
) -> Result<(), String> {
    let Some(entry) = list.step(&Step::Index(index)) else { return Ok(()) };
    let name = entry.name();
    let has_name = |table: &dyn TableLike| name.is_some() && table.get("name").and_then(Item::as_str) == name;
    match item {
        Item::ArrayOfTables(tables) => {
            let found = match name {
                Some(_) => tables.iter().position(|table| has_name(table)),
                None => Some(index),
            };
            if found.is_none() {
                let mut table = Table::new();
                table.insert("name", Item::Value(name.unwrap_or_default().into()));
                tables.push(table);
            }
            let number = found.unwrap_or(tables.len() - 1);
            let table = tables.get_mut(number).ok_or_else(not_in_the_file)?;
            put_in_entry(table, entry, rest, value)
        }
        Item::Value(Value::Array(items)) => {
            let found = match name {
                Some(_) => items.iter().position(|item| item.as_inline_table().is_some_and(|t| has_name(t))),
                None => Some(index),
            };
            if rest.is_empty() {
                let place = items.get_mut(found.ok_or_else(not_in_the_file)?).ok_or_else(not_in_the_file)?;
                *place = as_value(value);
                return Ok(());
            }
            if found.is_none() {
                let mut table = InlineTable::new();
                table.insert("name", name.unwrap_or_default().into());
                items.push(Value::InlineTable(table));
            }
            let number = found.unwrap_or(items.len() - 1);
            let table = items.get_mut(number).and_then(Value::as_inline_table_mut);
            put_in_entry(table.ok_or_else(not_in_the_file)?, entry, rest, value)
        }
        _ => Err(not_in_the_file()),
    }
}

fn not_in_the_file() -> String {
    "the list comes from the base of the file; set the whole list".into()
}

fn put_in_entry(
    table: &mut dyn TableLike,
    entry: &Node,
    rest: &[Step],
    value: &toml::Value,
) -> Result<(), String> {
    if !rest.is_empty() {
        return put(table, entry, rest, value);
    }
    // The whole entry: what it has no more goes, the rest is set.
    let toml::Value::Table(fields) = value else {
        return Err("an entry of this list is a table; write { field = value, ... }".into());
    };
    let gone: Vec<String> =
        table.iter().map(|(key, _)| key.to_string()).filter(|k| !fields.contains_key(k)).collect();
    for key in gone {
        table.remove(&key);
    }
    for (key, value) in fields {
        put_value(table, key, value);
    }
    Ok(())
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

/// Removes what a text says at a place, if it says something there.
fn remove(table: &mut dyn TableLike, before: &Node, path: &[Step]) {
    match path {
        [Step::Key(key)] => {
            table.remove(key);
        }
        [Step::Key(key), Step::Index(index), rest @ ..] => {
            let list = before.get(key);
            let entry = list.and_then(|list| list.step(&Step::Index(*index)));
            let name = entry.and_then(Node::name);
            let found = |table: &dyn TableLike, number: usize| match name {
                Some(_) => table.get("name").and_then(Item::as_str) == name,
                None => number == *index,
            };
            match table.get_mut(key) {
                Some(Item::ArrayOfTables(tables)) => {
                    let Some(number) =
                        (0..tables.len()).find(|n| tables.get(*n).is_some_and(|t| found(t, *n)))
                    else {
                        return;
                    };
                    if rest.is_empty() {
                        tables.remove(number);
                    } else if let (Some(table), Some(entry)) = (tables.get_mut(number), entry) {
                        remove(table, entry, rest);
                    }
                }
                Some(Item::Value(Value::Array(items))) => {
                    let is_found = |n: &usize| match items.get(*n).and_then(Value::as_inline_table) {
                        Some(table) => found(table, *n),
                        None => *n == *index,
                    };
                    let Some(number) = (0..items.len()).find(is_found) else { return };
                    if rest.is_empty() {
                        items.remove(number);
                    } else if let (Some(table), Some(entry)) =
                        (items.get_mut(number).and_then(Value::as_inline_table_mut), entry)
                    {
                        remove(table, entry, rest);
                    }
                }
                _ => {}
            }
        }
        [Step::Key(key), rest @ ..] => {
            let inner = table.get_mut(key).and_then(Item::as_table_like_mut);
            if let (Some(inner), Some(before)) = (inner, before.get(key)) {
                remove(inner, before, rest);
            }
        }
        _ => {}
    }
}
