//! The report page.

mod analysis_section;
mod escape;
mod experiment;
mod glossary;
mod html;
mod report_data;

pub use analysis_section::analysis_section;
pub(crate) use escape::escape;
pub use experiment::extract_experiment;
pub use glossary::glossary_section;
pub(crate) use html::{close_page, open_page, write_figure};
pub use report_data::{Number, NumberTable, Origin, ReportData, ReportItem, ReportPicture, Section};
