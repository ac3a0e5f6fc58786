//! Choice of the values of a parameter at which a tissue is solved, so that means of states in between are exact enough.

use rayon::prelude::*;

use super::state_grid::{MAX_NODES, bent};
use crate::spectral::WavelengthGrid;
use crate::tissue::{DiscreteOrdinates, EffectiveTissue, LayeredTissue, Level, TissueError};

/// Relative error along one parameter, the others in the middle of their ranges, at which no nodes are added: below
/// [`super::INTERPOLATION_ERROR`], as the errors of several parameters add up.
const NODE_ERROR: f64 = 0.005;
/// Wavelengths at which states are compared, nm: bands and gaps of hemoglobin, usual lights, porphyrin.
const PROBES_NM: [f64; 12] =
    [385.0, 405.0, 420.0, 435.0, 450.0, 500.0, 520.0, 540.0, 560.0, 580.0, 635.0, 700.0];
/// Shares of the way between two nodes at which the mean of both is compared with the tissue.
const INNER: [f64; 3] = [0.25, 0.5, 0.75];

/// What a tissue does at a few wavelengths: reflectance, and fluorescence of every pair.
#[derive(Clone, Debug)]
pub(super) struct Probe(Vec<f64>);

impl Probe {
    /// Solves tissues at the wavelengths of the comparison.
    pub(super) fn of(tissues: &[LayeredTissue], bands: &WavelengthGrid) -> Result<Vec<Self>, TissueError> {
        let solved = EffectiveTissue::several(tissues, &probed_nm(bands), DiscreteOrdinates::DIFFUSE)?;
        Ok(solved.par_iter().map(|solved| Self::of_solution(solved, bands)).collect())
    }

    /// The same of a tissue that is solved already.
    pub(super) fn of_solution(solved: &EffectiveTissue, bands: &WavelengthGrid) -> Self {
        let nm = probed_nm(bands);
        let reflectance = solved.reflectance(Level::AboveSurface);
        let mut values: Vec<f64> = nm.iter().map(|&nm| reflectance.at(nm)).collect();
        let parts = solved.parts();
        for (index, &excitation) in nm.iter().enumerate() {
            for &emission in &nm[index + 1..] {
                let of_part = |part| solved.yield_density(part, emission, excitation, Level::AboveSurface);
                values.push(parts.iter().copied().map(of_part).sum());
            }
        }
        Self(values)
    }

    /// Largest relative error of a weighted mean of others in place of this one.
    pub(super) fn error_of_mean<'a>(&self, others: impl Iterator<Item = (f64, &'a Self)>) -> f64 {
        let mut mean = vec![0.0; self.0.len()];
        for (weight, other) in others {
            mean.iter_mut().zip(&other.0).for_each(|(sum, value)| *sum += weight * value);
        }
        let errors = self.0.iter().zip(mean).filter(|(exact, _)| **exact > 0.0);
        errors.map(|(exact, mean)| (mean / exact - 1.0).abs()).fold(0.0, f64::max)
    }
}

/// Wavelengths of the comparison within a grid.
fn probed_nm(bands: &WavelengthGrid) -> Vec<f64> {
    let inside = |nm: &f64| (bands.start_nm()..=bands.end_nm()).contains(nm);
    let nm: Vec<f64> = PROBES_NM.into_iter().filter(inside).collect();
    if nm.len() < 2 { vec![bands.start_nm(), bands.end_nm()] } else { nm }
}

/// Nodes of a parameter, with the bend of each interval.
pub(super) struct ChosenNodes {
    pub(super) nodes: Vec<f32>,
    pub(super) bends: Vec<f32>,
    /// Largest relative error that is left between them.
    pub(super) error: f64,
}

/// The interval between two nodes, with tissues in it that are to be met.
struct Interval {
    ends: [(f64, Probe); 2],
    inner: Vec<(f64, Probe)>,
    bend: f64,
    error: f64,
}

/// Where a value lies a share of the way between two others: by ratio where both are above 0.
pub(super) fn between([low, high]: [f64; 2], share: f64) -> f64 {
    if low > 0.0 { low * (high / low).powf(share) } else { low + share * (high - low) }
}

impl Interval {
    /// Compares at the inner values; the middle one is not solved again where it is `known`.
    fn new(
        ends: [(f64, Probe); 2],
        known: Option<(f64, Probe)>,
        probes: &impl Fn(&[f64]) -> Result<Vec<Probe>, TissueError>,
    ) -> Result<Self, TissueError> {
        let range = [ends[0].0, ends[1].0];
        let mut values = INNER.map(|share| between(range, share)).to_vec();
        if known.is_some() {
            values.remove(1);
        }
        let solved = probes(&values)?;
        let mut inner: Vec<(f64, Probe)> = values.into_iter().zip(solved).collect();
        if let Some(known) = known {
            inner.insert(1, known);
        }
        let mut interval = Self { ends, inner, bend: 1.0, error: 0.0 };
        interval.bend = interval.best_bend();
        interval.error = interval.error_with(interval.bend);
        Ok(interval)
    }

    /// Largest error of the mean of both ends at the inner values.
    fn error_with(&self, bend: f64) -> f64 {
        let [(low, first), (high, second)] = &self.ends;
        let error = |(value, exact): &(f64, Probe)| {
            let share = (value - low) / (high - low);
            let weight = f64::from(bent(share as f32, bend as f32));
            exact.error_of_mean([(1.0 - weight, first), (weight, second)].into_iter())
        };
        self.inner.iter().map(error).fold(0.0, f64::max)
    }

    /// The bend with the smallest error, by golden-section search over its logarithm.
    fn best_bend(&self) -> f64 {
        const GOLDEN: f64 = 0.618_033_988_749_895;
        let error = |log_bend: f64| self.error_with(log_bend.exp());
        let [mut low, mut high] = [-3.0, 3.0];
        let mut inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
        let mut errors = inner.map(error);
        for _ in 0..24 {
            if errors[0] < errors[1] {
                high = inner[1];
                inner = [high - GOLDEN * (high - low), inner[0]];
                errors = [error(inner[0]), errors[0]];
            } else {
                low = inner[0];
                inner = [inner[1], low + GOLDEN * (high - low)];
                errors = [errors[1], error(inner[1])];
            }
        }
        f64::from((0.5 * (low + high)).exp() as f32)
    }

    /// Both halves; what is known in the middle of each is kept.
    fn halves(
        self,
        probes: &impl Fn(&[f64]) -> Result<Vec<Probe>, TissueError>,
    ) -> Result<[Self; 2], TissueError> {
        let [low, high] = self.ends;
        let mut inner = self.inner.into_iter();
        let (Some(first), Some(middle), Some(third)) = (inner.next(), inner.next(), inner.next()) else {
            return Err(TissueError::Unsolvable { layer: None });
        };
        let left = Self::new([low, middle.clone()], Some(first), probes)?;
        Ok([left, Self::new([middle, high], Some(third), probes)?])
    }
}

/// Nodes of a parameter in a range: its ends, 1 if that lies within (parameters of maps are factors, and 1 is the tissue
/// itself), and then intervals are halved until all are within [`NODE_ERROR`] or there are 8 nodes.
pub(super) fn choose_nodes(
    range: [f64; 2],
    probes: impl Fn(&[f64]) -> Result<Vec<Probe>, TissueError>,
) -> Result<ChosenNodes, TissueError> {
    let [low, mut high] = range;
    if high <= low {
        // A map that is the same everywhere still needs two nodes.
        high = low.max(f64::MIN_POSITIVE) * (1.0 + 1e-3);
    }
    let values = if low < 1.0 && high > 1.0 { vec![low, 1.0, high] } else { vec![low, high] };
    let ends: Vec<(f64, Probe)> = values.iter().copied().zip(probes(&values)?).collect();
    let mut intervals = Vec::new();
    for pair in ends.windows(2) {
        intervals.push(Interval::new([pair[0].clone(), pair[1].clone()], None, &probes)?);
    }
    loop {
        let worst = (0..intervals.len()).max_by(|&a, &b| intervals[a].error.total_cmp(&intervals[b].error));
        let Some(worst) =
            worst.filter(|&worst| intervals[worst].error > NODE_ERROR && intervals.len() + 1 < MAX_NODES)
        else {
            break;
        };
        let halves = intervals.remove(worst).halves(&probes)?;
        intervals.splice(worst..worst, halves);
    }
    let ends = intervals.iter().map(|interval| interval.ends[1].0 as f32);
    Ok(ChosenNodes {
        nodes: std::iter::once(low as f32).chain(ends).collect(),
        bends: intervals.iter().map(|interval| interval.bend as f32).collect(),
        error: intervals.iter().map(|interval| interval.error).fold(0.0, f64::max),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Several falling exponentials: one bend can't meet all, but comes closer than the line.
    #[test]
    fn bends_follow_what_falls_with_the_parameter() {
        let probe = |x: f64| Probe([0.7, 0.8, 1.0].map(|k: f64| 0.3 + (-k * x).exp()).to_vec());
        let probes = |values: &[f64]| Ok(values.iter().map(|x| probe(*x)).collect());
        let chosen = choose_nodes([0.5, 4.0], probes).unwrap();
        assert!(chosen.error < NODE_ERROR && chosen.nodes.len() < MAX_NODES, "{:?}", chosen.nodes);
        assert!(chosen.nodes.is_sorted_by(|a, b| a < b) && chosen.bends.len() + 1 == chosen.nodes.len());
        assert_eq!([chosen.nodes[0], chosen.nodes[chosen.nodes.len() - 1]], [0.5, 4.0]);
        assert!(chosen.nodes.contains(&1.0));
        assert!(chosen.bends.iter().all(|bend| *bend < 1.0), "falls fast at first: {:?}", chosen.bends);
        // At values of its own the error is that which it states, to a quarter.
        for x in [0.6, 0.9, 1.7, 2.6, 3.7] {
            let right = chosen.nodes.iter().position(|&node| f64::from(node) > x).unwrap();
            let [low, high] = [right - 1, right].map(|node| f64::from(chosen.nodes[node]));
            let weight = f64::from(bent(((x - low) / (high - low)) as f32, chosen.bends[right - 1]));
            let [first, second] = [low, high].map(probe);
            let mean = [(1.0 - weight, &first), (weight, &second)];
            let error = probe(x).error_of_mean(mean.into_iter());
            assert!(error < 1.25 * chosen.error, "{x}: {error}, stated {}", chosen.error);
        }
    }

    #[test]
    fn what_is_linear_needs_two_nodes_and_no_bend() {
        let chosen = choose_nodes([0.0, 0.8], |values| {
            Ok(values.iter().map(|x| Probe(vec![1.0 + x, 3.0 - x])).collect())
        })
        .unwrap();
        assert_eq!(chosen.nodes, [0.0, 0.8]);
        assert!((chosen.bends[0] - 1.0).abs() < 1e-3 && chosen.error < 1e-3, "{:?}", chosen.bends);
    }
}
