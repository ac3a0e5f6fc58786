//! Fluorescence matrices of pbrt-v3-spectral.
//!
//! A `photolumi` holds a first wavelength, a step and a last one, then a square matrix `F` row by row, rows emission and
//! columns excitation. Its toolbox multiplies it with band values of irradiance, without the step:
//! `M_o = sum_i F_oi E_i`, in energy. As a density that is `F / step` within the square of each pair of bands.

use fluorspar::spectral::{EemTable, EnergyEem, Fluorophore, PhotonEem, Stokes, WavelengthGrid};
use fluorspar_format::{PbrtError, PbrtParameter};

use crate::convert::Convert;

/// Most bands of a matrix.
const MOST_BANDS: usize = 1000;

/// Points along each side of a pair of bands at which a yield is averaged.
const WITHIN: usize = 4;

/// Width of the flanks of a band, nm.
const FLANK_NM: f64 = 1e-3;

/// Samples per band at which the renderer integrates a matrix of 5 nm bands: one every 0.5 nm.
const SAMPLES_PER_BAND: f64 = 10.0;

impl Convert<'_> {
    /// Makes the fluorophore of a matrix, or finds it, and gives its number.
    pub(crate) fn photolumi(&mut self, name: &str, parameter: &PbrtParameter) -> Result<usize, PbrtError> {
        let at = parameter.at;
        let numbers = parameter.numbers().unwrap_or_default();
        let [first, step, last, matrix @ ..] = numbers else {
            return Err(self.error(
                at,
                "photolumi takes first wavelength, step and last wavelength (nm), then the matrix",
            ));
        };
        let (first, step, last) = (*first, *step, *last);
        let is_grid = step > 0.0 && last > first && first >= 100.0 && last <= 20_000.0;
        let bands = if is_grid { ((last - first) / step).round() + 1.0 } else { 0.0 };
        if !(2.0..=MOST_BANDS as f64).contains(&bands) {
            let message = format!(
                "wavelengths from {first} to {last} nm by {step} nm do not form bands; give 2 to {MOST_BANDS} bands with a positive step"
            );
            return Err(self.error(at, message));
        }
        let bands = bands as usize;
        if matrix.len() != bands * bands {
            let message = format!(
                "the matrix of {bands} x {bands} bands needs {} numbers after the wavelengths; it has {}",
                bands * bands,
                matrix.len()
            );
            return Err(self.error(at, message));
        }
        if matrix.iter().any(|value| *value < 0.0) {
            self.remark(at, "the fluorescence matrix has values below 0; they count as 0");
        }
        self.note(
            at,
            format!(
                "the fluorescence matrix is energy per band of {step} nm, applied without the step as pbrt-v3-spectral does; \
                 it is divided by {step} nm to a yield density"
            ),
        );
        let eem = photon_eem(first, step, bands, matrix, &self.options.grid)
            .map_err(|error| self.error(at, error.to_string()))?;
        if let Some(known) = self.fluorophores.iter().position(|other| other.eem == eem) {
            return Ok(known);
        }
        let range = (first - 0.5 * step, last + 0.5 * step);
        let main = self.tree.files.first().map_or_else(String::new, |file| file.display().to_string());
        let taken = |name: &str| self.fluorophores.iter().any(|other| other.name == name);
        let mut unique = name.to_string();
        let mut number = 2;
        while taken(&unique) {
            unique = format!("{name}_{number}");
            number += 1;
        }
        self.fluorophores.push(Fluorophore {
            title: unique.clone(),
            name: unique,
            eem,
            excitation_range_nm: range,
            emission_range_nm: range,
            source: main,
        });
        Ok(self.fluorophores.len() - 1)
    }
}

/// Bands of one width.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bands {
    /// Middle of the first one.
    pub(crate) first_nm: f64,
    pub(crate) step_nm: f64,
    pub(crate) count: usize,
}

impl Bands {
    /// The bins of a grid where they are even, else bands of the narrowest bin between its ends, as far as a matrix may have so many.
    pub(crate) fn of(grid: &WavelengthGrid) -> Self {
        let span = grid.end_nm() - grid.start_nm();
        let narrowest = grid.widths_nm().into_iter().fold(f64::INFINITY, f64::min);
        let count = ((span / narrowest).round() as usize).clamp(2, MOST_BANDS);
        let step_nm = span / count as f64;
        Self { first_nm: grid.start_nm() + 0.5 * step_nm, step_nm, count }
    }

    pub(crate) fn last_nm(self) -> f64 {
        self.first_nm + (self.count - 1) as f64 * self.step_nm
    }
}

/// A sum of fluorophores as the matrix of a `photolumi`: means of the energy yield density over each pair of bands, times the step.
pub(crate) fn band_matrix(parts: &[(f64, &PhotonEem)], bands: Bands) -> Vec<f64> {
    let Bands { first_nm, step_nm, count } = bands;
    let fine: Vec<f64> =
        (0..count * WITHIN).map(|n| first_nm + step_nm * ((n as f64 + 0.5) / WITHIN as f64 - 0.5)).collect();
    let mut matrix = vec![0.0; count * count];
    for (amount, eem) in parts {
        for (row, emission) in fine.chunks_exact(WITHIN).enumerate() {
            for (number, density) in eem.densities(emission, &fine).into_iter().enumerate() {
                let (out_nm, in_nm) = (emission[number / fine.len()], fine[number % fine.len()]);
                let mean = step_nm / (WITHIN * WITHIN) as f64;
                matrix[row * count + number % fine.len() / WITHIN] +=
                    amount * density * in_nm / out_nm * mean;
            }
        }
    }
    matrix
}

/// The matrix as a density that is constant within each pair of bands.
fn photon_eem(
    first: f64,
    step: f64,
    bands: usize,
    matrix: &[f64],
    grid: &WavelengthGrid,
) -> Result<PhotonEem, fluorspar::spectral::EemError> {
    let nodes = nodes(first, step, bands);
    let ends_with_render =
        [grid.start_nm() >= nodes[0] - 1e-6, grid.end_nm() <= nodes[nodes.len() - 1] + 1e-6];
    let density = |row: usize, column: usize| matrix[row * bands + column].max(0.0) / step;
    let columns: Vec<Vec<f64>> = (0..bands)
        .map(|column| emission_steps(&(0..bands).map(|row| density(row, column)).collect::<Vec<_>>()))
        .collect();
    let row_of = |row: usize| columns.iter().map(|column| column[row]).collect::<Vec<_>>();
    let values = (0..nodes.len()).flat_map(|row| excitation_steps(&row_of(row), ends_with_render)).collect();
    let table = EemTable { emission_nm: nodes.clone(), excitation_nm: nodes, values };
    Ok(EnergyEem::table(table, Stokes::Off)?.to_photon())
}

/// Band values along the emission, as heights at the nodes of a piecewise linear function with steep flanks.
///
/// The renderer averages emission over bands by the trapezoidal rule on samples every 0.5 nm, the edges of bands included. So the
/// height at an edge lies between the values beside it, and those within a band are raised or lowered by what the edges take
/// from or add to its ten intervals: then the mean over every band is its value, to rounding, and where the matrix breaks off
/// nothing leaks into the next band.
fn emission_steps(values: &[f64]) -> Vec<f64> {
    let edge = |left: f64, right: f64| (0.5 * (left + right)).min(5.0 * left.min(right));
    steps(values, edge, |low, value, high| {
        (SAMPLES_PER_BAND * value - 0.5 * (low + high)) / (SAMPLES_PER_BAND - 1.0)
    })
}

/// Band values along the excitation. Integrals over all of it are those of the bands: what an edge takes from one, it gives to
/// the other. `ends_with_render` says whether the bands of the render end below the first and above the last band; there
/// nothing takes the other half.
fn excitation_steps(values: &[f64], ends_with_render: [bool; 2]) -> Vec<f64> {
    let mut heights = steps(values, |left, right| 0.5 * (left + right), |_, value, _| value);
    if let (Some(first), true) = (heights.first_mut(), ends_with_render[0]) {
        *first *= 2.0;
    }
    if let (Some(last), true) = (heights.last_mut(), ends_with_render[1]) {
        *last *= 2.0;
    }
    heights
}

/// Heights at the nodes of bands: at their lower edges, and behind and before their flanks.
fn steps(values: &[f64], edge: impl Fn(f64, f64) -> f64, inner: impl Fn(f64, f64, f64) -> f64) -> Vec<f64> {
    let at = |band: usize| values.get(band).copied().unwrap_or(0.0);
    let mut heights = Vec::with_capacity(3 * values.len() + 1);
    for (band, &value) in values.iter().enumerate() {
        let low = edge(if band == 0 { 0.0 } else { at(band - 1) }, value);
        let high = edge(value, at(band + 1));
        let height = inner(low, value, high);
        heights.extend([low, height, height]);
        if band + 1 == values.len() {
            heights.push(high);
        }
    }
    heights
}

/// The nodes of bands, nm.
fn nodes(first: f64, step: f64, bands: usize) -> Vec<f64> {
    let edge = |band: usize| first + (band as f64 - 0.5) * step;
    let inner = (0..bands).flat_map(|band| [edge(band), edge(band) + FLANK_NM, edge(band + 1) - FLANK_NM]);
    inner.chain([edge(bands)]).collect()
}

#[cfg(test)]
mod tests {
    use fluorspar::spectral::{Curve, WavelengthGrid};

    use super::*;

    /// `M_o = sum_i F_oi E_i` for even light, band by band, though the matrix breaks off at its diagonal.
    #[test]
    fn bands_of_exitance_are_sums_over_the_matrix() {
        let bands = 20;
        let value = |row: usize, column: usize| {
            if row <= column { 0.0 } else { 1e-3 * (1.0 + (row * 7 % 5) as f64) / (1.0 + column as f64) }
        };
        let matrix: Vec<f64> = (0..bands * bands).map(|i| value(i / bands, i % bands)).collect();
        let grid = WavelengthGrid::uniform(400.0, 495.0, 5.0).unwrap();
        let eem = photon_eem(400.0, 5.0, bands, &matrix, &grid).unwrap();
        let photons = Curve::from_fn(397.5, 497.5, |nm| nm);
        let exitance = eem.photon_exitance(&photons, (397.5, 497.5));
        let energy: Vec<f64> =
            exitance.wavelengths_nm().iter().zip(exitance.values()).map(|(nm, value)| value / nm).collect();
        let energy = Curve::new(exitance.wavelengths_nm().to_vec(), energy).unwrap();
        for row in 0..bands {
            let expected: f64 = (0..bands).map(|column| value(row, column)).sum();
            let start = 397.5 + 5.0 * row as f64;
            let found = energy.integral(start, start + 5.0) / 5.0;
            assert!((found - expected).abs() < 1e-4 * expected.max(1e-3), "{row}: {found} {expected}");
        }
    }

    #[test]
    fn no_height_is_negative() {
        for values in [[0.0, 1.0, 0.0, 0.0], [1e-6, 1.0, 1e-6, 0.5], [1.0, 0.0, 0.0, 1.0]] {
            let heights = [emission_steps(&values), excitation_steps(&values, [true, false])].concat();
            assert!(heights.iter().all(|height| *height >= 0.0), "{heights:?}");
        }
        let nodes = nodes(400.0, 5.0, 4);
        assert!(nodes.is_sorted() && nodes.len() == 13 && nodes[12] == 417.5, "{nodes:?}");
    }
}
