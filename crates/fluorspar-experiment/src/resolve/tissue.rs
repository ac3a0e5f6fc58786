//! Layered tissue as a material.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::context::{Context, KnownFluorophore, Resolved};
use super::emitter::known_emitter;
use super::fluorophore::{Fluorophores, MAX_CONCENTRATION};
use super::gloss::gloss;
use super::named_tissue::{NamedTissue, of_section};
use crate::ExperimentError;
use crate::cache::cached_tissue;
use crate::error::{Message, Place, steps};
use crate::preset::{self, PresetKind};
use crate::schema::{
    ExperimentFile, FluorophoreSection, GlossSection, LesionSection, TissueMaterialSection, TissueSection,
};
use fluorspar::material::{
    Coat, FluorophoreAmount, INTERPOLATION_ERROR, MAX_MAPPED_PARAMETERS, MappedParameter, Material,
    ScalarTexture, Scattering, StateGrid, SurfaceFluorescence, TissueSurface,
};
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar::scene::{Object, rough_surface_mean};
use fluorspar::spectral::{Curve, Fluorophore, WavelengthGrid};
use fluorspar::study::StudyTissue;
use fluorspar::tissue::{
    EffectiveTissue, LayeredTissue, Level, TissueError, TissueState, diffuse_reflectance,
};

/// Largest factor on a parameter of tissue over a surface.
const MAX_FACTOR: f64 = 100.0;

/// Wavelengths over which the absorption of hemoglobin is known, nm; beyond them it is that of the nearer end.
const HEMOGLOBIN_NM: [f64; 2] = [350.0, 750.0];

/// What a material of tissue is made of, kept so that lesions can change it.
#[derive(Clone, Debug)]
pub(crate) struct TissueRecipe {
    at: Place,
    tissue: NamedTissue,
    /// Names of the fluorophores that it holds.
    held: Vec<String>,
    /// What changes over the surface.
    variations: Vec<Variation>,
    /// Factors on what the tissue holds of a fluorophore.
    factors: Vec<(String, ScalarTexture)>,
    coat: Coat,
    /// Whether light leaves at some distance from where it enters.
    translucent: bool,
}

/// A change of a tissue over the surface.
#[derive(Clone, Debug)]
struct Variation {
    name: String,
    map: ScalarTexture,
    /// What changes inside of a spot, where the map is 1; of a single parameter the map itself is the factor.
    inside: Option<Inside>,
}

/// What changes inside of a spot.
#[derive(Clone, Debug, Default, PartialEq)]
struct Inside {
    /// States of the site, one after the other.
    states: Vec<TissueState>,
    /// Factors on parameters.
    factors: Vec<(String, f64)>,
}

impl Variation {
    /// Changes a site as it is where the map has a value.
    fn apply(&self, tissue: &mut NamedTissue, value: f64) -> Result<(), TissueError> {
        match &self.inside {
            None => tissue.scale(&self.name, value),
            Some(Inside { states, factors }) => {
                if let NamedTissue::Site(site) = tissue {
                    states.iter().try_for_each(|state| site.apply_share(state, value))?;
                }
                factors.iter().try_for_each(|(name, factor)| tissue.scale(name, 1.0 + value * (factor - 1.0)))
            }
        }
    }

    /// The map with its nodes: a spot is there or not, and mixes with what is around in its rim.
    fn parameter(&self) -> MappedParameter {
        let nodes = if self.inside.is_some() { vec![0.0, 1.0] } else { Vec::new() };
        MappedParameter { nodes, ..MappedParameter::without_nodes(self.name.clone(), self.map.clone()) }
    }
}

/// Checks the tissues of a file, used or not.
pub(crate) fn check_sections(
    context: &mut Context<'_>,
    sections: &[TissueSection],
    fluorophores: &[FluorophoreSection],
    grid: &WavelengthGrid,
) -> Resolved<()> {
    for (index, section) in sections.iter().enumerate() {
        let at = steps!["tissue", index];
        context.unique_name(&at, &section.name, sections[..index].iter().map(|other| other.name.as_str()))?;
        let named = of_section(context, &at, section, fluorophores, grid)?;
        check_balance(context, &at, section, &named, fluorophores, grid)?;
    }
    Ok(())
}

/// Refuses a section whose layers emit more photons than they absorb.
pub(crate) fn check_balance(
    context: &mut Context<'_>,
    at: &Place,
    section: &TissueSection,
    named: &NamedTissue,
    fluorophores: &[FluorophoreSection],
    grid: &WavelengthGrid,
) -> Resolved<()> {
    let changes = [
        ("layer", !section.layer.is_empty()),
        ("parameters", !section.parameters.is_empty()),
        ("states", !section.states.is_empty()),
    ];
    let Some((field, _)) = changes.iter().find(|(_, changed)| *changed) else { return Ok(()) };
    let layers = Layers::new(context, at, fluorophores, named)?;
    let balance = layers.of(named).and_then(|tissue| tissue.check_photon_balance(&grid.centers_nm()));
    balance.map_err(|error| context.error(&at.field(*field), error.to_string()))
}

/// A tissue by name: from the sections of the file, otherwise a site of the catalogue.
pub(crate) fn named_tissue(
    context: &mut Context<'_>,
    at: &Place,
    sections: &[TissueSection],
    fluorophores: &[FluorophoreSection],
    grid: &WavelengthGrid,
    name: &str,
) -> Resolved<NamedTissue> {
    if let Some(index) = sections.iter().position(|section| section.name == name) {
        return of_section(context, &steps!["tissue", index], &sections[index], fluorophores, grid);
    }
    let Ok(site) = preset::site(name) else {
        let sites = preset::names(PresetKind::Site);
        let known: Vec<&str> = sections.iter().map(|section| section.name.as_str()).chain(sites).collect();
        let message = Message::unknown(format!("there is no tissue \"{}\"", excerpt(name)), name, known);
        return context.fail(at, message);
    };
    context.note_site(at, name, &site)?;
    Ok(NamedTissue::Site(site))
}

/// The layers of a tissue, with fluorophores of the sections of the file, otherwise of the catalogue.
pub(crate) struct Layers(Vec<KnownFluorophore>);

impl Layers {
    /// Looks for all fluorophores that the tissue may hold.
    pub(crate) fn new(
        context: &mut Context<'_>,
        at: &Place,
        sections: &[FluorophoreSection],
        tissue: &NamedTissue,
    ) -> Resolved<Self> {
        let names = tissue.fluorophores();
        let emitters = names.iter().map(|name| known_emitter(context, at, sections, name));
        Ok(Self(emitters.collect::<Resolved<_>>()?))
    }

    /// The layers of the tissue, or of the same with other parameters.
    pub(crate) fn of(&self, tissue: &NamedTissue) -> Result<LayeredTissue, TissueError> {
        tissue.tissue(&|name| self.find(name))
    }

    fn find(&self, name: &str) -> Option<Arc<Fluorophore>> {
        let known = self.0.iter().find(|emitter| emitter.fluorophore.name == name);
        known.map(|emitter| emitter.fluorophore.clone())
    }
}

impl TissueRecipe {
    /// What a section says.
    pub(super) fn new(
        context: &mut Context<'_>,
        at: &Place,
        section: &TissueMaterialSection,
        file: &ExperimentFile,
        grid: &WavelengthGrid,
    ) -> Resolved<Self> {
        let at_tissue = at.field("tissue");
        let named =
            named_tissue(context, &at_tissue, &file.tissue, &file.fluorophore, grid, &section.tissue)?;
        let mut variations = Vec::new();
        for (name, reference) in &section.vary {
            let at = at.field("vary").field(name);
            check_parameter(context, &at, &named, name)?;
            let map = context.texture(&at, reference, MAX_FACTOR)?;
            variations.push(Variation { name: name.clone(), map, inside: None });
        }
        let layers = Layers::new(context, at, &file.fluorophore, &named)?;
        let tissue = layers.of(&named).map_err(|error| context.error(&at_tissue, error.to_string()))?;
        let held: Vec<String> = fluorophores_of(&tissue);
        let mut factors = Vec::new();
        for (name, reference) in &section.concentrations {
            let at = at.field("concentrations").field(name);
            check_held(context, &at, &named, &held, name)?;
            factors.push((name.clone(), context.texture(&at, reference, MAX_CONCENTRATION)?));
        }
        let gloss_at = at.field("gloss");
        let index = tissue.surface_index();
        let wet = GlossSection { refractive_index: index, ..GlossSection::default() };
        let wet = section.gloss.as_ref().unwrap_or(&wet);
        let Some(coat) = gloss(context, &gloss_at, Some(wet))? else {
            return context.fail(&gloss_at, "tissue has a wet surface");
        };
        if (wet.refractive_index - index).abs() > 1e-3 {
            let message = format!(
                "tissue \"{}\" has the refractive index {index}: give that, or leave it out",
                named.name()
            );
            return context.fail(&gloss_at.field("refractive_index"), message);
        }
        let translucent = section.translucent;
        let recipe = Self { at: at.clone(), tissue: named, held, variations, factors, coat, translucent };
        recipe.check_number(context, &at.field("vary"))?;
        Ok(recipe)
    }

    /// Refuses a lesion with a factor on what the tissue does not hold.
    pub(super) fn check_lesion(
        &self,
        context: &Context<'_>,
        at: &Place,
        lesion: &LesionSection,
    ) -> Resolved<()> {
        let at = at.field("concentrations");
        let mut names = lesion.concentrations.keys();
        names.try_for_each(|name| check_held(context, &at.field(name), &self.tissue, &self.held, name))
    }

    /// The same with a lesion where `mask` is 1. `bake` combines a texture with its value inside.
    pub(super) fn with_lesion(
        &self,
        context: &mut Context<'_>,
        at: &Place,
        lesion: &LesionSection,
        mask: ScalarTexture,
        bake: impl Fn(&ScalarTexture, f32) -> ScalarTexture,
    ) -> Resolved<Self> {
        let refused = [("blood_um", lesion.blood_um != 0.0), ("reflectance", lesion.reflectance.is_some())];
        if let Some(&(field, _)) = refused.iter().find(|(_, given)| *given) {
            let message = "the part is layered tissue: give states = [\"hyperemia\"] or tissue = { superficial_blood_fraction = 10.0 } \
                           instead";
            return context.fail(&at.field(field), message);
        }
        let mut inside = Inside::default();
        for (index, name) in lesion.states.iter().enumerate() {
            let at = at.field("states").index(index);
            let state = context.state(&at, name)?;
            if let NamedTissue::Layers { name, .. } = &self.tissue {
                let message = format!(
                    "states are known of sites of the catalogue; \"{name}\" is described by its layers: give factors on their \
                     parameters, tissue = {{ ... }}"
                );
                return context.fail(&at, message);
            }
            inside.states.push(state);
        }
        for (name, factor) in &lesion.tissue {
            let at = at.field("tissue").field(name);
            check_parameter(context, &at, &self.tissue, name)?;
            inside.factors.push((name.clone(), context.within(&at, *factor, [0.0, MAX_FACTOR], "")?));
        }
        let mut changed = self.clone();
        for (name, factor) in &lesion.concentrations {
            match changed.factors.iter_mut().find(|(known, _)| known == name) {
                Some((_, texture)) => *texture = bake(texture, *factor as f32),
                None => {
                    changed.factors.push((name.clone(), bake(&ScalarTexture::Constant(1.0), *factor as f32)))
                }
            }
        }
        if inside != Inside::default() {
            let name = format!("lesion {}", lesion.name);
            changed.variations.push(Variation { name, map: mask, inside: Some(inside) });
        }
        changed.check_number(context, at)?;
        Ok(changed)
    }

    fn check_number(&self, context: &Context<'_>, at: &Place) -> Resolved<()> {
        let varying = self.variations.iter().filter(|change| change.map.constant().is_none());
        let names: Vec<&str> = varying.map(|change| change.name.as_str()).collect();
        if names.len() <= MAX_MAPPED_PARAMETERS {
            return Ok(());
        }
        let material = context.document.error(&self.at, "").0.entry.unwrap_or_default();
        let message = format!(
            "the tissue of {material} varies by {}, {}; at most {MAX_MAPPED_PARAMETERS} can vary. Give a number in place of a map of \
             its `vary`, or move or remove a lesion",
            names.len(),
            names.join(", ")
        );
        context.fail(at, message)
    }

    /// Solves the tissue in all its states.
    pub(super) fn surface(
        &self,
        context: &mut Context<'_>,
        file: &ExperimentFile,
        grid: &WavelengthGrid,
    ) -> Resolved<TissueSurface> {
        let layers = Layers::new(context, &self.at, &file.fluorophore, &self.tissue)?;
        let mut named = self.tissue.clone();
        let mut varying = Vec::new();
        for change in &self.variations {
            match change.map.constant() {
                Some(value) => {
                    change.apply(&mut named, value.into()).map_err(|error| self.failed(context, &error))?;
                }
                None => varying.push(change),
            }
        }
        let tissue = |values: &[f64]| {
            let mut state = named.clone();
            varying.iter().zip(values).try_for_each(|(change, value)| change.apply(&mut state, *value))?;
            let tissue = layers.of(&state)?;
            tissue.check_photon_balance(&grid.centers_nm())?;
            Ok(tissue)
        };
        let parameters: Vec<MappedParameter> = varying.iter().map(|change| change.parameter()).collect();
        let key = self.key(&named, &layers, &varying, &parameters, grid);
        let maps = parameters.iter().map(|p| (p.name.clone(), p.map.clone())).collect();
        let make = || TissueSurface::varying(parameters, tissue, grid, self.translucent);
        let surface = cached_tissue(&key, maps, &|name| layers.find(name), make)
            .map_err(|error| self.failed(context, &error))?;
        if surface.error > INTERPOLATION_ERROR {
            let percent = 100.0 * surface.error;
            let message = format!(
                "between its states the tissue is up to {percent:.1} % off, in reflectance or fluorescence; a narrower range of \
                 the maps is more exact"
            );
            context.warn(&self.at.field("vary"), message);
        }
        Ok(surface)
    }

    /// All that the states of the tissue depend on: the site with its parameters, what is held by which layers, how it
    /// varies between which values, and the wavelengths.
    fn key(
        &self,
        named: &NamedTissue,
        layers: &Layers,
        varying: &[&Variation],
        parameters: &[MappedParameter],
        grid: &WavelengthGrid,
    ) -> String {
        // Debug text of finite numbers is exact: it reads back to the same bits.
        let range = [grid.start_nm(), grid.end_nm()];
        let mut key = format!("tissue 2 {} {} {range:?}", self.translucent, named.key());
        for emitter in &layers.0 {
            key += &format!("\n{} {}", emitter.fluorophore.name, emitter.sha256);
        }
        for (change, MappedParameter { name, nodes, map, .. }) in varying.iter().zip(parameters) {
            key += &format!("\n{name} {:?} {nodes:?} {:?} {:?}", change.inside, map.min(), map.max());
        }
        key
    }

    fn failed(&self, context: &Context<'_>, error: &TissueError) -> ExperimentError {
        context.error(&self.at.field("tissue"), error.to_string())
    }

    /// Reflection and fluorophores of the material.
    pub(super) fn resolve(
        &self,
        context: &mut Context<'_>,
        file: &ExperimentFile,
        grid: &WavelengthGrid,
        fluorophores: &mut Fluorophores,
    ) -> Resolved<(Scattering, Vec<FluorophoreAmount>)> {
        context.note_range(&self.at.field("tissue"), HEMOGLOBIN_NM, grid);
        let surface = self.surface(context, file, grid)?;
        let mut amounts = Vec::new();
        for (number, emission) in surface.emissions.iter().enumerate() {
            let name = &emission.fluorophore.name;
            let given =
                self.factors.iter().find(|(known, _)| known == name).map(|(_, factor)| factor.clone());
            let factor = given.unwrap_or(ScalarTexture::Constant(1.0));
            if factor.max() > 0.0 {
                let index = fluorophores.index(context, &self.at, &file.fluorophore, name)?;
                amounts.extend(surface.amounts(number, index, &factor));
            }
        }
        let scattering = Material::with_base("", surface.base(), Some(self.coat.clone())).scattering;
        Ok((scattering, amounts))
    }
}

/// The layered tissues of a scene in their mean states, for what is told about them beside the image. Recipes stand under the
/// numbers of their materials.
pub(super) fn study_tissues(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    materials: &[Material],
    recipes: &BTreeMap<usize, TissueRecipe>,
    objects: &[Object],
) -> Resolved<Vec<StudyTissue>> {
    let mut tissues = Vec::new();
    for (&index, recipe) in recipes {
        let of_material = || objects.iter().filter(move |object| object.material == index);
        let parts: Vec<String> = of_material().map(|object| object.name.clone()).collect();
        if parts.is_empty() {
            continue;
        }
        let layers = Layers::new(context, &recipe.at, &file.fluorophore, &recipe.tissue)?;
        let mut named = recipe.tissue.clone();
        for change in &recipe.variations {
            let mean = rough_surface_mean(&change.map, of_material().map(|object| &object.shape));
            change.apply(&mut named, mean).map_err(|error| recipe.failed(context, &error))?;
        }
        let mut tissue = layers.of(&named).map_err(|error| recipe.failed(context, &error))?;
        for held in tissue.layers.iter_mut().flat_map(|layer| &mut layer.fluorophores) {
            let is_held = |(name, _): &&(String, ScalarTexture)| *name == held.fluorophore.name;
            if let Some((name, map)) = recipe.factors.iter().find(is_held) {
                if held.quantum_yield.is_some() && [map.min(), map.max()] != [1.0; 2] {
                    context.warn(&recipe.at, light_alone(name));
                }
                held.strength_per_mm *= rough_surface_mean(map, of_material().map(|object| &object.shape));
            }
        }
        tissues.push(StudyTissue { name: materials[index].name.clone(), parts, tissue });
    }
    Ok(tissues)
}

/// A dye absorbs in proportion to its amount, so that its light does not follow a factor.
fn light_alone(dye: &str) -> String {
    format!(
        "factors on \"{}\" scale its light and leave what it absorbs; give its layer another amount instead",
        excerpt(dye)
    )
}

/// A tissue as a flat, matte sample: what its surface sends back under diffuse light, without its specular reflection.
pub(crate) struct FlatTissue {
    /// Reflectance.
    pub(crate) reflectance: Curve,
    /// What it holds, each as its surface emits.
    pub(crate) fluorophores: Vec<Fluorophore>,
}

/// A tissue by name as a flat sample.
pub(crate) fn flat_tissue(
    context: &mut Context<'_>,
    at: &Place,
    tissues: &[TissueSection],
    fluorophores: &[FluorophoreSection],
    name: &str,
    grid: &WavelengthGrid,
) -> Resolved<FlatTissue> {
    check_sections(context, tissues, fluorophores, grid)?;
    let named = named_tissue(context, at, tissues, fluorophores, grid, name)?;
    let layers = Layers::new(context, at, fluorophores, &named)?;
    flat_layers(context, at, &layers, &named, grid)
}

/// A tissue with known fluorophores as a flat sample.
pub(crate) fn flat_layers(
    context: &Context<'_>,
    at: &Place,
    layers: &Layers,
    named: &NamedTissue,
    grid: &WavelengthGrid,
) -> Resolved<FlatTissue> {
    let failed = |error: TissueError| context.error(at, error.to_string());
    let tissue = layers.of(named).map_err(failed)?;
    let solved = EffectiveTissue::for_grid(&tissue, grid).map_err(failed)?;
    let reflectance = solved.reflectance(Level::AboveSurface);
    let surface = TissueSurface::new(StateGrid::default(), &[solved]).map_err(failed)?;
    // What the material has below its surface, with the share of diffuse light that the surface lets in
    let passed = 1.0 - diffuse_reflectance(1.0, tissue.surface_index());
    let as_seen = |emission: &SurfaceFluorescence| {
        let eem = emission.states.first()?;
        Some(Fluorophore {
            eem: eem.as_ref().clone().scaled(passed),
            ..emission.fluorophore.as_ref().clone()
        })
    };
    Ok(FlatTissue { reflectance, fluorophores: surface.emissions.iter().filter_map(as_seen).collect() })
}

/// Names of the fluorophores of a tissue, each once.
fn fluorophores_of(tissue: &LayeredTissue) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for held in tissue.layers.iter().flat_map(|layer| &layer.fluorophores) {
        if !names.contains(&held.fluorophore.name) {
            names.push(held.fluorophore.name.clone());
        }
    }
    names
}

/// Refuses a factor on a fluorophore that the tissue does not hold: it would change nothing.
fn check_held(
    context: &Context<'_>,
    at: &Place,
    tissue: &NamedTissue,
    held: &[String],
    name: &str,
) -> Resolved<()> {
    if held.iter().any(|known| known == name) {
        return Ok(());
    }
    let hint = did_you_mean(name, held.iter().map(String::as_str));
    let remedy = match tissue {
        NamedTissue::Layers { .. } => "Give it a strength in a layer of the [[tissue]]",
        NamedTissue::Site(site) if site.fluorophores().contains(&name) => {
            "Its strength is 0: give it one among the parameters of a [[tissue]]"
        }
        NamedTissue::Site(_) => {
            "Give it to a layer of a [[tissue]] of that site: [[tissue.layer]] with a name and fluorophores"
        }
    };
    let message = format!(
        "tissue \"{}\" holds no {}{hint} It holds: {}. {remedy}",
        tissue.name(),
        excerpt(name),
        held.join(", ")
    );
    context.fail(at, message)
}

/// Refuses the name of a parameter that the tissue does not have.
fn check_parameter(context: &Context<'_>, at: &Place, tissue: &NamedTissue, name: &str) -> Resolved<()> {
    let parameters = tissue.parameters();
    if let Some((_, value)) = parameters.iter().find(|(known, _)| known == name) {
        if *value != 0.0 {
            return Ok(());
        }
        let message =
            "is 0 in this tissue, so that a factor changes nothing; give it a value in a [[tissue]]";
        return context.fail(at, message);
    }
    let known = parameters.iter().map(|(known, _)| known.as_str());
    let message =
        Message::unknown(format!("tissue \"{}\" has no such parameter", tissue.name()), name, known);
    context.fail(at, message)
}
