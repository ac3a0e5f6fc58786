//! Raw frames.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use fluorspar::image::{ComponentFactors, ComponentImage, SensorImage};
use fluorspar::pipeline::{
    CapturePlanes, CapturedFrame, ColorRendering, PipelineError, Preview, SeenComponents,
    capture_from_planes, check_captures, check_same_scene, concentration_factors, preview, relight,
    scale_multiple,
};
use fluorspar::study::Study;
use fluorspar_experiment::schema::ConcentrationFactor;
use fluorspar_experiment::{
    Experiment as Parsed, ExperimentError, ResolvedExperiment, resolve, resolve_rendered,
};
use fluorspar_format::{read_sensor_image, write_sensor_tiff};
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::components::Components;
use crate::error::{failed, of_experiment};
use crate::experiment::Experiment;
use crate::process::work_through;
use crate::view::view;

/// A frame: raw digital numbers on the mosaic, and linear channels.
#[pyclass(frozen, module = "fluorspar._fluorspar")]
pub(crate) struct Frame {
    pub(crate) raw: SensorImage,
    /// Raw and developed; `None` of a frame from a file.
    pub(crate) captured: Option<CapturedFrame>,
    preview: Option<Preview>,
}

#[pymethods]
impl Frame {
    /// Name of the capture.
    #[getter]
    fn name(&self) -> &str {
        &self.raw.label
    }

    /// Digital numbers, `[row, col]`: a view, read-only.
    #[getter]
    fn raw<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<u16>>> {
        let raw = &slf.get().raw;
        view(slf, |this| &this.raw.data, (raw.height, raw.width))
    }

    /// Linear channels, black subtracted, `[row, col, channel]`, DN; `None` of a frame from a file.
    #[getter]
    fn developed<'py>(slf: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray3<f32>>>> {
        let Some(captured) = &slf.get().captured else { return Ok(None) };
        let image = &captured.developed;
        let shape = (image.height, image.width, image.channels.len());
        view(slf, |this| this.captured.as_ref().map_or(&[], |captured| &captured.developed.data), shape)
            .map(Some)
    }

    /// Names of the channels.
    #[getter]
    fn channels(&self) -> Vec<String> {
        self.raw.mosaic.channels.clone()
    }

    /// Repeating cell of the color filter array: names of channels by row.
    #[getter]
    fn mosaic(&self) -> Vec<Vec<String>> {
        let mosaic = &self.raw.mosaic;
        let row = |row: usize| {
            (0..mosaic.cols).map(|col| mosaic.channels[mosaic.channel(row, col)].clone()).collect()
        };
        (0..mosaic.rows).map(row).collect()
    }

    /// Numbers that scale the frame, by name.
    #[getter]
    fn scale(&self) -> BTreeMap<&'static str, f64> {
        let raw = &self.raw;
        BTreeMap::from([
            ("black_level_dn", raw.black_level),
            ("white_level_dn", f64::from(raw.white_level)),
            ("bit_depth", f64::from(raw.bit_depth)),
            ("exposure_s", raw.exposure_s),
            ("gain", raw.gain),
            ("dn_per_electron", raw.dn_per_electron),
            ("read_noise_dn", raw.read_noise_dn),
        ])
    }

    /// An image for people, sRGB, `[row, col, rgb]`; `None` of a frame from a file.
    #[getter]
    fn preview<'py>(slf: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        let Some(preview) = &slf.get().preview else { return Ok(None) };
        let shape = (preview.height, preview.width, 3);
        view(slf, |this| this.preview.as_ref().map_or(&[], |preview| &preview.rgb), shape).map(Some)
    }

    /// Writes the raw frame as TIFF with its description beside it.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| write_sensor_tiff(&path, &self.raw, None)).map_err(failed)
    }
}

/// Factors that make a component image show the scene of an experiment: `rendered` is the one that it was rendered from.
///
/// # Errors
/// A scene that only a new render can show, if `is_same` is demanded.
fn factors_of(
    rendered: Option<&Parsed>,
    now: &Parsed,
    resolved: &ResolvedExperiment,
    image: &ComponentImage,
    is_same: bool,
) -> Result<ComponentFactors, ViewError> {
    let study = &resolved.study;
    let Some(rendered) = rendered else {
        return Ok(concentration_factors(&BTreeMap::new(), study, image)?);
    };
    let even = |(name, factor): (&String, &ConcentrationFactor)| match factor {
        ConcentrationFactor::Even(factor) => Some((name.clone(), *factor)),
        ConcentrationFactor::Painted(_) => None,
    };
    let concentrations = rendered.file.concentration.iter().filter_map(even).collect();
    let rendered_study = match resolve_rendered(rendered, now, resolved)? {
        Some(study) => study,
        None => {
            // Factors on concentrations are no difference of the scenes
            let mut rendered = rendered.clone();
            rendered.file.concentration.clone_from(&now.file.concentration);
            resolve(&rendered)?.study
        }
    };
    let (shown, light) = relight(&rendered_study, study, image)?;
    if is_same {
        check_same_scene(&shown, study)?;
    }
    Ok(concentration_factors(&concentrations, study, image)?.times(light.even))
}

/// Why an image does not show what an experiment wants.
enum ViewError {
    Experiment(ExperimentError),
    Pipeline(PipelineError),
}

impl From<ExperimentError> for ViewError {
    fn from(error: ExperimentError) -> Self {
        Self::Experiment(error)
    }
}

impl From<PipelineError> for ViewError {
    fn from(error: PipelineError) -> Self {
        Self::Pipeline(error)
    }
}

/// What the captures of an experiment see of a component image.
pub(crate) struct View {
    image: Arc<ComponentImage>,
    factors: ComponentFactors,
    planes: CapturePlanes,
}

impl View {
    /// The view of the captures of an experiment.
    pub(crate) fn new(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        is_same: bool,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let image = components.image.clone();
        let rendered = components.experiment.as_ref().map(|experiment| experiment.get().parsed.clone());
        let (now, resolved) = (experiment.parsed.clone(), experiment.resolved(py, threads)?);
        let made = work_through(py, threads, move || {
            let study = &resolved.study;
            check_captures(study, &image)?;
            let mut factors = factors_of(rendered.as_deref(), &now, &resolved, &image, is_same)?;
            let planes = CapturePlanes::new(study, &image)?;
            if let Some(brightest) = planes.planes.first() {
                scale_multiple(&mut factors, &image, brightest);
            }
            Ok::<_, ViewError>(Self { image, factors, planes })
        })?;
        made.map_err(|error| match error {
            ViewError::Experiment(error) => of_experiment(py, &error),
            ViewError::Pipeline(error) => failed(error),
        })
    }

    pub(crate) fn seen<'a>(&'a self, study: &'a Study) -> SeenComponents<'a> {
        SeenComponents {
            image: &self.image,
            planes: &self.planes,
            captures: &study.captures,
            factors: &self.factors,
        }
    }
}

/// Takes the frames of an experiment's captures of a component image.
#[pyfunction]
#[pyo3(signature = (experiment, components, *, threads = None))]
pub(crate) fn capture(
    experiment: &Bound<'_, Experiment>,
    components: &Bound<'_, Components>,
    threads: Option<usize>,
) -> PyResult<Vec<Frame>> {
    let py = experiment.py();
    let resolved = experiment.get().resolved(py, threads)?;
    let seen = View::new(py, experiment.get(), components.get(), true, threads)?;
    let frames = work_through(py, threads, move || {
        let study = &resolved.study;
        let frames = capture_from_planes(study, &seen.seen(study))?;
        let frame = |(captured, settings): (CapturedFrame, &fluorspar::study::Capture)| Frame {
            preview: Some(preview(&captured.developed, &ColorRendering::of_frame(study, settings))),
            raw: captured.raw.clone(),
            captured: Some(captured),
        };
        Ok::<_, PipelineError>(frames.into_iter().zip(&study.captures).map(frame).collect())
    })?;
    frames.map_err(failed)
}

/// A raw frame from a file: TIFF, PNG, DNG or packed.
#[pyfunction]
#[pyo3(signature = (path, name = None))]
pub(crate) fn read_frame(py: Python<'_>, path: PathBuf, name: Option<String>) -> PyResult<Frame> {
    let mut raw = py.detach(|| read_sensor_image(&path)).map_err(failed)?.image;
    if let Some(name) = name {
        raw.label = name;
    }
    Ok(Frame { raw, captured: None, preview: None })
}
