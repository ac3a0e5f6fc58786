//! Pictures.

use std::path::PathBuf;

use fluorspar_format::write_rgb_png;
use numpy::PyReadonlyArray3;
use pyo3::prelude::*;

use crate::error::failed;

/// Writes a picture, `[row, col, rgb]`, as PNG.
#[pyfunction]
pub(crate) fn write_png(path: PathBuf, picture: PyReadonlyArray3<'_, u8>) -> PyResult<()> {
    let picture = picture.as_array();
    let (height, width, _) = picture.dim();
    let values: Vec<u8> = picture.iter().copied().collect();
    write_rgb_png(&path, width, height, &values).map_err(failed)
}
