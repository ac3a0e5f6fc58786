//! Photobiological safety in the report.

use fluorspar::pipeline::{CaptureSafety, SafetyReport, Viewer, ViewerSafety};
use fluorspar::safety::{Assessment, DAY_S, Hazard, RiskGroup, RiskQuantity};
use fluorspar::units::digits_text;

use super::words::capital;
use crate::{Number, NumberTable, ReportItem, Section};

/// Count of exposures where the day ends before any dose does.
const NO_LIMIT: &str = "no limit";

/// What limits the exposures of a day.
struct Limiting<'a> {
    capture: &'a CaptureSafety,
    viewer: &'a ViewerSafety,
    assessment: &'a Assessment,
    /// Exposures in 8 hours; 0 where one is too many, without an end of what is judged one exposure at a time.
    per_day: u64,
}

impl Limiting<'_> {
    /// Whether the dose ends before the day does.
    fn is_limit(&self) -> bool {
        self.per_day.saturating_add(1) as f64 * self.capture.light_on_s <= DAY_S
    }

    /// What follows from the dose of one exposure.
    fn consequence(&self) -> String {
        match (self.is_limit(), self.assessment.exposures_per_day) {
            (true, _) => format!("so {} exposures of it alone fit into 8 hours", self.per_day),
            (false, Some(_)) => "so more of it alone are allowed than fit into 8 hours".into(),
            (false, None) => "in each exposure, however many there are".into(),
        }
    }

    /// Whether it allows less than another one: fewer exposures, or where the day limits both, with the smaller margin.
    fn is_worse_than(&self, other: &Self) -> bool {
        let margin = |of: &Self| of.assessment.margin.unwrap_or(f64::INFINITY);
        match (self.is_limit(), other.is_limit()) {
            (true, true) => self.per_day < other.per_day,
            (false, false) => margin(self) < margin(other),
            (limits, _) => limits,
        }
    }
}

/// The hazard that allows the fewest exposures, where the day allows more the one with the smallest margin; `None` where nothing is
/// assessed.
fn limiting(report: &SafetyReport) -> Option<Limiting<'_>> {
    let mut found: Option<Limiting<'_>> = None;
    for capture in &report.captures {
        for viewer in &capture.viewers {
            for assessment in &viewer.hazards {
                // Burns happen in one exposure or not at all: their doses do not add up
                let per_day = match (assessment.margin, assessment.exposures_per_day) {
                    (Some(margin), _) if margin < 1.0 => 0,
                    (_, Some(per_day)) => per_day,
                    (Some(_), None) => u64::MAX,
                    (None, None) => continue,
                };
                let this = Limiting { capture, viewer, assessment, per_day };
                if found.as_ref().is_none_or(|worst| this.is_worse_than(worst)) {
                    found = Some(this);
                }
            }
        }
    }
    found
}

/// The number of captures a day for the first screen; nothing when no light is on.
pub(super) fn eye_safe_captures(report: &SafetyReport) -> Option<Number> {
    if !report.has_light() {
        return None;
    }
    let missing = viewers_without_distance(report);
    let limiting = limiting(report)?;
    let is_limit = limiting.is_limit();
    let Limiting { capture, viewer, assessment, per_day } = limiting;
    let place = viewer.distance_mm.map_or_else(String::new, |mm| format!(" at {mm:.0} mm"));
    let whole = sequences(report);
    let frames = match &whole {
        Some((_, frames)) => frames.clone(),
        None => format!("frame \"{}\"", capture.name),
    };
    let count = match &whole {
        Some((count, _)) => count.clone(),
        None if is_limit => per_day.to_string(),
        None => NO_LIMIT.into(),
    };
    let mut meaning = format!(
        "{}{frames}, {} {}, {}{place}",
        if has_eye(report) { "" } else { "for skin; eyes not assessed: " },
        if count == NO_LIMIT { "smallest margin:" } else { "limited by" },
        name(assessment.hazard),
        viewer.viewer.name(report.is_mouth)
    );
    if !missing.is_empty() {
        meaning += &format!("; no distance of the {} is given", missing.join(" and the "));
    }
    if let Some(group) = report.risk_group {
        meaning += &format!("; lights: {}", group_name(group).to_lowercase());
    }
    let unit = if whole.is_some() { "sequences" } else { "captures" };
    let title = if missing.is_empty() { format!("Eye-safe {unit}") } else { format!("Safe {unit}") };
    Some(Number::computed(title, count, "in 8 h", meaning))
}

/// Exposures that are beyond a limit by themselves, one sentence each.
#[must_use]
pub fn exceeded_limits(report: &SafetyReport) -> Vec<String> {
    let of_viewer = |capture: &CaptureSafety, viewer: &ViewerSafety| {
        let (margin, hazard) = viewer.smallest_margin.zip(viewer.governing)?;
        let place = viewer.distance_mm.map_or_else(String::new, |mm| format!(" at {mm:.0} mm"));
        (margin < 1.0).then(|| {
            format!(
                "Frame \"{}\": one exposure is {:.1} times the limit of {} for the {}{place}",
                capture.name,
                1.0 / margin,
                name(hazard),
                viewer.viewer.name(report.is_mouth)
            )
        })
    };
    let all = report
        .captures
        .iter()
        .flat_map(|capture| capture.viewers.iter().map(move |viewer| (capture, viewer)));
    all.filter_map(|(capture, viewer)| of_viewer(capture, viewer)).collect()
}

/// Says so where the lights are of the highest risk group: the number of safe exposures does not show it.
pub(super) fn risk_group_warning(report: &SafetyReport) -> Option<String> {
    (report.risk_group == Some(RiskGroup::High) && report.has_light()).then(|| {
        "The lights are of risk group 3 (IEC 62471), a high risk: where they shine longer than the frames need, even a short look into \
         them is a hazard."
            .into()
    })
}

/// Whether the exposure of some eye is assessed.
fn has_eye(report: &SafetyReport) -> bool {
    let mut viewers = report.captures.iter().flat_map(|capture| &capture.viewers);
    viewers.any(|v| v.viewer != Viewer::Mucosa && v.not_assessed.is_none())
}

/// Whole sequences of captures in a day, and what one is made of: where several captures have light, whose doses add. `None` where one
/// has, and where no viewer is assessed.
fn sequences(report: &SafetyReport) -> Option<(String, String)> {
    let lit: Vec<&CaptureSafety> = report.captures.iter().filter(|c| !c.viewers.is_empty()).collect();
    if lit.len() < 2 {
        return None;
    }
    let fewest = report.program.iter().filter_map(|line| line.sequences_per_day).min()?;
    let names: Vec<String> = lit.iter().map(|capture| format!("\"{}\"", capture.name)).collect();
    let light_on_s: f64 = lit.iter().map(|capture| capture.light_on_s).sum();
    let count = match (fewest + 1) as f64 * light_on_s > DAY_S {
        true => NO_LIMIT.into(),
        false => fewest.to_string(),
    };
    Some((count, names.join(" and ")))
}

/// Viewers whose distance is not known, by name.
fn viewers_without_distance(report: &SafetyReport) -> Vec<&'static str> {
    let mut names = Vec::new();
    for viewer in report.captures.iter().flat_map(|c| &c.viewers).filter(|v| v.not_assessed.is_some()) {
        let name = viewer.viewer.name(report.is_mouth);
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

fn group_name(group: RiskGroup) -> String {
    match group {
        RiskGroup::Exempt => "Exempt group".into(),
        group => format!("Risk group {}", group.name()),
    }
}

/// The limiting hazard in a sentence, then margins of every capture and viewer; nothing when no light is on.
pub(super) fn safety_section(report: &SafetyReport) -> Option<Section> {
    if !report.has_light() {
        return None;
    }
    let (note, sentence) = match limiting(report) {
        Some(limiting) => {
            let (is_limit, consequence) = (limiting.is_limit(), limiting.consequence());
            let Limiting { capture, viewer, assessment, per_day } = limiting;
            let who = viewer.viewer.name(report.is_mouth);
            let place = viewer.distance_mm.map_or_else(String::new, |mm| format!(" at {} mm", number(mm)));
            let hazard = name(assessment.hazard);
            let exposures =
                if is_limit { format!("{per_day} exposures") } else { "no limit of exposures".into() };
            (
                match sequences(report) {
                    Some((count, _)) if count == NO_LIMIT => {
                        format!("no limit of whole sequences in 8 hours; smallest margin: {hazard}, {who}")
                    }
                    Some((count, _)) => {
                        format!("{count} whole sequences in 8 hours; limited by {hazard}, {who}")
                    }
                    None => format!(
                        "{exposures} of frame \"{}\" in 8 hours; {} {hazard}, {who}",
                        capture.name,
                        if is_limit { "limited by" } else { "smallest margin:" }
                    ),
                },
                format!(
                    "{} {hazard} ({}) for the {who}{place}: one exposure of frame \"{}\" gives {} {} of the {} {} that are \
                     allowed, {consequence}.",
                    if is_limit {
                        "The limiting hazard is"
                    } else {
                        "No hazard limits a day; the smallest margin is that of"
                    },
                    explain(assessment.hazard, report.is_mouth),
                    capture.name,
                    number(assessment.value),
                    assessment.unit,
                    number(assessment.limit),
                    assessment.unit
                ),
            )
        }
        None => (
            "no distance of an eye is given".into(),
            "No distance of an eye is given, so nothing limits.".into(),
        ),
    };
    let note = match report.risk_group {
        Some(group) => format!("{note}; lights: {}", group_name(group).to_lowercase()),
        None => note,
    };
    let mut section = Section::new("Safety of eyes and skin").folded(note).say(sentence).say(format!(
        "Limits: {}. {} A margin is the limit over the value: below 1 the exposure is too much.",
        report.standard, report.caveat
    ));
    for capture in report.captures.iter().filter(|c| !c.viewers.is_empty()) {
        let mut rows = Vec::new();
        for viewer in &capture.viewers {
            rows.extend(viewer_rows(viewer, capture.light_on_s, report.is_mouth));
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
        .program
        .iter()
        .filter_map(|line| {
            Some(Number::computed(
                capital(line.viewer.name(report.is_mouth)),
                line.sequences_per_day?.to_string(),
                "per 8 h",
                "whole sequences of captures that all dose limits together allow",
            ))
        })
        .chain(report.risk_group.map(|group| {
            Number::computed(
                "Risk group",
                group.name(),
                "IEC 62471",
                "of the lights at 200 mm from the camera, as if they shone continuously, the worst of all captures; see below",
            )
        }))
        .collect();
    section = section.with(ReportItem::Table(NumberTable { caption: "Over a day".into(), rows }));
    let mut terms: Vec<(String, String)> = risk_group_term(report).into_iter().collect();
    terms.extend(report.assumptions.iter().map(|line| ("Assumed".to_string(), line.clone())));
    Some(section.with(ReportItem::Terms(terms)))
}

/// Meaning of the risk group, the quantity that decides it, and the time to its limit.
fn risk_group_term(report: &SafetyReport) -> Option<(String, String)> {
    let group = report.risk_group?;
    let title = group_name(group);
    let mut text = format!("{}.", capital(group.meaning()));
    // The worst of its group, measured by where the group below ends.
    let below = match group {
        RiskGroup::Exempt => None,
        RiskGroup::Low => Some(0),
        RiskGroup::Moderate => Some(1),
        RiskGroup::High => Some(2),
    };
    let excess = |q: &RiskQuantity| below.map_or(0.0, |below: usize| q.value / q.group_limits[below]);
    let worst = report
        .risk_quantities
        .iter()
        .filter(|q| below.is_some() && q.group == group)
        .max_by(|a, b| excess(a).total_cmp(&excess(b)));
    if let (Some(worst), Some(below)) = (worst, below) {
        let group_below = [RiskGroup::Exempt, RiskGroup::Low, RiskGroup::Moderate][below];
        let ends = match group_below {
            RiskGroup::Exempt => "the exempt group".to_string(),
            group => format!("group {}", group.name()),
        };
        text += &format!(
            " It comes from {}: {} {} at 200 mm, where {ends} ends at {}",
            quantity_name(worst.quantity),
            number(worst.value),
            worst.unit,
            number(worst.group_limits[below])
        );
        text += &match worst.seconds_to_limit() {
            Some(seconds) => format!("; an eye there may take {} s of it in a day.", number(seconds)),
            None => ".".into(),
        };
    }
    text += " For medical equipment, IEC 60601-2-57 says which measures a group requires.";
    Some((title, text))
}

fn quantity_name(quantity: &str) -> String {
    let name = match quantity {
        "E_s" => "actinic ultraviolet",
        "E_UVA" => "near ultraviolet",
        "L_B" => "blue light",
        "L_R" => "heat on the retina",
        "E_IR" => "infrared",
        other => return other.into(),
    };
    format!("{name} ({quantity})")
}

fn viewer_rows(viewer: &ViewerSafety, light_on_s: f64, is_mouth: bool) -> Vec<Number> {
    let who = capital(viewer.viewer.name(is_mouth));
    if let Some(reason) = &viewer.not_assessed {
        return vec![Number::computed(who, "not assessed", "", reason.clone())];
    }
    let place = viewer.distance_mm.map_or_else(String::new, |mm| format!(" at {} mm", number(mm)));
    viewer
        .hazards
        .iter()
        .filter_map(|a| {
            let meaning = format!(
                "{}: {} = {} {}, limit {} {}{}",
                explain(a.hazard, is_mouth),
                a.quantity,
                number(a.value),
                a.unit,
                number(a.limit),
                a.unit,
                a.exposures_per_day.map_or_else(String::new, |n| captures_per_day(n, light_on_s))
            );
            let name = format!("{who}{place}: {}", name(a.hazard));
            Some(Number::computed(name, number(a.margin?), "margin", meaning))
        })
        .collect()
}

/// How many captures the dose of a day allows; the day may end before the dose does.
fn captures_per_day(n: u64, light_on_s: f64) -> String {
    if (n + 1) as f64 * light_on_s > DAY_S {
        "; as many such captures as fit into 8 hours".into()
    } else {
        format!("; {n} such captures in 8 hours")
    }
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

fn explain(hazard: Hazard, is_mouth: bool) -> &'static str {
    match hazard {
        Hazard::ActinicUv => "inflammation of cornea and skin",
        Hazard::NearUv => "clouding of the lens of the eye",
        Hazard::BlueLight | Hazard::BlueLightSmallSource => "photochemical damage of the retina",
        Hazard::RetinalThermal | Hazard::RetinalThermalWeakStimulus => "burns of the retina",
        Hazard::InfraredEye => "heating of cornea and lens",
        Hazard::SkinThermal if is_mouth => "burns of the mucosa",
        Hazard::SkinThermal => "burns of the skin",
    }
}

/// Three digits.
fn number(value: f64) -> String {
    digits_text(value, 3)
}

#[cfg(test)]
mod tests {
    use fluorspar::pipeline::ProgramSafety;

    use super::*;

    #[test]
    fn the_card_names_the_risk_group_and_the_eye_without_a_distance() {
        let viewer = |who, distance_mm: Option<f64>| ViewerSafety {
            viewer: who,
            distance_mm,
            not_assessed: distance_mm.is_none().then(|| "unknown".into()),
            irradiance_w_per_m2: None,
            source_subtense_mrad: None,
            hazards: distance_mm.map(|_| blue_light()).into_iter().collect(),
            smallest_margin: None,
            governing: None,
            captures_per_day: None,
        };
        let report = SafetyReport {
            standard: "",
            caveat: "",
            is_mouth: false,
            assumptions: Vec::new(),
            captures: vec![CaptureSafety {
                name: "uv".into(),
                light_on_s: 1.0,
                light_on_from: String::new(),
                viewers: vec![viewer(Viewer::PatientEye, None), viewer(Viewer::OperatorEye, Some(500.0))],
            }],
            program: Vec::new(),
            risk_group: Some(RiskGroup::High),
            risk_quantities: Vec::new(),
        };
        let warning = risk_group_warning(&report).unwrap();
        assert!(warning.contains("risk group 3"), "{warning}");
        let lower = SafetyReport { risk_group: Some(RiskGroup::Moderate), ..report.clone() };
        assert_eq!(risk_group_warning(&lower), None);
        let rows = viewer_rows(&report.captures[0].viewers[0], 1.0, false);
        assert!(rows.len() == 1 && rows[0].value == "not assessed", "{rows:?}");
        let card = eye_safe_captures(&report).unwrap();
        assert_eq!((card.name.as_str(), card.value.as_str()), ("Safe captures", "212"));
        for part in [
            "no distance of the eye that looks into the lights is given",
            "lights: risk group 3",
            "operator's eye at 500 mm",
        ] {
            assert!(card.meaning.contains(part), "{part}: {}", card.meaning);
        }
    }

    /// Of two captures that use up the same dose, as many whole sequences fit as the program counts, not as many as of one capture.
    #[test]
    fn the_card_counts_whole_sequences() {
        let viewer = ViewerSafety {
            viewer: Viewer::PatientEye,
            distance_mm: Some(200.0),
            not_assessed: None,
            irradiance_w_per_m2: None,
            source_subtense_mrad: None,
            hazards: vec![blue_light()],
            smallest_margin: None,
            governing: None,
            captures_per_day: Some(212),
        };
        let capture = |name: &str| CaptureSafety {
            name: name.into(),
            light_on_s: 1.0,
            light_on_from: String::new(),
            viewers: vec![viewer.clone()],
        };
        let report = SafetyReport {
            standard: "",
            caveat: "",
            is_mouth: true,
            assumptions: Vec::new(),
            captures: vec![capture("white"), capture("blue")],
            program: vec![ProgramSafety { viewer: Viewer::PatientEye, sequences_per_day: Some(106) }],
            risk_group: None,
            risk_quantities: Vec::new(),
        };
        let card = eye_safe_captures(&report).unwrap();
        assert_eq!((card.name.as_str(), card.value.as_str()), ("Eye-safe sequences", "106"));
        assert!(
            card.meaning.starts_with("\"white\" and \"blue\", limited by blue light"),
            "{}",
            card.meaning
        );
        assert!(plain(&safety_section(&report).unwrap()).contains("106 whole sequences in 8 hours"));
    }

    fn report_of(viewers: Vec<ViewerSafety>) -> SafetyReport {
        let capture =
            CaptureSafety { name: "green".into(), light_on_s: 0.02, light_on_from: String::new(), viewers };
        SafetyReport {
            standard: "",
            caveat: "",
            is_mouth: false,
            assumptions: Vec::new(),
            captures: vec![capture],
            program: Vec::new(),
            risk_group: None,
            risk_quantities: Vec::new(),
        }
    }

    fn viewer_of(viewer: Viewer, hazards: Vec<Assessment>) -> ViewerSafety {
        ViewerSafety {
            viewer,
            distance_mm: (viewer != Viewer::Mucosa).then_some(200.0),
            not_assessed: hazards.is_empty().then(|| "unknown".into()),
            irradiance_w_per_m2: None,
            source_subtense_mrad: None,
            hazards,
            smallest_margin: None,
            governing: None,
            captures_per_day: None,
        }
    }

    /// 8 hours of exposures of 20 ms are 1 440 000, which says nothing of a hazard of which each gives a 2e7th part.
    #[test]
    fn a_day_that_ends_before_the_dose_is_no_limit_of_the_hazard() {
        let of = |hazard, margin, per_day| Assessment {
            hazard,
            margin: Some(margin),
            exposures_per_day: Some(per_day),
            ..blue_light()
        };
        let tissue = |hazards| report_of(vec![viewer_of(Viewer::Mucosa, hazards)]);
        let day = 1_440_000;
        let free = tissue(vec![of(Hazard::SkinThermal, 1e9, day), of(Hazard::ActinicUv, 1.8e7, day)]);
        let text = plain(&safety_section(&free).unwrap());
        for part in [
            "No hazard limits a day; the smallest margin is that of actinic ultraviolet",
            "so more of it alone are allowed than fit into 8 hours.",
            "no limit of exposures of frame",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("1440000"), "{text}");
        assert_eq!(eye_safe_captures(&free).unwrap().value, "no limit");
        // Burns are judged one exposure at a time, which no day ends: theirs is the smallest margin all the same
        let burns = Assessment { exposures_per_day: None, ..of(Hazard::SkinThermal, 2e4, 0) };
        let burns = tissue(vec![of(Hazard::ActinicUv, 3e8, day), burns]);
        let text = plain(&safety_section(&burns).unwrap());
        for part in [
            "the smallest margin is that of burns (burns of the skin) for the skin in the light",
            "in each exposure, however many there are.",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let card = eye_safe_captures(&burns).unwrap();
        assert!(card.value == "no limit" && card.meaning.contains("smallest margin: burns"), "{card:?}");
        // One exposure less than the day allows is a limit of the dose
        let limited = tissue(vec![of(Hazard::ActinicUv, 1e9, day), of(Hazard::SkinThermal, 2e9, day - 1)]);
        let text = plain(&safety_section(&limited).unwrap());
        assert!(text.contains("so 1439999 exposures of it alone fit into 8 hours."), "{text}");
        assert!(text.contains("The limiting hazard is burns"), "{text}");
        assert_eq!(eye_safe_captures(&limited).unwrap().value, "1439999");
    }

    #[test]
    fn a_card_of_skin_alone_says_so_first() {
        let skin = || viewer_of(Viewer::Mucosa, vec![blue_light()]);
        let unknown = viewer_of(Viewer::OperatorEye, Vec::new());
        let card = eye_safe_captures(&report_of(vec![skin(), unknown])).unwrap();
        assert!(card.meaning.starts_with("for skin; eyes not assessed: "), "{card:?}");
        assert_eq!(card.name, "Safe captures");
        let known = viewer_of(Viewer::OperatorEye, vec![blue_light()]);
        let card = eye_safe_captures(&report_of(vec![skin(), known])).unwrap();
        assert!(card.meaning.starts_with("frame \"green\", limited by"), "{card:?}");
    }

    fn plain(section: &Section) -> String {
        format!("{section:?}")
    }

    fn blue_light() -> Assessment {
        Assessment {
            hazard: Hazard::BlueLight,
            quantity: "L_B t",
            value: 1.0,
            limit: 2.0,
            unit: "J",
            margin: Some(2.0),
            daily_seconds: None,
            exposures_per_day: Some(212),
        }
    }

    #[test]
    fn the_risk_group_is_explained_with_what_decides_it() {
        let quantity = |quantity, value, group_limits, group| RiskQuantity {
            quantity,
            value,
            unit: "W/m²",
            group_limits,
            group,
        };
        let report = |group, quantities| SafetyReport {
            standard: "",
            caveat: "",
            is_mouth: true,
            assumptions: Vec::new(),
            captures: Vec::new(),
            program: Vec::new(),
            risk_group: group,
            risk_quantities: quantities,
        };
        let uva = |value, group| quantity("E_UVA", value, [10.0, 33.0, 100.0], group);
        let ir = quantity("E_IR", 5000.0, [100.0, 570.0, 3200.0], RiskGroup::High);
        let high = report(Some(RiskGroup::High), vec![ir, uva(400.0, RiskGroup::High)]);
        let (title, text) = risk_group_term(&high).unwrap();
        assert_eq!(title, "Risk group 3");
        // 400 is four times 100; 5000 is 1.6 times 3200. 1e4 J/m² over 400 W/m² are 25 s.
        for part in ["near ultraviolet (E_UVA): 400 W/m²", "group 2 ends at 100", "25.0 s", "High risk"] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let (title, text) =
            risk_group_term(&report(Some(RiskGroup::Exempt), vec![uva(1.0, RiskGroup::Exempt)])).unwrap();
        assert!(title == "Exempt group" && text.contains("No photobiological hazard"), "{text}");
        assert_eq!(risk_group_term(&report(None, Vec::new())), None);
    }
}
