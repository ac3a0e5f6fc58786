//! The figures of a cohort: colors of all people beside measured ones, ranges by part, estimates against truth, ROC curves.

use fluorspar::analysis::Agreement;
use fluorspar::findings::{
    CohortAgreement, CohortQuantity, FindingId, LesionSeparation, NormalRange, PersonFinding,
};
use fluorspar_experiment::schema::EfficiencyReference;

use crate::cohort_report::{CohortResults, part_name};
use crate::{Axis, Dash, Figure, Ink, Label, Panel, Series, SeriesShape};

/// A measured person: who, which part, `(r, g)`.
type Measured = (&'static str, &'static str, [f64; 2]);

/// Inner lips and backs of tongues of four people under a 405 nm LED, medians of three or four spectra each: radiance from 500 to 700 nm
/// as photons through the quantum efficiency "consumer_rgb_cmos". Spectra: J. Farrell, Z. Mou, B. Wandell,
/// github.com/ISET/oe_tongue_lip, 2024.
const MEASURED: [Measured; 8] = [
    ("S1", "lower_lip", [0.393, 0.473]),
    ("S2", "lower_lip", [0.388, 0.474]),
    ("S3", "lower_lip", [0.341, 0.511]),
    ("S4", "lower_lip", [0.351, 0.508]),
    ("S1", "tongue_dorsum", [0.403, 0.475]),
    ("S2", "tongue_dorsum", [0.443, 0.440]),
    ("S3", "tongue_dorsum", [0.414, 0.465]),
    ("S4", "tongue_dorsum", [0.507, 0.387]),
];

/// The measured people, where the camera of a cohort has the quantum efficiency that their colors are of.
pub(crate) fn measured_people(found: &CohortResults) -> &'static [Measured] {
    let sensor = found.cohort.experiment.file.sensor.as_ref();
    let is_same = sensor.is_some_and(|sensor| sensor.quantum_efficiency == EfficiencyReference::default());
    if is_same { &MEASURED } else { &[] }
}

/// Numbers of a kind in the analyzed frame, of parts and not of lesions.
fn of_analyzed_frame(quantity: &CohortQuantity, id: FindingId, frame: &str) -> bool {
    quantity.id == id
        && quantity.frame.as_deref() == Some(frame)
        && quantity.channel.is_none()
        && quantity.name.is_none()
}

/// The parts of a cohort with their views, in the order of the examination.
pub(crate) fn places(found: &CohortResults) -> Vec<(&str, &'static str)> {
    let views = found.cohort.views.iter();
    views.flat_map(|view| view.parts.iter().map(|part| (view.name, *part))).collect()
}

/// `(r, g)` of each person for a part in a view, people with a lesion there apart.
fn colors(found: &CohortResults, (view, part): (&str, &str), has_lesion: bool) -> Vec<[f64; 2]> {
    let of = |id: FindingId| {
        let wanted = move |(_, finding): &&(u32, PersonFinding)| {
            let quantity = &finding.quantity;
            of_analyzed_frame(quantity, id, &found.frame)
                && (quantity.view.as_str(), quantity.part.as_str()) == (view, part)
                && finding.has_lesion == has_lesion
        };
        found.findings.iter().filter(wanted).filter_map(|(person, finding)| Some((*person, finding.value?)))
    };
    let greens: std::collections::BTreeMap<u32, f64> = of(FindingId::ChromaticityG).collect();
    of(FindingId::ChromaticityR).filter_map(|(person, r)| Some([r, *greens.get(&person)?])).collect()
}

/// All people in the plane of chromaticities, by part, with the measured ones as names.
pub(crate) fn chromaticity_figure(found: &CohortResults) -> Figure {
    let clouds: Vec<(String, Vec<[f64; 2]>, bool)> = places(found)
        .into_iter()
        .flat_map(|place| [false, true].map(|has_lesion| (place, has_lesion)))
        .map(|(place, has_lesion)| {
            let lesion = if has_lesion { ", with a lesion" } else { "" };
            (format!("{}{lesion}", part_name(place.1)), colors(found, place, has_lesion), has_lesion)
        })
        .filter(|(_, points, _)| !points.is_empty())
        .collect();
    let measured = measured_people(found);
    let all = clouds.iter().flat_map(|(_, points, _)| points).chain(measured.iter().map(|(_, _, at)| at));
    let limits = [0, 1].map(|axis: usize| {
        let (low, high) = all
            .clone()
            .fold((1.0f64, 0.0f64), |(low, high), point| (low.min(point[axis]), high.max(point[axis])));
        [((20.0 * low - 0.2).floor() / 20.0).max(0.0), ((20.0 * high + 0.2).ceil() / 20.0).min(1.0)]
    });
    let mut panel = Panel::new(
        Axis::linear("r = R / (R + G + B)", "", limits[0]),
        Axis::linear("g = G / (R + G + B)", "", limits[1]),
    )
    .sized(520.0, 420.0);
    for (number, (name, points, hollow)) in clouds.into_iter().enumerate() {
        let shape = SeriesShape::Markers { points, radius: 3.0, hollow };
        panel = panel.with(Series { name: Some(name), ink: Ink::cycle(number), shape });
    }
    // Rings around the measured ones hide nobody
    for (part, name, ink) in
        [("tongue_dorsum", "measured tongues", Ink::Text), ("lower_lip", "measured inner lips", Ink::Muted)]
    {
        let points: Vec<[f64; 2]> = measured.iter().filter(|of| of.1 == part).map(|of| of.2).collect();
        if !points.is_empty() {
            let shape = SeriesShape::Markers { points, radius: 8.0, hollow: true };
            panel = panel.with(Series { name: Some(name.into()), ink, shape });
        }
    }
    let label = |(who, _, at): &Measured| Label { at: *at, text: (*who).to_owned() };
    panel = panel.with(Series::unnamed(Ink::Text, SeriesShape::Labels(measured.iter().map(label).collect())));
    Figure::new(format!("Mean colors of all people, frame \"{}\"", found.frame), panel)
}

/// What the ranges of a kind are drawn as.
pub(crate) struct RangeAxis {
    pub(crate) id: FindingId,
    pub(crate) label: &'static str,
    /// Factor on values, and unit.
    pub(crate) scale: (f64, &'static str),
}

/// The kinds whose ranges are drawn.
pub(crate) const RANGES: [RangeAxis; 2] = [
    RangeAxis { id: FindingId::ChromaticityR, label: "r = R / (R + G + B)", scale: (1.0, "") },
    RangeAxis { id: FindingId::RedShare, label: "estimated red fluorescence", scale: (100.0, "%") },
];

/// Ranges by part: all people as dots, median and tolerance interval.
pub(crate) fn ranges_figure(found: &CohortResults) -> Option<Figure> {
    let panels: Vec<Panel> = RANGES.iter().filter_map(|axis| ranges_panel(found, axis)).collect();
    (!panels.is_empty()).then(|| Figure::grid("People without lesions", panels, 1))
}

fn ranges_panel(found: &CohortResults, axis: &RangeAxis) -> Option<Panel> {
    let places = places(found);
    let of_place = |(view, part): &(&str, &str)| {
        let is_it = |range: &&NormalRange| {
            of_analyzed_frame(&range.quantity, axis.id, &found.frame)
                && (range.quantity.view.as_str(), range.quantity.part.as_str()) == (*view, *part)
        };
        found.said.ranges.iter().find(is_it)
    };
    let rows: Vec<(&(&str, &str), &NormalRange)> =
        places.iter().filter_map(|place| Some((place, of_place(place)?))).collect();
    let scale = axis.scale.0;
    let ends = rows.iter().flat_map(|(_, range)| {
        let tolerance = range.tolerance.map(|t| [t.low, t.high]).into_iter().flatten();
        tolerance.chain([range.statistics.min, range.statistics.max])
    });
    let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if rows.is_empty() {
        return None;
    }
    let margin = (0.05 * (high - low)).max(1e-3);
    let limits = [(low - margin).max(0.0) * scale, (high + margin).min(1.0) * scale];
    let names = rows.iter().map(|((_, part), _)| part_name(part));
    let y = Axis::named("", names).downward();
    let height = 60.0 + 26.0 * rows.len() as f64;
    let mut panel = Panel::new(Axis::linear(axis.label, axis.scale.1, limits), y).sized(520.0, height);
    let (mut bars, mut medians, mut dots) = (Vec::new(), Vec::new(), Vec::new());
    for (row, ((view, part), range)) in rows.iter().enumerate() {
        let at = row as f64 + 1.0;
        bars.extend(range.tolerance.map(|t| vec![[t.low * scale, at], [t.high * scale, at]]));
        medians.push([range.statistics.median * scale, at]);
        let values = found.findings.iter().filter(|(_, finding)| {
            of_analyzed_frame(&finding.quantity, axis.id, &found.frame)
                && (finding.quantity.view.as_str(), finding.quantity.part.as_str()) == (*view, *part)
                && !finding.has_lesion
        });
        dots.extend(values.filter_map(|(_, finding)| Some([finding.value? * scale, at + 0.25])));
    }
    panel = panel.with(Series {
        name: Some("each person".into()),
        ink: Ink::Muted,
        shape: SeriesShape::Dots { points: dots, radius: 1.8, opacity: 0.6 },
    });
    for (number, points) in bars.into_iter().enumerate() {
        let name = (number == 0).then(|| "tolerance interval".to_owned());
        panel = panel.with(Series {
            name,
            ink: Ink::PALETTE[0],
            shape: SeriesShape::Line { points, width: 4.0, dash: Dash::Solid },
        });
    }
    Some(panel.with(Series {
        name: Some("median".into()),
        ink: Ink::PALETTE[1],
        shape: SeriesShape::Markers { points: medians, radius: 4.0, hollow: false },
    }))
}

/// Estimates against truth, and their differences with the limits of agreement, of all parts together by color.
pub(crate) fn agreement_figure(found: &CohortResults, id: FindingId, all: &Agreement) -> Option<Figure> {
    let of_parts: Vec<&CohortAgreement> =
        found.said.agreements.iter().filter(|agreement| agreement.quantity.id == id).collect();
    let points = || of_parts.iter().flat_map(|of| &of.points).flatten().copied();
    let top = Axis::from_zero("", "", points().map(|value| 100.0 * value)).limits[1];
    let axis = |label: &str| Axis::linear(label, "%", [0.0, top]);
    let differences = of_parts.iter().flat_map(|of| &of.points).map(|[truth, estimate]| estimate - truth);
    let reach = differences.chain(all.limits).fold(0.0, |most: f64, value| most.max(100.0 * value.abs()));
    if of_parts.is_empty() || !(top > 0.0 && reach > 0.0) {
        return None;
    }
    let diagonal = vec![[0.0, 0.0], [top, top]];
    let mut against = Panel::new(axis("truth"), axis("estimate")).sized(320.0, 320.0).with(Series::dashed(
        "truth",
        Ink::Muted,
        diagonal,
        Dash::Dashed,
    ));
    let difference = Axis::linear("estimate less truth", "%", [-1.05 * reach, 1.05 * reach]);
    let mut apart = Panel::new(axis("truth"), difference).sized(320.0, 320.0);
    let level = |value: f64| vec![[0.0, 100.0 * value], [top, 100.0 * value]];
    apart = apart.with(Series::dashed("mean difference", Ink::Text, level(all.bias), Dash::Solid));
    for (number, limit) in all.limits.into_iter().enumerate() {
        let name = (number == 0).then(|| "limits of agreement".to_owned());
        let shape = SeriesShape::Line { points: level(limit), width: 1.5, dash: Dash::Dotted };
        apart = apart.with(Series { name, ink: Ink::Text, shape });
    }
    for (number, of) in of_parts.iter().enumerate() {
        let percent = |values: &dyn Fn(&[f64; 2]) -> [f64; 2]| -> Vec<[f64; 2]> {
            of.points.iter().map(|point| values(point).map(|value| 100.0 * value)).collect()
        };
        let markers = |points| SeriesShape::Markers { points, radius: 2.8, hollow: false };
        let ink = Ink::cycle(number);
        let name = Some(part_name(&of.quantity.part));
        against = against.with(Series { name, ink, shape: markers(percent(&|point| *point)) });
        let shape = markers(percent(&|[truth, estimate]| [*truth, estimate - truth]));
        apart = apart.with(Series::unnamed(ink, shape));
    }
    Some(Figure::grid("Estimate and truth", vec![against, apart], 2))
}

/// Curves drawn at most.
const MOST_CURVES: usize = 6;

/// ROC curves of the widest areas.
pub(crate) fn roc_figure(separations: &[LesionSeparation]) -> Option<Figure> {
    let axis = |label: &str| Axis::linear(label, "", [0.0, 1.0]);
    let mut panel = Panel::new(axis("1 - specificity"), axis("sensitivity"))
        .sized(380.0, 380.0)
        .with(Series::dashed("chance", Ink::Muted, vec![[0.0, 0.0], [1.0, 1.0]], Dash::Dashed));
    for (number, of) in separations.iter().take(MOST_CURVES).enumerate() {
        let steps = of.curve.windows(2).flat_map(|pair| [pair[0], [pair[0][0], pair[1][1]]]);
        let points = steps.chain(of.curve.last().copied()).collect();
        let name = format!("{}: {:.2}", separation_name(of), of.area.area);
        panel = panel.with(Series::dashed(name, Ink::cycle(number), points, Dash::cycle(number)));
    }
    (!separations.is_empty()).then(|| Figure::new("ROC curves, with their areas", panel))
}

/// The lesion and the channel.
pub(crate) fn separation_name(of: &LesionSeparation) -> String {
    let text = |text: &Option<String>| text.clone().unwrap_or_default();
    let CohortQuantity { frame, channel, name, view, .. } = &of.quantity;
    format!("{} in {view}, {} of frame \"{}\"", text(name), text(channel), text(frame))
}
