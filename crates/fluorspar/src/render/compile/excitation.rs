//! Bases of the light that arrives after reflections, and how often fluorescence excites again.

use fluorspar_accel::bands::{self, BandBlock};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rayon::prelude::*;

use super::lights::Lights;
use crate::material::{PreparedMaterial, PreparedMaterials};
use crate::render::compiled_scene::MaterialSpectra;
use crate::render::excitation::{Excitation, MOST_SPECTRA};
use crate::render::fluorescence_operator::FluorescenceOperator;

/// Root mean square of what a basis leaves out of the products, relative, that more spectra would not pay for.
const LEFT_OUT: f64 = 1e-3;
/// Most matrices that weight a basis.
const MOST_WEIGHTING: usize = 64;
/// Reflections before the light arrives that a basis is made for.
const REFLECTIONS: usize = 3;
/// Probability with which fluorescence excites again, by the share of it that comes back.
const PROBABILITY_BY_YIELD: f32 = 10.0;
/// Least probability of it.
const LEAST_REPEAT: f32 = 1.0 / 8.0;

/// `[spectrum kept apart]`: what its light excites, from the operators of each.
pub(super) fn compile(
    operators: Vec<Vec<FluorescenceOperator>>,
    lights: &Lights,
    materials: &[MaterialSpectra],
) -> Vec<Excitation> {
    let of_slice = |(slice, operators): (usize, Vec<FluorescenceOperator>)| {
        let own = lights.sources.iter().filter(|source| source.group == slice);
        let lights: Vec<Vec<f64>> = own.map(|source| doubles(&source.bands)).collect();
        let terms = materials.iter().flat_map(|material| &material.terms);
        excitation(operators, &lights, terms.map(|term| doubles(term)))
    };
    operators.into_par_iter().enumerate().map(of_slice).collect()
}

/// What lights of some spectra excite when they have been reflected, values by band, padded to whole blocks.
fn excitation(
    operators: Vec<FluorescenceOperator>,
    lights: &[Vec<f64>],
    reflectances: impl Iterator<Item = Vec<f64>>,
) -> Excitation {
    let len = lights.first().map_or(0, Vec::len);
    let lit: Vec<usize> = (0..len).filter(|&band| lights.iter().any(|light| light[band] > 0.0)).collect();
    let response = response(&operators, lights, &lit);
    let excited: Vec<usize> = lit.into_iter().filter(|&band| response[band] > 0.0).collect();
    let basis = basis(lights, reflectances, &response, &excited);
    Excitation::new(operators, &response, &excited, &basis)
}

fn doubles(blocks: &[BandBlock]) -> Vec<f64> {
    blocks.iter().flat_map(|block| block.0).map(f64::from).collect()
}

/// Root mean square over the matrices, each relative to what the lights excite in it, of what one unit of light in a band excites. Few
/// matrices stand for many.
fn response(operators: &[FluorescenceOperator], lights: &[Vec<f64>], lit: &[usize]) -> Vec<f64> {
    let mut squares = vec![0.0; lights.first().map_or(0, Vec::len)];
    for operator in operators.iter().step_by(operators.len().div_ceil(MOST_WEIGHTING).max(1)) {
        let square = |band: usize| -> f64 {
            let mut unit = vec![0.0; operator.bands()];
            unit[band] = 1.0;
            operator.product(1.0, &unit).iter().map(|&value| f64::from(value).powi(2)).sum()
        };
        let own: Vec<f64> = lit.iter().map(|&band| square(band)).collect();
        let whole = |light: &Vec<f64>| -> f64 {
            lit.iter().zip(&own).map(|(&band, own)| own * light[band].powi(2)).sum()
        };
        let whole: f64 = lights.iter().map(whole).sum();
        if whole > 0.0 {
            lit.iter().zip(&own).for_each(|(&band, own)| squares[band] += own / whole);
        }
    }
    squares.into_iter().map(f64::sqrt).collect()
}

/// Orthonormal vectors over some bands near which the products of light spectra and reflectances lie, weighted by the response. The
/// Gram matrix of products is the product of the Gram matrices, entry by entry.
fn basis(
    lights: &[Vec<f64>],
    mut reflectances: impl Iterator<Item = Vec<f64>>,
    response: &[f64],
    bands: &[usize],
) -> Vec<Vec<f64>> {
    let len = bands.len();
    if len == 0 {
        return Vec::new();
    }
    let gram = |spectra: &mut dyn Iterator<Item = Vec<f64>>| -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(len, len);
        let mut count = 0.0_f64;
        for spectrum in spectra {
            let own: Vec<f64> = bands.iter().map(|&band| spectrum[band]).collect();
            let greatest = own.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            if greatest > 0.0 {
                let own = DVector::from_vec(own) / greatest;
                sum.ger(1.0, &own, &own, 1.0);
                count += 1.0;
            }
        }
        sum / count.max(1.0)
    };
    let reflected = gram(&mut reflectances);
    let mut products = gram(&mut lights.iter().cloned());
    let mut sum = products.clone();
    for _ in 0..REFLECTIONS {
        products.component_mul_assign(&reflected);
        sum += &products;
    }
    for (row, &i) in bands.iter().enumerate() {
        for (col, &j) in bands.iter().enumerate() {
            sum[(row, col)] *= response[i] * response[j];
        }
    }

    // The few strongest of its eigenvectors
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(sum);
    let mut order: Vec<usize> = (0..len).collect();
    order.sort_by(|a, b| eigenvalues[*b].total_cmp(&eigenvalues[*a]));
    let whole: f64 = eigenvalues.iter().map(|value| value.max(0.0)).sum();
    let mut left = whole;
    let mut found = Vec::new();
    for number in order.into_iter().take(MOST_SPECTRA) {
        if left <= LEFT_OUT * LEFT_OUT * whole {
            break;
        }
        left -= eigenvalues[number].max(0.0);
        found.push(eigenvectors.column(number).iter().copied().collect());
    }
    found
}

/// Probability with which fluorescence excites again where it arrives: 1 where much of it comes back, less where that is next to
/// nothing beside what fluoresced once. Divided by it, the estimate stays unbiased.
pub(super) fn repeat_probability(
    materials: &PreparedMaterials,
    spectra: &[MaterialSpectra],
    lights: &Lights,
    operators: &[FluorescenceOperator],
) -> f32 {
    let mut emitted = vec![0.0_f32; operators.first().map_or(0, FluorescenceOperator::bands)];
    for exitance in lights.sources.iter().flat_map(|source| &source.exitance) {
        let mut own = vec![0.0; emitted.len()];
        bands::copy_bands(exitance, &mut own);
        emitted.iter_mut().zip(&own).for_each(|(sum, value)| *sum += value);
    }
    let total: f32 = emitted.iter().sum();
    if total <= 0.0 {
        return 1.0;
    }
    let of_matrix: Vec<f32> =
        operators.iter().map(|operator| operator.product(1.0 / total, &emitted).iter().sum()).collect();
    let of_material = |(material, spectra): (&PreparedMaterial, &MaterialSpectra)| -> f32 {
        let amounts = material.fluorophores.iter().zip(&spectra.emitters);
        amounts
            .map(|(amount, emitter)| {
                let states = if amount.in_tissue.is_some() { spectra.terms.len().max(1) } else { 1 };
                amount.concentration.max() * of_matrix[emitter.matrix] / states as f32
            })
            .sum()
    };
    let greatest = materials.iter().zip(spectra).map(of_material).fold(0.0, f32::max);
    (PROBABILITY_BY_YIELD * greatest).clamp(LEAST_REPEAT, 1.0)
}

#[cfg(test)]
mod tests {
    use fluorspar_accel::bands::{BLOCK, copy_bands, to_blocks};
    use fluorspar_accel::{Lanes, Simd, Work};

    use super::*;
    use crate::render::excitation::Choices;
    use crate::spectral::{Curve, PhotonEem, SeparableTerm, Stokes, WavelengthGrid};

    fn bell(center: f64, sd: f64) -> Curve {
        Curve::from_fn(200.0, 1000.0, |nm| (-0.5 * ((nm - center) / sd).powi(2)).exp())
    }

    fn operators(grid: &WavelengthGrid, light: &Curve) -> Vec<FluorescenceOperator> {
        let dye = |excitation: Curve, emission: Curve| {
            let emission = emission.scaled(0.01);
            let eem = PhotonEem::separable(vec![SeparableTerm { excitation, emission }], Stokes::Mask);
            FluorescenceOperator::new(&eem, grid, Some(light))
        };
        vec![dye(bell(370.0, 30.0), bell(460.0, 30.0)), dye(bell(410.0, 12.0), bell(635.0, 10.0))]
    }

    fn padded(grid: &WavelengthGrid, curve: &Curve) -> Vec<f64> {
        let mut values = curve.bin_averages(grid);
        values.resize(values.len().next_multiple_of(BLOCK), 0.0);
        values
    }

    /// What light excites through a matrix, projected `count` times: mean and standard error of each band.
    struct Excite<'a> {
        excitation: &'a Excitation,
        matrix: usize,
        light: &'a [BandBlock],
        count: u32,
    }

    impl Work for Excite<'_> {
        type Output = Vec<[f64; 2]>;

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Vec<[f64; 2]> {
            let mut sums = vec![[0.0; 2]; self.light.len() * BLOCK];
            for number in 0..self.count {
                let mut choices = Choices::new(u64::from(number));
                let mut rest = vec![BandBlock::ZERO; self.light.len()];
                let mut out = vec![BandBlock::ZERO; self.light.len()];
                let projected = self.excitation.project(lanes, self.light, &mut choices, &mut rest);
                self.excitation.add_excited(lanes, self.matrix, 1.0, (&projected, &rest), &mut out);
                for ([sum, squares], value) in sums.iter_mut().zip(doubles(&out)) {
                    *sum += value;
                    *squares += value * value;
                }
            }
            let count = f64::from(self.count);
            let error = |mean: f64, squares: f64| ((squares / count - mean * mean).max(0.0) / count).sqrt();
            sums.into_iter().map(|[sum, squares]| [sum / count, error(sum / count, squares)]).collect()
        }
    }

    #[test]
    fn reflected_light_excites_on_average_as_the_operator_says() {
        let grid = WavelengthGrid::default();
        let light = bell(395.0, 8.0);
        let tissue =
            |nm: f64| Curve::from_fn(200.0, 1000.0, move |at| 0.1 + 0.3 / (1.0 + ((at - nm) / 20.0).exp()));
        let known = [tissue(390.0), tissue(400.0), tissue(410.0), Curve::constant(0.5)];
        let terms = || known.iter().map(|term| padded(&grid, term));
        let excitation = excitation(operators(&grid, &light), &[padded(&grid, &light)], terms());
        // Products that the basis is made for, and light that nobody foresaw
        let product = light.times(&known[0]).times(&known[2]).times(&known[2]);
        for (light, is_foreseen) in [(product, true), (bell(402.0, 2.0), false)] {
            let blocks = to_blocks(&padded(&grid, &light).iter().map(|v| *v as f32).collect::<Vec<_>>());
            for (matrix, operator) in operators(&grid, &bell(395.0, 8.0)).iter().enumerate() {
                let mut single = vec![0.0; grid.len()];
                copy_bands(&blocks, &mut single);
                let exact = operator.product(1.0, &single);
                let peak = f64::from(exact.iter().copied().fold(0.0, f32::max));
                let found = Simd::detect().run(Excite {
                    excitation: &excitation,
                    matrix,
                    light: &blocks,
                    count: 20_000,
                });
                for (exact, [mean, error]) in exact.iter().zip(&found) {
                    let away = (mean - f64::from(*exact)).abs();
                    assert!(away <= 5.0 * error + 1e-5 * peak, "{matrix}: {exact} {mean} {error}");
                    // One choice scatters by little where the basis holds the light
                    assert!(
                        !is_foreseen || error * 20_000_f64.sqrt() <= 0.02 * peak,
                        "{matrix}: {error} of {peak}"
                    );
                }
            }
        }
    }
}
