//! What the fronts of Fluorspar share, the command line and the Python package: tasks, each from its options to its answer, and finished
//! renders. It prints nothing: a front gives a task a [`Job`], which hears of it and ends it, and words its answer and its errors.
//!
//! | to | call |
//! |---|---|
//! | analyze frames, or many photographs | [`analyze`] |
//! | calibrate a camera from its frames | [`calibrate`] |
//! | capture a component image | [`capture`] |
//! | write spectral cubes for other programs | [`cube`] |
//! | run an experiment from scene to report | [`run`] |
//! | check an experiment or a flat sample | [`check`] |
//! | compare two finished runs | [`compare`] |
//! | examine many people | [`cohort`] |
//! | write them as training data | [`dataset`] |
//! | search lights, filters and sensors | [`design`] |
//! | predict a flat sample | [`predict`] |
//! | fit measured spectra with fluorophores | [`fluorophore`] |
//! | solve, look into, trace, fit a tissue | [`tissue`] |
//! | open a render, or take one that is in memory | [`FinishedRender::open`], [`FinishedRender::of_image`] |
//! | see it with the lights, filters, sensor and concentrations of an experiment | [`FinishedRender::shown`] |
//! | form its electrons in the captures | [`FinishedRender::seen_by`] |
//! | show a render while its experiment changes again and again | [`LiveRender`] |
//! | look at photographs and draw upon them | [`PhotographCamera`] |
//! | learn what is odd about an experiment before it is rendered | [`warnings_before_run`] |

#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "comments of options are the texts of --help, where brackets stand for themselves"
)]

mod analyze;
mod calibrate;
mod capture;
mod changes;
mod check;
mod cite;
mod coarse_render;
mod cohort;
mod compare;
mod cube;
mod dataset;
pub mod design;
mod error;
mod figure_file;
mod finished_render;
pub mod fluorophore;
mod frame_report;
mod job;
mod live_render;
pub mod named_spectra;
mod options;
mod photographs;
mod plane_cache;
mod predict;
mod region_option;
mod render;
mod render_remarks;
mod rendered_scene;
mod resource_needs;
mod run;
mod shard;
mod source;
mod surroundings;
pub mod tissue;
pub mod values;

pub use analyze::{AnalyzeOptions, Analyzed, AnalyzedFrames, analyze};
pub use calibrate::{CalibrateOptions, CalibratedCamera, CalibrationText, calibrate};
pub use capture::{CaptureOptions, CapturedFolder, RawForm, capture};
pub use changes::{Changes, ExperimentArgs, RenderOptions, Seed};
pub use check::{CameraView, CheckOptions, CheckedExperiment, CheckedFile, CheckedSample, check};
pub use cite::{Citations, CiteOptions, CitedSource, cite};
pub use coarse_render::{image_warnings, warnings_before_run};
pub use cohort::{CohortArgs, CohortOptions, CohortOutcome, ExaminedCohort, FinishedShard, cohort};
pub use compare::{CompareOptions, ComparedRun, ComparedRuns, Comparison, compare};
pub use cube::{CubeOptions, WrittenCube, cube};
pub use dataset::{DatasetOptions, WrittenDataset, dataset};
pub use error::{Error, ErrorKind, Result, worded};
pub use figure_file::FigureFormat;
pub use finished_render::{CaptureView, FinishedRender, ShownExperiment};
pub use job::{Job, Left, Listener};
pub use live_render::{LiveRender, LiveStudy, Shapes};
pub use options::{TaskOption, TaskOptions};
pub use photographs::{
    AnalyzedPhotographs, FailedPhotograph, IntervalKind, PatientEstimate, Photograph, PhotographCamera,
    PhotographRow, RegionEstimate, UNCONFIRMED, camera_digest, estimate_photograph, find_photographs,
    photograph_pictures, photographs_csv, read_photographs, region_mask, region_with_mask,
};
pub use plane_cache::Wanted;
pub use predict::{PredictOptions, PredictedSample, filter_list, predict};
pub use render::{Keep, fill_film, render_scene, render_with_excitation_basis};
pub use render_remarks::{as_typed_in_session, experiment_of, say_uncertainty, warn_of_denoised};
pub use rendered_scene::SceneChanges;
pub use resource_needs::{
    ResourceLimits, ResourceNeeds, film_file_bytes, frame_bytes, image_room_bytes, render_seconds, run_bytes,
    say_time, seconds_of,
};
pub use run::{FinishedExperiment, RunOptions, check_memory, check_nothing_painted, run};
pub use shard::WorkShard;
pub use source::{ExperimentSource, files_named, read_text};
pub use surroundings::use_surroundings;
