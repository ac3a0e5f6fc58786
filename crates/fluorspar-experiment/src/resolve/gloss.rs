//! The clear layer on a surface.

use super::context::{Context, Resolved};
use crate::error::Place;
use crate::schema::GlossSection;
use fluorspar::material::Coat;

/// The clear layer on a diffuse surface.
pub(super) fn gloss(
    context: &mut Context<'_>,
    at: &Place,
    section: Option<&GlossSection>,
) -> Resolved<Option<Coat>> {
    let Some(gloss) = section else { return Ok(None) };
    let index = context.within(&at.field("refractive_index"), gloss.refractive_index, [1.0, 3.0], "")?;
    let roughness_at = at.field("roughness");
    let roughness = context.texture(&roughness_at, &gloss.roughness, 1.0)?;
    if roughness.max() <= 0.0 {
        return context.fail(&roughness_at, "must be above 0 and at most 1; 0.01 is mirror-like");
    }
    Ok(Some(Coat { refractive_index: index as f32, roughness }))
}
