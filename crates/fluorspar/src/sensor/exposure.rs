//! A sensor with its quantum efficiency, and the exposure of one frame.

use std::borrow::Cow;
use std::cmp::Ordering;

use rayon::prelude::*;

use super::film_rates::{PixelIntegrals, PlaneOrder};
use super::isetcam::IsetcamChain;
use super::physical_chain::PhysicalChain;
use super::pixel_integration::{FilmExtent, dot};
use super::readout::Readout;
use super::relative_illumination::RelativeIllumination;
use super::shutter::Timing;
use super::{BinningKind, SensorMode, SensorModel, SensorProblem, ShutterKind, SpectralQe};
use crate::image::{Mosaic, SensorImage, SpectralImage};
use crate::spectral::{Curve, Irradiance, WavelengthGrid};

/// How one frame is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposure {
    /// Exposure time, s.
    pub time_s: f64,
    /// Gain on top of the model's analog gain.
    pub gain: f64,
    /// Seed of the temporal noise.
    pub seed: u64,
    /// Number of the frame: repeats of one exposure differ in it.
    pub frame: u64,
    /// Name of the frame, for instance "blue". Frames of different names have independent noise.
    pub label: String,
}

impl Default for Exposure {
    /// 30 ms at gain 1.
    fn default() -> Self {
        Self { time_s: 0.03, gain: 1.0, seed: 0, frame: 0, label: String::new() }
    }
}

/// Shortest and longest exposure, ms: a nanosecond and an hour.
pub const EXPOSURE_MS: [f64; 2] = [1e-6, 3.6e6];
/// Smallest and largest gain of an exposure.
pub(super) const GAIN: [f64; 2] = [0.01, 1e3];

impl Exposure {
    /// Checks time and gain.
    ///
    /// # Errors
    /// A time that is neither 0 nor from a nanosecond to an hour, or a gain that is not from 0.01 to 1000.
    pub fn validate(&self) -> Result<(), SensorProblem> {
        if self.time_s != 0.0 {
            let range_s = EXPOSURE_MS.map(|ms| ms * 1e-3);
            let hint = "give seconds, or 0 for the offset alone";
            SensorProblem::unless_within("exposure.time_s", self.time_s, range_s, hint)?;
        }
        SensorProblem::unless_within("exposure.gain", self.gain, GAIN, "give 1 for the base gain")
    }
}

/// Electrons per second that light frees in each pixel, before any noise: `[row, col]`.
#[derive(Clone, Debug, PartialEq)]
pub struct ElectronRate {
    /// Columns.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Rates, e-/s.
    pub data: Vec<f32>,
}

/// The chain of equations that the model's mode selects.
pub(super) enum Chain {
    Physical(Box<PhysicalChain>),
    Isetcam(IsetcamChain),
}

impl Chain {
    pub(super) fn new(sensor: &Sensor, exposure: &Exposure) -> Self {
        let model = &sensor.model;
        IsetcamChain::of(model, exposure).map_or_else(
            || Self::Physical(Box::new(PhysicalChain::new(model, &sensor.readout, exposure))),
            Self::Isetcam,
        )
    }

    pub(super) fn full_scale_e(&self) -> f64 {
        match self {
            Self::Physical(chain) => chain.full_scale_e(),
            Self::Isetcam(chain) => chain.full_scale_e(),
        }
    }

    /// A raw image; the function fills in the electron rates of a row of the sensor.
    /// Black level, white level, DN per electron and read noise (DN) of its images.
    fn levels(&self) -> (f64, u16, f64, f64) {
        match self {
            Self::Physical(c) => (c.black_dn(), c.white_level(), c.dn_per_electron(), c.read_noise_dn()),
            Self::Isetcam(c) => (c.black_dn(), c.white_level(), c.dn_per_electron(), c.read_noise_dn()),
        }
    }

    fn image(
        &self,
        sensor: &Sensor,
        exposure: &Exposure,
        fill: impl Fn(usize, &mut [f32]) + Sync,
    ) -> SensorImage {
        let (black_level, white_level, dn_per_electron, read_noise_dn) = self.levels();
        let (model, readout) = (&sensor.model, &sensor.readout);
        let mut data = vec![0; readout.columns * readout.rows];
        let rows = data.par_chunks_exact_mut(readout.columns).enumerate();
        rows.for_each_init(Vec::new, |rates, (row, out)| {
            rates.resize(model.columns, 0.0);
            self.expose_row(readout, row, rates, &fill, out);
        });
        SensorImage {
            width: readout.columns,
            height: readout.rows,
            data,
            mosaic: readout.mosaic(&sensor.mosaic),
            black_level,
            black_offsets: Vec::new(),
            white_levels: Vec::new(),
            factors: Vec::new(),
            orientation: crate::image::Orientation::default(),
            white_level,
            bit_depth: bits_of(sensor),
            exposure_s: exposure.time_s,
            gain: model.analog_gain * exposure.gain,
            dn_per_electron,
            read_noise_dn,
            gain_is_assumed: false,
            seed: exposure.seed,
            label: exposure.label.clone(),
        }
    }

    /// One row of the raw image.
    fn expose_row(
        &self,
        readout: &Readout,
        row: usize,
        rates: &mut [f32],
        fill: impl Fn(usize, &mut [f32]),
        out: &mut [u16],
    ) {
        let first = readout.first_column;
        match (self, &readout.binning) {
            (Self::Isetcam(chain), _) => {
                let row = readout.first_row + row;
                fill(row, rates);
                chain.expose_row(row, first, rates, out);
            }
            (Self::Physical(chain), None) => {
                let row = readout.first_row + row;
                fill(row, rates);
                chain.expose_row(row, first, &rates[first..first + out.len()], out);
            }
            (Self::Physical(chain), Some(binning)) if binning.kind == BinningKind::Charge => {
                // Collect the charges of the joined pixels, and read their sum once
                let mut charges = vec![0.0; out.len()];
                let mut read_row = readout.first_row;
                for (index, row) in readout.rows_of(row).enumerate() {
                    if index == 0 {
                        read_row = row;
                    }
                    fill(row, rates);
                    for (col, charge) in charges.iter_mut().enumerate() {
                        *charge += chain.collect(row, readout.columns_of(col), rates);
                    }
                }
                for (col, (charge, out)) in charges.iter().zip(out).enumerate() {
                    let read_column = readout.columns_of(col).next().unwrap_or(first);
                    *out = chain.read(read_row, read_column, *charge);
                }
            }
            (Self::Physical(chain), Some(binning)) => {
                // Read every pixel, and add or average the codes
                let mut sums = vec![0u32; out.len()];
                let mut codes = vec![0u16; rates.len()];
                for row in readout.rows_of(row) {
                    fill(row, rates);
                    chain.expose_row(row, 0, rates, &mut codes);
                    for (col, sum) in sums.iter_mut().enumerate() {
                        *sum += readout.columns_of(col).map(|col| u32::from(codes[col])).sum::<u32>();
                    }
                }
                let divisor = match binning.kind {
                    BinningKind::DigitalAverage => binning.pixels() as u32,
                    BinningKind::DigitalSum | BinningKind::Charge => 1,
                };
                for (sum, out) in sums.into_iter().zip(out) {
                    *out = ((sum + divisor / 2) / divisor) as u16;
                }
            }
        }
    }
}

/// Bits that the numbers of a raw image need.
fn bits_of(sensor: &Sensor) -> u8 {
    let model = &sensor.model;
    match &model.binning {
        Some(binning) if binning.kind == BinningKind::DigitalSum => {
            let largest = u32::from(model.max_code()) * binning.pixels() as u32;
            (u32::BITS - largest.leading_zeros()) as u8
        }
        // ISETCam's converter has one code more than its bits count
        _ => model.bit_depth + u8::from(matches!(model.mode, SensorMode::Isetcam { .. })),
    }
}

/// A sensor: its data sheet and the quantum efficiency of its channels, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    model: SensorModel,
    qe: SpectralQe,
    mosaic: Mosaic,
    readout: Readout,
}

impl Sensor {
    /// Time of an exposure in which light falls on a pixel, s: what a strobe leaves of it, in the first row.
    pub fn light_s(&self, exposure_s: f64) -> f64 {
        Timing { shutter: self.model.shutter, strobe: self.model.strobe }.light_s(0, exposure_s)
    }

    /// Time that lamps are on for an exposure, s: the pulse of a strobe, else from the first row's exposure to the end of the last one's.
    pub fn lamp_on_s(&self, exposure_s: f64) -> f64 {
        let binned = self.readout.binning.map_or(1, |binning| binning.rows);
        let last_row = (self.readout.rows * binned).saturating_sub(1);
        let rolling_s = match self.model.shutter.kind {
            ShutterKind::Global => 0.0,
            ShutterKind::Rolling => last_row as f64 * self.model.shutter.row_time_us * 1e-6,
        };
        let frame_s = exposure_s + rolling_s;
        self.model.strobe.map_or(frame_s, |strobe| strobe.pulse_s(frame_s))
    }

    /// Electrons behind a value of a frame for each electron per second in a pixel, s: [`Self::light_s`] times the pixels that are joined.
    pub fn frame_light_s(&self, exposure_s: f64) -> f64 {
        self.readout.binning.map_or(1.0, |binning| binning.pixels() as f64) * self.light_s(exposure_s)
    }

    /// Joins a model and its quantum efficiency.
    ///
    /// # Errors
    /// A parameter that can't be used, or a mosaic and a quantum efficiency that don't name the same channels.
    pub fn new(model: SensorModel, qe: SpectralQe) -> Result<Self, SensorProblem> {
        model.validate()?;
        if let Some(sheet) = &model.emva1288 {
            sheet.check_efficiency(&qe)?;
        }
        let model = model.with_data_sheet()?;
        let names: Vec<String> = qe.channels().iter().map(|channel| channel.name.clone()).collect();
        let mut pattern = Vec::new();
        for name in model.mosaic.iter().flatten() {
            let Some(channel) = qe.find(name).and_then(|channel| u8::try_from(channel).ok()) else {
                let message = format!(
                    "no quantum efficiency for channel \"{name}\"; there is one for {}",
                    names.join(", ")
                );
                return Err(SensorProblem::new("mosaic", message));
            };
            pattern.push(channel);
        }
        if let Some(unused) = (0..names.len()).find(|&channel| !pattern.contains(&(channel as u8))) {
            let message =
                "no pixel of the mosaic has this channel; leave the curve out or add it to the mosaic";
            return Err(SensorProblem::new(format!("quantum_efficiency.{}", names[unused]), message));
        }
        let (rows, cols) = (model.mosaic.len(), model.mosaic[0].len());
        let readout = Readout::of(&model)?;
        Ok(Self { mosaic: Mosaic { rows, cols, pattern, channels: names }, model, qe, readout })
    }

    /// The model; a data sheet after EMVA 1288 has become part of it.
    pub fn model(&self) -> &SensorModel {
        &self.model
    }

    /// Columns and rows of the raw images.
    pub fn image_size(&self) -> [usize; 2] {
        [self.readout.columns, self.readout.rows]
    }

    /// The same sensor behind one more filter, for instance one of a filter wheel.
    #[must_use]
    pub fn behind(&self, filter: &Curve) -> Self {
        Self { qe: self.qe.behind(filter), ..self.clone() }
    }

    /// Quantum efficiency that a uniform field sees at the center of the sensor: crosstalk included, averaged over the
    /// places of a channel in the mosaic.
    pub fn effective_qe(&self) -> SpectralQe {
        match &self.model.crosstalk {
            Some(crosstalk) => crosstalk.mixed(&self.qe, &self.mosaic),
            None => self.qe.clone(),
        }
    }

    /// The same sensor with the optical crosstalk everywhere that pixels of its raw images have on average.
    #[must_use]
    pub fn as_pixels_see(&self, pixels: &[usize]) -> Cow<'_, Self> {
        let Some(crosstalk) = self.model.crosstalk.as_ref().filter(|it| it.optical_edge_factor != 1.0) else {
            return Cow::Borrowed(self);
        };
        let (model, readout) = (&self.model, &self.readout);
        let joined = readout.binning.map_or([1, 1], |binning| [binning.columns, binning.rows]);
        let first = [readout.first_column, readout.first_row];
        let from_center = |at: usize, axis: usize| {
            let size = [model.columns, model.rows][axis] as f64;
            first[axis] as f64 + (at as f64 + 0.5) * joined[axis] as f64 - 0.5 * size
        };
        let radius2 = |pixel: &usize| {
            from_center(pixel % readout.columns, 0).powi(2) + from_center(pixel / readout.columns, 1).powi(2)
        };
        let corner2 = 0.25 * ((model.columns * model.columns + model.rows * model.rows) as f64);
        let mean = pixels.iter().map(radius2).sum::<f64>() / (corner2 * pixels.len().max(1) as f64);
        let mut sensor = self.clone();
        sensor.model.crosstalk = Some(crosstalk.at(mean));
        Cow::Owned(sensor)
    }

    /// The quantum efficiency.
    pub fn qe(&self) -> &SpectralQe {
        &self.qe
    }

    /// The color filter array of the whole sensor; channels are in the order of the quantum efficiency.
    pub fn mosaic(&self) -> &Mosaic {
        &self.mosaic
    }

    /// The extent of film that covers the sensor exactly.
    pub fn film_extent(&self) -> FilmExtent {
        FilmExtent { width_mm: self.model.width_mm(), height_mm: self.model.height_mm() }
    }

    /// Electrons per second per unit of irradiance in each bin, by channel, e-/s per W/(m² nm), without crosstalk.
    pub fn electron_weights(&self, grid: &WavelengthGrid) -> Vec<Vec<f64>> {
        self.weights_of(&self.qe, grid)
    }

    pub(super) fn weights_of(&self, qe: &SpectralQe, grid: &WavelengthGrid) -> Vec<Vec<f64>> {
        let area_m2 = self.model.collecting_area_m2();
        let isetcam = matches!(self.model.mode, SensorMode::Isetcam { .. });
        let weights = |channel| {
            if isetcam {
                qe.isetcam_electron_weights(channel, grid, area_m2)
            } else {
                qe.electron_weights(channel, grid, area_m2)
            }
        };
        (0..qe.channels().len()).map(weights).collect()
    }

    /// Noise-free electron rates under an irradiance image that covers the sensor exactly.
    pub fn electron_rate(&self, irradiance: &SpectralImage<Irradiance>) -> ElectronRate {
        self.rate_on(irradiance, self.film_extent())
    }

    /// Noise-free electron rates under an irradiance image of a given extent, centered on the sensor. Pixels
    /// integrate over their full pitch (the fill factor scales the result), light is conserved at any ratio of
    /// sample to pixel, and pixels beyond the film are dark.
    ///
    /// # Errors
    /// An extent that can't be used.
    pub fn electron_rate_on_film(
        &self,
        irradiance: &SpectralImage<Irradiance>,
        film: FilmExtent,
    ) -> Result<ElectronRate, SensorProblem> {
        film.validate()?;
        Ok(self.rate_on(irradiance, film))
    }

    fn rate_on(&self, irradiance: &SpectralImage<Irradiance>, film: FilmExtent) -> ElectronRate {
        let rate = self.rate_of(&RateSource::new(self, &self.qe, irradiance, film));
        let Some(crosstalk) = &self.model.crosstalk else { return rate };
        let electrical = crosstalk.electrical_share().map(|share| {
            // Electrons that a pixel hands over: its own efficiency times the share, wavelength by wavelength.
            self.rate_of(&RateSource::new(self, &self.qe.behind(&share), irradiance, film)).data
        });
        crosstalk.spread(&rate, &electrical.unwrap_or_default())
    }

    fn rate_of(&self, source: &RateSource<'_>) -> ElectronRate {
        let (columns, rows) = (self.model.columns, self.model.rows);
        let mut data = vec![0.0; columns * rows];
        data.par_chunks_exact_mut(columns).enumerate().for_each(|(row, out)| source.fill_row(row, out));
        ElectronRate { columns, rows, data }
    }

    /// Mean electron rates of each pixel over its own exposure, of light that changes in steps: from each of the rising
    /// `times_s` on, s, hold the rates that `rate_from` returns for its index; the first hold before its time too, the last
    /// for ever. Time 0 is the start of the first row's exposure. With a rolling shutter rows see different steps. One step
    /// is in memory at a time.
    ///
    /// # Errors
    /// No times, times that do not rise, rates of another sensor's size, an exposure that can't be used; what `rate_from`
    /// reports.
    pub fn rate_over_time<E: From<SensorProblem>>(
        &self,
        times_s: &[f64],
        exposure: &Exposure,
        mut rate_from: impl FnMut(usize) -> Result<ElectronRate, E>,
    ) -> Result<ElectronRate, E> {
        exposure.validate()?;
        if times_s.is_empty() {
            return Err(SensorProblem::new("times", "there is none; give one at least").into());
        }
        if times_s.windows(2).any(|pair| pair[1].partial_cmp(&pair[0]) != Some(Ordering::Greater)) {
            return Err(SensorProblem::new("times", "they do not rise; sort them").into());
        }
        let (columns, rows) = (self.model.columns, self.model.rows);
        let timing = Timing { shutter: self.model.shutter, strobe: self.model.strobe };
        let mut data = vec![0.0f32; columns * rows];
        for (index, start) in times_s.iter().enumerate() {
            let rate = rate_from(index)?;
            self.check_size(&rate)?;
            let from = if index == 0 { f64::NEG_INFINITY } else { *start };
            let to = times_s.get(index + 1).map_or(f64::INFINITY, |next| *next);
            // Add the share of each row's light that falls into this step.
            data.par_chunks_exact_mut(columns).enumerate().for_each(|(row, out)| {
                let read = row.saturating_sub(self.readout.first_row);
                let total_s = timing.light_s(read, exposure.time_s);
                let share = if total_s > 0.0 {
                    (timing.light_s_between(read, exposure.time_s, [from, to]) / total_s) as f32
                } else {
                    // A row without light takes the rates of the first step.
                    f32::from(u8::from(index == 0))
                };
                for (out, rate) in out.iter_mut().zip(&rate.data[row * columns..]) {
                    *out += share * rate;
                }
            });
        }
        Ok(ElectronRate { columns, rows, data })
    }

    /// Rates of the pixels of the region that is read; all of them where the rates are not those of the whole sensor.
    pub(super) fn rates_that_are_read(&self, rate: &ElectronRate) -> Vec<f32> {
        let Some([first, row, width, height]) = self.model.region_px else { return rate.data.clone() };
        if self.check_size(rate).is_err() {
            return rate.data.clone();
        }
        let rows = rate.data.chunks_exact(self.model.columns).skip(row).take(height);
        rows.flat_map(|rates| &rates[first..first + width]).copied().collect()
    }

    fn check_size(&self, rate: &ElectronRate) -> Result<(), SensorProblem> {
        let (columns, rows) = (self.model.columns, self.model.rows);
        if rate.columns == columns && rate.rows == rows && rate.data.len() == columns * rows {
            return Ok(());
        }
        let message = format!(
            "rates of {} by {} pixels on a sensor of {columns} by {rows}; compute them with this sensor",
            rate.columns, rate.rows
        );
        Err(SensorProblem::new("electron rate", message))
    }

    /// Takes a frame of an irradiance image that covers the sensor exactly.
    ///
    /// # Errors
    /// A time or gain that can't be used.
    pub fn expose(
        &self,
        irradiance: &SpectralImage<Irradiance>,
        exposure: &Exposure,
    ) -> Result<SensorImage, SensorProblem> {
        self.expose_film(irradiance, self.film_extent(), exposure)
    }

    /// Takes a frame of an irradiance image of a given extent, centered on the sensor.
    ///
    /// # Errors
    /// A time, gain or extent that can't be used.
    pub fn expose_film(
        &self,
        irradiance: &SpectralImage<Irradiance>,
        film: FilmExtent,
        exposure: &Exposure,
    ) -> Result<SensorImage, SensorProblem> {
        exposure.validate()?;
        film.validate()?;
        if self.model.crosstalk.is_some() {
            return self.expose_rate(&self.rate_on(irradiance, film), exposure);
        }
        let source = RateSource::new(self, &self.qe, irradiance, film);
        Ok(Chain::new(self, exposure).image(self, exposure, |row, rates| source.fill_row(row, rates)))
    }

    /// Takes a frame of known electron rates.
    ///
    /// # Errors
    /// A time or gain that can't be used, or rates of another sensor's size.
    pub fn expose_rate(
        &self,
        rate: &ElectronRate,
        exposure: &Exposure,
    ) -> Result<SensorImage, SensorProblem> {
        exposure.validate()?;
        self.check_size(rate)?;
        let columns = self.model.columns;
        Ok(Chain::new(self, exposure).image(self, exposure, |row, rates| {
            rates.copy_from_slice(&rate.data[row * columns..][..columns]);
        }))
    }

    /// Takes a frame of even light that frees the same number of electrons per second in every pixel.
    ///
    /// # Errors
    /// A time or gain that can't be used.
    pub fn expose_even(&self, rate_e_per_s: f64, exposure: &Exposure) -> Result<SensorImage, SensorProblem> {
        exposure.validate()?;
        Ok(Chain::new(self, exposure).image(self, exposure, |_, rates| rates.fill(rate_e_per_s as f32)))
    }
}

/// Where the electron rates of a row come from, and how they fall off toward the corners.
struct RateSource<'a> {
    spectra: SpectraSource<'a>,
    falloff: Option<RelativeIllumination>,
}

enum SpectraSource<'a> {
    /// Samples are pixels: each pixel's spectrum is weighted once, for its own channel.
    Direct { irradiance: &'a SpectralImage<Irradiance>, mosaic: &'a Mosaic, weights: Vec<Vec<f32>> },
    /// Every sample is weighted for every channel, then integrated over pixels.
    Resampled(PixelIntegrals<'a>),
}

impl<'a> RateSource<'a> {
    fn new(
        sensor: &'a Sensor,
        qe: &SpectralQe,
        irradiance: &'a SpectralImage<Irradiance>,
        film: FilmExtent,
    ) -> Self {
        let falloff = RelativeIllumination::of(&sensor.model, &sensor.mosaic);
        Self { spectra: SpectraSource::new(sensor, qe, irradiance, film), falloff }
    }

    fn fill_row(&self, row: usize, out: &mut [f32]) {
        self.spectra.fill_row(row, out);
        if let Some(falloff) = &self.falloff {
            falloff.apply(self.spectra.mosaic(), row, out);
        }
    }
}

impl<'a> SpectraSource<'a> {
    fn new(
        sensor: &'a Sensor,
        qe: &SpectralQe,
        irradiance: &'a SpectralImage<Irradiance>,
        film: FilmExtent,
    ) -> Self {
        let single = |weights: Vec<f64>| weights.into_iter().map(|weight| weight as f32).collect();
        let weights: Vec<Vec<f32>> =
            sensor.weights_of(qe, irradiance.grid()).into_iter().map(single).collect();
        let (model, mosaic) = (&sensor.model, &sensor.mosaic);
        let (width, height) = (irradiance.width(), irradiance.height());
        let is_same = |a: f64, b: f64| (a - b).abs() < 1e-9 * b;
        if (width, height) == (model.columns, model.rows)
            && is_same(film.width_mm, model.width_mm())
            && is_same(film.height_mm, model.height_mm())
        {
            return Self::Direct { irradiance, mosaic, weights };
        }
        let planes = (Cow::Owned(film_planes(irradiance, &weights)), PlaneOrder::Rows);
        Self::Resampled(PixelIntegrals::new(sensor, planes, [width, height], film))
    }

    fn mosaic(&self) -> &Mosaic {
        match self {
            Self::Direct { mosaic, .. } => mosaic,
            Self::Resampled(pixels) => pixels.mosaic(),
        }
    }

    fn fill_row(&self, row: usize, out: &mut [f32]) {
        match self {
            Self::Direct { irradiance, mosaic, weights } => {
                for (col, out) in out.iter_mut().enumerate() {
                    *out = dot(irradiance.pixel(row, col), &weights[mosaic.channel(row, col)]) as f32;
                }
            }
            Self::Resampled(pixels) => pixels.fill_row(row, out),
        }
    }
}

/// Spectra weighted for every channel, `[row][channel][col]`.
fn film_planes(irradiance: &SpectralImage<Irradiance>, weights: &[Vec<f32>]) -> Vec<f32> {
    let (width, height, bands) = (irradiance.width(), irradiance.height(), irradiance.bands());
    let mut planes = vec![0.0; width * height * weights.len()];
    if width * height > 0 {
        let rows = planes.par_chunks_exact_mut(width * weights.len());
        rows.zip(irradiance.data().par_chunks_exact(width * bands)).for_each(|(planes, spectra)| {
            for (col, spectrum) in spectra.chunks_exact(bands).enumerate() {
                for (plane, weights) in planes.chunks_exact_mut(width).zip(weights) {
                    plane[col] = dot(spectrum, weights) as f32;
                }
            }
        });
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::Curve;
    use crate::units::{ISETCAM_PLANCK_J_S, LIGHT_SPEED_M_PER_S, photons_per_joule};

    fn rgb() -> SpectralQe {
        let curve =
            |peak_nm: f64| Curve::from_fn(350.0, 750.0, |nm| 0.5 * (-((nm - peak_nm) / 60.0).powi(2)).exp());
        SpectralQe::from_curves([("R", curve(610.0)), ("G", curve(540.0)), ("B", curve(460.0))]).unwrap()
    }

    fn small(columns: usize, rows: usize) -> SensorModel {
        SensorModel { columns, rows, ..SensorModel::default() }
    }

    fn pattern(width: usize, height: usize) -> SpectralImage<Irradiance> {
        let mut image = SpectralImage::zeros(WavelengthGrid::default(), width, height);
        for (index, value) in image.data_mut().iter_mut().enumerate() {
            *value = 1e-4 * (1.0 + (index * 7919 % 613) as f32);
        }
        image
    }

    #[test]
    fn isetcam_electrons_follow_the_closed_form() {
        // e = T A FF sum E QE lambda / (hc) step, with ISETCam's constant.
        let mode = SensorMode::Isetcam { noise_flag: -1 };
        let sensor = Sensor::new(SensorModel { mode, ..small(4, 2) }, rgb()).unwrap();
        let light = pattern(4, 2);
        let rate = sensor.electron_rate(&light);
        let channels = [[1, 0, 1, 0], [2, 1, 2, 1]]; // GRBG in the order R, G, B
        for (row, channels) in channels.iter().enumerate() {
            for (col, &channel) in channels.iter().enumerate() {
                let curve = &sensor.qe().channels()[channel].curve;
                let expected: f64 = light
                    .pixel(row, col)
                    .iter()
                    .zip(light.grid().centers_nm())
                    .map(|(&e, nm)| {
                        let photons = nm * 1e-9 / (ISETCAM_PLANCK_J_S * LIGHT_SPEED_M_PER_S);
                        f64::from(e) * curve.at(nm) * photons * 5.0 * 6.1875e-12
                    })
                    .sum();
                let actual = f64::from(rate.data[row * 4 + col]);
                assert!((actual / expected - 1.0).abs() < 1e-6, "{actual} e-/s, expected {expected}");
            }
        }
    }

    #[test]
    fn a_laser_line_is_counted_in_photons() {
        // 1 uW/m2 in one bin of 5 nm at 500 nm on a flat efficiency of 0.5, exact constants.
        let qe = SpectralQe::from_curves([("mono", Curve::constant(0.5))]).unwrap();
        let sensor =
            Sensor::new(SensorModel { mosaic: vec![vec!["mono".into()]], ..small(1, 1) }, qe).unwrap();
        let mut light = SpectralImage::zeros(WavelengthGrid::default(), 1, 1);
        light.data_mut()[30] = 1e-6 / 5.0;
        let expected = 1e-6 * 6.1875e-12 * photons_per_joule(500.0) * 0.5;
        let actual = f64::from(sensor.electron_rate(&light).data[0]);
        assert!((actual / expected - 1.0).abs() < 3e-7, "{actual} e-/s, expected {expected}");
    }

    #[test]
    fn resampling_keeps_pixels_and_light() {
        let (fine, coarse) = (Sensor::new(small(12, 8), rgb()).unwrap(), pattern(6, 4));
        let rate = fine.electron_rate(&coarse);
        // Between the middles of coarse samples light is linear: a quarter of the way from one to the next; beyond them it is even.
        for (row, col, samples) in [
            (0, 0, vec![(0, 0, 1.0)]),
            (3, 5, vec![(1, 2, 0.5625), (1, 3, 0.1875), (2, 2, 0.1875), (2, 3, 0.0625)]),
            (7, 11, vec![(3, 5, 1.0)]),
        ] {
            let mut one = SpectralImage::zeros(WavelengthGrid::default(), 12, 8);
            for (r, c, weight) in samples {
                let values = one.pixel_mut(row, col).iter_mut().zip(coarse.pixel(r, c));
                values.for_each(|(sum, value)| *sum += weight * value);
            }
            let (even, linear) = (fine.electron_rate(&one).data[row * 12 + col], rate.data[row * 12 + col]);
            assert!((even / linear - 1.0).abs() < 1e-6, "{even} {linear}");
        }
        // A film twice as wide as the sensor: only its middle is seen.
        let film = FilmExtent::of_width(2.0 * fine.film_extent().width_mm, 24, 16);
        let wide = pattern(24, 16);
        let mut middle = SpectralImage::zeros(WavelengthGrid::default(), 12, 8);
        for row in 0..8 {
            for col in 0..12 {
                middle.pixel_mut(row, col).copy_from_slice(wide.pixel(row + 4, col + 6));
            }
        }
        assert_eq!(fine.electron_rate_on_film(&wide, film).unwrap(), fine.electron_rate(&middle));
        // A film half as wide as the sensor: dark around it.
        let film = FilmExtent { width_mm: 0.25 * film.width_mm, height_mm: 0.25 * film.height_mm };
        let rate = fine.electron_rate_on_film(&coarse, film).unwrap();
        assert_eq!(rate.data[0], 0.0);
        assert!(rate.data[4 * 12 + 6] > 0.0);
    }

    #[test]
    fn exposing_light_or_its_rate_gives_the_same_frame() {
        let sensor = Sensor::new(small(12, 8), rgb()).unwrap();
        let (light, exposure) = (pattern(12, 8), Exposure { time_s: 0.5, ..Exposure::default() });
        let frame = sensor.expose(&light, &exposure).unwrap();
        assert_eq!(frame, sensor.expose_rate(&sensor.electron_rate(&light), &exposure).unwrap());
        assert_eq!(frame.mosaic, Mosaic::bayer("grbg").unwrap());
    }

    #[test]
    fn mosaic_and_efficiency_must_name_the_same_channels() {
        let mono = SpectralQe::from_curves([("mono", Curve::constant(0.5))]).unwrap();
        let error = Sensor::new(small(4, 4), mono).unwrap_err();
        assert!(error.to_string().contains("\"G\"; there is one for mono"), "{error}");
        let one_color = SensorModel { mosaic: vec![vec!["G".into()]], ..small(4, 4) };
        assert_eq!(Sensor::new(one_color, rgb()).unwrap_err().field, "quantum_efficiency.R");
    }

    #[test]
    fn bad_exposures_are_refused() {
        let sensor = Sensor::new(small(4, 4), rgb()).unwrap();
        let light = pattern(4, 4);
        for (exposure, field) in [
            (Exposure { time_s: -1.0, ..Exposure::default() }, "exposure.time_s"),
            (Exposure { time_s: 1e-99, ..Exposure::default() }, "exposure.time_s"),
            (Exposure { time_s: f64::NAN, ..Exposure::default() }, "exposure.time_s"),
            (Exposure { gain: 0.0, ..Exposure::default() }, "exposure.gain"),
        ] {
            assert_eq!(sensor.expose(&light, &exposure).unwrap_err().field, field);
        }
        let film = FilmExtent { width_mm: 0.0, height_mm: 1.0 };
        assert_eq!(sensor.electron_rate_on_film(&light, film).unwrap_err().field, "film.width_mm");
    }
}
