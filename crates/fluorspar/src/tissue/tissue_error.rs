//! Errors of descriptions of tissue.

use thiserror::Error;

use crate::names::did_you_mean;
use crate::quote::excerpt;
use crate::units::number_text;

/// A description of tissue that cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum TissueError {
    /// A number outside its range.
    #[error(
        "{place}: {quantity} is {}, outside {} to {}; {hint}",
        number_text(*value),
        number_text(range[0]),
        number_text(range[1])
    )]
    OutOfRange {
        /// Where: `layer 2`, `layer 'epithelium'`.
        place: String,
        /// Which number, with its unit in its name: `absorption_per_mm`.
        quantity: &'static str,
        /// The number.
        value: f64,
        /// Smallest and largest that is allowed.
        range: [f64; 2],
        /// How to fix it.
        hint: &'static str,
    },
    /// No layer at all.
    #[error("a tissue needs at least one layer; give the uppermost first")]
    NoLayers,
    /// Two layers of one name.
    #[error("two layers are named '{name}'; give each its own name")]
    NameTwice {
        /// The name.
        name: String,
    },
    /// The wavelength of a strength does not excite the fluorophore.
    #[error(
        "{place}: the fluorophore is not excited at {} nm, where its strength is given; choose a wavelength within its \
         excitation",
        number_text(*at_nm)
    )]
    NotExcited {
        /// Layer and fluorophore.
        place: String,
        /// The wavelength, nm.
        at_nm: f64,
    },
    /// A layer that emits more photons than it absorbs.
    #[error(
        "layer '{layer}', fluorophore '{fluorophore}': under {} nm the layer emits {} photons per mm and photon, but absorbs {}; \
         give the fluorophore a smaller strength, or its quantum_yield, with which its own absorption comes",
        number_text(*nm),
        three_digits(*emitted_per_mm),
        three_digits(*absorbed_per_mm)
    )]
    GainsPhotons {
        /// The layer.
        layer: String,
        /// The strongest fluorophore of those that bring no absorption.
        fluorophore: String,
        /// Excitation, nm.
        nm: f64,
        /// Photons emitted per mm of path of a photon.
        emitted_per_mm: f64,
        /// Absorption coefficient, 1/mm.
        absorbed_per_mm: f64,
    },
    /// A layer that a site does not have.
    #[error(
        "tissue '{site}' has no layer '{}'{} It has {}",
        excerpt(name),
        did_you_mean(name, known.iter().copied()),
        known.join(", ")
    )]
    NoSuchSiteLayer {
        /// The site.
        site: String,
        /// The name.
        name: String,
        /// The names that there are.
        known: &'static [&'static str],
    },
    /// A layer too thin for what was added to it.
    #[error("layer '{name}' is thinner than 0.1 um and holds nothing; make it thicker")]
    ThinLayer {
        /// The layer.
        name: String,
    },
    /// A parameter that a site does not have.
    #[error(
        "tissue '{site}' has no parameter '{}'{} It has {}",
        excerpt(name),
        did_you_mean(name, known.iter().copied()),
        known.join(", ")
    )]
    NoSuchParameter {
        /// The site.
        site: String,
        /// The name.
        name: String,
        /// The names that there are.
        known: Vec<&'static str>,
    },
    /// A state of another kind of tissue.
    #[error("tissue '{site}' has no '{changed}': the state '{state}' is one of {kind}")]
    StateOfOtherTissue {
        /// The site.
        site: String,
        /// The state.
        state: String,
        /// A parameter or a layer that it changes.
        changed: String,
        /// What can have the state.
        kind: &'static str,
    },
    /// Parameters without values.
    #[error("tissue '{site}' lacks values of {}; give every parameter one", missing.join(", "))]
    MissingParameters {
        /// The site.
        site: String,
        /// The parameters.
        missing: Vec<&'static str>,
    },
    /// Two values of one parameter.
    #[error("tissue '{site}' gives {name} twice; remove one of the values")]
    ParameterTwice {
        /// The site.
        site: String,
        /// The parameter.
        name: String,
    },
    /// A fluorophore of a site that was not found.
    #[error("tissue '{site}' holds the fluorophore '{name}', which was not found")]
    NoSuchFluorophore {
        /// The site.
        site: String,
        /// The fluorophore.
        name: String,
    },
    /// Wavelengths that cannot be solved for.
    #[error("give two wavelengths or more, rising, within 200 to 1200 nm")]
    Wavelengths,
    /// A fluorophore or a layer that the tissue does not have.
    #[error("the tissue has no such fluorophore in such a layer")]
    NoSuchPart,
    /// Too few directions for a narrow phase function.
    #[error(
        "{}the light cannot be solved with so few directions; use more nodes per hemisphere or an anisotropy nearer to 0",
        layer.map_or_else(String::new, |number| format!("layer {number}: "))
    )]
    Unsolvable {
        /// Number of the layer, from 1, where it is known.
        layer: Option<usize>,
    },
    /// A layer to watch that is not there.
    #[error("the error target names layer {}, but there are {layers}", layer + 1)]
    NoSuchLayer {
        /// Layer asked for, counted from zero.
        layer: usize,
        /// Layers that there are.
        layers: usize,
    },
    /// An error target on fluorescence in a simulation without.
    #[error("the error target is on fluorescence, but none is simulated; watch the reflectance instead")]
    NoFluorescence,
    /// More bins than memory is meant for.
    #[error(
        "{bins} bins of depth and radius are more than {most}; make the steps wider or the limits smaller"
    )]
    TooManyBins {
        /// Bins asked for.
        bins: usize,
        /// The most.
        most: usize,
    },
    /// Stopped before there was any result.
    #[error("interrupted before the first photons were traced")]
    Interrupted,
    /// Optics of excitation and emission that belong to different tissues.
    #[error("excitation and emission need the same layers: give stacks with the same thicknesses")]
    LayersDiffer,
    /// Not one strength a layer.
    #[error(
        "{strengths} fluorophore strengths for {layers} layers; give one for each, 0 where there is none"
    )]
    StrengthsDiffer {
        /// Strengths given.
        strengths: usize,
        /// Layers that there are.
        layers: usize,
    },
    /// Fluences on different slices.
    #[error("the fluences of excitation and emission are on different slices; use the same grid for both")]
    SlicesDiffer,
    /// Two fluences whose errors depend on each other.
    #[error(
        "excitation and emission have the same seed {seed}, so their errors are not independent; change one"
    )]
    SameSeed {
        /// The seed of both.
        seed: u64,
    },
    /// Reciprocity needs the fluence of even diffuse light.
    #[error("reciprocity needs the emission wavelength simulated under Lambertian light")]
    EmissionNotLambertian,
}

fn three_digits(value: f64) -> String {
    number_text(format!("{value:.2e}").parse().unwrap_or(value))
}

/// Refuses a number outside a range, ends included, and NaN.
pub(super) fn check(
    place: &str,
    quantity: &'static str,
    value: f64,
    range: [f64; 2],
    hint: &'static str,
) -> Result<(), TissueError> {
    if (range[0]..=range[1]).contains(&value) {
        return Ok(());
    }
    Err(TissueError::OutOfRange { place: place.to_string(), quantity, value, range, hint })
}
