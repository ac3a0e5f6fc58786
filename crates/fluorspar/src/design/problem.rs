//! A design problem: what may be chosen, what is assumed, what counts.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::optics::IdealLens;
use crate::safety::{ApparentSource, ExposedTissue, Illumination, assess};
use crate::spectral::Curve;

use super::criterion::Criterion;
use super::design_camera::DesignCamera;
use super::evaluation::Assumptions;
use super::eye::ExposedEye;
use super::region_model::{LibraryError, RegionModel};

/// A light that may be chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct LightChoice {
    /// Name.
    pub name: String,
    /// Its spectrum behind its own filters, of unit power.
    pub spectrum: Curve,
    /// Irradiance of a flat region, W/m².
    pub light: f64,
    /// Power where a region is rendered: of the first light of the group whose place it takes, W.
    pub power_w: f64,
    /// Wavelength of its peak, nm.
    pub peak_nm: f64,
    /// Price, in any unit.
    pub cost: f64,
}

/// Where a long-pass filter opens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LongPassEdge {
    /// At a wavelength, nm, for all exposures.
    At(f64),
    /// So many nanometers above the peak of the light of each exposure, each with a filter of its own.
    AfterPeak(f64),
}

/// A viewing filter that may be chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct FilterChoice {
    /// Name.
    pub name: String,
    /// What stays the same for all exposures.
    pub fixed: Curve,
    /// A long-pass edge besides.
    pub long_pass: Option<LongPass>,
    /// Price, in any unit; of a filter for each light that of each.
    pub cost: f64,
}

/// A long-pass edge: `10^-D + (1 - 10^-D) / (1 + exp(-(lambda - edge) / s))`, `s` the width from 10 % to 90 % over `2 ln 9`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LongPass {
    /// Where it passes one half.
    pub edge: LongPassEdge,
    /// Distance between 10 % and 90 %, nm.
    pub width_nm: f64,
    /// Optical density below it.
    pub optical_density: f64,
}

impl LongPass {
    fn transmittance(&self, edge_nm: f64) -> Curve {
        let floor = 10f64.powf(-self.optical_density);
        let scale = self.width_nm.max(1e-3) / (2.0 * 9f64.ln());
        let pass = move |nm: f64| floor + (1.0 - floor) / (1.0 + (-(nm - edge_nm) / scale).exp());
        Curve::from_fn(200.0, 1200.0, pass)
    }
}

impl FilterChoice {
    /// Its transmittance in an exposure under a light of this peak.
    pub fn transmittance(&self, peak_nm: f64) -> Curve {
        match &self.long_pass {
            None => self.fixed.clone(),
            Some(long_pass) => {
                let edge_nm = match long_pass.edge {
                    LongPassEdge::At(nm) => nm,
                    LongPassEdge::AfterPeak(nm) => peak_nm + nm,
                };
                self.fixed.times(&long_pass.transmittance(edge_nm))
            }
        }
    }

    /// Price for these lights.
    pub(super) fn cost_for(&self, lights: usize) -> f64 {
        match self.long_pass {
            Some(LongPass { edge: LongPassEdge::AfterPeak(_), .. }) => self.cost * lights as f64,
            _ => self.cost,
        }
    }
}

/// An aperture that may be chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct LensChoice {
    /// Focal length over the diameter of the entrance pupil.
    pub f_number: f64,
    /// Solid angle on the axis, sr.
    pub solid_angle_sr: f64,
}

impl LensChoice {
    /// A lens at an aperture.
    pub fn new(lens: &IdealLens, f_number: f64) -> Self {
        let stopped = IdealLens { f_number, ..lens.clone() };
        Self { f_number, solid_angle_sr: stopped.axial_solid_angle_sr() }
    }
}

/// How exposures share what there is of time or electrons.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Equal times.
    EqualTime,
    /// Equal electrons in the first region.
    EqualElectrons,
    /// The first exposure (the shortest wavelength) has this share of the time, the others the rest in equal parts.
    #[serde(untagged)]
    First(f64),
}

/// What all exposures have together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// Time, s.
    Time(f64),
    /// Electrons in the first region: all channels of all exposures, one pixel of each channel.
    Electrons(f64),
}

/// A frame under white light without fluorescence filter, whose data count, too.
#[derive(Clone, Debug, PartialEq)]
pub struct WhiteFrame {
    /// Its light.
    pub light: LightChoice,
    /// Filter in front of the sensor.
    pub filter: Curve,
    /// Signal of its brightest channel in the first region, share of what a pixel holds.
    pub level: f64,
}

/// What a design must keep to; `None` is no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Smallest photobiological margin of the tissue under all exposures together.
    pub tissue_margin: Option<f64>,
    /// Smallest photobiological margin of an eye that looks into the lights of all exposures.
    pub eye_margin: Option<f64>,
    /// Largest ratio of reflected to fluorescent electrons.
    pub leak: Option<f64>,
    /// Largest share of what a pixel holds.
    pub saturation: Option<f64>,
    /// Longest time of all exposures together, s.
    pub time_s: Option<f64>,
    /// Highest price.
    pub cost: Option<f64>,
}

/// A ratio of amounts by the names of fluorophores, such as NADH / (NADH + FAD). In layered tissue and in rendered scenes an amount is
/// the light that a fluorophore sends between 500 and 700 nm under 405 nm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ContrastDefinition {
    /// Name.
    pub name: String,
    /// Fluorophores of the numerator.
    pub part: Vec<String>,
    /// Fluorophores of the denominator. Default: all.
    #[serde(default)]
    pub whole: Vec<String>,
}

/// People in two states, whom a design should tell apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Cohort {
    /// What differs.
    pub name: String,
    /// Regions of people in the first state.
    pub healthy: Vec<RegionModel>,
    /// Regions of people in the second.
    pub altered: Vec<RegionModel>,
}

/// A geometry that may be chosen: a place of lights or camera, of which only a render shows what it does.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometryChoice {
    /// Name.
    pub name: String,
    /// Regions as it shows them; every geometry has the same ones.
    pub regions: Vec<RegionModel>,
    /// Solid angle of each aperture on the axis at the working distance of this geometry, sr, in the order of
    /// [`DesignProblem::lenses`]; empty where it has no working distance of its own.
    pub lens_sr: Vec<f64>,
    /// An eye that looks into the lights, for each watt of the first light of the group; `None` where the scene says of none.
    pub eye: Option<ExposedEye>,
}

/// What is known of the weight of a fluorophore before anything is measured: a normal prior about the amount that a region holds.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightPrior {
    /// Name of the fluorophore.
    pub fluorophore: String,
    /// Standard deviation over that amount.
    pub relative: f64,
}

/// Everything that a search needs.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignProblem {
    /// Flat regions, the same in every geometry. A design is as good as in the worst of all regions.
    pub regions: Vec<RegionModel>,
    /// Geometries with their rendered regions; none where all regions are flat.
    pub geometries: Vec<GeometryChoice>,
    /// An eye that looks into the lights, for each W/m² on a flat region. Rendered geometries have their own.
    pub eye: Option<ExposedEye>,
    /// Two groups of people.
    pub cohort: Option<Cohort>,
    /// Lights, by rising wavelength.
    pub lights: Vec<LightChoice>,
    /// Numbers of exposures under different lights.
    pub exposures: Vec<usize>,
    /// Viewing filters.
    pub filters: Vec<FilterChoice>,
    /// Sensors behind their lenses.
    pub cameras: Vec<DesignCamera>,
    /// Apertures.
    pub lenses: Vec<LensChoice>,
    /// Factors on all lights.
    pub drives: Vec<f64>,
    /// How exposures share the budget.
    pub splits: Vec<Split>,
    /// What they have together.
    pub budget: Budget,
    /// A white frame.
    pub white: Option<WhiteFrame>,
    /// How wrong the library may be.
    pub library: LibraryError,
    /// What is taken for granted.
    pub assumptions: Assumptions,
    /// What is known of weights before. Weights of other fluorophores are not known at all.
    pub weights: Vec<WeightPrior>,
    /// Ratios of amounts.
    pub contrasts: Vec<ContrastDefinition>,
    /// What designs are ranked by.
    pub criterion: Criterion,
    /// What they must keep to.
    pub limits: Limits,
    /// Factor by which mucosa is taken to be more sensitive than skin.
    pub tissue_safety_factor: f64,
}

impl DesignProblem {
    /// Number of geometries, 1 or more.
    pub fn geometry_count(&self) -> usize {
        self.geometries.len().max(1)
    }

    /// All regions of a geometry: flat ones, then those that were rendered.
    pub fn regions_of(&self, geometry: usize) -> impl Iterator<Item = &RegionModel> {
        let rendered = self.geometries.get(geometry).into_iter().flat_map(|choice| &choice.regions);
        self.regions.iter().chain(rendered)
    }

    /// The eye of a geometry, and whether it is of a rendered scene: for each watt, not for each W/m² of a flat region.
    pub(super) fn eye_of(&self, geometry: usize) -> Option<(&ExposedEye, bool)> {
        match self.geometries.get(geometry) {
            Some(choice) => choice.eye.as_ref().map(|eye| (eye, true)),
            None => self.eye.as_ref().map(|eye| (eye, false)),
        }
    }

    /// Solid angle of an aperture on the axis, sr, at the working distance of a geometry.
    pub fn lens_sr(&self, geometry: usize, lens: usize) -> f64 {
        let own = self.geometries.get(geometry).and_then(|choice| choice.lens_sr.get(lens));
        own.copied().unwrap_or(self.lenses[lens].solid_angle_sr)
    }

    /// Standard deviations of the priors of the weights of a region, in the order of its fluorophores; infinite without one.
    pub(super) fn priors_of(&self, region: &RegionModel) -> Vec<f64> {
        let of = |name: &String| {
            let known = self.weights.iter().find(|prior| prior.fluorophore == *name);
            known.map_or(f64::INFINITY, |prior| prior.relative)
        };
        region.response.fluorescence.iter().map(|part| of(&part.name)).collect()
    }

    /// One of the regions of [`Self::regions_of`], to change.
    pub(super) fn region_mut(&mut self, geometry: usize, number: usize) -> Option<&mut RegionModel> {
        let flat = self.regions.len();
        match number.checked_sub(flat) {
            None => self.regions.get_mut(number),
            Some(rendered) => self.geometries.get_mut(geometry)?.regions.get_mut(rendered),
        }
    }
}

/// Smallest ratio of limit to exposure over the hazards to tissue of one irradiance, W/(m² nm); `None` where nothing counts.
pub(super) fn tissue_margin(irradiance: &Curve, time_s: f64, safety_factor: f64) -> Option<f64> {
    let illumination = Illumination {
        spectra: vec![irradiance.clone()],
        sources: vec![ApparentSource {
            spectrum: 0,
            irradiance_factor: 1.0,
            direction: [0.0, 0.0, 1.0],
            subtense_rad: 0.0,
            solid_angle_sr: 0.0,
        }],
    };
    let hazards = assess(&illumination, time_s, ExposedTissue::Skin { safety_factor });
    hazards.iter().filter_map(|hazard| hazard.margin).reduce(f64::min)
}
