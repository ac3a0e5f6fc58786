//! Dark frames, flat fields and bad pixels.

use super::DevelopError;
use super::develop::{LinearMosaic, noise_floor_dn};
use crate::image::{Mosaic, SensorImage};

/// Exposure times and gains that differ by no more than this share count as one: cameras tell theirs to a line of the sensor.
const SAME_EXPOSURE: f64 = 0.01;

/// Whether two exposure times or gains are one setting.
pub(crate) fn is_same_setting(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME_EXPOSURE * a.abs().max(b.abs())
}

/// What dark frames must know of a frame from which they are subtracted.
pub(super) struct DarkenedFrame<'a> {
    pub(super) label: &'a str,
    pub(super) exposure_s: f64,
    pub(super) dn_per_electron: f64,
    pub(super) black_level: f64,
    pub(super) black_offsets: &'a [f32],
}

/// Mean of equal raw frames.
#[derive(Clone, Debug, PartialEq)]
pub struct MasterFrame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Color filter array.
    pub mosaic: Mosaic,
    /// Mean digital number of each pixel, black level included, `[row, col]`.
    pub mean: Vec<f32>,
    /// Pixels that were saturated in any frame.
    pub saturated: Vec<bool>,
    /// Frames averaged.
    pub frames: usize,
    /// Mean of their exposure times, s.
    pub exposure_s: f64,
    /// Their gain, DN per electron.
    pub dn_per_electron: f64,
    /// Their black level, DN.
    pub black_level: f64,
    /// What the black level of each value lies above it, DN; empty where it is the same everywhere.
    pub black_offsets: Vec<f32>,
    /// Standard deviation of the dark noise of one value of one of them, DN.
    pub noise_floor_dn: f64,
    /// Name of the first of them.
    pub label: String,
}

impl MasterFrame {
    /// Averages raw frames of one sensor, exposure and gain. They are taken one by one, so only one is in memory when the
    /// iterator makes them.
    ///
    /// # Errors
    /// No frames, or frames that differ in size, mosaic, exposure or gain.
    pub fn average<E: From<DevelopError>>(
        frames: impl IntoIterator<Item = Result<SensorImage, E>>,
    ) -> Result<Self, E> {
        let mut frames = frames.into_iter();
        let first = frames.next().ok_or(DevelopError::Nothing)??;
        let mut sums: Vec<f64> = first.data.iter().map(|&dn| f64::from(dn)).collect();
        let mut saturated: Vec<bool> = (0..first.data.len()).map(|value| first.is_saturated(value)).collect();
        let mut count = 1usize;
        let noise_floor_dn = noise_floor_dn(&first);
        let mut times_s = first.exposure_s;
        // Add the frames, which must share sensor and exposure
        for frame in frames {
            let frame = frame?;
            let size = |frame: &SensorImage| (frame.width, frame.height, frame.data.len());
            if size(&frame) != size(&first) || frame.mosaic != first.mosaic {
                let (frame, ambient) = (first.label, frame.label);
                return Err(DevelopError::DifferentSensors { frame, ambient }.into());
            }
            if !is_same_setting(frame.exposure_s, first.exposure_s)
                || !is_same_setting(frame.dn_per_electron, first.dn_per_electron)
            {
                return Err(DevelopError::DifferentExposures {
                    frames: [first.label.clone(), frame.label],
                    exposure_s: [first.exposure_s, frame.exposure_s],
                    gain: [first.dn_per_electron, frame.dn_per_electron],
                }
                .into());
            }
            count += 1;
            times_s += frame.exposure_s;
            // Of frames whose black level moved what lies above it counts
            let is_known = first.black_level > 0.0 && frame.black_level > 0.0;
            for (value, (sum, full)) in sums.iter_mut().zip(&mut saturated).enumerate() {
                let moved = if is_known { first.black_of(value) - frame.black_of(value) } else { 0.0 };
                *sum += f64::from(frame.data[value]) + moved;
                *full |= frame.is_saturated(value);
            }
        }
        Ok(Self {
            width: first.width,
            height: first.height,
            mosaic: first.mosaic,
            mean: sums.into_iter().map(|sum| (sum / count as f64) as f32).collect(),
            saturated,
            frames: count,
            exposure_s: times_s / count as f64,
            dn_per_electron: first.dn_per_electron,
            black_level: first.black_level,
            noise_floor_dn,
            black_offsets: first.black_offsets,
            label: first.label,
        })
    }

    /// Whether they were taken with this exposure time and gain.
    pub fn has_exposure(&self, exposure_s: f64, dn_per_electron: f64) -> bool {
        is_same_setting(self.exposure_s, exposure_s) && is_same_setting(self.dn_per_electron, dn_per_electron)
    }

    /// The levels of dark frames in a frame of about their exposure: what lies above their black level grows with exposure time and
    /// gain, and stands on the black level of the frame. Where a black level is not known nothing tells that part, and the levels stay.
    ///
    /// # Errors
    /// Another exposure.
    pub(super) fn dark_levels(&self, frame: &DarkenedFrame<'_>) -> Result<Vec<f32>, DevelopError> {
        let (exposure_s, dn_per_electron) = (frame.exposure_s, frame.dn_per_electron);
        if !self.has_exposure(exposure_s, dn_per_electron) {
            return Err(DevelopError::OtherExposure {
                dark: self.label.clone(),
                dark_s: self.exposure_s,
                dark_gain: self.dn_per_electron,
                frame: frame.label.into(),
                exposure_s,
                gain: dn_per_electron,
            });
        }
        let scale = self.dark_scale(exposure_s, dn_per_electron);
        let has_other_black = self.black_level > 0.0
            && frame.black_level > 0.0
            && (self.black_level, self.black_offsets.as_slice()) != (frame.black_level, frame.black_offsets);
        if scale == 1.0 && !has_other_black {
            return Ok(self.mean.clone());
        }
        let level = |(value, &dn): (usize, &f32)| {
            let own = self.black_of(value);
            let black = match has_other_black {
                true => frame.black_level + frame.black_offsets.get(value).map_or(0.0, |o| f64::from(*o)),
                false => own,
            };
            (black + scale * (f64::from(dn) - own)) as f32
        };
        Ok(self.mean.iter().enumerate().map(level).collect())
    }

    /// The median of each channel above the black level in words, where they differ by more than `least` times the dark noise of one
    /// value: without light channels differ in nothing.
    pub(crate) fn uneven_channels(&self, least: f64) -> Option<String> {
        let level = |channel: usize| {
            let above = |value: usize| (f64::from(self.mean[value]) - self.black_of(value)) as f32;
            median(&mut self.values_of(channel).map(above).collect::<Vec<_>>()).map(f64::from)
        };
        let names = self.mosaic.channels.iter().enumerate();
        let levels: Vec<(&str, f64)> =
            names.filter_map(|(channel, name)| Some((name.as_str(), level(channel)?))).collect();
        let (low, high) =
            levels.iter().fold((f64::MAX, f64::MIN), |(l, h), (_, dn)| (l.min(*dn), h.max(*dn)));
        (high - low > least * self.noise_floor_dn.max(1.0)).then(|| {
            let levels: Vec<String> = levels.iter().map(|(name, dn)| format!("{name} {dn:.1}")).collect();
            format!("{} DN", levels.join(", "))
        })
    }

    /// Refuses dark frames of which more of a channel's pixels are full than may be defect, and those that light fell on.
    pub(crate) fn refuse_lit_dark(&self) -> Result<(), DevelopError> {
        for (channel, name) in self.mosaic.channels.iter().enumerate() {
            if let Some(percent) = self.percent_saturated(channel) {
                let (dark, channel) = (self.label.clone(), name.clone());
                return Err(DevelopError::SaturatedDark { dark, channel, percent });
            }
        }
        match self.uneven_channels(LIT_CHANNELS) {
            Some(levels) => {
                let how = format!("has channels that differ by far more than noise, {levels}");
                Err(DevelopError::LitDark { dark: self.label.clone(), how })
            }
            None => Ok(()),
        }
    }

    /// What the part above the black level is multiplied by for a frame of this exposure.
    pub fn dark_scale(&self, exposure_s: f64, dn_per_electron: f64) -> f64 {
        let own = self.exposure_s * self.dn_per_electron;
        if self.black_level > 0.0 && own > 0.0 { exposure_s * dn_per_electron / own } else { 1.0 }
    }

    /// What a value holds above its black level without light, DN: dark charge. 0 where the black level is not known.
    pub(super) fn charge_dn(&self, value: usize) -> f64 {
        if self.black_level > 0.0 {
            (f64::from(self.mean[value]) - self.black_of(value)).max(0.0)
        } else {
            0.0
        }
    }

    /// Variance of a value of one of the frames, which holds so much light and charge, DN².
    fn variance_of_one_dn2(&self, collected_dn: f64) -> f64 {
        self.noise_floor_dn.powi(2) + self.dn_per_electron * collected_dn.max(0.0)
    }

    /// Variance of a value of the mean whose frames hold so much light and charge, DN².
    fn variance_dn2(&self, collected_dn: f64) -> f64 {
        self.variance_of_one_dn2(collected_dn) / self.frames.max(1) as f64
    }

    pub(super) fn black_of(&self, value: usize) -> f64 {
        self.black_level + self.black_offsets.get(value).map_or(0.0, |offset| f64::from(*offset))
    }

    /// Values of a pixel: 1 on a mosaic, or all channels.
    pub(super) fn samples(&self) -> usize {
        (self.mean.len() / (self.width * self.height).max(1)).max(1)
    }

    /// Numbers of the values of a channel.
    pub(super) fn values_of(&self, channel: usize) -> impl Iterator<Item = usize> {
        let (width, mosaic, samples) = (self.width, &self.mosaic, self.samples());
        (0..self.mean.len()).filter(move |value| match samples {
            1 => mosaic.channel(value / width, value % width) == channel,
            _ => value % samples == channel,
        })
    }
}

/// Response of each pixel to even light, as the factor that evens it out.
///
/// Each channel is scaled to its own response on the axis, where a quadratic that is fitted to the middle ninth of the image has it:
/// there digital numbers keep their meaning, toward the corners values grow by what the lens loses there, and their noise with them.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatField {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Color filter array.
    pub mosaic: Mosaic,
    /// Factors, `[row, col]`; 1 where a pixel has no usable response.
    pub gain: Vec<f32>,
    /// Variance of each by the noise of the frames, over its square; 0 where a pixel has no usable response.
    pub factor_variance: Vec<f32>,
    /// The same of the response on the axis, by channel; how the responses of the pixels differ there counts, too.
    pub scale_variance: Vec<f64>,
    /// Pixels that were saturated in any frame.
    pub saturated: Vec<bool>,
    /// Name of the first of the frames of even light.
    pub label: String,
    /// Exposure time of each, s.
    pub exposure_s: f64,
    /// Their gain, DN per electron.
    pub dn_per_electron: f64,
}

/// Pixels that respond less than this share of the middle have no usable response.
const LEAST_RESPONSE: f32 = 0.02;
/// Times the dark noise of one value by which channels of a dark frame differ where light fell on it: those of a readout differ by less.
const LIT_CHANNELS: f64 = 10.0;
/// Frames of even light of which more of a channel's pixels are saturated are refused; so many may be defect.
const MOST_SATURATED: f64 = 0.01;
/// Least signal over noise of a middling pixel in the mean of the frames: below, the inverse of its response is hardly known.
const LEAST_SIGNAL_TO_NOISE: f64 = 5.0;
/// Fewest pixels that a quadratic is fitted to: twice its terms.
const LEAST_FITTED: usize = 12;
/// Least part of a constant, squared, that may be orthogonal to the terms of a quadratic: in a full square it is 2/7.
const LEAST_ORTHOGONAL: f64 = 0.05;

impl FlatField {
    /// The factors of averaged frames of even light, minus dark frames of the same exposure or else the black level.
    ///
    /// The inverse of a response `S` with the variance `V` is too large by `1 + V/S²` in the mean, which is taken out.
    ///
    /// # Errors
    /// A dark frame of another sensor or exposure; frames that are saturated, or whose noise is as large as what they tell.
    pub fn new(flat: &MasterFrame, dark: Option<&MasterFrame>) -> Result<Self, DevelopError> {
        let signal = signal(flat, dark)?;
        let relative_variance = |value: usize| {
            let light = f64::from(signal[value]);
            let charge = dark.map_or(0.0, |dark| dark.charge_dn(value));
            let of_dark = dark.map_or(0.0, |dark| dark.variance_dn2(charge));
            (flat.variance_dn2(light + charge) + of_dark) / (light * light)
        };
        // Of one frame of light and one dark frame, which may still have to be taken
        let variance_of_pair = |value: usize| {
            let light = f64::from(signal[value]);
            let charge = dark.map_or(0.0, |dark| dark.charge_dn(value));
            let of_dark = dark.unwrap_or(flat).variance_of_one_dn2(charge);
            ((flat.variance_of_one_dn2(light + charge) + of_dark) / (light * light)) as f32
        };
        let channels = flat.mosaic.channels.len();
        let mut field = Self {
            width: flat.width,
            height: flat.height,
            mosaic: flat.mosaic.clone(),
            gain: vec![1.0; signal.len()],
            factor_variance: vec![0.0; signal.len()],
            scale_variance: vec![0.0; channels],
            saturated: flat.saturated.clone(),
            label: flat.label.clone(),
            exposure_s: flat.exposure_s,
            dn_per_electron: flat.dn_per_electron,
        };
        let (mut dimmest, mut pairs) = ((0, 0.0), 0.0f64);
        for channel in 0..channels {
            flat.refuse_saturated(channel)?;
            let Some(axis) = AxisResponse::new(flat, channel, &signal) else {
                // A name of which the array has no pixel
                if flat.values_of(channel).next().is_none() {
                    continue;
                }
                return Err(flat.dim(channel, f64::INFINITY, None));
            };
            let is_usable = |&value: &usize| f64::from(signal[value]) > f64::from(LEAST_RESPONSE) * axis.dn;
            for value in flat.values_of(channel).filter(is_usable) {
                let variance = relative_variance(value);
                field.gain[value] = (axis.dn / f64::from(signal[value]) / (1.0 + variance)) as f32;
                field.factor_variance[value] = variance as f32;
            }
            let middling = |of: &dyn Fn(usize) -> f32| {
                let mut values: Vec<f32> = flat.values_of(channel).filter(is_usable).map(of).collect();
                median(&mut values).map_or(0.0, f64::from)
            };
            let variance = middling(&|value| field.factor_variance[value]);
            if variance > dimmest.1 {
                dimmest = (channel, variance);
            }
            pairs = pairs.max(middling(&variance_of_pair));
            let of_weight = |&(value, weight): &(usize, f64)| {
                weight * weight * relative_variance(value) * f64::from(signal[value]).powi(2)
            };
            let of_noise = axis.weights.iter().map(of_weight).sum::<f64>() / (axis.dn * axis.dn);
            let of_scatter = axis.weights.iter().map(|(_, weight)| weight * weight).sum::<f64>()
                * relative_scatter(flat, channel, &signal);
            field.scale_variance[channel] = of_noise.max(of_scatter);
        }
        let (channel, variance) = dimmest;
        if variance > LEAST_SIGNAL_TO_NOISE.powi(-2) {
            let wanted = (pairs * LEAST_SIGNAL_TO_NOISE.powi(2)).ceil() as usize;
            return Err(flat.dim(channel, variance, Some(wanted)));
        }
        Ok(field)
    }
}

impl MasterFrame {
    /// Share of a channel's pixels that are full, %, where they are more than may be defect.
    fn percent_saturated(&self, channel: usize) -> Option<f64> {
        let (full, all) = self.values_of(channel).fold((0usize, 0usize), |(full, all), value| {
            (full + usize::from(self.saturated[value]), all + 1)
        });
        let share = full as f64 / all.max(1) as f64;
        (share > MOST_SATURATED).then_some(100.0 * share)
    }

    fn refuse_saturated(&self, channel: usize) -> Result<(), DevelopError> {
        let Some(percent) = self.percent_saturated(channel) else { return Ok(()) };
        let (flat, channel) = (self.label.clone(), self.mosaic.channels[channel].clone());
        Err(DevelopError::SaturatedFlat { flat, channel, percent })
    }

    /// Why frames of even light are refused whose pixels have this variance over their squared signal.
    fn dim(&self, channel: usize, relative_variance: f64, wanted: Option<usize>) -> DevelopError {
        DevelopError::DimFlat {
            flat: self.label.clone(),
            channel: self.mosaic.channels[channel].clone(),
            frames: self.frames,
            signal_to_noise: relative_variance.powf(-0.5),
            least: LEAST_SIGNAL_TO_NOISE,
            wanted,
        }
    }
}

/// Response of a channel on the axis: the constant of a quadratic in column and row, fitted to the middle ninth by least squares.
struct AxisResponse {
    /// DN.
    dn: f64,
    /// The values that it is a weighted sum of, with their weights.
    weights: Vec<(usize, f64)>,
}

impl AxisResponse {
    /// `None` of a channel without a response. Of few pixels it is their mean.
    fn new(flat: &MasterFrame, channel: usize, signal: &[f32]) -> Option<Self> {
        let middle = |line: usize, lines: usize| 3 * line >= lines && 3 * line < 2 * lines;
        let place = |value: usize| {
            let pixel = value / flat.samples();
            [pixel / flat.width, pixel % flat.width]
        };
        let is_middle = |&value: &usize| {
            let [row, col] = place(value);
            middle(row, flat.height) && middle(col, flat.width)
        };
        let mut values: Vec<usize> = flat.values_of(channel).filter(is_middle).collect();
        if values.is_empty() {
            values = flat.values_of(channel).collect();
        }
        // Leave out defect pixels
        let typical = median(&mut values.iter().map(|&value| signal[value]).collect::<Vec<_>>())?;
        values.retain(|&value| {
            (0.5 * typical..=2.0 * typical).contains(&signal[value]) && !flat.saturated[value]
        });
        let terms = match values.len() {
            0 => return None,
            few if few < LEAST_FITTED => Vec::new(),
            _ => {
                // In thirds of the image from the axis
                let at = |value: usize| {
                    let [row, col] = place(value);
                    let from_axis =
                        |line: usize, lines: usize| 6.0 * (line as f64 + 0.5) / lines as f64 - 3.0;
                    (from_axis(col, flat.width), from_axis(row, flat.height))
                };
                let term = |of: fn(f64, f64) -> f64| -> Vec<f64> {
                    values.iter().map(|&value| at(value)).map(|(x, y)| of(x, y)).collect()
                };
                vec![
                    term(|x, _| x),
                    term(|_, y| y),
                    term(|x, _| x * x),
                    term(|x, y| x * y),
                    term(|_, y| y * y),
                ]
            }
        };
        let weights = weights_of_constant(values.len(), terms);
        let weights: Vec<(usize, f64)> = values.into_iter().zip(weights).collect();
        let dn = weights.iter().map(|&(value, weight)| weight * f64::from(signal[value])).sum::<f64>();
        (dn > 0.0).then_some(Self { dn, weights })
    }
}

/// Variance of a channel's values over their square by noise and by the responses of pixels, without shading: from the spread of the
/// second differences of three in a row, whose variance is six times theirs. Defect pixels do not count in it.
fn relative_scatter(flat: &MasterFrame, channel: usize, signal: &[f32]) -> f64 {
    let (samples, step) = (flat.samples(), flat.mosaic.cols);
    let difference = |value: usize| {
        let col = value / samples % flat.width;
        let here = signal[value];
        (col >= step && col + step < flat.width && here > 0.0)
            .then(|| (signal[value - step * samples] + signal[value + step * samples]) / here - 2.0)
    };
    let mut differences: Vec<f32> = flat.values_of(channel).filter_map(difference).collect();
    robust(&mut differences).map_or(0.0, |(_, spread)| f64::from(spread).powi(2) / 6.0)
}

/// Weights of `count` values in the constant of their least-squares fit by a constant and some terms: what of the constant is orthogonal
/// to the terms (theorem of Frisch, Waugh and Lovell).
fn weights_of_constant(count: usize, terms: Vec<Vec<f64>>) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut orthogonal: Vec<Vec<f64>> = Vec::new();
    let rest_of = |mut column: Vec<f64>, orthogonal: &[Vec<f64>]| {
        for other in orthogonal {
            let part = dot(&column, other) / dot(other, other);
            column.iter_mut().zip(other).for_each(|(value, other)| *value -= part * other);
        }
        column
    };
    for column in terms {
        let before = dot(&column, &column);
        let rest = rest_of(column, &orthogonal);
        // One that others hold already says nothing, as in one row of pixels
        if dot(&rest, &rest) > 1e-6 * before {
            orthogonal.push(rest);
        }
    }
    let mut rest = rest_of(vec![1.0; count], &orthogonal);
    // Pixels that do not tell a constant from the terms
    if rest.iter().sum::<f64>() < LEAST_ORTHOGONAL * count as f64 {
        rest = vec![1.0; count];
    }
    let norm = rest.iter().sum::<f64>();
    rest.into_iter().map(|value| value / norm).collect()
}

/// Pixels that do not measure light.
#[derive(Clone, Debug, PartialEq)]
pub struct BadPixels {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Which they are, `[row, col]`.
    pub bad: Vec<bool>,
    /// Number in the dark frames: far from the median dark signal of their channel.
    pub in_dark: usize,
    /// Number in the flat field: far from the response of their neighbors of the same channel.
    pub in_flat: usize,
}

/// A robust standard deviation is never taken below this in dark frames, DN: half a code.
const LEAST_DARK_SPREAD_DN: f32 = 0.5;
/// Nor below this in relative response.
const LEAST_RESPONSE_SPREAD: f32 = 0.01;
/// Median absolute deviation of a normal distribution, in standard deviations.
const MAD_OF_NORMAL: f32 = 0.674_49;

impl BadPixels {
    /// Finds them in averaged dark and flat frames.
    ///
    /// A pixel is bad when its dark signal lies more than `sigma` robust standard deviations (median absolute deviation
    /// over 0.674) from the median of its channel, or its response to even light as far from the median of its own
    /// channel in the 5 x 5 cells around it. Six standard deviations make a false alarm in 5e8 normal pixels.
    ///
    /// # Errors
    /// Frames of different sensors or exposures, or with all channels in every pixel.
    pub fn detect(
        dark: Option<&MasterFrame>,
        flat: Option<(&MasterFrame, Option<&MasterFrame>)>,
        sigma: f64,
    ) -> Result<Self, DevelopError> {
        let any = dark.or(flat.map(|(flat, _)| flat)).ok_or(DevelopError::Nothing)?;
        if any.samples() > 1 {
            return Err(DevelopError::BadPixelsOfChannels);
        }
        let mut found = Self {
            width: any.width,
            height: any.height,
            bad: vec![false; any.mean.len()],
            in_dark: 0,
            in_flat: 0,
        };
        let sigma = sigma as f32;
        // Mark outliers of the dark signal, per channel
        if let Some(dark) = dark {
            for channel in 0..dark.mosaic.channels.len() {
                let mut values: Vec<f32> = dark.values_of(channel).map(|p| dark.mean[p]).collect();
                let Some((center, spread)) = robust(&mut values) else { continue };
                let limit = sigma * spread.max(LEAST_DARK_SPREAD_DN);
                for pixel in dark.values_of(channel) {
                    if (dark.mean[pixel] - center).abs() > limit || dark.saturated[pixel] {
                        found.bad[pixel] = true;
                        found.in_dark += 1;
                    }
                }
            }
        }
        // Mark outliers of the relative response to even light, per channel
        if let Some((flat, flat_dark)) = flat {
            if (flat.width, flat.height) != (any.width, any.height) || flat.mosaic != any.mosaic {
                let (frame, ambient) = (flat.label.clone(), any.label.clone());
                return Err(DevelopError::DifferentSensors { frame, ambient });
            }
            let signal = signal(flat, flat_dark)?;
            let relative = relative_response(flat, &signal);
            for channel in 0..flat.mosaic.channels.len() {
                let mut values: Vec<f32> = flat.values_of(channel).map(|p| relative[p]).collect();
                let Some((center, spread)) = robust(&mut values) else { continue };
                let limit = sigma * spread.max(LEAST_RESPONSE_SPREAD);
                for pixel in flat.values_of(channel) {
                    if (relative[pixel] - center).abs() > limit || flat.saturated[pixel] {
                        found.bad[pixel] = true;
                        found.in_flat += 1;
                    }
                }
            }
        }
        Ok(found)
    }

    /// Number of bad pixels.
    pub fn count(&self) -> usize {
        self.bad.iter().filter(|bad| **bad).count()
    }

    /// Replaces every bad value by the mean of the nearest good pixels of its channel, weighted by the inverse square of
    /// their distance. Where no good one lies within four cells the value stays and counts as saturated.
    pub(super) fn repair(&self, frame: &mut LinearMosaic) {
        let (rows, cols) = (frame.mosaic.rows as isize, frame.mosaic.cols as isize);
        let old = frame.values.clone();
        let full = frame.saturated.clone();
        for pixel in (0..self.bad.len()).filter(|&pixel| self.bad[pixel]) {
            let (row, col) = (pixel / self.width, pixel % self.width);
            let channel = frame.mosaic.channel(row, col);
            let mut repaired = None;
            // Search growing rings of cells for good pixels of the same channel
            for ring in 1..=4isize {
                let (mut sum, mut weights, mut saturated) = (0.0f64, 0.0f64, false);
                for down in -ring * rows..=ring * rows {
                    for right in -ring * cols..=ring * cols {
                        let (r, c) = (row as isize + down, col as isize + right);
                        let inside =
                            (0..self.height as isize).contains(&r) && (0..self.width as isize).contains(&c);
                        if !inside || (down, right) == (0, 0) {
                            continue;
                        }
                        let other = r as usize * self.width + c as usize;
                        if self.bad[other] || frame.mosaic.channel(r as usize, c as usize) != channel {
                            continue;
                        }
                        let weight = 1.0 / (down * down + right * right) as f64;
                        sum += weight * f64::from(old[other]);
                        weights += weight;
                        saturated |= full[other];
                    }
                }
                // Stop at the first ring that has any
                if weights > 0.0 {
                    repaired = Some(((sum / weights) as f32, saturated));
                    break;
                }
            }
            match repaired {
                Some((value, saturated)) => {
                    frame.values[pixel] = value;
                    frame.saturated[pixel] = saturated;
                }
                None => frame.saturated[pixel] = true,
            }
        }
    }
}

/// Light of an averaged frame, DN.
fn signal(frame: &MasterFrame, dark: Option<&MasterFrame>) -> Result<Vec<f32>, DevelopError> {
    let Some(dark) = dark else {
        let above = |(value, &dn): (usize, &f32)| (f64::from(dn) - frame.black_of(value)) as f32;
        return Ok(frame.mean.iter().enumerate().map(above).collect());
    };
    if (dark.width, dark.height) != (frame.width, frame.height) || dark.mosaic != frame.mosaic {
        let (columns, rows) = (dark.width, dark.height);
        let frame = frame.label.clone();
        return Err(DevelopError::OtherCalibration { what: "dark frame", columns, rows, frame });
    }
    let levels = dark.dark_levels(&DarkenedFrame {
        label: &frame.label,
        exposure_s: frame.exposure_s,
        dn_per_electron: frame.dn_per_electron,
        black_level: frame.black_level,
        black_offsets: &frame.black_offsets,
    })?;
    Ok(frame.mean.iter().zip(&levels).map(|(light, dark)| light - dark).collect())
}

/// Signal over the median of its channel in the 5 x 5 cells around, so that the shading of a lens does not count.
fn relative_response(flat: &MasterFrame, signal: &[f32]) -> Vec<f32> {
    let (rows, cols) = (2 * flat.mosaic.rows as isize, 2 * flat.mosaic.cols as isize);
    let mut near = Vec::new();
    let mut relative = vec![1.0; signal.len()];
    for (pixel, out) in relative.iter_mut().enumerate() {
        let (row, col) = (pixel / flat.width, pixel % flat.width);
        let channel = flat.mosaic.channel(row, col);
        near.clear();
        for down in -rows..=rows {
            for right in -cols..=cols {
                let (r, c) = (row as isize + down, col as isize + right);
                if (0..flat.height as isize).contains(&r) && (0..flat.width as isize).contains(&c) {
                    let (r, c) = (r as usize, c as usize);
                    if flat.mosaic.channel(r, c) == channel {
                        near.push(signal[r * flat.width + c]);
                    }
                }
            }
        }
        if let Some(local) = median(&mut near).filter(|local| *local > 0.0) {
            *out = signal[pixel] / local;
        }
    }
    relative
}

fn median(values: &mut [f32]) -> Option<f32> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Median and robust standard deviation.
pub(super) fn robust(values: &mut [f32]) -> Option<(f32, f32)> {
    let center = median(values)?;
    values.iter_mut().for_each(|value| *value = (*value - center).abs());
    Some((center, median(values)? / MAD_OF_NORMAL))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{
        Demosaicing, Development, ElectronRate, Exposure, Sensor, SensorModel, SensorProblem, SpectralQe,
    };
    use crate::spectral::Curve;

    const SIDE: usize = 96;

    fn sensor() -> Sensor {
        let model = SensorModel { columns: SIDE, rows: SIDE, prnu_percent: 3.0, ..SensorModel::default() };
        let curve = || Curve::constant(0.4);
        Sensor::new(model, SpectralQe::from_curves([("R", curve()), ("G", curve()), ("B", curve())]).unwrap())
            .unwrap()
    }

    /// Shading that falls to 60 % in the corners.
    fn shading(pixel: usize) -> f64 {
        let (y, x) = (pixel / SIDE, pixel % SIDE);
        let r2 = (y as f64 - 47.5).powi(2) + (x as f64 - 47.5).powi(2);
        1.0 - 0.4 * r2 / (2.0 * 47.5 * 47.5)
    }

    const HOT: [usize; 3] = [10 * SIDE + 11, 50 * SIDE + 2, 95 * SIDE + 95];
    const DEAD: [usize; 3] = [20 * SIDE + 21, 20 * SIDE + 23, 0];

    /// A frame of a defective device: hot pixels add 200 DN, dead ones see nothing.
    fn take(sensor: &Sensor, electrons: f64, time_s: f64, frame: u64) -> Result<SensorImage, SensorProblem> {
        let rate = |p: usize| if DEAD.contains(&p) { 0.0 } else { (electrons / time_s * shading(p)) as f32 };
        let rate = ElectronRate { columns: SIDE, rows: SIDE, data: (0..SIDE * SIDE).map(rate).collect() };
        let exposure = Exposure { time_s, frame, label: "frame".into(), ..Exposure::default() };
        let mut raw = sensor.expose_rate(&rate, &exposure)?;
        for pixel in HOT {
            raw.data[pixel] = (raw.data[pixel] + 200).min(4095);
        }
        Ok(raw)
    }

    #[derive(Debug)]
    enum Failed {
        Sensor(#[allow(dead_code, reason = "shown when a test fails")] SensorProblem),
        Develop(#[allow(dead_code, reason = "shown when a test fails")] DevelopError),
    }
    impl From<DevelopError> for Failed {
        fn from(error: DevelopError) -> Self {
            Self::Develop(error)
        }
    }

    fn master(sensor: &Sensor, electrons: f64, time_s: f64, first: u64, count: u64) -> MasterFrame {
        let frames = (first..first + count)
            .map(|frame| take(sensor, electrons, time_s, frame).map_err(Failed::Sensor));
        MasterFrame::average(frames).unwrap()
    }

    #[test]
    fn defects_are_found_and_a_flat_scene_becomes_flat() {
        let sensor = sensor();
        let dark = master(&sensor, 0.0, 0.03, 100, 16);
        let flat = master(&sensor, 4000.0, 0.03, 200, 32);
        let bad = BadPixels::detect(Some(&dark), Some((&flat, Some(&dark))), 6.0).unwrap();
        let mut expected: Vec<usize> = [HOT, DEAD].concat();
        expected.sort_unstable();
        let found: Vec<usize> = (0..SIDE * SIDE).filter(|&p| bad.bad[p]).collect();
        assert_eq!(found, expected);
        assert_eq!((bad.in_dark, bad.in_flat), (3, 3));

        let correction = FlatField::new(&flat, Some(&dark)).unwrap();
        let raw = take(&sensor, 2000.0, 0.03, 7).unwrap();
        let plain = Development::default().linearize(&raw).unwrap();
        let development = Development {
            demosaicing: Demosaicing::Bilinear,
            dark: Some(&dark),
            flat: Some(&correction),
            bad_pixels: Some(&bad),
            ..Development::default()
        };
        let corrected = development.linearize(&raw).unwrap();
        let spread = |frame: &LinearMosaic| {
            let mean = frame.values.iter().map(|&v| f64::from(v)).sum::<f64>() / frame.values.len() as f64;
            let squares = frame.values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>();
            (mean, (squares / frame.values.len() as f64).sqrt() / mean)
        };
        // Shot noise of 2000 e- in the middle (1200 e- in a corner), read noise 13.9 e-, those of the calibration: 2.9 %;
        // before, shading of some 10 % and a PRNU of 3 % on top.
        let (mean, after) = spread(&corrected);
        assert!(spread(&plain).1 > 0.09, "{}", spread(&plain).1);
        assert!(after < 0.031, "{after}");
        // On the axis numbers keep their meaning: shading there is 1 to 2 %.
        assert!((mean / (2000.0 * raw.dn_per_electron) - 1.0).abs() < 0.03, "{mean}");
        // The defects are gone: within six standard deviations of the mean.
        for pixel in expected {
            assert!((f64::from(corrected.values[pixel]) / mean - 1.0).abs() < 6.0 * after, "{pixel}");
        }
    }

    #[test]
    fn calibrations_that_do_not_fit_are_refused() {
        let sensor = sensor();
        let dark = master(&sensor, 0.0, 0.03, 0, 2);
        let raw = take(&sensor, 100.0, 0.06, 0).unwrap();
        let development = Development { dark: Some(&dark), ..Development::default() };
        let error = development.linearize(&raw).unwrap_err();
        assert!(matches!(error, DevelopError::OtherExposure { .. }), "{error}");
        // Frames within 1 % of the exposure are one setting: .5 % more holds .5 % more dark charge
        let mut hotter = dark.clone();
        (hotter.mean, hotter.exposure_s) = (vec![164.0; SIDE * SIDE], 0.0603);
        (hotter.black_level, hotter.black_offsets) = (64.0, Vec::new());
        let mut even = raw.clone();
        even.data.fill(200);
        let development = Development { dark: Some(&hotter), ..Development::default() };
        let left = development.linearize(&even).unwrap().values;
        // 200 - (64 + 100 * 0.06 / 0.0603)
        assert!(left.iter().all(|v| (f64::from(*v) - 36.4975).abs() < 1e-3), "{}", left[0]);
        hotter.exposure_s = 0.061;
        let development = Development { dark: Some(&hotter), ..Development::default() };
        let error = development.linearize(&even).unwrap_err().to_string();
        assert!(error.contains("has 61 ms") && error.contains("\"frame\" 60 ms"), "{error}");
        let small = BadPixels { width: 2, height: 2, bad: vec![false; 4], in_dark: 0, in_flat: 0 };
        let development = Development { bad_pixels: Some(&small), ..Development::default() };
        assert!(matches!(development.linearize(&raw), Err(DevelopError::OtherCalibration { .. })));
        let mixed = [take(&sensor, 0.0, 0.03, 0), take(&sensor, 0.0, 0.04, 0)]
            .map(|frame| frame.map_err(Failed::Sensor));
        assert!(MasterFrame::average(mixed).is_err());
        assert!(MasterFrame::average(Vec::<Result<SensorImage, Failed>>::new()).is_err());
    }

    /// Even light of some DN on a Bayer array of 24 x 24 pixels, each channel shaded by its own share toward the corners.
    fn shaded(level: [f64; 3], shade: [f64; 3]) -> MasterFrame {
        let mosaic = Mosaic::bayer("grbg").unwrap();
        let value = |pixel: usize| {
            let (row, col) = (pixel / 24, pixel % 24);
            let r2 = ((row as f64 - 11.5).powi(2) + (col as f64 - 11.5).powi(2)) / (2.0 * 11.5 * 11.5);
            let channel = mosaic.channel(row, col);
            (level[channel] * (1.0 - shade[channel] * r2)) as f32 + 64.0
        };
        MasterFrame {
            width: 24,
            height: 24,
            mean: (0..24 * 24).map(value).collect(),
            saturated: vec![false; 24 * 24],
            frames: 4,
            exposure_s: 0.03,
            dn_per_electron: 0.5,
            black_level: 64.0,
            black_offsets: Vec::new(),
            noise_floor_dn: 5.0,
            label: "even".into(),
            mosaic,
        }
    }

    /// Shading that differs by channel leaves the colors on the axis: of light in the proportions of the channels' levels, however much
    /// each falls toward the corners.
    #[test]
    fn each_channel_is_scaled_to_the_axis() {
        let (level, shade) = ([2000.0, 3000.0, 1500.0], [0.45, 0.3, 0.25]);
        let flat = shaded(level, shade);
        let field = FlatField::new(&flat, None).unwrap();
        for pixel in [0, 23, 11 * 24 + 12, 5 * 24 + 20] {
            let channel = flat.mosaic.channel(pixel / 24, pixel % 24);
            let signal = f64::from(flat.mean[pixel]) - 64.0;
            // Four frames of read noise and shot noise
            let variance = (25.0 + 0.5 * signal) / 4.0 / (signal * signal);
            let leveled = f64::from(field.gain[pixel]) * signal * (1.0 + variance);
            assert!((leveled / level[channel] - 1.0).abs() < 1e-5, "{pixel}: {leveled}");
            assert!((f64::from(field.factor_variance[pixel]) / variance - 1.0).abs() < 1e-4);
        }
        // A quadratic in a square of n values has its constant with 7/2 of the variance of a mean of them, up to the corners that pixels
        // of 8 x 8 leave out; R and B have 16 there, G 32.
        let of_pixel = |level: f64| (25.0 + 0.5 * level) / 4.0 / (level * level);
        for (channel, n) in [(0, 16.0), (1, 32.0), (2, 16.0)] {
            let expected = 3.5 * of_pixel(level[channel]) / n;
            assert!(
                (field.scale_variance[channel] / expected - 1.0).abs() < 0.3,
                "{:?}",
                field.scale_variance
            );
        }
    }

    #[test]
    fn frames_of_even_light_that_are_full_or_dim_are_refused() {
        let mut flat = shaded([2000.0, 3000.0, 1500.0], [0.0; 3]);
        // 4 of the 144 blue pixels are 2.8 %
        for pixel in [24, 26, 28, 30] {
            assert_eq!(flat.mosaic.channel(1, pixel % 24), 2);
            flat.saturated[pixel] = true;
        }
        let said = FlatField::new(&flat, None).unwrap_err().to_string();
        assert!(said.contains("2.8 % of the B pixels of the flat frame \"even\" are saturated"), "{said}");
        // One may be defect: what lies there is not measured
        flat.saturated[24..32].fill(false);
        flat.saturated[24] = true;
        assert!(FlatField::new(&flat, None).unwrap().saturated[24]);
        // 10 DN with a variance of (25 + 5) / 4 are 3.65 standard deviations; less dark frames that of n of both is (25 + 5 + 25) / n, of
        // 14 pairs 5.05
        let said = FlatField::new(&shaded([2000.0, 3000.0, 10.0], [0.0; 3]), None).unwrap_err().to_string();
        assert!(said.contains("a B pixel of the mean of 4 flat frames"), "{said}");
        assert!(said.contains("3.7 times its noise") && said.contains("or 14 of them"), "{said}");
        let pairs = |frames: usize| {
            let flat = MasterFrame { frames, ..shaded([2000.0, 3000.0, 10.0], [0.0; 3]) };
            let dark = MasterFrame { frames, ..shaded([0.0; 3], [0.0; 3]) };
            FlatField::new(&flat, Some(&dark))
        };
        assert!(pairs(14).is_ok());
        assert!(pairs(13).unwrap_err().to_string().contains("or 14 of them"));
        // The cap on the lens: no number of frames makes up for it
        let said = FlatField::new(&shaded([2000.0, 0.0, 1500.0], [0.0; 3]), None).unwrap_err().to_string();
        assert!(said.contains("a G pixel") && said.contains("0.0 times its noise"), "{said}");
        assert!(said.ends_with("take frames of brighter even light"), "{said}");
    }
}
