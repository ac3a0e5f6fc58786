//! Raw frames.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock};

use fluorspar::image::{ChannelPlanes, ComponentFactors, ComponentImage, SensorImage};
use fluorspar::pipeline::{
    CapturePlanes, CaptureResponses, CapturedFrame, ColorRendering, FilmResponse, PipelineError, Preview,
    SeenComponents, capture_from_planes, check_captures, preview, subtract_what_is_given,
};
use fluorspar::study::{Capture, Study};
use fluorspar_cli::RenderedScene;
use fluorspar_experiment::ExperimentError;
use fluorspar_experiment::kept_analysis;
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
    /// How people see it; `None` of a frame from a file.
    colors: Option<ColorRendering>,
    /// Made when it is first looked at.
    preview: OnceLock<Preview>,
}

impl Frame {
    /// An image for people; `None` of a frame from a file.
    fn shown(&self) -> Option<&Preview> {
        let (captured, colors) = (self.captured.as_ref()?, self.colors.as_ref()?);
        Some(self.preview.get_or_init(|| preview(&captured.developed, colors)))
    }
}

#[pymethods]
impl Frame {
    /// Name of the capture.
    #[getter]
    fn name(&self) -> &str {
        &self.raw.label
    }

    /// Digital numbers, `[row, col]`, of a frame from a file that holds all channels in every pixel these side by side: a view, read-only.
    #[getter]
    fn raw<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<u16>>> {
        let raw = &slf.get().raw;
        view(slf, |this| &this.raw.data, (raw.height, raw.data.len() / raw.height.max(1)))
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
        let frame = slf.get();
        let made = match frame.preview.get() {
            Some(made) => Some(made),
            None => work_through(slf.py(), None, || frame.shown())?,
        };
        let Some(preview) = made else { return Ok(None) };
        let shape = (preview.height, preview.width, 3);
        view(slf, |this| this.shown().map_or(&[], |preview| &preview.rgb), shape).map(Some)
    }

    /// Writes the raw frame as TIFF with its description beside it.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| write_sensor_tiff(&path, &self.raw, None)).map_err(failed)
    }
}

/// Why an image does not show what an experiment wants.
enum ViewError {
    Experiment(ExperimentError),
    Pipeline(PipelineError),
}

impl ViewError {
    fn raised(self, py: Python<'_>) -> PyErr {
        match self {
            Self::Experiment(error) => of_experiment(py, &error),
            Self::Pipeline(error) => failed(error),
        }
    }
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

/// Channel planes of some cameras, so that other exposures, drives and concentrations need no spectra.
#[derive(Default)]
pub(crate) struct KeptPlanes(Mutex<Vec<ChannelPlanes>>);

impl KeptPlanes {
    /// Cameras whose planes are kept.
    const MOST: usize = 4;

    /// The planes of the captures of a study, with changed concentrations.
    fn of_captures(
        &self,
        study: &Study,
        image: &ComponentImage,
        factors: &mut ComponentFactors,
    ) -> Result<CapturePlanes, PipelineError> {
        let CaptureResponses { responses, of_capture } =
            CaptureResponses::new(study, &study.captures, image)?;
        let film = responses.first().ok_or(PipelineError::Missing("captures"))?.film();
        let planes = CapturePlanes { planes: self.of_cameras(&responses, image), of_capture, film };
        let seen = (image, study.captures.as_slice());
        let Ok((planes, _)) = planes.with_concentrations(&responses, seen, factors, image, |_| true);
        Ok(planes)
    }

    /// The planes of cameras: those that are kept, and new ones of the others.
    fn of_cameras(&self, responses: &[FilmResponse], image: &ComponentImage) -> Vec<ChannelPlanes> {
        let kept = |camera: &str| {
            self.0.lock().ok().and_then(|kept| kept.iter().find(|planes| planes.camera == camera).cloned())
        };
        let held: Vec<Option<ChannelPlanes>> =
            responses.iter().map(|response| kept(response.camera())).collect();
        let missing: Vec<&FilmResponse> = responses
            .iter()
            .zip(&held)
            .filter(|(_, held)| held.is_none())
            .map(|(response, _)| response)
            .collect();
        let formed = match missing.is_empty() {
            true => Vec::new(),
            false => {
                let Ok(formed) = FilmResponse::planes(&missing, |_| true, image);
                formed
            }
        };
        if let Ok(mut kept) = self.0.lock() {
            kept.extend(formed.iter().cloned());
            let surplus = kept.len().saturating_sub(Self::MOST);
            kept.drain(..surplus);
        }
        let mut formed = formed.into_iter();
        held.into_iter().filter_map(|held| held.or_else(|| formed.next())).collect()
    }
}

/// A component image as the captures of a study see it.
pub(crate) struct View {
    study: Study,
    image: Arc<ComponentImage>,
    factors: ComponentFactors,
    planes: CapturePlanes,
}

impl View {
    fn new(
        study: Study,
        image: Arc<ComponentImage>,
        mut factors: ComponentFactors,
        kept: &KeptPlanes,
    ) -> Result<Self, ViewError> {
        let planes = kept.of_captures(&study, &image, &mut factors)?;
        Ok(Self { study, image, factors, planes })
    }

    /// The view of a finished render whose scene is that of an experiment, with the study that `complete` makes of its captures; nothing is
    /// meshed. `None` where more has changed.
    fn without_surfaces(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        threads: Option<usize>,
        complete: impl FnOnce(Study) -> Study + Send,
    ) -> PyResult<Option<Self>> {
        let Some(rendered) = &components.experiment else { return Ok(None) };
        let (image, rendered) = (components.image.clone(), rendered.get().parsed.clone());
        let found = work_through(py, threads, || {
            let scene = RenderedScene { labels: &image, experiment: Some(&rendered) };
            let Some((found, changes)) = scene.captures::<ViewError>(&experiment.parsed)? else {
                return Ok(None);
            };
            check_captures(&found.study, &image)?;
            Self::new(complete(found.study), image, changes.factors, &components.planes).map(Some)
        })?;
        found.map_err(|error: ViewError| error.raised(py))
    }

    /// The view of an analysis of which was kept what it asks of surfaces. `None` where nothing was kept.
    pub(crate) fn of_kept_analysis(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        threads: Option<usize>,
    ) -> PyResult<Option<Self>> {
        let Some(kept) = kept_analysis(&experiment.parsed) else { return Ok(None) };
        Self::without_surfaces(py, experiment, components, threads, |study| kept.complete(study))
    }

    /// The view of the captures of an experiment, with its surfaces only where the scene has changed.
    pub(crate) fn of_captures(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        if let Some(view) = Self::without_surfaces(py, experiment, components, threads, |study| study)? {
            return Ok(view);
        }
        Self::whole(py, experiment, components, true, threads)
    }

    /// The view of an experiment with all its surfaces, as its analysis needs it.
    pub(crate) fn whole(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        is_same: bool,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let image = components.image.clone();
        let rendered = components.experiment.as_ref().map(|experiment| experiment.get().parsed.clone());
        let resolved = experiment.resolved(py, threads)?;
        let made = work_through(py, threads, || {
            check_captures(&resolved.study, &image)?;
            let scene = RenderedScene { labels: &image, experiment: rendered.as_deref() };
            // Images in memory have no excitation basis
            let changes = scene.changes::<ViewError>(&experiment.parsed, &resolved, is_same, || Ok(None))?;
            Self::new(resolved.study.clone(), image, changes.factors, &components.planes)
        })?;
        made.map_err(|error| error.raised(py))
    }

    /// What the view is of.
    pub(crate) fn study(&self) -> &Study {
        &self.study
    }

    /// Subtracts no frame that is not given; returns as [`subtract_what_is_given`].
    pub(crate) fn subtract_what_is_given(
        &mut self,
        is_given: impl Fn(&str) -> bool,
    ) -> Vec<(String, String)> {
        subtract_what_is_given(&mut self.study, is_given)
    }

    /// The channel planes of the camera of a capture.
    pub(crate) fn planes_of(&self, capture: &str) -> Option<&ChannelPlanes> {
        let number = self.study.captures.iter().position(|settings| settings.frame.label == capture)?;
        self.planes.planes.get(*self.planes.of_capture.get(number)?)
    }

    pub(crate) fn seen(&self) -> SeenComponents<'_> {
        SeenComponents {
            image: &self.image,
            planes: &self.planes,
            captures: &self.study.captures,
            factors: &self.factors,
        }
    }

    fn frames(&self) -> Result<Vec<Frame>, PipelineError> {
        let frames = capture_from_planes(&self.study, &self.seen())?;
        let frame = |(captured, settings): (CapturedFrame, &Capture)| Frame {
            colors: Some(ColorRendering::of_frame(&self.study, settings)),
            preview: OnceLock::new(),
            raw: captured.raw.clone(),
            captured: Some(captured),
        };
        Ok(frames.into_iter().zip(&self.study.captures).map(frame).collect())
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
    let view = View::of_captures(py, experiment.get(), components.get(), threads)?;
    work_through(py, threads, || view.frames())?.map_err(failed)
}

/// A raw frame from a file: TIFF, PNG, DNG or packed.
#[pyfunction]
#[pyo3(signature = (path, name = None))]
pub(crate) fn read_frame(py: Python<'_>, path: PathBuf, name: Option<String>) -> PyResult<Frame> {
    let mut raw = py.detach(|| read_sensor_image(&path)).map_err(failed)?.image;
    if let Some(name) = name {
        raw.label = name;
    }
    Ok(Frame { raw, captured: None, colors: None, preview: OnceLock::new() })
}
