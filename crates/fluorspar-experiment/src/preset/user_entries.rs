//! Entries of the user that stand beside those of the catalogue.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::OnceLock;

use super::kind::PresetKind;

/// Largest file of an entry, bytes.
pub(super) const MOST_BYTES: u64 = 4 << 20;

/// An entry, and the file that it was read from.
pub(crate) struct UserEntry {
    /// In the form of the catalogue.
    pub(super) text: String,
    pub(crate) file: PathBuf,
    /// Digest of the file.
    pub(crate) sha256: String,
}

/// Entries by folder and name.
pub(super) type Entries = BTreeMap<(&'static str, String), UserEntry>;

static ENTRIES: OnceLock<Entries> = OnceLock::new();

/// Keeps entries for the rest of this process; the first ones stay.
pub(super) fn keep_entries(entries: Entries) {
    ENTRIES.get_or_init(|| entries);
}

/// The entry of a kind and a name, if the user has one.
pub(crate) fn user_entry(kind: PresetKind, name: &str) -> Option<&'static UserEntry> {
    ENTRIES.get()?.get(&(kind.folder(), name.to_owned()))
}

/// Names of the entries of a kind.
pub(super) fn user_names(kind: PresetKind) -> impl Iterator<Item = &'static str> {
    let of_kind = move |(folder, _): &&(&'static str, String)| *folder == kind.folder();
    ENTRIES
        .get()
        .into_iter()
        .flat_map(|entries| entries.keys())
        .filter(of_kind)
        .map(|(_, name)| name.as_str())
}

/// Whether the user has entries of any kind.
pub(crate) fn has_user_catalogue() -> bool {
    ENTRIES.get().is_some_and(|entries| !entries.is_empty())
}
