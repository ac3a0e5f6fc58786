//! MATLAB format 7.3: HDF5 with conventions of its own.

use std::path::Path;

use hdf5_pure::{AttrValue, DType, Dataset, Error, File, Group};

use super::{Fields, FormatError, MatLimits, MatValue};
use crate::store::file::check_packing;
use fluorspar::quote::excerpt;

/// Structs inside structs that are followed.
const MAX_DEPTH: usize = 8;
/// Most variables and fields.
const MAX_ENTRIES: usize = 10_000;

pub(super) fn read(path: &Path, bytes: Vec<u8>, limits: MatLimits) -> Result<Fields, FormatError> {
    let mut left = Left { length: bytes.len() as u64, values: limits.values, entries: MAX_ENTRIES, limits };
    let file = File::from_bytes(bytes).map_err(|error| damaged(path, &error))?;
    read_group(path, &file.root(), 0, &mut left)
}

/// What a file may still hold.
struct Left {
    /// Bytes of the file.
    length: u64,
    values: u64,
    entries: usize,
    limits: MatLimits,
}

fn damaged(path: &Path, error: &Error) -> FormatError {
    const HINT: &str =
        "If the file is incomplete, copy it again; otherwise save it in MATLAB with save(..., '-v7')";
    FormatError::malformed(path, format!("the MATLAB 7.3 data can't be read: {error}"), HINT)
}

fn read_group(path: &Path, group: &Group, depth: usize, left: &mut Left) -> Result<Fields, FormatError> {
    let failed = |error: Error| damaged(path, &error);
    let mut fields = Fields::new();
    for name in group.datasets().map_err(failed)? {
        let value = read_dataset(path, &name, &group.dataset(&name).map_err(failed)?, left)?;
        fields.push((name, value));
    }
    for name in group.groups().map_err(failed)? {
        // `#refs#` and `#subsystem#` hold what cells and objects point to.
        if name.starts_with('#') || depth == MAX_DEPTH {
            continue;
        }
        let inner = read_group(path, &group.group(&name).map_err(failed)?, depth + 1, left)?;
        fields.push((name, MatValue::Struct(inner)));
    }
    Ok(fields)
}

fn read_dataset(
    path: &Path,
    name: &str,
    dataset: &Dataset,
    left: &mut Left,
) -> Result<MatValue, FormatError> {
    let failed = |error: Error| damaged(path, &error);
    let shape = dataset.shape().map_err(failed)?;
    let count = shape.iter().try_fold(1_u64, |product, &n| product.checked_mul(n)).unwrap_or(u64::MAX);
    left.values = left.values.checked_sub(count).ok_or_else(|| {
        let what = format!("\"{}\" claims the size {shape:?}", excerpt(name));
        FormatError::too_large(path, what, format!("{} values in all", left.limits.values))
    })?;
    left.entries = left.entries.checked_sub(1).ok_or_else(|| {
        FormatError::too_large(path, "the file holds too many variables and fields", format!("{MAX_ENTRIES}"))
    })?;
    check_packing(path, count, left.length)?;
    let attributes = dataset.attrs().map_err(failed)?;
    let is_text = matches!(attributes.get("MATLAB_class"), Some(class) if text_of(class) == Some("char"));
    // An empty array stores its size as data.
    if attributes.contains_key("MATLAB_empty") {
        let empty = MatValue::Numbers { dims: vec![0, 0], values: Vec::new() };
        return Ok(if is_text { MatValue::Text(String::new()) } else { empty });
    }
    Ok(match dataset.dtype().map_err(failed)? {
        DType::U8 | DType::U16 | DType::U32 if is_text => {
            let units: Vec<u16> =
                dataset.read_u32().map_err(failed)?.into_iter().map(|unit| unit as u16).collect();
            MatValue::Text(String::from_utf16_lossy(&units))
        }
        DType::F32
        | DType::F64
        | DType::I8
        | DType::I16
        | DType::I32
        | DType::I64
        | DType::U8
        | DType::U16
        | DType::U32
        | DType::U64 => {
            // HDF5 counts the last dimension fastest, MATLAB the first: the order of the values is the same.
            let dims = shape.iter().rev().map(|&n| n as usize).collect();
            MatValue::Numbers { dims, values: dataset.read_f64().map_err(failed)? }
        }
        DType::String | DType::VariableLengthString => {
            MatValue::Text(dataset.read_string().map_err(failed)?.into_iter().next().unwrap_or_default())
        }
        _ => MatValue::Other("an array of another type"),
    })
}

fn text_of(value: &AttrValue) -> Option<&str> {
    match value {
        AttrValue::String(text) | AttrValue::AsciiString(text) => Some(text),
        _ => None,
    }
}
