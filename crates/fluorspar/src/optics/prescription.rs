//! A lens as its maker or its patent describes it: surfaces, glasses, stop, and what moves to focus.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::glass::{D_LINE_NM, Dispersion};
use super::paraxial::Paraxial;
use crate::units::number_text;

/// The material behind a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum Medium {
    /// Air.
    Air,
    /// A glass of a catalogue, by name; [`LensPrescription::with_glasses`] replaces it.
    Named(String),
    /// A material with known index.
    Known(Dispersion),
}

/// One surface, the medium behind it, and the way to the next surface. Light comes from the side of the object.
#[derive(Clone, Debug, PartialEq)]
pub struct LensSurface {
    /// Curvature at the vertex, 1/mm: positive when the center lies behind the surface; 0 is a plane.
    pub curvature_per_mm: f64,
    /// Conic constant `k`: 0 sphere, -1 paraboloid, below -1 hyperboloid.
    pub conic: f64,
    /// Even polynomial terms of the sag: the `i`th one multiplies `r^(4 + 2 i)`, in `mm^-(3 + 2 i)`.
    pub aspheric: Vec<f64>,
    /// Distance from this vertex to the next one, mm; of the last surface it is not used.
    pub thickness_mm: f64,
    /// Medium behind the surface.
    pub medium: Medium,
    /// Half of the clear aperture, mm.
    pub semi_diameter_mm: f64,
    /// Whether this is the aperture stop.
    pub is_stop: bool,
}

/// Parts of a lens that move to focus on an object at a finite distance.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum FocusMechanism {
    /// The film moves away from the lens (or the whole lens away from the film).
    #[default]
    Film,
    /// Groups of elements move, the film stays where infinity is sharp. The distance behind each listed surface
    /// changes by its full amount at the closest focus, and proportionally before.
    Gaps(Vec<FocusGap>),
}

/// A distance that changes with focus.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FocusGap {
    /// Number of the surface in front of the gap, from 1.
    pub behind_surface: usize,
    /// Change of the gap from infinity to the closest focus, mm.
    pub change_mm: f64,
}

/// A lens.
#[derive(Clone, Debug, PartialEq)]
pub struct LensPrescription {
    /// Name.
    pub name: String,
    /// Where the numbers come from.
    pub source: String,
    /// Wavelength at which the lens is traced when bands are not split, nm.
    pub design_wavelength_nm: f64,
    /// Surfaces from the object to the image.
    pub surfaces: Vec<LensSurface>,
    /// Parts that move to focus.
    pub focus: FocusMechanism,
    /// How wide its stop is, until its glasses are looked up; `None`: as its surface says.
    pub aperture: Option<SystemAperture>,
}

/// What the aperture stop lets through, where a file says it otherwise than by the size of the stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SystemAperture {
    /// Diameter of the entrance pupil, mm.
    EntrancePupilMm(f64),
    /// F-number at infinity: focal length over the diameter of the entrance pupil.
    FNumber(f64),
}

/// A lens that can't be used: where and why.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{place}: {message}")]
pub struct PrescriptionError {
    /// Where: "surface 3, semi_diameter_mm", for instance.
    pub place: String,
    /// What is wrong and how to fix it.
    pub message: String,
}

impl PrescriptionError {
    pub(crate) fn new(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self { place: place.into(), message: message.into() }
    }
}

/// Most surfaces that a lens may have.
pub const MOST_SURFACES: usize = 200;
/// Most even polynomial terms of a surface.
pub const MOST_ASPHERIC_TERMS: usize = 10;

impl LensSurface {
    /// A spherical surface with air behind it; radius 0 or infinite is a plane.
    pub fn spherical(radius_mm: f64, thickness_mm: f64, semi_diameter_mm: f64) -> Self {
        Self {
            curvature_per_mm: curvature(radius_mm),
            conic: 0.0,
            aspheric: Vec::new(),
            thickness_mm,
            medium: Medium::Air,
            semi_diameter_mm,
            is_stop: false,
        }
    }

    /// The surface with a material behind it.
    #[must_use]
    pub fn with_medium(mut self, dispersion: Dispersion) -> Self {
        self.medium = Medium::Known(dispersion);
        self
    }

    /// A stop in air.
    ///
    /// ```
    /// use fluorspar::optics::{Dispersion, LensPrescription, LensSurface, Paraxial};
    ///
    /// // A biconvex singlet of 50 mm behind its stop; a thin lens would have 1 / (0.5 (1/50 + 1/50)).
    /// let glass = Dispersion::Constant { index: 1.5 };
    /// let singlet = vec![
    ///     LensSurface::stop(2.0, 3.0),
    ///     LensSurface::spherical(50.0, 4.0, 10.0).with_medium(glass),
    ///     LensSurface::spherical(-50.0, 0.0, 10.0),
    /// ];
    /// let lens = LensPrescription::new("singlet", singlet);
    /// assert!((Paraxial::new(&lens, 550.0).focal_length_mm - 50.0).abs() < 1.0);
    /// ```
    pub fn stop(thickness_mm: f64, semi_diameter_mm: f64) -> Self {
        Self { is_stop: true, ..Self::spherical(0.0, thickness_mm, semi_diameter_mm) }
    }

    /// Radius of curvature, mm; infinite for a plane.
    pub fn radius_mm(&self) -> f64 {
        1.0 / self.curvature_per_mm
    }

    /// Checks one surface; the error is a field and what is wrong with it. Behind the last surface thickness means nothing.
    fn validate(&self, is_last: bool) -> Result<(), (&'static str, String)> {
        let fail = |field: &'static str, message: String| Err((field, message));
        if !(self.curvature_per_mm.is_finite() && self.curvature_per_mm.abs() <= 1e3) {
            return fail("radius_mm", "must be a number of mm, or left out for a plane".into());
        }
        if !(1e-6..=1e5).contains(&self.semi_diameter_mm) {
            let value = number_text(self.semi_diameter_mm);
            return fail(
                "semi_diameter_mm",
                format!("{value} is not between 1e-6 and 1e5 mm; give half the clear diameter"),
            );
        }
        if !is_last && !(0.0..=1e5).contains(&self.thickness_mm) {
            let value = number_text(self.thickness_mm);
            return fail("thickness_mm", format!("{value} is not between 0 and 1e5 mm"));
        }
        if !(self.conic.is_finite() && self.conic.abs() <= 1e4) {
            let value = number_text(self.conic);
            return fail("conic", format!("{value} is not between -1e4 and 1e4"));
        }
        if self.aspheric.len() > MOST_ASPHERIC_TERMS || self.aspheric.iter().any(|a| !a.is_finite()) {
            let message = format!("must be at most {MOST_ASPHERIC_TERMS} finite numbers, from r^4 on");
            return fail("aspheric", message);
        }
        match &self.medium {
            Medium::Named(name) => {
                return fail("glass", format!("\"{name}\" was not looked up in a catalogue"));
            }
            Medium::Known(glass) => {
                if let Err(message) = glass.validate() {
                    return fail("glass", message);
                }
            }
            Medium::Air => {}
        }
        let edge = self.semi_diameter_mm;
        if self.sag(edge * edge).is_none() {
            let message = format!(
                "{edge} mm reaches beyond the edge of the surface, whose radius is {:.4} mm; make it smaller",
                self.radius_mm()
            );
            return fail("semi_diameter_mm", message);
        }
        Ok(())
    }

    /// Height of the surface above its vertex plane at the squared distance `r2` from the axis, and its derivative
    /// with respect to `r2`:
    /// `z = c r² / (1 + sqrt(1 - (1 + k) c² r²)) + sum a_i r^(4 + 2 i)`. `None` beyond the edge of the conic.
    pub fn sag(&self, r2: f64) -> Option<(f64, f64)> {
        sag(self.curvature_per_mm, self.conic, &self.aspheric, r2)
    }
}

pub(super) fn sag(c: f64, conic: f64, aspheric: &[f64], r2: f64) -> Option<(f64, f64)> {
    let root2 = 1.0 - (1.0 + conic) * c * c * r2;
    if root2 <= 0.0 {
        return None;
    }
    let root = root2.sqrt();
    // dz/dr = c r / root, so dz/d(r²) = c / (2 root).
    let (mut z, mut slope) = (c * r2 / (1.0 + root), 0.5 * c / root);
    let mut power = r2;
    for (i, a) in aspheric.iter().enumerate() {
        let order = (i + 2) as f64;
        slope += order * a * power;
        power *= r2;
        z += a * power;
    }
    Some((z, slope))
}

fn curvature(radius_mm: f64) -> f64 {
    if radius_mm == 0.0 || radius_mm.is_infinite() { 0.0 } else { 1.0 / radius_mm }
}

impl LensPrescription {
    /// A lens for the d line that focuses by moving the film.
    pub fn new(name: impl Into<String>, surfaces: Vec<LensSurface>) -> Self {
        Self {
            name: name.into(),
            source: String::new(),
            design_wavelength_nm: D_LINE_NM,
            surfaces,
            focus: FocusMechanism::Film,
            aperture: None,
        }
    }

    /// Index of the aperture stop; 0 in a lens that was not checked and has none.
    pub fn stop(&self) -> usize {
        self.surfaces.iter().position(|surface| surface.is_stop).unwrap_or(0)
    }

    /// The lens with every named glass looked up, and its stop as wide as [`Self::aperture`] says.
    ///
    /// # Errors
    /// The first glass that `find` does not know, with what it has to say about it.
    pub fn with_glasses(
        mut self,
        find: impl Fn(&str) -> Result<Dispersion, String>,
    ) -> Result<Self, PrescriptionError> {
        for (index, surface) in self.surfaces.iter_mut().enumerate() {
            if let Medium::Named(name) = &surface.medium {
                let place = format!("surface {}, glass", index + 1);
                surface.medium =
                    Medium::Known(find(name).map_err(|message| PrescriptionError::new(place, message))?);
            }
        }
        if let Some(aperture) = self.aperture.take() {
            let paraxial = Paraxial::new(&self, self.design_wavelength_nm);
            let pupil_mm = match aperture {
                SystemAperture::EntrancePupilMm(diameter) => diameter,
                SystemAperture::FNumber(number) => (paraxial.focal_length_mm / number).abs(),
            };
            let stop = self.stop();
            let opening_mm = 0.5 * pupil_mm / paraxial.entrance_pupil_scale.abs();
            self.surfaces[stop].semi_diameter_mm = self.surfaces[stop].semi_diameter_mm.min(opening_mm);
        }
        Ok(self)
    }

    /// Whether any glass disperses.
    pub fn is_dispersive(&self) -> bool {
        self.surfaces.iter().any(|s| matches!(&s.medium, Medium::Known(glass) if glass.is_dispersive()))
    }

    /// Index behind a surface at a wavelength. A glass that was not looked up counts as air; `validate` refuses it.
    pub(super) fn index_behind(&self, surface: usize, wavelength_nm: f64) -> f64 {
        match &self.surfaces[surface].medium {
            Medium::Known(glass) => glass.index(wavelength_nm),
            Medium::Air | Medium::Named(_) => 1.0,
        }
    }

    /// The lens with all lengths multiplied: another focal length, the same f-number and angles.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        for surface in &mut self.surfaces {
            surface.curvature_per_mm /= factor;
            surface.thickness_mm *= factor;
            surface.semi_diameter_mm *= factor;
            for (i, a) in surface.aspheric.iter_mut().enumerate() {
                *a /= factor.powi(3 + 2 * i as i32);
            }
        }
        if let FocusMechanism::Gaps(gaps) = &mut self.focus {
            gaps.iter_mut().for_each(|gap| gap.change_mm *= factor);
        }
        if let Some(SystemAperture::EntrancePupilMm(diameter)) = &mut self.aperture {
            *diameter *= factor;
        }
        self
    }

    /// The distances behind the surfaces with the focusing groups `travel` of their way (0 infinity, 1 closest).
    #[must_use]
    pub fn with_focus_travel(mut self, travel: f64) -> Self {
        if let FocusMechanism::Gaps(gaps) = &self.focus {
            for gap in gaps.clone() {
                if let Some(surface) = self.surfaces.get_mut(gap.behind_surface.wrapping_sub(1)) {
                    surface.thickness_mm += travel * gap.change_mm;
                }
            }
        }
        self
    }

    /// Checks every number.
    ///
    /// # Errors
    /// The first surface and field that can't be used, with the way to fix it.
    pub fn validate(&self) -> Result<(), PrescriptionError> {
        let fail = |place: String, message: String| Err(PrescriptionError { place, message });
        // Check the lens as a whole
        if self.surfaces.is_empty() || self.surfaces.len() > MOST_SURFACES {
            let message = format!("{} surfaces; a lens has 1 to {MOST_SURFACES}", self.surfaces.len());
            return fail("surfaces".into(), message);
        }
        if !(200.0..=1200.0).contains(&self.design_wavelength_nm) {
            let value = number_text(self.design_wavelength_nm);
            let message = format!("{value} is not between 200 and 1200 nm");
            return fail("design_wavelength_nm".into(), message);
        }
        let stops = self.surfaces.iter().filter(|surface| surface.is_stop).count();
        if stops != 1 {
            return fail("stop".into(), format!("{stops} surfaces are the aperture stop; mark exactly one"));
        }
        // Check each surface
        for (index, surface) in self.surfaces.iter().enumerate() {
            let last = index + 1 == self.surfaces.len();
            surface.validate(last).map_err(|(field, message)| PrescriptionError {
                place: format!("surface {}, {field}", index + 1),
                message,
            })?;
        }
        // Check the space behind the lens and the gaps that focus it
        let last = self.surfaces.len() - 1;
        if (self.index_behind(last, self.design_wavelength_nm) - 1.0).abs() > 1e-12 {
            let message = "there must be air behind the last surface; add the rear face of the last glass";
            return fail(format!("surface {}, glass", last + 1), message.into());
        }
        if let FocusMechanism::Gaps(gaps) = &self.focus {
            for gap in gaps {
                if gap.behind_surface == 0 || gap.behind_surface >= self.surfaces.len() {
                    let message =
                        format!("{} is not a surface with another one behind it", gap.behind_surface);
                    return fail("focus, behind_surface".into(), message);
                }
                let nearest = self.surfaces[gap.behind_surface - 1].thickness_mm + gap.change_mm;
                if !(-1e-9..=1e5).contains(&nearest) {
                    let message = format!(
                        "the gap behind surface {} would become {} mm; it must stay between 0 and 1e5 mm",
                        gap.behind_surface,
                        number_text(nearest)
                    );
                    return fail("focus, change_mm".into(), message);
                }
            }
        }
        Ok(())
    }
}
