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
use fluorspar_cli::{RenderedScene, coarse_image, dark_frames};
use fluorspar_experiment::{
    Experiment as Parsed, ExperimentError, ResolvedExperiment, cached_analysis, with_sampling_of,
};
use fluorspar_format::{read_sensor_image, write_sensor_tiff};
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

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

/// What a frame is made of.
type Parts = (SensorImage, Option<CapturedFrame>, Option<ColorRendering>);

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

    /// What pickles: the frame as bytes, which the same version of the package reads.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let (py, frame) = (slf.py(), slf.get());
        let parts = (env!("CARGO_PKG_VERSION"), &frame.raw, &frame.captured, &frame.colors);
        let bytes = py.detach(|| postcard::to_stdvec(&parts)).map_err(failed)?;
        Ok((py.get_type::<Self>().getattr("of_bytes")?, (PyBytes::new(py, &bytes),)))
    }

    /// A frame from the bytes of its pickle.
    #[staticmethod]
    fn of_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Self> {
        let unreadable = |error| failed(format!("the bytes are no pickled frame: {error}"));
        let (version, rest): (String, _) = postcard::take_from_bytes(bytes).map_err(unreadable)?;
        let own = env!("CARGO_PKG_VERSION");
        if version != own {
            return Err(failed(format!(
                "the frame was pickled by fluorspar {version}, and this is {own}: keep frames as files (Frame.write)"
            )));
        }
        let (raw, captured, colors) =
            py.detach(|| postcard::from_bytes::<Parts>(rest)).map_err(unreadable)?;
        Ok(Self { raw, captured, colors, preview: OnceLock::new() })
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
pub(crate) struct CachedPlanes(Mutex<Vec<FormedPlanes>>);

/// Channel planes, and of which components they were formed: the others are dark.
#[derive(Clone)]
struct FormedPlanes {
    planes: ChannelPlanes,
    formed: Vec<bool>,
}

/// Components whose planes are asked for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Asked<'a> {
    /// Those under a light that some capture of the camera switches on.
    Lit,
    /// In the camera of one capture those under a light that it switches on.
    LitBy(&'a str),
    /// In the camera of one capture all.
    AllOf(&'a str),
}

impl Asked<'_> {
    /// Whether a capture asks for components under a light group.
    fn asks(self, capture: &Capture, group: &str) -> bool {
        let is_lit = || capture.frame.drive(group) != 0.0;
        match self {
            Self::Lit => is_lit(),
            Self::LitBy(name) => capture.frame.label == name && is_lit(),
            Self::AllOf(name) => capture.frame.label == name,
        }
    }
}

impl CachedPlanes {
    /// Cameras whose planes are kept.
    const MOST: usize = 4;

    /// The planes of the captures of a study, with changed concentrations.
    fn of_captures(
        &self,
        study: &Study,
        image: &ComponentImage,
        factors: &mut ComponentFactors,
        asked: Asked<'_>,
    ) -> Result<CapturePlanes, PipelineError> {
        let CaptureResponses { responses, of_capture } =
            CaptureResponses::new(study, &study.captures, image)?;
        let film = responses.first().ok_or(PipelineError::Missing("captures"))?.film();
        let is_asked = |response: usize, component: usize| {
            let group = &image.components[component].light_group;
            let mut own = study.captures.iter().zip(&of_capture).filter(|(_, of)| **of == response);
            own.any(|(capture, _)| asked.asks(capture, group))
        };
        let planes = self.of_cameras(&responses, image, is_asked);
        let planes = CapturePlanes { planes, of_capture: of_capture.clone(), film };
        let seen = (image, study.captures.as_slice());
        let Ok((planes, _)) = planes.with_concentrations(&responses, seen, factors, image, |_| true);
        Ok(planes)
    }

    /// The planes of cameras: those that are kept, and new ones of other cameras and of components that nobody has asked for.
    fn of_cameras(
        &self,
        responses: &[FilmResponse],
        image: &ComponentImage,
        is_asked: impl Fn(usize, usize) -> bool,
    ) -> Vec<ChannelPlanes> {
        let count = image.components.len();
        let kept = |response: &FilmResponse| {
            let kept = self.0.lock().ok()?;
            kept.iter().find(|one| one.planes.camera == response.camera()).cloned()
        };
        let new =
            |response: &FilmResponse| FormedPlanes { planes: response.dark(), formed: vec![false; count] };
        let mut all: Vec<FormedPlanes> =
            responses.iter().map(|response| kept(response).unwrap_or_else(|| new(response))).collect();
        let is_missing = |number: usize, of: &FormedPlanes| {
            (0..count).any(|component| !of.formed[component] && is_asked(number, component))
        };
        let missing: Vec<usize> =
            (0..all.len()).filter(|number| is_missing(*number, &all[*number])).collect();
        if !missing.is_empty() {
            let wanted: Vec<bool> = (0..count)
                .map(|c| missing.iter().any(|number| !all[*number].formed[c] && is_asked(*number, c)))
                .collect();
            let cameras: Vec<&FilmResponse> = missing.iter().map(|number| &responses[*number]).collect();
            let Ok(formed) = FilmResponse::planes(&cameras, |component| wanted[component], image);
            for (number, new) in missing.iter().zip(formed) {
                all[*number].add(new, &wanted);
            }
        }
        if let Ok(mut kept) = self.0.lock() {
            for number in missing {
                kept.retain(|one| one.planes.camera != responses[number].camera());
                kept.push(all[number].clone());
            }
            let surplus = kept.len().saturating_sub(Self::MOST);
            kept.drain(..surplus);
        }
        all.into_iter().map(|one| one.planes).collect()
    }
}

impl FormedPlanes {
    /// Takes over the planes of components that are formed now.
    fn add(&mut self, new: ChannelPlanes, is_new: &[bool]) {
        if !self.formed.contains(&true) {
            self.planes = new;
        } else {
            for component in
                (0..is_new.len()).filter(|component| is_new[*component] && !self.formed[*component])
            {
                for channel in 0..new.channels {
                    self.planes.plane_mut(component, channel).copy_from_slice(new.plane(component, channel));
                }
            }
        }
        self.formed.iter_mut().zip(is_new).for_each(|(formed, is_new)| *formed |= is_new);
    }
}

/// A component image as the captures of a study see it.
pub(crate) struct View {
    experiment: ResolvedExperiment,
    image: Arc<ComponentImage>,
    factors: ComponentFactors,
    planes: CapturePlanes,
}

impl View {
    fn new(
        experiment: ResolvedExperiment,
        image: Arc<ComponentImage>,
        mut factors: ComponentFactors,
        (kept, asked): (&CachedPlanes, Asked<'_>),
    ) -> Result<Self, ViewError> {
        let planes = kept.of_captures(&experiment.study, &image, &mut factors, asked)?;
        Ok(Self { experiment, image, factors, planes })
    }

    /// The view of a finished render whose scene is that of an experiment, with the study that `complete` makes of its captures; nothing is
    /// meshed. `None` where more has changed.
    fn without_surfaces(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        threads: Option<usize>,
        asked: Asked<'_>,
        complete: impl FnOnce(Study) -> Study + Send,
    ) -> PyResult<Option<Self>> {
        let Some(rendered) = rendered_for(components, experiment) else { return Ok(None) };
        let image = components.image.clone();
        let found = work_through(py, threads, || {
            let scene = RenderedScene { labels: &image, experiment: Some(&rendered) };
            let Some((found, changes)) = scene.captures::<ViewError>(&experiment.parsed)? else {
                return Ok(None);
            };
            check_captures(&found.study, &image)?;
            let ResolvedExperiment { study, record } = found.into_resolved(&experiment.parsed);
            let found = ResolvedExperiment { study: complete(study), record };
            Self::new(found, image, changes.factors, (&components.planes, asked)).map(Some)
        })?;
        found.map_err(|error: ViewError| error.raised(py))
    }

    /// The view of an analysis of which was kept what it asks of surfaces. `None` where nothing was kept.
    pub(crate) fn of_cached_analysis(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        threads: Option<usize>,
    ) -> PyResult<Option<Self>> {
        let Some(kept) = cached_analysis(&experiment.parsed) else { return Ok(None) };
        Self::without_surfaces(py, experiment, components, threads, Asked::Lit, |study| kept.complete(study))
    }

    /// The view of the captures of an experiment, with its surfaces only where the scene has changed.
    pub(crate) fn of_captures(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        asked: Asked<'_>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let without = Self::without_surfaces(py, experiment, components, threads, asked, |study| study)?;
        match without {
            Some(view) => Ok(view),
            None => Self::whole(py, experiment, components, (true, asked), threads),
        }
    }

    /// The view of an experiment with all its surfaces, as its analysis needs it.
    pub(crate) fn whole(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        (is_same, asked): (bool, Asked<'_>),
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let image = components.image.clone();
        let rendered = rendered_for(components, experiment);
        let resolved = experiment.resolved(py, threads)?;
        let made = work_through(py, threads, || {
            check_captures(&resolved.study, &image)?;
            let scene = RenderedScene { labels: &image, experiment: rendered.as_deref() };
            // Images in memory have no excitation basis
            let changes = scene.changes::<ViewError>(&experiment.parsed, &resolved, is_same, || Ok(None))?;
            Self::new((*resolved).clone(), image, changes.factors, (&components.planes, asked))
        })?;
        made.map_err(|error| error.raised(py))
    }

    /// The experiment whose captures see the image.
    pub(crate) fn experiment(&self) -> &ResolvedExperiment {
        &self.experiment
    }

    /// What the view is of.
    pub(crate) fn study(&self) -> &Study {
        &self.experiment.study
    }

    /// Subtracts no frame that is not given; returns as [`subtract_what_is_given`].
    pub(crate) fn subtract_what_is_given(
        &mut self,
        is_given: impl Fn(&str) -> bool,
    ) -> Vec<(String, String)> {
        subtract_what_is_given(&mut self.experiment.study, is_given)
    }

    /// The channel planes of the camera of a capture.
    pub(crate) fn planes_of(&self, capture: &str) -> Option<&ChannelPlanes> {
        let number = self.study().captures.iter().position(|settings| settings.frame.label == capture)?;
        self.planes.planes.get(*self.planes.of_capture.get(number)?)
    }

    pub(crate) fn seen(&self) -> SeenComponents<'_> {
        SeenComponents {
            image: &self.image,
            planes: &self.planes,
            captures: &self.study().captures,
            factors: &self.factors,
        }
    }

    /// The frames of all captures, and what they may be mistaken for.
    fn frames(&self, rendered: Option<&Parsed>) -> Result<(Vec<Frame>, Vec<String>), PipelineError> {
        let study = self.study();
        let frames = capture_from_planes(study, &self.seen())?;
        let mut warnings = Vec::new();
        if self.image.denoised.is_some() {
            warnings.push("the component image is denoised: its frames are for display only".into());
        }
        warnings.extend(coarse_image(&self.image, rendered, study).map(|warning| warning.to_string()));
        warnings.extend(dark_frames(&self.experiment, &frames));
        let frame = |(captured, settings): (CapturedFrame, &Capture)| Frame {
            colors: Some(ColorRendering::of_frame(study, settings)),
            preview: OnceLock::new(),
            raw: captured.raw.clone(),
            captured: Some(captured),
        };
        Ok((frames.into_iter().zip(&study.captures).map(frame).collect(), warnings))
    }
}

/// The experiment that an image was rendered from, for one that wants to see it: with how many samples and within which limits it was
/// rendered, which a call may say for itself, is no difference between the two.
fn rendered_for(components: &Components, now: &Experiment) -> Option<Arc<Parsed>> {
    let rendered = &components.experiment.as_ref()?.get().parsed;
    match rendered.file.render == now.parsed.file.render {
        true => Some(rendered.clone()),
        false => Some(Arc::new(with_sampling_of(rendered, &now.parsed))),
    }
}

/// Takes the frames of an experiment's captures of a component image; returns with them what they may be mistaken for.
#[pyfunction]
#[pyo3(signature = (experiment, components, *, threads = None))]
pub(crate) fn capture(
    experiment: &Bound<'_, Experiment>,
    components: &Bound<'_, Components>,
    threads: Option<usize>,
) -> PyResult<(Vec<Frame>, Vec<String>)> {
    let py = experiment.py();
    let view = View::of_captures(py, experiment.get(), components.get(), Asked::Lit, threads)?;
    let rendered = components.get().experiment.as_ref().map(|rendered| rendered.get().parsed.clone());
    work_through(py, threads, || view.frames(rendered.as_deref()))?.map_err(failed)
}

/// Refuses an experiment whose captures can't be taken of a component image, before any is taken.
#[pyfunction]
#[pyo3(signature = (experiment, components, *, threads = None))]
pub(crate) fn check_capture(
    experiment: &Bound<'_, Experiment>,
    components: &Bound<'_, Components>,
    threads: Option<usize>,
) -> PyResult<()> {
    let (py, experiment, components) = (experiment.py(), experiment.get(), components.get());
    let (rendered, image) = (rendered_for(components, experiment), &components.image);
    let scene = RenderedScene { labels: image, experiment: rendered.as_deref() };
    let without_surfaces = || -> Result<bool, ViewError> {
        let Some((found, _)) = scene.captures::<ViewError>(&experiment.parsed)? else { return Ok(false) };
        check_captures(&found.study, image)?;
        Ok(true)
    };
    if work_through(py, threads, without_surfaces)?.map_err(|error| error.raised(py))? {
        return Ok(());
    }
    let resolved = experiment.resolved(py, threads)?;
    let with_surfaces = || -> Result<(), ViewError> {
        check_captures(&resolved.study, image)?;
        scene.changes::<ViewError>(&experiment.parsed, &resolved, true, || Ok(None)).map(|_| ())
    };
    work_through(py, threads, with_surfaces)?.map_err(|error| error.raised(py))
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
