//! Writing: the only place of this workspace that makes, replaces and removes files and folders.
//!
//! A command declares all that it will write before it begins ([`Outputs`]). What can't be written, or must not be, is refused
//! then: two outputs of one name, an output that is an input, a file that this program did not write, a disk without room.
//! A file is written beside its place and moved there when it is complete and on the disk ([`write_atomically`]); the files of
//! one command are moved together ([`OutputSet::finish`]), and so is a folder ([`OutputFolder`]). What a killed process has
//! left is not locked, and goes with the next write to the same place. Only [`AppendedLines`], those of a [`Journal`], and a data set beside one, grow in their
//! place: they hold finished work. Processes that share work hold each piece by a [`Claim`].

mod claim;
mod disk;
mod file;
mod folder;
mod journal;
mod lines;
mod mark;
mod paths;
mod set;
mod written_share;

pub use claim::Claim;
pub use disk::{check_room, free_bytes, sync_together};
pub use file::{remove_unfinished_files, unfinished_files, write_atomically, write_unsynced};
pub use folder::OutputFolder;
pub use journal::Journal;
pub use lines::AppendedLines;
pub use mark::WRITTEN_BY;
pub use set::{Output, OutputSet, Outputs};
pub(crate) use written_share::WrittenShare;
pub use written_share::written_share;
