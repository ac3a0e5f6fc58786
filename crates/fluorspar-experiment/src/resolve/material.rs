//! Fluorophores and materials.

use super::context::{Context, Resolved};
use super::mouth;
use super::spectrum::Role;
use super::tissue::TissueRecipe;
use crate::error::{Place, steps};
use crate::preset::{self, PresetKind};
use crate::schema::{
    ExperimentFile, FilePath, FluorophoreSection, FluorophoreSource, GlossSection, MatSource,
    MaterialSection, MatrixSource, MetalIndex, MetalReference, NormalMapSection, ReflectanceReference,
    ScatteringSection, SpectraSource, SpectrumReference, TableSource, TextureReference,
};
use fluorspar::material::{
    Coat, Coated, Conductor, Dielectric, FluorophoreAmount, Lambertian, Material, Mixture, NormalMap,
    ReflectanceTerm, ScalarTexture, Scattering, TwoSided,
};
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar::spectral::{
    Curve, EemTable, EnergyEem, Fluorophore, PhotonEem, SeparableTerm, Stokes, WavelengthGrid, YieldUnit,
};
use fluorspar_format::{
    AntiStokes, CsvColumns, CsvEemOptions, CsvSpectrumOptions, EemUnit, Negative, Transfer, read_eem_csv,
    read_fluorophore_csv, read_iset_fluorophore, read_texture_png,
};

/// Largest concentration that is accepted.
pub(super) const MAX_CONCENTRATION: f64 = 1e6;

/// Fluorophores in use, in the order of their first use.
#[derive(Default)]
pub(crate) struct Fluorophores {
    pub(crate) list: Vec<Fluorophore>,
}

impl Fluorophores {
    /// Number of a fluorophore by name: from the sections of the file, otherwise from the catalogue.
    pub(crate) fn index(
        &mut self,
        context: &mut Context<'_>,
        at: &Place,
        sections: &[FluorophoreSection],
        name: &str,
    ) -> Resolved<usize> {
        if let Some(index) = self.list.iter().position(|fluorophore| fluorophore.name == name) {
            return Ok(index);
        }
        let fluorophore = match sections.iter().position(|section| section.name == name) {
            Some(index) => from_section(context, &steps!["fluorophore", index], &sections[index])?,
            None => {
                let Ok(preset) = preset::fluorophore(name) else {
                    return Err(unknown(context, at, sections, name));
                };
                context.note_preset("fluorophore", name, &preset);
                preset.fluorophore()
            }
        };
        self.list.push(fluorophore);
        Ok(self.list.len() - 1)
    }
}

pub(crate) fn unknown(
    context: &Context<'_>,
    at: &Place,
    sections: &[FluorophoreSection],
    name: &str,
) -> crate::ExperimentError {
    let mut known: Vec<&str> = sections.iter().map(|section| section.name.as_str()).collect();
    known.extend(preset::names(PresetKind::Fluorophore));
    known.dedup();
    let hint = did_you_mean(name, known.iter().copied());
    context
        .error(at, format!("there is no fluorophore \"{}\"{hint} Known: {}", excerpt(name), known.join(", ")))
}

/// Checks names and sources of the fluorophore sections, used or not.
pub(crate) fn check_sections(context: &Context<'_>, sections: &[FluorophoreSection]) -> Resolved<()> {
    for (index, section) in sections.iter().enumerate() {
        let at = steps!["fluorophore", index];
        context.unique_name(&at, &section.name, sections[..index].iter().map(|other| other.name.as_str()))?;
        if !matches!(section.source, FluorophoreSource::Catalogue(_)) && section.photon_yield.is_none() {
            let message = "a fluorophore from a file needs `photon_yield`: photons out per photon in at its best \
                           excitation, at concentration 1";
            return context.fail(&at, message);
        }
        if let Some(value) = section.photon_yield
            && !(1e-12..=1.0).contains(&value)
        {
            let at = at.field("photon_yield");
            return context.fail(&at, "must be between 1e-12 and 1 (photons out per photon in)");
        }
        if let FluorophoreSource::Catalogue(name) = &section.source
            && let Err(error) = preset::fluorophore(name)
        {
            return context.fail(&at.field("source"), error.to_string());
        }
    }
    Ok(())
}

fn from_section(
    context: &mut Context<'_>,
    at: &Place,
    section: &FluorophoreSection,
) -> Resolved<Fluorophore> {
    let at_source = at.field("source");
    let stokes = section.stokes.unwrap_or_default();
    let (eem, source) = match &section.source {
        FluorophoreSource::Catalogue(name) => return of_catalogue(context, &at_source, section, name),
        FluorophoreSource::Matrix(MatrixSource { eem_csv, unit }) => {
            (matrix_from_csv(context, &at_source.field("eem_csv"), eem_csv, *unit, stokes)?, eem_csv)
        }
        FluorophoreSource::Mat(MatSource { mat, unit }) => {
            (from_mat(context, &at_source.field("mat"), mat, *unit, stokes)?, mat)
        }
        FluorophoreSource::Table(TableSource { csv, unit }) => {
            let at = at_source.field("csv");
            context.note_input(&at, csv)?;
            let read = read_fluorophore_csv(csv.as_ref(), Negative::ClipToZero)
                .map_err(|e| context.file_error(&at, &e))?;
            if read.emission_only {
                let message = "the excitation column is constant: it was never measured. Give a measured one";
                return context.fail(&at, message);
            }
            (separable(context, &at, *unit, read.excitation, read.emission, stokes)?, csv)
        }
        FluorophoreSource::Spectra(SpectraSource { excitation_csv, emission_csv, unit }) => {
            let options = CsvSpectrumOptions {
                columns: CsvColumns::Numbered(vec![1]),
                negative: Negative::ClipToZero,
                ..CsvSpectrumOptions::default()
            };
            let mut first = |key: &str, file: &FilePath| -> Resolved<Curve> {
                Ok(context.csv(&at_source.field(key), file, &options)?.swap_remove(0).curve)
            };
            let excitation = first("excitation_csv", excitation_csv)?;
            let emission = first("emission_csv", emission_csv)?;
            (separable(context, at, *unit, excitation, emission, stokes)?, emission_csv)
        }
    };
    let photon_yield = section.photon_yield.unwrap_or(1e-3);
    let (excitation_range_nm, emission_range_nm) = ranges(&eem);
    let unmasked = eem.clone().with_stokes(Stokes::Off);
    let steps = ((excitation_range_nm.1 - excitation_range_nm.0).ceil() as usize).max(1);
    let best = (0..=steps)
        .map(|i| excitation_range_nm.0 + i as f64)
        .map(|nm| {
            unmasked.photon_yield(nm.min(excitation_range_nm.1), emission_range_nm.0, emission_range_nm.1)
        })
        .fold(0.0, f64::max);
    if best <= 0.0 {
        return context.fail(at, "the fluorophore emits nothing: all its values are zero");
    }
    Ok(Fluorophore {
        name: section.name.clone(),
        title: section.title.clone().unwrap_or_else(|| section.name.clone()),
        eem: eem.scaled(photon_yield / best),
        excitation_range_nm,
        emission_range_nm,
        source: source.to_string(),
    })
}

/// A variant of a fluorophore of the catalogue.
fn of_catalogue(
    context: &mut Context<'_>,
    at: &Place,
    section: &FluorophoreSection,
    name: &str,
) -> Resolved<Fluorophore> {
    let preset = preset::fluorophore(name).map_err(|e| context.error(at, e.to_string()))?;
    context.note_preset("fluorophore", name, &preset);
    let photon_yield = section.photon_yield.unwrap_or(preset.photon_yield);
    let mut fluorophore = preset.fluorophore_with(photon_yield, section.stokes.unwrap_or(preset.stokes));
    fluorophore.name.clone_from(&section.name);
    if let Some(title) = &section.title {
        fluorophore.title.clone_from(title);
    }
    Ok(fluorophore)
}

fn ranges(eem: &PhotonEem) -> ((f64, f64), (f64, f64)) {
    match eem.density() {
        fluorspar::spectral::YieldDensity::Table(table) => {
            let ends = |axis: &[f64]| (axis[0], axis[axis.len() - 1]);
            (ends(&table.excitation_nm), ends(&table.emission_nm))
        }
        fluorspar::spectral::YieldDensity::Separable(terms) => terms
            .first()
            .map_or(((0.0, 0.0), (0.0, 0.0)), |term| (term.excitation.range_nm(), term.emission.range_nm())),
    }
}

fn separable(
    context: &Context<'_>,
    at: &Place,
    unit: Option<YieldUnit>,
    excitation: Curve,
    emission: Curve,
    stokes: Stokes,
) -> Resolved<PhotonEem> {
    // Y_q(lo|li) = Y_e(lo|li) lo / li, for the product of two spectra as for a matrix.
    let weighted = |curve: Curve, weight: fn(f64) -> f64| match unit {
        Some(YieldUnit::Energy) => {
            let wavelengths = curve.wavelengths_nm().to_vec();
            let values =
                curve.values().iter().zip(&wavelengths).map(|(value, nm)| value * weight(*nm)).collect();
            Curve::new(wavelengths, values).map_err(|error| context.error(at, error.to_string()))
        }
        _ => Ok(curve),
    };
    let (excitation, emission) = (weighted(excitation, |nm| 1.0 / nm)?, weighted(emission, |nm| nm)?);
    let area = emission.total();
    if !(area > 0.0 && excitation.max() > 0.0) {
        return context.fail(at, "the fluorophore emits nothing: a spectrum is zero everywhere");
    }
    let excitation = excitation.scaled(1.0 / excitation.max());
    Ok(PhotonEem::separable(
        vec![SeparableTerm { excitation, emission: emission.scaled(1.0 / area) }],
        stokes,
    ))
}

fn matrix(
    context: &Context<'_>,
    at: &Place,
    table: EemTable,
    unit: YieldUnit,
    stokes: Stokes,
) -> Resolved<PhotonEem> {
    match unit {
        YieldUnit::Photons => PhotonEem::table(table, stokes),
        YieldUnit::Energy => EnergyEem::table(table, stokes).map(|eem| eem.to_photon()),
    }
    .map_err(|error| context.error(at, error.to_string()))
}

/// What to do about a matrix whose values may count photons or energy.
const UNKNOWN_UNIT: &str =
    "the file does not know what its values count; add unit = \"photons\" or \"energy\"";

fn matrix_from_csv(
    context: &mut Context<'_>,
    at: &Place,
    file: &FilePath,
    unit: Option<YieldUnit>,
    stokes: Stokes,
) -> Resolved<PhotonEem> {
    context.note_input(at, file)?;
    let options = CsvEemOptions {
        unit: unit.map(|unit| match unit {
            YieldUnit::Photons => EemUnit::Photons,
            YieldUnit::Energy => EemUnit::Energy,
        }),
        anti_stokes: AntiStokes::Keep,
        negative: Negative::ClipToZero,
        empty_as_zero: true,
    };
    let read = read_eem_csv(file.as_ref(), &options).map_err(|error| context.file_error(at, &error))?;
    let unit = match read.unit {
        EemUnit::Photons => YieldUnit::Photons,
        EemUnit::Energy => YieldUnit::Energy,
        EemUnit::Unknown => return context.fail(at, UNKNOWN_UNIT),
    };
    let table =
        EemTable { emission_nm: read.emission_nm, excitation_nm: read.excitation_nm, values: read.values };
    matrix(context, at, table, unit, stokes)
}

/// Files of isetfluorescence hold photons.
fn from_mat(
    context: &mut Context<'_>,
    at: &Place,
    file: &FilePath,
    unit: Option<YieldUnit>,
    stokes: Stokes,
) -> Resolved<PhotonEem> {
    context.note_input(at, file)?;
    let read = read_iset_fluorophore(file.as_ref()).map_err(|error| context.file_error(at, &error))?;
    if let Some(values) = read.eem {
        let values = values.into_iter().map(|value| value.max(0.0)).collect();
        let table = EemTable { emission_nm: read.wave_nm.clone(), excitation_nm: read.wave_nm, values };
        return matrix(context, at, table, unit.unwrap_or(YieldUnit::Photons), stokes);
    }
    if read.emission_only {
        return context
            .fail(at, "the excitation is missing or constant: it was never measured. Give a measured one");
    }
    let (Some(excitation), Some(emission)) = (read.excitation, read.emission) else {
        return context.fail(at, "the file has neither a matrix nor both excitation and emission");
    };
    let curve = |values: Vec<f64>| {
        let values = values.into_iter().map(|value| value.max(0.0)).collect();
        Curve::new(read.wave_nm.clone(), values).map_err(|error| context.error(at, error.to_string()))
    };
    separable(context, at, unit, curve(excitation)?, curve(emission)?, stokes)
}

/// Most materials of an experiment: each mixture is followed through all of its parts.
const MAX_MATERIALS: usize = 4000;

/// All materials of the sections.
pub(super) fn materials(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    grid: &WavelengthGrid,
    fluorophores: &mut Fluorophores,
) -> Resolved<Vec<Material>> {
    if file.material.len() > MAX_MATERIALS {
        let message = format!("{} materials; an experiment has at most {MAX_MATERIALS}", file.material.len());
        return context.fail(&steps!["material"], message);
    }
    let mut materials = Vec::with_capacity(file.material.len());
    if let Some(mouth) = &file.mouth {
        mouth::check_parameters(context, &mouth.parameters)?;
        context.mouth = Some(mouth.parameters.clone());
    }
    for (index, section) in file.material.iter().enumerate() {
        let at = steps!["material", index];
        let earlier = file.material[..index].iter().map(|other| other.name.as_str());
        context.unique_name(&at, &section.name, earlier)?;
        context.tissue = mouth::only_tissue(file, &section.name);
        let (scattering, amounts) = match &section.scattering {
            ScatteringSection::Tissue(tissue) => {
                let recipe = TissueRecipe::new(context, &at, tissue, file)?;
                let resolved = recipe.resolve(context, file, grid, fluorophores)?;
                context.tissue_recipes.insert(index, recipe);
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
    Ok(materials)
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
        if let Some(index) = file.material.iter().position(|other| other.name == name) {
            return Ok(index);
        }
        let known: Vec<&str> = file.material.iter().map(|other| other.name.as_str()).collect();
        let hint = did_you_mean(name, known.iter().copied());
        let message = format!("there is no [[material]] of this name{hint} Known: {}", known.join(", "));
        context.fail(&at.field(key), message)
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
            if !(index > 1.0 && index <= 3.0) {
                return context.fail(&at.field("refractive_index"), "must be above 1 and at most 3");
            }
            let roughness = context.texture(&at.field("roughness"), &glass.roughness, 1.0)?;
            let transmittance_at = at.field("transmittance");
            let transmittance =
                context.spectrum(&transmittance_at, &glass.transmittance, Role::Filter, 0.0, grid)?;
            Ok(Scattering::Dielectric(Dielectric {
                refractive_index: index as f32,
                roughness,
                transmittance,
            }))
        }
        ScatteringSection::Conductor(metal) => {
            let roughness = context.texture(&at.field("roughness"), &metal.roughness, 1.0)?;
            let (n, k) = metal_index(context, &at.field("metal"), &metal.metal, grid)?;
            Ok(Scattering::Conductor(Conductor { n, k, roughness }))
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
            let preset = preset::metal(name).map_err(|error| context.error(at, error.to_string()))?;
            context.note_preset("metal", name, &preset);
            Ok(preset.index())
        }
        MetalReference::Index(MetalIndex { n, k }) => {
            let mut part = |key: &str, reference: &SpectrumReference| {
                let at = at.field(key);
                if reference.catalogue_name().is_some() {
                    let message = "the catalogue has no single indices; give a number, a table, a CSV file, or the name \
                                   of a metal instead of n and k";
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
