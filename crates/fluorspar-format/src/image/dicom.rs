//! DICOM files (PS3.10), explicit VR little endian, without compression.

use std::path::Path;

use crate::FormatError;
use crate::store::output::write_atomically;

/// Names this program in heads of files: a random UUID (PS3.5, B.2).
const IMPLEMENTATION: &str = "2.25.27149706148466550363595592555234299244";
const EXPLICIT_LITTLE_ENDIAN: &str = "1.2.840.10008.1.2.1";

/// An attribute of a data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DicomElement {
    /// Group in the upper 16 bits, element in the lower.
    pub tag: u32,
    /// Its value.
    pub value: DicomValue,
}

/// A value of a data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DicomValue {
    /// Text of a representation such as `LO` or `UI`; several values with a backslash between them.
    Text([u8; 2], String),
    /// US.
    Short(u16),
    /// OB: bytes such as pixels of eight bits.
    Bytes(Vec<u8>),
    /// SQ: items.
    Items(Vec<Vec<DicomElement>>),
}

impl DicomElement {
    /// A text.
    pub fn text(tag: u32, representation: &[u8; 2], text: &str) -> Self {
        Self { tag, value: DicomValue::Text(*representation, text.to_owned()) }
    }

    /// A number.
    pub fn short(tag: u32, number: u16) -> Self {
        Self { tag, value: DicomValue::Short(number) }
    }

    fn write(&self, to: &mut Vec<u8>) {
        let (representation, mut bytes) = match &self.value {
            DicomValue::Text(of, text) => (*of, text.clone().into_bytes()),
            DicomValue::Short(number) => (*b"US", number.to_le_bytes().to_vec()),
            DicomValue::Bytes(bytes) => (*b"OB", bytes.clone()),
            DicomValue::Items(items) => (*b"SQ", items.iter().flat_map(|item| item_bytes(item)).collect()),
        };
        if bytes.len() % 2 == 1 {
            // Identifiers and bytes end with a null, other texts with a space
            bytes.push(if [*b"UI", *b"OB"].contains(&representation) { 0 } else { b' ' });
        }
        to.extend(((self.tag >> 16) as u16).to_le_bytes());
        to.extend((self.tag as u16).to_le_bytes());
        to.extend(representation);
        if [*b"OB", *b"SQ"].contains(&representation) {
            to.extend([0, 0]);
            to.extend((bytes.len() as u32).to_le_bytes());
        } else {
            to.extend((bytes.len() as u16).to_le_bytes());
        }
        to.extend(bytes);
    }
}

fn set_bytes(elements: &[DicomElement]) -> Vec<u8> {
    let mut sorted: Vec<&DicomElement> = elements.iter().collect();
    sorted.sort_by_key(|element| element.tag);
    let mut bytes = Vec::new();
    sorted.into_iter().for_each(|element| element.write(&mut bytes));
    bytes
}

fn item_bytes(elements: &[DicomElement]) -> Vec<u8> {
    let set = set_bytes(elements);
    [&[0xfe, 0xff, 0x00, 0xe0][..], &(set.len() as u32).to_le_bytes(), &set].concat()
}

/// Writes a data set of a class (SOP Class UID) and an instance, in the order of its tags; both are attributes of the set as well.
///
/// # Errors
/// When the file can't be written.
pub fn write_dicom(
    path: &Path,
    class: &str,
    instance: &str,
    elements: &[DicomElement],
) -> Result<(), FormatError> {
    let head = set_bytes(&[
        DicomElement { tag: 0x0002_0001, value: DicomValue::Bytes(vec![0, 1]) },
        DicomElement::text(0x0002_0002, b"UI", class),
        DicomElement::text(0x0002_0003, b"UI", instance),
        DicomElement::text(0x0002_0010, b"UI", EXPLICIT_LITTLE_ENDIAN),
        DicomElement::text(0x0002_0012, b"UI", IMPLEMENTATION),
    ]);
    let of_set =
        [DicomElement::text(0x0008_0016, b"UI", class), DicomElement::text(0x0008_0018, b"UI", instance)];
    let mut bytes = [&[0; 128][..], b"DICM", &[2, 0, 0, 0], b"UL", &[4, 0]].concat();
    bytes.extend((head.len() as u32).to_le_bytes());
    bytes.extend(head);
    bytes.extend(set_bytes(&[elements, &of_set].concat()));
    write_atomically(path, |file| std::io::Write::write_all(file, &bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand after PS3.5, 7.1 and 7.5.
    #[test]
    fn elements_are_in_order_and_of_even_length() {
        let inner = vec![DicomElement::short(0x0028_0002, 3)];
        let set = set_bytes(&[
            DicomElement { tag: 0x0040_0555, value: DicomValue::Items(vec![inner]) },
            DicomElement::text(0x0020_000d, b"UI", "2.5"),
            DicomElement::text(0x0010_0020, b"LO", "a"),
        ]);
        let wanted: [&[u8]; 5] = [
            b"\x10\0\x20\0LO\x02\0a ",
            b"\x20\0\x0d\0UI\x04\x002.5\0",
            b"\x40\0\x55\x05SQ\0\0\x12\0\0\0",
            b"\xfe\xff\0\xe0\x0a\0\0\0",
            b"\x28\0\x02\0US\x02\0\x03\0",
        ];
        assert_eq!(set, wanted.concat());
    }
}
