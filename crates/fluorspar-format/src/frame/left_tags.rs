//! What a picture's file tells beside its pixels: names of tags and chunks, not their values.

use std::path::Path;

use super::tiff_directory::TiffBytes;
use crate::FormatError;
use crate::store::file::{MAX_IMAGE_BYTES, read_file};

/// A tag of a TIFF, with the directories of EXIF and places, or a chunk of a PNG.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LeftTags {
    /// Number of the tag of a TIFF.
    pub number: Option<u16>,
    /// Its name for a list.
    pub name: String,
}

/// Chunks without which a PNG has no pixels.
const CRITICAL: [&[u8; 4]; 4] = [b"IHDR", b"PLTE", b"IDAT", b"IEND"];

/// The tags or chunks of a picture, each once; nothing of other files.
///
/// # Errors
/// A file that can't be read.
pub fn left_tags(path: &Path) -> Result<Vec<LeftTags>, FormatError> {
    let bytes = read_file(path, MAX_IMAGE_BYTES)?;
    let mut found = if bytes.starts_with(b"\x89PNG") { png_chunks(&bytes) } else { tiff_tags(&bytes) };
    found.sort();
    found.dedup();
    Ok(found)
}

fn png_chunks(bytes: &[u8]) -> Vec<LeftTags> {
    let (mut at, mut found) = (8usize, Vec::new());
    while let (Some(length), Some(kind)) = (bytes.get(at..at + 4), bytes.get(at + 4..at + 8)) {
        if !CRITICAL.iter().any(|critical| *critical == kind) {
            found.push(LeftTags { number: None, name: format!("PNG {}", String::from_utf8_lossy(kind)) });
        }
        let length = length.iter().fold(0usize, |sum, byte| 256 * sum + usize::from(*byte));
        let Some(next) = at.checked_add(12).and_then(|next| next.checked_add(length)) else { break };
        at = next;
    }
    found
}

fn tiff_tags(bytes: &[u8]) -> Vec<LeftTags> {
    let Some(tiff) = TiffBytes::new(bytes) else { return Vec::new() };
    let named = |tag: u16| LeftTags { number: Some(tag), name: format!("tag {tag}") };
    let mut found = Vec::new();
    for directory in tiff.directories() {
        found.extend(directory.tags().map(named));
        // EXIF, places and interoperability have directories of their own
        for pointer in [34_665, 34_853, 40_965] {
            let inner = directory.first(pointer).and_then(|offset| tiff.directory(offset));
            found.extend(inner.iter().flat_map(|inner| inner.tags()).map(named));
        }
    }
    found
}
