//! Excitation-emission matrices on wavelength bins.

use std::ops::Range;

use fluorspar_accel::bands::{self, BandBlock, BandMatrix, OuterProduct};
use fluorspar_accel::{Lanes, Simd, Work};

use crate::spectral::{Curve, Lookup, PhotonEem, Stokes, WavelengthGrid, YieldDensity};

/// Points per bin at which tables and the bin on the diagonal are integrated.
const SUBSAMPLES: usize = 8;

/// Turns irradiance (W/(m² nm), bin averages) into fluorescent exitance in the same unit: `M_o = sum_i F_oi E_i`.
///
/// The matrix is the energy form of the photon yield density, averaged over both bins and multiplied by the width
/// of the excitation bin. Within an excitation bin the yield is weighted with the spectrum of the light, so that a
/// line or a steep filter edge narrower than the bin loses no accuracy.
#[derive(Clone, Debug)]
pub struct FluorescenceOperator {
    bands: usize,
    form: Form,
}

#[derive(Clone, Debug)]
enum Form {
    /// One outer product per term, O(bands) each; the first also has what falls into the bin of its excitation.
    Separable(Vec<OuterProduct>),
    /// Any matrix, O(bands²).
    Dense(BandMatrix),
}

impl FluorescenceOperator {
    /// The operator for a matrix at unit concentration, with excitation weighted by a light spectrum (any scale).
    /// Bins in which the light is dark, and `None`, weight evenly.
    pub fn new(eem: &PhotonEem, grid: &WavelengthGrid, light: Option<&Curve>) -> Self {
        SampledEem::new(eem, grid).operator(&BinWeight::new(grid, light))
    }

    /// Number of bands.
    pub(super) fn bands(&self) -> usize {
        self.bands
    }

    /// Blocks of bands that [`Self::add_product`] reads or writes, about in proportion to its time.
    pub(super) fn blocks(&self) -> usize {
        match &self.form {
            Form::Separable(terms) => terms.iter().map(OuterProduct::blocks).sum(),
            Form::Dense(_) => self.bands * self.bands.div_ceil(bands::BLOCK),
        }
    }

    /// `out += factor * F v`. Both slices hold one value per band, padded to whole blocks.
    #[inline(always)]
    pub fn add_product<L: Lanes>(&self, lanes: L, factor: f32, v: &[BandBlock], out: &mut [BandBlock]) {
        debug_assert!(v.len() == self.bands.div_ceil(bands::BLOCK) && out.len() == v.len());
        match &self.form {
            Form::Separable(terms) => {
                for term in terms {
                    term.add_product(lanes, factor, v, out);
                }
            }
            Form::Dense(matrix) => matrix.add_product(lanes, factor, v, out),
        }
    }

    /// [`Self::add_product`] on plain band vectors, with the widest instructions of this processor.
    pub fn product(&self, factor: f32, v: &[f32]) -> Vec<f32> {
        struct Product<'a>(&'a FluorescenceOperator, f32, &'a [BandBlock], &'a mut [BandBlock]);
        impl Work for Product<'_> {
            type Output = ();
            #[inline(always)]
            fn run<L: Lanes>(self, lanes: L) {
                self.0.add_product(lanes, self.1, self.2, self.3);
            }
        }
        let v = bands::to_blocks(v);
        let mut blocks = vec![BandBlock::ZERO; v.len()];
        Simd::detect().run(Product(self, factor, &v, &mut blocks));
        let mut out = vec![0.0; self.bands];
        bands::copy_bands(&blocks, &mut out);
        out
    }
}

/// A matrix at the sub-samples of all bins, from which operators under any light follow.
pub(super) struct SampledEem<'a> {
    eem: &'a PhotonEem,
    grid: &'a WavelengthGrid,
    /// Of each separable term.
    terms: Vec<SampledTerm>,
    /// Yield density before the Stokes mask between the sub-samples of a bin, `[band][emission][excitation]`; nothing without a mask.
    diagonal: Vec<[[f64; SUBSAMPLES]; SUBSAMPLES]>,
}

struct SampledTerm {
    /// Photons absorbed at each sub-sample, as energy.
    excitation: Vec<f64>,
    /// Energy emitted, by band.
    emission: Vec<f64>,
}

impl<'a> SampledEem<'a> {
    pub(super) fn new(eem: &'a PhotonEem, grid: &'a WavelengthGrid) -> Self {
        let mut sampled = Self { eem, grid, terms: Vec::new(), diagonal: Vec::new() };
        let YieldDensity::Separable(terms) = eem.density() else { return sampled };
        let nodes: Vec<f64> = (0..grid.len()).flat_map(|band| bin_nodes(grid, band)).collect();
        let (mut exciting, mut emitting) = (Lookup::new(&nodes), Lookup::new(&nodes));
        if eem.stokes() == Stokes::Mask {
            sampled.diagonal = vec![[[0.0; SUBSAMPLES]; SUBSAMPLES]; grid.len()];
        }
        for term in terms {
            let mut excitation = exciting.values(&term.excitation);
            let mut emission = emitting.values(&term.emission);
            let bins = excitation.as_chunks().0.iter().zip(emission.as_chunks().0);
            for (density, (excited, emitted)) in sampled.diagonal.iter_mut().zip(bins) {
                add_outer_product(density, emitted, excited);
            }
            for ((excited, emitted), nm) in excitation.iter_mut().zip(&mut emission).zip(&nodes) {
                *excited *= nm;
                *emitted /= nm;
            }
            let emission = emission.chunks(SUBSAMPLES).map(even_mean).collect();
            sampled.terms.push(SampledTerm { excitation, emission });
        }
        sampled.diagonal.as_flattened_mut().as_flattened_mut().iter_mut().for_each(|d| *d *= eem.scale());
        sampled
    }

    /// The operator under light that weights the excitation within each bin.
    pub(super) fn operator(&self, weight: &BinWeight<'_>) -> FluorescenceOperator {
        let bands = self.grid.len();
        let form = match self.eem.density() {
            YieldDensity::Separable(_) => {
                let masked = self.eem.stokes() == Stokes::Mask;
                // Integrate the Stokes mask on the diagonal
                let mut diagonal: Vec<f32> =
                    (0..bands).map(|band| self.diagonal_entry(weight, band) as f32).collect();
                let terms = self.terms.iter().map(|term| {
                    // Average excitation over the bins
                    let excitation: Vec<f32> =
                        (0..bands).map(|band| self.absorbed(term, weight, band) as f32).collect();
                    let emission: Vec<f32> = term.emission.iter().map(|value| *value as f32).collect();
                    if !masked {
                        return OuterProduct::new(&excitation, &emission);
                    }
                    // Add the diagonal to the first term only
                    let product = OuterProduct::below_diagonal(&excitation, &emission, &diagonal);
                    diagonal.fill(0.0);
                    product
                });
                Form::Separable(terms.collect())
            }
            YieldDensity::Table(_) => {
                let columns: Vec<Vec<f64>> =
                    (0..bands).map(|excitation| table_column(self.eem, weight, excitation)).collect();
                Form::Dense(BandMatrix::new(bands, |row, column| columns[column][row] as f32))
            }
        };
        FluorescenceOperator { bands, form }
    }

    /// For each of the bands in which a light spectrum lies, its exitance per unit concentration by what the light has there, as
    /// [`FluorescenceOperator`] forms it.
    pub(super) fn columns(
        &self,
        weight: &BinWeight<'_>,
        irradiance: &[f64],
        lit: Range<usize>,
    ) -> Vec<Vec<f64>> {
        let column = |excitation: usize| -> Vec<f64> {
            let mut column = match self.eem.density() {
                YieldDensity::Table(_) => table_column(self.eem, weight, excitation),
                YieldDensity::Separable(_) => {
                    let mut column = vec![0.0; self.grid.len()];
                    for term in &self.terms {
                        let absorbed = self.absorbed(term, weight, excitation);
                        for (sum, emission) in column.iter_mut().zip(&term.emission) {
                            *sum += absorbed * emission;
                        }
                    }
                    if self.eem.stokes() == Stokes::Mask {
                        column[..excitation].fill(0.0);
                        column[excitation] = self.diagonal_entry(weight, excitation);
                    }
                    column
                }
            };
            column.iter_mut().for_each(|value| *value *= irradiance[excitation]);
            column
        };
        lit.map(column).collect()
    }

    /// Photons that a term absorbs in a band, as energy.
    fn absorbed(&self, term: &SampledTerm, weight: &BinWeight<'_>, band: usize) -> f64 {
        let values = &term.excitation[band * SUBSAMPLES..][..SUBSAMPLES];
        let average: f64 =
            weight.weights[band].iter().zip(values).map(|(weight, value)| weight * value).sum();
        self.eem.scale() * average * self.grid.width_nm(band)
    }

    /// Entry for emission and excitation in the same bin under the Stokes mask; 0 without it.
    fn diagonal_entry(&self, weight: &BinWeight<'_>, band: usize) -> f64 {
        self.diagonal.get(band).map_or(0.0, |density| diagonal_sum(density, weight, band))
    }
}

/// `density[emission][excitation] += emitted * excited`.
fn add_outer_product(
    density: &mut [[f64; SUBSAMPLES]; SUBSAMPLES],
    emitted: &[f64; SUBSAMPLES],
    excited: &[f64; SUBSAMPLES],
) {
    for (row, emitted) in density.iter_mut().zip(emitted) {
        row.iter_mut().zip(excited).for_each(|(sum, excited)| *sum += excited * emitted);
    }
}

/// A column of a table: each entry averaged over both bins.
fn table_column(eem: &PhotonEem, weight: &BinWeight<'_>, excitation: usize) -> Vec<f64> {
    let grid = weight.grid;
    let entry = |emission: usize| {
        let nodes = bin_nodes(grid, emission);
        if emission == excitation && eem.stokes() == Stokes::Mask {
            let densities = eem.unmasked_densities(&nodes, &nodes);
            let rows = densities.as_chunks().0.as_chunks().0;
            return rows.first().map_or(0.0, |density| diagonal_sum(density, weight, emission));
        }
        let at = |excitation_nm: f64| {
            even_mean(
                &nodes.map(|emission_nm| eem.at(emission_nm, excitation_nm) * excitation_nm / emission_nm),
            )
        };
        let values = bin_nodes(grid, excitation).map(at);
        let average: f64 =
            weight.weights[excitation].iter().zip(values).map(|(weight, value)| weight * value).sum();
        grid.width_nm(excitation) * average
    };
    (0..grid.len()).map(entry).collect()
}

/// `F s` of any matrix for a fixed light spectrum, formed on fine samples before averaging over bins.
pub(crate) struct DirectLight<'a> {
    grid: &'a WavelengthGrid,
    /// In units of 1/(h c): photons = energy * lambda.
    photons: Curve,
}

impl<'a> DirectLight<'a> {
    /// Only excitation within the grid counts.
    pub(crate) fn new(grid: &'a WavelengthGrid, light: &Curve) -> Self {
        let within = light.clipped(grid.start_nm(), grid.end_nm());
        let wavelength = Curve::from_fn(grid.start_nm(), grid.end_nm(), |nm| nm);
        Self { grid, photons: within.times(&wavelength) }
    }

    /// Exitance per unit concentration, W/(m² nm) for an irradiance `s` in W/(m² nm).
    pub(crate) fn exitance(&self, eem: &PhotonEem) -> Vec<f64> {
        let range = (self.grid.start_nm(), self.grid.end_nm());
        let photons = eem.photon_exitance(&self.photons, range);
        let (x, y) = (photons.wavelengths_nm(), photons.values());
        let energy = Curve::new(x.to_vec(), x.iter().zip(y).map(|(nm, value)| value / nm).collect());
        match energy {
            Ok(curve) => curve.bin_averages(self.grid),
            Err(_) => vec![0.0; self.grid.len()],
        }
    }
}

/// [`DirectLight::exitance`] of one matrix.
pub(crate) fn direct_exitance(eem: &PhotonEem, grid: &WavelengthGrid, light: &Curve) -> Vec<f64> {
    DirectLight::new(grid, light).exitance(eem)
}

/// The sub-samples of a bin, nm.
fn bin_nodes(grid: &WavelengthGrid, band: usize) -> [f64; SUBSAMPLES] {
    let (start, width) = (grid.edges_nm()[band], grid.width_nm(band));
    std::array::from_fn(|k| start + width * (k as f64 + 0.5) / SUBSAMPLES as f64)
}

/// Average over a bin with even weight.
fn even_mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / SUBSAMPLES as f64
}

/// Weights of sub-samples of every bin, each bin's sum being 1.
pub(super) struct BinWeight<'a> {
    grid: &'a WavelengthGrid,
    weights: Vec<[f64; SUBSAMPLES]>,
}

impl<'a> BinWeight<'a> {
    /// By a light spectrum of any scale; even where it is dark, or `None`.
    pub(super) fn new(grid: &'a WavelengthGrid, light: Option<&Curve>) -> Self {
        let even = [1.0 / SUBSAMPLES as f64; SUBSAMPLES];
        let weights = (0..grid.len())
            .map(|band| {
                let Some(light) = light else { return even };
                let (start, width) = (grid.edges_nm()[band], grid.width_nm(band));
                let edge = |k: usize| start + width * k as f64 / SUBSAMPLES as f64;
                let mut weights: [f64; SUBSAMPLES] =
                    std::array::from_fn(|k| light.integral(edge(k), edge(k + 1)).max(0.0));
                let total: f64 = weights.iter().sum();
                if total <= 0.0 {
                    return even;
                }
                weights.iter_mut().for_each(|w| *w /= total);
                weights
            })
            .collect();
        Self { grid, weights }
    }
}

/// Sum over emission and excitation in the same bin under the Stokes mask: only pairs with `lo > li` count.
/// Pairs of sub-samples at the same place count half.
fn diagonal_sum(density: &[[f64; SUBSAMPLES]; SUBSAMPLES], weight: &BinWeight<'_>, band: usize) -> f64 {
    let nodes = bin_nodes(weight.grid, band);
    let mut sum = 0.0;
    for (i, excitation_weight) in weight.weights[band].iter().enumerate() {
        for o in i..SUBSAMPLES {
            let half = if o == i { 0.5 } else { 1.0 };
            sum += half * excitation_weight * density[o][i] * nodes[i] / nodes[o];
        }
    }
    sum * weight.grid.width_nm(band) / SUBSAMPLES as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::{EemTable, Irradiance, SeparableTerm, Spectrum};

    fn gaussian(center: f64, sd: f64, height: f64) -> Curve {
        Curve::from_fn(200.0, 1000.0, |nm| height * (-0.5 * ((nm - center) / sd).powi(2)).exp())
    }

    fn dye(stokes: Stokes) -> PhotonEem {
        let terms = [(390.0, 30.0, 500.0, 30.0), (430.0, 25.0, 560.0, 35.0), (400.0, 40.0, 440.0, 20.0)]
            .map(|(ex, ex_sd, em, em_sd)| SeparableTerm {
                excitation: gaussian(ex, ex_sd, 0.2),
                emission: gaussian(em, em_sd, 1.0 / (em_sd * (2.0 * std::f64::consts::PI).sqrt())),
            })
            .to_vec();
        PhotonEem::separable(terms, stokes)
    }

    fn photons(grid: &WavelengthGrid, energy: impl IntoIterator<Item = f64>) -> f64 {
        energy.into_iter().enumerate().map(|(b, e)| e * grid.center_nm(b) * grid.width_nm(b)).sum()
    }

    /// A steep spectrum: a 10 nm LED behind a sharp short-pass.
    fn steep_spectrum() -> Curve {
        Curve::from_fn(300.0, 800.0, |nm| {
            (-0.5 * ((nm - 385.0) / 5.0).powi(2)).exp() / (1.0 + ((nm - 392.0) / 0.8).exp())
        })
    }

    #[test]
    fn emitted_photons_do_not_depend_on_the_step() {
        for stokes in [Stokes::Mask, Stokes::Off] {
            let eem = dye(stokes);
            let mut direct = Vec::new();
            let mut indirect = Vec::new();
            for step in [1.0, 2.0, 5.0, 10.0] {
                let grid = WavelengthGrid::uniform(350.0, 750.0, step).unwrap();
                direct.push(photons(&grid, direct_exitance(&eem, &grid, &steep_spectrum())));
                let light: Spectrum<Irradiance> = steep_spectrum().on_grid(&grid);
                let light: Vec<f32> = light.values().iter().map(|&v| v as f32).collect();
                let out =
                    FluorescenceOperator::new(&eem, &grid, Some(&steep_spectrum())).product(1.0, &light);
                indirect.push(photons(&grid, out.iter().map(|&e| f64::from(e))));
            }
            for values in [&direct, &indirect] {
                for value in values {
                    assert!((value / direct[0] - 1.0).abs() < 1e-3, "{stokes:?} {direct:?} {indirect:?}");
                }
            }
        }
    }

    #[test]
    fn separable_and_dense_forms_agree() {
        for stokes in [Stokes::Mask, Stokes::Off] {
            let eem = dye(stokes);
            let nodes: Vec<f64> = (0..=450).map(|i| 330.0 + f64::from(i)).collect();
            let mut values = Vec::new();
            for &emission_nm in &nodes {
                values.extend(nodes.iter().map(|&excitation_nm| eem.unmasked(emission_nm, excitation_nm)));
            }
            let table = EemTable { emission_nm: nodes.clone(), excitation_nm: nodes, values };
            let dense = PhotonEem::table(table, stokes).unwrap();
            let grid = WavelengthGrid::default();
            let v: Vec<f32> = (0..grid.len()).map(|b| 1.0 + (b as f32 * 0.3).sin()).collect();
            let a = FluorescenceOperator::new(&eem, &grid, None).product(0.7, &v);
            let b = FluorescenceOperator::new(&dense, &grid, None).product(0.7, &v);
            let peak = a.iter().copied().fold(0.0, f32::max);
            for (x, y) in a.iter().zip(&b) {
                assert!((x - y).abs() < 2e-3 * peak, "{stokes:?}: {x} {y} of {peak}");
            }
        }
    }
}
