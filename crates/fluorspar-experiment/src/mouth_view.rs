//! The view of a `[mouth]`: a name for a pose of the mouth and a place of the camera, spelled out before files are merged.

use crate::document::tree::{Content, Node};
use fluorspar_anatomy::{ExaminationView, MouthParameters};

/// The view that a tree names, if there is one of this name.
pub(crate) fn view_of(root: &Node) -> Option<&'static ExaminationView> {
    ExaminationView::find(root.get("mouth")?.get("view")?.as_str()?)
}

/// Spells out the view that a text names, as far as the text itself says nothing else; `under` is what it is put on top of.
pub(crate) fn spell_out_view(text: &mut Node, under: Option<&Node>) {
    if let Some(view) = view_of(text) {
        let width = lip_width(text).or_else(|| lip_width(under?));
        put(text, view, width, false);
    }
}

/// Puts the view that an override named in place of the one before.
pub(crate) fn change_view(root: &mut Node, before: Option<&ExaminationView>) {
    if let Some(view) = view_of(root) {
        let drawn_apart = before.map_or(0.0, |view| view.corner_retraction_mm);
        let width = lip_width(root).map(|width| width - drawn_apart);
        put(root, view, width, true);
    }
}

/// Distance between the corners of the mouth, mm.
fn lip_width(root: &Node) -> Option<f64> {
    match root.get("mouth")?.get("lip_opening_width_mm")?.content {
        Content::Leaf(toml::Value::Float(width)) => Some(width),
        Content::Leaf(toml::Value::Integer(width)) => Some(width as f64),
        _ => None,
    }
}

/// Writes pose and camera of a view into a tree, over what is there or beside it.
fn put(root: &mut Node, view: &ExaminationView, lip_width_mm: Option<f64>, replaces: bool) {
    let mut person = MouthParameters::default();
    person.lip_opening_width_mm = lip_width_mm.unwrap_or(person.lip_opening_width_mm);
    let pose = view.pose(&person);
    let pose = [
        ("jaw_opening_mm", pose.jaw_opening_mm),
        ("tongue_protrusion_mm", pose.tongue_protrusion_mm),
        ("tongue_shift_mm", pose.tongue_shift_mm),
        ("tongue_elevation_mm", pose.tongue_elevation_mm),
        ("tongue_curl", pose.tongue_curl),
        ("lip_retraction_mm", pose.lip_retraction_mm),
        ("lip_opening_width_mm", pose.lip_opening_width_mm),
    ];
    let camera = [("position_mm", view.camera_mm), ("look_at_mm", view.look_at_mm)];
    let number = |value: f64| Content::Leaf(toml::Value::Float(value));
    let origin =
        root.get("mouth").and_then(|mouth| mouth.get("view")).map_or(root.origin, |view| view.origin);
    let node = |content| Node { content, origin };
    let fields = pose.map(|(field, value)| ("mouth", field, number(value))).into_iter();
    let places = camera.map(|(field, place)| {
        ("camera", field, Content::Array(place.map(|value| node(number(value))).to_vec()))
    });
    for (section, field, content) in fields.chain(places) {
        if root.get(section).is_none() {
            root.insert(section, node(Content::Table(Vec::new())));
        }
        let Some(section) = root.get_mut(section) else { continue };
        match section.get_mut(field) {
            Some(_) if !replaces => {}
            Some(there) => *there = node(content),
            None => section.insert(field, node(content)),
        }
    }
}
