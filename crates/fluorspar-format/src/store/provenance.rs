//! Where a result comes from: it rides on every file, so that the result can be made again from the file alone.

use serde::{Deserialize, Serialize};

use fluorspar::digest::sha256_hex;

/// Program, version and complete configuration behind a result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// "fluorspar".
    pub program: String,
    /// Version of the program.
    pub version: String,
    /// SHA-256 of the experiment as the user wrote it, lower-case hexadecimal.
    pub experiment_sha256: String,
    /// The experiment with every default filled in: running it gives the same bits again.
    pub resolved_experiment_toml: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Paths averaged per pixel.
    pub samples_per_pixel: u32,
    /// Time of creation, UTC, ISO 8601. Left out by default, so that equal runs give equal files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub created_utc: Option<String>,
}

impl Provenance {
    /// Provenance of this version of the program, without a time of creation.
    ///
    /// `experiment` is the text that the user wrote, `resolved_experiment_toml` the same with every default filled in.
    pub fn new(
        experiment: &str,
        resolved_experiment_toml: impl Into<String>,
        seed: u64,
        samples_per_pixel: u32,
    ) -> Self {
        Self {
            program: "fluorspar".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            experiment_sha256: sha256_hex([experiment]),
            resolved_experiment_toml: resolved_experiment_toml.into(),
            seed,
            samples_per_pixel,
            created_utc: None,
        }
    }
}

/// Result of a reader: the data and their provenance, if the file states it.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded<T> {
    /// The data.
    pub image: T,
    /// Where they come from.
    pub provenance: Option<Provenance>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_experiment_is_known_by_its_sha256() {
        let provenance = Provenance::new("abc", "", 1, 2);
        // FIPS 180-2, appendix B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(provenance.experiment_sha256, expected);
    }

    #[test]
    fn equal_runs_have_equal_provenance() {
        let json = serde_json::to_string(&Provenance::new("a", "b", 1, 2)).unwrap();
        assert!(!json.contains("created_utc"), "{json}");
    }
}
