//! Overriding: an experiment on top of its base, an override on top of both.

use super::document::{Content, Node};

/// Keys of one table of which an override replaces all when it gives one.
const ALTERNATIVES: [&[&str]; 10] = [
    &["mesh", "sphere", "quad", "disc", "box"],
    &["power_mw", "irradiance_w_per_m2", "radiance_w_per_sr_m2"],
    &["from", "eem_csv", "csv", "mat", "excitation_csv"],
    &["direction", "look_at_mm"],
    &["read_noise_mv", "read_noise_e"],
    &["dsnu_mv", "dsnu_e"],
    &["dark_voltage_mv_per_s", "dark_current_e_per_s"],
    &["edges_nm", "first_nm"],
    &["bulk", "bulk_material"],
    &["reflectance", "dielectric", "conductor", "mix", "two_sided"],
];
/// Keys that go with an alternative of another name.
const ALSO_REPLACED: [(&str, &[&str]); 14] = [
    (
        "emva1288",
        &[
            "well_capacity_e",
            "voltage_swing_v",
            "conversion_gain_mv_per_e",
            "bit_depth",
            "black_level_dn",
            "read_noise_mv",
            "read_noise_e",
            "post_gain_noise_mv",
            "dsnu_mv",
            "dsnu_e",
            "prnu_percent",
            "dark_voltage_mv_per_s",
            "dark_current_e_per_s",
            "dark_reference_temperature_c",
            "dark_doubling_temperature_k",
            "fill_factor",
            "well_knee",
        ],
    ),
    ("power_mw", &["at_distance_mm"]),
    ("edges_nm", &["last_nm", "step_nm"]),
    ("last_nm", &["edges_nm"]),
    ("step_nm", &["edges_nm"]),
    ("from", &["emission_csv", "unit"]),
    ("metal", &["n", "k"]),
    ("n", &["metal"]),
    ("k", &["metal"]),
    ("dielectric", &["gloss"]),
    ("conductor", &["gloss"]),
    ("mix", &["gloss", "normal_map"]),
    ("two_sided", &["gloss", "normal_map"]),
    // A traced lens in place of an ideal one.
    ("prescription", &["focal_length_mm", "f_number", "vignetting", "transmittance"]),
];
/// Keys whose tables describe one value and are replaced as a whole.
const WHOLE: [&str; 17] = [
    "n",
    "k",
    "opacity",
    "amount",
    "map",
    "spectrum",
    "relative_illumination",
    "transmittance",
    "quantum_efficiency",
    "reflectance",
    "roughness",
    "weight",
    "sphere",
    "quad",
    "disc",
    "box",
    "light_groups",
];

/// Puts `over` on top of `under`: tables are merged key by key, lists of named entries entry by entry, and
/// everything else is replaced. An entry with `remove = true` disappears.
pub(super) fn merge(under: &mut Node, over: Node) {
    merge_at("", under, over);
}

fn merge_at(key: &str, under: &mut Node, over: Node) {
    match (&mut under.content, over.content) {
        (Content::Table(entries), Content::Table(overrides)) if !WHOLE.contains(&key) => {
            // What an override says last is where its mistakes are looked for.
            under.origin = over.origin;
            if key == "sensor" {
                drop_other_sensor(entries, overrides.iter().find(|(inner, _)| inner == "preset"));
            }
            for (inner, _) in &overrides {
                drop_alternatives(entries, inner);
            }
            for (inner, value) in overrides {
                match entries.iter_mut().find(|(k, _)| *k == inner) {
                    // A texture is one value, whatever the fluorophore is called.
                    Some((_, existing)) if key == "concentrations" => *existing = value,
                    Some((_, existing)) => merge_at(&inner, existing, value),
                    None => entries.push((inner, value)),
                }
            }
        }
        (Content::Array(items), Content::Array(overrides))
            if !WHOLE.contains(&key) && is_named(items) && is_named(&overrides) =>
        {
            for entry in overrides {
                let name = entry.name().map(String::from);
                let position = items.iter().position(|item| item.name() == name.as_deref());
                let removed = matches!(
                    entry.get("remove").map(|node| &node.content),
                    Some(Content::Leaf(toml::Value::Boolean(true)))
                );
                match position {
                    Some(index) if removed => {
                        items.remove(index);
                    }
                    Some(index) => merge_at("", &mut items[index], entry),
                    None => items.push(entry),
                }
            }
        }
        (_, content) => *under = Node { content, origin: over.origin },
    }
}

/// Another sensor of the catalogue takes the place of everything that was said about the one below it.
fn drop_other_sensor(entries: &mut Vec<(String, Node)>, preset: Option<&(String, Node)>) {
    let Some((_, preset)) = preset else { return };
    let same = entries.iter().any(|(key, node)| key == "preset" && node.as_str() == preset.as_str());
    if !same {
        entries.clear();
    }
}

/// Gives a key of a table a new value, whatever it was before.
pub(super) fn replace(table: &mut Node, key: &str, value: Node) {
    let Content::Table(entries) = &mut table.content else {
        *table = Node { origin: value.origin, content: Content::Table(vec![(key.into(), value)]) };
        return;
    };
    drop_alternatives(entries, key);
    match entries.iter_mut().find(|(k, _)| k == key) {
        Some((_, existing)) => *existing = value,
        None => entries.push((key.into(), value)),
    }
}

fn is_named(items: &[Node]) -> bool {
    !items.is_empty() && items.iter().all(|item| item.name().is_some())
}

fn drop_alternatives(entries: &mut Vec<(String, Node)>, key: &str) {
    for group in ALTERNATIVES {
        if group.contains(&key) {
            entries.retain(|(other, _)| other == key || !group.contains(&other.as_str()));
        }
    }
    for (trigger, others) in ALSO_REPLACED {
        if trigger == key {
            entries.retain(|(other, _)| !others.contains(&other.as_str()));
        }
    }
}
