//! Functions of wavelength on their own, fine samples.

use std::borrow::Cow;
use std::fmt;
use std::sync::{Arc, LazyLock};

use thiserror::Error;

use super::{CurveModel, Quantity, Spectrum, WavelengthGrid};
use crate::digest::sha256_hex;
use crate::units::number_text;

/// Step, nm, at which analytic models and products are sampled before they are averaged over bins.
pub const FINE_STEP_NM: f64 = 0.5;

/// A function of wavelength: linear between its samples, zero outside them.
///
/// Sources, filters and excitation spectra are kept in this form, so that products which matter are formed
/// before any averaging over bins.
#[derive(Clone, PartialEq)]
pub struct Curve {
    /// Shared: scenes hold thousands of curves on few sets of wavelengths.
    wavelength_nm: Arc<[f64]>,
    value: Vec<f64>,
}

/// Short samples as they are; of long ones the range and a digest of every bit, which costs less than their decimals: digests of
/// scenes are made of this.
impl fmt::Debug for Curve {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN: usize = 16;
        let mut fields = f.debug_struct("Curve");
        if self.value.len() <= SHOWN {
            return fields.field("wavelength_nm", &self.wavelength_nm).field("value", &self.value).finish();
        }
        let bytes = self.wavelength_nm.iter().chain(&self.value).map(|value| value.to_le_bytes());
        fields
            .field("range_nm", &self.range_nm())
            .field("samples", &self.value.len())
            .field("sha256", &sha256_hex(bytes))
            .finish()
    }
}

/// Range over which models are sampled, nm.
const MODEL_NM: [f64; 2] = [200.0, 1200.0];

/// The wavelengths of [`Curve::from_fn`] over [`MODEL_NM`].
static MODEL_WAVELENGTHS: LazyLock<Arc<[f64]>> = LazyLock::new(|| fine_wavelengths(MODEL_NM[0], MODEL_NM[1]));

/// Wavelengths every [`FINE_STEP_NM`] or less over a range, ends included.
fn fine_wavelengths(start_nm: f64, end_nm: f64) -> Arc<[f64]> {
    let intervals = ((end_nm - start_nm) / FINE_STEP_NM).ceil().max(1.0) as usize;
    let step = (end_nm - start_nm) / intervals as f64;
    (0..=intervals).map(|i| start_nm + i as f64 * step).collect()
}

/// Why samples cannot be a curve.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum CurveError {
    /// Columns of different length.
    #[error("{wavelengths} wavelengths but {values} values; give one value per wavelength")]
    LengthMismatch {
        /// Number of wavelengths.
        wavelengths: usize,
        /// Number of values.
        values: usize,
    },
    /// Not enough samples.
    #[error("a spectrum needs at least two samples; got {0}")]
    TooFew(usize),
    /// Wavelengths that do not increase.
    #[error(
        "wavelengths must increase: sample {index} is at {} nm after {} nm. Sort the file by wavelength",
        number_text(*value),
        number_text(*previous)
    )]
    NotIncreasing {
        /// Number of the sample, from 0.
        index: usize,
        /// Its wavelength, nm.
        value: f64,
        /// The wavelength before it, nm.
        previous: f64,
    },
    /// NaN or infinite.
    #[error(
        "sample {index} (at {} nm) is {value}; every value must be a finite number",
        number_text(*wavelength_nm)
    )]
    NotFinite {
        /// Number of the sample, from 0.
        index: usize,
        /// Its wavelength, nm.
        wavelength_nm: f64,
        /// Its value.
        value: f64,
    },
    /// A wavelength far from the optical range.
    #[error(
        "wavelengths run from {} to {}; they must lie between 100 and 20000 nm. Are they in micrometers or meters? Give \
         nanometers",
        number_text(*first),
        number_text(*last)
    )]
    NotNanometers {
        /// First wavelength.
        first: f64,
        /// Last wavelength.
        last: f64,
    },
}

impl Curve {
    /// A piecewise linear function through samples; zero outside them.
    ///
    /// # Errors
    /// Columns of different length, fewer than two samples, wavelengths that do not increase or are not in nm,
    /// values that are not finite.
    pub fn new(wavelength_nm: Vec<f64>, value: Vec<f64>) -> Result<Self, CurveError> {
        Self::on_shared(wavelength_nm.into(), value)
    }

    /// [`Self::new`] on wavelengths that other curves have, too.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub(crate) fn on_shared(wavelength_nm: Arc<[f64]>, value: Vec<f64>) -> Result<Self, CurveError> {
        if wavelength_nm.len() != value.len() {
            return Err(CurveError::LengthMismatch { wavelengths: wavelength_nm.len(), values: value.len() });
        }
        if value.len() < 2 {
            return Err(CurveError::TooFew(value.len()));
        }
        for (index, (&at, &v)) in wavelength_nm.iter().zip(&value).enumerate() {
            if !at.is_finite() || !v.is_finite() {
                return Err(CurveError::NotFinite { index, wavelength_nm: at, value: v });
            }
            if index > 0 && at <= wavelength_nm[index - 1] {
                return Err(CurveError::NotIncreasing {
                    index,
                    value: at,
                    previous: wavelength_nm[index - 1],
                });
            }
        }
        let (first, last) = (wavelength_nm[0], wavelength_nm[wavelength_nm.len() - 1]);
        if first < 100.0 || last > 20_000.0 {
            return Err(CurveError::NotNanometers { first, last });
        }
        Ok(Self { wavelength_nm, value })
    }

    /// Samples a function every [`FINE_STEP_NM`] over a range, ends included.
    pub fn from_fn(start_nm: f64, end_nm: f64, f: impl Fn(f64) -> f64) -> Self {
        Self::from_samples(start_nm, end_nm, |wavelength_nm| wavelength_nm.iter().map(|&nm| f(nm)).collect())
    }

    /// [`Self::from_fn`] with all values made together from the wavelengths of the samples.
    pub(super) fn from_samples(start_nm: f64, end_nm: f64, values: impl FnOnce(&[f64]) -> Vec<f64>) -> Self {
        let wavelength_nm = if [start_nm, end_nm] == MODEL_NM {
            Arc::clone(&MODEL_WAVELENGTHS)
        } else {
            fine_wavelengths(start_nm, end_nm)
        };
        let value = values(&wavelength_nm);
        Self { wavelength_nm, value }
    }

    /// A piecewise linear function through values at equal distances; at least two of them.
    pub(super) fn evenly_spaced(first_nm: f64, step_nm: f64, values: impl IntoIterator<Item = f64>) -> Self {
        let value: Vec<f64> = values.into_iter().collect();
        let wavelength_nm = (0..value.len()).map(|i| first_nm + i as f64 * step_nm).collect();
        Self { wavelength_nm, value }
    }

    /// Samples an analytic model over 200 to 1200 nm. A `table` keeps its own samples and range.
    pub fn from_model(model: &CurveModel) -> Self {
        if let CurveModel::Table { wavelength_nm, value } = model
            && let Ok(curve) = Self::new(wavelength_nm.clone(), value.clone())
        {
            return curve;
        }
        let [first_nm, last_nm] = MODEL_NM;
        Self::from_fn(first_nm, last_nm, |nm| model.eval(nm))
    }

    /// The same value everywhere between 200 and 1200 nm.
    pub fn constant(value: f64) -> Self {
        Self { wavelength_nm: MODEL_NM.into(), value: vec![value, value] }
    }

    /// Value at a wavelength; zero outside the samples.
    pub fn at(&self, wavelength_nm: f64) -> f64 {
        let (first, last) = self.range_nm();
        if !(first..=last).contains(&wavelength_nm) {
            return 0.0;
        }
        self.between(self.first_not_below(wavelength_nm).max(1), wavelength_nm)
    }

    /// Value at a wavelength within the range, of which the first sample that is not below it is known.
    fn between(&self, right: usize, wavelength_nm: f64) -> f64 {
        let (x0, x1) = (self.wavelength_nm[right - 1], self.wavelength_nm[right]);
        let (y0, y1) = (self.value[right - 1], self.value[right]);
        y0 + (y1 - y0) * (wavelength_nm - x0) / (x1 - x0)
    }

    /// Number of samples below a wavelength within the range. Samples mostly stand at even steps: it is looked for there first.
    fn first_not_below(&self, wavelength_nm: f64) -> usize {
        let (first, last) = self.range_nm();
        let x = &self.wavelength_nm;
        let guess = ((wavelength_nm - first) / (last - first) * (x.len() - 1) as f64) as usize;
        for left in [guess, guess.saturating_sub(1)] {
            if let Some(&[x0, x1]) = x.get(left..left + 2)
                && x0 < wavelength_nm
                && wavelength_nm <= x1
            {
                return left + 1;
            }
        }
        x.partition_point(|&nm| nm < wavelength_nm)
    }

    /// First and last sampled wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        (self.wavelength_nm[0], self.wavelength_nm[self.wavelength_nm.len() - 1])
    }

    /// Sampled wavelengths, nm.
    pub fn wavelengths_nm(&self) -> &[f64] {
        &self.wavelength_nm
    }

    /// Values at the samples.
    pub fn values(&self) -> &[f64] {
        &self.value
    }

    /// Largest value at a sample.
    pub fn max(&self) -> f64 {
        self.value.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Wavelength of the largest sample, nm.
    pub fn peak_nm(&self) -> f64 {
        let best =
            (0..self.value.len()).fold(0, |best, i| if self.value[i] > self.value[best] { i } else { best });
        self.wavelength_nm[best]
    }

    /// Every value times a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        self.mapped(|value| value * factor)
    }

    /// A function of every value.
    pub(crate) fn mapped(&self, of: impl Fn(f64) -> f64) -> Self {
        let value = self.value.iter().map(|value| of(*value)).collect();
        Self { wavelength_nm: self.wavelength_nm.clone(), value }
    }

    /// Exact integral of the piecewise linear function between two wavelengths, value × nm.
    pub fn integral(&self, from_nm: f64, to_nm: f64) -> f64 {
        let (first, last) = self.range_nm();
        let (a, b) = (from_nm.max(first), to_nm.min(last));
        if b <= a {
            return 0.0;
        }
        let mut sum = 0.0;
        let mut left = a;
        let mut left_value = self.at(a);
        let mut next = self.wavelength_nm.partition_point(|&nm| nm <= a).min(self.wavelength_nm.len() - 1);
        loop {
            let right = self.wavelength_nm[next].min(b);
            let right_value = self.between(next, right);
            sum += 0.5 * (left_value + right_value) * (right - left);
            if right >= b {
                return sum;
            }
            (left, left_value, next) = (right, right_value, next + 1);
        }
    }

    /// Integral over all samples, value × nm.
    pub fn total(&self) -> f64 {
        let (first, last) = self.range_nm();
        self.integral(first, last)
    }

    /// Averages over the bins of a grid, `(1/width) * integral over the bin`, in the unit of the curve. The integral over
    /// the grid is kept exactly.
    pub fn bin_averages(&self, grid: &WavelengthGrid) -> Vec<f64> {
        grid.edges_nm().windows(2).map(|edge| self.integral(edge[0], edge[1]) / (edge[1] - edge[0])).collect()
    }

    /// [`Self::bin_averages`] of a curve that holds values of a quantity, in its unit.
    pub fn on_grid<Q: Quantity>(&self, grid: &WavelengthGrid) -> Spectrum<Q> {
        Spectrum::from_parts(grid.clone(), self.bin_averages(grid))
    }

    /// Bin averages weighted by the spectrum of the light that passes, `integral T w / integral w`: what a filter lets through
    /// of light whose spectrum is as steep as its own edge. Even weight in bins without light.
    pub fn on_grid_under<Q: Quantity>(&self, grid: &WavelengthGrid, light: &Self) -> Spectrum<Q> {
        let product = self.times(light);
        let average = |edge: &[f64]| {
            let arriving = light.integral(edge[0], edge[1]);
            if arriving > 0.0 {
                product.integral(edge[0], edge[1]) / arriving
            } else {
                self.integral(edge[0], edge[1]) / (edge[1] - edge[0])
            }
        };
        Spectrum::from_parts(grid.clone(), grid.edges_nm().windows(2).map(average).collect())
    }

    /// The part between two wavelengths; zero elsewhere.
    #[must_use]
    pub fn clipped(&self, from_nm: f64, to_nm: f64) -> Self {
        let (first, last) = self.range_nm();
        let (start, end) = (from_nm.max(first), to_nm.min(last));
        if end <= start {
            return Self { wavelength_nm: [from_nm, to_nm].into(), value: vec![0.0, 0.0] };
        }
        let mut wavelength_nm = vec![start];
        wavelength_nm.extend(self.wavelength_nm.iter().copied().filter(|&nm| nm > start && nm < end));
        wavelength_nm.push(end);
        let value = wavelength_nm.iter().map(|&nm| self.at(nm)).collect();
        Self { wavelength_nm: wavelength_nm.into(), value }
    }

    /// Sum of curves, each with its weight, sampled every [`FINE_STEP_NM`] where there are several; `None` for no curves.
    pub fn weighted_sum<'a>(parts: impl Iterator<Item = (Cow<'a, Self>, f64)>) -> Option<Self> {
        let parts: Vec<(Cow<'a, Self>, f64)> = parts.collect();
        match parts.as_slice() {
            [] => None,
            [(curve, weight)] => Some(curve.scaled(*weight)),
            _ => {
                let first = parts.iter().map(|(s, _)| s.range_nm().0).fold(f64::INFINITY, f64::min);
                let last = parts.iter().map(|(s, _)| s.range_nm().1).fold(f64::NEG_INFINITY, f64::max);
                Some(Self::from_fn(first, last, |nm| parts.iter().map(|(s, w)| w * s.at(nm)).sum()))
            }
        }
    }

    /// Pointwise product on the union of both samplings, refined to at most [`FINE_STEP_NM`]; zero where either is.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        Factor::new(other).times(self)
    }
}

/// Where wavelengths lie among the samples of curves, looked up once for curves in a row that have the same samples.
pub(crate) struct Lookup<'a> {
    wavelength_nm: &'a [f64],
    samples: Option<Arc<[f64]>>,
    places: Vec<Option<Place>>,
}

/// A wavelength within the range of some samples.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Number of the sample at its right end of the interval, from 1.
    pub(super) right: usize,
    from_left: f64,
    width: f64,
}

impl Place {
    fn new(samples: &[f64], right: usize, wavelength_nm: f64) -> Self {
        let (x0, x1) = (samples[right - 1], samples[right]);
        Self { right, from_left: wavelength_nm - x0, width: x1 - x0 }
    }

    /// What [`Curve::at`] gives there, to the last bit.
    pub(super) fn value(&self, values: &[f64]) -> f64 {
        let (y0, y1) = (values[self.right - 1], values[self.right]);
        y0 + (y1 - y0) * self.from_left / self.width
    }
}

impl<'a> Lookup<'a> {
    pub(crate) fn new(wavelength_nm: &'a [f64]) -> Self {
        Self { wavelength_nm, samples: None, places: Vec::new() }
    }

    /// The wavelengths.
    pub(super) fn wavelengths_nm(&self) -> &'a [f64] {
        self.wavelength_nm
    }

    /// Where each wavelength lies; `None` outside the samples.
    pub(super) fn places(&mut self, curve: &Curve) -> &[Option<Place>] {
        if !self.samples.as_ref().is_some_and(|known| same(known, &curve.wavelength_nm)) {
            let (first, last) = curve.range_nm();
            let place = |&nm: &f64| {
                (first..=last)
                    .contains(&nm)
                    .then(|| Place::new(&curve.wavelength_nm, curve.first_not_below(nm).max(1), nm))
            };
            self.places.clear();
            self.places.extend(self.wavelength_nm.iter().map(place));
            self.samples = Some(Arc::clone(&curve.wavelength_nm));
        }
        &self.places
    }

    /// What [`Curve::at`] gives at each wavelength, to the last bit.
    pub(crate) fn values(&mut self, curve: &Curve) -> Vec<f64> {
        let value = |place: &Option<Place>| place.map_or(0.0, |place| place.value(&curve.value));
        self.places(curve).iter().map(value).collect()
    }
}

fn same(a: &Arc<[f64]>, b: &Arc<[f64]>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}

/// A curve by which others are multiplied: their samples are merged with its own once for curves in a row that have the same.
pub(super) struct Factor<'a> {
    factor: &'a Curve,
    samples: Option<Arc<[f64]>>,
    merged: Merged,
}

/// Two samplings together.
struct Merged {
    wavelength_nm: Arc<[f64]>,
    /// At each: its place among the samples of the one, and the value of the other. Nothing where they do not overlap.
    places: Vec<(Place, f64)>,
}

impl<'a> Factor<'a> {
    pub(super) fn new(factor: &'a Curve) -> Self {
        let merged = Merged { wavelength_nm: Arc::default(), places: Vec::new() };
        Self { factor, samples: None, merged }
    }

    /// [`Curve::times`].
    pub(super) fn times(&mut self, curve: &Curve) -> Curve {
        if !self.samples.as_ref().is_some_and(|known| same(known, &curve.wavelength_nm)) {
            self.merged = self.merged_with(curve);
            self.samples = Some(Arc::clone(&curve.wavelength_nm));
        }
        let Merged { wavelength_nm, places } = &self.merged;
        let mut value: Vec<f64> =
            places.iter().map(|(place, factor)| place.value(&curve.value) * factor).collect();
        value.resize(wavelength_nm.len(), 0.0);
        Curve { wavelength_nm: Arc::clone(wavelength_nm), value }
    }

    fn merged_with(&self, curve: &Curve) -> Merged {
        let (a, b) = (curve.range_nm(), self.factor.range_nm());
        let (start, end) = (a.0.max(b.0), a.1.min(b.1));
        if end <= start {
            return Merged { wavelength_nm: [a.0, a.1].into(), places: Vec::new() };
        }
        let steps = ((end - start) / FINE_STEP_NM).ceil() as usize;
        let mut fine = (0..=steps).map(|i| start + (end - start) * i as f64 / steps as f64).peekable();
        // Both samplings and the fine one are in order: they are merged, with a place in each
        let (x, y) = (&curve.wavelength_nm, &self.factor.wavelength_nm);
        let (mut i, mut j) = (x.partition_point(|&nm| nm < start), y.partition_point(|&nm| nm < start));
        let room = steps + x.len() + y.len();
        let (mut nodes, mut places) = (Vec::with_capacity(room), Vec::with_capacity(room));
        loop {
            let next_of =
                |x: &[f64], i: usize| x.get(i).copied().filter(|&nm| nm <= end).unwrap_or(f64::INFINITY);
            let nm = next_of(x, i).min(next_of(y, j)).min(fine.peek().copied().unwrap_or(f64::INFINITY));
            if nm == f64::INFINITY {
                break;
            }
            if nodes.last().is_none_or(|last| nm - last >= 1e-9) {
                nodes.push(nm);
                places.push((Place::new(x, i.max(1), nm), self.factor.between(j.max(1), nm)));
            }
            i += usize::from(x.get(i) == Some(&nm));
            j += usize::from(y.get(j) == Some(&nm));
            fine.next_if_eq(&nm);
        }
        Merged { wavelength_nm: nodes.into(), places }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::Dimensionless;

    #[test]
    fn values_between_uneven_samples_are_those_of_a_search() {
        let x = vec![200.0, 200.5, 201.0, 333.3, 334.0, 700.0, 700.1, 1200.0];
        let y = vec![1.0, -2.0, 4.0, 0.5, 7.0, 3.0, 9.0, 2.0];
        let curve = Curve::new(x.clone(), y.clone()).unwrap();
        for nm in (0..=10_000).map(|k| 200.0 + 0.1 * f64::from(k)).chain(x.iter().copied()) {
            if nm > 1200.0 {
                continue;
            }
            let right = x.partition_point(|&sample| sample < nm).max(1);
            let step = (nm - x[right - 1]) / (x[right] - x[right - 1]);
            let expected = y[right - 1] + (y[right] - y[right - 1]) * step;
            // A few roundings of numbers below 10
            assert!((curve.at(nm) - expected).abs() < 1e-13, "{nm}: {}", curve.at(nm));
        }
    }

    #[test]
    fn resampling_keeps_the_integral() {
        let curve = Curve::new(vec![380.0, 383.0, 391.0, 420.0], vec![0.0, 5.0, 1.0, 0.2]).unwrap();
        for step in [1.0, 2.0, 5.0, 10.0] {
            let grid = WavelengthGrid::uniform(350.0, 450.0, step).unwrap();
            let spectrum: Spectrum<Dimensionless> = curve.on_grid(&grid);
            assert!((spectrum.integral() - curve.total()).abs() < 1e-12 * curve.total());
        }
    }

    #[test]
    fn values_are_linear_inside_and_zero_outside() {
        let curve = Curve::new(vec![400.0, 410.0], vec![1.0, 3.0]).unwrap();
        assert_eq!((curve.at(400.0), curve.at(405.0), curve.at(410.0)), (1.0, 2.0, 3.0));
        assert_eq!((curve.at(399.9), curve.at(410.1)), (0.0, 0.0));
    }

    #[test]
    fn a_product_is_formed_finely() {
        let ramp = Curve::new(vec![400.0, 500.0], vec![0.0, 1.0]).unwrap();
        let square = ramp.times(&ramp);
        assert!((square.total() - 100.0 / 3.0).abs() < 1e-3);
    }

    #[test]
    fn bad_samples_are_refused() {
        assert!(matches!(Curve::new(vec![0.4, 0.5], vec![1.0, 1.0]), Err(CurveError::NotNanometers { .. })));
        assert!(matches!(
            Curve::new(vec![400.0, 400.0], vec![1.0, 1.0]),
            Err(CurveError::NotIncreasing { index: 1, .. })
        ));
        assert!(matches!(
            Curve::new(vec![400.0, 500.0], vec![1.0, f64::NAN]),
            Err(CurveError::NotFinite { .. })
        ));
        assert_eq!(Curve::new(vec![400.0], vec![1.0]), Err(CurveError::TooFew(1)));
    }
}
