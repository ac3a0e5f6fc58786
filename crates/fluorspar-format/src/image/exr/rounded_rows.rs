//! Rows of spectra that are stored as 24-bit values, the form of a run's component image.
//!
//! Captures with another filter or sensor read all of them, and most of their time went into the decoder for everything, which asks
//! for new memory at each of its steps. Here a thread unpacks all blocks in the same memory, and only what is wanted.

use std::cell::RefCell;
use std::path::Path;

use exr::block::chunk::{CompressedBlock, CompressedScanLineBlock};
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::Compression;
use libdeflater::Decompressor;

use super::read::{PackedBlock, damaged};
use crate::FormatError;

/// Bytes of a value.
const VALUE_BYTES: usize = 3;

/// What a thread needs again for each block.
struct Scratch {
    decompressor: Decompressor,
    bytes: Vec<u8>,
    lines: Vec<f32>,
}

thread_local! {
    static SCRATCH: RefCell<Option<Scratch>> = const { RefCell::new(None) };
}

/// Calls `visit` for each row of a block with `[band][col]`, where the block holds rows of 24-bit values as wide as the image; `false`
/// where it does not. `bands` tells the band of each channel, if it is one.
///
/// PXR24 of OpenEXR: of each line and channel the bytes of all values, highest first, each value less the one at its left, then
/// deflate.
pub(super) fn rows_of_24_bits(
    path: &Path,
    header: &Header,
    bands: &[Option<usize>],
    block: &PackedBlock<'_>,
    mut visit: impl FnMut(usize, &[f32]),
) -> Result<bool, FormatError> {
    let channels = &header.channels.list;
    let CompressedBlock::ScanLine(CompressedScanLineBlock { compressed_pixels_le: packed, .. }) =
        &block.chunk.compressed_block
    else {
        return Ok(false);
    };
    let is_rounded = header.compression == Compression::PXR24
        && channels.iter().all(|channel| channel.sample_type == SampleType::F32);
    if !is_rounded {
        return Ok(false);
    }
    let broken = |error: exr::error::Error| damaged(path, &error);
    let tile = header.get_block_data_indices(&block.chunk.compressed_block).map_err(broken)?;
    let place = header.get_absolute_block_pixel_coordinates(tile).map_err(broken)?;
    place.validate(Some(header.layer_size)).map_err(broken)?;
    let first_row = place.position.to_usize("rows").map_err(broken)?.y();
    let (width, rows) = (place.size.width(), place.size.height());
    // What deflate made no smaller is stored as it was, with 32 bits
    let values = width * rows * channels.len();
    if width == 0 || packed.len() == size_of::<f32>() * values {
        return Ok(false);
    }

    // Visitors may come here again on the same thread
    let scratch = SCRATCH.take();
    let Scratch { mut decompressor, mut bytes, mut lines } = scratch.unwrap_or_else(|| Scratch {
        decompressor: Decompressor::new(),
        bytes: Vec::new(),
        lines: Vec::new(),
    });
    bytes.resize(VALUE_BYTES * values, 0);
    lines.clear();
    lines.resize(bands.iter().flatten().count() * width, 0.0);
    let unpacked = decompressor.zlib_decompress(packed, &mut bytes);
    if !unpacked.is_ok_and(|length| length == bytes.len()) {
        let what = "not a valid OpenEXR file: compressed PXR24 data";
        return Err(FormatError::malformed(path, what, "Copy the file again"));
    }
    for (row, of_row) in bytes.chunks_exact(VALUE_BYTES * width * channels.len()).enumerate() {
        for (stored, band) in of_row.chunks_exact(VALUE_BYTES * width).zip(bands) {
            if let Some(band) = band {
                summed(stored, &mut lines[band * width..][..width]);
            }
        }
        visit(first_row + row, &lines);
    }
    SCRATCH.set(Some(Scratch { decompressor, bytes, lines }));
    Ok(true)
}

/// A line of values from its bytes, each value the sum of all differences up to it.
fn summed(stored: &[u8], line: &mut [f32]) {
    let (high, rest) = stored.split_at(line.len());
    let (middle, low) = rest.split_at(line.len());
    let mut bits = 0_u32;
    for (((value, high), middle), low) in line.iter_mut().zip(high).zip(middle).zip(low) {
        bits = bits.wrapping_add(u32::from_be_bytes([*high, *middle, *low, 0]));
        *value = f32::from_bits(bits);
    }
}
