//! Claims on work that several processes share.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use super::paths::parent_of;
use crate::FormatError;

/// A piece of work that one process holds: a locked file. The lock of a killed process is gone, and the work free again.
#[derive(Debug)]
pub struct Claim {
    path: PathBuf,
    /// Open as long as the claim is held.
    _lock: File,
}

impl Claim {
    /// Claims the work of a file, whose folder is made where it is missing; `None` while another process holds it.
    ///
    /// # Errors
    /// What the system reports, as of a file system without locks.
    pub fn take(path: &Path) -> Result<Option<Self>, FormatError> {
        let failed = |source| FormatError::io(path, "create", source);
        fs::create_dir_all(parent_of(path)).map_err(failed)?;
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Self { path: path.into(), _lock: file })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(source)) => Err(FormatError::io(path, "lock", source)),
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Whoever opened the file before finds the work done
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_held_by_one_and_free_when_it_lets_go() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("renders/a.lock");
        let held = Claim::take(&path).unwrap().unwrap();
        assert!(Claim::take(&path).unwrap().is_none());
        drop(held);
        assert!(!path.exists() && Claim::take(&path).unwrap().is_some());
        // What a killed process left is locked by nobody
        fs::write(&path, "").unwrap();
        assert!(Claim::take(&path).unwrap().is_some());
    }
}
