//! Regions of a design problem: surfaces and layered tissue as responses to any light.

use std::f64::consts::PI;

use fluorspar::design::{
    ChangeGrowth, Cohort, ExcitationBasis, FluorescenceResponse, RegionModel, RegionResponse, ResponseChange,
};
use fluorspar::sampling::random::Key;
use fluorspar::spectral::{Curve, Fluorophore, WavelengthGrid, blood_transmittance};
use fluorspar::tissue::{Population, Site};

use super::schema::{CohortSection, DesignFile, RegionSection};
use crate::error::{Place, steps};
use crate::part_file::sample::{SampleMaterial, Sampled, material};
use crate::resolve::context::{Context, Resolved};
use crate::resolve::named_tissue::NamedTissue;
use crate::resolve::tissue::{FlatTissue, Layers, check_sections, flat_layers, named_tissue};

/// Name of all fluorophores together that have no weight of their own.
pub(super) const BULK: &str = "bulk";

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
    let at_material = at.field("material");
    let mut model = flat_region(context, &at_material, file, &section.name, material, axes)?;
    let held = || model.response.fluorescence.iter().map(|part| part.name.as_str());
    context.check_names(
        &at.field("apart"),
        &section.apart,
        held(),
        "the region holds no such fluorophore",
    )?;
    if !section.apart.is_empty() {
        let is_apart: Vec<bool> = held().map(|name| section.apart.iter().any(|own| own == name)).collect();
        with_bulk(&mut model.response, &section.apart);
        for change in &mut model.changes {
            change.fluorescence = bulk_first(std::mem::take(&mut change.fluorescence), &is_apart);
        }
    }
    Ok(model)
}

/// Values of all fluorophores, the sum of those that are not apart first.
fn bulk_first(parts: Vec<Vec<f64>>, is_apart: &[bool]) -> Vec<Vec<f64>> {
    let mut bulk: Option<Vec<f64>> = None;
    let mut own = Vec::new();
    for (part, is_apart) in parts.into_iter().zip(is_apart) {
        match &mut bulk {
            _ if *is_apart => own.push(part),
            None => bulk = Some(part),
            Some(sum) => sum.iter_mut().zip(part).for_each(|(sum, value)| *sum += value),
        }
    }
    bulk.into_iter().chain(own).collect()
}

/// Takes all fluorophores of a region but some together as one.
pub(super) fn with_bulk(region: &mut RegionResponse, apart: &[String]) {
    let held = std::mem::take(&mut region.fluorescence);
    let (own, others): (Vec<_>, Vec<_>) = held.into_iter().partition(|part| apart.contains(&part.name));
    let mut bulk = FluorescenceResponse {
        name: BULK.into(),
        amount: others.iter().map(|part| part.amount).sum(),
        radiance: vec![0.0; region.grid.len() * region.excitation.len()],
    };
    for part in &others {
        bulk.radiance.iter_mut().zip(&part.radiance).for_each(|(sum, value)| *sum += value);
    }
    // A region whose fluorophores are all apart has no other light
    let bulk = (!others.is_empty()).then_some(bulk);
    region.fluorescence = bulk.into_iter().chain(own).collect();
}

/// A flat material, with what is not known of it: of a surface a layer of blood above it, of layered tissue what varies among people.
fn flat_region(
    context: &mut Context<'_>,
    at: &Place,
    file: &DesignFile,
    name: &str,
    section: &SampleMaterial,
    axes: &Axes<'_>,
) -> Resolved<RegionModel> {
    let (experiment, unknown) = (&file.experiment, &file.question.unknown);
    let of_file = (experiment.tissue.as_slice(), experiment.fluorophore.as_slice());
    if let SampleMaterial::Tissue(_) = section {
        check_sections(context, of_file.0, of_file.1, axes.grid)?;
    }
    let Sampled { reflectance, fluorophores: held, .. } = material(context, at, section, of_file, axes.grid)?;
    let at_amounts = at.field("concentrations");
    if held.is_empty() {
        let message = "the region holds no fluorophore, so there is no weight to estimate; add for instance { nadh = 1.0 }";
        return context.fail(&at_amounts, message);
    }
    for (fluorophore, amount) in &held {
        let at = at_amounts.field(&fluorophore.name);
        context.within(&at, *amount, [1e-9, 1e6], "; leave out what the region does not hold")?;
    }
    let response = RegionResponse::flat(name, axes.grid, &axes.nodes_nm, &reflectance, &held);
    let SampleMaterial::Tissue(tissue) = section else {
        let mut model = RegionModel::known(response);
        model.changes.extend(change_by_blood(&model.response, unknown.blood_um));
        return Ok(model);
    };
    let mut model = RegionModel::known(response.counted_by_light());
    if unknown.tissue > 0.0 {
        let at = at.field("tissue");
        let typical = named_tissue(context, &at, of_file.0, of_file.1, axes.grid, &tissue.tissue)?;
        let layers = Layers::new(context, &at, of_file.1, &typical)?;
        let factors: Vec<f64> = held.iter().map(|(_, factor)| *factor).collect();
        for (variation, moved) in moved_sites(typical.site(context, &at)?, unknown.tissue) {
            let moved = flat_layers(context, &at, &layers, &NamedTissue::Site(moved), axes.grid)?;
            let moved = respond(name, &moved, &factors, axes);
            let change = ResponseChange::between(variation, &model.response, &moved, ChangeGrowth::Linear);
            model.changes.extend(change);
        }
    }
    Ok(model)
}

/// What a layer of whole blood of a thickness changes of a region, where there is one.
pub(super) fn change_by_blood(region: &RegionResponse, thickness_um: f64) -> Option<ResponseChange> {
    if thickness_um <= 0.0 {
        return None;
    }
    ResponseChange::between("blood", region, &below_blood(region, thickness_um), ChangeGrowth::Attenuation)
}

/// The same region below a layer of whole blood that light passes twice.
fn below_blood(region: &RegionResponse, thickness_um: f64) -> RegionResponse {
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

/// A change of the tissue of a rendered region at one standard deviation, as factors on what the region sends.
///
/// Light of a scene meets the same tissue at each of its bounces, and the factor of flat tissue is that of one: the bound is for the light
/// that comes directly from the lamps, most of it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TissueFactors {
    name: String,
    /// Change of fluorescence over fluorescence, `[band][node]`.
    fluorescence: Vec<f64>,
    /// The same of reflected light.
    reflected: Curve,
}

impl TissueFactors {
    /// What it changes of a region.
    pub(super) fn change_of(&self, region: &RegionResponse) -> ResponseChange {
        let of_part = |part: &FluorescenceResponse| {
            self.fluorescence.iter().zip(&part.radiance).map(|(factor, value)| factor * value).collect()
        };
        ResponseChange {
            name: self.name.clone(),
            fluorescence: region.fluorescence.iter().map(of_part).collect(),
            reflected: Some(region.reflected.times(&self.reflected)),
            growth: ChangeGrowth::Linear,
        }
    }
}

/// Fluorescence of all fluorophores, `[band][number of the basis]`.
fn total_radiance(region: &RegionResponse) -> Vec<f64> {
    let mut total = vec![0.0; region.grid.len() * region.excitation.len()];
    for part in &region.fluorescence {
        total.iter_mut().zip(&part.radiance).for_each(|(sum, value)| *sum += value);
    }
    total
}

/// What is not known of a rendered region that is one of some tissues: how its tissue varies among people and, where there are several,
/// which it is. Each of `n` tissues is as likely as the others: their differences from the mean, each times `1/sqrt(n)`, have the
/// covariance of the tissues, and the variations of each among people count by `1/sqrt(n)` as well.
pub(super) fn tissue_factors(
    context: &mut Context<'_>,
    at: &Place,
    file: &DesignFile,
    names: &[String],
    axes: &Axes<'_>,
) -> Resolved<Vec<TissueFactors>> {
    check_sections(context, &file.experiment.tissue, &file.experiment.fluorophore, axes.grid)?;
    let (spread, share) = (file.question.unknown.tissue, (names.len() as f64).sqrt().recip());
    let mut responses: Vec<(Vec<f64>, Curve)> = Vec::new();
    let mut found = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let at = at.index(index);
        context.unique_name(&at, name, names[..index].iter().map(String::as_str))?;
        let typical = named_tissue(
            context,
            &at,
            &file.experiment.tissue,
            &file.experiment.fluorophore,
            axes.grid,
            name,
        )?;
        let layers = Layers::new(context, &at, &file.experiment.fluorophore, &typical)?;
        let of = |context: &Context<'_>, tissue: &NamedTissue| -> Resolved<(Vec<f64>, Curve)> {
            let flat = flat_layers(context, &at, &layers, tissue, axes.grid)?;
            let region = respond(name, &flat, &vec![1.0; flat.fluorophores.len()], axes);
            Ok((total_radiance(&region), region.reflected))
        };
        let own = of(context, &typical)?;
        let site = typical.site(context, &at)?;
        for (variation, moved) in moved_sites(site, spread) {
            let name = if names.len() > 1 { format!("{variation} of {name}") } else { variation.to_owned() };
            found.push(factors_between(name, &own, &of(context, &NamedTissue::Site(moved))?, share));
        }
        responses.push(own);
    }
    if responses.len() > 1 {
        let mean = mean_response(&responses);
        for (name, response) in names.iter().zip(&responses) {
            found.push(factors_between(format!("tissue {name}"), &mean, response, spread * share));
        }
    }
    Ok(found)
}

/// A site with each of its variations among people moved by so many standard deviations, but for amounts, which are weights.
fn moved_sites(typical: &Site, spread: f64) -> Vec<(&'static str, Site)> {
    let population = Population::of(typical);
    let mut found = Vec::new();
    for (number, variation) in population.variations().iter().enumerate() {
        if variation.name.ends_with(AMOUNT_ENDING) {
            continue;
        }
        let mut deviations = vec![0.0; population.variations().len()];
        deviations[number] = spread;
        let moved = population.tissue_at(&deviations);
        if moved != *typical {
            found.push((variation.name, moved));
        }
    }
    found
}

/// Relative differences of two responses, times a factor.
fn factors_between(
    name: String,
    (fluorescence, reflected): &(Vec<f64>, Curve),
    (moved, moved_reflected): &(Vec<f64>, Curve),
    factor: f64,
) -> TissueFactors {
    let relative = |before: f64, after: f64| if before > 0.0 { factor * (after / before - 1.0) } else { 0.0 };
    let (first, last) = reflected.range_nm();
    TissueFactors {
        name,
        fluorescence: fluorescence
            .iter()
            .zip(moved)
            .map(|(before, after)| relative(*before, *after))
            .collect(),
        reflected: Curve::from_fn(first, last, |nm| relative(reflected.at(nm), moved_reflected.at(nm))),
    }
}

fn mean_response(responses: &[(Vec<f64>, Curve)]) -> (Vec<f64>, Curve) {
    let count = responses.len() as f64;
    let mut mean = vec![0.0; responses[0].0.len()];
    for (values, _) in responses {
        mean.iter_mut().zip(values).for_each(|(sum, value)| *sum += value / count);
    }
    let (first, last) = responses[0].1.range_nm();
    let of = |nm: f64| responses.iter().map(|(_, curve)| curve.at(nm)).sum::<f64>() / count;
    (mean, Curve::from_fn(first, last, of))
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
    let (tissues, fluorophores) = (&file.experiment.tissue, &file.experiment.fluorophore);
    let typical = named_tissue(context, &at_tissue, tissues, fluorophores, axes.grid, &section.tissue)?;
    let state = context.state(&at.field("state"), &section.state)?;
    let layers = Layers::new(context, &at_tissue, &file.experiment.fluorophore, &typical)?;
    let population = Population::of_people(typical.site(context, &at_tissue)?);
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
        tissue.apply(&state).map_err(|error| context.error(&at.field("state"), error.to_string()))?;
        altered.push(of(context, &tissue)?);
    }
    Ok(Cohort { name: format!("{} with {}", section.tissue, section.state), healthy, altered })
}

/// The response of a person, all fluorophores in one.
fn total_response(name: &str, flat: &FlatTissue, axes: &Axes<'_>) -> RegionResponse {
    let held: Vec<(Fluorophore, f64)> = flat.fluorophores.iter().map(|f| (f.clone(), 1.0)).collect();
    let apart = RegionResponse::flat(name, axes.grid, &axes.nodes_nm, &flat.reflectance, &held);
    let all = FluorescenceResponse { name: "all".into(), amount: 1.0, radiance: total_radiance(&apart) };
    RegionResponse {
        excitation: ExcitationBasis::Nodes(axes.nodes_nm.clone()),
        fluorescence: vec![all],
        reflected: flat.reflectance.scaled(1.0 / PI),
        ..apart
    }
}
