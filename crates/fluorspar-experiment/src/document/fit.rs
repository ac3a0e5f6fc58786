//! Whether a tree fits the shapes of its file, and what does not is explained at its place.

use fluorspar::quote::excerpt;
use std::path::PathBuf;

use super::shape::{Either, Field, Found, Mark, Schema, Shape, Table, TextKind, Variant};
use super::tree::{Content, Document, Node, TextSource};
use crate::error::{ExperimentError, Message, Place, Step};
use crate::schema::{NameOrTable, is_file_name};
use fluorspar::names::{did_you_mean, nearest_name, suggestion};

/// Makes a merged tree complete: relative paths start where they were written, and tables that leave the tag of their
/// variant out get that of the default.
pub(crate) fn complete(schema: &Schema, shape: &Shape, node: &mut Node, sources: &[TextSource]) {
    let origin = node.origin;
    match (schema.resolve(shape), &mut node.content) {
        (Shape::Text(kind), Content::Leaf(toml::Value::String(text))) => {
            anchor(*kind, text, sources[origin.source].folder.as_ref());
        }
        (Shape::Either(either), Content::Leaf(toml::Value::String(text))) => {
            for value in &either.values {
                if let Shape::Text(kind) = schema.resolve(value) {
                    anchor(*kind, text, sources[origin.source].folder.as_ref());
                }
            }
        }
        (shape @ (Shape::List { .. } | Shape::Either(_)), Content::Array(items)) => {
            if let Some(of_items) = schema.items(shape) {
                items.iter_mut().for_each(|item| complete(schema, of_items, item, sources));
            }
        }
        (shape @ (Shape::Table(_) | Shape::Either(_)), Content::Table(_)) => {
            if let Some(table) = schema.table(shape) {
                complete_table(schema, table, node, sources);
            }
        }
        _ => {}
    }
}

fn complete_table(schema: &Schema, table: &Table, node: &mut Node, sources: &[TextSource]) {
    let variant = table.variant_or_default(node);
    if let Some(Mark::Tag { field, value }) = variant.map(|index| &table.variants[index].mark)
        && node.get(field).is_none()
    {
        let content = Content::Leaf(toml::Value::String(value.clone()));
        node.insert(field, Node { content, origin: node.origin });
    }
    let Content::Table(entries) = &mut node.content else { return };
    for (key, inner) in entries {
        if let Some(shape) = table.shape(variant, key) {
            complete(schema, shape, inner, sources);
        }
    }
}

fn anchor(kind: TextKind, text: &mut String, folder: Option<&PathBuf>) {
    let is_path = match kind {
        TextKind::Plain => false,
        TextKind::Path => true,
        TextKind::NameOrTablePath => NameOrTable::is_path(text),
        TextKind::NameOrFilePath => is_file_name(text),
    };
    if let (true, false, Some(folder)) = (is_path, text.is_empty(), folder) {
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.clone());
        *text = folder.join(&*text).to_string_lossy().into_owned();
    }
}

/// Checks that a tree is of the shape of its file.
///
/// # Errors
/// The first thing that does not fit.
pub(crate) fn check(schema: &Schema, document: &Document) -> Result<(), ExperimentError> {
    Fit { schema, document }.value(schema.root(), &document.root, &Place::default())
}

struct Fit<'a> {
    schema: &'a Schema,
    document: &'a Document,
}

impl Fit<'_> {
    fn value(&self, shape: &Shape, node: &Node, at: &Place) -> Result<(), ExperimentError> {
        use toml::Value::{Boolean, Float, Integer, String};
        let shape = self.schema.resolve(shape);
        match (shape, &node.content) {
            (Shape::Anything, _)
            | (Shape::Boolean, Content::Leaf(Boolean(_)))
            | (Shape::Number, Content::Leaf(Float(_) | Integer(_)))
            | (Shape::Text(_), Content::Leaf(String(_))) => Ok(()),
            (Shape::Whole([least, most]), Content::Leaf(Integer(value))) => {
                if (*least..=*most).contains(value) {
                    return Ok(());
                }
                self.fail(at, format!("expected {}", whole_number([*least, *most])))
            }
            (Shape::Word(words), Content::Leaf(String(text))) => self.word(words, text, at),
            (Shape::List { items, length }, Content::Array(nodes)) => {
                self.list(shape, items, *length, nodes, at)
            }
            (Shape::Table(table), Content::Table(entries)) => self.table(table, node, entries, at),
            (Shape::Either(either), _) => self.either(either, node, at),
            _ => self.other_type(&self.expected(shape), Some(shape), node, at),
        }
    }

    fn fail<T>(&self, at: &Place, message: impl Into<Message>) -> Result<T, ExperimentError> {
        Err(self.document.error(at, message))
    }

    fn word(&self, words: &[String], text: &str, at: &Place) -> Result<(), ExperimentError> {
        if words.iter().any(|word| word == text) {
            return Ok(());
        }
        let what = format!("unknown value \"{}\"", excerpt(text));
        self.fail(at, Message::unknown(what, text, words.iter().map(String::as_str)))
    }

    fn list(
        &self,
        shape: &Shape,
        items: &Shape,
        length: Option<usize>,
        nodes: &[Node],
        at: &Place,
    ) -> Result<(), ExperimentError> {
        if length.is_some_and(|length| length != nodes.len()) {
            let entries = if nodes.len() == 1 { "entry" } else { "entries" };
            let message =
                format!("this list has {} {entries}; expected {}", nodes.len(), self.expected(shape));
            return self.fail(at, message);
        }
        nodes.iter().enumerate().try_for_each(|(index, node)| self.value(items, node, &at.index(index)))
    }

    /// Values of different types: the value is checked against its own type.
    fn either(&self, either: &Either, node: &Node, at: &Place) -> Result<(), ExperimentError> {
        match (&node.content, &either.table) {
            (Content::Table(entries), Some(table)) => return self.table(table, node, entries, at),
            (Content::Array(_), _) => {
                let is_list = |shape: &&Shape| matches!(self.schema.resolve(shape), Shape::List { .. });
                if let Some(list) = either.values.iter().find(is_list) {
                    return self.value(list, node, at);
                }
            }
            (Content::Leaf(_), _)
                if either.values.iter().any(|shape| self.value(shape, node, at).is_ok()) =>
            {
                return Ok(());
            }
            _ => {}
        }
        self.other_type(&either.expected, None, node, at)
    }

    /// A value of another type than the one that is wanted.
    fn other_type(
        &self,
        expected: &str,
        shape: Option<&Shape>,
        node: &Node,
        at: &Place,
    ) -> Result<(), ExperimentError> {
        let found = match &node.content {
            Content::Table(_) => "found a table; ",
            Content::Array(_) => "found a list; ",
            Content::Leaf(_) => "",
        };
        let example = match (&node.content, shape) {
            (Content::Leaf(toml::Value::String(text)), Some(Shape::List { length: None, .. })) if text.starts_with('[') => {
                ": texts within it need quotes, which a shell takes away; put '...' around the whole of PATH=VALUE".into()
            }
            (Content::Leaf(value), Some(Shape::List { length: None, .. }))
                if value.to_string().len() <= 60 =>
            {
                format!(", for instance [{value}]")
            }
            _ => String::new(),
        };
        self.fail(at, format!("{found}expected {expected}{example}"))
    }

    /// The expected values of a shape, in words.
    fn expected(&self, shape: &Shape) -> String {
        match self.schema.resolve(shape) {
            Shape::Anything => "a value".into(),
            Shape::Boolean => "true or false".into(),
            Shape::Number => "a number".into(),
            Shape::Whole(range) => whole_number(*range),
            Shape::Text(_) => "a text in quotes".into(),
            Shape::Word(words) => format!("one of the texts {}", words.join(", ")),
            Shape::List { items, length: Some(length) } => {
                let what = match self.schema.resolve(items) {
                    Shape::Number => "numbers",
                    Shape::Whole(_) => "whole numbers",
                    _ => "entries",
                };
                format!("a list of {length} {what}")
            }
            Shape::List { .. } => "a list in [ ]".into(),
            Shape::Table(_) | Shape::Named(_) => "a table".into(),
            Shape::Either(either) => either.expected.clone(),
        }
    }

    fn table(
        &self,
        table: &Table,
        node: &Node,
        entries: &[(String, Node)],
        at: &Place,
    ) -> Result<(), ExperimentError> {
        let variant = self.variant(table, node, at)?;
        for (key, inner) in entries {
            if Some(key.as_str()) == table.tag() {
                continue;
            }
            match table.shape(variant, key) {
                Some(shape) => self.value(shape, inner, &at.field(key))?,
                None => return Err(self.unknown_field(table, variant, key, at)),
            }
        }
        let is_missing = |field: &&Field| field.required && node.get(&field.name).is_none();
        if let Some(missing) = table.fields_of(variant).find(is_missing) {
            return Err(self.missing_field(table, variant, missing, at));
        }
        Ok(())
    }

    /// The variant of a table, if it has variants.
    fn variant(&self, table: &Table, node: &Node, at: &Place) -> Result<Option<usize>, ExperimentError> {
        let marks = || table.variants.iter().map(mark_name).collect::<Vec<_>>();
        if table.variant_of(node) == Found::Unsaid
            && table.default.is_none()
            && let Some(unknown) = self.unknown_mark(table, node)
        {
            let known: Vec<String> = marks();
            let message = match table.tag().filter(|_| known.iter().any(|value| value == unknown)) {
                Some(tag) => {
                    format!("unknown field `{unknown}`; write {tag} = \"{unknown}\" and its fields beside it")
                }
                None => {
                    let hint = did_you_mean(unknown, known.iter().map(String::as_str));
                    format!("unknown field `{}`{hint} Give one of {}", excerpt(unknown), known.join(", "))
                }
            };
            return Err(self.document.error_at_key(at, &Step::Key(unknown.into()), message));
        }
        if table.variant_of(node) == Found::Unsaid
            && let Some(tag) = table.tag()
            && let Content::Table(entries) = &node.content
            && let Some((old, _)) = entries.iter().find(|(key, _)| table.renamed(key) == Some(tag))
        {
            let message = format!("unknown field `{old}`; write {tag}");
            return Err(self.document.error_at_key(at, &Step::Key(old.clone()), message));
        }
        match table.variant_of(node) {
            Found::Variant(index) => Ok(Some(index)),
            Found::Unsaid if table.variants.is_empty() || table.default.is_some() => Ok(table.default),
            found @ (Found::Unsaid | Found::Several) => {
                if let (Some(tag), Found::Unsaid) = (table.tag(), &found) {
                    return Err(self.missing(at, tag, missing_tag(table, tag)));
                }
                let known = if table.tag().is_some() { marks_of(table, by_field) } else { marks() };
                let message = format!("give exactly one of {}", known.join(", "));
                Err(self.document.error(at, message).without_value())
            }
            Found::UnknownTag(tag) => {
                let at = at.field(tag);
                let fields = marks_of(table, by_field);
                match node.get(tag).and_then(Node::as_str) {
                    Some(text) if fields.iter().any(|field| field == text) => {
                        let example = if is_file(text) { "\"FILE\"" } else { "..." };
                        let message =
                            format!("unknown value \"{text}\"; write {{ {text} = {example} }} without {tag}");
                        self.fail(&at, message)
                    }
                    Some(text) => self.word(&marks_of(table, by_tag), text, &at).map(|()| None),
                    None => self.fail(&at, "expected a text in quotes"),
                }
            }
        }
    }

    /// The first field of a table without a variant that no variant has.
    fn unknown_mark<'n>(&self, table: &Table, node: &'n Node) -> Option<&'n str> {
        let Content::Table(entries) = &node.content else { return None };
        let of_any = |key: &str| {
            let fields = table.variants.iter().flat_map(|variant| &variant.fields);
            table.fields.iter().chain(fields).any(|field| field.name == key)
        };
        let unknown = entries.iter().find(|(key, _)| !of_any(key) && table.variants.iter().any(by_field));
        unknown.map(|(key, _)| key.as_str())
    }

    fn unknown_field(
        &self,
        table: &Table,
        variant: Option<usize>,
        unknown: &str,
        at: &Place,
    ) -> ExperimentError {
        let has_it = |variant: &&Variant| variant.fields.iter().any(|field| field.name == unknown);
        let others: Vec<&Variant> = table.variants.iter().filter(has_it).collect();
        let this = variant.map(|index| &table.variants[index]);
        let message = match (this, table.renamed(unknown)) {
            (_, Some(now)) => format!("unknown field `{unknown}`; write {now}").into(),
            (Some(this), None) if !others.is_empty() => field_of_others(this, &others, unknown).into(),
            _ => self.not_known(table, variant, unknown),
        };
        self.document.error_at_key(at, &Step::Key(unknown.into()), message)
    }

    /// A field that no variant has, with the fields that there are and the one that may be meant.
    fn not_known(&self, table: &Table, variant: Option<usize>, unknown: &str) -> Message {
        let tag = table.tag().into_iter();
        let known: Vec<&str> = tag.chain(table.fields_of(variant).map(|field| field.name.as_str())).collect();
        let mut hint = did_you_mean(unknown, known.iter().copied());
        if hint == "." {
            // What is written one level further down.
            let below: Vec<(String, &str)> = table
                .fields_of(variant)
                .flat_map(|field| {
                    let inner = self.schema.table(&field.shape).into_iter();
                    let fields = inner.flat_map(|table| {
                        table.fields.iter().chain(table.variants.iter().flat_map(|v| &v.fields))
                    });
                    fields.map(move |inner| (format!("{}.{}", field.name, inner.name), inner.name.as_str()))
                })
                .collect();
            let near = nearest_name(unknown, below.iter().map(|(_, name)| *name));
            let path = below.iter().find(|(_, name)| Some(*name) == near).map(|(path, _)| path.as_str());
            hint = suggestion(path);
        }
        Message::with_known(format!("unknown field `{}`{hint}", excerpt(unknown)), known)
    }

    /// Description of a missing field.
    fn example(&self, field: &Field) -> String {
        let shape = self.schema.resolve(&field.shape);
        match shape {
            _ if field.expected.is_some() => {
                format!("; give {}", field.expected.as_deref().unwrap_or_default())
            }
            Shape::Either(either) => format!("; give {}", either.expected),
            Shape::Text(TextKind::NameOrFilePath) => {
                let lenses = crate::preset::names(crate::preset::PresetKind::Lens).join(", ");
                format!("; give a lens of the catalogue ({lenses}) or a lens file")
            }
            Shape::Table(table) if table.tag().is_none() && !table.variants.is_empty() => {
                let marks = table.variants.iter().map(|v| format!("{}.{}", field.name, mark_name(v)));
                format!("; give {}", marks.collect::<Vec<_>>().join(" or "))
            }
            _ => String::new(),
        }
    }

    fn missing_field(
        &self,
        table: &Table,
        variant: Option<usize>,
        missing: &Field,
        at: &Place,
    ) -> ExperimentError {
        let of_all = table.fields.iter().any(|field| field.name == missing.name);
        let who = variant.filter(|_| !of_all).map(|index| &table.variants[index]);
        let (name, example) = (&missing.name, self.example(missing));
        let message = match (who, example.as_str()) {
            (None, _) => format!("the field `{name}` is missing{example}"),
            (Some(who), "") => format!("{} needs the field `{name}`; add it", in_words(who)),
            (Some(who), _) => format!("{} needs the field `{name}`{example}", in_words(who)),
        };
        self.missing(at, &missing.name, message)
    }

    /// An error about a table without a field that it needs.
    fn missing(&self, at: &Place, field: &str, message: String) -> ExperimentError {
        let mut error = self.document.error(at, message).without_value();
        error.0.path = self.document.error(&at.field(field), "").0.path;
        error
    }
}

/// Whole numbers of a range, in words.
fn whole_number([least, most]: [i64; 2]) -> String {
    match (least, most) {
        (0, i64::MAX) => "a whole number, 0 or more".into(),
        (i64::MIN, i64::MAX) => "a whole number".into(),
        _ => format!("a whole number from {least} to {most}"),
    }
}

/// Whether a variant is marked by a field of its own.
fn by_field(variant: &Variant) -> bool {
    matches!(variant.mark, Mark::Field(_))
}

/// Whether a variant is marked by the value of a field that all have.
fn by_tag(variant: &Variant) -> bool {
    matches!(variant.mark, Mark::Tag { .. })
}

/// The marks of some variants.
fn marks_of(table: &Table, which: fn(&Variant) -> bool) -> Vec<String> {
    table.variants.iter().filter(|variant| which(variant)).map(mark_name).collect()
}

/// Whether a field that marks a variant names a file.
fn is_file(field: &str) -> bool {
    ["csv", "mat"].contains(&field)
}

/// What to say of a table without the field that selects its variant.
fn missing_tag(table: &Table, tag: &str) -> String {
    let values: Vec<String> = marks_of(table, by_tag).iter().map(|value| format!("\"{value}\"")).collect();
    let values = match values.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} or {last}", others.join(", ")),
        _ => values.concat(),
    };
    let fields = marks_of(table, by_field);
    let instead = match fields.is_empty() {
        true => String::new(),
        false => format!(", or give the field {} instead", fields.join(" or ")),
    };
    format!("the field `{tag}` is missing; give {tag} = {values}{instead}")
}

/// What to say of a field that only other variants have.
fn field_of_others(this: &Variant, others: &[&Variant], unknown: &str) -> String {
    let Mark::Tag { field: tag, .. } = &this.mark else {
        let own = match &this.mark {
            Mark::Field(field) => field.as_str(),
            _ => this.fields.first().map_or("", |field| field.name.as_str()),
        };
        let owners: Vec<String> =
            others.iter().filter(|other| by_field(other)).map(|other| in_words(other)).collect();
        let goes_with = match owners.is_empty() {
            true => String::new(),
            false => format!(": `{unknown}` goes with {}", owners.join(" or ")),
        };
        return format!("`{own}` and `{unknown}` exclude each other{goes_with}; remove one of them");
    };
    let named = |which: fn(&Variant) -> bool| {
        let names: Vec<String> =
            others.iter().filter(|other| which(other)).map(|other| mark_name(other)).collect();
        names.join(", ")
    };
    let (tagged, marked) = (named(by_tag), named(by_field));
    let instead = match (tagged.as_str(), marked.as_str()) {
        (_, "") => format!("use a {tag} that has it: {tagged}"),
        ("", _) => format!("give {marked} instead of {tag}"),
        _ => format!("use a {tag} that has it: {tagged}, or give {marked} instead of {tag}"),
    };
    format!("{} has no field `{unknown}`. Remove the field, or {instead}", in_words(this))
}

/// The field or tag that selects a variant.
fn mark_name(variant: &Variant) -> String {
    match &variant.mark {
        Mark::Tag { value, .. } => value.clone(),
        Mark::Field(key) => key.clone(),
        Mark::None => variant.fields.iter().map(|f| f.name.as_str()).collect::<Vec<_>>().join(", "),
    }
}

/// A variant in a sentence.
fn in_words(variant: &Variant) -> String {
    match &variant.mark {
        Mark::Tag { field, value } => format!("{field} \"{value}\""),
        Mark::Field(_) | Mark::None => format!("`{}`", mark_name(variant)),
    }
}
