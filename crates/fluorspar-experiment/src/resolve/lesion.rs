//! Spots on the parts of a mouth: their masks are baked into the textures of the part's own material.

use std::sync::Arc;

use super::context::{Context, Resolved};
use super::fluorophore::Fluorophores;
use super::lesion_spot::{SIDE, Spot, Unfold, pixel_center};
use super::material::Materials;
use super::spectrum::Role;
use crate::error::steps;
use crate::schema::{ExperimentFile, MouthSection};
use fluorspar::material::{FluorophoreAmount, ImageTexture, Material, ReflectanceTerm, ScalarTexture};
use fluorspar::names::did_you_mean;
use fluorspar::scene::{Object, Shape};
use fluorspar::spectral::{Curve, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, WavelengthGrid, blood_transmittance};

/// Parts that a lesion reaches, and its share on the map of each.
pub(super) type SpotMaps = Vec<(String, Arc<ImageTexture>)>;

/// What the lesions of a mouth left behind.
#[derive(Default)]
pub(super) struct Lesions {
    /// Number of the material that each material behind those of the file was copied from.
    pub(super) copied_materials: Vec<usize>,
    /// Name of each lesion, and its share on the maps of the parts that it reaches.
    pub(super) spots: Vec<(String, SpotMaps)>,
}

/// Adds all lesions: the part gets a material of its own, behind the others.
pub(super) fn lesions(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    section: &MouthSection,
    grid: &WavelengthGrid,
    materials: &mut Materials,
    fluorophores: &mut Fluorophores,
    parts: &mut [Object],
) -> Resolved<Lesions> {
    let mut copied = Vec::new();
    let mut spots = Vec::new();
    for (index, lesion) in section.lesion.iter().enumerate() {
        let at = steps!["mouth", "lesion", index];
        context.unique_name(&at, &lesion.name, section.lesion[..index].iter().map(|l| l.name.as_str()))?;
        let Some(object) = parts.iter().find(|part| part.name == lesion.part) else {
            let hint = did_you_mean(&lesion.part, parts.iter().map(|part| part.name.as_str()));
            return context.fail(&at.field("part"), format!("the mouth has no part of this name{hint}"));
        };
        let Shape::Mesh(mesh) = &object.shape else {
            return context.fail(&at.field("part"), "this part has no mesh");
        };
        context.within(&at.field("blood_um"), lesion.blood_um, [0.0, 200.0], "µm")?;
        if mesh.uvs.is_empty() {
            let message =
                "this part has no texture coordinates, which tell where on it; export them with its mesh";
            return context.fail(&at.field("part"), message);
        }
        let spot = Spot::new(context, &at, lesion, mesh)?;
        let reflectance = match &lesion.reflectance {
            Some(reference) => {
                Some(context.spectrum(&at.field("reflectance"), reference, Role::Reflectance, 0.0, grid)?)
            }
            None => None,
        };
        let mut amounts = Vec::new();
        for (name, &inside) in &lesion.concentrations {
            let at = at.field("concentrations").field(name);
            context.within(&at, inside, [0.0, 1e6], "")?;
            amounts.push((fluorophores.index(context, &at, &file.fluorophore, name)?, inside as f32));
        }
        let mut reached = Vec::new();
        for object in parts.iter_mut() {
            let Some(unfold) = continuation(&lesion.part, &object.name) else { continue };
            let Shape::Mesh(mesh) = &object.shape else { continue };
            let Some(mask) = spot.bake(mesh, unfold) else { continue };
            // The shares are numbers between 0 and 1.
            reached.extend(
                ImageTexture::new(SIDE, SIDE, mask.clone()).map(|map| (object.name.clone(), Arc::new(map))),
            );
            let blood_um = lesion.blood_um;
            if let Some(recipe) = materials.recipes.get(&object.material).cloned() {
                if object.name == lesion.part {
                    recipe.check_lesion(context, &at, lesion)?;
                }
                let inside = |texture: &ScalarTexture, value: f32| {
                    bake(texture, &mask, |around, m| around * (1.0 - m) + value * m)
                };
                let within = bake(&ScalarTexture::Constant(0.0), &mask, |_, m| m);
                let recipe = recipe.with_lesion(context, &at, lesion, within, inside)?;
                let (scattering, amounts) = recipe.resolve(context, file, grid, fluorophores)?;
                let around = &materials.list[object.material];
                let name = format!("{} with {}", around.name, lesion.name);
                materials.list.push(Material { name, scattering, fluorophores: amounts, ..around.clone() });
                copied.push(object.material);
                object.material = materials.list.len() - 1;
                materials.recipes.insert(object.material, recipe);
                continue;
            }
            if !(lesion.tissue.is_empty() && lesion.states.is_empty()) {
                let message = format!(
                    "material \"{}\" of part \"{}\" is not of layered tissue; give it type = \"tissue\", or the lesion a blood_um, a \
                     reflectance or concentrations",
                    materials.list[object.material].name, object.name
                );
                let field = if lesion.tissue.is_empty() { "states" } else { "tissue" };
                return context.fail(&at.field(field), message);
            }
            if reflectance.is_some() && materials.list[object.material].diffuse().is_none() {
                let message = format!(
                    "material \"{}\" of part \"{}\" has no diffuse reflectance that a lesion could change; remove it",
                    materials.list[object.material].name, object.name
                );
                return context.fail(&at.field("reflectance"), message);
            }
            if blood_um > 0.0 && !materials.list[object.material].fluorophores.is_empty() {
                let message = "darkens what the surface reflects, and not its fluorescence; a mouth of layered tissue has both";
                context.warn(&at.field("blood_um"), message);
            }
            let material = with_spot(
                &materials.list[object.material],
                &lesion.name,
                &mask,
                blood_um,
                &reflectance,
                &amounts,
            );
            materials.list.push(material);
            copied.push(object.material);
            object.material = materials.list.len() - 1;
        }
        spots.push((lesion.name.clone(), reached));
    }
    Ok(Lesions { copied_materials: copied, spots })
}

/// The parts of the tongue's back, which share one map.
const TONGUE_BACK: [&str; 4] = ["tongue_dorsum", "tongue_tip", "tongue_lateral_right", "tongue_lateral_left"];
const TONGUE_UNDERSIDE: &str = "tongue_ventral";

/// How a lesion on a part continues on another one; `None` where it ends.
fn continuation(of: &str, over: &str) -> Option<Unfold> {
    if of == over {
        return Some(Unfold::Same);
    }
    let is_back = |name: &str| TONGUE_BACK.contains(&name);
    match (is_back(of), is_back(over)) {
        (true, true) => Some(Unfold::Same),
        (true, false) if over == TONGUE_UNDERSIDE => Some(Unfold::AcrossBorder),
        (false, true) if of == TONGUE_UNDERSIDE => Some(Unfold::AcrossBorder),
        _ => None,
    }
}

/// A material as it is inside the mask.
fn with_spot(
    around: &Material,
    name: &str,
    mask: &[f32],
    blood_um: f64,
    reflectance: &Option<Curve>,
    amounts: &[(usize, f32)],
) -> Material {
    let mut material = around.clone();
    material.name = format!("{} with {name}", around.name);
    let blood = |curve: &Curve| -> Curve {
        if blood_um == 0.0 {
            return curve.clone();
        }
        curve.times(&Curve::from_fn(MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM, |nm| {
            blood_transmittance(nm, 2.0 * blood_um)
        }))
    };
    let mut terms = Vec::new();
    for term in around.diffuse().map_or(&[][..], |base| &base.reflectance) {
        let weight = bake(&term.weight, mask, |w, m| w * (1.0 - m));
        terms.push(ReflectanceTerm { spectrum: term.spectrum.clone(), weight });
        if reflectance.is_none() {
            let weight = bake(&term.weight, mask, |w, m| w * m);
            terms.push(ReflectanceTerm { spectrum: blood(&term.spectrum), weight });
        }
    }
    if let Some(spectrum) = reflectance {
        let weight = bake(&ScalarTexture::Constant(1.0), mask, |_, m| m);
        terms.push(ReflectanceTerm { spectrum: blood(spectrum), weight });
    }
    if let Some(base) = material.diffuse_mut() {
        base.reflectance = terms;
    }
    for &(fluorophore, inside) in amounts {
        match material.fluorophores.iter_mut().find(|amount| amount.fluorophore == fluorophore) {
            Some(amount) => {
                amount.concentration = bake(&amount.concentration, mask, |c, m| c * (1.0 - m) + inside * m);
            }
            None => material.fluorophores.push(FluorophoreAmount::new(
                fluorophore,
                bake(&ScalarTexture::Constant(0.0), mask, |_, m| inside * m),
            )),
        }
    }
    material
}

/// A texture as an image in which every pixel was combined with the mask.
fn bake(texture: &ScalarTexture, mask: &[f32], combine: impl Fn(f32, f32) -> f32) -> ScalarTexture {
    let values: Vec<f32> =
        (0..SIDE * SIDE).map(|i| combine(texture.at(pixel_center(i)), mask[i]).max(0.0)).collect();
    match ImageTexture::new(SIDE, SIDE, values) {
        Ok(image) => ScalarTexture::Image { image: Arc::new(image), low: 0.0, high: 1.0 },
        // Products of finite numbers from 0 up are such numbers.
        Err(_) => texture.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spots_end_with_their_part_but_for_those_of_the_tongue() {
        assert_eq!(continuation("tongue_lateral_left", "tongue_dorsum"), Some(Unfold::Same));
        assert_eq!(continuation("tongue_lateral_left", "tongue_ventral"), Some(Unfold::AcrossBorder));
        assert_eq!(continuation("tongue_ventral", "tongue_tip"), Some(Unfold::AcrossBorder));
        assert_eq!(continuation("cheek_left", "cheek_left"), Some(Unfold::Same));
        assert_eq!(continuation("cheek_left", "lower_lip"), None);
        assert_eq!(continuation("tongue_dorsum", "frenulum"), None);
    }
}
