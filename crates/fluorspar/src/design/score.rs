//! What a search needs of a design, and the front of designs that no other beats.

use std::cmp::Ordering;

use serde::Serialize;

/// What a search needs of a design.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Loss; infinite where a limit is broken.
    pub loss: f64,
    /// Time of all exposures, s.
    pub time_s: f64,
    /// Price.
    pub cost: f64,
    /// Number of exposures.
    pub exposures: usize,
}

impl Score {
    /// Whether this design is at least as good as another in all that counts, and better in something.
    pub fn dominates(&self, other: &Self) -> bool {
        let (a, b) = (self.objectives(), other.objectives());
        a.iter().zip(&b).all(|(a, b)| a <= b) && a != b
    }

    fn objectives(&self) -> [f64; 4] {
        [self.loss, self.time_s, self.cost, self.exposures as f64]
    }
}

/// Numbers of the scores that no other dominates, the best loss first. Of equals the first counts.
pub fn pareto_front(scores: &[Score]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scores.len()).filter(|&k| scores[k].loss.is_finite()).collect();
    let compare = |a: &f64, b: &f64| a.total_cmp(b);
    order.sort_by(|&a, &b| {
        let (x, y) = (scores[a].objectives(), scores[b].objectives());
        let by = x.iter().zip(&y).map(|(x, y)| compare(x, y)).find(|order| *order != Ordering::Equal);
        by.unwrap_or(a.cmp(&b))
    });
    let mut front: Vec<usize> = Vec::new();
    for candidate in order {
        let beaten = |&kept: &usize| {
            scores[kept].dominates(&scores[candidate])
                || scores[kept].objectives() == scores[candidate].objectives()
        };
        if !front.iter().any(beaten) {
            front.push(candidate);
        }
    }
    front
}
