//! Fluorophores that a layer of tissue holds.

use super::context::{Context, Resolved};
use super::emitter::known_emitter;
use crate::error::{ExperimentError, Place};
use crate::preset::{self, PublishedDye};
use crate::schema::{FluorophoreSection, FluorophoreSource, LayerFluorophoreSection, TissueLayerSection};
use fluorspar::tissue::{Site, TissueError, TissueFluorophore};
use fluorspar::units::number_text;

/// Wavelength of a strength, nm.
const STRENGTH_NM: f64 = 405.0;
/// Largest absorption coefficient of a dye, 1/mm.
const ABSORPTION_PER_MM: f64 = 400.0;

/// The fluorophores of a layer, or of what is added to the layer of a site. Those of no strength are left out.
pub(super) fn held_fluorophores(
    context: &mut Context<'_>,
    at: &Place,
    section: &TissueLayerSection,
    sections: &[FluorophoreSection],
    site: Option<&Site>,
) -> Resolved<Vec<TissueFluorophore>> {
    let at = at.field("fluorophores");
    let mut held = Vec::new();
    for (name, section) in &section.fluorophores {
        let at = at.field(name);
        let fluorophore = known_emitter(context, &at, sections, name)?.fluorophore;
        let (strength_per_mm, at_nm, quantum_yield) = match (section.strength_per_mm, section) {
            (None, LayerFluorophoreSection { concentration_umol_per_l: Some(amount), .. }) => {
                of_concentration(context, &at, section, *amount, published(sections, name))?
            }
            (Some(strength), LayerFluorophoreSection { concentration_umol_per_l: None, .. }) => {
                let knows = |site: &Site| site.fluorophores().contains(&name.as_str());
                if section.quantum_yield.is_none() && !site.is_none_or(knows) {
                    let message = "give its quantum yield, 0.001 to 1: a dye brings its own absorption into the layer of a site";
                    return context.fail(&at.field("quantum_yield"), message);
                }
                (strength, section.at_nm.unwrap_or(STRENGTH_NM), section.quantum_yield)
            }
            _ => return context.fail(&at, "give either strength_per_mm or concentration_umol_per_l"),
        };
        let found = TissueFluorophore { fluorophore, strength_per_mm, at_nm, quantum_yield };
        found.validate("").map_err(|error| misplaced(context, &at, &error))?;
        if strength_per_mm > 0.0 {
            held.push(found);
        }
    }
    Ok(held)
}

/// What is published of a dye of the catalogue, or of one that a section takes from there.
fn published(sections: &[FluorophoreSection], name: &str) -> Option<PublishedDye> {
    let section = sections.iter().find(|section| section.name == name);
    let of_catalogue = match section.map(|section| &section.source) {
        None => name,
        Some(FluorophoreSource::Catalogue(source)) => source,
        Some(_) => return None,
    };
    preset::fluorophore(of_catalogue).ok()?.published
}

/// Strength, its wavelength and the quantum yield of an amount of a dye: its absorption coefficient is `ln(10) epsilon c`.
fn of_concentration(
    context: &Context<'_>,
    at: &Place,
    section: &LayerFluorophoreSection,
    umol_per_l: f64,
    dye: Option<PublishedDye>,
) -> Resolved<(f64, f64, Option<f64>)> {
    /// From 1/cm and umol/l to 1/mm and mol/l.
    const UNITS: f64 = 0.1 * 1e-6;
    let Some(dye) = dye else {
        let message = "its molar absorption is not in the catalogue; give strength_per_mm, at_nm and quantum_yield instead";
        return context.fail(&at.field("concentration_umol_per_l"), message);
    };
    let own = [("at_nm", section.at_nm.is_some()), ("quantum_yield", section.quantum_yield.is_some())];
    if let Some((field, _)) = own.iter().find(|(_, given)| *given) {
        return context
            .fail(&at.field(*field), "is that of the catalogue where a concentration is given; remove it");
    }
    let per_umol_per_l = std::f64::consts::LN_10 * dye.molar_absorption_per_m_cm * UNITS;
    let most = (ABSORPTION_PER_MM / per_umol_per_l).floor();
    let amount = context.within(&at.field("concentration_umol_per_l"), umol_per_l, [0.0, most], "umol/l")?;
    Ok((amount * per_umol_per_l * dye.quantum_yield, dye.excitation_peak_nm, Some(dye.quantum_yield)))
}

/// A number outside its range, told at its field: the last word of what the layer calls it.
pub(super) fn misplaced(context: &Context<'_>, at: &Place, error: &TissueError) -> ExperimentError {
    match error {
        TissueError::OutOfRange { quantity, range, hint, .. } => {
            let field = quantity.rsplit('.').next().unwrap_or(quantity);
            let [least, most] = range.map(number_text);
            context.error(&at.field(field), format!("must be between {least} and {most}; {hint}"))
        }
        TissueError::NotExcited { at_nm, .. } => {
            let nm = number_text(*at_nm);
            let message = format!(
                "the fluorophore is not excited at {nm} nm; choose a wavelength within its excitation"
            );
            context.error(&at.field("at_nm"), message)
        }
        other => context.error(at, other.to_string()),
    }
}
