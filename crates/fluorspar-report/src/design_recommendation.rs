//! Which design is recommended, why, and what it fails at.

use fluorspar::analysis::{DETECTION_Z, VisibleShare};
use fluorspar::design::{Criterion, LimitExcess, WorstCase};
use fluorspar::pipeline::DesignEstimate;

use crate::design_remarks::cures;
use crate::design_report::{DesignFindings, JudgedDesign, digits};

/// Losses within tolerances that differ by a smaller share are the same but for rounding.
const SAME_LOSS: f64 = 1e-6;

/// Designs without a loss of which it is asked what would give them one, at most.
const MOST_ASKED: usize = 200;

/// Whether a design is seen within its tolerances and keeps to all limits there.
fn keeps_to_limits(worst: &WorstCase) -> bool {
    worst.loss.is_finite() && worst.broken.is_empty()
}

/// The place of the design of the least loss within tolerances, of those for which that is known: where some keep to all limits there, of
/// these.
fn best_within_tolerances(found: &DesignFindings<'_>) -> Option<usize> {
    let least = |counts: &dyn Fn(&WorstCase) -> bool| {
        let known = || found.worst_cases.iter().take(found.best.len());
        let loss = known().filter(|worst| counts(worst)).map(|worst| worst.loss).reduce(f64::min)?;
        // Of equal ones the best as meant
        known().position(|worst| counts(worst) && worst.loss <= loss * (1.0 + SAME_LOSS))
    };
    least(&keeps_to_limits).or_else(|| least(&|worst| worst.loss.is_finite()))
}

/// The design that is recommended and its place among the best: the one that is best as it will be made, else as it is meant.
pub fn recommended<'a>(found: &DesignFindings<'a>) -> Option<(usize, &'a JudgedDesign)> {
    let place = best_within_tolerances(found).unwrap_or(0);
    found.best.get(place).map(|judged| (place, judged))
}

/// Which design is recommended, and what it fails at, a sentence each. Without one, why, and what would help.
pub fn recommendation(found: &DesignFindings<'_>) -> Vec<String> {
    let (Some(best), Some((place, made))) = (found.best.first(), recommended(found)) else {
        let step = found.scores.len().div_ceil(MOST_ASKED).max(1);
        let designs = found.scores.iter().step_by(step).map(|(number, _)| found.space.design(*number));
        let none = format!("No design keeps to all limits and sees {}.", found.criterion);
        let why = (!found.left_out.is_empty()).then(|| format!("{}.", found.left_out));
        return std::iter::once(none).chain(why).chain(cures(found.space, designs)).collect();
    };
    let mut sentences = vec![match (place, found.worst_cases.get(place)) {
        (0, Some(worst)) if worst.loss.is_finite() => {
            format!("The best is {}, as meant and within tolerances.", best.name)
        }
        (0, _) => format!("The best is {}.", best.name),
        (_, worst) => format!(
            "Recommended is {}: {}, {}. As meant {} is the best, with a loss of {}, but within tolerances {}.",
            made.name,
            least_of_which(found),
            digits(worst.map_or(f64::NAN, |worst| worst.loss)),
            best.name,
            digits(best.merits.loss),
            what_tolerances_do(&found.worst_cases[0]),
        ),
    }];
    sentences.extend(why_others_see_less(found, made));
    sentences.extend(made.estimate.as_ref().map(estimate_in_words));
    sentences.extend(failings(found, place, made).into_iter().map(|what| format!("But {what}.")));
    sentences
}

/// Share of the fluorophores that a contrast asks for in the fluorescence that a design collects, and their names; `None` where no contrast
/// ranks the designs, or where it asks for all that fluoresces.
pub(crate) fn analyte_share(found: &DesignFindings<'_>, judged: &JudgedDesign) -> Option<(String, f64)> {
    let p = found.space.problem();
    let Criterion::Contrast(k) = p.criterion else { return None };
    let analyte = &p.contrasts.get(k)?.part;
    let shares = &judged.fluorescence.as_ref()?.shares;
    let region = p.regions_of(judged.design.geometry).next()?;
    let (mut names, mut share) = (Vec::new(), 0.0);
    for (part, of_part) in region.response.fluorescence.iter().zip(shares) {
        if analyte.contains(&part.name) {
            names.push(part.name.as_str());
            share += of_part;
        }
    }
    (!names.is_empty() && names.len() < shares.len()).then(|| (names.join(" and "), share))
}

/// How much of the collected light is what the contrast asks for, beside the others of the best: what lights and filters choose by.
fn why_others_see_less(found: &DesignFindings<'_>, made: &JudgedDesign) -> Option<String> {
    let (names, share) = analyte_share(found, made)?;
    let percent = |share: f64| digits(100.0 * share);
    let others = found.best.iter().filter(|judged| judged.design != made.design);
    let shares: Vec<f64> = others.filter_map(|judged| Some(analyte_share(found, judged)?.1)).collect();
    let least = percent(shares.iter().copied().reduce(f64::min)?);
    let most = percent(shares.iter().copied().reduce(f64::max)?);
    let range = if least == most { least } else { format!("{least} to {most}") };
    Some(format!(
        "It collects fluorescence of which {} % is {names}; of the other {} of the best designs {range} %.",
        percent(share),
        shares.len()
    ))
}

/// What an analysis of the frames of a design would find.
fn estimate_in_words(estimate: &DesignEstimate) -> String {
    let percent = |share: f64| digits(100.0 * share);
    let from = |share: Option<f64>| match share {
        Some(share) => format!("from {} % on", percent(share)),
        None => format!("not below {} %", percent(VisibleShare::LARGEST)),
    };
    let [low, high] = estimate.interval.map(percent);
    let limit = estimate.visible.limited_by.as_ref();
    format!(
        "An analysis of its frames would put {} % of porphyrin at {low} to {high} %, and tell porphyrin from none {} in patches over a tenth of \
         the region, {} where it is spread evenly{}: {}.",
        percent(estimate.share),
        from(estimate.visible.in_patches),
        from(estimate.visible.evenly),
        limit.map_or_else(String::new, |limit| format!(", limited by {limit}")),
        estimate.prior
    )
}

/// Of which designs the recommended one has the least loss within tolerances, as a part of a sentence that the loss follows.
fn least_of_which(found: &DesignFindings<'_>) -> String {
    let tried = found.worst_cases.len();
    match found.worst_cases.iter().filter(|worst| keeps_to_limits(worst)).count() {
        1 if tried > 1 => {
            format!("of the {tried} best it alone keeps to all limits within tolerances, with a loss of")
        }
        kept if kept > 0 && kept < tried => format!(
            "of the {tried} best {kept} keep to all limits within tolerances, and of these it has the least loss there"
        ),
        _ => format!("of the {tried} best it has the least loss within tolerances"),
    }
}

/// What tolerances do to a design that is not recommended for them, as the end of a sentence: the limits that they break count before the loss.
fn what_tolerances_do(worst: &WorstCase) -> String {
    if !worst.loss.is_finite() {
        return "it does not see what is asked for".into();
    }
    match &worst.excesses[..] {
        [] => format!("of {}", digits(worst.loss)),
        excesses => excesses.iter().map(limit_in_words).collect::<Vec<_>>().join(", and "),
    }
}

/// A limit that is broken with its numbers, as a part of a sentence: `its leak rises to 11.75 %, beyond limit.leak = 0.01 (1 %)`.
pub(crate) fn limit_in_words(excess: &LimitExcess) -> String {
    let (what, field, factor, unit) = match excess.limit {
        "tissue_margin" => ("margin of the tissue falls", "tissue_margin", 1.0, ""),
        "eye_margin" => ("margin of the eye falls", "eye_margin", 1.0, ""),
        "saturation" => ("saturation rises", "saturation", 1.0, ""),
        "time" => ("time rises", "total_ms", 1e3, " ms"),
        "cost" => ("price rises", "cost", 1.0, ""),
        _ => ("leak rises", "leak", 100.0, " %"),
    };
    let value = if excess.value.is_finite() { digits(factor * excess.value) } else { "infinity".into() };
    // The limit as the file has it, without what the change of units rounded
    let rounded = (1e9 * factor * excess.allowed).round() / 1e9;
    let allowed = match field {
        "total_ms" => rounded.to_string(),
        "leak" => format!("{} ({rounded} %)", excess.allowed),
        _ => excess.allowed.to_string(),
    };
    format!("its {what} to {value}{unit}, beyond limit.{field} = {allowed}")
}

/// What a design fails at though no limit of the file keeps it out, each as the end of a sentence.
fn failings(found: &DesignFindings<'_>, place: usize, judged: &JudgedDesign) -> Vec<String> {
    let merits = &judged.merits;
    let mut failings = Vec::new();
    if merits.saturation > 1.0 {
        failings.push(format!(
            "it saturates: its brightest pixel collects {} times what it holds, and the file lets it (limit.saturation)",
            digits(merits.saturation)
        ));
    }
    let margins =
        [("an eye that looks into its lights", merits.eye_margin), ("the tissue", merits.tissue_margin)];
    for (who, margin) in margins {
        if let Some(margin) = margin.filter(|margin| *margin < 1.0) {
            failings.push(format!("{who} gets {} times the exposure limit", digits(1.0 / margin)));
        }
    }
    if let Some(worst) = found.worst_cases.get(place).filter(|worst| !keeps_to_limits(worst)) {
        failings.push(format!("within its tolerances {}", what_tolerances_do(worst)));
    }
    if let Criterion::Contrast(k) = found.space.problem().criterion {
        for region in &merits.regions {
            let value = region.contrast_values.get(k).copied().flatten();
            let sd = region.contrasts.get(k).copied().filter(|sd| sd.is_finite());
            let is_lost =
                |(value, sd): &(f64, f64)| value.abs() < DETECTION_Z * sd && judged.estimate.is_none();
            if let Some((value, sd)) = value.zip(sd).filter(is_lost) {
                let told = digits(DETECTION_Z * sd);
                failings.push(format!(
                    "the value itself, {}, can't be told from zero: it would have to be {told}, {DETECTION_Z:.2} standard deviations",
                    digits(value)
                ));
                break;
            }
        }
    }
    failings
}
