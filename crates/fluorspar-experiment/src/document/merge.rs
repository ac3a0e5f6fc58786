//! Overriding: an experiment on top of its base, an override on top of both.
//!
//! The types of the schema say how (see `shape.rs`): tables are merged key by key, lists of named entries entry by entry,
//! a table of another variant takes the place of what the old variant had, and everything else is replaced.

use super::shape::{Found, Schema, Shape, Table};
use super::tree::{Content, Node};

/// Puts `over` on top of `under`. An entry of a list with `remove = true` disappears.
pub(crate) fn merge(schema: &Schema, shape: Option<&Shape>, under: &mut Node, over: Node) {
    let is_whole = shape.is_some_and(|shape| schema.is_whole(shape));
    match (&mut under.content, over.content) {
        (Content::Table(_), Content::Table(overrides)) if !is_whole => {
            let over = Node { content: Content::Table(overrides), origin: over.origin };
            merge_tables(schema, shape.and_then(|shape| schema.table(shape)), under, over);
        }
        (Content::Array(items), Content::Array(overrides))
            if !is_whole && is_named(items) && is_named(&overrides) =>
        {
            merge_entries(schema, shape.and_then(|shape| schema.items(shape)), items, overrides);
        }
        (_, content) => *under = Node { content, origin: over.origin },
    }
}

fn merge_tables(schema: &Schema, table: Option<&Table>, under: &mut Node, over: Node) {
    if let Some(table) = table {
        make_room(table, under, &over, |_| false);
    }
    // What an override says last is where its mistakes are looked for.
    under.origin = over.origin;
    let variant = table.and_then(|table| match table.variant_of(&over) {
        Found::Variant(index) => Some(index),
        _ => table.variant_or_default(under),
    });
    let (Content::Table(entries), Content::Table(overrides)) = (&mut under.content, over.content) else {
        return;
    };
    for (key, value) in overrides {
        let shape = table.and_then(|table| table.shape(variant, &key));
        match entries.iter_mut().find(|(k, _)| *k == key) {
            Some((_, existing)) => merge(schema, shape, existing, value),
            None => entries.push((key, value)),
        }
    }
}

fn merge_entries(schema: &Schema, shape: Option<&Shape>, items: &mut Vec<Node>, overrides: Vec<Node>) {
    for entry in overrides {
        let position = items.iter().position(|item| item.name() == entry.name());
        let removed = matches!(
            entry.get("remove").map(|node| &node.content),
            Some(Content::Leaf(toml::Value::Boolean(true)))
        );
        match position {
            Some(index) if removed => {
                items.remove(index);
            }
            Some(index) => merge(schema, shape, &mut items[index], entry),
            None => items.push(entry),
        }
    }
}

fn is_named(items: &[Node]) -> bool {
    !items.is_empty() && items.iter().all(|item| item.name().is_some())
}

/// Removes from a table what the fields of another one take the place of: all but the common fields if it is of another
/// variant, everything if it is another thing altogether, and the fields that one of its own replaces. What is to be kept
/// in any case stays.
pub(crate) fn make_room(table: &Table, under: &mut Node, over: &Node, keep: impl Fn(&Node) -> bool) {
    let is_other_thing = table.identity.as_deref().is_some_and(|identity| {
        let text = |node: &Node| node.get(identity).and_then(Node::as_str).map(String::from);
        text(over).is_some() && text(over) != text(under)
    });
    let is_other_variant = match table.variant_of(over) {
        Found::Variant(index) => table.variant_or_default(under) != Some(index),
        Found::UnknownTag(_) => true,
        Found::Unsaid | Found::Several => false,
    };
    let is_replaced = |key: &str| {
        let given = table.fields.iter().filter(|field| over.get(&field.name).is_some());
        given.flat_map(|field| &field.replaces).any(|other| other == key)
    };
    let is_common = |key: &str| table.fields.iter().any(|field| field.name == key);
    let Content::Table(entries) = &mut under.content else { return };
    entries.retain(|(key, node)| {
        let goes = is_other_thing || (is_other_variant && !is_common(key)) || is_replaced(key);
        !goes || keep(node)
    });
}
