//! Dark frames, flat fields and bad pixels of a study's own sensor, or of a real one.

use super::film_irradiance::flat_film_irradiance;
use crate::image::{SensorImage, SpectralImage};
use crate::pipeline::PipelineError;
use crate::sensor::{
    AutoExposure, BadPixels, Demosaicing, DevelopError, Development, EXPOSURE_MS, ElectronRate, Exposure,
    FlatField, MasterFrame, Sensor, is_same_setting,
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
/// Electrons per second of the brightest pixel before the level is analyte: every well fills within an hour.
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
            let taken = |dark: &MasterFrame| {
                (dark.exposure_s, dark.dn_per_electron) == (raw.exposure_s, raw.dn_per_electron)
            };
            if plan.dark_frames > 0 && !calibration.darks.iter().any(taken) {
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
                    is_same_setting(first.exposure_s, frame.exposure_s)
                        && is_same_setting(first.dn_per_electron, frame.dn_per_electron)
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
            let dark = average(group)?;
            dark.refuse_lit_dark()?;
            calibration.darks.push(dark);
        }
        // Make the flat field
        let mut flat_master = None;
        if !flat_frames.is_empty() {
            let light = average(flat_frames)?;
            let dark = calibration.dark_for(light.exposure_s, light.dn_per_electron);
            calibration.flat = Some(FlatField::new(&light, dark)?);
            flat_master = Some(light);
        }
        // Detect bad pixels in the longest dark frame and the flat field
        if let Some(sigma) = bad_pixel_sigma {
            let longest = calibration.darks.iter().max_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
            let flat = flat_master
                .as_ref()
                .map(|light| (light, calibration.dark_for(light.exposure_s, light.dn_per_electron)));
            if longest.is_some() || flat.is_some() {
                calibration.bad_pixels = Some(BadPixels::detect(longest, flat, sigma)?);
            }
        }
        Ok(calibration)
    }

    /// The dark frame of an exposure time and gain, of several the nearest in time.
    fn dark_for(&self, exposure_s: f64, dn_per_electron: f64) -> Option<&MasterFrame> {
        let away = |dark: &MasterFrame| (dark.exposure_s - exposure_s).abs();
        let fitting = self.darks.iter().filter(|dark| dark.has_exposure(exposure_s, dn_per_electron));
        fitting.min_by(|a, b| away(a).total_cmp(&away(b)))
    }

    /// How one raw frame is developed: with the dark frame of its exposure, where there are dark frames.
    ///
    /// # Errors
    /// Dark frames, none of which has the exposure time and gain of the frame.
    pub fn development(&self, raw: &SensorImage) -> Result<Development<'_>, DevelopError> {
        let dark = self.dark_for(raw.exposure_s, raw.dn_per_electron);
        let away = |dark: &MasterFrame| (dark.exposure_s / raw.exposure_s).ln().abs();
        let nearest = self.darks.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        if let (None, Some(nearest)) = (dark, nearest) {
            return Err(DevelopError::OtherExposure {
                dark: nearest.label.clone(),
                dark_s: nearest.exposure_s,
                dark_gain: nearest.dn_per_electron,
                frame: raw.label.clone(),
                exposure_s: raw.exposure_s,
                gain: raw.dn_per_electron,
            });
        }
        Ok(Development {
            demosaicing: self.demosaicing,
            dark,
            is_dark_shared: false,
            flat: self.flat.as_ref(),
            bad_pixels: self.bad_pixels.as_ref(),
        })
    }

    /// What of dark frames is used otherwise than as it was taken, for these frames.
    ///
    /// # Errors
    /// A dark frame that neither these frames nor the flat field can use.
    pub fn remarks<'a>(
        &self,
        frames: impl IntoIterator<Item = &'a SensorImage>,
    ) -> Result<Vec<String>, DevelopError> {
        let frames: Vec<&SensorImage> = frames.into_iter().collect();
        let mut remarks = Vec::new();
        let lights = frames.iter().map(|raw| (&raw.label, raw.exposure_s, raw.dn_per_electron));
        let flat = self.flat.as_ref().map(|flat| (&flat.label, flat.exposure_s, flat.dn_per_electron));
        let lights: Vec<_> = lights.chain(flat).collect();
        for dark in &self.darks {
            if let Some(levels) = dark.uneven_channels(1.0) {
                remarks.push(format!(
                    "The channels of the dark frame \"{}\" differ by more than noise: {levels}. Light may have fallen on it: take dark \
                     frames with the cap on the lens",
                    dark.label
                ));
            }
            if !lights.iter().any(|(_, time_s, gain)| dark.has_exposure(*time_s, *gain)) {
                return Err(DevelopError::UnusedDark {
                    dark: dark.label.clone(),
                    dark_s: dark.exposure_s,
                    dark_gain: dark.dn_per_electron,
                });
            }
        }
        for raw in &frames {
            let dark = self.dark_for(raw.exposure_s, raw.dn_per_electron);
            let has_other = |dark: &&MasterFrame| {
                dark.black_level > 0.0 && raw.black_level > 0.0 && dark.black_level != raw.black_level
            };
            if let Some(dark) = dark.filter(has_other) {
                remarks.push(format!(
                    "The dark frame \"{}\" has a black level of {} DN, the frame \"{}\" {} DN: what it holds above its own is subtracted \
                     with the latter",
                    dark.label, dark.black_level, raw.label, raw.black_level
                ));
            }
        }
        for (label, time_s, gain) in &lights {
            match self.dark_for(*time_s, *gain) {
                Some(dark) => {
                    let scale = dark.dark_scale(*time_s, *gain);
                    let ms = |time_s: f64| (1e9 * time_s).round() / 1e6;
                    if (scale - 1.0).abs() > 1e-6 {
                        remarks.push(format!(
                            "The dark frame \"{}\" has {} ms, the frame \"{label}\" {} ms: what it holds above the black level counts \
                             times {scale:.5}",
                            dark.label,
                            ms(dark.exposure_s),
                            ms(*time_s)
                        ));
                    } else if (dark.exposure_s / time_s - 1.0).abs() > 1e-6 {
                        remarks.push(format!(
                            "The dark frame \"{}\" has {} ms, the frame \"{label}\" {} ms: as its black level is 0, it is subtracted as \
                             it is",
                            dark.label,
                            ms(dark.exposure_s),
                            ms(*time_s)
                        ));
                    }
                }
                None if !self.darks.is_empty() => remarks.push(format!(
                    "No dark frame has the exposure time and gain of the flat frame \"{label}\": its black level is subtracted"
                )),
                None => {}
            }
        }
        Ok(remarks)
    }
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

#[cfg(test)]
mod tests {
    use super::super::captured_frame::{RawExposures, with_shared_dark};
    use super::*;
    use crate::image::Mosaic;

    fn raw(label: &str, exposure_s: f64, dn: u16) -> SensorImage {
        SensorImage {
            width: 2,
            height: 2,
            data: vec![dn; 4],
            mosaic: Mosaic::monochrome(),
            black_level: 64.0,
            black_offsets: Vec::new(),
            white_levels: Vec::new(),
            factors: Vec::new(),
            orientation: crate::image::Orientation::default(),
            white_level: 4095,
            bit_depth: 12,
            exposure_s,
            gain: 1.0,
            dn_per_electron: 0.5,
            read_noise_dn: 6.0,
            gain_is_assumed: false,
            seed: 0,
            label: label.into(),
        }
    }

    /// No dark frame is without an effect and without a word.
    #[test]
    fn dark_frames_are_used_or_refused() {
        let with = |darks: Vec<SensorImage>, flats: Vec<SensorImage>| {
            Calibration::of_frames(Demosaicing::Bilinear, darks, flats, None).unwrap()
        };
        let frame = raw("blue", 0.5, 1000);
        // Two of the same setting but for a line of the sensor are one mean
        let near = with(vec![raw("dark", 0.501, 264), raw("dark 2", 0.5011, 266)], Vec::new());
        assert_eq!(near.darks.len(), 1);
        let left = near.development(&frame).unwrap().linearize(&frame).unwrap().values[0];
        // 1000 - 64 - 201 * 0.5 / 0.50105
        assert!((f64::from(left) - 735.421_215).abs() < 1e-3, "{left}");
        let remarks = near.remarks([&frame]).unwrap();
        assert!(remarks[0].contains("\"dark\" has 501.05 ms, the frame \"blue\" 500 ms"), "{remarks:?}");
        // Another time, or another gain
        let far = with(vec![raw("dark", 0.506, 264)], Vec::new());
        let said = far.development(&frame).unwrap_err().to_string();
        assert!(said.contains("506 ms and 0.5 DN/e-, the frame \"blue\" 500 ms and 0.5 DN/e-"), "{said}");
        let louder = SensorImage { dn_per_electron: 2.0, ..raw("dark", 0.5, 264) };
        let said = with(vec![louder], Vec::new()).development(&frame).unwrap_err().to_string();
        assert!(said.contains("500 ms and 2 DN/e-") && said.contains("another gain (ISO)"), "{said}");
        // One too many
        let both = with(vec![raw("dark", 0.5, 264), raw("odd", 0.03, 264)], Vec::new());
        assert!(both.development(&frame).is_ok());
        let said = both.remarks([&frame]).unwrap_err().to_string();
        assert!(said.contains("\"odd\" has 30 ms"), "{said}");
        // Frames of even light without a dark frame, and with one
        let flat = || vec![raw("flat", 0.03, 3000)];
        let remarks = with(vec![raw("dark", 0.5, 264)], flat()).remarks([&frame]).unwrap();
        assert!(remarks[0].contains("flat frame \"flat\": its black level is subtracted"), "{remarks:?}");
        let remarks = with(vec![raw("dark", 0.5, 264), raw("odd", 0.03, 264)], flat()).remarks([&frame]);
        assert_eq!(remarks.unwrap(), Vec::<String>::new());
    }

    /// The noise of one dark frame cancels where both frames of a difference have it: the stated noise is that without dark frames, but for
    /// the shot noise of the dark charge, 0.5 DN per electron times 200 DN in each.
    #[test]
    fn noise_of_dark_frames_that_a_difference_shares_cancels() {
        let frames = [raw("blue", 0.5, 1000), raw("ambient", 0.5, 300)]
            .map(|raw| RawExposures { raw, bracket: Vec::new() });
        let of = |calibration: &Calibration| {
            let [frame, ambient] =
                with_shared_dark([&frames[0], &frames[1]], calibration).unwrap().unwrap_or_else(|| {
                    frames
                        .each_ref()
                        .map(|f| calibration.development(&f.raw).unwrap().linearize(&f.raw).unwrap())
                });
            frame.without(&ambient).unwrap()
        };
        let with = |darks| Calibration::of_frames(Demosaicing::Bilinear, darks, Vec::new(), None).unwrap();
        let (plain, dark) = (of(&with(Vec::new())), of(&with(vec![raw("dark", 0.5, 264)])));
        assert!((dark.noise_floor_dn / plain.noise_floor_dn - 1.0).abs() < 1e-12);
        let noise = dark.calibration.unwrap();
        assert!(noise.line_variance.iter().all(|of| (of - 1.0).abs() < 1e-6), "{:?}", noise.line_variance);
        assert!(noise.variance_dn2.iter().all(|dn2| (dn2 - 200.0).abs() < 1e-3), "{:?}", noise.variance_dn2);
        assert_eq!(noise.dark_pattern_dn2, [0.0]);
    }

    /// 1000 DN less a dark charge of 200: 64 + 200 where the black level is that of the frame, 70 + 200 where it moved by 6, and of one
    /// of each as much.
    #[test]
    fn dark_charge_stands_on_the_black_level_of_the_frame() {
        let frame = raw("blue", 0.5, 1000);
        let moved = || SensorImage { black_level: 70.0, ..raw("moved", 0.5, 270) };
        for darks in [vec![raw("dark", 0.5, 264)], vec![moved()], vec![raw("dark", 0.5, 264), moved()]] {
            let name = darks[0].label.clone();
            let calibration = Calibration::of_frames(Demosaicing::Bilinear, darks, Vec::new(), None).unwrap();
            let left = calibration.development(&frame).unwrap().linearize(&frame).unwrap();
            assert!(left.values.iter().all(|value| *value == 736.0), "{name}: {:?}", left.values);
            let remarks = calibration.remarks([&frame]).unwrap();
            assert_eq!(remarks.len(), usize::from(name == "moved"), "{remarks:?}");
            assert!(
                remarks
                    .iter()
                    .all(|said| said.contains("has a black level of 70 DN, the frame \"blue\" 64 DN"))
            );
        }
    }

    /// A dark frame that is full, or whose channels differ as light makes them, was taken without the cap.
    #[test]
    fn lit_dark_frames_are_refused_or_told() {
        let frame = SensorImage { mosaic: Mosaic::bayer("rggb").unwrap(), ..raw("blue", 0.5, 1000) };
        let dark = |data: [u16; 4]| {
            let dark = SensorImage { label: "dark".into(), data: data.to_vec(), ..frame.clone() };
            Calibration::of_frames(Demosaicing::Bilinear, vec![dark], Vec::new(), None)
        };
        let said = dark([70, 4095, 70, 70]).unwrap_err().to_string();
        assert!(said.contains("50.0 % of the G pixels of the dark frame \"dark\" are saturated"), "{said}");
        // The dark noise of one value is 6 DN
        assert_eq!(dark([70, 72, 72, 75]).unwrap().remarks([&frame]).unwrap(), Vec::<String>::new());
        let remarks = dark([70, 90, 90, 75]).unwrap().remarks([&frame]).unwrap();
        assert!(remarks[0].contains("differ by more than noise: R 6.0, G 26.0, B 11.0 DN"), "{remarks:?}");
        let said = dark([70, 160, 160, 75]).unwrap_err().to_string();
        assert!(said.contains("differ by far more than noise, R 6.0, G 96.0, B 11.0 DN"), "{said}");
        // Even light shows where the frame has less
        let even = dark([300; 4]).unwrap();
        assert!(even.development(&frame).unwrap().linearize(&frame).is_ok());
        let darker = SensorImage { data: vec![200; 4], ..frame.clone() };
        let said = even.development(&darker).unwrap().linearize(&darker).unwrap_err().to_string();
        assert!(
            said.contains("has 100 DN more than the frame \"blue\" in the mean: light fell on it"),
            "{said}"
        );
    }
}
