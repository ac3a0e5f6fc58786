//! Findings in words: names, values and meanings, each worded here and nowhere else.

use fluorspar::analysis::Analyte;
use fluorspar::findings::{Caveat, Finding, FindingId};

use crate::run::capital;
use crate::{Number, Origin};

/// What is said where electrons are of frames whose conversion gain is assumed.
pub const ASSUMED_GAIN: &str =
    "with the conversion gain of the experiment's sensor, as the frame does not tell its own";

/// How findings are worded: what is looked for, and what frames are called.
pub(crate) struct FindingWords<'a> {
    /// The fluorophore that is looked for.
    pub(crate) analyte: &'a Analyte,
    /// What stands for a frame.
    pub(crate) frame: &'a dyn Fn(&str) -> String,
}

impl<'a> FindingWords<'a> {
    /// With frames by their names in quotes.
    #[must_use]
    pub(crate) fn of(analyte: &'a Analyte) -> Self {
        Self { analyte, frame: &|frame| format!("\"{frame}\"") }
    }

    /// What it is, the same in all runs.
    #[must_use]
    pub(crate) fn name(&self, finding: &Finding) -> String {
        use FindingId as Id;

        let (analyte, share) = (self.analyte, format!("{} share", self.analyte.capitalized()));
        let name = finding.name.as_deref().unwrap_or_default();
        let frame = finding.frame.as_deref().unwrap_or_default();
        let frames: Vec<String> =
            frame.split(" + ").filter(|frame| !frame.is_empty()).map(self.frame).collect();
        let frame = frames.join(" and ");
        let of_frame =
            |what: &str| if frame.is_empty() { what.to_owned() } else { format!("{what} of frame {frame}") };
        let signal = |what: &str| match finding.channel.as_deref() {
            Some("mono") | None => format!("{what}, frame {frame}"),
            Some(channel) => format!("{what} in {channel}, frame {frame}"),
        };
        let of_target = |what: &str| format!("{what} of target \"{name}\", frame {frame}");
        let channel = finding.channel.as_deref().unwrap_or_default();
        match finding.id {
            Id::Share => format!("{share} of the light"),
            Id::RedShare => format!("Red fluorescence ({analyte} and plant pigment)"),
            Id::VisibleInPatches => {
                format!("Smallest {analyte} share told from none, in patches over a tenth of the region")
            }
            Id::VisibleEvenly => format!("Smallest {analyte} share told from none, spread evenly"),
            Id::ShareUpperLimit => format!("Upper limit of the {analyte} share"),
            Id::ShareOfMean => format!("{share} from the mean of the region alone"),
            Id::MarkedBlocks => format!("Places with {analyte}"),
            Id::ProbabilityOfNone => format!("Probability of no {analyte}"),
            Id::ShareInWiderFamily => format!("{share} if tissue varies twice as much"),
            Id::TissueProbability => format!("Probability of {}", name.replace('_', " ")),
            Id::TissueBayesFactor => format!("Bayes factor of {}", name.replace('_', " ")),
            Id::MostConfused => format!("Correlation with {name}, the easiest to confuse with it"),
            Id::ShareWithout => format!("{share} without {name}"),
            Id::FamilyDistance => "Distance from the assumed tissue".into(),
            Id::LineShare => format!("{share} on the mixture line"),
            Id::LineShareByNoise => format!("{share} on the mixture line, noise alone"),
            Id::LineNoise => "Sensor noise".into(),
            Id::LineChange => capital(name),
            Id::LineBlank => "Blank".into(),
            Id::DetectionLimit => format!("Detection limit of the {analyte} share"),
            Id::AmountRatio => "Ratio of amounts a_p/(a_b+a_p)".into(),
            Id::AmountRatioOfPixels => "Ratio of amounts, pixels".into(),
            Id::AmountRatioErrorOfPixel => "Ratio of amounts, standard error of a pixel".into(),
            Id::LineDistance => "Distance from the line".into(),
            Id::PixelsOffLine => "Off the line".into(),
            Id::LineAngle => "Angle to the line".into(),
            Id::PixelsBeyondEnd => "Beyond an end".into(),
            Id::LineLength => "Length of the line".into(),
            Id::UnmixedShare => format!("Share of {}, unmixed from all signals", short_list(name)),
            Id::UnmixedAmount => format!("Amount of {}, unmixed from all signals", short_list(name)),
            Id::UnmixedOthers => "Light of other parts".into(),
            Id::UnmixingMisfit => "What the unmixing leaves".into(),
            Id::TrueShare => format!("True {analyte} share"),
            Id::WidthOverTruth => "Width of the 95 % interval over the true share".into(),
            Id::UpperLimitOverTruth => "Upper limit over the true share".into(),
            Id::LimitOverTruth => "Detection limit over the true share".into(),
            Id::SpotSeparation => {
                let noun = if frames.len() > 1 { "frames" } else { "frame" };
                format!("d' of the spots, {name} of {noun} {frame}")
            }
            Id::TargetSeparation => of_target("d'"),
            Id::TargetSeparationOfPixel => of_target("d' of a pixel"),
            Id::TargetSeparationOfSensor => of_target("d' by sensor noise alone"),
            Id::TargetContrast => of_target(&format!("Contrast in {channel}")),
            Id::TargetCnr => of_target(&format!("CNR in {channel}")),
            Id::SmallestDiameter => of_target("Smallest visible diameter"),
            Id::FramesNeeded => of_target("Frames to average"),
            Id::Leak => of_frame("Leak"),
            Id::MedianSignal => signal("Median signal"),
            Id::MedianSignalPerMs => signal("Median signal per ms of exposure"),
            Id::PixelSnr => signal("Signal to noise of a pixel"),
            Id::MeanSignal => signal("Mean signal"),
            Id::MeanLevel => signal("Mean level"),
            Id::SignalRatio => format!("Signal of {name}"),
            Id::RegionSnr => format!("Signal to noise of the region's mean, all channels of frame {frame}"),
            Id::ChromaticityR => "r".into(),
            Id::ChromaticityG => "g".into(),
            Id::SpreadAlong => "Spread along".into(),
            Id::SpreadAcross => "Spread across".into(),
            Id::PixelsOfRegion => "In the region".into(),
            Id::PixelsUsed => "Used".into(),
            Id::PixelsSaturated => "Saturated".into(),
            Id::PixelsBelowNoise => "Below the noise floor".into(),
            Id::PixelsWithoutSignal => "Without signal".into(),
            Id::MedianLevel => format!("{channel} level"),
            Id::Exposure => of_frame("Exposure"),
            Id::Clipped if frame.is_empty() => "Clipped pixels of the region".into(),
            Id::Clipped => of_frame("Clipped pixels"),
            Id::SafeCaptures => format!("{}, for the {name}", of_frame("Safe captures")),
            Id::SafeSequences => format!("Safe sequences of all captures, for the {name}"),
        }
    }

    /// What it means, in a sentence or two.
    #[must_use]
    pub(crate) fn meaning(&self, finding: &Finding) -> String {
        use FindingId as Id;

        let analyte = self.analyte;
        let reference = shown(finding).reference.map(number).unwrap_or_default();
        let truth = finding.reference.map_or_else(String::new, |_| format!(" True: {reference} %."));
        match finding.id {
            Id::Share => format!(
                "Electrons of {analyte} light over those of all fluorescence of the region. The interval of 95 % holds sensor noise, leak, \
                 indirect light, the variety of tissue and errors of the library of spectra."
            ),
            Id::RedShare => format!("Share of both in the fluorescence, by color alone.{truth}"),
            Id::ShareUpperLimit => "The share is below it with a probability of 95 %.".into(),
            Id::ShareOfMean => "What one color of the whole region says, without its pattern.".into(),
            Id::MarkedBlocks => of_marked_blocks(&reference, analyte),
            Id::ProbabilityOfNone => format!("Before the measurement it was taken as {reference} %."),
            Id::ShareInWiderFamily => {
                "Where it is far from the interval above, the assumed variety of tissue decides.".into()
            }
            Id::TissueProbability => "After the measurement; the named tissue first.".into(),
            Id::TissueBayesFactor => "How much better it explains the colors than the named tissue.".into(),
            Id::MostConfused => "Correlation of an error of the share with it.".into(),
            Id::ShareWithout => "The interval if this were known.".into(),
            Id::FamilyDistance => {
                format!("Chi-square: about {reference}, the number of signals, where the tissue is as assumed.")
            }
            Id::LineShare | Id::LineShareByNoise => {
                let holds = match finding.has(&Caveat::SensorNoiseAlone) {
                    true => "The interval holds the sensor's noise alone",
                    false => {
                        "The interval holds noise and the changes below, but neither the variety of tissue nor errors of the library"
                    }
                };
                format!(
                    "Electrons of {analyte} light over those of {analyte} and bulk, as if the bulk were known. {holds}."
                )
            }
            Id::LineNoise => "Half of the 95 % interval that the sensor's noise leaves.".into(),
            Id::LineChange => format!("Without it the share would be {reference} %."),
            Id::LineBlank => format!("The estimate from the same light without that of the {analyte}."),
            Id::DetectionLimit => {
                "A share this far above the blank is missed, or falsely seen, in at most 5 % of frames, by sensor noise alone."
                    .into()
            }
            Id::AmountRatio => format!(
                "Amount of {analyte} over the amounts of {analyte} and bulk, in the units of the catalogue (Lyu et al. 2021, Sec. 4.1): no \
                 share of the light, which depends on how bright a unit of each is."
            ),
            Id::AmountRatioOfPixels => "The same for each pixel on its own.".into(),
            Id::AmountRatioErrorOfPixel => "How far noise alone moves the ratio of a typical pixel.".into(),
            Id::LineDistance => format!(
                "How far pixels lie beside the line between bulk and {analyte}. Far from zero, something else is in the light: reflected \
                 light, or another bulk than assumed."
            ),
            Id::PixelsOffLine => format!(
                "Of {reference}: farther beside the line than three standard errors. By chance, 3 in 1000 are."
            ),
            Id::LineAngle => format!("Small when pixels differ mainly in {analyte}."),
            Id::PixelsBeyondEnd => format!(
                "Of {reference}: past the bulk or the {analyte} point; they count as lying at that end. Without {analyte}, noise puts half of \
                 them there."
            ),
            Id::LineLength => format!(
                "Distance between bulk and {analyte}. The longer it is beside the noise, the better this design tells them apart."
            ),
            Id::UnmixedShare => {
                format!("Of the electrons of all signals together, as if all spectra were known.{truth}")
            }
            Id::UnmixedAmount => "On a flat sample under direct light, by sensor noise alone.".into(),
            Id::UnmixedOthers => format!(
                "The simulation knows: share of fluorophores that no term has, as of other parts; {}.",
                place_of_others(finding)
            ),
            Id::UnmixingMisfit => {
                "Root mean square of the signals less the sum. Far above 1 flat samples of these fluorophores under direct light don't make \
                 up the region: light is absorbed on its way, comes indirectly, is reflected, or another fluorophore gives it off."
                    .into()
            }
            Id::TrueShare => format!(
                "{} electrons over all fluorescence electrons of the region; the range counts light that fluoresced twice one way or the \
                 other.",
                analyte.capitalized()
            ),
            Id::WidthOverTruth | Id::UpperLimitOverTruth | Id::LimitOverTruth => {
                "In units of what is there, in which cameras with other lights and filters compare.".into()
            }
            Id::SpotSeparation => {
                let right = finding.reference.map_or(0.0, |right| 100.0 * right);
                format!(
                    "Distance of the two spots in standard deviations of a pixel; an ideal observer assigns {right:.0} % of single pixels to \
                     the right spot."
                )
            }
            Id::SignalRatio => "Electrons per second over electrons per second, by sensor noise alone.".into(),
            Id::ChromaticityR => "Share of the signal that is red: mean and standard deviation of the pixels.".into(),
            Id::ChromaticityG => "The same of green.".into(),
            Id::SpreadAlong | Id::SpreadAcross => "Standard deviation of the cloud of pixels along an axis.".into(),
            Id::PixelsOfRegion => "All pixels of the region.".into(),
            Id::PixelsUsed => "Pixels bright enough and not saturated.".into(),
            Id::PixelsSaturated => "Left out: their true value is unknown.".into(),
            Id::PixelsBelowNoise => format!("Left out: the sum of the channels is below {reference} DN."),
            Id::PixelsWithoutSignal => "Left out: the sum of the channels is not positive.".into(),
            Id::MedianLevel => match finding.has(&Caveat::NineTenths) {
                true => "Median over the unsaturated pixels of the region, and the range of nine tenths of them.",
                false => "Median over all pixels of the region; a lower limit where half of them are saturated.",
            }
            .into(),
            _ => String::new(),
        }
    }

    /// A row of a table.
    #[must_use]
    pub(crate) fn row(&self, finding: &Finding) -> Number {
        let value = value(finding).replace('-', "−");
        Number::computed(self.name(finding), value, shown(finding).unit, self.meaning(finding))
            .from(Origin::Computed)
    }

    /// A line of text.
    #[must_use]
    pub(crate) fn line(&self, finding: &Finding) -> String {
        let shown = shown(finding);
        let has_unit = !shown.unit.is_empty() && !finding.has(&Caveat::Unbounded);
        let unit = if has_unit { format!(" {}", shown.unit) } else { String::new() };
        let noise = match finding.has(&Caveat::SensorNoiseAlone) {
            true => " by sensor noise alone",
            false => "",
        };
        let judged = match (finding.id, shown.reference) {
            (FindingId::ProbabilityOfNone, Some(before)) => format!(" ({} % before)", number(before)),
            (FindingId::UnmixedShare, Some(truth)) => format!("; true share {} %", number(truth)),
            (FindingId::FamilyDistance, Some(count)) => format!(" (chi-square; {} expected)", number(count)),
            (FindingId::PixelsOffLine | FindingId::PixelsBeyondEnd | FindingId::MarkedBlocks, Some(all)) => {
                format!(" of {}", number(all))
            }
            (FindingId::SpotSeparation, Some(right)) => format!(", {:.0} % of pixels right", 100.0 * right),
            (FindingId::RedShare, Some(truth)) => format!("; true {} %", number(truth)),
            (FindingId::VisibleInPatches, _) => match &finding.name {
                Some(limit) => format!(", limited by {limit}"),
                None => String::new(),
            },
            (FindingId::UnmixedOthers, _) => format!("; {}", place_of_others(finding)),
            (FindingId::DetectionLimit, _) => " above the blank".into(),
            (FindingId::TrueShare, _) if value(finding).ends_with(')') => {
                " with light that fluoresced twice".into()
            }
            (FindingId::SmallestDiameter, Some(wanted)) => format!(" for d' {}", number(wanted)),
            _ => String::new(),
        };
        let render = finding.caveats.iter().find_map(|caveat| match caveat {
            Caveat::RenderNoise(ratio, samples) => Some(format!("; {}", render_noise(*ratio, *samples))),
            _ => None,
        });
        format!(
            "{}: {}{unit}{}{noise}{judged}{}",
            self.name(finding),
            value_alone(finding),
            saturated(finding),
            render.unwrap_or_default()
        )
    }
}

/// What marked blocks are, and what they tell.
fn of_marked_blocks(all: &str, analyte: &Analyte) -> String {
    format!(
        "Of {all} squares of the region: their share is above 2 %, but for at most 5 % of them. The tissue of one person varies little from \
         place to place, so the places with the least red light tell its color without {analyte}."
    )
}

/// Where the truth counts light of other parts.
fn place_of_others(finding: &Finding) -> &'static str {
    match finding.has(&Caveat::CountsAsBulk) {
        true => "it counts as bulk in the true shares, as in the fit",
        false => "it is in no true share; the fit spreads it over the terms",
    }
}

/// That the noise of the render was taken out, and how many samples make it small.
pub(crate) fn render_noise(ratio: f64, samples: u32) -> String {
    format!(
        "noise of the render, {ratio:.1} times the rest in variance, was taken out and widens the interval: \
         render.samples_per_pixel = {samples} makes it a quarter"
    )
}

/// A finding as it is shown: shares of the light in percent.
pub(crate) fn shown(finding: &Finding) -> Finding {
    use FindingId as Id;

    let is_share = matches!(
        finding.id,
        Id::Share
            | Id::RedShare
            | Id::ShareUpperLimit
            | Id::VisibleInPatches
            | Id::VisibleEvenly
            | Id::ShareOfMean
            | Id::ShareInWiderFamily
            | Id::ShareWithout
            | Id::LineShare
            | Id::LineShareByNoise
            | Id::LineNoise
            | Id::LineChange
            | Id::LineBlank
            | Id::DetectionLimit
            | Id::UnmixedShare
            | Id::UnmixedOthers
            | Id::TrueShare
    );
    if !is_share {
        return finding.clone();
    }
    let percent = |share: f64| 100.0 * share;
    Finding {
        value: finding.value.map(percent),
        interval: finding.interval.map(|ends| ends.map(percent)),
        reference: finding.reference.map(percent),
        unit: "%",
        ..finding.clone()
    }
}

/// The bulk is too long for a row.
fn short_list(names: &str) -> String {
    match names.split(" + ").count() {
        1 | 2 => names.to_owned(),
        count => format!("the bulk of {count} fluorophores"),
    }
}

/// How much of the pixels is saturated, in brackets; empty where that is not said.
fn saturated(finding: &Finding) -> String {
    let share = finding.caveats.iter().find_map(|caveat| match caveat {
        Caveat::Saturated(share) => Some(format!(" ({:.0} % saturated)", 100.0 * share)),
        _ => None,
    });
    share.unwrap_or_default()
}

/// The value with its interval, without the unit.
#[must_use]
pub(crate) fn value(finding: &Finding) -> String {
    value_alone(finding) + &saturated(finding)
}

fn value_alone(finding: &Finding) -> String {
    let finding = &shown(finding);
    let open = |end: f64| if end.is_finite() { number(end) } else { "open".into() };
    let [low, high] = finding.interval.unwrap_or([f64::NAN; 2]);
    let digits = digits_of(low, high);
    let text = |value: f64| match digits {
        Some(digits) if value.is_finite() => format!("{value:.digits$}"),
        _ => open(value),
    };
    let has = |caveat: Caveat| finding.caveats.contains(&caveat);
    if has(Caveat::NoEstimate) {
        "no estimate".into()
    } else if has(Caveat::NotDetected) {
        format!("at most {}", text(high))
    } else if has(Caveat::Unbounded) {
        if finding.id == FindingId::FramesNeeded { "never" } else { "no limit" }.into()
    } else if has(Caveat::LowerLimit) {
        format!("at least {}", finding.value.map(number).unwrap_or_default())
    } else {
        match (finding.value, finding.interval) {
            (Some(value), None) => number(value),
            (None, None) if finding.id == FindingId::TargetContrast => "dark background".into(),
            (None, None) => "-".into(),
            (None, Some(_)) => format!("{} to {}", text(low), text(high)),
            (Some(value), Some(_)) if has(Caveat::StandardDeviation) => {
                format!("{} ± {}", text(value), text(0.5 * (high - low)))
            }
            (Some(value), Some(_)) if has(Caveat::NineTenths) => {
                format!("{} (5 % to 95 %: {} to {})", text(value), text(low), text(high))
            }
            (Some(value), Some(_)) if high.is_infinite() => {
                format!("{} ({} or more)", number(value), number(low))
            }
            // An interval of rounding says nothing
            (Some(value), Some(_)) if high - low <= 1e-6 * value.abs() => number(value),
            (Some(value), Some(_)) => format!("{} ({} to {})", text(value), text(low), text(high)),
        }
    }
}

/// Decimals of which the half of an interval has two digits; `None` where it tells none.
pub(crate) fn digits_of(low: f64, high: f64) -> Option<usize> {
    let half = 0.5 * (high - low);
    (half.is_finite() && half > 0.0).then(|| (1.0 - half.log10().floor()).clamp(0.0, 9.0) as usize)
}

/// Three digits, whatever the size; counts as such.
#[must_use]
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".into()
    } else if value.fract() == 0.0 && size < 1e12 {
        format!("{value:.0}")
    } else if !(1e-4..1e6).contains(&size) {
        format!("{value:.2e}")
    } else {
        let digits = (2.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
        format!("{value:.digits$}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_the_digits_that_their_intervals_carry() {
        let share = |value: Option<f64>, interval, caveats: &[Caveat]| {
            let finding = Finding::new(FindingId::Share, value);
            self::value(&Finding { interval: Some(interval), caveats: caveats.to_vec(), ..finding })
        };
        assert_eq!(share(Some(0.051_234), [0.0399, 0.0625], &[]), "5.1 (4.0 to 6.2)");
        assert_eq!(share(Some(0.051_234), [0.050_9, 0.051_5], &[]), "5.123 (5.090 to 5.150)");
        assert_eq!(share(None, [0.0, 0.0941], &[Caveat::NotDetected]), "at most 9.4");
        assert_eq!(share(None, [0.0, 0.5], &[Caveat::NoEstimate]), "no estimate");
        assert_eq!(share(None, [0.011, 0.083], &[]), "1.1 to 8.3");
        assert_eq!(share(Some(0.015), [0.01, f64::INFINITY], &[]), "1.50 (1 or more)");
        assert_eq!(share(Some(0.25), [0.2, 0.3], &[Caveat::StandardDeviation]), "25.0 ± 5.0");
        let signal = Finding::new(FindingId::MedianSignal, 5000.0);
        let caveats = vec![Caveat::LowerLimit, Caveat::Saturated(0.9)];
        assert_eq!(value(&Finding { caveats, ..signal }), "at least 5000 (90 % saturated)");
        assert_eq!(
            [0.0, 5.0, 1234.56, -0.012_345, 2e-7].map(number),
            ["0", "5", "1235", "-0.0123", "2.00e-7"]
        );
    }
}
