//! A stack made ready for photons: constants of each layer, interfaces, depth bins.

use super::scattering::{Direction, HenyeyGreenstein, uniform};
use super::settings::ScoringGrid;
use crate::sampling::random::KeyedRng;
use crate::tissue::OpticalStack;

/// Below this optical thickness a layer is scored along tracks: few photons collide in it, but all cross it.
const THIN: f64 = 0.1;
/// Extinction that stands for none, 1/mm: free paths in a clear layer are longer than any layer, but finite.
const CLEAR_PER_MM: f64 = 1e-280;

/// Plane layers as photons meet them.
#[derive(Clone, Debug)]
pub(super) struct Medium {
    pub(super) layers: Vec<Layer>,
    /// Refractive index above.
    pub(super) index_above: f64,
    /// Depth bins of all layers, those below the limit included.
    pub(super) depth_bins: usize,
}

/// One layer: what a photon needs to know of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layer {
    /// Depth of the upper interface, mm.
    pub(super) top: f64,
    /// Depth of the lower interface, mm.
    pub(super) bottom: f64,
    /// Extinction coefficient, 1/mm.
    pub(super) extinction: f64,
    /// Mean free path, mm.
    pub(super) mean_free_path: f64,
    /// Share of the weight that survives a collision: the single scattering albedo.
    pub(super) albedo: f64,
    pub(super) phase: HenyeyGreenstein,
    /// Whether tracks are scored instead of collisions.
    pub(super) is_thin: bool,
    /// Refractive index.
    pub(super) index: f64,
    /// Refractive index of what lies above and below.
    pub(super) neighbors: [f64; 2],
    pub(super) bins: DepthBins,
}

/// Equal depth bins of one layer among the bins of all; the last one takes what lies below the limit of depth.
#[derive(Clone, Copy, Debug)]
pub(super) struct DepthBins {
    /// The first of them.
    pub(super) first: usize,
    /// Their number, without that below the limit.
    pub(super) number: usize,
    /// Width, mm.
    pub(super) width: f64,
    per_mm: f64,
}

impl DepthBins {
    fn new(first: usize, top: f64, thickness: f64, grid: &ScoringGrid) -> Self {
        let scored = thickness.min(grid.depth_limit_mm - top).max(0.0);
        // A layer of 20 um has two bins of 10 um whatever the last bit of either number.
        let number = (scored / grid.depth_step_mm - 1e-9).ceil().max(0.0) as usize;
        let width = if number > 0 { scored / number as f64 } else { grid.depth_step_mm };
        Self { first, number, width, per_mm: width.recip() }
    }

    /// Bin at a depth below the top of the layer, mm.
    #[inline(always)]
    pub(super) fn at(&self, depth: f64) -> usize {
        // Rounding to nearest in the addition of 1.5 * 2^52 leaves the whole number in the lowest bits, without the
        // checks of a conversion.
        let floor = (depth * self.per_mm - 0.5 + 6_755_399_441_055_744.0).to_bits() as u32 as usize;
        self.first + floor.min(self.number)
    }
}

impl Layer {
    /// Track length in mm that one unit of score stands for: see [`super::walk::DepthRecord`].
    pub(super) fn track_per_score(&self) -> f64 {
        if self.is_thin { 1.0 } else { self.mean_free_path }
    }
}

impl Medium {
    pub(super) fn new(stack: &OpticalStack, grid: &ScoringGrid) -> Self {
        let (mut top, mut first) = (0.0, 0);
        let mut layers = Vec::with_capacity(stack.layers.len());
        for (place, layer) in stack.layers.iter().enumerate() {
            let extinction = (layer.absorption_per_mm + layer.scattering_per_mm).max(CLEAR_PER_MM);
            let bins = DepthBins::new(first, top, layer.thickness_mm, grid);
            let above = place.checked_sub(1).map_or(stack.index_above, |p| stack.layers[p].refractive_index);
            let below = stack.layers.get(place + 1).map_or(stack.index_below, |l| l.refractive_index);
            layers.push(Layer {
                top,
                bottom: top + layer.thickness_mm,
                extinction,
                mean_free_path: extinction.recip(),
                albedo: layer.scattering_per_mm / extinction,
                phase: HenyeyGreenstein::new(layer.anisotropy),
                is_thin: extinction * layer.thickness_mm < THIN,
                index: layer.refractive_index,
                neighbors: [above, below],
                bins,
            });
            top += layer.thickness_mm;
            first += bins.number + 1;
        }
        Self { layers, index_above: stack.index_above, depth_bins: first }
    }
}

/// Fresnel's reflectance for unpolarized light and the cosine of the refracted ray; `None` for total reflection.
///
/// `cos` is the cosine of incidence, from 0 to 1, `from` and `to` are the refractive indices.
pub(super) fn fresnel(from: f64, to: f64, cos: f64) -> Option<(f64, f64)> {
    let ratio = from / to;
    let sin2 = (1.0 - cos * cos) * ratio * ratio;
    if sin2 >= 1.0 {
        return None;
    }
    let refracted = (1.0 - sin2).sqrt();
    let perpendicular = (from * cos - to * refracted) / (from * cos + to * refracted);
    let parallel = (from * refracted - to * cos) / (from * refracted + to * cos);
    Some((0.5 * (perpendicular * perpendicular + parallel * parallel), refracted))
}

/// Reflects or refracts a photon at an interface, by chance: whether it crosses.
#[inline]
pub(super) fn meet_interface(from: f64, to: f64, direction: &mut Direction, rng: &mut KeyedRng) -> bool {
    if from == to {
        return true;
    }
    let [x, y, z] = *direction;
    match fresnel(from, to, z.abs()) {
        Some((reflectance, refracted)) if uniform(rng) >= reflectance => {
            let ratio = from / to;
            *direction = [x * ratio, y * ratio, refracted.copysign(z)];
            true
        }
        _ => {
            *direction = [x, y, -z];
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::Key;
    use crate::tissue::OpticalLayer;

    #[test]
    fn fresnel_keeps_snell_and_is_reciprocal() {
        for cos in [0.05, 0.4, 0.9, 1.0_f64] {
            let (in_reflectance, inside) = fresnel(1.0, 1.4, cos).unwrap();
            let (out_reflectance, outside) = fresnel(1.4, 1.0, inside).unwrap();
            assert!((in_reflectance - out_reflectance).abs() < 1e-14 && (outside - cos).abs() < 1e-14);
            assert!(((1.0 - cos * cos).sqrt() - 1.4 * (1.0 - inside * inside).sqrt()).abs() < 1e-14);
        }
        assert!((fresnel(1.0, 1.5, 1.0).unwrap().0 - 0.04).abs() < 1e-15);
        // The critical angle of 1.4: 45.58 degrees.
        assert_eq!(fresnel(1.4, 1.0, 45.6_f64.to_radians().cos()), None);
        assert!(fresnel(1.4, 1.0, 45.5_f64.to_radians().cos()).is_some());
    }

    #[test]
    fn refracted_directions_have_unit_length() {
        let mut rng = Key::new(1).rng();
        let before = [0.36, -0.48, -0.8];
        let mut crossed = 0;
        for _ in 0..1000 {
            let mut after = before;
            let crosses = meet_interface(1.33, 1.54, &mut after, &mut rng);
            crossed += i32::from(crosses);
            assert!((after.iter().map(|a| a * a).sum::<f64>() - 1.0).abs() < 1e-14);
            assert_eq!(after[2] < 0.0, crosses);
        }
        // 1000 draws that reflect with R = 0.00683: mean 6.8, standard deviation 2.6; five of them.
        assert!((980..1000).contains(&crossed), "{crossed}");
    }

    #[test]
    fn depth_bins_do_not_straddle_layers() {
        let layer = |thickness_mm| OpticalLayer {
            thickness_mm,
            absorption_per_mm: 0.1,
            scattering_per_mm: 10.0,
            anisotropy: 0.9,
            refractive_index: 1.4,
        };
        let stack = OpticalStack {
            layers: vec![layer(0.02), layer(0.105), layer(5.0)],
            index_above: 1.0,
            index_below: 1.4,
        };
        let grid = ScoringGrid { depth_step_mm: 0.01, depth_limit_mm: 1.125, ..ScoringGrid::default() };
        let medium = Medium::new(&stack, &grid);
        let numbers: Vec<_> = medium.layers.iter().map(|l| (l.bins.first, l.bins.number)).collect();
        assert_eq!(numbers, [(0, 2), (3, 11), (15, 100)]);
        let bins = medium.layers[1].bins;
        assert_eq!([bins.at(0.0), bins.at(0.0095), bins.at(0.0096), bins.at(0.1049)], [3, 3, 4, 13]);
        let deep = medium.layers[2].bins;
        assert_eq!([deep.at(0.9999), deep.at(1.0001), deep.at(4.9)], [114, 115, 115]);
        assert_eq!(medium.depth_bins, 116);
    }
}
