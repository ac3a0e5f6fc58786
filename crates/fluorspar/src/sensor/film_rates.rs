//! Electron rates at the samples of an image on the film, and their integrals over pixels.

use std::borrow::Cow;

use rayon::prelude::*;

use super::pixel_integration::{AxisWeights, FilmExtent, channels_in_row};
use super::relative_illumination::RelativeIllumination;
use super::{ElectronRate, Sensor, SensorProblem};
use crate::image::Mosaic;
use crate::spectral::WavelengthGrid;

/// Electrons per second that the light at each sample of an image on the film would free in a pixel of each channel, with the
/// weights of [`Sensor::film_weights`]: `[channel][row][col]`, e-/s.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmRates {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[channel][row][col]`.
    pub data: Vec<f32>,
}

impl Sensor {
    /// Electrons per second per unit of irradiance in each bin, e-/s per W/(m² nm), for every kind of plane that a frame is
    /// made of: first the channels of the quantum efficiency, then, on a sensor with electrical crosstalk, for each of them
    /// what a pixel hands to one side neighbor.
    pub fn film_weights(&self, grid: &WavelengthGrid) -> Vec<Vec<f64>> {
        let mut weights = self.weights_of(self.qe(), grid);
        let share = self.model().crosstalk.as_ref().and_then(|crosstalk| crosstalk.electrical_share());
        weights.extend(share.into_iter().flat_map(|share| self.weights_of(&self.qe().behind(&share), grid)));
        weights
    }

    /// Noise-free electron rates of all pixels from those at the samples of an image of a given extent, centered on the sensor:
    /// as [`Sensor::electron_rate_on_film`] from its spectra, pixel integration, fall-off and crosstalk included.
    ///
    /// # Errors
    /// An extent that can't be used, rates that do not have the planes of [`Sensor::film_weights`].
    pub fn electron_rate_of(
        &self,
        rates: &FilmRates,
        film: FilmExtent,
    ) -> Result<ElectronRate, SensorProblem> {
        film.validate()?;
        let own = self.mosaic().channels.len() * rates.width * rates.height;
        let crosstalk = self.model().crosstalk.as_ref();
        let is_electrical = crosstalk.is_some_and(|crosstalk| crosstalk.electrical_share().is_some());
        let needed = if is_electrical { 2 * own } else { own };
        if rates.data.len() != needed {
            let message = format!(
                "{} rates where {needed} are needed: one for each channel and film sample; form them with this sensor",
                rates.data.len()
            );
            return Err(SensorProblem::new("film rates", message));
        }
        let rate = self.integrated(&rates.data[..own], rates, film);
        let Some(crosstalk) = crosstalk else { return Ok(rate) };
        let handed =
            if is_electrical { self.integrated(&rates.data[own..], rates, film).data } else { Vec::new() };
        Ok(crosstalk.spread(&rate, &handed))
    }

    /// Pixels of the sensor over planes `[channel][row][col]`, with the fall-off.
    fn integrated(&self, planes: &[f32], rates: &FilmRates, film: FilmExtent) -> ElectronRate {
        let pixels = PixelIntegrals::new(
            self,
            (Cow::Borrowed(planes), PlaneOrder::Channels),
            [rates.width, rates.height],
            film,
        );
        let falloff = RelativeIllumination::of(self.model(), self.mosaic());
        let (columns, rows) = (self.model().columns, self.model().rows);
        let mut data = vec![0.0; columns * rows];
        data.par_chunks_exact_mut(columns).enumerate().for_each(|(row, out)| {
            pixels.fill_row(row, out);
            if let Some(falloff) = &falloff {
                falloff.apply(self.mosaic(), row, out);
            }
        });
        ElectronRate { columns, rows, data }
    }
}

/// How film samples of several channels follow each other.
#[derive(Clone, Copy, Debug)]
pub(super) enum PlaneOrder {
    /// `[channel][row][col]`.
    Channels,
    /// `[row][channel][col]`.
    Rows,
}

/// Integrals of film samples over the pixels of a sensor.
pub(super) struct PixelIntegrals<'a> {
    planes: Cow<'a, [f32]>,
    order: PlaneOrder,
    size: [usize; 2],
    mosaic: &'a Mosaic,
    across: AxisWeights,
    down: AxisWeights,
}

impl<'a> PixelIntegrals<'a> {
    pub(super) fn new(
        sensor: &'a Sensor,
        (planes, order): (Cow<'a, [f32]>, PlaneOrder),
        size: [usize; 2],
        film: FilmExtent,
    ) -> Self {
        let model = sensor.model();
        let pitch_mm = model.pixel_size_um * 1e-3;
        let aperture_mm = model.aperture_um.map_or(pitch_mm, |um| um * 1e-3);
        let across = AxisWeights::new(model.columns, pitch_mm, aperture_mm, size[0], film.width_mm);
        let down = AxisWeights::new(model.rows, pitch_mm, aperture_mm, size[1], film.height_mm);
        Self { planes, order, size, mosaic: sensor.mosaic(), across, down }
    }

    pub(super) fn mosaic(&self) -> &Mosaic {
        self.mosaic
    }

    pub(super) fn fill_row(&self, row: usize, out: &mut [f32]) {
        let [width, height] = self.size;
        let (lines, line_weights) = self.down.of(row);
        let mut line = vec![0.0f32; width];
        for channel in channels_in_row(self.mosaic, row) {
            line.fill(0.0);
            for (sample_row, weight) in lines.clone().zip(line_weights) {
                let number = match self.order {
                    PlaneOrder::Channels => channel * height + sample_row,
                    PlaneOrder::Rows => sample_row * self.mosaic.channels.len() + channel,
                };
                let samples = &self.planes[number * width..][..width];
                for (sum, value) in line.iter_mut().zip(samples) {
                    *sum += weight * value;
                }
            }
            for (col, out) in out.iter_mut().enumerate() {
                if self.mosaic.channel(row, col) == channel {
                    let (range, weights) = self.across.of(col);
                    *out = line[range]
                        .iter()
                        .zip(weights)
                        .fold(0.0, |sum, (value, weight)| sum + value * weight);
                }
            }
        }
    }
}
