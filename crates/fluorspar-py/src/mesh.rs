//! Meshes.

use std::path::PathBuf;

use fluorspar_format::{read_obj, read_ply, read_stl};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::error::failed;

/// Vertices (m), triangles (three vertex numbers), normals and texture coordinates of a mesh; those that it lacks have no rows.
type Arrays<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
);

/// A mesh from a file, `.ply`, `.obj` or `.stl`, whose unit is `unit_m` meters.
#[pyfunction]
#[pyo3(signature = (path, unit_m = 1.0))]
pub(crate) fn read_mesh(py: Python<'_>, path: PathBuf, unit_m: f64) -> PyResult<Arrays<'_>> {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let mesh = py.detach(|| match ending.as_deref() {
        Some("obj") => read_obj(&path, unit_m),
        Some("stl") => read_stl(&path, unit_m),
        _ => read_ply(&path, unit_m),
    });
    let mesh = mesh.map_err(failed)?;
    let rows = |values: &[[f32; 3]]| -> PyResult<Bound<'_, PyArray2<f32>>> {
        PyArray1::from_slice(py, values.as_flattened()).reshape((values.len(), 3))
    };
    let vertices: Vec<[f32; 3]> = mesh.positions.iter().map(|v| v.to_array()).collect();
    let normals: Vec<[f32; 3]> = mesh.normals.iter().map(|v| v.to_array()).collect();
    let uvs: Vec<f32> = mesh.uvs.iter().flat_map(|uv| uv.to_array()).collect();
    let triangles = PyArray1::from_slice(py, mesh.triangles.as_flattened());
    Ok((
        rows(&vertices)?,
        triangles.reshape((mesh.triangles.len(), 3))?,
        rows(&normals)?,
        PyArray1::from_vec(py, uvs).reshape((mesh.uvs.len(), 2))?,
    ))
}
