//! The calibrated camera as an experiment: its base, and what was measured in place of what that says.

use std::path::Path;

use fluorspar::pipeline::{CameraScales, LightScale};
use fluorspar::sensor::{Emva1288, FrameCalibration, SensorModel};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::schema::SensorSection;
use fluorspar_experiment::{Experiment, parse};
use fluorspar_report::calibration_rows;
use toml::{Table, Value};

use crate::photographs::camera_study;
use crate::{Error, ExperimentSource, Result};

/// What a camera file begins with.
pub(super) struct CameraHead<'a> {
    pub(super) title: &'a str,
    /// The experiment that it changes, a file as the place of the camera file has it.
    pub(super) base: &'a str,
    /// A folder beside that place.
    pub(super) folder: &'a Path,
}

/// The text of the experiment. What was measured stands above it, with intervals.
pub(super) fn camera_toml(
    head: &CameraHead<'_>,
    (source, parsed): (&ExperimentSource, &Experiment),
    study: &Study,
    (camera, gain): (&FrameCalibration, f64),
    scales: &CameraScales,
) -> Result<String> {
    let mut text =
        "# A calibrated camera: experiments may have it as their base. Measured, with 95 % intervals:\n"
            .to_owned();
    for [name, value, interval, unit] in calibration_rows(camera, scales) {
        let interval = if interval.is_empty() { interval } else { format!(" ({interval})") };
        text += format!("#   {name}: {value}{interval} {unit}").trim_end();
        text.push('\n');
    }
    let mut file = Table::new();
    file.insert("format".into(), Value::Integer(1));
    file.insert("base".into(), head.base.into());
    file.insert("title".into(), head.title.into());
    let Some(section) = &parsed.file.sensor else {
        return Err(Error::Input(format!("{}: there is no [sensor] section; add one", source.name)));
    };
    // Fields that were not measured are those of the base; none of its data sheet may stay
    file.insert("unset".into(), vec![Value::from("sensor")].into());
    file.insert("sensor".into(), sensor((study, section), camera, gain, scales)?.into());
    if is_ideal(study) {
        // Part of the measured shading
        file.insert("lens".into(), Table::from_iter([("vignetting".to_owned(), Value::from("none"))]).into());
    }
    if let Some(filter) = leaking_filter(study, scales) {
        file.insert(
            "view_filter".into(),
            Table::from_iter([("filters".to_owned(), Value::from(vec![filter]))]).into(),
        );
    }
    let captures: Vec<Value> = study.captures.iter().filter_map(|of| capture(of, study, scales)).collect();
    if !captures.is_empty() {
        file.insert("capture".into(), captures.into());
    }
    text += &toml::to_string(&file).map_err(|error| Error::Failed(format!("camera.toml: {error}")))?;
    // What no experiment can have is told now, and not at its first use
    let again = parse(&text, "camera.toml", head.folder, &[])?;
    camera_study(source, &again)?;
    Ok(text)
}

/// A number to six digits.
fn float(value: f64) -> Value {
    Value::Float(format!("{value:.5e}").parse::<f64>().unwrap_or(value))
}

/// Wavelengths at which spectra are written, nm.
fn wavelengths() -> Vec<f64> {
    (300..=1100).map(f64::from).collect()
}

/// The section of the sensor: what the experiment says, with what was measured in its place.
fn sensor(
    (study, section): (&Study, &SensorSection),
    camera: &FrameCalibration,
    gain: f64,
    scales: &CameraScales,
) -> Result<Table> {
    let failed = |error: toml::ser::Error| Error::Failed(format!("camera.toml: {error}"));
    let mut sensor = Table::try_from(section).map_err(failed)?;
    let default = Table::try_from(SensorModel::default()).map_err(failed)?;
    let is_replaced = |key: &str| Emva1288::replaced_fields().any(|field| field == key);
    sensor.retain(|key, value| default.get(key) != Some(value) && !is_replaced(key));
    let sheet = Table::try_from(camera.data_sheet(gain)).map_err(failed)?;
    let rounded = |value: Value| value.as_float().map_or(value.clone(), float);
    let sheet: Table = sheet.into_iter().map(|(key, value)| (key, rounded(value))).collect();
    sensor.insert("emva1288".into(), sheet.into());
    if is_ideal(study) {
        let shading = camera.channels.iter().map(|channel| {
            let terms: Vec<Value> = channel.shading.iter().map(|term| float(term.value)).collect();
            (channel.channel.clone(), Value::from(terms))
        });
        sensor.insert("relative_illumination".into(), Table::from_iter(shading).into());
    }
    let common = of_efficiency(scales);
    let known = study.camera.sensor.iter().flat_map(|sensor| sensor.qe().channels());
    let scaled = known.map(|channel| {
        let scale = scales.efficiencies.iter().find(|scale| scale.channel == channel.name);
        let curve = channel.curve.scaled(common * scale.map_or(1.0, |scale| scale.factor.value));
        (channel.name.clone(), table(|nm| curve.at(nm)))
    });
    if !scales.efficiencies.is_empty() || common != 1.0 {
        sensor.insert("quantum_efficiency".into(), Table::from_iter(scaled).into());
    }
    Ok(sensor)
}

/// Whether shading can stand in the place of what the lens makes of it; that of a traced lens is its own.
fn is_ideal(study: &Study) -> bool {
    study.camera.lens.as_ref().is_some_and(|lens| lens.traced.is_none())
}

/// A spectrum as a table.
fn table(value: impl Fn(f64) -> f64) -> Value {
    let list = |of: &dyn Fn(f64) -> f64| {
        Value::from(wavelengths().into_iter().map(|nm| float(of(nm))).collect::<Vec<_>>())
    };
    Table::from_iter([
        ("type".to_owned(), Value::from("table")),
        ("wavelength_nm".to_owned(), list(&|nm| nm)),
        ("value".to_owned(), list(&value)),
    ])
    .into()
}

/// The viewing filter with a floor, where more of the excitation passes it than it describes.
fn leaking_filter(study: &Study, scales: &CameraScales) -> Option<Value> {
    let has_own = |capture: &str| study.capture(capture).is_some_and(|capture| capture.filter.is_some());
    let mut floors = scales
        .leaks
        .iter()
        .filter(|leak| !has_own(&leak.capture) && leak.passed.low > leak.described)
        .map(|leak| leak.passed.value);
    let first = floors.next()?;
    let floor = floors.fold(first, f64::max);
    let transmittance = &study.camera.view_filter.transmittance;
    Some(table(|nm| transmittance.at(nm).max(floor)))
}

/// What of the measured strengths goes to the quantum efficiency. Where light and efficiency are not told apart, and less was
/// measured than is described, the strongest light is as described and the sensor less sensitive: it is not taken for weaker, and so for safer,
/// than it may be.
fn of_efficiency(scales: &CameraScales) -> f64 {
    let unknown = scales.lights.iter().filter(|light| !light.is_absolute);
    let strongest = unknown.map(|light| light.factor.value).fold(0.0, f64::max);
    if strongest > 0.0 { strongest.min(1.0) } else { 1.0 }
}

/// A capture whose lights are as strong as they were measured: in it, or else in another capture that drives them.
fn capture(capture: &Capture, study: &Study, scales: &CameraScales) -> Option<Value> {
    let common = of_efficiency(scales);
    let own = scales.lights.iter().find(|light| light.capture == capture.frame.label);
    let of_group = |group: &str| {
        let drives = |light: &&LightScale| {
            study.capture(&light.capture).is_some_and(|other| other.frame.drive(group) > 0.0)
        };
        let light = own.or_else(|| scales.lights.iter().find(drives))?;
        Some(light.factor.value / if light.is_absolute { 1.0 } else { common })
    };
    let lights = capture.frame.lights.iter();
    let factors: Vec<Option<f64>> = lights.clone().map(|(group, _)| of_group(group)).collect();
    factors.iter().flatten().next()?;
    let drives = lights
        .zip(factors)
        .map(|((group, drive), factor)| (group.clone(), float(drive * factor.unwrap_or(1.0))));
    let section = [
        ("name".to_owned(), Value::from(capture.frame.label.clone())),
        ("light_groups".to_owned(), Table::from_iter(drives).into()),
    ];
    Some(Table::from_iter(section).into())
}
