//! Raw sensor images and the linear channel images developed from them.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::InterpolationTaps;

/// A color filter array: which channel each pixel of a repeating cell sees. Without a pattern every pixel sees all channels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mosaic {
    /// Rows of the repeating cell.
    pub rows: usize,
    /// Columns of the repeating cell.
    pub cols: usize,
    /// Channel number of each pixel of the cell, row by row; empty where every pixel measures all channels.
    pub pattern: Vec<u8>,
    /// Channel names, for instance `["R", "G", "B"]`.
    pub channels: Vec<String>,
}

impl Mosaic {
    /// A two by two Bayer array such as `"rggb"`, `"grbg"`, `"gbrg"`, `"bggr"`; `None` for any other letters.
    pub fn bayer(order: &str) -> Option<Self> {
        let pattern: Vec<u8> = order
            .bytes()
            .map(|letter| match letter.to_ascii_lowercase() {
                b'r' => Some(0),
                b'g' => Some(1),
                b'b' => Some(2),
                _ => None,
            })
            .collect::<Option<_>>()?;
        let count = |channel| pattern.iter().filter(|&&c| c == channel).count();
        let greens_touch_corners = pattern.len() == 4 && (pattern[0] == 1) == (pattern[3] == 1);
        (pattern.len() == 4 && count(0) == 1 && count(1) == 2 && greens_touch_corners).then(|| Self {
            rows: 2,
            cols: 2,
            pattern,
            channels: ["R", "G", "B"].map(String::from).to_vec(),
        })
    }

    /// One channel on every pixel.
    pub fn monochrome() -> Self {
        Self { rows: 1, cols: 1, pattern: vec![0], channels: vec!["mono".into()] }
    }

    /// Whether it is a two by two Bayer array: three channels, one of them on both pixels of a diagonal.
    pub fn is_bayer(&self) -> bool {
        let count = |channel: u8| self.pattern.iter().filter(|&&c| c == channel).count();
        (self.rows, self.cols, self.channels.len(), self.pattern.len()) == (2, 2, 3, 4)
            && (0..3).all(|channel| count(channel) >= 1)
            && (self.pattern[0] == self.pattern[3] || self.pattern[1] == self.pattern[2])
    }

    /// Share of the pixels that measure each channel.
    pub fn shares(&self) -> Vec<f64> {
        if self.pattern.is_empty() {
            return vec![1.0; self.channels.len()];
        }
        let count = |channel| self.pattern.iter().filter(|&&c| usize::from(c) == channel).count();
        (0..self.channels.len()).map(|c| count(c) as f64 / self.pattern.len().max(1) as f64).collect()
    }

    /// Channel number of a pixel.
    pub fn channel(&self, row: usize, col: usize) -> usize {
        usize::from(self.pattern[(row % self.rows) * self.cols + col % self.cols])
    }
}

/// One raw frame: digital numbers on a mosaic, `[row, col]`, rows from the top; or of all channels, `[row, col, channel]`, where a
/// file holds them developed, or the sensor has no mosaic.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Digital numbers.
    pub data: Vec<u16>,
    /// Color filter array; of developed channels the one that they were interpolated from.
    pub mosaic: Mosaic,
    /// Digital number of no light; where it differs by place, its mean.
    pub black_level: f64,
    /// What the black level of each value lies above `black_level`, DN, in the order of `data`; empty where it is the same everywhere.
    pub black_offsets: Vec<f32>,
    /// Digital number at and above which a pixel is saturated.
    pub white_level: u16,
    /// Bits of the converter.
    pub bit_depth: u8,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Analog gain, 1 = base.
    pub gain: f64,
    /// Digital numbers per electron at this gain.
    pub dn_per_electron: f64,
    /// Whether these are those of an experiment's sensor, as the file of the frame does not tell them.
    pub gain_is_assumed: bool,
    /// Temporal read noise, digital numbers rms, quantization excluded.
    pub read_noise_dn: f64,
    /// Seed of the temporal noise.
    pub seed: u64,
    /// Name of the frame in the capture sequence, for instance "blue".
    pub label: String,
}

impl SensorImage {
    /// Whether every pixel holds all channels.
    #[must_use]
    pub fn has_all_channels(&self) -> bool {
        self.data.len() > self.width * self.height
    }

    /// Black level of one value, DN.
    #[must_use]
    pub fn black_of(&self, value: usize) -> f64 {
        self.black_level + self.black_offsets.get(value).map_or(0.0, |offset| f64::from(*offset))
    }
}

/// A developed frame: linear, black-subtracted digital numbers, `[row, col, channel]`, not clipped below zero.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Channel names.
    pub channels: Vec<String>,
    /// Values, `[row, col, channel]`.
    pub data: Vec<f32>,
    /// Pixels for which any raw value that entered was saturated, `[row, col]`.
    pub saturated: Vec<bool>,
    /// Standard deviation of the dark noise of one value (read noise and quantization), digital numbers.
    pub noise_floor_dn: f64,
    /// Digital numbers between black and saturation.
    pub full_scale_dn: f64,
    /// Share of the raw pixels that measure each channel: 0.25, 0.5, 0.25 on a Bayer array, 1 without a mosaic. The mean of
    /// `n` interpolated values holds `n * share` independent measurements.
    pub shares: Vec<f64>,
    /// How the channels were interpolated from raw pixels; `None` where that is not known, or every pixel measured all of them.
    #[serde(with = "shared")]
    pub interpolation: Option<Arc<InterpolationTaps>>,
    /// Light of another frame that was subtracted.
    pub subtracted: Option<SubtractedLight>,
    /// What the frames that calibrated it add to its noise; `None` without such frames.
    pub calibration: Option<CalibrationNoise>,
    /// Name of the frame.
    pub label: String,
}

/// Light that was subtracted from a developed frame. Its shot noise stays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SubtractedLight {
    /// Its level in digital numbers of the frame, `[row, col, channel]`.
    pub dn: Vec<f32>,
    /// Exposure time of the frame over that of the frame that was subtracted.
    pub exposure_ratio: f64,
}

/// What dark frames and frames of even light do to the noise of developed values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibrationNoise {
    /// What is added to the variance of each value, DN², `[row, col, channel]`. Below zero where a flat field makes a value smaller.
    pub variance_dn2: Vec<f32>,
    /// Variance of the scale of each channel, over its square: the same error for all its values. 0 without a flat field.
    pub scale_variance: Vec<f64>,
    /// Whether dark frames took out the pattern of dark signals.
    pub has_dark: bool,
    /// Whether frames of even light took out the pattern of responses.
    pub has_flat: bool,
}

/// What several frames share is written with each of them.
mod shared {
    use super::{Arc, Deserialize, InterpolationTaps, Serialize};
    use serde::{Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(
        taps: &Option<Arc<InterpolationTaps>>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        taps.as_deref().serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Option<Arc<InterpolationTaps>>, D::Error> {
        Ok(Option::<InterpolationTaps>::deserialize(from)?.map(Arc::new))
    }
}

impl ChannelImage {
    /// The channels of one pixel.
    pub fn pixel(&self, row: usize, col: usize) -> &[f32] {
        let n = self.channels.len();
        let start = (row * self.width + col) * n;
        &self.data[start..start + n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bayer_orders_are_read_and_nonsense_is_not() {
        let grbg = Mosaic::bayer("GRBG").unwrap();
        assert_eq!(
            [grbg.channel(0, 0), grbg.channel(0, 1), grbg.channel(1, 0), grbg.channel(5, 7)],
            [1, 0, 2, 1]
        );
        for wrong in ["rgb", "rgbg5", "rrbb", "rgxb", "rbgg", ""] {
            assert!(Mosaic::bayer(wrong).is_none(), "{wrong}");
        }
    }
}
