//! Entries of the user that stand beside those of the catalogue.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use super::kind::PresetKind;

/// Largest file of an entry, bytes.
pub(super) const MOST_BYTES: u64 = 4 << 20;

/// Entries by folder and name: files in the form of the catalogue.
pub(super) type Entries = BTreeMap<(&'static str, String), String>;

static ENTRIES: OnceLock<Entries> = OnceLock::new();

/// Keeps entries for the rest of this process; the first ones stay.
pub(super) fn keep_entries(entries: Entries) {
    ENTRIES.get_or_init(|| entries);
}

/// The entry of a kind and a name, if the user has one.
pub(super) fn user_entry(kind: PresetKind, name: &str) -> Option<&'static str> {
    ENTRIES.get()?.get(&(kind.folder(), name.to_owned())).map(String::as_str)
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
