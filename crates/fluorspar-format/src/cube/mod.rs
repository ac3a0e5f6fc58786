//! Spectral cubes in the forms of other programs, `[y, x, wavelength]`.

mod envi;
mod iset;
pub(crate) mod ome_tiff;
pub(crate) mod ome_zarr;
mod zarr;

use std::path::{Path, PathBuf};

use crate::table::spectra::NOISE;
use crate::{
    ExrOptions, FormatError, Provenance, read_spectral_image, write_spectral_exr, write_spectral_npy,
};
use fluorspar::image::{FeatureMaps, SpectralImage};
use fluorspar::spectral::{Irradiance, Quantity, Radiance, WavelengthGrid};

pub use zarr::write_component_zarr;

/// The values of a cube.
#[derive(Clone, Debug, PartialEq)]
pub enum CubeLight {
    /// Radiance toward the camera.
    Radiance(SpectralImage<Radiance>),
    /// Irradiance on the film.
    Irradiance(SpectralImage<Irradiance>),
}

/// Calls something with the image, whatever its quantity.
macro_rules! of_light {
    ($light:expr, $image:ident => $what:expr) => {
        match $light {
            CubeLight::Radiance($image) => $what,
            CubeLight::Irradiance($image) => $what,
        }
    };
}

impl CubeLight {
    /// The wavelength grid.
    pub fn grid(&self) -> &WavelengthGrid {
        of_light!(self, image => image.grid())
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        of_light!(self, image => [image.width(), image.height()])
    }

    /// All values, `[y, x, wavelength]`.
    pub fn values(&self) -> &[f32] {
        of_light!(self, image => image.data())
    }

    fn is_radiance(&self) -> bool {
        matches!(self, Self::Radiance(_))
    }

    fn unit(&self) -> &'static str {
        if self.is_radiance() { Radiance::UNIT } else { Irradiance::UNIT }
    }
}

/// What travels along with a cube.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CubeFacts {
    /// Title.
    pub title: String,
    /// Capture whose light it is.
    pub capture: Option<String>,
    /// What each pixel sees, and the camera.
    pub maps: FeatureMaps,
    /// Camera matrix ([`fluorspar::image::View::matrix_px`]).
    pub camera_matrix_px: Option<[[f64; 3]; 3]>,
    /// Millimeters per pixel: of irradiance on the film, of radiance at [`Self::distance_m`].
    pub mm_per_pixel: Option<f64>,
    /// Distance of what is seen along the axis (median), m.
    pub distance_m: Option<f64>,
    /// Paths averaged per pixel; the fewest of any pixel.
    pub samples_per_pixel: Option<u32>,
    /// Where the cube comes from.
    pub provenance: Option<Provenance>,
}

impl CubeFacts {
    /// Facts of an image of so many columns and rows: camera matrix, scale and distance follow from its maps.
    pub fn of_maps(maps: FeatureMaps, [width, height]: [usize; 2]) -> Self {
        let distance_m = maps.median_distance_m(width);
        let camera_matrix_px = maps.view.map(|view| view.matrix_px(width, height));
        let mm_per_pixel =
            distance_m.zip(camera_matrix_px).map(|(distance, matrix)| 1e3 * distance / matrix[0][0]);
        Self { maps, camera_matrix_px, mm_per_pixel, distance_m, ..Self::default() }
    }
}

/// A spectral cube.
#[derive(Clone, Debug, PartialEq)]
pub struct Cube {
    /// Its values.
    pub light: CubeLight,
    /// What is known beside them.
    pub facts: CubeFacts,
}

/// Forms of cubes, known by the ends of names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CubeForm {
    /// Zarr version 3, a folder: `.zarr`.
    Zarr,
    /// ENVI, a header `.hdr` and values `.dat`.
    Envi,
    /// A scene or an optical image of ISETCam: `.mat`.
    Iset,
    /// One page for each band: `.ome.tiff`, `.ome.tif`.
    OmeTiff,
    /// Spectral OpenEXR: `.exr`.
    Exr,
    /// NumPy with a description: `.npy`.
    Npy,
}

impl CubeForm {
    /// The form that a name tells.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let forms = [
            (".zarr", Self::Zarr),
            (".hdr", Self::Envi),
            (".mat", Self::Iset),
            (".ome.tiff", Self::OmeTiff),
            (".ome.tif", Self::OmeTiff),
            (".exr", Self::Exr),
            (".npy", Self::Npy),
        ];
        forms.into_iter().find(|(ending, _)| name.ends_with(ending)).map(|(_, form)| form)
    }

    /// The files of a cube: more than one of ENVI, whose maps are images of their own.
    pub fn files(self, path: &Path, facts: &CubeFacts) -> Vec<PathBuf> {
        if self == Self::Envi { envi::files(path, facts) } else { vec![path.to_path_buf()] }
    }

    /// Writes a cube; [`Self::Zarr`] into a folder that is there.
    ///
    /// # Errors
    /// Values that the form can't hold; a file that can't be written.
    pub fn write(self, path: &Path, cube: &Cube) -> Result<(), FormatError> {
        let provenance = cube.facts.provenance.as_ref();
        let exr = ExrOptions { provenance, ..Default::default() };
        match self {
            Self::Zarr => zarr::write_zarr(path, cube),
            Self::Envi => envi::write_envi(path, cube),
            Self::Iset => iset::write_iset(path, cube),
            Self::OmeTiff => ome_tiff::write_cube(path, cube),
            Self::Exr => of_light!(&cube.light, image => write_spectral_exr(path, image, &exr)),
            Self::Npy => of_light!(&cube.light, image => write_spectral_npy(path, image, provenance)),
        }
    }
}

/// Reads a cube: ENVI, a scene or an optical image of ISETCam, radiance or irradiance as OpenEXR or NumPy.
///
/// # Errors
/// Another form; no wavelengths or no unit; of ENVI and ISETCam, values below 0 that are no noise; a damaged file.
pub fn read_cube(path: &Path) -> Result<Cube, FormatError> {
    let form = CubeForm::of(path);
    match form {
        Some(CubeForm::Envi) => envi::read_envi(path),
        Some(CubeForm::Iset) => iset::read_iset(path),
        Some(CubeForm::Exr | CubeForm::Npy) => {
            let of = |provenance| CubeFacts { provenance, ..CubeFacts::default() };
            match read_spectral_image::<Radiance>(path) {
                Ok(loaded) => {
                    Ok(Cube { light: CubeLight::Radiance(loaded.image), facts: of(loaded.provenance) })
                }
                Err(error) => match read_spectral_image::<Irradiance>(path) {
                    Ok(film) => {
                        Ok(Cube { light: CubeLight::Irradiance(film.image), facts: of(film.provenance) })
                    }
                    Err(_) => Err(error),
                },
            }
        }
        _ => Err(FormatError::unsupported(
            path,
            form.map_or("this is no cube", |_| "Zarr and OME-TIFF are written, not read"),
            "Read are ENVI (.hdr), scenes of ISETCam (.mat), OpenEXR (.exr) and NumPy (.npy)",
        )),
    }
}

/// Values as an image. Some below 0 are noise, as in tables of spectra.
fn image_of<Q: Quantity>(
    path: &Path,
    grid: &WavelengthGrid,
    [width, height]: [usize; 2],
    values: Vec<f32>,
) -> Result<SpectralImage<Q>, FormatError> {
    let beyond = |sign: f32| {
        let sizes = || values.iter().map(|value| f64::from((sign * value).max(0.0)));
        [sizes().sum(), sizes().fold(0.0, f64::max)]
    };
    let (below, above) = (beyond(-1.0), beyond(1.0));
    if [0, 1].iter().all(|k| below[*k] > NOISE * above[*k]) {
        let (count, lowest) = (values.iter().filter(|value| **value < 0.0).count(), -below[1]);
        let what = format!("{count} of {} values are below 0, as far as {lowest:.2e}", values.len());
        let hint = "Check data type, gains and offsets, and put 0 where nothing was measured";
        return Err(FormatError::malformed(path, what, hint));
    }
    SpectralImage::from_data(grid.clone(), width, height, values)
        .map_err(|error| FormatError::malformed(path, error.to_string(), "Write the file again"))
}
