//! Limits of what is read, and descriptions beside data files.

use std::cell::Cell;
use std::io::Write;
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Once;

use super::input::read_bounded;
use super::output::write_atomically;
use crate::{FileFormat, FormatError};

/// Most bytes an image may take in memory, where nothing else bounds it.
pub(crate) const MAX_IMAGE_BYTES: u64 = 1 << 33;
/// Longest side of an image, pixels.
pub(crate) const MAX_SIDE: u64 = 100_000;
/// Pixel bytes per byte of file up to which the size of a file on disk vouches for a larger image: images of this program
/// shrink to between a half and a twentieth.
const USUAL_PACKING: u64 = 64;
/// Most pixel bytes per byte of file: twice what deflate reaches on zeros (1032).
const MAX_PACKING: u64 = 2000;
/// Largest table or text file, bytes.
pub(crate) const MAX_TEXT_BYTES: u64 = 256 << 20;
/// Largest mesh file, bytes.
pub(crate) const MAX_MESH_BYTES: u64 = 4 << 30;

/// The whole file, refused above `limit` bytes and when it is empty.
pub(crate) fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, FormatError> {
    let bytes = read_bounded(path, limit)?;
    check_not_empty(path, bytes.len() as u64)?;
    Ok(bytes)
}

/// Refuses a file without a byte.
pub(crate) fn check_not_empty(path: &Path, length: u64) -> Result<(), FormatError> {
    if length > 0 {
        return Ok(());
    }
    Err(FormatError::malformed(path, "the file is empty", "Copy the file again"))
}

/// Text as UTF-8, without byte order mark.
pub(crate) fn as_text<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, FormatError> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    if bytes.starts_with(b"\xFF\xFE") || bytes.starts_with(b"\xFE\xFF") {
        return Err(FormatError::malformed(path, "the text is UTF-16", "Save it as UTF-8"));
    }
    std::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        FormatError::at_line(path, line as u64, "this is not UTF-8 text", "Save the file as plain UTF-8 text")
    })
}

/// Most bytes that an image from a file of `length` bytes may take in memory: a file that is large itself may hold more
/// than [`MAX_IMAGE_BYTES`], as large renders do.
pub(crate) fn most_image_bytes(length: u64) -> u64 {
    MAX_IMAGE_BYTES.max(length.saturating_mul(USUAL_PACKING))
}

/// Refuses images that no camera takes, before anything is allocated for them.
pub(crate) fn check_image_size(
    path: &Path,
    width: u64,
    height: u64,
    bytes_per_pixel: u64,
    most_bytes: u64,
) -> Result<(), FormatError> {
    if width == 0 || height == 0 {
        return Err(FormatError::malformed(
            path,
            format!("the image has {height} rows and {width} columns"),
            "An image needs at least one pixel",
        ));
    }
    if width > MAX_SIDE || height > MAX_SIDE {
        return Err(FormatError::too_large(
            path,
            format!("the image claims {height} rows and {width} columns"),
            format!("{MAX_SIDE} a side"),
        ));
    }
    let bytes = u128::from(width) * u128::from(height) * u128::from(bytes_per_pixel);
    if bytes > u128::from(most_bytes) {
        return Err(FormatError::too_large(
            path,
            format!("the image claims {height} rows and {width} columns of {bytes_per_pixel} bytes"),
            format!("{most_bytes} bytes"),
        ));
    }
    Ok(())
}

/// Refuses more pixels than a file of `length` bytes can hold, however well they are packed.
pub(crate) fn check_packing(path: &Path, pixel_bytes: u64, length: u64) -> Result<(), FormatError> {
    if pixel_bytes / MAX_PACKING <= length {
        return Ok(());
    }
    Err(FormatError::malformed(
        path,
        format!("the header claims {pixel_bytes} bytes of pixels in a file of {length} bytes"),
        "Copy the file again",
    ))
}

/// Turns a panic of a third-party decoder, which only damaged files provoke, into an error, and prints nothing about it.
pub(crate) fn guarded<T>(
    path: &Path,
    format: &str,
    decode: impl FnOnce() -> Result<T, FormatError>,
) -> Result<T, FormatError> {
    silence_guarded_panics();
    let outer = GUARDED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(decode));
    GUARDED.set(outer);
    result.unwrap_or_else(|_| {
        Err(FormatError::malformed(
            path,
            format!("the {format} data are damaged so badly that the decoder gave up"),
            "Copy or export the file again",
        ))
    })
}

thread_local! {
    /// Whether this thread is in a decoder whose panics are caught.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Lets the panic hook pass over panics that [`guarded`] catches.
fn silence_guarded_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let usual = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !GUARDED.get() {
                usual(info);
            }
        }));
    });
}

/// The sidecar of a data file: `NAME.json` next to `NAME`.
pub(crate) fn sidecar_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(".json");
    name.into()
}

/// Reads a JSON sidecar of a format.
pub(crate) fn read_sidecar<T: serde::de::DeserializeOwned>(
    data_path: &Path,
    format: &'static FileFormat,
) -> Result<T, FormatError> {
    let path = sidecar_path(data_path);
    if !path.exists() {
        return Err(FormatError::malformed(
            data_path,
            format!("its description {} is missing", path.display()),
            describes(format),
        ));
    }
    let bytes = read_file(&path, MAX_TEXT_BYTES)?;
    format.check_json(&path, &bytes)?;
    serde_json::from_slice(&bytes).map_err(|source| FormatError::json(&path, source))
}

/// How a missing description comes back.
fn describes(format: &FileFormat) -> &'static str {
    if *format == FileFormat::RAW_FRAME {
        "Keep the two files together. For a frame from a camera, `fluorspar describe FRAME` writes the description"
    } else {
        "Keep the two files together; without it neither units nor exposure are known"
    }
}

/// Writes a JSON sidecar.
pub(crate) fn write_sidecar(data_path: &Path, content: &impl serde::Serialize) -> Result<(), FormatError> {
    write_atomically(&sidecar_path(data_path), |writer| {
        serde_json::to_writer_pretty(&mut *writer, content)?;
        writer.write_all(b"\n")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test starts itself, since a panic hook is that of a whole process.
    #[test]
    fn panics_of_decoders_are_errors_and_say_nothing() {
        const WITHIN: &str = "FLUORSPAR_TEST_GUARDED";
        if std::env::var_os(WITHIN).is_some() {
            let damaged = || guarded::<()>(Path::new("a.mat"), "HDF5", || panic!("a decoder gave up"));
            let error = damaged().unwrap_err().to_string();
            assert!(error.starts_with("a.mat: the HDF5 data are damaged so badly"), "{error}");
            // On another thread, and twice.
            std::thread::spawn(move || damaged().unwrap_err()).join().unwrap();
            return;
        }
        let said = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "file::tests::panics_of_decoders_are_errors_and_say_nothing", "--nocapture"])
            .env(WITHIN, "1")
            .output()
            .unwrap();
        assert!(said.status.success());
        assert_eq!(String::from_utf8(said.stderr).unwrap(), "");
    }

    #[test]
    fn a_large_file_may_hold_a_large_image_and_a_small_one_may_not() {
        let path = Path::new("x.exr");
        let (width, height, bytes_per_pixel) = (8192, 6144, 4 * 81 * 14);
        let bytes = width * height * bytes_per_pixel;
        assert!(bytes > MAX_IMAGE_BYTES);
        let check = |length| check_image_size(path, width, height, bytes_per_pixel, most_image_bytes(length));
        assert!(check(bytes).is_ok() && check(bytes / 20).is_ok());
        assert!(check(1 << 20).is_err() && check_packing(path, bytes, 1 << 20).is_err());
        assert_eq!(most_image_bytes(u64::MAX), u64::MAX);
    }
}
