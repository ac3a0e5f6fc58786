//! Opening and reading files: the only place of this workspace where files of the user are opened.
//!
//! Whatever the system says of a file, no more than a fixed number of bytes is read. Files that are read more than once, or
//! at several places, must be plain files; all others may be pipes.

use std::fs::{self, File, FileType};
use std::io::{self, Read, Seek};
use std::path::Path;

use super::file::as_text;
use crate::FormatError;
use fluorspar::digest::sha256_of;

/// How a file begins that Git LFS leaves in place of another one, and how long such files are at most.
const LFS_START: &[u8] = b"version https://git-lfs.github.com/spec/";
const LFS_BYTES: u64 = 1024;
/// Most bytes read from a pipe.
const MAX_PIPE_BYTES: u64 = 256 << 20;

/// The content of a plain file or pipe.
///
/// # Errors
/// No such file, no permission, a folder or device, more than `limit` bytes (256 MiB from a pipe), no memory.
pub fn read_bounded(path: &Path, limit: u64) -> Result<Vec<u8>, FormatError> {
    let failed = |source| FormatError::io(path, "read", source);
    let (file, length) = open(path)?;
    let limit = if length.is_some() { limit } else { limit.min(MAX_PIPE_BYTES) };
    let too_large = |size: String| FormatError::too_large(path, size, format!("{limit} bytes"));
    let length = length.unwrap_or(0);
    if length > limit {
        return Err(too_large(format!("the file has {length} bytes")));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length as usize).map_err(|_| failed(io::ErrorKind::OutOfMemory.into()))?;
    file.take(limit + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limit {
        return Err(too_large("the file has no end".into()));
    }
    Ok(bytes)
}

/// The content of a plain file or pipe as UTF-8 text, without byte order mark.
///
/// # Errors
/// As [`read_bounded`]; other text, with its line.
pub fn read_text_bounded(path: &Path, limit: u64) -> Result<String, FormatError> {
    let bytes = read_bounded(path, limit)?;
    Ok(as_text(path, &bytes)?.to_string())
}

/// The first bytes of a plain file or pipe, at most `limit`.
///
/// # Errors
/// No such file, no permission, a folder or device.
pub fn read_start(path: &Path, limit: u64) -> Result<Vec<u8>, FormatError> {
    let (file, _) = open(path)?;
    let mut bytes = Vec::new();
    file.take(limit).read_to_end(&mut bytes).map_err(|source| FormatError::io(path, "read", source))?;
    Ok(bytes)
}

/// SHA-256 of a plain file, 64 lower-case hexadecimal digits; the file is never in memory as a whole.
///
/// # Errors
/// No such file, no permission, a folder, pipe or device; more than `limit` bytes.
pub fn digest_bounded(path: &Path, limit: u64) -> Result<String, FormatError> {
    let (file, length) = open_plain(path)?;
    let mut rest = file.take(limit + 1);
    let digest = if length > limit { None } else { Some(sha256_of(&mut rest)) };
    match digest {
        Some(digest) if rest.limit() > 0 => digest.map_err(|source| FormatError::io(path, "read", source)),
        _ => Err(FormatError::too_large(
            path,
            format!("the file has {length} bytes or more"),
            format!("{limit} bytes"),
        )),
    }
}

/// Opens a file that is read at several places or several times, and its length, bytes.
///
/// # Errors
/// No such file, no permission, a folder, device or pipe.
pub(crate) fn open_plain(path: &Path) -> Result<(File, u64), FormatError> {
    match open(path)? {
        (file, Some(length)) => Ok((file, length)),
        (_, None) => Err(not_a_file(path, "a pipe", "give a file on a disk, as it is read more than once")),
    }
}

/// Opens a plain file, with its length, or a pipe.
fn open(path: &Path) -> Result<(File, Option<u64>), FormatError> {
    let failed = |source| FormatError::io(path, "read", source);
    // What can't be read to its end is not opened: opening alone may wait or do something.
    check_kind(path, fs::metadata(path).map_err(failed)?.file_type())?;
    let mut file = File::open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    check_kind(path, metadata.file_type())?;
    let length = metadata.is_file().then_some(metadata.len());
    if length.is_some_and(|length| (LFS_START.len() as u64..LFS_BYTES).contains(&length)) {
        let mut start = Vec::new();
        (&file).take(LFS_START.len() as u64).read_to_end(&mut start).map_err(failed)?;
        if start == LFS_START {
            let (what, hint) = ("a Git LFS pointer, not the file itself", "fetch it with `git lfs pull`");
            return Err(not_a_file(path, what, hint));
        }
        file.rewind().map_err(failed)?;
    }
    Ok((file, length))
}

fn check_kind(path: &Path, kind: FileType) -> Result<(), FormatError> {
    if kind.is_dir() {
        return Err(not_a_file(path, "a folder", "give a file in it"));
    }
    if is_device(kind) {
        return Err(not_a_file(path, "a device", "give a file"));
    }
    Ok(())
}

#[cfg(unix)]
fn is_device(kind: FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_char_device() || kind.is_block_device()
}

#[cfg(not(unix))]
fn is_device(_: FileType) -> bool {
    false
}

fn not_a_file(path: &Path, what: &'static str, hint: &'static str) -> FormatError {
    FormatError::refused(path, format!("this is {what}"), hint)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message<T: std::fmt::Debug>(result: Result<T, FormatError>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn a_file_is_read_up_to_its_limit_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f");
        fs::write(&path, "abc").unwrap();
        assert_eq!(read_bounded(&path, 3).unwrap(), b"abc");
        assert_eq!(read_start(&path, 2).unwrap(), b"ab");
        assert_eq!(digest_bounded(&path, 3).unwrap(), fluorspar::digest::sha256_hex(["abc"]));
        for said in [message(read_bounded(&path, 2)), message(digest_bounded(&path, 2))] {
            assert!(said.contains("the file has 3 bytes") && said.contains("the limit is 2 bytes"), "{said}");
        }
        let said = message(read_text_bounded(&folder.path().join("none"), 3));
        assert!(said.ends_with("Check the path and its folder"), "{said}");
        assert!(message(read_bounded(folder.path(), 3)).ends_with(": this is a folder; give a file in it"));
    }

    #[test]
    fn a_pointer_of_git_lfs_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lens.dat");
        let digest = "0".repeat(64);
        let pointer =
            format!("version https://git-lfs.github.com/spec/v1\noid sha256:{digest}\nsize 12345\n");
        fs::write(&path, &pointer).unwrap();
        let expected =
            "lens.dat: this is a Git LFS pointer, not the file itself; fetch it with `git lfs pull`";
        for said in [
            message(read_bounded(&path, 1 << 20)),
            message(digest_bounded(&path, 1 << 20)),
            message(open_plain(&path)),
            crate::read_lens(&path).unwrap_err().to_string(),
        ] {
            assert!(said.ends_with(expected), "{said}");
        }
        fs::write(&path, pointer.replace("version", "# version")).unwrap();
        assert_eq!(read_bounded(&path, 1 << 20).unwrap().len(), pointer.len() + 2);
    }

    #[cfg(unix)]
    #[test]
    fn devices_are_not_read_and_pipes_end_at_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("link.csv");
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        assert!(message(read_bounded(&link, 1 << 40)).ends_with("link.csv: this is a device; give a file"));
        assert!(digest_bounded(&link, 1 << 40).is_err() && read_start(&link, 1).is_err());
        // Files of the system tell no length.
        let status = Path::new("/proc/self/status");
        if status.exists() {
            assert!(!read_bounded(status, 1 << 20).unwrap().is_empty());
            assert!(message(read_bounded(status, 10)).contains("the limit is 10 bytes"));
            assert!(digest_bounded(status, 10).is_err());
        }
        let (reader, mut writer) = io::pipe().unwrap();
        let path = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&reader));
        if Path::new(&path).exists() {
            assert!(message(digest_bounded(Path::new(&path), 3)).contains("this is a pipe"));
            io::Write::write_all(&mut writer, b"abcd").unwrap();
            drop(writer);
            assert!(message(read_bounded(Path::new(&path), 3)).contains("the file has no end"));
        }
    }
}
