//! Writing of MATLAB format 5, little-endian and compressed ("MAT-File Format", The MathWorks, level 5).

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::v5::{class, kind};
use crate::FormatError;
use crate::store::output::{WRITTEN_BY, write_atomically};

/// Bytes for the name of each field of a struct, with the zero that ends it.
const NAME_BYTES: usize = 32;
/// Most bytes of a variable: beyond that MATLAB itself needs format 7.3.
const MOST_BYTES: usize = i32::MAX as usize;

/// What a variable or field holds.
pub(crate) enum MatField {
    Text(String),
    /// Numbers, first dimension fastest.
    Doubles(Vec<usize>, Vec<f64>),
    /// The same in single precision.
    Singles(Vec<usize>, Vec<f32>),
    Struct(Vec<(&'static str, Self)>),
}

impl MatField {
    pub(crate) fn number(value: f64) -> Self {
        Self::Doubles(vec![1, 1], vec![value])
    }

    pub(crate) fn column(values: Vec<f64>) -> Self {
        Self::Doubles(vec![values.len(), 1], values)
    }

    /// The array as an element.
    fn element(&self, name: &str) -> Vec<u8> {
        let (class, dims) = match self {
            Self::Text(text) => (class::CHAR, vec![1, text.encode_utf16().count()]),
            Self::Doubles(dims, _) => (class::FIRST_NUMERIC, dims.clone()),
            Self::Singles(dims, _) => (class::FIRST_NUMERIC + 1, dims.clone()),
            Self::Struct(_) => (class::STRUCT, vec![1, 1]),
        };
        let dims: Vec<u8> = dims.iter().flat_map(|n| (*n as u32).to_le_bytes()).collect();
        let mut content = element(kind::UINT32, &[class.to_le_bytes(), [0; 4]].concat());
        content.extend(element(kind::INT32, &dims));
        content.extend(element(kind::INT8, name.as_bytes()));
        match self {
            Self::Text(text) => {
                let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
                content.extend(element(kind::UTF16, &units));
            }
            Self::Doubles(_, values) => {
                let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
                content.extend(element(kind::DOUBLE, &bytes));
            }
            Self::Singles(_, values) => {
                let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
                content.extend(element(kind::SINGLE, &bytes));
            }
            Self::Struct(fields) => {
                content.extend([kind::INT32 | 4 << 16, NAME_BYTES as u32].map(u32::to_le_bytes).concat());
                let mut names = vec![0; NAME_BYTES * fields.len()];
                for (place, (name, _)) in names.chunks_exact_mut(NAME_BYTES).zip(fields) {
                    place[..name.len()].copy_from_slice(name.as_bytes());
                }
                content.extend(element(kind::INT8, &names));
                fields.iter().for_each(|(_, field)| content.extend(field.element("")));
            }
        }
        element(kind::MATRIX, &content)
    }
}

/// Type, length and content, filled up to a multiple of eight bytes.
fn element(kind: u32, content: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(content.len() + 16);
    bytes.extend(kind.to_le_bytes());
    bytes.extend((content.len() as u32).to_le_bytes());
    bytes.extend_from_slice(content);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// Writes a file with one variable.
///
/// # Errors
/// A variable of 2 GiB or more; a file that can't be written.
pub(crate) fn write_mat(path: &Path, name: &str, field: &MatField) -> Result<(), FormatError> {
    let variable = field.element(name);
    if variable.len() > MOST_BYTES {
        let what = format!("a variable of {} bytes is more than MATLAB format 5 holds", variable.len());
        return Err(FormatError::unwritable(path, what, "Write a .zarr, or fewer bands"));
    }
    write_atomically(path, |file| {
        let mut header = format!("MATLAB 5.0 MAT-file, {WRITTEN_BY}").into_bytes();
        header.resize(124, b' ');
        header.extend(b"\0\x01IM");
        file.write_all(&header)?;
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::fast());
        packed.write_all(&variable)?;
        let packed = packed.finish()?;
        file.write_all(&[kind::COMPRESSED, packed.len() as u32].map(u32::to_le_bytes).concat())?;
        file.write_all(&packed)
    })
}
