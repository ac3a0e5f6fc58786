//! Tissues by themselves: solved, looked into, traced and fitted.

mod depth;
mod fit;
mod fit_files;
mod monte_carlo;
mod monte_carlo_files;
mod solve;
mod solve_files;
mod source;

pub use depth::{DepthOptions, LightOrigin, LightOrigins, depth};
pub use fit::{TissueFitOptions, fit};
pub use fit_files::FittedTissue;
pub use monte_carlo::{MonteCarloOptions, TracedEmission, TracedTissue, monte_carlo};
pub use solve::{
    OwnAbsorption, SolveOptions, SolvedFluorescence, SolvedTissue, TissueEem, TissueEmitter, solve,
};
pub use source::{SiteOptions, TissueOptions, find, site_named};
