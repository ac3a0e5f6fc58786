//! What a path leads to, whether or not it exists.

use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

/// Most links that lead to links, as systems have it.
const MOST_LINKS: usize = 40;

/// An absolute path without links, `.` and `..`; its end need not exist, nor that of a link.
pub(super) fn without_links(path: &Path) -> io::Result<PathBuf> {
    follow(path, MOST_LINKS)
}

fn follow(path: &Path, most_links: usize) -> io::Result<PathBuf> {
    let mut real = PathBuf::new();
    for component in std::path::absolute(path)?.components() {
        match component {
            Component::ParentDir => {
                real.pop();
            }
            Component::CurDir => {}
            other => real.push(other),
        }
        match real.canonicalize() {
            Ok(canonical) => real = canonical,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                // A link to nothing: what it names will be made.
                if let Ok(named) = fs::read_link(&real) {
                    let left = most_links.checked_sub(1).ok_or(error)?;
                    real = follow(&parent_of(&real).join(named), left)?;
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(real)
}

/// Where a write to a path ends: behind the link that it may be, or the path itself.
pub(super) fn behind_link(path: &Path) -> io::Result<PathBuf> {
    match fs::read_link(path) {
        Ok(_) => without_links(path),
        Err(_) => Ok(path.to_path_buf()),
    }
}

/// The folder of a path, `.` for a name alone.
pub(super) fn parent_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The innermost folder around a path, or the path itself, that exists.
pub(super) fn existing_folder(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    absolute.ancestors().find(|folder| folder.is_dir()).unwrap_or(Path::new(".")).to_path_buf()
}

/// Whether two paths lead to one file: by their names without links, or by hard links.
pub(super) fn are_one(a: &Path, b: &Path) -> bool {
    let by_name = || Some(without_links(a).ok()? == without_links(b).ok()?);
    identity(a).zip(identity(b)).is_some_and(|(a, b)| a == b) || by_name().unwrap_or(false)
}

/// Disk and number of a file that exists.
#[cfg(unix)]
fn identity(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    let metadata = fs::metadata(path).ok()?;
    Some((metadata.dev(), metadata.ino()))
}

#[cfg(not(unix))]
fn identity(_: &Path) -> Option<(u64, u64)> {
    None
}
