//! View and person of a `[mouth]`: a name for a pose of the mouth and a place of the camera, and a number for its shape, spelled out before
//! files are merged.

use crate::document::tree::{Content, Node, Origin};
use fluorspar_anatomy::{ExaminationView, MouthParameters, POSE_FIELDS, sample_person};

/// The view that a tree names, if there is one of this name.
pub(crate) fn view_of(root: &Node) -> Option<&'static ExaminationView> {
    ExaminationView::find(root.get("mouth")?.get("view")?.as_str()?)
}

/// The number of the person of a tree, if it gives one that can be.
pub(crate) fn person_of(root: &Node) -> Option<u32> {
    match root.get("mouth")?.get("person")?.content {
        Content::Leaf(toml::Value::Integer(number)) => u32::try_from(number).ok(),
        _ => None,
    }
}

/// Spells out person and view that a text names, as far as the text itself says nothing else; `under` is what it is put on top of.
pub(crate) fn spell_out_view(text: &mut Node, under: Option<&Node>) {
    if let Some(person) = person_of(text) {
        let view = view_of(text).or_else(|| view_of(under?));
        put_person(text, sample_person(person), view, false);
    }
    if let Some(view) = view_of(text) {
        let width = lip_width(text).or_else(|| lip_width(under?));
        put(text, view, width, false);
    }
}

/// Puts the shape of the person that an override named in place of the one before; without one the typical shape.
pub(crate) fn change_person(root: &mut Node) {
    let view = view_of(root);
    put_person(root, person_of(root).map(sample_person).unwrap_or_default(), view, true);
}

/// Writes the shape of a person into a tree, over what is there or beside it.
fn put_person(root: &mut Node, mut person: MouthParameters, view: Option<&ExaminationView>, replaces: bool) {
    person.lip_opening_width_mm =
        view.map_or(person.lip_opening_width_mm, |view| view.pose(&person).lip_opening_width_mm);
    let origin = origin_of(root, "person");
    let Ok(toml::Value::Table(fields)) = toml::Value::try_from(&person) else { return };
    for (field, value) in fields.into_iter().filter(|(field, _)| !POSE_FIELDS.contains(&field.as_str())) {
        let content = match value {
            toml::Value::Array(list) => {
                let node = |value| Node { content: Content::Leaf(value), origin };
                Content::Array(list.into_iter().map(node).collect())
            }
            value => Content::Leaf(value),
        };
        put_field(root, "mouth", &field, Node { content, origin }, replaces);
    }
}

/// Where a field of `[mouth]` was written.
fn origin_of(root: &Node, field: &str) -> Origin {
    root.get("mouth").and_then(|mouth| mouth.get(field)).map_or(root.origin, |node| node.origin)
}

fn put_field(root: &mut Node, section: &str, field: &str, value: Node, replaces: bool) {
    if root.get(section).is_none() {
        root.insert(section, Node { content: Content::Table(Vec::new()), origin: value.origin });
    }
    let Some(section) = root.get_mut(section) else { return };
    match section.get_mut(field) {
        Some(_) if !replaces => {}
        Some(there) => *there = value,
        None => section.insert(field, value),
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
    let origin = origin_of(root, "view");
    let node = |content| Node { content, origin };
    let fields = pose.map(|(field, value)| ("mouth", field, number(value))).into_iter();
    let places = camera.map(|(field, place)| {
        ("camera", field, Content::Array(place.map(|value| node(number(value))).to_vec()))
    });
    for (section, field, content) in fields.chain(places) {
        put_field(root, section, field, node(content), replaces);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::schema::MouthSection;
    use crate::{Experiment, parse, resolve, resolve_shapes};
    use fluorspar::scene::Scene;
    use fluorspar_anatomy::sample_person;

    fn read(text: &str, set: &[&str]) -> Experiment {
        let set: Vec<String> = set.iter().map(|text| (*text).to_owned()).collect();
        parse(&format!("format = 1\nbase = \"oraleye-2021\"\n{text}"), "x", Path::new("."), &set).unwrap()
    }

    #[test]
    fn a_person_gives_shape_and_tissues_and_no_pose() {
        let mouth = |text: &str, set: &[&str]| -> MouthSection { read(text, set).file.mouth.unwrap() };
        let (base, person) = (mouth("", &[]), sample_person(7));
        let set = mouth("", &["mouth.person=7"]);
        assert_eq!(set, mouth("[mouth]\nperson = 7\n", &[]));
        assert_eq!(set.parameters.tongue_width_mm.to_bits(), person.tongue_width_mm.to_bits());
        assert_eq!((set.parameters.seed, &set.parameters.missing_teeth), (7, &person.missing_teeth));
        assert_eq!(set.parameters.jaw_opening_mm.to_bits(), base.parameters.jaw_opening_mm.to_bits());
        assert_eq!(set, mouth("[mouth]\nperson = 3\n", &["mouth.person=7"]));
        // What stands beside it changes what it gives; retractors draw the corners of its own mouth apart
        let changed = mouth("", &["mouth.person=7", "mouth.tongue_width_mm=51"]);
        assert_eq!(changed.parameters.tongue_width_mm.to_bits(), 51f64.to_bits());
        let drawn_apart = |set: &[&str]| mouth("", set).parameters.lip_opening_width_mm;
        let apart = drawn_apart(&["mouth.person=7", "mouth.view=right-cheek"]);
        assert!(apart > person.lip_opening_width_mm + 1.0, "{apart}");
        assert!((apart - drawn_apart(&["mouth.view=right-cheek", "mouth.person=7"])).abs() < 1e-9);
        assert_eq!(mouth("[mouth]\nperson = 7\ntongue_width_mm = 51.0\n", &[]), changed);
    }

    #[test]
    fn tissues_and_fillings_of_a_person_are_those_of_mouth_sample() {
        let small = ["mouth.detail=0.25", "spectral.step_nm=40"];
        let set = |more: &'static str| small.into_iter().chain([more]).collect::<Vec<_>>();
        let one = resolve(&read("", &set("mouth.person=7"))).unwrap();
        let mut spelled_out = read("", &set("mouth.person=7"));
        spelled_out.file.mouth.as_mut().unwrap().person = None;
        crate::people::give_tissues_of(7, &mut spelled_out.file).unwrap();
        crate::people::give_restorations_of(7, &mut spelled_out.file);
        let parts =
            |scene: &Scene| -> Vec<String> { scene.objects.iter().map(|one| one.name.clone()).collect() };
        let told = resolve(&spelled_out).unwrap().study;
        assert_eq!((&told.tissues, parts(&told.scene)), (&one.study.tissues, parts(&one.study.scene)));
        let shapes = resolve_shapes(&read("", &set("mouth.person=7"))).unwrap();
        assert!(
            parts(&shapes) == parts(&told.scene)
                && parts(&shapes).iter().any(|name| name.starts_with("restoration_"))
        );
        // What is written of the run draws the same person again
        let again = parse(&one.record.resolved_toml, "again", Path::new("."), &[]).unwrap();
        assert_eq!(resolve(&again).unwrap().study.tissues, one.study.tissues);
        let error = resolve(&read("", &set("mouth.person=0"))).unwrap_err().to_string();
        assert!(error.contains("person") && error.contains("between 1 and 4000000000"), "{error}");
    }
}
