//! Figures and the self-contained HTML report of a run.
//!
//! | stage | call | gives |
//! |---|---|---|
//! | draw | [`figures`], or a [`Figure`] of your own | axes with units and explicit limits, series, heat maps |
//! | export | [`Figure::to_svg`], [`Figure::to_png`] | the same image as vector text or as pixels |
//! | write | [`ReportData::to_html`] | one file: text, images, figures, tables, the experiment itself |
//! | two finished runs side by side | [`compared_numbers`], [`comparison_report`] | numbers with intervals, and whether these tell them apart |
//! | a design search as a page | [`design_report`] | what is best, what it costs, what it rests on |
//! | a cohort as a page | [`cohort_report`] | what is normal, how good estimates are, how well lesions are told |
//! | many photographs as a page | [`photographs_report`] | a line each region, what lies apart, pictures |
//! | people against norms as a page | [`norm_report`] | who lies outside, and how sure that is |
//! | what a data set holds and assumes | [`dataset_sheet`] | Markdown |
//! | read back | [`extract_experiment`] | the TOML that a report was made from |
//!
//! Out of scope: physics. Everything here draws and explains numbers that were computed elsewhere.

mod calibration_report;
mod cohort_figures;
mod cohort_report;
mod comparison;
mod dataset_sheet;
mod design_recommendation;
mod design_remarks;
mod design_report;
mod figure;
pub mod figures;
mod findings;
mod norm_report;
mod outlined_preview;
mod page;
mod photographs_report;
mod run;

pub use calibration_report::{CalibrationResults, CalibrationRow, calibration_report, calibration_rows};
pub use cohort_report::{CohortResults, cohort_figures, cohort_report};
pub use comparison::{
    ComparedNumber, ComparedPictures, ComparedSide, Distinction, FinishedCapture, FinishedFrame,
    FinishedProgram, FinishedRegion, FinishedRun, FinishedSafety, FinishedViewer, FrameToCompare, HOW_JUDGED,
    UnreadableRun, compared_numbers, compared_pictures, comparison_figures, comparison_remarks,
    comparison_report, comparison_verdict, numbers_by_region, setting_cells,
};
pub use dataset_sheet::{DatasetFacts, LesionCounts, SplitCounts, dataset_in_short, dataset_sheet};
pub use design_recommendation::{recommendation, recommended};
pub use design_remarks::{best_case, cures, ideal_edges};
pub use design_report::{DesignFindings, JudgedDesign, design_figures, design_report, design_sections};
pub use figure::{
    Axis, ColorBar, ColorMap, ContactSheet, Dash, Figure, FigureError, Ink, Label, Panel, Raster, Scale,
    Series, SeriesShape,
};
pub use findings::{ASSUMED_GAIN, finding_lines};
pub use norm_report::{HeldNumber, HeldNumbers, norm_report, percentile_of, verdict_of};
pub use outlined_preview::{OUTLINE_COLORS, outlined_preview};
pub use page::{
    Answer, Contribution, Contributions, FrameView, MapOverlay, Number, NumberMatrix, NumberTable, Origin,
    Overview, ReportData, ReportItem, ReportPicture, Section, analysis_section, close_page, escape,
    extract_experiment, open_page, page_policy, write_figure,
};
pub use photographs_report::{PhotographResults, PlacedNumber, photographs_report, warnings_by_kind};
pub use run::{
    FrameOrigin, LEAKING, NamedFigure, RunFolderError, RunReport, RunResults, analysis_json, dark_frames,
    evaluation_json, exceeded_limits, leaking_frames, region_warnings, regions_matrix, run_report,
    stopped_early, write_frame_report, write_run_components, write_run_folder,
};
