//! What each channel of a camera collects of a spectral radiance, on fine samples, for any filter.

use crate::sensor::{Binning, BinningKind, Sensor, SensorModel};
use crate::spectral::{Curve, WavelengthGrid};

/// Widest fine bin, nm: filters fall by a decade in several nanometers.
const FINE_BIN_NM: f64 = 1.0;

/// Variance of the converter's rounding, DN²: an even distribution over one code.
const ROUNDING_DN2: f64 = 1.0 / 12.0;

/// Bands cut into fine bins.
#[derive(Clone, Debug, PartialEq)]
pub struct FineBands {
    /// All fine bins.
    pub fine: WavelengthGrid,
    /// Number of the band that holds each of them.
    pub band: Vec<usize>,
}

impl FineBands {
    /// Cuts the bands of a grid into bins of at most 1 nm.
    pub fn of(grid: &WavelengthGrid) -> Self {
        let (mut edges, mut band) = (vec![grid.start_nm()], Vec::new());
        for (number, edge) in grid.edges_nm().windows(2).enumerate() {
            let pieces = ((edge[1] - edge[0]) / FINE_BIN_NM - 1e-9).ceil().max(1.0) as usize;
            for piece in 1..=pieces {
                edges.push(edge[0] + (edge[1] - edge[0]) * piece as f64 / pieces as f64);
                band.push(number);
            }
        }
        // Edges rise as those of the grid do, so the only way to fail is a grid of more bins than are allowed.
        let fine = WavelengthGrid::from_edges(&edges).unwrap_or_else(|_| grid.clone());
        if fine.len() != band.len() {
            band = (0..fine.len()).collect();
        }
        Self { fine, band }
    }
}

/// A sensor behind a lens of unknown aperture, with the numbers of its noise.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignCamera {
    /// Name.
    pub name: String,
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Share of the pixels that measure each channel.
    pub shares: Vec<f64>,
    /// Variance of a read without light, e-²: noise of the readout and rounding of the converter.
    pub dark_variance_e2: f64,
    /// The same of what a row or a column shares.
    pub line_variance_e2: f64,
    /// Spread of the gains of columns, relative.
    pub column_gain: f64,
    /// Dark current, e-/s.
    pub dark_e_per_s: f64,
    /// Photo-response non-uniformity, relative.
    pub prnu: f64,
    /// Electrons of one pixel, dark ones included, at which its well or the converter is full.
    pub full_e: f64,
    /// Price, in any unit.
    pub cost: f64,
    /// Electrons per second of a pixel per W/(sr m² nm) and sr of the lens, `[channel][fine bin]`.
    weights: Vec<Vec<f64>>,
}

/// Pixels that are joined count as one, which holds the electrons of all; digital numbers have a read noise each.
struct Joined {
    pixels: f64,
    reads: f64,
    full_e: f64,
}

impl Joined {
    /// Of a sensor whose converter is full at so many electrons.
    fn of(model: &SensorModel, converter_e: f64) -> Self {
        let pixels = model.binning.map_or(1.0, |binning| binning.pixels() as f64);
        let (reads, full_e) = match model.binning {
            Some(Binning { kind: BinningKind::Charge, well_capacity_e, .. }) => {
                let node_e = well_capacity_e.unwrap_or(pixels * model.well_capacity_e);
                (1.0, (pixels * model.well_capacity_e).min(node_e).min(converter_e))
            }
            _ => (pixels, pixels * model.well_capacity_e.min(converter_e)),
        };
        Self { pixels, reads, full_e }
    }
}

impl DesignCamera {
    /// A sensor at an analog gain behind a lens of a transmittance.
    pub fn new(
        name: &str,
        sensor: &Sensor,
        gain: f64,
        lens_transmittance: &Curve,
        bands: &FineBands,
    ) -> Self {
        let model = sensor.model();
        let dn_per_e = model.base_dn_per_electron() * model.analog_gain * gain;
        let behind_lens = sensor.behind(lens_transmittance);
        let black_dn = model.black_level_dn + model.analog_offset_mv * 1e-3 / model.volts_per_dn();
        let converter_e = (f64::from(model.max_code()) - black_dn) / dn_per_e;
        let Joined { pixels: joined, reads, full_e } = Joined::of(model, converter_e);
        let of_lines_e2 =
            [model.row_noise_mv, model.column_noise_mv].map(|mv| model.electrons_of_mv(mv).powi(2));
        let of_pixel_e2 = model.dark_noise_electrons(gain).powi(2) - of_lines_e2.iter().sum::<f64>();
        let of_read_e2 = of_pixel_e2 + ROUNDING_DN2 / (dn_per_e * dn_per_e);
        let of_pixels = |weights: Vec<f64>| weights.into_iter().map(|weight| joined * weight).collect();
        Self {
            name: name.into(),
            channels: sensor.mosaic().channels.clone(),
            shares: sensor.mosaic().shares(),
            dark_variance_e2: reads * of_read_e2,
            line_variance_e2: of_lines_e2
                .iter()
                .zip(model.image_line_factors())
                .map(|(of, factor)| of * factor)
                .sum(),
            column_gain: model.image_column_gain(),
            dark_e_per_s: joined * model.dark_electrons_per_s(),
            prnu: model.image_prnu_percent() / 100.0,
            full_e,
            cost: 0.0,
            weights: behind_lens.flat_electron_weights(&bands.fine).into_iter().map(of_pixels).collect(),
        }
    }

    /// A camera of one channel behind a wheel of filters, by name: each is a channel that all pixels see, in an even share of the time.
    /// `None` for a camera of several channels, or a wheel without filters.
    pub fn behind_wheel(&self, wheel: &[(String, Curve)], bands: &FineBands) -> Option<Self> {
        let ([weights], false) = (self.weights.as_slice(), wheel.is_empty()) else { return None };
        let share = 1.0 / wheel.len() as f64;
        let through = |(_, filter): &(String, Curve)| {
            let transmittance = filter.bin_averages(&bands.fine);
            weights.iter().zip(&transmittance).map(|(w, t)| share * w * t).collect()
        };
        Some(Self {
            channels: wheel.iter().map(|(name, _)| name.clone()).collect(),
            shares: vec![1.0; wheel.len()],
            dark_e_per_s: share * self.dark_e_per_s,
            weights: wheel.iter().map(through).collect(),
            ..self.clone()
        })
    }

    /// Sensitivity of each channel to light by fine bin, relative to the largest of all.
    pub fn relative_sensitivity(&self) -> Vec<Vec<f64>> {
        let top = self.weights.iter().flatten().copied().fold(1e-300, f64::max);
        self.weights.iter().map(|weights| weights.iter().map(|w| w / top).collect()).collect()
    }

    /// The same camera behind a filter.
    pub fn behind(&self, filter: &Curve, bands: &FineBands) -> FilteredCamera {
        let transmittance = filter.bin_averages(&bands.fine);
        let through = |weights: &Vec<f64>| weights.iter().zip(&transmittance).map(|(w, t)| w * t).collect();
        let fine: Vec<Vec<f64>> = self.weights.iter().map(through).collect();
        let count = bands.band.last().map_or(0, |last| last + 1);
        let by_band = fine.iter().map(|weights| {
            let mut sums = vec![0.0; count];
            weights.iter().zip(&bands.band).for_each(|(w, &band)| sums[band] += w);
            sums
        });
        FilteredCamera { by_band: by_band.collect(), fine }
    }
}

/// A camera behind a filter: electrons per second per W/(sr m² nm) and sr.
#[derive(Clone, Debug, PartialEq)]
pub struct FilteredCamera {
    /// `[channel][band]`, for light that is even within bands, as fluorescence is.
    pub(super) by_band: Vec<Vec<f64>>,
    /// `[channel][fine bin]`, for light as steep as the filter.
    pub(super) fine: Vec<Vec<f64>>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::SpectralQe;

    /// Four pixels as one hold four times the electrons: with one read noise where charges are added, with four where numbers are.
    #[test]
    fn joined_pixels_have_the_electrons_of_all_and_the_reads_of_their_kind() {
        let grid = WavelengthGrid::from_edges(&[500.0, 510.0]).unwrap();
        let camera = |kind: Option<BinningKind>, analog_offset_mv: f64| {
            let binning = kind.map(|kind| Binning { kind, columns: 2, rows: 2, well_capacity_e: None });
            let (row_noise_mv, column_noise_mv) = (0.3, 0.4);
            let mosaic = vec![vec!["mono".into()]];
            let model = SensorModel {
                binning,
                mosaic,
                analog_offset_mv,
                row_noise_mv,
                column_noise_mv,
                column_gain_percent: 0.5,
                ..Default::default()
            };
            let qe = SpectralQe::from_curves([("mono", Curve::constant(0.6))]).unwrap();
            let sensor = Sensor::new(model, qe).unwrap();
            DesignCamera::new("camera", &sensor, 1.0, &Curve::constant(1.0), &FineBands::of(&grid))
        };
        let plain = camera(None, 0.0);
        // The converter is full before the well, and an offset takes of its room
        let taken_e = plain.full_e - camera(None, 10.0).full_e;
        assert!((taken_e / SensorModel::default().electrons_of_mv(10.0) - 1.0).abs() < 1e-9, "{taken_e}");
        // Two reads of a row are in its sum: their common noise counts twice
        for (kind, reads, lines, column_gain) in [
            (BinningKind::Charge, 1.0, 1.0, 1.0),
            (BinningKind::DigitalSum, 4.0, 8.0, 0.5f64.sqrt()),
            (BinningKind::DigitalAverage, 4.0, 8.0, 0.5f64.sqrt()),
        ] {
            let joined = camera(Some(kind), 0.0);
            let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-12, "{kind:?}: {a} {b}");
            near(joined.weights[0][0], 4.0 * plain.weights[0][0]);
            near(joined.dark_e_per_s, 4.0 * plain.dark_e_per_s);
            near(joined.dark_variance_e2, reads * plain.dark_variance_e2);
            near(joined.line_variance_e2, lines * plain.line_variance_e2);
            near(joined.prnu, 0.5 * plain.prnu);
            near(joined.column_gain, column_gain * plain.column_gain);
            assert!(joined.full_e <= 4.0 * plain.full_e && joined.full_e >= plain.full_e, "{kind:?}");
        }
    }
}
