//! What two experiments set differently, by path.

use std::path::Path;

use fluorspar_format::read_toml;
use serde::Serialize;
use toml::{Table, Value};

use super::error::step_text;
use super::preset::{self, PresetKind};
use super::resolve::device;
use super::schema::SensorSection;
use super::{Experiment, SensorFile, parse_sensor};

/// A setting that two experiments do not share.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SettingDifference {
    /// Its path, as `--set` takes it.
    pub path: String,
    /// Unit of its numbers, as its name tells; empty for a pure number and for text.
    pub unit: &'static str,
    /// Its value in the first experiment, with defaults; `None` where it is not there.
    pub a: Option<Value>,
    /// Its value in the second one.
    pub b: Option<Value>,
}

/// Names for people: no setting changes with them.
const TEXTS: [&str; 2] = ["title", "description"];

/// Ends of the names of fields and their units, longer ends first. Names are what binds: every field carries its unit in its name, and its
/// description says it in a sentence, which differs from field to field. A test holds each description of the schema to this table.
const UNITS: [(&str, &str); 38] = [
    ("_w_per_sr_m2_nm", "W/(sr m² nm)"),
    ("_w_per_sr_m2", "W/(sr m²)"),
    ("_w_per_m2", "W/m²"),
    ("_umol_per_l", "µmol/l"),
    ("_g_per_l", "g/l"),
    ("_e_per_dn", "e-/DN"),
    ("_dn_per_e", "DN/e-"),
    ("_mv_per_e", "mV/e-"),
    ("_mv_per_s", "mV/s"),
    ("_e_per_s", "e-/s"),
    ("_px_per_s", "px/s"),
    ("_per_million", "per million"),
    ("_per_mm", "1/mm"),
    ("_per_cm", "1/cm"),
    ("_per_nm", "1/nm"),
    ("_percent", "%"),
    ("_deg", "degrees"),
    ("_gib", "GiB"),
    ("_db", "dB"),
    ("_dn", "DN"),
    ("_ev", "EV"),
    ("_hz", "Hz"),
    ("_mm", "mm"),
    ("_ms", "ms"),
    ("_mv", "mV"),
    ("_mw", "mW"),
    ("_nm", "nm"),
    ("_px", "px"),
    ("_um", "µm"),
    ("_us", "µs"),
    ("_c", "°C"),
    ("_e", "e-"),
    ("_k", "K"),
    ("_s", "s"),
    ("_v", "V"),
    ("columns", "px"),
    ("rows", "px"),
    ("bit_depth", "bits"),
];

/// The unit of a field by its name.
fn unit_of(field: &str) -> &'static str {
    UNITS.iter().find(|(end, _)| field.ends_with(end)).map_or("", |(_, unit)| unit)
}

/// What two experiments set differently, defaults included, in the order of the first one: entries of lists are the same where they have
/// the same name. Titles and descriptions are left out. Empty where both set the same.
#[must_use]
pub fn setting_differences(a: &Experiment, b: &Experiment) -> Vec<SettingDifference> {
    let names = [a, b].map(sensor_name);
    // A sensor without a name is told by its fields alone: one of the catalogue with another number in one is no other sensor
    let are_named = names.iter().all(Option::is_some);
    let complete = |experiment: &Experiment, name: Option<String>| {
        let mut file = Value::try_from(&experiment.file).ok()?;
        if let (Some(name), Some(sensor)) = (name.filter(|_| are_named), file.get_mut("sensor")) {
            name_first(sensor, &name);
        }
        Some(file)
    };
    let mut found = Vec::new();
    let [of_a, of_b] = names;
    let (a, b) = (complete(a, of_a), complete(b, of_b));
    differences(String::new(), "", (a.as_ref(), b.as_ref()), &mut found);
    found.retain(|difference| !TEXTS.contains(&difference.path.as_str()));
    found
}

/// The sensor of the catalogue whose fields an experiment has, whatever its number of pixels. Experiments are read with the fields of a
/// sensor and without its name, which is what people call it by.
fn sensor_name(experiment: &Experiment) -> Option<String> {
    let fields = |section: &SensorSection| {
        let filled = SensorSection { model: device::filled(&section.model), ..section.clone() };
        let mut value = Value::try_from(filled).ok()?;
        let table = value.as_table_mut()?;
        for size in ["columns", "rows"] {
            table.remove(size);
        }
        Some(value)
    };
    let wanted = fields(experiment.file.sensor.as_ref()?)?;
    let is_it = |name: &&str| {
        let text = preset::text(PresetKind::Sensor, name).ok();
        let read = text.and_then(|text| parse_sensor(text, name, Path::new("."), &[]).ok());
        let file = read.and_then(|read| read_toml::<SensorFile>(&read.resolved_toml).ok());
        file.and_then(|file| fields(&file.sensor)).is_some_and(|found| found == wanted)
    };
    preset::names(PresetKind::Sensor).into_iter().find(is_it).map(String::from)
}

/// Puts the name of a sensor before its fields.
fn name_first(sensor: &mut Value, name: &str) {
    if let Some(fields) = sensor.as_table_mut() {
        let mut named = Table::new();
        named.insert("preset".into(), Value::String(name.into()));
        named.extend(std::mem::take(fields));
        *fields = named;
    }
}

/// Adds what differs at a path and below it. `field` is the name of the last field on the way.
fn differences(
    path: String,
    field: &str,
    (a, b): (Option<&Value>, Option<&Value>),
    found: &mut Vec<SettingDifference>,
) {
    if a == b {
        return;
    }
    let inside = |step: String| if path.is_empty() { step } else { format!("{path}.{step}") };
    match (a, b) {
        (Some(Value::Table(of_a)), Some(Value::Table(of_b))) => {
            let only_b = of_b.keys().filter(|key| !of_a.contains_key(*key));
            for key in of_a.keys().chain(only_b) {
                differences(inside(step_text(key)), key, (of_a.get(key), of_b.get(key)), found);
            }
        }
        (Some(Value::Array(of_a)), Some(Value::Array(of_b)))
            if of_a.iter().chain(of_b).all(|entry| name(entry).is_some()) =>
        {
            let entry = |list: &[Value], wanted: &str| list.iter().position(|e| name(e) == Some(wanted));
            let only_b = of_b.iter().filter(|e| name(e).is_none_or(|n| entry(of_a, n).is_none()));
            for wanted in of_a.iter().chain(only_b).filter_map(name) {
                let at = |list: &'_ [Value]| entry(list, wanted);
                let pair = (at(of_a).map(|k| &of_a[k]), at(of_b).map(|k| &of_b[k]));
                differences(inside(step_text(wanted)), field, pair, found);
            }
        }
        (Some(Value::Array(of_a)), Some(Value::Array(of_b)))
            if of_a.len() == of_b.len() && of_a.iter().chain(of_b).all(Value::is_table) =>
        {
            for (index, pair) in of_a.iter().zip(of_b).enumerate() {
                let pair = (Some(pair.0), Some(pair.1));
                differences(format!("{path}[{index}]"), field, pair, found);
            }
        }
        _ => found.push(SettingDifference { path, unit: unit_of(field), a: a.cloned(), b: b.cloned() }),
    }
}

/// The name of an entry of a list.
fn name(entry: &Value) -> Option<&str> {
    entry.get("name")?.as_str()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::parse;

    fn patch(changes: &[&str]) -> Experiment {
        let changes: Vec<String> = changes.iter().map(|change| change.to_string()).collect();
        parse("format = 1\nbase = \"flat-patch\"", "patch", Path::new("."), &changes).unwrap()
    }

    #[test]
    fn only_what_differs_is_told_by_path_with_its_unit() {
        let a = patch(&["title=first"]);
        let b = patch(&["capture.blue.exposure_ms=60", "light.blue.spectrum=led_405", "title=second"]);
        let found = setting_differences(&a, &b);
        let told: Vec<(&str, &str)> = found.iter().map(|d| (d.path.as_str(), d.unit)).collect();
        assert_eq!(told, [("light.blue.spectrum", ""), ("capture.blue.exposure_ms", "ms")]);
        assert_eq!(found[1].a, Some(Value::Float(30.0)));
        assert_eq!(found[1].b, Some(Value::Float(60.0)));
        assert_eq!(setting_differences(&a, &a), []);
    }

    #[test]
    fn sensors_of_the_catalogue_are_told_by_name() {
        let (a, b) = (patch(&[]), patch(&["sensor.preset=monochrome_3_45um", "sensor.columns=64"]));
        let found = setting_differences(&a, &b);
        assert_eq!(found[0].path, "sensor.preset");
        assert_eq!(found[0].b, Some(Value::String("monochrome_3_45um".into())));
        // A sensor of which one number is another has no name
        let changed = patch(&["sensor.preset=monochrome_3_45um", "sensor.read_noise_e=5"]);
        assert_eq!(sensor_name(&changed), None);
        // Nor is it another sensor
        let found = setting_differences(&a, &patch(&["sensor.prnu_percent=3"]));
        assert!(matches!(&found[..], [only] if only.path == "sensor.prnu_percent"), "{found:?}");
        assert_eq!(
            sensor_name(&patch(&["sensor.preset=lyu_2021_table_1"])).as_deref(),
            Some("lyu_2021_table_1")
        );
    }

    #[test]
    fn an_entry_that_is_only_there_once_is_one_difference() {
        let a = patch(&[]);
        let fewer = patch(&["unset capture.blue.subtract", "unset capture.ambient"]);
        let found = setting_differences(&a, &fewer);
        let ambient: Vec<_> = found.iter().filter(|d| d.path.starts_with("capture.ambient")).collect();
        assert!(
            matches!(ambient[..], [only] if only.path == "capture.ambient" && only.b.is_none()),
            "{found:?}"
        );
        // The other way round the sides are swapped
        let swapped = setting_differences(&fewer, &a);
        assert_eq!(swapped.len(), found.len());
        assert!(swapped.iter().any(|d| d.path == "capture.ambient" && d.a.is_none()), "{swapped:?}");
    }

    #[test]
    fn units_are_those_of_the_longest_end() {
        let of = |field| unit_of(field);
        assert_eq!(of("exposure_ms"), "ms");
        assert_eq!(of("irradiance_w_per_m2"), "W/m²");
        assert_eq!(of("dark_current_e_per_s"), "e-/s");
        assert_eq!(of("read_noise_e"), "e-");
        assert_eq!(of("spectrum"), "");
    }

    /// Fields of numbers of a JSON schema and their descriptions.
    fn numbers(schema: &serde_json::Value, found: &mut Vec<(String, String)>) {
        fn is_number(value: &serde_json::Value) -> bool {
            let is_one = |kind: &str| kind == "number" || kind == "integer";
            let kinds = match &value["type"] {
                serde_json::Value::Array(kinds) => kinds.iter().any(|kind| kind.as_str().is_some_and(is_one)),
                kind => kind.as_str().is_some_and(is_one),
            };
            let alternatives = ["anyOf", "oneOf"].iter().filter_map(|key| value[*key].as_array()).flatten();
            kinds || alternatives.into_iter().any(is_number) || value.get("items").is_some_and(is_number)
        }
        match schema {
            serde_json::Value::Object(entries) => {
                for (name, field) in schema["properties"].as_object().into_iter().flatten() {
                    if is_number(field) {
                        let text = field["description"].as_str().unwrap_or_default();
                        found.push((name.clone(), text.replace('\n', " ")));
                    }
                }
                entries.values().for_each(|inner| numbers(inner, found));
            }
            serde_json::Value::Array(items) => items.iter().for_each(|inner| numbers(inner, found)),
            _ => {}
        }
    }

    /// How descriptions say a unit, where not by its symbol.
    const IN_WORDS: [(&str, &[&str]); 12] = [
        ("px", &["pixels", "Pixels", "Columns", "Rows", "column, row"]),
        ("µm", &["um"]),
        ("µs", &["us"]),
        ("µmol/l", &["umol/l"]),
        ("px/s", &["pixels of the sensor per second"]),
        ("g/l", &["g/L"]),
        ("%", &["percent"]),
        ("EV", &["stops"]),
        ("°C", &["degrees Celsius"]),
        ("s", &["Seconds"]),
        ("DN", &["Digital number"]),
        ("e-", &["Electrons"]),
    ];

    /// The names of fields and what the schema says of them tell the same unit: a new unit comes into the table, and one that no field has
    /// leaves it.
    #[test]
    fn units_are_those_of_the_schema() {
        let mut fields = Vec::new();
        numbers(&schemars::schema_for!(crate::schema::ExperimentFile).to_value(), &mut fields);
        assert!(fields.len() > 150, "{}", fields.len());
        let is_of_a_word = |c: char| c.is_alphanumeric() || "_/²".contains(c);
        // Places of a word by itself
        let places = |text: &str, word: &str| -> Vec<usize> {
            let is_alone = |at: &usize| {
                let ends = [text[..*at].chars().next_back(), text[at + word.len()..].chars().next()];
                !ends.into_iter().flatten().any(is_of_a_word)
            };
            text.match_indices(word).map(|(at, _)| at).filter(is_alone).collect()
        };
        let says = |text: &str, unit: &str| {
            let words = IN_WORDS.iter().find(|(other, _)| *other == unit).map_or(&[][..], |(_, words)| words);
            std::iter::once(&unit).chain(words).any(|word| !places(text, word).is_empty())
        };
        // Bits and millionths are no physical units: texts hold these words for other reasons
        let physical =
            ["mm", "nm", "µm", "ms", "mV", "mW", "W/m²", "degrees", "Hz", "K", "GiB", "1/mm", "1/cm"];
        for (name, text) in &fields {
            let unit = unit_of(name);
            if unit.is_empty() {
                // As the unit of the field: ", mm" or "in mm", not "at 500 nm"
                let is_told = |unit: &&&str| {
                    let before = |at: &usize| text[..*at].ends_with(", ") || text[..*at].ends_with(" in ");
                    places(text, unit).iter().any(before)
                };
                // The last column of a matrix has a unit, the others have none
                let untold = physical.iter().find(is_told).filter(|_| name != "matrix");
                assert!(
                    untold.is_none(),
                    "{name} has no unit in its name, and its description says {untold:?}: {text}"
                );
            } else if !["per million", "bits"].contains(&unit) {
                assert!(
                    says(text, unit),
                    "{name} is in {unit} by its name, but not by its description: {text}"
                );
            }
        }
        for (end, unit) in UNITS {
            let of_end = |name: &str| UNITS.iter().find(|(end, _)| name.ends_with(end)) == Some(&(end, unit));
            assert!(fields.iter().any(|(name, _)| of_end(name)), "no field ends in {end}");
        }
    }
}
