//! What the pixels of a camera's frame show that its file does not tell: alignment, plateaus, a black level above them.

use fluorspar::image::{Orientation, SensorImage};

use super::opcodes::bounds;
use super::tiff_directory::Directory;

/// One thing that a frame has otherwise than most, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FrameRemark {
    pub(super) key: &'static str,
    pub(super) value: String,
    /// What follows from it.
    pub(super) remark: String,
    /// Whether it makes results doubtful.
    pub(super) is_doubtful: bool,
}

/// What the tags of a file tell beside a description.
#[derive(Debug, Default)]
pub(super) struct FrameTags {
    pub(super) orientation: Orientation,
    /// White level of each channel, as stored; empty where one is for all.
    pub(super) whites: Vec<u16>,
    pub(super) factors: Vec<f32>,
    pub(super) remarks: Vec<FrameRemark>,
}

/// Pixels as a file stores them.
#[derive(Debug, Default)]
pub(super) struct StoredFrame {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) data: Vec<u16>,
    /// What the black level of each value lies above the described one; empty where it is the same everywhere.
    pub(super) black_offsets: Vec<f32>,
    pub(super) tags: FrameTags,
}

/// Bits of converters that are known to write into the upper ones of 16.
const CONVERTER_BITS: [u8; 5] = [8, 10, 12, 14, 15];

/// Bits at the lower end that no value of a frame uses; 0 of a frame of one value.
pub(super) fn unused_bits(data: &[u16]) -> u32 {
    let all = data.iter().fold(0, |all, value| all | value);
    if data.iter().all(|value| *value == data[0]) { 0 } else { all.trailing_zeros().min(16) }
}

/// Bits of most converters that write so, and how many different values must be multiples of more to tell another.
const USUAL_BITS: u8 = 12;
const FEW_VALUES: usize = 16;

/// Bits of the converter whose values stand in the upper ones of 16: all are multiples of a power of 2, and some need more bits than the
/// converter has.
pub(super) fn left_aligned_bits(data: &[u16]) -> Option<u8> {
    let most = data.iter().copied().max().unwrap_or(0);
    let bits = 16 - unused_bits(data);
    let mut bits = CONVERTER_BITS.into_iter().find(|known| u32::from(*known) >= bits)?;
    if bits < USUAL_BITS {
        // A few values may be multiples of more by chance
        let mut values = data.to_vec();
        values.sort_unstable();
        values.dedup();
        if values.len() < FEW_VALUES {
            bits = USUAL_BITS;
        }
    }
    (u32::from(most) >> bits > 0).then_some(bits)
}

/// What is said of values that were shifted down.
pub(super) fn alignment_words(bits: u8, shift: u8) -> String {
    format!("{bits} bits left-aligned in {}; divided by {}", bits + shift, 1u32 << shift)
}

/// Share of a channel's pixels from which those that have its largest value are a plateau; above the second they are all of the picture,
/// and no plateau unless they lie near the end of the range.
const PLATEAU_SHARE: [f64; 2] = [1e-3, 0.9];
/// Part of the range from which a level is near its end.
const NEAR_END: f64 = 0.9;
/// Fewest pixels of a plateau.
const PLATEAU_PIXELS: u64 = 8;
/// Values below the largest that tell how many pixels a value has there without a plateau, and how many times as many a plateau has.
const BELOW_PLATEAU: (usize, u64) = (16, 5);

/// Takes plateaus for saturation: values that many pixels of a channel share and none exceeds.
pub(super) fn mark_plateaus(image: &mut SensorImage) -> Option<FrameRemark> {
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
    let plateaus: Vec<Option<(u16, f64)>> =
        counts.iter().zip(&whites).map(|(of, white)| plateau(of, *white, image.black_level)).collect();
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

/// The plateau of a channel below its white level, and the share of its pixels there, by how many pixels each value has.
fn plateau(counts: &[u64], white: u16, black: f64) -> Option<(u16, f64)> {
    let dn = counts.iter().rposition(|count| *count > 0)?;
    let all: u64 = counts.iter().sum();
    let share = counts[dn] as f64 / all as f64;
    let (below, times) = BELOW_PLATEAU;
    let near: u64 = counts[dn.saturating_sub(below)..dn].iter().sum();
    let is_peak = dn < usize::from(white)
        && counts[dn] >= PLATEAU_PIXELS
        && share >= PLATEAU_SHARE[0]
        && counts[dn] * below as u64 > times * near;
    if !is_peak {
        return None;
    }
    let part = (dn as f64 - black) / (f64::from(white) - black);
    if part >= NEAR_END {
        return Some((dn as u16, share));
    }
    // Far above the bulk of the others
    let (mut seen, others) = (0, all - counts[dn]);
    let median = counts.iter().position(|count| {
        seen += count;
        2 * seen >= others
    })?;
    let is_high = part > 0.5 || dn as f64 - black > 2.0 * (median as f64 - black).max(1.0);
    // Where another level stands alone as well, the picture has no noise, and a level is nothing but a level
    let stands_alone = |level: usize| {
        let around = level.saturating_sub(below)..(level + below + 1).min(counts.len());
        counts[around].iter().sum::<u64>() == counts[level]
    };
    let has_noise = (0..dn).all(|level| times * counts[level] < counts[dn] || !stands_alone(level));
    (share <= PLATEAU_SHARE[1] && is_high && has_noise).then_some((dn as u16, share))
}

/// Standard deviations of the mean of a channel from which noise does not put its median below a level.
const DEVIATIONS: f64 = 3.0;

/// Channels whose median lies further below the black level than rounding, and the noise of their mean, explain.
pub(super) fn high_black_level(image: &SensorImage) -> Option<FrameRemark> {
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
        let median = match values.is_empty() {
            true => 0.0,
            false => f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1),
        };
        median + 0.5 < -DEVIATIONS * (square / count).sqrt()
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
pub(super) fn orientation_of<'a, 'b: 'a>(
    directories: impl IntoIterator<Item = &'a Directory<'b>>,
) -> Orientation {
    let tag = directories.into_iter().find_map(|directory| directory.first(274));
    tag.and_then(Orientation::of_tag).unwrap_or_default()
}

/// How a frame was turned.
pub(super) fn turned_words(orientation: Orientation) -> Option<FrameRemark> {
    (!orientation.is_upright()).then(|| FrameRemark {
        key: "orientation",
        value: orientation.words().into(),
        remark: "as viewers show it: masks, rectangles, polygons and previews count rows and columns there"
            .into(),
        is_doubtful: false,
    })
}

/// White levels by channel.
pub(super) fn white_levels_words(image: &SensorImage) -> Option<FrameRemark> {
    (!image.white_levels.is_empty()).then(|| FrameRemark {
        key: "white level by plane",
        value: by_channel(image, |channel| image.white_levels.get(channel).map(|&white| f64::from(white))),
        remark: "each counts for its own channel".into(),
        is_doubtful: false,
    })
}

/// How far the black levels of pixels lie from their mean, where they do.
pub(super) fn black_offsets_words(image: &SensorImage) -> Option<FrameRemark> {
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
