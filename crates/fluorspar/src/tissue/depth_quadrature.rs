//! Depths at which light is known, for integrals over the depth.

use super::angular_quadrature::gauss_legendre;
use super::layered_tissue::LayeredTissue;

/// Gauss nodes in each panel.
const NODES: usize = 4;
/// Thickness of the uppermost panel of a layer, in shortest transport mean free paths.
const FIRST_PANEL: f64 = 0.4;
/// Each panel is that much thicker than the one above it.
const GROWTH: f64 = 2.0;

/// A depth with its weight in an integral over the depth.
#[derive(Clone, Copy, Debug)]
pub(super) struct DepthNode {
    /// Number of the layer, from 0.
    pub(super) layer: usize,
    /// Depth below the top of the layer, mm.
    pub(super) depth_mm: f64,
    /// Weight, mm.
    pub(super) weight_mm: f64,
    /// Refractive index of the layer.
    pub(super) refractive_index: f64,
}

/// Depths in all layers from above to below: in each layer panels that grow with depth, as light changes fastest near the top.
pub(super) fn depth_nodes(tissue: &LayeredTissue, wavelengths_nm: &[f64]) -> Vec<DepthNode> {
    let mut opacity_per_mm = vec![0.0f64; tissue.layers.len()];
    for &nm in wavelengths_nm {
        for (opacity, layer) in opacity_per_mm.iter_mut().zip(tissue.optics(nm).layers) {
            *opacity = opacity.max(layer.absorption_per_mm + layer.reduced_scattering_per_mm());
        }
    }
    let mut nodes = Vec::new();
    for (number, (layer, opacity)) in tissue.layers.iter().zip(opacity_per_mm).enumerate() {
        let thickness_mm = layer.thickness_um * 1e-3;
        let mut top = 0.0;
        let mut panel = if opacity > 0.0 { FIRST_PANEL / opacity } else { thickness_mm };
        while top < thickness_mm {
            // A last panel that would be thin is added to the one above it.
            let bottom = if top + 1.5 * panel >= thickness_mm { thickness_mm } else { top + panel };
            nodes.extend(gauss_legendre(NODES, bottom - top).into_iter().map(|(z, weight_mm)| DepthNode {
                layer: number,
                depth_mm: top + z,
                weight_mm,
                refractive_index: layer.refractive_index.unwrap_or(tissue.refractive_index),
            }));
            (top, panel) = (bottom, GROWTH * panel);
        }
    }
    nodes
}
