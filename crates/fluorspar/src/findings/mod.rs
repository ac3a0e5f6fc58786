//! Every number of an evaluation that people decide by, made once: what it is, of what, its value, its interval of 95 % and what limits
//! it. There are no sentences here; text, page, comparison and JSON word and list the same findings.

mod cohort;
mod finding;

pub use cohort::{
    CohortAgreement, CohortFindings, CohortQuantity, LesionSeparation, NormalRange, PersonFinding,
    cohort_findings,
};
pub use finding::{Caveat, Finding, FindingId};

use crate::analysis::{
    Analysis, BudgetItem, ChannelSignal, ChannelStatistics, ErrorBudget, MixtureSummary, PorphyrinTruth,
    RegionFraction, SharePosterior, SignalRatio, SignalSummary, Statistics, TargetDetection, Unmixing,
    VisibleShare,
};
use crate::pipeline::{Evaluation, FrameLeak, Viewer};
use crate::safety::DAY_S;
use crate::sampling::Z_95;

/// Standard errors of the least share that is told from none with errors of 5 % either way, twice the one-sided 1.645 (Currie 1968).
const DETECTION_Z: f64 = 3.29;

/// Captures of one kind, and how many of them eyes and tissue bear in 8 hours.
#[derive(Clone, Debug, PartialEq)]
pub struct SafeCaptures {
    /// Name of the capture.
    pub name: String,
    /// Time that the lights are on, s.
    pub light_on_s: f64,
    /// The fewest of all viewers, and whose they are; `None` where nobody is assessed.
    pub per_day: Option<(u64, Viewer)>,
}

/// All findings of an evaluation: those of the analysis, of leaks, frames and safety, then those of further regions that are in view.
#[must_use]
pub fn findings(evaluation: &Evaluation) -> Vec<Finding> {
    let mut all = Vec::new();
    if let Some(analyzed) = &evaluation.analysis {
        all.extend(region_findings(&analyzed.analysis));
    }
    all.extend(leak_findings(&evaluation.leaks));
    for frame in &evaluation.frames {
        let saturated = frame.developed.saturated.iter().filter(|is_saturated| **is_saturated).count();
        let share = saturated as f64 / frame.developed.saturated.len().max(1) as f64;
        all.extend(frame_findings(&frame.raw.label, frame.raw.exposure_s, share));
    }
    if let Some(safety) = &evaluation.safety {
        let lit = safety.captures.iter().filter(|capture| !capture.viewers.is_empty());
        let captures = lit.map(|capture| SafeCaptures {
            name: capture.name.clone(),
            light_on_s: capture.light_on_s,
            per_day: fewest(capture.viewers.iter().map(|viewer| (viewer.captures_per_day, viewer.viewer))),
        });
        let sequences = fewest(safety.program.iter().map(|line| (line.sequences_per_day, line.viewer)));
        all.extend(safety_findings(&captures.collect::<Vec<_>>(), sequences, safety.is_mouth));
    }
    for region in &evaluation.regions {
        let Some(analyzed) = region.in_view() else { continue };
        let named = |finding| Finding { region: Some(region.name.clone()), ..finding };
        all.extend(region_findings(&analyzed.analysis).into_iter().map(named));
    }
    all
}

/// What the pixels of a region say.
#[must_use]
pub fn region_findings(analysis: &Analysis) -> Vec<Finding> {
    let mut all = share_findings(analysis);
    if let Some(signals) = &analysis.signals {
        all.extend(signal_findings(signals));
        all.extend(signals.unmixing.iter().flat_map(unmixing_findings));
    } else {
        all.extend(level_findings(analysis));
    }
    all.extend(region_snr(analysis));
    all.extend(chromaticity_findings(analysis));
    all.extend(analysis.spots.iter().map(|spot| {
        Finding::new(FindingId::SpotSeparation, spot.d_prime)
            .of_frame(spot.frames.join(" + "))
            .named(spot.channels.join(", "))
            .within(spot.d_prime_interval)
            .judged_by(spot.right)
    }));
    all.extend(analysis.targets.iter().flat_map(target_findings));
    all.extend(pixel_findings(analysis));
    if analysis.gain_is_assumed {
        let in_electrons = [
            FindingId::MedianSignal,
            FindingId::MedianSignalPerMs,
            FindingId::MeanSignal,
            FindingId::PixelSnr,
            FindingId::RegionSnr,
        ];
        let electrons = all.iter_mut().filter(|finding| in_electrons.contains(&finding.id));
        electrons.for_each(|finding| finding.caveats.push(Caveat::AssumedGain));
    }
    all
}

/// The estimates of the share, their truth, and the least that is detected.
fn share_findings(analysis: &Analysis) -> Vec<Finding> {
    let truth = analysis.truth.as_ref().map(|truth| truth.share);
    let mut all = Vec::new();
    if let Some(posterior) = &analysis.posterior {
        all.extend(posterior_findings(posterior, analysis.truth.as_ref()));
    }
    if let Some(mixture) = &analysis.mixture {
        all.extend(line_findings(mixture, analysis, truth));
    }
    // Of channels without a mixture line the share is unmixed from all signals, and so is its truth; the analyte is the last term
    let unmixed =
        match analysis.signals.as_ref().and_then(|signals| Some(&signals.unmixing.as_ref()?.terms[..])) {
            Some([.., _, analyte]) if truth.is_some() => Some(analyte),
            _ => None,
        };
    let answers = |finding: &Finding| matches!(finding.id, FindingId::Share | FindingId::LineShare);
    let of_signals = unmixed.and_then(|of| of.true_share).filter(|_| !all.iter().any(answers));
    all.extend(of_signals.map(|share| Finding::new(FindingId::TrueShare, share)));
    if let (Some(truth), None) = (&analysis.truth, of_signals) {
        let twice = truth.share_with_light_that_fluoresced_twice;
        let share = Finding::new(FindingId::TrueShare, truth.share).of_frame(&analysis.frame);
        all.push(share.within(twice).with(Caveat::FluorescedTwice));
    }
    let there = truth.filter(|share| *share > 0.0);
    let percent = |id, share: f64, there: f64| Finding::new(id, 100.0 * share / there);
    // One limit of one kind: that of the line knows neither people nor indirect light
    let of_line = analysis.detection_limit().filter(|_| analysis.posterior.is_none());
    if let Some(limit) = of_line {
        all.push(Finding::new(FindingId::DetectionLimit, limit).with(Caveat::SensorNoiseAlone));
        all.extend(there.map(|there| percent(FindingId::LimitOverTruth, limit, there)));
    } else if there.is_some()
        && let Some(analyte) = unmixed
        && let Some(there) = analyte.true_share.filter(|share| *share > 0.0)
    {
        let [low, high] = analyte.share_interval;
        // A share at its end has no width that tells anything
        if high > low {
            all.push(percent(FindingId::LimitOverTruth, DETECTION_Z * 0.5 * (high - low) / Z_95, there));
        }
    }
    if let (Some(there), Some(posterior)) = (there, &analysis.posterior)
        && !posterior.is_no_estimate()
    {
        // Shares of cameras with other channels, lights or filters have other denominators; in units of what is there they compare
        let [low, high] = posterior.interval;
        all.push(percent(FindingId::UpperLimitOverTruth, posterior.upper_limit, there));
        all.push(percent(FindingId::WidthOverTruth, high - low, there));
    }
    all
}

/// Share of red light that is more than the pigments of ordinary tissue give. \[assumed\]
const PLAINLY_RED: f64 = 0.1;

/// The share if the region is tissue of which a family is known.
fn posterior_findings(posterior: &SharePosterior, known: Option<&PorphyrinTruth>) -> Vec<Finding> {
    let truth = known.map(|truth| truth.share);
    let frame = posterior.frames.first().map_or("", String::as_str);
    let share = |value: Option<f64>| Finding::new(FindingId::Share, value).of_frame(frame);
    let mut share = if posterior.is_no_estimate() {
        share(None).with(Caveat::NoEstimate)
    } else if posterior.excludes_none() {
        share(Some(posterior.median)).within(posterior.interval).judged_by(truth)
    } else {
        let to_limit = [0.0, posterior.upper_limit];
        share(None).within(to_limit).judged_by(truth).with(Caveat::NotDetected)
    };
    let other = posterior.explained_by().map(|tissue| Caveat::OtherTissue(tissue.to_owned()));
    share.caveats.extend(other);
    if posterior.frames.len() > 1 {
        share.caveats.push(Caveat::FromFrames(posterior.frames.clone()));
    }
    // Much red light that may still be no porphyrin is that of something that looks like it
    let is_plain = posterior.red.is_some_and(|red| red.interval[0] > PLAINLY_RED);
    let looks_alike = posterior.blocks.as_ref().is_some_and(|blocks| blocks.looks_like_chlorophyll)
        || (is_plain && !posterior.excludes_none());
    let alike = || looks_alike.then_some(Caveat::LooksLike("plant pigment"));
    let mut all = Vec::new();
    if let Some(red) = posterior.red.filter(|_| !posterior.is_no_estimate()) {
        share.caveats.extend(alike());
        let mut red = Finding::new(FindingId::RedShare, red.median).of_frame(frame).within(red.interval);
        red.caveats.extend(alike());
        all.push(red.judged_by(known.map(|truth| truth.red)));
    }
    all.push(share);
    if let Some(visible) = posterior.visible.as_ref().filter(|_| !posterior.is_no_estimate()) {
        let named = |finding: Finding| match &visible.limited_by {
            Some(limit) => finding.named(limit),
            None => finding,
        };
        let smallest = |id, share: Option<f64>| match share {
            Some(share) => Finding::new(id, share),
            None => Finding::new(id, VisibleShare::LARGEST).with(Caveat::LowerLimit),
        };
        all.push(named(smallest(FindingId::VisibleInPatches, visible.in_patches)));
        all.push(smallest(FindingId::VisibleEvenly, visible.evenly));
    }
    if let Some(blocks) = posterior.blocks.as_ref().filter(|_| !posterior.is_no_estimate()) {
        let marked = Finding::new(FindingId::MarkedBlocks, blocks.marked() as f64);
        all.push(marked.judged_by(blocks.blocks.len() as f64));
    }
    if let Some(of_mean) = posterior.of_mean.filter(|_| !posterior.is_no_estimate()) {
        let share = Finding::new(FindingId::ShareOfMean, None).within(of_mean.interval);
        all.push(share.with(Caveat::NotDetected));
    }
    if !posterior.is_no_estimate() {
        let probability = Finding::new(FindingId::ProbabilityOfNone, 100.0 * posterior.probability_of_none);
        if posterior.excludes_none() {
            all.push(Finding::new(FindingId::ShareUpperLimit, posterior.upper_limit));
        }
        all.push(probability.judged_by(100.0 * posterior.prior_probability_of_none));
        let wider = Finding::new(FindingId::ShareInWiderFamily, None);
        all.push(wider.within(posterior.with_prior_twice_as_wide));
    }
    for found in posterior.doubt.iter().flat_map(|doubt| &doubt.tissues) {
        let number = |id, value: f64| Finding::new(id, value).named(&found.tissue);
        all.push(number(FindingId::TissueProbability, 100.0 * found.probability));
        all.push(number(FindingId::TissueBayesFactor, found.bayes_factor));
    }
    if !posterior.is_no_estimate() {
        let confused = posterior.blind_to.iter();
        all.extend(confused.map(|b| Finding::new(FindingId::MostConfused, b.correlation).named(&b.name)));
        let without = posterior.without.iter();
        all.extend(
            without.map(|w| Finding::new(FindingId::ShareWithout, None).named(&w.source).within(w.interval)),
        );
    }
    all.push(Finding::new(FindingId::FamilyDistance, posterior.misfit).judged_by(posterior.data as f64));
    all
}

/// The region on the mixture line.
fn line_findings(mixture: &MixtureSummary, analysis: &Analysis, truth: Option<f64>) -> Vec<Finding> {
    let mut all = Vec::new();
    let share = |id, value: f64| Finding::new(id, value).of_frame(&analysis.frame).judged_by(truth);
    if let Some(RegionFraction { estimate, .. }) = &mixture.region {
        let by_noise = |id| {
            share(id, estimate.position).within(estimate.position_interval()).with(Caveat::SensorNoiseAlone)
        };
        match &analysis.budget {
            Some(budget) => {
                all.push(share(FindingId::LineShare, budget.share).within(budget.total_interval));
                all.push(by_noise(FindingId::LineShareByNoise));
                all.extend(budget_findings(budget));
            }
            None => all.push(by_noise(FindingId::LineShare)),
        }
        // Amounts in layered tissue are factors on what it holds: their ratio tells nothing
        if analysis.posterior.is_none() {
            let ratio = Finding::new(FindingId::AmountRatio, estimate.fraction);
            all.push(ratio.within(estimate.fraction_interval).with(Caveat::SensorNoiseAlone));
            all.extend(mixture.fraction.map(|of| of_pixels(FindingId::AmountRatioOfPixels, &of)));
            let error = mixture.fraction_standard_error;
            all.extend(error.map(|of| Finding::new(FindingId::AmountRatioErrorOfPixel, of.median)));
        }
    }
    let valid = analysis.counts.valid as f64;
    all.extend(mixture.distance.map(|of| mean_of_pixels(FindingId::LineDistance, &of)));
    all.push(Finding::new(FindingId::PixelsOffLine, mixture.off_line as f64).judged_by(valid));
    all.extend(mixture.angle_to_line_deg.map(|angle| Finding::new(FindingId::LineAngle, angle)));
    all.push(Finding::new(FindingId::PixelsBeyondEnd, mixture.clamped as f64).judged_by(valid));
    all.push(Finding::new(FindingId::LineLength, mixture.length));
    all
}

/// What moves the share on the mixture line.
fn budget_findings(budget: &ErrorBudget) -> Vec<Finding> {
    let change = |item: &BudgetItem| {
        Finding::new(FindingId::LineChange, item.change).named(&item.source).judged_by(item.without)
    };
    let mut all = vec![Finding::new(FindingId::LineNoise, budget.sensor_noise)];
    all.extend(budget.terms.iter().map(change));
    all.push(Finding::new(FindingId::LineBlank, budget.blank));
    all
}

/// Terms of signals that were taken apart.
fn unmixing_findings(unmixing: &Unmixing) -> Vec<Finding> {
    let mut all = Vec::new();
    for term in &unmixing.terms {
        let name = term.fluorophores.join(" + ").replace('_', " ");
        // Of one term alone all light is its own: only its amount is an answer
        if unmixing.terms.len() > 1 {
            let share = Finding::new(FindingId::UnmixedShare, term.share).named(&name);
            let share = share.within(term.share_interval).judged_by(term.true_share);
            all.push(share.with(Caveat::SensorNoiseAlone));
        }
        let amount = Finding::new(FindingId::UnmixedAmount, term.amount).named(name);
        all.push(amount.within(term.amount_interval).with(Caveat::SensorNoiseAlone));
    }
    let others = unmixing.true_share_of_others.filter(|others| others.is_worth_telling());
    all.extend(others.map(|others| {
        let share = Finding::new(FindingId::UnmixedOthers, others.share);
        if others.counts_as_bulk { share.with(Caveat::CountsAsBulk) } else { share }
    }));
    all.extend(unmixing.misfit.map(|misfit| Finding::new(FindingId::UnmixingMisfit, misfit)));
    all
}

/// The median signal of a channel in a frame, and that of a millisecond, in which cameras of other exposures compare.
fn median_signal(electrons: f64, exposure_s: Option<f64>, is_lower_limit: bool) -> Vec<Finding> {
    let limited = |finding: Finding| match is_lower_limit {
        true => finding.with(Caveat::LowerLimit),
        false => finding,
    };
    let mut all = vec![limited(Finding::new(FindingId::MedianSignal, electrons))];
    let milliseconds = exposure_s.map(|s| 1e3 * s).filter(|ms| *ms > 0.0);
    all.extend(milliseconds.map(|ms| limited(Finding::new(FindingId::MedianSignalPerMs, electrons / ms))));
    all
}

/// Levels of cameras with other channels than R, G and B, in all frames, and their ratios.
fn signal_findings(summary: &SignalSummary) -> Vec<Finding> {
    let of_signal = |signal: &ChannelSignal| {
        let saturated = signal.saturated_share();
        let is_limit = signal.saturated > 0 && signal.saturated >= signal.pixels;
        let median = signal.median_electrons.map(|e| median_signal(e, Some(signal.exposure_s), is_limit));
        let reach = Z_95 * signal.standard_error_e;
        let mean = Finding::new(FindingId::MeanSignal, signal.electrons)
            .within([signal.electrons - reach, signal.electrons + reach])
            .with(Caveat::SensorNoiseAlone);
        let mut all: Vec<Finding> = median.unwrap_or_default();
        all.extend([mean, Finding::new(FindingId::MeanLevel, signal.mean_dn)]);
        match saturated {
            // The mean of the others is a lower limit, and its noise tells nothing
            Some(share) => all.iter_mut().for_each(|finding| {
                if !finding.has(&Caveat::LowerLimit)
                    && finding.id != FindingId::MedianSignal
                    && finding.id != FindingId::MedianSignalPerMs
                {
                    finding.caveats.push(Caveat::LowerLimit);
                    finding.interval = None;
                }
                finding.caveats.push(Caveat::Saturated(share));
            }),
            None => all.push(Finding::new(FindingId::PixelSnr, signal.snr_of_pixel)),
        }
        let (frame, channel) = (signal.frame.clone(), signal.channel.clone());
        all.into_iter().map(move |finding| finding.of_frame(frame.clone()).in_channel(channel.clone()))
    };
    let ratio = |ratio: &SignalRatio| {
        let reach = Z_95 * ratio.standard_error;
        Finding::new(FindingId::SignalRatio, ratio.ratio)
            .named(format!("{} over {}", ratio.above, ratio.below))
            .within([ratio.ratio - reach, ratio.ratio + reach])
            .with(Caveat::SensorNoiseAlone)
    };
    let others = other_ratios(summary);
    let ratios = summary.ratios.iter().chain(&others).map(ratio);
    summary.signals.iter().flat_map(of_signal).chain(ratios).collect()
}

/// Signals of a summary whose ratios are listed pair by pair, at most: three give one pair beside those over the strongest.
const MOST_PAIRED: usize = 4;

/// Each signal over each before it, where its ratio to the strongest one does not tell it: the red band over the green one of frames that
/// begin with a white one.
fn other_ratios(summary: &SignalSummary) -> Vec<SignalRatio> {
    if summary.signals.len() > MOST_PAIRED {
        return Vec::new();
    }
    let is_known = |above: &ChannelSignal, below: &ChannelSignal| {
        let names = [above.name(), below.name()];
        summary.ratios.iter().any(|r| names.contains(&r.above) && names.contains(&r.below))
    };
    let all = summary.signals.iter().enumerate();
    let pairs =
        all.flat_map(|(place, above)| summary.signals[..place].iter().map(move |below| (above, below)));
    let unknown = pairs.filter(|(above, below)| !is_known(above, below));
    unknown.filter_map(|(above, below)| SignalRatio::new(above, below)).collect()
}

/// Levels of R, G and B in the region.
fn level_findings(analysis: &Analysis) -> Vec<Finding> {
    let of_channel = |channel: &ChannelStatistics| {
        let level = analysis.median_level(channel)?;
        let noise = &analysis.settings.noise;
        let (median, deviation) = (level.dn.max(0.0), noise.variance(level.dn.max(0.0)).sqrt());
        if noise.dn_per_electron <= 0.0 || deviation <= 0.0 {
            return None;
        }
        let electrons = median / noise.dn_per_electron;
        let mut all = median_signal(electrons, analysis.exposure_s, level.is_lower_limit);
        if !level.is_lower_limit {
            all.push(Finding::new(FindingId::PixelSnr, median / deviation));
        }
        let name = channel.name.clone();
        Some(all.into_iter().map(move |finding| finding.of_frame(&analysis.frame).in_channel(name.clone())))
    };
    analysis.channels.iter().filter_map(of_channel).flatten().collect()
}

/// The signal to noise of the region's mean in each frame, all its channels together: the root of the sum of their squares. It compares
/// cameras whose channels have other names. Frames of which more than one pixel in a hundred is saturated have none.
fn region_snr(analysis: &Analysis) -> Vec<Finding> {
    let number =
        |frame: &str, squares: f64| Finding::new(FindingId::RegionSnr, squares.sqrt()).of_frame(frame);
    let square = |mean: f64, variance: f64| if variance > 0.0 { mean * mean / variance } else { 0.0 };
    if let Some(SignalSummary { signals, .. }) = &analysis.signals {
        let frames = signals.chunk_by(|a, b| a.frame == b.frame);
        let usable = frames.filter(|frame| frame.iter().all(|signal| signal.saturated_share().is_none()));
        let of_frame = |frame: &[ChannelSignal]| {
            let squares = frame.iter().map(|s| square(s.electrons, s.standard_error_e.powi(2))).sum();
            Some(number(&frame.first()?.frame, squares))
        };
        return usable.filter_map(of_frame).collect();
    }
    let region = analysis.mixture.as_ref().and_then(|mixture| mixture.region);
    let region = region.filter(|_| analysis.counts.saturated_share().is_none());
    let squares = |region: RegionFraction| -> f64 {
        let channels = region.mean_rgb_dn.iter().zip(region.variance_dn2);
        channels.map(|(&mean, variance)| square(mean, variance)).sum()
    };
    region.map(|region| number(&analysis.frame, squares(region))).into_iter().collect()
}

fn chromaticity_findings(analysis: &Analysis) -> Vec<Finding> {
    let of = |id, statistics: &Option<Statistics>| statistics.as_ref().map(|of| mean_of_pixels(id, of));
    let mut all: Vec<Finding> =
        [of(FindingId::ChromaticityR, &analysis.r), of(FindingId::ChromaticityG, &analysis.g)]
            .into_iter()
            .flatten()
            .collect();
    if let Some(ellipse) = &analysis.ellipse {
        let ids = [FindingId::SpreadAlong, FindingId::SpreadAcross];
        all.extend(ids.into_iter().zip(ellipse.half_axes).map(|(id, axis)| Finding::new(id, axis)));
    }
    all
}

/// How well a frame shows a target.
fn target_findings(target: &TargetDetection) -> Vec<Finding> {
    let mut all = vec![
        Finding {
            interval: target.d_prime_interval,
            ..Finding::new(FindingId::TargetSeparation, target.d_prime)
        },
        Finding::new(FindingId::TargetSeparationOfPixel, target.d_prime_pixel),
        Finding::new(FindingId::TargetSeparationOfSensor, target.d_prime_of_sensor),
    ];
    let px = target.smallest_diameter_px;
    let (unit, per_px) = match target.smallest_diameter_mm {
        Some(mm) if px > 0.0 => ("mm", mm / px),
        _ => ("px", 1.0),
    };
    let most = target.smallest_diameter_most_px.unwrap_or(f64::INFINITY);
    let diameter = Finding::new(FindingId::SmallestDiameter, px * per_px)
        .within([target.smallest_diameter_least_px, most].map(|end| end * per_px))
        .judged_by(target.wanted_d_prime);
    let noise = target.render_noise.zip(target.samples_needed);
    let noise = noise.map(|(ratio, samples)| Caveat::RenderNoise(ratio, samples));
    all.push(Finding { unit, caveats: noise.into_iter().collect(), ..diameter });
    let frames = Finding::new(FindingId::FramesNeeded, target.frames_needed.map(|count| count as f64));
    all.push(if target.frames_needed.is_none() { frames.with(Caveat::Unbounded) } else { frames });
    for channel in &target.channels {
        let number = |id, value: Option<f64>| Finding::new(id, value).in_channel(&channel.name);
        all.push(number(FindingId::TargetContrast, channel.contrast));
        all.push(number(FindingId::TargetCnr, Some(channel.cnr)));
    }
    all.into_iter().map(|finding| finding.of_frame(&target.frame).named(&target.target)).collect()
}

/// Pixels by what becomes of them, and the levels of the channels.
fn pixel_findings(analysis: &Analysis) -> Vec<Finding> {
    let counts = &analysis.counts;
    let pixels = |id, count: usize| Finding::new(id, count as f64);
    let clipped = 100.0 * counts.saturated as f64 / counts.total().max(1) as f64;
    let mut all = vec![
        Finding::new(FindingId::Clipped, clipped),
        pixels(FindingId::PixelsOfRegion, counts.total()),
        pixels(FindingId::PixelsUsed, counts.valid),
        pixels(FindingId::PixelsSaturated, counts.saturated),
        pixels(FindingId::PixelsBelowNoise, counts.below_noise_floor).judged_by(analysis.least_sum_dn),
        pixels(FindingId::PixelsWithoutSignal, counts.undefined),
    ];
    for channel in &analysis.channels {
        let level = match (counts.saturated_share(), analysis.median_level(channel), &channel.statistics) {
            (Some(share), Some(level), _) => {
                let median = Finding::new(FindingId::MedianLevel, level.dn).with(Caveat::Saturated(share));
                Some(if level.is_lower_limit { median.with(Caveat::LowerLimit) } else { median })
            }
            (_, _, Some(statistics)) => Some(of_pixels(FindingId::MedianLevel, statistics)),
            _ => None,
        };
        all.extend(level.map(|level| level.in_channel(&channel.name)));
    }
    all
}

/// Median of pixels and the range of nine tenths of them.
fn of_pixels(id: FindingId, statistics: &Statistics) -> Finding {
    Finding::new(id, statistics.median).within([statistics.p05, statistics.p95]).with(Caveat::NineTenths)
}

/// Mean of pixels with their standard deviation.
fn mean_of_pixels(id: FindingId, statistics: &Statistics) -> Finding {
    let mean = Finding::new(id, statistics.mean);
    match statistics.sd {
        Some(sd) => mean.within([statistics.mean - sd, statistics.mean + sd]).with(Caveat::StandardDeviation),
        None => mean,
    }
}

/// Reflected light in frames of fluorescence.
#[must_use]
pub fn leak_findings(leaks: &[FrameLeak]) -> Vec<Finding> {
    let of_fluorescence = leaks.iter().filter(|leak| !leak.is_reflectance());
    let number = |leak: &FrameLeak| {
        Some(Finding::new(FindingId::Leak, 100.0 * leak.leak_ratio?).of_frame(&leak.frame))
    };
    of_fluorescence.filter_map(number).collect()
}

/// Exposure of a frame, and its saturated pixels, 0 to 1.
#[must_use]
pub fn frame_findings(frame: &str, exposure_s: f64, saturated: f64) -> Vec<Finding> {
    let number = |id, value: f64| Finding::new(id, value).of_frame(frame);
    vec![number(FindingId::Exposure, 1e3 * exposure_s), number(FindingId::Clipped, 100.0 * saturated)]
}

/// The fewest of counts, and whose they are.
#[must_use]
pub fn fewest(counts: impl Iterator<Item = (Option<u64>, Viewer)>) -> Option<(u64, Viewer)> {
    counts.filter_map(|(count, viewer)| Some((count?, viewer))).min_by_key(|(count, _)| *count)
}

/// What eyes and tissue bear in a day: captures of each kind, and whole sequences of them; in a mouth, or before anything else.
#[must_use]
pub fn safety_findings(
    captures: &[SafeCaptures],
    sequences: Option<(u64, Viewer)>,
    is_mouth: bool,
) -> Vec<Finding> {
    // Counts for an eye and for tissue do not compare
    let number = |id, (count, viewer): (u64, Viewer), light_on_s: f64| {
        let finding = match (count as f64 + 1.0) * light_on_s > DAY_S {
            // More than fit into the day are no limit
            true => Finding::new(id, None).with(Caveat::Unbounded),
            false => Finding::new(id, count as f64),
        };
        finding.named(viewer.name(is_mouth))
    };
    let of_capture = |capture: &SafeCaptures| {
        let count = number(FindingId::SafeCaptures, capture.per_day?, capture.light_on_s);
        Some(count.of_frame(&capture.name))
    };
    let mut all: Vec<Finding> = captures.iter().filter_map(of_capture).collect();
    if captures.len() > 1 {
        let all_s = captures.iter().map(|capture| capture.light_on_s).sum();
        all.extend(sequences.map(|count| number(FindingId::SafeSequences, count, all_s)));
    }
    all
}
