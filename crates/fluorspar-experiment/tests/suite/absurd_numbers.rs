//! Every number of every built-in experiment and sample, and of a file with the fields that those leave out, is set to
//! 1e99 and -1e99 in turn (whole numbers to the largest one): each is refused with its name and what is allowed, in numbers
//! that can be read, or is known to be fine.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::collections::BTreeSet;
use std::path::Path;

use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{is_sample, parse, parse_sample, resolve};
use toml::{Table, Value};

/// Fields that the built-in experiments leave at their defaults.
const RARE_FIELDS: &str = r#"
format = 1
base = "flat-patch"
[render]
time_limit_s = 100.0
relative_error = 0.02
error_range_nm = [500.0, 700.0]
[view_filter]
effective_index = 1.8
autofluorescence = { photon_yield = 1e-6, spectrum = "led_450" }
[sensor]
aperture_um = 1.0
relative_illumination = { all = [-0.1] }
crosstalk = { optical_side_percent = 0.5, electrical_side_percent = [[400.0, 0.5], [700.0, 1.0]] }
shutter = { type = "rolling", row_time_us = 20.0 }
strobe = { delay_ms = 1.0, duration_ms = 5.0, frequency_hz = 1000.0, duty = 0.5 }
binning = { type = "charge", columns = 2, rows = 2, well_capacity_e = 20000.0 }
[motion]
drift_px_per_s = [1.0, 2.0]
jitter_px = 0.5
interval_ms = 30.0
[develop]
dark_frames = 4
bad_pixel_sigma = 8.0
flat_field = { frames = 4, level = 0.5, spectrum = "equal_energy" }
[[spectroradiometer]]
name = "spot"
capture = "blue"
aim = [0.5, 0.5]
[safety]
patient_eye_distance_mm = 100.0
operator_eye_distance_mm = 400.0
mucosa_distance_mm = 80.0
[[light]]
name = "far"
type = "disc"
group = "blue"
spectrum = { type = "led", peak_nm = 400.0, fwhm_short_nm = 8.0, fwhm_long_nm = 12.0, tails = [{ side = "long", level = 0.01, decay_nm = 20.0 }] }
strength.irradiance_w_per_m2 = 3.0
strength.at_distance_mm = 1000.0
radius_mm = 5.0
position_mm = [0.0, 0.0, 1000.0]
aim.look_at_mm = [0.0, 0.0, 0.0]
[[material]]
name = "stones"
reflectance = { type = "bands", base = 0.1, bands = [{ peak_nm = 500.0, fwhm_short_nm = 40.0, fwhm_long_nm = 60.0, weight = 0.2 }] }
[[object]]
name = "stone"
material = "stones"
type = "disc"
center_mm = [50.0, 0.0, 30.0]
normal = [0.0, 0.0, 1.0]
radius_mm = 2.0
emission = { group = "blue", spectrum = "led_450", radiance_w_per_sr_m2 = 0.5 }
[[object]]
name = "crystal"
material = "stones"
type = "box"
center_mm = [0.0, 0.0, 0.0]
size_mm = [2.0, 2.0, 2.0]
[[object.instance]]
translate_mm = [-50.0, 0.0, 30.0]
stretch = [1.0, 2.0, 1.0]
axis = [0.0, 0.0, 1.0]
angle_deg = 30.0
[[object.instance]]
matrix = [[1.0, 0.0, 0.0, -60.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 30.0]]
[[object]]
name = "cloth"
material = "stones"
type = "quad"
corner_mm = [60.0, 0.0, 30.0]
edge_u_mm = [5.0, 0.0, 0.0]
edge_v_mm = [0.0, 5.0, 0.0]
[object.displacement]
map = { noise = [4.0, 4.0], low = 0.0, high = 1.0 }
amount_mm = 0.1
subdivisions = 1
"#;

/// A sample with a data sheet.
const DATA_SHEET: &str = r#"
format = 1
[light]
spectrum = "led_385"
strength.irradiance_w_per_m2 = 10.0
[sample]
reflectance = 0.1
[lens]
focal_length_mm = 8.0
f_number = 2.0
[sensor]
preset = "monochrome_4_8um"
[sensor.emva1288]
gain_dn_per_e = 0.3
gain_e_per_dn = 3.333
dark_noise_e = 3.0
saturation_capacity_e = 12000.0
bit_depth = 12
black_level_dn = 20.0
dark_current_e_per_s = 1.0
dark_current_temperature_c = 25.0
doubling_temperature_k = 7.0
dsnu_e = 1.0
prnu_percent = 0.7
"#;

/// Seeds may be any number, and directions of any length.
const FINE: [&str; 8] = [
    "camera.up.#",
    "light.#.aim.direction.#",
    "mouth.seed",
    "object.#.normal.#",
    "object.#.instance.#.axis.#",
    "object.#.transform.axis.#",
    "render.seed",
    "sensor.device_seed",
];

/// One step into a tree: a key, or the number of an entry.
#[derive(Clone)]
enum Step {
    Key(String),
    Entry(usize),
}

fn numbers(value: &Value, at: &mut Vec<Step>, found: &mut Vec<Vec<Step>>) {
    let inner: Vec<(Step, &Value)> = match value {
        Value::Table(table) => table.iter().map(|(key, value)| (Step::Key(key.clone()), value)).collect(),
        Value::Array(items) => items.iter().enumerate().map(|(i, value)| (Step::Entry(i), value)).collect(),
        Value::Integer(_) | Value::Float(_) => return found.push(at.clone()),
        _ => return,
    };
    for (step, value) in inner {
        at.push(step);
        numbers(value, at, found);
        at.pop();
    }
}

fn place<'a>(root: &'a mut Value, at: &[Step]) -> &'a mut Value {
    at.iter().fold(root, |value, step| match step {
        Step::Key(key) => value.get_mut(key).unwrap(),
        Step::Entry(index) => value.get_mut(*index).unwrap(),
    })
}

/// The path with `#` for the number of an entry: of tables only, or of lists of numbers as well.
fn name(at: &[Step], lists_too: bool) -> String {
    let is_key = |step: Option<&Step>| matches!(step, Some(Step::Key(_)));
    let step = |(index, step): (usize, &Step)| match step {
        Step::Key(key) => key.clone(),
        Step::Entry(_) if lists_too || is_key(at.get(index + 1)) => "#".into(),
        Step::Entry(number) => number.to_string(),
    };
    at.iter().enumerate().map(step).collect::<Vec<_>>().join(".")
}

/// The smallest mouth that there is: its making takes most of the time.
fn with_small_mouth(text: &str) -> Value {
    let mut root = Value::Table(text.parse::<Table>().unwrap());
    if let Some(mouth) = root.get_mut("mouth").and_then(Value::as_table_mut) {
        mouth.insert("detail".into(), Value::Float(0.25));
    }
    root
}

/// The error of a text, or else all its fields written out.
fn resolved(text: &str) -> Result<String, String> {
    let folder = Path::new(".");
    if is_sample(text) {
        return parse_sample(text, "x", folder, &[])
            .map(|s| s.record.resolved_toml)
            .map_err(|e| e.to_string());
    }
    let experiment = parse(text, "x", folder, &[]).and_then(|experiment| resolve(&experiment));
    experiment.map(|experiment| experiment.record.resolved_toml).map_err(|error| error.to_string())
}

#[test]
fn absurd_numbers_are_refused_in_words_that_can_be_read() {
    let samples = preset::names(PresetKind::Sample)
        .into_iter()
        .map(|name| preset::text(PresetKind::Sample, name).unwrap());
    let experiments = preset::names(PresetKind::Experiment)
        .into_iter()
        .map(|name| preset::text(PresetKind::Experiment, name).unwrap());
    let mut seen = BTreeSet::new();
    let mut wrong = String::new();
    for text in [RARE_FIELDS, DATA_SHEET].into_iter().chain(samples).chain(experiments) {
        let complete = resolved(&toml::to_string(&with_small_mouth(text)).unwrap()).unwrap();
        // Fields in the text but not in the complete file belong to the text alone, such as a data sheet.
        for text in [text, &complete] {
            let root = with_small_mouth(text);
            let mut found = Vec::new();
            numbers(&root, &mut Vec::new(), &mut found);
            for at in found {
                let own = name(&at, false);
                if !seen.insert((is_sample(text), own.clone())) || FINE.contains(&name(&at, true).as_str()) {
                    continue;
                }
                let mut changed = root.clone();
                let number_is_whole = place(&mut changed, &at).is_integer();
                let absurd = if number_is_whole {
                    vec![Value::Integer(i64::MAX)]
                } else {
                    vec![Value::Float(1e99), Value::Float(-1e99)]
                };
                for number in absurd {
                    *place(&mut changed, &at) = number;
                    let error = resolved(&toml::to_string(&changed).unwrap());
                    let error = error.err().unwrap_or("no error".into());
                    // An entry of a list is named with its list, a whole number too large for its type with its section.
                    let keys = at.iter().rev().filter_map(|step| match step {
                        Step::Key(key) => Some(key.as_str()),
                        Step::Entry(_) => None,
                    });
                    let is_named =
                        keys.take(if number_is_whole { 2 } else { 1 }).any(|key| error.contains(key));
                    let says_what_is_allowed = [
                        "between",
                        "outside",
                        "above",
                        "below",
                        "beyond",
                        "negative",
                        " to ",
                        "inside",
                        "reads format",
                    ]
                    .iter()
                    .any(|word| error.contains(word));
                    let is_short = error.len() < 400 && !error.contains(&"0".repeat(12));
                    if !(is_named && says_what_is_allowed && is_short) {
                        wrong += &format!("{own}\n    {error}\n");
                    }
                }
            }
        }
    }
    assert!(seen.len() > 300, "only {} numbers", seen.len());
    assert!(wrong.is_empty(), "\n{wrong}");
}
