//! Texts as cells of comma-separated tables.

use std::borrow::Cow;

/// A text as a cell, in quotes where it holds a comma, a quote or the end of a line (RFC 4180, section 2).
pub fn csv_cell(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) { quoted_csv_cell(text).into() } else { text.into() }
}

/// A text as a cell in quotes, whatever it holds.
pub fn quoted_csv_cell(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

#[cfg(test)]
mod tests {
    use super::{csv_cell, quoted_csv_cell};

    #[test]
    fn a_reader_of_tables_gets_every_text_back() {
        let texts = ["plain", "", " spaced ", "a, b", "say \"so\"", "\"", "two\nlines", "old\rline", "µ"];
        let as_needed: Vec<String> = texts.iter().map(|text| csv_cell(text).into_owned()).collect();
        let always: Vec<String> = texts.iter().map(|text| quoted_csv_cell(text)).collect();
        for line in [as_needed.join(","), always.join(",")] {
            let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(line.as_bytes());
            let record = reader.records().next().unwrap().unwrap();
            assert_eq!(record.iter().collect::<Vec<_>>(), texts, "{line}");
        }
        assert_eq!(as_needed[0], "plain");
    }
}
