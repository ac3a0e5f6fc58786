//! Component images.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use fluorspar::image::{ComponentImage, LightPath};
use fluorspar_format::{
    ExrCompression, ExrOptions, Provenance, read_component_image, write_component_exr, write_component_npy,
};
use fluorspar_session::FinishedRender;
use numpy::{PyArray1, PyArray2, PyArray3, PyArray4};
use pyo3::prelude::*;

use crate::error::failed;
use crate::experiment::Experiment;
use crate::process::{work_through, write_new};
use crate::view::view;

/// The result of a render: radiance of every light group, reflected and by fluorophore, `[component, row, col, band]`.
#[pyclass(frozen, module = "fluorspar._fluorspar")]
pub(crate) struct Components {
    pub(crate) image: Arc<ComponentImage>,
    /// All bands, once they are asked for, of an image that is stored with fewer.
    radiance: OnceLock<Vec<f32>>,
    pub(crate) provenance: Option<Provenance>,
    /// The experiment that it was rendered from.
    pub(crate) experiment: Option<Py<Experiment>>,
    /// The same for captures.
    pub(crate) render: Arc<FinishedRender>,
}

impl Components {
    /// A component image, where it is from, and the experiment that it was rendered from.
    pub(crate) fn new(
        image: ComponentImage,
        provenance: Option<Provenance>,
        experiment: Option<Py<Experiment>>,
    ) -> Self {
        let image = Arc::new(image);
        let parsed = experiment.as_ref().map(|experiment| experiment.get().parsed.clone());
        let render = Arc::new(FinishedRender::of_image(image.clone(), parsed));
        Self { image, radiance: OnceLock::new(), provenance, experiment, render }
    }

    fn all_bands(&self) -> &[f32] {
        if self.image.bases.is_empty() {
            return &self.image.data;
        }
        self.radiance.get_or_init(|| self.image.all_values().into_owned())
    }

    /// An image with the experiment that it carries.
    fn with_experiment(
        py: Python<'_>,
        image: ComponentImage,
        provenance: Option<Provenance>,
    ) -> PyResult<Self> {
        let experiment = match &provenance {
            None => None,
            Some(provenance) => {
                let text = provenance.resolved_experiment_toml.clone();
                let name = "experiment of the component image".into();
                Some(Py::new(py, Experiment::new(py, text, name, ".".into(), Vec::new())?)?)
            }
        };
        Ok(Self::new(image, provenance, experiment))
    }
}

#[pymethods]
impl Components {
    /// Radiance, `[component, row, col, band]`, W/(sr m2 nm): a view, read-only.
    #[getter]
    fn radiance<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray4<f32>>> {
        let image = &slf.get().image;
        let shape = (image.components.len(), image.height, image.width, image.grid.len());
        view(slf, |this| this.all_bands(), shape)
    }

    /// Distance of what a pixel sees, `[row, col]`, m; infinite where it sees nothing.
    #[getter]
    fn depth_m<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let image = &slf.get().image;
        view(slf, |this| &this.image.features.depth_m, (image.height, image.width))
    }

    /// Number of the part that a pixel sees, `[row, col]`: an index into `part_names` plus one; 0 where it sees nothing.
    #[getter]
    fn part<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<u16>>> {
        let image = &slf.get().image;
        view(slf, |this| &this.image.features.part, (image.height, image.width))
    }

    /// Shading normal, `[row, col, axis]`, in the coordinates of the scene; zero where a pixel sees nothing.
    #[getter]
    fn normal<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let image = &slf.get().image;
        view(slf, |this| this.image.features.normal.as_flattened(), (image.height, image.width, 3))
    }

    /// Names of the parts of the scene.
    #[getter]
    fn part_names(&self) -> Vec<String> {
        self.image.features.part_names.clone()
    }

    /// Centers of the bands, nm.
    #[getter]
    fn wavelengths_nm<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.image.grid.centers_nm())
    }

    /// Edges of the bands, nm: one more than bands.
    #[getter]
    fn edges_nm<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.image.grid.edges_nm())
    }

    /// Label of each component: `blue.reflected`, `blue.fluorescence.collagen`, `blue.multiple`.
    #[getter]
    fn labels(&self) -> Vec<String> {
        self.image.components.iter().map(fluorspar::image::Component::label).collect()
    }

    /// Light group of each component.
    #[getter]
    fn light_groups(&self) -> Vec<String> {
        self.image.components.iter().map(fluorspar::image::Component::group_label).collect()
    }

    /// What happened to the light of each component: `reflected`, the name of a fluorophore, or `multiple`.
    #[getter]
    fn paths(&self) -> Vec<String> {
        let path = |component: &fluorspar::image::Component| match &component.light {
            LightPath::Reflected => "reflected".to_string(),
            LightPath::Fluorescence(name) => name.clone(),
            LightPath::MultipleFluorescence => "multiple".to_string(),
        };
        self.image.components.iter().map(path).collect()
    }

    /// Paths averaged per pixel.
    #[getter]
    fn samples_per_pixel(&self) -> u32 {
        self.image.samples_per_pixel
    }

    /// The experiment that was rendered; `None` where the file carries none.
    #[getter]
    fn experiment(&self, py: Python<'_>) -> Option<Py<Experiment>> {
        self.experiment.as_ref().map(|experiment| experiment.clone_ref(py))
    }

    /// Digest of the experiment that was rendered.
    #[getter]
    fn sha256(&self) -> Option<&str> {
        self.provenance.as_ref().map(|provenance| provenance.experiment_sha256.as_str())
    }

    /// Writes the image: `.exr` (24 bits a value) or `.npy` with a description beside it.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let (image, provenance) = (self.image.clone(), self.provenance.clone());
        let is_npy = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npy"));
        work_through(py, None, move || {
            write_new(&path, &["exr", "npy"], || match is_npy {
                true => write_component_npy(&path, &image, provenance.as_ref()),
                false => {
                    let (compression, provenance) = (ExrCompression::Rounded24, provenance.as_ref());
                    let options = ExrOptions { compression, provenance, ..Default::default() };
                    write_component_exr(&path, &image, &options)
                }
            })
        })?
    }
}

/// A component image from a file: `.exr` or `.npy`.
#[pyfunction]
pub(crate) fn read_components(py: Python<'_>, path: PathBuf) -> PyResult<Components> {
    let loaded = work_through(py, None, move || read_component_image(&path))?.map_err(failed)?;
    Components::with_experiment(py, loaded.image, loaded.provenance)
}
