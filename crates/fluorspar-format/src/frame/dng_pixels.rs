//! Pixels of DNG files: strips and tiles, plain, deflated or as lossless JPEG, to linear numbers of the active area.

use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;
use rayon::prelude::*;

use super::lossless_jpeg::{LOSSY, decode_lossless_jpeg};
use super::tiff_directory::{Directory, TiffBytes};
use super::tiff_image::compression_name;
use crate::FormatError;
use crate::store::file::{MAX_IMAGE_BYTES, check_image_size, check_packing};

/// Pixels of the active area of a raw image, linear.
pub(crate) struct DngPixels {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Values of a pixel.
    pub(crate) samples: usize,
    /// Mean digital number without light.
    pub(crate) black_level: f64,
    /// What that of each value lies above the mean; empty where it is the same everywhere.
    pub(crate) black_offsets: Vec<f32>,
    /// `[row, col, sample]`.
    pub(crate) data: Vec<u16>,
}

/// What to do about other compressions.
const LOSSLESS: &str = "Convert the raw file of the camera to an uncompressed or losslessly compressed DNG";

/// How the values of a directory are stored.
struct Layout {
    width: usize,
    height: usize,
    samples: usize,
    bits: usize,
    compression: u64,
    /// 1: as they are; 2: differences to the left.
    predictor: u64,
    big_endian: bool,
    /// Width and height of a strip or tile.
    block: [usize; 2],
}

impl Layout {
    fn row_bytes(&self) -> usize {
        (self.block[0] * self.samples * self.bits).div_ceil(8)
    }
}

/// Reads the pixels of a directory: 8 to 16 bits; other depths than 8 and 16 are packed, most significant bit first.
pub(crate) fn read_dng_pixels(
    path: &Path,
    tiff: &TiffBytes<'_>,
    raw: &Directory<'_>,
) -> Result<DngPixels, FormatError> {
    let damaged = |what: String| FormatError::malformed(path, what, "Copy the file again");
    let layout = layout(path, tiff, raw)?;
    let is_tiled = raw.data(324).is_some();
    let (offsets, counts) = if is_tiled { (324, 325) } else { (273, 279) };
    let (offsets, counts) = (raw.unsigned(offsets), raw.unsigned(counts));
    let across = layout.width.div_ceil(layout.block[0]);
    let down = layout.height.div_ceil(layout.block[1]);
    let noun = if is_tiled { "tiles" } else { "strips" };
    if offsets.len() != counts.len() || offsets.is_empty() {
        return Err(damaged(format!("it has {} {noun} and {} lengths", offsets.len(), counts.len())));
    }
    if offsets.len() < across * down {
        let rows = layout.height.saturating_sub(offsets.len() / across.max(1) * layout.block[1]);
        return Err(damaged(format!("{rows} of {} rows are missing", layout.height)));
    }
    let block_of = |index: usize| {
        let bytes = usize::try_from(offsets[index]).ok().and_then(|start| {
            let end = start.checked_add(usize::try_from(counts[index]).ok()?)?;
            tiff.bytes().get(start..end.min(tiff.bytes().len()))
        });
        let row = index / across * layout.block[1];
        let bytes = bytes.ok_or_else(|| damaged(format!("rows from {row} on are not in the file")))?;
        let rows = if is_tiled { layout.block[1] } else { layout.block[1].min(layout.height - row) };
        decode_block(&layout, rows, bytes).map_err(|what| match what.as_str() {
            LOSSY => FormatError::unsupported(path, what, LOSSLESS),
            _ => damaged(format!("rows from {row} on: {what}")),
        })
    };
    let blocks = (0..across * down).into_par_iter().map(block_of).collect::<Result<Vec<Vec<u16>>, _>>()?;
    let mut data = vec![0; layout.width * layout.height * layout.samples];
    let (wide, line) = (layout.block[0] * layout.samples, layout.width * layout.samples);
    for (index, block) in blocks.iter().enumerate() {
        let (left, top) = (index % across * wide, index / across * layout.block[1]);
        let rows = data.chunks_exact_mut(line).skip(top);
        for (to, from) in rows.zip(block.chunks_exact(wide)) {
            let end = (left + wide).min(line);
            to[left..end].copy_from_slice(&from[..end - left]);
        }
    }
    active_area(&layout, raw, data)
        .and_then(|pixels| linear(pixels, raw))
        .map_err(|what| FormatError::malformed(path, what, "Convert the raw file of the camera to DNG again"))
}

fn layout(path: &Path, tiff: &TiffBytes<'_>, raw: &Directory<'_>) -> Result<Layout, FormatError> {
    let unsupported = |what: String| FormatError::unsupported(path, what, LOSSLESS);
    let (width, height) = (raw.first(256).unwrap_or(0), raw.first(257).unwrap_or(0));
    let samples = raw.samples();
    if ![1, 3].contains(&samples) {
        return Err(unsupported(format!("{samples} samples per pixel are not supported")));
    }
    check_image_size(path, width, height, 2 * samples, MAX_IMAGE_BYTES)?;
    check_packing(path, width * height * samples, tiff.bytes().len() as u64)?;
    match raw.first(339) {
        None | Some(1) => {}
        Some(3) => {
            let what = "its values are floating-point numbers, which sensors do not give";
            let hint = "Give the frames that it was made from, as the camera wrote them";
            return Err(FormatError::unsupported(path, what, hint));
        }
        Some(other) => return Err(unsupported(format!("TIFF sample format {other} is not supported"))),
    }
    let bits = raw.first(258).unwrap_or(1);
    if !(8..=16).contains(&bits) {
        return Err(unsupported(format!("{bits} bits per sample are not supported")));
    }
    let compression = raw.first(259).unwrap_or(1);
    if ![1, 7, 8, 32_946].contains(&compression) {
        let name = compression_name(compression);
        return Err(unsupported(format!("the pixels are compressed with {name}")));
    }
    for (name, tag) in [
        ("FillOrder", 266),
        ("CFALayout", 50_711),
        ("RowInterleaveFactor", 50_975),
        ("ColumnInterleaveFactor", 52_547),
    ] {
        if let Some(other) = raw.first(tag).filter(|value| *value != 1) {
            return Err(unsupported(format!("its tag {name} is {other}, and only 1 is read")));
        }
    }
    let predictor = raw.first(317).unwrap_or(1);
    if compression != 7 && !(predictor == 1 || (predictor == 2 && [8, 16].contains(&bits))) {
        return Err(unsupported(format!("TIFF predictor {predictor} is not supported")));
    }
    if raw.first(284).is_some_and(|planes| planes != 1) && samples > 1 {
        return Err(unsupported(
            "the channels are stored in separate planes (planar configuration 2)".into(),
        ));
    }
    let block = match (raw.first(322), raw.first(323)) {
        (Some(across), Some(down)) if raw.data(324).is_some() => [across, down],
        _ => [width, raw.first(278).unwrap_or(height).clamp(1, height)],
    };
    // A tile may reach beyond the image, but not far.
    let reaches_far = |side: u64, of: u64| side == 0 || side > of.saturating_add(4096);
    if reaches_far(block[0], width) || reaches_far(block[1], height) {
        return Err(unsupported(format!("its tiles have {} x {} pixels", block[0], block[1])));
    }
    Ok(Layout {
        width: width as usize,
        height: height as usize,
        samples: samples as usize,
        bits: bits as usize,
        compression,
        predictor,
        big_endian: tiff.is_big_endian(),
        block: block.map(|side| side as usize),
    })
}

/// Values of a strip or tile of some rows; in words what is wrong.
fn decode_block(layout: &Layout, rows: usize, bytes: &[u8]) -> Result<Vec<u16>, String> {
    let values = layout.block[0] * layout.samples;
    if layout.compression == 7 {
        return decode_lossless_jpeg(bytes, values * rows);
    }
    let needed = layout.row_bytes() * rows;
    let mut unpacked = Vec::new();
    let bytes = if layout.compression == 1 {
        bytes
    } else {
        let mut reader = ZlibDecoder::new(bytes).take(needed as u64);
        reader
            .read_to_end(&mut unpacked)
            .map_err(|error| format!("the deflated data are damaged ({error})"))?;
        unpacked.as_slice()
    };
    let bytes = bytes.get(..needed).ok_or("some of them are not in the file")?;
    let mut data = Vec::with_capacity(values * rows);
    for row in bytes.chunks_exact(layout.row_bytes().max(1)) {
        unpack_row(row, values, layout.bits as u32, layout.big_endian, &mut data);
    }
    if layout.predictor == 2 {
        data.chunks_exact_mut(values).for_each(|row| add_differences(layout, row));
    }
    Ok(data)
}

/// Undoes the horizontal predictor of TIFF (6.0, section 14): each value is the difference from that of its channel before it.
fn add_differences(layout: &Layout, row: &mut [u16]) {
    let most = ((1u32 << layout.bits) - 1) as u16;
    for at in layout.samples..row.len() {
        row[at] = row[at].wrapping_add(row[at - layout.samples]) & most;
    }
}

fn unpack_row(row: &[u8], columns: usize, bits: u32, big_endian: bool, out: &mut Vec<u16>) {
    match bits {
        8 => out.extend(row[..columns].iter().map(|&byte| u16::from(byte))),
        16 => out.extend(row.chunks_exact(2).map(|pair| {
            let pair = [pair[0], pair[1]];
            if big_endian { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) }
        })),
        _ => {
            let (mut held, mut count) = (0u32, 0u32);
            let mut bytes = row.iter();
            for _ in 0..columns {
                while count < bits {
                    held = (held << 8) | u32::from(*bytes.next().unwrap_or(&0));
                    count += 8;
                }
                count -= bits;
                out.push(((held >> count) & ((1 << bits) - 1)) as u16);
                held &= (1 << count) - 1;
            }
        }
    }
}

/// The pixels that see light: sensors have covered ones around them. Color filter array and black levels begin at its corner.
fn active_area(layout: &Layout, raw: &Directory<'_>, data: Vec<u16>) -> Result<DngPixels, String> {
    let whole = [0, 0, layout.height, layout.width];
    let area = raw.unsigned(50_829);
    let [top, left, bottom, right] = match area.as_slice() {
        [] => whole,
        [t, l, b, r] if t < b && l < r && *b <= whole[2] as u64 && *r <= whole[3] as u64 => {
            [*t, *l, *b, *r].map(|n| n as usize)
        }
        _ => {
            let [_, _, height, width] = whole;
            return Err(format!(
                "its tag ActiveArea, {area:?}, is no part of its {height} rows and {width} columns"
            ));
        }
    };
    let samples = layout.samples;
    let rows = data.chunks_exact(layout.width * samples).take(bottom).skip(top);
    let data = match [top, left, bottom, right] == whole {
        true => data,
        false => rows.flat_map(|row| &row[left * samples..right * samples]).copied().collect(),
    };
    Ok(DngPixels {
        width: right - left,
        height: bottom - top,
        samples,
        black_level: 0.0,
        black_offsets: Vec::new(),
        data,
    })
}

/// Undoes the table of a camera that stores its numbers on a curve, and finds the black level of each value: that of its place in a
/// repeated cell, and what its column and its row add (BlackLevelDeltaH and BlackLevelDeltaV of DNG).
fn linear(mut pixels: DngPixels, raw: &Directory<'_>) -> Result<DngPixels, String> {
    let table = raw.unsigned(50_712);
    if let Some(&last) = table.last() {
        let linearized =
            |value: u16| table.get(usize::from(value)).copied().unwrap_or(last).min(65_535) as u16;
        pixels.data.iter_mut().for_each(|value| *value = linearized(*value));
    }
    let (width, samples) = (pixels.width, pixels.samples);
    let cell = match raw.unsigned(50_713).as_slice() {
        [rows @ 1..=64, cols @ 1..=64] => [*rows as usize, *cols as usize],
        _ => [1, 1],
    };
    // Read the levels, each of which must have a place
    let mut levels = raw.numbers(50_714);
    if levels.len() == 1 || levels.is_empty() {
        levels = vec![levels.first().copied().unwrap_or(0.0); cell[0] * cell[1] * samples];
    }
    let [of_columns, of_rows] = [50_715, 50_716].map(|tag| raw.numbers(tag));
    for (name, found, wanted) in [
        ("BlackLevel", levels.len(), cell[0] * cell[1] * samples),
        ("BlackLevelDeltaH", of_columns.len(), width),
        ("BlackLevelDeltaV", of_rows.len(), pixels.height),
    ] {
        if found != wanted && found > 0 {
            return Err(format!("its tag {name} has {found} numbers where {wanted} belong"));
        }
    }
    if levels.iter().chain(&of_columns).chain(&of_rows).any(|level| !level.is_finite()) {
        return Err("a black level of it is not a number".into());
    }
    // Tell their mean, and how each value lies to it
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    pixels.black_level = mean(&levels) + mean(&of_columns) + mean(&of_rows);
    let offset = |index: usize| {
        let (row, col, sample) = (index / samples / width, index / samples % width, index % samples);
        let level = levels[(row % cell[0] * cell[1] + col % cell[1]) * samples + sample];
        let delta = |deltas: &[f64], at: usize| deltas.get(at).copied().unwrap_or(0.0);
        (level + delta(&of_columns, col) + delta(&of_rows, row) - pixels.black_level) as f32
    };
    let differs = |values: &[f64]| values.iter().any(|value| *value != values[0]);
    if [&levels, &of_columns, &of_rows].into_iter().any(|values| differs(values)) {
        pixels.black_offsets = (0..pixels.data.len()).map(offset).collect();
    }
    Ok(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_rows_are_most_significant_bit_first() {
        // 10 bits: 0x3ff, 0x000, 0x155 in 4 bytes (two bits to spare).
        let mut out = Vec::new();
        unpack_row(&[0b1111_1111, 0b1100_0000, 0b0000_0101, 0b0101_0100], 3, 10, false, &mut out);
        assert_eq!(out, [0x3ff, 0, 0x155]);
        out.clear();
        unpack_row(&[0xab, 0xcd, 0xef], 2, 12, false, &mut out);
        assert_eq!(out, [0xabc, 0xdef]);
        out.clear();
        unpack_row(&[1, 2], 1, 16, true, &mut out);
        assert_eq!(out, [0x102]);
    }
}
