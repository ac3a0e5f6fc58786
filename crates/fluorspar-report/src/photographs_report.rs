//! The page of many photographs.

use std::collections::{BTreeMap, BTreeSet};

use fluorspar::analysis::Analyte;
use fluorspar::findings::{Caveat, Finding, FindingId};
use fluorspar_experiment::Warning;

use crate::findings::{FindingWords, shown, value};
use crate::{NumberMatrix, ReportData, ReportItem, ReportPicture, Section};

/// A number of a region of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedNumber {
    /// Patient, visit, region.
    pub place: [String; 3],
    /// The frame that it is of.
    pub frame: String,
    /// What it is.
    pub id: FindingId,
    /// The channel that it is of.
    pub channel: Option<String>,
    /// The number.
    pub value: Option<f64>,
    /// Its interval.
    pub interval: Option<[f64; 2]>,
    /// Whether the interval is that of the pixels.
    pub is_of_pixels: bool,
    /// Whether it lies apart from the others.
    pub lies_apart: bool,
}

/// What a page of photographs is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotographResults<'a> {
    /// Title.
    pub title: String,
    /// The experiment that they are analyzed by.
    pub experiment: &'a str,
    /// Numbers, those of a region together.
    pub numbers: Vec<PlacedNumber>,
    /// The photographs.
    pub pictures: Vec<ReportPicture>,
    /// What makes numbers doubtful.
    pub warnings: Vec<Warning>,
    /// Files without an answer, and why.
    pub failures: Vec<(String, String)>,
    /// Whether regions are guesses, to be confirmed before anything is estimated.
    pub is_proposal: bool,
}

/// Warnings of regions, those that differ in numbers alone as one.
#[must_use]
pub fn warnings_by_kind(regions: &[Vec<String>]) -> Vec<Warning> {
    let mut kinds: BTreeMap<String, (usize, BTreeSet<&str>)> = BTreeMap::new();
    for warning in regions.iter().flatten() {
        let kind = warning.chars().filter(|letter| !letter.is_ascii_digit()).collect();
        let (count, texts) = kinds.entry(kind).or_default();
        *count += 1;
        texts.insert(warning);
    }
    let text = |(count, texts): (usize, BTreeSet<&str>)| {
        let first = texts.first().copied().unwrap_or_default();
        match (count, texts.len()) {
            (1, _) => Warning::from(format!("One region: {first}")),
            (_, 1) => Warning::from(format!("{count} regions: {first}")),
            _ => Warning::from(format!("{count} regions, for instance: {first}")),
        }
    };
    kinds.into_values().map(text).collect()
}

/// Numbers of the table.
const TOLD: [FindingId; 4] =
    [FindingId::RedShare, FindingId::Share, FindingId::ChromaticityR, FindingId::ChromaticityG];

/// The page of many photographs.
#[must_use]
pub fn photographs_report(found: &PhotographResults<'_>) -> ReportData {
    let mut sections = Vec::new();
    sections.extend(table(found).map(|matrix| Section::new("Patients").with(ReportItem::Matrix(matrix))));
    if !found.pictures.is_empty() {
        let text = if found.is_proposal {
            "Guessed from color and place alone. The percentage is the chance that a pixel of the region is told from its surroundings, not that \
             the name is right. In photographs.csv \"right\" as the verdict of a line confirms it, \"wrong\" leaves it out; \"guess\" is analyzed with a warning."
        } else {
            "Outlined is what was analyzed; photographs with a number that lies apart come first."
        };
        let pictures = ReportItem::Pictures(found.pictures.clone());
        sections.push(Section::new("Photographs").say(text).with(pictures));
    }
    if !found.failures.is_empty() {
        let terms = ReportItem::Terms(found.failures.clone());
        sections.push(Section::new("Without an answer").with(terms));
    }
    ReportData {
        title: found.title.clone(),
        lead: vec![lead(found)],
        warnings: found.warnings.clone(),
        sections,
        provenance: vec![("version".into(), env!("CARGO_PKG_VERSION").into())],
        ..ReportData::default()
    }
}

fn lead(found: &PhotographResults<'_>) -> String {
    let failed = match found.failures.len() {
        0 => String::new(),
        count => format!(" {count} files have no answer."),
    };
    let apart = places(found).filter(|place| of_place(found, place).any(|number| number.lies_apart)).count();
    let of = format!("Analyzed by {}.", found.experiment);
    match found.is_proposal {
        true => format!("No region is placed yet.{failed}"),
        false if apart > 0 => format!("{of} {apart} regions have a number apart from the others.{failed}"),
        false => format!("{of} No region lies apart from the others.{failed}"),
    }
}

/// Patient, visit and region, each once.
fn places<'a>(found: &'a PhotographResults<'_>) -> impl Iterator<Item = &'a [String; 3]> {
    let before = |index: usize| index.checked_sub(1).map(|index| &found.numbers[index].place);
    let numbers = found.numbers.iter().enumerate();
    numbers
        .filter(move |(index, number)| before(*index) != Some(&number.place))
        .map(|(_, number)| &number.place)
}

fn of_place<'a>(
    found: &'a PhotographResults<'_>,
    place: &'a [String; 3],
) -> impl Iterator<Item = &'a PlacedNumber> {
    found.numbers.iter().filter(move |number| number.place == *place)
}

fn finding_of(number: &PlacedNumber) -> Finding {
    let mut finding = Finding { interval: number.interval, ..Finding::new(number.id, number.value) };
    if number.is_of_pixels {
        finding.caveats.push(Caveat::StandardDeviation);
    }
    finding
}

fn table(found: &PhotographResults<'_>) -> Option<NumberMatrix> {
    let analyte = Analyte::default();
    let words = FindingWords::of(&analyte);
    let told: Vec<FindingId> =
        TOLD.into_iter().filter(|id| found.numbers.iter().any(|number| number.id == *id)).collect();
    let head = |id: &FindingId| {
        let finding = Finding::new(*id, 0.5);
        let unit = shown(&finding).unit;
        let name = words.name(&finding);
        if unit.is_empty() { name } else { format!("{name}, {unit}") }
    };
    let names = ["patient", "visit", "region"].map(String::from).into_iter();
    let columns: Vec<String> =
        names.chain(told.iter().map(head)).chain(std::iter::once("also apart *".to_owned())).collect();
    let name = |number: &PlacedNumber| match &number.channel {
        Some(channel) => format!("signal {channel}"),
        None if number.id == FindingId::LineShare => "share on the line".to_owned(),
        None => words.name(&finding_of(number)).split(" (").next().unwrap_or_default().to_owned(),
    };
    let row = |place: &[String; 3]| -> Vec<String> {
        let cell = |id: &FindingId| {
            let number = of_place(found, place).find(|number| number.id == *id && number.channel.is_none());
            number.map_or_else(
                || "-".into(),
                |number| value(&finding_of(number)) + if number.lies_apart { " *" } else { "" },
            )
        };
        let is_told = |number: &&PlacedNumber| number.channel.is_none() && told.contains(&number.id);
        let apart = of_place(found, place).filter(|number| number.lies_apart && !is_told(number));
        let names: Vec<String> = apart.map(name).collect();
        place.iter().cloned().chain(told.iter().map(cell)).chain(std::iter::once(names.join(", "))).collect()
    };
    let rows: Vec<Vec<String>> = places(found).map(row).collect();
    (!rows.is_empty()).then(|| NumberMatrix {
        caption: "Estimates of each region".into(),
        columns,
        rows,
        note: "In brackets 95 %; ± is the spread of the pixels. A star lies more than 3.5 robust standard deviations from the median of the \
               same number of all photographs: look at the picture first. A dash is what is not estimated of such a region. All numbers and their \
               warnings are in patients.csv."
            .into(),
    })
}
