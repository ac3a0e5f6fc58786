//! Regions of a design problem: surfaces and layered tissue as responses to any light.

use std::f64::consts::PI;

use fluorspar::design::{
    ChangeGrowth, Cohort, ExcitationBasis, FluorescenceResponse, RegionModel, RegionResponse, ResponseChange,
};
use fluorspar::sampling::random::Key;
use fluorspar::spectral::{Curve, Fluorophore, WavelengthGrid, blood_transmittance};
use fluorspar::tissue::{Population, Site, TissueState};

use super::schema::{CohortSection, DesignFile, RegionSection};
use crate::error::{Place, steps};
use crate::resolve::context::{Context, Resolved};
use crate::resolve::fluorophore::Fluorophores;
use crate::resolve::named_tissue::NamedTissue;
use crate::resolve::spectrum::Role;
use crate::resolve::tissue::{FlatTissue, Layers, check_sections, flat_layers, named_tissue};
use crate::sample::{SampleMaterial, SampleSurface, SampleTissue};

/// Parameters of tissue whose spread is that of weights, which are estimated, end so.
const AMOUNT_ENDING: &str = "_per_mm";

/// Bands and nodes of all regions.
pub(super) struct Axes<'a> {
    pub(super) grid: &'a WavelengthGrid,
    pub(super) nodes_nm: Vec<f64>,
}

pub(super) fn region(
    context: &mut Context<'_>,
    at: &Place,
    file: &DesignFile,
    section: &RegionSection,
    axes: &Axes<'_>,
) -> Resolved<RegionModel> {
    let Some(material) = &section.material else {
        return context.fail(
            at,
            "give what the region is made of (material), or where it lies in the scene (rendered)",
        );
    };
    let at = at.field("material");
    match material {
        SampleMaterial::Surface(surface) => surface_region(context, &at, file, section, surface, axes),
        SampleMaterial::Tissue(tissue) => tissue_region(context, &at, file, section, tissue, axes),
    }
}

/// A surface with fluorophores; blood may lie above it.
fn surface_region(
    context: &mut Context<'_>,
    at: &Place,
    file: &DesignFile,
    section: &RegionSection,
    surface: &SampleSurface,
    axes: &Axes<'_>,
) -> Resolved<RegionModel> {
    let reflectance = context.spectrum(
        &at.field("reflectance"),
        &surface.reflectance,
        Role::Reflectance,
        0.0,
        axes.grid,
    )?;
    let mut found = Fluorophores::default();
    let mut amounts = Vec::new();
    for (name, &amount) in &surface.concentrations {
        let at = at.field("concentrations").field(name);
        context.within(&at, amount, [1e-9, 1e6], "; leave out what the region does not hold")?;
        found.index(context, &at, &file.fluorophore, name)?;
        amounts.push(amount);
    }
    if amounts.is_empty() {
        return context.fail(
            &at.field("concentrations"),
            "the region holds no fluorophore, so there is no weight to estimate; add for instance { nadh = 1.0 }",
        );
    }
    let held: Vec<(Fluorophore, f64)> = found.list.into_iter().zip(amounts).collect();
    let response = RegionResponse::flat(&section.name, axes.grid, &axes.nodes_nm, &reflectance, &held);
    let mut model = RegionModel::known(response);
    if file.unknown.blood_um > 0.0 {
        let moved = below_blood(&model.response, file.unknown.blood_um);
        model.changes.extend(ResponseChange::between(
            "blood",
            &model.response,
            &moved,
            ChangeGrowth::Attenuation,
        ));
    }
    Ok(model)
}

/// The same region below a layer of whole blood that light passes twice.
pub(super) fn below_blood(region: &RegionResponse, thickness_um: f64) -> RegionResponse {
    let passes = |nm: &f64| blood_transmittance(*nm, thickness_um);
    let emission: Vec<f64> = region.grid.centers_nm().iter().map(passes).collect();
    let excitation: Vec<f64> = region.excitation.centers_nm().iter().map(passes).collect();
    let columns = excitation.len();
    let below = |f: &FluorescenceResponse| FluorescenceResponse {
        radiance: f
            .radiance
            .iter()
            .enumerate()
            .map(|(k, value)| value * emission[k / columns] * excitation[k % columns])
            .collect(),
        ..f.clone()
    };
    let twice = Curve::from_fn(200.0, 1200.0, |nm| passes(&nm).powi(2));
    RegionResponse {
        fluorescence: region.fluorescence.iter().map(below).collect(),
        reflected: region.reflected.times(&twice),
        ..region.clone()
    }
}

/// Layered tissue, with what varies among people as unknowns.
fn tissue_region(
    context: &mut Context<'_>,
    at: &Place,
    file: &DesignFile,
    section: &RegionSection,
    tissue: &SampleTissue,
    axes: &Axes<'_>,
) -> Resolved<RegionModel> {
    let at_tissue = at.field("tissue");
    check_sections(context, &file.tissue, &file.fluorophore, axes.grid)?;
    let (tissues, fluorophores) = (&file.tissue, &file.fluorophore);
    let typical = named_tissue(context, &at_tissue, tissues, fluorophores, axes.grid, &tissue.tissue)?;
    let layers = Layers::new(context, &at_tissue, &file.fluorophore, &typical)?;
    let solved = flat_layers(context, &at_tissue, &layers, &typical, axes.grid)?;
    let mut factors = Vec::new();
    for fluorophore in &solved.fluorophores {
        factors.push(tissue.concentrations.get(&fluorophore.name).copied().unwrap_or(1.0));
    }
    for (name, &factor) in &tissue.concentrations {
        let at = at.field("concentrations").field(name);
        context.within(&at, factor, [1e-9, 1e6], "")?;
        if !solved.fluorophores.iter().any(|held| held.name == *name) {
            let known: Vec<&str> = solved.fluorophores.iter().map(|held| held.name.as_str()).collect();
            let message = format!("the tissue holds no such fluorophore. It holds: {}", known.join(", "));
            return context.fail(&at, message);
        }
    }
    let respond = |flat: &FlatTissue| respond(&section.name, flat, &factors, axes);
    let mut model = RegionModel::known(respond(&solved));
    let spread = file.unknown.tissue;
    if spread > 0.0 {
        let typical = typical.site(context, &at_tissue)?;
        let population = Population::of(typical);
        for (number, variation) in population.variations().iter().enumerate() {
            if variation.name.ends_with(AMOUNT_ENDING) {
                continue;
            }
            let mut deviations = vec![0.0; population.variations().len()];
            deviations[number] = spread;
            let moved = population.tissue_at(&deviations);
            if moved == *typical {
                continue;
            }
            let moved = NamedTissue::Site(moved);
            let moved = respond(&flat_layers(context, &at_tissue, &layers, &moved, axes.grid)?);
            model.changes.extend(ResponseChange::between(
                variation.name,
                &model.response,
                &moved,
                ChangeGrowth::Linear,
            ));
        }
    }
    Ok(model)
}

/// Amounts of what tissue holds have no common unit: in ratios each counts by the light that it sends.
fn respond(name: &str, flat: &FlatTissue, factors: &[f64], axes: &Axes<'_>) -> RegionResponse {
    let held: Vec<(Fluorophore, f64)> =
        flat.fluorophores.iter().cloned().zip(factors.iter().copied()).collect();
    RegionResponse::flat(name, axes.grid, &axes.nodes_nm, &flat.reflectance, &held).counted_by_light()
}

/// People with a tissue, and the same people with it in another state.
pub(super) fn cohort(
    context: &mut Context<'_>,
    file: &DesignFile,
    section: &CohortSection,
    axes: &Axes<'_>,
) -> Resolved<Cohort> {
    let at = steps!["cohort"];
    context.whole_within(&at.field("people"), u64::from(section.people), [4, 200])?;
    let at_tissue = at.field("tissue");
    let (tissues, fluorophores) = (&file.tissue, &file.fluorophore);
    let typical = named_tissue(context, &at_tissue, tissues, fluorophores, axes.grid, &section.tissue)?;
    let state = TissueState::named(&section.state)
        .map_err(|error| context.error(&at.field("state"), error.to_string()))?;
    let layers = Layers::new(context, &at_tissue, &file.fluorophore, &typical)?;
    let population = Population::of(typical.site(context, &at_tissue)?);
    let key = Key::new(section.seed).with_text("cohort");
    let of = |context: &Context<'_>, site: &Site| -> Resolved<RegionModel> {
        let named = NamedTissue::Site(site.clone());
        let flat = flat_layers(context, &at_tissue, &layers, &named, axes.grid)?;
        Ok(RegionModel::known(total_response(&section.tissue, &flat, axes)))
    };
    let (mut healthy, mut altered) = (Vec::new(), Vec::new());
    for person in 0..section.people {
        let mut tissue = population.draw(&mut key.with(u64::from(person)).rng());
        healthy.push(of(context, &tissue)?);
        tissue.apply(state).map_err(|error| context.error(&at.field("state"), error.to_string()))?;
        altered.push(of(context, &tissue)?);
    }
    Ok(Cohort { name: format!("{} with {}", section.tissue, section.state), healthy, altered })
}

/// The response of a person, all fluorophores in one.
fn total_response(name: &str, flat: &FlatTissue, axes: &Axes<'_>) -> RegionResponse {
    let held: Vec<(Fluorophore, f64)> = flat.fluorophores.iter().map(|f| (f.clone(), 1.0)).collect();
    let apart = RegionResponse::flat(name, axes.grid, &axes.nodes_nm, &flat.reflectance, &held);
    let mut radiance = vec![0.0; axes.grid.len() * axes.nodes_nm.len()];
    for part in &apart.fluorescence {
        radiance.iter_mut().zip(&part.radiance).for_each(|(sum, value)| *sum += value);
    }
    let all = FluorescenceResponse { name: "all".into(), amount: 1.0, radiance };
    RegionResponse {
        excitation: ExcitationBasis::Nodes(axes.nodes_nm.clone()),
        fluorescence: vec![all],
        reflected: flat.reflectance.scaled(1.0 / PI),
        ..apart
    }
}
