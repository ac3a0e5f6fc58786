//! Regions beside that of `[analysis]`.

use super::context::Context;
use crate::error::{Place, steps};
use crate::schema::{AnalysisRegionSection, AnalysisSection};

/// Where the fields of an analysis stand in a file: in `[analysis]`, or in the entry of a region.
#[derive(Clone, Copy, Debug)]
pub(super) struct FieldPlaces {
    region: Option<usize>,
}

impl FieldPlaces {
    /// Of `[analysis]`.
    pub(super) const OF_ANALYSIS: Self = Self { region: None };

    /// Of the region of a number.
    pub(super) fn of_region(region: usize) -> Self {
        Self { region: Some(region) }
    }

    /// Where a field is written; of a region also in `[analysis]`, whose fields it has where it gives none of its own.
    pub(super) fn at(self, context: &Context<'_>, field: &str) -> Place {
        let shared = steps!["analysis", field];
        let Some(region) = self.region else { return shared };
        let own = steps!["analysis", "region", region, field];
        if context.document.has(&own) || !context.document.has(&shared) { own } else { shared }
    }
}

/// A region as the analysis that it is by itself. Where it lies is its own matter; what its light is made of, too, if it names its parts.
pub(super) fn as_analysis(section: &AnalysisRegionSection, shared: &AnalysisSection) -> AnalysisSection {
    let has_parts = !section.place.parts.is_empty();
    let is_of_parts = |tissue: &String| has_parts && tissue != "none";
    AnalysisSection {
        frame: shared.frame.clone(),
        place: section.place.clone(),
        inset_px: section.inset_px.unwrap_or(shared.inset_px),
        compared_px: None,
        region: Vec::new(),
        porphyrin: section.porphyrin.clone().or_else(|| shared.porphyrin.clone()),
        bulk: section.bulk.clone().or_else(|| shared.bulk.clone().filter(|_| !has_parts)),
        tissue: section.tissue.clone().or_else(|| shared.tissue.clone().filter(|name| !is_of_parts(name))),
        tissue_probability: section.tissue_probability.unwrap_or(shared.tissue_probability),
        further_frames: section.further_frames.clone().unwrap_or_else(|| shared.further_frames.clone()),
        prior_width: section.prior_width.unwrap_or(shared.prior_width),
        library_error: section.library_error.unwrap_or(shared.library_error),
        wanted_d_prime: shared.wanted_d_prime,
        noise_threshold: section.noise_threshold.unwrap_or(shared.noise_threshold),
    }
}
