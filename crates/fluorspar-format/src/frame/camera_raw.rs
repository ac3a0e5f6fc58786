//! Raw files of cameras that are no DNGs: of those that are TIFFs the first image is a small picture with a tone curve.

use std::path::Path;

use super::tiff_directory::{Directory, TiffBytes};
use super::tiff_image::{names, python_tiff};
use crate::FormatError;
use crate::npy_array::NPY_MAGIC;
use fluorspar::quote::excerpt;

/// Endings of raw files.
const RAW_EXTENSIONS: [&str; 26] = [
    "3fr", "arw", "cr2", "cr3", "crw", "dcr", "dcs", "erf", "fff", "gpr", "iiq", "k25", "kdc", "mef", "mos",
    "mrw", "nef", "nrw", "orf", "pef", "raf", "rw2", "rwl", "sr2", "srw", "x3f",
];
/// Beginnings of raw files that are no TIFFs.
const RAW_BEGINNINGS: [&[u8]; 8] =
    [b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"FUJIFILM", b"FOVb", b"\0MRM", b"\0\0\0\x18ftypcrx"];
/// Photometric interpretation of a mosaic.
const CFA: u64 = 32_803;

/// Refuses a raw file of a camera that is no DNG, and a TIFF whose first image is not its raw frame.
///
/// # Errors
/// Such a file, with the camera that wrote it.
pub(crate) fn refuse_camera_raw(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    let directories = TiffBytes::new(bytes).map(|tiff| tiff.directories()).unwrap_or_default();
    let (first, others) = (directories.first(), directories.get(1..).unwrap_or_default());
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let is_named = RAW_EXTENSIONS.contains(&ending.as_str())
        || RAW_BEGINNINGS.iter().any(|beginning| bytes.starts_with(beginning));
    let has_mosaic = others.iter().any(|directory| directory.first(262) == Some(CFA));
    let camera = first.and_then(camera);
    let what = if is_named || bytes.get(8..10) == Some(b"CR") || has_mosaic {
        format!("this is a raw file of {}, but no DNG", camera.as_deref().unwrap_or("a camera"))
    } else if let Some((first, [width, height])) = first.and_then(|f| Some((f, larger_image(f, others)?))) {
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
    let hint = format!("Convert the raw file to DNG: dnglab convert {}", names(path, ".dng"));
    Err(FormatError::unsupported(path, what, hint))
}

/// Why a file that is no DNG, TIFF or PNG is no frame, by its first bytes.
pub(crate) fn no_frame(path: &Path, start: &[u8]) -> FormatError {
    if let Err(error) = refuse_camera_raw(path, start) {
        return error;
    }
    let (what, hint): (&str, String) = if start.starts_with(b"\xff\xd8\xff") {
        let what = "this is a JPEG, whose numbers lie on a tone curve and are not kept exactly";
        (
            what,
            "Give the raw frame of the camera: a DNG, or its NEF, CR3, ARW made one (dnglab convert)".into(),
        )
    } else if start.starts_with(NPY_MAGIC) {
        ("this is a NumPy array", python_tiff(path, ["numpy", ", numpy"], "numpy.load(sys.argv[1])"))
    } else if start.starts_with(b"P5") || start.starts_with(b"P6") {
        let array = "n.imread(sys.argv[1])";
        ("this is a PGM or PPM", python_tiff(path, ["netpbmfile", ", netpbmfile as n"], array))
    } else {
        let hint = "Save its numbers as a TIFF or PNG of 16 bits, gray or linear RGB; of packed frames write a description with \
                    \"packing\" by hand: docs/file-formats.md";
        ("this is not a DNG, TIFF or PNG", hint.into())
    };
    FormatError::unsupported(path, what, hint)
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
