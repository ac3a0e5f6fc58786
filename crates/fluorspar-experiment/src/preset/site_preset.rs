//! Tissue sites of the catalogue and of files.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::catalogue::{damaged, text};
use super::curve_preset::check_name;
use super::kind::{PresetError, PresetKind};
use super::user_entries::MOST_BYTES;
use crate::schema::is_file_name;
use fluorspar::tissue::{Basis, Site, SiteDescription, SiteStructure, SiteValue, Surroundings};
use fluorspar_format::{read_text_bounded, read_toml};

/// The file of a site.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SiteFile {
    name: String,
    title: String,
    description: String,
    source: String,
    structure: SiteStructure,
    surroundings: Surroundings,
    values: Vec<ValueGroup>,
}

/// Values that come from one source.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ValueGroup {
    basis: Basis,
    #[serde(default)]
    source: String,
    parameters: BTreeMap<String, f64>,
}

/// The site that the text of a file describes.
///
/// # Errors
/// What is wrong and how to fix it.
pub fn site_of_text(text: &str) -> Result<Site, String> {
    let SiteFile { name, title, description, source, structure, surroundings, values } =
        read_toml(text).map_err(|error| error.to_string())?;
    let values = values.into_iter().flat_map(|ValueGroup { basis, source, parameters }| {
        parameters.into_iter().map(move |(parameter, value)| {
            let source = source.clone();
            SiteValue { parameter, value, basis, source }
        })
    });
    let description = SiteDescription { name, title, description, source, surroundings };
    Site::new(description, structure, values.collect()).map_err(|error| error.to_string())
}

/// A tissue site of the catalogue.
///
/// # Errors
/// When there is no such site.
pub fn site(name: &str) -> Result<Site, PresetError> {
    named_site(name, text(PresetKind::Site, name)?)
}

/// The site that the text of a file describes, which has to call itself so.
pub(super) fn named_site(name: &str, text: &str) -> Result<Site, PresetError> {
    let kind = PresetKind::Site;
    let site = site_of_text(text).map_err(|message| damaged(kind, name, message))?;
    check_name(kind, name, site.name())?;
    Ok(site)
}

/// A tissue site of the catalogue by its name, or one from a file.
///
/// # Errors
/// When there is no such site or file, or it is no site.
pub fn site_or_file(name: &str) -> Result<Site, PresetError> {
    if !is_file_name(name) {
        return site(name);
    }
    let refused = |message| PresetError::User { path: name.into(), message };
    let text = read_text_bounded(Path::new(name), MOST_BYTES)
        .map_err(|error| refused(error.problem().to_string()))?;
    site_of_text(&text).map_err(refused)
}

/// Sites that tissue may be of where one is taken for another: one of each kind of oral mucosa, specialized, lining and
/// masticatory, and the lip.
///
/// # Errors
/// When an embedded file is damaged.
pub fn compared_sites() -> Result<Vec<Site>, PresetError> {
    ["dorsal_tongue", "buccal_mucosa", "hard_palate", "lip"].into_iter().map(site).collect()
}

#[cfg(test)]
mod tests {
    use super::super::names;
    use super::*;

    #[test]
    fn every_site_loads_with_its_sources() {
        for name in names(PresetKind::Site) {
            let site = site(name).unwrap();
            assert!(!site.source().is_empty(), "{name}");
            assert_eq!(site.source().starts_with("[assumed]"), site.is_assumed(), "{name}");
            for (parameter, _) in site.parameters() {
                let (basis, source) = site.basis(parameter.name);
                assert!(basis == Basis::Assumed || !source.is_empty(), "{name}: {}", parameter.name);
            }
        }
    }

    #[test]
    fn wrong_site_files_are_refused_with_a_remedy() {
        let lip = text(PresetKind::Site, "lip").unwrap();
        let saturation = "parameters.oxygen_saturation = 0.868";
        assert!(lip.contains(saturation));
        for (wrong, words) in [
            (lip.replace("oxygen_saturation", "oxigen_saturation"), "; did you mean \"oxygen_saturation\"?"),
            (
                lip.replace(saturation, "parameters.oxygen_saturation = 86.8"),
                "is 86.8, outside 0 to 1; Oxygen",
            ),
            (lip.replace(saturation, ""), "lacks values of oxygen_saturation; give"),
            (
                format!("{lip}[[values]]\nbasis = \"assumed\"\n{saturation}\n"),
                "gives oxygen_saturation twice",
            ),
            (lip.replace("\"mucosa\"", "\"bone\""), "expected `mucosa` or `tooth`"),
            (lip.replace("\ntitle", "\ntitel"), "unknown field `titel`"),
        ] {
            let said = site_of_text(&wrong).unwrap_err();
            assert!(said.contains(words), "{words}: {said}");
        }
    }
}
