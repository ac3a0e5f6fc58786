//! What a spectrum says about each weight of the sum that is nearest to it.

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal, StudentsT};

use super::correlation::{ResidualCorrelation, Spread, WeightSpread};
use super::least_squares::{LeastSquares, border};
use super::{FitChiSquare, FittedBlood, FittedWeight, MixtureFit, ResidualScatter, SpectralMixture, over};

/// Amounts of blood, from end to end of those that fit, at which weights are looked for.
const AMOUNTS: usize = 17;
/// A sum is exact that leaves less of the squares of the data.
const ROUNDING: f64 = 1e-22;
/// Probability below the upper end of an interval.
const UPPER: f64 = 0.975;

/// The nearest sum, before anything is said about it.
pub(super) struct Fitting<'a> {
    mixture: &'a SpectralMixture,
    data: &'a [f64],
    errors: Option<&'a [f64]>,
    /// Data over errors.
    scaled: Vec<f64>,
    amount: f64,
    /// Components over errors at that amount of blood.
    columns: Vec<Vec<f64>>,
    weights: Vec<f64>,
    /// Components above zero.
    free: Vec<usize>,
    squares: f64,
}

/// Scatter of the residuals, and how much more than the nearest sum leaves still fits.
struct Limits {
    /// Of a residual.
    variance: f64,
    /// Squares, over a variance and a design effect, that may be left more.
    excess: f64,
    squares: f64,
}

impl Limits {
    fn new(squares: f64, spread: &Spread, errors_are_known: bool) -> Self {
        let found = squares / spread.expected_squares.max(f64::MIN_POSITIVE);
        let student = || StudentsT::new(0.0, 1.0, spread.freedom).map(|t| t.inverse_cdf(UPPER));
        // Larger residuals than the errors say count, smaller ones may be chance
        let quantile = match errors_are_known && found <= 1.0 {
            true => Normal::standard().inverse_cdf(UPPER),
            false => student().unwrap_or(f64::INFINITY),
        };
        let variance = if errors_are_known { found.max(1.0) } else { found };
        Self { variance, excess: quantile * quantile, squares }
    }

    /// Squares that may be left where a weight has some design effect.
    fn of(&self, effect: f64) -> f64 {
        // Rounding of an exact sum.
        self.squares * (1.0 + 1e-12) + self.excess * self.variance * effect
    }
}

impl<'a> Fitting<'a> {
    pub(super) fn new(
        mixture: &'a SpectralMixture,
        data: &'a [f64],
        errors: Option<&'a [f64]>,
        amount: f64,
    ) -> Self {
        let scaled = over(data, errors);
        let columns = mixture.scaled_components(amount, errors);
        let nearest = LeastSquares::new(&columns, &scaled).nearest_of_all();
        let free = (0..columns.len()).filter(|&column| nearest.is_free[column]).collect();
        let (weights, squares) = (nearest.weights, nearest.squares);
        Self { mixture, data, errors, scaled, amount, columns, weights, free, squares }
    }

    fn problem_behind(&self, amount: f64) -> LeastSquares {
        LeastSquares::new(&self.mixture.scaled_components(amount, self.errors), &self.scaled)
    }

    /// How the sum changes with the amount of blood; `None` where it does not.
    fn tangent(&self) -> Option<Vec<f64>> {
        let [least, largest] = self.mixture.blood.range()?;
        if !self.mixture.blood.matters(&self.free) {
            return None;
        }
        let step = 1e-4 * (largest - least);
        let [low, high] = [(self.amount - step).max(least), (self.amount + step).min(largest)];
        let sum = |amount: f64| {
            let columns = self.mixture.scaled_components(amount, self.errors);
            (0..self.data.len())
                .map(|i| columns.iter().zip(&self.weights).map(|(c, w)| w * c[i]).sum::<f64>())
                .collect::<Vec<f64>>()
        };
        let change: Vec<f64> =
            sum(high).iter().zip(sum(low)).map(|(high, low)| (high - low) / (2.0 * step)).collect();
        change.iter().any(|value| *value != 0.0).then_some(change)
    }

    /// Weights with their intervals, and what the residuals say.
    pub(super) fn judged(&self) -> MixtureFit {
        let nm = &self.mixture.wavelengths_nm;
        let free: Vec<Vec<f64>> = self.free.iter().map(|&column| self.columns[column].clone()).collect();
        // Blood that does what the weights do is not told from these
        let with_blood = self.tangent().map(|tangent| [free.clone(), vec![tangent]].concat());
        let with_blood = with_blood.filter(|all| Spread::of(&ResidualCorrelation::NONE, nm, all).is_some());
        let tells_blood = with_blood.is_some();
        let moving = with_blood.unwrap_or(free);
        let power: f64 = self.scaled.iter().map(|v| v * v).sum();
        let correlation = match self.squares <= ROUNDING * power {
            true => ResidualCorrelation::NONE,
            false => ResidualCorrelation::estimate(nm, &moving, &self.scaled),
        };
        let all_taken = Spread { expected_squares: 0.0, freedom: 1.0, weights: vec![] };
        let spread = Spread::of(&correlation, nm, &moving).unwrap_or(all_taken);
        let limits = Limits::new(self.squares, &spread, self.errors.is_some());
        let known: Vec<Option<WeightSpread>> = (0..self.columns.len())
            .map(|column| self.spread_of(column, &correlation, &spread, &moving))
            .collect();
        // What others make up is as uncertain as the worst of them
        let worst = spread.weights.iter().map(|weight| weight.effect).fold(1.0, f64::max);
        let effects: Vec<f64> = known.iter().map(|known| known.map_or(worst, |known| known.effect)).collect();
        let blood_effect =
            if tells_blood { spread.weights.last().map_or(worst, |w| w.effect) } else { worst };
        let intervals = self.intervals(&limits, &effects);
        MixtureFit {
            weights: self.fitted_weights(&limits, &known, &intervals),
            blood: self.mixture.blood.range().map(|range| FittedBlood {
                amount: self.amount,
                interval: self.amounts(limits.of(blood_effect), range),
            }),
            chi_square: self.errors.map(|_| self.chi_square(&spread)),
            scatter: ResidualScatter {
                correlation,
                effective_bands: spread.effective_samples(&correlation, nm),
                degrees_of_freedom: spread.freedom,
                standard_deviation: limits.variance.sqrt(),
            },
            ..self.sum()
        }
    }

    /// How well a weight is known; one at zero is freed for it. `None` where others make up the component.
    fn spread_of(
        &self,
        column: usize,
        correlation: &ResidualCorrelation,
        spread: &Spread,
        moving: &[Vec<f64>],
    ) -> Option<WeightSpread> {
        if let Some(place) = self.free.iter().position(|&free| free == column) {
            return spread.weights.get(place).copied();
        }
        let with = [moving, &[self.columns[column].clone()]].concat();
        Spread::of(correlation, &self.mixture.wavelengths_nm, &with)?.weights.last().copied()
    }

    /// Least and largest amount of blood behind which some sum leaves no more than a limit.
    fn amounts(&self, limit: f64, [least, largest]: [f64; 2]) -> [f64; 2] {
        let fits = |amount: f64| self.problem_behind(amount).nearest_of_all().squares <= limit;
        [least, largest].map(|end| if fits(end) { end } else { border(self.amount, end, &fits) })
    }

    /// Interval of each weight over all other weights and all amounts of blood.
    fn intervals(&self, limits: &Limits, effects: &[f64]) -> Vec<[f64; 2]> {
        let amounts = match self.mixture.blood.range() {
            None => vec![self.amount],
            Some(range) => {
                let widest = effects.iter().copied().fold(0.0, f64::max);
                let [low, high] = self.amounts(limits.of(widest), range);
                let node = |i: usize| low + (high - low) * i as f64 / (AMOUNTS - 1) as f64;
                (0..AMOUNTS).map(node).chain([self.amount]).collect()
            }
        };
        let problems: Vec<LeastSquares> = amounts.iter().map(|&amount| self.problem_behind(amount)).collect();
        let interval = |(column, effect): (usize, &f64)| {
            let ranges = problems.iter().filter_map(|problem| problem.range(column, limits.of(*effect)));
            ranges.fold([self.weights[column]; 2], |[a, b], [low, high]| [a.min(low), b.max(high)])
        };
        effects.iter().enumerate().map(interval).collect()
    }

    fn fitted_weights(
        &self,
        limits: &Limits,
        known: &[Option<WeightSpread>],
        intervals: &[[f64; 2]],
    ) -> Vec<FittedWeight> {
        let contributions = self.contributions();
        let all: f64 = contributions.iter().flatten().sum();
        let weight = |column: usize| {
            let part: f64 = contributions[column].iter().sum();
            FittedWeight {
                name: self.mixture.components[column].name.clone(),
                weight: self.weights[column],
                interval: intervals[column],
                standard_error: known[column].map(|known| (limits.variance * known.variance).sqrt()),
                design_effect: known[column].map(|known| known.effect),
                is_free: self.free.contains(&column),
                share: if all == 0.0 { 0.0 } else { part / all },
            }
        };
        (0..self.columns.len()).map(weight).collect()
    }

    fn chi_square(&self, spread: &Spread) -> FitChiSquare {
        let expected = spread.expected_squares;
        let below = ChiSquared::new(spread.freedom)
            .map_or(1.0, |known| known.cdf(spread.freedom * self.squares / expected.max(f64::MIN_POSITIVE)));
        FitChiSquare { chi_square: self.squares, expected, probability: 1.0 - below }
    }

    /// What each component adds, in the unit of the data.
    fn contributions(&self) -> Vec<Vec<f64>> {
        let values = self.mixture.blood.values(&self.mixture.components, self.amount);
        let weighted = |(values, weight): (Vec<f64>, &f64)| values.into_iter().map(|v| weight * v).collect();
        values.into_iter().zip(&self.weights).map(weighted).collect()
    }

    /// The sum and what it leaves, without a word about its weights.
    fn sum(&self) -> MixtureFit {
        let contributions = self.contributions();
        let at = |i: usize| contributions.iter().map(|part| part[i]).sum::<f64>();
        let fitted: Vec<f64> = (0..self.data.len()).map(at).collect();
        let residual: Vec<f64> = self.data.iter().zip(&fitted).map(|(data, fit)| data - fit).collect();
        let squares: f64 = residual.iter().map(|value| value * value).sum();
        let rms = (squares / residual.len() as f64).sqrt();
        let largest = self.data.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
        MixtureFit {
            weights: vec![],
            blood: None,
            fitted,
            residual,
            contributions,
            rms,
            relative_rms: rms / largest,
            scatter: ResidualScatter {
                correlation: ResidualCorrelation::NONE,
                effective_bands: 0.0,
                degrees_of_freedom: 0.0,
                standard_deviation: 0.0,
            },
            chi_square: None,
        }
    }
}
