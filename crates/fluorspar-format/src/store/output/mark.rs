//! Files that this program wrote, known by a mark that all of them carry.

use std::fs;
use std::path::Path;

use crate::store::file::sidecar_path;
use crate::store::input::read_start;

/// What the texts that this program writes say of themselves, in a comment at their beginning.
pub const WRITTEN_BY: &str = "written by fluorspar";

/// Bytes at the beginning of a file in which its mark is: the lists of thousands of bands of an OpenEXR file are before it.
const START: u64 = 1 << 20;

/// What files of this program have in their beginning, by format.
const MARKS: &[&[u8]] = &[
    WRITTEN_BY.as_bytes(),
    // Pages without a figure, which has the mark; glTF, PNG, OpenEXR, descriptions.
    b"name=\"generator\" content=\"Fluorspar ",
    b"\"generator\":\"fluorspar\"",
    b"Software\0fluorspar",
    b"fluorsparQuantity\0",
    b"\"program\": \"fluorspar\"",
    crate::store::film::MAGIC,
];

/// Why a file must not be replaced: this program did not write it. `None` where there is no file, or an empty one.
pub(super) fn foreign(path: &Path) -> Option<&'static str> {
    let metadata = fs::metadata(path).ok()?;
    if metadata.is_dir() {
        return Some("this is a folder");
    }
    if !metadata.is_file() {
        return Some("this is a device or a pipe");
    }
    // Values of ENVI have their mark in the header
    let header = path.extension().filter(|ending| *ending == "dat").map(|_| path.with_extension("hdr"));
    let beside = header.unwrap_or_else(|| sidecar_path(path));
    if metadata.len() == 0 || is_marked(path) || is_marked(&beside) {
        return None;
    }
    Some("this file was not written by fluorspar, and stays")
}

fn is_marked(path: &Path) -> bool {
    let start = read_start(path, START).unwrap_or_default();
    MARKS.iter().any(|mark| start.windows(mark.len()).any(|window| window == *mark))
}
