//! Spectra of IES TM-27-14 (`.spdx`): XML with one element for each wavelength.

use std::path::Path;

use super::instrument_text::TextTable;
use crate::FormatError;

/// The table of a file.
pub(crate) fn tm27_table(path: &Path, text: &str) -> Result<TextTable, FormatError> {
    let document = roxmltree::Document::parse(text).map_err(|error| {
        FormatError::malformed(path, format!("this is not XML: {error}"), "Copy or export the file again")
    })?;
    let named =
        |name: &'static str| document.descendants().filter(move |node| node.tag_name().name() == name);
    let quantity = named("SpectralQuantity").next().and_then(|node| node.text()).unwrap_or_default();
    // Counted on from node to node: each anew would take the square of their number
    let (mut line, mut counted) = (1, 0);
    let mut rows = Vec::new();
    for node in named("SpectralData") {
        let Some(nm) = node.attribute("wavelength") else { continue };
        let start = node.range().start.max(counted);
        line += text.as_bytes()[counted..start].iter().filter(|byte| **byte == b'\n').count() as u64;
        counted = start;
        rows.push((line, vec![nm.trim().to_string(), node.text().unwrap_or_default().trim().to_string()]));
    }
    let Some(first) = rows.first() else {
        return Err(FormatError::unsupported(
            path,
            "this XML holds no SpectralData elements with wavelengths",
            "Give a file of IES TM-27 (.spdx), or export the spectrum as text (CSV)",
        ));
    };
    Ok(TextTable {
        mixed: None,
        header_line: first.0,
        header: vec!["wavelength_nm".into(), words_of(quantity.trim())],
        rows,
        preamble: Vec::new(),
        read_as: vec!["IES TM-27".into()],
    })
}

/// Words of a name in camel case.
fn words_of(name: &str) -> String {
    let mut words = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !words.is_empty() {
            words.push(' ');
        }
        words.extend(c.to_lowercase());
    }
    words
}
