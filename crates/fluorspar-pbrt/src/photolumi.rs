//! Fluorescence matrices of pbrt-v3-spectral.
//!
//! A `photolumi` holds a first wavelength, a step and a last one, then a square matrix `F` row by row, rows emission and
//! columns excitation. Its toolbox multiplies it with band values of irradiance, without the step:
//! `M_o = sum_i F_oi E_i`, in energy. As a density that is `F / step` within the square of each pair of bands.

use fluorspar::spectral::{EemTable, EnergyEem, Fluorophore, PhotonEem, Stokes};
use fluorspar_format::{PbrtError, PbrtParameter};

use crate::convert::Convert;

/// Most bands of a matrix.
const MOST_BANDS: usize = 1000;

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
                "wavelengths from {first} to {last} nm by {step} nm are no bands; give 2 to {MOST_BANDS} of them"
            );
            return Err(self.error(at, message));
        }
        let bands = bands as usize;
        if matrix.len() != bands * bands {
            let message = format!(
                "{} numbers don't fill the matrix of {bands} x {bands} bands; {} are needed after the wavelengths",
                matrix.len(),
                bands * bands
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
        let eem =
            photon_eem(first, step, bands, matrix).map_err(|error| self.error(at, error.to_string()))?;
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

/// The matrix as a density that is constant within each pair of bands.
fn photon_eem(
    first: f64,
    step: f64,
    bands: usize,
    matrix: &[f64],
) -> Result<PhotonEem, fluorspar::spectral::EemError> {
    // Along the emission, column by column, then along the excitation, row by row.
    let mut nodes = Vec::new();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for column in 0..bands {
        let values: Vec<f64> = (0..bands).map(|row| matrix[row * bands + column].max(0.0) / step).collect();
        let (at, stepped) = steps(first, step, &values);
        nodes = at;
        columns.push(stepped);
    }
    let mut values = Vec::with_capacity(nodes.len() * nodes.len());
    for row in 0..nodes.len() {
        let along: Vec<f64> = columns.iter().map(|column| column[row]).collect();
        values.extend(steps(first, step, &along).1);
    }
    let table = EemTable { emission_nm: nodes.clone(), excitation_nm: nodes, values };
    Ok(EnergyEem::table(table, Stokes::Off)?.to_photon())
}

/// Band values as nodes of a piecewise linear function with steep flanks.
///
/// The renderer integrates tables by the trapezoidal rule on samples every 0.5 nm, the edges of bands included. So the value
/// at an edge lies between those beside it, and those within a band are raised or lowered by what the edges take from or
/// add to its ten intervals: then the mean over every band is its value, to rounding.
fn steps(first: f64, step: f64, values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let outside = 0.0;
    let edge = |left: f64, right: f64| (0.5 * (left + right)).min(5.0 * left.min(right));
    let (mut nodes, mut heights) = (Vec::new(), Vec::new());
    for (band, &value) in values.iter().enumerate() {
        let left = if band == 0 { outside } else { values[band - 1] };
        let right = values.get(band + 1).copied().unwrap_or(outside);
        let (low, high) = (edge(left, value), edge(value, right));
        let inner = (SAMPLES_PER_BAND * value - 0.5 * (low + high)) / (SAMPLES_PER_BAND - 1.0);
        let start = first + (band as f64 - 0.5) * step;
        nodes.extend([start, start + FLANK_NM, start + step - FLANK_NM]);
        heights.extend([low, inner, inner]);
        if band + 1 == values.len() {
            nodes.push(start + step);
            heights.push(high);
        }
    }
    (nodes, heights)
}

#[cfg(test)]
mod tests {
    use fluorspar::spectral::Curve;

    use super::*;

    /// `M_o = sum_i F_oi E_i` for even light, band by band, though the matrix breaks off at its diagonal.
    #[test]
    fn bands_of_exitance_are_sums_over_the_matrix() {
        let bands = 20;
        let value = |row: usize, column: usize| {
            if row <= column { 0.0 } else { 1e-3 * (1.0 + (row * 7 % 5) as f64) / (1.0 + column as f64) }
        };
        let matrix: Vec<f64> = (0..bands * bands).map(|i| value(i / bands, i % bands)).collect();
        let eem = photon_eem(400.0, 5.0, bands, &matrix).unwrap();
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
    fn no_node_is_negative() {
        for values in [vec![0.0, 1.0, 0.0], vec![1e-6, 1.0, 1e-6, 0.5], vec![1.0, 0.0, 0.0, 1.0]] {
            let (nodes, heights) = steps(400.0, 5.0, &values);
            assert!(heights.iter().all(|height| *height >= 0.0) && nodes.is_sorted(), "{heights:?}");
        }
    }
}
