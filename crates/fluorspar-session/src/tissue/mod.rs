//! Tissues by themselves: solved, swept, looked into, traced and fitted.

mod depth;
mod fit;
mod fit_files;
mod monte_carlo;
mod monte_carlo_files;
mod solve;
mod solve_files;
mod source;
mod sweep;
mod sweep_files;

pub use depth::{DepthOptions, LightOrigin, LightOrigins, depth};
pub use fit::{TissueFitOptions, fit};
pub use fit_files::FittedTissue;
pub use monte_carlo::{MonteCarloOptions, TracedEmission, TracedTissue, monte_carlo};
pub use solve::{
    OwnAbsorption, SolveOptions, SolvedFluorescence, SolvedTissue, TissueEem, TissueEmitter, solve,
};
pub use source::{SiteOptions, TissueOptions, find, site_named};
pub use sweep::{SweptPoint, SweptTissue, TissueSweepOptions, sweep};
pub use sweep_files::sweep_table;
