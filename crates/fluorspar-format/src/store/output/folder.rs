//! A folder for results that appears complete or not at all, and never takes anything of the user's with it.
//!
//! A folder that this program wrote holds a list of its files with their lengths and digests. Only such a folder is
//! replaced, only while everything in it is in that list and unchanged, and only the files of the list are deleted.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::disk::{check_room, exchange, sync, sync_folder};
use super::file::{lock_unfinished, write_atomically};
use super::paths::without_links;
use crate::store::input::{digest_bounded, read_text_bounded};
use crate::{FileFormat, FormatError};

/// File that lists what this program wrote into a folder.
const LIST: &str = "fluorspar-folder.json";
/// Files up to this length are texts that people edit; their content is compared, too.
const DIGEST_UP_TO_BYTES: u64 = 1 << 20;
/// Largest list of a folder, bytes.
const LARGEST_LIST_BYTES: u64 = 256 << 20;

/// The list of files.
#[derive(Debug, Serialize, Deserialize)]
struct FolderList {
    format: u32,
    version: String,
    /// By path below the folder, with `/` between names.
    files: BTreeMap<String, FileMark>,
}

/// Length and digest of a file when it was written.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct FileMark {
    bytes: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sha256: Option<String>,
}

/// Writes a folder beside its final place and moves it there when it is complete. Earlier results in the same
/// place are replaced; any other folder that is not empty is refused.
#[derive(Debug)]
pub struct OutputFolder {
    /// The place as the user named it.
    shown: PathBuf,
    /// The same, absolute, without links and `..`.
    target: PathBuf,
    partial: PathBuf,
    /// Held locked while this process lives, where folders can be locked: what no one holds is left over.
    lock: Option<File>,
    /// Folders around it that were made for it, the innermost first.
    around: Vec<PathBuf>,
    done: bool,
}

impl OutputFolder {
    /// Checks the place and prepares the partial folder. `inputs` are files that the command reads: a folder that
    /// holds one of them, or the folder of work, is refused. `bytes` is the room that the results take at most.
    ///
    /// # Errors
    /// A place that holds what this program did not write, that is read, or that can't be written; a disk without room.
    pub fn prepare(shown: &Path, inputs: &[PathBuf], bytes: u64) -> Result<Self, FormatError> {
        let refuse = |why: String| Err(FormatError::refused(shown, why, "choose another with --out"));
        let target = match without_links(shown) {
            Ok(target) => target,
            Err(error) => return refuse(format!("cannot access this path ({error})")),
        };
        if target.is_file() {
            return refuse("this is a file".into());
        }
        let here = std::env::current_dir().and_then(|here| here.canonicalize());
        if here.is_ok_and(|here| here.starts_with(&target)) {
            return refuse("results would replace the folder you are in".into());
        }
        for input in inputs {
            if without_links(input).is_ok_and(|input| input.starts_with(&target)) {
                return refuse(format!(
                    "results would replace this folder, which holds {}, a file that is read here",
                    input.display()
                ));
            }
        }
        if let Some(foreign) = foreign_file(&target) {
            return refuse(foreign);
        }
        let (Some(parent), Some(name)) = (target.parent(), target.file_name()) else {
            return refuse("not a result folder".into());
        };
        let name = name.to_string_lossy();
        for left in left_over(parent, &name, PARTIAL) {
            // What can't be removed is in no one's way.
            let _ = fs::remove_dir_all(left);
        }
        check_room(shown, bytes)?;
        let around: Vec<PathBuf> =
            parent.ancestors().take_while(|folder| !folder.exists()).map(Path::to_path_buf).collect();
        loop {
            let partial = beside(parent, &name, PARTIAL);
            // Known before it is there: a signal may come in between.
            lock_unfinished().folders.push((partial.clone(), around.clone()));
            if let Err(error) = fs::create_dir_all(&partial) {
                forget(&partial);
                remove_around(&around);
                return Err(FormatError::io(shown, "make this folder or write to", error));
            }
            let lock = File::open(&partial).and_then(|folder| folder.lock().map(|()| folder)).ok();
            // Another process may have taken it for left over before the lock was there.
            if partial.is_dir() {
                return Ok(Self { shown: shown.to_path_buf(), target, partial, lock, around, done: false });
            }
            forget(&partial);
        }
    }

    /// Where to write.
    pub fn path(&self) -> &Path {
        &self.partial
    }

    /// An error of writing to [`Self::path`], about the place that the user named.
    #[must_use]
    pub fn at_its_place(&self, error: FormatError) -> FormatError {
        error.moved(&self.partial, &self.shown)
    }

    /// Where a file or folder below [`Self::path`] will be, as the user names it.
    pub fn place_of(&self, path: &Path) -> PathBuf {
        path.strip_prefix(&self.partial).map_or_else(|_| path.to_path_buf(), |below| self.shown.join(below))
    }

    /// Writes files by their names, with the folders in these, and moves the complete folder to its place ([`Self::finish`]).
    ///
    /// # Errors
    /// What the system reports, about the place that the user named.
    pub fn finish_with(
        self,
        files: impl IntoIterator<Item = (String, Vec<u8>)>,
    ) -> Result<PathBuf, FormatError> {
        for (name, bytes) in files {
            let place = self.path().join(name);
            let made = fs::create_dir_all(place.parent().unwrap_or(self.path()));
            made.map_err(|error| FormatError::io(&place, "create", error))
                .and_then(|()| write_atomically(&place, |file| file.write_all(&bytes)))
                .map_err(|error| self.at_its_place(error))?;
        }
        self.finish()
    }

    /// Moves the complete folder to its place, once it is on the disk, and returns the place as the user named it.
    ///
    /// # Errors
    /// What the system reports. If someone else has written there in the meantime, the results are kept under another name.
    pub fn finish(mut self) -> Result<PathBuf, FormatError> {
        let shown = self.shown.clone();
        let failed = |error: io::Error| FormatError::io(&shown, "put the results at", error);
        self.complete().map_err(|error| self.at_its_place(error))?;
        if !self.target.exists() {
            self.put_at(&self.target.clone()).map_err(failed)?;
            return Ok(shown);
        }
        if let Some(foreign) = foreign_file(&self.target) {
            // Someone wrote there while the work was going on.
            let kept = self.keep()?;
            let what = format!("{foreign}; the results are in {}", kept.display());
            return Err(FormatError::failed(&shown, what));
        }
        let (parent, name) = self.parent_and_name();
        let old = beside(&parent, &name, REPLACED);
        let removed = self.take_the_place_of_earlier(&old, &parent).map_err(failed)?;
        for left in left_over(&parent, &name, REPLACED) {
            if left != old {
                // Results that were replaced by a process that was killed then; they may hold what is not ours.
                let _ = remove_replaced(&left);
            }
        }
        removed.map_err(|error| {
            let what = "the results are here, but the earlier ones can't be removed and are now";
            FormatError::failed(&shown, format!("{what} {}: {error}", old.display()))
        })?;
        Ok(shown)
    }

    /// Keeps an unfinished folder: in its place if that is free, otherwise beside it under a name of its own, which is
    /// returned.
    ///
    /// # Errors
    /// What the system reports.
    pub fn keep(mut self) -> Result<PathBuf, FormatError> {
        let shown = self.shown.clone();
        self.complete().map_err(|error| self.at_its_place(error))?;
        let (parent, name) = self.parent_and_name();
        let mut place = self.target.clone();
        let mut number = 1;
        while place.exists() {
            place = parent.join(format!("{name}-unfinished-{number}"));
            number += 1;
        }
        self.put_at(&place)
            .map_err(|error| FormatError::io(&shown, "keep what was made so far of", error))?;
        Ok(match (place == self.target, place.file_name()) {
            (false, Some(name)) => shown.with_file_name(name),
            _ => shown,
        })
    }

    /// Writes the list, and waits until all files are on the disk.
    fn complete(&self) -> Result<(), FormatError> {
        write_list(&self.partial)?;
        let failed = |error| FormatError::io(&self.partial, "write", error);
        for name in files_below(&self.partial).map_err(failed)? {
            let file = File::open(self.partial.join(name)).map_err(failed)?;
            sync(&file).map_err(failed)?;
        }
        folders_below(&self.partial)
            .and_then(|all| all.iter().try_for_each(|f| sync_folder(f)))
            .map_err(failed)
    }

    fn parent_and_name(&self) -> (PathBuf, String) {
        let name =
            self.target.file_name().map_or_else(|| "results".into(), |n| n.to_string_lossy().into_owned());
        (self.target.parent().map_or_else(|| self.target.clone(), Path::to_path_buf), name)
    }

    fn put_at(&mut self, place: &Path) -> io::Result<()> {
        fs::rename(&self.partial, place)?;
        let (parent, _) = self.parent_and_name();
        self.done(&parent)
    }

    /// Puts the folder in the place of earlier results, which are moved to `old` and then removed. Returns how that removal
    /// went.
    fn take_the_place_of_earlier(&mut self, old: &Path, parent: &Path) -> io::Result<io::Result<()>> {
        // A signal waits until the new results are in their place and the old ones are gone.
        let mut unfinished = lock_unfinished();
        replace(&self.partial, &self.target, old)?;
        unfinished.folders.retain(|(folder, _)| *folder != self.partial);
        self.done = true;
        self.lock = None;
        sync_folder(parent)?;
        Ok(remove_replaced(old))
    }

    /// From here on nothing is removed; waits until the new name is on the disk.
    fn done(&mut self, parent: &Path) -> io::Result<()> {
        self.done = true;
        self.lock = None;
        forget(&self.partial);
        sync_folder(parent)
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if !self.done {
            // A folder that can't be removed is left; there is nobody to tell.
            let _ = fs::remove_dir_all(&self.partial);
            remove_around(&self.around);
            forget(&self.partial);
        }
    }
}

/// Puts a folder in the place of another one, which gets the name `old`.
fn replace(partial: &Path, target: &Path, old: &Path) -> io::Result<()> {
    if exchange(partial, target).is_ok() {
        return fs::rename(partial, old);
    }
    fs::rename(target, old)?;
    fs::rename(partial, target).inspect_err(|_| {
        // The old results belong where they were; if even that fails, the first failure is told.
        let _ = fs::rename(old, target);
    })
}

/// Takes a folder off those in work.
fn forget(partial: &Path) {
    lock_unfinished().folders.retain(|(folder, _)| folder != partial);
}

fn remove_around(around: &[PathBuf]) {
    for folder in around {
        // Others may have put something there.
        let _ = fs::remove_dir(folder);
    }
}

/// Removes a folder into which another thread may still write: what comes in between is removed with it.
pub(super) fn remove_whole(path: &Path) {
    for _ in 0..100 {
        // Nothing more can be done about a folder that won't go away.
        if fs::remove_dir_all(path).is_ok() || !path.exists() {
            return;
        }
    }
}

/// Folders in work.
const PARTIAL: &str = "partial";
/// Folders on their way out.
const REPLACED: &str = "replaced";

/// Hidden folders of a kind beside a target that no process holds locked: theirs was killed.
fn left_over(parent: &Path, name: &str, what: &str) -> Vec<PathBuf> {
    let start = format!(".{name}.{what}-");
    let of_a_process = |name: &str| {
        let number = name.strip_prefix(&start);
        number.is_some_and(|n| !n.is_empty() && n.chars().all(|c| c.is_ascii_digit() || c == '-'))
    };
    let unheld = |path: &Path| File::open(path).is_ok_and(|folder| folder.try_lock().is_ok());
    fs::read_dir(parent)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| entry.file_name().to_str().is_some_and(of_a_process))
        .filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()))
        .map(|entry| entry.path())
        .filter(|path| unheld(path))
        .collect()
}

/// A hidden name in a folder that nothing has yet.
fn beside(parent: &Path, name: &str, what: &str) -> PathBuf {
    let stem = format!(".{name}.{what}-{}", std::process::id());
    let mut path = parent.join(&stem);
    let mut number = 1;
    while path.exists() {
        path = parent.join(format!("{stem}-{number}"));
        number += 1;
    }
    path
}

/// Why a folder can't be replaced: something in it was not written by this program. `None` for one that does not exist
/// or is empty.
fn foreign_file(folder: &Path) -> Option<String> {
    let entries = match files_below(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
        Err(error) => return Some(format!("cannot access this folder ({error})")),
    };
    if entries.is_empty() {
        return None;
    }
    let list = match read_list(folder) {
        Ok(list) => list,
        Err(problem) => return Some(problem),
    };
    for name in entries.iter().filter(|name| *name != LIST) {
        let Some(written) = list.files.get(name) else {
            return Some(format!("this folder holds {name}, which is not a result of fluorspar"));
        };
        match mark(&folder.join(name)) {
            Ok(now) if now == *written => {}
            Ok(_) => return Some(format!("{name} in this folder was changed since fluorspar wrote it")),
            Err(error) => return Some(format!("{name} in this folder cannot be read ({error})")),
        }
    }
    None
}

/// The list of a folder, or why there is none that can be used.
fn read_list(folder: &Path) -> Result<FolderList, String> {
    let foreign = || "this folder holds files that are not results of fluorspar".to_string();
    let text = read_text_bounded(&folder.join(LIST), LARGEST_LIST_BYTES).map_err(|_| foreign())?;
    let list: serde_json::Value = serde_json::from_str(&text).map_err(|_| foreign())?;
    FileFormat::RESULT_FOLDER
        .check(list["format"].as_i64())
        .map_err(|other| format!("in this folder {LIST}, {other}"))?;
    serde_json::from_value(list).map_err(|_| foreign())
}

fn write_list(folder: &Path) -> Result<(), FormatError> {
    let marks = || -> io::Result<BTreeMap<String, FileMark>> {
        let names = files_below(folder)?.into_iter().filter(|name| name != LIST);
        names.map(|name| mark(&folder.join(&name)).map(|mark| (name, mark))).collect()
    };
    let files = marks().map_err(|error| FormatError::io(folder, "write", error))?;
    let list = FolderList {
        format: FileFormat::RESULT_FOLDER.version(),
        version: env!("CARGO_PKG_VERSION").into(),
        files,
    };
    write_atomically(&folder.join(LIST), |file| {
        serde_json::to_writer_pretty(&mut *file, &list)?;
        file.write_all(b"\n")
    })
}

fn mark(path: &Path) -> io::Result<FileMark> {
    let metadata = fs::symlink_metadata(path)?;
    if !metadata.is_file() {
        return Err(io::Error::other("no plain file"));
    }
    let bytes = metadata.len();
    let digest = || digest_bounded(path, DIGEST_UP_TO_BYTES).map_err(io::Error::other);
    let sha256 = if bytes <= DIGEST_UP_TO_BYTES { Some(digest()?) } else { None };
    Ok(FileMark { bytes, sha256 })
}

/// Everything below a folder but folders, by path with `/` between names. Links are not followed.
fn files_below(folder: &Path) -> io::Result<Vec<String>> {
    let mut found = Vec::new();
    let mut open = vec![(folder.to_path_buf(), String::new())];
    while let Some((folder, prefix)) = open.pop() {
        for entry in fs::read_dir(&folder)? {
            let entry = entry?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.file_type()?.is_dir() {
                open.push((entry.path(), format!("{name}/")));
            } else {
                found.push(name);
            }
        }
    }
    Ok(found)
}

/// A folder and all folders below it.
fn folders_below(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = vec![folder.to_path_buf()];
    let mut next = 0;
    while let Some(folder) = found.get(next).cloned() {
        next += 1;
        for entry in fs::read_dir(&folder)? {
            let entry = entry?;
            if entry.file_type()?.is_dir() {
                found.push(entry.path());
            }
        }
    }
    Ok(found)
}

/// Deletes the files of the list of a folder, the list, and the folders that are then empty; fails where any is left.
fn remove_listed(folder: &Path) -> io::Result<()> {
    if let Ok(list) = read_list(folder) {
        // Only names that are found below the folder: a list may have been tampered with.
        for name in files_below(folder)? {
            if name == LIST || list.files.contains_key(&name) {
                fs::remove_file(folder.join(name))?;
            }
        }
    }
    remove_empty(folder)
}

/// Removes replaced results like [`remove_listed`]. Processes that replace results in one place at the same time find each
/// other's: the one that comes second waits, and finds nothing left to do.
fn remove_replaced(folder: &Path) -> io::Result<()> {
    let held = match File::open(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        opened => opened?,
    };
    // A file system without locks has none to wait for.
    let _ = held.lock();
    if folder.exists() { remove_listed(folder) } else { Ok(()) }
}

/// Removes a folder that holds nothing but empty folders.
fn remove_empty(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            remove_empty(&entry.path())?;
        }
    }
    fs::remove_dir(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_that_remove_one_folder_all_find_it_gone() {
        let around = tempfile::tempdir().unwrap();
        let folder = around.path().join("replaced");
        fs::create_dir(&folder).unwrap();
        for number in 0..300 {
            fs::write(folder.join(format!("{number}.txt")), "x").unwrap();
        }
        write_list(&folder).unwrap();
        let start = std::sync::Barrier::new(4);
        let removed: Vec<_> = std::thread::scope(|scope| {
            let remove = || {
                start.wait();
                remove_replaced(&folder)
            };
            let all = [(); 4].map(|()| scope.spawn(remove));
            all.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        assert!(removed.iter().all(Result::is_ok), "{removed:?}");
        assert!(!folder.exists());
    }

    /// A folder of format 1 as it was written, kept among the fixtures.
    #[test]
    fn folders_of_every_format_are_recognized_and_others_are_refused() {
        let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
        for version in 1..=FileFormat::RESULT_FOLDER.version() {
            let folder = stored.join(format!("folder-{version}"));
            assert_eq!(read_list(&folder).unwrap().files.len(), 1);
            assert_eq!(foreign_file(&folder), None);
        }
        let other = tempfile::tempdir().unwrap();
        let text = fs::read_to_string(stored.join("folder-1").join(LIST)).unwrap();
        fs::write(other.path().join(LIST), text.replace("\"format\": 1", "\"format\": 3")).unwrap();
        assert_eq!(
            foreign_file(other.path()).unwrap(),
            "in this folder fluorspar-folder.json, the list of files has format 3; this program reads format 1. \
             Delete the folder by hand if nothing in it is needed"
        );
    }
}
