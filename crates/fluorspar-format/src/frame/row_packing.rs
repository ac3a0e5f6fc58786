//! How camera modules pack pixels into bytes (MIPI CSI-2).
//!
//! RAW10: four pixels in five bytes, the eight high bits of each, then the low bits of all, the first pixel lowest. RAW12: two
//! pixels in three bytes likewise. Rows may be padded to a stride.

use serde::{Deserialize, Serialize};

/// How pixels are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RawPacking {
    /// MIPI RAW10.
    Raw10,
    /// MIPI RAW12.
    Raw12,
    /// Little-endian 16-bit numbers, as unpacked by the driver.
    Raw16,
}

/// How rows follow each other in a packed file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PackedRows {
    /// Packing of the pixels.
    pub(crate) format: RawPacking,
    /// Bytes from the start of a row to that of the next; by default rows follow each other without a gap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) stride_bytes: Option<u64>,
}

impl RawPacking {
    /// Bits of a pixel.
    pub fn bits(self) -> u8 {
        match self {
            Self::Raw10 => 10,
            Self::Raw12 => 12,
            Self::Raw16 => 16,
        }
    }

    /// Pixels and bytes of a group.
    fn group(self) -> (usize, usize) {
        match self {
            Self::Raw10 => (4, 5),
            Self::Raw12 => (2, 3),
            Self::Raw16 => (1, 2),
        }
    }

    /// Bytes of a row without padding; a broken group at its end counts as a whole one.
    pub fn row_bytes(self, columns: usize) -> usize {
        let (pixels, bytes) = self.group();
        columns.div_ceil(pixels) * bytes
    }

    pub(super) fn unpack(self, row: &[u8], columns: usize, out: &mut Vec<u16>) {
        let (pixels, bytes) = self.group();
        let end = out.len() + columns;
        for group in row.chunks_exact(bytes) {
            match self {
                Self::Raw16 => out.push(u16::from_le_bytes([group[0], group[1]])),
                Self::Raw10 | Self::Raw12 => {
                    let low = u16::from(group[bytes - 1]);
                    let bits = if self == Self::Raw10 { 2 } else { 4 };
                    for (index, &high) in group[..pixels].iter().enumerate() {
                        let low = (low >> (bits * index)) & ((1 << bits) - 1);
                        out.push(u16::from(high) << bits | low);
                    }
                }
            }
        }
        out.truncate(end);
    }

    pub(super) fn pack(self, row: &[u16], out: &mut Vec<u8>) {
        let (pixels, _) = self.group();
        for group in row.chunks(pixels) {
            match self {
                Self::Raw16 => out.extend(group[0].to_le_bytes()),
                Self::Raw10 | Self::Raw12 => {
                    let bits = if self == Self::Raw10 { 2 } else { 4 };
                    let at = |index: usize| group.get(index).copied().unwrap_or(0);
                    out.extend((0..pixels).map(|index| (at(index) >> bits) as u8));
                    let low = |index: usize| (at(index) & ((1 << bits) - 1)) << (bits * index);
                    out.push((0..pixels).map(low).sum::<u16>() as u8);
                }
            }
        }
    }
}
