//! A lens set to an aperture and focused: rays between film and scene, irradiance, chief rays.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::by_height::ByHeight;
use super::exit_pupil::{Circle, PupilBounds};
use super::paraxial::Paraxial;
use super::prescription::{FocusMechanism, LensPrescription, PrescriptionError};
use super::sequential_trace::{LensRay, SequentialTrace};
use crate::sampling::SampleStream;
use crate::units::{check_range, number_text};

/// How a lens is set.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LensSetting {
    /// Focal length over diameter of the axial beam of a distant object; `None` is wide open.
    pub f_number: Option<f64>,
    /// Distance to the plane in focus, mm, from the place of the entrance pupil when focused at infinity (in a lens that
    /// focuses by groups the pupil itself wanders); `None` is infinity.
    pub object_distance_mm: Option<f64>,
    /// Shift of the film from the paraxial focus, away from the lens, mm.
    pub film_shift_mm: f64,
}

/// A lens set to an aperture and a distance, before it is prepared for a wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct LensState {
    /// The lens with its groups where the focus puts them.
    pub lens: LensPrescription,
    /// The setting.
    pub setting: LensSetting,
    /// Position of the film from the first vertex, mm.
    pub film_mm: f64,
    /// Radius of the aperture stop, mm.
    pub stop_semi_diameter_mm: f64,
    /// Focal length over diameter of the axial beam of a distant object.
    pub f_number: f64,
    /// How far the focusing groups have gone, 0 to 1; 0 where the film moves.
    pub focus_travel: f64,
    /// First-order properties at the design wavelength.
    pub paraxial: Paraxial,
    /// Position from which object distances count: the entrance pupil when focused at infinity, mm from the first vertex.
    pub reference_mm: f64,
}

impl LensState {
    /// Checks a lens and sets it.
    ///
    /// # Errors
    /// A lens that is not usable, an aperture wider than it has, or an object nearer than it can focus.
    pub fn new(lens: &LensPrescription, setting: LensSetting) -> Result<Self, PrescriptionError> {
        lens.validate()?;
        let nm = lens.design_wavelength_nm;
        let at_infinity = Paraxial::new(lens, nm);
        check_collects(&at_infinity)?;
        let (stop_semi_diameter_mm, f_number) = aperture(lens, &at_infinity, setting.f_number)?;
        let (lens, film_mm, focus_travel) = focus(lens, &at_infinity, setting)?;
        let shift_mm = setting.film_shift_mm;
        if film_mm + shift_mm <= at_infinity.last_vertex_mm {
            let message = format!(
                "a shift of {} mm moves the image plane into the lens; give more than {:.3} mm",
                number_text(shift_mm),
                at_infinity.last_vertex_mm - film_mm
            );
            return Err(PrescriptionError::new("film_shift_mm", message));
        }
        check_range(shift_mm, [-1e6, 1e6], "give mm")
            .map_err(|message| PrescriptionError::new("film_shift_mm", message))?;
        let paraxial = Paraxial::new(&lens, nm);
        Ok(Self {
            setting,
            film_mm: film_mm + setting.film_shift_mm,
            stop_semi_diameter_mm,
            f_number,
            focus_travel,
            paraxial,
            reference_mm: at_infinity.entrance_pupil_mm,
            lens,
        })
    }

    /// Position of the plane in focus from the first vertex, mm; minus infinity for a distant one.
    pub fn object_mm(&self) -> f64 {
        self.setting.object_distance_mm.map_or(f64::NEG_INFINITY, |distance| self.reference_mm - distance)
    }

    /// Size of the image over the size of the object, negative because it is upside down; 0 at infinity.
    pub fn magnification(&self) -> f64 {
        self.paraxial.magnification(self.object_mm())
    }

    /// Irradiance per radiance on the axis, sr: `pi sin²` of the largest angle at which light arrives there.
    pub fn axial_solid_angle_sr(&self, wavelength_nm: f64) -> f64 {
        let trace = self.trace(wavelength_nm);
        let rear_mm = self.paraxial.last_vertex_mm;
        let reach = self.film_mm - rear_mm;
        let passes = |tangent: f64| {
            let film = DVec3::new(0.0, 0.0, self.film_mm);
            let to = DVec3::new(0.0, tangent * reach, rear_mm);
            LensRay::between(film, to).is_some_and(|ray| trace.backward(ray).is_ok())
        };
        let (mut low, mut high) = (0.0, 1e-3);
        while passes(high) && high < 100.0 {
            (low, high) = (high, 1.5 * high);
        }
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if passes(middle) { low = middle } else { high = middle }
        }
        PI * low * low / (1.0 + low * low)
    }

    /// [`Self::f_number`] at another wavelength than the design's.
    pub fn f_number_at(&self, wavelength_nm: f64) -> f64 {
        let lens = self.lens.clone().with_focus_travel(-self.focus_travel);
        let trace = SequentialTrace::new(&lens, wavelength_nm, self.stop_semi_diameter_mm);
        Paraxial::new(&lens, wavelength_nm).focal_length_mm / (2.0 * axial_beam_mm(&lens, &trace))
    }

    /// Rays at a wavelength.
    pub fn trace(&self, wavelength_nm: f64) -> SequentialTrace {
        SequentialTrace::new(&self.lens, wavelength_nm, self.stop_semi_diameter_mm)
    }
}

/// Refuses a lens that does not bring light of distant objects to a focus behind it.
fn check_collects(lens: &Paraxial) -> Result<(), PrescriptionError> {
    let (focal_length_mm, behind_mm) = (lens.focal_length_mm, lens.back_focal_length_mm);
    if focal_length_mm > 0.0 && focal_length_mm.is_finite() && behind_mm > 0.0 {
        return Ok(());
    }
    let message = format!(
        "the focal length is {focal_length_mm:.4} mm and the back focal length is {behind_mm:.4} mm; a camera lens needs both \
         positive. Check the signs of the radii, the thicknesses and the order of the surfaces (object side first)"
    );
    Err(PrescriptionError::new("surfaces", message))
}

/// A ray parallel to the axis at a height, mm.
fn parallel_ray(height: f64) -> LensRay {
    LensRay { origin: DVec3::new(height, 0.0, -1.0), direction: DVec3::Z }
}

/// Largest height at which a ray parallel to the axis passes, mm.
fn axial_beam_mm(lens: &LensPrescription, trace: &SequentialTrace) -> f64 {
    let (mut low, mut high) = (0.0, lens.surfaces[0].semi_diameter_mm * 1.01);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if trace.forward(parallel_ray(middle)).is_ok() { low = middle } else { high = middle }
    }
    low
}

/// Radius of the stop and f-number: focal length over diameter of the axial beam that a distant object sends through the
/// lens, traced, not paraxial: in fast lenses the two differ by percents.
fn aperture(
    lens: &LensPrescription,
    at_infinity: &Paraxial,
    wanted: Option<f64>,
) -> Result<(f64, f64), PrescriptionError> {
    let focal_length_mm = at_infinity.focal_length_mm;
    let widest = lens.surfaces[lens.stop()].semi_diameter_mm;
    let open = SequentialTrace::new(lens, lens.design_wavelength_nm, widest);
    let low = axial_beam_mm(lens, &open);
    let fastest = focal_length_mm / (2.0 * low);
    if !(low > 1e-9 && fastest.is_finite()) {
        let message =
            "no light of a distant object on the axis passes; check the semi-diameters and the stop";
        return Err(PrescriptionError::new("semi_diameter_mm", message));
    }
    // Set the stop for the wanted f-number
    let stop_at = |height: f64| open.to_stop(parallel_ray(height)).map_or(widest, |point| point.x.abs());
    match wanted {
        None => Ok((stop_at(low).min(widest), fastest)),
        Some(wanted) if wanted > 1e3 => {
            let message = format!("{} is too large: give at most f/1000", number_text(wanted));
            Err(PrescriptionError::new("f_number", message))
        }
        Some(wanted) if wanted >= fastest * (1.0 - 1e-4) => {
            let height = (focal_length_mm / (2.0 * wanted)).min(low);
            Ok((stop_at(height), focal_length_mm / (2.0 * height)))
        }
        Some(wanted) => {
            let message = format!(
                "{} is outside {fastest:.3} to 1000: the lens is f/{fastest:.3} wide open; give a larger f-number",
                number_text(wanted)
            );
            Err(PrescriptionError::new("f_number", message))
        }
    }
}

/// Lens, film position and travel of the groups for an object distance.
fn focus(
    lens: &LensPrescription,
    at_infinity: &Paraxial,
    setting: LensSetting,
) -> Result<(LensPrescription, f64, f64), PrescriptionError> {
    let Some(distance_mm) = setting.object_distance_mm else {
        return Ok((lens.clone(), at_infinity.rear_focus_mm, 0.0));
    };
    let nm = lens.design_wavelength_nm;
    let fail = |message: String| Err(PrescriptionError::new("focus_distance_mm", message));
    if let Err(message) = check_range(distance_mm, [1e-3, 1e9], "give mm, or leave it out for infinity") {
        return fail(message);
    }
    let object_mm = at_infinity.entrance_pupil_mm - distance_mm;
    match &lens.focus {
        FocusMechanism::Film => {
            let film = at_infinity.image_position_mm(object_mm);
            match film {
                Some(film) if film > at_infinity.last_vertex_mm && object_mm < 0.0 => {
                    Ok((lens.clone(), film, 0.0))
                }
                _ => fail(format!(
                    "an object {} mm from the entrance pupil has no real image behind this lens (focal length {:.3} mm); \
                     increase the distance",
                    number_text(distance_mm),
                    at_infinity.focal_length_mm
                )),
            }
        }
        FocusMechanism::Gaps(_) => {
            let behind = at_infinity.back_focal_length_mm;
            // Positive while the image lies behind the film, that is, while the groups have not gone far enough.
            let miss = |travel: f64| {
                let p = Paraxial::new(&lens.clone().with_focus_travel(travel), nm);
                p.image_position_mm(object_mm).map(|image| image - p.last_vertex_mm - behind)
            };
            let nearest = || {
                let p = Paraxial::new(&lens.clone().with_focus_travel(1.0), nm);
                // The object whose image is on the film, by Newton's equation backwards.
                let x = p.last_vertex_mm + behind - p.rear_focus_mm;
                let object = p.front_focus_mm - p.focal_length_mm * p.focal_length_mm / x;
                at_infinity.entrance_pupil_mm - object
            };
            let (mut low, mut high) = (0.0, 1.0);
            if !miss(high).is_some_and(|miss| miss <= 0.0) {
                return fail(format!(
                    "{distance_mm} mm is nearer than the closest focus, {:.1} mm from the entrance pupil; move the object \
                     away",
                    nearest()
                ));
            }
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if miss(middle).is_none_or(|miss| miss > 0.0) { low = middle } else { high = middle }
            }
            let focused = lens.clone().with_focus_travel(high);
            let film = Paraxial::new(&focused, nm).last_vertex_mm + behind;
            Ok((focused, film, high))
        }
    }
}

/// A lens before a film, at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct TracedLens {
    trace: SequentialTrace,
    bounds: PupilBounds,
    film_mm: f64,
    plane_mm: f64,
    rear_mm: f64,
    wavelength_nm: f64,
}

/// A ray into the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmSample {
    /// The ray in front of the lens, toward the object.
    pub ray: LensRay,
    /// Cosine of its angle to the axis between lens and film.
    pub image_cosine: f64,
    /// Irradiance on the film per radiance along the ray, sr: the mean of weight times radiance over all samples,
    /// blocked ones counting as zero, is the irradiance.
    pub weight_sr: f64,
}

/// The ray through the middle of the stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiefRay {
    /// In front of the lens, toward the object.
    pub object_side: LensRay,
    /// Tangent of its angle to the axis in front of the lens; positive on the side opposite to the film point.
    pub object_tangent: f64,
    /// Tangent of its angle to the axis behind the lens.
    pub image_tangent: f64,
}

/// Samples in sums over the pupil: powers of two use the sequence best.
const PUPIL_SAMPLES: u32 = 4096;

impl TracedLens {
    /// Prepares a lens for points of the film within `film_radius_mm` of the axis.
    pub fn new(state: &LensState, wavelength_nm: f64, film_radius_mm: f64) -> Self {
        let trace = state.trace(wavelength_nm);
        let paraxial = Paraxial::new(&state.lens, wavelength_nm);
        let rear_mm = paraxial.last_vertex_mm;
        let rear_semi = state.lens.surfaces.last().map_or(0.0, |surface| surface.semi_diameter_mm);
        let film_mm = state.film_mm;
        // Any plane parallel to the film will do; in the exit pupil the outline moves least. A pupil behind the film or
        // far away (telecentric) is replaced by the plane of the last vertex.
        let pupil = paraxial.exit_pupil_mm;
        let near =
            pupil < film_mm - 0.2 * (film_mm - rear_mm) && film_mm - pupil < 50.0 * (film_mm - rear_mm);
        let plane_mm = if near { pupil } else { rear_mm };
        // 10 % for the sag of the rear element, 100 % for the aberrations of the pupil.
        let rear = Circle { z_mm: rear_mm, radius_mm: 1.1 * rear_semi };
        let pupil_radius_mm = (paraxial.exit_pupil_scale * state.stop_semi_diameter_mm).abs();
        let pupil = Circle { z_mm: if near { pupil } else { rear_mm }, radius_mm: 2.0 * pupil_radius_mm };
        let bounds = PupilBounds::new(&trace, film_mm, plane_mm, rear, pupil, film_radius_mm);
        Self { trace, bounds, film_mm, plane_mm, rear_mm, wavelength_nm }
    }

    /// Wavelength, nm.
    pub fn wavelength_nm(&self) -> f64 {
        self.wavelength_nm
    }

    /// Position of the film from the first vertex, mm.
    pub fn film_mm(&self) -> f64 {
        self.film_mm
    }

    /// The surfaces.
    pub fn surfaces(&self) -> &SequentialTrace {
        &self.trace
    }

    /// A ray from a point of the film (mm from the axis) through a point of the pupil; `None` where it is blocked.
    pub fn sample(&self, film: DVec2, u: [f32; 2]) -> Option<FilmSample> {
        let sample = self.bounds.sample(film, u)?;
        let ray = self.trace.backward(sample.ray).ok()?;
        Some(FilmSample { ray, image_cosine: sample.ray.direction.z.abs(), weight_sr: sample.weight_sr })
    }

    /// Rays from a film point at a height over evenly spread pupil points, blocked ones left out, each with its share:
    /// shares add up to the irradiance per radiance.
    pub fn pupil_rays(&self, height_mm: f64, samples: u32) -> Vec<FilmSample> {
        let film = DVec2::new(height_mm, 0.0);
        (0..samples)
            .filter_map(|sample| {
                let [u, v, _, _] = SampleStream::new(0, 0, sample).next_4d();
                self.sample(film, [u, v])
            })
            .map(|s| FilmSample { weight_sr: s.weight_sr / f64::from(samples), ..s })
            .collect()
    }

    /// Irradiance per radiance of a uniform field at a height on the film, sr, losses at surfaces left out.
    pub fn solid_angle_sr(&self, height_mm: f64) -> f64 {
        self.pupil_rays(height_mm, PUPIL_SAMPLES).iter().map(|sample| sample.weight_sr).sum()
    }

    /// Tangents of chief rays to the axis in front of the lens, up to a height on the film; NaN where they miss it.
    pub(super) fn object_tangents(&self, radius_mm: f64) -> ByHeight {
        let tangent = |height_mm| self.chief_ray(height_mm).map_or(f64::NAN, |chief| chief.object_tangent);
        ByHeight::new(radius_mm, 65, tangent)
    }

    /// The ray from a film point at a height through the middle of the stop; `None` where it misses a surface.
    pub fn chief_ray(&self, height_mm: f64) -> Option<ChiefRay> {
        let film = DVec3::new(height_mm, 0.0, self.film_mm);
        let aim = |x: f64| LensRay::between(film, DVec3::new(x, 0.0, self.plane_mm));
        let miss = |x: f64| aim(x).and_then(|ray| self.trace.to_stop_backward(ray).ok()).map(|point| point.x);
        // In the paraxial pupil the answer is 0; the secant rule takes care of its aberration.
        let scale = 1e-3 * (self.film_mm - self.plane_mm).abs();
        let (mut a, mut b) = if self.plane_mm == self.rear_mm {
            let c = self.bounds.center_x(height_mm)?;
            (c, c + scale)
        } else {
            (0.0, scale)
        };
        let (mut fa, mut fb) = (miss(a)?, miss(b)?);
        for _ in 0..40 {
            if fb.abs() < 1e-12 || fa == fb {
                break;
            }
            let next = b - fb * (b - a) / (fb - fa);
            (a, fa) = (b, fb);
            b = next;
            fb = miss(b)?;
        }
        if fb.abs() > 1e-8 {
            return None;
        }
        let image_side = aim(b)?;
        // Clear apertures do not matter: a chief ray that is vignetted still defines perspective.
        let object_side = self.trace.backward_unclipped(image_side).ok()?;
        // Directions point to the object, along -z. An inverted image has the object on the other side of the axis.
        let side = if height_mm < 0.0 { 1.0 } else { -1.0 };
        let tangent = |direction: DVec3| direction.x / -direction.z;
        Some(ChiefRay {
            object_side,
            object_tangent: side * tangent(object_side.direction),
            image_tangent: tangent(image_side.direction).abs(),
        })
    }
}
