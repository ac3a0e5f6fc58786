//! Spectral bases of components in the headers of files.

use base64::prelude::{BASE64_STANDARD, Engine};
use fluorspar::image::{Projection, SpectralBasis};
use serde::{Deserialize, Serialize};

/// A basis as JSON.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BasisText {
    /// Bands that the coefficients are, ascending, from 0, in files of earlier programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    stored: Option<Vec<usize>>,
    /// `[band]`, little-endian 32-bit floats in Base64: a coefficient is the sum of all bands times its spectrum times these weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    weights: Option<String>,
    /// `[coefficient][band]`, likewise: what a coefficient of 1 adds to the spectrum.
    spectra: String,
    /// Error of the worst spectrum that it was made for, relative to it.
    error: f32,
}

impl BasisText {
    pub(crate) fn of(basis: &SpectralBasis) -> Self {
        let (stored, weights) = match basis.projection() {
            Projection::Bands(stored) => (Some(stored.clone()), None),
            Projection::Weights(weights) => (None, Some(floats_to_text(weights))),
        };
        Self { stored, weights, spectra: floats_to_text(basis.spectra()), error: basis.error() }
    }

    /// Whether coefficients are sums of all bands.
    pub(crate) fn has_weights(&self) -> bool {
        self.weights.is_some()
    }

    /// The basis of an image of so many bands; `None` where the text is damaged.
    pub(crate) fn basis(self, bands: usize) -> Option<SpectralBasis> {
        let projection = match (self.stored, self.weights) {
            (Some(stored), None) => Projection::Bands(stored),
            (None, Some(weights)) => Projection::Weights(floats_of_text(&weights)?),
            _ => return None,
        };
        SpectralBasis::new(floats_of_text(&self.spectra)?, projection, bands, self.error)
    }
}

/// Floats as little-endian bytes in Base64.
pub(crate) fn floats_to_text(values: &[f32]) -> String {
    BASE64_STANDARD.encode(values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
}

/// The opposite of [`floats_to_text`]; `None` where the text is damaged.
pub(crate) fn floats_of_text(text: &str) -> Option<Vec<f32>> {
    let bytes = BASE64_STANDARD.decode(text).ok()?;
    let (floats, rest) = bytes.as_chunks::<4>();
    rest.is_empty().then(|| floats.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
}
