//! Tissues of the mouth and of the face, as named parameters.

use std::sync::Arc;

use serde::Deserialize;

use super::chromophore::Chromophore;
use super::layered_tissue::{LayeredTissue, TissueFluorophore};
use super::site_parameter::{Basis, MucosaParameters, SiteParameter, ToothParameters};
use super::surroundings::Surroundings;
use super::tissue_error::{TissueError, check};
use super::tissue_state::TissueState;
use crate::spectral::Fluorophore;

/// A tissue with parameters that may be changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    description: Arc<SiteDescription>,
    /// Basis of the value that the description gives each parameter, and the source of it.
    bases: Arc<[(Basis, String)]>,
    parameters: Box<SiteParameters>,
    added: Vec<LayerAddition>,
}

/// What a layer of a site holds beside what its parameters say: a dye, for instance.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerAddition {
    /// Name of the layer, one of [`Site::layer_names`].
    pub layer: String,
    /// What absorbs.
    pub absorption: Vec<Chromophore>,
    /// What fluoresces. The absorption of a dye that the parameters do not know comes with its quantum yield.
    pub fluorophores: Vec<TissueFluorophore>,
}

/// What is known of a site beside its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteDescription {
    /// Name by which files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// What it is, and caveats.
    pub description: String,
    /// Where its parameters come from.
    pub source: String,
    /// What reaches it by way of other surfaces of a mouth.
    pub surroundings: Surroundings,
}

/// Layers that sites have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SiteStructure {
    /// Keratin, epithelium and stroma, of mucosa and skin: [`MucosaParameters`].
    Mucosa,
    /// Enamel on dentin: [`ToothParameters`].
    Tooth,
}

/// The parameters of a structure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SiteParameters {
    /// Of mucosa or skin.
    Mucosa(MucosaParameters),
    /// Of a tooth crown.
    Tooth(ToothParameters),
}

/// Value of a parameter, and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteValue {
    /// Name of the parameter.
    pub parameter: String,
    /// The value, in the unit at the end of the name.
    pub value: f64,
    /// Where it comes from.
    pub basis: Basis,
    /// Work or data that it comes from; may be empty.
    pub source: String,
}

/// Fluorophores of tissue, and photons that they emit per photon that they absorb.
/// \[assumed; from memory: NADH, FAD and porphyrin of Lakowicz, the others of that order\]
const QUANTUM_YIELDS: [(&str, f64); 11] = [
    ("nadh", 0.02),
    ("fad", 0.03),
    ("flavin_aggregate", 0.02),
    ("collagen", 0.2),
    ("elastin", 0.2),
    ("keratin", 0.2),
    ("lipopigment", 0.05),
    ("biofilm_porphyrin", 0.1),
    ("biofilm_chlorophyll", 0.05),
    ("enamel", 0.1),
    ("dentin", 0.1),
];

impl SiteParameters {
    fn of(structure: SiteStructure) -> Self {
        match structure {
            SiteStructure::Mucosa => Self::Mucosa(MucosaParameters::default()),
            SiteStructure::Tooth => Self::Tooth(ToothParameters::default()),
        }
    }

    fn list(&self) -> &'static [SiteParameter] {
        match self {
            Self::Mucosa(_) => MucosaParameters::PARAMETERS,
            Self::Tooth(_) => ToothParameters::PARAMETERS,
        }
    }

    fn values(&self) -> Vec<f64> {
        match self {
            Self::Mucosa(parameters) => parameters.values(),
            Self::Tooth(parameters) => parameters.values(),
        }
    }

    fn value_mut(&mut self, index: usize) -> Option<&mut f64> {
        match self {
            Self::Mucosa(parameters) => parameters.value_mut(index),
            Self::Tooth(parameters) => parameters.value_mut(index),
        }
    }
}

impl Site {
    /// A site from the values of all parameters of its structure.
    ///
    /// # Errors
    /// A parameter that the structure does not have, one that is given twice or not at all, a value outside its range.
    pub fn new(
        description: SiteDescription,
        structure: SiteStructure,
        values: Vec<SiteValue>,
    ) -> Result<Self, TissueError> {
        let parameters = Box::new(SiteParameters::of(structure));
        let all = parameters.list();
        let (description, bases) = (Arc::new(description), Arc::new([]));
        let mut site = Self { description, bases, parameters, added: Vec::new() };
        let mut bases = vec![None; all.len()];
        for SiteValue { parameter, value, basis, source } in values {
            site.set(&parameter, value)?;
            if bases[site.index_of(&parameter)?].replace((basis, source)).is_some() {
                return Err(TissueError::ParameterTwice { site: site.name().into(), name: parameter });
            }
        }
        let missing = bases.iter().zip(all).filter(|(basis, _)| basis.is_none());
        let missing: Vec<&str> = missing.map(|(_, parameter)| parameter.name).collect();
        if !missing.is_empty() {
            return Err(TissueError::MissingParameters { site: site.name().into(), missing });
        }
        site.bases = bases.into_iter().flatten().collect();
        Ok(site)
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.description.name
    }

    /// Its name for people.
    #[must_use]
    pub fn title(&self) -> &str {
        &self.description.title
    }

    /// What it is, and caveats.
    #[must_use]
    pub fn description(&self) -> &str {
        &self.description.description
    }

    /// Where its parameters come from.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.description.source
    }

    /// What reaches it by way of other surfaces of a mouth.
    #[must_use]
    pub fn surroundings(&self) -> &Surroundings {
        &self.description.surroundings
    }

    /// Whether it is mucosa or skin, with blood below an epithelium; teeth are not.
    #[must_use]
    pub fn is_mucosa(&self) -> bool {
        matches!(*self.parameters, SiteParameters::Mucosa(_))
    }

    /// Whether its parameters are assumed or published rather than fitted to measurements of the site.
    #[must_use]
    pub fn is_assumed(&self) -> bool {
        self.bases.iter().all(|(basis, _)| *basis != Basis::Fitted)
    }

    /// All parameters with their values.
    pub fn parameters(&self) -> impl Iterator<Item = (&'static SiteParameter, f64)> {
        self.parameters.list().iter().zip(self.parameters.values())
    }

    /// Where the value of a parameter comes from, and from what; assumed where the name is unknown.
    #[must_use]
    pub fn basis(&self, name: &str) -> (Basis, &str) {
        let index = self.index_of(name);
        index.map_or((Basis::Assumed, ""), |index| (self.bases[index].0, &self.bases[index].1))
    }

    fn index_of(&self, name: &str) -> Result<usize, TissueError> {
        let parameters = self.parameters.list();
        parameters.iter().position(|p| p.name == name).ok_or_else(|| TissueError::NoSuchParameter {
            site: self.name().into(),
            name: name.to_string(),
            known: parameters.iter().map(|p| p.name).collect(),
        })
    }

    /// Value of a parameter, in the unit at the end of its name.
    ///
    /// # Errors
    /// A name that the site does not have, with the names that it has.
    pub fn get(&self, name: &str) -> Result<f64, TissueError> {
        self.index_of(name).map(|index| self.parameters.values()[index])
    }

    /// Changes a parameter.
    ///
    /// # Errors
    /// A name that the site does not have, and a value outside the range of the parameter.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), TissueError> {
        let index = self.index_of(name)?;
        let parameter = &self.parameters.list()[index];
        let place = format!("tissue '{}'", self.name());
        check(&place, parameter.name, value, parameter.range, parameter.meaning)?;
        self.put(index, value);
        Ok(())
    }

    /// Refuses a value that [`Self::tissue`] does not follow because of the other parameters: a biofilm of more than half of the
    /// keratin layer.
    ///
    /// # Errors
    /// A name that the site does not have, and such a value.
    pub fn check_followed(&self, name: &str, value: f64) -> Result<(), TissueError> {
        let parameter = &self.parameters.list()[self.index_of(name)?];
        let [least, mut most] = parameter.range;
        if let (SiteParameters::Mucosa(mucosa), "biofilm_thickness_um") = (&*self.parameters, name) {
            most = most.min(mucosa.largest_biofilm_um());
        }
        check(&format!("tissue '{}'", self.name()), parameter.name, value, [least, most], parameter.meaning)
    }

    fn put(&mut self, index: usize, value: f64) {
        if let Some(parameter) = self.parameters.value_mut(index) {
            *parameter = value;
        }
    }

    /// Sets a parameter that the site has to the nearest value of its range.
    pub(super) fn set_within_range(&mut self, name: &str, value: f64) {
        if let Ok(index) = self.index_of(name) {
            let [least, most] = self.parameters.list()[index].range;
            self.put(index, value.clamp(least, most));
        }
    }

    /// Name of the parameter that holds the strength of a fluorophore in a layer of [`Self::tissue`]; none where the site has
    /// no such fluorophore there.
    #[must_use]
    pub fn strength_parameter(&self, layer: &str, fluorophore: &str) -> Option<&'static str> {
        let place = match layer {
            "superficial stroma" => "superficial_",
            "deep stroma" => "deep_",
            _ => "",
        };
        let wanted = format!("{place}{fluorophore}_per_mm");
        self.parameters().map(|(parameter, _)| parameter.name).find(|name| *name == wanted)
    }

    /// Changes the site to a state; several may follow each other.
    ///
    /// # Errors
    /// A state that the site can't have, as a tooth has no blood, or that takes a parameter out of its range.
    pub fn apply(&mut self, state: &TissueState) -> Result<(), TissueError> {
        self.apply_share(state, 1.0)
    }

    /// Goes a share of the way to a state, 0 to 1: parameters change in proportion.
    ///
    /// # Errors
    /// Those of [`Self::apply`].
    pub fn apply_share(&mut self, state: &TissueState, share: f64) -> Result<(), TissueError> {
        self.check_kind(state)?;
        for (name, factor) in &state.factors {
            let value = self.get(name)?;
            self.set(name, value * (1.0 + share * (factor - 1.0)))?;
        }
        for (name, wanted) in &state.values {
            let value = self.get(name)?;
            self.set(name, value + share * (wanted - value))?;
        }
        state.additions(share).filter(|_| share > 0.0).try_for_each(|addition| self.add(addition))
    }

    /// Refuses a state that changes what only the other kind of tissue has.
    fn check_kind(&self, state: &TissueState) -> Result<(), TissueError> {
        let (kind, parameters, layers) = match *self.parameters {
            SiteParameters::Mucosa(_) => ("teeth", ToothParameters::PARAMETERS, ToothParameters::LAYERS),
            SiteParameters::Tooth(_) => ("mucosa", MucosaParameters::PARAMETERS, MucosaParameters::LAYERS),
        };
        let mut changed = state.factors.iter().chain(&state.values).map(|(name, _)| name);
        let parameter = changed.find(|name| {
            self.index_of(name).is_err() && parameters.iter().any(|parameter| parameter.name == *name)
        });
        let mut added = state.gray_per_mm.iter().map(|(layer, _)| layer);
        let layer = || {
            added.find(|layer| {
                layers.contains(&layer.as_str()) && !self.layer_names().contains(&layer.as_str())
            })
        };
        let Some(changed) = parameter.or_else(layer) else { return Ok(()) };
        let (site, state, changed) = (self.name().into(), state.name.clone(), changed.clone());
        Err(TissueError::StateOfOtherTissue { site, state, changed, kind })
    }

    /// Names of the fluorophores that it may hold; [`Self::tissue`] looks for those of a strength above 0.
    #[must_use]
    pub fn fluorophores(&self) -> &'static [&'static str] {
        match *self.parameters {
            SiteParameters::Mucosa(_) => MucosaParameters::FLUOROPHORES,
            SiteParameters::Tooth(_) => ToothParameters::FLUOROPHORES,
        }
    }

    /// Names of the layers that it may have, the uppermost first.
    #[must_use]
    pub fn layer_names(&self) -> &'static [&'static str] {
        match *self.parameters {
            SiteParameters::Mucosa(_) => MucosaParameters::LAYERS,
            SiteParameters::Tooth(_) => ToothParameters::LAYERS,
        }
    }

    /// Adds something to a layer.
    ///
    /// # Errors
    /// A layer that the site does not have, with the names of those that it has.
    pub fn add(&mut self, addition: LayerAddition) -> Result<(), TissueError> {
        let known = self.layer_names();
        if !known.contains(&addition.layer.as_str()) {
            let (site, name) = (self.name().into(), addition.layer);
            return Err(TissueError::NoSuchSiteLayer { site, name, known });
        }
        self.added.push(addition);
        Ok(())
    }

    /// What was added to its layers.
    #[must_use]
    pub fn added(&self) -> &[LayerAddition] {
        &self.added
    }

    /// Photons emitted per photon that a fluorophore of tissue absorbs, as far as one number can be given: to size what its own
    /// absorption does. None of fluorophores that no site holds.
    #[must_use]
    pub fn quantum_yield(fluorophore: &str) -> Option<f64> {
        QUANTUM_YIELDS.into_iter().find_map(|(name, value)| (name == fluorophore).then_some(value))
    }

    /// The tissue. `find` gives a fluorophore by its name.
    ///
    /// # Errors
    /// A fluorophore that `find` does not have, and parameters that together are no tissue.
    pub fn tissue(
        &self,
        find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>,
    ) -> Result<LayeredTissue, TissueError> {
        let find = |name: &str| {
            find(name).ok_or_else(|| TissueError::NoSuchFluorophore {
                site: self.name().into(),
                name: name.to_string(),
            })
        };
        let is_added = |layer: &str| self.added.iter().any(|addition| addition.layer == layer);
        let mut tissue = match &*self.parameters {
            SiteParameters::Mucosa(parameters) => parameters.tissue(&find, &is_added)?,
            SiteParameters::Tooth(parameters) => parameters.tissue(&find)?,
        };
        for LayerAddition { layer, absorption, fluorophores } in &self.added {
            let held = tissue.layers.iter_mut().find(|held| held.name == *layer);
            let held = held.ok_or_else(|| TissueError::ThinLayer { name: layer.clone() })?;
            held.absorption.extend_from_slice(absorption);
            held.fluorophores.extend_from_slice(fluorophores);
        }
        tissue.validate()?;
        Ok(tissue)
    }
}
