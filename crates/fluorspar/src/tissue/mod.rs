//! Layered tissue: light in plane layers that absorb, scatter and fluoresce.
//!
//! | type | what it is |
//! |---|---|
//! | [`LayeredTissue`], [`TissueLayer`] | thickness, [`LayerScattering`], [`Chromophore`]s and [`TissueFluorophore`]s of each layer |
//! | [`Site`], [`SiteParameters`], [`TissueState`] | tissues as parameters that may be changed, and their states |
//! | [`Population`], [`Variation`] | how a site varies among people and within a person, and tissues drawn from it |
//! | [`EffectiveTissue`] | reflectance and fluorescence of a tissue as of a surface, by layer and fluorophore; depths |
//! | [`CachedSolutions`], [`SolutionStore`] | solved tissues that are kept from one run to the next |
//! | [`radial_profiles`], [`TissueProfiles`] | how far from where it enters light leaves, reflected and after fluorescence |
//! | [`OpticalLayer`], [`OpticalStack`] | plane layers at one wavelength, what solvers start from |
//! | [`DiscreteOrdinates`], [`LightField`] | the deterministic solver, and the light that it finds |
//! | [`fit`] | parameters of a tissue from measured spectra, with intervals; spectra under other lights |
//! | [`monte_carlo`] | photons traced: any refractive indices, light that spreads sideways, fluorescence, standard errors |
//!
//! Lengths are in mm or um and coefficients in 1/mm, as the names say.

pub mod fit;
pub mod monte_carlo;

mod angular_quadrature;
mod beam_source;
mod cached_solutions;
mod chromophore;
mod depth_quadrature;
mod discrete_ordinates;
#[cfg(test)]
mod discrete_ordinates_tests;
mod effective_tissue;
#[cfg(test)]
mod effective_tissue_tests;
mod fresnel_interface;
mod layer_modes;
mod layered_tissue;
mod light_field;
mod low_rank;
mod optical_layer;
mod population;
mod radial_mixture;
mod radial_profile;
#[cfg(test)]
mod radial_profile_tests;
mod scattering;
mod site;
mod site_layers;
mod site_parameter;
#[cfg(test)]
pub(crate) mod site_tests;
mod surroundings;
mod tissue_error;
mod tissue_state;

pub use cached_solutions::{CachedSolutions, SolutionStore};
pub use chromophore::{Blood, Chromophore};
pub use discrete_ordinates::{DiscreteOrdinates, Incidence};
pub use effective_tissue::{COMPRESSION_ERROR, DepthProfile, EffectiveTissue, LayerFluorophore, Level};
pub use fresnel_interface::{diffuse_reflectance, fresnel_reflectance};
pub use layered_tissue::{Below, LayeredTissue, TissueFluorophore, TissueLayer};
pub use light_field::LightField;
pub use optical_layer::{
    ANISOTROPY, COEFFICIENT_PER_MM, OpticalLayer, OpticalStack, REFRACTIVE_INDEX, THICKNESS_MM,
};
pub use population::{Population, Spread, Variation};
pub use radial_mixture::{GAUSSIANS, density_per_mm2, gaussian_mm};
pub(crate) use radial_profile::{EMITTED_NM, PHOTONS};
pub use radial_profile::{EXCITATIONS_NM, RadialProfile, TissueProfiles, radial_profiles};
pub use scattering::{LayerScattering, ScatteringCoefficient};
pub use site::{LayerAddition, Site, SiteDescription, SiteParameters, SiteStructure, SiteValue};
pub use site_parameter::{Basis, MucosaParameters, SiteParameter, ToothParameters};
pub use surroundings::Surroundings;
pub use tissue_error::TissueError;
pub use tissue_state::TissueState;
