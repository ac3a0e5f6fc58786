//! States of tissue as changes of its parameters.

use std::sync::Arc;

use super::chromophore::Chromophore;
use super::site::LayerAddition;
use crate::spectral::Curve;

/// A state of a [`super::Site`], a lesion for instance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TissueState {
    /// Name by which files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// What it is.
    pub description: String,
    /// Where directions and sizes of its changes come from.
    pub source: String,
    /// Parameters that it multiplies, with the factors.
    pub factors: Vec<(String, f64)>,
    /// Parameters that it sets, with the values.
    pub values: Vec<(String, f64)>,
    /// Absorption that it adds to layers, alike at all wavelengths, 1/mm: names of the layers, and how much.
    pub gray_per_mm: Vec<(String, f64)>,
}

impl TissueState {
    /// What it adds to layers, or a share of that.
    pub fn additions(&self, share: f64) -> impl Iterator<Item = LayerAddition> + '_ {
        self.gray_per_mm.iter().map(move |(layer, per_mm)| LayerAddition {
            layer: layer.clone(),
            absorption: vec![Chromophore::Curve {
                name: self.name.clone(),
                absorption_per_mm: Arc::new(Curve::constant(share * per_mm)),
            }],
            fluorophores: Vec::new(),
        })
    }
}
