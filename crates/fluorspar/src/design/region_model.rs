//! A region with everything about it that is not known.

use crate::spectral::Curve;

use super::design_camera::{FilteredCamera, FineBands};
use super::problem::LightChoice;
use super::region_response::{FluorescenceResponse, RegionResponse, bands_of};

/// How wrong the library of fluorophores may be: standard deviations of independent errors of each fluorophore.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LibraryError {
    /// Shift of its emission, nm. Libraries differ by 5 to 25 nm for the same molecule.
    pub emission_shift_nm: f64,
    /// Shift of its excitation, nm.
    pub excitation_shift_nm: f64,
    /// Smooth relative error of its emission and of its excitation spectrum.
    pub shape: f64,
    /// Distance over which that error is alike, nm.
    pub correlation_nm: f64,
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

    /// The same region seen with a library that may be wrong.
    #[must_use]
    pub fn with_library_error(mut self, error: &LibraryError) -> Self {
        let added = library_changes(&self.response, error);
        self.changes.extend(added);
        self
    }

    /// The region under a light, by spectrum, for each W/m² that the light gives a flat region.
    pub fn under(&self, light: &LightChoice, bands: &FineBands) -> LitRegion {
        let light = &match self.unit {
            LightUnit::Irradiance => light.spectrum.clone(),
            LightUnit::Power { .. } => light.spectrum.scaled(light.power_w / light.light),
        };
        let coefficients = self.response.excitation.coefficients(light);
        let reflected = |reflected: &Curve| light.times(reflected).bin_averages(&bands.fine);
        LitRegion {
            fluorescence: self
                .response
                .fluorescence
                .iter()
                .map(|f| bands_of(&f.radiance, &coefficients))
                .collect(),
            reflected: reflected(&self.response.reflected),
            changes: self
                .changes
                .iter()
                .map(|change| {
                    let mut all = vec![0.0; self.response.grid.len()];
                    for part in change.fluorescence.iter().filter(|part| !part.is_empty()) {
                        let bands = bands_of(part, &coefficients);
                        all.iter_mut().zip(bands).for_each(|(sum, value)| *sum += value);
                    }
                    (all, change.reflected.as_ref().map(reflected))
                })
                .collect(),
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

/// Changes of a response by errors of its library.
fn library_changes(region: &RegionResponse, error: &LibraryError) -> Vec<ResponseChange> {
    let nodes = region.excitation.centers_nm();
    let bands = region.grid.centers_nm();
    let mut changes = Vec::new();
    for (number, fluorescence) in region.fluorescence.iter().enumerate() {
        let matrix = &fluorescence.radiance;
        let mut add = |what: String, values: Vec<f64>| {
            let mut of_each = vec![Vec::new(); region.fluorescence.len()];
            of_each[number] = values;
            changes.push(ResponseChange {
                name: format!("{} {what}", fluorescence.name),
                fluorescence: of_each,
                reflected: None,
                growth: ChangeGrowth::Linear,
            });
        };
        if error.emission_shift_nm > 0.0 {
            add("emission shift".into(), shifted(matrix, &bands, &nodes, [error.emission_shift_nm, 0.0]));
        }
        if error.excitation_shift_nm > 0.0 {
            add("excitation shift".into(), shifted(matrix, &bands, &nodes, [0.0, error.excitation_shift_nm]));
        }
        if error.shape > 0.0 && error.correlation_nm > 0.0 {
            for (center, bump) in bumps(&bands, error) {
                let value = |k: usize| bump[k / nodes.len()] * matrix[k];
                add(format!("emission near {center:.0} nm"), (0..matrix.len()).map(value).collect());
            }
            for (center, bump) in bumps(&nodes, error) {
                let value = |k: usize| bump[k % nodes.len()] * matrix[k];
                add(format!("excitation near {center:.0} nm"), (0..matrix.len()).map(value).collect());
            }
        }
    }
    changes
}

/// The difference that a shift of a matrix by some nanometers of emission and excitation makes.
fn shifted(matrix: &[f64], bands: &[f64], nodes: &[f64], [emission, excitation]: [f64; 2]) -> Vec<f64> {
    let at = |axis: &[f64], nm: f64| {
        let right = axis.partition_point(|&x| x < nm).clamp(1, axis.len() - 1);
        let share = ((nm - axis[right - 1]) / (axis[right] - axis[right - 1])).clamp(0.0, 1.0);
        (right, share)
    };
    let columns = nodes.len();
    let mut difference = Vec::with_capacity(matrix.len());
    for (row, &emission_nm) in bands.iter().enumerate() {
        let (r, v) = at(bands, emission_nm - emission);
        for (col, &excitation_nm) in nodes.iter().enumerate() {
            let (c, u) = at(nodes, excitation_nm - excitation);
            let along = |r: usize| matrix[r * columns + c - 1] * (1.0 - u) + matrix[r * columns + c] * u;
            let moved = along(r - 1) * (1.0 - v) + along(r) * v;
            difference.push(moved - matrix[row * columns + col]);
        }
    }
    difference
}

/// Gaussians at distances of their own width, whose squares add up to the variance of the error: with independent unit weights
/// their sum has its standard deviation everywhere and a correlation of `exp(-(distance / correlation)² / 4)`.
fn bumps(axis: &[f64], error: &LibraryError) -> Vec<(f64, Vec<f64>)> {
    let (first, last) = (axis[0], axis[axis.len() - 1]);
    let width = error.correlation_nm;
    let count = ((last - first) / width).ceil() as usize + 1;
    // The squares of Gaussians of sd 1 at distance 1 add up to sqrt(pi).
    let height = error.shape / std::f64::consts::PI.powf(0.25);
    let bump = |k: usize| {
        let center = first + k as f64 * width;
        let value = |&nm: &f64| height * (-0.5 * ((nm - center) / width).powi(2)).exp();
        (center, axis.iter().map(value).collect())
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
        let changes = library_changes(&region, &error);
        let nodes = region.excitation.len();
        // Band 20 is far from both ends: the sum over Gaussians one width apart is constant to 1e-4.
        let k = 20 * nodes + 12;
        let variance = |kind: &str| {
            let held = changes.iter().filter(|change| change.name.contains(kind));
            held.map(|change| (change.fluorescence[0][k] / region.fluorescence[0].radiance[k]).powi(2))
                .sum::<f64>()
        };
        for kind in ["emission near", "excitation near"] {
            assert!((variance(kind).sqrt() / 0.05 - 1.0).abs() < 1e-3, "{kind} {}", variance(kind).sqrt());
        }
        // A shift by 2 nm on bins of 5 nm: linear interpolation is off by curvature x step²/8 < 0.4 %.
        let shift = LibraryError { emission_shift_nm: 2.0, ..LibraryError::default() };
        let changes = library_changes(&region, &shift);
        let bands = region.grid.centers_nm();
        let largest = region.fluorescence[0].radiance.iter().copied().fold(0.0, f64::max);
        for (row, nm) in bands.iter().enumerate().skip(1) {
            let bell = |nm: f64| (-((nm - 520.0) / 40.0).powi(2)).exp();
            let (got, expected) = (changes[0].fluorescence[0][row * nodes + 12], bell(nm - 2.0) - bell(*nm));
            assert!((got - expected).abs() < 4e-3 * largest, "{nm}: {got} {expected}");
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
