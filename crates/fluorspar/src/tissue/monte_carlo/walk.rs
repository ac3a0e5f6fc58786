//! The way of one photon packet through the layers.

use super::medium::{Layer, Medium, fresnel, meet_interface};
use super::scattering::{Direction, free_path, isotropic, turn, uniform};
use crate::sampling::random::KeyedRng;
use crate::tissue::Incidence;

/// Packets lighter than this play Russian roulette.
const ROULETTE_WEIGHT: f64 = 1e-4;
/// They survive it, ten times heavier, in one of ten cases.
const SURVIVAL: f64 = 0.1;
/// Interfaces in a row that a packet may meet without a collision, before it counts as guided along a clear layer.
const MOST_INTERFACES: u32 = 100_000;

/// A packet of light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Photon {
    /// Across and down, mm.
    pub(super) position: [f64; 3],
    pub(super) direction: Direction,
    /// Light left, relative to one incident photon.
    pub(super) weight: f64,
    /// Layer that it is in.
    pub(super) layer: usize,
    /// Whether it has collided.
    pub(super) has_scattered: bool,
}

/// Where a packet has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Above,
    Below,
    /// Absorbed.
    Inside,
    /// Guided sideways by total reflection in a clear layer.
    Guided,
    /// Nowhere: what is recorded has seen enough.
    Paused,
}

/// What is recorded on the way.
pub(super) trait Record {
    /// A collision in a layer, with the weight before it.
    fn collision(&mut self, layer: &Layer, photon: &Photon, rng: &mut KeyedRng);
    /// A straight way in a thin layer, to `depth`, of a length in mm.
    fn track(&mut self, layer: &Layer, photon: &Photon, depth: f64, length: f64);
    /// Any straight way, of a length in mm, in the layer in which the packet is.
    #[inline(always)]
    fn way(&mut self, _photon: &Photon, _length: f64) {}
    /// Whether the packet stops here, after a collision.
    #[inline(always)]
    fn pauses(&self) -> bool {
        false
    }
}

/// Records nothing.
pub(super) struct Unrecorded;

impl Record for Unrecorded {
    #[inline(always)]
    fn collision(&mut self, _: &Layer, _: &Photon, _: &mut KeyedRng) {}
    #[inline(always)]
    fn track(&mut self, _: &Layer, _: &Photon, _: f64, _: f64) {}
}

/// Light spent in each bin of depth: weight times optical depth in ordinary layers, times mm in thin ones.
pub(super) struct DepthRecord<'a> {
    pub(super) bins: &'a mut [f64],
}

impl Record for DepthRecord<'_> {
    #[inline(always)]
    fn collision(&mut self, layer: &Layer, photon: &Photon, _: &mut KeyedRng) {
        if !layer.is_thin {
            self.bins[layer.bins.at(photon.position[2] - layer.top)] += photon.weight;
        }
    }

    #[cold]
    fn track(&mut self, layer: &Layer, photon: &Photon, depth: f64, length: f64) {
        let (from, to) = (photon.position[2] - layer.top, depth - layer.top);
        let (upper, lower) = if from < to { (from, to) } else { (to, from) };
        let (first, last) = (layer.bins.at(upper), layer.bins.at(lower));
        if first == last {
            self.bins[first] += photon.weight * length;
            return;
        }
        let per_depth = photon.weight * length / (lower - upper);
        let mut begin = upper;
        for bin in first..last {
            let end = (bin + 1 - layer.bins.first) as f64 * layer.bins.width;
            self.bins[bin] += per_depth * (end - begin);
            begin = end;
        }
        self.bins[last] += per_depth * (lower - begin);
    }
}

impl Photon {
    /// A packet that meets the surface at the origin: what it reflects there, and the packet below it.
    pub(super) fn incident(incidence: Incidence, medium: &Medium, rng: &mut KeyedRng) -> (f64, Self) {
        let cos = match incidence {
            Incidence::Collimated { cosine } => cosine,
            // Even radiance: as much light per solid angle as the cosine.
            Incidence::Lambertian => (1.0 - uniform(rng)).sqrt(),
        };
        let (reflectance, refracted) =
            fresnel(medium.index_above, medium.layers[0].index, cos).unwrap_or((1.0, 0.0));
        let photon = Self {
            position: [0.0; 3],
            direction: [(1.0 - refracted * refracted).sqrt(), 0.0, refracted],
            weight: 1.0 - reflectance,
            layer: 0,
            has_scattered: false,
        };
        (reflectance, photon)
    }

    /// A packet emitted evenly in all directions.
    pub(super) fn emitted(position: [f64; 3], layer: usize, weight: f64, rng: &mut KeyedRng) -> Self {
        Self { position, direction: isotropic(rng), weight, layer, has_scattered: false }
    }

    /// Distance from the beam, mm.
    pub(super) fn radius(&self) -> f64 {
        let [x, y, _] = self.position;
        (x * x + y * y).sqrt()
    }
}

/// Moves a packet until it leaves or is absorbed.
///
/// Wang, Jacques and Zheng, MCML, Computer Methods and Programs in Biomedicine 47 (1995) 131: exponential free paths in
/// optical depth, which go on across interfaces; at each collision the weight falls by the albedo and the direction
/// turns; interfaces reflect all or nothing, by chance; light packets play Russian roulette.
#[inline(always)]
pub(super) fn walk(
    medium: &Medium,
    photon: Photon,
    record: &mut impl Record,
    rng: &mut KeyedRng,
) -> (End, Photon) {
    let mut photon = photon;
    if photon.weight <= 0.0 {
        return (End::Inside, photon);
    }
    let mut layer = &medium.layers[photon.layer];
    let mut optical_depth = free_path(rng);
    let mut interfaces = 0;
    loop {
        let path = optical_depth * layer.mean_free_path;
        let depth = photon.position[2] + photon.direction[2] * path;
        if depth >= layer.top && depth <= layer.bottom {
            if layer.is_thin {
                record.track(layer, &photon, depth, path);
            }
            record.way(&photon, path);
            photon.position[0] += photon.direction[0] * path;
            photon.position[1] += photon.direction[1] * path;
            photon.position[2] = depth;
            record.collision(layer, &photon, rng);
            photon.weight *= layer.albedo;
            photon.has_scattered = true;
            interfaces = 0;
            if photon.weight < ROULETTE_WEIGHT {
                if photon.weight == 0.0 || uniform(rng) >= SURVIVAL {
                    return (End::Inside, photon);
                }
                photon.weight *= SURVIVAL.recip();
            }
            let cos = layer.phase.cosine(rng);
            photon.direction = turn(photon.direction, cos, rng);
            if record.pauses() {
                return (End::Paused, photon);
            }
            optical_depth = free_path(rng);
            continue;
        }
        let goes_down = photon.direction[2] > 0.0;
        let boundary = if goes_down { layer.bottom } else { layer.top };
        let length = (boundary - photon.position[2]) / photon.direction[2];
        if layer.is_thin {
            record.track(layer, &photon, boundary, length);
        }
        record.way(&photon, length);
        photon.position[0] += photon.direction[0] * length;
        photon.position[1] += photon.direction[1] * length;
        photon.position[2] = boundary;
        optical_depth = (optical_depth - length * layer.extinction).max(0.0);
        interfaces += 1;
        if interfaces > MOST_INTERFACES {
            return (End::Guided, photon);
        }
        if !meet_interface(layer.index, layer.neighbors[usize::from(goes_down)], &mut photon.direction, rng) {
            continue;
        }
        if goes_down {
            photon.layer += 1;
            if photon.layer == medium.layers.len() {
                return (End::Below, photon);
            }
        } else if photon.layer == 0 {
            return (End::Above, photon);
        } else {
            photon.layer -= 1;
        }
        layer = &medium.layers[photon.layer];
    }
}
