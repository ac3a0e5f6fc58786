//! The `.npy` format of NumPy: one array of floating-point numbers (NumPy Enhancement Proposal 1, "A Simple File Format
//! for NumPy Arrays").
//!
//! A file is `\x93NUMPY`, a version, the length of the header, the header, and the values. The header is the text of a
//! Python dictionary: `{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }`.

use fluorspar::quote::excerpt;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use super::FormatError;
use crate::store::file::MAX_IMAGE_BYTES;
use crate::store::input::open_plain;

pub(super) const NPY_MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Longest header, bytes. NumPy itself trusts none above 10 000.
const MAX_HEADER_BYTES: u64 = 1 << 16;
/// The values of a file begin at a multiple of this, so that they can be mapped into memory.
const ALIGNMENT: usize = 64;
/// Values converted at once.
const CHUNK: usize = 1 << 14;

/// How one value of an array is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ElementType {
    LittleF32,
    BigF32,
    LittleF64,
    BigF64,
    /// Of a mask: a truth value or an integer of so many bytes, of which only matters whether it is zero.
    NotZero(usize),
    /// Of a mask: a double, whose size does not matter.
    Sign {
        is_big: bool,
    },
}

impl ElementType {
    /// The type that `descr` names.
    fn parse(descr: &str) -> Option<Self> {
        Some(match descr {
            "<f4" => Self::LittleF32,
            ">f4" => Self::BigF32,
            "<f8" => Self::LittleF64,
            ">f8" => Self::BigF64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::LittleF32 | Self::BigF32 => 4,
            Self::LittleF64 | Self::BigF64 | Self::Sign { .. } => 8,
            Self::NotZero(bytes) => bytes,
        }
    }

    /// The type that `descr` names where truth values and integers are allowed, too.
    fn parse_of_mask(descr: &str) -> Option<Self> {
        let mut letters = descr.chars();
        let (order, kind) = (letters.next()?, letters.next()?);
        let bytes: usize = letters.as_str().parse().ok()?;
        let is_whole = "<>|=".contains(order) && "bui".contains(kind) && [1, 2, 4, 8].contains(&bytes);
        match Self::parse(descr) {
            _ if is_whole => Some(Self::NotZero(bytes)),
            Some(double @ (Self::LittleF64 | Self::BigF64)) => {
                Some(Self::Sign { is_big: double == Self::BigF64 })
            }
            other => other,
        }
    }

    /// Appends the values of whole elements, rounded to single precision.
    fn decode(self, bytes: &[u8], values: &mut Vec<f32>) {
        let (singles, doubles) = (bytes.as_chunks::<4>().0, bytes.as_chunks::<8>().0);
        match self {
            Self::LittleF32 => values.extend(singles.iter().map(|b| f32::from_le_bytes(*b))),
            Self::BigF32 => values.extend(singles.iter().map(|b| f32::from_be_bytes(*b))),
            Self::LittleF64 => values.extend(doubles.iter().map(|b| f64::from_le_bytes(*b) as f32)),
            Self::BigF64 => values.extend(doubles.iter().map(|b| f64::from_be_bytes(*b) as f32)),
            Self::Sign { is_big } => values.extend(doubles.iter().map(|b| {
                let value = if is_big { f64::from_be_bytes(*b) } else { f64::from_le_bytes(*b) };
                if value == 0.0 { 0.0 } else { value.signum() as f32 }
            })),
            Self::NotZero(size) => {
                let is_set = |value: &[u8]| f32::from(u8::from(value.iter().any(|&byte| byte != 0)));
                values.extend(bytes.chunks_exact(size).map(is_set));
            }
        }
    }
}

/// The dictionary of a header, its element type still as text.
#[derive(Debug, PartialEq, Eq)]
struct Header {
    descr: String,
    fortran_order: bool,
    shape: Vec<u64>,
}

/// Writes an array in C order as `.npy`, version 1.0, little-endian f32. The shape must hold as many values.
pub(super) fn write_npy(writer: &mut impl Write, shape: &[u64], values: &[f32]) -> io::Result<()> {
    debug_assert_eq!(shape.iter().product::<u64>(), values.len() as u64);
    let mut extents = shape.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
    if shape.len() == 1 {
        // A comma makes it a tuple.
        extents.push(',');
    }
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({extents}), }}");
    let unpadded = NPY_MAGIC.len() + 4 + header.len() + 1;
    header.push_str(&" ".repeat(unpadded.next_multiple_of(ALIGNMENT) - unpadded));
    header.push('\n');
    let length = u16::try_from(header.len())
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "too many axes for a .npy file"))?;
    writer.write_all(NPY_MAGIC)?;
    writer.write_all(&[1, 0])?;
    writer.write_all(&length.to_le_bytes())?;
    writer.write_all(header.as_bytes())?;
    let mut bytes = Vec::with_capacity(4 * CHUNK.min(values.len()));
    for chunk in values.chunks(CHUNK) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|value| value.to_le_bytes()));
        writer.write_all(&bytes)?;
    }
    Ok(())
}

/// Shape and values of an array of f32 or f64 in C order, of either byte order, rounded to single precision. Versions 1.0
/// to 3.0.
///
/// # Errors
/// Other element types, Fortran order, a header that is not one, a shape that does not fit the length of the file.
pub(super) fn read_npy(path: &Path) -> Result<(Vec<u64>, Vec<f32>), FormatError> {
    read_npy_of(path, ElementType::parse, "'<f4' or '<f8'", "Save a.astype('<f4')")
}

/// Shape and values of a mask: an array of truth values, integers or floating-point numbers. Whole numbers other than 0 become 1, doubles 1 or -1.
///
/// # Errors
/// Those of [`read_npy`].
pub(super) fn read_npy_mask(path: &Path) -> Result<(Vec<u64>, Vec<f32>), FormatError> {
    read_npy_of(path, ElementType::parse_of_mask, "truth values or numbers", "Save (a != 0)")
}

fn read_npy_of(
    path: &Path,
    parse: impl Fn(&str) -> Option<ElementType>,
    expected: &str,
    hint: &str,
) -> Result<(Vec<u64>, Vec<f32>), FormatError> {
    let failed = |source| FormatError::io(path, "read", source);
    let (file, length) = open_plain(path)?;
    let mut reader = BufReader::new(file);

    // Read the header, bounded by what the file holds.
    if length < 12 {
        return Err(not_npy(path));
    }
    let mut start = [0; 8];
    reader.read_exact(&mut start).map_err(failed)?;
    if start[..6] != *NPY_MAGIC || !(1..=3).contains(&start[6]) {
        return Err(not_npy(path));
    }
    let size_bytes = if start[6] == 1 { 2 } else { 4 };
    let mut size = [0; 4];
    reader.read_exact(&mut size[..size_bytes]).map_err(failed)?;
    let header_bytes = u64::from(u32::from_le_bytes(size));
    let data_start = 8 + size_bytes as u64 + header_bytes;
    if data_start > length || header_bytes > MAX_HEADER_BYTES {
        return Err(FormatError::malformed(
            path,
            format!("the header claims {header_bytes} bytes in a file of {length}"),
            "Copy the file again",
        ));
    }
    let mut text = vec![0; header_bytes as usize];
    reader.read_exact(&mut text).map_err(failed)?;
    let header = std::str::from_utf8(&text).ok().and_then(parse_header).ok_or_else(|| {
        FormatError::malformed(path, "invalid header of a .npy file", "Write it with numpy.save")
    })?;

    // Check what the header promises.
    let Some(element) = parse(&header.descr) else {
        return Err(FormatError::unsupported(
            path,
            format!("the elements are '{}', not {expected}", excerpt(&header.descr)),
            hint,
        ));
    };
    if header.fortran_order {
        return Err(FormatError::unsupported(
            path,
            "the array is in Fortran order",
            "Save numpy.ascontiguousarray(a)",
        ));
    }
    let most_bytes = MAX_IMAGE_BYTES.max(length);
    let count = header.shape.iter().try_fold(1_u64, |count, extent| count.checked_mul(*extent));
    let bytes = count.and_then(|count| count.checked_mul(element.bytes() as u64));
    let Some(bytes) = bytes.filter(|&bytes| bytes <= most_bytes) else {
        let shape = format!("{:?}", header.shape);
        return Err(FormatError::too_large(
            path,
            format!("the array claims the shape {}", excerpt(&shape)),
            format!("{most_bytes} bytes"),
        ));
    };
    if bytes != length - data_start {
        return Err(FormatError::malformed(
            path,
            format!("the shape {:?} needs {bytes} bytes but {} follow", header.shape, length - data_start),
            "Copy the file again",
        ));
    }

    // Convert the values, chunk by chunk.
    let mut values = Vec::with_capacity(bytes as usize / element.bytes());
    let mut chunk = vec![0; CHUNK * element.bytes()];
    let mut left = bytes as usize;
    while left > 0 {
        let now = left.min(chunk.len());
        reader.read_exact(&mut chunk[..now]).map_err(failed)?;
        element.decode(&chunk[..now], &mut values);
        left -= now;
    }
    Ok((header.shape, values))
}

fn not_npy(path: &Path) -> FormatError {
    FormatError::malformed(path, "this is not a NumPy .npy file", "Write it with numpy.save")
}

/// The three entries of a header, each once, in any order. `None` for other text.
fn parse_header(text: &str) -> Option<Header> {
    let mut rest = text.trim().strip_prefix('{')?.strip_suffix('}')?.trim();
    let (mut descr, mut fortran_order, mut shape) = (None, None, None);
    while !rest.is_empty() {
        // Take the name of an entry and its colon.
        let (name, after) = python_string(rest)?;
        let value = after.trim_start().strip_prefix(':')?.trim_start();
        // Take its value.
        rest = match name {
            "descr" if descr.is_none() => {
                // Records have a list of fields instead of a string.
                let (text, after) = if value.starts_with('[') {
                    value.split_at(value.rfind(']')? + 1)
                } else {
                    python_string(value)?
                };
                descr = Some(text.to_owned());
                after
            }
            "fortran_order" if fortran_order.is_none() => {
                let (is, after) = match value.strip_prefix("True") {
                    Some(after) => (true, after),
                    None => (false, value.strip_prefix("False")?),
                };
                fortran_order = Some(is);
                after
            }
            "shape" if shape.is_none() => {
                let (extents, after) = value.strip_prefix('(')?.split_once(')')?;
                shape = Some(python_integers(extents)?);
                after
            }
            _ => return None,
        };
        // Take the comma, which the last entry may lack.
        rest = rest.trim_start();
        rest = match rest.strip_prefix(',') {
            Some(after) => after.trim_start(),
            None if rest.is_empty() => rest,
            None => return None,
        };
    }
    Some(Header { descr: descr?, fortran_order: fortran_order?, shape: shape? })
}

/// A quoted string without escapes at the beginning of a text, and what follows.
fn python_string(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|quote| matches!(quote, '\'' | '"'))?;
    let (inside, after) = text[1..].split_once(quote)?;
    (!inside.contains('\\')).then_some((inside, after))
}

/// The integers inside a tuple: none, or separated by commas, one behind the last allowed and behind an only one required.
/// Those out of range are the largest integer, so that the shape is too large rather than unreadable.
fn python_integers(inside: &str) -> Option<Vec<u64>> {
    let inside = inside.trim();
    if inside.is_empty() {
        return Some(Vec::new());
    }
    let (listed, ends_in_comma) = inside.strip_suffix(',').map_or((inside, false), |listed| (listed, true));
    let integer = |text: &str| {
        // Python 2 marked long integers with an L.
        let digits = text.trim();
        let digits = digits.strip_suffix('L').unwrap_or(digits);
        let is_number = !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit());
        is_number.then(|| digits.parse().unwrap_or(u64::MAX))
    };
    let integers: Vec<u64> = listed.split(',').map(integer).collect::<Option<_>>()?;
    (integers.len() > 1 || ends_in_comma).then_some(integers)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_of(bytes: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        std::fs::write(&path, bytes).unwrap();
        (folder, path)
    }

    fn array(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = NPY_MAGIC.to_vec();
        bytes.extend([version, 0]);
        match version {
            1 => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        bytes.extend(header.bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn arrays_survive_being_written() {
        for shape in [vec![], vec![5], vec![2, 3], vec![3, 1, 2, 20_000], vec![0, 4]] {
            let count = shape.iter().product::<u64>();
            let values: Vec<f32> = (0..count).map(|i| i as f32 - 7.5).collect();
            let mut bytes = Vec::new();
            write_npy(&mut bytes, &shape, &values).unwrap();
            assert_eq!((bytes.len() - 4 * values.len()) % ALIGNMENT, 0);
            let (_folder, path) = file_of(&bytes);
            assert_eq!(read_npy(&path).unwrap(), (shape, values));
        }
    }

    #[test]
    fn files_are_as_numpy_writes_them() {
        // numpy.save("a.npy", numpy.array([[1, 2, 3]], "<f4")), numpy 2.4.
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3), }";
        let expected = array(1, &format!("{header:<117}\n"), b"\0\0\x80\x3f\0\0\0\x40\0\0\x40\x40");
        let mut bytes = Vec::new();
        write_npy(&mut bytes, &[1, 3], &[1.0, 2.0, 3.0]).unwrap();
        assert_eq!(bytes, expected);
    }

    #[test]
    fn either_precision_byte_order_and_version_is_read() {
        let values = [1.5_f32, -2.0, 1e-30];
        let cases: [(&str, Vec<u8>); 4] = [
            ("<f4", values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            (">f4", values.iter().flat_map(|v| v.to_be_bytes()).collect()),
            ("<f8", values.iter().flat_map(|v| f64::from(*v).to_le_bytes()).collect()),
            (">f8", values.iter().flat_map(|v| f64::from(*v).to_be_bytes()).collect()),
        ];
        for (descr, data) in cases {
            for version in 1..=3 {
                let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (3,), }}  \n");
                let (_folder, path) = file_of(&array(version, &header, &data));
                assert_eq!(read_npy(&path).unwrap(), (vec![3], values.to_vec()), "{descr}, {version}");
            }
        }
    }

    #[test]
    fn headers_are_python_dictionaries() {
        let header = |shape: Vec<u64>| Some(Header { descr: "<f4".into(), fortran_order: false, shape });
        for (text, expected) in [
            ("{'descr':'<f4','fortran_order':False,'shape':()}", header(vec![])),
            ("{\"shape\": (4L, 5), 'fortran_order': False, \"descr\": \"<f4\"}\n", header(vec![4, 5])),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (7,) , }", header(vec![7])),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (7), }", None),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (7,,), }", None),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (-7,), }", None),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (7,)", None),
            ("{'descr': '<f4', 'fortran_order': 0, 'shape': (7,)}", None),
            ("{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (7,)}", None),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (7,), 'more': 1}", None),
            ("{'descr': '<f4' 'fortran_order': False, 'shape': (7,)}", None),
            ("{'fortran_order': False, 'shape': (7,)}", None),
            ("{'descr': 'é, 'fortran_order': False, 'shape': (7,)}", None),
            ("{", None),
            ("", None),
        ] {
            assert_eq!(parse_header(text), expected, "{text}");
        }
        let records = "{'descr': [('x', '<f4'), ('y', '<f4')], 'fortran_order': False, 'shape': (7,), }";
        assert_eq!(parse_header(records).unwrap().descr, "[('x', '<f4'), ('y', '<f4')]");
    }
}
