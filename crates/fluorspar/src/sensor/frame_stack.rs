//! Equal frames of a camera and their temporal noise, as photon transfer needs it.

use super::MasterFrame;
use super::develop::DevelopError;
use super::frame_statistics::{mean, variance};
use crate::image::SensorImage;

/// The mean of a channel in equal frames, and how their values vary in time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StackNoise {
    /// Mean digital number.
    pub mean_dn: f64,
    /// Temporal variance, DN²; 0 of one frame.
    pub variance_dn2: f64,
    /// Standard error of that variance, DN²; infinite of one frame.
    pub variance_error_dn2: f64,
    /// Share of its values that are saturated.
    pub saturated: f64,
    /// Share of its values that are 0.
    pub empty: f64,
}

/// Equal frames: their mean, and the noise of each channel.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameStack {
    /// Their mean.
    pub master: MasterFrame,
    /// Their noise, by channel.
    pub channels: Vec<StackNoise>,
    /// Mean digital number of all channels.
    pub level_dn: f64,
    /// Its standard error from frame to frame, DN: noise and what moves whole frames. Of one frame that of its pixels.
    pub level_error_dn: f64,
    /// Standard deviation of the levels of whole frames over their mean level above the black level: light that flickers. 0 of one frame.
    pub flicker: f64,
    /// Gain of the frames as they tell it.
    pub gain: f64,
    /// Digital number from which a value is saturated.
    pub white_level: u16,
    /// Bits of the converter.
    pub bit_depth: u8,
}

/// Sums over frames about the first of them, which keeps squares small.
#[derive(Default)]
struct Sums {
    origin: Vec<u16>,
    channel: Vec<u8>,
    sums: Vec<f64>,
    squares: Vec<f64>,
    empty: Vec<f64>,
    levels: Vec<f64>,
    /// Whether frames are scaled to the level of the first.
    is_scaled: bool,
    black: f64,
    gain: f64,
    bits: (u16, u8),
}

impl Sums {
    /// Adds a frame, scaled to the level of the first where light fell on it, and moved there where none did.
    fn add(&mut self, frame: &SensorImage, is_dark: bool) {
        let count = frame.data.len().max(1) as f64;
        let level = frame.data.iter().map(|&dn| f64::from(dn)).sum::<f64>() / count;
        if self.levels.is_empty() {
            self.origin.clone_from(&frame.data);
            self.channel = (0..frame.data.len()).map(|value| frame.channel_of(value) as u8).collect();
            self.sums = vec![0.0; frame.data.len()];
            self.squares = self.sums.clone();
            self.empty = vec![0.0; frame.mosaic.channels.len()];
            (self.black, self.gain) = (frame.black_level, frame.gain);
            self.bits = (frame.white_level, frame.bit_depth);
        }
        self.levels.push(level);
        let (first, black) = (self.levels[0], self.black);
        let (scale, shift) = match is_dark || level <= black || first <= black {
            true => (1.0, first - level),
            false => ((first - black) / (level - black), 0.0),
        };
        self.is_scaled |= scale != 1.0;
        for (value, (&dn, &origin)) in frame.data.iter().zip(&self.origin).enumerate() {
            let difference = (f64::from(dn) - black) * scale + shift + black - f64::from(origin);
            self.sums[value] += difference;
            self.squares[value] += difference * difference;
            self.empty[usize::from(self.channel[value])] += f64::from(u8::from(dn == 0));
        }
    }

    /// Standard deviation of the levels, DN.
    fn spread_of_levels(&self) -> f64 {
        let count = self.levels.len() as f64;
        let mean = self.levels.iter().sum::<f64>() / count;
        let squares = self.levels.iter().map(|level| (level - mean).powi(2)).sum::<f64>();
        (squares / (count - 1.0).max(1.0)).sqrt()
    }

    /// Standard error of the mean level: noise of pixels, and what moves whole frames.
    fn level_error_dn(&self, master: &MasterFrame, channels: &[StackNoise]) -> f64 {
        let frames = self.levels.len() as f64;
        let of_pixels = if frames > 1.0 {
            mean(channels.iter().map(|channel| channel.variance_dn2)) / frames
        } else {
            variance(&master.mean.iter().map(|&dn| f64::from(dn)).collect::<Vec<_>>())
        };
        (of_pixels / master.mean.len() as f64 + self.spread_of_levels().powi(2) / frames).sqrt()
    }

    /// The noise of a channel whose values have this mean. Its error is that of normal noise, `2 σ⁴ / (N - 1)` a pixel, in which `σ⁴` is
    /// estimated from squares of variances, so that pixels may differ in their light.
    fn noise_of(&self, channel: usize, master: &MasterFrame) -> StackNoise {
        let frames = self.levels.len() as f64;
        let (mut count, mut mean, mut full) = (0.0, 0.0, 0.0);
        let (mut variance, mut fourth) = (0.0, 0.0);
        for value in master.values_of(channel) {
            count += 1.0;
            mean += f64::from(master.mean[value]);
            full += f64::from(u8::from(master.saturated[value]));
            let of_value = self.squares[value] - self.sums[value].powi(2) / frames;
            let of_value = of_value.max(0.0) / (frames - 1.0).max(1.0);
            variance += of_value;
            fourth += of_value * of_value;
        }
        let count = f64::max(count, 1.0);
        // Noise at the mean level, which is that of the mean
        let level = self.levels.iter().sum::<f64>() / frames;
        let to_mean = if self.is_scaled { (level - self.black) / (self.levels[0] - self.black) } else { 1.0 };
        variance *= to_mean.powi(2);
        fourth *= to_mean.powi(4);
        StackNoise {
            mean_dn: mean / count,
            variance_dn2: variance / count,
            variance_error_dn2: if frames < 2.0 {
                f64::INFINITY
            } else {
                (2.0 / (frames + 1.0) * fourth).sqrt() / count
            },
            saturated: full / count,
            empty: self.empty[channel] / (count * frames),
        }
    }
}

impl FrameStack {
    /// Averages equal frames, dark or of steady light, that are taken one by one.
    ///
    /// # Errors
    /// As [`MasterFrame::average`].
    pub fn of<E: From<DevelopError>>(
        frames: impl IntoIterator<Item = Result<SensorImage, E>>,
        is_dark: bool,
    ) -> Result<Self, E> {
        let mut sums = Sums::default();
        let mut size = None;
        let seen = frames.into_iter().map(|frame| {
            // A frame of another size is refused by the mean
            frame.inspect(|frame| {
                if *size.get_or_insert(frame.data.len()) == frame.data.len() {
                    sums.add(frame, is_dark);
                }
            })
        });
        let master = MasterFrame::average(seen)?;
        let channels: Vec<StackNoise> =
            (0..master.mosaic.channels.len()).map(|channel| sums.noise_of(channel, &master)).collect();
        let frames = sums.levels.len() as f64;
        let level_dn = sums.levels.iter().sum::<f64>() / frames;
        let above = level_dn - sums.black;
        let flicker = if is_dark || above <= 0.0 { 0.0 } else { sums.spread_of_levels() / above };
        let level_error_dn = sums.level_error_dn(&master, &channels);
        let ((white_level, bit_depth), gain) = (sums.bits, sums.gain);
        Ok(Self { master, channels, level_dn, level_error_dn, flicker, gain, white_level, bit_depth })
    }

    /// Exposure time, s.
    #[must_use]
    pub fn exposure_s(&self) -> f64 {
        self.master.exposure_s
    }
}
