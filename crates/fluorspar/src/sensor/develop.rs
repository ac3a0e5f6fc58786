//! From raw frames to linear channel images.

use thiserror::Error;

use super::adc::QUANTIZATION_NOISE_DN;
use super::calibration::{BadPixels, DarkenedFrame, FlatField, MasterFrame, is_same_setting};
use super::demosaic::{Demosaic, Demosaicing};
use crate::image::{CalibrationNoise, ChannelImage, Mosaic, SensorImage, SubtractedLight};

/// Raw frames that can't be developed together.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DevelopError {
    /// Frames of different sensors.
    #[error(
        "frame \"{frame}\" and ambient frame \"{ambient}\" differ in size or color filter array; take both with one \
         sensor"
    )]
    DifferentSensors {
        /// Label of the frame.
        frame: String,
        /// Label of the ambient frame.
        ambient: String,
    },
    /// Without time or gain the ambient frame has no scale.
    #[error(
        "ambient frame \"{ambient}\" has an exposure of {exposure_s} s; take it with a positive exposure"
    )]
    NoExposure {
        /// Label of the ambient frame.
        ambient: String,
        /// Its exposure time, s.
        exposure_s: f64,
    },
    /// A calibration of another sensor.
    #[error(
        "the {what} has {columns} x {rows} pixels or another color filter array than frame \"{frame}\"; take both with \
         one sensor"
    )]
    OtherCalibration {
        /// "dark frame", "flat field" or "map of bad pixels".
        what: &'static str,
        /// Its columns.
        columns: usize,
        /// Its rows.
        rows: usize,
        /// Label of the frame.
        frame: String,
    },
    /// A dark frame of another exposure holds another dark signal.
    #[error(
        "the dark frame \"{dark}\" has {}, the frame \"{frame}\" {}: another {}; take dark frames with the exposure time and gain of the \
         frame, which may differ by 1 %",
        setting(*.dark_s, *.dark_gain), setting(*.exposure_s, *.gain), difference([*.dark_s, *.exposure_s], [*.dark_gain, *.gain])
    )]
    OtherExposure {
        /// Name of the dark frame.
        dark: String,
        /// Exposure of the dark frame, s.
        dark_s: f64,
        /// Its gain, DN per electron.
        dark_gain: f64,
        /// Label of the frame.
        frame: String,
        /// Exposure of the frame, s.
        exposure_s: f64,
        /// Its gain, DN per electron.
        gain: f64,
    },
    /// A dark frame that no frame can use.
    #[error(
        "the dark frame \"{dark}\" has {}, which no other frame has; leave it out, or take it with the exposure time and gain of a \
         frame", setting(*.dark_s, *.dark_gain)
    )]
    UnusedDark {
        /// Name of the dark frame.
        dark: String,
        /// Its exposure, s.
        dark_s: f64,
        /// Its gain, DN per electron.
        dark_gain: f64,
    },
    /// Frames of different exposures have no mean.
    #[error(
        "the frame \"{}\" has {}, the frame \"{}\" {}; average frames of one exposure time and gain, which may differ by 1 %",
        .frames[0], setting(.exposure_s[0], .gain[0]), .frames[1], setting(.exposure_s[1], .gain[1])
    )]
    DifferentExposures {
        /// Their names.
        frames: [String; 2],
        /// Their exposures, s.
        exposure_s: [f64; 2],
        /// Their gains, DN per electron.
        gain: [f64; 2],
    },
    /// Frames of even light that are full.
    #[error(
        "{percent:.1} % of the {channel} pixels of the flat frame \"{flat}\" are saturated; take frames of even light with a shorter \
         exposure time"
    )]
    SaturatedFlat {
        /// Name of the first flat frame.
        flat: String,
        /// The channel.
        channel: String,
        /// Share of its pixels, %.
        percent: f64,
    },
    /// Dark frames that are full.
    #[error(
        "{percent:.1} % of the {channel} pixels of the dark frame \"{dark}\" are saturated; take dark frames with the cap on the lens"
    )]
    SaturatedDark {
        /// Name of the first dark frame.
        dark: String,
        /// The channel.
        channel: String,
        /// Share of its pixels, %.
        percent: f64,
    },
    /// Dark frames that light fell on.
    #[error("the dark frame \"{dark}\" {how}: light fell on it; take dark frames with the cap on the lens")]
    LitDark {
        /// Name of the first dark frame.
        dark: String,
        /// What shows it.
        how: String,
    },
    /// Frames of even light that tell less of a pixel's response than their noise.
    #[error(
        "a {channel} pixel of the mean of {frames} flat frames, \"{flat}\" the first, has a signal of {signal_to_noise:.1} times its noise, \
         fewer than {least}; take frames of brighter even light{}", or_more(*.wanted)
    )]
    DimFlat {
        /// Name of the first flat frame.
        flat: String,
        /// The channel.
        channel: String,
        /// How many there are.
        frames: usize,
        /// Signal of a pixel of the mean over its noise.
        signal_to_noise: f64,
        /// The least that is taken.
        least: f64,
        /// How many would do, with as many dark frames; none where there is no signal.
        wanted: Option<usize>,
    },
    /// Gradient-corrected interpolation of something that is not a Bayer array.
    #[error(
        "frame \"{frame}\" has no two by two Bayer array; gradient-corrected interpolation needs one. Set develop.demosaic \
         = \"bilinear\""
    )]
    NotBayer {
        /// Label of the frame.
        frame: String,
    },
    /// Bad pixels of something that is no mosaic.
    #[error(
        "bad pixels are found among the pixels of a mosaic, and these frames hold all channels in every pixel; remove \
         develop.bad_pixel_sigma"
    )]
    BadPixelsOfChannels,
    /// Nothing to average.
    #[error("there is no exposure to merge, or no raw frame to average; give at least one")]
    Nothing,
}

/// What two settings differ in.
fn difference([a_s, b_s]: [f64; 2], [a_gain, b_gain]: [f64; 2]) -> &'static str {
    match (is_same_setting(a_s, b_s), is_same_setting(a_gain, b_gain)) {
        (true, _) => "gain (ISO)",
        (false, true) => "exposure time",
        (false, false) => "exposure time and gain (ISO)",
    }
}

/// How many frames would do, in words.
fn or_more(wanted: Option<usize>) -> String {
    wanted.map_or_else(String::new, |wanted| {
        format!(", or {wanted} of them and as many dark frames of their exposure time")
    })
}

/// Exposure time and gain in words.
fn setting(exposure_s: f64, dn_per_electron: f64) -> String {
    let rounded = |value: f64, digits: f64| (value * digits).round() / digits;
    format!("{} ms and {} DN/e-", rounded(1e3 * exposure_s, 1e6), rounded(dn_per_electron, 1e4))
}

/// How raw frames become linear channels. The default subtracts the black level and interpolates bilinearly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Development<'a> {
    /// Interpolation of the colors.
    pub demosaicing: Demosaicing,
    /// Mean of dark frames of the same exposure and gain, subtracted in place of the black level.
    pub dark: Option<&'a MasterFrame>,
    /// Whether the frame that will be subtracted has the same dark frames, whose noise then cancels.
    pub is_dark_shared: bool,
    /// Response of each pixel to even light, divided out.
    pub flat: Option<&'a FlatField>,
    /// Pixels to be replaced by the mean of their nearest good neighbors of the same color.
    pub bad_pixels: Option<&'a BadPixels>,
}

/// A frame on its mosaic in linear digital numbers, black subtracted: between raw frame and channel image.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearMosaic {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Color filter array.
    pub mosaic: Mosaic,
    /// Digital numbers above black, `[row, col]`, or `[row, col, channel]` of a frame that has all channels in every pixel; may be below
    /// zero.
    pub values: Vec<f32>,
    /// Pixels whose value is wrong because the sensor was full.
    pub saturated: Vec<bool>,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Exposure time times gain: digital numbers for one electron per second.
    pub dn_s_per_electron: f64,
    /// Standard deviation of the dark noise of one value, DN.
    pub noise_floor_dn: f64,
    /// Digital numbers between black and saturation.
    pub full_scale_dn: f64,
    /// Light of another frame that was subtracted: its level in digital numbers of this frame, `[row, col]`, and this frame's
    /// exposure time over that of the other.
    pub subtracted: Option<(Vec<f32>, f64)>,
    /// What the frames that calibrated it add to its noise.
    pub calibration: Option<CalibratedValues>,
    /// Name of the frame.
    pub label: String,
}

/// What dark frames and a flat field add to the noise of the values of a mosaic, and what merged exposures take from it.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibratedValues {
    /// Added to the variance of each value, DN²: shot noise of dark charge, and what the flat field's factor does to all noise; below
    /// zero where longer exposures were merged.
    pub variance_dn2: Vec<f32>,
    /// Variance of the flat field's factor of each value, over its square; empty without a flat field.
    pub factor_variance: Vec<f32>,
    /// Variance of the scale of each channel, over its square.
    pub scale_variance: Vec<f64>,
    /// Mean variance that the noise of dark frames leaves in each channel, DN².
    pub dark_pattern_dn2: Vec<f64>,
    /// Mean of `factor_variance` in each channel.
    pub mean_factor_variance: Vec<f64>,
    /// Variance of what lines share in one frame, over that of frames without calibration, of each value; empty where it is the same.
    pub line_variance: Vec<f32>,
    /// Whether dark frames were subtracted.
    pub has_dark: bool,
}

impl CalibratedValues {
    /// Of values from which dark levels were subtracted and which a flat field multiplied. The noise of a dark value is that of the raw
    /// frame and of the dark frames, but for the shot noise of the dark charge.
    fn new(development: &Development<'_>, raw: &SensorImage, values: &[f32], noise_dn: f64) -> Option<Self> {
        let (dark, flat) = (development.dark, development.flat);
        if dark.is_none() && flat.is_none() && raw.factors.is_empty() {
            return None;
        }
        let k = raw.dn_per_electron;
        let charge_dn2 = |dark: &MasterFrame, value: usize| charge_noise_dn2(dark, raw, value);
        let frames = development.dark_frames();
        let factor_of = |value: usize| match flat {
            Some(flat) => f64::from(flat.gain[value]),
            None => raw.factors.get(value).map_or(1.0, |factor| f64::from(*factor)),
        };
        let variance = |(value, &dn): (usize, &f32)| {
            let of_charge = dark.map_or(0.0, |dark| charge_dn2(dark, value) * (1.0 + 1.0 / frames));
            let factor = factor_of(value);
            let shot = k * f64::from(dn).max(0.0);
            ((factor * factor - 1.0) * noise_dn * noise_dn
                + (factor - 1.0) * shot
                + factor * factor * of_charge) as f32
        };
        // `noise_dn` holds that of the frame and, over their number, that of the dark frames
        let of_dark = |dark: &MasterFrame, value: usize| {
            noise_dn * noise_dn / (frames + 1.0) + charge_dn2(dark, value) / frames
        };
        let dark_pattern = |value| dark.map_or(0.0, |dark| of_dark(dark, value));
        // The mean of dark frames has lines of its own
        let of_darks = 1.0 + dark.map_or(0.0, |_| 1.0 / frames);
        let of_flat = |value: usize| flat.map_or(0.0, |flat| f64::from(flat.factor_variance[value]));
        Some(Self {
            variance_dn2: values.iter().enumerate().map(variance).collect(),
            dark_pattern_dn2: mean_by_channel(raw, &|value| factor_of(value).powi(2) * dark_pattern(value)),
            mean_factor_variance: mean_by_channel(raw, &of_flat),
            line_variance: (0..values.len())
                .map(|value| (factor_of(value).powi(2) * of_darks) as f32)
                .collect(),
            factor_variance: flat.map(|flat| flat.factor_variance.clone()).unwrap_or_default(),
            scale_variance: flat
                .map_or_else(|| vec![0.0; raw.mosaic.channels.len()], |flat| flat.scale_variance.clone()),
            has_dark: dark.is_some(),
        })
    }

    /// Of so many values that nothing was done to.
    fn none(mosaic: &Mosaic, values: usize) -> Self {
        Self {
            variance_dn2: vec![0.0; values],
            factor_variance: Vec::new(),
            scale_variance: vec![0.0; mosaic.channels.len()],
            dark_pattern_dn2: Vec::new(),
            mean_factor_variance: Vec::new(),
            line_variance: Vec::new(),
            has_dark: false,
        }
    }

    /// What is added to the variance of each value, the error of its flat field's factor with it.
    fn added(&self, values: &[f32]) -> Vec<f32> {
        let mut added = self.variance_dn2.clone();
        for ((added, value), factor) in added.iter_mut().zip(values).zip(&self.factor_variance) {
            *added += factor * value.max(0.0) * value.max(0.0);
        }
        added
    }

    /// Of a developed image, whose values have what is added to the variance of each.
    fn of_image(&self, variance_dn2: Vec<f32>) -> CalibrationNoise {
        CalibrationNoise {
            variance_dn2,
            scale_variance: self.scale_variance.clone(),
            dark_pattern_dn2: self.dark_pattern_dn2.clone(),
            factor_variance: self.mean_factor_variance.clone(),
            line_variance: self.line_variance.clone(),
            has_dark: self.has_dark,
            has_flat: !self.factor_variance.is_empty(),
        }
    }
}

/// Variance of a value of a frame by the charge that dark frames tell of, DN².
fn charge_noise_dn2(dark: &MasterFrame, raw: &SensorImage, value: usize) -> f64 {
    let k = raw.dn_per_electron;
    k * dark.dark_scale(raw.exposure_s, k) * dark.charge_dn(value)
}

/// Means over the values of each channel.
fn mean_by_channel(raw: &SensorImage, of: &dyn Fn(usize) -> f64) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0f64); raw.mosaic.channels.len()];
    for value in 0..raw.data.len() {
        let (sum, count) = &mut sums[raw.channel_of(value)];
        (*sum, *count) = (*sum + of(value), *count + 1.0);
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1.0)).collect()
}

/// Part of the range by which a frame may lie below its dark frame: black levels drift.
const LIT_SHARE: f64 = 0.01;

impl Development<'_> {
    /// Dark frames whose noise the mean of them has.
    fn dark_frames(&self) -> f64 {
        match self.dark {
            Some(dark) if !self.is_dark_shared => dark.frames.max(1) as f64,
            _ => f64::INFINITY,
        }
    }

    /// A raw frame in linear digital numbers: minus dark frame or black level, divided by the flat field or else times the factors of
    /// its file, bad pixels replaced.
    ///
    /// # Errors
    /// Calibration frames that do not fit the frame.
    pub fn linearize(&self, raw: &SensorImage) -> Result<LinearMosaic, DevelopError> {
        let fits =
            |what: &'static str, columns: usize, rows: usize, mosaic: Option<&Mosaic>, values: usize| {
                let is_alike = mosaic.is_none_or(|m| *m == raw.mosaic) && values == raw.data.len();
                if (columns, rows) == (raw.width, raw.height) && is_alike {
                    return Ok(());
                }
                Err(DevelopError::OtherCalibration { what, columns, rows, frame: raw.label.clone() })
            };
        let mut noise_dn = noise_floor_dn(raw);
        let mut values: Vec<f32> = match self.dark {
            None => {
                let above = |(value, &dn): (usize, &u16)| (f64::from(dn) - raw.black_of(value)) as f32;
                raw.data.iter().enumerate().map(above).collect()
            }
            Some(dark) => {
                fits("dark frame", dark.width, dark.height, Some(&dark.mosaic), dark.mean.len())?;
                let levels = dark.dark_levels(&DarkenedFrame {
                    label: &raw.label,
                    exposure_s: raw.exposure_s,
                    dn_per_electron: raw.dn_per_electron,
                    black_level: raw.black_level,
                    black_offsets: &raw.black_offsets,
                })?;
                // The mean of n dark frames has noise of its own.
                noise_dn *= (1.0 + 1.0 / self.dark_frames()).sqrt();
                let left: Vec<f32> =
                    raw.data.iter().zip(&levels).map(|(&dn, dark)| f32::from(dn) - dark).collect();
                let mean = left.iter().map(|dn| f64::from(*dn)).sum::<f64>() / left.len().max(1) as f64;
                if -mean > LIT_SHARE * (f64::from(raw.white_level) - raw.black_level) {
                    let how =
                        format!("has {:.0} DN more than the frame \"{}\" in the mean", -mean, raw.label);
                    return Err(DevelopError::LitDark { dark: dark.label.clone(), how });
                }
                left
            }
        };
        if let Some(flat) = self.flat {
            fits("flat field", flat.width, flat.height, Some(&flat.mosaic), flat.gain.len())?;
            values.iter_mut().zip(&flat.gain).for_each(|(value, gain)| *value *= gain);
        } else {
            // Frames of even light hold all of the shading that the file tells of
            values.iter_mut().zip(&raw.factors).for_each(|(value, factor)| *value *= factor);
        }
        let calibration = CalibratedValues::new(self, raw, &values, noise_dn);
        let mut frame = LinearMosaic { calibration, ..linear(raw, values, noise_dn) };
        if let Some(flat) = self.flat {
            frame.saturated.iter_mut().zip(&flat.saturated).for_each(|(own, flat)| *own |= flat);
        }
        if let Some(bad) = self.bad_pixels {
            fits("map of bad pixels", bad.width, bad.height, None, bad.bad.len())?;
            bad.repair(&mut frame);
        }
        Ok(frame)
    }
}

impl LinearMosaic {
    /// This frame minus the light of another, which is scaled by the ratio of exposure time times gain.
    ///
    /// # Errors
    /// Frames of different sensors, or one to subtract without exposure.
    pub fn without(mut self, ambient: &Self) -> Result<Self, DevelopError> {
        let size = |frame: &Self| (frame.width, frame.height, frame.values.len());
        if size(&self) != size(ambient) || self.mosaic != ambient.mosaic {
            let (frame, ambient) = (self.label, ambient.label.clone());
            return Err(DevelopError::DifferentSensors { frame, ambient });
        }
        if ambient.dn_s_per_electron <= 0.0 || ambient.dn_s_per_electron.is_nan() {
            return Err(DevelopError::NoExposure {
                ambient: ambient.label.clone(),
                exposure_s: ambient.exposure_s,
            });
        }
        let scale = self.dn_s_per_electron / ambient.dn_s_per_electron;
        let levels: Vec<f32> = ambient.values.iter().map(|v| (scale * f64::from(*v)) as f32).collect();
        for (value, other) in self.values.iter_mut().zip(&ambient.values) {
            *value = (f64::from(*value) - scale * f64::from(*other)) as f32;
        }
        let exposure_ratio = self.exposure_s / ambient.exposure_s;
        // One flat field scales both: its error is that of what is left
        if self.calibration.is_some() || ambient.calibration.is_some() {
            let times = exposure_ratio * exposure_ratio;
            let of_lines = |value| {
                ((self.line_variance(value) + times * ambient.line_variance(value)) / (1.0 + times)) as f32
            };
            let line_variance = (0..self.values.len()).map(of_lines).collect();
            let none = || CalibratedValues::none(&ambient.mosaic, ambient.values.len());
            let own = self.calibration.get_or_insert_with(none);
            own.line_variance = line_variance;
            let others = ambient.calibration.iter().flat_map(|by| &by.variance_dn2);
            let scale = (scale * scale) as f32;
            own.variance_dn2.iter_mut().zip(others).for_each(|(own, other)| *own += scale * other);
        }
        self.subtracted = Some((levels, exposure_ratio));
        self.saturated.iter_mut().zip(&ambient.saturated).for_each(|(own, other)| *own |= other);
        self.noise_floor_dn = self.noise_floor_dn.hypot(scale * ambient.noise_floor_dn);
        Ok(self)
    }

    /// Every channel at every pixel.
    ///
    /// # Errors
    /// Gradient correction of a mosaic that is not a Bayer array.
    pub fn demosaic(&self, how: Demosaicing) -> Result<ChannelImage, DevelopError> {
        if self.values.len() > self.width * self.height {
            return Ok(self.with_all_channels());
        }
        let method = match how {
            Demosaicing::Bilinear => Demosaic::new(&self.mosaic),
            Demosaicing::GradientCorrected => Demosaic::gradient_corrected(&self.mosaic)
                .ok_or_else(|| DevelopError::NotBayer { frame: self.label.clone() })?,
        };
        Ok(interpolate(self, &method))
    }
}

impl LinearMosaic {
    /// Variance of what lines share of a value, over that without calibration.
    fn line_variance(&self, value: usize) -> f64 {
        let known = self.calibration.as_ref().and_then(|by| by.line_variance.get(value));
        known.map_or(1.0, |variance| f64::from(*variance))
    }

    /// The frame, where every pixel holds all channels: nothing is interpolated.
    fn with_all_channels(&self) -> ChannelImage {
        let channels = self.mosaic.channels.len().max(1);
        let subtracted = self.subtracted.as_ref();
        ChannelImage {
            width: self.width,
            height: self.height,
            channels: self.mosaic.channels.clone(),
            data: self.values.clone(),
            saturated: self.saturated.chunks_exact(channels).map(|pixel| pixel.contains(&true)).collect(),
            noise_floor_dn: self.noise_floor_dn,
            full_scale_dn: self.full_scale_dn,
            shares: self.mosaic.shares(),
            interpolation: None,
            subtracted: subtracted
                .map(|(dn, ratio)| SubtractedLight { dn: dn.clone(), exposure_ratio: *ratio }),
            calibration: self.calibration.as_ref().map(|by| by.of_image(by.added(&self.values))),
            label: self.label.clone(),
        }
    }
}

/// One exposure of a bracket in electrons: what its noise is made of.
struct Bracketed {
    frame: LinearMosaic,
    exposure_s: f64,
    dn_per_electron: f64,
    /// Read noise and quantization, DN².
    floor_dn2: f64,
}

/// Merges exposures of one view, the first of them being the reference for scale and label.
///
/// Every pixel is the mean of the light that its unsaturated exposures measured, `x_i / (t_i K_i)`, weighted by the inverse of
/// their variance `(K_i² phi t_i + floor_i²) / (t_i K_i)²`. The light `phi` in it is that of all unsaturated exposures
/// together, `sum x_i / sum t_i K_i`, the same for all of them: weights that came from each exposure's own noisy value would
/// favor the low ones. A pixel that is saturated in every exposure takes the least exposed one and is marked.
///
/// # Errors
/// No exposure, one without exposure time or gain, frames of different sensors, calibrations that do not fit. `develop` gives the
/// calibration of each exposure, which differ in their dark frames.
pub fn merge_exposures<'a>(
    exposures: &[&SensorImage],
    develop: impl Fn(usize) -> Result<Development<'a>, DevelopError>,
) -> Result<LinearMosaic, DevelopError> {
    // Linearize every exposure
    let mut bracket = Vec::with_capacity(exposures.len());
    for (index, raw) in exposures.iter().enumerate() {
        let frame = develop(index)?.linearize(raw)?;
        if frame.dn_s_per_electron.is_nan() || frame.dn_s_per_electron <= 0.0 {
            return Err(DevelopError::NoExposure { ambient: raw.label.clone(), exposure_s: raw.exposure_s });
        }
        let floor_dn2 = frame.noise_floor_dn.powi(2);
        let (exposure_s, dn_per_electron) = (raw.exposure_s, raw.dn_per_electron);
        bracket.push(Bracketed { frame, exposure_s, dn_per_electron, floor_dn2 });
    }
    if bracket.len() == 1 {
        return Ok(bracket.swap_remove(0).frame);
    }
    let first = bracket.first().ok_or(DevelopError::Nothing)?;
    let mut merged = first.frame.clone();
    // Check that all come from one sensor
    for other in &bracket[1..] {
        let (a, b) = (&first.frame, &other.frame);
        if (a.width, a.height, a.values.len()) != (b.width, b.height, b.values.len()) || a.mosaic != b.mosaic
        {
            let (frame, ambient) = (a.label.clone(), b.label.clone());
            return Err(DevelopError::DifferentSensors { frame, ambient });
        }
    }
    // Express the result in the scale of the first exposure
    let reference = merged.dn_s_per_electron;
    // In the dark every exposure counts by its floor alone.
    let of_floors: f64 =
        bracket.iter().map(|b| b.frame.dn_s_per_electron.powi(2) / b.floor_dn2.max(f64::MIN_POSITIVE)).sum();
    merged.noise_floor_dn = reference / of_floors.sqrt();
    // What a value's variance has beyond that of a first exposure with this floor: less where longer ones count
    let floor_dn2 = merged.noise_floor_dn.powi(2);
    let more = |variance_dn2: f64, value_dn: f64| {
        (variance_dn2 - floor_dn2 - first.dn_per_electron * value_dn.max(0.0)) as f32
    };
    let mut added_dn2 = vec![0.0f32; merged.values.len()];
    let mut line_variance = vec![0.0f32; merged.values.len()];
    let of_lines = |b: &Bracketed, pixel: usize| {
        (b.dn_per_electron / first.dn_per_electron).powi(2) * b.frame.line_variance(pixel)
    };
    let shortest = (0..bracket.len()).fold(0, |best, i| {
        let light = |i: usize| bracket[i].frame.dn_s_per_electron;
        if light(i) < light(best) { i } else { best }
    });
    // Merge each pixel over its unsaturated exposures
    for (pixel, more_dn2) in added_dn2.iter_mut().enumerate() {
        let usable = || bracket.iter().filter(|b| !b.frame.saturated[pixel]);
        let value = |b: &Bracketed| f64::from(b.frame.values[pixel]);
        let (signal, light) = usable()
            .fold((0.0, 0.0), |(signal, light), b| (signal + value(b), light + b.frame.dn_s_per_electron));
        merged.saturated[pixel] = light == 0.0;
        // Fall back to the least exposed value where all are saturated
        if light == 0.0 {
            let least = &bracket[shortest];
            let scale = reference / least.frame.dn_s_per_electron;
            let own = least.frame.calibration.as_ref().map_or(0.0, |by| f64::from(by.variance_dn2[pixel]));
            let variance_dn2 = least.dn_per_electron * value(least).max(0.0) + least.floor_dn2 + own;
            merged.values[pixel] = (value(least) * scale) as f32;
            *more_dn2 = more(scale * scale * variance_dn2, value(least) * scale);
            line_variance[pixel] = (scale * scale * of_lines(least, pixel)) as f32;
            continue;
        }
        // Weight by inverse variance: shot noise of the common estimate, and the noise floor
        let electrons_per_s = (signal / light).max(0.0);
        let [sum, weights, added, lines] = usable().fold([0.0; 4], |[sum, weights, added, lines], b| {
            let shot_dn2 = b.dn_per_electron.powi(2) * electrons_per_s * b.exposure_s;
            let variance = (shot_dn2 + b.floor_dn2) / b.frame.dn_s_per_electron.powi(2);
            let weight = 1.0 / variance.max(f64::MIN_POSITIVE);
            let scaled = weight / b.frame.dn_s_per_electron;
            let own = b.frame.calibration.as_ref().map_or(0.0, |by| f64::from(by.variance_dn2[pixel]));
            let squared = scaled * scaled;
            let lines = lines + squared * of_lines(b, pixel);
            [sum + scaled * value(b), weights + weight, added + squared * own, lines]
        });
        let value_dn = reference * sum / weights;
        merged.values[pixel] = value_dn as f32;
        *more_dn2 = more((1.0 / weights + added / weights.powi(2)) * reference.powi(2), value_dn);
        line_variance[pixel] = (lines * (reference / weights).powi(2)) as f32;
    }
    let own = merged.calibration.unwrap_or_else(|| CalibratedValues::none(&merged.mosaic, 0));
    let of_floor = floor_dn2 / first.floor_dn2.max(f64::MIN_POSITIVE);
    merged.calibration = Some(CalibratedValues {
        variance_dn2: added_dn2,
        line_variance,
        dark_pattern_dn2: own.dark_pattern_dn2.iter().map(|dn2| of_floor * dn2).collect(),
        ..own
    });
    let scaled = |b: &Bracketed| b.frame.full_scale_dn * reference / b.frame.dn_s_per_electron;
    merged.full_scale_dn = bracket.iter().map(scaled).fold(0.0, f64::max);
    Ok(merged)
}

pub(crate) fn noise_floor_dn(raw: &SensorImage) -> f64 {
    raw.read_noise_dn.hypot(QUANTIZATION_NOISE_DN)
}

fn linear(raw: &SensorImage, values: Vec<f32>, noise_floor_dn: f64) -> LinearMosaic {
    LinearMosaic {
        width: raw.width,
        height: raw.height,
        mosaic: raw.mosaic.clone(),
        values,
        saturated: (0..raw.data.len()).map(|value| raw.is_saturated(value)).collect(),
        exposure_s: raw.exposure_s,
        dn_s_per_electron: raw.exposure_s * raw.dn_per_electron,
        noise_floor_dn,
        full_scale_dn: f64::from(raw.white_level) - raw.black_level,
        subtracted: None,
        calibration: None,
        label: raw.label.clone(),
    }
}

fn interpolate(frame: &LinearMosaic, method: &Demosaic) -> ChannelImage {
    let (data, saturated) = method.interpolate(&frame.values, &frame.saturated, frame.width, frame.height);
    ChannelImage {
        width: frame.width,
        height: frame.height,
        channels: frame.mosaic.channels.clone(),
        data,
        saturated,
        noise_floor_dn: frame.noise_floor_dn,
        full_scale_dn: frame.full_scale_dn,
        shares: frame.mosaic.shares(),
        interpolation: Some(method.taps()),
        subtracted: frame.subtracted.as_ref().map(|(levels, exposure_ratio)| {
            let unmarked = vec![false; levels.len()];
            let (dn, _) = method.interpolate(levels, &unmarked, frame.width, frame.height);
            SubtractedLight { dn, exposure_ratio: *exposure_ratio }
        }),
        calibration: frame.calibration.as_ref().map(|by| {
            let added = by.added(&frame.values);
            let unmarked = vec![false; added.len()];
            by.of_image(method.interpolate(&added, &unmarked, frame.width, frame.height).0)
        }),
        label: frame.label.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Mosaic;

    /// Three values a pixel, black 10: they stay as they are, and a pixel is saturated where one of them is.
    #[test]
    fn a_frame_of_all_channels_is_not_interpolated() {
        let mosaic = Mosaic::bayer("rggb").unwrap();
        let mut frame = raw(vec![0; 2], mosaic, 2);
        (frame.black_level, frame.white_level) = (10.0, 4000);
        frame.data = vec![20, 30, 40, 50, 60, 4000];
        assert!(frame.has_all_channels());
        let developed =
            Development::default().linearize(&frame).unwrap().demosaic(Demosaicing::Bilinear).unwrap();
        assert_eq!(developed.data, [10.0, 20.0, 30.0, 40.0, 50.0, 3990.0]);
        assert_eq!(developed.saturated, [false, true]);
        // Interpolated from a Bayer array, a channel has measured a quarter or a half of the pixels.
        assert_eq!(developed.shares, [0.25, 0.5, 0.25]);
        let stacked =
            Mosaic { rows: 1, cols: 1, pattern: Vec::new(), channels: frame.mosaic.channels.clone() };
        assert_eq!(stacked.shares(), [1.0; 3]);
    }

    fn raw(data: Vec<u16>, mosaic: Mosaic, width: usize) -> SensorImage {
        SensorImage {
            width,
            height: data.len() / width,
            data,
            mosaic,
            black_level: 64.0,
            black_offsets: Vec::new(),
            white_levels: Vec::new(),
            factors: Vec::new(),
            orientation: crate::image::Orientation::default(),
            white_level: 4095,
            bit_depth: 12,
            exposure_s: 0.03,
            gain: 1.0,
            dn_per_electron: 0.5,
            read_noise_dn: 6.0,
            gain_is_assumed: false,
            seed: 0,
            label: "blue".into(),
        }
    }

    #[test]
    fn monochrome_passes_through_below_zero_too() {
        let raw = raw(vec![60, 64, 70, 4095], Mosaic::monochrome(), 2);
        let image = Development::default().linearize(&raw).unwrap().demosaic(Demosaicing::Bilinear).unwrap();
        assert_eq!(image.data, [-4.0, 0.0, 6.0, 4031.0]);
        assert_eq!(image.saturated, [false, false, false, true]);
        assert_eq!(image.full_scale_dn, 4031.0);
        assert!((image.noise_floor_dn - (36.0f64 + 1.0 / 12.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn ambient_light_is_scaled_by_exposure_and_gain() {
        let develop_with_ambient = |raw: &SensorImage, ambient: &SensorImage| {
            let plain = Development::default();
            plain.linearize(raw)?.without(&plain.linearize(ambient)?)?.demosaic(Demosaicing::Bilinear)
        };
        let frame = raw(vec![164; 16], Mosaic::bayer("grbg").unwrap(), 4);
        let mut ambient = raw(vec![74; 16], Mosaic::bayer("grbg").unwrap(), 4);
        // A tenth of the time at twice the gain: its 10 DN are 50 DN of the frame.
        ambient.exposure_s = 0.003;
        ambient.dn_per_electron = 1.0;
        let image = develop_with_ambient(&frame, &ambient).unwrap();
        assert!(image.data.iter().all(|&value| (value - 50.0).abs() < 1e-4), "{:?}", image.data);
        let quantized = (36.0f64 + 1.0 / 12.0).sqrt();
        assert!((image.noise_floor_dn - quantized.hypot(5.0 * quantized)).abs() < 1e-9);
        let subtracted = image.subtracted.unwrap();
        assert!(subtracted.dn.iter().all(|&value| (value - 50.0).abs() < 1e-4));
        assert!((subtracted.exposure_ratio - 10.0).abs() < 1e-12);
        assert_eq!(image.shares, [0.25, 0.5, 0.25]);
        ambient.exposure_s = 0.0;
        assert!(matches!(develop_with_ambient(&frame, &ambient), Err(DevelopError::NoExposure { .. })));
        let other = raw(vec![64; 16], Mosaic::monochrome(), 4);
        assert!(develop_with_ambient(&frame, &other).unwrap_err().to_string().contains("one sensor"));
    }

    /// Two exposures of a flat field: the merged mean is unbiased and its noise that of inverse variances.
    #[test]
    fn merged_exposures_have_the_noise_of_their_weights() {
        use crate::analysis::ChannelNoise;
        use crate::sensor::{ElectronRate, Exposure, Sensor, SensorModel, SpectralQe};
        use crate::spectral::Curve;
        let model = SensorModel {
            columns: 128,
            rows: 128,
            mosaic: vec![vec!["mono".into()]],
            prnu_percent: 0.0,
            dsnu_mv: Some(0.0),
            dark_voltage_mv_per_s: Some(0.0),
            ..SensorModel::default()
        };
        let qe = SpectralQe::from_curves([("mono", Curve::constant(0.6))]).unwrap();
        let sensor = Sensor::new(model, qe).unwrap();
        let pixels = 128 * 128;
        let take = |electrons_per_s: f32, time_s: f64, frame: u64| {
            let rate = ElectronRate { columns: 128, rows: 128, data: vec![electrons_per_s; pixels] };
            let exposure = Exposure { time_s, frame, label: "blue".into(), ..Exposure::default() };
            sensor.expose_rate(&rate, &exposure).unwrap()
        };
        let statistics = |frame: &LinearMosaic| {
            let mean = frame.values.iter().map(|&v| f64::from(v)).sum::<f64>() / pixels as f64;
            let squares = frame.values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>();
            (mean, squares / (pixels - 1) as f64)
        };
        // 3000 e-/s in 10, 40 and 160 ms: 30, 120 and 480 e-, all unsaturated.
        let frames = [take(3000.0, 0.01, 0), take(3000.0, 0.04, 1), take(3000.0, 0.16, 2)];
        let merged =
            merge_exposures(&frames.iter().collect::<Vec<_>>(), |_| Ok(Development::default())).unwrap();
        let k = frames[0].dn_per_electron;
        let floor = frames[0].read_noise_dn.powi(2) + 1.0 / 12.0;
        let inverse: f64 =
            [0.01, 0.04, 0.16].map(|t| (t * k) * (t * k) / (k * k * 3000.0 * t + floor)).iter().sum();
        let variance = (0.01 * k).powi(2) / inverse;
        let (mean, measured) = statistics(&merged);
        // Standard errors: sqrt(V / n), and V sqrt(2 / n); five of them.
        assert!((mean - 30.0 * k).abs() < 5.0 * (variance / pixels as f64).sqrt(), "{mean}");
        assert!(
            (measured / variance - 1.0).abs() < 5.0 * (2.0 / pixels as f64).sqrt(),
            "{measured} {variance}"
        );
        // So the image says of itself
        let said = |merged: &LinearMosaic| {
            let image = merged.demosaic(Demosaicing::Bilinear).unwrap();
            let noise = ChannelNoise::of_image(&image, k, 0.0, 0.0);
            (0..pixels).map(|pixel| noise.of_pixel(&image, [0], pixel)[0]).sum::<f64>() / pixels as f64
        };
        assert!((said(&merged) / variance - 1.0).abs() < 0.02, "{} {variance}", said(&merged));
        assert!(merged.saturated.iter().all(|s| !s));
        assert!(
            (merged.full_scale_dn - (f64::from(frames[0].white_level) - frames[0].black_level)).abs() < 1e-9
        );
        // 400 000 e-/s: only the shortest is unsaturated, then none.
        let bright = [take(4e5, 0.01, 0), take(4e5, 0.04, 1)];
        let merged = merge_exposures(&[&bright[1], &bright[0]], |_| Ok(Development::default())).unwrap();
        let (mean, _) = statistics(&merged);
        assert!(
            (mean / (16_000.0 * k) - 1.0).abs() < 5.0 / (4000.0f64 * pixels as f64).sqrt() + 1e-4,
            "{mean}"
        );
        assert!(merged.saturated.iter().all(|s| !s));
        // In the scale of the long one, with the noise of the short one
        let variance = 16.0 * (k * k * 4000.0 + floor);
        assert!((said(&merged) / variance - 1.0).abs() < 0.02, "{} {variance}", said(&merged));
        let full = [take(4e6, 0.01, 0), take(4e6, 0.04, 1)];
        let merged = merge_exposures(&[&full[0], &full[1]], |_| Ok(Development::default())).unwrap();
        assert!(merged.saturated.iter().all(|s| *s));
        assert_eq!(merge_exposures(&[], |_| Ok(Development::default())), Err(DevelopError::Nothing));
    }

    /// Half of the noise after one dark frame is that frame's: no mean of frames is without it. A bracket under a single frame keeps what
    /// merging did to its noise.
    #[test]
    fn noise_of_calibration_is_told_from_that_of_frames() {
        let frame = raw(vec![80; 16], Mosaic::monochrome(), 4);
        let dark = MasterFrame::average([Ok::<_, DevelopError>(raw(vec![64; 16], Mosaic::monochrome(), 4))])
            .unwrap();
        let development = Development { dark: Some(&dark), ..Development::default() };
        let linear = development.linearize(&frame).unwrap();
        let image = linear.demosaic(Demosaicing::Bilinear).unwrap();
        let pattern = image.calibration.as_ref().unwrap().pattern_dn2(0, 16.0);
        assert!((pattern - image.noise_floor_dn.powi(2) / 2.0).abs() < 1e-9, "{pattern}");
        let bracket = [1.0, 4.0].map(|times| SensorImage { exposure_s: 0.03 * times, ..frame.clone() });
        let ambient = merge_exposures(&[&bracket[0], &bracket[1]], |_| Ok(Development::default())).unwrap();
        let added = ambient.calibration.as_ref().unwrap().variance_dn2.clone();
        let left = Development::default().linearize(&frame).unwrap().without(&ambient).unwrap();
        let left = left.calibration.unwrap();
        assert_eq!(left.variance_dn2, added);
        // Lines of one frame and what merging left of two, over those of two frames; dark frames add to them
        assert!(left.line_variance.iter().all(|variance| (0.5..0.6).contains(variance)), "{left:?}");
        assert!(image.calibration.unwrap().line_variance.iter().all(|variance| *variance == 2.0));
    }

    #[test]
    fn gradient_correction_of_a_monochrome_frame_is_refused() {
        let frame = Development::default().linearize(&raw(vec![64; 4], Mosaic::monochrome(), 2)).unwrap();
        let error = frame.demosaic(Demosaicing::GradientCorrected).unwrap_err();
        assert!(error.to_string().contains("develop.demosaic"), "{error}");
        assert!(frame.demosaic(Demosaicing::Bilinear).is_ok());
    }
}
