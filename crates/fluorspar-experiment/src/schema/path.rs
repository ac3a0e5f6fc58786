//! Paths in a file, and texts that are a name of the catalogue or a path.

use std::borrow::Cow;
use std::fmt;
use std::path::Path;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

/// Path of a file. In a file relative to the folder of that file, in an override to the working folder; absolute once it is read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FilePath(String);

impl FilePath {
    /// The path as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The ending of the name in small letters, for instance `png`.
    pub fn extension(&self) -> Option<String> {
        Path::new(&self.0).extension().map(|ending| ending.to_string_lossy().to_lowercase())
    }
}

impl From<String> for FilePath {
    fn from(path: String) -> Self {
        Self(path)
    }
}

impl AsRef<Path> for FilePath {
    fn as_ref(&self) -> &Path {
        Path::new(&self.0)
    }
}

impl fmt::Display for FilePath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl JsonSchema for FilePath {
    fn schema_name() -> Cow<'static, str> {
        "FilePath".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "Path of a file, relative to the file that names it.",
            "type": "string",
            "format": "path"
        })
    }
}

/// A text that is a name of the catalogue or a path.
macro_rules! name_or_path {
    ($(#[$about:meta])* $type:ident, $is_path:path, $(#[$path:meta])* $description:literal, $format:literal) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(from = "String", into = "String")]
        pub enum $type {
            /// A name of the catalogue.
            Name(String),
            $(#[$path])*
            File(FilePath),
        }

        impl $type {
            /// The name or the path.
            pub fn as_str(&self) -> &str {
                match self {
                    Self::Name(name) => name,
                    Self::File(path) => path.as_str(),
                }
            }
        }

        impl From<String> for $type {
            fn from(text: String) -> Self {
                if $is_path(&text) { Self::File(FilePath(text)) } else { Self::Name(text) }
            }
        }

        impl From<$type> for String {
            fn from(reference: $type) -> Self {
                match reference {
                    $type::Name(text) | $type::File(FilePath(text)) => text,
                }
            }
        }

        impl JsonSchema for $type {
            fn schema_name() -> Cow<'static, str> {
                stringify!($type).into()
            }

            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({ "description": $description, "type": "string", "format": $format })
            }
        }
    };
}

name_or_path!(
    /// A text that is a name of the catalogue or the path of a table of spectra.
    NameOrTable,
    NameOrTable::is_path,
    /// A path: with a slash, or the ending `.csv`, `.txt`, `.tsv` or `.mat`.
    "A name of the catalogue or the path of a CSV file.",
    "name-or-table-path"
);

name_or_path!(
    /// A text that is a lens or a tissue site of the catalogue, or the path of a file of one.
    NameOrFile,
    is_file_name,
    /// A path: with a slash, or the ending of such a file.
    "A name of the catalogue or the path of a file.",
    "name-or-file-path"
);

impl NameOrTable {
    /// Whether a text is the path of a table rather than a name: it has a slash, or an ending such as `.csv`.
    pub fn is_path(text: &str) -> bool {
        let ending = text.rsplit_once('.').map_or("", |(_, ending)| ending);
        let is_ending = ending.len() <= 12
            && ending.starts_with(|c: char| c.is_ascii_alphabetic())
            && ending.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        text.contains(['/', '\\']) || is_ending
    }
}

/// Whether a text is the path of a file of a lens or a tissue site rather than a name of the catalogue.
pub(crate) fn is_file_name(text: &str) -> bool {
    let lower = text.to_lowercase();
    text.contains(['/', '\\'])
        || [".toml", ".dat", ".json", ".zmx"].iter().any(|ending| lower.ends_with(ending))
}
