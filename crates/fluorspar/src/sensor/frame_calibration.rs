//! A camera measured from its own frames: dark ones, and an exposure series of even, steady light, after EMVA 1288.
//!
//! | quantity | estimated from |
//! |---|---|
//! | system gain K | slope of the temporal variance over the mean, dark frames included, weighted by errors |
//! | temporal dark noise | variance of the shortest dark frames less that of dark charge and `1/12 DN²`, over K² |
//! | black level, dark current | line through the levels of dark frames over time |
//! | DSNU | spatial variance of the most dark frames less what temporal noise leaves |
//! | PRNU, shading | quadratic in the squared distance from the middle, with a tilt and a saddle that are the light's; what is left |
//! | linearity error | mean distance of levels over time from the line of least relative squares |
//! | full scale | level of frames whose variance has vanished |
//!
//! Every number has a 95 % interval from the noise of the frames. What frames can't tell is absent: an absolute quantum efficiency first of all.

use nalgebra::{SMatrix, SVector};
use serde::Serialize;
use thiserror::Error;

use super::Emva1288;
use super::adc::QUANTIZATION_NOISE_DN;
use super::calibration::{is_same_setting, robust};
use super::characterization::{LEAST_DARK_VARIANCE_DN2, MOST_EMPTY, quantization_warning};
use super::frame_stack::{FrameStack, StackNoise};
use super::frame_statistics::{
    Line, MeasuredNumber, Point, mean, spatial_variances, variance, variance_with_error,
};
use super::photon_transfer::{Limit, saturation_capacity_e};
use crate::warning::Warning;

/// Frames of which more of a channel's pixels are saturated tell no gain.
const MOST_CLIPPED: f64 = 1e-3;
/// Part of the signal of the largest variance up to which photon transfer is taken as straight (EMVA 1288).
const STRAIGHT: f64 = 0.7;
/// Robust standard deviations from which a pixel is defect.
const DEFECT: f32 = 6.0;
/// Exposure time of dark frames over that of the longest flats from which dark frames of one time are refused.
const LONG: f64 = 1.1;
/// Part of the photon-transfer line below which a variance has vanished: its pixels are full.
const VANISHED: f64 = 0.2;
/// Chi-square for each degree of freedom from which variance does not rise in proportion to the signal.
const CURVED: f64 = 9.0;
/// Flicker of light and unevenness of a flat from which they are told.
const TOLD_FLICKER: f64 = 0.01;
const TOLD_TILT: f64 = 0.05;
/// Standard errors from which a tilt of a flat is told.
const SIGNIFICANT: f64 = 4.0;
/// Terms of the surface of a flat: 1, x, x², u, v, u² - v², u v with x = u² + v².
const TERMS: usize = 7;

/// Why frames tell no camera.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum CalibrationProblem {
    /// No frames of one kind.
    #[error(
        "there are no {0} frames; take some: dark ones with the cap on, flat ones of an evenly lit white surface at several exposure times"
    )]
    Nothing(&'static str),
    /// Frames of several gains.
    #[error("\"{}\" has a gain of {}, \"{}\" of {}; calibrate each gain (ISO) by itself", .frames[0], .gains[0], .frames[1], .gains[1])]
    MixedGains {
        /// Two frames.
        frames: [String; 2],
        /// Their gains.
        gains: [f64; 2],
    },
    /// Frames of several sensors.
    #[error("\"{}\" and \"{}\" differ in size or color filter array; take all frames with one camera, unturned and uncropped", .0[0], .0[1])]
    MixedSensors([String; 2]),
    /// Every flat is full, or single.
    #[error(
        "no two flat frames of one exposure time are below saturation, and the noise of one frame can't be told from its pattern; take each \
         exposure time twice or more, some at a tenth to a half of the full scale"
    )]
    NoPair,
    /// Dark charge that the flats do not have.
    #[error(
        "all dark frames have {dark_s} s, the flats {flat_s} s at most, so what the dark frames hold of dark charge is not known; take more with \
         the shortest exposure time of the flats"
    )]
    LongDarks {
        /// Exposure time of the dark frames, s.
        dark_s: f64,
        /// The longest of the flats, s.
        flat_s: f64,
    },
    /// Variance that does not rise.
    #[error(
        "the temporal noise does not rise with the light, so there is no gain to measure; give raw frames, neither averaged, denoised nor on a tone curve"
    )]
    NoRise,
    /// Flats without light.
    #[error(
        "the channel {0} of the flat frames is not lit from the middle to the corners; light an even white surface that fills the frame"
    )]
    NoLight(String),
    /// Too few pixels.
    #[error("the channel {channel} has {pixels} pixels, too few for its shading; give whole frames")]
    FewPixels {
        /// Channel.
        channel: String,
        /// Its pixels.
        pixels: usize,
    },
}

/// A channel in the flat frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelCalibration {
    /// Channel.
    pub channel: String,
    /// Level of no light and no time, DN.
    pub black_level_dn: f64,
    /// Electrons per second in a pixel on the axis in the light of the flat frames.
    pub flat_e_per_s: MeasuredNumber,
    /// Relative illumination, as [`super::SensorModel::relative_illumination`] has it: a1, a2.
    pub shading: [MeasuredNumber; 2],
    /// The same in the corner.
    pub corner: MeasuredNumber,
}

/// A level of the photon-transfer curve.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TransferPoint {
    /// Channel.
    pub channel: String,
    /// Exposure time, s; 0 light for dark frames.
    pub exposure_s: f64,
    /// Mean above the black level, DN.
    pub signal_dn: f64,
    /// Temporal variance, DN², null of one frame.
    pub variance_dn2: Option<f64>,
    /// Whether light fell on it.
    pub is_lit: bool,
}

/// A camera as its frames tell it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameCalibration {
    /// Columns and rows.
    pub size_px: [usize; 2],
    /// Bits of the converter.
    pub bit_depth: u8,
    /// System gain K, DN/e-.
    pub gain_dn_per_e: MeasuredNumber,
    /// Temporal dark noise, quantization excluded, e- rms; where dark frames are cut at 0, or single, from the noise of the flats.
    pub dark_noise_e: MeasuredNumber,
    /// Level of no light and no time, DN.
    pub black_level_dn: MeasuredNumber,
    /// Dark current, e-/s; null of dark frames of one exposure time.
    pub dark_current_e_per_s: Option<MeasuredNumber>,
    /// Dark signal non-uniformity, e-; null where all dark frames are cut at 0.
    pub dsnu_e: Option<MeasuredNumber>,
    /// The part of its variance that rows and columns share.
    pub dsnu_stripes: f64,
    /// Photo response non-uniformity, percent.
    pub prnu_percent: MeasuredNumber,
    /// Signal of full pixels, e-; null where no frame is full.
    pub full_scale_e: Option<MeasuredNumber>,
    /// The largest signal of a frame, e-.
    pub largest_signal_e: f64,
    /// Mean deviation of levels from a line over time, percent; null of fewer than three exposure times.
    pub linearity_error_percent: Option<MeasuredNumber>,
    /// Difference across the flat that no lens makes, percent of its level; 0 where noise may make it.
    pub unevenness_percent: f64,
    /// Pixels that are far from the others in the dark, and in light.
    pub defects: [usize; 2],
    /// Channels.
    pub channels: Vec<ChannelCalibration>,
    /// Photon-transfer curve.
    pub transfer: Vec<TransferPoint>,
    /// What makes it doubtful.
    pub warnings: Vec<Warning>,
}

/// Levels of dark frames over time, and how far that of each channel lies above them.
struct DarkLine {
    line: Line,
    has_slope: bool,
    shortest_s: f64,
    of_channels: Vec<f64>,
}

impl DarkLine {
    fn through(darks: &[FrameStack]) -> Self {
        let times = || darks.iter().map(FrameStack::exposure_s);
        let (shortest_s, longest_s) = times().fold((f64::MAX, 0.0), |(l, h), t| (t.min(l), t.max(h)));
        let has_slope = !is_same_setting(shortest_s, longest_s);
        let point = |dark: &FrameStack| {
            let weight = dark.level_error_dn.max(1e-4).powi(-2);
            (if has_slope { dark.exposure_s() } else { shortest_s }, dark.level_dn, weight)
        };
        let mut line = Line::through(darks.iter().map(point));
        if !has_slope {
            line = line.level();
        }
        let above =
            |channel: usize| mean(darks.iter().map(|dark| dark.channels[channel].mean_dn - dark.level_dn));
        let of_channels = (0..darks[0].channels.len()).map(above).collect();
        Self { line, has_slope, shortest_s, of_channels }
    }

    fn at(&self, time_s: f64) -> f64 {
        self.line.at(time_s)
    }

    /// The level of no time; of one exposure time its level.
    fn black(&self) -> MeasuredNumber {
        let at = if self.has_slope { 0.0 } else { self.shortest_s };
        MeasuredNumber::new(self.line.at(at), self.line.error_at(at))
    }
}

/// A straight photon-transfer curve.
struct Transfer {
    line: Line,
    gain: MeasuredNumber,
    /// Chi-square for each degree of freedom.
    reduced: f64,
    /// Signal of the largest variance, DN.
    top: f64,
    /// Whether it lies below the largest signal.
    turns: bool,
}

/// The frames, and what several estimates share.
struct Frames<'a> {
    darks: &'a [FrameStack],
    flats: &'a [FrameStack],
    dark: DarkLine,
}

/// Estimates a camera from stacks of dark frames and of frames of even, steady light, each of one exposure time, all of one gain.
///
/// # Errors
/// Frames of several cameras or gains, or from which no gain can be told.
pub fn calibrate_frames(
    darks: &[FrameStack],
    flats: &[FrameStack],
) -> Result<FrameCalibration, CalibrationProblem> {
    check(darks, flats)?;
    let frames = Frames { darks, flats, dark: DarkLine::through(darks) };
    let transfer = frames.transfer()?;
    let gain = transfer.gain;
    let mut warnings = frames.warnings(&transfer);
    let (dsnu_e, dsnu_stripes, hot) = frames.dsnu(&transfer);
    let flat = frames.brightest_flat(&transfer)?;
    let surfaces: Vec<Surface> = (0..flat.channels.len())
        .filter(|&channel| flat.master.values_of(channel).next().is_some())
        .map(|channel| frames.surface(flat, channel, &transfer))
        .collect::<Result<_, _>>()?;
    let unevenness = surfaces.iter().map(|surface| surface.unevenness).fold(0.0, f64::max);
    if unevenness > TOLD_TILT {
        let statement =
            format!("The flat is uneven: its light differs by {:.0} % across the frame", 100.0 * unevenness);
        let what = "Taken as the light's, and not the lens's; turn the camera by 180 degrees and see whether it turns with it.";
        warnings.push(Warning::explained(statement, what));
    }
    let dark_noise_e = frames.dark_noise(&transfer, &mut warnings);
    let dark_current = MeasuredNumber::new(frames.dark.line.slope, frames.dark.line.slope_error()).over(gain);
    let any = &flat.master;
    Ok(FrameCalibration {
        size_px: [any.width, any.height],
        bit_depth: flat.bit_depth,
        gain_dn_per_e: gain,
        dark_noise_e,
        black_level_dn: frames.black_of_device(),
        dark_current_e_per_s: frames.dark.has_slope.then_some(dark_current),
        dsnu_e,
        dsnu_stripes,
        prnu_percent: prnu_of(&surfaces),
        full_scale_e: frames.full_scale(&transfer),
        largest_signal_e: frames.lit().map(|(_, _, signal_dn)| signal_dn / gain.value).fold(0.0, f64::max),
        linearity_error_percent: frames.linearity(&transfer),
        unevenness_percent: 100.0 * unevenness,
        defects: [hot, surfaces.iter().map(|surface| surface.defects).sum()],
        channels: surfaces.iter().map(|surface| frames.channel(flat, surface, gain)).collect(),
        transfer: frames.points(),
        warnings,
    })
}

impl FrameCalibration {
    /// Level of no light at an exposure time, DN.
    fn dark_level(&self, time_s: f64) -> MeasuredNumber {
        let charge =
            self.dark_current_e_per_s.map_or(0.0, |current| current.value * self.gain_dn_per_e.value);
        let error = self.black_level_dn.error();
        MeasuredNumber::new(self.black_level_dn.value + charge * time_s, error)
    }

    /// What the channels of frames of one camera have in a rectangle (column, row, width, height), with the shading taken out, DN/s; `None`
    /// of a channel that is saturated there, or has no pixel. The error is that of noise, responses of pixels, flicker and black level.
    #[must_use]
    pub fn rates(&self, stack: &FrameStack, rectangle: [usize; 4]) -> Vec<Option<MeasuredNumber>> {
        (0..self.channels.len()).map(|number| self.rate(stack, rectangle, number)).collect()
    }

    fn rate(
        &self,
        stack: &FrameStack,
        [col0, row0, width, height]: [usize; 4],
        number: usize,
    ) -> Option<MeasuredNumber> {
        let (master, channel) = (&stack.master, &self.channels[number]);
        let index = master.mosaic.channels.iter().position(|name| *name == channel.channel)?;
        let dark = self.dark_level(stack.exposure_s());
        let black = dark.value + channel.black_level_dn - self.black_level_dn.value;
        let [u0, v0] = self.size_px.map(|side| 0.5 * side as f64);
        let place = |value: usize| {
            let pixel = value / master.samples();
            (pixel % master.width, pixel / master.width)
        };
        let is_within = |&value: &usize| {
            let (col, row) = place(value);
            (col0..col0 + width).contains(&col) && (row0..row0 + height).contains(&row)
        };
        let within: Vec<usize> = master.values_of(index).filter(is_within).collect();
        let full = within.iter().filter(|&&value| master.saturated[value]).count();
        if within.len() < 2 || full as f64 > MOST_CLIPPED * within.len() as f64 {
            return None;
        }
        let light = |&value: &usize| {
            let (col, row) = place(value);
            let squared = (col as f64 + 0.5 - u0).powi(2) + (row as f64 + 0.5 - v0).powi(2);
            let x = squared / (u0 * u0 + v0 * v0);
            let shading = 1.0 + channel.shading[0].value * x + channel.shading[1].value * x * x;
            (f64::from(master.mean[value]) - black) / shading
        };
        let values: Vec<f64> = within.iter().map(light).collect();
        let level = mean(values.iter().copied());
        let of_pixels = (variance(&values) / values.len() as f64).sqrt();
        let of_frames = stack.flicker * level / (master.frames as f64).sqrt();
        let error = of_pixels.hypot(of_frames).hypot(dark.error());
        Some(MeasuredNumber::new(level, error).times(1.0 / stack.exposure_s()))
    }

    /// The camera as a data sheet of EMVA 1288 at gain 1, from frames of an analog gain. What was not measured is the end of the converter and no
    /// dark current.
    #[must_use]
    pub fn data_sheet(&self, analog_gain: f64) -> Emva1288 {
        let gain = self.gain_dn_per_e.value / analog_gain;
        let codes = f64::from((1u32 << self.bit_depth) - 1);
        let (black, prnu) = (self.black_level_dn.value.max(0.0), self.prnu_percent.value);
        let noise_e = self.dark_noise_e.value;
        let converter_e = (codes - black) / gain;
        // A well that fills before the converter ends
        let own_e = (codes - black) / self.gain_dn_per_e.value;
        let well = self.full_scale_e.map(|full| full.value).filter(|full| *full < 0.995 * own_e);
        let limit = well
            .filter(|well| *well < converter_e)
            .map_or(Limit { electrons: converter_e, noise_e }, Limit::well);
        Emva1288 {
            gain_e_per_dn: None,
            gain_dn_per_e: Some(gain),
            dark_noise_e: Some(noise_e),
            dark_noise_dn: None,
            saturation_capacity_e: saturation_capacity_e(limit, 1e-2 * prnu),
            bit_depth: self.bit_depth,
            black_level_dn: Some(black),
            dark_current_e_per_s: self.dark_current_e_per_s.map_or(0.0, |current| current.value.max(0.0)),
            dsnu_e: Some(self.dsnu_e.map_or(0.0, |dsnu| dsnu.value)),
            prnu_percent: prnu,
            ..Emva1288::default()
        }
    }
}

fn check(darks: &[FrameStack], flats: &[FrameStack]) -> Result<(), CalibrationProblem> {
    let first = darks.first().ok_or(CalibrationProblem::Nothing("dark"))?;
    flats.first().ok_or(CalibrationProblem::Nothing("flat"))?;
    for other in darks.iter().chain(flats) {
        let frames = || [&first.master, &other.master].map(|master| master.label.clone());
        let shape = |stack: &FrameStack| (stack.master.width, stack.master.height, stack.master.mean.len());
        if shape(first) != shape(other) || first.master.mosaic != other.master.mosaic {
            return Err(CalibrationProblem::MixedSensors(frames()));
        }
        if !is_same_setting(first.gain, other.gain) {
            return Err(CalibrationProblem::MixedGains { frames: frames(), gains: [first.gain, other.gain] });
        }
    }
    let dark_s = darks.iter().map(FrameStack::exposure_s).fold(f64::INFINITY, f64::min);
    let flat_s = flats.iter().map(FrameStack::exposure_s).fold(0.0, f64::max);
    let has_one = darks.iter().all(|dark| is_same_setting(dark.exposure_s(), dark_s));
    if has_one && dark_s > LONG * flat_s {
        return Err(CalibrationProblem::LongDarks { dark_s, flat_s });
    }
    Ok(())
}

impl Frames<'_> {
    /// Flats with the number of a channel and its signal above the dark level, DN.
    fn lit(&self) -> impl Iterator<Item = (&FrameStack, usize, f64)> {
        self.flats.iter().flat_map(move |flat| {
            let dark = self.dark.at(flat.exposure_s());
            let noise = flat.channels.iter().enumerate();
            let present = noise.filter(|(channel, _)| flat.master.values_of(*channel).next().is_some());
            present.map(move |(channel, noise)| {
                (flat, channel, noise.mean_dn - dark - self.dark.of_channels[channel])
            })
        })
    }

    /// The photon-transfer line, whose points are weighted by their errors on the line itself, so that chance gives no weight.
    fn transfer(&self) -> Result<Transfer, CalibrationProblem> {
        let black = self.dark.black().value;
        let of_stack = |stack: &FrameStack| {
            let usable = |(_, noise): &(usize, &StackNoise)| {
                noise.saturated <= MOST_CLIPPED
                    && noise.empty <= MOST_EMPTY
                    && noise.variance_error_dn2.is_finite()
            };
            let point = |(channel, noise): (usize, &StackNoise)| {
                let relative = noise.variance_error_dn2 / noise.variance_dn2;
                let signal = noise.mean_dn - black - self.dark.of_channels[channel];
                (signal, noise.variance_dn2, relative.powi(-2))
            };
            stack
                .channels
                .iter()
                .enumerate()
                .filter(usable)
                .map(point)
                .filter(|(_, v, _)| *v > 0.0)
                .collect::<Vec<Point>>()
        };
        let lit: Vec<Point> = self.flats.iter().flat_map(of_stack).collect();
        let (top, most) = lit.iter().fold((0.0, 0.0), |(x, y), p| if p.1 > y { (p.0, p.1) } else { (x, y) });
        let largest = self.lit().map(|(_, _, signal)| signal).fold(0.0, f64::max);
        let turns = largest > 1.02 * top && most > 0.0;
        let limit = if turns && lit.iter().any(|p| p.0 <= STRAIGHT * top && p.0 > 0.0) {
            STRAIGHT * top
        } else {
            top
        };
        let lit: Vec<Point> = lit.into_iter().filter(|p| p.0 <= limit).collect();
        if lit.is_empty() {
            return Err(CalibrationProblem::NoPair);
        }
        // What quantization hides is no point (EMVA 1288, section 6), where light tells enough
        let is_seen = |p: &Point| lit.len() < 2 || p.1 >= LEAST_DARK_VARIANCE_DN2;
        let darks: Vec<Point> = self.darks.iter().flat_map(of_stack).filter(is_seen).collect();
        let points: Vec<Point> = darks.into_iter().chain(lit).collect();
        let weighted = |line: Option<&Line>| {
            let weight = |p: &Point| p.2 / line.map_or(p.1, |line| line.at(p.0).max(0.1 * p.1)).powi(2);
            Line::through(points.iter().map(|p| (p.0, p.1, weight(p))).collect::<Vec<_>>().into_iter())
        };
        let line = (0..3).fold(weighted(None), |line, _| weighted(Some(&line)));
        let freedom = points.len().saturating_sub(2).max(1) as f64;
        let reduced = line.chi_square / freedom;
        let gain = MeasuredNumber::new(line.slope, line.slope_error() * reduced.max(1.0).sqrt());
        if gain.low > 0.0 {
            Ok(Transfer { line, gain, reduced, top, turns })
        } else {
            Err(CalibrationProblem::NoRise)
        }
    }

    /// The black level that the pixels of the frames scatter about.
    fn black_of_device(&self) -> MeasuredNumber {
        let master = &self.darks[0].master;
        let pattern = variance(&master.mean.iter().map(|&dn| f64::from(dn)).collect::<Vec<_>>());
        let black = self.dark.black();
        MeasuredNumber::new(black.value, black.error().hypot((pattern / master.mean.len() as f64).sqrt()))
    }

    fn warnings(&self, transfer: &Transfer) -> Vec<Warning> {
        let mut warnings = Vec::new();
        // Noise that falls with more light, other than where pixels are full
        let falls = |(flat, channel, signal): &(&FrameStack, usize, f64)| {
            let noise = &flat.channels[*channel];
            *signal > transfer.top
                && noise.variance_dn2 > VANISHED * transfer.line.at(*signal)
                && self.is_full(noise, transfer)
        };
        if transfer.reduced > CURVED || self.lit().filter(falls).count() > self.flats[0].channels.len() {
            let statement = "The temporal noise does not rise in proportion to the light";
            let what = "The frames may be developed: gamma, noise reduction, sharpening. The gain is doubtful; give raw frames.";
            warnings.push(Warning::explained(statement, what));
        }
        let flicker = self.flats.iter().map(|flat| flat.flicker).fold(0.0, f64::max);
        if flicker > TOLD_FLICKER {
            let statement =
                format!("The light of the flats flickers by {:.1} % from frame to frame", 100.0 * flicker);
            warnings.push(Warning::explained(
                statement,
                "Its level is evened out; what is left widens the linearity error.",
            ));
        }
        if !self.dark.has_slope {
            let statement = "The dark current is not measured: all dark frames have one exposure time";
            let what = "It counts as 0. Take dark frames of two exposure times, one as long as the longest exposure.";
            warnings.push(Warning::explained(statement, what));
        }
        let [told, found] = [self.darks[0].master.black_level, self.dark.black().value];
        if (told - found).abs() > 1.0 {
            let statement =
                format!("The frames tell a black level of {told:.1} DN, dark frames have {found:.1} DN");
            warnings.push(Warning::explained(statement, "That of the dark frames counts."));
        }
        warnings
    }

    /// Variance of dark noise and quantization with its error, DN², from the shortest dark frames, else from the photon-transfer line.
    fn dark_variance(&self, transfer: &Transfer, warnings: &mut Vec<Warning>) -> (f64, f64) {
        let by_time = |a: &&FrameStack, b: &&FrameStack| a.exposure_s().total_cmp(&b.exposure_s());
        let shortest = self.darks.iter().min_by(by_time).unwrap_or(&self.darks[0]);
        let of = |value: fn(&StackNoise) -> f64| mean(shortest.channels.iter().map(value));
        let empty = of(|noise| noise.empty);
        if empty > MOST_EMPTY {
            let statement =
                format!("{:.1} % of the values of dark frames are 0 and cut the dark noise", 100.0 * empty);
            let what = "It is taken from the noise of the flats. Raise the black level (offset) of the camera, or take raw frames.";
            warnings.push(Warning::explained(statement, what));
        }
        let error = of(|noise| noise.variance_error_dn2) / (shortest.channels.len() as f64).sqrt();
        if empty > MOST_EMPTY || !error.is_finite() {
            return (transfer.line.at(0.0), transfer.line.error_at(0.0));
        }
        let charge = transfer.line.slope * (shortest.level_dn - self.dark.black().value);
        (of(|noise| noise.variance_dn2) - charge, error)
    }

    fn dark_noise(&self, transfer: &Transfer, warnings: &mut Vec<Warning>) -> MeasuredNumber {
        let (variance, error) = self.dark_variance(transfer, warnings);
        if variance < LEAST_DARK_VARIANCE_DN2 {
            warnings.push(quantization_warning(variance.max(0.0), transfer.gain.value));
            let most = hidden_e(transfer);
            return MeasuredNumber { value: 0.5 * most, low: 0.0, high: most };
        }
        root_over(variance - QUANTIZATION_NOISE_DN.powi(2), error, transfer.gain)
    }

    /// DSNU, the part of its variance that rows and columns share, and the number of hot pixels, which do not count in it.
    fn dsnu(&self, transfer: &Transfer) -> (Option<MeasuredNumber>, f64, usize) {
        let is_whole = |dark: &&FrameStack| dark.channels.iter().all(|noise| noise.empty <= MOST_EMPTY);
        let Some(best) = self.darks.iter().rev().filter(is_whole).max_by_key(|dark| dark.master.frames)
        else {
            return (None, 0.0, 0);
        };
        let master = &best.master;
        // Levels of channels are no pattern of pixels
        let mut levels = master.mean.clone();
        for (channel, above) in self.dark.of_channels.iter().enumerate() {
            master.values_of(channel).for_each(|value| levels[value] -= *above as f32);
        }
        let (center, spread) = robust(&mut levels.clone()).unwrap_or((0.0, 0.0));
        let is_hot = |dn: f32| (dn - center).abs() > DEFECT * spread.max(0.5);
        let hot = levels.iter().filter(|&&dn| is_hot(dn)).count();
        let values: Vec<f64> =
            levels.iter().map(|&dn| f64::from(if is_hot(dn) { center } else { dn })).collect();
        let columns = master.width * master.samples();
        let [_, row, column, _] = spatial_variances(&values, columns);
        let (all, error) = variance_with_error(&values);
        let rows = values.len() / columns;
        let stripes = (row.max(0.0), column.max(0.0));
        let error = error
            .hypot(stripes.0 * (2.0 / rows as f64).sqrt())
            .hypot(stripes.1 * (2.0 / columns as f64).sqrt());
        // The noise of one frame is that of the line
        let charge = best.level_dn - self.dark.black().value;
        let (noise, of_noise) = match master.frames {
            1 => (transfer.line.at(charge), transfer.line.error_at(charge)),
            _ => (mean(best.channels.iter().map(|channel| channel.variance_dn2)), 0.0),
        };
        let error = error.hypot(of_noise);
        let square = all - noise / master.frames as f64;
        let mut found = root_over(square, error, transfer.gain);
        if noise < LEAST_DARK_VARIANCE_DN2 {
            // Steps of the converter hide patterns, too
            found = MeasuredNumber { high: found.high.max(hidden_e(transfer)), low: 0.0, ..found };
        }
        (Some(found), (stripes.0 + stripes.1) / square.max(1e-12), hot)
    }

    /// The flat that tells most of the responses of pixels: the most light below saturation.
    fn brightest_flat(&self, transfer: &Transfer) -> Result<&FrameStack, CalibrationProblem> {
        let light = |flat: &FrameStack| {
            let all = |of: &dyn Fn(&StackNoise) -> bool| flat.channels.iter().all(of);
            let is_below = all(&|noise| noise.saturated <= MOST_CLIPPED)
                && flat.channels.iter().all(|noise| !self.is_full(noise, transfer));
            let signal = flat.level_dn - self.dark.at(flat.exposure_s());
            is_below.then_some(signal * flat.master.frames as f64)
        };
        let lit = self.flats.iter().filter_map(|flat| Some((light(flat)?, flat)));
        // Noise that falls below saturation is that of a tone curve
        let is_clipped = |flat: &FrameStack| flat.channels.iter().any(|noise| noise.saturated > MOST_CLIPPED);
        let none = || match self.flats.iter().all(is_clipped) {
            true => CalibrationProblem::NoPair,
            false => CalibrationProblem::NoRise,
        };
        lit.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, flat)| flat).ok_or_else(none)
    }

    /// Whether pixels are full: clipped at the last code, or of a variance that has fallen.
    fn is_full(&self, noise: &StackNoise, transfer: &Transfer) -> bool {
        let expected = transfer.line.at(noise.mean_dn - self.dark.black().value);
        let has_fallen = noise.variance_error_dn2.is_finite() && noise.variance_dn2 < 0.6 * expected;
        noise.saturated > MOST_CLIPPED || (transfer.turns && has_fallen)
    }

    fn full_scale(&self, transfer: &Transfer) -> Option<MeasuredNumber> {
        let black = self.dark.black();
        let is_full = |flat: &FrameStack, channel: usize| {
            let noise = &flat.channels[channel];
            let expected = transfer.line.at(noise.mean_dn - black.value);
            noise.saturated > 0.99
                || (noise.variance_error_dn2.is_finite() && noise.variance_dn2 < VANISHED * expected)
        };
        let full = self.lit().filter(|(flat, channel, _)| is_full(flat, *channel));
        let level = full.map(|(flat, channel, _)| flat.channels[channel].mean_dn).fold(0.0, f64::max);
        (level > 0.0)
            .then(|| MeasuredNumber::new(level - black.value, black.error().max(0.3)).over(transfer.gain))
    }

    /// Of the channel that deviates most.
    fn linearity(&self, transfer: &Transfer) -> Option<MeasuredNumber> {
        let channels = 0..self.flats[0].channels.len();
        let worst = channels.filter_map(|channel| self.linearity_of(channel, transfer));
        worst.max_by(|a, b| a.value.total_cmp(&b.value))
    }

    fn linearity_of(&self, channel: usize, transfer: &Transfer) -> Option<MeasuredNumber> {
        let of_channel = self.lit().filter(|(_, of, signal)| *of == channel && *signal > 0.0);
        let below = of_channel.filter(|(flat, of, _)| !self.is_full(&flat.channels[*of], transfer));
        let point = |(flat, _, signal): (&FrameStack, usize, f64)| {
            let light = flat.level_dn - self.dark.at(flat.exposure_s());
            let error = flat.level_error_dn.hypot(self.dark.line.error_at(flat.exposure_s())) / light;
            (flat.exposure_s(), signal, error)
        };
        let points: Vec<Point> = below.map(point).collect();
        let most = points.iter().map(|p| p.1).fold(0.0, f64::max);
        let points: Vec<Point> = points.into_iter().filter(|p| p.1 >= 0.05 * most).collect();
        let mut times: Vec<f64> = points.iter().map(|p| p.0).collect();
        times.sort_by(f64::total_cmp);
        times.dedup_by(|a, b| is_same_setting(*a, *b));
        if times.len() < 3 {
            return None;
        }
        let line = Line::through(points.iter().map(|p| (p.0, p.1, p.1.powi(-2))));
        let deviation = mean(points.iter().map(|p| (p.1 / line.at(p.0) - 1.0).abs()));
        let measured = MeasuredNumber::new(100.0 * deviation, 100.0 * mean(points.iter().map(|p| p.2)));
        Some(MeasuredNumber { low: measured.low.max(0.0), ..measured })
    }

    fn points(&self) -> Vec<TransferPoint> {
        let black = self.dark.black().value;
        let of = |stack: &FrameStack, is_lit: bool| {
            let channels = stack.master.mosaic.channels.clone().into_iter().zip(stack.channels.clone());
            let channels = channels.zip(self.dark.of_channels.clone());
            let exposure_s = stack.exposure_s();
            let has_noise = stack.master.frames > 1;
            channels.map(move |((channel, noise), above)| TransferPoint {
                channel,
                exposure_s,
                signal_dn: noise.mean_dn - black - above,
                variance_dn2: has_noise.then_some(noise.variance_dn2),
                is_lit,
            })
        };
        let dark = self.darks.iter().flat_map(|stack| of(stack, false));
        dark.chain(self.flats.iter().flat_map(|stack| of(stack, true))).collect()
    }

    fn channel(&self, flat: &FrameStack, surface: &Surface, gain: MeasuredNumber) -> ChannelCalibration {
        let flicker = flat.flicker / (flat.master.frames as f64).sqrt();
        let axis = surface.axis;
        let level = MeasuredNumber::new(axis.value, axis.error().hypot(flicker * axis.value));
        ChannelCalibration {
            channel: flat.master.mosaic.channels[surface.channel].clone(),
            black_level_dn: self.dark.black().value + self.dark.of_channels[surface.channel],
            flat_e_per_s: level.times(1.0 / flat.exposure_s()).over(gain),
            shading: surface.shading,
            corner: surface.corner,
        }
    }

    /// The light of a channel over the frame, and how pixels scatter about it.
    fn surface(
        &self,
        flat: &FrameStack,
        channel: usize,
        transfer: &Transfer,
    ) -> Result<Surface, CalibrationProblem> {
        let nearest = |a: &FrameStack| (a.exposure_s() - flat.exposure_s()).abs();
        let dark = self.darks.iter().fold(&self.darks[0], |a, b| if nearest(b) < nearest(a) { b } else { a });
        let (level, width) = (self.dark.at(flat.exposure_s()) - dark.level_dn, flat.master.width);
        let samples = flat.master.samples();
        let [u0, v0] = [0.5 * width as f64, 0.5 * flat.master.height as f64];
        let values = || flat.master.values_of(channel);
        let row = |value: usize| {
            let pixel = value / samples;
            let u = ((pixel % width) as f64 + 0.5 - u0) / u0.hypot(v0);
            let v = ((pixel / width) as f64 + 0.5 - v0) / u0.hypot(v0);
            let x = u * u + v * v;
            SVector::<f64, TERMS>::from([1.0, x, x * x, u, v, u * u - v * v, u * v])
        };
        let signal =
            |value: usize| f64::from(flat.master.mean[value]) - f64::from(dark.master.mean[value]) - level;
        let (name, pixels) = (flat.master.mosaic.channels[channel].clone(), values().count());
        if pixels < 8 * TERMS {
            return Err(CalibrationProblem::FewPixels { channel: name, pixels });
        }
        let fit = fit_surface(values, row, signal).ok_or(CalibrationProblem::NoLight(name))?;
        let relative: Vec<f32> =
            values().map(|value| (signal(value) / fit.beta.dot(&row(value)) - 1.0) as f32).collect();
        let (center, spread) = robust(&mut relative.clone()).unwrap_or((0.0, 0.0));
        let is_far = |r: f32| (r - center).abs() > DEFECT * spread.max(1e-3);
        let good: Vec<f64> = relative.iter().filter(|r| !is_far(**r)).map(|r| f64::from(*r)).collect();
        let dark_dn2 = dark.channels[channel].variance_dn2 / dark.master.frames as f64;
        let black = self.dark.black().value;
        let temporal = mean(values().collect::<Vec<_>>().into_iter().map(|value| {
            let light = fit.beta.dot(&row(value));
            let shot = transfer.line.at(light + self.dark.at(flat.exposure_s()) - black);
            (shot / flat.master.frames as f64 + dark_dn2) / (light * light)
        }));
        let (all, error) = variance_with_error(&good);
        let of_gain = temporal * transfer.gain.error() / transfer.gain.value;
        Ok(fit.surface(channel, (all - temporal, error.hypot(of_gain)), relative.len() - good.len()))
    }
}

/// Most that steps of the converter hide of noise or pattern, e-.
fn hidden_e(transfer: &Transfer) -> f64 {
    (LEAST_DARK_VARIANCE_DN2 - QUANTIZATION_NOISE_DN.powi(2)).sqrt() / transfer.gain.value
}

/// A root of a variance in digital numbers, in electrons.
fn root_over(square: f64, error: f64, gain: MeasuredNumber) -> MeasuredNumber {
    let squared = gain.value * gain.value;
    let of_gain = 2.0 * square * gain.error() / gain.value;
    MeasuredNumber::root(square / squared, error.hypot(of_gain) / squared)
}

/// PRNU of all channels, each weighted by its error.
fn prnu_of(surfaces: &[Surface]) -> MeasuredNumber {
    let weights = surfaces.iter().map(|surface| surface.scatter.1.powi(-2));
    let weight: f64 = weights.clone().sum();
    let square = surfaces.iter().zip(weights).map(|(surface, w)| w * surface.scatter.0).sum::<f64>() / weight;
    MeasuredNumber::root(square, weight.powf(-0.5)).times(100.0)
}

/// What the light of a channel is like over the frame.
struct Surface {
    channel: usize,
    /// DN in the middle.
    axis: MeasuredNumber,
    shading: [MeasuredNumber; 2],
    corner: MeasuredNumber,
    /// Largest difference that no lens makes; 0 where noise may make it.
    unevenness: f64,
    /// Squared PRNU with its error.
    scatter: (f64, f64),
    defects: usize,
}

/// Coefficients of a surface with their covariance, whatever the scatter of pixels depends on.
struct SurfaceFit {
    beta: SVector<f64, TERMS>,
    covariance: SMatrix<f64, TERMS, TERMS>,
}

fn fit_surface<I: Iterator<Item = usize>>(
    values: impl Fn() -> I,
    row: impl Fn(usize) -> SVector<f64, TERMS>,
    signal: impl Fn(usize) -> f64,
) -> Option<SurfaceFit> {
    let mut normal = SMatrix::<f64, TERMS, TERMS>::zeros();
    let mut right = SVector::<f64, TERMS>::zeros();
    for value in values() {
        let terms = row(value);
        normal += terms * terms.transpose();
        right += terms * signal(value);
    }
    let inverse = normal.cholesky()?.inverse();
    let beta = inverse * right;
    let mut middle = SMatrix::<f64, TERMS, TERMS>::zeros();
    for value in values() {
        let terms = row(value);
        middle += terms * terms.transpose() * (signal(value) - beta.dot(&terms)).powi(2);
    }
    let is_lit = beta[0] > 0.0 && beta[0] + beta[1] + beta[2] > 0.0;
    is_lit.then_some(SurfaceFit { beta, covariance: inverse * middle * inverse })
}

impl SurfaceFit {
    /// A sum of coefficients over the first of them.
    fn relative(&self, weights: [f64; 3]) -> MeasuredNumber {
        let sum = (0..3).map(|i| weights[i] * self.beta[i]).sum::<f64>();
        let ratio = sum / self.beta[0];
        let mut gradient = SVector::<f64, TERMS>::zeros();
        (0..3).for_each(|i| gradient[i] = weights[i] / self.beta[0]);
        gradient[0] -= ratio / self.beta[0];
        MeasuredNumber::new(ratio, (gradient.transpose() * self.covariance * gradient)[0].max(0.0).sqrt())
    }

    fn surface(&self, channel: usize, scatter: (f64, f64), defects: usize) -> Surface {
        let [tilt, saddle] = [self.beta[3].hypot(self.beta[4]), self.beta[5].hypot(self.beta[6])];
        let error = (3..TERMS).map(|i| self.covariance[(i, i)]).sum::<f64>().max(0.0).sqrt();
        let is_told = tilt + saddle > SIGNIFICANT * error;
        Surface {
            channel,
            axis: MeasuredNumber::new(self.beta[0], self.covariance[(0, 0)].max(0.0).sqrt()),
            shading: [self.relative([0.0, 1.0, 0.0]), self.relative([0.0, 0.0, 1.0])],
            corner: self.relative([1.0, 1.0, 1.0]),
            unevenness: if is_told { 2.0 * (tilt + saddle) / self.beta[0] } else { 0.0 },
            scatter,
            defects,
        }
    }
}
