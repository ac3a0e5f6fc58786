//! Which of two runs sees smaller amounts of porphyrin, in a sentence.

use fluorspar_experiment::SettingDifference;

use super::run_numbers::{LIMIT_OVER_TRUTH, WIDTH_OVER_TRUTH};
use super::{ComparedNumber, ComparedSide, FinishedRun, short};

/// Sections of an experiment that say what lies before the camera.
const SAMPLE: [&str; 7] = ["fluorophore", "tissue", "material", "mouth", "object", "concentration", "motion"];

/// Two numbers that differ by less than this share of the larger one decide nothing: what noise and the random paths of a render move them by.
const ABOUT_EQUAL: f64 = 0.1;

/// Which run sees smaller amounts of the fluorophore that is looked for, by the interval of the share in units of what is there, else by the detection
/// limit. `settings` are those that differ, where they are known. `None` where the truth of neither is known, or one holds no analysis.
#[must_use]
pub fn comparison_verdict(
    [a, b]: [&FinishedRun; 2],
    numbers: &[ComparedNumber],
    settings: Option<&[SettingDifference]>,
) -> Option<String> {
    let (of_a, of_b) = (a.analysis.as_ref()?, b.analysis.as_ref()?);
    let find = |quantity: &str| numbers.iter().find(|n| n.region.is_none() && n.quantity == quantity);
    let has = |quantity: &str| find(quantity).is_some();
    let values = |quantity: &str| {
        let number = find(quantity)?;
        let value = |side: &Option<ComparedSide>| side.as_ref().and_then(|side| side.value);
        Some([value(&number.a)?, value(&number.b)?])
    };
    let target = &a.target;
    let sentence = if let Some(widths) = values(WIDTH_OVER_TRUTH) {
        ranked(target, widths, "the 95 % interval is", " wide")
    } else if let Some(limits) = values(LIMIT_OVER_TRUTH) {
        let sentence = ranked(target, limits, "the detection limit is", "");
        format!("{sentence} It holds the sensor's noise alone, not what is unknown of the tissue.")
    } else if has(WIDTH_OVER_TRUTH) || has(LIMIT_OVER_TRUTH) {
        let withdrawn = [("A", of_a), ("B", of_b)].into_iter().filter(|(_, analysis)| {
            analysis.posterior.as_ref().is_some_and(|posterior| posterior.is_no_estimate())
        });
        let why: Vec<String> = withdrawn
            .map(|(letter, _)| {
                format!("{letter} gives no estimate, as its light is not that of the assumed tissue")
            })
            .collect();
        let why = if why.is_empty() {
            "one of them has no interval or limit that compares with the truth".into()
        } else {
            why.join("; ")
        };
        return Some(format!("Which run sees smaller amounts of {target} is not told: {why}."));
    } else {
        return None;
    };
    let sample: Vec<&str> = settings
        .unwrap_or_default()
        .iter()
        .map(|setting| setting.path.as_str())
        .filter(|path| SAMPLE.contains(&path.split(['.', '[']).next().unwrap_or_default()))
        .collect();
    Some(match (settings, sample.split_first()) {
        (None, _) => format!("{sentence} Whether both see the same sample is not known."),
        (Some(_), None) => sentence,
        (Some(_), Some((first, more))) => {
            let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
            format!(
                "{sentence} The samples differ, too ({first}{more}): this is no comparison of the cameras alone."
            )
        }
    })
}

/// The sentence for numbers in percent of the true share, of which the smaller one is better.
fn ranked(target: &str, [a, b]: [f64; 2], what: &str, adjective: &str) -> String {
    let numbers = format!(
        "In units of the {target} share that is there, {what} {} %{adjective} in A, {} % in B.",
        short(a),
        short(b)
    );
    if (a - b).abs() <= ABOUT_EQUAL * a.max(b) {
        return format!("A and B see about as small amounts of {target}. {numbers}");
    }
    let [better, other] = if a < b { ["A", "B"] } else { ["B", "A"] };
    format!("{better} sees smaller amounts of {target} than {other}. {numbers}")
}
