//! What the pixels of a camera's frame show that its file does not tell: alignment, plateaus, a black level above them.

use fluorspar::image::{Orientation, SensorImage};

use super::tiff_directory::Directory;

/// One thing that a frame has otherwise than most, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FrameRemark {
    pub(crate) key: &'static str,
    pub(crate) value: String,
    /// What follows from it.
    pub(crate) remark: String,
    /// Whether it makes results doubtful.
    pub(crate) is_doubtful: bool,
}

/// What the tags of a file tell beside a description.
#[derive(Debug, Default)]
pub(crate) struct FrameTags {
    pub(crate) orientation: Orientation,
    /// Bits of the converter, where a PNG tells them.
    pub(crate) bits: Option<u8>,
    /// White level of each channel, as stored; empty where one is for all.
    pub(crate) whites: Vec<u16>,
    pub(crate) factors: Vec<f32>,
    pub(crate) remarks: Vec<FrameRemark>,
    /// Whether black and white level are told for the values as stored.
    pub(crate) has_levels: bool,
}

/// Pixels as a file stores them.
#[derive(Debug, Default)]
pub(crate) struct StoredFrame {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) data: Vec<u16>,
    /// What the black level of each value lies above the described one; empty where it is the same everywhere.
    pub(crate) black_offsets: Vec<f32>,
    pub(crate) tags: FrameTags,
}

/// Bits of converters that are known to write into the upper ones of 16.
const CONVERTER_BITS: [u8; 5] = [8, 10, 12, 14, 15];

/// Bits at the lower end that no value of a frame uses; 0 of a frame of one value.
pub(crate) fn unused_bits(data: &[u16]) -> u32 {
    let all = data.iter().fold(0, |all, value| all | value);
    if data.iter().all(|value| *value == data[0]) { 0 } else { all.trailing_zeros().min(16) }
}

/// Bits of most converters that write so, and how many different values must be multiples of more to tell another.
const USUAL_BITS: u8 = 12;
const FEW_VALUES: usize = 16;

/// Bits of the converter whose values stand in the upper ones of 16: all are multiples of a power of 2, and some, or the white level where
/// it is told, need more bits than the converter has.
pub(crate) fn left_aligned_bits(data: &[u16], white: u16) -> Option<u8> {
    let most = data.iter().copied().max().unwrap_or(0).max(white);
    let bits = 16 - unused_bits(data);
    let mut bits = CONVERTER_BITS.into_iter().find(|known| u32::from(*known) >= bits)?;
    if bits < USUAL_BITS {
        // A few values may be multiples of more by chance
        if !has_many_values(data) {
            bits = USUAL_BITS;
        }
    }
    (u32::from(most) >> bits > 0).then_some(bits)
}

fn has_many_values(data: &[u16]) -> bool {
    let mut values = data.to_vec();
    values.sort_unstable();
    values.dedup();
    values.len() >= FEW_VALUES
}

/// What makes values doubtful that are all multiples of 4 or more, and too small to show that they stand in the upper bits.
pub(crate) fn maybe_left_aligned(data: &[u16], bit_depth: u8) -> Option<FrameRemark> {
    let unused = unused_bits(data);
    ((9..16).contains(&bit_depth) && unused >= 2 && has_many_values(data)).then(|| FrameRemark {
        key: "alignment",
        value: format!("all values are multiples of {}", 1u32 << unused),
        remark: format!(
            "where brighter frames of the camera have more than {} DN, its bits are left-aligned in 16, and all levels here are too large: \
             describe the frame with --left-aligned",
            (1u32 << bit_depth) - 1
        ),
        is_doubtful: true,
    })
}

/// What is said of values that were shifted down.
pub(crate) fn alignment_words(bits: u8, shift: u8) -> String {
    format!("{bits} bits left-aligned in {}; divided by {}", bits + shift, 1u32 << shift)
}

/// Shares of a channel's pixels from which those that have its largest value are a plateau: high in the range, and anywhere.
const PLATEAU_SHARE: [f64; 2] = [1e-3, 1e-2];
/// Part of the range from which a level is near its end.
const NEAR_END: f64 = 0.9;
/// Fewest pixels of a plateau.
const PLATEAU_PIXELS: u64 = 8;
/// Fewest pixels of a level that stands alone, and of a spread.
const LEVEL_PIXELS: u64 = 4;
/// Values below the largest that tell how many pixels a value has there without a plateau, and how many times as many a plateau has.
const BELOW_PLATEAU: (usize, u64) = (16, 5);
/// Numbers above the black level from which light has noise that spreads it over several values.
const NOISY_FROM: f64 = 64.0;

/// Takes plateaus for saturation: values that many pixels of a channel share and none exceeds.
pub(crate) fn mark_plateaus(image: &mut SensorImage) -> Option<FrameRemark> {
    let channels = image.mosaic.channels.len().max(1);
    let mut counts = vec![vec![0u64; 65_536]; channels];
    for (value, &dn) in image.data.iter().enumerate() {
        if let Some(of) = counts.get_mut(image.channel_of(value)) {
            of[usize::from(dn)] += 1;
        }
    }
    let whites: Vec<u16> = (0..channels)
        .map(|channel| image.white_levels.get(channel).copied().unwrap_or(image.white_level))
        .collect();
    let has_noise = counts.iter().any(|of| has_noise(of));
    let plateaus: Vec<Option<(u16, f64)>> = counts
        .iter()
        .zip(&whites)
        .map(|(of, white)| plateau(of, *white, image.black_level, has_noise))
        .collect();
    if plateaus.iter().all(Option::is_none) {
        return None;
    }
    let name = |channel: usize| image.mosaic.channels.get(channel).map_or("", String::as_str);
    let words = plateaus.iter().enumerate().filter_map(|(channel, found)| {
        let (dn, share) = (*found)?;
        Some(format!("{:.1} % of {} at {dn} DN", 100.0 * share, name(channel)))
    });
    let words: Vec<String> = words.collect();
    image.white_levels = whites
        .iter()
        .zip(&plateaus)
        .map(|(white, found)| found.map_or(*white, |(dn, _)| dn.min(*white)))
        .collect();
    Some(FrameRemark {
        key: "plateau",
        value: words.join(", "),
        remark: format!(
            "no pixel has more: taken as saturated, though the white level is {} DN",
            image.white_level
        ),
        is_doubtful: true,
    })
}

/// Whether values spread: some differ from the largest, and none of many pixels stands alone, as levels of a picture without noise do.
fn has_noise(counts: &[u64]) -> bool {
    let Some(largest) = counts.iter().rposition(|count| *count > 0) else { return false };
    let (near, times) = BELOW_PLATEAU;
    let stands_alone = |level: usize| {
        let around = level.saturating_sub(near)..(level + near + 1).min(counts.len());
        counts[around].iter().sum::<u64>() == counts[level]
    };
    let is_level = |level: usize| {
        let count = counts[level];
        count >= LEVEL_PIXELS && times * count >= counts[largest] && stands_alone(level)
    };
    counts[..largest].iter().sum::<u64>() >= LEVEL_PIXELS && !(0..largest).any(is_level)
}

/// The plateau of a channel below its white level, and the share of its pixels there, by how many pixels each value has.
fn plateau(counts: &[u64], white: u16, black: f64, has_noise: bool) -> Option<(u16, f64)> {
    let dn = counts.iter().rposition(|count| *count > 0)?;
    let all: u64 = counts.iter().sum();
    let share = counts[dn] as f64 / all as f64;
    let (below, times) = BELOW_PLATEAU;
    let near = &counts[dn.saturating_sub(below)..dn];
    let is_peak = dn < usize::from(white)
        && counts[dn] >= PLATEAU_PIXELS
        && share >= PLATEAU_SHARE[0]
        && counts[dn] * below as u64 > times * near.iter().sum::<u64>();
    if !is_peak {
        return None;
    }
    let (above, range) = (dn as f64 - black, f64::from(white) - black);
    if above >= NEAR_END * range {
        return Some((dn as u16, share));
    }
    // Without noise a level is nothing but a level; dim light may have none that shows, and most pixels then share one value or two
    let is_beyond_neighbors = counts[dn] > 2 * near.iter().copied().max().unwrap_or(0);
    let is_plateau = share >= PLATEAU_SHARE[1] && above >= NOISY_FROM && is_beyond_neighbors;
    (has_noise && (is_plateau || is_far_above_others(counts, dn, above, range))).then_some((dn as u16, share))
}

/// Whether the largest value lies high in the range, or far above the bulk of the others, which are no few.
fn is_far_above_others(counts: &[u64], dn: usize, above: f64, range: f64) -> bool {
    let others: u64 = counts[..dn].iter().sum();
    let mut seen = 0;
    let median = counts.iter().position(|count| {
        seen += count;
        2 * seen >= others
    });
    let is_high = above > 0.5 * range
        || median.is_some_and(|median| above > 2.0 * (above - (dn - median) as f64).max(1.0));
    10 * others >= counts[dn] && is_high
}

/// Standard deviations of the mean of a channel from which noise does not put its median below a level.
const DEVIATIONS: f64 = 3.0;

/// Channels whose median lies further below the black level than rounding, and the noise of their mean, explain.
pub(crate) fn high_black_level(image: &SensorImage) -> Option<FrameRemark> {
    let mut above: Vec<Vec<f32>> = vec![Vec::new(); image.mosaic.channels.len().max(1)];
    for (value, &dn) in image.data.iter().enumerate() {
        if let Some(of) = above.get_mut(image.channel_of(value)) {
            of.push((f64::from(dn) - image.black_of(value)) as f32);
        }
    }
    let mut is_high = |channel: usize| {
        let values = &mut above[channel];
        let count = values.len().max(1) as f64;
        let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
        let square = values.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / count;
        let middle = values.len() / 2;
        let mut median = || f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1);
        middle > 0 && median() + 0.5 < -DEVIATIONS * (square / count).sqrt()
    };
    let names: Vec<&str> = (0..image.mosaic.channels.len().max(1))
        .filter(|channel| is_high(*channel))
        .filter_map(|channel| image.mosaic.channels.get(channel).map(String::as_str))
        .collect();
    (!names.is_empty()).then(|| FrameRemark {
        key: "black level",
        value: format!("{} DN: most pixels of {} lie below it", image.black_level, names.join(", ")),
        remark: "it is too high, and their light counts as less than none: describe the frame with --black-level, the mean of a frame \
                 with the cap on the lens, or give such frames to `analyze --dark`"
            .into(),
        is_doubtful: true,
    })
}

/// How directories of a file, the first that tells, say that an image is turned.
pub(crate) fn orientation_of<'a, 'b: 'a>(
    directories: impl IntoIterator<Item = &'a Directory<'b>>,
) -> Orientation {
    let tag = directories.into_iter().find_map(|directory| directory.first(274));
    tag.and_then(Orientation::of_tag).unwrap_or_default()
}

/// How a frame was turned.
pub(crate) fn turned_words(orientation: Orientation) -> Option<FrameRemark> {
    (!orientation.is_upright()).then(|| FrameRemark {
        key: "orientation",
        value: orientation.words().into(),
        remark: "as viewers show it: masks, rectangles, polygons and previews count rows and columns there"
            .into(),
        is_doubtful: false,
    })
}

/// White levels by channel.
pub(crate) fn white_levels_words(image: &SensorImage) -> Option<FrameRemark> {
    (!image.white_levels.is_empty()).then(|| FrameRemark {
        key: "white level by plane",
        value: by_channel(image, |channel| image.white_levels.get(channel).map(|&white| f64::from(white))),
        remark: "each counts for its own channel".into(),
        is_doubtful: false,
    })
}

/// How far the black levels of pixels lie from their mean, where they do.
pub(crate) fn black_offsets_words(image: &SensorImage) -> Option<FrameRemark> {
    let (low, high) = bounds(&image.black_offsets)?;
    let mut sums = vec![(0.0, 0.0f64); image.mosaic.channels.len().max(1)];
    for value in 0..image.data.len() {
        if let Some((sum, count)) = sums.get_mut(image.channel_of(value)) {
            *sum += image.black_of(value);
            *count += 1.0;
        }
    }
    let mean = |channel: usize| sums.get(channel).map(|(sum, count)| sum / count.max(1.0));
    Some(FrameRemark {
        key: "black level by place",
        value: format!("{low} to {high:+} DN around it; {}", by_channel(image, mean)),
        remark: "each pixel has its own subtracted".into(),
        is_doubtful: false,
    })
}

/// A number of each channel in words.
fn by_channel(image: &SensorImage, number: impl Fn(usize) -> Option<f64>) -> String {
    let names = image.mosaic.channels.iter().enumerate();
    let words = names.filter_map(|(channel, name)| {
        let value = (100.0 * number(channel)?).round() / 100.0;
        Some(format!("{name} {value}"))
    });
    format!("{} DN", words.collect::<Vec<_>>().join(", "))
}

/// The least and the largest of some numbers.
pub(crate) fn bounds(values: &[f32]) -> Option<(f32, f32)> {
    let bounds =
        values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    (bounds.0 <= bounds.1).then_some(bounds)
}
