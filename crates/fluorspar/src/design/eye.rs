//! An eye that looks into the lights of a design.

use std::f64::consts::PI;

use crate::safety::{
    ApparentSource, Assessment, ExposedTissue, Hazard, Illumination, RetinalObserver, assess,
};
use crate::spectral::Curve;

/// An eye that looks into the lights of a design: how bright and how large they are for it.
#[derive(Clone, Debug, PartialEq)]
pub struct ExposedEye {
    /// Light sources, all of one spectrum: number 0. Their irradiance is that at the eye for one unit of light.
    pub sources: Vec<ApparentSource>,
    /// Whose eye.
    pub observer: RetinalObserver,
}

impl ExposedEye {
    /// An eye that sees one round source of a subtense, rad, which irradiates it this many times as much as a flat region.
    pub fn before_source(irradiance_share: f64, subtense_rad: f64, observer: RetinalObserver) -> Self {
        let source = ApparentSource {
            spectrum: 0,
            irradiance_factor: irradiance_share,
            direction: [0.0, 0.0, 1.0],
            subtense_rad,
            solid_angle_sr: 0.25 * PI * subtense_rad * subtense_rad,
        };
        Self { sources: vec![source], observer }
    }

    /// All hazards of one exposure to a light of this spectrum, its unit of light per nm.
    pub(super) fn hazards(&self, spectrum: &Curve, time_s: f64) -> Vec<Assessment> {
        let light = Illumination { spectra: vec![spectrum.clone()], sources: self.sources.clone() };
        assess(&light, time_s, ExposedTissue::Eye(self.observer))
    }
}

/// Smallest margin of several exposures together: doses of a hazard add up, so their inverse margins do; burns happen or do not in each.
/// `None` where nothing counts.
pub(super) fn smallest_margin_of_all(exposures: impl Iterator<Item = Vec<Assessment>>) -> Option<f64> {
    let mut inverse: Vec<(Hazard, f64)> = Vec::new();
    for found in exposures.flatten() {
        let Some(margin) = found.margin else { continue };
        let is_dose = found.daily_seconds.is_some();
        match inverse.iter_mut().find(|(hazard, _)| *hazard == found.hazard) {
            Some((_, sum)) if is_dose => *sum += 1.0 / margin,
            Some((_, most)) => *most = most.max(1.0 / margin),
            None => inverse.push((found.hazard, 1.0 / margin)),
        }
    }
    inverse.into_iter().map(|(_, sum)| 1.0 / sum).reduce(f64::min)
}
