//! Excitation-emission (Donaldson) matrices as photon yield densities, independent of any grid.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::Curve;
use super::curve::{Factor, Lookup, Place};

/// Whether light may be emitted at wavelengths shorter than those that excite it.
///
/// Stokes' observation is a mask, not a law: warm molecules have real anti-Stokes tails. It is on by default, as
/// in the paper (section 3.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Stokes {
    /// Nothing is emitted below the excitation wavelength.
    #[default]
    Mask,
    /// The density is used unchanged.
    Off,
}

/// One separable term: `excitation(li) * emission(lo)`.
#[derive(Clone, Debug, PartialEq)]
pub struct SeparableTerm {
    /// Photon yield before the Stokes mask, photons out per photon in, against excitation wavelength.
    pub excitation: Curve,
    /// Photon density of the emission, 1/nm, of unit area, against emission wavelength. Of a matrix that was compressed both
    /// factors are signed and have any area; only the sum of the terms has a meaning.
    pub emission: Curve,
}

/// A measured table of yield densities, bilinear between its nodes and zero outside them.
#[derive(Clone, Debug, PartialEq)]
pub struct EemTable {
    /// Emission wavelengths, nm, increasing: the rows.
    pub emission_nm: Vec<f64>,
    /// Excitation wavelengths, nm, increasing: the columns.
    pub excitation_nm: Vec<f64>,
    /// `[emission][excitation]`, 1/nm.
    pub values: Vec<f64>,
}

/// The form in which a density is held.
#[derive(Clone, Debug, PartialEq)]
pub enum YieldDensity {
    /// A sum of products. Rank one is 27 % wrong for collagen and 46 % for elastin; several terms are not.
    Separable(Vec<SeparableTerm>),
    /// A full matrix.
    Table(EemTable),
}

/// Why a table cannot be an excitation-emission matrix.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum EemError {
    /// The number of values does not match the axes.
    #[error("{values} values do not fill {rows} emission rows by {columns} excitation columns")]
    Shape {
        /// Values given.
        values: usize,
        /// Emission wavelengths.
        rows: usize,
        /// Excitation wavelengths.
        columns: usize,
    },
    /// An axis does not increase or is too short.
    #[error("the {axis} wavelengths must be at least two and increase; see entry {index}")]
    Axis {
        /// "emission" or "excitation".
        axis: &'static str,
        /// Number of the entry, from 0.
        index: usize,
    },
    /// A value is negative or not finite.
    #[error(
        "the value at emission {emission_nm} nm, excitation {excitation_nm} nm is {value}; it must be a number >= 0"
    )]
    BadValue {
        /// Emission wavelength, nm.
        emission_nm: f64,
        /// Excitation wavelength, nm.
        excitation_nm: f64,
        /// The value.
        value: f64,
    },
}

impl EemTable {
    /// Checks shape, axes and values.
    ///
    /// # Errors
    /// The first defect found.
    pub fn validate(&self) -> Result<(), EemError> {
        let (rows, columns) = (self.emission_nm.len(), self.excitation_nm.len());
        if self.values.len() != rows * columns {
            return Err(EemError::Shape { values: self.values.len(), rows, columns });
        }
        for (axis, nodes) in [("emission", &self.emission_nm), ("excitation", &self.excitation_nm)] {
            if nodes.len() < 2 {
                return Err(EemError::Axis { axis, index: 0 });
            }
            for index in 1..nodes.len() {
                if nodes[index].partial_cmp(&nodes[index - 1]) != Some(std::cmp::Ordering::Greater) {
                    return Err(EemError::Axis { axis, index });
                }
            }
        }
        for (index, &value) in self.values.iter().enumerate() {
            if !(value.is_finite() && value >= 0.0) {
                let (emission_nm, excitation_nm) =
                    (self.emission_nm[index / columns], self.excitation_nm[index % columns]);
                return Err(EemError::BadValue { emission_nm, excitation_nm, value });
            }
        }
        Ok(())
    }

    fn at(&self, emission_nm: f64, excitation_nm: f64) -> f64 {
        let Some((row, row_fraction)) = interval(&self.emission_nm, emission_nm) else { return 0.0 };
        let Some((col, col_fraction)) = interval(&self.excitation_nm, excitation_nm) else { return 0.0 };
        let columns = self.excitation_nm.len();
        let value = |r: usize, c: usize| self.values[r * columns + c];
        let low = value(row, col) * (1.0 - col_fraction) + value(row, col + 1) * col_fraction;
        let high = value(row + 1, col) * (1.0 - col_fraction) + value(row + 1, col + 1) * col_fraction;
        low * (1.0 - row_fraction) + high * row_fraction
    }
}

/// The interval of sorted nodes that holds `x`, and how far into it `x` lies.
fn interval(nodes: &[f64], x: f64) -> Option<(usize, f64)> {
    let last = nodes.len() - 1;
    if !(nodes[0]..=nodes[last]).contains(&x) {
        return None;
    }
    let right = nodes.partition_point(|&node| node < x).clamp(1, last);
    Some((right - 1, (x - nodes[right - 1]) / (nodes[right] - nodes[right - 1])))
}

/// Photon yield density `Y(lo|li)`: photons that leave per nm of emission, per photon that arrives, 1/nm.
///
/// `M_q(lo) = integral Y(lo|li) E_q(li) dli` is the photon exitance; emission is Lambertian, so the radiance is
/// `M / pi`. The `pi` belongs to the material, never to the matrix. Eq. 3 of the paper.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotonEem {
    density: YieldDensity,
    stokes: Stokes,
    scale: f64,
}

/// The same matrix for energy: `Y_e(lo|li) = Y(lo|li) * li / lo`, watts out per nm per watt in.
#[derive(Clone, Debug, PartialEq)]
pub struct EnergyEem(PhotonEem);

impl PhotonEem {
    /// A sum of separable terms.
    pub fn separable(terms: Vec<SeparableTerm>, stokes: Stokes) -> Self {
        Self { density: YieldDensity::Separable(terms), stokes, scale: 1.0 }
    }

    /// A full matrix of photon yield densities.
    ///
    /// # Errors
    /// Axes that do not increase, a shape that does not fit, negative or non-finite values.
    pub fn table(table: EemTable, stokes: Stokes) -> Result<Self, EemError> {
        table.validate()?;
        Ok(Self { density: YieldDensity::Table(table), stokes, scale: 1.0 })
    }

    /// A weighted sum of separable matrices under the Stokes mask of all of them. `None` without any, or where one is a
    /// full matrix or has another mask.
    pub fn weighted_sum<'a>(parts: impl Iterator<Item = (f64, &'a Self)>) -> Option<Self> {
        let mut sum: Option<(Vec<SeparableTerm>, Stokes)> = None;
        for (weight, eem) in parts {
            let YieldDensity::Separable(terms) = &eem.density else { return None };
            let (all, stokes) = sum.get_or_insert((Vec::new(), eem.stokes));
            if *stokes != eem.stokes {
                return None;
            }
            all.extend(terms.iter().filter(|_| weight != 0.0).map(|term| SeparableTerm {
                excitation: term.excitation.scaled(weight * eem.scale),
                emission: term.emission.clone(),
            }));
        }
        sum.map(|(terms, stokes)| Self::separable(terms, stokes))
    }

    /// How the density is held.
    pub fn density(&self) -> &YieldDensity {
        &self.density
    }

    /// Factor on the density as held.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Whether anti-Stokes emission is masked.
    pub fn stokes(&self) -> Stokes {
        self.stokes
    }

    /// The same matrix with another mask.
    #[must_use]
    pub fn with_stokes(mut self, stokes: Stokes) -> Self {
        self.stokes = stokes;
        self
    }

    /// The same matrix times a factor: a concentration, or a change of yield.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.scale *= factor;
        self
    }

    /// Yield density before the Stokes mask, 1/nm.
    pub fn unmasked(&self, emission_nm: f64, excitation_nm: f64) -> f64 {
        self.scale
            * match &self.density {
                YieldDensity::Separable(terms) => {
                    terms.iter().map(|t| t.excitation.at(excitation_nm) * t.emission.at(emission_nm)).sum()
                }
                YieldDensity::Table(table) => table.at(emission_nm, excitation_nm),
            }
    }

    /// Yield density at some wavelengths, 1/nm, `[emission][excitation]`: what [`Self::at`] gives for each pair, bit for bit, with
    /// each curve looked up once for a wavelength.
    pub fn densities(&self, emission_nm: &[f64], excitation_nm: &[f64]) -> Vec<f64> {
        let mut values = self.unmasked_densities(emission_nm, excitation_nm);
        if self.stokes == Stokes::Mask {
            for (row, m) in values.chunks_exact_mut(excitation_nm.len().max(1)).zip(emission_nm) {
                row.iter_mut()
                    .zip(excitation_nm)
                    .filter(|(_, x)| m <= *x)
                    .for_each(|(value, _)| *value = 0.0);
            }
        }
        values
    }

    /// The same before the Stokes mask: what [`Self::unmasked`] gives for each pair.
    pub(crate) fn unmasked_densities(&self, emission_nm: &[f64], excitation_nm: &[f64]) -> Vec<f64> {
        let YieldDensity::Separable(terms) = &self.density else {
            let row = |m: f64| excitation_nm.iter().map(move |x| self.unmasked(m, *x));
            return emission_nm.iter().flat_map(|m| row(*m)).collect();
        };
        let mut sums = vec![0.0; emission_nm.len() * excitation_nm.len()];
        let (mut emitting, mut exciting) = (Lookup::new(emission_nm), Lookup::new(excitation_nm));
        for term in terms {
            let excited = exciting.values(&term.excitation);
            let emitted = emitting.values(&term.emission);
            for (row, emitted) in sums.chunks_exact_mut(excited.len().max(1)).zip(emitted) {
                row.iter_mut().zip(&excited).for_each(|(sum, excited)| *sum += excited * emitted);
            }
        }
        sums.iter_mut().for_each(|sum| *sum *= self.scale);
        sums
    }

    /// Yield density, 1/nm.
    pub fn at(&self, emission_nm: f64, excitation_nm: f64) -> f64 {
        if self.stokes == Stokes::Mask && emission_nm <= excitation_nm {
            return 0.0;
        }
        self.unmasked(emission_nm, excitation_nm)
    }

    /// Photons emitted between two wavelengths per photon of `excitation_nm` that arrives.
    pub fn photon_yield(&self, excitation_nm: f64, from_nm: f64, to_nm: f64) -> f64 {
        let from_nm = if self.stokes == Stokes::Mask { from_nm.max(excitation_nm) } else { from_nm };
        if to_nm <= from_nm {
            return 0.0;
        }
        match &self.density {
            YieldDensity::Separable(terms) => {
                self.scale
                    * terms
                        .iter()
                        .map(|t| t.excitation.at(excitation_nm) * t.emission.integral(from_nm, to_nm))
                        .sum::<f64>()
            }
            YieldDensity::Table(_) => {
                Curve::from_fn(from_nm, to_nm, |emission_nm| self.unmasked(emission_nm, excitation_nm))
                    .total()
            }
        }
    }

    /// Photons emitted at any wavelength per photon that arrives, for many excitation wavelengths at once.
    pub fn total_yields(&self, excitation_nm: &[f64]) -> Vec<f64> {
        match &self.density {
            YieldDensity::Separable(terms) => {
                let (mut exciting, mut emitting) = (Lookup::new(excitation_nm), Lookup::new(excitation_nm));
                let mut totals = vec![0.0; excitation_nm.len()];
                for term in terms {
                    let sum = Cumulative::of(&term.emission);
                    let excited = exciting.values(&term.excitation);
                    let below = match self.stokes {
                        Stokes::Mask => sum.up_to_each(&mut emitting),
                        Stokes::Off => vec![0.0; totals.len()],
                    };
                    for ((total, excited), below) in totals.iter_mut().zip(excited).zip(below) {
                        *total += excited * (sum.total() - below);
                    }
                }
                totals.iter_mut().for_each(|total| *total *= self.scale);
                totals
            }
            YieldDensity::Table(table) => {
                let (from_nm, to_nm) = (table.emission_nm[0], table.emission_nm[table.emission_nm.len() - 1]);
                excitation_nm.iter().map(|&nm| self.photon_yield(nm, from_nm, to_nm)).collect()
            }
        }
    }

    /// Photon exitance under a photon irradiance given on a curve: `M_q(lo) = integral Y E_q dli`, sampled finely.
    pub fn photon_exitance(&self, photon_irradiance: &Curve, emission_range_nm: (f64, f64)) -> Curve {
        match &self.density {
            YieldDensity::Separable(terms) => {
                let mut light = Factor::new(photon_irradiance);
                Curve::from_samples(emission_range_nm.0, emission_range_nm.1, |emission_nm| {
                    let (mut absorbing, mut emitting) = (Lookup::new(emission_nm), Lookup::new(emission_nm));
                    let mut sums = vec![0.0; emission_nm.len()];
                    for term in terms {
                        let absorbed = light.times(&term.excitation);
                        let absorbed = Cumulative::of(&absorbed);
                        let exciting = match self.stokes {
                            Stokes::Mask => absorbed.up_to_each(&mut absorbing),
                            Stokes::Off => vec![absorbed.total(); sums.len()],
                        };
                        let emitted = emitting.values(&term.emission);
                        for ((sum, exciting), emitted) in sums.iter_mut().zip(exciting).zip(emitted) {
                            *sum += exciting * emitted;
                        }
                    }
                    sums.iter_mut().for_each(|sum| *sum *= self.scale);
                    sums
                })
            }
            YieldDensity::Table(_) => {
                Curve::from_fn(emission_range_nm.0, emission_range_nm.1, |emission_nm| {
                    let nodes = photon_irradiance.wavelengths_nm();
                    let values: Vec<f64> =
                        nodes.iter().map(|&nm| self.at(emission_nm, nm) * photon_irradiance.at(nm)).collect();
                    nodes
                        .windows(2)
                        .zip(values.windows(2))
                        .map(|(x, y)| 0.5 * (y[0] + y[1]) * (x[1] - x[0]))
                        .sum()
                })
            }
        }
    }
}

impl EnergyEem {
    /// Energy yield density, 1/nm.
    pub fn at(&self, emission_nm: f64, excitation_nm: f64) -> f64 {
        self.0.at(emission_nm, excitation_nm) * excitation_nm / emission_nm
    }

    /// A full matrix given as energy yield densities: watts out per nm per watt in.
    ///
    /// # Errors
    /// As [`PhotonEem::table`].
    pub fn table(mut table: EemTable, stokes: Stokes) -> Result<Self, EemError> {
        table.validate()?;
        let columns = table.excitation_nm.len();
        for (row, &emission_nm) in table.emission_nm.iter().enumerate() {
            for (col, &excitation_nm) in table.excitation_nm.iter().enumerate() {
                table.values[row * columns + col] *= emission_nm / excitation_nm;
            }
        }
        PhotonEem::table(table, stokes).map(Self)
    }

    /// The same matrix for photons.
    pub fn to_photon(&self) -> PhotonEem {
        self.0.clone()
    }
}

/// Running integral of a curve.
struct Cumulative<'a> {
    curve: &'a Curve,
    sums: Vec<f64>,
}

impl<'a> Cumulative<'a> {
    fn of(curve: &'a Curve) -> Self {
        let (x, y) = (curve.wavelengths_nm(), curve.values());
        let mut sums = vec![0.0; x.len()];
        for i in 1..x.len() {
            sums[i] = sums[i - 1] + 0.5 * (y[i] + y[i - 1]) * (x[i] - x[i - 1]);
        }
        Self { curve, sums }
    }

    fn total(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// The integral up to each of some wavelengths.
    fn up_to_each(&self, lookup: &mut Lookup<'_>) -> Vec<f64> {
        let (x, y) = (self.curve.wavelengths_nm(), self.curve.values());
        let wavelengths_nm = lookup.wavelengths_nm();
        let up_to = |(place, &nm): (&Option<Place>, &f64)| {
            let Some(place) = place else { return if nm < x[0] { 0.0 } else { self.total() } };
            // The first sample above the wavelength
            let next = place.right + usize::from(x[place.right] <= nm);
            if next == x.len() {
                return self.total();
            }
            self.sums[next - 1] + 0.5 * (y[next - 1] + place.value(y)) * (nm - x[next - 1])
        };
        lookup.places(self.curve).iter().zip(wavelengths_nm).map(up_to).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaussian(center: f64, sd: f64) -> Curve {
        let norm = sd * (2.0 * std::f64::consts::PI).sqrt();
        Curve::from_fn(300.0, 800.0, |nm| (-0.5 * ((nm - center) / sd).powi(2)).exp() / norm)
    }

    fn sample() -> PhotonEem {
        let excitation =
            Curve::from_fn(300.0, 800.0, |nm| 0.2 * (-0.5 * ((nm - 380.0) / 30.0).powi(2)).exp());
        PhotonEem::separable(
            vec![SeparableTerm { excitation, emission: gaussian(500.0, 25.0) }],
            Stokes::Mask,
        )
    }

    #[test]
    fn energy_form_differs_by_the_ratio_of_wavelengths() {
        let eem = sample();
        let energy = EnergyEem(eem.clone());
        let ratio = energy.at(500.0, 385.0) / eem.at(500.0, 385.0);
        assert!((ratio - 385.0 / 500.0).abs() < 1e-12);
        assert_eq!(energy.to_photon(), eem);
    }

    #[test]
    fn densities_are_those_of_pairs() {
        let one = sample().scaled(0.7);
        let YieldDensity::Separable(terms) = &one.density else { panic!("a sum of products") };
        let second = SeparableTerm { excitation: gaussian(420.0, 20.0), emission: gaussian(620.0, 9.0) };
        let two = PhotonEem::separable(vec![terms[0].clone(), second], Stokes::Mask).scaled(0.3);
        let (emission_nm, excitation_nm) = ([250.0, 398.0, 455.5, 500.0, 619.0], [300.0, 385.25, 460.0]);
        for eem in [one, two.clone(), two.with_stokes(Stokes::Off)] {
            let all = eem.densities(&emission_nm, &excitation_nm);
            let pairs = emission_nm.iter().flat_map(|m| excitation_nm.iter().map(|x| eem.at(*m, *x)));
            assert!(all.iter().copied().eq(pairs), "{all:?}");
            assert!(all.iter().any(|density| *density > 0.0));
        }
    }

    #[test]
    fn the_mask_removes_emission_below_excitation() {
        let eem = sample();
        assert_eq!(eem.at(450.0, 460.0), 0.0);
        assert!(eem.clone().with_stokes(Stokes::Off).at(450.0, 460.0) > 0.0);
    }

    #[test]
    fn yields_agree_whichever_way_they_are_asked_for() {
        for eem in [sample(), sample().with_stokes(Stokes::Off)] {
            for (nm, total) in [380.0, 480.0, 505.0].into_iter().zip(eem.total_yields(&[380.0, 480.0, 505.0]))
            {
                let one = eem.photon_yield(nm, 300.0, 800.0);
                assert!((total - one).abs() < 1e-9, "{nm}: {total} {one}");
            }
        }
    }

    #[test]
    fn yield_and_exitance_agree() {
        let eem = sample();
        let line = Curve::new(vec![384.0, 385.0, 386.0], vec![0.0, 1.0, 0.0]).unwrap();
        let exitance = eem.photon_exitance(&line, (300.0, 800.0));
        let expected = eem.photon_yield(385.0, 300.0, 800.0);
        assert!((exitance.total() / expected - 1.0).abs() < 2e-3, "{} {expected}", exitance.total());
    }

    #[test]
    fn a_table_is_bilinear_and_checked() {
        let table = EemTable {
            emission_nm: vec![500.0, 510.0],
            excitation_nm: vec![380.0, 390.0],
            values: vec![0.0, 1.0, 2.0, 3.0],
        };
        let eem = PhotonEem::table(table.clone(), Stokes::Mask).unwrap();
        assert!((eem.at(505.0, 385.0) - 1.5).abs() < 1e-12);
        let mut bad = table.clone();
        bad.values[2] = -1.0;
        assert!(matches!(PhotonEem::table(bad, Stokes::Mask), Err(EemError::BadValue { .. })));
        let mut bad = table;
        bad.excitation_nm = vec![390.0, 380.0];
        assert_eq!(bad.validate(), Err(EemError::Axis { axis: "excitation", index: 1 }));
    }
}
