//! The shape of a file, read from the types of the schema.
//!
//! The sections derive a JSON schema; it is read once into [`Shape`]s, which know the fields of every table, the variants
//! of every choice and which texts are paths. Everything that handles a file before it becomes typed sections follows
//! them: merging with a base, overrides, anchoring of paths, and the check that explains what does not fit. A new field
//! or variant needs no line in any of these.
//!
//! A type declares what Rust can't express with an extension of its JSON schema, next to its fields:
//!
//! | extension | on | meaning |
//! |---|---|---|
//! | `x-default` | a tagged enum | the variant of a table without its tag |
//! | `x-merge: "replace"` | a type | one value: an override replaces it as a whole |
//! | `x-mutually-exclusive-with` | a field | fields of the same table that can't be given with it; an override removes them |
//! | `x-identity` | a section | field whose new value makes it another thing: nothing of the old one stays |
//! | `x-renamed` | a section | fields that were written otherwise before format 1, and what to write now |
//! | `format: "path"` | a text | path of a file, relative to the file that names it |
//! | `format: "name-or-table-path"`, `"name-or-file-path"` | a text | name of the catalogue, or such a path |

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde_json::Value;

use super::tree::Node;

/// The shapes of one kind of file.
pub(crate) struct Schema {
    root: Shape,
    named: BTreeMap<String, Shape>,
}

/// The allowed values at one place.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Shape {
    /// Whatever TOML can hold.
    Anything,
    Boolean,
    Number,
    /// A whole number between these, ends included.
    Whole([i64; 2]),
    Text(TextKind),
    /// One of these texts.
    Word(Vec<String>),
    List {
        items: Box<Shape>,
        /// How many, where the number is fixed.
        length: Option<usize>,
    },
    Table(Table),
    Either(Either),
    /// A shape of the schema by its name.
    Named(String),
}

/// Meaning of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TextKind {
    Plain,
    /// Path of a file.
    Path,
    /// Name of the catalogue, or path of a table of spectra.
    NameOrTablePath,
    /// Name of the catalogue, or path of a file of a lens or a tissue site.
    NameOrFilePath,
}

/// Values of different types: a number, a name, a list, a table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Either {
    /// The expected value, in words.
    pub(crate) expected: String,
    /// All but the tables.
    pub(crate) values: Vec<Shape>,
    /// Fields of a table.
    pub(crate) table: Option<Table>,
    /// Whether an override replaces it as a whole.
    pub(crate) whole: bool,
}

/// A table: fields that it always may have, and those of one variant.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Table {
    pub(crate) fields: Vec<Field>,
    /// Entries under names that the user chooses.
    pub(crate) rest: Option<Box<Shape>>,
    pub(crate) variants: Vec<Variant>,
    /// Number of the variant of a table that names none.
    pub(crate) default: Option<usize>,
    /// Whether an override replaces it as a whole.
    pub(crate) whole: bool,
    /// Field whose new value makes it another thing.
    pub(crate) identity: Option<String>,
    /// What to write now for fields that were written otherwise before format 1.
    renamed: BTreeMap<String, String>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) shape: Shape,
    pub(crate) required: bool,
    /// What it holds, in words, where that is not all that its type can be.
    pub(crate) expected: Option<String>,
    /// Other fields of the table that it takes the place of.
    pub(crate) replaces: Vec<String>,
}

/// One variant of a choice.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Variant {
    pub(crate) mark: Mark,
    /// Its fields; of a tagged variant without the tag.
    pub(crate) fields: Vec<Field>,
}

/// How a table says which variant it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    /// By the value of a field: `type = "sphere"`.
    Tag { field: String, value: String },
    /// By a field that only it has, and must have: `power_mw`.
    Field(String),
    /// By nothing: any of its fields will do.
    None,
}

/// Which variant a table is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Found<'a> {
    /// The variant of this number.
    Variant(usize),
    /// The table says nothing about it.
    Unsaid,
    /// The tag has a value that no variant has.
    UnknownTag(&'a str),
    /// It has the marks of several variants.
    Several,
}

impl Table {
    /// Field that selects the variant, if it is one field.
    pub(crate) fn tag(&self) -> Option<&str> {
        self.variants.iter().find_map(|variant| match &variant.mark {
            Mark::Tag { field, .. } => Some(field.as_str()),
            _ => None,
        })
    }

    /// What to write for a field that was written otherwise before format 1; the tag `type` was `kind`.
    pub(crate) fn renamed(&self, field: &str) -> Option<&str> {
        let tag = self.tag().filter(|tag| field == "kind" && *tag == "type");
        tag.or_else(|| self.renamed.get(field).map(String::as_str))
    }

    /// Which variant a table says it is.
    pub(crate) fn variant_of<'a>(&'a self, node: &Node) -> Found<'a> {
        let has = |key: &str| node.get(key).is_some();
        if let Some(tag) = self.tag()
            && let Some(given) = node.get(tag)
        {
            let is_given = |variant: &Variant| match &variant.mark {
                Mark::Tag { field, value } => field == tag && given.as_str() == Some(value),
                _ => false,
            };
            return match self.variants.iter().position(is_given) {
                Some(index) => Found::Variant(index),
                None => Found::UnknownTag(tag),
            };
        }
        let marked = |variant: &Variant| matches!(&variant.mark, Mark::Field(key) if has(key));
        let mut marks = (0..self.variants.len()).filter(|index| marked(&self.variants[*index]));
        match (marks.next(), marks.next()) {
            (Some(index), None) => return Found::Variant(index),
            (Some(_), Some(_)) => return Found::Several,
            _ => {}
        }
        let unmarked = |variant: &Variant| {
            variant.mark == Mark::None && variant.fields.iter().any(|field| has(&field.name))
        };
        self.variants.iter().position(unmarked).map_or(Found::Unsaid, Found::Variant)
    }

    /// The variant of a complete table: what it says, or the default.
    pub(crate) fn variant_or_default(&self, node: &Node) -> Option<usize> {
        match self.variant_of(node) {
            Found::Variant(index) => Some(index),
            Found::Unsaid => self.default,
            Found::UnknownTag(_) | Found::Several => None,
        }
    }

    /// A field of a variant, or of all.
    pub(crate) fn field(&self, variant: Option<usize>, name: &str) -> Option<&Field> {
        self.fields_of(variant).find(|field| field.name == name)
    }

    /// The fields of a variant, those that all have first.
    pub(crate) fn fields_of(&self, variant: Option<usize>) -> impl Iterator<Item = &Field> {
        let of_variant = variant.and_then(|index| self.variants.get(index));
        self.fields.iter().chain(of_variant.into_iter().flat_map(|variant| &variant.fields))
    }

    /// Shape of the value under a key.
    pub(crate) fn shape(&self, variant: Option<usize>, key: &str) -> Option<&Shape> {
        self.field(variant, key).map(|field| &field.shape).or(self.rest.as_deref())
    }
}

impl Schema {
    /// The shapes of a type.
    pub(crate) fn of<T: JsonSchema>() -> Self {
        let root = schemars::schema_for!(T).to_value();
        let empty = serde_json::Map::new();
        let definitions = root.get("$defs").and_then(Value::as_object).unwrap_or(&empty);
        let reader = SchemaReader { definitions };
        let named = definitions.iter().map(|(name, value)| (name.clone(), reader.shape(value))).collect();
        Self { root: reader.shape(&root), named }
    }

    /// The shape of a whole file.
    pub(crate) fn root(&self) -> &Shape {
        &self.root
    }

    /// The shape that a name refers to.
    pub(crate) fn resolve<'a>(&'a self, shape: &'a Shape) -> &'a Shape {
        match shape {
            Shape::Named(name) => self.named.get(name).map_or(&Shape::Anything, |shape| self.resolve(shape)),
            _ => shape,
        }
    }

    /// Fields of a table of this shape.
    pub(crate) fn table<'a>(&'a self, shape: &'a Shape) -> Option<&'a Table> {
        match self.resolve(shape) {
            Shape::Table(table) => Some(table),
            Shape::Either(either) => either.table.as_ref(),
            _ => None,
        }
    }

    /// Shape of the entries of a list of this shape.
    pub(crate) fn items<'a>(&'a self, shape: &'a Shape) -> Option<&'a Shape> {
        match self.resolve(shape) {
            Shape::List { items, .. } => Some(items),
            Shape::Either(either) => either.values.iter().find_map(|value| self.items(value)),
            _ => None,
        }
    }

    /// Whether an override replaces the value as a whole.
    pub(crate) fn is_whole(&self, shape: &Shape) -> bool {
        match self.resolve(shape) {
            Shape::Table(table) => table.whole,
            Shape::Either(either) => either.whole,
            _ => false,
        }
    }
}

/// Reads shapes from JSON schemas.
struct SchemaReader<'a> {
    definitions: &'a serde_json::Map<String, Value>,
}

/// A part of a JSON schema, null if there is none.
fn part<'v>(value: &'v Value, key: &str) -> &'v Value {
    value.get(key).unwrap_or(&Value::Null)
}

/// Items of a list of a JSON schema.
fn list<'v>(value: &'v Value, key: &str) -> impl Iterator<Item = &'v Value> {
    part(value, key).as_array().into_iter().flatten()
}

fn texts(value: &Value, key: &str) -> Vec<String> {
    list(value, key).filter_map(Value::as_str).map(String::from).collect()
}

impl SchemaReader<'_> {
    fn shape(&self, value: &Value) -> Shape {
        if let Some(name) = reference(value)
            && value.get("properties").is_none()
        {
            return Shape::Named(name.into());
        }
        if let Some(words) = words(value) {
            return Shape::Word(words);
        }
        if value.get("properties").is_some() {
            return Shape::Table(self.table(value));
        }
        let alternatives = self.alternatives(value);
        match alternatives.as_slice() {
            [] => self.plain(value),
            // An optional value.
            [only] => self.shape(only),
            _ => self.either(value, &alternatives),
        }
    }

    /// The entries of `anyOf` and `oneOf`, without null.
    fn alternatives<'v>(&'v self, value: &'v Value) -> Vec<&'v Value> {
        let is_null = |v: &Value| part(v, "type").as_str() == Some("null");
        list(value, "anyOf").chain(list(value, "oneOf")).filter(|v| !is_null(v)).collect()
    }

    /// A value without alternatives.
    fn plain(&self, value: &Value) -> Shape {
        let kind = match part(value, "type") {
            Value::String(kind) => kind.as_str(),
            Value::Array(kinds) => {
                kinds.iter().filter_map(Value::as_str).find(|k| *k != "null").unwrap_or("")
            }
            _ => "",
        };
        match kind {
            "boolean" => Shape::Boolean,
            "number" => Shape::Number,
            "integer" => Shape::Whole(whole_range(value)),
            "string" => Shape::Text(match part(value, "format").as_str() {
                Some("path") => TextKind::Path,
                Some("name-or-table-path") => TextKind::NameOrTablePath,
                Some("name-or-file-path") => TextKind::NameOrFilePath,
                _ => TextKind::Plain,
            }),
            "array" => self.list(value),
            "object" => Shape::Table(self.table(value)),
            _ => Shape::Anything,
        }
    }

    fn list(&self, value: &Value) -> Shape {
        let length = |key: &str| part(value, key).as_u64();
        let fixed = length("minItems").filter(|least| length("maxItems") == Some(*least));
        let items = Box::new(self.shape(part(value, "items")));
        Shape::List { items, length: fixed.map(|length| length as usize) }
    }

    /// Values of different types.
    fn either(&self, value: &Value, alternatives: &[&Value]) -> Shape {
        let whole = is_whole(value);
        let mut flat = Vec::new();
        alternatives.iter().for_each(|alternative| self.flatten(alternative, &mut flat));
        let is_table = |v: &&Value| part(v, "type").as_str() == Some("object");
        let (tables, values): (Vec<&Value>, Vec<&Value>) = flat.into_iter().partition(is_table);
        let table = match tables.as_slice() {
            [] => None,
            [only] => Some(self.table(only)),
            _ => Some(self.choice(value, &tables)),
        };
        if values.is_empty()
            && let Some(table) = table
        {
            return Shape::Table(Table { whole: whole || table.whole, ..table });
        }
        let description = part(value, "description").as_str().unwrap_or_default();
        Shape::Either(Either {
            expected: in_a_sentence(description),
            values: values.into_iter().map(|value| self.shape(value)).collect(),
            table,
            whole,
        })
    }

    /// The alternatives of an alternative.
    fn flatten<'v>(&'v self, value: &'v Value, into: &mut Vec<&'v Value>) {
        if let Some(definition) = reference(value).and_then(|name| self.definitions.get(name)) {
            return self.flatten(definition, into);
        }
        let inner = if value.get("properties").is_some() { Vec::new() } else { self.alternatives(value) };
        if inner.is_empty() || words(value).is_some() {
            into.push(value);
        } else {
            inner.into_iter().for_each(|value| self.flatten(value, into));
        }
    }

    /// A table, with its variants if it has any.
    fn table(&self, value: &Value) -> Table {
        let mut alternatives = Vec::new();
        self.alternatives(value).into_iter().for_each(|inner| self.flatten(inner, &mut alternatives));
        let mut table = self.choice(value, &alternatives);
        if let Some(definition) = reference(value).and_then(|name| self.definitions.get(name)) {
            table.fields.extend(self.table(definition).fields);
        }
        table.fields.extend(self.fields(value));
        let rest = part(value, "additionalProperties");
        table.rest = rest.is_object().then(|| Box::new(self.shape(rest)));
        let renamed = part(value, "x-renamed").as_object().into_iter().flatten();
        table.renamed =
            renamed.filter_map(|(old, now)| Some((old.clone(), now.as_str()?.to_string()))).collect();
        table.identity = part(value, "x-identity").as_str().map(String::from);
        table
    }

    /// The variants of a choice.
    fn choice(&self, value: &Value, alternatives: &[&Value]) -> Table {
        let variants: Vec<Variant> = alternatives.iter().map(|variant| self.variant(variant)).collect();
        let default = part(value, "x-default").as_str();
        let is_default = |variant: &Variant| match &variant.mark {
            Mark::Tag { value, .. } => Some(value.as_str()) == default,
            Mark::Field(_) => false,
            Mark::None => true,
        };
        let mut rests = alternatives.iter().map(|variant| part(variant, "additionalProperties"));
        Table {
            default: variants.iter().position(is_default),
            rest: rests.find(|rest| rest.is_object()).map(|rest| Box::new(self.shape(rest))),
            variants,
            whole: is_whole(value),
            ..Table::default()
        }
    }

    fn variant(&self, value: &Value) -> Variant {
        let properties = part(value, "properties").as_object().into_iter().flatten();
        let constant = |v: &Value| part(v, "const").as_str().map(String::from);
        let tag = properties
            .filter_map(|(field, v)| Some(Mark::Tag { field: field.clone(), value: constant(v)? }))
            .next();
        let mut fields = self.table(value).fields;
        if let Some(Mark::Tag { field: tag, .. }) = &tag {
            fields.retain(|field| field.name != *tag);
        }
        let by_field =
            || fields.iter().find(|field| field.required).map(|field| Mark::Field(field.name.clone()));
        let mark = tag.or_else(by_field).unwrap_or(Mark::None);
        Variant { mark, fields }
    }

    fn fields(&self, value: &Value) -> Vec<Field> {
        let required = texts(value, "required");
        let properties = part(value, "properties").as_object().into_iter().flatten();
        properties
            .map(|(name, value)| Field {
                name: name.clone(),
                shape: self.shape(value),
                required: required.contains(name),
                expected: part(value, "x-expected").as_str().map(String::from),
                replaces: texts(value, "x-mutually-exclusive-with"),
            })
            .collect()
    }
}

fn is_whole(value: &Value) -> bool {
    part(value, "x-merge").as_str() == Some("replace")
}

/// Name of the definition that a schema refers to.
fn reference(value: &Value) -> Option<&str> {
    part(value, "$ref").as_str()?.strip_prefix("#/$defs/")
}

/// The texts of an enum without data.
fn words(value: &Value) -> Option<Vec<String>> {
    if let Some(word) = part(value, "const").as_str() {
        return Some(vec![word.into()]);
    }
    if value.get("enum").is_some() {
        return Some(texts(value, "enum"));
    }
    let mut variants = list(value, "oneOf").peekable();
    variants.peek()?;
    let words: Option<Vec<Vec<String>>> = variants.map(words).collect();
    words.map(|words| words.concat())
}

/// The whole numbers that a field takes: those that are stated, otherwise those that its type holds.
fn whole_range(value: &Value) -> [i64; 2] {
    let of_type = match part(value, "format").as_str() {
        Some("uint8") => i64::from(u8::MAX),
        Some("uint16") => i64::from(u16::MAX),
        Some("uint32") => i64::from(u32::MAX),
        Some("int8") => i64::from(i8::MAX),
        _ => i64::MAX,
    };
    let most = part(value, "maximum").as_i64().unwrap_or(of_type);
    let least = match part(value, "format").as_str() {
        Some("int8") => i64::from(i8::MIN),
        _ => part(value, "minimum").as_i64().unwrap_or(i64::MIN),
    };
    [least, most]
}

/// A description as a part of a sentence: `A spectrum: a number, ....` becomes `a spectrum: a number, ...`.
fn in_a_sentence(description: &str) -> String {
    let text = description.split("\n\n").next().unwrap_or_default().replace('\n', " ");
    let text = text.trim().trim_end_matches('.');
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}
