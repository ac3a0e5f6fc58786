//! The clear layer on a surface.

use super::context::{Context, Resolved};
use crate::error::Place;
use crate::schema::GlossSection;
use fluorspar::material::Coat;

/// Lengths over which a film evens out relief, mm: up to about twice the capillary length of water.
const SMOOTHING_MM: [f64; 2] = [0.01, 5.0];

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
    let smoothing_mm = match gloss.smoothing_mm {
        0.0 => 0.0,
        some => context.within(&at.field("smoothing_mm"), some, SMOOTHING_MM, "mm, or 0")?,
    };
    Ok(Some(Coat { refractive_index: index as f32, roughness, smoothing_m: 1e-3 * smoothing_mm as f32 }))
}
