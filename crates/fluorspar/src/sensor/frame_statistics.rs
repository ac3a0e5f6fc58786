//! What measured frames are reduced to: lines through points with errors, spatial variances, numbers with intervals.

use serde::Serialize;

/// Standard errors to each side of a 95 % interval.
const TO_95: f64 = 1.959_963_985;

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MeasuredNumber {
    /// Value.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl MeasuredNumber {
    /// A value with its standard error.
    #[must_use]
    pub fn new(value: f64, error: f64) -> Self {
        Self { value, low: value - TO_95 * error, high: value + TO_95 * error }
    }

    /// The root of a square with its standard error; squares below 0 are noise about 0.
    #[must_use]
    pub fn root(square: f64, error: f64) -> Self {
        let Self { value, low, high } = Self::new(square, error);
        let root = |square: f64| square.max(0.0).sqrt();
        Self { value: root(value), low: root(low), high: root(high) }
    }

    /// Standard error.
    #[must_use]
    pub fn error(&self) -> f64 {
        (self.high - self.low) / (2.0 * TO_95)
    }

    /// The ratio to another number of independent errors.
    #[must_use]
    pub fn over(self, other: Self) -> Self {
        let ratio = self.value / other.value;
        let error = (self.error() / other.value).hypot(ratio * other.error() / other.value);
        Self::new(ratio, error)
    }

    /// It times a number without an error.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { value: self.value * factor, low: self.low * factor, high: self.high * factor }
    }

    /// Whether the interval holds a number.
    #[must_use]
    pub fn holds(&self, number: f64) -> bool {
        (self.low..=self.high).contains(&number)
    }
}

/// A point: abscissa, ordinate, weight.
pub(super) type Point = (f64, f64, f64);

/// Line of least weighted squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    /// Where weights are centered.
    center: [f64; 2],
    pub(super) slope: f64,
    /// Variances of the ordinate at the center and of the slope, where weights are inverse variances.
    variances: [f64; 2],
    /// Weighted squares of the residuals.
    pub(super) chi_square: f64,
}

impl Line {
    pub(super) fn through(points: impl Iterator<Item = Point> + Clone) -> Self {
        let sum = |f: &dyn Fn(Point) -> f64| points.clone().map(f).sum::<f64>();
        let weight = sum(&|(_, _, w)| w);
        let (x0, y0) = (sum(&|(x, _, w)| w * x) / weight, sum(&|(_, y, w)| w * y) / weight);
        let spread = sum(&|(x, _, w)| w * (x - x0).powi(2));
        let slope = sum(&|(x, y, w)| w * (x - x0) * (y - y0)) / spread;
        let chi_square = sum(&|(x, y, w)| w * (y - y0 - slope * (x - x0)).powi(2));
        Self { center: [x0, y0], slope, variances: [1.0 / weight, 1.0 / spread], chi_square }
    }

    /// The same without its slope, as of points of one abscissa.
    pub(super) fn level(self) -> Self {
        Self { slope: 0.0, variances: [self.variances[0], 0.0], ..self }
    }

    pub(super) fn at(&self, x: f64) -> f64 {
        self.center[1] + self.slope * (x - self.center[0])
    }

    /// Standard error of the ordinate.
    pub(super) fn error_at(&self, x: f64) -> f64 {
        (self.variances[0] + self.variances[1] * (x - self.center[0]).powi(2)).sqrt()
    }

    pub(super) fn slope_error(&self) -> f64 {
        self.variances[1].sqrt()
    }
}

pub(super) fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

pub(super) fn variance(values: &[f64]) -> f64 {
    let center = mean(values.iter().copied());
    values.iter().map(|v| (v - center).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)
}

/// Variance of values whose distribution is not known, with its standard error from their fourth moment.
pub(super) fn variance_with_error(values: &[f64]) -> (f64, f64) {
    let center = mean(values.iter().copied());
    let fourth = mean(values.iter().map(|v| (v - center).powi(4)));
    let variance = variance(values);
    (variance, ((fourth - variance * variance).max(0.0) / values.len() as f64).sqrt())
}

/// Spatial variances of an image: total, rows, columns, pixels.
pub(super) fn spatial_variances(values: &[f64], columns: usize) -> [f64; 4] {
    let rows = values.len() / columns;
    let row_means: Vec<f64> = values.chunks_exact(columns).map(|row| mean(row.iter().copied())).collect();
    let mut column_means = vec![0.0; columns];
    for row in values.chunks_exact(columns) {
        for (sum, value) in column_means.iter_mut().zip(row) {
            *sum += value / rows as f64;
        }
    }
    // The mean over a row holds the row's own deviation and that of its pixels over their number; so for columns.
    let (over_row, over_column) = (1.0 / columns as f64, 1.0 / rows as f64);
    let (all, of_rows, of_columns) = (variance(values), variance(&row_means), variance(&column_means));
    let pixels = (all - of_rows - of_columns) / (1.0 - over_row - over_column);
    [all, of_rows - pixels * over_row, of_columns - pixels * over_column, pixels]
}
