//! Photons in rounds over all threads, until there are enough.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use super::estimate::{Estimate, GROUPS, GroupSums};
use super::settings::{MonteCarloControl, MonteCarloProgress, MonteCarloSettings};
use crate::sampling::random::{Key, KeyedRng};
use crate::tissue::TissueError;

/// Photons of a group in the first round.
const FIRST_ROUND: u64 = 16;
/// Rounds grow to this many photons of a group: bounds what an interruption loses.
const LARGEST_ROUND: u64 = 4096;
/// Photons between two looks at the request to stop.
const STRIDE: u64 = 16;
/// Most scores of one simulation: 256 groups of them are kept twice.
const MOST_SCORES: usize = 50_000;

/// What ended a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// All photons were traced.
    Photons,
    /// The error target was reached.
    Error,
    /// A request to stop; the results are those of the complete rounds.
    Interrupted,
}

/// Traces photons and sums their scores.
///
/// `trace` adds the scores of one photon; `watched` gives the estimate that the error target is about. Every number depends
/// on the seed only: photon `i` of group `g` draws from the stream (seed, g, i), and each group sums its photons in order.
pub(super) fn trace_photons(
    settings: &MonteCarloSettings,
    scores: usize,
    control: &MonteCarloControl<'_>,
    watched: impl Fn(&GroupSums) -> Estimate,
    trace: impl Fn(&mut [f64], &mut KeyedRng) + Sync,
) -> Result<(GroupSums, Ending), TissueError> {
    if scores > MOST_SCORES {
        return Err(TissueError::TooManyBins { bins: scores, most: MOST_SCORES });
    }
    let most = settings.photons.div_ceil(GROUPS as u64);
    let target = settings.target.map(|target| target.relative_standard_error);
    let mut total = GroupSums::new(scores);
    let mut expected = most;
    while total.photons_per_group < most {
        let done = total.photons_per_group;
        let round = done.clamp(FIRST_ROUND, LARGEST_ROUND).min(expected - done);
        let Some(sums) =
            round_of_photons(settings.seed, scores, done..done + round, expected, control, &trace)
        else {
            return if done == 0 { Err(TissueError::Interrupted) } else { Ok((total, Ending::Interrupted)) };
        };
        for (sum, new) in total.sums.iter_mut().zip(&sums) {
            sum.iter_mut().zip(new).for_each(|(sum, new)| *sum += new);
        }
        total.photons_per_group += round;
        let Some(target) = target else { continue };
        let error = watched(&total).relative_error();
        if error <= target {
            return Ok((total, Ending::Error));
        }
        expected = photons_for(total.photons_per_group, error / target)
            .clamp(total.photons_per_group + 1, most.max(total.photons_per_group + 1));
    }
    Ok((total, Ending::Photons))
}

/// Photons of a group for a relative error smaller by `factor`, with 2 % to spare.
fn photons_for(done: u64, factor: f64) -> u64 {
    // An infinite factor saturates.
    (1.02 * done as f64 * factor * factor).ceil() as u64
}

/// One round; `None` when it was interrupted.
fn round_of_photons(
    seed: u64,
    scores: usize,
    photons: Range<u64>,
    expected: u64,
    control: &MonteCarloControl<'_>,
    trace: &(impl Fn(&mut [f64], &mut KeyedRng) + Sync),
) -> Option<Vec<Vec<f64>>> {
    let groups = GROUPS as u64;
    let finished = AtomicU64::new(photons.start * groups);
    let group_scores = |group: usize| {
        let key = Key::new(seed).with(group as u64);
        let mut sums = vec![0.0; scores];
        let mut begin = photons.start;
        while begin < photons.end {
            if control.stop.load(Ordering::Relaxed) {
                return None;
            }
            let end = photons.end.min(begin + STRIDE);
            for photon in begin..end {
                trace(&mut sums, &mut key.with(photon).rng());
            }
            let photons_done = finished.fetch_add(end - begin, Ordering::Relaxed) + end - begin;
            (control.progress)(MonteCarloProgress {
                photons_done,
                photons_total: expected.saturating_mul(groups),
            });
            begin = end;
        }
        Some(sums)
    };
    (0..GROUPS).into_par_iter().with_max_len(1).map(group_scores).collect()
}
