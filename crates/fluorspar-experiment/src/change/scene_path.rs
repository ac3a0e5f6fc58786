//! Paths to the things of a scene: `light.blue.strength.power_mw`, `material.tongue_*.gloss`, `tooth_*/material`.
//!
//! A step names a key of a table or an entry of a list, by its name or by its number from 0. `*` stands for any letters and `?`
//! for one, unless the step is quoted. What comes before a slash names parts: objects, and parts of the mouth.

use fluorspar::quote::excerpt;

use crate::document::shape::{Mark, Schema, Shape, Table};
use crate::document::tree::{Content, Node, TextSource};
use crate::error::{ExperimentError, Message, Step};

/// Most things that a path may name.
const MOST_TARGETS: usize = 100_000;

/// A step of a path as it is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Pattern {
    pub(crate) text: String,
    is_quoted: bool,
}

/// Most steps of a path: tables that lie deeper than those of TOML may would not fit on the stack.
const MOST_STEPS: usize = 64;

/// A path as it is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ScenePath {
    /// The parts before the slash, where there is one.
    pub(crate) part: Option<Pattern>,
    pub(crate) steps: Vec<Pattern>,
}

impl Pattern {
    /// Whether it stands for several names.
    pub(crate) fn is_wild(&self) -> bool {
        !self.is_quoted && self.text.contains(['*', '?'])
    }

    /// Whether a name is one of those that it stands for.
    pub(crate) fn matches(&self, name: &str) -> bool {
        if self.is_wild() { matches(&self.text, name) } else { self.text == name }
    }
}

/// Whether a name follows a pattern of letters, `*` and `?`.
fn matches(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    // Where the last star stands, and how much of the name it covers.
    let mut star: Option<(usize, usize)> = None;
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, n));
                p += 1;
            }
            Some(letter) if *letter == '?' || *letter == name[n] => (p, n) = (p + 1, n + 1),
            _ => {
                let Some((at, covered)) = star else { return false };
                star = Some((at, covered + 1));
                (p, n) = (at + 1, covered + 1);
            }
        }
    }
    pattern[p..].iter().all(|letter| *letter == '*')
}

impl ScenePath {
    /// Reads a path, and finds the place of its `=`, if there is one.
    pub(crate) fn read(text: &str, source: &TextSource) -> Result<(Self, Option<usize>), ExperimentError> {
        let mut reader = Steps::default();
        let mut equals = None;
        let mut is_quoted = false;
        for (at, c) in text.char_indices() {
            match c {
                '"' => {
                    is_quoted = !is_quoted;
                    reader.current.is_quoted = true;
                }
                '.' | '[' | ']' if !is_quoted => {
                    if !reader.end_step() && c == '.' && !text[..at].ends_with(']') {
                        return Err(source.error("the path has an empty step; write section.field=value"));
                    }
                }
                '/' if !is_quoted => reader.end_part(source)?,
                '=' if !is_quoted => {
                    equals = Some(at);
                    break;
                }
                c => reader.current.text.push(c),
            }
        }
        reader.end_step();
        if reader.path.steps.is_empty() {
            let message = match (&reader.path.part, equals) {
                (Some(_), _) => "the path ends with its slash; write PART/material or PART/transform",
                (None, Some(_)) => "the path before `=` is missing; write section.field=value",
                (None, None) => "the path is empty; write section.field",
            };
            return Err(source.error(message));
        }
        if reader.path.steps.len() > MOST_STEPS {
            let message =
                format!("the path has {} steps; those of an experiment have a few", reader.path.steps.len());
            return Err(source.error(message));
        }
        Ok((reader.path, equals))
    }
}

/// A path that is being read.
struct Steps {
    path: ScenePath,
    current: Pattern,
}

impl Default for Steps {
    fn default() -> Self {
        Self { path: ScenePath { part: None, steps: Vec::new() }, current: Pattern::empty() }
    }
}

impl Pattern {
    fn empty() -> Self {
        Self { text: String::new(), is_quoted: false }
    }

    /// A name without wildcards.
    pub(crate) fn plain(name: &str) -> Self {
        Self { text: name.into(), is_quoted: true }
    }
}

impl Steps {
    /// Adds a step to the path, if there is one.
    fn end_step(&mut self) -> bool {
        let mut step = std::mem::replace(&mut self.current, Pattern::empty());
        if !step.is_quoted {
            step.text = step.text.trim().to_string();
        }
        let exists = !step.text.trim().is_empty();
        if exists {
            step.text = step.text.trim().to_string();
            self.path.steps.push(step);
        }
        exists
    }

    /// What was read so far names parts.
    fn end_part(&mut self, source: &TextSource) -> Result<(), ExperimentError> {
        self.end_step();
        if self.path.part.is_some() || self.path.steps.len() != 1 {
            let message = "a slash follows the name of parts, once; write PART/material.field=value";
            return Err(source.error(message));
        }
        self.path.part = self.path.steps.pop();
        Ok(())
    }
}

/// Finds what a path names in a tree.
pub(crate) struct Finder<'a> {
    pub(crate) schema: &'a Schema,
    pub(crate) source: &'a TextSource,
    found: Vec<Vec<Step>>,
    /// First thing that was passed over below a wildcard.
    passed: Option<ExperimentError>,
}

impl<'a> Finder<'a> {
    pub(crate) fn new(schema: &'a Schema, source: &'a TextSource) -> Self {
        Self { schema, source, found: Vec::new(), passed: None }
    }

    /// All places that steps lead to from the root of a tree, in its order. A step without wildcard may name a key that is not
    /// there yet; below a wildcard only where the schema has such a field.
    ///
    /// # Errors
    /// Names that are not there, wildcards that nothing matches.
    pub(crate) fn find(mut self, root: &Node, steps: &[Pattern]) -> Result<Vec<Vec<Step>>, ExperimentError> {
        let schema = self.schema;
        self.walk(Some(schema.root()), Some(root), "", steps, &mut Vec::new(), false)?;
        if self.found.is_empty() {
            let wild = steps.iter().find(|step| step.is_wild());
            let message = || {
                let step = wild.map_or("", |step| step.text.as_str());
                format!("nothing matches `{}`; `fluorspar scene tree` lists what there is", excerpt(step))
            };
            return Err(self.passed.unwrap_or_else(|| self.source.error(message())));
        }
        Ok(self.found)
    }

    fn walk(
        &mut self,
        shape: Option<&Shape>,
        node: Option<&Node>,
        parent: &str,
        steps: &[Pattern],
        done: &mut Vec<Step>,
        is_below_wildcard: bool,
    ) -> Result<(), ExperimentError> {
        let Some((step, rest)) = steps.split_first() else {
            if self.found.len() == MOST_TARGETS {
                return Err(self.source.error(format!("the path names more than {MOST_TARGETS} things")));
            }
            self.found.push(done.clone());
            return Ok(());
        };
        let is_wild = is_below_wildcard || step.is_wild();
        match node.map(|node| &node.content) {
            Some(Content::Array(items)) => {
                let shape = shape.and_then(|shape| self.schema.items(shape));
                let numbers = match self.entries(items, parent, step) {
                    Ok(numbers) => numbers,
                    Err(error) => return self.pass_over(is_below_wildcard, error),
                };
                for number in numbers {
                    done.push(Step::Index(number));
                    self.walk(shape, items.get(number), &step.text, rest, done, is_wild)?;
                    done.pop();
                }
                Ok(())
            }
            Some(Content::Leaf(_)) => {
                let message =
                    format!("`{}` is a value and has no field `{}`", excerpt(parent), excerpt(&step.text));
                let error = self.source.error(message);
                self.pass_over(is_below_wildcard, error)
            }
            _ => {
                let table = shape.and_then(|shape| self.schema.table(shape));
                for key in self.keys(table, node, step, is_below_wildcard) {
                    let variant =
                        table.and_then(|table| node.and_then(|node| table.variant_or_default(node)));
                    let shape = table.and_then(|table| table.shape(variant, &key));
                    let inner = node.and_then(|node| node.get(&key));
                    done.push(Step::Key(key.clone()));
                    self.walk(shape, inner, &key, rest, done, is_wild)?;
                    done.pop();
                }
                Ok(())
            }
        }
    }

    /// An error, but for places below a wildcard, which are left out.
    fn pass_over(&mut self, is_below_wildcard: bool, error: ExperimentError) -> Result<(), ExperimentError> {
        if !is_below_wildcard {
            return Err(error);
        }
        self.passed.get_or_insert(error);
        Ok(())
    }

    /// Keys of a table that a step names.
    fn keys(
        &mut self,
        table: Option<&Table>,
        node: Option<&Node>,
        step: &Pattern,
        is_below_wildcard: bool,
    ) -> Vec<String> {
        if step.is_wild() {
            let entries = match node.map(|node| &node.content) {
                Some(Content::Table(entries)) => entries.as_slice(),
                _ => &[],
            };
            return entries.iter().map(|(key, _)| key).filter(|key| step.matches(key)).cloned().collect();
        }
        let is_there = node.is_some_and(|node| node.get(&step.text).is_some());
        if is_below_wildcard && !is_there && table.is_some_and(|table| !can_have(table, node, &step.text)) {
            let message = format!("nothing that the path names can have a field `{}`", excerpt(&step.text));
            let error = self.source.error(message);
            self.passed.get_or_insert(error);
            return Vec::new();
        }
        vec![step.text.clone()]
    }

    /// Numbers of the entries of a list that a step names.
    fn entries(&self, items: &[Node], list: &str, step: &Pattern) -> Result<Vec<usize>, ExperimentError> {
        if step.is_wild() {
            let is_named = |number: &usize| match items[*number].name() {
                Some(name) => step.matches(name),
                None => step.matches(&number.to_string()),
            };
            return Ok((0..items.len()).filter(is_named).collect());
        }
        Ok(vec![find_entry(items, list, &step.text, self.source)?])
    }
}

/// Whether a table can have a field: as what it is now, or as another variant that fields select.
fn can_have(table: &Table, node: Option<&Node>, key: &str) -> bool {
    let variant = node.and_then(|node| table.variant_or_default(node));
    let by_fields = || {
        let of_variant = |variant: &crate::document::shape::Variant| {
            !matches!(variant.mark, Mark::Tag { .. }) && variant.fields.iter().any(|field| field.name == key)
        };
        table.variants.iter().any(of_variant)
    };
    table.tag() == Some(key) || table.shape(variant, key).is_some() || by_fields()
}

/// The number of the entry of a list that a step names.
fn find_entry(items: &[Node], list: &str, step: &str, source: &TextSource) -> Result<usize, ExperimentError> {
    if let Some(index) = items.iter().position(|item| item.name() == Some(step)) {
        return Ok(index);
    }
    if let Ok(index) = step.parse::<usize>() {
        if index < items.len() {
            return Ok(index);
        }
        let message = match items.len() {
            0 => format!("there is no {list}[{index}]; the list is empty"),
            1 => format!("there is no {list}[{index}]; the list has one entry, {list}[0]"),
            many => format!("there is no {list}[{index}]; the list has {many} entries, numbered from 0"),
        };
        return Err(source.error(message));
    }
    let names: Vec<&str> = items.iter().filter_map(Node::name).collect();
    if names.is_empty() {
        let message = format!("`{list}` is a list; address its entries by number, as in {list}[0]");
        return Err(source.error(message));
    }
    let what = format!("there is no {list} \"{}\"", excerpt(step));
    Err(source.error(Message::unknown(what, step, names.iter().copied())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match_as_those_of_a_shell_do() {
        let cases = [
            ("*", "", true),
            ("tooth_*", "tooth_11", true),
            ("tooth_*", "teeth", false),
            ("*_1?", "tooth_11", true),
            ("*_1?", "tooth_1", false),
            ("a*b*c", "aXbYbZc", true),
            ("a*b*c", "aXbYbZ", false),
            ("a**", "a", true),
            ("?", "ü", true),
            ("", "", true),
            ("*aaaaaaaaaaaaab", &"a".repeat(3000), false),
        ];
        for (pattern, name, expected) in cases {
            assert_eq!(matches(pattern, name), expected, "{pattern} {name}");
        }
    }
}
