//! Blocks of pixels packed for OpenEXR, on all threads and by libdeflate, which is faster than the packer of the `exr` crate and leaves
//! no more.

use std::io::{Seek, Write};

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, enumerate_ordered_header_block_indices};
use exr::error::Result;
use exr::image::write::layers::LayersWriter;
use exr::meta::Headers;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::Compression;
use fluorspar::units::memory_is_available;
use libdeflater::{CompressionLvl, Compressor};
use rayon::prelude::*;

/// Level of libdeflate: of the levels beyond it the file gets 1 % smaller at most.
const LEVEL: i32 = 4;
/// Blocks in work at once: each is some megabytes of a spectral image.
const AT_ONCE: usize = 16;

/// Writes all blocks of layers of scan lines, and calls `progress` with the share that is written.
///
/// # Errors
/// What the writer fails with.
pub(super) fn write_blocks(
    writer: impl Write + Seek,
    headers: Headers,
    layers: &impl LayersWriter,
    progress: impl Fn(f64),
) -> Result<()> {
    exr::block::write(writer, headers, true, |meta, chunks| {
        let blocks: Vec<(usize, BlockIndex)> =
            enumerate_ordered_header_block_indices(&meta.headers).collect();
        let mut written = 0;
        for batch in blocks.chunks(AT_ONCE) {
            let pack = |(place, index): &(usize, BlockIndex)| {
                let data = layers.extract_uncompressed_block(&meta.headers, *index);
                (*place, packed(&meta.headers, *index, data))
            };
            let packed: Vec<(usize, Chunk)> = batch.par_iter().map(pack).collect();
            for (place, chunk) in packed {
                chunks.write_chunk(place, chunk)?;
                written += 1;
                progress(written as f64 / blocks.len() as f64);
            }
        }
        Ok(())
    })
}

/// A block of scan lines as the file has it.
fn packed(headers: &[Header], index: BlockIndex, data: Vec<u8>) -> Chunk {
    let header = &headers[index.layer];
    let (width, channels) = (index.pixel_size.0, &header.channels.list);
    let kinds: Vec<SampleType> = channels.iter().map(|channel| channel.sample_type).collect();
    let ordered = match header.compression {
        Compression::PXR24 => Some(differences(&data, width, &kinds)),
        _ => None,
    };
    let stored = little_endian(data, &kinds, width);
    let ordered = match header.compression {
        Compression::ZIP16 => Some(byte_differences(&stored)),
        _ => ordered,
    };
    // What does not get smaller is stored as it is, as what is not to be packed
    chunk(header, index, ordered.and_then(|bytes| deflated(&bytes, stored.len())).unwrap_or(stored))
}

/// Memory of a compressor, bytes, generously.
const COMPRESSOR_BYTES: u64 = 2 << 20;

/// Bytes in less than so many; `None` where that is not possible.
fn deflated(bytes: &[u8], most: usize) -> Option<Vec<u8>> {
    // The library ends the program where it gets no memory
    if !memory_is_available(COMPRESSOR_BYTES) {
        return None;
    }
    let mut compressor = Compressor::new(CompressionLvl::new(LEVEL).unwrap_or_default());
    let mut packed = vec![0; compressor.zlib_compress_bound(bytes.len())];
    let length = compressor.zlib_compress(bytes, &mut packed).ok().filter(|length| *length < most)?;
    packed.truncate(length);
    Some(packed)
}

fn chunk(header: &Header, index: BlockIndex, compressed_pixels_le: Vec<u8>) -> Chunk {
    let y_coordinate = index.pixel_position.1 as i32 + header.own_attributes.layer_position.1;
    let block = CompressedScanLineBlock { y_coordinate, compressed_pixels_le };
    Chunk { layer_index: index.layer, compressed_block: CompressedBlock::ScanLine(block) }
}

/// Samples in the order of bytes of files.
fn little_endian(mut data: Vec<u8>, channels: &[SampleType], width: usize) -> Vec<u8> {
    if cfg!(target_endian = "big") {
        let mut rest = data.as_mut_slice();
        for kind in channels.iter().cycle() {
            if rest.is_empty() {
                break;
            }
            let (line, others) = rest.split_at_mut(kind.bytes_per_sample() * width);
            line.chunks_exact_mut(kind.bytes_per_sample()).for_each(<[u8]>::reverse);
            rest = others;
        }
    }
    data
}

/// Lines as PXR24 orders them before they are deflated (OpenEXR, `ImfPxr24Compressor`): each sample less its left neighbor, its bytes apart
/// from those of the others, the highest first; 32-bit floats rounded to 24 bits.
fn differences(data: &[u8], width: usize, channels: &[SampleType]) -> Vec<u8> {
    let mut ordered = Vec::with_capacity(data.len());
    let mut rest = data;
    for kind in channels.iter().cycle() {
        if rest.is_empty() {
            break;
        }
        let (line, others) = rest.split_at(kind.bytes_per_sample() * width);
        rest = others;
        let (samples, bytes): (Vec<u32>, usize) = match kind {
            SampleType::F16 => {
                let samples = line.as_chunks::<2>().0.iter();
                (samples.map(|bytes| u32::from(u16::from_ne_bytes(*bytes))).collect(), 2)
            }
            SampleType::U32 => {
                (line.as_chunks::<4>().0.iter().map(|bytes| u32::from_ne_bytes(*bytes)).collect(), 4)
            }
            SampleType::F32 => {
                let samples = line.as_chunks::<4>().0.iter();
                (samples.map(|bytes| rounded_to_24_bits(f32::from_ne_bytes(*bytes))).collect(), 3)
            }
        };
        let start = ordered.len();
        ordered.resize(start + bytes * width, 0);
        let mut before = 0_u32;
        for (col, sample) in samples.into_iter().enumerate() {
            let difference = sample.wrapping_sub(before).to_be_bytes();
            before = sample;
            for (place, byte) in difference[4 - bytes..].iter().enumerate() {
                ordered[start + place * width + col] = *byte;
            }
        }
    }
    ordered
}

/// The upper 24 bits of a float, rounded to the nearest; infinite ones and those that are no number stay such.
fn rounded_to_24_bits(value: f32) -> u32 {
    let bits = value.to_bits();
    let (sign, magnitude) = (bits & 0x8000_0000, bits & 0x7fff_ffff);
    let rounded = (magnitude + (magnitude & 0x80)) >> 8;
    let upper = if magnitude >= 0x7f80_0000 {
        let is_no_number = magnitude > 0x7f80_0000;
        let upper = magnitude >> 8;
        if is_no_number && upper == 0x7f_8000 { upper | 1 } else { upper }
    } else if rounded >= 0x7f_8000 {
        magnitude >> 8
    } else {
        rounded
    };
    (sign >> 8) | upper
}

/// Bytes as ZIP orders them (OpenEXR, `ImfZip`): every other one in the first half, and each less the one before it.
fn byte_differences(data: &[u8]) -> Vec<u8> {
    let halves = data.iter().step_by(2).chain(data.iter().skip(1).step_by(2));
    let mut before = None;
    let difference = |byte: &u8| {
        let found = before.map_or(*byte, |before: u8| byte.wrapping_sub(before).wrapping_add(128));
        before = Some(*byte);
        found
    };
    halves.map(difference).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floats_are_rounded_to_the_nearest_of_24_bits() {
        let back = |value: f32| f32::from_bits(rounded_to_24_bits(value) << 8);
        for value in [0.0, 1.0, -1.5, 1.0e-30, f32::MAX, f32::INFINITY, f32::NEG_INFINITY, f32::MIN_POSITIVE]
        {
            let rounded = back(value);
            assert!(
                rounded == value || ((rounded - value) / value).abs() <= 2f32.powi(-15),
                "{value} {rounded}"
            );
        }
        for value in [0.1_f32, 3.7e5, -2.9e-7] {
            assert!(((back(value) - value) / value).abs() <= 2f32.powi(-16), "{value}");
        }
        assert!(back(f32::NAN).is_nan() && back(f32::from_bits(0x7f80_0001)).is_nan());
    }
}
