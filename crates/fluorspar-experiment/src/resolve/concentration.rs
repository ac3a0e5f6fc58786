//! Factors on the concentrations of fluorophores.

use std::sync::Arc;

use super::context::{Context, Resolved};
use super::fluorophore::Fluorophores;
use crate::error::steps;
use crate::schema::{ConcentrationFactor, ExperimentFile, PaintedMask};
use fluorspar::material::{Material, ScalarTexture};
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar::study::{ConcentrationChange, PaintedFactor};
use fluorspar_format::{Transfer, read_texture_png};

/// Factors that are taken.
const FACTOR: [f64; 2] = [0.0, 1e6];

/// Checks the factors, and multiplies the concentrations of all materials by those that hold everywhere. What a mask paints
/// belongs to an image, not to the scene.
pub(super) fn scale(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    fluorophores: &Fluorophores,
    materials: &mut [Material],
) -> Resolved<Vec<ConcentrationChange>> {
    let known: Vec<&str> = fluorophores.list.iter().map(|other| other.name.as_str()).collect();
    let changes = changes(context, file, &known)?;
    for change in changes.iter().filter(|change| change.painted.is_none()) {
        if let Some(number) = known.iter().position(|name| *name == change.fluorophore) {
            scale_materials(materials, number, change.factor as f32);
        }
    }
    Ok(changes)
}

/// The factors, of fluorophores that are known.
pub(super) fn changes(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    known: &[&str],
) -> Resolved<Vec<ConcentrationChange>> {
    let mut changes = Vec::with_capacity(file.concentration.len());
    for (name, factor) in &file.concentration {
        let at = steps!["concentration", name];
        if !known.contains(&name.as_str()) {
            return context.fail(&at, unknown_fluorophore(name, known));
        }
        let change = match factor {
            ConcentrationFactor::Even(factor) => {
                context.within(&at, *factor, FACTOR, "")?;
                ConcentrationChange { fluorophore: name.clone(), factor: *factor, painted: None }
            }
            ConcentrationFactor::Painted(mask) => {
                context.within(&at.field("inside"), mask.inside, FACTOR, "")?;
                context.within(&at.field("outside"), mask.outside, FACTOR, "")?;
                let painted = Some(painted(context, name, mask)?);
                ConcentrationChange { fluorophore: name.clone(), factor: mask.outside, painted }
            }
        };
        changes.push(change);
    }
    Ok(changes)
}

fn unknown_fluorophore(name: &str, known: &[&str]) -> String {
    format!(
        "no material contains the fluorophore \"{}\"{} The scene has: {}",
        excerpt(name),
        did_you_mean(name, known.iter().copied()),
        if known.is_empty() { "none".into() } else { known.join(", ") }
    )
}

fn scale_materials(materials: &mut [Material], fluorophore: usize, factor: f32) {
    if factor == 1.0 {
        return;
    }
    let amounts = materials.iter_mut().flat_map(|material| &mut material.fluorophores);
    for amount in amounts.filter(|amount| amount.fluorophore == fluorophore) {
        amount.concentration = match &amount.concentration {
            ScalarTexture::Constant(value) => ScalarTexture::Constant(factor * value),
            map => ScalarTexture::Product(Box::new(ScalarTexture::Constant(factor)), Box::new(map.clone())),
        };
    }
}

fn painted(context: &mut Context<'_>, name: &str, section: &PaintedMask) -> Resolved<PaintedFactor> {
    let at = steps!["concentration", name, "mask"];
    context.note_input(&at, &section.mask)?;
    let image = read_texture_png(section.mask.as_ref(), Transfer::Linear)
        .map_err(|error| context.file_error(&at, &error))?;
    // An alpha channel is no color.
    let colors = if image.channels >= 3 { 3 } else { 1 };
    let brightest = |pixel: &[f32]| pixel[..colors].iter().copied().fold(0.0, f32::max);
    let mask: Arc<[f32]> = image.data.chunks_exact(image.channels).map(brightest).collect();
    Ok(PaintedFactor { inside: section.inside, width: image.width, height: image.height, mask })
}
