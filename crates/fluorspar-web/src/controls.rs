//! What of an experiment can be changed without a new render: each with its path, unit and range.

use fluorspar::spectral::CurveModel;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::schema::{
    CaptureSection, ConcentrationFactor, ExposureTime, LightSection, SpectrumReference,
};
use fluorspar_experiment::{Experiment, scene_values};
use fluorspar_session::values::quoted;
use fluorspar_session::{Changes, LiveRender, LiveStudy, Result};
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
        #[serde(skip_serializing_if = "Option::is_none")]
        auto: Option<bool>,
        /// The value around the number, which stands for `$`.
        #[serde(skip_serializing_if = "Option::is_none")]
        template: Option<String>,
    },
    /// One of a list.
    Choice { value: String, options: Vec<Choice> },
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

/// All controls of a render.
///
/// # Errors
/// A render whose experiment can't be read any more.
pub(crate) fn controls(live: &LiveRender, changes: &Changes) -> Result<Vec<ControlGroup>> {
    let study = live.show(changes)?;
    let experiment = study.experiment();
    let groups = live.render().labels().light_groups();
    let captures = experiment.file.capture.iter().map(|capture| ControlGroup {
        title: format!("Capture \"{}\"", capture.name),
        capture: Some(capture.name.clone()),
        controls: of_capture(capture, &groups, experiment),
    });
    let shared = [
        ("Camera", of_camera(experiment)?),
        ("Light spectra", of_lights(live, experiment)?),
        ("Fluorophores", of_fluorophores(&study)),
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
    let kind = Kind::Number { value: Some(value), range, is_log, auto: None, template: None };
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
        let title = format!("as in the experiment {current}");
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

fn of_fluorophores(study: &LiveStudy<'_>) -> Vec<Control> {
    let factors = &study.experiment().file.concentration;
    let control = |name: &str| {
        let value = match factors.get(name) {
            None => 1.0,
            Some(ConcentrationFactor::Even(factor)) => *factor,
            Some(ConcentrationFactor::Painted(_)) => return None,
        };
        let path = format!("concentration.{}", step(name));
        Some(number(path, &name.replace('_', " "), "×", value, [0.0, MOST_CONCENTRATION], false))
    };
    study.fluorophores().into_iter().filter_map(control).collect()
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
