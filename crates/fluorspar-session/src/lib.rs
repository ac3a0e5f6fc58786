//! What the fronts of Fluorspar share, the command line and the Python package: a finished render, opened once, and what captures of
//! any experiment that shows its scene see of it. It prints nothing and knows no words of a front.
//!
//! | to | call |
//! |---|---|
//! | open a render, or take one that is in memory | [`FinishedRender::open`], [`FinishedRender::of_image`] |
//! | see it with the lights, filters, sensor and concentrations of an experiment | [`FinishedRender::shown`] |
//! | form its electrons in the captures | [`FinishedRender::seen_by`] |
//! | learn what is odd about an experiment before it is rendered | [`warnings_before_run`] |

mod coarse_render;
mod error;
mod finished_render;
mod plane_cache;
mod rendered_scene;

pub use coarse_render::{coarse_image, warnings_before_run};
pub use error::SessionError;
pub use finished_render::{CaptureView, FinishedRender, ShownExperiment};
pub use plane_cache::Wanted;
pub use rendered_scene::SceneChanges;
