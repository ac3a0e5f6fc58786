//! What a cohort says: the same number of many people as normal ranges, agreement with the truth, and separation of those with a lesion.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Caveat, Finding, FindingId};
use crate::analysis::{
    Agreement, EstimateOfTruth, RocArea, Statistics, ToleranceInterval, ValueRange, d_prime_of_scores,
    group_size_for_area, roc_curve,
};

/// What a number of a cohort is of: the same in all people.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct CohortQuantity {
    /// View of the examination.
    pub view: String,
    /// Part of the mouth.
    pub part: String,
    /// What it is.
    pub id: FindingId,
    /// The frame that it is of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<String>,
    /// The channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<String>,
    /// The fluorophore, tissue, source or target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

/// A number of one person.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PersonFinding {
    /// What it is of.
    #[serde(flatten)]
    pub quantity: CohortQuantity,
    /// The number; `None` where there is an interval only.
    pub value: Option<f64>,
    /// Its 95 % interval; an open end is `None`.
    pub interval: Option<[Option<f64>; 2]>,
    /// What it is judged by: the truth of an estimate.
    pub reference: Option<f64>,
    /// Whether the person has the lesion that the number is of, or any on the part.
    pub has_lesion: bool,
}

impl PersonFinding {
    /// A finding of a part in a view; its frame is `frame` where it names none.
    #[must_use]
    pub fn of(finding: &Finding, [view, part, frame]: [&str; 3], has_lesion: bool) -> Self {
        let end = |end: f64| end.is_finite().then_some(end);
        // The signal of clipped pixels is that of the sensor
        let is_limit = finding.has(&Caveat::LowerLimit) && finding.id == FindingId::MedianSignal;
        Self {
            quantity: CohortQuantity {
                view: view.into(),
                part: part.into(),
                id: finding.id,
                frame: Some(finding.frame.clone().unwrap_or_else(|| frame.into())),
                channel: finding.channel.clone(),
                name: finding.name.clone(),
            },
            value: finding.value.filter(|_| !is_limit).and_then(end),
            interval: finding.interval.map(|ends| ends.map(end)),
            reference: finding.reference.and_then(end),
            has_lesion,
        }
    }
}

/// The range of a number among people without lesions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NormalRange {
    /// What it is of.
    pub quantity: CohortQuantity,
    /// What the people show.
    pub statistics: Statistics,
    /// What 95 % of all people show; `None` of too few people.
    pub tolerance: Option<ToleranceInterval>,
}

/// Estimates of all people against their truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CohortAgreement {
    /// What is estimated.
    pub quantity: CohortQuantity,
    /// How well.
    pub agreement: Agreement,
    /// Truth and estimate of each person.
    pub points: Vec<[f64; 2]>,
}

/// How well a number tells people with a lesion from those without.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LesionSeparation {
    /// The number.
    pub quantity: CohortQuantity,
    /// Whether smaller values mean the lesion.
    pub is_lower: bool,
    /// Area under the ROC curve.
    pub area: RocArea,
    /// d' of the numbers of the two groups, positive in the direction of the lesion; `None` where nothing varies.
    pub d_prime: Option<f64>,
    /// People in each group for whom the area's interval has a half width of [`Self::WANTED_HALF_WIDTH`]; `None` of an area of 1.
    pub group_size: Option<u64>,
    /// False over true positives.
    pub curve: Vec<[f64; 2]>,
}

impl LesionSeparation {
    /// Half width of the interval of an area that a study should reach.
    pub const WANTED_HALF_WIDTH: f64 = 0.05;
}

/// What a cohort says.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CohortFindings {
    /// Ranges of people without lesions.
    pub ranges: Vec<NormalRange>,
    /// Estimates against truth.
    pub agreements: Vec<CohortAgreement>,
    /// Lesions, the widest area first.
    pub separations: Vec<LesionSeparation>,
}

impl FindingId {
    /// Which values the number can take; `None` of those that have no normal range.
    #[must_use]
    pub fn value_range(self) -> Option<ValueRange> {
        use FindingId as Id;

        match self {
            Id::ChromaticityR
            | Id::ChromaticityG
            | Id::Share
            | Id::RedShare
            | Id::TrueShare
            | Id::VisibleInPatches => Some(ValueRange::Share),
            Id::MedianSignal | Id::SignalRatio | Id::FamilyDistance => Some(ValueRange::Positive),
            // These may lie beyond their ends
            Id::LineShare | Id::UnmixedShare | Id::UnmixedAmount | Id::TargetContrast => {
                Some(ValueRange::Real)
            }
            _ => None,
        }
    }
}

/// Whether a number is an estimate of what a simulation knows.
fn is_estimate(id: FindingId) -> bool {
    matches!(id, FindingId::Share | FindingId::RedShare | FindingId::LineShare | FindingId::UnmixedShare)
}

/// What a cohort says, from the numbers of all its people.
#[must_use]
pub fn cohort_findings(all: &[PersonFinding]) -> CohortFindings {
    let mut by_quantity: BTreeMap<&CohortQuantity, Vec<&PersonFinding>> = BTreeMap::new();
    for finding in all {
        by_quantity.entry(&finding.quantity).or_default().push(finding);
    }
    let mut found = CohortFindings::default();
    for (quantity, people) in by_quantity {
        found.ranges.extend(normal_range(quantity, &people));
        found.agreements.extend(agreement(quantity, &people));
        found.separations.extend(separation(quantity, &people));
    }
    let rank = |of: &LesionSeparation| (of.area.area, of.d_prime.unwrap_or(0.0));
    found.separations.sort_by(|a, b| rank(b).partial_cmp(&rank(a)).unwrap_or(Ordering::Equal));
    found
}

fn normal_range(quantity: &CohortQuantity, people: &[&PersonFinding]) -> Option<NormalRange> {
    let range = quantity.id.value_range()?;
    let healthy = people.iter().filter(|person| !person.has_lesion);
    let values: Vec<f64> = healthy.filter_map(|person| person.value).collect();
    let statistics = Statistics::of(values.iter().copied())?;
    let tolerance = ToleranceInterval::of(&values, range);
    Some(NormalRange { quantity: quantity.clone(), statistics, tolerance })
}

fn agreement(quantity: &CohortQuantity, people: &[&PersonFinding]) -> Option<CohortAgreement> {
    if !is_estimate(quantity.id) {
        return None;
    }
    let case = |person: &&PersonFinding| {
        let interval = person.interval.and_then(|[low, high]| Some([low?, high?]));
        Some(EstimateOfTruth { estimate: person.value, interval, truth: person.reference? })
    };
    let cases: Vec<EstimateOfTruth> = people.iter().filter_map(case).collect();
    let points = cases.iter().filter_map(|case| Some([case.truth, case.estimate?])).collect();
    Some(CohortAgreement { quantity: quantity.clone(), agreement: Agreement::of(&cases)?, points })
}

fn separation(quantity: &CohortQuantity, people: &[&PersonFinding]) -> Option<LesionSeparation> {
    if quantity.id != FindingId::TargetContrast {
        return None;
    }
    let group = |has_lesion: bool, sign: f64| -> Vec<f64> {
        let of = people.iter().filter(|person| person.has_lesion == has_lesion);
        of.filter_map(|person| Some(sign * person.value?)).collect()
    };
    let upward = RocArea::of(&group(true, 1.0), &group(false, 1.0))?;
    let is_lower = upward.area < 0.5;
    let sign = if is_lower { -1.0 } else { 1.0 };
    let (with, without) = (group(true, sign), group(false, sign));
    let area = RocArea::of(&with, &without)?;
    Some(LesionSeparation {
        quantity: quantity.clone(),
        is_lower,
        area,
        d_prime: d_prime_of_scores(&with, &without),
        group_size: group_size_for_area(area.area, LesionSeparation::WANTED_HALF_WIDTH),
        curve: roc_curve(&with, &without),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn person(id: FindingId, value: f64, reference: Option<f64>, has_lesion: bool) -> PersonFinding {
        let finding = Finding { reference, ..Finding::new(id, value) };
        PersonFinding::of(&finding, ["dorsal-tongue", "tongue_dorsum", "blue"], has_lesion)
    }

    #[test]
    fn healthy_people_make_ranges_and_all_make_the_rest() {
        let mut all: Vec<PersonFinding> = (1..=12)
            .map(|k| person(FindingId::ChromaticityR, 0.3 + 0.01 * f64::from(k), None, k > 10))
            .collect();
        all.extend(
            (1..=4).map(|k| {
                person(FindingId::Share, 0.1 * f64::from(k) + 0.02, Some(0.1 * f64::from(k)), false)
            }),
        );
        // Darker with the lesion; one of each group lies the wrong way round
        let contrasts = [(-0.5, true), (-0.4, true), (-0.1, true), (-0.2, false), (0.0, false), (0.1, false)];
        all.extend(contrasts.map(|(value, ill)| person(FindingId::TargetContrast, value, None, ill)));
        all.push(person(FindingId::PixelsUsed, 100.0, None, false));
        let found = cohort_findings(&all);
        let of_r = &found.ranges
            [found.ranges.iter().position(|r| r.quantity.id == FindingId::ChromaticityR).unwrap()];
        assert_eq!((of_r.statistics.n, of_r.tolerance.unwrap().n), (10, 10));
        assert!(found.ranges.iter().all(|range| range.quantity.id != FindingId::PixelsUsed));
        let [agreement] = &found.agreements[..] else { panic!("{found:?}") };
        assert!((agreement.agreement.bias - 0.02).abs() < 1e-12 && agreement.points.len() == 4);
        let [lesion] = &found.separations[..] else { panic!("{found:?}") };
        assert!(lesion.is_lower && (lesion.area.area - 8.0 / 9.0).abs() < 1e-12);
        assert!(lesion.d_prime.unwrap() > 1.0 && lesion.group_size.unwrap() > 50);
        // A journal gives back what it was given
        let text = serde_json::to_string(&all).unwrap();
        assert_eq!(serde_json::from_str::<Vec<PersonFinding>>(&text).unwrap(), all);
    }
}
