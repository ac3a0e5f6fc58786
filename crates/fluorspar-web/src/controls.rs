//! What of an experiment can be changed, each with its path, unit and range; what needs a new render is rendered then.

use fluorspar::spectral::CurveModel;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::schema::{
    CaptureSection, ConcentrationFactor, ExposureTime, LightSection, SpectrumReference,
};
use fluorspar_experiment::{EXAMINATION_VIEWS, Experiment, POSES, scene_values};
use fluorspar_session::values::quoted;
use fluorspar_session::{Changes, LiveRender, Result};
use serde::Serialize;

/// Controls that belong together.
#[derive(Serialize)]
pub(crate) struct ControlGroup {
    title: String,
    /// The capture that they change; `None` of all.
    capture: Option<String>,
    controls: Vec<Control>,
}

/// Something that can be changed.
#[derive(Serialize)]
pub(crate) struct Control {
    /// Path of `--set`.
    path: String,
    label: String,
    unit: &'static str,
    /// Where its range or its value comes from, and what it means.
    note: String,
    #[serde(flatten)]
    kind: Kind,
}

/// How it is changed. Values are TOML.
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Kind {
    /// A number of a range; `auto` where the word may stand in its place, and whether it does.
    Number {
        value: Option<f64>,
        range: [f64; 2],
        is_log: bool,
        is_whole: bool,
        #[serde(skip_serializing_if = "Option::is_none")]
        auto: Option<bool>,
        /// The value around the number, which stands for `$`.
        #[serde(skip_serializing_if = "Option::is_none")]
        template: Option<String>,
    },
    /// One of a list; an empty value where the experiment says nothing.
    Choice { value: String, options: Vec<Choice> },
    /// Several values within one, where their paths stand behind `$`; nothing at first unless there is a value.
    Record { value: Option<String>, template: String, fields: Vec<Control> },
}

#[derive(Serialize)]
struct Choice {
    value: String,
    title: String,
}

/// The least and the largest exposure of the page, ms.
const EXPOSURES_MS: [f64; 2] = [0.1, 1000.0];
/// The same of gains.
const GAINS: [f64; 2] = [1.0, 32.0];
/// Largest drive and factor on a concentration, unless the experiment has more.
const MOST_DRIVE: f64 = 2.0;
const MOST_CONCENTRATION: f64 = 4.0;
/// Width of an LED that the catalogue does not have, nm.
const LED_WIDTH_NM: f64 = 12.0;

/// All controls of a render. What they say is that of the experiment without changes, but for a view, which poses the mouth.
///
/// # Errors
/// A render whose experiment can't be read any more.
pub(crate) fn controls(live: &LiveRender, changes: &Changes) -> Result<Vec<ControlGroup>> {
    let poses = changes.set.iter().filter(|set| set.starts_with("mouth.view")).cloned().collect();
    let experiment = &live.experiment(&Changes { set: poses, ..Changes::default() })?;
    let groups = live.render().labels().light_groups();
    let captures = experiment.file.capture.iter().map(|capture| ControlGroup {
        title: format!("Capture \"{}\"", capture.name),
        capture: Some(capture.name.clone()),
        controls: of_capture(capture, &groups, experiment),
    });
    let shared = [
        ("Camera", of_camera(experiment)?),
        ("Light spectra", of_lights(live, experiment)?),
        ("Fluorophores", of_fluorophores(live, experiment)),
        ("Mouth", of_mouth(experiment)?),
        ("Lesion", of_lesion(live, experiment)?),
    ];
    let shared = shared.into_iter().filter(|(_, controls)| !controls.is_empty());
    let shared =
        shared.map(|(title, controls)| ControlGroup { title: title.into(), capture: None, controls });
    Ok(captures.chain(shared).collect())
}

/// A step of a path, in quotation marks where it needs them.
fn step(name: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !name.is_empty() && name.chars().all(is_plain) { name.into() } else { quoted(name) }
}

fn number(
    path: String,
    label: &str,
    unit: &'static str,
    value: f64,
    range: [f64; 2],
    is_log: bool,
) -> Control {
    let range = [range[0].min(value), range[1].max(value)];
    let kind =
        Kind::Number { value: Some(value), range, is_log, is_whole: false, auto: None, template: None };
    Control { path, label: label.into(), unit, note: String::new(), kind }
}

fn of_capture(capture: &CaptureSection, groups: &[String], experiment: &Experiment) -> Vec<Control> {
    let path = format!("capture.{}", step(&capture.name));
    let drive = |group: &String| {
        let value = capture.light_groups.get(group).copied().unwrap_or(0.0);
        let range = [0.0, MOST_DRIVE.max(2.0 * value)];
        let path = format!("{path}.light_groups.{}", step(group));
        let control = number(path, &format!("Drive of \"{group}\""), "×", value, range, false);
        Control { note: emitters(group, experiment), ..control }
    };
    let (time_ms, is_auto) = match capture.exposure_ms {
        ExposureTime::Milliseconds(time_ms) => (Some(time_ms), false),
        ExposureTime::Auto => (None, true),
    };
    let [least, most] = EXPOSURES_MS;
    let kind = Kind::Number {
        value: time_ms,
        range: [time_ms.map_or(least, |t| t.min(least)), time_ms.map_or(most, |t| t.max(most))],
        is_log: true,
        is_whole: false,
        auto: Some(is_auto),
        template: None,
    };
    let exposure = Control {
        path: format!("{path}.exposure_ms"),
        label: "Exposure".into(),
        unit: "ms",
        note: String::new(),
        kind,
    };
    let gain = number(format!("{path}.gain"), "Analog gain", "×", capture.gain, GAINS, true);
    groups.iter().map(drive).chain([exposure, gain]).collect()
}

/// What a drive of 1 is: the emitters of a light group.
fn emitters(group: &str, experiment: &Experiment) -> String {
    let is_own = |light: &&LightSection| light.group.as_deref().unwrap_or(&light.name) == group;
    let told = |light: &LightSection| {
        let of = match &light.spectrum {
            SpectrumReference::Text(name) => serde_json::to_value(name).ok(),
            _ => None,
        };
        let of = of.and_then(|name| Some(name.as_str()?.to_owned())).unwrap_or_else(|| light.name.clone());
        match light.emitter.power_mw() {
            Some(power_mw) => format!("{} × {power_mw} mW, {of}", light.emitter.count()),
            None => of,
        }
    };
    experiment.file.light.iter().filter(is_own).map(told).collect::<Vec<_>>().join("; ")
}

/// The value of a path, as TOML.
fn value_at(experiment: &Experiment, path: &str) -> Option<String> {
    Some(scene_values(experiment, path).ok()?.first()?.value.to_string())
}

fn choice(path: &str, label: &str, note: &str, current: String, mut options: Vec<Choice>) -> Control {
    if !options.iter().any(|option| option.value == current) {
        let title = format!("as in the experiment {current}").trim_end().to_owned();
        options.insert(0, Choice { value: current.clone(), title });
    }
    let kind = Kind::Choice { value: current, options };
    Control { path: path.into(), label: label.into(), unit: "", note: note.into(), kind }
}

/// Entries of the catalogue; `form` makes the value of a name.
fn entries(kind: PresetKind, form: impl Fn(&str) -> String) -> Result<Vec<Choice>> {
    let named = |entry: preset::PresetSummary| Choice {
        value: form(&entry.name),
        title: format!("{} ({})", entry.title, entry.name),
    };
    Ok(preset::list(kind)?.into_iter().map(named).collect())
}

fn of_camera(experiment: &Experiment) -> Result<Vec<Control>> {
    let filters = "view_filter.filters";
    let current = value_at(experiment, filters).unwrap_or_else(|| "[]".into());
    let mut list = vec![Choice { value: "[]".into(), title: "no filter".into() }];
    list.extend(entries(PresetKind::Filter, |name| format!("[{}]", quoted(name)))?);
    let mut all = vec![choice(filters, "Viewing filter", "in front of the lens", current, list)];
    if experiment.file.sensor.is_some() {
        // The experiment that a render carries has all fields of its sensor, and no name
        let current = value_at(experiment, "sensor.preset").unwrap_or_default();
        let note = "another sensor takes the place of the whole section";
        all.push(choice("sensor.preset", "Sensor", note, current, entries(PresetKind::Sensor, quoted)?));
    }
    Ok(all)
}

fn of_fluorophores(live: &LiveRender, experiment: &Experiment) -> Vec<Control> {
    let factors = &experiment.file.concentration;
    let control = |name: &str| {
        let value = match factors.get(name) {
            None => 1.0,
            Some(ConcentrationFactor::Even(factor)) => *factor,
            Some(ConcentrationFactor::Painted(_)) => return None,
        };
        let path = format!("concentration.{}", step(name));
        Some(number(path, &name.replace('_', " "), "×", value, [0.0, MOST_CONCENTRATION], false))
    };
    live.fluorophores().into_iter().filter_map(control).collect()
}

/// Peaks of lights whose excitation is kept apart by wavelength.
fn of_lights(live: &LiveRender, experiment: &Experiment) -> Result<Vec<Control>> {
    let spans = live.render().excitation_spans()?;
    let mut all = Vec::new();
    for light in &experiment.file.light {
        let group = light.group.as_deref().unwrap_or(&light.name);
        let Some((_, span)) = spans.iter().find(|(name, _)| name == group) else { continue };
        let (peak_nm, shape) = led(&light.spectrum);
        let kind = Kind::Number {
            value: peak_nm,
            range: experiment.file.render.excitation_basis_nm.unwrap_or(*span),
            is_log: false,
            is_whole: false,
            auto: None,
            template: Some(format!("{{ type = \"led\", peak_nm = $, {shape} }}")),
        };
        all.push(Control {
            path: format!("light.{}.spectrum", step(&light.name)),
            label: format!("LED peak of \"{}\"", light.name),
            unit: "nm",
            note: "follows the excitation basis of the render".into(),
            kind,
        });
    }
    Ok(all)
}

/// The peak of the LED that a spectrum is, and its shape as fields; one of a usual width where it is none.
fn led(spectrum: &SpectrumReference) -> (Option<f64>, String) {
    let model = match spectrum {
        SpectrumReference::Model(model) => Some(model.clone()),
        SpectrumReference::Text(name) => serde_json::to_value(name)
            .ok()
            .and_then(|name| preset::light_spectrum(name.as_str()?).ok())
            .map(|preset| preset.model),
        _ => None,
    };
    match model {
        Some(CurveModel::Led { peak_nm, fwhm_short_nm, fwhm_long_nm, shape, .. }) => (
            Some(peak_nm),
            format!("fwhm_short_nm = {fwhm_short_nm}, fwhm_long_nm = {fwhm_long_nm}, shape = {shape:?}"),
        ),
        _ => (None, format!("fwhm_short_nm = {LED_WIDTH_NM:?}, fwhm_long_nm = {LED_WIDTH_NM:?}")),
    }
}

/// Numbers of people on a slider, of the four thousand million that there are.
const PEOPLE: [f64; 2] = [1.0, 200.0];
/// Pose of a mouth: field, what it is called, unit and range (`docs/mouth.md`).
const POSE: [(&str, &str, &str, [f64; 2]); 6] = [
    ("jaw_opening_mm", "Opening of the jaw", "mm", [14.0, 60.0]),
    ("tongue_protrusion_mm", "Tongue put out", "mm", [-10.0, 25.0]),
    ("tongue_elevation_mm", "Tongue raised", "mm", [-5.0, 12.0]),
    ("tongue_shift_mm", "Tongue to the left", "mm", [-20.0, 20.0]),
    ("tongue_curl", "Tip of the tongue curled up", "", [0.0, 1.0]),
    ("lip_retraction_mm", "Lips drawn back", "mm", [-3.0, 11.0]),
];

/// Where it is told what the values of a mouth rest on.
const SOURCES: &str = "sources: docs/mouth.md";

/// Person, view and pose of a mouth.
fn of_mouth(experiment: &Experiment) -> Result<Vec<Control>> {
    let Some(mouth) = &experiment.file.mouth else { return Ok(Vec::new()) };
    let kind = Kind::Number {
        value: mouth.person.map(f64::from),
        range: PEOPLE,
        is_log: false,
        is_whole: true,
        auto: None,
        template: None,
    };
    let person = Control {
        path: "mouth.person".into(),
        label: "Person".into(),
        unit: "",
        note: format!("shape, teeth and tissues, as mouth sample draws them; any number; {SOURCES}"),
        kind,
    };
    let views = EXAMINATION_VIEWS.iter().chain(&POSES);
    let views = views.map(|view| Choice { value: quoted(view.name), title: view.title.into() });
    let current = mouth.view.as_deref().map(quoted).unwrap_or_default();
    let note = "pose of jaw, tongue and lips, and place of the camera";
    let view = choice("mouth.view", "View", note, current, views.collect());
    let values = serde_json::to_value(&mouth.parameters)?;
    let pose = POSE.into_iter().filter_map(|(field, label, unit, range)| {
        let path = format!("mouth.{field}");
        let control = number(path, label, unit, values.get(field)?.as_f64()?, range, false);
        Some(Control { note: SOURCES.into(), ..control })
    });
    Ok([person, view].into_iter().chain(pose).collect())
}

/// Name of the lesion that the page adds.
const LESION: &str = "drawn";
/// Its fields, where the values of controls stand behind `$`.
const LESION_TEMPLATE: &str =
    "{ part = $part, states = [$state], center = [$u, $v], size_mm = [$length, $width], edge_mm = $edge }";

/// A lesion on a part that is seen: one more, or that which the page added to a saved experiment.
fn of_lesion(live: &LiveRender, experiment: &Experiment) -> Result<Vec<Control>> {
    let Some(mouth) = &experiment.file.mouth else { return Ok(Vec::new()) };
    if !experiment.file.material.iter().any(|material| material.tissue().is_some()) {
        return Ok(Vec::new());
    }
    let seen = live.render().labels().features.part_names.iter();
    let is_soft = |part: &&String| !part.starts_with("tooth_") && *part != "face";
    let parts =
        seen.filter(is_soft).map(|part| Choice { value: quoted(part), title: part.replace('_', " ") });
    let states = entries(PresetKind::State, quoted)?;
    let known = mouth.lesion.iter().find(|lesion| lesion.name == LESION);
    let part = known.map_or("tongue_dorsum", |lesion| &lesion.part);
    let state = known.and_then(|lesion| lesion.states.first()).map_or("dysplasia_moderate", String::as_str);
    let [u, v] = known.map_or([0.5; 2], |lesion| lesion.center);
    let [length, width] = known.map_or([8.0, 6.0], |lesion| lesion.size_mm);
    let edge_mm = known.map_or(1.0, |lesion| lesion.edge_mm);
    let fields = vec![
        choice("part", "On", "", quoted(part), parts.collect()),
        choice("state", "Kind", "a state of the catalogue", quoted(state), states),
        number("u".into(), "Place along u", "", u, [0.0, 1.0], false),
        number("v".into(), "Place along v", "", v, [0.0, 1.0], false),
        number("length".into(), "Length", "mm", length, [1.0, 40.0], false),
        number("width".into(), "Width", "mm", width, [1.0, 40.0], false),
        number("edge".into(), "Edge", "mm", edge_mm, [0.0, 5.0], false),
    ];
    let (path, template) = match known {
        Some(_) => ("", LESION_TEMPLATE.replacen('{', &format!("{{ name = {},", quoted(LESION)), 1)),
        None => ("insert ", LESION_TEMPLATE.to_owned()),
    };
    let path = format!("{path}mouth.lesion.{LESION}");
    let value = known.map(|_| filled(&template, &fields));
    let note = "coordinates of parts: docs/mouth.md; states: docs/tissue.md".into();
    let kind = Kind::Record { value, template, fields };
    Ok(vec![Control { path, label: "A lesion".into(), unit: "", note, kind }])
}

/// A template with the values of its fields.
fn filled(template: &str, fields: &[Control]) -> String {
    fields.iter().fold(template.to_owned(), |text, field| match &field.kind {
        Kind::Number { value, .. } => {
            text.replace(&format!("${}", field.path), &format!("{:?}", value.unwrap_or_default()))
        }
        Kind::Choice { value, .. } => text.replace(&format!("${}", field.path), value),
        Kind::Record { .. } => text,
    })
}
