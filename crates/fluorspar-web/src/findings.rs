//! What a report says of what is shown, by section; and the report itself.

use std::time::Instant;

use fluorspar_report::{NumberMatrix, NumberTable, ReportItem, Section};
use fluorspar_session::Result;
use serde::{Deserialize, Serialize};

use crate::region::Place;
use crate::server::Shown;

/// What findings are wanted of.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FindingsRequest {
    #[serde(default)]
    pub(crate) set: Vec<String>,
    place: Option<Place>,
    /// Light by origin, leak and depth, too, which take longer.
    #[serde(default)]
    with_spectra: bool,
}

#[derive(Serialize)]
pub(crate) struct FindingsAnswer {
    sections: Vec<ToldSection>,
    milliseconds: f64,
}

#[derive(Serialize)]
pub(crate) struct ToldSection {
    title: String,
    /// What it says, in a line.
    note: String,
    html: String,
}

/// Sections as the page shows them.
pub(crate) fn told_sections(sections: impl IntoIterator<Item = Section>) -> Vec<ToldSection> {
    let mut figures = 0;
    let told = |section: Section| ToldSection {
        html: section.to_html(&mut figures),
        title: section.title,
        note: section.note,
    };
    sections.into_iter().map(told).collect()
}

/// The sections of a report on the frames and the region, the numbers of its first screen before them.
///
/// # Errors
/// A change that can't be made or shown; frames that can't be analyzed.
pub(crate) fn findings(shown: &Shown, request: &FindingsRequest) -> Result<FindingsAnswer> {
    let begun = Instant::now();
    let place = request.place.as_ref().map(Place::text);
    let page = shown.live.show(&shown.changes)?.findings(place.as_deref(), request.with_spectra)?.alone();
    let overview = page.overview.map(|overview| {
        let budgets = overview.answer.into_iter().flat_map(|answer| answer.budgets);
        let budgets = budgets.filter(|budget| !budget.rows.is_empty()).map(|budget| {
            let rows = budget.rows.into_iter().map(|row| vec![row.name, row.text]).collect();
            let columns = vec![budget.title, String::new()];
            ReportItem::Matrix(NumberMatrix { columns, rows, ..NumberMatrix::default() })
        });
        let cards = NumberTable { caption: String::new(), rows: overview.cards };
        let whole = budgets.fold(Section::new("In short").with(ReportItem::Table(cards)), Section::with);
        whole.say(overview.assumed.join(" "))
    });
    let warnings =
        page.warnings.iter().fold(Section::new("Doubts"), |section, warning| section.say(warning.text()));
    let warnings = Some(warnings).filter(|section| !section.items.is_empty());
    let sections = told_sections(overview.into_iter().chain(page.sections).chain(warnings));
    Ok(FindingsAnswer { sections, milliseconds: 1e3 * begun.elapsed().as_secs_f64() })
}

/// Of what a report is wanted.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReportRequest {
    #[serde(default)]
    pub(crate) set: Vec<String>,
    place: Option<Place>,
}

/// The report that `capture --report` writes of the saved experiment, as one page.
///
/// # Errors
/// Those of [`findings`].
pub(crate) fn report(shown: &Shown, request: &ReportRequest) -> Result<String> {
    let place = request.place.as_ref().map(Place::text);
    Ok(shown.live.report(&shown.changes, place.as_deref())?.alone().to_html())
}
