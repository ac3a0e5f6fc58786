//! Photobiological safety in the report.

use fluorspar::pipeline::{SafetyReport, ViewerSafety};
use fluorspar::safety::Hazard;

use crate::{Number, NumberTable, Origin, ReportItem, Section};

/// Margins of every capture and viewer; nothing when no light is on.
pub(super) fn safety_section(report: &SafetyReport) -> Option<Section> {
    if !report.has_light() {
        return None;
    }
    let mut section = Section::new("Safety of eyes and tissue").say(format!(
        "Limits: {}. {} A margin is the limit over the value: below 1 the exposure is too much.",
        report.standard, report.caveat
    ));
    for capture in report.captures.iter().filter(|c| !c.viewers.is_empty()) {
        let mut rows = Vec::new();
        for viewer in &capture.viewers {
            rows.extend(viewer_rows(viewer));
        }
        let caption = format!(
            "Capture \"{}\", lights on for {} ms ({})",
            capture.name,
            number(1e3 * capture.light_on_s),
            capture.light_on_from
        );
        section = section.with(ReportItem::Table(NumberTable { caption, rows }));
    }
    let rows: Vec<Number> = report
        .programme
        .iter()
        .filter_map(|line| {
            Some(Number::computed(
                capital(line.viewer.name()),
                line.sequences_per_day?.to_string(),
                "per 8 h",
                "whole sequences of captures that all dose limits together allow",
            ))
        })
        .chain(report.risk_group.map(|group| {
            Number::computed(
                "Risk group",
                match serde_json::to_value(group) {
                    Ok(serde_json::Value::String(name)) => name,
                    _ => String::new(),
                },
                "IEC 62471",
                "of the lights of the brightest capture at 200 mm, as if they shone continuously",
            )
        }))
        .collect();
    section = section.with(ReportItem::Table(NumberTable { caption: "Over a day".into(), rows }));
    Some(section.with(ReportItem::Terms(
        report.assumptions.iter().map(|line| ("Assumed".to_string(), line.clone())).collect(),
    )))
}

fn viewer_rows(viewer: &ViewerSafety) -> Vec<Number> {
    let who = capital(viewer.viewer.name());
    if let Some(reason) = &viewer.not_assessed {
        return vec![
            Number::computed(who, "no margin", "", reason.clone()).from(Origin::Assumed(reason.clone())),
        ];
    }
    let place = viewer.distance_mm.map_or_else(String::new, |mm| format!(" at {} mm", number(mm)));
    viewer
        .hazards
        .iter()
        .filter_map(|a| {
            let meaning = format!(
                "{}: {} = {} {}, limit {} {}{}",
                explain(a.hazard),
                a.quantity,
                number(a.value),
                a.unit,
                number(a.limit),
                a.unit,
                a.exposures_per_day.map_or_else(String::new, |n| format!("; {n} such captures in 8 hours"))
            );
            let name = format!("{who}{place}: {}", name(a.hazard));
            Some(Number::computed(name, number(a.margin?), "margin", meaning))
        })
        .collect()
}

fn name(hazard: Hazard) -> &'static str {
    match hazard {
        Hazard::ActinicUv => "actinic ultraviolet",
        Hazard::NearUv => "near ultraviolet",
        Hazard::BlueLight => "blue light",
        Hazard::BlueLightSmallSource => "blue light, small source",
        Hazard::RetinalThermal => "retina, thermal",
        Hazard::RetinalThermalWeakStimulus => "retina, thermal, infrared",
        Hazard::InfraredEye => "infrared",
        Hazard::SkinThermal => "burns",
    }
}

fn explain(hazard: Hazard) -> &'static str {
    match hazard {
        Hazard::ActinicUv => "inflammation of cornea and skin",
        Hazard::NearUv => "clouding of the lens of the eye",
        Hazard::BlueLight | Hazard::BlueLightSmallSource => "photochemical damage of the retina",
        Hazard::RetinalThermal | Hazard::RetinalThermalWeakStimulus => "burns of the retina",
        Hazard::InfraredEye => "heating of cornea and lens",
        Hazard::SkinThermal => "burns of the tissue",
    }
}

fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

/// Three digits of any size.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !(1e-2..1e5).contains(&value.abs()) {
        return format!("{value:.2e}");
    }
    let digits = (2.0 - value.abs().log10().floor()).clamp(0.0, 4.0) as usize;
    format!("{value:.digits$}")
}
