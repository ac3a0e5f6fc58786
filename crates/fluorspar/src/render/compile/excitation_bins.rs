//! Light spectra cut into excitation bins, which are kept apart so that other light spectra can be made up from them.

use crate::spectral::Curve;

/// A light spectrum cut at the edges, then what lies outside of them; their sum is the spectrum.
pub(super) fn excitation_slices(curve: &Curve, edges_nm: &[f64]) -> Vec<Curve> {
    let [first, .., last] = edges_nm else { return vec![curve.clone()] };
    let mut slices: Vec<Curve> = edges_nm.windows(2).map(|edges| curve.clipped(edges[0], edges[1])).collect();
    let (low, high) = curve.range_nm();
    let mut nodes: Vec<(f64, f64)> = Vec::new();
    // Zero between two steep flanks: a curve can't jump.
    const FLANK_NM: f64 = 1e-6;
    for (start, end) in [(low, last.min(*first)), (first.max(*last), high)] {
        if start < end {
            let part = curve.clipped(start, end);
            nodes.push((start - FLANK_NM, 0.0));
            nodes.extend(part.wavelengths_nm().iter().copied().zip(part.values().iter().copied()));
            nodes.push((end + FLANK_NM, 0.0));
        }
    }
    let (wavelengths, values) = nodes.into_iter().unzip();
    slices.push(Curve::new(wavelengths, values).unwrap_or_else(|_| curve.scaled(0.0)));
    slices
}
