//! Checks that a scene is physical before anything is rendered.

use glam::Vec2;
use thiserror::Error;

use super::{Scene, Shape};
use crate::geometry::MeshError;
use crate::light::Emitter;
use crate::material::Material;

/// What makes a scene impossible to render.
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
        /// How many entries there are.
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
    #[error(
        "material \"{material}\" creates photons: at {wavelength_nm} nm reflectance {reflectance:.4} plus fluorescence \
         yield {photon_yield:.4} exceed 1 by {excess:.4}. Lower the reflectance or the concentrations"
    )]
    CreatesPhotons {
        /// Name of the material.
        material: String,
        /// Excitation wavelength, nm.
        wavelength_nm: f64,
        /// Largest diffuse reflectance there.
        reflectance: f64,
        /// Largest photon yield there, summed over fluorophores.
        photon_yield: f64,
        /// Excess over 1.
        excess: f64,
    },
    /// There is nothing to see.
    #[error("the scene has no {0}")]
    Nothing(&'static str),
}

/// Something that a user should know, though the scene can be rendered.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SceneWarning {
    /// A light has power where a fluorophore's excitation spectrum is not backed by data.
    #[error(
        "{percent:.1} % of the power of light \"{light}\" lies outside {from_nm} to {to_nm} nm, where the excitation of \
         fluorophore \"{fluorophore}\" is backed by data"
    )]
    ExcitationOutsideData {
        /// Light.
        light: String,
        /// Fluorophore.
        fluorophore: String,
        /// Share of the light's power, percent.
        percent: f64,
        /// Start of the fluorophore's range, nm.
        from_nm: f64,
        /// End of that range, nm.
        to_nm: f64,
    },
    /// A light has power outside the wavelength grid, where nothing is rendered.
    #[error(
        "{percent:.1} % of the power of light \"{light}\" lies outside the rendered {from_nm} to {to_nm} nm and is left out"
    )]
    LightOutsideGrid {
        /// Light.
        light: String,
        /// Share of the light's power, percent.
        percent: f64,
        /// Start of the grid, nm.
        from_nm: f64,
        /// End of the grid, nm.
        to_nm: f64,
    },
    /// A light sends nothing.
    #[error("light \"{0}\" has no power within the rendered wavelengths")]
    DarkLight(String),
}

/// Step at which photon conservation is checked, nm.
const CHECK_STEP_NM: f64 = 1.0;
/// Rounding allowed above 1: a perfectly white material must pass.
const ROUNDING: f64 = 1e-6;

impl Scene {
    /// Checks indices, geometry, ranges and photon conservation.
    ///
    /// # Errors
    /// The first thing that makes the scene unphysical or impossible.
    pub fn check(&self) -> Result<(), SceneError> {
        if self.objects.is_empty() && !self.lights.iter().any(|l| l.emitter == Emitter::Environment) {
            return Err(SceneError::Nothing("objects"));
        }
        if self.light_groups.is_empty() {
            return Err(SceneError::Nothing("lights"));
        }
        let index = |what: String, target: &'static str, index: usize, count: usize| {
            if index < count { Ok(()) } else { Err(SceneError::BadIndex { what, target, index, count }) }
        };
        for object in &self.objects {
            let what = format!("object \"{}\"", object.name);
            index(what.clone(), "material", object.material, self.materials.len())?;
            if let Some(emission) = &object.emission {
                index(what.clone(), "light group", emission.group, self.light_groups.len())?;
            }
            match &object.shape {
                Shape::Mesh(mesh) => {
                    mesh.validate()
                        .map_err(|source| SceneError::Mesh { object: object.name.clone(), source })?;
                }
                Shape::Sphere { radius_m, .. } | Shape::Disc { radius_m, .. } => {
                    positive(&what, "radius", *radius_m)?
                }
            }
        }
        for light in &self.lights {
            let what = format!("light \"{}\"", light.name);
            index(what.clone(), "light group", light.group, self.light_groups.len())?;
            check_emitter(&what, &light.emitter)?;
        }
        let nodes = self.conservation_nodes();
        let yields: Vec<Vec<f64>> = self.fluorophores.iter().map(|f| f.eem.total_yields(&nodes)).collect();
        for material in &self.materials {
            for amount in &material.fluorophores {
                index(
                    format!("material \"{}\"", material.name),
                    "fluorophore",
                    amount.fluorophore,
                    self.fluorophores.len(),
                )?;
            }
            if let Some(coat) = &material.coat
                && !(1.0..=3.0).contains(&coat.refractive_index)
            {
                return Err(SceneError::OutOfRange {
                    what: format!("coat of material \"{}\"", material.name),
                    message: format!("refractive index {} is not between 1 and 3", coat.refractive_index),
                });
            }
            check_photons(material, &nodes, &yields)?;
        }
        Ok(())
    }

    /// Wavelengths at which photon conservation is checked, nm.
    fn conservation_nodes(&self) -> Vec<f64> {
        let (start, end) = (self.grid.start_nm(), self.grid.end_nm());
        let steps = ((end - start) / CHECK_STEP_NM).ceil() as usize;
        (0..=steps).map(|step| (start + CHECK_STEP_NM * step as f64).min(end)).collect()
    }

    /// What a user should know about the lights.
    pub fn warnings(&self) -> Vec<SceneWarning> {
        let mut warnings = Vec::new();
        let (from_nm, to_nm) = (self.grid.start_nm(), self.grid.end_nm());
        let mut seen: Vec<(usize, &crate::spectral::Curve)> = Vec::new();
        for light in &self.lights {
            if seen.iter().any(|(group, spectrum)| *group == light.group && **spectrum == light.spectrum) {
                continue;
            }
            seen.push((light.group, &light.spectrum));
            let total = light.spectrum.total();
            let inside = light.spectrum.integral(from_nm, to_nm);
            if inside <= 0.0 {
                warnings.push(SceneWarning::DarkLight(light.name.clone()));
                continue;
            }
            let percent = 100.0 * (1.0 - inside / total);
            if percent > 1.0 {
                let light = light.name.clone();
                warnings.push(SceneWarning::LightOutsideGrid { light, percent, from_nm, to_nm });
            }
            for fluorophore in &self.fluorophores {
                let (from_nm, to_nm) = fluorophore.excitation_range_nm;
                // Beyond the long end excitation is weak and its tail is extrapolated smoothly; below it is unknown.
                let below = light.spectrum.integral(self.grid.start_nm(), from_nm);
                let percent = 100.0 * below / inside;
                if percent > 1.0 {
                    warnings.push(SceneWarning::ExcitationOutsideData {
                        light: light.name.clone(),
                        fluorophore: fluorophore.name.clone(),
                        percent,
                        from_nm,
                        to_nm,
                    });
                }
            }
        }
        warnings
    }
}

/// `R + sum_o Y <= 1` for every excitation wavelength, with all textures at their largest value. `yields` holds those
/// of each fluorophore at unit concentration.
fn check_photons(material: &Material, nodes: &[f64], yields: &[Vec<f64>]) -> Result<(), SceneError> {
    let mut worst = None;
    let mut largest = ROUNDING;
    for (node, &wavelength_nm) in nodes.iter().enumerate() {
        let reflectance: f64 = material
            .reflectance
            .iter()
            .map(|term| term.spectrum.at(wavelength_nm) * f64::from(term.weight.max()))
            .sum();
        let photon_yield: f64 = material
            .fluorophores
            .iter()
            .map(|amount| yields[amount.fluorophore][node] * f64::from(amount.concentration.max()))
            .sum();
        let (mut reflectance, mut photon_yield) = (reflectance, photon_yield);
        if reflectance + photon_yield - 1.0 > ROUNDING {
            // Textures of one material often exclude each other: look where they are together.
            (reflectance, photon_yield) = largest_sum(material, wavelength_nm, node, yields);
        }
        let excess = reflectance + photon_yield - 1.0;
        if excess > largest {
            largest = excess;
            let material = material.name.clone();
            worst = Some(SceneError::CreatesPhotons {
                material,
                wavelength_nm,
                reflectance,
                photon_yield,
                excess,
            });
        }
    }
    worst.map_or(Ok(()), Err)
}

/// Reflectance and photon yield where their sum is largest on a lattice over the textures.
fn largest_sum(material: &Material, wavelength_nm: f64, node: usize, yields: &[Vec<f64>]) -> (f64, f64) {
    const SIDE: u32 = 48;
    let mut worst = (0.0, 0.0);
    for i in 0..SIDE * SIDE {
        let uv = Vec2::new((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5) / SIDE as f32;
        let reflectance: f64 = material
            .reflectance
            .iter()
            .map(|term| term.spectrum.at(wavelength_nm) * f64::from(term.weight.at(uv)))
            .sum();
        let photon_yield: f64 = material
            .fluorophores
            .iter()
            .map(|amount| yields[amount.fluorophore][node] * f64::from(amount.concentration.at(uv)))
            .sum();
        if reflectance + photon_yield > worst.0 + worst.1 {
            worst = (reflectance, photon_yield);
        }
    }
    worst
}

fn positive(what: &str, quantity: &str, value: f32) -> Result<(), SceneError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    let message = format!("the {quantity} must be a positive length; got {value} m");
    Err(SceneError::OutOfRange { what: what.into(), message })
}

fn check_emitter(what: &str, emitter: &Emitter) -> Result<(), SceneError> {
    let exponent = |exponent: f32, lowest: f32| {
        if (lowest..=Emitter::MAX_EXPONENT).contains(&exponent) {
            return Ok(());
        }
        let message = format!(
            "the emission exponent {exponent} is not between {lowest} and {}; for a flat source 1 is Lambertian (a half angle of 60 degrees)",
            Emitter::MAX_EXPONENT
        );
        Err(SceneError::OutOfRange { what: what.into(), message })
    };
    match emitter {
        Emitter::Disc { radius_m, exponent: g, .. } => {
            positive(what, "radius", *radius_m)?;
            exponent(*g, 1.0)
        }
        Emitter::Rectangle { edge_u, edge_v, exponent: g, .. } => {
            positive(what, "first edge", edge_u.length())?;
            positive(what, "second edge", edge_v.length())?;
            exponent(*g, 1.0)
        }
        Emitter::Sphere { radius_m, .. } => positive(what, "radius", *radius_m),
        Emitter::Point { pattern: Some((_, g)), .. } => exponent(*g, 0.0),
        Emitter::Point { pattern: None, .. } | Emitter::Distant { .. } | Emitter::Environment => Ok(()),
    }
}
