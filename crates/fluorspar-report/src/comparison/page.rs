//! Two runs side by side as a page.

use fluorspar_experiment::{SettingDifference, Warning};

use super::run_numbers::{ERROR, is_share};
use super::{
    ComparedNumber, ComparedSide, Distinction, FinishedRun, HOW_JUDGED, comparison_remarks,
    comparison_verdict, numbers_by_region,
};
use crate::{
    Axis, Dash, Figure, Ink, Label, NumberMatrix, Panel, ReportData, ReportItem, ReportPicture, Section,
    Series, SeriesShape,
};

/// Longest value of a setting in the table of the page, whose cells wrap, characters.
const LONGEST_VALUE: usize = 300;
/// Estimates of the analysis that the figure shows at most.
const MOST_ESTIMATES: usize = 4;
/// Further regions that it shows at most.
const MOST_REGIONS: usize = 8;

/// A setting's value for a table, so many characters at most.
fn value_text(value: Option<&toml::Value>, longest: usize) -> String {
    let Some(value) = value else { return "-".into() };
    let text = value.as_str().map_or_else(|| rounded(value).to_string(), str::to_owned);
    match text.char_indices().nth(longest) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

/// Numbers of a value to six digits: what is computed of a data sheet has sixteen, of which no more matter.
fn rounded(value: &toml::Value) -> toml::Value {
    match value {
        toml::Value::Float(number) => {
            toml::Value::Float(format!("{number:.5e}").parse::<f64>().unwrap_or(*number))
        }
        toml::Value::Array(items) => toml::Value::Array(items.iter().map(rounded).collect()),
        toml::Value::Table(entries) => {
            toml::Value::Table(entries.iter().map(|(name, entry)| (name.clone(), rounded(entry))).collect())
        }
        other => other.clone(),
    }
}

/// Cells of the row of a setting: path, both values of so many characters at most with their unit.
#[must_use]
pub fn setting_cells(setting: &SettingDifference, longest: usize) -> [String; 3] {
    let side = |value: &Option<toml::Value>| match (value, setting.unit) {
        (Some(value), unit) if !unit.is_empty() && is_number(value) => {
            format!("{} {unit}", value_text(Some(value), longest))
        }
        (value, _) => value_text(value.as_ref(), longest),
    };
    [setting.path.clone(), side(&setting.a), side(&setting.b)]
}

/// Whether a value is made of numbers: words in place of one, as "auto", have no unit.
fn is_number(value: &toml::Value) -> bool {
    match value {
        toml::Value::Integer(_) | toml::Value::Float(_) => true,
        toml::Value::Array(items) => items.iter().all(is_number),
        _ => false,
    }
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
    let apart = numbers.iter().filter(|n| n.told_apart == Distinction::Apart).count();
    let judged = apart + numbers.iter().filter(|n| n.told_apart == Distinction::NotApart).count();
    let counted = match judged {
        0 => "None of the numbers has an interval in both.".into(),
        1 if apart == 1 => "One number has an interval in both runs; it tells them apart.".into(),
        1 => "One number has an interval in both runs; it does not tell them apart.".into(),
        _ => {
            let verb = if apart == 1 { "tells" } else { "tell" };
            format!("{judged} numbers have an interval in both runs; {apart} of them {verb} the runs apart.")
        }
    };
    let mut lead = vec![format!("A is {}.", about(a)), format!("B is {}.", about(b))];
    lead.extend(comparison_verdict(runs, numbers, settings.ok()));
    lead.push(counted);
    let mut sections = Vec::new();
    if !frames.is_empty() {
        sections.push(frames_section(frames));
    }
    sections.push(numbers_section(numbers));
    sections.extend(regions_section(numbers));
    sections.push(settings_section(settings));
    ReportData {
        title: "Two runs compared".into(),
        lead,
        warnings: comparison_remarks(a, b).into_iter().map(Warning::from).collect(),
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

/// Numbers of both runs as a table.
fn matrix<'a>(
    caption: String,
    numbers: impl Iterator<Item = &'a ComparedNumber>,
    note: String,
) -> NumberMatrix {
    let minus = |cell: String| if cell == "-" { cell } else { cell.replace('-', "−") };
    let row = |number: &ComparedNumber| {
        let [a, b, difference, told_apart] = number.cells().map(minus);
        let judged = match number.told_apart {
            Distinction::Apart | Distinction::NotApart | Distinction::NoiseAlone => {
                format!("{difference} {told_apart}")
            }
            _ => difference,
        };
        vec![number.name(), a, b, judged]
    };
    NumberMatrix {
        caption,
        columns: ["Number", "A", "B", "B − A, told apart?"].map(String::from).to_vec(),
        rows: numbers.map(row).collect(),
        note,
    }
}

fn numbers_section(numbers: &[ComparedNumber]) -> Section {
    let of_runs = numbers.iter().filter(|number| number.region.is_none());
    let matrix = matrix("Numbers of both runs".into(), of_runs, HOW_JUDGED.into());
    let mut section = Section::new("Numbers");
    for (stem, figure) in comparison_figures(numbers) {
        section = section.with(ReportItem::Figure { figure, caption: String::new(), stem });
    }
    section.with(ReportItem::Matrix(matrix))
}

/// Further regions that both runs have, a table each.
fn regions_section(numbers: &[ComparedNumber]) -> Option<Section> {
    let regions = numbers_by_region(numbers);
    if regions.is_empty() {
        return None;
    }
    let items = regions.into_iter().map(|(name, block)| {
        ReportItem::Matrix(matrix(format!("Region \"{name}\""), block.iter(), String::new()))
    });
    Some(items.fold(Section::new("Regions"), Section::with))
}

fn settings_section(settings: Result<&[SettingDifference], &str>) -> Section {
    let section = Section::new("Settings that differ");
    match settings {
        Err(why) => section.say(format!("The settings are not compared: {why}")),
        Ok([]) => section.say("None: both have the same settings."),
        Ok(list) => section.with(ReportItem::Matrix(NumberMatrix {
            caption: "By path, as --set takes them".into(),
            columns: ["Setting", "A", "B"].map(String::from).to_vec(),
            rows: list.iter().map(|setting| setting_cells(setting, LONGEST_VALUE).to_vec()).collect(),
            note: "Defaults are included; a dash stands where a run does not have the setting.".into(),
        })),
    }
}

/// Figures of a comparison with the names of their files: the shares with their intervals. Empty where neither run has one.
#[must_use]
pub fn comparison_figures(numbers: &[ComparedNumber]) -> Vec<(String, Figure)> {
    let is_estimate = |n: &&ComparedNumber| {
        let sides = || [&n.a, &n.b].into_iter().flatten();
        is_share(n.id) && !n.quantity.ends_with(ERROR) && sides().any(|side| side.interval.is_some())
    };
    // Of the analysis all estimates, of further regions the first one
    let mut shares: Vec<&ComparedNumber> =
        numbers.iter().filter(|n| n.region.is_none()).filter(is_estimate).take(MOST_ESTIMATES).collect();
    let of_regions = numbers_by_region(numbers);
    shares
        .extend(of_regions.iter().filter_map(|(_, block)| block.iter().find(is_estimate)).take(MOST_REGIONS));
    if shares.is_empty() {
        return Vec::new();
    }
    let ends = shares.iter().flat_map(|n| [&n.a, &n.b]).flatten().flat_map(|side| {
        let values = side.interval.into_iter().flatten().chain(side.value).chain(side.truth);
        values.filter(|value| value.is_finite())
    });
    let (low, high) = ends.fold((0.0f64, 0.0f64), |(low, high), value| (low.min(value), high.max(value)));
    let margin = 0.05 * (high - low).max(1e-6);
    let height = shares.len() as f64;
    let x = Axis::linear("share", "%", [low - margin, high + margin]);
    let mut panel = Panel::new(x, Axis::hidden([0.0, height])).sized(620.0, 90.0 * height + 20.0);
    // Below the estimates, whose dots stay seen
    panel = panel.with(truth_series(&shares));
    for (run, side_of) in [("A", 0), ("B", 1)] {
        panel = with_estimates(panel, run, side_of, &shares);
    }
    // Names stand above their lines, from the left end on
    let name = |(place, n): (usize, &&ComparedNumber)| Label {
        at: [low, height - place as f64 - 0.15],
        text: match &n.region {
            Some(region) => format!("{region}: {}", n.quantity),
            None => n.quantity.clone(),
        },
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

/// Circles at the true shares, beside the estimates of the runs that know them.
fn truth_series(shares: &[&ComparedNumber]) -> Series {
    let circle = |(place, side_of): (usize, usize)| {
        let known = side(shares[place], side_of).as_ref()?.truth?;
        Some([known, place_of(shares.len(), place, side_of)])
    };
    let places = (0..shares.len()).flat_map(|place| [(place, 0), (place, 1)]);
    let points: Vec<[f64; 2]> = places.filter_map(circle).collect();
    let name = (!points.is_empty()).then(|| "truth".into());
    let shape = SeriesShape::Markers { points, radius: 7.0, hollow: true };
    Series { name, ink: Ink::Text, shape }
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

#[cfg(test)]
mod tests {
    use toml::Value;

    use super::*;

    #[test]
    fn only_numbers_have_units() {
        let cells = |a: Value, b: Value| {
            let (path, unit) = ("capture.blue.exposure_ms".into(), "ms");
            setting_cells(&SettingDifference { path, unit, a: Some(a), b: Some(b) }, 60)
        };
        let [_, a, b] = cells(Value::String("auto".into()), Value::Float(30.0));
        assert_eq!((a.as_str(), b.as_str()), ("auto", "30.0 ms"));
        let [_, a, _] = cells(vec![1.0, 2.0].into(), Value::Integer(1));
        assert_eq!(a, "[1.0, 2.0] ms");
        // What a data sheet gives to sixteen digits
        let [_, a, b] = cells(Value::Float(10629.914999008179), vec![0.10122222222222221].into());
        assert_eq!((a.as_str(), b.as_str()), ("10629.9 ms", "[0.101222] ms"));
    }
}
