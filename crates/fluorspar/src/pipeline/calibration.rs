//! Dark frames, flat fields and bad pixels of a study's own sensor, or of a real one.

use super::PipelineError;
use super::capture::flat_film_irradiance;
use crate::image::{SensorImage, SpectralImage};
use crate::sensor::{
    AutoExposure, BadPixels, Demosaicing, Development, EXPOSURE_MS, ElectronRate, Exposure, FlatField,
    MasterFrame, Sensor,
};
use crate::spectral::Radiance;
use crate::study::{FlatFieldPlan, Study};

/// Calibration frames for the development of raw frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Calibration {
    /// Interpolation of the colors.
    pub demosaicing: Demosaicing,
    /// Averaged dark frames, one for each exposure time and gain.
    pub darks: Vec<MasterFrame>,
    /// Flat field.
    pub flat: Option<FlatField>,
    /// Pixels to be replaced.
    pub bad_pixels: Option<BadPixels>,
}

/// Exposure of the frames of a flat field, s.
const FLAT_EXPOSURE_S: f64 = 0.03;
/// Electrons per second of the brightest pixel before the level is sought: every well fills within an hour.
const FLAT_RATE: f64 = 1e7;
/// Columns of the image of even light: its shading is smooth.
const FLAT_COLUMNS: usize = 96;

impl Calibration {
    /// Takes the study's dark and flat frames with its own sensor and lens, for the given exposures.
    /// Their noise depends on the seed alone: the same study has the same calibration.
    ///
    /// # Errors
    /// A study without lens or sensor, exposures that can't be used.
    pub fn of_study<'a>(
        study: &Study,
        exposures: impl IntoIterator<Item = &'a SensorImage>,
    ) -> Result<Self, PipelineError> {
        let plan = &study.develop;
        let mut calibration = Self { demosaicing: plan.demosaicing, ..Self::default() };
        if plan.dark_frames == 0 && plan.flat_field.is_none() {
            return Ok(calibration);
        }
        let sensor = study.camera.sensor.as_ref().ok_or(PipelineError::Missing("sensor"))?;
        let seed = study.render.seed;
        for raw in exposures {
            if plan.dark_frames > 0 && calibration.dark_for(raw).is_none() {
                let gain = raw.gain / sensor.model().analog_gain;
                calibration.darks.push(darks(sensor, raw.exposure_s, gain, plan.dark_frames, seed)?);
            }
        }
        let mut flat_frames = None;
        if let Some(flat) = &plan.flat_field {
            let light = flats(study, sensor, flat)?;
            let dark = match plan.dark_frames {
                0 => None,
                frames => Some(darks(sensor, light.exposure_s, 1.0, frames, seed)?),
            };
            calibration.flat = Some(FlatField::new(&light, dark.as_ref())?);
            flat_frames = Some((light, dark));
        }
        if let Some(sigma) = plan.bad_pixel_sigma {
            // The longest exposure shows hot pixels best.
            let longest = calibration.darks.iter().max_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
            let flat = flat_frames.as_ref().map(|(light, dark)| (light, dark.as_ref()));
            calibration.bad_pixels = Some(BadPixels::detect(longest, flat, sigma)?);
        }
        Ok(calibration)
    }

    /// The calibration of a real camera: dark frames (of any number of exposures), frames of even light with dark frames of
    /// their exposure among the dark ones or else their black level, and bad pixels from both.
    ///
    /// # Errors
    /// Frames of different sensors.
    pub fn of_frames(
        demosaicing: Demosaicing,
        dark_frames: Vec<SensorImage>,
        flat_frames: Vec<SensorImage>,
        bad_pixel_sigma: Option<f64>,
    ) -> Result<Self, PipelineError> {
        // Average dark frames of equal exposure
        let mut groups: Vec<Vec<SensorImage>> = Vec::new();
        for frame in dark_frames {
            let same = |g: &&mut Vec<SensorImage>| {
                g.first().is_some_and(|first| {
                    (first.exposure_s, first.dn_per_electron) == (frame.exposure_s, frame.dn_per_electron)
                })
            };
            match groups.iter_mut().find(same) {
                Some(group) => group.push(frame),
                None => groups.push(vec![frame]),
            }
        }
        let average =
            |frames: Vec<SensorImage>| MasterFrame::average(frames.into_iter().map(Ok::<_, PipelineError>));
        let mut calibration = Self { demosaicing, ..Self::default() };
        for group in groups {
            calibration.darks.push(average(group)?);
        }
        // Make the flat field
        let mut flat_master = None;
        if !flat_frames.is_empty() {
            let light = average(flat_frames)?;
            let dark = calibration.darks.iter().find(|dark| same_exposure(dark, &light));
            calibration.flat = Some(FlatField::new(&light, dark)?);
            flat_master = Some(light);
        }
        // Detect bad pixels in the longest dark frame and the flat field
        if let Some(sigma) = bad_pixel_sigma {
            let longest = calibration.darks.iter().max_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
            let flat = flat_master
                .as_ref()
                .map(|light| (light, calibration.darks.iter().find(|dark| same_exposure(dark, light))));
            if longest.is_some() || flat.is_some() {
                calibration.bad_pixels = Some(BadPixels::detect(longest, flat, sigma)?);
            }
        }
        Ok(calibration)
    }

    fn dark_for(&self, raw: &SensorImage) -> Option<&MasterFrame> {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(b.abs());
        self.darks.iter().find(|dark| {
            near(dark.exposure_s, raw.exposure_s) && near(dark.dn_per_electron, raw.dn_per_electron)
        })
    }

    /// How one raw frame is developed: with the dark frame of its exposure, if there is one.
    pub fn development(&self, raw: &SensorImage) -> Development<'_> {
        Development {
            demosaicing: self.demosaicing,
            dark: self.dark_for(raw),
            flat: self.flat.as_ref(),
            bad_pixels: self.bad_pixels.as_ref(),
        }
    }
}

fn same_exposure(a: &MasterFrame, b: &MasterFrame) -> bool {
    (a.exposure_s, a.dn_per_electron) == (b.exposure_s, b.dn_per_electron)
}

fn darks(
    sensor: &Sensor,
    time_s: f64,
    gain: f64,
    frames: u32,
    seed: u64,
) -> Result<MasterFrame, PipelineError> {
    let (columns, rows) = (sensor.model().columns, sensor.model().rows);
    let rate = ElectronRate { columns, rows, data: vec![0.0; columns * rows] };
    let label = format!("dark frame of {time_s} s at gain {gain}");
    MasterFrame::average((0..u64::from(frames)).map(|frame| -> Result<SensorImage, PipelineError> {
        let exposure = Exposure { time_s, gain, seed, frame, label: label.clone() };
        Ok(sensor.expose_rate(&rate, &exposure)?)
    }))
}

/// Frames of light of the same radiance from everywhere, so bright that the brightest pixel of the middle is at the level that
/// is asked for.
fn flats(study: &Study, sensor: &Sensor, plan: &FlatFieldPlan) -> Result<MasterFrame, PipelineError> {
    let lens = study.camera.lens_behind_filters().ok_or(PipelineError::Missing("lens"))?;
    // Light from everywhere covers the sensor, whatever was rendered.
    let film = sensor.film_extent();
    let rows = (FLAT_COLUMNS as f64 * film.height_mm / film.width_mm).round().max(1.0) as usize;
    let grid = &study.scene.grid;
    let spectrum = plan.spectrum.bin_averages(grid);
    let mut radiance = SpectralImage::<Radiance>::zeros(grid.clone(), FLAT_COLUMNS, rows);
    // Only the shape counts: units of any size stay within single precision.
    let peak = spectrum.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    for pixel in radiance.data_mut().chunks_exact_mut(grid.len()) {
        pixel.iter_mut().zip(&spectrum).for_each(|(value, s)| *value = (*s / peak) as f32);
    }
    let irradiance = flat_film_irradiance(study, &lens, &radiance, film.width_mm);
    let mut rate = sensor.electron_rate_on_film(&irradiance, film)?;
    let brightest = f64::from(rate.data.iter().copied().fold(0.0, f32::max));
    if brightest <= 0.0 {
        return Err(PipelineError::DarkFlatField);
    }
    rate.data.iter_mut().for_each(|value| *value = (f64::from(*value) * FLAT_RATE / brightest) as f32);
    let [min_exposure_ms, max_exposure_ms] = EXPOSURE_MS;
    let rule =
        AutoExposure { percentile: 100.0, target_fraction: plan.level, min_exposure_ms, max_exposure_ms };
    let scale = sensor.auto_exposure_s(&rate, 1.0, &rule)? / FLAT_EXPOSURE_S;
    rate.data.iter_mut().for_each(|value| *value = (f64::from(*value) * scale) as f32);
    MasterFrame::average((0..u64::from(plan.frames)).map(|frame| -> Result<SensorImage, PipelineError> {
        let exposure = Exposure {
            time_s: FLAT_EXPOSURE_S,
            gain: 1.0,
            seed: study.render.seed,
            frame,
            label: "flat field".into(),
        };
        Ok(sensor.expose_rate(&rate, &exposure)?)
    }))
}
