//! `photographs.csv`: which files are photographs of whom, of which capture, and where their regions lie.

use std::path::{Path, PathBuf};

use csv::{ReaderBuilder, StringRecord, Trim, Writer};
use fluorspar::names::nearest_name;
use fluorspar::quote::excerpt;
use fluorspar_format::read_bounded;
use serde::{Deserialize, Serialize};

use super::estimate::GUESS;
use crate::{Error, Result};

/// Verdict of a line that does not count.
pub(super) const WRONG: &str = "wrong";
/// Verdict of a line whose region nobody placed yet.
pub(super) const MISSING: &str = "missing";
/// What a line may say as verdict.
const VERDICTS: [&str; 6] = ["", "right", "ok", GUESS, WRONG, MISSING];
/// Largest table that is read.
const LARGEST_BYTES: u64 = 64 << 20;

/// A line of the table; all but `frame` may be empty.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PhotographRow {
    /// Pseudonym of the person.
    pub patient: String,
    /// Visit of the person.
    pub visit: String,
    /// Capture of the experiment that the file is a frame of.
    pub capture: String,
    /// The file, relative to the table.
    pub frame: PathBuf,
    /// Dark frame of the camera.
    pub dark: PathBuf,
    /// Frame of even light of the camera.
    pub flat: PathBuf,
    /// Name of a region.
    pub region: String,
    /// Where it lies, as `--named-region NAME=WHERE` has it.
    #[serde(rename = "where")]
    pub place: String,
    /// What somebody who looked at it says: of `wrong` nothing is estimated, `guess` is what nobody looked at, `missing` what nobody placed.
    pub verdict: String,
}

impl PhotographRow {
    /// The columns in their order.
    pub const COLUMNS: [&str; 9] =
        ["patient", "visit", "capture", "frame", "dark", "flat", "region", "where", "verdict"];
}

/// Reads a table, without frames of the verdict `wrong`, but with such regions: a study is told of them. Files are as the table has them.
///
/// # Errors
/// Another column, no column `frame`, a line without a frame, a region without a place or the other way round.
pub fn read_photographs(path: &Path) -> Result<Vec<PhotographRow>> {
    let wrong = |why: String| Error::Input(format!("{}: {why}", path.display()));
    let bytes = read_bounded(path, LARGEST_BYTES)?;
    let first = bytes.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let delimiter = if first.contains(&b';') && !first.contains(&b',') { b';' } else { b',' };
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let mut reader = ReaderBuilder::new().trim(Trim::All).delimiter(delimiter).from_reader(text);
    let heads = reader.headers().map_err(|error| wrong(error.to_string()))?.clone();
    check_columns(&heads).map_err(wrong)?;
    let mut rows = Vec::new();
    for (number, row) in reader.deserialize::<PhotographRow>().enumerate() {
        let at = |why: &str| wrong(format!("line {}: {why}", number + 2));
        let mut row = row.map_err(|error| at(&error.to_string()))?;
        row.verdict = row.verdict.to_lowercase();
        if !VERDICTS.contains(&row.verdict.as_str()) {
            let known = VERDICTS[1..].join(", ");
            return Err(at(&format!(
                "\"{}\" is no verdict; write one of {known}, or nothing",
                excerpt(&row.verdict)
            )));
        }
        if row.verdict == MISSING {
            if !row.place.is_empty() {
                return Err(at("its region has a place: write \"right\" as verdict"));
            }
            (row.region, row.verdict) = (String::new(), String::new());
        }
        if row.frame.as_os_str().is_empty() {
            return Err(at("\"frame\", the file, is empty"));
        }
        if row.region.is_empty() != row.place.is_empty() {
            return Err(at("\"region\" and \"where\" belong together: write both, or neither"));
        }
        if row.verdict != WRONG || !row.region.is_empty() {
            rows.push(row);
        }
    }
    Ok(rows)
}

/// Refuses columns that do not exist, and a table without files.
fn check_columns(heads: &StringRecord) -> Result<(), String> {
    if let Some(other) = heads.iter().find(|head| !PhotographRow::COLUMNS.contains(head)) {
        let near = nearest_name(other, PhotographRow::COLUMNS)
            .map_or_else(String::new, |near| format!(" Did you mean \"{near}\"?"));
        let columns = PhotographRow::COLUMNS.join(", ");
        return Err(format!("there is no column \"{other}\".{near} The columns are {columns}"));
    }
    if !heads.iter().any(|head| head == "frame") {
        return Err("the column \"frame\", the file of each photograph, is missing".into());
    }
    Ok(())
}

/// The lines as a table.
///
/// # Errors
/// None is known.
pub fn photographs_csv(rows: &[PhotographRow]) -> Result<Vec<u8>> {
    let failed = |error: &dyn std::fmt::Display| Error::Failed(format!("photographs.csv: {error}"));
    let mut writer = Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).map_err(|error| failed(&error))?;
    }
    writer.into_inner().map_err(|error| failed(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_come_back_and_wrong_ones_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("photographs.csv");
        let told = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_photographs(&path)
        };
        let rows = told("\u{feff}patient,visit,capture,frame,region,where,verdict\nP1,1,blue,a.dng,tongue,\"1,2,30,40\",ok\nP1,1,blue,a.dng,lip,m.png,wrong\nP1,1,blue,b.dng,,,wrong\n").unwrap();
        assert_eq!(rows.len(), 2);
        assert_eq!((rows[0].place.as_str(), rows[0].frame.as_path()), ("1,2,30,40", Path::new("a.dng")));
        std::fs::write(&path, photographs_csv(&rows).unwrap()).unwrap();
        assert_eq!(read_photographs(&path).unwrap(), rows);
        let capital = told("frame,region,where,verdict\na.dng,tongue,\"1,2,3,4\",Wrong\n").unwrap();
        assert_eq!(capital[0].verdict, WRONG, "as spreadsheets capitalize it");
        assert_eq!(told("frame;patient\nb.dng;P2\n").unwrap()[0].patient, "P2");
        let missing = told("frame,region,where,verdict\na.dng,tongue,,missing\n").unwrap();
        assert_eq!((missing[0].region.as_str(), missing[0].verdict.as_str()), ("", ""));
        for (text, why) in [
            (
                "frame,region,where,verdict\na.dng,tongue,\"1,2,3,4\",missing\n",
                "line 2: its region has a place",
            ),
            ("vist,frame\n1,a\n", "no column \"vist\". Did you mean \"visit\"?"),
            ("patient\nP1\n", "the column \"frame\""),
            ("frame,patient\n,P1\n", "line 2: \"frame\""),
            ("frame,region\na.dng,tongue\n", "line 2: \"region\" and \"where\""),
            ("frame,patient\na.dng\n", "line 2: "),
            (
                "frame,region,where,verdict\na.dng,tongue,\"1,2,3,4\",worng\n",
                "line 2: \"worng\" is no verdict; write one of right,",
            ),
        ] {
            let error = told(text).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        }
    }
}
