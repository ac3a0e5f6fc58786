//! MATLAB format 5 (also called 6 and 7).

use std::path::Path;

use matrw::{MatFile, MatVariable, MatlabType};

use super::{Fields, FormatError, MatValue};

const HEADER_BYTES: usize = 128;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

pub(super) fn read(path: &Path, mut bytes: Vec<u8>) -> Result<Fields, FormatError> {
    check_elements(path, &bytes)?;
    // The decoder knows one spelling of the header text only; other writers omit the comma.
    bytes[19..21].copy_from_slice(b", ");
    let file: MatFile = matrw::load_matfile_from_u8(&bytes).map_err(|error| {
        FormatError::malformed(path, format!("the MATLAB data are damaged: {error}"), "Save the file again")
    })?;
    Ok(file.into_iter().map(|(name, value)| (name, convert(value))).collect())
}

/// Checks that every variable lies inside the file.
fn check_elements(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    let truncated = |what: String| Err(FormatError::malformed(path, what, "Was it copied completely?"));
    if bytes.len() < HEADER_BYTES {
        return truncated(format!("the header has {} of {HEADER_BYTES} bytes", bytes.len()));
    }
    let little = match &bytes[126..128] {
        b"IM" => true,
        b"MI" => false,
        _ => return truncated("the header names no byte order".into()),
    };
    let word = |at: usize| {
        let word = [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        if little { u32::from_le_bytes(word) } else { u32::from_be_bytes(word) }
    };
    let mut at = HEADER_BYTES;
    while at < bytes.len() {
        let left = bytes.len() - at;
        if left < 8 {
            return truncated(format!("the variable at byte {at} is cut off"));
        }
        let (kind, size) = (word(at), word(at + 4) as usize);
        if kind != MATRIX && kind != COMPRESSED {
            return truncated(format!("at byte {at} there is no variable (type {kind})"));
        }
        if size > left - 8 {
            return truncated(format!(
                "the variable at byte {at} claims {size} bytes but {} follow",
                left - 8
            ));
        }
        at += 8 + size;
    }
    Ok(())
}

fn convert(value: MatVariable) -> MatValue {
    match value {
        MatVariable::Compressed(inner) => convert(*inner.value),
        MatVariable::Structure(fields) => {
            MatValue::Struct(fields.value.into_iter().map(|(name, value)| (name, convert(value))).collect())
        }
        MatVariable::StructureArray(array) => array.value.into_iter().next().map_or(MatValue::Other, convert),
        MatVariable::NumericArray(array) if array.value_cmp.is_none() => numbers(array.dim, array.value),
        _ => MatValue::Other,
    }
}

fn numbers(dims: Vec<usize>, value: MatlabType) -> MatValue {
    fn widen<T: Into<f64>>(values: Vec<T>) -> Vec<f64> {
        values.into_iter().map(Into::into).collect()
    }
    let values = match value {
        MatlabType::UTF8(text) | MatlabType::UTF16(text) => {
            return MatValue::Text(text.into_iter().collect());
        }
        MatlabType::U8(values) => widen(values),
        MatlabType::I8(values) => widen(values),
        MatlabType::U16(values) => widen(values),
        MatlabType::I16(values) => widen(values),
        MatlabType::U32(values) => widen(values),
        MatlabType::I32(values) => widen(values),
        MatlabType::U64(values) => values.into_iter().map(|value| value as f64).collect(),
        MatlabType::I64(values) => values.into_iter().map(|value| value as f64).collect(),
        MatlabType::F32(values) => widen(values),
        MatlabType::F64(values) => values,
        MatlabType::BOOL(values) => widen(values),
    };
    MatValue::Numbers { dims, values }
}
