//! A region with everything about it that is not known.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::spectral::Curve;

use super::design_camera::{FilteredCamera, FineBands};
use super::problem::LightChoice;
use super::region_response::{FluorescenceResponse, RegionResponse, bands_of};

/// How wrong the library of fluorophores may be: standard deviations of independent errors of each fluorophore.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LibraryError {
    /// Shift of its emission, nm, 0 to 100. Libraries differ by 5 to 25 nm for the same molecule. Default 0.
    pub emission_shift_nm: f64,
    /// Shift of its excitation, nm, 0 to 100. Default 0.
    pub excitation_shift_nm: f64,
    /// Smooth relative error of its emission and of its excitation spectrum, 0 to 1. Default 0.
    #[serde(rename = "spectrum")]
    pub shape: f64,
    /// Distance over which that error is alike, nm, 5 to 500. Default 40.
    pub correlation_nm: f64,
}

impl Default for LibraryError {
    /// No error.
    fn default() -> Self {
        Self { emission_shift_nm: 0.0, excitation_shift_nm: 0.0, shape: 0.0, correlation_nm: 40.0 }
    }
}

/// A change of everything that a region sends when one unknown moves by one standard deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct ResponseChange {
    /// What moves.
    pub name: String,
    /// Change of the fluorescence of each fluorophore, `[band][number of the basis]`; empty is none.
    pub fluorescence: Vec<Vec<f64>>,
    /// Change of the reflected light; `None` is none.
    pub reflected: Option<Curve>,
    /// How it grows with the unknown.
    pub growth: ChangeGrowth,
}

/// How a change grows when its unknown moves by more than one standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangeGrowth {
    /// In proportion.
    Linear,
    /// As what light passes twice as thick a layer does: the share that is left is raised to the power of the thickness.
    Attenuation,
}

impl ResponseChange {
    /// The difference between two responses of the same region, one with something moved. `None` where they differ in bands,
    /// basis or fluorophores.
    pub fn between(
        name: &str,
        region: &RegionResponse,
        moved: &RegionResponse,
        growth: ChangeGrowth,
    ) -> Option<Self> {
        let alike = region.grid == moved.grid
            && region.excitation == moved.excitation
            && region.fluorescence.len() == moved.fluorescence.len();
        if !alike {
            return None;
        }
        let difference = |(before, after): (&FluorescenceResponse, &FluorescenceResponse)| {
            after.radiance.iter().zip(&before.radiance).map(|(after, before)| after - before).collect()
        };
        let fluorescence = region.fluorescence.iter().zip(&moved.fluorescence).map(difference).collect();
        let (first, last) = region.reflected.range_nm();
        let reflected = Curve::from_fn(first, last, |nm| moved.reflected.at(nm) - region.reflected.at(nm));
        Some(Self { name: name.into(), fluorescence, reflected: Some(reflected), growth })
    }

    /// The change when the unknown moves by `factor` standard deviations.
    #[must_use]
    pub(super) fn grown(&self, factor: f64, region: &RegionResponse) -> Self {
        let grown = |change: f64, whole: f64| match self.growth {
            ChangeGrowth::Attenuation if whole > 0.0 => {
                whole * ((1.0 + change / whole).max(0.0).powf(factor) - 1.0)
            }
            _ => factor * change,
        };
        let of = |(j, change): (usize, &Vec<f64>)| {
            let whole = &region.fluorescence[j].radiance;
            change.iter().zip(whole).map(|(change, whole)| grown(*change, *whole)).collect()
        };
        let reflected = self.reflected.as_ref().map(|change| {
            let values = change.wavelengths_nm().iter().zip(change.values());
            let values = values.map(|(&nm, &value)| grown(value, region.reflected.at(nm))).collect();
            Curve::new(change.wavelengths_nm().to_vec(), values).unwrap_or_else(|_| change.scaled(factor))
        });
        Self {
            fluorescence: self.fluorescence.iter().enumerate().map(of).collect(),
            reflected,
            ..self.clone()
        }
    }
}

/// What the response of a region is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightUnit {
    /// An irradiance of 1 W/m².
    Irradiance,
    /// A power of 1 W of the first light of its group, at its place in a scene.
    Power {
        /// Largest irradiance of the region by the whole group, unshaded, W/m² for each watt of its first light.
        irradiance_per_w: f64,
    },
}

/// A region and its unknowns besides the weights of its fluorophores.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionModel {
    /// What it sends.
    pub response: RegionResponse,
    /// Blood, depth, errors of the library: each changes the signal by this much at one standard deviation.
    pub changes: Vec<ResponseChange>,
    /// The light that the response is for.
    pub unit: LightUnit,
    /// Pixels of the sensor that the region covers over those in the first geometry: fewer where the camera stands farther away.
    pub pixel_share: f64,
}

impl RegionModel {
    /// A flat region of which only the weights are not known.
    pub fn known(response: RegionResponse) -> Self {
        Self { response, changes: Vec::new(), unit: LightUnit::Irradiance, pixel_share: 1.0 }
    }

    /// A region of a render of which only the weights are not known, with its largest irradiance for each watt of the first light of
    /// the group.
    pub fn rendered(response: RegionResponse, irradiance_per_w: f64) -> Self {
        let unit = LightUnit::Power { irradiance_per_w };
        Self { response, changes: Vec::new(), unit, pixel_share: 1.0 }
    }

    /// Irradiance that a light gives the region, W/m².
    pub(super) fn irradiance(&self, light: &LightChoice) -> f64 {
        match self.unit {
            LightUnit::Irradiance => light.light,
            LightUnit::Power { irradiance_per_w } => light.power_w * irradiance_per_w,
        }
    }

    /// The region under a light, by spectrum, for each W/m² that the light gives a flat region, seen with a library of fluorophores
    /// that may be wrong: its errors are unknowns behind those of the region.
    pub fn under(&self, light: &LightChoice, bands: &FineBands, library: &LibraryError) -> LitRegion {
        let light = &match self.unit {
            LightUnit::Irradiance => light.spectrum.clone(),
            LightUnit::Power { .. } => light.spectrum.scaled(light.power_w / light.light),
        };
        let coefficients = self.response.excitation.coefficients(light);
        let reflected = |reflected: &Curve| light.times(reflected).bin_averages(&bands.fine);
        let response = &self.response;
        let fluorescence: Vec<Vec<f64>> =
            response.fluorescence.iter().map(|f| bands_of(&f.radiance, &coefficients)).collect();
        let change = |change: &ResponseChange| {
            let mut all = vec![0.0; response.grid.len()];
            for part in change.fluorescence.iter().filter(|part| !part.is_empty()) {
                let bands = bands_of(part, &coefficients);
                all.iter_mut().zip(bands).for_each(|(sum, value)| *sum += value);
            }
            (all, change.reflected.as_ref().map(reflected))
        };
        let library_changes = library_changes(response, &fluorescence, &coefficients, library);
        LitRegion {
            reflected: reflected(&response.reflected),
            changes: self
                .changes
                .iter()
                .map(change)
                .chain(library_changes.into_iter().map(|change| (change, None)))
                .collect(),
            fluorescence,
        }
    }
}

/// Spectra that a region sends under one light, W/(sr m² nm).
#[derive(Clone, Debug, PartialEq)]
pub struct LitRegion {
    /// Fluorescence, `[fluorophore][band]`.
    fluorescence: Vec<Vec<f64>>,
    /// Reflected light, `[fine bin]`.
    reflected: Vec<f64>,
    /// Changes by unknown: fluorescence by band, reflected light by fine bin.
    changes: Vec<(Vec<f64>, Option<Vec<f64>>)>,
}

impl LitRegion {
    /// Its signals in a camera.
    pub fn through(&self, camera: &FilteredCamera) -> SignalRates {
        let channels = || camera.by_band.iter().zip(&camera.fine);
        let change = |(even, steep): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
            let of = |(fluorescence, reflected): &(Vec<f64>, Option<Vec<f64>>)| {
                dot(even, fluorescence) + reflected.as_ref().map_or(0.0, |reflected| dot(steep, reflected))
            };
            self.changes.iter().map(of).collect()
        };
        SignalRates {
            fluorescence: channels()
                .map(|(even, _)| self.fluorescence.iter().map(|f| dot(even, f)).collect())
                .collect(),
            leak: channels().map(|(_, steep)| dot(steep, &self.reflected)).collect(),
            changes: channels().map(change).collect(),
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Electrons per second of one pixel, per unit of light and sr of the lens.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalRates {
    /// `[channel][fluorophore]`.
    pub fluorescence: Vec<Vec<f64>>,
    /// Reflected light that passes the filters, `[channel]`.
    pub leak: Vec<f64>,
    /// Change at one standard deviation of each unknown, `[channel][unknown]`.
    pub changes: Vec<Vec<f64>>,
}

/// Changes of lit fluorescence, `[unknown][band]`, by errors of its library: an error of the emission spectrum acts on what each
/// fluorophore sends, one of the excitation spectrum on the coefficients of the light.
fn library_changes(
    region: &RegionResponse,
    lit: &[Vec<f64>],
    coefficients: &[f64],
    error: &LibraryError,
) -> Vec<Vec<f64>> {
    let nodes = region.excitation.centers_nm();
    let bands = region.grid.centers_nm();
    let has_shape_error = error.shape > 0.0 && error.correlation_nm > 0.0;
    let bumps_of = |axis: &[f64]| if has_shape_error { bumps(axis, error) } else { Vec::new() };
    let products = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let emission_bumps = bumps_of(&bands);
    // Lights through wrong excitation spectra
    let mut wrong_lights = Vec::new();
    if error.excitation_shift_nm > 0.0 {
        wrong_lights.push(shifted_coefficients(coefficients, &nodes, error.excitation_shift_nm));
    }
    let shift_count = wrong_lights.len();
    wrong_lights.extend(bumps_of(&nodes).iter().map(|bump| products(coefficients, bump)));
    let mut changes = Vec::new();
    for (fluorescence, lit) in region.fluorescence.iter().zip(lit) {
        let under = |light: &Vec<f64>| bands_of(&fluorescence.radiance, light);
        if error.emission_shift_nm > 0.0 {
            changes.push(shifted(lit, &bands, error.emission_shift_nm));
        }
        changes.extend(wrong_lights[..shift_count].iter().map(under));
        changes.extend(emission_bumps.iter().map(|bump| products(lit, bump)));
        changes.extend(wrong_lights[shift_count..].iter().map(under));
    }
    changes
}

/// The sample right of a wavelength, at least the second, and the share of the way to it from its neighbor, 0 to 1.
fn interval_of(axis: &[f64], nm: f64) -> (usize, f64) {
    let right = axis.partition_point(|&x| x < nm).clamp(1, axis.len() - 1);
    let share = ((nm - axis[right - 1]) / (axis[right] - axis[right - 1])).clamp(0.0, 1.0);
    (right, share)
}

/// The difference that a shift by some nanometers makes to a spectrum.
fn shifted(values: &[f64], axis: &[f64], shift_nm: f64) -> Vec<f64> {
    let difference = |(&nm, value): (&f64, &f64)| {
        let (right, share) = interval_of(axis, nm - shift_nm);
        values[right - 1] * (1.0 - share) + values[right] * share - value
    };
    axis.iter().zip(values).map(difference).collect()
}

/// The coefficients whose sum over an excitation spectrum is the difference that a shift of the spectrum by some nanometers makes:
/// the transpose of [`shifted`].
fn shifted_coefficients(coefficients: &[f64], nodes: &[f64], shift_nm: f64) -> Vec<f64> {
    let mut found: Vec<f64> = coefficients.iter().map(|c| -c).collect();
    for (&nm, c) in nodes.iter().zip(coefficients) {
        let (right, share) = interval_of(nodes, nm - shift_nm);
        found[right - 1] += c * (1.0 - share);
        found[right] += c * share;
    }
    found
}

/// Gaussians at distances of their own width, whose squares add up to the variance of the error: with independent unit weights
/// their sum has its standard deviation everywhere and a correlation of `exp(-(distance / correlation)² / 4)`.
fn bumps(axis: &[f64], error: &LibraryError) -> Vec<Vec<f64>> {
    let (first, last) = (axis[0], axis[axis.len() - 1]);
    let width = error.correlation_nm;
    let count = ((last - first) / width).ceil() as usize + 1;
    // The squares of Gaussians of sd 1 at distance 1 add up to sqrt(pi).
    let height = error.shape / std::f64::consts::PI.powf(0.25);
    let bump = |k: usize| {
        let center = first + k as f64 * width;
        let value = |&nm: &f64| height * (-0.5 * ((nm - center) / width).powi(2)).exp();
        axis.iter().map(value).collect()
    };
    (0..count).map(bump).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::WavelengthGrid;

    use super::super::ExcitationBasis;

    fn region() -> RegionResponse {
        let grid = WavelengthGrid::uniform(400.0, 700.0, 5.0).unwrap();
        let excitation = ExcitationBasis::every(340.0, 460.0, 5.0);
        let mut radiance = Vec::new();
        for emission in grid.centers_nm() {
            for nm in excitation.centers_nm() {
                radiance.push((-((emission - 520.0) / 40.0).powi(2) - ((nm - 400.0) / 30.0).powi(2)).exp());
            }
        }
        let fluorescence = vec![FluorescenceResponse { name: "dye".into(), amount: 1.0, radiance }];
        RegionResponse { name: "x".into(), grid, excitation, fluorescence, reflected: Curve::constant(0.1) }
    }

    #[test]
    fn errors_of_the_library_have_their_standard_deviation() {
        let error = LibraryError { shape: 0.05, correlation_nm: 20.0, ..LibraryError::default() };
        let region = region();
        let nodes = region.excitation.len();
        // Light of one excitation node: what it makes the fluorophore send is a column of its matrix
        let (band, node) = (20, 12);
        let mut light = vec![0.0; nodes];
        light[node] = 1.0;
        let column: Vec<f64> =
            region.fluorescence[0].radiance.iter().skip(node).step_by(nodes).copied().collect();
        let changes_by =
            |error: &LibraryError| library_changes(&region, std::slice::from_ref(&column), &light, error);
        let changes = changes_by(&error);
        // Emission comes first: (700 - 400 - 5) / 20 and (460 - 340) / 20 Gaussians, rounded up, and one. Band and node are far
        // from both ends: the sum over Gaussians one width apart is constant to 1e-4.
        let (emission, excitation) = changes.split_at(16);
        assert_eq!(excitation.len(), 7);
        for held in [emission, excitation] {
            let variance: f64 = held.iter().map(|change| (change[band] / column[band]).powi(2)).sum();
            assert!((variance.sqrt() / 0.05 - 1.0).abs() < 1e-3, "{}", variance.sqrt());
        }
        // A shift by 2 nm on bins of 5 nm: linear interpolation is off by curvature x step²/8 < 0.4 %.
        let largest = column.iter().copied().fold(0.0, f64::max);
        let bell = |nm: f64, center: f64, width: f64| (-((nm - center) / width).powi(2)).exp();
        let shift = LibraryError { emission_shift_nm: 2.0, ..LibraryError::default() };
        let changes = changes_by(&shift);
        let excited = bell(region.excitation.centers_nm()[node], 400.0, 30.0);
        for (got, nm) in changes[0].iter().zip(region.grid.centers_nm()).skip(1) {
            let expected = (bell(nm - 2.0, 520.0, 40.0) - bell(nm, 520.0, 40.0)) * excited;
            assert!((got - expected).abs() < 4e-3 * largest, "{nm}: {got} {expected}");
        }
        let shift = LibraryError { excitation_shift_nm: 2.0, ..LibraryError::default() };
        let changes = changes_by(&shift);
        let nm = region.excitation.centers_nm()[node];
        let moved = bell(nm - 2.0, 400.0, 30.0) / bell(nm, 400.0, 30.0) - 1.0;
        for (got, sent) in changes[0].iter().zip(&column) {
            assert!((got - moved * sent).abs() < 7e-3 * largest, "{got} {}", moved * sent);
        }
    }

    #[test]
    fn a_change_is_the_difference_of_two_responses() {
        let region = region();
        let mut moved = region.clone();
        moved.fluorescence[0].radiance.iter_mut().for_each(|value| *value *= 0.9);
        moved.reflected = Curve::constant(0.08);
        let between = |moved: &RegionResponse| {
            ResponseChange::between("blood", &region, moved, ChangeGrowth::Attenuation)
        };
        let change = between(&moved).unwrap();
        assert!((change.fluorescence[0][500] + 0.1 * region.fluorescence[0].radiance[500]).abs() < 1e-12);
        assert!((change.reflected.as_ref().unwrap().at(500.0) + 0.02).abs() < 1e-12);
        // Twice the thickness leaves 0.81 of the fluorescence and 0.64 of the reflected light; in proportion it would be 0.8 and 0.6.
        let twice = change.grown(2.0, &region);
        assert!((twice.fluorescence[0][500] + 0.19 * region.fluorescence[0].radiance[500]).abs() < 1e-12);
        assert!((twice.reflected.unwrap().at(500.0) + 0.036).abs() < 1e-12);
        moved.fluorescence.clear();
        assert!(between(&moved).is_none());
    }
}
