//! Pilot samples, which find the quanta of the film.

use fluorspar_accel::bands::{BLOCK, BandBlock, copy_bands};
use rayon::prelude::*;

use super::block_sum::BlockSum;
use super::compiled_scene::CompiledScene;
use super::component_bases::component_bases;
use super::component_labels::component_labels;
use super::settings::{ComponentBands, RenderSettings};
use crate::image::{Component, FilmLayout, SpectralBasis};
use crate::interruption::end_if_interrupted;
use crate::scene::Scene;

/// Pilot pixels along each side of the image.
const PILOT_SIDE: usize = 32;
/// Samples of each pilot pixel.
const PILOT_SAMPLES: u32 = 4;

/// Pieces along each side of the image that are timed.
const TIMED_SIDE: usize = 8;
/// Samples of each pixel of a timed piece: those of a whole block.
const TIMED_SAMPLES: u32 = 16;

/// Traces some thousand paths all over the image in batches, as the film is filled with them, and forgets them. Returns their number.
pub(super) fn trial_paths(compiled: &CompiledScene, settings: &RenderSettings) -> usize {
    let camera = &compiled.camera;
    let samples = 0..settings.samples_per_pixel.min(TIMED_SAMPLES);
    let middle = |number: usize, size: usize| (2 * number + 1) * size / (2 * TIMED_SIDE);
    (0..TIMED_SIDE * TIMED_SIDE)
        .into_par_iter()
        .map_init(
            || BlockSum::new(compiled),
            |block, piece| {
                let row = middle(piece / TIMED_SIDE, camera.height);
                let col = middle(piece % TIMED_SIDE, camera.width);
                let count = block.pixels_at_a_time(&samples).min(camera.width - col);
                let pixels = (0..count).map(|pixel| (row, col + pixel));
                block.render(compiled, settings, pixels, samples.clone());
                count * samples.len()
            },
        )
        .sum()
}

/// Layout of the film, with quanta from pilot samples on a grid of pixels.
pub(super) fn film_layout(
    compiled: &CompiledScene,
    scene: &Scene,
    settings: &RenderSettings,
    scene_digest: String,
) -> FilmLayout {
    let camera = &compiled.camera;
    let components = component_labels(scene, settings);
    let bands = compiled.bands;
    // Choose a grid of pilot pixels
    let grid = |size: usize| -> Vec<usize> {
        let count = size.min(PILOT_SIDE);
        (0..count).map(|i| (2 * i + 1) * size / (2 * count)).collect()
    };
    let pixels: Vec<(usize, usize)> = grid(camera.height)
        .into_iter()
        .flat_map(|row| grid(camera.width).into_iter().map(move |col| (row, col)))
        .collect();
    let has_bases = settings.film_bands() == ComponentBands::Basis;
    // Fixed groups of pixels: sums of floats in an order that no scheduler decides.
    let parts: Vec<_> = pixels
        .par_chunks(PILOT_SIDE)
        .map_init(
            || BlockSum::new(compiled),
            |block, pixels| {
                let (mut brightest, mut sums) =
                    (vec![0.0_f32; block.pixel_len()], vec![0.0; block.pixel_len()]);
                let mut spectra = vec![Vec::new(); components.len()];
                for &(row, col) in pixels {
                    end_if_interrupted();
                    let mut pixel = vec![0.0_f32; block.pixel_len()];
                    for sample in 0..PILOT_SAMPLES {
                        block.render(compiled, settings, std::iter::once((row, col)), sample..sample + 1);
                        for ((most, sum), &value) in brightest.iter_mut().zip(&mut sums).zip(&block.values) {
                            *most = most.max(value);
                            *sum += f64::from(value);
                        }
                        pixel.iter_mut().zip(&block.values).for_each(|(sum, value)| *sum += value);
                    }
                    let of_components = spectra.iter_mut().zip(pixel.chunks_exact(bands));
                    for (spectra, of_pixel) in
                        of_components.filter(|(_, of)| has_bases && of.iter().any(|v| *v > 0.0))
                    {
                        spectra.extend_from_slice(of_pixel);
                    }
                }
                (brightest, sums, spectra)
            },
        )
        .collect();
    // Reduce brightest samples and sums in a fixed order
    let (mut brightest, mut levels) =
        (vec![0.0_f32; components.len() * bands], vec![0.0; components.len() * bands]);
    let mut spectra = vec![Vec::new(); components.len()];
    for (most, sums, of_part) in parts {
        spectra.iter_mut().zip(of_part).for_each(|(all, of_part)| all.extend(of_part));
        brightest.iter_mut().zip(&most).for_each(|(a, b)| *a = a.max(*b));
        levels.iter_mut().zip(&sums).for_each(|(a, b)| *a += b);
    }
    let samples = f64::from(PILOT_SAMPLES) * pixels.len() as f64;
    let levels: Vec<f32> = levels.into_iter().map(|sum| ((sum / samples) as f32).min(f32::MAX)).collect();
    let bases = if has_bases { component_bases(compiled, spectra, &levels) } else { Vec::new() };
    let exponents = exponents(compiled, &components, &brightest);
    let of_component = |(component, exponents): (usize, &[i16])| -> Vec<i16> {
        match bases.get(component).and_then(Option::as_ref) {
            Some(basis) => coefficient_exponents(basis, exponents),
            None => exponents.to_vec(),
        }
    };
    FilmLayout {
        grid: compiled.grid.clone(),
        width: camera.width,
        height: camera.height,
        exponents: exponents.chunks_exact(bands).enumerate().flat_map(of_component).collect(),
        bases,
        components,
        statistics: settings.film_statistics(),
        levels,
        scene_digest,
    }
}

/// Quanta of the coefficients of a component: those of the largest coefficients that bands at the ends of their own scales may add up to.
fn coefficient_exponents(basis: &SpectralBasis, of_bands: &[i16]) -> Vec<i16> {
    let scales = of_bands.iter().map(|exponent| 2_f64.powi(i32::from(*exponent)));
    let scales: Vec<f64> = scales.collect();
    let of_block = |block: &[BandBlock]| -> [f64; BLOCK] {
        let mut most = [0.0; BLOCK];
        for (weights, scale) in block.iter().zip(&scales) {
            most.iter_mut()
                .zip(weights.0)
                .for_each(|(most, weight)| *most += f64::from(weight.abs()) * scale);
        }
        most
    };
    let most = basis.projection_blocks().chunks_exact(of_bands.len()).flat_map(of_block).collect::<Vec<_>>();
    most[..basis.len()].iter().map(|most| (most.log2().ceil() as i32).clamp(-400, 400) as i16).collect()
}

/// Quanta as powers of two: 2^-30 of the brightest pilot sample of the component and band; where the pilot finds the
/// band dark, 2^-50 of the component's brightest sample times the share that the band has in what the lights emit or
/// excite. A component without any light in the pilot is taken to be 2^-10 of its light group.
fn exponents(scene: &CompiledScene, components: &[Component], brightest: &[f32]) -> Vec<i16> {
    let bands = scene.bands;
    let kinds = scene.fluorophores + 2;
    let most = |values: &[f32]| values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f32::max);
    let of_component: Vec<f32> = brightest.chunks(bands).map(most).collect();
    let mut exponents = Vec::with_capacity(brightest.len());
    for component in 0..components.len() {
        let (group, kind) = (component / kinds, component % kinds);
        let of_group = most(&of_component[group * kinds..(group + 1) * kinds]);
        let level = match (of_component[component], of_group) {
            (own, _) if own > 0.0 => f64::from(own),
            (_, of_group) if of_group > 0.0 => f64::from(of_group) / 1024.0,
            _ => 1.0,
        };
        let mut shape = vec![0.0_f32; bands];
        for source in scene.sources.iter().filter(|source| source.group == group) {
            let spectra: &[Vec<BandBlock>] = match kind {
                0 => std::slice::from_ref(&source.bands),
                kind if kind < kinds - 1 => &source.exitance[kind - 1..kind],
                _ => &source.exitance,
            };
            let mut spectrum = vec![0.0; bands];
            for blocks in spectra {
                copy_bands(blocks, &mut spectrum);
                shape.iter_mut().zip(&spectrum).for_each(|(a, b)| *a = a.max(*b));
            }
        }
        let peak = most(&shape);
        for (&value, &share) in brightest[component * bands..(component + 1) * bands].iter().zip(&shape) {
            let share = if share > 0.0 && share.is_finite() { f64::from(share / peak) } else { 1.0 };
            let floor = level * share.max(f64::MIN_POSITIVE) * 2_f64.powi(-20);
            let value = if value.is_finite() { f64::from(value).max(floor) } else { level };
            exponents.push((value.log2().ceil() as i32 - 30).clamp(-400, 400) as i16);
        }
    }
    exponents
}
