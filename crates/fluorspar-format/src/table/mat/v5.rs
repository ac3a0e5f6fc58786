//! MATLAB format 5 (also called 6 and 7), after "MAT-File Format", The MathWorks, level 5.
//!
//! Nothing is allocated before its size is known to lie within the file, or within [`MatLimits`] for compressed
//! variables; structs are followed to a fixed depth. Cells, objects, sparse and complex arrays are named, not read.

use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::{Fields, FormatError, MatLimits, MatValue};
use fluorspar::quote::excerpt;

const HEADER_BYTES: usize = 128;
/// Most variables and fields in a file.
const MAX_ENTRIES: usize = 100_000;
/// Structs inside structs.
const MAX_DEPTH: usize = 32;

/// Types of elements: "MAT-File Format", table 1-1.
pub(super) mod kind {
    pub(in super::super) const INT8: u32 = 1;
    pub(in super::super) const UINT8: u32 = 2;
    pub(in super::super) const INT16: u32 = 3;
    pub(in super::super) const UINT16: u32 = 4;
    pub(in super::super) const INT32: u32 = 5;
    pub(in super::super) const UINT32: u32 = 6;
    pub(in super::super) const SINGLE: u32 = 7;
    pub(in super::super) const DOUBLE: u32 = 9;
    pub(in super::super) const INT64: u32 = 12;
    pub(in super::super) const UINT64: u32 = 13;
    pub(in super::super) const MATRIX: u32 = 14;
    pub(in super::super) const COMPRESSED: u32 = 15;
    pub(in super::super) const UTF8: u32 = 16;
    pub(in super::super) const UTF16: u32 = 17;
    pub(in super::super) const UTF32: u32 = 18;
}

/// Classes of arrays: "MAT-File Format", table 1-3, and what later versions added.
pub(super) mod class {
    pub(in super::super) const CELL: u32 = 1;
    pub(in super::super) const STRUCT: u32 = 2;
    pub(in super::super) const CHAR: u32 = 4;
    pub(in super::super) const SPARSE: u32 = 5;
    pub(in super::super) const FIRST_NUMERIC: u32 = 6;
    pub(in super::super) const LAST_NUMERIC: u32 = 15;
    pub(in super::super) const OPAQUE: u32 = 17;
}

/// Flag of an array with imaginary parts.
const COMPLEX: u32 = 0x0800;

/// Reads all variables of a file whose first bytes say that it is of this format.
///
/// # Errors
/// A file that ends too early, sizes that don't fit, damaged compression, more than the limits above.
pub(super) fn read(path: &Path, bytes: &[u8], limits: MatLimits) -> Result<Fields, FormatError> {
    let damaged = |what: String| FormatError::malformed(path, what, "Copy the file again");
    if bytes.len() < HEADER_BYTES {
        return Err(damaged(format!("the header has {} of {HEADER_BYTES} bytes", bytes.len())));
    }
    let order = match &bytes[126..HEADER_BYTES] {
        b"IM" => Order::Little,
        b"MI" => Order::Big,
        _ => return Err(damaged("the header names no byte order".into())),
    };
    let mut left =
        Left { values: limits.values as usize, entries: MAX_ENTRIES, inflated: limits.inflated(), limits };
    let mut fields = Fields::new();
    let mut at = HEADER_BYTES;
    while at < bytes.len() {
        let rest = &bytes[at..];
        let (Some(kind), Some(size)) = (order.word(rest), rest.get(4..).and_then(|rest| order.word(rest)))
        else {
            return Err(damaged(format!("the variable at byte {at} is cut off")));
        };
        if kind != kind::MATRIX && kind != kind::COMPRESSED {
            return Err(damaged(format!("at byte {at} there is no variable (type {kind})")));
        }
        let Some(content) = rest[8..].get(..size as usize) else {
            let follow = rest.len() - 8;
            return Err(damaged(format!(
                "the variable at byte {at} claims {size} bytes but {follow} follow"
            )));
        };
        let variable = if kind == kind::COMPRESSED {
            inflated(content, order, &mut left)
        } else {
            matrix(content, order, 0, &mut left)
        };
        fields.push(variable.map_err(|fault| match fault {
            Fault::Damaged(what) => damaged(format!("the variable at byte {at} is damaged: {what}")),
            Fault::TooLarge { what, limit } => FormatError::too_large(path, what, limit),
        })?);
        at += 8 + content.len();
    }
    Ok(fields)
}

/// Why a variable can't be read.
enum Fault {
    Damaged(String),
    TooLarge { what: &'static str, limit: String },
}

fn damaged<T>(what: impl Into<String>) -> Result<T, Fault> {
    Err(Fault::Damaged(what.into()))
}

/// What the rest of a file may still take.
struct Left {
    values: usize,
    entries: usize,
    inflated: usize,
    limits: MatLimits,
}

impl Left {
    fn take_values(&mut self, count: usize) -> Result<(), Fault> {
        let limit = || format!("{} values", self.limits.values);
        let left = self.values.checked_sub(count);
        self.values = left
            .ok_or_else(|| Fault::TooLarge { what: "the variables hold too many numbers", limit: limit() })?;
        Ok(())
    }

    fn take_entry(&mut self) -> Result<(), Fault> {
        let limit = || format!("{MAX_ENTRIES}");
        self.entries = self.entries.checked_sub(1).ok_or_else(|| Fault::TooLarge {
            what: "the file holds too many variables and fields",
            limit: limit(),
        })?;
        Ok(())
    }
}

#[derive(Clone, Copy)]
enum Order {
    Little,
    Big,
}

impl Order {
    /// The first four bytes as a number.
    fn word(self, bytes: &[u8]) -> Option<u32> {
        let word = *bytes.first_chunk()?;
        Some(match self {
            Self::Little => u32::from_le_bytes(word),
            Self::Big => u32::from_be_bytes(word),
        })
    }

    fn words(self, bytes: &[u8]) -> impl Iterator<Item = u32> {
        bytes.chunks_exact(4).filter_map(move |word| self.word(word))
    }

    fn halves(self, bytes: &[u8]) -> Vec<u16> {
        self.convert(bytes, u16::from_le_bytes, u16::from_be_bytes)
    }

    fn convert<const N: usize, T>(
        self,
        bytes: &[u8],
        little: impl Fn([u8; N]) -> T,
        big: impl Fn([u8; N]) -> T,
    ) -> Vec<T> {
        let (chunks, _) = bytes.as_chunks::<N>();
        match self {
            Self::Little => chunks.iter().map(|chunk| little(*chunk)).collect(),
            Self::Big => chunks.iter().map(|chunk| big(*chunk)).collect(),
        }
    }
}

/// Elements one after the other, each with its type.
struct Elements<'b> {
    bytes: &'b [u8],
    order: Order,
}

impl<'b> Elements<'b> {
    /// The next element; elements of up to four bytes may be packed into their tag.
    fn next(&mut self, what: &str) -> Result<(u32, &'b [u8]), Fault> {
        let missing = || Fault::Damaged(format!("{what} missing"));
        let tag = self.order.word(self.bytes).ok_or_else(missing)?;
        let (kind, start, size) = if tag >> 16 == 0 {
            let size = self.bytes.get(4..).and_then(|rest| self.order.word(rest)).ok_or_else(missing)?;
            (tag, 8, size as usize)
        } else {
            (tag & 0xffff, 4, (tag >> 16) as usize)
        };
        let left = self.bytes.len() - start;
        if size > left || (start == 4 && size > 4) {
            return damaged(format!("{what}: {size} bytes are claimed but {left} follow"));
        }
        let content = &self.bytes[start..start + size];
        // The last one may lack its padding.
        let end = (start + size).next_multiple_of(8).min(self.bytes.len());
        self.bytes = &self.bytes[end..];
        Ok((kind, content))
    }

    fn expect(&mut self, wanted: u32, what: &str) -> Result<&'b [u8], Fault> {
        let (kind, content) = self.next(what)?;
        if kind == wanted { Ok(content) } else { damaged(format!("{what}: elements of type {kind}")) }
    }

    fn name(&mut self, what: &str) -> Result<String, Fault> {
        let (_, content) = self.next(what)?;
        Ok(String::from_utf8_lossy(content).into_owned())
    }
}

/// A compressed variable.
fn inflated(content: &[u8], order: Order, left: &mut Left) -> Result<(String, MatValue), Fault> {
    let mut bytes = Vec::new();
    let most = left.inflated as u64 + 1;
    if let Err(error) = ZlibDecoder::new(content).take(most).read_to_end(&mut bytes) {
        return damaged(format!("it can't be unpacked: {error}"));
    }
    let rest = left.inflated.checked_sub(bytes.len());
    left.inflated = rest.ok_or_else(|| Fault::TooLarge {
        what: "the variables are too large when decompressed",
        limit: format!("{} bytes", left.limits.inflated()),
    })?;
    let mut elements = Elements { bytes: &bytes, order };
    matrix(elements.expect(kind::MATRIX, "the array is")?, order, 0, left)
}

/// Name and value of the array in an element.
fn matrix(content: &[u8], order: Order, depth: usize, left: &mut Left) -> Result<(String, MatValue), Fault> {
    left.take_entry()?;
    if content.is_empty() {
        return Ok((String::new(), MatValue::Numbers { dims: vec![0, 0], values: Vec::new() }));
    }
    if depth > MAX_DEPTH {
        return damaged(format!("structs lie in structs more than {MAX_DEPTH} deep"));
    }
    let mut elements = Elements { bytes: content, order };
    let flags = elements.expect(kind::UINT32, "the flags are")?;
    let Some(flags) = order.word(flags) else { return damaged("the flags are missing") };
    let class = flags & 0xff;
    if class == class::OPAQUE {
        return Ok((elements.name("the name is")?, MatValue::Other("an object")));
    }
    let dims: Vec<usize> =
        order.words(elements.expect(kind::INT32, "the size is")?).map(|n| n as usize).collect();
    let name = elements.name("the name is")?;
    let fits = |n: &usize| i32::try_from(*n).is_ok();
    let count = dims.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
    let Some(count) = count.filter(|_| (2..=MAX_DEPTH).contains(&dims.len()) && dims.iter().all(fits)) else {
        return damaged(format!("\"{}\" has an impossible size", excerpt(&name)));
    };
    let of_it = |fault: Fault| match fault {
        Fault::Damaged(what) => Fault::Damaged(format!("\"{}\": {what}", excerpt(&name))),
        other => other,
    };
    let value = match class {
        class::CELL => MatValue::Other("a list of cells"),
        class::STRUCT => first_struct(&mut elements, count, depth, left).map_err(of_it)?,
        class::CHAR => text(&mut elements, &dims, left).map_err(of_it)?,
        class::SPARSE => MatValue::Other("a sparse matrix"),
        class::FIRST_NUMERIC..=class::LAST_NUMERIC if flags & COMPLEX != 0 => {
            MatValue::Other("an array of complex numbers")
        }
        class::FIRST_NUMERIC..=class::LAST_NUMERIC => {
            MatValue::Numbers { values: numbers(&mut elements, count, left).map_err(of_it)?, dims }
        }
        _ => MatValue::Other("an object"),
    };
    Ok((name, value))
}

/// The first struct of an array of `count`.
fn first_struct(
    elements: &mut Elements<'_>,
    count: usize,
    depth: usize,
    left: &mut Left,
) -> Result<MatValue, Fault> {
    let order = elements.order;
    let length = order.word(elements.expect(kind::INT32, "the length of field names is")?).unwrap_or(0);
    let names = elements.expect(kind::INT8, "field names are")?;
    if length == 0 && !names.is_empty() {
        return damaged("field names have no length");
    }
    let mut fields = Fields::new();
    if count > 0 {
        for name in names.chunks_exact((length as usize).max(1)) {
            let name = name.split(|&byte| byte == 0).next().unwrap_or_default();
            let content = elements.expect(kind::MATRIX, "a field is")?;
            let (_, value) = matrix(content, order, depth + 1, left)?;
            fields.push((String::from_utf8_lossy(name).into_owned(), value));
        }
    }
    Ok(MatValue::Struct(fields))
}

/// A text; lines of an array of several rows one after the other.
fn text(elements: &mut Elements<'_>, dims: &[usize], left: &mut Left) -> Result<MatValue, Fault> {
    let order = elements.order;
    let (kind, content) = elements.next("the letters are")?;
    left.take_values(content.len())?;
    let utf16 = |units: Vec<u16>| String::from_utf16_lossy(&units).chars().collect();
    let letters: Vec<char> = match kind {
        kind::UTF8 => String::from_utf8_lossy(content).chars().collect(),
        kind::UINT8 | kind::INT8 => content.iter().map(|byte| char::from(*byte)).collect(),
        kind::UTF16 | kind::UINT16 => utf16(order.halves(content)),
        kind::UTF32 | kind::UINT32 => {
            order.words(content).map(|c| char::from_u32(c).unwrap_or('\u{fffd}')).collect()
        }
        _ => return damaged(format!("letters of type {kind}")),
    };
    let rows = dims[0];
    // Lines without letters are as many as the file claims
    if rows < 2 || letters.is_empty() || rows * dims[1] != letters.len() {
        return Ok(MatValue::Text(letters.into_iter().collect()));
    }
    let line = |row: usize| letters.iter().skip(row).step_by(rows).collect::<String>();
    let lines: Vec<String> = (0..rows).map(|row| line(row).trim_end().to_string()).collect();
    Ok(MatValue::Text(lines.join("\n")))
}

/// Real numbers, of whatever type they are stored in.
fn numbers(elements: &mut Elements<'_>, count: usize, left: &mut Left) -> Result<Vec<f64>, Fault> {
    fn widen<T: Into<f64>>(values: Vec<T>) -> Vec<f64> {
        values.into_iter().map(Into::into).collect()
    }
    let order = elements.order;
    let (kind, bytes) = elements.next("the numbers are")?;
    let width = match kind {
        kind::INT8 | kind::UINT8 => 1,
        kind::INT16 | kind::UINT16 => 2,
        kind::INT32 | kind::UINT32 | kind::SINGLE => 4,
        kind::DOUBLE | kind::INT64 | kind::UINT64 => 8,
        _ => return damaged(format!("numbers of type {kind}")),
    };
    if count.checked_mul(width) != Some(bytes.len()) {
        return damaged(format!("{} bytes hold {count} numbers of {width} bytes", bytes.len()));
    }
    left.take_values(count)?;
    Ok(match kind {
        kind::INT8 => bytes.iter().map(|byte| f64::from(byte.cast_signed())).collect(),
        kind::UINT8 => bytes.iter().map(|byte| f64::from(*byte)).collect(),
        kind::INT16 => widen(order.convert(bytes, i16::from_le_bytes, i16::from_be_bytes)),
        kind::UINT16 => widen(order.halves(bytes)),
        kind::INT32 => widen(order.convert(bytes, i32::from_le_bytes, i32::from_be_bytes)),
        kind::UINT32 => order.words(bytes).map(f64::from).collect(),
        kind::SINGLE => widen(order.convert(bytes, f32::from_le_bytes, f32::from_be_bytes)),
        kind::INT64 => order.convert(
            bytes,
            |eight| i64::from_le_bytes(eight) as f64,
            |eight| i64::from_be_bytes(eight) as f64,
        ),
        kind::UINT64 => order.convert(
            bytes,
            |eight| u64::from_le_bytes(eight) as f64,
            |eight| u64::from_be_bytes(eight) as f64,
        ),
        _ => order.convert(bytes, f64::from_le_bytes, f64::from_be_bytes),
    })
}
