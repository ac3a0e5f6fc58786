//! Spectra that a render keeps apart in place of the spectrum of a light: its excitation bins, of which light spectra are
//! made up that are in proportion to it within each, or the hats of excitation nodes, of which any are.

use crate::render::RenderSettings;
use crate::scene::Scene;
use crate::spectral::Curve;

/// What the spectra of the lights of a scene are taken apart into.
pub(super) struct Slicing<'a> {
    settings: &'a RenderSettings,
    /// Integral of the spectrum of the first light of each group: that of the unit hats.
    totals: Vec<f64>,
}

/// A spectrum that is kept apart.
#[derive(Clone)]
pub(super) struct Slice {
    pub(super) curve: Curve,
    /// Whether it is the hat of a node: dark outside of a few bands.
    pub(super) is_hat: bool,
}

impl<'a> Slicing<'a> {
    pub(super) fn new(scene: &Scene, settings: &'a RenderSettings) -> Self {
        let total = |group| scene.group_spectra(group).first().map_or(0.0, |spectrum| spectrum.total());
        Self { settings, totals: (0..scene.light_groups.len()).map(total).collect() }
    }

    /// Spectra that are kept apart of a light group.
    pub(super) fn count(&self, group: usize) -> usize {
        self.settings.slices(group)
    }

    /// Number of the first of them.
    pub(super) fn first(&self, group: usize) -> usize {
        self.settings.first_slice(group)
    }

    /// The spectra in place of that of a light of a group.
    pub(super) fn slices(&self, group: usize, curve: &Curve) -> Vec<Slice> {
        let bins = excitation_slices(curve, &self.settings.excitation_edges_nm);
        let mut slices: Vec<Slice> = bins.into_iter().map(|curve| Slice { curve, is_hat: false }).collect();
        if let Some(nodes) = self.settings.nodes_of(group) {
            let factor = if self.totals[group] > 0.0 { curve.total() / self.totals[group] } else { 0.0 };
            let hat = |node| Slice { curve: nodes.hat(node).scaled(factor), is_hat: true };
            slices.extend((0..nodes.len()).map(hat));
        }
        slices
    }
}

/// A light spectrum cut at the edges, then what lies outside of them; their sum is the spectrum.
fn excitation_slices(curve: &Curve, edges_nm: &[f64]) -> Vec<Curve> {
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
