//! Changes of a scene by name, on top of an experiment file: `--set path=value`, and what else a script of changes holds.

use std::fmt;
use std::path::Path;

use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;

use super::scene_parts::{ScenePart, materials_within_others, named_parts, scene_parts};
use super::scene_path::{Finder, Pattern, ScenePath};
use crate::document::merge::make_room;
use crate::document::shape::{Found, Schema, Shape};
use crate::document::tree::{Content, Document, Node, Origin, Overriding, TextSource, read_tree};
use crate::error::{ExperimentError, Step};

/// One change of a scene.
///
/// Paths are those of `--set`: `light.blue.strength.power_mw`, with wildcards `material.tongue_*.gloss.roughness`, by part
/// `tooth_*/material.reflectance`. Values are TOML; what is not TOML is a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneChange {
    /// Gives everything that a path names a value.
    Set {
        /// Path of what changes.
        path: String,
        /// Its new value.
        value: String,
    },
    /// Adds an entry to a list of named ones: `light.lamp`.
    Insert {
        /// The list and the name of the entry.
        path: String,
        /// The fields of the entry, a table.
        value: String,
    },
    /// Removes everything that a path names.
    Delete {
        /// Path of what goes.
        path: String,
    },
}

impl SceneChange {
    /// The change that `PATH=VALUE` sets.
    ///
    /// # Errors
    /// No `=`, or nothing before it.
    pub fn read_set(text: &str) -> Result<Self, ExperimentError> {
        let (path, value) = split(text, &overriding(format!("--set {text}"), 0, None))?;
        Ok(Self::Set { path, value })
    }

    /// The change that an override asks for: `PATH=VALUE`, `insert PATH=VALUE`, or `unset PATH`.
    ///
    /// # Errors
    /// No `=`, nothing before it, or a value to be unset.
    pub fn read(text: &str) -> Result<Self, ExperimentError> {
        if let Some(entry) = text.strip_prefix(INSERT) {
            return Self::read_insert(entry);
        }
        let Some(path) = text.strip_prefix(UNSET) else { return Self::read_set(text) };
        let source = overriding(text.into(), 0, None);
        match ScenePath::read(path, &source)?.1 {
            Some(_) => Err(source.error("what is unset has no value; write unset section.field")),
            None => Ok(Self::Delete { path: path.trim().into() }),
        }
    }

    /// The change that inserts `PATH=VALUE`.
    ///
    /// # Errors
    /// No `=`, or nothing before it.
    pub fn read_insert(text: &str) -> Result<Self, ExperimentError> {
        let (path, value) = split(text, &overriding(format!("insert {text}"), 0, None))?;
        Ok(Self::Insert { path, value })
    }
}

/// What precedes a path that is taken away, in an override.
const UNSET: &str = "unset ";
/// What precedes an entry that is added to a list.
const INSERT: &str = "insert ";

impl fmt::Display for SceneChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Set { path, value } => write!(f, "--set {path}={value}"),
            Self::Insert { path, value } => write!(f, "insert {path}={value}"),
            Self::Delete { path } => write!(f, "delete {path}"),
        }
    }
}

/// Splits `path=value`.
fn split(text: &str, source: &TextSource) -> Result<(String, String), ExperimentError> {
    match ScenePath::read(text, source)?.1 {
        Some(at) => Ok((text[..at].trim().into(), text[at + 1..].trim().into())),
        None => Err(source.error(
            "there is no `=`; write section.field=value, for instance light.blue.strength.power_mw=20",
        )),
    }
}

/// A source that is no file.
fn overriding(name: String, number: usize, folder: Option<&Path>) -> TextSource {
    TextSource {
        name,
        overriding: Some(Overriding { number, path: Vec::new() }),
        folder: folder.map(Path::to_path_buf),
    }
}

/// What a change comes to on a tree.
#[derive(Clone, Debug, PartialEq)]
enum Edit {
    /// A value at a place, the tables around it included.
    Put { path: Vec<Step>, value: Node },
    /// A new entry at the end of a list.
    Append { list: Vec<Step>, entry: Node },
    /// A place that goes.
    Remove { path: Vec<Step> },
}

/// Applies one change, of a number among all.
///
/// # Errors
/// Paths that name nothing, entries that exist already.
pub(crate) fn apply_change(
    document: &mut Document,
    schema: &Schema,
    number: usize,
    change: &SceneChange,
    base_dir: &Path,
) -> Result<(), ExperimentError> {
    let mut source = overriding(change.to_string(), number, Some(base_dir));
    let index = document.sources.len();
    let plan = Plan { root: &document.root, schema, source: &source, index };
    let (path, edits) = match change {
        SceneChange::Set { path, value } => (path, plan.set(path, value)),
        SceneChange::Insert { path, value } => (path, plan.insert(path, value)),
        SceneChange::Delete { path } => (path, plan.delete(path, "here")),
    };
    let edits = edits.map_err(|error| error.about(path))?;
    // A mistake of what is set is one of the change; of several places, those below the first.
    if let Some(Edit::Put { path, .. }) = edits.last() {
        source.overriding = Some(Overriding { number, path: path.clone() });
    }
    document.sources.push(source);
    edits.iter().for_each(|edit| apply_edit(document, schema, edit));
    Ok(())
}

/// Takes away from the bases below a file what its `unset` names, a list of paths.
///
/// # Errors
/// Something else than a list of texts, paths that name nothing there.
pub(crate) fn apply_unset(
    document: &mut Document,
    schema: &Schema,
    unset: &Node,
) -> Result<(), ExperimentError> {
    let source = document.sources[unset.origin.source].clone();
    let index = unset.origin.source;
    // The list is in no tree any more: its place is put into words here.
    let at_line = |line: usize, value: Option<String>, message: String| {
        let mut error = source.error(message);
        error.0.line = source.has_lines().then_some(line);
        (error.0.field, error.0.value) = (Some("unset".into()), value);
        error.0.path = Some("unset".into());
        error
    };
    let expected = r#"expected a list of paths, for instance ["light.white", "analysis"]"#;
    let Content::Array(items) = &unset.content else {
        return Err(at_line(unset.origin.line, None, expected.into()));
    };
    for item in items {
        let line = item.origin.line;
        let path = item.as_str().ok_or_else(|| at_line(line, None, expected.into()))?;
        let plan = Plan { root: &document.root, schema, source: &source, index };
        let edits = plan.delete(path, "in the base");
        let quoted = toml::Value::String(excerpt(path)).to_string();
        let edits = edits.map_err(|error| at_line(line, Some(quoted), error.details().message.clone()))?;
        edits.iter().for_each(|edit| apply_edit(document, schema, edit));
    }
    Ok(())
}

/// What a person may have meant by a path that leads nowhere: the names beside its first step that is not there.
fn names_beside(root: &Node, path: &[Step]) -> String {
    let mut node = root;
    for step in path {
        match (node.step(step), step, &node.content) {
            (Some(inner), _, _) => node = inner,
            (None, Step::Key(key), Content::Table(entries)) if !entries.is_empty() => {
                let names: Vec<&str> = entries.iter().map(|(name, _)| name.as_str()).collect();
                let known: Vec<String> = names.iter().map(|name| excerpt(name)).collect();
                return format!("{} Known: {}", did_you_mean(key, names.iter().copied()), known.join(", "));
            }
            _ => break,
        }
    }
    String::new()
}

/// Finds out what a change comes to.
struct Plan<'a> {
    root: &'a Node,
    schema: &'a Schema,
    source: &'a TextSource,
    /// Number of the source.
    index: usize,
}

impl Plan<'_> {
    fn path(&self, text: &str) -> Result<ScenePath, ExperimentError> {
        Ok(ScenePath::read(text, self.source)?.0)
    }

    fn find(&self, steps: &[Pattern]) -> Result<Vec<Vec<Step>>, ExperimentError> {
        Finder::new(self.schema, self.source).find(self.root, steps)
    }

    fn value(&self, text: &str) -> Node {
        read_value(text, self.source, self.index)
    }

    fn set(&self, path: &str, value: &str) -> Result<Vec<Edit>, ExperimentError> {
        let ScenePath { part, steps } = self.path(path)?;
        let value = self.value(value);
        let Some(part) = part else {
            let put = |path| Edit::Put { path, value: value.clone() };
            return Ok(self.find(&steps)?.into_iter().map(put).collect());
        };
        let parts = named_parts(self.root, &part, self.source)?;
        match steps.as_slice() {
            [first, rest @ ..] if first.text == "material" && !rest.is_empty() => {
                self.set_in_materials(&part, &parts, rest, &value)
            }
            _ => {
                let put = |path| Edit::Put { path, value: value.clone() };
                Ok(places_of_parts(self, &parts, &steps)?.into_iter().map(put).collect())
            }
        }
    }

    /// Sets a field of the materials of parts. A material that other parts have as well is copied first, so that those stay as
    /// they are.
    fn set_in_materials(
        &self,
        pattern: &Pattern,
        parts: &[ScenePart],
        steps: &[Pattern],
        value: &Node,
    ) -> Result<Vec<Edit>, ExperimentError> {
        let all = scene_parts(self.root).map_err(|message| self.source.error(message))?;
        let within = materials_within_others(self.root);
        let mut edits = Vec::new();
        for name in material_names(parts, self.source)? {
            let (position, material) = self.material(&name)?;
            let is_meant = |part: &ScenePart| parts.iter().any(|other| other.name == part.name);
            let has_others = within.contains(&name)
                || all.iter().any(|part| part.material.as_ref() == Some(&name) && !is_meant(part));
            let mut path = [Step::from("material"), Step::from(position)];
            if has_others {
                let (number, copy) = self.copy(material, &name, pattern, edits.as_slice());
                let called = copy.get("name").cloned();
                path[1] = Step::from(number);
                edits.push(Edit::Append { list: vec![Step::from("material")], entry: copy });
                let of_this = parts.iter().filter(|part| part.material.as_ref() == Some(&name));
                let put = |part: &ScenePart| {
                    called.clone().map(|value| Edit::Put { path: part.material_at.clone(), value })
                };
                edits.extend(of_this.filter_map(put));
            }
            for below in self.below(material, steps)? {
                edits.push(Edit::Put { path: [&path[..], &below[..]].concat(), value: value.clone() });
            }
        }
        Ok(edits)
    }

    /// A material by its name, with its number.
    fn material(&self, name: &str) -> Result<(usize, &Node), ExperimentError> {
        let Some(Content::Array(items)) = self.root.get("material").map(|node| &node.content) else {
            return Err(self.source.error("there are no materials"));
        };
        items.iter().enumerate().find(|(_, item)| item.name() == Some(name)).ok_or_else(|| {
            let hint = did_you_mean(name, items.iter().filter_map(Node::name));
            self.source.error(format!("there is no material \"{}\"{hint}", excerpt(name)))
        })
    }

    /// A copy of a material under the name of the parts that it is for, and its number among the materials after the edits.
    fn copy(&self, material: &Node, name: &str, pattern: &Pattern, edits: &[Edit]) -> (usize, Node) {
        let before = match self.root.get("material").map(|node| &node.content) {
            Some(Content::Array(items)) => items.as_slice(),
            _ => &[],
        };
        let appended = edits.iter().filter(|edit| matches!(edit, Edit::Append { .. })).count();
        let wanted = format!("{name}@{}", pattern.text);
        let is_free = |name: &String| before.iter().all(|item| item.name() != Some(name));
        let numbered = (2_usize..).map(|number| format!("{wanted} {number}"));
        let free = std::iter::once(wanted.clone()).chain(numbered).find(is_free).unwrap_or(wanted);
        let mut copy = material.clone();
        mark(&mut copy, self.origin());
        if let Some(node) = copy.get_mut("name") {
            node.content = Content::Leaf(toml::Value::String(free));
        }
        (before.len() + appended, copy)
    }

    fn origin(&self) -> Origin {
        Origin { source: self.index, line: 1 }
    }

    /// Places below a material that steps name.
    fn below(&self, material: &Node, steps: &[Pattern]) -> Result<Vec<Vec<Step>>, ExperimentError> {
        let origin = self.origin();
        // A tree with this material alone.
        let list = Node { content: Content::Array(vec![material.clone()]), origin };
        let root = Node { content: Content::Table(vec![("material".into(), list)]), origin };
        let mut all = vec![Pattern::plain("material"), Pattern::plain("0")];
        all.extend_from_slice(steps);
        let found = Finder::new(self.schema, self.source).find(&root, &all)?;
        Ok(found.into_iter().map(|path| path[2..].to_vec()).collect())
    }

    fn insert(&self, path: &str, value: &str) -> Result<Vec<Edit>, ExperimentError> {
        let ScenePath { part: None, steps } = self.path(path)? else {
            return Err(self.source.error("what is inserted is no part; write object.NAME={ ... }"));
        };
        let [list @ .., name] = steps.as_slice() else { return Ok(Vec::new()) };
        if list.is_empty() || steps.iter().any(Pattern::is_wild) {
            return Err(self.source.error("write LIST.NAME={ ... }, for instance light.lamp={ ... }"));
        }
        let [list] = self.find(list)?.try_into().unwrap_or_default();
        let mut entry = self.value(value);
        let Content::Table(fields) = &mut entry.content else {
            return Err(self.source.error("an entry is a table; write LIST.NAME={ field = value, ... }"));
        };
        if !self.has_room(&list, &name.text) {
            let message = format!(
                "`{}` is no list, or has an entry \"{}\" already; `set` changes what is there",
                excerpt(&path[..path.len().min(60)]),
                excerpt(&name.text)
            );
            return Err(self.source.error(message));
        }
        fields.retain(|(key, _)| key != "name");
        let content = Content::Leaf(toml::Value::String(name.text.clone()));
        fields.insert(0, ("name".into(), Node { content, origin: self.origin() }));
        Ok(vec![Edit::Append { list, entry }])
    }

    /// Whether there can be another entry of this name: in a list that has none.
    fn has_room(&self, list: &[Step], name: &str) -> bool {
        let node = list.iter().try_fold(self.root, |node, step| node.step(step));
        match node.map(|node| &node.content) {
            Some(Content::Array(items)) => items.iter().all(|item| item.name() != Some(name)),
            None => self.is_list(list),
            Some(_) => false,
        }
    }

    /// Whether a place holds a list by the schema.
    fn is_list(&self, path: &[Step]) -> bool {
        let mut shape = self.schema.root();
        for step in path {
            let Step::Key(key) = step else { return false };
            let Some(inner) = self.schema.table(shape).and_then(|table| table.shape(None, key)) else {
                return false;
            };
            shape = inner;
        }
        self.schema.items(shape).is_some()
    }

    /// Removes what a path names; `source` ends the words "there is no ...".
    fn delete(&self, path: &str, source: &str) -> Result<Vec<Edit>, ExperimentError> {
        let ScenePath { part, steps } = self.path(path)?;
        let mut found = match part {
            None => self.find(&steps)?,
            Some(part) => {
                let parts = named_parts(self.root, &part, self.source)?;
                places_of_parts(self, &parts, &steps)?
            }
        };
        let first = found.first().cloned().unwrap_or_default();
        found.retain(|path| path.iter().try_fold(self.root, |node, step| node.step(step)).is_some());
        if found.is_empty() {
            let beside = names_beside(self.root, &first);
            let message = format!("there is no `{}` {source}{beside}", excerpt(path));
            return Err(self.source.error(message));
        }
        // From the end, so that the numbers of the entries before stay right.
        Ok(found.into_iter().rev().map(|path| Edit::Remove { path }).collect())
    }
}

/// Places of fields of parts in their own sections, and of their materials as wholes.
fn places_of_parts(
    plan: &Plan<'_>,
    parts: &[ScenePart],
    steps: &[Pattern],
) -> Result<Vec<Vec<Step>>, ExperimentError> {
    if let [first] = steps
        && first.text == "material"
    {
        return Ok(parts.iter().map(|part| part.material_at.clone()).collect());
    }
    let mut found = Vec::new();
    for part in parts {
        let Some(section) = &part.section else {
            let message = format!(
                "part \"{}\" follows from the fields of [mouth] and has a material only; write {}/material",
                excerpt(&part.name),
                excerpt(&part.name)
            );
            return Err(plan.source.error(message));
        };
        let fixed = section.iter().map(|step| match step {
            Step::Key(key) => Pattern::plain(key),
            Step::Index(index) => Pattern::plain(&index.to_string()),
        });
        let all: Vec<Pattern> = fixed.chain(steps.iter().cloned()).collect();
        found.extend(plan.find(&all)?);
    }
    Ok(found)
}

/// Names of the materials of parts, each once.
fn material_names(parts: &[ScenePart], source: &TextSource) -> Result<Vec<String>, ExperimentError> {
    let mut names: Vec<String> = Vec::new();
    for part in parts {
        let Some(name) = &part.material else {
            return Err(source.error(format!("part \"{}\" has no material", excerpt(&part.name))));
        };
        if !names.contains(name) {
            names.push(name.clone());
        }
    }
    Ok(names)
}

/// Gives a tree the origin of a change.
fn mark(node: &mut Node, origin: Origin) {
    let folder_stays = matches!(&node.content, Content::Leaf(toml::Value::String(_)));
    match &mut node.content {
        Content::Table(entries) => entries.iter_mut().for_each(|(_, inner)| mark(inner, origin)),
        Content::Array(items) => items.iter_mut().for_each(|inner| mark(inner, origin)),
        Content::Leaf(_) => {}
    }
    // Texts may be paths, which start where they were written.
    if !folder_stays {
        node.origin = origin;
    }
}

fn read_value(text: &str, source: &TextSource, index: usize) -> Node {
    let origin = Origin { source: index, line: 1 };
    let as_string = || Node { content: Content::Leaf(toml::Value::String(text.into())), origin };
    if text.contains('\n') && !text.starts_with(['{', '[', '"', '\'']) {
        return as_string();
    }
    read_tree(&format!("value = {text}"), source, index)
        .ok()
        .filter(|root| matches!(&root.content, Content::Table(entries) if entries.len() == 1))
        .and_then(|mut root| root.take("value"))
        .map_or_else(as_string, |mut node| {
            on_line_one(&mut node, origin);
            node
        })
}

fn on_line_one(node: &mut Node, origin: Origin) {
    node.origin = origin;
    match &mut node.content {
        Content::Table(entries) => entries.iter_mut().for_each(|(_, inner)| on_line_one(inner, origin)),
        Content::Array(items) => items.iter_mut().for_each(|inner| on_line_one(inner, origin)),
        Content::Leaf(_) => {}
    }
}

/// Applies an edit to a tree.
fn apply_edit(document: &mut Document, schema: &Schema, edit: &Edit) {
    let Document { sources, root, .. } = document;
    match edit {
        Edit::Put { path, value } => {
            // Another variant takes the place of what files say about the old one; earlier overrides stay.
            let is_override = |node: &Node| !sources[node.origin.source].has_lines();
            put(schema, Some(schema.root()), root, path, value.clone(), &is_override);
        }
        Edit::Append { list, entry } => {
            let is_there = list.iter().try_fold(&*root, |node, step| node.step(step)).is_some();
            if !is_there {
                let value = Node { content: Content::Array(Vec::new()), origin: entry.origin };
                put(schema, Some(schema.root()), root, list, value, &|_| true);
            }
            if let Some(Content::Array(items)) = inner_mut(root, list).map(|node| &mut node.content) {
                items.push(entry.clone());
            }
        }
        Edit::Remove { path } => {
            if let [around @ .., last] = path.as_slice()
                && let Some(node) = inner_mut(root, around)
            {
                remove(node, last);
            }
        }
    }
}

fn inner_mut<'a>(root: &'a mut Node, path: &[Step]) -> Option<&'a mut Node> {
    path.iter().try_fold(root, |node, step| match (step, &mut node.content) {
        (Step::Key(key), Content::Table(entries)) => {
            entries.iter_mut().find(|(known, _)| known == key).map(|(_, node)| node)
        }
        (Step::Index(index), Content::Array(items)) => items.get_mut(*index),
        _ => None,
    })
}

fn remove(node: &mut Node, step: &Step) {
    match (step, &mut node.content) {
        (Step::Key(key), Content::Table(entries)) => entries.retain(|(known, _)| known != key),
        (Step::Index(index), Content::Array(items)) if *index < items.len() => {
            items.remove(*index);
        }
        _ => {}
    }
}
/// Puts a value at a path, building the tables around it where they do not exist.
fn put(
    schema: &Schema,
    shape: Option<&Shape>,
    node: &mut Node,
    steps: &[Step],
    value: Node,
    keep: &impl Fn(&Node) -> bool,
) {
    match steps {
        [] => *node = value,
        [Step::Index(index), rest @ ..] => {
            if let Content::Array(items) = &mut node.content
                && let Some(item) = items.get_mut(*index)
            {
                put(schema, shape.and_then(|shape| schema.items(shape)), item, rest, value, keep);
            }
        }
        [Step::Key(key), rest @ ..] => {
            // A tree with nothing but this value in it, so that the rules of merging hold for overrides as well.
            let origin = value.origin;
            let in_table = |inner: Node, step: &Step| match step {
                Step::Key(key) => Node { content: Content::Table(vec![(key.clone(), inner)]), origin },
                Step::Index(_) => inner,
            };
            let alone = steps.iter().rev().fold(value.clone(), in_table);
            if !matches!(node.content, Content::Table(_)) {
                *node = alone;
                return;
            }
            let table = shape.and_then(|shape| schema.table(shape));
            if let Some(table) = table {
                make_room(table, node, &alone, keep);
            }
            let variant = table.and_then(|table| match table.variant_of(&alone) {
                Found::Variant(index) => Some(index),
                _ => table.variant_or_default(node),
            });
            let shape = table.and_then(|table| table.shape(variant, key));
            if let (false, Some(inner)) = (rest.is_empty(), node.get_mut(key))
                && !matches!(inner.content, Content::Leaf(_))
            {
                put(schema, shape, inner, rest, value, keep);
                return;
            }
            let value = rest.iter().rev().fold(value, in_table);
            match node.get_mut(key) {
                Some(existing) => *existing = value,
                None => node.insert(key, value),
            }
        }
    }
}
