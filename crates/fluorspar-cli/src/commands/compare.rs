//! `fluorspar compare`: two finished runs in words.

use fluorspar_report::{ComparedNumber, HOW_JUDGED, numbers_by_region, setting_cells};
use fluorspar_session::Comparison;

use super::table::align;

/// Longest value of a setting in a line, characters.
const LONGEST_VALUE: usize = 60;

/// The comparison as text.
pub(crate) fn describe(comparison: &Comparison) -> String {
    let Comparison { compared, settings, numbers, .. } = comparison;
    let mut text = String::new();
    for (letter, run) in [("A", &compared.a), ("B", &compared.b)] {
        let title = run.title.as_deref().unwrap_or_default();
        text += format!("{letter}  {}  {title}\n", run.folder).trim_end();
        text.push('\n');
    }
    match settings {
        None => {
            let why = comparison.settings_not_compared.as_deref().unwrap_or_default();
            text += &format!("\nThe settings are not compared: {why}\n");
        }
        Some(list) if list.is_empty() => text += "\nNo setting differs.\n",
        Some(list) => {
            let head = ["Setting that differs", "A", "B"].map(String::from).to_vec();
            let rows = list.iter().map(|setting| setting_cells(setting, LONGEST_VALUE).to_vec());
            text += &format!("\n{}", align(&std::iter::once(head).chain(rows).collect::<Vec<_>>(), &[1, 2]));
        }
    }
    let head = ["Number", "A", "B", "B - A", "told apart"].map(String::from).to_vec();
    let row = |number: &ComparedNumber| {
        let [a, b, difference, verdict] = number.cells();
        // The interval of the difference is in the page and in the JSON: lines are long enough
        let difference = difference.split(" (").next().unwrap_or_default().to_owned();
        vec![number.name(), a, b, difference, verdict]
    };
    let rows: Vec<Vec<String>> = std::iter::once(head.clone())
        .chain(numbers.iter().filter(|number| number.region.is_none()).map(row))
        .collect();
    text += &format!("\n{}", align(&rows, &[4]));
    for (name, block) in numbers_by_region(numbers) {
        let rows: Vec<Vec<String>> = std::iter::once(head.clone()).chain(block.iter().map(row)).collect();
        text += &format!("\nRegion \"{name}\"\n{}", align(&rows, &[4]));
    }
    text += &format!("\n{HOW_JUDGED}\n");
    if let Some(verdict) = &comparison.verdict {
        text += &format!("\n{verdict}\n");
    }
    for remark in &comparison.warnings {
        text += &format!("{remark}\n");
    }
    text
}
