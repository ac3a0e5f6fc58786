//! The page of people against norms: who lies outside, and how sure that is.

use fluorspar::analysis::{Analyte, NormPlace, NormSums, Standing};
use fluorspar::findings::{Finding, FindingId};
use fluorspar_experiment::Warning;

use crate::findings::{FindingWords, shown, value};
use crate::{
    Axis, Dash, Figure, Ink, NumberMatrix, Panel, ReportData, ReportItem, Section, Series, SeriesShape,
};

/// A number of a person against a norm.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldNumber {
    /// Pseudonym and visit.
    pub of: [String; 2],
    /// The number; `None` where there is an upper limit only.
    pub value: Option<f64>,
    /// Its interval; `None` where its error is not known.
    pub interval: Option<[f64; 2]>,
    /// Where it stands.
    pub place: NormPlace,
}

/// Numbers of one kind against a norm.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldNumbers {
    /// Name of the region.
    pub region: String,
    /// What the numbers are.
    pub id: FindingId,
    /// Their channel.
    pub channel: Option<String>,
    /// `measured` or `simulated`, of the norm.
    pub origin: String,
    /// Sums over the people of the norm.
    pub sums: NormSums,
    /// The numbers.
    pub numbers: Vec<HeldNumber>,
}

/// Rows of a table and of a figure at most: those outside first.
const MOST_ROWS: [usize; 2] = [400, 40];

/// Standings in the order of a page, with the ink of each.
const STANDINGS: [(Standing, Ink); 3] = [
    (Standing::Outside, Ink::PALETTE[1]),
    (Standing::CannotTell, Ink::Muted),
    (Standing::Inside, Ink::PALETTE[0]),
];

/// The ink of ranges, in which people lie.
const RANGE: Ink = Ink::Rgb(190, 204, 216);

/// What a standing is called.
#[must_use]
pub fn verdict_of(standing: Standing) -> &'static str {
    match standing {
        Standing::Inside => "inside",
        Standing::Outside => "OUTSIDE",
        Standing::CannotTell => "can't tell",
    }
}

/// What is known of a percentile.
#[must_use]
pub fn percentile_of([low, high]: [f64; 2]) -> String {
    const LAST: f64 = 99.9;
    match (low > LAST, high < 100.0 - LAST) {
        (true, _) => format!("above {LAST}"),
        (_, true) => format!("below {:.1}", 100.0 - LAST),
        _ => format!("{low:.1} to {high:.1}"),
    }
}

/// The page of people against norms. `left_out` says which numbers no norm holds for, and why.
#[must_use]
pub fn norm_report(
    study: &str,
    held: &[HeldNumbers],
    left_out: &[String],
    warnings: Vec<Warning>,
) -> ReportData {
    let has_numbers = |held: &&HeldNumbers| !held.numbers.is_empty();
    let mut sections: Vec<Section> = held.iter().filter(has_numbers).map(section).collect();
    if !left_out.is_empty() {
        let terms = left_out.iter().map(|text| text.split_once(": ").unwrap_or((text, "")));
        let terms = terms.map(|(of, why)| (of.to_owned(), why.to_owned())).collect();
        sections.push(Section::new("Not held against the norm").with(ReportItem::Terms(terms)));
    }
    ReportData {
        title: format!("{study}: who is outside of what is normal"),
        lead: held.iter().map(lead).collect(),
        warnings,
        sections,
        provenance: vec![("version".into(), env!("CARGO_PKG_VERSION").into())],
        ..ReportData::default()
    }
}

/// Numbers of a standing.
fn of_standing(held: &HeldNumbers, standing: Standing) -> impl Iterator<Item = &HeldNumber> {
    held.numbers.iter().filter(move |number| number.place.standing == standing)
}

fn name_of(held: &HeldNumbers) -> String {
    let finding = Finding { channel: held.channel.clone(), ..Finding::new(held.id, None) };
    FindingWords::of(&Analyte::default()).name(&finding)
}

/// Who lies outside, in a sentence.
fn lead(held: &HeldNumbers) -> String {
    let [outside, open, inside] = STANDINGS.map(|(standing, _)| of_standing(held, standing).count());
    let mut names: Vec<&str> =
        of_standing(held, Standing::Outside).map(|number| number.of[0].as_str()).collect();
    names.dedup();
    let who = match outside {
        _ if held.numbers.is_empty() => "no number can be held against them".to_owned(),
        0 => "nobody outside".to_owned(),
        _ if names.len() <= 12 => format!("OUTSIDE: {}", names.join(", ")),
        _ => format!("{} people outside", names.len()),
    };
    let open = if open == 0 { String::new() } else { format!("; of {open} it can't be told") };
    format!(
        "{} of the {}, against {} {} people: {who}; {inside} of {} numbers inside{open}.",
        name_of(held),
        held.region.replace('_', " "),
        held.sums.people(),
        held.origin,
        held.numbers.len(),
    )
}

fn section(held: &HeldNumbers) -> Section {
    let name = name_of(held);
    let mut numbers: Vec<&HeldNumber> =
        STANDINGS.iter().flat_map(|(standing, _)| sorted(of_standing(held, *standing).collect())).collect();
    numbers.truncate(MOST_ROWS[0]);
    let others = if held.origin == "measured" { "the other people of the norm" } else { "simulated people" };
    let age = if held.sums.by_age { " of that age" } else { "" };
    let site = if held.sums.sites.len() > 1 { " at that site" } else { "" };
    let text = format!(
        "{name} of the {}. The bar of a person is the range of {others}{age}{site}; the line is the whole interval of the number. Numbers \
         of the norm have errors, too.",
        held.region.replace('_', " ")
    );
    let section = Section::new(format!("{name}, {}", held.region.replace('_', " ")));
    let figure = figure(held, &name, &numbers[..numbers.len().min(MOST_ROWS[1])]);
    section.show(figure, text).with(ReportItem::Matrix(table(held, &numbers)))
}

/// Largest first.
fn sorted(mut numbers: Vec<&HeldNumber>) -> Vec<&HeldNumber> {
    let key = |number: &HeldNumber| number.value.unwrap_or(f64::NEG_INFINITY);
    numbers.sort_by(|a, b| key(b).total_cmp(&key(a)));
    numbers
}

/// Each person's range as a bar, the number with its interval over it.
fn figure(held: &HeldNumbers, name: &str, numbers: &[&HeldNumber]) -> Figure {
    let finding = |value: Option<f64>, interval| shown(&Finding { interval, ..Finding::new(held.id, value) });
    let ends = |number: &HeldNumber| {
        finding(None, number.interval)
            .interval
            .or_else(|| finding(number.value, None).value.map(|at| [at; 2]))
    };
    let range = |number: &HeldNumber| finding(None, Some(number.place.range)).interval.unwrap_or_default();
    let all = numbers.iter().flat_map(|number| ends(number).into_iter().chain([range(number)]).flatten());
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let margin = 0.05 * (high - low).max(1e-6);
    let rows = numbers.iter().map(|number| match number.of[1].as_str() {
        "1" | "" => number.of[0].clone(),
        visit => format!("{}, visit {visit}", number.of[0]),
    });
    let x = Axis::linear(name, finding(None, None).unit, [low - margin, high + margin]);
    let height = 60.0 + 20.0 * numbers.len() as f64;
    let mut panel = Panel::new(x, Axis::named("", rows).downward()).sized(560.0, height);
    let line = |points, width| SeriesShape::Line { points, width, dash: Dash::Solid };
    for (row, number) in numbers.iter().enumerate() {
        let at = row as f64 + 1.0;
        let name = (row == 0).then(|| "range of 95 % of people".to_owned());
        let shape = line(range(number).map(|end| [end, at]).to_vec(), 9.0);
        panel = panel.with(Series { name, ink: RANGE, shape });
    }
    for (standing, ink) in STANDINGS {
        let of_it = || numbers.iter().enumerate().filter(|(_, number)| number.place.standing == standing);
        for (row, number) in of_it() {
            let points = ends(number).map(|ends| ends.map(|end| [end, row as f64 + 1.0]).to_vec());
            panel = panel.with(Series::unnamed(ink, line(points.unwrap_or_default(), 2.0)));
        }
        let at = |(row, number): (usize, &&HeldNumber)| {
            Some([finding(number.value, None).value?, row as f64 + 1.0])
        };
        let points: Vec<[f64; 2]> = of_it().filter_map(at).collect();
        if !points.is_empty() {
            let shape = SeriesShape::Markers { points, radius: 4.0, hollow: standing != Standing::Outside };
            panel = panel.with(Series { name: Some(verdict_of(standing).to_lowercase()), ink, shape });
        }
    }
    Figure::new("People against the norm", panel)
}

fn table(held: &HeldNumbers, numbers: &[&HeldNumber]) -> NumberMatrix {
    let cell = |value_of, interval| value(&Finding { interval, ..Finding::new(held.id, value_of) });
    let row = |number: &&HeldNumber| {
        let [person, visit] = number.of.clone();
        let verdict = verdict_of(number.place.standing).to_owned();
        let range = number.place.range.map(|end| cell(Some(end), None)).join(" to ");
        vec![
            person,
            visit,
            verdict,
            cell(number.value, number.interval),
            range,
            percentile_of(number.place.percentile),
        ]
    };
    let unit = shown(&Finding::new(held.id, None)).unit;
    let head = |name: &str| if unit.is_empty() { name.to_owned() } else { format!("{name}, {unit}") };
    let cut = match held.numbers.len() - numbers.len() {
        0 => String::new(),
        more => format!(" {more} further numbers are not shown."),
    };
    let unknown = if held.origin == "measured" { " Who has no outcome counts as healthy." } else { "" };
    NumberMatrix {
        caption: "How sure the verdict is".into(),
        columns: vec![
            "person".into(),
            "visit".into(),
            "verdict".into(),
            head("value (95 %)"),
            head("normal range"),
            "percentile (95 %)".into(),
        ],
        rows: numbers.iter().map(row).collect(),
        note: format!(
            "The range holds 95 % of people with 95 % confidence: beyond it is outside, as are up to five of a hundred healthy people; the \
             range is sure of all people together, a percentile of one number, which beyond the range may reach to below 97.5 or above 2.5. Inside \
             is whose percentile is within 2.5 to 97.5 with 95 % confidence; of others it can't be told.{unknown} People of the norm were measured with errors, too: a number is judged by itself, and by what its interval has beyond those of most of them; \
             an error that all share moves all alike. Percentiles take people as normally distributed.{cut}"
        ),
    }
}
