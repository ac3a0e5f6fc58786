//! Which of two runs sees smaller amounts of porphyrin, in a sentence.

use fluorspar::analysis::{Analysis, ChannelStatistics, SharePosterior};
use fluorspar::findings::FindingId;
use fluorspar::sampling::Z_95;
use fluorspar_experiment::SettingDifference;

use super::{ComparedNumber, ComparedSide, FinishedRun};
use crate::LEAKING;
use crate::findings::number as short;

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
    let find = |id: FindingId| numbers.iter().find(|n| n.region.is_none() && n.id == id);
    let has = |id: FindingId| find(id).is_some();
    let values = |id: FindingId| {
        let number = find(id)?;
        let value = |side: &Option<ComparedSide>| side.as_ref().and_then(|side| side.value);
        Some([value(&number.a)?, value(&number.b)?])
    };
    let (target, other) = analyte(a, b);
    if let Some((letter, leak)) =
        [("A", a), ("B", b)].into_iter().find_map(|(letter, run)| Some((letter, leak_of(run)?)))
    {
        return Some(format!(
            "Which run sees smaller amounts is not told: in {letter} reflected excitation light is {} % of the fluorescence, and every number \
             takes it for fluorescence.",
            short(100.0 * leak)
        ));
    }
    let sentence = if !has(FindingId::WidthOverTruth) && !has(FindingId::LimitOverTruth) {
        return None;
    } else if let Some(other) = other {
        return Some(format!(
            "Which run sees smaller amounts is not told: A looks for {target}, B for {other}."
        ));
    } else if let Some(widths) = values(FindingId::WidthOverTruth) {
        ranked(target, widths, [a, b], Measure::Width) + &smallest_shares(target, [of_a, of_b])
    } else if let Some(limits) = values(FindingId::LimitOverTruth) {
        let sentence = ranked(target, limits, [a, b], Measure::Limit);
        format!("{sentence} It holds the sensor's noise alone, not what is unknown of the sample.")
    } else {
        let has_value = |side: fn(&ComparedNumber) -> &Option<ComparedSide>| {
            let numbers = [FindingId::WidthOverTruth, FindingId::LimitOverTruth].into_iter().filter_map(find);
            numbers.filter_map(|number| side(number).as_ref()).any(|side| side.value.is_some())
        };
        let sides = [("A", of_a, has_value(|n| &n.a)), ("B", of_b, has_value(|n| &n.b))];
        let why =
            sides.into_iter().filter(|(.., has_value)| !has_value).filter_map(|(letter, analysis, _)| {
                Some(format!("{letter} {}", nothing_to_compare(analysis, target)?))
            });
        let why: Vec<String> = why.collect();
        let why = if why.is_empty() {
            "one of them has no interval or limit that compares with the truth".into()
        } else {
            why.join("; ")
        };
        return Some(format!("Which run sees smaller amounts of {target} is not told: {why}."));
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

/// Reflected over fluorescent electrons of the analyzed frame, where its numbers say little because of them.
fn leak_of(run: &FinishedRun) -> Option<f64> {
    let frame = &run.analysis.as_ref()?.frame;
    let leak = run.leaks.iter().find(|leak| leak.frame == *frame && !leak.is_reflectance())?;
    leak.leak_ratio.filter(|ratio| *ratio > LEAKING)
}

/// Which run would tell less of the fluorophore from none, in units of what is there: another question than how narrowly that is estimated.
fn smallest_shares(target: &str, analyses: [&Analysis; 2]) -> String {
    let share = |analysis: &Analysis| {
        let seen = analysis.posterior.as_ref()?.visible.as_ref()?.in_patches?;
        let truth = analysis.truth.as_ref()?.share;
        (truth > 0.0).then(|| 100.0 * seen / truth)
    };
    match analyses.map(share) {
        [Some(a), Some(b)] => format!(
            " The smallest amount of {target} in patches that would be told from none is {} % of what is there in A, {} % in B.",
            short(a),
            short(b)
        ),
        _ => String::new(),
    }
}

/// What both runs look for, and where they look for different fluorophores, that of the second run. One that estimates no share looks for none.
fn analyte<'a>(a: &'a FinishedRun, b: &'a FinishedRun) -> (&'a str, Option<&'a str>) {
    let looks = |run: &FinishedRun| {
        let analysis = run.analysis.as_ref();
        analysis.is_some_and(|a| a.truth.is_some() || a.posterior.is_some() || a.mixture.is_some())
    };
    match (looks(a), looks(b)) {
        (true, true) if a.target != b.target => (&a.target, Some(&b.target)),
        (false, true) => (&b.target, None),
        _ => (&a.target, None),
    }
}

/// Why a run has no number in units of the true share, after its letter; `None` where that is not known.
fn nothing_to_compare(analysis: &Analysis, target: &str) -> Option<String> {
    if analysis.posterior.as_ref().is_some_and(SharePosterior::is_no_estimate) {
        return Some("gives no estimate, as its light is not that of the assumed tissue".into());
    }
    match &analysis.truth {
        None => Some(format!("does not know the true share of {target}")),
        Some(truth) if truth.share <= 0.0 => Some(format!("holds no {target}")),
        Some(_) if analysis.posterior.is_none() => Some(
            "has neither an interval of the share that holds the variety of tissue nor a detection limit: its frames don't tell the fluorophore \
             from the bulk, which takes two channels or further frames"
                .into(),
        ),
        Some(_) => None,
    }
}

/// Whether a run has an upper limit of the share and no more.
fn has_limit_only(run: &FinishedRun) -> bool {
    let posterior = run.analysis.as_ref().and_then(|analysis| analysis.posterior.as_ref());
    posterior.is_some_and(|posterior| !posterior.excludes_none())
}

/// The sentence for numbers in percent of the true share, of which the smaller one is better.
///
/// `ln(b/a)` has the standard error `hypot(error_a, error_b)` of the relative ones; where its 95 % interval holds 0, repeats of one camera would
/// differ as much.
fn ranked(target: &str, [a, b]: [f64; 2], runs: [&FinishedRun; 2], measure: Measure) -> String {
    let limits_only = runs.map(|run| measure == Measure::Width && has_limit_only(run));
    let (what, adjective) = match (measure, limits_only) {
        (Measure::Width, [true, true]) => ("the upper limit is", ""),
        (Measure::Width, _) => ("the 95 % interval is", " wide"),
        (Measure::Limit, _) => ("the detection limit is", ""),
    };
    let numbers = format!(
        "In units of the {target} share that is there, {what} {} %{adjective} in A, {} % in B",
        short(a),
        short(b)
    );
    let limits = match limits_only {
        [true, true] => {
            format!("Both runs have an upper limit only: neither tells the {target} from none. ")
        }
        _ => String::new(),
    };
    let limit_of_one = match limits_only {
        [true, false] => " A has an upper limit only.",
        [false, true] => " B has an upper limit only.",
        _ => "",
    };
    // Limits of a tissue that is not that of the sample may leave out the truth
    let limit_of_one = match limits_only {
        [true, true] if a.min(b) < 100.0 => {
            " A limit below 100 % is less than what is there: its tissue is another."
        }
        _ => limit_of_one,
    };
    let ratio = b / a;
    let [error_a, error_b] = match runs.map(|run| relative_error(run, measure)) {
        [Ok(error_a), Ok(error_b)] => [error_a, error_b],
        [of_a, of_b] => {
            let why = [("A", of_a.err()), ("B", of_b.err())];
            let why: Vec<String> =
                why.into_iter().filter_map(|(letter, why)| Some(format!("of {letter} {}", why?))).collect();
            return format!(
                "{limits}{numbers}: {} times as much in B. How far repeats of the runs would differ is not known, so neither is called \
                 better: {}.{limit_of_one}",
                short(ratio),
                why.join("; ")
            );
        }
    };
    let reach = Z_95 * error_a.hypot(error_b);
    let [low, high] = [-1.0, 1.0].map(|sign: f64| ratio * (sign * reach).exp());
    let numbers = format!(
        "{numbers}: {} times as much in B, {} to {} by the noise of sensor and render.{limit_of_one}",
        short(ratio),
        short(low),
        short(high)
    );
    let [better, other] = if a < b { ["A", "B"] } else { ["B", "A"] };
    let [alike, apart] = match measure {
        Measure::Width => [
            format!("A and B are not told apart by how narrowly they estimate the {target} that is there."),
            format!("{better} estimates the {target} that is there more narrowly than {other}."),
        ],
        Measure::Limit => [
            format!("A and B are not told apart by the smallest amounts of {target} that they see."),
            format!("{better} sees smaller amounts of {target} than {other}."),
        ],
    };
    match (low <= 1.0 && high >= 1.0, limits.is_empty()) {
        (true, true) => format!("{alike} {numbers}"),
        (false, true) => format!("{apart} {numbers}"),
        (true, false) => format!("{limits}The limits are not told apart. {numbers}"),
        (false, false) => {
            format!("{limits}In units of what is there, the limit of {better} is the lower one. {numbers}")
        }
    }
}

/// Relative standard error of a number over the true share if the run were repeated with another seed, or what is missing to tell it, and the remedy.
///
/// Pixels of a render are independent, so its noise moves the mean of a channel over `n` of them by `sd/(mean sqrt(n))` at most, where `sd` is
/// all that the pixels differ by, structure included: `r`, the largest of the channels. A share, porphyrin over all light, then moves by
/// `sqrt(2) r`. An end of the interval follows the estimate one to one at most, so with the width `w` in units of the truth it moves `w` by
/// `sqrt(2) r max(1, |1/w - 1|)`, truth and interval together, and the sensor's noise `s` of the share moves it by `s/width`. The detection limit
/// goes with the root of the signals: `r/2` on top of the truth's `sqrt(2) r`.
fn relative_error(run: &FinishedRun, measure: Measure) -> Result<f64, String> {
    let analysis = run.analysis.as_ref().ok_or("there is no analysis")?;
    let of_mean = render_error(run, analysis)?;
    let of_truth = std::f64::consts::SQRT_2 * of_mean;
    if measure == Measure::Limit {
        return Ok(of_truth + of_mean / 2.0);
    }
    let interval = analysis.posterior.as_ref().map(|posterior| posterior.interval[1] - posterior.interval[0]);
    let truth = analysis.truth.as_ref().map(|truth| truth.share);
    let (Some(width), Some(truth)) = (interval.filter(|width| *width > 0.0), truth) else {
        return Err("there is no interval".into());
    };
    let sensor_noise = sensor_noise(analysis, truth).ok_or(
        "the noise of the share by the sensor is not known: analyze frames that tell the analyte from the bulk",
    )?;
    Ok((of_truth * (truth / width - 1.0).abs().max(1.0)).hypot(sensor_noise / width))
}

/// Standard error of the share of the analyzed frame by the sensor's noise: on the mixture line, else that of the share unmixed from all signals,
/// which cameras of any channels have. That one is of other light; it is as large in units of what is there.
fn sensor_noise(analysis: &Analysis, truth: f64) -> Option<f64> {
    if let Some(budget) = &analysis.budget {
        return Some(budget.sensor_noise / Z_95);
    }
    if let Some(region) = analysis.mixture.as_ref().and_then(|mixture| mixture.region) {
        return Some(region.estimate.position_standard_error);
    }
    let unmixing = analysis.signals.as_ref()?.unmixing.as_ref()?;
    // The analyte is the last term
    let [.., _, analyte] = unmixing.terms.as_slice() else { return None };
    let of_all = analyte.true_share.filter(|share| *share > 0.0)?;
    let [low, high] = analyte.share_interval;
    Some(0.5 * (high - low) / Z_95 * truth / of_all)
}

/// How far the noise of a render moves the mean of a channel over the region at most, relative to it.
fn render_error(run: &FinishedRun, analysis: &Analysis) -> Result<f64, String> {
    let rendered = run.render_pixels.ok_or(
        "the size of the render is not known: compare folders of `run` or `capture --report`, with their experiment.toml",
    )?;
    let recorded = run.frame_pixels.ok_or_else(|| {
        let frame = &analysis.frame;
        format!("preview_{frame}.png is missing, which tells the size of the frame: compare the whole folder")
    })?;
    // Several pixels of the sensor may see one of the render
    let pixels_per_pixel = rendered as f64 / recorded as f64;
    let of_channel = |channel: &ChannelStatistics| {
        let of = channel.statistics.as_ref()?;
        let independent = of.n as f64 * pixels_per_pixel.min(1.0);
        Some(of.sd? / of.mean / independent.sqrt()).filter(|error| error.is_finite() && *error >= 0.0)
    };
    let largest = analysis.channels.iter().map(of_channel).reduce(|a, b| Some(a?.max(b?)));
    largest.flatten().ok_or_else(|| "a channel has no pixels that count, or no light".into())
}
