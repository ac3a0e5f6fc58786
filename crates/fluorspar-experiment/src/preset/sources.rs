//! Entries of the catalogue that an experiment names, and where their numbers come from.

use toml::{Table, Value};

use super::catalogue::{names, parse};
use super::kind::{PresetError, PresetKind};

/// An entry of the catalogue that an experiment names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsedPreset {
    /// Its kind.
    pub kind: PresetKind,
    /// Its name.
    pub name: String,
    /// Where its numbers come from: its own source, then those of its parts that say a year.
    pub sources: Vec<String>,
}

/// Kind of the entries that a field names.
fn kind_of(field: &str) -> Option<PresetKind> {
    Some(match field {
        "spectrum" => PresetKind::Light,
        "filters" => PresetKind::Filter,
        "reflectance" => PresetKind::Reflectance,
        "metal" => PresetKind::Metal,
        "glass" => PresetKind::Glass,
        "lens" => PresetKind::Lens,
        "quantum_efficiency" => PresetKind::QuantumEfficiency,
        "site" | "tissue" => PresetKind::Site,
        "state" | "states" => PresetKind::State,
        _ => return None,
    })
}

/// Entries that the fields of a resolved experiment name, and those of its fluorophores, in the order of [`PresetKind::ALL`], by name.
///
/// # Errors
/// When an entry is damaged.
pub fn used_presets<'a>(
    sections: &'a Table,
    fluorophores: impl Iterator<Item = &'a str>,
) -> Result<Vec<UsedPreset>, PresetError> {
    let mut named: Vec<(PresetKind, &str)> =
        fluorophores.map(|name| (PresetKind::Fluorophore, name)).collect();
    each_text(sections, &mut |field, text| named.extend(kind_of(field).map(|kind| (kind, text))));
    let mut found = Vec::new();
    for kind in PresetKind::ALL {
        let known = names(kind);
        let mut of_kind: Vec<&str> = named.iter().filter(|(k, _)| *k == kind).map(|(_, n)| *n).collect();
        of_kind.sort_unstable();
        of_kind.dedup();
        for name in of_kind.into_iter().filter(|name| known.contains(name)) {
            found.push(UsedPreset { kind, name: name.into(), sources: sources(&parse(kind, name)?) });
        }
    }
    Ok(found)
}

/// Every text in a table, however deep, with the field that holds it.
fn each_text<'a>(table: &'a Table, see: &mut impl FnMut(&'a str, &'a str)) {
    fn within<'a>(field: &'a str, value: &'a Value, see: &mut impl FnMut(&'a str, &'a str)) {
        match value {
            Value::String(text) => see(field, text),
            Value::Array(items) => items.iter().for_each(|item| within(field, item, see)),
            Value::Table(table) => each_text(table, see),
            _ => {}
        }
    }
    table.iter().for_each(|(field, value)| within(field, value, see));
}

/// The source of an entry, then those of its parts that say a year.
fn sources(entry: &Table) -> Vec<String> {
    let own = entry.get("source").and_then(Value::as_str).filter(|source| !source.is_empty());
    let mut found: Vec<String> = own.into_iter().map(String::from).collect();
    each_text(entry, &mut |field, text| {
        if field == "source" && says_year(text) && !found.iter().any(|known| known == text) {
            found.push(text.into());
        }
    });
    found
}

/// Whether a text has a year from 1600 to 2099.
fn says_year(text: &str) -> bool {
    let numbers = text.split(|c: char| !c.is_ascii_digit()).filter(|number| number.len() == 4);
    numbers.filter_map(|number| number.parse::<u32>().ok()).any(|year| (1600..2100).contains(&year))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_and_their_sources_are_found_by_the_fields_that_name_them() {
        let text = "title = \"led_405\"\n[[light]]\nname = \"led_405\"\nspectrum = \"led_385\"\nfilters = [\"short_pass_425\"]\n\
                    [[material]]\nname = \"tongue\"\ntissue = \"dorsal_tongue\"\n[[tissue]]\nname = \"own\"\nsite = \"lip\"\n";
        let used = used_presets(&text.parse().unwrap(), ["collagen", "my dye"].into_iter()).unwrap();
        let names: Vec<(PresetKind, &str)> = used.iter().map(|entry| (entry.kind, &*entry.name)).collect();
        let expected = [
            (PresetKind::Light, "led_385"),
            (PresetKind::Filter, "short_pass_425"),
            (PresetKind::Fluorophore, "collagen"),
            (PresetKind::Site, "dorsal_tongue"),
            (PresetKind::Site, "lip"),
        ];
        assert_eq!(names, expected);
        assert!(used[2].sources[0].starts_with("DaCosta"), "{used:?}");
        let of_lip = &used[4].sources;
        assert!(of_lip[0].starts_with("fitted to measured") && of_lip.iter().any(|s| s.contains("Pavlova")));
        assert!(!of_lip.iter().any(|source| source == "capillaries"), "{of_lip:?}");
    }

    #[test]
    fn every_entry_that_experiments_name_says_its_source() {
        for kind in [
            PresetKind::Light,
            PresetKind::Filter,
            PresetKind::Reflectance,
            PresetKind::Fluorophore,
            PresetKind::Site,
        ] {
            for name in names(kind) {
                let entry: Table = parse(kind, name).unwrap();
                assert!(!sources(&entry).is_empty(), "{kind} {name}");
            }
        }
    }
}
