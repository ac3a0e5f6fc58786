//! Raw files of cameras that are TIFFs but no DNGs: their first image is a small picture with a tone curve.

use std::path::Path;

use super::FormatError;
use super::tiff_directory::{Directory, TiffBytes};
use fluorspar::quote::excerpt;

/// Endings of raw files that are built like TIFFs.
const RAW_EXTENSIONS: [&str; 21] = [
    "3fr", "arw", "cr2", "dcr", "dcs", "erf", "fff", "gpr", "iiq", "k25", "kdc", "mef", "mos", "nef", "nrw",
    "orf", "pef", "rw2", "rwl", "sr2", "srw",
];
/// Photometric interpretation of a mosaic.
const CFA: u64 = 32_803;

/// Refuses a TIFF without a DNG version whose first image is not its raw frame.
///
/// # Errors
/// Such a file, with the camera that wrote it.
pub(super) fn refuse_camera_raw(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    let Some(tiff) = TiffBytes::new(bytes) else { return Ok(()) };
    let directories = tiff.directories();
    let Some((first, others)) = directories.split_first() else { return Ok(()) };
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let is_named = RAW_EXTENSIONS.contains(&ending.as_str());
    let has_mosaic = others.iter().any(|directory| directory.first(262) == Some(CFA));
    let camera = camera(first);
    let what = if is_named || bytes.get(8..10) == Some(b"CR") || has_mosaic {
        format!("this is a raw file of {}, but no DNG", camera.as_deref().unwrap_or("a camera"))
    } else if let Some([width, height]) = larger_image(first, others) {
        let [small_width, small_height] = size(first);
        let what = format!(
            "its first image, {small_width} x {small_height}, is a small picture of another one in the file, {width} x {height}"
        );
        match camera {
            Some(_) => what,
            None if is_reduced(first) => {
                let hint = "Save the large one as a file of its own";
                return Err(FormatError::unsupported(path, what, hint));
            }
            // Pages of different sizes, which are counted elsewhere
            None => return Ok(()),
        }
    } else {
        return Ok(());
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let hint = format!("Convert the raw file to DNG: dnglab convert {name} {stem}.dng");
    Err(FormatError::unsupported(path, what, hint))
}

fn size(directory: &Directory<'_>) -> [u64; 2] {
    [256, 257].map(|tag| directory.first(tag).unwrap_or(0))
}

/// Whether a directory holds a smaller form of another image (bit 0 of NewSubfileType).
fn is_reduced(directory: &Directory<'_>) -> bool {
    directory.first(254).is_some_and(|kind| kind & 1 == 1)
}

/// The size of the largest other image, where the first one is a small form of it.
fn larger_image(first: &Directory<'_>, others: &[Directory<'_>]) -> Option<[u64; 2]> {
    let pixels = |[width, height]: [u64; 2]| width.saturating_mul(height);
    let largest = others.iter().map(size).max_by_key(|side| pixels(*side))?;
    (is_reduced(first) || pixels(largest) > pixels(size(first))).then_some(largest)
}

/// Maker and model of a camera, where its file tells them.
fn camera(first: &Directory<'_>) -> Option<String> {
    let text = |tag: u16| {
        let bytes = first.data(tag).unwrap_or_default();
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(&bytes[..end]).trim().to_string()
    };
    let (make, model) = (text(271), text(272));
    // Many models begin with the maker's name.
    let maker = make.split_whitespace().next().unwrap_or_default().to_lowercase();
    match (make.is_empty(), model.is_empty()) {
        (true, true) => None,
        (_, true) => Some(excerpt(&make)),
        _ if model.to_lowercase().starts_with(&maker) => Some(excerpt(&model)),
        _ => Some(excerpt(&format!("{make} {model}"))),
    }
}
