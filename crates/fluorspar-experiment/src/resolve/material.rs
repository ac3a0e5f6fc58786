//! Materials.

use std::collections::BTreeMap;

use super::context::{Context, Resolved};
use super::fluorophore::{Fluorophores, MAX_CONCENTRATION, unknown};
use super::gloss::gloss;
use super::mouth;
use super::spectrum::Role;
use super::tissue::TissueRecipe;
use crate::error::{Place, steps};
use crate::preset;
use crate::schema::{
    ExperimentFile, MaterialSection, MetalIndex, MetalReference, NormalMapSection, ReflectanceReference,
    ScatteringSection, SpectrumReference, TextureReference,
};
use fluorspar::material::{
    Coated, Conductor, Dielectric, FluorophoreAmount, Lambertian, MAX_DIELECTRIC_INDEX, Material, Mixture,
    NormalMap, ReflectanceTerm, ScalarTexture, Scattering, TwoSided,
};
use fluorspar::spectral::{Curve, WavelengthGrid};
use fluorspar_format::{Transfer, read_texture_png};

/// The materials of an experiment.
pub(super) struct Materials {
    pub(super) list: Vec<Material>,
    /// Those of layered tissue by their numbers, so that lesions can change them.
    pub(super) recipes: BTreeMap<usize, TissueRecipe>,
}

/// Most materials of an experiment: each mixture is followed through all of its parts.
const MAX_MATERIALS: usize = 4000;

/// All materials of the sections.
pub(super) fn materials(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    grid: &WavelengthGrid,
    fluorophores: &mut Fluorophores,
) -> Resolved<Materials> {
    if file.material.len() > MAX_MATERIALS {
        let message = format!("{} materials; an experiment has at most {MAX_MATERIALS}", file.material.len());
        return context.fail(&steps!["material"], message);
    }
    let mut materials = Vec::with_capacity(file.material.len());
    let mut recipes = BTreeMap::new();
    if let Some(mouth) = &file.mouth {
        mouth::check_person(context, mouth)?;
        context.mouth = Some(mouth.parameters.clone());
    }
    for (index, section) in file.material.iter().enumerate() {
        let at = steps!["material", index];
        let earlier = file.material[..index].iter().map(|other| other.name.as_str());
        context.unique_name(&at, &section.name, earlier)?;
        context.tissue = mouth::only_tissue(context, file, &section.name);
        let (scattering, amounts) = match &section.scattering {
            ScatteringSection::Tissue(tissue) => {
                let recipe = TissueRecipe::new(context, &at, tissue, file, grid)?;
                let resolved = recipe.resolve(context, file, grid, fluorophores)?;
                recipes.insert(index, recipe);
                resolved
            }
            _ => (
                scattering(context, &at, section, file, grid)?,
                concentrations(context, &at, section, file, fluorophores)?,
            ),
        };
        materials.push(material(context, &at, section, scattering, amounts)?);
    }
    context.tissue = None;
    Ok(Materials { list: materials, recipes })
}

/// How a material reflects and transmits light.
fn scattering(
    context: &mut Context<'_>,
    at: &Place,
    section: &MaterialSection,
    file: &ExperimentFile,
    grid: &WavelengthGrid,
) -> Resolved<Scattering> {
    let part = |context: &Context<'_>, key: &str, name: &str| -> Resolved<usize> {
        let known = file.material.iter().map(|other| other.name.as_str());
        context.known(&at.field(key), name, known, "there is no [[material]] of this name")
    };
    match &section.scattering {
        ScatteringSection::Diffuse(diffuse) => {
            let terms = reflectance(context, &at.field("reflectance"), &diffuse.reflectance, grid)?;
            let base = Lambertian { reflectance: terms, states: None };
            Ok(match gloss(context, &at.field("gloss"), diffuse.gloss.as_ref())? {
                None => Scattering::Lambertian(base),
                Some(coat) => Scattering::Coated(Coated { base, coat }),
            })
        }
        // Resolved together with its fluorophores.
        ScatteringSection::Tissue(_) => Ok(Scattering::default()),
        ScatteringSection::Dielectric(glass) => {
            let index = glass.refractive_index;
            if !(index > 1.0 && index <= f64::from(MAX_DIELECTRIC_INDEX)) {
                let message = format!("must be above 1 and at most {MAX_DIELECTRIC_INDEX}");
                return context.fail(&at.field("refractive_index"), message);
            }
            let roughness = context.texture(&at.field("roughness"), &glass.roughness, 1.0)?;
            let transmittance_at = at.field("transmittance");
            let transmittance =
                context.spectrum(&transmittance_at, &glass.transmittance, Role::Filter, 0.0, grid)?;
            Ok(Scattering::Dielectric(Dielectric {
                refractive_index: index as f32,
                roughness,
                transmittance,
                single_scattering: glass.single_scattering,
            }))
        }
        ScatteringSection::Conductor(metal) => {
            let roughness = context.texture(&at.field("roughness"), &metal.roughness, 1.0)?;
            let (n, k) = metal_index(context, &at.field("metal"), &metal.metal, grid)?;
            Ok(Scattering::Conductor(Conductor {
                n,
                k,
                roughness,
                single_scattering: metal.single_scattering,
            }))
        }
        ScatteringSection::Mix(mix) => {
            let first = part(context, "first", &mix.first)?;
            let second = part(context, "second", &mix.second)?;
            let amount = context.texture(&at.field("amount"), &mix.amount, 1.0)?;
            Ok(Scattering::Mixture(Mixture { first, second, amount }))
        }
        ScatteringSection::TwoSided(sides) => {
            let front = part(context, "front", &sides.front)?;
            let back = part(context, "back", &sides.back)?;
            Ok(Scattering::TwoSided(TwoSided { front, back }))
        }
    }
}

/// Real part of the refractive index and extinction coefficient of a metal.
fn metal_index(
    context: &mut Context<'_>,
    at: &Place,
    reference: &MetalReference,
    grid: &WavelengthGrid,
) -> Resolved<(Curve, Curve)> {
    match reference {
        MetalReference::Name(name) => {
            let preset = preset::metal(name).map_err(|error| context.error(at, error))?;
            context.note_preset("metal", name, &preset);
            Ok(preset.index())
        }
        MetalReference::Index(MetalIndex { n, k }) => {
            let mut part = |key: &str, reference: &SpectrumReference| {
                let at = at.field(key);
                if reference.catalogue_name().is_some() {
                    let message = "n and k cannot be named separately from the catalogue; write metal = \"gold\", or give n and k \
                                   each as a number, a table or a CSV file";
                    return context.fail(&at, message);
                }
                context.spectrum(&at, reference, Role::Absolute, 0.0, grid)
            };
            Ok((part("n", n)?, part("k", k)?))
        }
    }
}

fn normal_map(context: &mut Context<'_>, at: &Place, section: &NormalMapSection) -> Resolved<NormalMap> {
    let strength_at = at.field("strength");
    let strength = context.within(&strength_at, section.strength, [0.0, 10.0], "")? as f32;
    let at = at.field("image");
    context.note_input(&at, &section.image)?;
    let image = read_texture_png(section.image.as_ref(), Transfer::Linear)
        .map_err(|e| context.file_error(&at, &e))?;
    if image.channels < 3 {
        return context.fail(&at, "a normal map has red, green and blue; this image is gray");
    }
    let rgb: Vec<f32> =
        image.data.chunks_exact(image.channels).flat_map(|pixel| pixel[..3].to_vec()).collect();
    NormalMap::from_rgb(image.width, image.height, &rgb, strength)
        .map_err(|error| context.error(&at, error.to_string()))
}

/// The terms of a reflectance.
fn reflectance(
    context: &mut Context<'_>,
    at: &Place,
    reference: &ReflectanceReference,
    grid: &WavelengthGrid,
) -> Resolved<Vec<ReflectanceTerm>> {
    let terms = match reference {
        ReflectanceReference::Spectrum(reference) => {
            let spectrum = context.spectrum(at, reference, Role::Reflectance, 0.0, grid)?;
            return Ok(vec![ReflectanceTerm { spectrum, weight: ScalarTexture::Constant(1.0) }]);
        }
        ReflectanceReference::Sum(terms) if terms.is_empty() => {
            return context
                .fail(at, "the sum has no terms; give at least one { spectrum, weight }, or 0 for black");
        }
        ReflectanceReference::Sum(terms) => terms,
    };
    let mut sum = Vec::with_capacity(terms.len());
    for (index, term) in terms.iter().enumerate() {
        let at = at.index(index);
        let spectrum =
            context.spectrum(&at.field("spectrum"), &term.spectrum, Role::Reflectance, 0.0, grid)?;
        let weight = context.texture(&at.field("weight"), &term.weight, 1e3)?;
        sum.push(ReflectanceTerm { spectrum, weight });
    }
    Ok(sum)
}

/// Fluorophores on a surface.
fn concentrations(
    context: &mut Context<'_>,
    at: &Place,
    section: &MaterialSection,
    file: &ExperimentFile,
    fluorophores: &mut Fluorophores,
) -> Resolved<Vec<FluorophoreAmount>> {
    let mut amounts = Vec::new();
    for (name, reference) in section.concentrations().into_iter().flatten() {
        let at = at.field("concentrations").field(name);
        if matches!(reference, TextureReference::Constant(value) if *value < 0.0) {
            return context.fail(&at, "a concentration can't be negative; give 0 or more");
        }
        let concentration = context.texture(&at, reference, MAX_CONCENTRATION)?;
        if concentration.max() > 0.0 {
            let fluorophore = fluorophores.index(context, &at, &file.fluorophore, name)?;
            amounts.push(FluorophoreAmount::new(fluorophore, concentration));
        } else if preset::fluorophore(name).is_err() && !file.fluorophore.iter().any(|f| f.name == *name) {
            return Err(unknown(context, &at, &file.fluorophore, name));
        }
    }
    Ok(amounts)
}

fn material(
    context: &mut Context<'_>,
    at: &Place,
    section: &MaterialSection,
    scattering: Scattering,
    amounts: Vec<FluorophoreAmount>,
) -> Resolved<Material> {
    let opacity = match &section.opacity {
        None => None,
        Some(opacity) => Some(context.texture(&at.field("opacity"), opacity, 1.0)?),
    };
    let normal_map = match &section.normal_map {
        None => None,
        Some(map) => Some(normal_map(context, &at.field("normal_map"), map)?),
    };
    Ok(Material { name: section.name.clone(), scattering, fluorophores: amounts, opacity, normal_map })
}
