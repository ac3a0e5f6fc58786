//! Findings as people read them: the verdict, lines of text, tables of a page.

mod words;

pub use words::ASSUMED_GAIN;
pub(crate) use words::{FindingWords, digits_of, number, render_noise, shown, value};

use fluorspar::analysis::Analyte;
use fluorspar::findings::{Caveat, Finding, FindingId};

use crate::{NumberMatrix, NumberTable, ReportItem};

/// A table of the page: its findings.
pub(crate) struct Table {
    pub(crate) caption: &'static str,
    pub(crate) ids: &'static [FindingId],
}

use FindingId as Id;

/// The tables of a region, in their order. `{}` stands for the analyte.
pub(crate) const TABLES: &[Table] = &[
    Table {
        caption: "Sensor chromaticity of the region",
        ids: &[Id::ChromaticityR, Id::ChromaticityG, Id::SpreadAlong, Id::SpreadAcross],
    },
    Table { caption: "Ratios of the signals", ids: &[Id::SignalRatio] },
    Table {
        caption: "Fluorophores in the signals",
        ids: &[Id::UnmixedShare, Id::UnmixedAmount, Id::UnmixingMisfit, Id::UnmixedOthers],
    },
    Table {
        caption: "{} in tissue that is not known",
        ids: &[
            Id::RedShare,
            Id::Share,
            Id::ShareUpperLimit,
            Id::VisibleInPatches,
            Id::VisibleEvenly,
            Id::ProbabilityOfNone,
            Id::ShareInWiderFamily,
            Id::TissueProbability,
            Id::TissueBayesFactor,
            Id::MostConfused,
            Id::ShareWithout,
            Id::FamilyDistance,
        ],
    },
    Table {
        caption: "{} share on the mixture line",
        ids: &[
            Id::LineShare,
            Id::LineShareByNoise,
            Id::AmountRatio,
            Id::AmountRatioOfPixels,
            Id::AmountRatioErrorOfPixel,
            Id::LineDistance,
            Id::PixelsOffLine,
            Id::LineAngle,
            Id::PixelsBeyondEnd,
            Id::LineLength,
            Id::DetectionLimit,
        ],
    },
    Table {
        caption: "What the simulation knows",
        ids: &[Id::TrueShare, Id::UpperLimitOverTruth, Id::WidthOverTruth, Id::LimitOverTruth],
    },
    Table {
        caption: "What moves the estimate on the line",
        ids: &[Id::LineNoise, Id::LineChange, Id::LineBlank],
    },
    Table { caption: "How well two spots are told apart", ids: &[Id::SpotSeparation] },
];

/// Pixels and levels, the last table of a region.
pub(crate) const PIXELS: Table = Table {
    caption: "Pixels and levels",
    ids: &[
        Id::PixelsOfRegion,
        Id::PixelsUsed,
        Id::PixelsSaturated,
        Id::PixelsBelowNoise,
        Id::PixelsWithoutSignal,
        Id::MedianLevel,
    ],
};

/// Findings that answer, in this order: what a run says at its end. `analyze` adds [`DETAILS`] and [`PIXELS`].
const ANSWERS: &[FindingId] = &[
    Id::RedShare,
    Id::TrueShare,
    Id::MarkedBlocks,
    Id::ProbabilityOfNone,
    Id::VisibleInPatches,
    Id::LineShare,
    Id::LineBlank,
    Id::DetectionLimit,
    Id::AmountRatio,
    Id::MeanSignal,
    Id::SignalRatio,
    Id::UnmixedShare,
    Id::UnmixedAmount,
    Id::SpotSeparation,
    Id::TargetSeparation,
    Id::SmallestDiameter,
    Id::FramesNeeded,
];

/// What an answer rests on.
const DETAILS: &[FindingId] = &[
    Id::ShareOfMean,
    Id::ShareInWiderFamily,
    Id::VisibleEvenly,
    Id::TissueProbability,
    Id::MostConfused,
    Id::FamilyDistance,
    Id::PixelSnr,
    Id::UnmixedOthers,
    Id::UnmixingMisfit,
    Id::TargetSeparationOfPixel,
    Id::TargetSeparationOfSensor,
    Id::TargetContrast,
    Id::ChromaticityR,
    Id::ChromaticityG,
];

impl Table {
    /// The table of some findings; `None` where there is none of it.
    pub(crate) fn of(&self, findings: &[Finding], words: &FindingWords<'_>) -> Option<ReportItem> {
        let mut own: Vec<&Finding> =
            findings.iter().filter(|finding| self.ids.contains(&finding.id)).collect();
        own.sort_by_key(|finding| self.ids.iter().position(|id| *id == finding.id));
        let caption = self.caption.replace("{}", &words.analyte.capitalized());
        let rows = own.into_iter().map(|finding| words.row(finding)).collect::<Vec<_>>();
        (!rows.is_empty()).then_some(ReportItem::Table(NumberTable { caption, rows }))
    }
}

/// The findings of a region in lines, the verdict first. `whole` adds what it rests on, pixels and levels.
#[must_use]
pub fn finding_lines(findings: &[Finding], analyte: &Analyte, whole: bool) -> Vec<String> {
    let words = FindingWords::of(analyte);
    // Without an answer there is nothing but what would have carried it
    let has_details = whole || answering_share(findings).is_none();
    let details = if has_details { DETAILS } else { &[] };
    let pixels = if whole { PIXELS.ids } else { &[] };
    let of = |id: FindingId| findings.iter().filter(move |finding| finding.id == id);
    // In tissue the line, as if the bulk were known, is no answer beside the estimate
    let in_tissue = of(Id::Share).next().is_some();
    let red = undivided_red(findings);
    let is_told = |id: &FindingId| match id {
        Id::LineShare | Id::LineBlank => !in_tissue,
        Id::RedShare => red.is_none(),
        _ => true,
    };
    let lines = ANSWERS.iter().chain(details).chain(pixels).copied().filter(is_told).flat_map(of);
    let lines = lines.map(|finding| format!("  {}", words.line(finding)));
    let spread = if has_details { "; ± is the spread of the pixels" } else { "" };
    let note = format!("  Intervals are of 95 %{spread}");
    let first = red.map(|red| ShareAnswer::of_share(red, analyte).sentence());
    let truth = red.and_then(|red| red.reference);
    let truth = truth.map(|truth| format!("  True red fluorescence: {} %", number(100.0 * truth)));
    let head = first.into_iter().chain(verdict(findings, analyte)).chain(truth);
    head.chain(lines).chain([note]).collect()
}

/// What may tell porphyrin from plant pigment: per 10 % of the light the ratio of the two frames moves by 0.217 and by 0.001, computed for R, G, B
/// under 385 nm on a tongue; not for this camera.
const TELLS_APART: &str = "a second blue frame behind a 655 nm short-pass may tell";

/// What a share of the fluorescence is, in percent: 5.3 % (3.5 to 9.9 %).
fn percent(finding: &Finding) -> String {
    let text = value(finding);
    match text.strip_suffix(')') {
        Some(text) => format!("{} %)", text.replacen(" (", " % (", 1)),
        None => format!("{text} %"),
    }
}

/// The answer to the question how much of the light is that of the analyte.
pub(crate) struct ShareAnswer {
    /// What it is of.
    name: String,
    /// The share, or that there is none.
    pub(crate) headline: String,
    /// What it is a share of, with its interval.
    pub(crate) rest: String,
}

impl ShareAnswer {
    /// The answer in a sentence.
    pub(crate) fn sentence(&self) -> String {
        let joint = if self.headline.ends_with('%') { " " } else { "; " };
        format!("{}: {}{joint}{}", self.name, self.headline, self.rest)
    }

    /// Of the share of tissue, else that on the mixture line, else unmixed. `None` where no share is estimated.
    pub(crate) fn of(findings: &[Finding], analyte: &Analyte) -> Option<Self> {
        Some(Self::of_share(answering_share(findings)?, analyte))
    }

    /// Of one of these shares.
    pub(crate) fn of_share(share: &Finding, analyte: &Analyte) -> Self {
        let other = share.caveats.iter().find_map(|caveat| match caveat {
            Caveat::OtherTissue(tissue) => Some(tissue.replace('_', " ")),
            _ => None,
        });
        let of_what = match share.id {
            Id::Share | Id::RedShare => "of the fluorescence".to_owned(),
            Id::LineShare => "of the fluorescence, as if the bulk were known".into(),
            _ => "of the electrons of all signals, as if all spectra were known".into(),
        };
        let noise = if share.has(&Caveat::SensorNoiseAlone) { ", by sensor noise alone" } else { "" };
        let (headline, rest) = if share.has(&Caveat::NoEstimate) {
            ("no estimate".to_owned(), "the light is not that of the assumed tissue".to_owned())
        } else if share.has(&Caveat::NotDetected) {
            ("not detected".into(), format!("{} {of_what} (95 %)", percent(share)))
        } else {
            let text = percent(share);
            let (value, interval) = text.split_once(" (").unwrap_or((&text, ""));
            let interval = interval.trim_end_matches(')');
            let rest = match interval.is_empty() {
                true => of_what,
                false => format!("{of_what} (95 %: {interval}{noise})"),
            };
            (value.to_owned(), rest)
        };
        let other = other.map_or_else(String::new, |tissue| {
            format!(". The light is not that of the named tissue; {tissue} explains it")
        });
        let frames = share.caveats.iter().find_map(|caveat| match caveat {
            Caveat::FromFrames(frames) => Some(format!(", from frames {}", frames.join(" and "))),
            _ => None,
        });
        let alike = share.caveats.iter().find_map(|caveat| match caveat {
            Caveat::LooksLike(what) if share.id == Id::Share => {
                Some(format!(", or {what}, which looks the same to this camera; {TELLS_APART}"))
            }
            _ => None,
        });
        let other = frames.unwrap_or_default() + &alike.unwrap_or_default() + &other;
        let name = match share.id {
            Id::UnmixedShare => crate::run::capital(share.name.as_deref().unwrap_or_default()),
            Id::RedShare => "Red fluorescence".into(),
            _ => analyte.capitalized(),
        };
        Self { name, headline, rest: rest + &other }
    }
}

/// All red emission, where the camera can't tell the analyte from plant pigment: then its sum is the first answer.
pub(crate) fn undivided_red(findings: &[Finding]) -> Option<&Finding> {
    let is_undivided = |red: &&Finding| red.caveats.iter().any(|c| matches!(c, Caveat::LooksLike(_)));
    findings.iter().find(|finding| finding.id == Id::RedShare).filter(is_undivided)
}

/// The share that answers: of the tissue, else on the mixture line, else unmixed from all signals: that of the analyte, where one is looked
/// for, the last term, else the strongest.
pub(crate) fn answering_share(findings: &[Finding]) -> Option<&Finding> {
    let of = |id| findings.iter().filter(move |finding| finding.id == id);
    let strongest =
        || of(Id::UnmixedShare).max_by(|a, b| a.value.unwrap_or(0.0).total_cmp(&b.value.unwrap_or(0.0)));
    of(Id::Share).chain(of(Id::LineShare)).next().or_else(|| match of(Id::TrueShare).next() {
        Some(_) => of(Id::UnmixedShare).next_back(),
        None => strongest(),
    })
}

/// Whether the analyte is there, and how much of the light it makes, in a sentence. `None` where no share is estimated.
#[must_use]
pub(crate) fn verdict(findings: &[Finding], analyte: &Analyte) -> Option<String> {
    Some(ShareAnswer::of(findings, analyte)?.sentence())
}

/// Findings side by side: a row for each key that `row` gives, a column for each that `column` gives, in the order in which they come.
pub(crate) fn matrix(
    findings: &[Finding],
    first: &str,
    row: impl Fn(&Finding) -> Option<String>,
    column: impl Fn(&Finding) -> Option<String>,
) -> NumberMatrix {
    let mut columns = vec![first.to_owned()];
    let mut rows: Vec<Vec<String>> = Vec::new();
    for finding in findings {
        let (Some(row), Some(column)) = (row(finding), column(finding)) else { continue };
        let place = columns.iter().position(|known| *known == column).unwrap_or_else(|| {
            columns.push(column);
            columns.len() - 1
        });
        let line = rows.iter().position(|line| line[0] == row).unwrap_or_else(|| {
            rows.push(vec![row]);
            rows.len() - 1
        });
        let line = &mut rows[line];
        line.resize(line.len().max(place + 1), "-".into());
        line[place] = value(finding).replace('-', "−");
    }
    rows.iter_mut().for_each(|line| line.resize(columns.len(), "-".into()));
    NumberMatrix { caption: String::new(), columns, rows, note: String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verdict_comes_first() {
        let share = |id, value: Option<f64>, interval, caveat: Option<Caveat>| {
            let finding = Finding::new(id, value);
            let finding =
                Finding { interval: Some(interval), caveats: caveat.into_iter().collect(), ..finding };
            verdict(&[finding], &Analyte::default()).unwrap()
        };
        assert_eq!(
            share(Id::Share, Some(0.053), [0.035, 0.099], None),
            "Porphyrin: 5.3 % of the fluorescence (95 %: 3.5 to 9.9 %)"
        );
        assert_eq!(
            share(Id::Share, None, [0.0, 0.094], Some(Caveat::NotDetected)),
            "Porphyrin: not detected; at most 9.4 % of the fluorescence (95 %)"
        );
        assert_eq!(
            share(Id::Share, None, [0.0, 0.9], Some(Caveat::NoEstimate)),
            "Porphyrin: no estimate; the light is not that of the assumed tissue"
        );
        assert_eq!(
            share(Id::LineShare, Some(0.0661), [0.0656, 0.0666], Some(Caveat::SensorNoiseAlone)),
            "Porphyrin: 6.610 % of the fluorescence, as if the bulk were known (95 %: 6.560 to 6.660 %, by sensor noise alone)"
        );
        assert_eq!(verdict(&[], &Analyte::default()), None);
    }
}
