//! From a component image to raw and developed frames.

use std::borrow::Cow;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::calibration::Calibration;
use super::capture_planes::{CapturePlanes, SeenComponents};
use super::motion::{MotionPath, shifted};
use crate::image::{ChannelImage, ComponentFactors, ComponentImage, SensorImage, SpectralImage};
use crate::pipeline::PipelineError;
use crate::sensor::{
    CaptureFrame, Development, Exposure, FilmExtent, FilmRates, LinearMosaic, Sensor, ShutterKind,
    merge_exposures,
};
use crate::spectral::Radiance;
use crate::study::{Capture, Study};

/// One capture, raw and developed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CapturedFrame {
    /// Digital numbers on the mosaic.
    pub raw: SensorImage,
    /// Further exposures of a bracket, named `CAPTURE_ev+2` and the like.
    pub bracket: Vec<SensorImage>,
    /// Linear channels: black subtracted, exposures merged, calibrated and less the ambient light, as in the study.
    pub developed: ChannelImage,
}

/// Raw exposures of one capture.
#[derive(Clone, Debug, PartialEq)]
pub struct RawExposures {
    /// The exposure that gives scale and name.
    pub raw: SensorImage,
    /// Further exposures to merge with it.
    pub bracket: Vec<SensorImage>,
}

impl RawExposures {
    /// All exposures, the main one first.
    pub fn all(&self) -> impl Iterator<Item = &SensorImage> {
        std::iter::once(&self.raw).chain(&self.bracket)
    }
}

/// Turns the frames of an analysis as the first one is, pixel by pixel of the sensor. Tells of each that is to be shown otherwise.
pub fn turned_alike(exposures: &mut [RawExposures]) -> Vec<String> {
    let Some((RawExposures { raw: first, bracket }, others)) = exposures.split_first_mut() else {
        return Vec::new();
    };
    let rest = others.iter_mut().flat_map(|one| std::iter::once(&mut one.raw).chain(&mut one.bracket));
    let turn = |image: &mut SensorImage| -> Option<String> {
        if image.orientation == first.orientation {
            return None;
        }
        let (turned, remark) = image.clone().turned_as(first);
        *image = turned;
        remark
    };
    bracket.iter_mut().chain(rest).filter_map(turn).collect()
}

/// What a raw frame lacks to be developed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IncompleteRaw {
    /// Its exposure time.
    #[error("its exposure time is not known")]
    NoExposure,
    /// Its conversion gain, which no sensor tells.
    #[error("its conversion gain is not known, and the experiment has no [sensor] that tells it")]
    NoSensor,
    /// Its conversion gain, and the sensor has other bits.
    #[error(
        "its conversion gain is not known, and the sensor of the experiment has {of_sensor} bits where the frame has {of_frame}"
    )]
    OtherBits {
        /// Bits of the frame.
        of_frame: u8,
        /// Bits of the sensor.
        of_sensor: u8,
        /// How the frame's values would fit the bits of the sensor; `None` where they do not.
        fit: Option<BitFit>,
    },
}

/// How values fit fewer bits than a frame is said to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BitFit {
    /// As they are.
    AsTheyAre,
    /// As they are, with another white level.
    WhiteLevel(u32),
    /// They stand in the upper bits.
    LeftAligned,
}

/// Fills in what a real camera's file does not tell, conversion gain and read noise, from the sensor of a study. What it
/// tells is kept.
///
/// # Errors
/// An exposure time that is missing, a sensor that is not there or has other bits.
pub fn complete_raw(study: &Study, raw: &mut SensorImage) -> Result<(), IncompleteRaw> {
    if raw.exposure_s <= 0.0 {
        return Err(IncompleteRaw::NoExposure);
    }
    if raw.dn_per_electron > 0.0 {
        return Ok(());
    }
    let Some(sensor) = &study.camera.sensor else { return Err(IncompleteRaw::NoSensor) };
    let model = sensor.model();
    let (of_frame, of_sensor) = (raw.bit_depth, model.bit_depth);
    if of_frame != of_sensor {
        return Err(IncompleteRaw::OtherBits { of_frame, of_sensor, fit: bit_fit(raw, of_sensor) });
    }
    raw.dn_per_electron = model.base_dn_per_electron() * raw.gain;
    raw.gain_is_assumed = true;
    if raw.read_noise_dn <= 0.0 {
        raw.read_noise_dn = raw.dn_per_electron * model.read_noise_electrons();
    }
    Ok(())
}

/// How the values of a frame fit the bits of a sensor. A tag may tell a white level that fewer bits do not have, and values may stand in
/// the upper ones.
fn bit_fit(raw: &SensorImage, of_sensor: u8) -> Option<BitFit> {
    let most = (1u32 << of_sensor.clamp(1, 16)) - 1;
    let unused = raw.data.iter().fold(0, |all, value| all | value).trailing_zeros();
    let is_larger = |value: &u16| u32::from(*value) > most;
    if raw.bit_depth == 16 && unused >= 16 - u32::from(of_sensor.min(16)) {
        Some(BitFit::LeftAligned)
    } else if raw.data.iter().any(is_larger) {
        None
    } else if is_larger(&raw.white_level) {
        Some(BitFit::WhiteLevel(most))
    } else {
        Some(BitFit::AsTheyAre)
    }
}

/// Name of a further exposure of a capture: `blue_ev+2`, `blue_ev-1.5`; the number is repeated exposures' own.
pub fn bracket_label(capture: &str, bracket_ev: &[f64], index: usize) -> String {
    let stops = bracket_ev[index];
    let repeat = bracket_ev[..index].iter().filter(|other| **other == stops).count();
    let repeat = if repeat > 0 { format!("_{}", repeat + 1) } else { String::new() };
    format!("{capture}_ev{stops:+}{repeat}")
}

/// Radiance under the lights of one frame: components weighted by the drive of their light group.
pub fn frame_radiance(frame: &CaptureFrame, components: &ComponentImage) -> SpectralImage<Radiance> {
    components.recombine(|component| frame.drive(&component.light_group))
}

/// Takes all frames of a study: lights of the frame, lens, motion, sensor, brackets, development.
///
/// Lens and sensor may be others than those that the image was rendered for: the sensor then sees more or less of it.
/// What lies beyond the rendered field is dark.
///
/// # Errors
/// A study without lens, sensor or captures; an image of another study or from another place; exposures that
/// can't be used.
pub fn capture(study: &Study, components: &ComponentImage) -> Result<Vec<CapturedFrame>, PipelineError> {
    check_captures(study, components)?;
    let planes = CapturePlanes::new(study, components)?;
    let factors = ComponentFactors::ones(components.components.len());
    let captures = &study.captures;
    capture_from_planes(
        study,
        &SeenComponents { image: components, planes: &planes, captures, factors: &factors },
    )
}

/// [`capture`] from the channel planes of the captures, with factors on the components (of concentrations, for instance).
///
/// # Errors
/// Those of [`capture`].
pub fn capture_from_planes(
    study: &Study,
    seen: &SeenComponents<'_>,
) -> Result<Vec<CapturedFrame>, PipelineError> {
    capture_some(study, seen, |_| true, None)
}

/// [`capture_from_planes`], of one capture of the study. The exposures that it needs of the others are taken from `recent` where they
/// would be the same.
///
/// # Errors
/// Those of [`capture`]; a capture that is not there.
pub fn capture_one(
    study: &Study,
    seen: &SeenComponents<'_>,
    label: &str,
    recent: &RecentExposures,
) -> Result<CapturedFrame, PipelineError> {
    let frame = capture_some(study, seen, |other| other == label, Some(recent))?.pop();
    frame.ok_or_else(|| {
        let known = study.captures.iter().map(|capture| capture.frame.label.as_str());
        PipelineError::NoFrame { wanted: label.into(), known: known.collect::<Vec<_>>().join(", ") }
    })
}

/// Exposures that frames of late needed beside their own: those that they subtract.
#[derive(Debug, Default)]
pub struct RecentExposures(Mutex<Vec<(Exposed, RawExposures)>>);

/// All that the exposures of a capture come from where nothing moves.
#[derive(Clone, Debug, PartialEq)]
struct Exposed {
    sensor: Sensor,
    capture: Capture,
    film: FilmExtent,
    seed: u64,
    rates: FilmRates,
}

impl RecentExposures {
    /// Captures whose exposures are kept: most experiments have fewer beside the one that is shown.
    const MOST: usize = 4;

    /// The exposures of a capture, taken unless they are known.
    fn or_taken(
        &self,
        exposed: Exposed,
        take: impl FnOnce(&FilmRates) -> Result<RawExposures, PipelineError>,
    ) -> Result<RawExposures, PipelineError> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, known)) = lock().iter().find(|(of, _)| *of == exposed) {
            return Ok(known.clone());
        }
        let taken = take(&exposed.rates)?;
        let mut kept = lock();
        kept.insert(0, (exposed, taken.clone()));
        kept.truncate(Self::MOST);
        Ok(taken)
    }
}

/// The frames of some captures of a study.
fn capture_some(
    study: &Study,
    seen: &SeenComponents<'_>,
    is_wanted: impl Fn(&str) -> bool,
    recent: Option<&RecentExposures>,
) -> Result<Vec<CapturedFrame>, PipelineError> {
    check_captures(study, seen.image)?;
    let sensor = study.camera.sensor.as_ref().ok_or(PipelineError::Missing("sensor"))?;
    // Expose each capture in sequence
    let mut path = MotionPath::new(study);
    let mut exposures = Vec::with_capacity(study.captures.len());
    for capture in &study.captures {
        let (film, seed) = (seen.planes.film, study.render.seed);
        let rates = seen.film_rates(capture, |component| capture.frame.drive(&component.light_group));
        let mut take = |rates: &FilmRates| expose_capture(study, sensor, capture, rates, film, &mut path);
        let is_beside = study.motion.is_none() && !is_wanted(&capture.frame.label);
        exposures.push(match recent.filter(|_| is_beside) {
            None => take(&rates)?,
            Some(recent) => {
                let exposed = Exposed { sensor: sensor.clone(), capture: capture.clone(), film, seed, rates };
                recent.or_taken(exposed, take)?
            }
        });
    }
    // Develop with calibration frames of the same exposures
    let calibration = Calibration::of_study(study, exposures.iter().flat_map(RawExposures::all))?;
    develop_some(study, exposures, &calibration, is_wanted)
}

/// Checks that a study has all that captures need, and that a component image fits it.
///
/// # Errors
/// What is missing, or what does not fit.
pub fn check_captures(study: &Study, components: &ComponentImage) -> Result<(), PipelineError> {
    if study.camera.lens.is_none() {
        return Err(PipelineError::Missing("lens"));
    }
    if study.camera.sensor.is_none() {
        return Err(PipelineError::Missing("sensor"));
    }
    if study.captures.is_empty() {
        return Err(PipelineError::Missing("captures"));
    }
    if components.grid != study.scene.grid {
        let (image, study) = (components.grid.len(), study.scene.grid.len());
        return Err(PipelineError::OtherGrid { image, study });
    }
    check_lights(study, components)?;
    check_view(study, components)?;
    study.capture_sequence().validate()?;
    Ok(())
}

/// Checks that a component image holds all lights that captures turn on.
fn check_lights(study: &Study, components: &ComponentImage) -> Result<(), PipelineError> {
    let known = components.light_groups();
    for c in &study.captures {
        let frame = &c.frame;
        if let Some(group) = frame.lights.keys().find(|g| frame.drive(g) > 0.0 && !known.contains(g)) {
            let (frame, group) = (frame.label.clone(), group.clone());
            return Err(PipelineError::OtherLights { frame, group, known: known.join(", ") });
        }
    }
    Ok(())
}

/// Checks that a component image was rendered from where the camera of a study stands, where it tells that.
fn check_view(study: &Study, components: &ComponentImage) -> Result<(), PipelineError> {
    let (Some(view), Some(now)) = (&components.features.view, study.scene.camera.view()) else {
        return Ok(());
    };
    let apart = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-6);
    let is_other = apart(view.position_m, now.position_m)
        || apart(view.forward, now.forward)
        || apart(view.right, now.right);
    if is_other { Err(PipelineError::OtherCamera) } else { Ok(()) }
}

/// Most steps in which an image moves while a rolling shutter runs.
const MOST_STEPS: f64 = 64.0;

/// Starts of the steps, s, in which an image that drifts is shown to a rolling shutter, from the first row's exposure to the
/// end of the last row's: steps of half a pixel, as long as these are not too many. None where all rows are exposed at once
/// or nothing drifts.
fn rolling_steps(sensor: &Sensor, exposure: &Exposure, drift_px_per_s: [f64; 2]) -> Option<Vec<f64>> {
    let model = sensor.model();
    let speed_px_per_s = drift_px_per_s[0].hypot(drift_px_per_s[1]);
    if model.shutter.kind != ShutterKind::Rolling || speed_px_per_s == 0.0 {
        return None;
    }
    let frame_s = exposure.time_s + 1e-6 * model.shutter.row_time_us * model.rows as f64;
    let steps = (2.0 * speed_px_per_s * frame_s).ceil().clamp(1.0, MOST_STEPS);
    Some((0..steps as usize).map(|step| frame_s * step as f64 / steps).collect())
}

/// All exposures of one capture. The exposure time of an automatic one is that of the image at rest.
fn expose_capture(
    study: &Study,
    sensor: &Sensor,
    capture: &Capture,
    rates: &FilmRates,
    film: FilmExtent,
    path: &mut MotionPath,
) -> Result<RawExposures, PipelineError> {
    let at_rest = sensor.electron_rate_of(rates, film)?;
    let main = sensor.frame_exposure(&capture.frame, &at_rest, study.render.seed)?;
    let sample_um = 1e3 * film.width_mm / rates.width as f64;
    let samples_per_pixel = sensor.model().pixel_size_um / sample_um;
    let rate_at = |shift_px: [f64; 2]| {
        let [right, down] = shift_px.map(|pixels| pixels * samples_per_pixel);
        sensor.electron_rate_of(&shifted(rates, right, down), film)
    };
    let mut take = |exposure: &Exposure| -> Result<SensorImage, PipelineError> {
        let start_px = path.next(exposure.time_s);
        let drift_px_per_s = path.drift_px_per_s();
        let rate = if let Some(times_s) = rolling_steps(sensor, exposure, drift_px_per_s) {
            Cow::Owned(sensor.rate_over_time(&times_s, exposure, |step| {
                // Show the image where it is at half of the step.
                let step_s = times_s.get(1).copied().unwrap_or(0.0);
                let time_s = times_s[step] + 0.5 * step_s;
                rate_at([0, 1].map(|axis| start_px[axis] + drift_px_per_s[axis] * time_s))
            })?)
        } else if start_px == [0.0; 2] {
            Cow::Borrowed(&at_rest)
        } else {
            Cow::Owned(rate_at(start_px)?)
        };
        Ok(sensor.expose_rate(&rate, exposure)?)
    };
    let raw = take(&main)?;
    let mut bracket = Vec::with_capacity(capture.bracket_ev.len());
    for (index, stops) in capture.bracket_ev.iter().enumerate() {
        // Noise of its own: the number of the exposure goes into its key.
        let exposure =
            Exposure { time_s: main.time_s * stops.exp2(), frame: 1 + index as u64, ..main.clone() };
        let mut image = take(&exposure)?;
        image.label = bracket_label(&capture.frame.label, &capture.bracket_ev, index);
        bracket.push(image);
    }
    Ok(RawExposures { raw, bracket })
}

/// Lets captures whose frames are given subtract no frame that is not given. Returns the label of each such capture and that of the
/// frame that it subtracted: room light then counts as light of what they show.
pub fn subtract_what_is_given(study: &mut Study, is_given: impl Fn(&str) -> bool) -> Vec<(String, String)> {
    let mut left_out = Vec::new();
    for capture in study.captures.iter_mut().filter(|capture| is_given(&capture.frame.label)) {
        if let Some(missing) = capture.subtract.take_if(|label| !is_given(label)) {
            left_out.push((capture.frame.label.clone(), missing));
        }
    }
    left_out
}

/// Develops raw frames: calibrates and merges the exposures of each, subtracts the frame that the study names for it,
/// interpolates the colors.
///
/// # Errors
/// When a frame to subtract is missing, or frames and calibration do not fit.
pub fn develop_frames(
    study: &Study,
    exposures: Vec<RawExposures>,
    calibration: &Calibration,
) -> Result<Vec<CapturedFrame>, PipelineError> {
    develop_some(study, exposures, calibration, |_| true)
}

/// [`develop_frames`], of those that are wanted.
fn develop_some(
    study: &Study,
    exposures: Vec<RawExposures>,
    calibration: &Calibration,
    is_wanted: impl Fn(&str) -> bool,
) -> Result<Vec<CapturedFrame>, PipelineError> {
    // Calibrate and merge the exposures of each frame
    let merge = |frame: &RawExposures| {
        let all: Vec<&SensorImage> = frame.all().collect();
        merge_exposures(&all, |index| calibration.development(all[index]))
    };
    let linear: Vec<LinearMosaic> = exposures.par_iter().map(merge).collect::<Result<_, _>>()?;
    // Subtract ambient frames and demosaic
    let develop = |frame: &LinearMosaic| -> Result<ChannelImage, PipelineError> {
        Ok(match study.capture(&frame.label).and_then(|c| c.subtract.as_deref()) {
            None => frame.demosaic(calibration.demosaicing)?,
            Some(label) => {
                let [own, other] = [index_of(&linear, &frame.label)?, index_of(&linear, label)?];
                let left = match with_shared_dark([&exposures[own], &exposures[other]], calibration)? {
                    Some([frame, ambient]) => frame.without(&ambient)?,
                    None => frame.clone().without(&linear[other])?,
                };
                left.demosaic(calibration.demosaicing)?
            }
        })
    };
    let wanted: Vec<&LinearMosaic> = linear.iter().filter(|frame| is_wanted(&frame.label)).collect();
    let developed: Vec<ChannelImage> = wanted.into_par_iter().map(develop).collect::<Result<_, _>>()?;
    Ok(exposures
        .into_iter()
        .filter(|frame| is_wanted(&frame.raw.label))
        .zip(developed)
        .map(|(frame, developed)| CapturedFrame { raw: frame.raw, bracket: frame.bracket, developed })
        .collect())
}

/// A frame and the one that it subtracts, of one exposure each, where both have the same dark frames.
pub(super) fn with_shared_dark(
    frames: [&RawExposures; 2],
    calibration: &Calibration,
) -> Result<Option<[LinearMosaic; 2]>, PipelineError> {
    let [first, second] =
        [calibration.development(&frames[0].raw)?, calibration.development(&frames[1].raw)?];
    let is_shared = first.dark.zip(second.dark).is_some_and(|(dark, other)| std::ptr::eq(dark, other));
    if !is_shared || frames.iter().any(|frame| !frame.bracket.is_empty()) {
        return Ok(None);
    }
    let development = Development { is_dark_shared: true, ..first };
    Ok(Some([development.linearize(&frames[0].raw)?, development.linearize(&frames[1].raw)?]))
}

/// Where the frame of a name is.
fn index_of(frames: &[LinearMosaic], label: &str) -> Result<usize, PipelineError> {
    frames.iter().position(|other| other.label == label).ok_or_else(|| {
        let known = frames.iter().map(|other| other.label.as_str()).collect::<Vec<_>>();
        PipelineError::NoFrame { wanted: label.into(), known: known.join(", ") }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{SensorModel, Shutter, SpectralQe};
    use crate::spectral::Curve;

    fn sensor(kind: ShutterKind) -> Sensor {
        let shutter = Shutter { kind, row_time_us: 100.0, ..Shutter::default() };
        let mosaic = vec![vec!["mono".into()]];
        let model = SensorModel { columns: 60, rows: 40, mosaic, shutter, ..SensorModel::default() };
        Sensor::new(model, SpectralQe::from_curves([("mono", Curve::constant(0.6))]).unwrap()).unwrap()
    }

    #[test]
    fn a_rolling_shutter_sees_what_drifts_row_by_row() {
        let exposure = Exposure { time_s: 0.001, ..Exposure::default() };
        assert_eq!(rolling_steps(&sensor(ShutterKind::Global), &exposure, [1e3, 0.0]), None);
        let rolling = sensor(ShutterKind::Rolling);
        assert_eq!(rolling_steps(&rolling, &exposure, [0.0; 2]), None);
        // 40 rows of 0.1 ms and the exposure: 5 ms, 5 pixels, ten steps.
        let times_s = rolling_steps(&rolling, &exposure, [0.0, -1e3]).unwrap();
        assert_eq!(times_s.len(), 10);
        assert!((times_s[9] - 0.0045).abs() < 1e-12);
        assert_eq!(rolling_steps(&rolling, &exposure, [1e9, 0.0]).unwrap().len(), 64);
    }

    #[test]
    fn an_upright_edge_that_drifts_leans() {
        let sensor = sensor(ShutterKind::Rolling);
        let film = sensor.film_extent();
        let data = (0..60 * 40).map(|pixel| if pixel % 60 < 30 { 1e4 } else { 0.0 }).collect();
        let rates = FilmRates { width: 60, height: 40, data };
        let exposure = Exposure { time_s: 0.001, ..Exposure::default() };
        let times_s = rolling_steps(&sensor, &exposure, [1000.0, 0.0]).unwrap();
        let middle_s = |step: usize| times_s[step] + 0.5 * times_s[1];
        let rate = sensor
            .rate_over_time(&times_s, &exposure, |step| {
                sensor.electron_rate_of(&shifted(&rates, 1000.0 * middle_s(step), 0.0), film)
            })
            .unwrap();
        let full = rate.data[0];
        for (row, pixels) in rate.data.chunks_exact(60).enumerate() {
            // Lit pixels: the mean place of the edge during the row's exposure, which begins 0.1 ms later in each row.
            let lit = pixels.iter().map(|value| f64::from(value / full)).sum::<f64>();
            let expected = 30.0 + 1000.0 * (1e-4 * row as f64 + 0.5e-3);
            // Steps of half a pixel, of which a row sees two or three.
            assert!((lit - expected).abs() < 0.25, "row {row}: {lit}, expected {expected}");
        }
    }
}
