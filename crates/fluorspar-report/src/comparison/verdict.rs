//! Which of two runs sees smaller amounts of porphyrin, in a sentence.

use fluorspar::analysis::{Analysis, ChannelStatistics};
use fluorspar::sampling::Z_95;
use fluorspar_experiment::SettingDifference;

use super::run_numbers::{LIMIT_OVER_TRUTH, WIDTH_OVER_TRUTH};
use super::{ComparedNumber, ComparedSide, FinishedRun, short};

/// Sections of an experiment that say what lies before the camera.
const SAMPLE: [&str; 7] = ["fluorophore", "tissue", "material", "mouth", "object", "concentration", "motion"];

/// What compares the runs, in units of the true share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Measure {
    /// The width of the interval of the share.
    Width,
    /// The detection limit by the sensor's noise alone.
    Limit,
}

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
        ranked(target, widths, [a, b].map(|run| relative_error(run, Measure::Width)), Measure::Width)
    } else if let Some(limits) = values(LIMIT_OVER_TRUTH) {
        let errors = [a, b].map(|run| relative_error(run, Measure::Limit));
        let sentence = ranked(target, limits, errors, Measure::Limit);
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

/// The sentence for numbers in percent of the true share, of which the smaller one is better, and their relative standard errors.
///
/// `ln(b/a)` has the standard error `hypot(error_a, error_b)`; where its 95 % interval holds 0, repeats of one camera would differ as much.
fn ranked(target: &str, [a, b]: [f64; 2], errors: [Option<f64>; 2], measure: Measure) -> String {
    let (what, adjective) = match measure {
        Measure::Width => ("the 95 % interval is", " wide"),
        Measure::Limit => ("the detection limit is", ""),
    };
    let numbers = format!(
        "In units of the {target} share that is there, {what} {} %{adjective} in A, {} % in B",
        short(a),
        short(b)
    );
    let ratio = b / a;
    let [Some(error_a), Some(error_b)] = errors else {
        return format!(
            "{numbers}: {} times as much in B. How far repeats of the runs would differ is not known, so neither is called better.",
            short(ratio)
        );
    };
    let reach = Z_95 * error_a.hypot(error_b);
    let [low, high] = [-1.0, 1.0].map(|sign: f64| ratio * (sign * reach).exp());
    let numbers = format!(
        "{numbers}: {} times as much in B, {} to {} by the noise of sensor and render.",
        short(ratio),
        short(low),
        short(high)
    );
    if low <= 1.0 && high >= 1.0 {
        return format!(
            "A and B are not told apart by the smallest amounts of {target} that they see. {numbers}"
        );
    }
    let [better, other] = if a < b { ["A", "B"] } else { ["B", "A"] };
    format!("{better} sees smaller amounts of {target} than {other}. {numbers}")
}

/// Relative standard error of a number over the true share if the run were repeated with another seed; `None` where it is not known.
///
/// Pixels of a render are independent, so its noise moves the mean of a channel over `n` of them by `sd/(mean sqrt(n))` at most, where `sd` is
/// all that the pixels differ by, structure included: `r`, the largest of the channels. A share, porphyrin over all light, then moves by
/// `sqrt(2) r`. An end of the interval follows the estimate one to one at most, so with the width `w` in units of the truth it moves `w` by
/// `sqrt(2) r max(1, |1/w - 1|)`, truth and interval together, and the sensor's noise `s` of the share moves it by `s/width`. The detection limit
/// goes with the root of the signals: `r/2` on top of the truth's `sqrt(2) r`.
fn relative_error(run: &FinishedRun, measure: Measure) -> Option<f64> {
    let analysis = run.analysis.as_ref()?;
    let of_mean = render_error(run, analysis)?;
    let of_truth = std::f64::consts::SQRT_2 * of_mean;
    if measure == Measure::Limit {
        return Some(of_truth + of_mean / 2.0);
    }
    let posterior = analysis.posterior.as_ref()?;
    let width = posterior.interval[1] - posterior.interval[0];
    let truth = analysis.truth.as_ref()?.share;
    let sensor_noise = match &analysis.budget {
        Some(budget) => budget.sensor_noise / Z_95,
        None => analysis.mixture.as_ref()?.region?.estimate.position_standard_error,
    };
    (width > 0.0).then(|| (of_truth * (truth / width - 1.0).abs().max(1.0)).hypot(sensor_noise / width))
}

/// How far the noise of a render moves the mean of a channel over the region at most, relative to it.
fn render_error(run: &FinishedRun, analysis: &Analysis) -> Option<f64> {
    // Several pixels of the sensor may see one of the render
    let pixels_per_pixel = run.render_pixels? as f64 / run.frame_pixels? as f64;
    let of_channel = |channel: &ChannelStatistics| {
        let of = channel.statistics.as_ref()?;
        let independent = of.n as f64 * pixels_per_pixel.min(1.0);
        Some(of.sd? / of.mean / independent.sqrt()).filter(|error| error.is_finite() && *error >= 0.0)
    };
    analysis.channels.iter().map(of_channel).reduce(|a, b| Some(a?.max(b?)))?
}
