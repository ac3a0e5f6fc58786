//! Design of lights, filters and sensors: what a camera could prove, before it is built.
//!
//! | step | type or call | file |
//! |---|---|---|
//! | what a region sends, for any light | [`RegionResponse`], [`ExcitationBasis`] | `region_response.rs`, `rendered_region.rs` |
//! | what about it is not known | [`RegionModel`], [`LightUnit`], [`LibraryError`], [`ResponseChange`], [`ChangeGrowth`] | `region_model.rs` |
//! | what a camera behind a filter makes of it | [`DesignCamera`], [`LitRegion`], [`SignalRates`] | `design_camera.rs`, `region_model.rs` |
//! | Fisher information, nuisances by Schur complement | [`Information`], [`UncertainData`], [`Bound`] | `fisher.rs` |
//! | figures of merit | [`Criterion`], [`Contrast`] | `criterion.rs` |
//! | what may be chosen, assumed, and must be kept to | [`DesignProblem`] | `problem.rs` |
//! | all designs, with signals that are prepared once | [`DesignSpace`], [`Design`] | `design_space.rs`, `prepared_signals.rs` |
//! | a design of a space in numbers | [`Merits`], [`Score`] | `merits.rs`, `score.rs` |
//! | its exposures as an estimate takes them | [`LitExposure`] | `lit_exposure.rs` |
//! | search | [`score_all`], [`exchange`], [`pareto_front`] | `search.rs`, `score.rs` |
//! | an eye that looks into the lights | [`ExposedEye`] | `eye.rs` |
//! | what it rests on | [`sensitivities`], [`worst_case`] | `robustness.rs` |
//! | one region in numbers | [`evaluate_region`], [`detectability`], [`chromaticity_separability`] | `evaluation.rs` |
//!
//! Every step works on plain values that are prepared once: a light costs milliseconds, a design of prepared lights, filters and
//! sensors some ten microseconds.

mod criterion;
mod design_camera;
mod design_space;
#[cfg(test)]
mod design_space_tests;
mod evaluation;
mod eye;
mod fisher;
mod lit_exposure;
mod merits;
mod prepared_signals;
mod problem;
mod region_model;
mod region_response;
mod rendered_region;
mod robustness;
mod score;
mod search;

pub use criterion::{Contrast, Criterion};
pub use design_camera::{DesignCamera, FilteredCamera, FineBands};
pub use design_space::{Design, DesignError, DesignSpace};
pub use evaluation::{
    Assumptions, DesignExposure, RegionMerits, chromaticity_separability, detectability, evaluate_region,
};
pub use eye::ExposedEye;
pub use fisher::{Bound, Information, UncertainData, WeakDirection};
pub use lit_exposure::LitExposure;
pub use merits::{FilteredFluorescence, LimitExcess, Merits};
pub use problem::{
    Budget, Cohort, ContrastDefinition, DesignProblem, FilterChoice, GeometryChoice, LensChoice, LightChoice,
    Limits, LongPass, LongPassEdge, Split, WeightPrior, WhiteFrame,
};
pub use region_model::{
    ChangeGrowth, LibraryError, LightUnit, LitRegion, RegionModel, ResponseChange, SignalRates,
};
pub use region_response::{ExcitationBasis, FluorescenceResponse, RegionResponse};
pub use robustness::{Sensitivity, Tolerances, WorstCase, sensitivities, worst_case};
pub use score::{Score, pareto_front};
pub use search::{ExchangeResult, exchange, score_all};
