//! How far layered tissue as a material of a scene is from its layers, under light from one direction.
//!
//!     cargo run --release -p fluorspar-experiment --example tissue_as_a_material
//!
//! A material of tissue is exact under diffuse light. Its base is Lambertian: light that enters at an angle theta is passed on
//! with the Fresnel factor `(1 - r(theta)) / (1 - E)` of the surface alone, and leaves with that of its own angle. In the layers a
//! steep beam goes deeper than a flat one, and what leaves is not quite Lambertian. For every site of the catalogue this prints
//! reflectance and fluorescence by the solver, divided by those of the material.
#![allow(clippy::print_stdout, reason = "this program prints a table")]

use std::error::Error;
use std::f64::consts::PI;
use std::sync::Arc;

use fluorspar::tissue::{
    DiscreteOrdinates, EffectiveTissue, Incidence, LayeredTissue, Level, LightField, fresnel_reflectance,
};
use fluorspar_experiment::preset::{self, PresetKind};

/// Angles of the light, and of the view, degrees.
const ANGLES_DEG: [f64; 3] = [0.0, 45.0, 70.0];
/// Wavelengths of reflectance, nm.
const REFLECTED_NM: [f64; 5] = [420.0, 450.0, 520.0, 560.0, 700.0];
/// Excitation and emission, nm.
const PAIRS_NM: [[f64; 2]; 3] = [[385.0, 520.0], [405.0, 520.0], [405.0, 635.0]];
/// Wavelengths at which tissues are solved, nm.
const SOLVED_NM: [f64; 8] = [385.0, 405.0, 420.0, 450.0, 520.0, 560.0, 635.0, 700.0];
/// Depths per layer.
const DEPTHS: usize = 600;

fn main() -> Result<(), Box<dyn Error>> {
    println!("Solver over material: 1 is exact. Light (R, F) or view (L) at {ANGLES_DEG:?} degrees.");
    let [mut least, mut most] = [f64::INFINITY, 0.0_f64];
    for name in preset::names(PresetKind::Site) {
        let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
        let tissue = preset::site(name)?.tissue(&find)?;
        let solved = EffectiveTissue::new(&tissue, &SOLVED_NM, DiscreteOrdinates::WORKING)?;
        println!("\n{name}");
        for nm in REFLECTED_NM {
            let diffuse = field(&tissue, nm, Incidence::Lambertian)?;
            let mut light = Vec::new();
            let mut view = Vec::new();
            for cosine in cosines() {
                let factor = passing(&solved, &tissue, cosine);
                let beam = field(&tissue, nm, Incidence::Collimated { cosine })?;
                light.push(beam.reflectance / (factor * diffuse.reflectance));
                view.push(PI * diffuse.radiance_above(cosine) / (factor * diffuse.reflectance));
            }
            println!("  R {nm:>3} nm        {}     L {}", row(&light), row(&view));
            least = light.iter().chain(&view).copied().fold(least, f64::min);
            most = light.iter().chain(&view).copied().fold(most, f64::max);
        }
        for [excitation, emission] in PAIRS_NM {
            let ratios = cosines()
                .map(|cosine| fluorescence_ratio(&solved, &tissue, [excitation, emission], cosine))
                .into_iter()
                .collect::<Result<Vec<f64>, Box<dyn Error>>>()?;
            println!("  F {excitation:>3} to {emission:>3} nm {}", row(&ratios));
            least = ratios.iter().copied().fold(least, f64::min);
            most = ratios.iter().copied().fold(most, f64::max);
        }
    }
    println!("\nAll ratios lie between {least:.3} and {most:.3}.");
    Ok(())
}

fn cosines() -> [f64; 3] {
    ANGLES_DEG.map(|degrees| degrees.to_radians().cos())
}

fn row(ratios: &[f64]) -> String {
    ratios.iter().map(|ratio| format!(" {ratio:.3}")).collect()
}

fn field(tissue: &LayeredTissue, nm: f64, incidence: Incidence) -> Result<LightField, Box<dyn Error>> {
    Ok(DiscreteOrdinates::WORKING.solve(&tissue.optics(nm), incidence)?)
}

/// `(1 - r(theta)) / (1 - E)` of the surface.
fn passing(solved: &EffectiveTissue, tissue: &LayeredTissue, cosine: f64) -> f64 {
    (1.0 - fresnel_reflectance(cosine, 1.0, tissue.surface_index())) / (1.0 - solved.specular_reflectance())
}

/// Fluorescence under a beam by the solver, all fluorophores together, over that of the material. Refractive indices of layers
/// cancel within a layer.
fn fluorescence_ratio(
    solved: &EffectiveTissue,
    tissue: &LayeredTissue,
    [excitation, emission]: [f64; 2],
    cosine: f64,
) -> Result<f64, Box<dyn Error>> {
    let beam = field(tissue, excitation, Incidence::Collimated { cosine })?;
    let diffuse = field(tissue, excitation, Incidence::Lambertian)?;
    let leaving = field(tissue, emission, Incidence::Lambertian)?;
    let [mut by_beam, mut by_diffuse] = [0.0; 2];
    for part in solved.parts() {
        let thickness_mm = 1e-3 * tissue.layers[part.layer].thickness_um;
        let [mut of_beam, mut of_diffuse] = [0.0; 2];
        for step in 0..DEPTHS {
            // Midpoints that crowd toward the top, where the light changes fastest
            let u = (step as f64 + 0.5) / DEPTHS as f64;
            let (depth_mm, weight) = (thickness_mm * u * u, u);
            let out = weight * leaving.layer_fluence(part.layer, depth_mm);
            of_beam += out * beam.layer_fluence(part.layer, depth_mm);
            of_diffuse += out * diffuse.layer_fluence(part.layer, depth_mm);
        }
        let amount = solved.yield_density(part, emission, excitation, Level::AboveSurface);
        by_beam += amount * of_beam / of_diffuse;
        by_diffuse += amount;
    }
    Ok(by_beam / (by_diffuse * passing(solved, tissue, cosine)))
}
