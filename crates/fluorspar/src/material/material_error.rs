//! Errors of unphysical material parameters.

use thiserror::Error;

use super::texture::ScalarTexture;
use crate::units::number_text;

/// A parameter of a material out of its range.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MaterialError {
    /// A share or a roughness above 1.
    #[error("the {parameter} reaches {value}, more than 1")]
    AboveOne {
        /// Which parameter.
        parameter: &'static str,
        /// Its largest value.
        value: f32,
    },
    /// An index of refraction that the layer or body can't have.
    #[error("the refractive index {value} of the {layer} is not {range}")]
    RefractiveIndex {
        /// "coat" or "dielectric".
        layer: &'static str,
        /// The index.
        value: f32,
        /// What is allowed.
        range: &'static str,
    },
    /// A length that no film evens out.
    #[error("the film evens out relief over {} m: give 0, or at least 1e-5", number_text((*.0).into()))]
    FilmSmoothing(f32),
    /// A transmittance beyond 0 to 1.
    #[error("the transmittance {} is not between 0 and 1", number_text(*.0))]
    Transmittance(f64),
    /// A refractive index of a metal that does not cover the bands of the render.
    #[error(
        "{parameter} of the metal is known from {first_nm} to {last_nm} nm, but the wavelengths run from {start_nm} to \
         {end_nm} nm; give a wider table or fewer wavelengths"
    )]
    MetalRange {
        /// "n" or "k".
        parameter: &'static str,
        /// First wavelength of the data, nm.
        first_nm: f64,
        /// Last wavelength of the data, nm.
        last_nm: f64,
        /// Start of the bands, nm.
        start_nm: f64,
        /// End of the bands, nm.
        end_nm: f64,
    },
    /// A refractive index that no metal has.
    #[error(
        "{parameter} of the metal is {}; it must be between {} and 1000",
        number_text(*value),
        number_text(*least)
    )]
    MetalValue {
        /// "n" or "k".
        parameter: &'static str,
        /// The value.
        value: f64,
        /// The smallest that is allowed.
        least: f64,
    },
    /// States of a tissue that do not fit their parameters or their fluorophores.
    #[error("the states of the tissue: {0}")]
    States(String),
    /// Fluorophores where there is no surface of its own.
    #[error("a mixture has no fluorophores of its own; give them to its parts")]
    FluorophoresOfMixture,
}

/// Refuses a texture that exceeds 1 somewhere.
pub(super) fn at_most_one(parameter: &'static str, texture: &ScalarTexture) -> Result<(), MaterialError> {
    let value = texture.max();
    if value <= 1.0 { Ok(()) } else { Err(MaterialError::AboveOne { parameter, value }) }
}
