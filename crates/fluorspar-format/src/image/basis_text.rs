//! Spectral bases of components in the headers of files.

use base64::prelude::{BASE64_STANDARD, Engine};
use fluorspar::image::SpectralBasis;
use serde::{Deserialize, Serialize};

/// A basis as JSON.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BasisText {
    /// `[band]`, little-endian 32-bit floats in Base64: a coefficient is the sum of all bands times its spectrum times these weights.
    weights: String,
    /// `[coefficient][band]`, likewise: what a coefficient of 1 adds to the spectrum.
    spectra: String,
    /// Error of the worst spectrum that it was made for, relative to it.
    error: f32,
}

impl BasisText {
    pub(crate) fn of(basis: &SpectralBasis) -> Self {
        let [weights, spectra] = [basis.weights(), basis.spectra()].map(floats_to_text);
        Self { weights, spectra, error: basis.error() }
    }

    /// The basis of an image of so many bands; `None` where the text is damaged.
    pub(crate) fn basis(self, bands: usize) -> Option<SpectralBasis> {
        let weights = floats_of_text(&self.weights).filter(|weights| weights.len() == bands)?;
        SpectralBasis::new(floats_of_text(&self.spectra)?, weights, self.error)
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
