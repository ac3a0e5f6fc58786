//! The report page.

mod analysis_section;
mod escape;
mod experiment;
mod glossary;
mod html;
mod live_figure;
mod overview_html;
mod report_data;

pub use analysis_section::analysis_section;
pub(crate) use analysis_section::render_noise_words;
pub use escape::escape;
pub use experiment::extract_experiment;
pub(crate) use glossary::{glossary_section, plain_text};
pub use html::{close_page, open_page, write_figure};
pub use live_figure::page_policy;
pub use report_data::{
    Answer, Contribution, Contributions, FrameView, MapOverlay, Number, NumberMatrix, NumberTable, Origin,
    Overview, ReportData, ReportItem, ReportPicture, Section,
};
