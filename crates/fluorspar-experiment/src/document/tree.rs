//! An experiment as a tree that remembers which line of which file every value comes from.

use fluorspar::quote::{excerpt, excerpt_to};
use std::path::PathBuf;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{
    BlamedOverride, ErrorDetails, ExperimentError, Message, Place, Step, path_text, step_text,
};
use fluorspar::units::number_text;
use fluorspar_format::read_toml_places;

/// Longest text of an experiment, bytes.
pub(crate) const MAX_TEXT_BYTES: usize = 4 << 20;
/// Most keys of a table and tables of a list.
const MAX_ENTRIES: usize = 10_000;

/// Where values come from.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TextSource {
    /// Name for messages: a file, a preset or an override.
    pub(crate) name: String,
    /// The override that it is, if it is no file.
    pub(crate) overriding: Option<Overriding>,
    /// Where its relative paths start; the files of the catalogue name no others.
    pub(crate) folder: Option<PathBuf>,
}

/// What an override overrides.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Overriding {
    /// Its number among the overrides, from 0.
    pub(crate) number: usize,
    /// The value that it sets; nothing while that is not known.
    pub(crate) path: Vec<Step>,
}

impl TextSource {
    /// Whether line numbers mean anything: not in an override.
    pub(crate) fn has_lines(&self) -> bool {
        self.overriding.is_none()
    }

    /// An error that belongs to no line.
    pub(crate) fn error(&self, message: impl Into<Message>) -> ExperimentError {
        let Message { text: message, known } = message.into();
        ExperimentError(Box::new(ErrorDetails {
            source_name: self.name.clone(),
            blamed_override: self.blame(&[]),
            line: None,
            entry: None,
            field: None,
            path: None,
            value: None,
            message,
            known,
            paths_from: None,
        }))
    }

    /// The override, if it is one, as what holds the defect at a path.
    pub(crate) fn blame(&self, path: &[Step]) -> Option<BlamedOverride> {
        let Overriding { number, path: set } = self.overriding.as_ref()?;
        Some(BlamedOverride { number: *number, sets_field: path.starts_with(set) })
    }
}

/// Place of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Origin {
    /// Index into the sources of the document.
    pub(crate) source: usize,
    /// Line, from 1.
    pub(crate) line: usize,
}

/// A value with its place.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Node {
    pub(crate) content: Content,
    pub(crate) origin: Origin,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Content {
    Table(Vec<(String, Node)>),
    Array(Vec<Node>),
    Leaf(toml::Value),
}

/// A tree and the sources it was merged from.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Document {
    pub(crate) sources: Vec<TextSource>,
    /// Files of base experiments that were read.
    pub(crate) base_files: Vec<PathBuf>,
    pub(crate) root: Node,
}

impl Node {
    pub(crate) fn get(&self, key: &str) -> Option<&Self> {
        match &self.content {
            Content::Table(entries) => entries.iter().find(|(k, _)| k == key).map(|(_, node)| node),
            _ => None,
        }
    }

    pub(crate) fn get_mut(&mut self, key: &str) -> Option<&mut Self> {
        match &mut self.content {
            Content::Table(entries) => entries.iter_mut().find(|(k, _)| k == key).map(|(_, node)| node),
            _ => None,
        }
    }

    /// Adds a key that the table does not have yet.
    pub(crate) fn insert(&mut self, key: &str, value: Self) {
        if let Content::Table(entries) = &mut self.content {
            entries.push((key.into(), value));
        }
    }

    /// Removes a key of a table.
    pub(crate) fn take(&mut self, key: &str) -> Option<Self> {
        let Content::Table(entries) = &mut self.content else { return None };
        let index = entries.iter().position(|(k, _)| k == key)?;
        Some(entries.remove(index).1)
    }

    pub(crate) fn step(&self, step: &Step) -> Option<&Self> {
        match (step, &self.content) {
            (Step::Key(key), _) => self.get(key),
            (Step::Index(index), Content::Array(items)) => items.get(*index),
            _ => None,
        }
    }

    pub(crate) fn as_str(&self) -> Option<&str> {
        match &self.content {
            Content::Leaf(toml::Value::String(text)) => Some(text),
            _ => None,
        }
    }

    /// Removes all keys of a table but some.
    pub(crate) fn retain(&mut self, is_kept: impl Fn(&str) -> bool) {
        if let Content::Table(entries) = &mut self.content {
            entries.retain(|(key, _)| is_kept(key));
        }
    }

    /// Name of an entry of a list, where it has one.
    pub(crate) fn name(&self) -> Option<&str> {
        self.get("name")?.as_str()
    }

    /// A path from here as changes write it: entries of lists by their names, where they have one.
    pub(crate) fn named_path(&self, path: &[Step]) -> String {
        let (mut node, mut text) = (Some(self), String::new());
        for step in path {
            node = node.and_then(|node| node.step(step));
            match (step, node.and_then(Self::name)) {
                (Step::Index(index), None) => text.push_str(&format!("[{index}]")),
                (Step::Index(_), Some(name)) => text.push_str(&format!(".{}", step_text(name))),
                (Step::Key(key), _) if text.is_empty() => text.push_str(&step_text(key)),
                (Step::Key(key), _) => text.push_str(&format!(".{}", step_text(key))),
            }
        }
        text
    }

    pub(crate) fn to_value(&self) -> toml::Value {
        match &self.content {
            Content::Table(entries) => {
                toml::Value::Table(entries.iter().map(|(key, node)| (key.clone(), node.to_value())).collect())
            }
            Content::Array(items) => toml::Value::Array(items.iter().map(Self::to_value).collect()),
            Content::Leaf(value) => value.clone(),
        }
    }

    /// Whether it is a value or a list of values.
    fn is_plain(&self) -> bool {
        match &self.content {
            Content::Leaf(_) => true,
            Content::Array(items) => items.iter().all(|item| matches!(item.content, Content::Leaf(_))),
            Content::Table(_) => false,
        }
    }

    /// A value or a list of values as it would be typed: `0.5`, `1e99`, `[1, "a"]`.
    fn as_typed(&self) -> String {
        match &self.content {
            Content::Array(items) => {
                let items: Vec<String> = items.iter().map(Self::as_typed).collect();
                format!("[{}]", items.join(", "))
            }
            // The writer of TOML spells large and small numbers out.
            Content::Leaf(toml::Value::Float(value))
                if value.is_finite() && *value != 0.0 && !(1e-4..1e9).contains(&value.abs()) =>
            {
                number_text(*value)
            }
            Content::Leaf(_) | Content::Table(_) => self.to_value().to_string(),
        }
    }
}

impl Document {
    /// Reads a text into a tree.
    pub(crate) fn read(text: &str, source: TextSource) -> Result<Self, ExperimentError> {
        let root = read_tree(text, &source, 0)?;
        Ok(Self { sources: vec![source], base_files: Vec::new(), root })
    }

    /// Whether there is a value at a path.
    pub(crate) fn has(&self, path: &[Step]) -> bool {
        path.iter().try_fold(&self.root, |node, step| node.step(step)).is_some()
    }

    /// An error about the value at a path, or about the nearest thing around it that exists.
    pub(crate) fn error(&self, path: &[Step], message: impl Into<Message>) -> ExperimentError {
        let Message { text: message, known } = message.into();
        let mut node = &self.root;
        let mut depth = 0;
        while let Some(inner) = path.get(depth).and_then(|step| node.step(step)) {
            node = inner;
            depth += 1;
        }
        let exists = depth == path.len();
        let source = &self.sources[node.origin.source];
        let (entry, field) = self.entry_and_field(path);
        let value = (exists && field.is_some() && node.is_plain()).then(|| shortened(&node.as_typed()));
        let line = (source.has_lines() && depth > 0).then_some(node.origin.line);
        ExperimentError(Box::new(ErrorDetails {
            source_name: source.name.clone(),
            blamed_override: source.blame(path),
            line,
            entry,
            field,
            path: (!path.is_empty()).then(|| self.root.named_path(path)),
            value,
            message,
            known,
            paths_from: None,
        }))
    }

    /// An error about a table, on the line of one of its keys.
    pub(crate) fn error_at_key(
        &self,
        table: &Place,
        key: &Step,
        message: impl Into<Message>,
    ) -> ExperimentError {
        let key = [&table[..], std::slice::from_ref(key)].concat();
        let place = self.error(&key, "");
        let mut error = self.error(table, message).without_value();
        error.0.source_name.clone_from(&place.0.source_name);
        error.0.blamed_override = place.0.blamed_override;
        error.0.line = place.0.line;
        error.0.path.clone_from(&place.0.path);
        error
    }

    /// Splits a path into the entry of a top-level list, with its name, and what follows.
    fn entry_and_field(&self, path: &[Step]) -> (Option<String>, Option<String>) {
        let text = |path: &[Step]| (!path.is_empty()).then(|| path_text(path));
        let [Step::Key(list), Step::Index(index), rest @ ..] = path else { return (None, text(path)) };
        let name = self.root.get(list).and_then(|node| node.step(&Step::Index(*index))).and_then(Node::name);
        let name = name.filter(|name| !name.is_empty());
        let name = name.map_or_else(String::new, |name| format!(" \"{}\"", shortened(name)));
        (Some(format!("{list}[{index}]{name}")), text(rest))
    }
}

/// Where the lines of a text end, bytes.
struct Lines(Vec<usize>);

impl Lines {
    fn of(text: &str) -> Self {
        Self(text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at).collect())
    }

    /// The line that a byte lies on, from 1.
    fn line_of(&self, byte: usize) -> usize {
        1 + self.0.partition_point(|end| *end < byte)
    }
}

/// Reads a text into nodes of a given source.
pub(crate) fn read_tree(text: &str, source: &TextSource, index: usize) -> Result<Node, ExperimentError> {
    if text.len() > MAX_TEXT_BYTES {
        let message = format!(
            "the text has {} bytes; at most {MAX_TEXT_BYTES} are read. Put long tables into files of their own",
            text.len()
        );
        return Err(source.error(message));
    }
    let table = read_toml_places(text).map_err(|error| {
        let message = format!("invalid TOML: {}", error.message().trim().replace('\n', ", "));
        let line = error.line().filter(|_| source.has_lines());
        let error = source.error(message);
        match line {
            Some(line) => error.at_line(line),
            None => error,
        }
    })?;
    let reader = Reader { lines: Lines::of(text), source, index };
    let origin = Origin { source: index, line: 1 };
    Ok(Node { content: reader.table(table.get_ref(), 1)?, origin })
}

struct Reader<'a> {
    lines: Lines,
    source: &'a TextSource,
    index: usize,
}

impl Reader<'_> {
    /// Refuses tables and lists that are far longer than those of any experiment: each entry is looked up among the others.
    fn check_count(&self, count: usize, what: &str, line: usize) -> Result<(), ExperimentError> {
        if count <= MAX_ENTRIES {
            return Ok(());
        }
        let message = format!("{count} {what}; at most {MAX_ENTRIES} are read. Is this the right file?");
        Err(self.source.error(message).at_line(line))
    }

    fn table(&self, table: &DeTable<'_>, line: usize) -> Result<Content, ExperimentError> {
        self.check_count(table.len(), "keys in one table", line)?;
        let mut entries = Vec::with_capacity(table.len());
        for (key, value) in table {
            let line = self.lines.line_of(key.span().start);
            let mut node = self.value(value)?;
            // The header of a table or the key of a value is what a reader looks for.
            if !matches!(node.content, Content::Array(_)) {
                node.origin.line = line;
            }
            entries.push((key.get_ref().to_string(), node));
        }
        Ok(Content::Table(entries))
    }

    fn value(&self, value: &Spanned<DeValue<'_>>) -> Result<Node, ExperimentError> {
        let line = self.lines.line_of(value.span().start);
        let number = |what: &str, text: &str| {
            let message = format!("{} is too large for {what}", shortened(text));
            self.source.error(message).at_line(line)
        };
        let content = match value.get_ref() {
            DeValue::Table(table) => self.table(table, line)?,
            DeValue::Array(items) => {
                let is_table = |item: &&Spanned<DeValue<'_>>| matches!(item.get_ref(), DeValue::Table(_));
                self.check_count(items.iter().filter(is_table).count(), "tables in one list", line)?;
                Content::Array(items.iter().map(|item| self.value(item)).collect::<Result<_, _>>()?)
            }
            DeValue::String(text) => Content::Leaf(toml::Value::String(text.to_string())),
            DeValue::Boolean(value) => Content::Leaf(toml::Value::Boolean(*value)),
            DeValue::Integer(integer) => {
                let value = i64::from_str_radix(integer.as_str(), integer.radix())
                    .map_err(|_| number("a whole number", integer.as_str()))?;
                Content::Leaf(toml::Value::Integer(value))
            }
            DeValue::Float(float) => {
                let value = float.as_str().parse::<f64>().map_err(|_| number("a number", float.as_str()))?;
                Content::Leaf(toml::Value::Float(value))
            }
            DeValue::Datetime(datetime) => Content::Leaf(toml::Value::Datetime(*datetime)),
        };
        Ok(Node { content, origin: Origin { source: self.index, line } })
    }
}

/// A value fit for a message.
pub(crate) fn shortened(text: &str) -> String {
    // Paths are looked for by their end.
    if text.contains('/') { excerpt_to(text, 400) } else { excerpt(text) }
}
