//! Where light leaves the lens, seen from each point of the film: bounds computed once, sampled often.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::sequential_trace::{LensRay, SequentialTrace};
use crate::sampling::warp;

/// Bins of film radius.
const BINS: usize = 48;
/// Rays along a side of the first and of the later search grids.
const FIRST_GRID: usize = 64;
const LATER_GRID: usize = 40;
/// Later search grids, each over the bounds that the one before found.
const LATER_PASSES: usize = 2;

/// An ellipse in the pupil plane that holds everything that passes from a range of film radii along +x.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bounds {
    center_x: f64,
    half_x: f64,
    half_y: f64,
}

/// Bounds of the exit pupil by film radius. All coordinates in mm, in the frame of the lens.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PupilBounds {
    film_mm: f64,
    plane_mm: f64,
    film_radius_mm: f64,
    bins: Vec<Option<Bounds>>,
}

/// A direction from the film to the lens.
#[derive(Clone, Copy, Debug)]
pub(super) struct PupilSample {
    /// From the film toward the lens.
    pub(super) ray: LensRay,
    /// `cos⁴ A / z²`: irradiance per radiance if every sample had this weight and passed, sr.
    pub(super) weight_sr: f64,
}

impl PupilBounds {
    /// Searches the pupil of `trace` as seen from a film at `film_mm` of radius `film_radius_mm`. `plane_mm` is the
    /// plane in which pupil points are taken: the paraxial exit pupil where it lies in front of the film.
    pub(super) fn new(
        trace: &SequentialTrace,
        film_mm: f64,
        plane_mm: f64,
        rear: Circle,
        pupil: Circle,
        film_radius_mm: f64,
    ) -> Self {
        let nodes: Vec<Vec<DVec2>> = (0..=BINS)
            .into_par_iter()
            .map(|node| {
                let height = film_radius_mm * node as f64 / BINS as f64;
                let found = passing(trace, height, film_mm, plane_mm, rear);
                // The first grid may miss a pupil that is small compared with the rear element.
                if found.is_empty() { passing(trace, height, film_mm, plane_mm, pupil) } else { found }
            })
            .collect();
        let bins = nodes.windows(2).map(|pair| enclose(pair[0].iter().chain(&pair[1]).copied())).collect();
        Self { film_mm, plane_mm, film_radius_mm, bins }
    }

    /// Middle of the pupil as seen from a film point at a height.
    pub(super) fn center_x(&self, height_mm: f64) -> Option<f64> {
        let bin = (height_mm.abs() / self.film_radius_mm * BINS as f64) as usize;
        let center = (*self.bins.get(bin.min(BINS - 1))?)?.center_x;
        Some(if height_mm < 0.0 { -center } else { center })
    }

    /// A direction toward the pupil from a point of the film; `None` where no light arrives.
    pub(super) fn sample(&self, film: DVec2, u: [f32; 2]) -> Option<PupilSample> {
        let radius = film.length();
        let bin = (radius / self.film_radius_mm * BINS as f64) as usize;
        let bounds = (*self.bins.get(bin.min(BINS - 1))?)?;
        if radius > self.film_radius_mm * (1.0 + 1e-9) {
            return None;
        }
        let disc = warp::concentric_disc(u).as_dvec2();
        let local = DVec2::new(bounds.center_x + bounds.half_x * disc.x, bounds.half_y * disc.y);
        let along = if radius > 0.0 { film / radius } else { DVec2::X };
        let pupil = along.rotate(local).extend(self.plane_mm);
        let ray = LensRay::between(film.extend(self.film_mm), pupil)?;
        let cosine2 = ray.direction.z * ray.direction.z;
        let area = std::f64::consts::PI * bounds.half_x * bounds.half_y;
        let z = self.film_mm - self.plane_mm;
        Some(PupilSample { ray, weight_sr: cosine2 * cosine2 * area / (z * z) })
    }
}

/// A circle about the axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    pub(super) z_mm: f64,
    pub(super) radius_mm: f64,
}

/// Pupil points through which a film point at (height, 0) sees light, both halves of the symmetric pupil, within the
/// projection of a circle on the pupil plane.
fn passing(trace: &SequentialTrace, height: f64, film_mm: f64, plane_mm: f64, within: Circle) -> Vec<DVec2> {
    let stretch = (film_mm - plane_mm) / (film_mm - within.z_mm);
    let center = height * (1.0 - stretch);
    let half = within.radius_mm * stretch.abs();
    let mut low = DVec2::new(center - half, 0.0);
    let mut high = DVec2::new(center + half, half);
    let mut found = Vec::new();
    // Trace grids of rays over shrinking boxes around those that pass
    for pass in 0..=LATER_PASSES {
        let side = if pass == 0 { FIRST_GRID } else { LATER_GRID };
        let step = (high - low) / DVec2::new(side as f64, side as f64);
        found.clear();
        for row in 0..side {
            for col in 0..side {
                let point = low + step * DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
                let film = DVec3::new(height, 0.0, film_mm);
                let ray = LensRay::between(film, point.extend(plane_mm));
                if ray.is_some_and(|ray| trace.backward(ray).is_ok()) {
                    found.push(point);
                }
            }
        }
        if found.is_empty() {
            return found;
        }
        // Shrink the box to the passing rays, one cell wider
        let least = found.iter().fold(DVec2::INFINITY, |a, b| a.min(*b));
        let most = found.iter().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b));
        (low, high) = (least - step, most + step);
        low.y = low.y.max(0.0);
        if pass == LATER_PASSES {
            // What passes lies within one step of a point that was found.
            let mut widened = Vec::with_capacity(4 * found.len());
            for point in &found {
                for corner in [DVec2::NEG_ONE, DVec2::new(1.0, -1.0), DVec2::new(-1.0, 1.0), DVec2::ONE] {
                    widened.push(*point + 0.55 * corner * step);
                }
            }
            return widened;
        }
    }
    found
}

/// The ellipse about the bounding box of points, mirrored in y, large enough to hold all of them.
fn enclose(points: impl Iterator<Item = DVec2> + Clone) -> Option<Bounds> {
    let low = points.clone().fold(f64::INFINITY, |a, p| a.min(p.x));
    let high = points.clone().fold(f64::NEG_INFINITY, |a, p| a.max(p.x));
    let half_y = points.clone().fold(0.0_f64, |a, p| a.max(p.y.abs()));
    if !(low < high && half_y > 0.0) {
        return None;
    }
    let (center_x, half_x) = (0.5 * (low + high), 0.5 * (high - low));
    let reach2 =
        points.map(|p| ((p.x - center_x) / half_x).powi(2) + (p.y / half_y).powi(2)).fold(0.0_f64, f64::max);
    let reach = reach2.sqrt();
    Some(Bounds { center_x, half_x: half_x * reach, half_y: half_y * reach })
}
