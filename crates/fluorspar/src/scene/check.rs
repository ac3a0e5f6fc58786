//! Checks that a scene is physical before anything is rendered.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fmt;

use thiserror::Error;

use super::{Scene, Shape};
use crate::geometry::MeshError;
use crate::light::LightName;
use crate::material::{Material, PhotonExcess};
use crate::spectral::{Curve, Fluorophore};
use crate::units::counted;

/// An error of a scene that prevents a render.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SceneError {
    /// Something refers to an entry that does not exist.
    #[error("{what} refers to {target} number {index}, but there are only {count}")]
    BadIndex {
        /// Who refers.
        what: String,
        /// To what kind of entry.
        target: &'static str,
        /// The index.
        index: usize,
        /// Number of entries.
        count: usize,
    },
    /// A mesh is broken.
    #[error("object \"{object}\": {source}")]
    Mesh {
        /// Name of the object.
        object: String,
        /// What is wrong.
        source: MeshError,
    },
    /// A length, exponent or other number is out of range.
    #[error("{what}: {message}")]
    OutOfRange {
        /// Which object, light or material.
        what: String,
        /// What is wrong and what is allowed.
        message: String,
    },
    /// More photons leave than arrive.
    #[error("material \"{material}\" {excess}")]
    CreatesPhotons {
        /// Name of the material.
        material: String,
        /// Where most photons are created, and how many.
        excess: PhotonExcess,
    },
    /// There is nothing to see.
    #[error("the scene has no {0}")]
    Nothing(&'static str),
}

/// Something that a user should know, though the scene can be rendered. One warning per cause; it names all that share it.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SceneWarning {
    /// Lights have power where the excitation spectrum of a fluorophore is not backed by data.
    #[error(
        "what some light excites is extrapolated, since its wavelengths lie beyond those at which the fluorophores were measured: {}",
        excitation_text(.0)
    )]
    ExcitationOutsideData(Vec<ExcitationOutsideData>),
    /// Fluorophores emit where their emission spectrum is not backed by data.
    #[error(
        "some fluorescence is extrapolated, since its wavelengths lie beyond those at which the emission was measured: {}",
        list(.0)
    )]
    EmissionOutsideData(Vec<EmissionOutsideData>),
    /// Lights have power outside the wavelength grid, where nothing is rendered.
    #[error("light outside the rendered {from_nm} to {to_nm} nm is left out: {}", list(.lights))]
    LightOutsideGrid {
        /// The lights.
        lights: Vec<LightOutsideGrid>,
        /// Start of the grid, nm.
        from_nm: f64,
        /// End of the grid, nm.
        to_nm: f64,
    },
    /// A light sends nothing.
    #[error("light \"{0}\" has no power within the rendered wavelengths")]
    DarkLight(String),
}

impl SceneWarning {
    /// The warning on one line: numbers of lights and fluorophores instead of their names.
    pub fn summary(&self) -> String {
        match self {
            Self::ExcitationOutsideData(cases) => {
                let lights = number_of(cases.iter().map(|case| case.light.as_str()));
                let fluorophores = number_of(cases.iter().map(|case| case.fluorophore.as_str()));
                format!(
                    "the excitation of {} by {} is extrapolated beyond its data",
                    counted(fluorophores, "fluorophore", "fluorophores"),
                    counted(lights, "light", "lights")
                )
            }
            Self::EmissionOutsideData(cases) => format!(
                "the emission of {} is extrapolated beyond its data, up to {:.1} % of it",
                counted(cases.len(), "fluorophore", "fluorophores"),
                cases.iter().fold(0.0, |most: f64, case| most.max(case.percent))
            ),
            Self::LightOutsideGrid { lights, from_nm, to_nm } => format!(
                "up to {:.1} % of the power of {} lies outside the rendered {from_nm} to {to_nm} nm and is left out",
                lights.iter().fold(0.0, |most: f64, light| most.max(light.percent)),
                counted(number_of(lights.iter().map(|light| light.light.as_str())), "light", "lights")
            ),
            Self::DarkLight(_) => self.to_string(),
        }
    }
}

/// Number of different names.
fn number_of<'a>(names: impl Iterator<Item = &'a str>) -> usize {
    names.collect::<BTreeSet<_>>().len()
}

/// A light and a fluorophore whose data do not reach as far.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationOutsideData {
    /// Light.
    pub light: String,
    /// Fluorophore.
    pub fluorophore: String,
    /// Share of the light's rendered power that lies outside the data, percent.
    pub percent: f64,
    /// Where the fluorophore's excitation is backed by data, nm.
    pub range_nm: (f64, f64),
}

/// A fluorophore that emits beyond its data.
#[derive(Clone, Debug, PartialEq)]
pub struct EmissionOutsideData {
    /// Fluorophore.
    pub fluorophore: String,
    /// Largest share under any light of the rendered emission that lies outside the data, percent.
    pub percent: f64,
    /// Where the fluorophore's emission is backed by data, nm.
    pub range_nm: (f64, f64),
}

/// A light that sends more than is rendered.
#[derive(Clone, Debug, PartialEq)]
pub struct LightOutsideGrid {
    /// Light.
    pub light: String,
    /// Share of its power, percent.
    pub percent: f64,
}

/// Light by light; fluorophores that were measured over the same wavelengths together.
fn excitation_text(cases: &[ExcitationOutsideData]) -> String {
    let mut reported: Vec<(&str, String, Vec<&str>)> = Vec::new();
    for case in cases {
        let (from, to) = case.range_nm;
        let share = format!("{:.0} % beyond {from} to {to} nm", case.percent);
        match reported.iter_mut().find(|(light, other, _)| *light == case.light && *other == share) {
            Some((.., names)) => names.push(&case.fluorophore),
            None => reported.push((&case.light, share, vec![&case.fluorophore])),
        }
    }
    let mut text = String::new();
    let mut last = None;
    for (light, share, names) in reported {
        let start = if last == Some(light) { ", ".into() } else { format!("of the light \"{}\" ", light) };
        if last.is_some_and(|last| last != light) {
            text += "; ";
        }
        text += &format!("{start}{share} ({})", names.join(", "));
        last = Some(light);
    }
    text
}

impl fmt::Display for EmissionOutsideData {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { fluorophore, percent, range_nm: (from, to) } = self;
        write!(f, "{percent:.1} % of the light of {fluorophore} (measured from {from} to {to} nm)")
    }
}

impl fmt::Display for LightOutsideGrid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} % of the power of \"{}\"", self.percent, self.light)
    }
}

fn list<T: fmt::Display>(items: &[T]) -> String {
    items.iter().map(T::to_string).collect::<Vec<_>>().join("; ")
}

/// Shares below this are not worth a warning, percent.
const LEAST_PERCENT: f64 = 1.0;
/// The same for emission: tails of models are a few percent wrong where they have data, too.
const LEAST_EMISSION_PERCENT: f64 = 2.0;
/// Excitation that ends above this share of its maximum breaks off.
const LEAST_EDGE: f64 = 0.05;
/// Most triangles of the instances of a light.
const MOST_EMISSIVE_TRIANGLES: u64 = 20_000_000;
/// Step at which photon conservation is checked, nm.
const CHECK_STEP_NM: f64 = 1.0;

/// Part numbers of images are 16-bit, and 0 is nothing.
const MOST_OBJECTS: usize = u16::MAX as usize - 1;

impl Scene {
    /// Checks indices, geometry, ranges and photon conservation.
    ///
    /// # Errors
    /// The first thing that makes the scene unphysical or impossible.
    pub fn check(&self) -> Result<(), SceneError> {
        if self.objects.is_empty() && !self.lights.iter().any(|light| light.emitter.is_environment()) {
            return Err(SceneError::Nothing("objects"));
        }
        if self.light_groups.is_empty() {
            return Err(SceneError::Nothing("lights"));
        }
        if self.objects.len() > MOST_OBJECTS {
            let message = format!(
                "a scene may have {MOST_OBJECTS}, so that images can number its parts; join some, or place many with \
                 instances of one part"
            );
            return Err(SceneError::OutOfRange { what: format!("{} objects", self.objects.len()), message });
        }
        let index = |what: String, target: &'static str, index: usize, count: usize| {
            if index < count { Ok(()) } else { Err(SceneError::BadIndex { what, target, index, count }) }
        };
        for object in &self.objects {
            let what = format!("object \"{}\"", object.name);
            index(what.clone(), "material", object.material, self.materials.len())?;
            if let Some(emission) = &object.emission {
                index(what.clone(), "light group", emission.group, self.light_groups.len())?;
                let material = &self.materials[object.material];
                if material.any(&self.materials, |part| part.opacity.is_some()) {
                    let message = "a surface that emits can't have a material with holes; remove `opacity` or the emission";
                    return Err(SceneError::OutOfRange { what, message: message.into() });
                }
            }
            match &object.shape {
                Shape::Mesh(mesh) => {
                    mesh.validate()
                        .map_err(|source| SceneError::Mesh { object: object.name.clone(), source })?;
                }
                Shape::Instances(many) => {
                    let refuse =
                        |message: String| Err(SceneError::OutOfRange { what: what.clone(), message });
                    if let Err(error) = many.validate() {
                        return refuse(error.to_string());
                    }
                    if self.materials[object.material].smoothing_m(&self.materials) > 0.0 {
                        return refuse(
                            "the film on instances of a mesh follows their relief: smooth it over 0, or use a mesh of its own"
                                .into(),
                        );
                    }
                    let triangles = many.triangle_count();
                    if object.emission.is_some() && triangles > MOST_EMISSIVE_TRIANGLES {
                        return refuse(format!(
                            "its instances have {triangles} triangles; lights are kept triangle by triangle, up to \
                             {MOST_EMISSIVE_TRIANGLES}. Give fewer instances or a coarser mesh"
                        ));
                    }
                }
                Shape::Sphere { radius_m, .. } | Shape::Disc { radius_m, .. } => {
                    positive(&what, "radius", *radius_m)?
                }
            }
        }
        for light in &self.lights {
            let what = format!("light \"{}\"", light.name);
            index(what.clone(), "light group", light.group, self.light_groups.len())?;
            if let Err(error) = light.emitter.check() {
                return Err(SceneError::OutOfRange { what, message: error.to_string() });
            }
        }
        let nodes = self.conservation_nodes();
        let yields: Vec<Vec<f64>> = self.fluorophores.iter().map(|f| f.eem.total_yields(&nodes)).collect();
        for (position, material) in self.materials.iter().enumerate() {
            for amount in &material.fluorophores {
                index(
                    format!("material \"{}\"", material.name),
                    "fluorophore",
                    amount.fluorophore,
                    self.fluorophores.len(),
                )?;
            }
            self.check_material(position, &nodes, &yields)?;
        }
        Ok(())
    }

    /// Parameters, parts and conservation of photons of one material.
    fn check_material(
        &self,
        position: usize,
        nodes_nm: &[f64],
        yields: &[Vec<f64>],
    ) -> Result<(), SceneError> {
        let material = &self.materials[position];
        let what = || format!("material \"{}\"", material.name);
        material
            .check(&self.grid)
            .map_err(|error| SceneError::OutOfRange { what: what(), message: error.to_string() })?;
        let count = self.materials.len();
        if let Some(&index) = material.parts().iter().flatten().find(|&&part| part >= count) {
            return Err(SceneError::BadIndex { what: what(), target: "material", index, count });
        }
        if Material::is_part_of_itself(position, &self.materials) {
            let message = "contains itself; remove the loop".into();
            return Err(SceneError::OutOfRange { what: what(), message });
        }
        let Some(excess) = material.photon_excess(nodes_nm, yields) else { return Ok(()) };
        Err(SceneError::CreatesPhotons { material: material.name.clone(), excess })
    }

    /// Wavelengths at which photon conservation is checked, nm.
    fn conservation_nodes(&self) -> Vec<f64> {
        let (start, end) = (self.grid.start_nm(), self.grid.end_nm());
        let steps = ((end - start) / CHECK_STEP_NM).ceil() as usize;
        (0..=steps).map(|step| (start + CHECK_STEP_NM * step as f64).min(end)).collect()
    }

    /// Warnings about lights and fluorophores: light that is left out, and results without data.
    pub fn warnings(&self) -> Vec<SceneWarning> {
        let (from_nm, to_nm) = (self.grid.start_nm(), self.grid.end_nm());
        let (mut outside_grid, mut dark) = (Vec::new(), Vec::new());
        let mut excitation = Vec::new();
        let mut emission: Vec<EmissionOutsideData> = Vec::new();
        for (light, spectrum) in self.distinct_spectra() {
            let total = spectrum.total();
            let inside = spectrum.integral(from_nm, to_nm);
            if inside <= 0.0 {
                dark.push(SceneWarning::DarkLight(light.to_string()));
                continue;
            }
            let percent = 100.0 * (1.0 - inside / total);
            if percent > LEAST_PERCENT {
                outside_grid.push(LightOutsideGrid { light: light.light().into(), percent });
            }
            // In units of 1/(h c): photons = energy * lambda.
            let photons = spectrum.clipped(from_nm, to_nm).times(&Curve::from_fn(from_nm, to_nm, |nm| nm));
            for fluorophore in &self.fluorophores {
                let percent = 100.0 * self.unknown_excitation(fluorophore, &spectrum, &photons) / inside;
                let name = || fluorophore.name.clone();
                if percent > LEAST_PERCENT {
                    let range_nm = fluorophore.excitation_range_nm;
                    let light = light.light().into();
                    excitation.push(ExcitationOutsideData { light, fluorophore: name(), percent, range_nm });
                }
                let range_nm = fluorophore.emission_range_nm;
                let emitted = fluorophore.eem.photon_exitance(&photons, (from_nm, to_nm));
                let known = emitted.integral(range_nm.0.max(from_nm), range_nm.1.min(to_nm));
                let percent = 100.0 * (1.0 - known / emitted.total());
                if percent > LEAST_EMISSION_PERCENT {
                    match emission.iter_mut().find(|case| case.fluorophore == fluorophore.name) {
                        Some(case) => case.percent = case.percent.max(percent),
                        None => emission.push(EmissionOutsideData { fluorophore: name(), percent, range_nm }),
                    }
                }
            }
        }
        let mut warnings = dark;
        if !outside_grid.is_empty() {
            warnings.push(SceneWarning::LightOutsideGrid { lights: outside_grid, from_nm, to_nm });
        }
        if !excitation.is_empty() {
            warnings.push(SceneWarning::ExcitationOutsideData(excitation));
        }
        if !emission.is_empty() {
            warnings.push(SceneWarning::EmissionOutsideData(emission));
        }
        warnings
    }

    /// Spectra of all that sends light in a light group, those of surfaces first.
    pub(crate) fn group_spectra(&self, group: usize) -> Vec<Cow<'_, Curve>> {
        let surfaces = self.objects.iter().filter_map(|object| object.emission.as_ref());
        let surfaces = surfaces.filter(|emission| emission.group == group);
        let lights = self.lights.iter().filter(|light| light.group == group);
        let surfaces = surfaces.map(|emission| Cow::Borrowed(&emission.radiance));
        surfaces.chain(lights.map(|light| light.whole_spectrum())).collect()
    }

    /// Names and spectra of all that sends light, those of one group with one spectrum once.
    fn distinct_spectra(&self) -> Vec<(LightName, Cow<'_, Curve>)> {
        let lights =
            self.lights.iter().map(|light| (light.name.clone(), light.group, light.whole_spectrum()));
        let surfaces = self.objects.iter().filter_map(|object| {
            let emission = object.emission.as_ref()?;
            Some((object.name.as_str().into(), emission.group, Cow::Borrowed(&emission.radiance)))
        });
        let mut distinct: Vec<(usize, LightName, Cow<'_, Curve>)> = Vec::new();
        for (name, group, spectrum) in lights.chain(surfaces) {
            if !distinct.iter().any(|(other, _, seen)| *other == group && *seen == spectrum) {
                distinct.push((group, name, spectrum));
            }
        }
        distinct.into_iter().map(|(_, name, spectrum)| (name, spectrum)).collect()
    }

    /// Power of a light within the grid for which it is not known how a fluorophore takes it. Below the data nothing is
    /// known. Above them excitation usually ends: light there counts where the data break off before it does, and where
    /// the extrapolation has a visible part in the fluorescence.
    fn unknown_excitation(&self, fluorophore: &Fluorophore, spectrum: &Curve, photons: &Curve) -> f64 {
        let (start, end) = (self.grid.start_nm(), self.grid.end_nm());
        let (low, high) = fluorophore.excitation_range_nm;
        let below = if low > start { spectrum.integral(start, low.min(end)) } else { 0.0 };
        if high >= end {
            return below;
        }
        let above = spectrum.integral(high.max(start), end);
        let emitted = |photons: &Curve| fluorophore.eem.photon_exitance(photons, (start, end)).total();
        let (all, beyond) = (emitted(photons), emitted(&photons.clipped(high.max(start), end)));
        let nodes: Vec<f64> = (0..=100).map(|i| low + (high - low) * f64::from(i) / 100.0).collect();
        let yields = fluorophore.eem.total_yields(&nodes);
        let best = yields.iter().copied().fold(0.0, f64::max);
        let breaks_off = yields.last().is_some_and(|last| *last > LEAST_EDGE * best);
        if breaks_off || 100.0 * beyond > LEAST_PERCENT * all { below + above } else { below }
    }
}

fn positive(what: &str, quantity: &str, value: f32) -> Result<(), SceneError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    let message = format!("the {quantity} must be a positive length; got {value} m");
    Err(SceneError::OutOfRange { what: what.into(), message })
}
