//! Signals of any channels of any frames over a region: levels, signal to noise, ratios, and sums of known fluorophores.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::statistics::median;
use super::{ChannelNoise, ExclusionCounts, PixelMean, PixelSelection};
use crate::image::ChannelImage;
use crate::sampling::Z_95;
use crate::warning::Warning;

/// One channel of one frame over a region.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelSignal {
    /// Frame.
    pub frame: String,
    /// Channel.
    pub channel: String,
    /// Time of the frame's exposure in which light fell, s.
    pub exposure_s: f64,
    /// Pixels that are not saturated.
    pub pixels: usize,
    /// Pixels that are, and are left out of the mean: without them it is a lower limit.
    #[serde(default)]
    pub saturated: usize,
    /// Median of all pixels, saturated ones at the level at which they clip, in electrons: a lower limit where half of them are. `None` in
    /// results of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub median_electrons: Option<f64>,
    /// Mean of the pixels that are not saturated, DN.
    pub mean_dn: f64,
    /// The same in electrons per pixel.
    pub electrons: f64,
    /// Its standard error by the sensor's noise, e-.
    pub standard_error_e: f64,
    /// Signal to noise of one pixel.
    pub snr_of_pixel: f64,
}

impl ChannelSignal {
    /// Signals of all channels of a developed frame over a region; empty where every pixel is saturated.
    #[must_use]
    pub fn of_frame(
        image: &ChannelImage,
        region: &PixelSelection,
        noise: &ChannelNoise,
        [dn_per_electron, exposure_s]: [f64; 2],
    ) -> Vec<Self> {
        let n = image.channels.len();
        let usable: Vec<usize> =
            region.pixels.iter().copied().filter(|&p| image.saturated.get(p) == Some(&false)).collect();
        if usable.is_empty() {
            return Vec::new();
        }
        let count = usable.len() as f64;
        let all: Vec<usize> = (0..n).collect();
        let Some(mean) = PixelMean::new(image, &all, &usable, noise) else { return Vec::new() };
        let value = |channel: usize| {
            let data = move |&pixel: &usize| image.data.get(pixel * n + channel).map(|&dn| f64::from(dn));
            region.pixels.iter().filter_map(data)
        };
        let of = |(channel, name): (usize, &String)| {
            let mean_dn = mean.dn[channel];
            let variance =
                usable.iter().map(|&p| noise.of_pixel(image, [channel], p)[0]).sum::<f64>() / count;
            Self {
                frame: image.label.clone(),
                channel: name.clone(),
                exposure_s,
                pixels: usable.len(),
                saturated: region.pixels.len() - usable.len(),
                median_electrons: median(value(channel)).map(|dn| dn / dn_per_electron),
                mean_dn,
                electrons: mean_dn / dn_per_electron,
                standard_error_e: mean.variance_dn2[channel].sqrt() / dn_per_electron,
                snr_of_pixel: mean_dn / variance.sqrt().max(f64::MIN_POSITIVE),
            }
        };
        image.channels.iter().enumerate().map(of).collect()
    }

    /// Share of the region's pixels that are saturated, where they are more than one in a hundred.
    #[must_use]
    pub fn saturated_share(&self) -> Option<f64> {
        let counts =
            ExclusionCounts { valid: self.pixels, saturated: self.saturated, ..ExclusionCounts::default() };
        counts.saturated_share()
    }

    /// Its name: that of the channel and of its frame, or of the frame alone where it has one channel.
    #[must_use]
    pub fn name(&self) -> String {
        if self.channel == "mono" {
            self.frame.clone()
        } else {
            format!("{} of {}", self.channel, self.frame)
        }
    }

    /// Its name in words that no light of the same name is taken for: `R of frame "blue"`.
    #[must_use]
    pub fn title(&self) -> String {
        let frame = format!("frame \"{}\"", self.frame);
        if self.channel == "mono" { frame } else { format!("{} of {frame}", self.channel) }
    }
}

/// One signal over another, as if both frames had the same exposure time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SignalRatio {
    /// The signal above.
    pub above: String,
    /// The signal below.
    pub below: String,
    /// Electrons per second over electrons per second.
    pub ratio: f64,
    /// Its standard error by the sensor's noise, to first order.
    pub standard_error: f64,
}

impl SignalRatio {
    /// The ratio of two independent signals; `None` where the one below is not above its noise.
    #[must_use]
    pub fn new(above: &ChannelSignal, below: &ChannelSignal) -> Option<Self> {
        if below.electrons <= 2.0 * below.standard_error_e || below.electrons <= 0.0 {
            return None;
        }
        let times = if above.exposure_s > 0.0 && below.exposure_s > 0.0 {
            below.exposure_s / above.exposure_s
        } else {
            1.0
        };
        let ratio = times * above.electrons / below.electrons;
        let error = (times * above.standard_error_e).hypot(ratio * below.standard_error_e) / below.electrons;
        Some(Self { above: above.name(), below: below.name(), ratio, standard_error: error })
    }
}

/// Fluorophores that one term of a sum stands for, with the electrons that one unit of it gives in each signal.
#[derive(Clone, Debug, PartialEq)]
pub struct UnmixingTerm {
    /// Names.
    pub fluorophores: Vec<String>,
    /// Electrons in each signal.
    pub electrons: Vec<f64>,
}

/// One term of signals that were taken apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnmixedTerm {
    /// Fluorophores that it stands for.
    pub fluorophores: Vec<String>,
    /// Its amount, in the unit of the concentrations, as if the light fell directly on a flat sample; 0 or more.
    pub amount: f64,
    /// 95 % of it by the sensor's noise.
    pub amount_interval: [f64; 2],
    /// Its share of the electrons of all signals together.
    pub share: f64,
    /// 95 % of it by the sensor's noise.
    pub share_interval: [f64; 2],
    /// The share that a simulation knows: of the electrons of all light that fluoresced once, by whatever way it came.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub true_share: Option<f64>,
}

/// Light of fluorophores that no term has, such as that of teeth, reflected in the region.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OtherLight {
    /// Its share of the electrons of all light that fluoresced once, 0 to 1.
    pub share: f64,
    /// Whether the true share of the bulk holds it: of two terms the fit has no other place for what is no porphyrin. Of more terms no
    /// true share holds it.
    pub counts_as_bulk: bool,
}

impl OtherLight {
    /// Least share that is worth a word.
    const LEAST: f64 = 1e-4;

    /// Whether there is more than next to nothing of it.
    #[must_use]
    pub fn is_worth_telling(&self) -> bool {
        self.share >= Self::LEAST
    }
}

/// Signals as a sum of fluorophores.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unmixing {
    /// Signals that entered.
    pub signals: Vec<String>,
    /// Terms of the sum.
    pub terms: Vec<UnmixedTerm>,
    /// Root mean square of what is left, in standard errors; none where there are as many terms as signals.
    pub misfit: Option<f64>,
    /// What a simulation knows of the light of fluorophores that no term has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub true_share_of_others: Option<OtherLight>,
}

/// Everything about the signals of a region.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SignalSummary {
    /// Each channel of each frame with light.
    pub signals: Vec<ChannelSignal>,
    /// Each signal over the strongest one.
    pub ratios: Vec<SignalRatio>,
    /// What the signals are made of; none where they are too few.
    pub unmixing: Option<Unmixing>,
}

/// Largest number of terms of a sum: all sets of them are tried.
const MOST_TERMS: usize = 10;
/// Columns whose cosines leave less than this of a direction of their own are one and the same.
const LEAST_OWN: f64 = 1e-6;

impl Unmixing {
    /// Fits `electrons = sum_j a_j electrons_j` with `a_j >= 0`, weighted by the known standard errors of the signals. The best set of free
    /// terms is found among all; intervals are those of the free terms, and of a term at zero those that it would have if it were free.
    /// `None` for fewer signals than terms, more than ten terms, and terms that the signals can't tell apart.
    #[must_use]
    pub fn new(signals: &[&ChannelSignal], terms: &[UnmixingTerm]) -> Option<Self> {
        let (rows, columns) = (signals.len(), terms.len());
        if columns == 0 || columns > MOST_TERMS || rows < columns {
            return None;
        }
        let error = |i: usize| signals[i].standard_error_e.max(f64::MIN_POSITIVE);
        let matrix = DMatrix::from_fn(rows, columns, |i, j| terms[j].electrons[i] / error(i));
        let data = DVector::from_fn(rows, |i, _| signals[i].electrons / error(i));
        if !is_independent(&matrix) {
            return None;
        }
        // The feasible set of free terms that leaves least
        let feasible = (1usize..1 << columns).filter_map(|set| {
            let free: Vec<usize> = (0..columns).filter(|j| set & (1 << j) != 0).collect();
            let (weights, _) = least_squares(&matrix, &data, &free)?;
            let is_feasible = weights.iter().all(|weight| *weight >= 0.0);
            let left = (&data - &matrix * spread(&weights, &free, columns)).norm_squared();
            is_feasible.then_some((left, free))
        });
        let (left, free) =
            feasible.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((data.norm_squared(), Vec::new()));
        let weights = match least_squares(&matrix, &data, &free) {
            Some((weights, _)) => spread(&weights, &free, columns),
            None => DVector::zeros(columns),
        };
        let terms = (0..columns)
            .map(|j| unmixed(&matrix, &data, &free, &weights, terms, j))
            .collect::<Option<_>>()?;
        let freedom = rows - columns;
        Some(Self {
            signals: signals.iter().map(|signal| signal.name()).collect(),
            terms,
            misfit: (freedom > 0).then(|| (left / freedom as f64).sqrt()),
            true_share_of_others: None,
        })
    }
}

/// Whether no column is nearly a sum of the others: smallest eigenvalue of the cosines between them.
fn is_independent(matrix: &DMatrix<f64>) -> bool {
    let lengths: Vec<f64> = matrix.column_iter().map(|column| column.norm()).collect();
    if lengths.iter().any(|length| *length <= 0.0 || !length.is_finite()) {
        return false;
    }
    let cosines = DMatrix::from_fn(lengths.len(), lengths.len(), |i, j| {
        matrix.column(i).dot(&matrix.column(j)) / (lengths[i] * lengths[j])
    });
    cosines.symmetric_eigenvalues().min() > LEAST_OWN
}

fn spread(weights: &DVector<f64>, free: &[usize], columns: usize) -> DVector<f64> {
    let mut all = DVector::zeros(columns);
    free.iter().zip(weights.iter()).for_each(|(&j, weight)| all[j] = *weight);
    all
}

/// Weights of some columns, and their covariance.
fn least_squares(
    matrix: &DMatrix<f64>,
    data: &DVector<f64>,
    free: &[usize],
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    if free.is_empty() {
        return None;
    }
    let part = matrix.select_columns(free);
    let inverse = (part.transpose() * &part).cholesky()?.inverse();
    Some((&inverse * (part.transpose() * data), inverse))
}

/// One term with its intervals. Its share of the electrons varies with all amounts.
fn unmixed(
    matrix: &DMatrix<f64>,
    data: &DVector<f64>,
    free: &[usize],
    weights: &DVector<f64>,
    terms: &[UnmixingTerm],
    term: usize,
) -> Option<UnmixedTerm> {
    let mut columns = free.to_vec();
    if !columns.contains(&term) {
        columns.push(term);
        columns.sort_unstable();
    }
    let (center, covariance) = least_squares(matrix, data, &columns)?;
    let own = columns.iter().position(|&column| column == term)?;
    let reach = Z_95 * covariance[(own, own)].sqrt();
    let amount = |value: f64| value.max(0.0);
    // Electrons of each term per unit
    let per_unit: Vec<f64> = columns.iter().map(|&j| terms[j].electrons.iter().sum()).collect();
    let total: f64 = center.iter().zip(&per_unit).map(|(a, e)| a * e).sum();
    let share_of = center[own] * per_unit[own] / total;
    let slope = DVector::from_fn(columns.len(), |k, _| {
        let is_own = if k == own { 1.0 } else { 0.0 };
        per_unit[k] * (is_own - share_of) / total
    });
    let share_reach = Z_95 * slope.dot(&(&covariance * &slope)).max(0.0).sqrt();
    let all: f64 = weights.iter().zip(terms).map(|(a, t)| a * t.electrons.iter().sum::<f64>()).sum();
    let share = weights[term] * terms[term].electrons.iter().sum::<f64>() / all.max(f64::MIN_POSITIVE);
    Some(UnmixedTerm {
        fluorophores: terms[term].fluorophores.clone(),
        amount: amount(weights[term]),
        amount_interval: [amount(center[own] - reach), amount(center[own] + reach)],
        share,
        share_interval: [share_of - share_reach, share_of + share_reach].map(|share| share.clamp(0.0, 1.0)),
        true_share: None,
    })
}

impl SignalSummary {
    /// What saturated pixels do to the signals, one line for each frame that has them.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let first = |s: &&ChannelSignal| self.signals.iter().find(|other| other.frame == s.frame) == Some(*s);
        let line = |s: &ChannelSignal| {
            let percent = 100.0 * s.saturated_share()?;
            let statement = format!(
                "{percent:.0} % of the region's pixels are saturated in frame \"{}\" and left out of its means, which are lower limits: ratios \
                 and shares with them compare other pixels than those of frames that are not saturated",
                s.frame
            );
            Some(Warning::explained(statement, "Shorten the exposure or lower the gain."))
        };
        self.signals.iter().filter(first).filter_map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::Key;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    fn signal(frame: &str, electrons: f64, error: f64) -> ChannelSignal {
        ChannelSignal {
            frame: frame.into(),
            channel: "mono".into(),
            exposure_s: 0.01,
            pixels: 100,
            saturated: 0,
            median_electrons: Some(electrons),
            mean_dn: 0.5 * electrons,
            electrons,
            standard_error_e: error,
            snr_of_pixel: 10.0,
        }
    }

    fn terms() -> Vec<UnmixingTerm> {
        let term = |name: &str, electrons: [f64; 4]| UnmixingTerm {
            fluorophores: vec![name.into()],
            electrons: electrons.into(),
        };
        vec![
            term("a", [100.0, 60.0, 20.0, 5.0]),
            term("b", [10.0, 50.0, 80.0, 30.0]),
            term("c", [0.0, 5.0, 20.0, 90.0]),
        ]
    }

    /// 95 % intervals of amounts and shares hold the truth in 95 % of 400 draws: 380 with a standard deviation of 4.4.
    #[test]
    fn amounts_come_back_within_their_intervals() {
        let terms = terms();
        let amounts = [2.0, 1.0, 0.5];
        let truth = |i: usize| terms.iter().zip(amounts).map(|(t, a)| a * t.electrons[i]).sum::<f64>();
        let all: f64 = (0..4).map(truth).sum();
        let share = |j: usize| amounts[j] * terms[j].electrons.iter().sum::<f64>() / all;
        let mut rng = Key::new(5).rng();
        let mut inside = [[0; 3]; 2];
        for _ in 0..400 {
            let drawn: Vec<ChannelSignal> = (0..4)
                .map(|i| signal("w", truth(i) + 3.0 * rng.sample::<f64, _>(StandardNormal), 3.0))
                .collect();
            let found = Unmixing::new(&drawn.iter().collect::<Vec<_>>(), &terms).unwrap();
            for (j, term) in found.terms.iter().enumerate() {
                let holds = |[low, high]: [f64; 2], value: f64| usize::from(low <= value && value <= high);
                inside[0][j] += holds(term.amount_interval, amounts[j]);
                inside[1][j] += holds(term.share_interval, share(j));
            }
        }
        for count in inside.into_iter().flatten() {
            assert!((362..=397).contains(&count), "{inside:?}");
        }
    }

    #[test]
    fn exact_signals_give_exact_amounts_and_what_is_not_there_is_zero() {
        let terms = terms();
        let exact: Vec<ChannelSignal> = (0..4)
            .map(|i| {
                signal(&format!("w{i}"), 3.0 * terms[0].electrons[i] + 0.25 * terms[2].electrons[i], 1.0)
            })
            .collect();
        let signals: Vec<&ChannelSignal> = exact.iter().collect();
        let found = Unmixing::new(&signals, &terms).unwrap();
        let amounts: Vec<f64> = found.terms.iter().map(|term| term.amount).collect();
        for (amount, expected) in amounts.iter().zip([3.0, 0.0, 0.25]) {
            assert!((amount - expected).abs() < 1e-9, "{amounts:?}");
        }
        assert!(found.terms[1].amount_interval[1] > 0.0 && found.misfit.unwrap() < 1e-6);
        assert!((found.terms.iter().map(|term| term.share).sum::<f64>() - 1.0).abs() < 1e-12);
        // Too few signals, and terms that are one and the same.
        assert_eq!(Unmixing::new(&signals[..2], &terms), None);
        let twins = [terms[0].clone(), terms[0].clone()];
        assert_eq!(Unmixing::new(&signals, &twins), None);
    }

    #[test]
    fn a_mean_without_saturated_pixels_is_warned_of() {
        let summary = |saturated| SignalSummary {
            signals: vec![ChannelSignal { saturated, ..signal("red", 50.0, 1.0) }],
            ..SignalSummary::default()
        };
        let few = summary(1);
        assert!(few.warnings().is_empty());
        let many = summary(100);
        assert!(many.warnings()[0].starts_with("50 % of the region's pixels are saturated in frame \"red\""));
    }

    #[test]
    fn ratios_carry_the_errors_of_both() {
        let ratio = SignalRatio::new(&signal("red", 50.0, 1.0), &signal("green", 100.0, 4.0)).unwrap();
        assert_eq!((ratio.above.as_str(), ratio.below.as_str(), ratio.ratio), ("red", "green", 0.5));
        // sqrt(1² + (0.5 * 4)²) / 100
        assert!((ratio.standard_error - 5f64.sqrt() / 100.0).abs() < 1e-12);
        assert_eq!(SignalRatio::new(&signal("red", 50.0, 1.0), &signal("green", 3.0, 4.0)), None);
        // Twice the time for the one above: half the ratio, half the part of its error.
        let longer = ChannelSignal { exposure_s: 0.02, ..signal("red", 50.0, 1.0) };
        let ratio = SignalRatio::new(&longer, &signal("green", 100.0, 4.0)).unwrap();
        assert!((ratio.ratio - 0.25).abs() < 1e-12);
        assert!((ratio.standard_error - 0.5f64.hypot(1.0) / 100.0).abs() < 1e-12);
    }
}
