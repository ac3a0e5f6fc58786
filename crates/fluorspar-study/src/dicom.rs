//! Pictures for archives: DICOM VL Photographic Images (PS3.3, A.32.4) of people by their codes.

use std::path::Path;

use fluorspar::digest::sha256_hex;
use fluorspar_format::{DicomElement, DicomValue, write_dicom};
use fluorspar_session::{Error, Result};

/// VL Photographic Image Storage.
const CLASS: &str = "1.2.840.10008.5.1.4.1.1.77.1.4";

/// What a picture shows, in words that may leave.
pub(crate) struct Shown<'a> {
    /// The code of the person.
    pub(crate) code: &'a str,
    /// As the study has it, where it is of the list.
    pub(crate) sex: &'a str,
    /// Number of the visit of the person, and of the photograph in it.
    pub(crate) visit: usize,
    pub(crate) photograph: usize,
    /// The visit as the study has it, which is in no file.
    pub(crate) session: &'a str,
    /// Digest of the photograph.
    pub(crate) sha256: &'a str,
    /// Number of the picture within the photograph, from 1.
    pub(crate) picture: usize,
    /// The light.
    pub(crate) capture: &'a str,
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// `[row, col, channel]`.
    pub(crate) rgb: &'a [u8],
}

/// An identifier (PS3.5, B.2) that is the same in all exports of a study: a UUID of version 8 (RFC 9562), derived from a secret.
fn uid(secret: &str, parts: &[&str]) -> String {
    let digest = sha256_hex([format!("{secret}\nuid\n{}", parts.join("\n"))]);
    let bits = u128::from_str_radix(&digest[..32], 16).unwrap_or_default();
    let marked = bits & !(0xf << 76) & !(0x3 << 62) | (0x8 << 76) | (0x2 << 62);
    format!("2.25.{marked}")
}

/// Writes a picture of a person who is told by the code alone.
///
/// # Errors
/// When the file can't be written, or has more rows or columns than its format counts.
pub(crate) fn write_picture(path: &Path, of: &Shown<'_>, secret: &str) -> Result<()> {
    let [columns, rows] = of.size;
    let most = usize::from(u16::MAX);
    if columns > most || rows > most {
        let text = format!("{columns} x {rows} pixels: DICOM has {most} rows and columns at most");
        return Err(Error::Input(text));
    }
    let instance = uid(secret, &[of.code, of.sha256, &of.picture.to_string()]);
    let elements = [person(of), visit_of(of, secret), image(of), pixels(of)].concat();
    Ok(write_dicom(path, CLASS, &instance, &elements)?)
}

/// The person, and what was done to hide who it is: PS3.16, CID 7050.
fn person(of: &Shown<'_>) -> Vec<DicomElement> {
    let text = DicomElement::text;
    let sex = of.sex.chars().next().filter(|sex| ['f', 'm', 'o'].contains(sex));
    let profile = vec![
        text(0x0008_0100, b"SH", "113100"),
        text(0x0008_0102, b"SH", "DCM"),
        text(0x0008_0104, b"LO", "Basic Application Confidentiality Profile"),
    ];
    vec![
        text(0x0010_0010, b"PN", &format!("{}^", of.code)),
        text(0x0010_0020, b"LO", of.code),
        text(0x0010_0030, b"DA", ""),
        text(0x0010_0040, b"CS", &sex.map_or_else(String::new, |sex| sex.to_uppercase().to_string())),
        text(0x0012_0062, b"CS", "YES"),
        text(0x0012_0063, b"LO", "Written from pixels; listed words alone"),
        DicomElement { tag: 0x0012_0064, value: DicomValue::Items(vec![profile]) },
    ]
}

/// The visit as study and the photograph as series; no date is told.
fn visit_of(of: &Shown<'_>, secret: &str) -> Vec<DicomElement> {
    let text = DicomElement::text;
    let (visit, photograph) = (of.visit.to_string(), of.photograph.to_string());
    let series = uid(secret, &[of.code, of.sha256]);
    vec![
        text(0x0020_000d, b"UI", &uid(secret, &[of.code, of.session])),
        text(0x0020_000e, b"UI", &series),
        text(0x0020_0010, b"SH", &visit),
        text(0x0020_0011, b"IS", &photograph),
        text(0x0008_0020, b"DA", ""),
        text(0x0008_0030, b"TM", ""),
        text(0x0008_0050, b"SH", ""),
        text(0x0008_0060, b"CS", "XC"),
        text(0x0008_0070, b"LO", ""),
        text(0x0008_0090, b"PN", ""),
    ]
}

/// What it is a picture of.
fn image(of: &Shown<'_>) -> Vec<DicomElement> {
    let text = DicomElement::text;
    vec![
        text(0x0008_0008, b"CS", "DERIVED\\PRIMARY"),
        text(0x0020_0013, b"IS", &of.picture.to_string()),
        text(0x0020_0020, b"CS", ""),
        text(0x0020_0060, b"CS", ""),
        text(0x0020_4000, b"LT", of.capture),
        text(0x0028_2110, b"CS", "00"),
        DicomElement { tag: 0x0040_0555, value: DicomValue::Items(Vec::new()) },
    ]
}

fn pixels(of: &Shown<'_>) -> Vec<DicomElement> {
    let numbers = [
        (0x0028_0002, 3),
        (0x0028_0006, 0),
        (0x0028_0010, of.size[1] as u16),
        (0x0028_0011, of.size[0] as u16),
        (0x0028_0100, 8),
        (0x0028_0101, 8),
        (0x0028_0102, 7),
        (0x0028_0103, 0),
    ];
    let mut elements: Vec<DicomElement> =
        numbers.into_iter().map(|(tag, number)| DicomElement::short(tag, number)).collect();
    elements.push(DicomElement::text(0x0028_0004, b"CS", "RGB"));
    elements.push(DicomElement { tag: 0x7fe0_0010, value: DicomValue::Bytes(of.rgb.to_vec()) });
    elements
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_derived_and_tell_people_apart() {
        let one = uid("secret", &["a", "1"]);
        assert_eq!(one, uid("secret", &["a", "1"]));
        assert!(one != uid("secret", &["b", "1"]) && one != uid("other", &["a", "1"]));
        let bits: u128 = one.strip_prefix("2.25.").unwrap().parse().unwrap();
        assert_eq!(((bits >> 76) & 0xf, (bits >> 62) & 3), (8, 2));
        assert!(one.len() <= 64);
    }
}
