//! Searching the designs of a problem: all of them, or by exchange of one choice at a time.

use std::collections::HashMap;
use std::ops::Range;

use rand::RngExt;
use rayon::prelude::*;

use crate::sampling::random::{Key, KeyedRng};

use super::design_space::{Design, DesignSpace};
use super::score::Score;

/// Scores of a range of designs, in parallel; the same for any number of threads.
pub fn score_all(space: &DesignSpace, numbers: Range<u64>) -> Vec<Score> {
    numbers.into_par_iter().map(|number| space.score(&space.design(number))).collect()
}

/// The outcome of a search by exchange.
#[derive(Clone, Debug, PartialEq)]
pub struct ExchangeResult {
    /// Number of the best design that was found.
    pub best: u64,
    /// Its score.
    pub score: Score,
    /// Different designs that were evaluated, with their scores, in the order of their numbers.
    pub evaluated: Vec<(u64, Score)>,
    /// Local optima from which the search started anew.
    pub restarts: usize,
}

/// Coordinate exchange after Meyer and Nachtsheim, Technometrics 37:60 (1995): from a random design, each choice in turn is
/// exchanged for the best of all its alternatives, until none is better; then from another random design, until
/// `most_evaluations` different designs were evaluated or all were. The same seed gives the same designs for any number of
/// threads.
pub fn exchange(space: &DesignSpace, seed: u64, most_evaluations: usize) -> ExchangeResult {
    let mut search = Exchange { space, most_evaluations, known: HashMap::new() };
    let mut rng = Key::new(seed).with_text("exchange").rng();
    let mut restarts = 0;
    let mut best: Option<(u64, Score)> = None;
    let all = usize::try_from(space.len()).unwrap_or(usize::MAX);
    while search.known.len() < most_evaluations.min(all).max(1) {
        let start = space.design(rng.random_range(0..space.len()));
        restarts += 1;
        let found = search.descend(start, &mut rng);
        let better = |(_, kept): (u64, Score)| found.1.loss < kept.loss;
        if best.is_none_or(better) {
            best = Some(found);
        }
    }
    let mut evaluated: Vec<(u64, Score)> = search.known.into_iter().collect();
    evaluated.sort_by_key(|(number, _)| *number);
    let (number, score) = best.unwrap_or(evaluated[0]);
    ExchangeResult { best: number, score, evaluated, restarts }
}

struct Exchange<'a> {
    space: &'a DesignSpace,
    most_evaluations: usize,
    known: HashMap<u64, Score>,
}

impl Exchange<'_> {
    /// Exchanges choices until none is better; the local optimum.
    fn descend(&mut self, start: Design, rng: &mut KeyedRng) -> (u64, Score) {
        let Some(mut here) = self.scored(vec![start]).into_iter().next() else {
            // Nothing may be evaluated any more
            let number = self.known.keys().copied().min().unwrap_or(0);
            return (number, self.space.score(&self.space.design(number)));
        };
        loop {
            let before = here.1.loss;
            let mut variables: Vec<usize> = (0..self.variables(&self.space.design(here.0))).collect();
            // Shuffle the order of the choices
            for last in (1..variables.len()).rev() {
                variables.swap(last, rng.random_range(0..=last));
            }
            for variable in variables {
                let alternatives = self.alternatives(&self.space.design(here.0), variable);
                for found in self.scored(alternatives) {
                    if found.1.loss < here.1.loss {
                        here = found;
                    }
                }
            }
            if here.1.loss >= before || before.is_nan() {
                return here;
            }
        }
    }

    /// Choices of a design: each of its lights, one more or one less of them, and six others.
    fn variables(&self, design: &Design) -> usize {
        design.lights.len() + 1 + 6
    }

    /// All designs that differ in one choice.
    fn alternatives(&self, design: &Design, variable: usize) -> Vec<Design> {
        let p = self.space.problem();
        let lights = design.lights.len();
        let with = |change: &dyn Fn(&mut Design)| {
            let mut other = design.clone();
            change(&mut other);
            other.lights.sort_unstable();
            other
        };
        let each = |count: usize, set: &dyn Fn(&mut Design, usize)| -> Vec<Design> {
            (0..count).map(|value| with(&|other| set(other, value))).collect()
        };
        match variable.checked_sub(lights) {
            None => each(p.lights.len(), &|other, light| other.lights[variable] = light),
            Some(0) => {
                let mut found = each(p.lights.len(), &|other, light| other.lights.push(light));
                found.extend(each(lights, &|other, slot| {
                    other.lights.remove(slot);
                }));
                found
            }
            Some(1) => each(p.filters.len(), &|other, value| other.filter = value),
            Some(2) => each(p.cameras.len(), &|other, value| other.camera = value),
            Some(3) => each(p.lenses.len(), &|other, value| other.lens = value),
            Some(4) => each(p.drives.len(), &|other, value| other.drive = value),
            Some(5) => each(p.splits.len(), &|other, value| other.split = value),
            Some(_) => each(p.geometry_count(), &|other, value| other.geometry = value),
        }
    }

    /// Scores of designs that exist, as far as more may be evaluated, in their order.
    fn scored(&mut self, designs: Vec<Design>) -> Vec<(u64, Score)> {
        let numbered: Vec<(u64, Design)> =
            designs.into_iter().filter_map(|design| Some((self.space.number(&design)?, design))).collect();
        let room = self.most_evaluations.saturating_sub(self.known.len());
        let mut new: Vec<&(u64, Design)> =
            numbered.iter().filter(|(number, _)| !self.known.contains_key(number)).collect();
        new.dedup_by_key(|(number, _)| *number);
        new.truncate(room);
        let scores: Vec<(u64, Score)> =
            new.into_par_iter().map(|(number, design)| (*number, self.space.score(design))).collect();
        self.known.extend(scores);
        numbered.iter().filter_map(|(number, _)| Some((*number, *self.known.get(number)?))).collect()
    }
}
