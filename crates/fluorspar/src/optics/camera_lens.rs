//! A traced lens as the camera of a render: film, one lens per group of bands, rays into the scene.

use std::ops::Range;

use glam::DVec2;

use super::by_height::ByHeight;
use super::filter::AngleDistribution;
use super::traced_lens::{FilmSample, LensState, TracedLens};
use crate::spectral::WavelengthGrid;

/// Rays per film point that decide the angles in a filter.
const FILTER_RAYS: u32 = 512;

/// Film behind a traced lens.
///
/// A render through it records *lens radiance*: irradiance on the film over the solid angle
/// [`CameraLens::axial_solid_angle_sr`] that a uniform field fills on the axis. A uniform field of radiance `L` gives
/// `L` on the axis and `L` times the relative illumination elsewhere. The unit stays that of radiance; one factor makes
/// it irradiance again.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraLens {
    state: LensState,
    film_width_mm: f64,
    film_height_mm: f64,
    groups: Vec<(Range<usize>, TracedLens)>,
    axial_solid_angle_sr: f64,
    /// Tangents of chief rays of the middle group.
    tangents: ByHeight,
}

/// A ray of a film point in the frame of the camera (right, up, forward; origin in the entrance pupil; mm).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraLensRay {
    /// A point of the ray in front of the lens: right, up, forward, mm.
    pub origin_mm: [f64; 3],
    /// Unit direction: right, up, forward.
    pub direction: [f64; 3],
    /// Factor on the radiance along the ray.
    pub weight: f64,
}

impl CameraLens {
    /// Prepares a lens for a film. With `band_groups` of 1 all bands share the design wavelength; with more, the bands
    /// of `grid` are divided into as many runs, each traced at the middle of its wavelengths (dispersion).
    pub fn new(
        state: LensState,
        film_width_mm: f64,
        film_height_mm: f64,
        grid: &WavelengthGrid,
        band_groups: usize,
    ) -> Self {
        let radius_mm = 0.5 * film_width_mm.hypot(film_height_mm);
        let bands = grid.len();
        let count = band_groups.clamp(1, bands);
        let edges = grid.edges_nm();
        let groups: Vec<(Range<usize>, TracedLens)> = (0..count)
            .map(|group| {
                let range = group * bands / count..(group + 1) * bands / count;
                let middle = 0.5 * (edges[range.start] + edges[range.end]);
                let nm = if count == 1 { state.lens.design_wavelength_nm } else { middle };
                (range, TracedLens::new(&state, nm, radius_mm))
            })
            .collect();
        let axial_solid_angle_sr = state.axial_solid_angle_sr(state.lens.design_wavelength_nm);
        let tangents = groups[groups.len() / 2].1.object_tangents(radius_mm);
        Self { axial_solid_angle_sr, state, film_width_mm, film_height_mm, groups, tangents }
    }

    /// The setting of the lens.
    pub fn state(&self) -> &LensState {
        &self.state
    }

    /// Width of the film, mm.
    pub fn film_width_mm(&self) -> f64 {
        self.film_width_mm
    }

    /// Height of the film, mm.
    pub fn film_height_mm(&self) -> f64 {
        self.film_height_mm
    }

    /// Groups of bands that share rays, and the lens at the wavelength of each.
    pub fn groups(&self) -> &[(Range<usize>, TracedLens)] {
        &self.groups
    }

    /// The lens at the wavelength of the middle group.
    pub fn middle(&self) -> &TracedLens {
        &self.groups[self.groups.len() / 2].1
    }

    /// Irradiance on the axis per radiance of a uniform field, at the design wavelength, sr.
    pub fn axial_solid_angle_sr(&self) -> f64 {
        self.axial_solid_angle_sr
    }

    /// A ray from a point of the upright image (mm right of and above its middle) for a group of bands; `None` where
    /// the lens blocks it, which counts as black.
    pub fn sample(&self, group: usize, right_mm: f64, up_mm: f64, u: [f32; 2]) -> Option<CameraLensRay> {
        // The lens turns the image around.
        let FilmSample { ray, weight_sr, .. } =
            self.groups[group].1.sample(DVec2::new(-right_mm, -up_mm), u)?;
        let forward_mm = self.state.reference_mm - ray.origin.z;
        Some(CameraLensRay {
            origin_mm: [ray.origin.x, ray.origin.y, forward_mm],
            direction: [ray.direction.x, ray.direction.y, -ray.direction.z],
            weight: weight_sr / self.axial_solid_angle_sr,
        })
    }

    /// Where the chief ray of a point of the upright image goes (mm right of and above its middle): tangents to the axis, to the right and
    /// up. NaN where it misses the lens.
    pub fn chief_tangents(&self, right_mm: f64, up_mm: f64) -> [f64; 2] {
        self.tangents.along(DVec2::new(right_mm, up_mm)).to_array()
    }

    /// Relative illumination of a uniform field at a height on the film: the mean weight of all samples there.
    pub fn relative_illumination(&self, height_mm: f64) -> f64 {
        self.middle().solid_angle_sr(height_mm) / self.axial_solid_angle_sr
    }

    /// Angles to the axis at which light that arrives at a height on the film passes a filter in front of the lens, or
    /// one between lens and film. `None` where no light arrives.
    pub fn filter_angles(&self, height_mm: f64, behind_lens: bool) -> Option<AngleDistribution> {
        let rays = self.middle().pupil_rays(height_mm, FILTER_RAYS);
        AngleDistribution::of_rays(rays.iter().map(|sample| {
            let cosine = if behind_lens { sample.image_cosine } else { sample.ray.direction.z };
            (1.0 - cosine * cosine, sample.weight_sr)
        }))
    }

    /// Tangent of half the horizontal field of a pinhole whose image of the film's proportions holds everything that
    /// the film sees, distortion included. `None` where chief rays miss the lens.
    pub fn covering_tangent(&self) -> Option<f64> {
        let (w, h) = (0.5 * self.film_width_mm, 0.5 * self.film_height_mm);
        let mut needed = 0.0_f64;
        for (x, y) in [(w, 0.0), (0.0, h), (w, h)] {
            let radius = x.hypot(y);
            let tangent = self.middle().chief_ray(radius)?.object_tangent;
            let (tx, ty) = (tangent * x / radius, tangent * y / radius);
            needed = needed.max(tx).max(ty * w / h);
        }
        (needed > 0.0 && needed.is_finite()).then_some(needed)
    }
}
