//! Spectra that a render keeps apart in place of the spectrum of a light: its excitation bins, of which light spectra are
//! made up that are in proportion to it within each, or the hats of excitation nodes, of which any are.

use crate::render::RenderSettings;
use crate::scene::Scene;
use crate::spectral::{Curve, ExcitationNodes};

/// What the spectra of the lights of a scene are taken apart into.
pub(super) struct Slicing<'a> {
    settings: &'a RenderSettings,
    /// Integral of the spectrum of the first light of each group: that of the unit hats.
    totals: Vec<f64>,
}

impl<'a> Slicing<'a> {
    pub(super) fn new(scene: &Scene, settings: &'a RenderSettings) -> Self {
        let total = |group| scene.group_spectra(group).first().map_or(0.0, |spectrum| spectrum.total());
        Self { settings, totals: (0..scene.light_groups.len()).map(total).collect() }
    }

    /// Spectra that are kept apart of all groups.
    pub(super) fn all(&self) -> usize {
        self.settings.first_slice(self.totals.len())
    }

    /// Spectra that are kept apart of a light group.
    pub(super) fn count(&self, group: usize) -> usize {
        self.settings.slices(group)
    }

    /// Excitation bins of a light group, which come before its nodes.
    pub(super) fn bins(&self, group: usize) -> usize {
        self.count(group) - self.nodes_of(group).map_or(0, ExcitationNodes::len)
    }

    /// Excitation nodes of a light group that has some.
    pub(super) fn nodes_of(&self, group: usize) -> Option<&'a ExcitationNodes> {
        self.settings.nodes_of(group)
    }

    /// Factor on the hats of a light of a group with this spectrum: they are for the first light.
    pub(super) fn hat_factor(&self, group: usize, curve: &Curve) -> f64 {
        if self.totals[group] > 0.0 { curve.total() / self.totals[group] } else { 0.0 }
    }

    /// Number of the first of them.
    pub(super) fn first(&self, group: usize) -> usize {
        self.settings.first_slice(group)
    }

    /// The excitation bins in place of the spectrum of a light.
    pub(super) fn slices(&self, curve: &Curve) -> Vec<Curve> {
        excitation_slices(curve, &self.settings.excitation_edges_nm)
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
