//! Reflected light against fluorescence behind the viewing filters: the number that decides whether they block enough.

use serde::{Deserialize, Serialize};

use super::predict::{PredictError, predict};
use crate::spectral::{Curve, Transmittance};
use crate::study::FlatSample;
use crate::units::photons_per_joule;

/// Light that passes the viewing filters of a flat sample. Photon radiances are photons/(s m² sr), all wavelengths of the
/// sample together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FilterLeak {
    /// Reflected photon radiance before the filters.
    pub reflected: f64,
    /// Fluorescent photon radiance before the filters.
    pub fluorescent: f64,
    /// Reflected over fluorescent photons before the filters; null without fluorescence.
    pub ratio_before: Option<f64>,
    /// Behind the filters at the angles that the sample states: fixed, or those of its lens.
    pub as_stated: LeakBehindFilters,
    /// Behind the filters at other angles.
    pub at_angles: Vec<LeakAtAngle>,
}

/// At one angle of all light.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeakAtAngle {
    /// Angle to the normal of the filters, degrees.
    pub angle_deg: f64,
    /// Transmitted light.
    #[serde(flatten)]
    pub behind: LeakBehindFilters,
}

/// Light behind the filters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeakBehindFilters {
    /// Reflected photon radiance.
    pub reflected: f64,
    /// Fluorescent photon radiance.
    pub fluorescent: f64,
    /// Reflected over fluorescent photons, the leak; null without fluorescence.
    pub leak_ratio: Option<f64>,
    /// Share of the fluorescent photons that pass.
    pub fluorescence_passed: f64,
    /// Mean optical density for the reflected light, `-log10` of the share of its photons that pass; null when none do.
    pub reflected_density: Option<f64>,
    /// Share of the leaking photons at wavelengths that pass at least half as well as the best one. There no viewing filter
    /// helps: it is the tail of the light itself, to be cut by a filter on the light.
    pub leak_in_pass_band: Option<f64>,
}

/// Leak behind the viewing filters of a flat sample.
///
/// # Errors
/// A sample that can't be predicted.
pub fn filter_leak(sample: &FlatSample, angles_deg: &[f64]) -> Result<FilterLeak, PredictError> {
    let prediction = predict(sample)?;
    let filter = &sample.camera.view_filter;
    let reflected = photons(sample, &prediction.radiance.reflected);
    let mut emitted = vec![0.0; reflected.len()];
    for spectrum in prediction.radiance.fluorescence.values() {
        for (sum, value) in emitted.iter_mut().zip(photons(sample, spectrum)) {
            *sum += value;
        }
    }
    let shape = sample.irradiance.times(&sample.reflectance);
    let behind = |filters: &Curve| {
        // Reflected light has the spectrum of its source within a band, which may fall by decades there.
        let of_reflected = filters.on_grid_under::<Transmittance>(&sample.grid, &shape);
        let even = filters.on_grid::<Transmittance>(&sample.grid);
        behind_filters(&reflected, &emitted, of_reflected.values(), even.values())
    };
    let (all_reflected, all_emitted): (f64, f64) = (reflected.iter().sum(), emitted.iter().sum());
    Ok(FilterLeak {
        reflected: all_reflected,
        fluorescent: all_emitted,
        ratio_before: (all_emitted > 0.0).then(|| all_reflected / all_emitted),
        as_stated: behind(&filter.transmittance),
        at_angles: angles_deg
            .iter()
            .map(|&angle_deg| LeakAtAngle { angle_deg, behind: behind(&filter.stack.at_angle(angle_deg)) })
            .collect(),
    })
}

/// Photons of each band, photons/(s m² sr).
fn photons(sample: &FlatSample, radiance: &[f64]) -> Vec<f64> {
    let (centers, widths) = (sample.grid.centers_nm(), sample.grid.widths_nm());
    let bands = centers.iter().zip(widths);
    radiance.iter().zip(bands).map(|(l, (nm, width))| l * width * photons_per_joule(*nm)).collect()
}

/// `of_reflected` and `passed` are the transmittance for reflected and for even light.
pub(super) fn behind_filters(
    reflected: &[f64],
    emitted: &[f64],
    of_reflected: &[f64],
    passed: &[f64],
) -> LeakBehindFilters {
    let through =
        |light: &[f64], passed: &[f64]| -> f64 { light.iter().zip(passed).map(|(l, t)| l * t).sum() };
    let (leak, signal) = (through(reflected, of_reflected), through(emitted, passed));
    let half = 0.5 * passed.iter().copied().fold(0.0, f64::max);
    let inside: f64 = (0..passed.len())
        .filter(|&band| passed[band] >= half)
        .map(|band| reflected[band] * of_reflected[band])
        .sum();
    let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 0.0 };
    let all: f64 = reflected.iter().sum();
    LeakBehindFilters {
        reflected: leak,
        fluorescent: signal,
        leak_ratio: (signal > 0.0).then(|| leak / signal),
        fluorescence_passed: share(signal, emitted.iter().sum()),
        reflected_density: (leak > 0.0).then(|| (all / leak).log10()),
        leak_in_pass_band: (leak > 0.0).then(|| inside / leak),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_filter_leaks_its_floor_and_the_tail_of_the_light() {
        // Two bands of light and one of fluorescence: 1000 photons stopped at density 3, 2 in the pass band, 10 emitted.
        let leak =
            behind_filters(&[1000.0, 0.0, 2.0], &[0.0, 10.0, 0.0], &[1e-3, 1.0, 1.0], &[1e-3, 1.0, 1.0]);
        assert!((leak.reflected - 3.0).abs() < 1e-12 && (leak.fluorescent - 10.0).abs() < 1e-12);
        assert!((leak.leak_ratio.unwrap() - 0.3).abs() < 1e-12);
        assert!((leak.leak_in_pass_band.unwrap() - 2.0 / 3.0).abs() < 1e-12);
        assert!((leak.reflected_density.unwrap() - (1002.0_f64 / 3.0).log10()).abs() < 1e-12);
        assert_eq!(leak.fluorescence_passed, 1.0);
        let dark = behind_filters(&[1.0], &[0.0], &[0.0], &[0.0]);
        assert_eq!((dark.leak_ratio, dark.reflected_density, dark.leak_in_pass_band), (None, None, None));
    }
}
