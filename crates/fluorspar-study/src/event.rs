//! What happens in a study: the lines of its log.

use std::path::PathBuf;

use fluorspar::digest::sha256_hex;
use fluorspar::findings::FindingId;
use fluorspar_session::RegionEstimate;
use serde::{Deserialize, Serialize};

/// A file of the study.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredFile {
    /// What it is: the name of a capture, `dark`, `flat`, `mask` or `description`.
    pub role: String,
    /// Where it lies below the folder of the study.
    pub path: PathBuf,
    /// SHA-256 of its bytes.
    pub sha256: String,
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Event {
    /// The study began.
    Study {
        /// Its name.
        name: String,
        /// Where its people are examined.
        site: String,
        /// Of random bytes: codes of exports are made with it. It never leaves.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        secret: String,
    },
    /// The camera of the numbers that follow, and files of the study that are of no photograph.
    Setup {
        /// Digest of the experiment of the camera, by which its numbers are known.
        analysis: String,
        /// `camera.toml`, what that names, and the description of the study.
        files: Vec<StoredFile>,
    },
    /// A person, or what is newly known of one.
    Subject(Subject),
    /// A person withdrew: from here on in no norm and no export.
    Withdrawal {
        /// The pseudonym.
        subject: String,
    },
    /// A photograph: frames of a visit.
    Photograph {
        /// SHA-256 of its analyzed frame, by which it is called.
        photograph: String,
        /// The pseudonym.
        subject: String,
        /// The visit.
        session: String,
        /// The visit as the table has it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        visit: Option<String>,
        /// Its frames, the analyzed one first, and frames of the camera.
        files: Vec<StoredFile>,
    },
    /// Where a region lies; a later one of the same name takes its place.
    Region(Region),
    /// A number of a region.
    Estimate(LoggedEstimate),
    /// What became of a person.
    Outcome {
        /// The pseudonym.
        subject: String,
        /// `biopsy`, `follow-up` or another.
        method: String,
        /// What was found.
        outcome: String,
    },
}

/// Outcomes that are no lesion, in small letters; the page of studies and the help of the import name them.
pub(crate) const HEALTHY: [&str; 10] =
    ["healthy", "normal", "none", "no", "no lesion", "negative", "clear", "unremarkable", "ok", "0"];

/// Outcomes of which nobody can tell whether they are a lesion: a benign one is one, and benign tissue is none.
pub(crate) const UNCLEAR: [&str; 7] = ["benign", "unknown", "unclear", "pending", "n/a", "na", "?"];

/// What is known of a person.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Subject {
    /// The pseudonym: letters and digits.
    pub subject: String,
    /// The pseudonym as the table has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub written: Option<String>,
    /// Where the person is examined; that of the study where empty.
    pub site: String,
    /// As the study has it.
    pub sex: String,
    /// Years at the first visit.
    pub age: Option<f64>,
    /// Type of skin, as the study has it.
    pub skin: String,
    /// Whether the person smokes, as the study has it.
    pub smoker: String,
    /// `yes`, `no` or empty.
    pub consent: String,
}

/// A region of a photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// The photograph.
    pub photograph: String,
    /// Name.
    pub region: String,
    /// Where it lies; of a mask its path below the folder of the study.
    pub place: String,
    /// The mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<StoredFile>,
    /// What somebody who looked at it says.
    pub verdict: String,
}

impl Region {
    /// Digest of the photograph and of where the region lies.
    pub fn sha256(&self) -> String {
        let mask = self.mask.as_ref().map_or("", |mask| &mask.sha256);
        sha256_hex([format!("{}\n{}\n{}\n{mask}", self.photograph, self.region, self.place)])
    }
}

/// A number of a region of a photograph, by an analysis of a version of the program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoggedEstimate {
    /// The photograph.
    pub photograph: String,
    /// Digest of the region.
    pub region_sha256: String,
    /// The number.
    #[serde(flatten)]
    pub number: RegionEstimate,
    /// Digest of the experiment by which it was made.
    pub analysis: String,
    /// Version of the program.
    pub version: String,
}

/// A quantity by the name that files have.
pub(crate) fn quantity_name(quantity: FindingId) -> String {
    let name = serde_json::to_value(quantity).ok();
    name.and_then(|name| name.as_str().map(str::to_owned)).unwrap_or_default()
}
