//! Packed raw frames as camera modules deliver them, with a JSON description next to them.

use std::io::Write;
use std::path::Path;

use super::described_frame::{Description, JudgedFrame, description, image_of};
use super::frame_judgement::StoredFrame;
use super::row_packing::{PackedRows, RawPacking};
use crate::store::file::{MAX_IMAGE_BYTES, check_image_size, read_file, write_sidecar};
use crate::store::output::write_atomically;
use crate::{FormatError, Provenance};
use fluorspar::image::SensorImage;

/// Writes a raw frame packed, and its description to `PATH.json`.
///
/// # Errors
/// A frame of more bits than the packing has, fields that contradict each other, a file that can't be written.
pub fn write_packed_raw(
    path: &Path,
    image: &SensorImage,
    packing: RawPacking,
    provenance: Option<&Provenance>,
) -> Result<(), FormatError> {
    let mut description = description(path, image, provenance)?;
    let bits = packing.bits();
    if image.bit_depth > bits {
        let what =
            format!("a frame of {} bits does not fit the {bits} bits of this packing", image.bit_depth);
        return Err(FormatError::unwritable(path, what, "Choose a packing of more bits, or write a .tiff"));
    }
    description.packing = Some(PackedRows { format: packing, stride_bytes: None });
    let mut bytes = Vec::with_capacity(packing.row_bytes(image.width) * image.height);
    for row in image.data.chunks_exact(image.width) {
        packing.pack(row, &mut bytes);
    }
    write_atomically(path, |writer| writer.write_all(&bytes))?;
    write_sidecar(path, &description)
}

/// Reads a packed frame by its description.
pub(crate) fn read_packed(
    path: &Path,
    description: Description,
    rows: PackedRows,
) -> Result<JudgedFrame, FormatError> {
    check_image_size(path, description.width, description.height, 2, MAX_IMAGE_BYTES)?;
    let (columns, lines) = (description.width as usize, description.height as usize);
    let least = rows.format.row_bytes(columns);
    let stride = stride(path, rows, columns)?;
    // The last row may lack its padding.
    let needed = (stride as u64) * (lines as u64 - 1) + least as u64;
    let bytes = read_file(path, needed.saturating_add(1 << 24))?;
    if (bytes.len() as u64) < needed {
        return Err(FormatError::malformed(
            path,
            format!("{lines} rows of {stride} bytes need {needed} bytes; the file has {}", bytes.len()),
            "Copy the file again, or correct width, height and packing in the description",
        ));
    }
    let mut data = Vec::with_capacity(columns * lines);
    for line in 0..lines {
        rows.format.unpack(&bytes[line * stride..line * stride + least], columns, &mut data);
    }
    let stored = StoredFrame { width: columns, height: lines, data, ..StoredFrame::default() };
    image_of(path, stored, &description)
}

/// Bytes from row to row.
fn stride(path: &Path, rows: PackedRows, columns: usize) -> Result<usize, FormatError> {
    let least = rows.format.row_bytes(columns);
    let stride = rows.stride_bytes.unwrap_or(least as u64);
    if stride < least as u64 || stride > 1 << 24 {
        return Err(FormatError::malformed(
            path,
            format!("rows of {columns} pixels take {least} bytes, but the description says {stride}"),
            "Correct packing.stride_bytes",
        ));
    }
    Ok(stride as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_packed_as_csi_2_has_them() {
        let mut bytes = Vec::new();
        RawPacking::Raw10.pack(&[0x3ff, 0x001, 0x2aa, 0x154], &mut bytes);
        // High eight bits of each; then low bits 3, 1, 2, 0 from the least significant on.
        assert_eq!(bytes, [0xff, 0x00, 0xaa, 0x55, 0b00_10_01_11]);
        let mut values = Vec::new();
        RawPacking::Raw10.unpack(&bytes, 4, &mut values);
        assert_eq!(values, [0x3ff, 0x001, 0x2aa, 0x154]);
        bytes.clear();
        RawPacking::Raw12.pack(&[0xabc, 0x123], &mut bytes);
        assert_eq!(bytes, [0xab, 0x12, 0x3c]);
        // A row that ends within a group.
        for packing in [RawPacking::Raw10, RawPacking::Raw12, RawPacking::Raw16] {
            let row: Vec<u16> = (0..7).map(|i| i * 77 + 5).collect();
            let (mut bytes, mut back) = (Vec::new(), Vec::new());
            packing.pack(&row, &mut bytes);
            assert_eq!(bytes.len(), packing.row_bytes(7));
            packing.unpack(&bytes, 7, &mut back);
            assert_eq!(back, row);
        }
    }
}
