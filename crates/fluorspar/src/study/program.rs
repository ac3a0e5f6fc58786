//! Captures, instruments and analysis of a study.

use std::sync::Arc;

use super::Target;
use crate::analysis::{PixelMask, Polygon, Rectangle, RegionOfInterest};
use crate::sensor::{CaptureFrame, Demosaicing, Spectroradiometer};
use crate::spectral::{Curve, Fluorophore};
use crate::tissue::{CachedSolutions, Site};

/// A factor on all concentrations of a fluorophore. What holds everywhere is part of the scene, too, so that a new render shows it;
/// what is painted holds for images of a finished render only.
#[derive(Clone, Debug, PartialEq)]
pub struct ConcentrationChange {
    /// Name of the fluorophore.
    pub fluorophore: String,
    /// Factor everywhere, or outside of what is painted.
    pub factor: f64,
    /// A painted mask.
    pub painted: Option<PaintedFactor>,
}

/// A mask over the rendered image with a factor of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct PaintedFactor {
    /// Factor where the mask is 1; where it is between 0 and 1 the factors mix.
    pub inside: f64,
    /// Columns of the mask, which covers the image.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[row][col]`, 0 to 1.
    pub mask: Arc<[f32]>,
}

/// One capture: an exposure, or a bracket of several that are merged.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Lights, time and gain.
    pub frame: CaptureFrame,
    /// Label of the earlier frame whose image is subtracted.
    pub subtract: Option<String>,
    /// Filters in front of the sensor in this capture only, multiplied.
    pub filter: Option<Curve>,
    /// Further exposures, in stops from the first, that are merged with it.
    pub bracket_ev: Vec<f64>,
    /// How long the lights are on, ms, if it is not the time of the exposures.
    pub light_on_ms: Option<f64>,
}

impl From<CaptureFrame> for Capture {
    /// One exposure, nothing subtracted, no filter of its own.
    fn from(frame: CaptureFrame) -> Self {
        Self { frame, subtract: None, filter: None, bracket_ev: Vec::new(), light_on_ms: None }
    }
}

/// How the image moves on the sensor between exposures: a hand that holds the camera, a tongue that does not keep still.
///
/// The whole image shifts evenly; within an exposure it is at rest. Rotation, parallax and blur are left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Steady motion of the image, pixels of the sensor per second: to the right, downward.
    pub drift_px_per_s: [f64; 2],
    /// Random shift of each exposure, standard deviation in either direction, pixels.
    pub jitter_px: f64,
    /// Time between the end of an exposure and the start of the next, ms.
    pub interval_ms: f64,
}

/// How raw frames become linear channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Develop {
    /// Interpolation of the colors.
    pub demosaicing: Demosaicing,
    /// Dark frames for each exposure time and gain; none are taken if 0.
    pub dark_frames: u32,
    /// Flat field.
    pub flat_field: Option<FlatFieldPlan>,
    /// Robust standard deviations from which a pixel counts as bad.
    pub bad_pixel_sigma: Option<f64>,
}

/// Frames of even light.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatFieldPlan {
    /// Frames averaged.
    pub frames: u32,
    /// Signal of the brightest channel on the axis, share of full scale.
    pub level: f64,
    /// Spectrum of the light, any scale.
    pub spectrum: Curve,
}

/// A spectroradiometer and what it looks at.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectroradiometerPlan {
    /// Name.
    pub name: String,
    /// The frame whose lights are on.
    pub frame: CaptureFrame,
    /// Its target.
    pub target: SpectroradiometerTarget,
    /// The instrument with its filters.
    pub instrument: Spectroradiometer,
}

/// Target of a spectroradiometer.
#[derive(Clone, Debug, PartialEq)]
pub enum SpectroradiometerTarget {
    /// A round spot.
    Spot {
        /// Its center, from the left and the top edge of the image, 0 to 1.
        aim: [f64; 2],
        /// Its full angle, degrees.
        acceptance_deg: f64,
    },
    /// All pixels that show these parts.
    Parts(Vec<String>),
}

/// Settings of the photobiological safety assessment. Without a distance there is no margin.
#[derive(Clone, Debug, PartialEq)]
pub struct SafetyPlan {
    /// Distance from the camera's pupil, along its axis, at which a patient's eye may look into the lights, mm.
    pub patient_eye_distance_mm: Option<f64>,
    /// Distance from the lit mouth to the eye of the operator, who sees it by reflected light, mm.
    pub operator_eye_distance_mm: Option<f64>,
    /// Distance from the camera's pupil, along its axis, to the nearest mucosa, mm.
    pub mucosa_distance_mm: f64,
    /// Diameter of what the operator sees lit, mm.
    pub lit_diameter_mm: f64,
    /// Diffuse reflectance of what the operator sees, 0 to 1.
    pub reflectance: f64,
    /// Factor by which limits for skin are divided for mucosa, for which there are none; 1 for skin.
    pub mucosa_safety_factor: f64,
    /// Whether the patient may be an infant or have no lens in the eye.
    pub aphakic: bool,
    /// Whether the lights shine into a mouth. Elsewhere the lit tissue is skin, and nobody is a patient.
    pub is_mouth: bool,
}

impl SafetyPlan {
    /// Mucosa at a distance, mm, from the camera; distances of eyes unknown, a lit disc of 60 mm, reflectance 1 (the
    /// upper bound), a safety factor of 10 for mucosa (assumed).
    pub fn new(mucosa_distance_mm: f64) -> Self {
        Self {
            patient_eye_distance_mm: None,
            operator_eye_distance_mm: None,
            mucosa_distance_mm,
            lit_diameter_mm: 60.0,
            reflectance: 1.0,
            mucosa_safety_factor: 10.0,
            aphakic: false,
            is_mouth: true,
        }
    }
}

/// Analysis of the captures.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalysisPlan {
    /// Label of the frame that is analyzed.
    pub frame: String,
    /// Names of the parts that form the region of interest; empty means all.
    pub parts: Vec<String>,
    /// Pixels of the sensor by which the region keeps away from the rim of the parts.
    pub inset_px: u32,
    /// Rectangle of the sensor: column, row, width, height.
    pub rectangle_px: Option<[u32; 4]>,
    /// Polygon on the sensor that the region lies in.
    pub polygon: Option<Polygon>,
    /// Mask of the raw image that the region lies in.
    pub mask: Option<PixelMask>,
    /// Name of the porphyrin, or of another fluorophore whose share is estimated; `None` where no share is asked for.
    pub porphyrin: Option<String>,
    /// Two regions of the sensor whose pixels are compared.
    pub compared: Option<[RegionOfInterest; 2]>,
    /// Fluorophores that form the bulk, with their amounts.
    pub bulk: Vec<(String, f64)>,
    /// Fluorophores whose responses are predicted: those of the scene, and those of the bulk that no material holds. Where the
    /// region is layered tissue, they emit as its surface does.
    pub fluorophores: Vec<Fluorophore>,
    /// Labels of further frames that enter the estimate of a tissue family.
    pub further_frames: Vec<String>,
    /// What is known of the tissue of the region beforehand; without it there is no estimate from a tissue family.
    pub tissue: Option<TissuePrior>,
    /// Where the colors of the ends of the mixture line come from.
    pub line_ends: LineEnds,
    /// What shall be seen.
    pub targets: Vec<Target>,
    /// d' that a target shall reach.
    pub wanted_d_prime: f64,
    /// Least channel sum that has a chromaticity, in standard deviations of its noise.
    pub noise_threshold: f64,
}

/// A region that is analyzed beside that of the study's analysis, in the same frame.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionPlan {
    /// Its name, unique among the regions of a study.
    pub name: String,
    /// Its analysis, without targets and compared spots, which are told once.
    pub analysis: AnalysisPlan,
}

impl AnalysisPlan {
    /// Twice the one-sided 95 % quantile of the normal distribution: a threshold half way errs in 5 % of cases either way (Currie 1968).
    pub const WANTED_D_PRIME: f64 = 3.29;

    /// The region that is analyzed.
    #[must_use]
    pub fn region(&self) -> RegionOfInterest {
        let rectangle = self.rectangle_px.map(|rectangle| {
            let [col, row, width, height] = rectangle.map(|n| n as usize);
            Rectangle { col, row, width, height }
        });
        RegionOfInterest {
            parts: self.parts.clone(),
            rectangle,
            polygon: self.polygon.clone(),
            mask: self.mask.clone(),
            inset_px: self.inset_px as usize,
        }
    }
}

/// What is known of a tissue before it is measured: its site, and how much that varies.
#[derive(Clone, Debug, PartialEq)]
pub struct TissuePrior {
    /// The site in the middle of the prior.
    pub site: Site,
    /// Fluorophores that the site may hold, and those of [`Self::teeth`].
    pub fluorophores: Vec<Arc<Fluorophore>>,
    /// Standard deviations of blood, depth and amounts over those of the population ([`crate::tissue::Population`]).
    pub width: f64,
    /// Relative error of the spectra of the library at each wavelength.
    pub library_error: f64,
    /// The teeth around in a mouth, where light reaches the region by way of other tissue and from them.
    pub teeth: Option<Site>,
    /// Probability beforehand that the tissue is of this site, above 0 to 1. Below 1 those of [`Self::others`] share the rest.
    pub site_probability: f64,
    /// Sites that other tissue may be of; one of the name of [`Self::site`] does not count.
    pub others: Vec<Site>,
    /// Where solved tissues of the family are kept.
    pub kept: CachedSolutions,
}

impl TissuePrior {
    /// A little wider than the population, which four people tell of. \[assumed\]
    pub const WIDTH: f64 = 1.25;
    /// Models of this kind leave 0.02 to 0.05 of the value at 520 nm between them and measured tongues and lips; sixteen narrow channels
    /// find them as far away as this says.
    pub const LIBRARY_ERROR: f64 = 0.03;
    /// One in ten regions is other tissue than it is told. \[assumed\]
    pub const SITE_PROBABILITY: f64 = 0.9;
}

/// Where the colors of the ends of a mixture line come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LineEnds {
    /// The light of bulk and porphyrin as it reaches the sensor from the region of a component image, by all ways; flat samples
    /// where there is none.
    #[default]
    Scene,
    /// Flat samples of the bulk and the porphyrin under direct light, whatever the scene holds: an assumption to be tested.
    FlatSample,
}
