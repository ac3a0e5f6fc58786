//! Radial profiles of a material at the radii from which distances are drawn.

use fluorspar_accel::bands::BandBlock;

/// Radii at which profiles are known: the first one, mm, their ratio and their number. Beyond the last no light leaves.
const FIRST_MM: f64 = 0.01;
const RATIO: f64 = 1.2;
pub(super) const RADII: usize = 42;

/// Radial profiles of a material.
#[derive(Debug)]
pub(super) struct MaterialSpread {
    /// Probability of distances up to each node.
    pub(super) cumulative: [f32; RADII],
    /// Reflectance times density, 1/mm², `[term][radius][block]`.
    pub(super) reflected: Vec<Vec<BandBlock>>,
    /// Density, 1/mm², `[fluorophore][radius][wavelength of emission]`; nothing of what lies on the surface.
    pub(super) emitted: Vec<Vec<f32>>,
}

/// Radius of a node, mm.
pub(super) fn radius_mm(node: usize) -> f64 {
    FIRST_MM * RATIO.powi(node as i32)
}

/// Area that each node stands for when densities are interpolated between them, mm².
pub(super) fn node_areas_mm2() -> [f64; RADII] {
    const STEPS: usize = 64;
    let mut areas = [0.0; RADII];
    areas[0] = std::f64::consts::PI * radius_mm(0).powi(2);
    for node in 0..RADII - 1 {
        let (inner, outer) = (radius_mm(node), radius_mm(node + 1));
        for step in 0..STEPS {
            let share = (step as f64 + 0.5) / STEPS as f64;
            let radius = inner * RATIO.powf(share);
            // dA = 2 pi r dr, dr = r ln(ratio) d(share)
            let area = std::f64::consts::TAU * radius * radius * (outer / inner).ln() / STEPS as f64;
            areas[node] += (1.0 - share) * area;
            areas[node + 1] += share * area;
        }
    }
    areas
}

/// Node below a distance, and the share of the way to the next; `None` beyond the last.
pub(super) fn node_at(distance_mm: f32) -> Option<(usize, f32)> {
    let place = (distance_mm.max(FIRST_MM as f32) / FIRST_MM as f32).ln() / (RATIO as f32).ln();
    let node = place as usize;
    (node + 1 < RADII).then_some((node, place - node as f32))
}

impl MaterialSpread {
    /// Draws a distance along the plane, mm, and gives the density there, 1/mm². Distances rise with `u`, so that even numbers give
    /// evenly spread distances; the density is even within a ring between two nodes.
    pub(super) fn sample(&self, u: f32) -> (f32, f32) {
        let ring = self.cumulative.partition_point(|sum| *sum <= u).min(RADII - 1);
        let below = if ring == 0 { 0.0 } else { self.cumulative[ring - 1] };
        let share = self.cumulative[ring] - below;
        let inner = if ring == 0 { 0.0 } else { radius_mm(ring - 1) as f32 };
        let area = radius_mm(ring).powi(2) as f32 - inner * inner;
        let distance_mm = (inner * inner + ((u - below) / share).clamp(0.0, 1.0) * area).sqrt();
        (distance_mm, share / (std::f32::consts::PI * area))
    }
}
