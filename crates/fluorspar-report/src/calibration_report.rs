//! The page of a camera that was calibrated from its own frames: its numbers, and what of an acceptance test they answer.

use fluorspar::pipeline::CameraScales;
use fluorspar::sensor::{FrameCalibration, MeasuredNumber};
use fluorspar::units::digits_text;
use fluorspar_experiment::Warning;

use crate::figures::{PhotonTransferPlot, photon_transfer};
use crate::{NumberMatrix, ReportData, ReportItem, Section};

/// What a page of a calibrated camera is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationResults<'a> {
    /// Title.
    pub title: &'a str,
    /// The experiment whose camera it is.
    pub experiment: &'a str,
    /// What dark and flat frames tell.
    pub camera: &'a FrameCalibration,
    /// What targets tell.
    pub scales: &'a CameraScales,
    /// What makes it doubtful.
    pub warnings: &'a [Warning],
    /// Files that were read.
    pub files: usize,
}

/// Name, value, interval and unit of each number.
pub type CalibrationRow = [String; 4];

fn row(name: &str, number: Option<MeasuredNumber>, unit: &str) -> CalibrationRow {
    let cell = |value: f64| digits_text(value, 4);
    let [value, interval] = match number {
        Some(number) => [cell(number.value), format!("{} to {}", cell(number.low), cell(number.high))],
        None => ["not measured".into(), String::new()],
    };
    [name.into(), value, interval, unit.into()]
}

/// The numbers of a calibrated camera.
#[must_use]
pub fn calibration_rows(camera: &FrameCalibration, scales: &CameraScales) -> Vec<CalibrationRow> {
    let mut rows = vec![
        row("system gain K", Some(camera.gain_dn_per_e), "DN/e-"),
        row("dark noise", Some(camera.dark_noise_e), "e-"),
        row("black level", Some(camera.black_level_dn), "DN"),
        row("dark current", camera.dark_current_e_per_s, "e-/s"),
        row("DSNU", camera.dsnu_e, "e-"),
        row("PRNU", Some(camera.prnu_percent), "%"),
        row("full scale", camera.full_scale_e, "e-"),
        row("linearity error", camera.linearity_error_percent, "%"),
    ];
    for channel in &camera.channels {
        rows.push(row(
            &format!("{} in the corner over the middle", channel.channel),
            Some(channel.corner),
            "",
        ));
    }
    for scale in &scales.efficiencies {
        let what = if scale.is_absolute { "quantum efficiency" } else { "relative quantum efficiency" };
        let name = format!("{} {what}, over that described", scale.channel);
        rows.push(row(&name, Some(scale.factor), ""));
    }
    for light in &scales.lights {
        let what = if light.is_absolute { "light" } else { "light times efficiency" };
        rows.push(row(&format!("{}: {what}, over that described", light.capture), Some(light.factor), ""));
    }
    for leak in &scales.leaks {
        let name =
            format!("{}: part of the light that passes the viewing filter, {}", leak.capture, leak.channel);
        rows.push(row(&name, Some(leak.passed), ""));
    }
    rows
}

/// What an acceptance test of a fluorescence camera asks (AAPM TG311; J. Biomed. Opt. 28, 096007), and what these frames answer.
fn acceptance(found: &CalibrationResults<'_>) -> Vec<(String, String)> {
    let (camera, scales) = (found.camera, found.scales);
    let percent = |value: f64| format!("{} %", digits_text(value, 3));
    let corner = camera.channels.iter().map(|c| c.corner.value).fold(f64::INFINITY, f64::min);
    let open = |what: &str| format!("Not measured by these frames: {what}.");
    let leaks = scales.leaks.iter().map(|leak| {
        let [passed, described] = [leak.passed.value, leak.described].map(|part| digits_text(part, 3));
        format!(
            "{} {}: {passed} of the light passes the filter, {described} by its description",
            leak.capture, leak.channel
        )
    });
    let lights = scales.lights.iter().map(|light| {
        let [factor, residual] = [light.factor.value, 100.0 * light.residual].map(|x| digits_text(x, 3));
        format!(
            "{}: {factor} times what is described, channels and tiles differ from that by up to {residual} %",
            light.capture
        )
    });
    let or =
        |texts: Vec<String>, what: &str| if texts.is_empty() { open(what) } else { texts.join("; ") + "." };
    let noise_e = camera.dark_noise_e.value;
    let range = camera.full_scale_e.filter(|_| noise_e > 0.0).map(|full| full.value / noise_e);
    let decibels = range.map(|range| 20.0 * range.log10());
    let rows = [
        (
            "Linearity",
            camera.linearity_error_percent.map_or_else(
                || open("it takes flats of three exposure times"),
                |error| {
                    format!("Levels deviate from a line over time by {} in the mean.", percent(error.value))
                },
            ),
        ),
        (
            "Sensitivity and range",
            decibels.map_or_else(
                || open("it takes flats that are full"),
                |db| format!("{} dB between dark noise and full scale.", digits_text(db, 3)),
            ),
        ),
        (
            "Uniformity",
            format!(
                "The corner has {} of the middle; the light of the flat differs by {} otherwise.",
                percent(100.0 * corner),
                percent(camera.unevenness_percent)
            ),
        ),
        (
            "Signal to background",
            or(
                leaks.collect(),
                "it takes a tile under the excitation light with and without the viewing filter",
            ),
        ),
        ("Excitation power", or(lights.collect(), "it takes a tile of known reflectance or fluorescence")),
        ("Excitation bands", open("take a spectrometer; the described spectra count")),
        ("Resolution", open("take an edge or a bar target")),
        ("Depth of field", open("take that target at several distances")),
        ("Distortion", open("take a grid of dots")),
        ("Depth sensitivity", open("take fluorescent inclusions at several depths")),
    ];
    rows.map(|(name, text)| (name.to_owned(), text)).to_vec()
}

/// The page of a calibrated camera.
#[must_use]
pub fn calibration_report(found: &CalibrationResults<'_>) -> ReportData {
    let camera = found.camera;
    let heads = ["", "value", "95 % interval", "unit"].map(String::from).to_vec();
    let rows = calibration_rows(camera, found.scales).into_iter().map(Vec::from).collect();
    let note = "Intervals are those of noise, of responses of pixels and of what is known of the targets. Full scale: of pixels, at the well or \
                the converter.";
    let matrix = NumberMatrix { caption: "The camera".into(), columns: heads, rows, note: note.into() };
    let figure = photon_transfer(&PhotonTransferPlot::of_frames(camera));
    let [hot, dead] = camera.defects;
    let [columns, rows] = camera.size_px;
    ReportData {
        title: found.title.into(),
        lead: vec![format!(
            "{} frames of {columns} x {rows} pixels, {} bits, by the camera of {}. {hot} pixels are far from the others in the dark, {dead} in light.",
            found.files, camera.bit_depth, found.experiment
        )],
        warnings: found.warnings.to_vec(),
        sections: vec![
            Section::new("Numbers").with(ReportItem::Matrix(matrix)),
            Section::new("Noise and light").show(figure, ""),
            Section::new("Acceptance")
                .say("What AAPM TG311 and J. Biomed. Opt. 28, 096007 ask of a fluorescence camera.")
                .with(ReportItem::Terms(acceptance(found))),
        ],
        provenance: vec![("version".into(), env!("CARGO_PKG_VERSION").into())],
        ..ReportData::default()
    }
}
