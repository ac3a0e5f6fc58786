//! Files with one tissue: a `[[tissue]]` section by itself, as `fluorspar tissue fit` writes it.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{ExperimentError, steps};
use crate::read::read_sections;
use crate::resolve::context::Context;
use crate::resolve::device;
use crate::resolve::fluorophore::check_sections;
use crate::resolve::named_tissue::{NamedTissue, of_section};
use crate::resolve::tissue::check_balance;
use crate::schema::{FluorophoreSection, FormatVersion, SpectralSection, TissueSection};

/// A tissue by itself. The section can be copied into an experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TissueFile {
    /// Version of the form of this file: 1.
    pub format: FormatVersion,
    /// Fluorophores of its own that its layers name.
    #[serde(default)]
    pub fluorophore: Vec<FluorophoreSection>,
    /// The tissue: one section.
    #[serde(default)]
    pub tissue: Vec<TissueSection>,
}

/// Reads a file with one tissue: its name, and the site with its states and parameters, or its layers. Fluorophores of layers are
/// those of the file, otherwise of the catalogue.
///
/// # Errors
/// The first defect found; no tissue, or several.
pub fn parse_tissue(
    text: &str,
    source_name: &str,
    base_dir: &Path,
) -> Result<(String, NamedTissue), ExperimentError> {
    let (document, file) = read_sections::<TissueFile>(text, source_name, base_dir, &[])?;
    let context = &mut Context::new(&document);
    let [section] = file.tissue.as_slice() else {
        let message = format!("there are {} tissues; give one [[tissue]] section", file.tissue.len());
        return context.fail(&steps!["tissue"], message);
    };
    let grid = device::grid(context, &SpectralSection::default())?;
    check_sections(context, &file.fluorophore)?;
    let named = of_section(context, &steps!["tissue", 0], section, &file.fluorophore, &grid)?;
    check_balance(context, &steps!["tissue", 0], section, &named, &file.fluorophore, &grid)?;
    check_use(context, &file.fluorophore, section, &named)?;
    Ok((section.name.clone(), named))
}

/// Refuses fluorophores that no layer holds, or that have the names of those of the site.
fn check_use(
    context: &Context<'_>,
    fluorophores: &[FluorophoreSection],
    section: &TissueSection,
    named: &NamedTissue,
) -> Result<(), ExperimentError> {
    for (index, own) in fluorophores.iter().enumerate() {
        let at = steps!["fluorophore", index];
        if let NamedTissue::Site(site) = named
            && site.fluorophores().contains(&own.name.as_str())
        {
            let message =
                "the site holds the fluorophore of this name of the catalogue; give this one another name";
            return context.fail(&at.field("name"), message);
        }
        if !section.layer.iter().any(|layer| layer.fluorophores.contains_key(&own.name)) {
            return context.fail(
                &at,
                "no layer holds it; name it in the fluorophores of a [[tissue.layer]], or remove it",
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "these are tests")]

    use super::*;

    fn read(text: &str) -> Result<(String, NamedTissue), ExperimentError> {
        parse_tissue(text, "me.toml", Path::new("."))
    }

    #[test]
    fn a_tissue_is_read_and_defects_are_told_with_their_line() {
        let one = "[[tissue]]\nname = \"mine\"\nsite = \"lip\"\nparameters = { oxygen_saturation = 0.7 }\n";
        let (name, site) = read(&format!("format = 1\n{one}")).unwrap();
        let NamedTissue::Site(site) = site else { panic!("a site") };
        assert!(name == "mine" && site.name() == "lip" && site.get("oxygen_saturation").unwrap() == 0.7);
        let wrong = [
            ("format = 1\n".to_string(), "there are 0 tissues"),
            (format!("format = 1\n{one}{}", one.replace("mine", "yours")), "there are 2 tissues"),
            (one.to_string(), "write format = 1"),
            (format!("format = 1\n{}", one.replace("0.7", "70")), "outside 0 to 1"),
            (format!("format = 1\n{}", one.replace("lip\"", "lop\"")), "no tissue \"lop\""),
            (format!("format = 1\nlayer = 3\n{one}"), "layer"),
        ];
        for (text, words) in wrong {
            let said = read(&text).unwrap_err().to_string();
            assert!(said.contains(words), "{words}: {said}");
        }
    }
}
