//! The page of a cohort: what is normal, how good estimates are, and how well lesions are told.

use fluorspar::analysis::{Agreement, Analyte, EstimateOfTruth, ToleranceMethod};
use fluorspar::findings::{
    CohortFindings, CohortQuantity, Finding, FindingId, LesionSeparation, NormalRange, PersonFinding,
};
use fluorspar_experiment::CohortStudy;

use crate::cohort_figures::{
    agreement_figure, chromaticity_figure, measured_people, places, ranges_figure, roc_figure,
    separation_name,
};
use crate::findings::{FindingWords, number, shown, value};
use crate::{Figure, Number, NumberMatrix, ReportData, ReportItem, Section};

/// What was found in a cohort.
#[derive(Clone, Debug)]
pub struct CohortResults {
    /// Title.
    pub title: String,
    /// The cohort.
    pub cohort: CohortStudy,
    /// Every number by the person.
    pub findings: Vec<(u32, PersonFinding)>,
    /// What they say together.
    pub said: CohortFindings,
    /// Name of the analyzed frame.
    pub frame: String,
    /// What texts call the fluorophore whose share is estimated.
    pub analyte: Analyte,
    /// The file with everything that it rests on.
    pub toml: String,
    /// Files that it names.
    pub inputs: Vec<String>,
    /// Its digest.
    pub sha256: String,
}

/// A part as people say it.
pub(crate) fn part_name(part: &str) -> String {
    part.replace('_', " ")
}

/// A number of a cohort as a finding, for its words.
pub(crate) fn finding_of(
    quantity: &CohortQuantity,
    value: Option<f64>,
    interval: Option<[f64; 2]>,
) -> Finding {
    let CohortQuantity { id, frame, channel, name, .. } = quantity.clone();
    Finding { frame, channel, name, interval, ..Finding::new(id, value) }
}

/// Fewest people whose differences have ends that are told.
const PEOPLE_OF_LIMITS: u32 = 20;

/// The estimates whose agreement is told, the first that a cohort has first.
const ESTIMATES: [FindingId; 4] =
    [FindingId::RedShare, FindingId::Share, FindingId::LineShare, FindingId::UnmixedShare];

/// The agreement of an estimate in all parts and people together.
fn overall(found: &CohortResults, id: FindingId) -> Option<Agreement> {
    let cases =
        found.findings.iter().filter(|(_, finding)| finding.quantity.id == id).filter_map(|(_, finding)| {
            let interval = finding.interval.and_then(|[low, high]| Some([low?, high?]));
            Some(EstimateOfTruth { estimate: finding.value, interval, truth: finding.reference? })
        });
    Agreement::of(&cases.collect::<Vec<_>>())
}

/// The figures of the page by the stems of their files.
pub fn cohort_figures(found: &CohortResults) -> Vec<(&'static str, Figure)> {
    let main = ESTIMATES.into_iter().find_map(|id| Some((id, overall(found, id)?)));
    let colors = found.said.ranges.iter().any(|range| range.quantity.id == FindingId::ChromaticityR);
    let figures = [
        ("chromaticity", colors.then(|| chromaticity_figure(found))),
        ("ranges", ranges_figure(found)),
        ("agreement", main.and_then(|(id, all)| agreement_figure(found, id, &all))),
        ("roc", roc_figure(&found.said.separations)),
    ];
    figures.into_iter().filter_map(|(stem, figure)| Some((stem, figure?))).collect()
}

/// The page of a cohort.
pub fn cohort_report(found: &CohortResults) -> ReportData {
    let figures = cohort_figures(found);
    let figure = |stem: &str| figures.iter().find(|(of, _)| *of == stem).map(|(_, figure)| figure.clone());
    let sections = [
        colors_section(found, figure("chromaticity")),
        ranges_section(found, figure("ranges")),
        agreement_section(found, figure("agreement")),
        lesions_section(found, figure("roc")),
    ];
    ReportData {
        title: found.title.clone(),
        overview: None,
        live: None,
        lead: verdict(found),
        headline: headline(found),
        warnings: Vec::new(),
        sections: sections.into_iter().flatten().collect(),
        provenance: vec![
            ("people".into(), people(found)),
            ("sha256".into(), found.sha256.clone()),
            ("version".into(), env!("CARGO_PKG_VERSION").into()),
        ],
        experiment_toml: found.toml.clone(),
        input_files: found.inputs.clone(),
        rerun_command: "fluorspar cohort report.html".into(),
    }
}

fn people(found: &CohortResults) -> String {
    let people = &found.cohort.people;
    let last = people.first.saturating_add(people.count - 1);
    let drawn = match people.count {
        1 => format!("One drawn person, number {last}"),
        count => format!("{count} drawn people, numbers {} to {last}", people.first),
    };
    let views = found.cohort.views.len();
    format!("{drawn}, in {views} view{}", if views == 1 { "" } else { "s" })
}

/// The range of a number of a part in the analyzed frame.
fn range_of<'a>(
    found: &'a CohortResults,
    id: FindingId,
    (view, part): (&str, &str),
) -> Option<&'a NormalRange> {
    found.said.ranges.iter().find(|range| {
        let of = &range.quantity;
        (of.id, of.view.as_str(), of.part.as_str()) == (id, view, part)
            && of.frame.as_deref() == Some(found.frame.as_str())
            && of.name.is_none()
    })
}

fn verdict(found: &CohortResults) -> Vec<String> {
    let mut lead = vec![format!("{}, drawn from assumed populations and rendered.", people(found))];
    let description = &found.cohort.experiment.file.description;
    if !description.is_empty() {
        lead.insert(0, description.clone());
    }
    let first = places(found)
        .into_iter()
        .find_map(|place| Some((place.1, range_of(found, FindingId::ChromaticityR, place)?)));
    if let Some((part, range)) = first {
        let seen = &range.statistics;
        let people =
            if found.cohort.lesions().is_empty() { "these people" } else { "those without a lesion" };
        let (of_people, of_all) = match range.tolerance {
            Some(t) => (
                format!("from {} to {} (5 to 95 % of {people})", number(seen.p05), number(seen.p95)),
                format!(
                    "Normal (95 % of people, with 95 % confidence): {} to {}.",
                    number(t.low),
                    number(t.high)
                ),
            ),
            None => (
                format!("{} (median of {people})", number(seen.median)),
                format!("{} people are too few for a range of normal values, which takes ten.", seen.n),
            ),
        };
        lead.push(format!("The {} has r {of_people}. {of_all}", part_name(part)));
    }
    lead.extend(
        ESTIMATES.into_iter().find_map(|id| Some(agreement_sentence(found, id, &overall(found, id)?))),
    );
    let separations = &found.said.separations;
    lead.extend(separations.first().map(|best| separation_sentence(best, separations.len())));
    lead
}

fn agreement_sentence(found: &CohortResults, id: FindingId, all: &Agreement) -> String {
    let name = FindingWords::of(&found.analyte).name(&Finding::new(id, None));
    let percent = |share: f64| format!("{:+.1}", 100.0 * share);
    // Views of one person are alike: few people say little of the ends
    let people = found.cohort.people.count;
    let spread = if people < PEOPLE_OF_LIMITS {
        String::new()
    } else {
        format!(", 95 % of them by {} to {}", percent(all.limits[0]), percent(all.limits[1]))
    };
    let refused = match all.without_estimate {
        0 => String::new(),
        without => format!(" {without} more have no estimate, which the mean leaves out."),
    };
    format!(
        "{name}: {} estimates in {people} people are off by {} percentage points in the mean{spread}; {} of {} intervals hold the \
         truth.{refused}",
        all.n,
        percent(all.bias),
        all.held,
        all.with_interval
    )
}

fn separation_sentence(best: &LesionSeparation, tried: usize) -> String {
    let [low, high] = best.area.interval_of_best(tried);
    let size = best.group_size.map_or_else(String::new, |size| {
        let width = LesionSeparation::WANTED_HALF_WIDTH;
        format!(" To know that area to ±{width} takes {size} people in each group.")
    });
    format!(
        "Of {tried} numbers what tells the lesion best is {}, {} with it: area under the ROC curve {:.2} (95 %, as the best of {tried}: \
         {low:.2} to {high:.2}).{size}",
        separation_name(best),
        if best.is_lower { "darker" } else { "brighter" },
        best.area.area
    )
}

fn headline(found: &CohortResults) -> Vec<Number> {
    let mut numbers = Vec::new();
    if let Some((part, range)) = places(found)
        .into_iter()
        .find_map(|place| Some((place.1, range_of(found, FindingId::ChromaticityR, place)?)))
    {
        let ends = range.tolerance.map(|t| [t.low, t.high]);
        let finding = finding_of(&range.quantity, Some(range.statistics.median), ends);
        let meaning = match ends {
            Some(_) => "median of people without a lesion, in brackets what 95 % of all have",
            None => "median of people without a lesion",
        };
        numbers.push(Number::computed(format!("r of the {}", part_name(part)), value(&finding), "", meaning));
    }
    if let Some((_, all)) = ESTIMATES.into_iter().find_map(|id| Some((id, overall(found, id)?))) {
        let held = format!("{} of {}", all.held, all.with_interval);
        numbers.push(Number::computed("intervals that hold the truth", held, "", "of 95 % each"));
    }
    numbers.extend(found.said.separations.first().map(|best| {
        let d_prime = best.d_prime.map_or_else(|| "-".into(), number);
        Number::computed("d' of the lesion among people", d_prime, "", separation_name(best))
    }));
    numbers
}

fn colors_section(found: &CohortResults, figure: Option<Figure>) -> Option<Section> {
    let measured = match measured_people(found) {
        [] => "Measured people are drawn for the sensor \"consumer_rgb_cmos\" alone.",
        _ => {
            "S1 to S4 are measured: inner lips and tongues of four people under 405 nm, their light from 500 to 700 nm through this quantum \
             efficiency (spectra: Farrell, Mou and Wandell, github.com/ISET/oe_tongue_lip). Another light or filter moves people, not them."
        }
    };
    let caption = format!("Each mark is the mean color of a part of one person. {measured}");
    Some(Section::new("Colors").show(figure?, caption))
}

fn ranges_section(found: &CohortResults, figure: Option<Figure>) -> Option<Section> {
    use FindingId as Id;

    let words = FindingWords::of(&found.analyte);
    let told =
        [Id::ChromaticityR, Id::ChromaticityG, Id::RedShare, Id::Share, Id::LineShare, Id::MedianSignal];
    let mut rows = Vec::new();
    for (view, part) in places(found) {
        let is_here = |range: &&NormalRange| {
            let of = &range.quantity;
            (of.view.as_str(), of.part.as_str()) == (view, part) && told.contains(&of.id)
        };
        for range in found.said.ranges.iter().filter(is_here) {
            let ends = range.tolerance.map(|t| [t.low, t.high]);
            let of = finding_of(&range.quantity, Some(range.statistics.median), None);
            let by_ranks = range.tolerance.is_some_and(|t| t.method == ToleranceMethod::OrderStatistics);
            let interval = ends.map_or_else(
                || "too few".into(),
                |ends| {
                    let shown = value(&finding_of(&range.quantity, None, Some(ends)));
                    if by_ranks { format!("{shown}, ranks") } else { shown }
                },
            );
            let frame = range.quantity.frame.clone().unwrap_or_default();
            let unit = shown(&of).unit;
            let name = if matches!(of.id, Id::ChromaticityR | Id::ChromaticityG) {
                format!("{} of frame \"{frame}\"", words.name(&of))
            } else {
                words.name(&of)
            };
            rows.push(vec![
                part_name(part),
                if unit.is_empty() { name } else { format!("{name}, {unit}") },
                range.statistics.n.to_string(),
                value(&of),
                interval,
            ]);
        }
    }
    let matrix = NumberMatrix {
        caption: "Normal ranges".into(),
        columns: ["part", "number", "people", "median", "95 % of people"].map(String::from).into(),
        rows,
        note: "With 95 % confidence 95 % of all people of these populations lie within: by order statistics where marked \"ranks\", else from mean \
             and standard deviation of logarithms (signals) or log odds (shares), taken as normal. People with a lesion on the part and signals \
             of clipped pixels are left out. More numbers are in ranges.csv."
            .into(),
    };
    let mut section = Section::new("What is normal");
    if let Some(figure) = figure {
        section = section.show(
            figure,
            "Bars hold 95 % of people with 95 % confidence; they are missing below ten people.",
        );
    }
    Some(section.with(ReportItem::Matrix(matrix)))
}

fn agreement_section(found: &CohortResults, figure: Option<Figure>) -> Option<Section> {
    let words = FindingWords::of(&found.analyte);
    let mut rows = Vec::new();
    for of in &found.said.agreements {
        let percent = |value: f64| format!("{:+.2}", 100.0 * value);
        let range = |[low, high]: [f64; 2]| format!("{} to {}", percent(low), percent(high));
        let Agreement { n, without_estimate, bias, bias_interval, limits, held, with_interval, .. } =
            of.agreement;
        rows.push(vec![
            part_name(&of.quantity.part),
            words.name(&finding_of(&of.quantity, None, None)),
            n.to_string(),
            without_estimate.to_string(),
            format!("{} ({})", percent(bias), range(bias_interval)),
            range(limits),
            format!("{held} of {with_interval}"),
        ]);
    }
    if rows.is_empty() {
        return None;
    }
    let columns = [
        "part",
        "estimate",
        "people",
        "without estimate",
        "bias (95 %), %",
        "limits of agreement, %",
        "intervals that hold",
    ];
    let matrix = NumberMatrix {
        caption: "Estimate less truth".into(),
        columns: columns.map(String::from).into(),
        rows,
        note: "After Bland and Altman (1999): between the limits lie 95 % of differences. The truth is that of the simulation.".into(),
    };
    let mut section = Section::new("Truth against estimate");
    if let Some(figure) = figure {
        section = section.show(
            figure,
            "Each mark is a person; a perfect estimate lies on the dashed line, and at 0 on the right.",
        );
    }
    Some(section.with(ReportItem::Matrix(matrix)))
}

/// Lesions of which too few people have any, or all but a few.
fn too_few(found: &CohortResults) -> Option<Section> {
    let people = &found.cohort.people;
    let numbers = (0..people.count).map(|person| people.first.saturating_add(person));
    let counts = |lesion| {
        let with = numbers.clone().filter(|person| found.cohort.has_lesion(*person, lesion)).count();
        let text = format!("{with} of {} people have \"{}\".", people.count, lesion.name);
        ReportItem::Paragraph(text)
    };
    let lesions = found.cohort.lesions();
    let section = lesions.iter().map(counts).fold(Section::new("Lesions"), Section::with);
    let why = "How well a lesion is told takes two people with it and two without, in a view that shows it.";
    (!lesions.is_empty()).then(|| section.with(ReportItem::Paragraph(why.into())))
}

fn lesions_section(found: &CohortResults, figure: Option<Figure>) -> Option<Section> {
    let Some(figure) = figure else { return too_few(found) };
    let row = |of: &LesionSeparation| {
        let [low, high] = of.area.interval;
        vec![
            separation_name(of),
            if of.is_lower { "darker" } else { "brighter" }.to_owned(),
            format!("{} / {}", of.area.n[0], of.area.n[1]),
            format!("{:.3} ({low:.3} to {high:.3})", of.area.area),
            of.d_prime.map_or_else(|| "-".into(), number),
            of.group_size.map_or_else(|| "-".into(), |size| size.to_string()),
        ]
    };
    let width = LesionSeparation::WANTED_HALF_WIDTH;
    let columns =
        ["lesion", "with it", "people with / without", "area (95 %)", "d'", &format!("people for ±{width}")];
    let matrix = NumberMatrix {
        caption: "People with a lesion against people without".into(),
        columns: columns.map(String::from).into(),
        rows: found.said.separations.iter().map(row).collect(),
        note: format!(
            "The score is the contrast of the place of the lesion to its surroundings, in people without it, too. Mucosa without a lesion is more \
             even here than in a clinic, and lesions of one file are alike: there areas are smaller. Intervals of areas after Newcombe (2006); the last column is the size of each of two groups that gives the area to ±{width} (Hanley and McNeil 1982). The \
             direction is chosen after the fact: areas near 0.5 are no finding."
        ),
    };
    let caption = "Each step of a curve is a person, sorted by the contrast of the place of the lesion to its surroundings.";
    Some(Section::new("Lesions").show(figure, caption).with(ReportItem::Matrix(matrix)))
}
