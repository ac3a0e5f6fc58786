//! Tissues by name: sites of the catalogue with their parameters, and layers that a file describes one by one.

use std::sync::Arc;

use super::context::{Context, Resolved};
use super::held_fluorophore::{held_fluorophores, misplaced};
use super::spectrum::Role;
use crate::error::Place;
use crate::schema::{
    FluorophoreSection, LayerAbsorptionSection, LayerScatteringSection, NameOrFile, NameOrTable,
    SpectrumReference, TissueLayerSection, TissueSection,
};
use fluorspar::spectral::{Curve, Fluorophore, WavelengthGrid};
use fluorspar::tissue::{
    Below, Blood, Chromophore, LayerAddition, LayerScattering, LayeredTissue, REFRACTIVE_INDEX,
    ScatteringCoefficient, Site, TissueError, TissueLayer,
};
use fluorspar::units::number_text;

/// Refractive index of mucosa.
const MUCOSA_INDEX: f64 = 1.4;
/// Thickness of a layer, um.
const THICKNESS_UM: [f64; 2] = [0.1, 1e6];
/// Wavelength of scattering coefficients that are numbers, nm.
const SCATTERING_NM: f64 = 500.0;

/// A tissue by name.
#[derive(Clone, Debug, PartialEq)]
pub enum NamedTissue {
    /// A site with its parameters.
    Site(Site),
    /// Layers of a file.
    Layers {
        /// Name.
        name: String,
        /// The layers.
        tissue: LayeredTissue,
    },
}

/// What of a layer can be multiplied by a factor; with the name of the layer in front, the name of a parameter.
const LAYER_PARAMETERS: [&str; 9] = [
    "thickness_um",
    "scattering",
    "blood_fraction",
    "oxygen_saturation",
    "vessel_radius_um",
    "melanin_fraction",
    "water_fraction",
    "beta_carotene_umol_per_l",
    "background_per_mm",
];

impl NamedTissue {
    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Site(site) => site.name(),
            Self::Layers { name, .. } => name,
        }
    }

    /// The site, for what needs to know how a tissue varies among people.
    pub(crate) fn site(&self, context: &Context<'_>, at: &Place) -> Resolved<&Site> {
        match self {
            Self::Site(site) => Ok(site),
            Self::Layers { .. } => {
                let message = "is described by its layers, and their variation among people is not known; give a tissue site of \
                               the catalogue";
                context.fail(at, message)
            }
        }
    }

    /// Names of the fluorophores that it may hold.
    pub(crate) fn fluorophores(&self) -> Vec<&str> {
        match self {
            Self::Site(site) => {
                let mut names = site.fluorophores().to_vec();
                let added = site.added().iter().flat_map(|addition| &addition.fluorophores);
                for name in added.map(|held| held.fluorophore.name.as_str()) {
                    if !names.contains(&name) {
                        names.push(name);
                    }
                }
                names
            }
            Self::Layers { tissue, .. } => {
                let held = tissue.layers.iter().flat_map(|layer| &layer.fluorophores);
                let mut names: Vec<&str> = held.map(|held| held.fluorophore.name.as_str()).collect();
                names.sort_unstable();
                names.dedup();
                names
            }
        }
    }

    /// Its layers. `find` gives a fluorophore of a site by its name.
    ///
    /// # Errors
    /// A fluorophore that `find` does not have, and numbers outside their ranges.
    pub fn tissue(
        &self,
        find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>,
    ) -> Result<LayeredTissue, TissueError> {
        match self {
            Self::Site(site) => site.tissue(find),
            Self::Layers { tissue, .. } => {
                tissue.validate()?;
                Ok(tissue.clone())
            }
        }
    }

    /// Names and values of the parameters that [`Self::scale`] knows. Scattering counts as 1.
    pub(crate) fn parameters(&self) -> Vec<(String, f64)> {
        match self {
            Self::Site(site) => {
                site.parameters().map(|(parameter, value)| (parameter.name.to_owned(), value)).collect()
            }
            Self::Layers { tissue, .. } => {
                let of_layer = |layer: &TissueLayer| {
                    let mut layer = layer.clone();
                    LAYER_PARAMETERS
                        .iter()
                        .filter_map(|parameter| {
                            let value = scale_layer(&mut layer, parameter, 1.0)?;
                            Some((parameter_name(&layer.name, parameter), value))
                        })
                        .collect::<Vec<_>>()
                };
                tissue.layers.iter().flat_map(of_layer).collect()
            }
        }
    }

    /// Multiplies a parameter.
    ///
    /// # Errors
    /// A name that a site does not have, and a value outside the range of its parameter. Layers are checked when they are used.
    pub(crate) fn scale(&mut self, name: &str, factor: f64) -> Result<(), TissueError> {
        match self {
            Self::Site(site) => site.set(name, factor * site.get(name)?),
            Self::Layers { tissue, .. } => {
                for layer in &mut tissue.layers {
                    let wanted =
                        LAYER_PARAMETERS.iter().find(|known| parameter_name(&layer.name, known) == name);
                    if let Some(parameter) = wanted {
                        scale_layer(layer, parameter, factor);
                    }
                }
                Ok(())
            }
        }
    }

    /// All that its layers depend on but for the spectra of the fluorophores, as text.
    pub(super) fn key(&self) -> String {
        // Debug text of finite numbers is exact: it reads back to the same bits.
        let tissue = match self {
            Self::Site(site) => return format!("{site:?}"),
            Self::Layers { tissue, .. } => tissue,
        };
        let mut key = format!("{:?} {:?}", tissue.refractive_index, tissue.below);
        for TissueLayer { name, thickness_um, scattering, absorption, fluorophores, refractive_index } in
            &tissue.layers
        {
            key += &format!("\n{name} {thickness_um:?} {scattering:?} {absorption:?} {refractive_index:?}");
            for held in fluorophores {
                key += &format!(
                    "\n{} {:?} {:?} {:?}",
                    held.fluorophore.name, held.strength_per_mm, held.at_nm, held.quantum_yield
                );
            }
        }
        key
    }
}

/// Name of a parameter of a layer.
fn parameter_name(layer: &str, parameter: &str) -> String {
    format!("{}_{parameter}", layer.replace(' ', "_"))
}

/// Multiplies a parameter of a layer and returns it; none where the layer has no such thing.
fn scale_layer(layer: &mut TissueLayer, parameter: &str, factor: f64) -> Option<f64> {
    match parameter {
        "thickness_um" => {
            layer.thickness_um *= factor;
            Some(layer.thickness_um)
        }
        "scattering" => {
            layer.scattering = layer.scattering.clone().scaled(factor);
            Some(factor)
        }
        _ => layer.absorption.iter_mut().find_map(|chromophore| {
            let value = match (chromophore, parameter) {
                (Chromophore::Blood(blood), "blood_fraction") => &mut blood.volume_fraction,
                (Chromophore::Blood(blood), "oxygen_saturation") => &mut blood.saturation,
                (Chromophore::Blood(blood), "vessel_radius_um") => &mut blood.vessel_radius_um,
                (Chromophore::Melanin { volume_fraction }, "melanin_fraction")
                | (Chromophore::Water { volume_fraction }, "water_fraction") => volume_fraction,
                (Chromophore::BetaCarotene { concentration_umol_per_l }, "beta_carotene_umol_per_l") => {
                    concentration_umol_per_l
                }
                (Chromophore::Background { absorption_per_mm, .. }, "background_per_mm") => absorption_per_mm,
                _ => return None,
            };
            *value *= factor;
            Some(*value)
        }),
    }
}

/// The tissue of a section.
pub(crate) fn of_section(
    context: &mut Context<'_>,
    at: &Place,
    section: &TissueSection,
    fluorophores: &[FluorophoreSection],
    grid: &WavelengthGrid,
) -> Resolved<NamedTissue> {
    let only_layers = [
        ("refractive_index", section.refractive_index.is_some()),
        ("index_below", section.index_below.is_some()),
    ];
    let only_sites = [("states", !section.states.is_empty()), ("parameters", !section.parameters.is_empty())];
    let given = |fields: &[(&'static str, bool)]| fields.iter().find(|(_, given)| *given).map(|(f, _)| *f);
    match &section.site {
        Some(site) => match given(&only_layers) {
            None => Ok(NamedTissue::Site(of_site(context, at, section, site, fluorophores, grid)?)),
            Some(field) => {
                let message = "a tissue site has its own index; remove this field, or remove `site` to describe the layers yourself";
                context.fail(&at.field(field), message)
            }
        },
        None if section.layer.is_empty() => {
            let message = "give the site of the catalogue that it starts from, site = \"dorsal_tongue\", or layers of its own, \
                           [[tissue.layer]], the uppermost first";
            context.fail(at, message)
        }
        None => match given(&only_sites) {
            None => of_layers(context, at, section, fluorophores, grid),
            Some(field) => {
                let message = "applies only to sites of the catalogue; this tissue is described by its layers, so change the layers";
                context.fail(&at.field(field), message)
            }
        },
    }
}

/// The site of a section, in its states, with its parameters and what its layers hold in addition.
fn of_site(
    context: &mut Context<'_>,
    at: &Place,
    section: &TissueSection,
    site: &NameOrFile,
    fluorophores: &[FluorophoreSection],
    grid: &WavelengthGrid,
) -> Resolved<Site> {
    let mut site = context.site(&at.field("site"), site)?;
    let failed = |context: &Context<'_>, at: &Place, error: TissueError| context.error(at, error.to_string());
    for (index, name) in section.states.iter().enumerate() {
        let at = at.field("states").index(index);
        let state = context.state(&at, name)?;
        site.apply(&state).map_err(|error| failed(context, &at, error))?;
    }
    for (name, value) in &section.parameters {
        site.set(name, *value)
            .map_err(|error| failed(context, &at.field("parameters").field(name), error))?;
    }
    for (number, layer) in section.layer.iter().enumerate() {
        let at = at.field("layer").index(number);
        context.unique_name(&at, &layer.name, section.layer[..number].iter().map(|l| l.name.as_str()))?;
        let addition = addition(context, &at, layer, &site, fluorophores, grid)?;
        site.add(addition).map_err(|error| context.error(&at.field("name"), error.to_string()))?;
    }
    Ok(site)
}

/// What a section adds to a layer of a site.
fn addition(
    context: &mut Context<'_>,
    at: &Place,
    section: &TissueLayerSection,
    site: &Site,
    sections: &[FluorophoreSection],
    grid: &WavelengthGrid,
) -> Resolved<LayerAddition> {
    let own = [
        ("thickness_um", section.thickness_um.is_some()),
        ("scattering", section.scattering.is_some()),
        ("refractive_index", section.refractive_index.is_some()),
    ];
    if let Some((field, _)) = own.iter().find(|(_, given)| *given) {
        let message = "the layer of a site has its own; change it by `parameters`, or remove `site` to describe the layers yourself";
        return context.fail(&at.field(*field), message);
    }
    let absorption = absorption(context, &at.field("absorption"), &section.absorption, grid)?;
    let fluorophores = held_fluorophores(context, at, section, sections, Some(site))?;
    if absorption.is_empty() && section.fluorophores.is_empty() {
        let message =
            "adds nothing to the layer of the site; give it absorption or fluorophores, or remove it";
        return context.fail(at, message);
    }
    Ok(LayerAddition { layer: section.name.clone(), absorption, fluorophores })
}

fn of_layers(
    context: &mut Context<'_>,
    at: &Place,
    section: &TissueSection,
    fluorophores: &[FluorophoreSection],
    grid: &WavelengthGrid,
) -> Resolved<NamedTissue> {
    let hint = "(tissue has 1.33 to 1.65)";
    let index = |field: &str, value: f64| context.within(&at.field(field), value, REFRACTIVE_INDEX, hint);
    let refractive_index = index("refractive_index", section.refractive_index.unwrap_or(MUCOSA_INDEX))?;
    let below = match section.index_below {
        None => Below::Black,
        Some(value) => Below::Index(index("index_below", value)?),
    };
    let mut layers: Vec<TissueLayer> = Vec::new();
    for (number, layer) in section.layer.iter().enumerate() {
        let at = at.field("layer").index(number);
        context.unique_name(&at, &layer.name, section.layer[..number].iter().map(|l| l.name.as_str()))?;
        layers.push(of_layer(context, &at, layer, fluorophores, grid)?);
    }
    let tissue = LayeredTissue { layers, refractive_index, below };
    tissue.validate().map_err(|error| context.error(at, error.to_string()))?;
    Ok(NamedTissue::Layers { name: section.name.clone(), tissue })
}

fn of_layer(
    context: &mut Context<'_>,
    at: &Place,
    section: &TissueLayerSection,
    sections: &[FluorophoreSection],
    grid: &WavelengthGrid,
) -> Resolved<TissueLayer> {
    let (Some(thickness_um), Some(scattering_section)) = (section.thickness_um, &section.scattering) else {
        let message =
            "give its thickness_um and its scattering, or the tissue a `site` whose layer this adds to";
        return context.fail(at, message);
    };
    let thickness = at.field("thickness_um");
    let thickness_um = context.within(&thickness, thickness_um, THICKNESS_UM, "µm (1 mm = 1000 µm)")?;
    if let Some(index) = section.refractive_index {
        let hint = "(tissue has 1.33 to 1.65)";
        context.within(&at.field("refractive_index"), index, REFRACTIVE_INDEX, hint)?;
    }
    let scattering = scattering(context, &at.field("scattering"), scattering_section, grid)?;
    let absorption = absorption(context, &at.field("absorption"), &section.absorption, grid)?;
    let fluorophores = held_fluorophores(context, at, section, sections, None)?;
    let refractive_index = section.refractive_index;
    let name = section.name.clone();
    Ok(TissueLayer { name, thickness_um, scattering, absorption, fluorophores, refractive_index })
}

fn scattering(
    context: &mut Context<'_>,
    at: &Place,
    section: &LayerScatteringSection,
    grid: &WavelengthGrid,
) -> Resolved<LayerScattering> {
    let (field, reference) = match (&section.scattering_per_mm, &section.reduced_per_mm) {
        (Some(reference), None) => ("scattering_per_mm", reference),
        (None, Some(reference)) => ("reduced_per_mm", reference),
        (None, None) => {
            let message = "give scattering_per_mm, or reduced_per_mm, which is that times (1 - anisotropy), in 1/mm \
                           (1/cm = 0.1/mm)";
            return context.fail(at, message);
        }
        (Some(_), Some(_)) => {
            let message = "scattering_per_mm is given as well, and each follows from the other; remove one";
            return context.fail(&at.field("reduced_per_mm"), message);
        }
    };
    let is_reduced = field == "reduced_per_mm";
    let coefficient = if let SpectrumReference::Constant(value) = reference {
        let (at_nm, power) = (section.at_nm.unwrap_or(SCATTERING_NM), section.power.unwrap_or(0.0));
        match is_reduced {
            false => ScatteringCoefficient::PowerLaw { scattering_per_mm: *value, at_nm, power },
            true => ScatteringCoefficient::ReducedPowerLaw { reduced_per_mm: *value, at_nm, power },
        }
    } else {
        let law = [("at_nm", section.at_nm), ("power", section.power)];
        if let Some((field, _)) = law.iter().find(|(_, given)| given.is_some()) {
            return context.fail(
                &at.field(*field),
                "the coefficient is a spectrum, which needs no power law; remove this",
            );
        }
        let curve = Arc::new(coefficients(context, &at.field(field), reference, grid)?);
        match is_reduced {
            false => ScatteringCoefficient::Curve { scattering_per_mm: curve },
            true => ScatteringCoefficient::ReducedCurve { reduced_per_mm: curve },
        }
    };
    let scattering = LayerScattering { coefficient, anisotropy: section.anisotropy };
    scattering.validate("").map_err(|error| misplaced(context, at, &error))?;
    Ok(scattering)
}

/// A spectrum of coefficients, 1/mm.
fn coefficients(
    context: &mut Context<'_>,
    at: &Place,
    reference: &SpectrumReference,
    grid: &WavelengthGrid,
) -> Resolved<Curve> {
    if let SpectrumReference::Text(NameOrTable::Name(_)) = reference {
        let message =
            "the catalogue has no spectra of coefficients; give a number, a CSV file or an equation, in 1/mm";
        return context.fail(at, message);
    }
    context.spectrum(at, reference, Role::Coefficient, 0.0, grid)
}

fn absorption(
    context: &mut Context<'_>,
    at: &Place,
    section: &LayerAbsorptionSection,
    grid: &WavelengthGrid,
) -> Resolved<Vec<Chromophore>> {
    let blood = section.blood.as_ref().map(|blood| {
        Chromophore::Blood(Blood {
            volume_fraction: blood.volume_fraction,
            saturation: blood.saturation,
            hemoglobin_g_per_l: blood.hemoglobin_g_per_l,
            vessel_radius_um: blood.vessel_radius_um,
        })
    });
    let melanin =
        section.melanin.as_ref().map(|m| Chromophore::Melanin { volume_fraction: m.volume_fraction });
    let water = section.water.as_ref().map(|w| Chromophore::Water { volume_fraction: w.volume_fraction });
    let carotene = section.beta_carotene.as_ref().map(|carotene| Chromophore::BetaCarotene {
        concentration_umol_per_l: carotene.concentration_umol_per_l,
    });
    let background = section.background.as_ref().map(|background| Chromophore::Background {
        absorption_per_mm: background.absorption_per_mm,
        at_nm: background.at_nm,
        slope_per_nm: background.slope_per_nm,
    });
    let known = [
        ("blood", blood),
        ("melanin", melanin),
        ("water", water),
        ("beta_carotene", carotene),
        ("background", background),
    ];
    let mut found = Vec::new();
    for (field, chromophore) in known {
        let Some(chromophore) = chromophore else { continue };
        chromophore.validate("").map_err(|error| misplaced(context, &at.field(field), &error))?;
        found.push(chromophore);
    }
    for (name, reference) in &section.curves {
        let at = at.field("curves").field(name);
        let absorption_per_mm = Arc::new(coefficients(context, &at, reference, grid)?);
        let chromophore = Chromophore::Curve { name: name.clone(), absorption_per_mm };
        if let Err(TissueError::OutOfRange { value, range, hint, .. }) = chromophore.validate("") {
            let [value, least, most] = [value, range[0], range[1]].map(number_text);
            return context.fail(&at, format!("its value {value} is not between {least} and {most}; {hint}"));
        }
        found.push(chromophore);
    }
    Ok(found)
}
