//! The files that a command will write, declared before it begins.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::disk::{check_room, exchange, sync_folder};
use super::file::{Complete, PartialFile, lock_unfinished};
use super::mark::foreign;
use super::paths::{are_one, existing_folder, parent_of, without_links};
use crate::FormatError;
use crate::store::file::sidecar_path;

/// How an output comes to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// A file that is moved to its place at the end.
    File,
    /// A file that appears, and is renewed, during the work.
    Early,
    /// The same, and its reader judges what is there already.
    Continued,
    /// A folder, which [`super::OutputFolder`] writes.
    Folder,
}

/// Something that will be written.
#[derive(Clone, Debug)]
pub struct Output {
    /// The option that names it.
    option: String,
    path: PathBuf,
    kind: Kind,
    bytes: u64,
}

impl Output {
    fn new(option: &str, path: &Path, kind: Kind) -> Self {
        Self { option: option.into(), path: path.into(), kind, bytes: 0 }
    }

    /// A file that appears when the work is done.
    pub fn file(option: &str, path: &Path) -> Self {
        Self::new(option, path, Kind::File)
    }

    /// A file that is written, and renewed, during the work.
    pub fn early(option: &str, path: &Path) -> Self {
        Self::new(option, path, Kind::Early)
    }

    /// A file that is written during the work and may hold earlier work, which its reader judges.
    pub fn continued(option: &str, path: &Path) -> Self {
        Self::new(option, path, Kind::Continued)
    }

    /// A folder, which an [`super::OutputFolder`] writes.
    pub fn folder(option: &str, path: &Path) -> Self {
        Self::new(option, path, Kind::Folder)
    }

    /// Room on the disk that it takes at most, bytes.
    pub fn of_bytes(mut self, bytes: u64) -> Self {
        self.bytes = bytes;
        self
    }
}

/// All outputs and inputs of a command.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    outputs: Vec<Output>,
    inputs: Vec<PathBuf>,
}

impl Outputs {
    /// None.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an output. The file beside it that belongs to it, as the description of a `.npy` and the materials of an `.obj`, is
    /// added with it.
    #[must_use]
    pub fn and(mut self, output: Output) -> Self {
        let beside = match output.path.extension().and_then(|ending| ending.to_str()) {
            Some(ending) if ending.eq_ignore_ascii_case("npy") => Some(sidecar_path(&output.path)),
            Some(ending) if ending.eq_ignore_ascii_case("obj") => Some(output.path.with_extension("mtl")),
            _ => None,
        };
        let beside = beside.map(|path| Output { path, bytes: 0, ..output.clone() });
        self.outputs.push(output);
        self.outputs.extend(beside);
        self
    }

    /// Names files that the command reads: none of them may be written.
    #[must_use]
    pub fn reading(mut self, inputs: &[PathBuf]) -> Self {
        self.inputs.extend_from_slice(inputs);
        self
    }

    /// Refuses outputs that can't or must not be written. From here on [`super::write_atomically`] keeps the files that are
    /// to appear at the end, until [`OutputSet::finish`].
    ///
    /// # Errors
    /// A folder that does not exist or can't be written, a folder or device in the place of a file, a file that this program
    /// did not write, two outputs or an output and an input that are one file, a disk without room.
    pub fn declare(self) -> Result<OutputSet, FormatError> {
        for (number, output) in self.outputs.iter().enumerate() {
            output.check()?;
            self.check_alone(number)?;
        }
        self.check_room()?;
        let mut places = Vec::new();
        for Output { path, kind, .. } in &self.outputs {
            if *kind == Kind::File {
                places.push(without_links(path).map_err(|error| FormatError::io(path, "create", error))?);
            }
        }
        lock_unfinished().waiting.extend(places.iter().map(|place| (place.clone(), None)));
        Ok(OutputSet { places })
    }

    /// Refuses an output that is an input, or one file with an earlier output.
    fn check_alone(&self, number: usize) -> Result<(), FormatError> {
        let Output { option, path, kind, .. } = &self.outputs[number];
        let refuse =
            |why: String| Err(FormatError::refused(path, why, format!("name another with {option}")));
        // A folder looks into itself for what is read.
        if *kind != Kind::Folder
            && let Some(input) = self.inputs.iter().find(|input| are_one(path, input))
        {
            return refuse(format!("this is {}, a file that is read here", input.display()));
        }
        for earlier in &self.outputs[..number] {
            let (this, other) = (without_links(path), without_links(&earlier.path));
            let inside = |a: &Output, a_path: &io::Result<PathBuf>, b: &io::Result<PathBuf>| {
                a.kind == Kind::Folder
                    && matches!((a_path, b), (Ok(folder), Ok(path)) if path.starts_with(folder))
            };
            if are_one(path, &earlier.path)
                || inside(earlier, &other, &this)
                || inside(&self.outputs[number], &this, &other)
            {
                return refuse(format!(
                    "{} {} would be written to the same place",
                    earlier.option,
                    earlier.path.display()
                ));
            }
        }
        Ok(())
    }

    /// Refuses what does not fit on the disks, each with all that goes there.
    fn check_room(&self) -> Result<(), FormatError> {
        let mut disks: BTreeMap<PathBuf, (&Path, u64)> = BTreeMap::new();
        for Output { path, bytes, .. } in self.outputs.iter().filter(|output| output.bytes > 0) {
            let all = disks.entry(disk_of(path)).or_insert((path, 0));
            all.1 = all.1.saturating_add(*bytes);
        }
        disks.into_values().try_for_each(|(path, bytes)| check_room(path, bytes))
    }
}

/// Names the disk of a path: by its number, or the folder itself where disks have none.
fn disk_of(path: &Path) -> PathBuf {
    let folder = existing_folder(path);
    #[cfg(unix)]
    if let Ok(metadata) = fs::metadata(&folder) {
        return std::os::unix::fs::MetadataExt::dev(&metadata).to_string().into();
    }
    folder
}

impl Output {
    /// Refuses an output that can't be written, or holds what this program did not write.
    fn check(&self) -> Result<(), FormatError> {
        let Self { option, path, kind, .. } = self;
        if *kind == Kind::Folder {
            return Ok(());
        }
        let refuse =
            |why: String| Err(FormatError::refused(path, why, format!("name another with {option}")));
        if path.file_name().is_none() {
            return refuse("this names no file".into());
        }
        if path.is_dir() {
            return Err(FormatError::refused(path, "this is a folder", "give the name of a file in it"));
        }
        let folder = parent_of(path);
        if !folder.is_dir() {
            let why = format!("the folder {} does not exist", folder.display());
            return Err(FormatError::refused(path, why, "create it first"));
        }
        match foreign(path) {
            Some(why) if *kind != Kind::Continued || !path.is_file() => return refuse(why.into()),
            _ => {}
        }
        // Whether the folder can be written is known by writing to it.
        let place =
            super::paths::behind_link(path).map_err(|error| FormatError::io(path, "create", error))?;
        PartialFile::beside(&place).map_err(|error| FormatError::io(path, "create", error))?;
        Ok(())
    }
}

/// Files that appear together. Dropped without [`Self::finish`], none of them does.
#[must_use = "nothing appears before `finish`"]
#[derive(Debug)]
pub struct OutputSet {
    /// Without links.
    places: Vec<PathBuf>,
}

impl OutputSet {
    /// Moves the complete files to their places, all of them or none. Where someone else has put a file in the meantime, it
    /// stays, and the result is put beside it.
    ///
    /// # Errors
    /// A file that can't be moved: none is then. A file of someone else, with the name of the result beside it.
    pub fn finish(self) -> Result<(), FormatError> {
        let mut unfinished = lock_unfinished();
        let take = |place: &PathBuf| Some((place.clone(), unfinished.waiting.get_mut(place)?.take()?));
        let files: Vec<(PathBuf, Complete)> = self.places.iter().filter_map(take).collect();
        let mut moved: Vec<(&Path, PathBuf, Moved)> = Vec::new();
        let mut outcome = Ok(());
        for (place, (partial, _)) in &files {
            let free = if foreign(place).is_some() { name_beside(place) } else { place.clone() };
            match put(&partial.0, &free) {
                Ok(how) => moved.push((&partial.0, free, how)),
                Err(error) => {
                    for (partial, place, how) in moved.drain(..).rev() {
                        undo(partial, &place, how);
                    }
                    outcome = Err(FormatError::io(place, "rename the finished file to", error));
                    break;
                }
            }
        }
        for ((place, _), (_, used, _)) in files.iter().zip(&moved) {
            if place != used && outcome.is_ok() {
                let what = "someone else has written this file in the meantime";
                outcome =
                    Err(FormatError::failed(place, format!("{what}; the result is {}", used.display())));
            }
        }
        drop(unfinished);
        let folders: std::collections::BTreeSet<&Path> =
            files.iter().map(|(place, _)| parent_of(place)).collect();
        for folder in folders {
            sync_folder(folder).map_err(|error| FormatError::io(folder, "write", error))?;
        }
        outcome
    }
}

impl Drop for OutputSet {
    fn drop(&mut self) {
        let mut unfinished = lock_unfinished();
        let left: Vec<_> = self.places.iter().map(|place| unfinished.waiting.remove(place)).collect();
        drop(unfinished);
        // Temporary files remove themselves, which takes the lock.
        drop(left);
    }
}

/// How a file came to its place.
enum Moved {
    /// There was nothing.
    New,
    /// The earlier file has the temporary name now.
    Exchanged,
    /// The earlier file is gone.
    Replaced,
}

fn put(partial: &Path, place: &Path) -> io::Result<Moved> {
    if !place.exists() {
        fs::rename(partial, place)?;
        return Ok(Moved::New);
    }
    if exchange(partial, place).is_ok() {
        return Ok(Moved::Exchanged);
    }
    fs::rename(partial, place)?;
    Ok(Moved::Replaced)
}

/// Takes a file back, as far as it goes; the first failure is the one that is told.
fn undo(partial: &Path, place: &Path, how: Moved) {
    let _ = match how {
        Moved::New => fs::rename(place, partial),
        Moved::Exchanged => exchange(partial, place),
        Moved::Replaced => Ok(()),
    };
}

/// A name like that of a file that nothing has yet: `image-unfinished-1.exr`.
fn name_beside(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().map_or_else(String::new, |ending| format!(".{}", ending.to_string_lossy()));
    (1_u64..)
        .map(|number| path.with_file_name(format!("{stem}-unfinished-{number}{ending}")))
        .find(|path| !path.exists())
        .unwrap_or_else(|| path.to_path_buf())
}
