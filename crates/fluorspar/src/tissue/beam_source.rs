//! Light of a collimated beam, and what a layer scatters out of it.

use std::f64::consts::PI;

use nalgebra::DVector;

use super::angular_quadrature::{Ordinate, legendre_series};
use super::layer_modes::LayerModes;

/// A beam of unit flux that enters a layer at its top, and the light that the layer scatters out of it.
///
/// `p' = -k^2 q + A^T j_S e^(-b z)` and `q' = -p + B^T j_D e^(-b z)` in the notation of [`LayerModes`], where `b` is the
/// extinction of the beam along the depth. The particular solution is the one with `q(0) = 0`: it stays finite where `b`
/// meets a `k`.
pub(super) struct BeamSource {
    /// Cosine of the beam in the layer.
    pub(super) cosine: f64,
    /// `b`, 1/mm.
    pub(super) decay_per_mm: f64,
    /// For each mode: `A^T j_S + b B^T j_D`.
    drive: Vec<f64>,
    /// For each mode: `B^T j_D`.
    difference: Vec<f64>,
    /// Light that leaves at the top.
    pub(super) up: DVector<f64>,
    /// Light that leaves at the bottom, without the beam.
    pub(super) down: DVector<f64>,
}

impl BeamSource {
    pub(super) fn new(modes: &LayerModes, ordinates: &[Ordinate], index: f64, cosine: f64, mm: f64) -> Self {
        let number = ordinates.len();
        let phase = &modes.phase;
        let beam = legendre_series(phase.moments.len(), cosine);
        let mut sums = DVector::zeros(number);
        let mut differences = DVector::zeros(number);
        let mut scattered_per_mm = 0.0;
        for (i, (ordinate, &mu)) in ordinates.iter().zip(&modes.cosines).enumerate() {
            let series = legendre_series(phase.moments.len(), mu);
            let mut parity = [0.0, 0.0];
            for (l, moment) in phase.moments.iter().enumerate() {
                parity[l % 2] += (2.0 * l as f64 + 1.0) * moment * series[l] * beam[l];
            }
            let root = ordinate.etendue.sqrt();
            let scale = 2.0 * phase.scattering_per_mm / (4.0 * PI * cosine) * root / (index * index * mu);
            sums[i] = scale * parity[0];
            differences[i] = scale * parity[1];
            scattered_per_mm += ordinate.etendue / (index * index * mu) * parity[0] * phase.scattering_per_mm;
        }
        // As in the diffuse light, what the quadrature loses goes straight ahead.
        let straight_ahead = phase.scattering_per_mm - scattered_per_mm;
        let decay_per_mm = (phase.extinction_per_mm - straight_ahead) / cosine;
        let sums = modes.sums.tr_mul(&sums);
        let difference = modes.differences.tr_mul(&differences);
        let drive = (&sums + decay_per_mm * &difference).iter().copied().collect();
        let none = DVector::zeros(number);
        let difference = difference.iter().copied().collect();
        let mut source = Self { cosine, decay_per_mm, drive, difference, up: none.clone(), down: none };
        let [top, bottom] = [0.0, mm].map(|z| source.particular(modes, z));
        let out = |inside: &(DVector<f64>, DVector<f64>), sign: f64| 0.5 * (&inside.0 + sign * &inside.1);
        let (down_top, up_top, down_bottom, up_bottom) =
            (out(&top, 1.0), out(&top, -1.0), out(&bottom, 1.0), out(&bottom, -1.0));
        let (r, t) = (&modes.reflection, &modes.transmission);
        source.up = up_top - r * &down_top - t * &up_bottom;
        source.down = down_bottom - t * &down_top - r * &up_bottom;
        source
    }

    /// Share of the beam that reaches the other side.
    pub(super) fn transmittance(&self, thickness_mm: f64) -> f64 {
        (-self.decay_per_mm * thickness_mm).exp()
    }

    /// `q` of a mode at a depth is this factor times [`difference_quotient`].
    pub(super) fn amplitude(&self, mode: usize, k: f64) -> f64 {
        self.drive[mode] / (k + self.decay_per_mm)
    }

    /// `S` and `D` of the particular solution at a depth, mm.
    pub(super) fn particular(&self, modes: &LayerModes, z: f64) -> (DVector<f64>, DVector<f64>) {
        let number = self.drive.len();
        let (mut q, mut p) = (DVector::zeros(number), DVector::zeros(number));
        for (j, &k) in modes.decay_per_mm.iter().enumerate() {
            let quotient = difference_quotient(self.decay_per_mm, k, z);
            q[j] = self.amplitude(j, k) * quotient;
            let slope = self.amplitude(j, k) * ((-k * z).exp() - self.decay_per_mm * quotient);
            p[j] = self.difference[j] * (-self.decay_per_mm * z).exp() - slope;
        }
        (&modes.sums * q, &modes.differences * p)
    }
}

/// `(e^(-b z) - e^(-k z)) / (k - b)`, also where `b` and `k` meet.
pub(super) fn difference_quotient(b: f64, k: f64, z: f64) -> f64 {
    let (low, high) = (b.min(k), b.max(k));
    let x = (high - low) * z;
    let mean = if x < 1e-12 { 1.0 } else { -(-x).exp_m1() / x };
    (-low * z).exp() * z * mean
}
