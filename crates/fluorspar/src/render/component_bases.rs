//! In which spectra each component is worth storing: bases for what light can become in a scene.

use std::sync::Arc;

use fluorspar_accel::bands::{BandBlock, copy_bands};
use rayon::prelude::*;

use super::compiled_scene::{CompiledScene, Source};
use crate::image::{ComponentBases, SpectralBasis, representatives};

/// Error of the spectra of the pilot, relative to them, see [`SpectralBasis::of_samples`]: that of a component that is all the light of
/// its group somewhere. One that is a share of it everywhere may err as much more, and no more than at the least share.
const ERROR: f32 = 5e-4;
const LEAST_SHARE: f32 = 0.1;
/// A component that is nowhere so large a share, as fluorescence in white light, may err by this: by a fraction of `ERROR` of all light.
const FAINT_SHARE: f32 = 1e-2;
const FAINT_ERROR: f32 = 2e-2;
/// Bands dimmer than this share of the brightest of a light group show nothing.
const DARK_BAND: f32 = 1e-7;
/// Error of what represents the reflectances and emissions of a scene.
const REPRESENTED: f32 = 1e-3;
/// Bands that are dimmer than this share of the brightest are exact relative to it: of fluorescence, and of reflected light, whose tails
/// a filter may let pass where it holds back the rest.
const FLOOR_OF_FLUORESCENCE: f32 = 1e-2;
const FLOOR_OF_REFLECTED: f32 = 1e-9;
/// Most reflectances and emissions of a scene by which all others are represented.
const MOST_REFLECTANCES: usize = 24;
const MOST_EMISSIONS: usize = 12;

/// The bases of all components, from the spectra of pilot pixels, `[component]` each `[pixel][band]`, and from what the lights
/// excite and the surfaces reflect once and twice: a pilot may miss what is small. `levels` are the means of the pilot,
/// `[component][band]`.
pub(super) fn component_bases(scene: &CompiledScene, pilot: Vec<Vec<f32>>, levels: &[f32]) -> ComponentBases {
    let (bands, kinds) = (scene.bands, scene.fluorophores + 2);
    let plain = |blocks: &Vec<BandBlock>| {
        let mut spectrum = vec![0.0; bands];
        copy_bands(blocks, &mut spectrum);
        spectrum
    };
    let terms: Vec<f32> =
        scene.material_spectra.iter().flat_map(|material| material.terms.iter().flat_map(plain)).collect();
    let reflectances =
        reflected_twice(&representatives(&terms, bands, REPRESENTED, MOST_REFLECTANCES), bands);
    let matrices = matrices_of_fluorophores(scene);
    let of_component = |(component, seen): (usize, Vec<f32>)| {
        let (group, kind) = (component / kinds, component % kinds);
        let sources = || scene.sources.iter().filter(move |source| source.group == group);
        let lights: Vec<f32> = if kind == 0 {
            sources().flat_map(|source| plain(&source.bands)).collect()
        } else if kind < kinds - 1 {
            let exitances = |source: &Source| -> Vec<f32> {
                matrices[kind - 1].iter().flat_map(|matrix| plain(&source.exitance[*matrix])).collect()
            };
            sources().flat_map(exitances).collect()
        } else {
            // Fluorescence of any fluorophore that excites any
            let all: Vec<f32> = sources().flat_map(|source| source.exitance.iter().flat_map(plain)).collect();
            let exciting = representatives(&all, bands, REPRESENTED, MOST_EMISSIONS);
            let again = |light: &[f32]| -> Vec<f32> {
                scene.plain_operators.iter().flat_map(|operator| operator.product(1.0, light)).collect()
            };
            exciting.chunks_exact(bands).flat_map(again).collect()
        };
        let lights = representatives(&lights, bands, REPRESENTED, MOST_EMISSIONS);
        let mut possible = Vec::new();
        for light in lights.chunks_exact(bands) {
            possible.extend_from_slice(light);
            for reflectance in reflectances.chunks_exact(bands) {
                possible.extend(light.iter().zip(reflectance).map(|(a, b)| a * b));
            }
        }
        let floor = if kind == 0 { FLOOR_OF_REFLECTED } else { FLOOR_OF_FLUORESCENCE };
        let error = match largest_share(component, kinds, levels, bands) {
            share if share < FAINT_SHARE => FAINT_ERROR,
            share => ERROR / share.max(LEAST_SHARE),
        };
        SpectralBasis::of_samples(&seen, &possible, bands, floor, error).map(Arc::new)
    };
    pilot.into_par_iter().enumerate().map(of_component).collect()
}

/// Largest share of a component in the light of its group in any band.
fn largest_share(component: usize, kinds: usize, levels: &[f32], bands: usize) -> f32 {
    let group = component / kinds * kinds;
    let total = |band: usize| (group..group + kinds).map(|c| levels[c * bands + band]).sum::<f32>();
    let most = (0..bands).map(total).fold(0.0, f32::max);
    let share = |band: usize| match total(band) {
        total if total > DARK_BAND * most => levels[component * bands + band] / total,
        _ => 0.0,
    };
    match (0..bands).map(share).fold(0.0, f32::max) {
        // What the pilot does not see may be small and bright
        0.0 => 1.0,
        share => share,
    }
}

/// Reflectances and all their products of two.
fn reflected_twice(once: &[f32], bands: usize) -> Vec<f32> {
    let mut all = once.to_vec();
    for (number, a) in once.chunks_exact(bands).enumerate() {
        for b in once.chunks_exact(bands).skip(number) {
            all.extend(a.iter().zip(b).map(|(a, b)| a * b));
        }
    }
    all
}

/// The matrices that each fluorophore has in the materials of a scene.
fn matrices_of_fluorophores(scene: &CompiledScene) -> Vec<Vec<usize>> {
    let mut matrices = vec![Vec::new(); scene.fluorophores];
    for emitter in scene.material_spectra.iter().flat_map(|material| &material.emitters) {
        matrices[emitter.fluorophore].push(emitter.matrix);
    }
    for own in &mut matrices {
        own.sort_unstable();
        own.dedup();
    }
    matrices
}
