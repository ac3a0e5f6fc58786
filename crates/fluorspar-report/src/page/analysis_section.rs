//! An analysis in plain words.

use fluorspar::analysis::{
    ASSUMED_GAIN, Analysis, Analyte, ChannelSignal, ErrorBudget, LineEstimate, MixtureSummary, OtherLight,
    PorphyrinTruth, SharePosterior, SignalRatio, SignalSummary, SpotSeparation, Statistics, TargetDetection,
    UnmixedTerm, with_error,
};

use super::report_data::{Number, NumberMatrix, NumberTable, Origin, ReportItem, Section};
use crate::FrameOrigin;

/// One analysis: its figures first, then the tables: chromaticity, porphyrin share, predicted fluorophores, pixels
/// used and levels.
pub fn analysis_section(analysis: &Analysis, figures: Vec<ReportItem>, from: FrameOrigin) -> Section {
    let how = match from {
        FrameOrigin::Simulated => "the simulated sensor image, in the way they would be from a recorded one",
        FrameOrigin::Given => "recorded frames",
    };
    let analyte = &analysis.analyte;
    // Say what a camera would not have
    let known: Vec<&str> = [
        analysis.mixture.as_ref().map(|_| "the ends of the line"),
        analysis.truth.as_ref().map(|_| "the true share"),
        analysis.budget.as_ref().map(|_| "what moves the estimate"),
    ]
    .into_iter()
    .flatten()
    .collect();
    let known = match from {
        FrameOrigin::Simulated if analysis.truth.is_some() || analysis.budget.is_some() => {
            format!(" From the render, which no camera has, come {}.", known.join(", "))
        }
        _ => String::new(),
    };
    let mut section = Section::new(format!("What the frame \"{}\" says", analysis.frame)).say(format!(
        "Region: {}. Levels, colors and estimates are computed from {how}.{known}",
        analysis.region_description
    ));
    section.items.extend(figures);
    let chromaticity = chromaticity_rows(analysis);
    if !chromaticity.is_empty() {
        section = section.with(table("Sensor chromaticity of the region", chromaticity));
    }
    if let Some(signals) = &analysis.signals {
        section = with_signals(section, signals, analysis.gain_is_assumed);
    }
    if !analysis.targets.is_empty() {
        section = section.with(ReportItem::Matrix(target_matrix(&analysis.targets)));
    }
    if let Some(posterior) = &analysis.posterior {
        section = section.with(table(
            &format!("{} in tissue that is not known", analyte.capitalized()),
            posterior_rows(posterior, analyte),
        ));
    }
    if let Some(mixture) = &analysis.mixture {
        // Amounts in layered tissue are factors on what it holds: their ratio tells nothing.
        let with_amounts = analysis.posterior.is_none();
        let mut rows = mixture_rows(mixture, analysis.counts.valid, with_amounts, analyte);
        rows.extend(detection_row(analysis));
        section = section.with(table(&format!("{} share on the mixture line", analyte.capitalized()), rows));
    }
    if let Some(truth) = &analysis.truth {
        section = section.with(table("What the simulation knows", truth_rows(truth, analyte)));
    }
    if let Some(budget) = &analysis.budget {
        section = section.with(table("What moves the estimate on the line", budget_rows(budget, analyte)));
    }
    if !analysis.spots.is_empty() {
        section = section.with(table("How well two spots are told apart", spot_rows(&analysis.spots)));
    }
    let predicted = fluorophore_rows(analysis);
    if !predicted.is_empty() {
        section = section.with(table("Predicted fluorophores", predicted));
    }
    section.with(table("Pixels and levels", pixel_rows(analysis)))
}

/// Predicted chromaticity of each fluorophore.
fn fluorophore_rows(analysis: &Analysis) -> Vec<Number> {
    let rows = analysis.fluorophores.iter().map(|fluorophore| {
        let point = fluorophore.chromaticity;
        let value = point.map_or_else(|| "none".into(), |[r, g]| format!("{r:.3}, {g:.3}"));
        let part = match fluorophore.bulk_weight {
            Some(weight) => format!(" Its weight in the bulk is {}.", short(weight)),
            None => String::new(),
        };
        Number::computed(
            fluorophore.name.replace('_', " "),
            value,
            "r, g",
            format!("Where this fluorophore alone would lie, through these filters and this sensor.{part}"),
        )
        .from(Origin::Assumed("from the fluorophore model of this experiment".into()))
    });
    rows.collect()
}

fn table(caption: &str, rows: Vec<Number>) -> ReportItem {
    ReportItem::Table(NumberTable { caption: caption.into(), rows })
}

/// Share with its 95 % interval.
fn range([low, high]: [f64; 2]) -> String {
    format!("{low:.3} to {high:.3}")
}

fn posterior_rows(posterior: &SharePosterior, analyte: &Analyte) -> Vec<Number> {
    let mut rows = vec![Number::computed(
        format!("{} share of the light", analyte.capitalized()),
        posterior.finding(),
        "",
        format!(
            "Electrons of {analyte} light over those of all fluorescence of the region in frame \"{}\". The interval holds sensor noise, leak, \
             indirect light, the variety of tissue and errors of the library of spectra. From {}. Assumed beforehand: {}.",
            posterior.frames.first().map_or("", String::as_str),
            posterior.frames_in_words(),
            posterior.prior
        ),
    )];
    // Of light that no tissue explains neither a median nor an interval means anything
    if posterior.is_no_estimate() {
        rows.extend(tissue_row(posterior));
        rows.push(distance_row(posterior));
        return rows;
    }
    rows.push(if posterior.excludes_none() {
        Number::computed(
            "Upper limit",
            format!("{:.3}", posterior.upper_limit),
            "",
            "The share is below it with a probability of 95 %.",
        )
    } else {
        let meaning = format!(
            "Middle of the probability, no estimate: the {:.0} % that were given to none beforehand pull it toward 0.",
            100.0 * posterior.prior_probability_of_none
        );
        Number::computed("Median", format!("{:.3}", posterior.median), "", meaning)
    });
    rows.extend([
        Number::computed(
            format!("No {analyte}"),
            format!("{:.0}", 100.0 * posterior.probability_of_none),
            "%",
            format!(
                "Probability that there is none, which was taken as {:.0} % beforehand.",
                100.0 * posterior.prior_probability_of_none
            ),
        ),
        Number::computed(
            "With a prior twice as wide",
            range(posterior.with_prior_twice_as_wide),
            "",
            "The interval if tissue varied twice as much as assumed: far from the one above, the assumption decides.",
        ),
    ]);
    rows.extend(tissue_row(posterior));
    if let Some(blind) = &posterior.blind_to {
        let value = format!("{} ({:+.2})", blind.name, blind.correlation).replace('-', "−");
        let meaning =
            "What an error of the share goes along with most after this measurement, and their correlation.";
        rows.push(Number::computed("Most correlated with", value, "", meaning));
    }
    for without in &posterior.without {
        rows.push(Number::computed(
            format!("Without {}", without.source),
            range(without.interval),
            "",
            "The interval as it would be without this uncertainty.",
        ));
    }
    rows.push(distance_row(posterior));
    rows
}

/// Which tissue it is, where several were compared.
fn tissue_row(posterior: &SharePosterior) -> Option<Number> {
    let doubt = posterior.doubt.as_ref()?;
    let all: Vec<String> =
        doubt.tissues.iter().map(|of| format!("{} {:.0} %", of.tissue, 100.0 * of.probability)).collect();
    let others: Vec<String> =
        doubt.tissues.iter().skip(1).map(|of| format!("{} {:.2}", of.tissue, of.bayes_factor)).collect();
    Some(Number::computed(
        "Tissue",
        all.join(", "),
        "",
        format!(
            "Probability after the measurement, the tissue that was named first. So many times as well as it do the others explain the colors \
             (Bayes factors): {}. Each was as probable as another beforehand, so that their mean, {:.2}, is that of all others together: one \
             of them may be above it.",
            others.join(", "),
            doubt.bayes_factor
        ),
    ))
}

/// How far the light is from that of the assumed tissue.
fn distance_row(posterior: &SharePosterior) -> Number {
    Number::computed(
        "Distance from the family",
        format!("{:.1}", posterior.misfit),
        "",
        format!(
            "Chi-square: about {}, the number of signals, where the region is the assumed tissue; far more where it is not.",
            posterior.data
        ),
    )
}

fn truth_rows(truth: &PorphyrinTruth, analyte: &Analyte) -> Vec<Number> {
    let [low, high] = truth.share_with_light_that_fluoresced_twice;
    vec![Number::computed(
        format!("True {analyte} share"),
        format!("{:.4}", truth.share),
        "",
        format!(
            "The quantity that estimates from the analyzed frame are after: {}. Light that fluoresced twice would make it {low:.4} to {high:.4}.",
            truth.definition
        ),
    )]
}

fn budget_rows(budget: &ErrorBudget, analyte: &Analyte) -> Vec<Number> {
    let signed = |value: f64| format!("{value:+.4}").replace('-', "−");
    let [low, high] = budget.total_interval.map(|end| format!("{end:.4}").replace('-', "−"));
    let mut rows = vec![
        Number::computed(
            "Share on the line, total interval",
            format!("{} ({low} to {high})", format!("{:.4}", budget.share).replace('-', "−")),
            "",
            format!(
                "Share of the electrons that the {analyte} emitted, with all that follows, added as squares. The variety of tissue and \
                 errors of the library of spectra are not in it."
            ),
        ),
        Number::computed(
            "Sensor noise",
            format!("± {:.4}", budget.sensor_noise),
            "",
            "Half of the 95 % interval that the sensor's noise leaves.",
        ),
    ];
    for item in &budget.items {
        let without = format!("{:.4}", item.without).replace('-', "−");
        let meaning = format!("Without it the share would be {without}.");
        rows.push(Number::computed(
            item.source[..1].to_uppercase() + &item.source[1..],
            signed(item.change),
            "",
            meaning,
        ));
    }
    rows.push(Number::computed(
        "Blank",
        format!("{:.4}", budget.blank).replace('-', "−"),
        "",
        format!("The estimate from the same light without that of the {analyte}."),
    ));
    rows
}

/// The detection limit, of simulated frames as of recorded ones, whose blank nobody knows.
fn detection_row(analysis: &Analysis) -> Option<Number> {
    let analyte = &analysis.analyte;
    let meaning = format!(
        "So far beyond the blank sensor noise mistakes neither a blank for {analyte} nor {analyte} for a blank in more than 5 % of cases."
    );
    let limit = analysis.detection_limit()?;
    Some(Number::computed(
        "Detection limit, noise alone",
        format!("{limit:.4}"),
        "share of the light",
        meaning,
    ))
}

fn spot_rows(spots: &[SpotSeparation]) -> Vec<Number> {
    let row = |spot: &SpotSeparation| {
        let [low, high] = spot.d_prime_interval;
        Number::computed(
            spot.name(),
            format!("{:.2} ({low:.2} to {high:.2})", spot.d_prime),
            "d'",
            format!(
                "Distance of the two spots in standard deviations of a pixel, with its 95 % interval, by {}; an ideal observer assigns \
                 {:.0} % of single pixels to the right spot.",
                spot.scale.words(),
                100.0 * spot.right
            ),
        )
    };
    spots.iter().map(row).collect()
}

/// Signals of a summary whose ratios are told pair by pair, at most: three give one pair beside those over the strongest.
const MOST_PAIRED: usize = 4;

/// Each signal over each before it, where its ratio to the strongest one does not tell it: the red band over the green one of frames that begin
/// with a white one.
fn other_ratios(summary: &SignalSummary) -> Vec<SignalRatio> {
    let known = |above: &ChannelSignal, below: &ChannelSignal| {
        let names = [above.name(), below.name()];
        summary.ratios.iter().any(|r| names.contains(&r.above) && names.contains(&r.below))
    };
    if summary.signals.len() > MOST_PAIRED {
        return Vec::new();
    }
    let pairs = summary
        .signals
        .iter()
        .enumerate()
        .flat_map(|(place, above)| summary.signals[..place].iter().map(move |below| (above, below)));
    pairs
        .filter(|(above, below)| !known(above, below))
        .filter_map(|(above, below)| SignalRatio::new(above, below))
        .collect()
}

/// Levels of all channels of all frames, their ratios, and what they are made of.
fn with_signals(section: Section, summary: &SignalSummary, gain_is_assumed: bool) -> Section {
    let gain = if gain_is_assumed {
        format!(" Electrons and signal to noise {ASSUMED_GAIN}.")
    } else {
        String::new()
    };
    let columns =
        ["Signal", "electrons", "standard error", "DN", "signal to noise"].map(String::from).to_vec();
    let rows = summary.signals.iter().map(|s| {
        let at_least = if s.saturated_share().is_some() { "at least " } else { "" };
        let cells = [s.electrons, s.standard_error_e, s.mean_dn, s.snr_of_pixel].map(short);
        let [electrons, error, dn, snr] = cells;
        vec![s.title(), format!("{at_least}{electrons}"), error, format!("{at_least}{dn}"), snr]
    });
    let mut section = section.with(ReportItem::Matrix(NumberMatrix {
        caption: "Signals of the region".into(),
        columns,
        rows: rows.collect(),
        note: "Mean of a pixel, the standard error of the mean by the sensor's noise, and the signal to noise of one pixel: of those that are not \
               saturated, so that a mean is a lower limit where more than 1 % are.".to_owned() + &gain,
    }));
    if !summary.ratios.is_empty() {
        let others = other_ratios(summary);
        let rows = summary.ratios.iter().chain(&others).map(|r| {
            let value = with_error(r.ratio, r.standard_error).replace('-', "−");
            Number::computed(
                format!("{} over {}", r.above, r.below),
                value,
                "",
                "Electrons per second over electrons per second, with the standard error that the sensor's noise leaves.",
            )
        });
        section = section.with(table("Ratios of the signals", rows.collect()));
    }
    if let Some(unmixing) = &summary.unmixing {
        let mut rows: Vec<Number> = match unmixing.terms.as_slice() {
            [only] => vec![only_row(only)],
            terms => terms.iter().map(unmixed_row).collect(),
        };
        if let Some(misfit) = unmixing.misfit {
            rows.push(Number::computed(
                "What is left",
                short(misfit),
                "standard errors",
                "Root mean square of the signals less the sum. Far above 1 flat samples of these fluorophores under direct light don't make \
                 up the region: light is absorbed on its way, comes indirectly, is reflected, or another fluorophore gives it off.",
            ));
        }
        rows.extend(unmixing.true_share_of_others.and_then(other_light_row));
        let caption = match unmixing.terms.len() {
            1 => "Fluorophores in the signals".to_owned(),
            _ => format!(
                "Fluorophores in the signals, as shares of all electrons of {}",
                unmixing.signals.join(", ")
            ),
        };
        section = section.with(table(&caption, rows));
    }
    section
}

/// The one fluorophore of the model: all light counts as its own, and only its amount is an answer.
fn only_row(term: &UnmixedTerm) -> Number {
    let [least, most] = term.amount_interval.map(short);
    Number::computed(
        term.fluorophores.join(" + ").replace('_', " "),
        format!("{} ({least} to {most})", short(term.amount)),
        "units",
        "Amount on a flat sample under direct light, with its 95 % interval by sensor noise alone. It is the only fluorophore, so all \
         light counts as its own.",
    )
}

fn unmixed_row(term: &UnmixedTerm) -> Number {
    let [low, high] = term.share_interval;
    let truth =
        term.true_share.map_or_else(String::new, |share| format!(" The simulation knows: {share:.4}."));
    let [least, most] = term.amount_interval.map(short);
    Number::computed(
        term.fluorophores.join(" + ").replace('_', " "),
        format!("{:.4} ({low:.4} to {high:.4})", term.share),
        "of the electrons of all signals",
        format!(
            "Share with its 95 % interval by sensor noise alone; amount {} ({least} to {most}) on a flat sample under direct light.{truth}",
            short(term.amount)
        ),
    )
}

/// Light of other parts in the truth; none where there is next to nothing of it.
fn other_light_row(others: OtherLight) -> Option<Number> {
    let words = others.words()?;
    let meaning = format!("The simulation knows of {words}.");
    Some(Number::computed(
        "Light of other parts",
        format!("{:.4}", others.share),
        "of the electrons of all signals",
        meaning,
    ))
}

/// Targets in frames, one row each.
fn target_matrix(targets: &[TargetDetection]) -> NumberMatrix {
    let names = targets.first().map_or(&[][..], |target| &target.channels);
    let columns = ["Target, frame".to_owned()]
        .into_iter()
        .chain(names.iter().map(|c| format!("contrast {}", c.name)))
        .chain(["d' a pixel", "d'", "d' of the sensor", "smallest diameter", "frames"].map(String::from));
    let row = |t: &TargetDetection| {
        let contrast = t
            .channels
            .iter()
            .map(|c| c.contrast.map_or_else(|| "dark".into(), |v| format!("{v:+.3}").replace('-', "−")));
        let px = t.smallest_diameter_px;
        let diameter = match t.smallest_diameter_mm {
            Some(mm) => format!("{mm:.2} mm ({})", t.diameter_interval(mm / px, 2)),
            None => format!("{px:.1} px ({})", t.diameter_interval(1.0, 1)),
        };
        let frames = t.frames_needed.map_or_else(|| "never".into(), |count| count.to_string());
        let numbers = [
            format!("{:.2}", t.d_prime_pixel),
            format!("{:.1}", t.d_prime),
            format!("{:.1}", t.d_prime_of_sensor),
        ];
        std::iter::once(format!("{}, frame \"{}\"", t.target, t.frame))
            .chain(contrast)
            .chain(numbers)
            .chain([diameter, frames])
            .collect::<Vec<String>>()
    };
    let wanted = targets.first().map_or(0.0, |target| target.wanted_d_prime);
    NumberMatrix {
        caption: "How well targets are told from what lies around them".into(),
        columns: columns.collect(),
        rows: targets.iter().map(row).collect(),
        note: format!(
            "Contrast: difference over background. d' is the distance of target and background in standard deviations: of one pixel; of the \
             whole target in the noise and structure of the frame, neighbors correlated as they are (Hotelling observer); and in the sensor's \
             noise alone. Diameter of a disc of this contrast on the surface of the target, and number of averaged frames, for d' {wanted}. \
             Noise of the render is taken out; intervals are 95 % by the noise of frame and render.{}",
            render_notes(targets)
        ),
    }
}

/// What the render leaves uncertain in the frames.
fn render_notes(targets: &[TargetDetection]) -> String {
    let note = |t: &TargetDetection| Some(format!(" {}, {}: {}.", t.target, t.frame, t.render_words()?));
    targets.iter().filter_map(note).collect()
}

/// Names of the channels whose sum counts as light.
fn sum_of_channels(analysis: &Analysis) -> String {
    let names: Vec<&str> = analysis.channels.iter().map(|channel| channel.name.as_str()).collect();
    match names.as_slice() {
        [only] => format!("the {only} signal"),
        [_, _, _] if analysis.r.is_some() => "R + G + B".into(),
        _ => format!("the sum of the {} channels", names.len()),
    }
}

fn pixel_rows(analysis: &Analysis) -> Vec<Number> {
    let counts = &analysis.counts;
    let sum = sum_of_channels(analysis);
    let pixels =
        |name: &str, n: usize, meaning: String| Number::computed(name, n.to_string(), "pixels", meaning);
    let mut rows = vec![
        pixels("In the region", counts.total(), "All pixels of the region.".into()),
        pixels("Used", counts.valid, "Pixels bright enough and not saturated.".into()),
        pixels("Saturated", counts.saturated, "Left out: their true value is unknown.".into()),
        pixels(
            "Below the noise floor",
            counts.below_noise_floor,
            format!(
                "Left out: {sum} is below {:.0} DN, {} standard deviations of its value in the dark.",
                analysis.least_sum_dn,
                short(analysis.settings.noise_threshold)
            ),
        ),
        pixels("Without signal", counts.undefined, format!("Left out: {sum} is not positive.")),
    ];
    for channel in &analysis.channels {
        if let Some((share, level)) = analysis.counts.saturated_share().zip(analysis.median_level(channel)) {
            let (at_least, what) = match level.is_lower_limit {
                true => ("at least ", "a lower limit, as it clips itself"),
                false => ("", "the rest alone would be the dim part of the region, and there is no mean"),
            };
            rows.push(Number::computed(
                format!("{} level", channel.name),
                format!("{at_least}{}", short(level.dn)),
                "DN",
                format!(
                    "Median over all pixels of the region, {:.0} % of them saturated: {what}.",
                    100.0 * share
                ),
            ));
        } else if let Some(s) = &channel.statistics {
            rows.push(Number::computed(
                format!("{} level", channel.name),
                format!("{} (5 % to 95 %: {} to {})", short(s.median), short(s.p05), short(s.p95)),
                "DN",
                "Median over the unsaturated pixels of the region, and the range of nine tenths of them.",
            ));
        }
    }
    rows
}

fn chromaticity_rows(analysis: &Analysis) -> Vec<Number> {
    let row = |name: &str, statistics: &Option<Statistics>, share: &str| {
        statistics.map(|s| {
            let spread = s.sd.map(|sd| format!(" ± {sd:.4}")).unwrap_or_default();
            Number::computed(
                name,
                format!("{:.4}{spread}", s.mean),
                "",
                format!(
                    "Share of the signal that is {share}: mean and standard deviation over the pixels used."
                ),
            )
        })
    };
    let mut rows: Vec<Number> =
        [row("r", &analysis.r, "red"), row("g", &analysis.g, "green")].into_iter().flatten().collect();
    if let Some(ellipse) = &analysis.ellipse {
        rows.push(Number::computed(
            "Spread along, across",
            format!("{:.4}, {:.4}", ellipse.half_axes[0], ellipse.half_axes[1]),
            "",
            "Standard deviation of the cloud of pixels along its long and its short axis.",
        ));
    }
    rows
}

fn mixture_rows(
    mixture: &MixtureSummary,
    valid: usize,
    with_amounts: bool,
    analyte: &Analyte,
) -> Vec<Number> {
    let mut rows = Vec::new();
    if let Some(region) = &mixture.region {
        let estimate = &region.estimate;
        let [low, high] = estimate.position_interval().map(|end| format!("{end:.4}"));
        rows.push(Number::computed(
            "Share, region as a whole",
            format!("{:.4} ({low} to {high})", estimate.position).replace('-', "−"),
            "",
            format!(
                "Electrons of {analyte} light over those of {analyte} and bulk, from the region's mean color, as if the bulk were known; with \
                 the 95 % interval that the sensor's noise leaves. Errors of the model are not in it."
            ),
        ));
        if with_amounts {
            rows.extend(amount_rows(mixture, estimate, analyte));
        }
    }
    if let Some(s) = &mixture.distance {
        let spread = s.sd.map(|sd| format!(" ± {sd:.4}")).unwrap_or_default();
        rows.push(Number::computed(
            "Distance from the line",
            format!("{:.4}{spread}", s.mean).replace('-', "−"),
            "r, g",
            format!(
                "How far pixels lie beside the line between bulk and {analyte}. Far from zero, something else is in the light: \
                 reflected light, or another bulk than assumed."
            ),
        ));
    }
    rows.push(Number::computed(
        "Off the line",
        format!("{} of {valid}", mixture.off_line),
        "pixels",
        "Pixels farther beside the line than three standard errors. By chance, 3 in 1000 are.",
    ));
    if let Some(angle) = mixture.angle_to_line_deg {
        rows.push(Number::computed(
            "Angle to the line",
            format!("{angle:.1}"),
            "degrees",
            format!("Between the long axis of the cloud and the line. Small when pixels differ mainly in {analyte}."),
        ));
    }
    rows.push(Number::computed(
        "Beyond an end",
        format!("{} of {valid}", mixture.clamped),
        "pixels",
        format!(
            "Pixels past the bulk or the {analyte} point; they count as lying at that end. Without {analyte}, noise puts half of them there."
        ),
    ));
    rows.push(Number::computed(
        "Length of the line",
        format!("{:.4}", mixture.length),
        "r, g",
        format!(
            "Distance between bulk and {analyte}. The longer it is beside the noise, the better this design tells them apart."
        ),
    ));
    rows
}

/// The ratio of amounts, which is no share of the light.
fn amount_rows(mixture: &MixtureSummary, estimate: &LineEstimate, analyte: &Analyte) -> Vec<Number> {
    let [low, high] = estimate.fraction_interval;
    let mut rows = vec![Number::computed(
        "Ratio of amounts",
        format!("{:.4} ({low:.4} to {high:.4})", estimate.fraction),
        "",
        format!(
            "Amount of {analyte} over the amounts of {analyte} and bulk, in the units of the catalogue (Lyu et al. 2021, Sec. 4.1): no \
             share of the light, which depends on how bright a unit of each is."
        ),
    )];
    if let Some(s) = &mixture.fraction {
        rows.push(Number::computed(
            "Ratio of amounts, pixels",
            format!("{:.4} (5 % to 95 %: {:.4} to {:.4})", s.median, s.p05, s.p95),
            "",
            "The same for each pixel on its own: the middle pixel, and the range of nine tenths of them.",
        ));
    }
    if let Some(s) = &mixture.fraction_standard_error {
        rows.push(Number::computed(
            "Ratio of amounts, standard error of a pixel",
            format!("{:.4}", s.median),
            "",
            "How far noise alone moves the ratio of a typical pixel.",
        ));
    }
    rows
}

/// Four digits, without trailing zeros.
fn short(value: f64) -> String {
    let magnitude = if value == 0.0 { 0.0 } else { value.abs().log10().floor() };
    let decimals = (3.0 - magnitude).clamp(0.0, 8.0) as usize;
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use fluorspar::analysis::{AnalysisSettings, ChannelNoise, RegionOfInterest, analyze_region};
    use fluorspar::image::ChannelImage;

    use super::*;

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [0.0, 5.0, 1234.56, -0.012345, 12.5, 98765.0].map(short),
            ["0", "5", "1235", "−0.01235", "12.5", "98765"]
        );
    }

    #[test]
    fn an_analysis_without_a_single_usable_pixel_still_makes_a_section() {
        let image = ChannelImage {
            width: 2,
            height: 1,
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            data: vec![0.0; 6],
            saturated: vec![false; 2],
            noise_floor_dn: 2.0,
            full_scale_dn: 4000.0,
            shares: vec![0.25, 0.5, 0.25],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "dark".into(),
        };
        let noise = ChannelNoise { floor_dn: 2.0, dn_per_electron: 0.5, gain_spread: 0.0 };
        let settings = AnalysisSettings::new(RegionOfInterest::default(), noise);
        let (analysis, ..) = analyze_region(&image, None, None, None, &settings).unwrap();
        let section = analysis_section(&analysis, Vec::new(), FrameOrigin::Given);
        assert_eq!(section.title, "What the frame \"dark\" says");
        // Without a pixel that tells a color the words and the table of pixels remain.
        assert_eq!(section.items.len(), 2);
    }
}
