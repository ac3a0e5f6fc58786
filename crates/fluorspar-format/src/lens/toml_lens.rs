//! Our own lens file.

use serde::{Deserialize, Serialize};

use super::Fault;
use crate::read_toml;
use fluorspar::optics::{
    D_LINE_NM, Dispersion, FocusGap, FocusMechanism, LensPrescription, LensSurface, Medium,
};
use fluorspar::units::check_range;

/// A lens as a TOML file. Lengths in mm, surfaces from the object to the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensFile {
    /// Name.
    pub name: String,
    /// Name for people. Default: empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub title: String,
    /// Description and caveats. Default: empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Where the numbers come from. Default: empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub source: String,
    /// Fields that are assumed rather than published.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub assumed: Vec<String>,
    /// Wavelength for which the lens is traced when bands are not split, nm, 200 to 1200. Default: the d line, 587.5618.
    #[serde(default = "d_line")]
    pub design_wavelength_nm: f64,
    /// Factor on all lengths of surfaces and focus, above 0. Default 1.
    #[serde(default = "unity", skip_serializing_if = "is_unity")]
    pub scale: f64,
    /// Published values of the whole lens, after scaling.
    pub published: Option<PublishedLens>,
    /// Gaps that change to focus; none: the film moves.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub focus: Vec<FocusGap>,
    /// The surfaces.
    #[serde(rename = "surface")]
    pub surfaces: Vec<LensFileSurface>,
}

/// Published values of a lens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedLens {
    /// Effective focal length, mm.
    pub focal_length_mm: Option<f64>,
    /// Distance from the last vertex to the focus, mm.
    pub back_focal_length_mm: Option<f64>,
    /// Focal length over diameter of the entrance pupil.
    pub f_number: Option<f64>,
}

/// Index and Abbe number of a glass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AbbeGlass {
    /// Index at the d line.
    pub nd: f64,
    /// Abbe number.
    pub vd: f64,
}

/// A surface and what is behind it: one of `glass`, `index`, `abbe`, `dispersion`, or air.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensFileSurface {
    /// Radius of curvature, positive when the center lies behind. Default: a plane.
    pub radius_mm: Option<f64>,
    /// Conic constant. Default 0, a sphere.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub conic: f64,
    /// Coefficients of r^4, r^6, ... Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aspheric: Vec<f64>,
    /// Distance to the next surface. Default 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub thickness_mm: f64,
    /// Glass of the catalogue.
    pub glass: Option<String>,
    /// The same index at all wavelengths.
    pub index: Option<f64>,
    /// Index and Abbe number.
    pub abbe: Option<AbbeGlass>,
    /// A dispersion formula or table.
    pub dispersion: Option<Dispersion>,
    /// Half of the clear aperture.
    pub semi_diameter_mm: f64,
    /// Whether this is the aperture stop. Default false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stop: bool,
}

fn d_line() -> f64 {
    D_LINE_NM
}

fn unity() -> f64 {
    1.0
}

fn is_unity(value: &f64) -> bool {
    *value == 1.0
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl LensFile {
    /// Reads the text of a lens file.
    ///
    /// # Errors
    /// The line, where one is to blame, and what is wrong.
    pub fn parse(text: &str) -> Result<Self, (Option<usize>, String)> {
        read_toml(text).map_err(|error| (error.line(), error.message().to_string()))
    }

    /// The text of the file.
    ///
    /// # Errors
    /// When it can't be written as TOML, for instance because a number is not finite.
    pub fn to_toml(&self) -> Result<String, String> {
        toml::to_string(self).map_err(|error| error.to_string())
    }

    /// The lens that the file describes; glasses of the catalogue stay names.
    pub(super) fn prescription(&self) -> Result<LensPrescription, Fault> {
        self.to_prescription().map_err(Fault::anywhere)
    }

    /// The lens that the file describes; glasses of the catalogue stay names.
    ///
    /// # Errors
    /// What is wrong and how to fix it.
    pub fn to_prescription(&self) -> Result<LensPrescription, String> {
        check_range(self.scale, [1e-6, 1e6], "give a factor on all lengths")
            .map_err(|message| format!("scale: {message}"))?;
        let mut surfaces = Vec::with_capacity(self.surfaces.len());
        for (index, s) in self.surfaces.iter().enumerate() {
            let given = [s.glass.is_some(), s.index.is_some(), s.abbe.is_some(), s.dispersion.is_some()];
            if given.iter().filter(|given| **given).count() > 1 {
                return Err(format!(
                    "surface {}: give at most one of glass, index, abbe and dispersion; none is air",
                    index + 1
                ));
            }
            let medium = match (&s.glass, s.index, s.abbe, &s.dispersion) {
                (Some(name), ..) => Medium::Named(name.clone()),
                (_, Some(index), ..) => Medium::Known(Dispersion::Constant { index }),
                (_, _, Some(glass), _) => Medium::Known(Dispersion::Abbe { nd: glass.nd, vd: glass.vd }),
                (_, _, _, Some(dispersion)) => Medium::Known(dispersion.clone()),
                _ => Medium::Air,
            };
            if s.radius_mm.is_some_and(|radius| radius == 0.0 || radius.is_nan()) {
                return Err(format!(
                    "surface {}: a radius of 0 is invalid; leave it out for a plane",
                    index + 1
                ));
            }
            surfaces.push(LensSurface {
                conic: s.conic,
                aspheric: s.aspheric.clone(),
                medium,
                is_stop: s.stop,
                ..LensSurface::spherical(s.radius_mm.unwrap_or(0.0), s.thickness_mm, s.semi_diameter_mm)
            });
        }
        let lens = LensPrescription {
            name: self.name.clone(),
            source: self.source.clone(),
            design_wavelength_nm: self.design_wavelength_nm,
            surfaces,
            focus: if self.focus.is_empty() {
                FocusMechanism::Film
            } else {
                FocusMechanism::Gaps(self.focus.clone())
            },
            aperture: None,
        };
        Ok(if self.scale == 1.0 { lens } else { lens.scaled(self.scale) })
    }

    /// The file of a lens.
    pub fn from_prescription(lens: &LensPrescription) -> Self {
        let surface = |s: &LensSurface| {
            let mut file = LensFileSurface {
                radius_mm: (s.curvature_per_mm != 0.0).then(|| s.radius_mm()),
                conic: s.conic,
                aspheric: s.aspheric.clone(),
                thickness_mm: s.thickness_mm,
                semi_diameter_mm: s.semi_diameter_mm,
                stop: s.is_stop,
                ..LensFileSurface::default()
            };
            match &s.medium {
                Medium::Air => {}
                Medium::Named(name) => file.glass = Some(name.clone()),
                Medium::Known(Dispersion::Constant { index }) => file.index = Some(*index),
                Medium::Known(Dispersion::Abbe { nd, vd }) => {
                    file.abbe = Some(AbbeGlass { nd: *nd, vd: *vd })
                }
                Medium::Known(other) => file.dispersion = Some(other.clone()),
            }
            file
        };
        Self {
            name: lens.name.clone(),
            title: String::new(),
            description: String::new(),
            source: lens.source.clone(),
            assumed: Vec::new(),
            design_wavelength_nm: lens.design_wavelength_nm,
            scale: 1.0,
            published: None,
            focus: match &lens.focus {
                FocusMechanism::Film => Vec::new(),
                FocusMechanism::Gaps(gaps) => gaps.clone(),
            },
            surfaces: lens.surfaces.iter().map(surface).collect(),
        }
    }
}
