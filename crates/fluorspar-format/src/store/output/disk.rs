//! Room on disks, and what makes writing last.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::paths::existing_folder;
use crate::{Defect, FormatError};

/// Room that is left on the disk of a path, bytes, which need not exist; `None` where the system does not tell.
pub fn free_bytes(path: &Path) -> Option<u64> {
    free_in(&existing_folder(path))
}

#[cfg(unix)]
fn free_in(folder: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(folder).ok()?;
    // File systems without a size of their own tell of no blocks.
    (disk.f_blocks > 0).then(|| disk.f_bavail.saturating_mul(disk.f_frsize))
}

#[cfg(not(unix))]
fn free_in(_: &Path) -> Option<u64> {
    None
}

/// Refuses what does not fit on the disk of a path.
///
/// # Errors
/// [`Defect::NoRoom`], with both numbers. Where the system does not tell how much room there is, nothing is refused.
pub fn check_room(path: &Path, needed_bytes: u64) -> Result<(), FormatError> {
    match free_bytes(path) {
        Some(free_bytes) if free_bytes < needed_bytes => {
            Err(Defect::NoRoom { needed_bytes, free_bytes }.of(path))
        }
        _ => Ok(()),
    }
}

/// Waits until the content of a file is on the disk. Some kinds of disks know no such thing.
pub(super) fn sync(file: &File) -> io::Result<()> {
    match file.sync_all() {
        Err(error) if matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        done => done,
    }
}

/// Waits until the names in a folder are on the disk, where folders can be opened.
pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    match File::open(folder) {
        Ok(folder) => sync(&folder),
        // A folder may be written to without being readable; other systems open no folders.
        Err(_) => Ok(()),
    }
}

/// Waits until files below a folder, and their names, are on its disk: all at once where the system can, which is a hundred times faster.
///
/// # Errors
/// What the system reports.
pub fn sync_together(folder: &Path, files: &[PathBuf]) -> Result<(), FormatError> {
    let all = || -> io::Result<()> {
        #[cfg(target_os = "linux")]
        if rustix::fs::syncfs(File::open(folder)?).is_ok() {
            return Ok(());
        }
        files.iter().try_for_each(|file| {
            sync(&File::open(file)?)?;
            file.parent().map_or(Ok(()), sync_folder)
        })
    };
    if files.is_empty() { Ok(()) } else { all().map_err(|source| FormatError::io(folder, "write", source)) }
}

/// Exchanges two files or folders in one step, where the system can.
#[cfg(target_os = "linux")]
pub(super) fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

#[cfg(not(target_os = "linux"))]
pub(super) fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(ErrorKind::Unsupported.into())
}
