//! Raw frames.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use fluorspar::image::{ChannelPlanes, SensorImage};
use fluorspar::pipeline::{
    CapturedFrame, ColorRendering, Preview, SeenComponents, capture_from_planes, check_captures, preview,
    subtract_what_is_given,
};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::{ResolvedExperiment, cached_analysis};
use fluorspar_format::{DescribedFrame, read_described_frame, write_sensor_tiff};
use fluorspar_report::dark_frames;
use fluorspar_session::{CaptureView, Error, FinishedRender, ShownExperiment, Wanted, image_warnings};
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::components::Components;
use crate::error::{failed, of_session};
use crate::experiment::Experiment;
use crate::process::{work_through, write_new};
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
        py.detach(|| write_new(&path, &["tiff", "tif"], || write_sensor_tiff(&path, &self.raw, None)))
    }
}

/// A component image as the captures of a study see it.
pub(crate) struct View {
    experiment: ResolvedExperiment,
    render: Arc<FinishedRender>,
    view: CaptureView,
}

impl View {
    fn new(
        render: Arc<FinishedRender>,
        ShownExperiment { experiment, changes }: ShownExperiment<'_>,
        wanted: Wanted<'_>,
    ) -> Result<Self, Error> {
        let study = &experiment.study;
        check_captures(study, render.labels())?;
        let view = render.seen_by(study, &study.captures, changes, wanted)?;
        Ok(Self { experiment, render, view })
    }

    /// The view of an analysis of which is cached what it asks of surfaces. `None` where nothing is.
    pub(crate) fn of_cached_analysis(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        threads: Option<usize>,
    ) -> PyResult<Option<Self>> {
        let Some(cached) = cached_analysis(&experiment.parsed) else { return Ok(None) };
        let render = components.render.clone();
        let found = work_through(py, threads, || {
            let Some(shown) = render.shown_without_surfaces(&experiment.parsed)? else { return Ok(None) };
            let ResolvedExperiment { study, record } = shown.experiment;
            let experiment = ResolvedExperiment { study: cached.complete(study), record };
            let shown = ShownExperiment { experiment, changes: shown.changes };
            Self::new(render.clone(), shown, Wanted::Lit).map(Some)
        })?;
        found.map_err(|error| of_session(py, error))
    }

    /// The view of the captures of an experiment, with its surfaces only where the scene has changed.
    pub(crate) fn of_captures(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        wanted: Wanted<'_>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let render = components.render.clone();
        let found = work_through(py, threads, || {
            let shown = render.shown_without_surfaces(&experiment.parsed)?;
            shown.map(|shown| Self::new(render.clone(), shown, wanted)).transpose()
        })?;
        match found.map_err(|error| of_session(py, error))? {
            Some(view) => Ok(view),
            None => Self::whole(py, experiment, components, (true, wanted), threads),
        }
    }

    /// The view of an experiment with all its surfaces, as its analysis needs it.
    pub(crate) fn whole(
        py: Python<'_>,
        experiment: &Experiment,
        components: &Components,
        (is_same, wanted): (bool, Wanted<'_>),
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let render = components.render.clone();
        let resolved = experiment.resolved(py, threads)?;
        let made = work_through(py, threads, || {
            check_captures(&resolved.study, render.labels())?;
            let changes = render.changes(&experiment.parsed, &resolved, is_same)?;
            let shown = ShownExperiment { experiment: (*resolved).clone(), changes };
            Self::new(render.clone(), shown, wanted)
        })?;
        made.map_err(|error| of_session(py, error))
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
        self.view.planes_of(capture)
    }

    pub(crate) fn seen(&self) -> SeenComponents<'_> {
        self.view.components(&self.render)
    }

    /// The frames of all captures, and what they may be mistaken for.
    fn frames(&self) -> Result<(Vec<Frame>, Vec<String>), Error> {
        let study = self.study();
        let frames = capture_from_planes(study, &self.seen())?;
        let mut warnings = Vec::new();
        if self.render.labels().denoised.is_some() {
            warnings.push("the component image is denoised: its frames are for display only".into());
        }
        let rendered = self.render.experiment()?.map(Arc::as_ref);
        let of_image = image_warnings(self.render.labels(), rendered, &self.experiment);
        warnings.extend(of_image.iter().map(ToString::to_string));
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

/// Takes the frames of an experiment's captures of a component image; returns with them what they may be mistaken for.
#[pyfunction]
#[pyo3(signature = (experiment, components, *, threads = None))]
pub(crate) fn capture(
    experiment: &Bound<'_, Experiment>,
    components: &Bound<'_, Components>,
    threads: Option<usize>,
) -> PyResult<(Vec<Frame>, Vec<String>)> {
    let py = experiment.py();
    let view = View::of_captures(py, experiment.get(), components.get(), Wanted::Lit, threads)?;
    work_through(py, threads, || view.frames())?.map_err(|error| of_session(py, error))
}

/// Refuses an experiment whose captures can't be taken of a component image, before any is taken.
#[pyfunction]
#[pyo3(signature = (experiment, components, *, threads = None))]
pub(crate) fn check_capture(
    experiment: &Bound<'_, Experiment>,
    components: &Bound<'_, Components>,
    threads: Option<usize>,
) -> PyResult<()> {
    let (py, experiment, render) = (experiment.py(), experiment.get(), &components.get().render);
    let without_surfaces = || -> Result<bool, Error> {
        let Some(shown) = render.shown_without_surfaces(&experiment.parsed)? else { return Ok(false) };
        check_captures(&shown.experiment.study, render.labels())?;
        Ok(true)
    };
    if work_through(py, threads, without_surfaces)?.map_err(|error| of_session(py, error))? {
        return Ok(());
    }
    let resolved = experiment.resolved(py, threads)?;
    let with_surfaces = || -> Result<(), Error> {
        check_captures(&resolved.study, render.labels())?;
        render.changes(&experiment.parsed, &resolved, true).map(|_| ())
    };
    work_through(py, threads, with_surfaces)?.map_err(|error| of_session(py, error))
}

/// A raw frame from a file: TIFF, PNG, DNG or packed; returns with it what of its description is doubtful.
#[pyfunction]
#[pyo3(signature = (path, name = None))]
pub(crate) fn read_frame(
    py: Python<'_>,
    path: PathBuf,
    name: Option<String>,
) -> PyResult<(Frame, Vec<String>)> {
    let DescribedFrame { image: mut raw, facts } =
        py.detach(|| read_described_frame(&path)).map_err(failed)?;
    if let Some(name) = name {
        raw.label = name;
    }
    let doubts = facts.iter().filter(|fact| fact.is_doubtful);
    let doubts = doubts.map(|fact| format!("{}: {}", path.display(), fact.sentence())).collect();
    Ok((Frame { raw, captured: None, colors: None, preview: OnceLock::new() }, doubts))
}
