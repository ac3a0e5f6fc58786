//! Design of lights, filters and sensors: what a camera could prove, before it is built.
//!
//! | step | type or call | file |
//! |---|---|---|
//! | what a region sends, for any light | [`RegionResponse`], [`ExcitationBasis`] | `region_response.rs`, `rendered_region.rs` |
//! | what about it is not known | [`RegionModel`], [`LibraryError`], [`ResponseChange`] | `region_model.rs` |
//! | what a camera behind a filter makes of it | [`DesignCamera`], [`LitRegion`], [`SignalRates`] | `design_camera.rs`, `region_model.rs` |
//! | Fisher information, nuisances by Schur complement | [`Information`], [`UncertainData`], [`Bound`] | `fisher.rs` |
//! | figures of merit | [`Criterion`], [`Contrast`] | `criterion.rs` |
//! | what may be chosen, assumed, and must be kept to | [`DesignProblem`] | `problem.rs` |
//! | all designs, with signals that are prepared once | [`DesignSpace`], [`Design`], [`Merits`] | `design_space.rs` |
//! | search | [`score_all`], [`exchange`], [`pareto_front`] | `search.rs`, `design_space.rs` |
//! | what it rests on | [`sensitivities`], [`worst_case`] | `robustness.rs` |
//! | one design in numbers | [`evaluate_region`], [`detectability`], [`chromaticity_separability`] | `evaluation.rs` |
//!
//! Every step works on plain values that are prepared once: a light costs milliseconds, a design of prepared lights, filters and
//! sensors some ten microseconds.

mod criterion;
mod design_camera;
mod design_space;
#[cfg(test)]
mod design_space_tests;
mod evaluation;
mod fisher;
mod problem;
mod region_model;
mod region_response;
mod rendered_region;
mod robustness;
mod search;

pub use criterion::{Contrast, Criterion};
pub use design_camera::{DesignCamera, FilteredCamera, FineBands};
pub use design_space::{Design, DesignError, DesignSpace, Merits, Score, pareto_front};
pub use evaluation::{
    Assumptions, DesignExposure, RegionMerits, chromaticity_separability, detectability, evaluate_region,
};
pub use fisher::{Bound, Information, UncertainData, WeakDirection};
pub use problem::{
    Budget, Cohort, ContrastDefinition, DesignProblem, FilterChoice, LensChoice, LightChoice, Limits,
    LongPass, LongPassEdge, Split, WhiteFrame,
};
pub use region_model::{LibraryError, LitRegion, RegionModel, ResponseChange, SignalRates};
pub use region_response::{ExcitationBasis, FluorescenceResponse, RegionResponse};
pub use robustness::{Sensitivity, Tolerances, WorstCase, sensitivities, worst_case};
pub use search::{ExchangeResult, exchange, score_all};
