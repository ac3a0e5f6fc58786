//! The numbers of a finished run that an engineer decides by.

use fluorspar::analysis::{
    Analysis, ChannelSignal, ErrorBudget, RegionFraction, SharePosterior, SignalSummary, TargetDetection,
};
use fluorspar::safety::DAY_S;
use fluorspar::sampling::Z_95;

use super::finished_run::{FinishedCapture, FinishedFrame, FinishedRun, FinishedSafety};
use super::{ComparedSide, short};
use crate::run::{RegionLevel, capital, level};

/// What a number is about; numbers are listed in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Subject {
    Estimate,
    Target,
    Leak,
    Signal,
    Frame,
    Safety,
}

/// How wide the interval of the share is, in units of what is there: what compares cameras whose shares have other denominators.
pub(super) const WIDTH_OVER_TRUTH: &str = "Width of the 95 % interval over the true share";
/// The least share that the sensor's noise alone lets see, in the same units.
pub(super) const LIMIT_OVER_TRUTH: &str = "Detection limit over the true share";

/// What a number says of a share of the light.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ShareNumber {
    /// An estimate.
    Estimate(ShareOf),
    /// The true share, which a simulation knows.
    Truth(ShareOf),
}

/// What a share is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ShareOf {
    /// The fluorophore that is looked for, in the light of the analyzed frame.
    Analyte,
    /// A term of the unmixing, by its name, in the light of all signals.
    Term(String),
}

/// A number of a run.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RunNumber {
    pub(super) subject: Subject,
    /// The share that it is; `None` for all else, errors of shares included.
    pub(super) share: Option<ShareNumber>,
    /// What it is, the same in all runs.
    pub(super) quantity: String,
    /// Its unit; empty for a pure number.
    pub(super) unit: &'static str,
    /// `None` where there is an interval only, or nothing.
    pub(super) value: Option<f64>,
    /// 95 %; the upper end may be infinite.
    pub(super) interval: Option<[f64; 2]>,
    /// What is said instead of the number.
    pub(super) words: Option<String>,
    /// Whether the interval holds the sensor's noise and nothing else: neither that of the render nor what is assumed.
    pub(super) noise_alone: bool,
    /// The further region that it is of; `None` of the analysis and of frames.
    pub(super) region: Option<String>,
}

impl RunNumber {
    fn new(subject: Subject, quantity: impl Into<String>, unit: &'static str, value: f64) -> Self {
        Self {
            subject,
            share: None,
            quantity: quantity.into(),
            unit,
            value: Some(value),
            interval: None,
            words: None,
            noise_alone: false,
            region: None,
        }
    }

    /// A share of the light.
    fn of_share(share: ShareNumber, quantity: impl Into<String>, value: f64) -> Self {
        Self { share: Some(share), ..Self::new(Subject::Estimate, quantity, "", value) }
    }

    fn within(self, interval: [f64; 2]) -> Self {
        Self { interval: Some(interval), ..self }
    }

    fn within_noise(self, interval: [f64; 2]) -> Self {
        Self { interval: Some(interval), noise_alone: true, ..self }
    }
}

/// All numbers of a run, those of its further regions last. `label` is how a frame of it is called beside those of the other run.
pub(super) fn run_numbers(run: &FinishedRun, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
    let mut numbers = Vec::new();
    if let Some(analysis) = &run.analysis {
        numbers.extend(region_numbers(analysis, &run.target, &run.frames, label));
        numbers.extend(spot_numbers(analysis, label));
        numbers.extend(analysis.targets.iter().flat_map(|target| target_numbers(target, label)));
    }
    for leak in run.leaks.iter().filter(|leak| !leak.is_reflectance()) {
        let quantity = format!("Leak of frame {}", label(&leak.frame));
        numbers
            .extend(leak.leak_ratio.map(|ratio| RunNumber::new(Subject::Leak, quantity, "%", 100.0 * ratio)));
    }
    for frame in &run.frames {
        let of = |what: &str| format!("{what} of frame {}", label(&frame.name));
        numbers.push(RunNumber::new(Subject::Frame, of("Exposure"), "ms", 1e3 * frame.exposure_s));
        let clipped = 100.0 * frame.saturated_fraction;
        numbers.push(RunNumber::new(Subject::Frame, of("Clipped pixels"), "%", clipped));
    }
    numbers.extend(run.safety.iter().flat_map(|safety| safety_numbers(safety, label)));
    numbers.sort_by_key(|number| number.subject);
    for region in &run.regions {
        let mut own = region_numbers(&region.analysis, &region.target, &run.frames, label);
        own.sort_by_key(|number| number.subject);
        numbers.extend(own.into_iter().map(|n| RunNumber { region: Some(region.name.clone()), ..n }));
    }
    numbers
}

/// What the pixels of a region say.
fn region_numbers(
    analysis: &Analysis,
    target: &str,
    frames: &[FinishedFrame],
    label: &dyn Fn(&str) -> String,
) -> Vec<RunNumber> {
    let mut numbers = share_numbers(analysis, target);
    numbers.extend(match &analysis.signals {
        Some(signals) => signal_numbers(signals, label),
        None => channel_numbers(analysis, frames, label),
    });
    numbers.extend(region_snr_numbers(analysis, label));
    let counts = &analysis.counts;
    let clipped = 100.0 * counts.saturated as f64 / counts.total().max(1) as f64;
    numbers.push(RunNumber::new(Subject::Frame, "Clipped pixels of the region", "%", clipped));
    numbers
}

/// The estimate of the share with its interval, as tables have it: of the tissue, else on the mixture line, else unmixed; and whether the
/// interval holds the sensor's noise alone. `None` where nothing is estimated.
pub(crate) fn share_text(analysis: &Analysis) -> Option<(String, bool)> {
    let numbers = share_numbers(analysis, "");
    let estimate = numbers.into_iter().find(|number| number.interval.is_some() || number.words.is_some())?;
    let noise_alone = estimate.noise_alone;
    Some((ComparedSide::from(estimate).text(), noise_alone))
}

/// The estimates of the share, what they err by, and the least that is detected.
fn share_numbers(analysis: &Analysis, target: &str) -> Vec<RunNumber> {
    let name = capital(target);
    let truth = analysis.truth.as_ref().map(|truth| truth.share);
    let mut numbers = Vec::new();
    let add_with_error = |number: RunNumber, truth: Option<f64>, numbers: &mut Vec<RunNumber>| {
        let error = truth.map(|truth| RunNumber {
            share: None,
            quantity: format!("{} less the true share", number.quantity),
            value: number.value.map(|value| value - truth),
            interval: number.interval.map(|ends| ends.map(|end| end - truth)),
            ..number.clone()
        });
        // What is no estimate has no error
        let error = error.filter(|_| number.words.is_none());
        numbers.push(number);
        numbers.extend(error);
    };
    if let Some(posterior) = &analysis.posterior {
        add_with_error(posterior_number(posterior, &name), truth, &mut numbers);
        numbers.extend(numbers_over_truth(posterior, truth));
    }
    let estimate = analysis.mixture.as_ref().and_then(|mixture| mixture.region).map(|region| region.estimate);
    if let Some(estimate) = estimate {
        let quantity = format!("{name} share on the mixture line");
        let estimated = ShareNumber::Estimate(ShareOf::Analyte);
        let number = |value| RunNumber::of_share(estimated, quantity, value);
        let number = match &analysis.budget {
            Some(ErrorBudget { share, total_interval, .. }) => number(*share).within(*total_interval),
            None => number(estimate.position).within_noise(estimate.position_interval()),
        };
        add_with_error(number, truth, &mut numbers);
    }
    numbers.extend(truth.map(|share| {
        let quantity = format!("True {target} share of the analyzed frame, which the simulation knows");
        RunNumber::of_share(ShareNumber::Truth(ShareOf::Analyte), quantity, share)
    }));
    numbers.extend(limit_numbers(analysis, target));
    let terms =
        analysis.signals.iter().filter_map(|signals| signals.unmixing.as_ref()).flat_map(|u| &u.terms);
    for term in terms {
        // The bulk is too long for a row
        let names = match &term.fluorophores[..] {
            names @ ([_] | [_, _]) => names.join(" + ").replace('_', " "),
            names => format!("the bulk of {} fluorophores", names.len()),
        };
        let quantity = format!("Share of {names}, unmixed from all signals");
        let of = ShareOf::Term(names.clone());
        let number = RunNumber::of_share(ShareNumber::Estimate(of.clone()), quantity, term.share);
        add_with_error(number.within_noise(term.share_interval), term.true_share, &mut numbers);
        let truth = format!("True share of {names} in all signals, which the simulation knows");
        let true_share = |share| RunNumber::of_share(ShareNumber::Truth(of), truth, share);
        numbers.extend(term.true_share.map(true_share));
    }
    numbers
}

/// The share if the region is tissue of a known site. Where none can't be excluded there is only a limit.
fn posterior_number(posterior: &SharePosterior, name: &str) -> RunNumber {
    let quantity = format!("{name} share of the light");
    let estimated = ShareNumber::Estimate(ShareOf::Analyte);
    let number = RunNumber::of_share(estimated, quantity, posterior.median).within(posterior.interval);
    if posterior.is_no_estimate() {
        return RunNumber { value: None, interval: None, words: Some("no estimate".into()), ..number };
    }
    if posterior.excludes_none() {
        return number;
    }
    let limit = posterior.upper_limit;
    RunNumber {
        value: None,
        interval: Some([0.0, limit]),
        words: Some(format!("at most {limit:.4}")),
        ..number
    }
}

/// Limit and interval in units of the share that is there. Shares of cameras with other channels, lights or filters have other
/// denominators; these do not.
fn numbers_over_truth(posterior: &SharePosterior, truth: Option<f64>) -> Vec<RunNumber> {
    let Some(truth) = truth.filter(|share| *share > 0.0 && !posterior.is_no_estimate()) else {
        return Vec::new();
    };
    let [low, high] = posterior.interval;
    let percent =
        |quantity: &str, share: f64| RunNumber::new(Subject::Estimate, quantity, "%", 100.0 * share / truth);
    vec![
        percent("Upper limit over the true share", posterior.upper_limit),
        percent(WIDTH_OVER_TRUTH, high - low),
    ]
}

/// Standard errors of the least share that is told from none with errors of 5 % either way, twice the one-sided 1.645 (Currie 1968).
const DETECTION_Z: f64 = 3.29;

/// The detection limit of cameras whose channels have no mixture line, over the true share: that of the share of the analyte unmixed
/// from all signals, by the sensor's noise.
fn unmixed_limit_over_truth(analysis: &Analysis) -> Option<f64> {
    // The true share tells that one is looked for; it is the last term
    analysis.truth.as_ref()?;
    let [.., _, analyte] = analysis.signals.as_ref()?.unmixing.as_ref()?.terms.as_slice() else {
        return None;
    };
    let truth = analyte.true_share.filter(|share| *share > 0.0)?;
    let [low, high] = analyte.share_interval;
    Some(DETECTION_Z * 0.5 * (high - low) / Z_95 / truth)
}

/// The detection limit as a share of the light, and where the truth is known, relative to it.
fn limit_numbers(analysis: &Analysis, target: &str) -> Vec<RunNumber> {
    let Some(limit) = analysis.detection_limit() else {
        let over_truth = unmixed_limit_over_truth(analysis);
        let number = |ratio| RunNumber::new(Subject::Estimate, LIMIT_OVER_TRUTH, "%", 100.0 * ratio);
        return over_truth.map(number).into_iter().collect();
    };
    let mut numbers = vec![RunNumber::new(
        Subject::Estimate,
        format!("Detection limit of the {target} share"),
        "share of the light",
        limit,
    )];
    let there = analysis.truth.as_ref().map(|truth| truth.share).filter(|share| *share > 0.0);
    numbers.extend(
        there.map(|there| RunNumber::new(Subject::Estimate, LIMIT_OVER_TRUTH, "%", 100.0 * limit / there)),
    );
    numbers
}

/// How well spots are told apart.
fn spot_numbers(analysis: &Analysis, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
    let number = |spot: &fluorspar::analysis::SpotSeparation| {
        let frames: Vec<String> = spot.frames.iter().map(|frame| label(frame)).collect();
        let quantity =
            format!("d' of the spots, {} of frame {}", spot.channels.join(", "), frames.join(" and "));
        RunNumber::new(Subject::Target, quantity, "", spot.d_prime).within(spot.d_prime_interval)
    };
    analysis.spots.iter().map(number).collect()
}

/// How well a frame shows a target.
fn target_numbers(target: &TargetDetection, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
    let of = |what: &str| format!("{what} of target \"{}\", frame {}", target.target, label(&target.frame));
    let number = |what: &str, unit, value| RunNumber::new(Subject::Target, of(what), unit, value);
    let mut numbers =
        vec![number("d'", "", target.d_prime), number("d' of a pixel", "", target.d_prime_pixel)];
    numbers.extend(target.channels.iter().map(|c| number(&format!("CNR in {}", c.name), "", c.cnr)));
    let px = target.smallest_diameter_px;
    let (unit, per_px) = match target.smallest_diameter_mm {
        Some(mm) if px > 0.0 => ("mm", mm / px),
        _ => ("px", 1.0),
    };
    let most = target.smallest_diameter_most_px.unwrap_or(f64::INFINITY);
    let interval = [target.smallest_diameter_least_px, most].map(|end| end * per_px);
    numbers.push(number("Smallest visible diameter", unit, px * per_px).within(interval));
    numbers
}

/// Median levels of a channel over the region, of cameras with any channels.
struct MedianSignal<'a> {
    channel: &'a str,
    frame: &'a str,
    exposure_s: Option<f64>,
    electrons: f64,
    is_lower_limit: bool,
    snr: Option<f64>,
    /// The pixel whose signal to noise it is.
    snr_of: &'static str,
}

impl MedianSignal<'_> {
    /// The signal, that of a millisecond of exposure, in which cameras of other exposures compare, and the signal to noise.
    fn numbers(&self, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
        let frame = label(self.frame);
        let number = |what: &str, unit, value| {
            RunNumber::new(Subject::Signal, format!("{what} in {}, frame {frame}", self.channel), unit, value)
        };
        let limited = |number: RunNumber| match self.is_lower_limit {
            true => {
                let words = number.value.map(|value| format!("at least {}", short(value)));
                RunNumber { value: None, words, ..number }
            }
            false => number,
        };
        let mut numbers = vec![limited(number("Median signal", "e-", self.electrons))];
        let milliseconds = self.exposure_s.map(|s| 1e3 * s).filter(|ms| *ms > 0.0);
        numbers.extend(
            milliseconds
                .map(|ms| limited(number("Median signal per ms of exposure", "e-/ms", self.electrons / ms))),
        );
        numbers.extend(
            self.snr.map(|snr| number(&format!("Signal to noise of a {} pixel", self.snr_of), "", snr)),
        );
        numbers
    }
}

/// The signal to noise of the region's mean in each frame, all its channels together: the root of the sum of their squares. It compares cameras
/// whose channels have other names. Frames of which more than one pixel in a hundred is saturated have none.
fn region_snr_numbers(analysis: &Analysis, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
    let number = |frame: &str, squares: f64| {
        let quantity =
            format!("Signal to noise of the region's mean, all channels of frame {}", label(frame));
        RunNumber::new(Subject::Signal, quantity, "", squares.sqrt())
    };
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
        region
            .mean_rgb_dn
            .iter()
            .zip(region.variance_dn2)
            .map(|(&mean, variance)| square(mean, variance))
            .sum()
    };
    region.map(|region| number(&analysis.frame, squares(region))).into_iter().collect()
}

/// Levels of cameras with other channels than R, G and B, in all frames.
fn signal_numbers(signals: &SignalSummary, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
    let numbers = signals.signals.iter().filter_map(|signal| {
        let median = MedianSignal {
            channel: &signal.channel,
            frame: &signal.frame,
            exposure_s: Some(signal.exposure_s),
            electrons: signal.median_electrons?,
            is_lower_limit: signal.saturated > 0 && signal.saturated >= signal.pixels,
            snr: signal.saturated_share().is_none().then_some(signal.snr_of_pixel),
            snr_of: "mean",
        };
        Some(median.numbers(label))
    });
    numbers.flatten().collect()
}

/// Levels of R, G and B in the region, as cards of reports have them.
fn channel_numbers(
    analysis: &Analysis,
    frames: &[FinishedFrame],
    label: &dyn Fn(&str) -> String,
) -> Vec<RunNumber> {
    let of_frame = || frames.iter().find(|frame| frame.name == analysis.frame).map(|frame| frame.exposure_s);
    let exposure_s = analysis.exposure_s.or_else(of_frame);
    let numbers = analysis.channels.iter().filter_map(|channel| {
        let RegionLevel { electrons, snr, is_lower_limit } = level(analysis, channel)?;
        let (channel, frame) = (channel.name.as_str(), analysis.frame.as_str());
        let median =
            MedianSignal { channel, frame, exposure_s, electrons, is_lower_limit, snr, snr_of: "median" };
        Some(median.numbers(label))
    });
    numbers.flatten().collect()
}

/// What eyes and tissue bear in a day: captures of each kind, and whole sequences.
fn safety_numbers(safety: &FinishedSafety, label: &dyn Fn(&str) -> String) -> Vec<RunNumber> {
    let lit = || safety.captures.iter().filter(|capture| !capture.viewers.is_empty());
    let number = |quantity: String, count: u64, light_on_s: f64| {
        let number = RunNumber::new(Subject::Safety, quantity, "in 8 h", count as f64);
        // More than fit into the day are no limit
        match (count as f64 + 1.0) * light_on_s > DAY_S {
            true => RunNumber { value: None, words: Some("no limit".into()), ..number },
            false => number,
        }
    };
    let fewest = |capture: &FinishedCapture| capture.viewers.iter().filter_map(|v| v.captures_per_day).min();
    let mut numbers: Vec<RunNumber> = lit()
        .filter_map(|capture| {
            let quantity = format!("Safe captures of frame {}", label(&capture.name));
            Some(number(quantity, fewest(capture)?, capture.light_on_s))
        })
        .collect();
    if lit().count() > 1 {
        let all_s: f64 = lit().map(|capture| capture.light_on_s).sum();
        let sequences = safety.program.iter().filter_map(|line| line.sequences_per_day).min();
        numbers.extend(sequences.map(|count| number("Safe sequences of all captures".into(), count, all_s)));
    }
    numbers
}
