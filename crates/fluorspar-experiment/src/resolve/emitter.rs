//! Fluorophores that tissue may hold.

use std::sync::Arc;

use super::context::{Context, KnownFluorophore, Resolved};
use super::fluorophore::Fluorophores;
use crate::error::Place;
use crate::schema::FluorophoreSection;
use fluorspar::digest::{bytes_of, sha256_hex};
use fluorspar::spectral::{Fluorophore, YieldDensity};

/// A fluorophore that tissue may hold: of the sections of the file, otherwise of the catalogue.
pub(super) fn known_emitter(
    context: &mut Context<'_>,
    at: &Place,
    sections: &[FluorophoreSection],
    name: &str,
) -> Resolved<KnownFluorophore> {
    if let Some(known) = context.emitters.iter().find(|known| known.fluorophore.name == name) {
        return Ok(known.clone());
    }
    // A list of its own: what the tissue does not hold is no component of the render.
    let mut found = Fluorophores::default();
    let index = found.index(context, at, sections, name)?;
    let fluorophore = found.list.swap_remove(index);
    let sha256 = digest(&fluorophore);
    let emitter = KnownFluorophore { fluorophore: Arc::new(fluorophore), sha256 };
    context.emitters.push(emitter.clone());
    Ok(emitter)
}

/// Digest of the spectra of a fluorophore, to the last bit.
fn digest(fluorophore: &Fluorophore) -> String {
    let eem = &fluorophore.eem;
    let mut blocks = vec![fluorophore.name.clone().into_bytes(), format!("{:?}", eem.stokes()).into_bytes()];
    blocks.push(bytes_of(&[eem.scale()]));
    match eem.density() {
        YieldDensity::Separable(terms) => {
            for curve in terms.iter().flat_map(|term| [&term.excitation, &term.emission]) {
                blocks.extend([bytes_of(curve.wavelengths_nm()), bytes_of(curve.values())]);
            }
        }
        YieldDensity::Table(table) => {
            blocks.extend([&table.emission_nm, &table.excitation_nm, &table.values].map(|v| bytes_of(v)));
        }
    }
    sha256_hex(blocks)
}
