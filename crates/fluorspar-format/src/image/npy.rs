//! NumPy arrays: spectral and component images as f32 `.npy` with a JSON description next to them.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::exr::{read_component_exr, read_spectral_exr};
use crate::npy_array::{NPY_MAGIC, read_npy, write_npy};
use crate::store::file::{check_image_size, read_sidecar, sidecar_path, write_sidecar};
use crate::store::input::read_start;
use crate::store::output::write_atomically;
use crate::{FileFormat, FormatError, Loaded, Provenance};
use fluorspar::image::{Component, ComponentImage, FeatureMaps, SpectralImage};
use fluorspar::quote::excerpt;
use fluorspar::spectral::{Quantity, Radiance, WavelengthGrid};

const SPECTRAL_AXES: [&str; 3] = ["row", "col", "band"];
const COMPONENT_AXES: [&str; 4] = ["component", "row", "col", "band"];

/// Contents of the JSON description of a `.npy` file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    format: u32,
    /// What wrote the file: it may be replaced where this program did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    program: Option<String>,
    quantity: String,
    unit: String,
    axes: Vec<String>,
    shape: Vec<u64>,
    wavelength_edges_nm: Vec<f64>,
    wavelength_centers_nm: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    components: Option<Vec<Component>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    samples_per_pixel: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    denoised: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    provenance: Option<Provenance>,
}

/// Writes `[row, col, band]` as little-endian f32 `.npy`, and its description to `PATH.json`.
///
/// # Errors
/// When a file can't be written.
pub fn write_spectral_npy<Q: Quantity>(
    path: &Path,
    image: &SpectralImage<Q>,
    provenance: Option<&Provenance>,
) -> Result<(), FormatError> {
    let grid = image.grid();
    let description = Description {
        format: FileFormat::ARRAY.version(),
        program: Some("fluorspar".into()),
        quantity: Q::NAME.into(),
        unit: Q::UNIT.into(),
        axes: SPECTRAL_AXES.map(String::from).to_vec(),
        shape: [image.height(), image.width(), image.bands()].map(|n| n as u64).to_vec(),
        wavelength_edges_nm: grid.edges_nm().to_vec(),
        wavelength_centers_nm: grid.centers_nm(),
        components: None,
        samples_per_pixel: None,
        denoised: None,
        provenance: provenance.cloned(),
    };
    write_array(path, &description, image.data())
}

/// Writes `[component, row, col, band]` as little-endian f32 `.npy`, and its description to `PATH.json`. Feature
/// maps are not kept: write OpenEXR for them.
///
/// # Errors
/// When a file can't be written.
pub fn write_component_npy(
    path: &Path,
    image: &ComponentImage,
    provenance: Option<&Provenance>,
) -> Result<(), FormatError> {
    let shape = [image.components.len(), image.height, image.width, image.grid.len()];
    let description = Description {
        format: FileFormat::ARRAY.version(),
        program: Some("fluorspar".into()),
        quantity: Radiance::NAME.into(),
        unit: Radiance::UNIT.into(),
        axes: COMPONENT_AXES.map(String::from).to_vec(),
        shape: shape.map(|n| n as u64).to_vec(),
        wavelength_edges_nm: image.grid.edges_nm().to_vec(),
        wavelength_centers_nm: image.grid.centers_nm(),
        components: Some(image.components.clone()),
        samples_per_pixel: Some(image.samples_per_pixel),
        denoised: image.denoised.clone(),
        provenance: provenance.cloned(),
    };
    write_array(path, &description, &image.all_values())
}

/// Writes numbers, the last axis of `shape` fastest, as little-endian f32 `.npy`, without a description: `[row, col]` is a map.
///
/// # Errors
/// When the file can't be written, or the numbers do not fill the shape.
pub fn write_map_npy(path: &Path, shape: &[usize], values: &[f32]) -> Result<(), FormatError> {
    if values.len() != shape.iter().product::<usize>() {
        let what = format!("{} values do not fill an array of shape {shape:?}", values.len());
        return Err(FormatError::unwritable(path, what, "Give one value per pixel"));
    }
    let shape: Vec<u64> = shape.iter().map(|extent| *extent as u64).collect();
    write_atomically(path, |writer: &mut BufWriter<File>| write_npy(writer, &shape, values))
}

fn write_array(path: &Path, description: &Description, data: &[f32]) -> Result<(), FormatError> {
    if description.shape.iter().product::<u64>() != data.len() as u64 {
        return Err(FormatError::unwritable(
            path,
            format!("{} values do not fill an array of shape {:?}", data.len(), description.shape),
            "Give one value per component, row, column and band",
        ));
    }
    write_atomically(path, |writer: &mut BufWriter<File>| write_npy(writer, &description.shape, data))?;
    write_sidecar(path, description)
}

/// Reads what [`write_spectral_npy`] wrote.
///
/// # Errors
/// A missing or mismatched description, another quantity, another element type or axis order, damaged files.
pub fn read_spectral_npy<Q: Quantity>(path: &Path) -> Result<Loaded<SpectralImage<Q>>, FormatError> {
    let (description, grid, data) = read_array(path, &SPECTRAL_AXES, Q::NAME, Q::UNIT)?;
    let [height, width] = [0, 1].map(|axis| description.shape[axis] as usize);
    let image = SpectralImage::from_data(grid, width, height, data)
        .map_err(|error| FormatError::malformed(path, error.to_string(), "Write the file again"))?;
    Ok(Loaded { image, provenance: description.provenance })
}

/// Reads what [`write_component_npy`] wrote; the feature maps are empty.
///
/// # Errors
/// As [`read_spectral_npy`].
pub fn read_component_npy(path: &Path) -> Result<Loaded<ComponentImage>, FormatError> {
    let (description, grid, data) = read_array(path, &COMPONENT_AXES, Radiance::NAME, Radiance::UNIT)?;
    let components = description.components.unwrap_or_default();
    if components.len() as u64 != description.shape[0] {
        return Err(FormatError::malformed(
            &sidecar_path(path),
            format!(
                "{} components are described but the array holds {}",
                components.len(),
                description.shape[0]
            ),
            "Restore the description as it was written",
        ));
    }
    let image = ComponentImage {
        grid,
        height: description.shape[1] as usize,
        width: description.shape[2] as usize,
        components,
        bases: Vec::new(),
        data,
        samples_per_pixel: description.samples_per_pixel.unwrap_or(0),
        samples: Vec::new(),
        features: FeatureMaps::default(),
        statistics: None,
        denoised: description.denoised,
    };
    Ok(Loaded { image, provenance: description.provenance })
}

/// Whether the description of an array says that it is a component image.
pub fn is_component_npy(path: &Path) -> bool {
    let read = read_sidecar::<Description>(path, &FileFormat::ARRAY);
    read.is_ok_and(|description| description.axes == COMPONENT_AXES)
}

/// Reads a component image in either form, known by how the file begins.
///
/// # Errors
/// As [`read_component_exr`] and [`read_component_npy`].
pub fn read_component_image(path: &Path) -> Result<Loaded<ComponentImage>, FormatError> {
    if is_npy(path)? { read_component_npy(path) } else { read_component_exr(path) }
}

/// Reads a spectral image in either form, known by how the file begins.
///
/// # Errors
/// As [`read_spectral_exr`] and [`read_spectral_npy`].
pub fn read_spectral_image<Q: Quantity>(path: &Path) -> Result<Loaded<SpectralImage<Q>>, FormatError> {
    if is_npy(path)? { read_spectral_npy(path) } else { read_spectral_exr(path) }
}

pub(crate) fn is_npy(path: &Path) -> Result<bool, FormatError> {
    Ok(read_start(path, NPY_MAGIC.len() as u64)? == NPY_MAGIC)
}

fn read_array(
    path: &Path,
    axes: &[&str],
    quantity: &str,
    unit: &str,
) -> Result<(Description, WavelengthGrid, Vec<f32>), FormatError> {
    let (shape, data) = read_npy(path)?;
    let description: Description = read_sidecar(path, &FileFormat::ARRAY)?;
    let sidecar = sidecar_path(path);
    let mismatch = |what: String, hint: &str| Err(FormatError::malformed(&sidecar, what, hint));
    if description.axes != axes {
        return mismatch(
            format!("the axes are {}, not {}", excerpt(&description.axes.join(", ")), axes.join(", ")),
            "Read it as what it is: radiance has three axes, its components four",
        );
    }
    if description.quantity != quantity || description.unit != unit {
        return Err(FormatError::unit(
            &sidecar,
            format!(
                "the file holds {} in {}, not {quantity} in {unit}",
                description.quantity, description.unit
            ),
            "Read it as what it is",
        ));
    }
    if description.shape != shape || shape.len() != axes.len() {
        return mismatch(
            format!("the description has shape {:?} but the array has {shape:?}", description.shape),
            "Keep the two files of one run together",
        );
    }
    let grid = match WavelengthGrid::from_edges(&description.wavelength_edges_nm) {
        Ok(grid) => grid,
        Err(error) => return mismatch(error.to_string(), "Restore the description as it was written"),
    };
    if shape[axes.len() - 1] != grid.len() as u64 {
        return mismatch(
            format!("there are {} bands but {} wavelength bins", shape[axes.len() - 1], grid.len()),
            "Restore the description as it was written",
        );
    }
    check_image_size(
        path,
        shape[axes.len() - 2],
        shape[axes.len() - 3],
        4 * shape[axes.len() - 1],
        u64::MAX,
    )?;
    check_finite(path, &data)?;
    Ok((description, grid, data))
}

/// Refuses values of an image that are no numbers, which a frame would show as black.
pub(super) fn check_finite(path: &Path, values: &[f32]) -> Result<(), FormatError> {
    // All are looked at: that is faster than to end at the first
    if values.iter().fold(true, |all, value| all & value.is_finite()) {
        return Ok(());
    }
    let value = values.iter().find(|value| !value.is_finite()).unwrap_or(&f32::NAN);
    let what = format!("a value is {value} in 32 bits");
    Err(FormatError::malformed(path, what, "Put 0 where nothing was measured"))
}
