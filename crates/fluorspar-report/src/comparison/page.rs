//! Two runs side by side as a page.

use fluorspar_experiment::SettingDifference;

use super::{ComparedNumber, ComparedSide, FinishedRun, HOW_JUDGED, ToldApart, comparison_remarks};
use crate::{
    Axis, Dash, Figure, Ink, Label, NumberMatrix, Panel, ReportData, ReportItem, ReportPicture, Section,
    Series, SeriesShape,
};

/// Longest value of a setting in a table, characters.
const LONGEST_VALUE: usize = 60;
/// Estimates that the figure shows at most.
const MOST_ESTIMATES: usize = 4;

/// A setting's value for a table.
pub(super) fn value_text(value: Option<&toml::Value>) -> String {
    let Some(value) = value else { return "-".into() };
    let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    match text.char_indices().nth(LONGEST_VALUE) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

/// Cells of the row of a setting: path, both values with their unit.
#[must_use]
pub fn setting_cells(setting: &SettingDifference) -> [String; 3] {
    let side = |value: &Option<toml::Value>| match (value, setting.unit) {
        (Some(value), unit) if !unit.is_empty() => format!("{} {unit}", value_text(Some(value))),
        (value, _) => value_text(value.as_ref()),
    };
    [setting.path.clone(), side(&setting.a), side(&setting.b)]
}

/// The page of a comparison. `settings` is why they can't be compared, or what differs; `frames` are pairs of pictures with their title
/// and caption.
#[must_use]
pub fn comparison_report(
    runs: [&FinishedRun; 2],
    settings: Result<&[SettingDifference], &str>,
    numbers: &[ComparedNumber],
    frames: Vec<(String, ReportPicture, ReportPicture)>,
) -> ReportData {
    let [a, b] = runs;
    let about = |run: &FinishedRun| match run.title.is_empty() {
        true => run.name.clone(),
        false => format!("{}: {}", run.name, run.title),
    };
    let apart = numbers.iter().filter(|n| n.told_apart == ToldApart::Apart).count();
    let judged = apart + numbers.iter().filter(|n| n.told_apart == ToldApart::NotApart).count();
    let counted = match judged {
        0 => "None of the numbers has an interval in both.".into(),
        _ => format!("Of {judged} numbers with intervals {apart} are told apart."),
    };
    let mut sections = Vec::new();
    if !frames.is_empty() {
        sections.push(frames_section(frames));
    }
    sections.push(numbers_section(numbers));
    sections.push(settings_section(settings));
    ReportData {
        title: "Two runs compared".into(),
        lead: vec![format!("A is {}.", about(a)), format!("B is {}.", about(b)), counted],
        warnings: comparison_remarks(a, b),
        sections,
        ..ReportData::default()
    }
}

fn frames_section(frames: Vec<(String, ReportPicture, ReportPicture)>) -> Section {
    let mut section = Section::new("Frames");
    for (caption, a, b) in frames {
        section = section.with(ReportItem::Pictures(vec![a, b])).say(caption);
    }
    section
}

fn numbers_section(numbers: &[ComparedNumber]) -> Section {
    let minus = |cell: String| if cell == "-" { cell } else { cell.replace('-', "−") };
    let row = |number: &ComparedNumber| {
        let [a, b, difference, told_apart] = number.cells().map(minus);
        let judged = match number.told_apart {
            ToldApart::Apart | ToldApart::NotApart => format!("{difference} {told_apart}"),
            _ => difference,
        };
        vec![number.name(), a, b, judged]
    };
    let matrix = NumberMatrix {
        caption: "Numbers of both runs".into(),
        columns: ["Number", "A", "B", "B − A, told apart?"].map(String::from).to_vec(),
        rows: numbers.iter().map(row).collect(),
        note: HOW_JUDGED.into(),
    };
    let mut section = Section::new("Numbers");
    for (stem, figure) in comparison_figures(numbers) {
        section = section.with(ReportItem::Figure { figure, caption: String::new(), stem });
    }
    section.with(ReportItem::Matrix(matrix))
}

fn settings_section(settings: Result<&[SettingDifference], &str>) -> Section {
    let section = Section::new("Settings that differ");
    match settings {
        Err(why) => section.say(format!("The settings are not compared: {why}")),
        Ok([]) => section.say("None: both have the same settings."),
        Ok(list) => section.with(ReportItem::Matrix(NumberMatrix {
            caption: "By path, as --set takes them".into(),
            columns: ["Setting", "A", "B"].map(String::from).to_vec(),
            rows: list.iter().map(|setting| setting_cells(setting).to_vec()).collect(),
            note: "Defaults are included; a dash stands where a run does not have the setting.".into(),
        })),
    }
}

/// Figures of a comparison with the names of their files: the shares with their intervals. Empty where neither run has one.
#[must_use]
pub fn comparison_figures(numbers: &[ComparedNumber]) -> Vec<(String, Figure)> {
    let is_share = |n: &&ComparedNumber| {
        n.unit.is_empty()
            && n.quantity.to_lowercase().contains("share")
            && !n.quantity.contains("less the true")
            && [&n.a, &n.b].iter().any(|side| side.as_ref().is_some_and(|s| s.interval.is_some()))
    };
    let shares: Vec<&ComparedNumber> = numbers.iter().filter(is_share).take(MOST_ESTIMATES).collect();
    if shares.is_empty() {
        return Vec::new();
    }
    let truth = numbers.iter().find(|n| n.quantity.starts_with("True "));
    let ends = shares.iter().copied().chain(truth).flat_map(|n| [&n.a, &n.b]).flatten().flat_map(|side| {
        side.interval.into_iter().flatten().chain(side.value).filter(|value| value.is_finite())
    });
    let (low, high) = ends.fold((0.0f64, 0.0f64), |(low, high), value| (low.min(value), high.max(value)));
    let margin = 0.05 * (high - low).max(1e-6);
    let height = shares.len() as f64;
    let x = Axis::linear("share", "", [low - margin, high + margin]);
    let mut panel = Panel::new(x, Axis::hidden([0.0, height])).sized(620.0, 90.0 * height + 20.0);
    // Below the estimates, whose dots stay seen
    panel = panel.with(truth_series(truth, &shares));
    for (run, side_of) in [("A", 0), ("B", 1)] {
        panel = with_estimates(panel, run, side_of, &shares);
    }
    // Names stand above their lines, from the left end on
    let name = |(place, n): (usize, &&ComparedNumber)| Label {
        at: [low, height - place as f64 - 0.15],
        text: n.quantity.clone(),
    };
    let names = SeriesShape::Labels(shares.iter().enumerate().map(name).collect());
    panel = panel.with(Series::unnamed(Ink::Text, names));
    let figure = Figure::new("Shares with their intervals", panel)
        .explained("Lines are intervals of 95 %, dots estimates; a line without a dot is a limit. Circles are true shares, of a simulation.");
    vec![("shares".into(), figure)]
}

fn side(number: &ComparedNumber, side_of: usize) -> &Option<ComparedSide> {
    if side_of == 0 { &number.a } else { &number.b }
}

/// Height of the line of a run among so many shares.
fn place_of(shares: usize, place: usize, side_of: usize) -> f64 {
    shares as f64 - place as f64 - 0.45 - 0.25 * side_of as f64
}

/// Circles at the true share, beside the estimates of the runs that know it.
fn truth_series(truth: Option<&ComparedNumber>, shares: &[&ComparedNumber]) -> Series {
    let known = |side_of: usize| truth.and_then(|n| side(n, side_of).as_ref()?.value);
    let circle = |(place, side_of): (usize, usize)| {
        side(shares[place], side_of).as_ref()?;
        Some([known(side_of)?, place_of(shares.len(), place, side_of)])
    };
    let places = (0..shares.len()).flat_map(|place| [(place, 0), (place, 1)]);
    let points = places.filter_map(circle).collect();
    let shape = SeriesShape::Markers { points, radius: 7.0, hollow: true };
    Series { name: truth.map(|_| "truth".into()), ink: Ink::Text, shape }
}

/// The estimates of one run, each on its own height: lines for the intervals, dots for the values.
fn with_estimates(mut panel: Panel, run: &str, side_of: usize, shares: &[&ComparedNumber]) -> Panel {
    let ink = Ink::cycle(side_of);
    let (mut dots, mut lines) = (Vec::new(), Vec::new());
    for (place, number) in shares.iter().enumerate() {
        let y = place_of(shares.len(), place, side_of);
        let Some(side) = side(number, side_of) else { continue };
        dots.extend(side.value.map(|value| [value, y]));
        if let Some([low, high]) = side.interval {
            // Not a number interrupts the line between two intervals
            lines.extend([[low, y], [high, y], [f64::NAN, f64::NAN]]);
        }
    }
    let shape = SeriesShape::Line { points: lines, width: 3.0, dash: Dash::Solid };
    panel = panel.with(Series { name: Some(run.into()), ink, shape });
    panel.with(Series::unnamed(ink, SeriesShape::Markers { points: dots, radius: 4.0, hollow: false }))
}
