//! Raw sensor images and the linear channel images developed from them.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{InterpolationTaps, Orientation};

/// A color filter array: which channel each pixel of a repeating cell sees. Without a pattern every pixel sees all channels.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
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

    /// The array of a sensor of `size` columns and rows as stored, shown as `to` turns it, from that which `from` shows.
    #[must_use]
    pub fn turned(&self, size: [usize; 2], from: Orientation, to: Orientation) -> Self {
        if self.pattern.is_empty() || from == to {
            return self.clone();
        }
        // A cell at a corner of the turned image, which may begin within a cell of the stored one. An image that is larger by whole cells
        // has the same there, also where the image is smaller than a cell
        let [cols, rows] = Orientation::size(Orientation::size([self.cols, self.rows], from), to);
        let large = size.map(|side| side + self.rows * self.cols);
        let channel = |row: usize, col: usize| {
            let [row, col] = to.stored(large, [row, col]);
            let place = from.shown(large, [row, col]);
            self.channel(place[0], place[1])
        };
        let places = (0..rows).flat_map(|row| (0..cols).map(move |col| (row, col)));
        Self {
            rows,
            cols,
            pattern: places.map(|(row, col)| channel(row, col) as u8).collect(),
            channels: self.channels.clone(),
        }
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
    /// Digital number at and above which a pixel is saturated; where it differs by channel, the largest.
    pub white_level: u16,
    /// That of each channel; empty where it is the same for all.
    pub white_levels: Vec<u16>,
    /// What evens out the shading of the lens, as the file tells: a factor of each value above its black level, in the order of `data`;
    /// empty where it tells none.
    pub factors: Vec<f32>,
    /// How the frame is turned from the order of its file.
    pub orientation: Orientation,
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

    /// Channel of one value.
    #[must_use]
    pub fn channel_of(&self, value: usize) -> usize {
        match self.data.len() / (self.width * self.height).max(1) {
            0 | 1 if self.mosaic.pattern.is_empty() => 0,
            0 | 1 => self.mosaic.channel(value / self.width, value % self.width),
            samples => value % samples,
        }
    }

    /// Whether one value is saturated.
    #[must_use]
    pub fn is_saturated(&self, value: usize) -> bool {
        let white = match self.white_levels.is_empty() {
            true => None,
            false => self.white_levels.get(self.channel_of(value)),
        };
        self.data[value] >= white.copied().unwrap_or(self.white_level)
    }

    /// The frame turned as another orientation shows it.
    #[must_use]
    pub fn turned(mut self, orientation: Orientation) -> Self {
        if self.orientation == orientation {
            return self;
        }
        let before = self.orientation;
        let stored = Orientation::size([self.width, self.height], before);
        let shown = Orientation::size(stored, orientation);
        self.mosaic = self.mosaic.turned(stored, before, orientation);
        fn turn<T: Copy>(values: &[T], size: [usize; 2], [from, to]: [Orientation; 2]) -> Vec<T> {
            if values.is_empty() { Vec::new() } else { to.turn(size, &from.turn_back(size, values)) }
        }
        let turns = [before, orientation];
        self.data = turn(&self.data, stored, turns);
        self.black_offsets = turn(&self.black_offsets, stored, turns);
        self.factors = turn(&self.factors, stored, turns);
        [self.width, self.height] = shown;
        self.orientation = orientation;
        self
    }

    /// The frame turned as the first one of its analysis is, whose pixels are the same pixels of the sensor, and a remark where its own
    /// file shows it otherwise: cameras that look down often tell another orientation from frame to frame.
    #[must_use]
    pub fn turned_as(self, first: &Self) -> (Self, Option<String>) {
        let remark = (self.orientation != first.orientation).then(|| {
            let said = |orientation: Orientation| match orientation.words() {
                "" => "as it is stored",
                words => words,
            };
            format!(
                "Frame \"{}\" is to be shown {}, frame \"{}\" {}: it is turned as the latter, pixel by pixel of the sensor",
                self.label,
                said(self.orientation),
                first.label,
                said(first.orientation)
            )
        });
        (self.turned(first.orientation), remark)
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
    /// Mean variance that dark frames leave in each channel, the same in all frames, DN²: the noise of their mean. Empty where not known.
    #[serde(default)]
    pub dark_pattern_dn2: Vec<f64>,
    /// Mean variance of the flat field's factors in each channel, over their squares: the same in all frames.
    #[serde(default)]
    pub factor_variance: Vec<f64>,
    /// Variance of what rows and columns share in one frame, over that of frames without calibration, of each raw value; empty where it is
    /// the same.
    #[serde(default)]
    pub line_variance: Vec<f32>,
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

impl CalibrationNoise {
    /// Variance of a value by what the noise of calibration frames leaves in each pixel, the same in all frames, DN².
    #[must_use]
    pub fn pattern_dn2(&self, channel: usize, value_dn: f64) -> f64 {
        let of = |variances: &[f64]| variances.get(channel).copied().unwrap_or(0.0);
        of(&self.dark_pattern_dn2) + of(&self.factor_variance) * value_dn * value_dn
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
#[allow(clippy::unwrap_used, reason = "these are tests")]
mod tests {
    use super::*;

    /// A frame of 3 x 5 pixels whose values tell their place and channel: each pixel keeps its own channel, level and factor.
    #[test]
    fn a_turned_frame_keeps_the_channel_of_each_pixel() {
        let mosaic = Mosaic {
            rows: 2,
            cols: 3,
            pattern: vec![0, 1, 2, 2, 1, 1],
            channels: ["R", "G", "B"].map(String::from).to_vec(),
        };
        let pixels = || (0..5usize).flat_map(|row| (0..3usize).map(move |col| (row, col)));
        let frame = SensorImage {
            width: 3,
            height: 5,
            data: pixels()
                .map(|(row, col)| (100 * row + 10 * col + mosaic.channel(row, col)) as u16)
                .collect(),
            black_offsets: (0..15).map(|pixel| pixel as f32).collect(),
            factors: (0..15).map(|pixel| 1.0 + pixel as f32).collect(),
            mosaic,
            black_level: 0.0,
            white_level: 1000,
            white_levels: vec![1000, 211, 1000],
            orientation: Orientation::default(),
            bit_depth: 10,
            exposure_s: 1.0,
            gain: 1.0,
            dn_per_electron: 1.0,
            gain_is_assumed: false,
            read_noise_dn: 1.0,
            seed: 0,
            label: "blue".into(),
        };
        for tag in 1..=8 {
            let turned = frame.clone().turned(Orientation::of_tag(tag).unwrap());
            for (value, &dn) in turned.data.iter().enumerate() {
                let (row, col, channel) = (dn / 100, dn / 10 % 10, usize::from(dn % 10));
                assert_eq!(turned.channel_of(value), channel, "{tag}: {dn}");
                assert_eq!(turned.black_of(value), f64::from(3 * row + col));
                assert_eq!(turned.factors[value], f32::from(3 * row + col + 1));
                assert_eq!(turned.is_saturated(value), channel == 1 && dn >= 211);
            }
            let again = turned.turned(Orientation::of_tag(6).unwrap());
            assert_eq!(again, frame.clone().turned(Orientation::of_tag(6).unwrap()));
            let (as_first, remark) = again.turned_as(&frame);
            assert_eq!(as_first, frame);
            assert!(
                remark
                    .unwrap()
                    .contains("shown turned by 90 degrees clockwise, frame \"blue\" as it is stored")
            );
        }
    }

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
