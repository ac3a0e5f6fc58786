//! The designs of a search: as dots, and each with what a report says of it.

use axum::Json;
use axum::response::{IntoResponse, Response};
use fluorspar_session::Result;
use fluorspar_session::design::{DesignKey, FoundDesigns};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::findings::told_sections;

/// Which designs are looked at, the first in full.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DesignRequest {
    designs: Vec<DesignKey>,
}

/// Designs that are looked at together, at most.
const MOST_TOGETHER: usize = 4;

/// What a page shows of all designs.
pub(crate) fn about_designs(found: &FoundDesigns) -> Value {
    json!({
        "stage": "designs",
        "title": found.problem.title(),
        "criterion": found.criterion(),
        "search": found.search,
        "left_out": found.left_out,
        "drawn": found.drawn,
        "recommended": found.recommended,
        "compared": found.compared().collect::<Vec<_>>(),
        "designs": found.told,
    })
}

/// What a report says of designs, section by section.
///
/// # Errors
/// A design that there is not.
pub(crate) fn design(found: &FoundDesigns, request: &DesignRequest) -> Result<Response> {
    let keys = &request.designs[..request.designs.len().min(MOST_TOGETHER)];
    Ok(Json(json!({ "sections": told_sections(found.sections(keys)?) })).into_response())
}
