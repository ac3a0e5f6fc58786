//! The hats of excitation nodes, and what they excite.

use std::ops::Range;

use fluorspar_accel::bands::BandBlock;
use rayon::prelude::*;

use super::lights::{Lights, band_blocks};
use crate::interruption::end_if_interrupted;
use crate::render::RenderSettings;
use crate::render::compiled_scene::{BasisGroup, BasisNode};
use crate::render::fluorescence_operator::{BinWeight, SampledEem};
use crate::scene::Scene;
use crate::spectral::{Curve, ExcitationNodes, PhotonEem, WavelengthGrid};

/// The nodes of all groups that have some.
pub(super) fn compile(
    scene: &Scene,
    matrices: &[&PhotonEem],
    lights: &Lights,
    settings: &RenderSettings,
) -> Vec<BasisGroup> {
    let of_group = |group: usize| {
        let nodes = settings.nodes_of(group)?;
        let own = lights.hats.iter().filter(|(of, ..)| *of == group);
        Some(BasisGroup {
            first: settings.spectrum_number(group) + 1,
            nodes: basis_nodes(&scene.grid, matrices, nodes),
            sources: own.map(|(_, source, factor)| (*source, *factor)).collect(),
        })
    };
    (0..scene.light_groups.len()).filter_map(of_group).collect()
}

fn basis_nodes(grid: &WavelengthGrid, matrices: &[&PhotonEem], nodes: &ExcitationNodes) -> Vec<BasisNode> {
    let hats: Vec<Curve> = (0..nodes.len()).map(|node| nodes.hat(node)).collect();
    let lit: Vec<Range<usize>> = hats.iter().map(|hat| lit_bands(grid, hat)).collect();
    let weights: Vec<BinWeight<'_>> = hats.iter().map(|hat| BinWeight::new(grid, Some(hat))).collect();
    let averages: Vec<Vec<f64>> = hats.iter().map(|hat| hat.bin_averages(grid)).collect();
    // `[matrix][node]`
    let of_matrix = |eem: &&PhotonEem| -> Vec<Vec<BandBlock>> {
        end_if_interrupted();
        let sampled = SampledEem::new(eem, grid);
        let of_node = |((weight, irradiance), lit): ((&BinWeight<'_>, &Vec<f64>), &Range<usize>)| {
            let columns = sampled.columns(weight, irradiance, lit.clone());
            columns.iter().flat_map(|column| band_blocks(column)).collect()
        };
        weights.iter().zip(&averages).zip(&lit).map(of_node).collect()
    };
    let mut found: Vec<Vec<Vec<BandBlock>>> = matrices.par_iter().map(of_matrix).collect();
    let node = |(number, bands): (usize, &Range<usize>)| {
        let columns = found.iter_mut().map(|of_matrix| std::mem::take(&mut of_matrix[number])).collect();
        let reflected_bands = reflected_bands(number, &lit, grid.len());
        let reflected = reflected_bands.clone().map(|band| reflected_share(&averages, number, bands, band));
        BasisNode { bands: bands.clone(), reflected: reflected.collect(), reflected_bands, columns }
    };
    lit.iter().enumerate().map(node).collect()
}

/// Bands in which a node keeps reflected light: the first and the last one keep that outside the nodes as well.
fn reflected_bands(number: usize, lit: &[Range<usize>], bands: usize) -> Range<usize> {
    let start = if number == 0 { 0 } else { lit[number].start };
    start..if number + 1 == lit.len() { bands } else { lit[number].end }
}

/// What a node keeps of reflected light in one of these bands: the average of its hat, and at the ends what all hats lack.
fn reflected_share(averages: &[Vec<f64>], number: usize, lit: &Range<usize>, band: usize) -> f32 {
    let is_end = number == 0 && band < lit.end || number + 1 == averages.len() && band >= lit.start;
    let of_all: f64 = averages.iter().map(|of_node| of_node[band]).sum();
    (averages[number][band] + if is_end { 1.0 - of_all } else { 0.0 }) as f32
}

/// Bands in which a hat is not dark.
fn lit_bands(grid: &WavelengthGrid, hat: &Curve) -> Range<usize> {
    let (first_nm, last_nm) = hat.range_nm();
    let edges = grid.edges_nm();
    let first = edges.partition_point(|edge| *edge <= first_nm).saturating_sub(1);
    let end = edges.partition_point(|edge| *edge < last_nm).min(grid.len());
    first.min(end)..end
}
