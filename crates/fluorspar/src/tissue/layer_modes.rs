//! One layer in discrete ordinates: its modes, and what it reflects and transmits.

use std::rc::Rc;

use nalgebra::{DMatrix, SymmetricEigen};

use super::angular_quadrature::{Ordinate, cosine, legendre_series};
use super::optical_layer::OpticalLayer;

/// Modes of a layer.
///
/// With `x = sqrt(n^2 mu w) I / n^2` for each direction, sums `S` and differences `D` of the downward and the upward `x` obey
/// `S' = -G1 D`, `D' = -G2 S`; both matrices are symmetric. From `G1 = L L^T` and the eigenvectors `Q` of `L^T G2 L`, whose
/// eigenvalues are `k^2`, follow `A = L Q` and `B = L^-T Q` with `S = A q`, `D = -B q'` and `q'' = k^2 q`. Layers that do not
/// absorb have a `k` of 0; nothing here divides by it. (Stamnes et al., Appl. Opt. 27, 2502, 1988; the symmetric form:
/// Nakajima and Tanaka, J. Quant. Spectrosc. Radiat. Transfer 35, 13, 1986.)
pub(super) struct LayerModes {
    /// Cosines of the directions in this layer.
    pub(super) cosines: Vec<f64>,
    /// `A`.
    pub(super) sums: DMatrix<f64>,
    /// `B`.
    pub(super) differences: DMatrix<f64>,
    /// `k`, 1/mm.
    pub(super) decay_per_mm: Vec<f64>,
    /// Reflection of the layer alone, from either side.
    pub(super) reflection: DMatrix<f64>,
    /// Transmission of the layer alone.
    pub(super) transmission: DMatrix<f64>,
    /// How the layer scatters.
    pub(super) phase: PhaseFunction,
}

/// The phase function with its forward peak taken as unscattered (delta-M; Wiscombe, J. Atmos. Sci. 34, 1408, 1977).
pub(super) struct PhaseFunction {
    /// Scattering coefficient without the forward peak, 1/mm.
    pub(super) scattering_per_mm: f64,
    /// Absorption and scattering without the forward peak, 1/mm.
    pub(super) extinction_per_mm: f64,
    /// Legendre moments `(g^l - f) / (1 - f)` with `f = g^moments`.
    pub(super) moments: Vec<f64>,
}

impl PhaseFunction {
    fn new(layer: &OpticalLayer, number: usize) -> Self {
        let g = layer.anisotropy;
        let peak = g.powi(number as i32);
        let scattering_per_mm = layer.scattering_per_mm * (1.0 - peak);
        Self {
            scattering_per_mm,
            // Clear layers attenuate by 1e-10, so that their modes exist.
            extinction_per_mm: (layer.absorption_per_mm + scattering_per_mm).max(1e-10 / layer.thickness_mm),
            moments: (0..number).map(|l| (g.powi(l as i32) - peak) / (1.0 - peak)).collect(),
        }
    }
}

/// Modes of the layers that stacks have in common: most of the work of a solution.
#[derive(Default)]
pub(super) struct KnownModes(Vec<(OpticalLayer, Vec<Ordinate>, Rc<LayerModes>)>);

impl KnownModes {
    /// [`LayerModes::new`], of each layer once.
    pub(super) fn of(&mut self, layer: &OpticalLayer, ordinates: &[Ordinate]) -> Option<Rc<LayerModes>> {
        let found = self.0.iter().find(|(known, along, _)| known == layer && along == ordinates);
        if let Some((_, _, modes)) = found {
            return Some(modes.clone());
        }
        let modes = Rc::new(LayerModes::new(layer, ordinates)?);
        self.0.push((*layer, ordinates.to_vec(), modes.clone()));
        Some(modes)
    }
}

/// Legendre moments that a number of directions resolves: more of them alias, as the directions are not Gauss nodes in the
/// cosine of the layer. (Three moments for two directions converge fastest; four converge as slowly as Gauss nodes do.)
fn moments(directions: usize) -> usize {
    2 * (3 * directions / 4)
}

impl LayerModes {
    /// None where the phase function is too narrow for so few directions.
    fn new(layer: &OpticalLayer, ordinates: &[Ordinate]) -> Option<Self> {
        let number = ordinates.len();
        let index = layer.refractive_index;
        let cosines: Vec<f64> = ordinates.iter().map(|o| cosine(o.lateral, index)).collect();
        let phase = PhaseFunction::new(layer, moments(number));
        let [g1, g2] = transport_matrices(&phase, ordinates, &cosines, index);
        let lower = g1.cholesky()?.unpack();
        let product = lower.tr_mul(&(&g2 * &lower));
        let eigen = SymmetricEigen::new(0.5 * (&product + product.transpose()));
        let decay_per_mm: Vec<f64> = eigen.eigenvalues.iter().map(|v| v.max(0.0).sqrt()).collect();
        let sums = &lower * &eigen.eigenvectors;
        let mut differences = eigen.eigenvectors;
        if !lower.tr_solve_lower_triangular_mut(&mut differences) {
            return None;
        }
        let [reflection, transmission] =
            slab_response(&sums, &differences, &decay_per_mm, layer.thickness_mm)?;
        Some(Self { cosines, sums, differences, decay_per_mm, reflection, transmission, phase })
    }
}

/// `G1` and `G2` of [`LayerModes`].
///
/// Quadratures that are not exact for all products of Legendre polynomials lose or gain scattered light. What is lost is
/// taken as scattered straight ahead, so that every direction keeps its light.
fn transport_matrices(
    phase: &PhaseFunction,
    ordinates: &[Ordinate],
    cosines: &[f64],
    index: f64,
) -> [DMatrix<f64>; 2] {
    let number = ordinates.len();
    let mut matrices = scattering_matrices(phase, ordinates, cosines, index);
    for i in 0..number {
        let kept: f64 = (0..number)
            .map(|j| {
                let share = (ordinates[j].etendue / ordinates[i].etendue).sqrt() * cosines[i];
                -matrices[1][(i, j)] * share
            })
            .sum();
        let straight_ahead = phase.scattering_per_mm - kept;
        for matrix in &mut matrices {
            matrix[(i, i)] += (phase.extinction_per_mm - straight_ahead) / cosines[i];
        }
    }
    matrices
}

/// What [`transport_matrices`] hold of light that is scattered, by [odd, even] degrees of the phase function.
fn scattering_matrices(
    phase: &PhaseFunction,
    ordinates: &[Ordinate],
    cosines: &[f64],
    index: f64,
) -> [DMatrix<f64>; 2] {
    let number = ordinates.len();
    // Rows of a degree: sqrt(2 l + 1) P_l(mu) sqrt(w / mu), plain and times the scattering by its moment.
    let mut plain = [DMatrix::zeros(number, number), DMatrix::zeros(number, number)];
    let mut scattered = plain.clone();
    for (i, (ordinate, &mu)) in ordinates.iter().zip(cosines).enumerate() {
        let scale = ordinate.etendue.sqrt() / (index * mu);
        let series = legendre_series(phase.moments.len(), mu);
        for (l, (polynomial, moment)) in series.iter().zip(&phase.moments).enumerate() {
            let value = (2.0 * l as f64 + 1.0).sqrt() * polynomial * scale;
            plain[1 - l % 2][(l / 2, i)] = value;
            scattered[1 - l % 2][(l / 2, i)] = value * moment * phase.scattering_per_mm;
        }
    }
    [0, 1].map(|parity| -plain[parity].tr_mul(&scattered[parity]))
}

/// Reflection and transmission of a layer between media that reflect nothing.
///
/// Light that falls equally on both sides has `D = Y S` at the top with `Y = B k tanh(k h / 2) B^T`; opposite light has
/// `S = Z D` with `Z = A tanh(k h / 2) / k A^T`. So `R + T = 2 (1 + Y)^-1 - 1` and `R - T = 1 - 2 (1 + Z)^-1`: bounded for any
/// thickness, and no exponential grows.
fn slab_response(
    sums: &DMatrix<f64>,
    differences: &DMatrix<f64>,
    decay_per_mm: &[f64],
    thickness_mm: f64,
) -> Option<[DMatrix<f64>; 2]> {
    let (mut even, mut odd) = (differences.clone(), sums.clone());
    for (j, &k) in decay_per_mm.iter().enumerate() {
        let half = 0.5 * k * thickness_mm;
        let tanh = half.tanh();
        even.column_mut(j).scale_mut(k * tanh);
        odd.column_mut(j).scale_mut(if half > 1e-8 { tanh / k } else { 0.5 * thickness_mm });
    }
    let one = DMatrix::identity(sums.nrows(), sums.nrows());
    let even = (even * differences.transpose() + &one).cholesky()?.inverse();
    let odd = (odd * sums.transpose() + &one).cholesky()?.inverse();
    Some([&even - &odd, &even + &odd - one])
}
