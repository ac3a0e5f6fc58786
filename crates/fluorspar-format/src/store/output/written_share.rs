//! How much of a large file is written already, for those who wait for it.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

fn shares() -> MutexGuard<'static, BTreeMap<PathBuf, f64>> {
    static SHARES: Mutex<BTreeMap<PathBuf, f64>> = Mutex::new(BTreeMap::new());
    // All of it is whole after each of its changes.
    SHARES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Share, 0 to 1, of the values of a file that this process has written so far. `None` of files that it is not writing, and of kinds
/// that do not tell. The file is known by its name alone; of several of one name the least share counts.
pub fn written_share(name: &OsStr) -> Option<f64> {
    let of_name = |(path, share): (&PathBuf, &f64)| (path.file_name() == Some(name)).then_some(*share);
    shares().iter().filter_map(of_name).min_by(f64::total_cmp)
}

/// A file whose share is told until this goes out of scope.
pub(crate) struct WrittenShare(PathBuf);

impl WrittenShare {
    pub(crate) fn begin(path: &Path) -> Self {
        shares().insert(path.to_path_buf(), 0.0);
        Self(path.to_path_buf())
    }

    pub(crate) fn set(&self, share: f64) {
        shares().insert(self.0.clone(), share.clamp(0.0, 1.0));
    }
}

impl Drop for WrittenShare {
    fn drop(&mut self) {
        shares().remove(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_known_while_its_file_is_written() {
        let name = OsStr::new("known-while-written.exr");
        assert_eq!(written_share(name), None);
        let of_a = WrittenShare::begin(&Path::new("a").join(name));
        of_a.set(0.75);
        assert_eq!(written_share(name), Some(0.75));
        let of_b = WrittenShare::begin(&Path::new("b").join(name));
        of_b.set(0.25);
        assert_eq!(written_share(name), Some(0.25));
        drop(of_b);
        assert_eq!(written_share(name), Some(0.75));
        drop(of_a);
        assert_eq!(written_share(name), None);
    }
}
