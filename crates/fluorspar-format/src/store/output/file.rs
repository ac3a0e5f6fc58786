//! One file: written beside its place, moved there when it is complete.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::disk::{sync, sync_folder};
use super::folder::remove_whole;
use super::paths::{behind_link, parent_of, without_links};
use crate::FormatError;

/// Writes a file completely or not at all.
///
/// `write` fills a temporary file next to `path`, which is renamed into place when all went well and it is on the disk; of a
/// link the file behind it is replaced. On an error, or if `write` panics, the temporary file is removed and whatever stood at
/// `path` before is untouched. A file of an [`super::OutputSet`] waits for the others of it. A process that is ended calls
/// [`remove_unfinished_files`]; what one that was killed has left in the folder is removed by the next that writes there.
///
/// # Errors
/// Whatever the system or `write` reports.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), FormatError> {
    write_complete(path, true, write)
}

/// As [`write_atomically`], but sure to be on the disk only after [`super::sync_together`].
///
/// # Errors
/// Whatever the system or `write` reports.
pub fn write_unsynced(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), FormatError> {
    write_complete(path, false, write)
}

fn write_complete(
    path: &Path,
    is_synced: bool,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), FormatError> {
    if path.file_name().is_none() {
        return Err(FormatError::unwritable(path, "the path names no file", "Add a file name"));
    }
    let failed = |action| move |source| FormatError::io(path, action, source);
    let target = behind_link(path).map_err(failed("create"))?;
    let (partial, file) = PartialFile::beside(&target).map_err(failed("create"))?;
    let mut writer = BufWriter::with_capacity(1 << 18, file);
    write(&mut writer).and_then(|()| writer.flush()).map_err(failed("write"))?;
    let file = writer.into_inner().map_err(|error| failed("write")(error.into_error()))?;
    // The files of a folder in work are brought to the disk together, when it is complete.
    let in_folder = lock_unfinished().folders.iter().any(|(folder, _)| target.starts_with(folder));
    let is_synced = is_synced && !in_folder;
    if is_synced {
        sync(&file).map_err(failed("write"))?;
    }
    let Some(partial) = leave_to_set(&target, partial, file) else { return Ok(()) };
    fs::rename(&partial.0, &target).map_err(failed("rename the finished file to"))?;
    if is_synced { sync_folder(parent_of(&target)).map_err(failed("write")) } else { Ok(()) }
}

/// Files that are being written, under the names that they bear until they are complete.
pub fn unfinished_files() -> Vec<PathBuf> {
    lock_unfinished().files.iter().cloned().collect()
}

/// Removes the files and folders that are being written, and lets no thread begin another. To be called once, when the
/// process is about to end while others write.
pub fn remove_unfinished_files() {
    let unfinished = lock_unfinished();
    for path in &unfinished.files {
        // There is nobody left to tell.
        let _ = fs::remove_file(path);
    }
    for (folder, around) in &unfinished.folders {
        remove_whole(folder);
        for folder in around {
            // Others may have put something there.
            let _ = fs::remove_dir(folder);
        }
    }
    // Whoever wants to begin a file waits for the end of the process.
    std::mem::forget(unfinished);
}

/// What this process is writing.
#[derive(Default)]
pub(super) struct Unfinished {
    /// Temporary files.
    files: BTreeSet<PathBuf>,
    /// Folders in which those of dead processes have been removed.
    cleared: BTreeSet<PathBuf>,
    /// Files of open sets by their places, once they are complete.
    pub(super) waiting: BTreeMap<PathBuf, Option<Complete>>,
    /// Folders in work, and those around each that were made for it, the innermost first.
    pub(super) folders: Vec<(PathBuf, Vec<PathBuf>)>,
}

/// A complete file that has not been moved to its place. It is open, since its lock tells that this process is alive.
pub(super) type Complete = (PartialFile, File);

pub(super) fn lock_unfinished() -> MutexGuard<'static, Unfinished> {
    static UNFINISHED: Mutex<Unfinished> = Mutex::new(Unfinished {
        files: BTreeSet::new(),
        cleared: BTreeSet::new(),
        waiting: BTreeMap::new(),
        folders: Vec::new(),
    });
    // All of it is whole after each of its changes.
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Gives a complete file to the set that waits for it; back if there is none.
fn leave_to_set(target: &Path, partial: PartialFile, file: File) -> Option<PartialFile> {
    let mut unfinished = lock_unfinished();
    if unfinished.waiting.is_empty() {
        return Some(partial);
    }
    let place = without_links(target).ok().and_then(|real| unfinished.waiting.get_mut(&real));
    let Some(place) = place else { return Some(partial) };
    let earlier = place.replace((partial, file));
    drop(unfinished);
    // An earlier one removes itself, which takes the lock.
    drop(earlier);
    None
}

/// A temporary file that is removed when it goes out of scope; after a rename there is nothing left to remove.
pub(super) struct PartialFile(pub(super) PathBuf);

const PARTIAL_START: &str = ".fluorspar-";
const PARTIAL_END: &str = ".partial";

impl PartialFile {
    /// A new, locked file in the folder of `path`. The lock goes with the process, and tells others that it is alive.
    pub(super) fn beside(path: &Path) -> io::Result<(Self, File)> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let mut unfinished = lock_unfinished();
        let folder = parent_of(path);
        if unfinished.cleared.insert(folder.to_path_buf()) {
            remove_stale(folder);
        }
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let partial =
                path.with_file_name(format!("{PARTIAL_START}{}-{number}{PARTIAL_END}", process::id()));
            let file = match OpenOptions::new().read(true).write(true).create_new(true).open(&partial) {
                // Another process of the same number, on another machine.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                file => file?,
            };
            // Where files can't be locked, none is ever found to be stale.
            let _ = file.lock();
            // Another process may have taken it for stale before the lock was there.
            if partial.exists() {
                unfinished.files.insert(partial.clone());
                return Ok((Self(partial), file));
            }
        }
    }
}

impl Drop for PartialFile {
    fn drop(&mut self) {
        let mut unfinished = lock_unfinished();
        let _ = fs::remove_file(&self.0);
        unfinished.files.remove(&self.0);
    }
}

/// Removes what killed processes have left in a folder: temporary files that no one holds locked.
fn remove_stale(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let ours = name.to_str().is_some_and(|n| n.starts_with(PARTIAL_START) && n.ends_with(PARTIAL_END));
        if !ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        let path = entry.path();
        if File::options().write(true).open(&path).is_ok_and(|file| file.try_lock().is_ok()) {
            // One that can't be removed harms no one.
            let _ = fs::remove_file(&path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_dead_left_is_removed_and_what_the_living_write_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [".fluorspar-1-0.partial", ".fluorspar-2-0.partial", "notes.partial", ".fluorspar.toml"] {
            fs::write(at(name), "x").unwrap();
        }
        let alive = File::options().write(true).open(at(".fluorspar-2-0.partial")).unwrap();
        alive.lock().unwrap();
        write_atomically(&at("a.txt"), |file| file.write_all(b"done")).unwrap();
        let names = || {
            let mut names: Vec<_> =
                fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
            names.sort();
            names
        };
        assert_eq!(names(), [".fluorspar-2-0.partial", ".fluorspar.toml", "a.txt", "notes.partial"]);
        // The file in work is known until it is done, whatever comes of it.
        let known = || lock_unfinished().files.iter().filter(|file| file.starts_with(folder.path())).count();
        let failed = write_atomically(&at("b.txt"), |_| {
            assert_eq!(known(), 1);
            assert!(unfinished_files().iter().any(|file| file.starts_with(folder.path())));
            Err(io::Error::other("no"))
        });
        assert!(failed.is_err() && known() == 0 && names().len() == 4);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_and_what_it_leads_to_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("far")).unwrap();
        for text in ["one", "two"] {
            // First a link to nothing.
            let _ = std::os::unix::fs::symlink("far/away.txt", at("near.txt"));
            write_atomically(&at("near.txt"), |file| file.write_all(text.as_bytes())).unwrap();
            assert!(fs::symlink_metadata(at("near.txt")).unwrap().is_symlink());
            assert_eq!(fs::read_to_string(at("far/away.txt")).unwrap(), text);
        }
    }
}
