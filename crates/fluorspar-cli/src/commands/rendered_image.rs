//! A component image of an earlier render, opened by part, and what captures see of it.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::thread::{self, JoinHandle};
use std::time::UNIX_EPOCH;

use fluorspar::image::{
    ChannelPlanes, ComponentFactors, ComponentImage, ComponentRows, ExcitationImage, PreparedRows, RelitRows,
};
use fluorspar::light::Light;
use fluorspar::pipeline::{
    CapturePlanes, CaptureResponses, FilmResponse, MultipleUncertainty, PipelineError, SeenComponents,
};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::{Experiment, ResolvedExperiment, cache, parse, resolve};
use fluorspar_format::{ComponentFile, Provenance};

use crate::error::CliError;
use crate::message::Messages;
use crate::rendered_scene::{RenderedScene, SceneChanges};
use crate::values::{Override, as_typed, sets};

/// Most bytes of channel planes that are kept, an eighth of the cache: larger ones would drive mouths and tissues out of it.
const MOST_KEPT_BYTES: usize = 128 << 20;

/// Kind of the entries of the cache that hold channel planes.
const PLANES_KIND: &str = "planes";

/// A component image whose spectra are read when they are needed.
pub(crate) struct RenderedImage {
    path: PathBuf,
    file: ComponentFile,
    /// The experiment that it was rendered from, once it is read.
    rendered: OnceLock<Experiment>,
    /// The excitation basis, once it is read.
    basis: OnceLock<Option<ExcitationImage>>,
    /// Writes channel planes to the cache while the rest of the command runs.
    being_kept: OnceLock<JoinHandle<()>>,
}

impl RenderedImage {
    pub(crate) fn open(path: &Path) -> Result<Self, CliError> {
        Ok(Self::new(path, ComponentFile::open(path)?))
    }

    /// [`Self::open`] without the feature maps, which captures do not need.
    pub(crate) fn open_for_captures(path: &Path) -> Result<Self, CliError> {
        Ok(Self::new(path, ComponentFile::open_without_maps(path)?))
    }

    fn new(path: &Path, file: ComponentFile) -> Self {
        let (rendered, basis, being_kept) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        Self { path: path.into(), file, rendered, basis, being_kept }
    }

    /// The image without its values.
    pub(crate) fn labels(&self) -> &ComponentImage {
        self.file.labels()
    }

    /// Warns of an image that proves nothing.
    pub(crate) fn warn(&self, messages: Messages) {
        if self.labels().denoised.is_some() {
            let warning =
                format!("{}: this image is denoised: its frames are for display only", self.path.display());
            messages.warnings(&[warning.into()]);
        }
    }

    fn provenance(&self) -> Result<&Provenance, CliError> {
        self.file.provenance().ok_or_else(|| {
            let path = self.path.display();
            CliError::Input(format!("{path}: this image carries no experiment; name one with --experiment"))
        })
    }

    /// Text of the experiment that the image carries, and the experiment with changes.
    pub(crate) fn experiment(&self, overrides: &[Override]) -> Result<(String, Experiment), CliError> {
        let text = self.provenance()?.resolved_experiment_toml.clone();
        let name = format!("experiment in {}", self.path.display());
        let parsed = parse(&text, &name, Path::new("."), &sets(overrides));
        Ok((text, parsed.map_err(|error| as_typed(error, overrides))?))
    }

    /// The experiment that the image was rendered from.
    pub(crate) fn rendered(&self) -> Result<&Experiment, CliError> {
        if let Some(rendered) = self.rendered.get() {
            return Ok(rendered);
        }
        let (_, read) = self.experiment(&[])?;
        Ok(self.rendered.get_or_init(|| read))
    }

    /// An experiment of this image with changes, as captures of the image need it.
    pub(crate) fn shown(
        &self,
        now: &Experiment,
        overrides: &[Override],
    ) -> Result<ShownByImage<'_>, CliError> {
        match self.without_surfaces(now) {
            Ok(Some(found)) => Ok(found),
            Ok(None) => self.shown_whole(now, overrides),
            Err(CliError::Experiment(error)) => Err(as_typed(error, overrides).into()),
            Err(error) => Err(error),
        }
    }

    /// [`Self::shown`] where nothing of the scene has changed: no mesh or tissue is needed then.
    pub(crate) fn without_surfaces(&self, now: &Experiment) -> Result<Option<ShownByImage<'_>>, CliError> {
        let rendered = self.rendered()?;
        let Some((found, changes)) = self.scene(Some(rendered)).captures::<CliError>(now)? else {
            return Ok(None);
        };
        Ok(Some(ShownByImage { experiment: found.into_resolved(now), changes }))
    }

    /// [`Self::shown`] with all surfaces.
    pub(crate) fn shown_whole(
        &self,
        now: &Experiment,
        overrides: &[Override],
    ) -> Result<ShownByImage<'_>, CliError> {
        self.shown_by(now, resolve(now).map_err(|error| as_typed(error, overrides))?)
    }

    /// [`Self::shown`] of any experiment that is resolved.
    pub(crate) fn shown_by(
        &self,
        now: &Experiment,
        resolved: ResolvedExperiment,
    ) -> Result<ShownByImage<'_>, CliError> {
        let changes = self.changes(now, &resolved, true)?;
        Ok(ShownByImage { experiment: resolved, changes })
    }

    /// What makes the image show the scene of an experiment.
    ///
    /// # Errors
    /// A scene that only a new render can show, if `is_same` is demanded.
    pub(crate) fn changes(
        &self,
        now: &Experiment,
        resolved: &ResolvedExperiment,
        is_same: bool,
    ) -> Result<SceneChanges<'_>, CliError> {
        let rendered = match self.file.provenance() {
            None => None,
            Some(_) => Some(self.rendered()?),
        };
        self.scene(rendered).changes(now, resolved, is_same, || self.basis())
    }

    fn scene<'a>(&'a self, experiment: Option<&'a Experiment>) -> RenderedScene<'a> {
        RenderedScene { labels: self.labels(), experiment }
    }

    /// The excitation basis of the image, if it has one.
    fn basis(&self) -> Result<Option<&ExcitationImage>, CliError> {
        if let Some(basis) = self.basis.get() {
            return Ok(basis.as_ref());
        }
        let read = self.file.excitation_basis()?;
        Ok(self.basis.get_or_init(|| read).as_ref())
    }

    /// What captures see of the image: its channel planes, and the factors on them.
    pub(crate) fn seen_by(
        &self,
        study: &Study,
        captures: &[Capture],
        changes: SceneChanges<'_>,
    ) -> Result<CaptureView, CliError> {
        let labels = self.labels();
        let SceneChanges { mut factors, relit, lights, light_errors } = changes;
        let size = [labels.width, labels.height, labels.grid.len()];
        let rows = RelitRows { rows: &self.file, size, relit: &relit };
        let CaptureResponses { responses, of_capture } = CaptureResponses::new(study, captures, labels)?;
        let film = responses.first().ok_or(PipelineError::Missing("captures"))?.film();
        let planes = if relit.iter().all(Option::is_none) {
            self.planes(&responses, |response, component| {
                let mut of_response = captures.iter().zip(&of_capture).filter(|(_, of)| **of == response);
                of_response.any(|(capture, _)| self.is_lit(component, std::slice::from_ref(capture)))
            })?
        } else {
            self.relit_planes(study, &responses, captures, lights, &rows)?
        };
        let (planes, uncertainty) = CapturePlanes { planes, of_capture, film }.with_concentrations(
            &responses,
            (labels, captures),
            &mut factors,
            &rows,
            |component| self.is_lit(component, captures),
        )?;
        Ok(CaptureView { planes, factors, uncertainty, light_errors })
    }

    /// The image with the spectra that captures see: under changed lights, with changed concentrations but for what these do to light
    /// that fluoresced twice. Components of other lights stay dark. `None` where the spectra are larger than the
    /// memory that a study allows.
    pub(crate) fn spectra(
        &self,
        study: &Study,
        changes: &SceneChanges<'_>,
    ) -> Result<Option<ComponentImage>, CliError> {
        let labels = self.labels();
        let (width, height, bands) = (labels.width, labels.height, labels.grid.len());
        let values = labels.components.len() * width * height * bands;
        // The rows that are read, and the image that they are put into
        if 2 * 4 * values as u64 > study.render.memory_limit_bytes {
            return Ok(None);
        }
        let rows = RelitRows { rows: &self.file, size: [width, height, bands], relit: &changes.relit };
        let rows = PreparedRows { rows: &rows, factors: &changes.factors, width };
        let found = rows.map_rows(
            |component| self.is_lit(component, &study.captures),
            |component, _, lines| by_pixel(lines, width, changes.factors.even[component] as f32),
        )?;
        let mut image = ComponentImage { data: vec![0.0; values], ..labels.clone() };
        for (component, row, spectra) in found {
            let start = (component * height + row) * width * bands;
            image.data[start..start + width * bands].copy_from_slice(&spectra);
        }
        Ok(Some(image))
    }

    /// Light that no capture switches on need not be read.
    fn is_lit(&self, component: usize, captures: &[Capture]) -> bool {
        let group = &self.labels().components[component].light_group;
        captures.iter().any(|capture| capture.frame.drive(group) != 0.0)
    }

    /// Channel planes under other lights: new ones of the components that these change; of the others those that the file holds for
    /// the same camera, where it does.
    fn relit_planes(
        &self,
        study: &Study,
        responses: &[FilmResponse],
        captures: &[Capture],
        lights: Option<Vec<Light>>,
        rows: &RelitRows<'_, ComponentFile>,
    ) -> Result<Vec<ChannelPlanes>, CliError> {
        let labels = self.labels();
        let mut before = study.clone();
        if let Some(lights) = lights {
            before.scene.lights = lights;
        }
        let rendered = CaptureResponses::new(&before, captures, labels)?;
        let ones = ComponentFactors::ones(labels.components.len());
        let rows_of = PreparedRows { rows, factors: &ones, width: labels.width };
        let mut all = Vec::with_capacity(responses.len());
        for (number, response) in responses.iter().enumerate() {
            // The same captures share responses before and after
            let old = rendered.responses.get(number);
            let held =
                old.map(|old| self.file.planes(old.camera(), |component| self.is_lit(component, captures)));
            let held = held.transpose()?.flatten();
            let is_new = |component: usize| held.is_none() || rows.relit[component].is_some();
            // Of components that the basis gives, few spectra pass the camera; a lens that mixes pixels needs all bands
            let is_short = |component: usize| response.is_local() && rows.relit[component].is_some();
            let wanted = |component: usize| {
                is_new(component) && !is_short(component) && self.is_lit(component, captures)
            };
            let mut planes = FilmResponse::planes(&[response], wanted, &rows_of)?;
            let mut planes = planes.pop().ok_or(PipelineError::Missing("captures"))?;
            for (component, relit) in
                rows.relit.iter().enumerate().filter(|(component, _)| is_short(*component))
            {
                if let Some(relit) = relit {
                    response.place_relit(component, relit, &mut planes);
                }
            }
            for component in (0..planes.components).filter(|component| !is_new(*component)) {
                for channel in 0..planes.channels {
                    if let Some(held) = &held {
                        planes.plane_mut(component, channel).copy_from_slice(held.plane(component, channel));
                    }
                }
            }
            all.push(planes);
        }
        Ok(all)
    }

    /// Channel planes: those that the file holds, and for other cameras new ones from its spectra. `is_seen` tells which components the
    /// captures of a response see; the planes of others may stay dark.
    fn planes(
        &self,
        responses: &[FilmResponse],
        is_seen: impl Fn(usize, usize) -> bool + Sync,
    ) -> Result<Vec<ChannelPlanes>, CliError> {
        let mut planes = Vec::with_capacity(responses.len());
        for (number, response) in responses.iter().enumerate() {
            let seen = |component| is_seen(number, component);
            let held = match self.file.planes(response.camera(), seen)? {
                None => self.cached_planes(response, seen),
                held => held,
            };
            planes.push(held);
        }
        let missing: Vec<usize> = (0..responses.len()).filter(|number| planes[*number].is_none()).collect();
        let wanted = |component| missing.iter().any(|number| is_seen(*number, component));
        let mut formed =
            self.formed(missing.iter().map(|number| &responses[*number]).collect(), wanted)?.into_iter();
        Ok(planes.into_iter().filter_map(|held| held.or_else(|| formed.next())).collect())
    }

    /// New channel planes of cameras of which neither the file nor an earlier command holds any; they are kept for the next one.
    fn formed(
        &self,
        responses: Vec<&FilmResponse>,
        wanted: impl Fn(usize) -> bool + Sync,
    ) -> Result<Vec<ChannelPlanes>, CliError> {
        if responses.is_empty() {
            return Ok(Vec::new());
        }
        let ones = ComponentFactors::ones(self.labels().components.len());
        let rows = PreparedRows { rows: &self.file, factors: &ones, width: self.labels().width };
        let planes = FilmResponse::planes(&responses, &wanted, &rows)?;
        let mut entries = Vec::with_capacity(planes.len());
        for (response, planes) in responses.into_iter().zip(&planes) {
            let is_small = 4 * planes.data.len() <= MOST_KEPT_BYTES;
            if let Some(key) = self.key_of_planes(response).filter(|_| is_small && cache().is_some()) {
                entries.push((key, bytes_of_planes(planes, &wanted)));
            }
        }
        let keep = move || {
            for (key, bytes) in entries {
                if let Some(cache) = cache() {
                    cache.put(PLANES_KIND, key.as_bytes(), &bytes);
                }
            }
        };
        self.being_kept.set(thread::spawn(keep)).ok();
        Ok(planes)
    }

    /// Channel planes that an earlier command has formed, if those of all wanted components are among them.
    fn cached_planes(
        &self,
        response: &FilmResponse,
        wanted: impl Fn(usize) -> bool,
    ) -> Option<ChannelPlanes> {
        let bytes = cache()?.get(PLANES_KIND, self.key_of_planes(response)?.as_bytes())?;
        planes_of_bytes(&bytes, response, wanted)
    }

    /// All that channel planes depend on: the file as it lies there, and the camera.
    fn key_of_planes(&self, response: &FilmResponse) -> Option<String> {
        let path = self.path.canonicalize().ok()?;
        let metadata = path.metadata().ok()?;
        let changed = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
        Some(format!("planes 2 {path:?} {} {changed:?} {}", metadata.len(), response.camera()))
    }
}

impl Drop for RenderedImage {
    /// What is being kept must be whole before the process ends.
    fn drop(&mut self) {
        if let Some(thread) = self.being_kept.take() {
            // What can't be kept is made again.
            let _ = thread.join();
        }
    }
}

/// Planes of the wanted components as bytes: which components there are, a byte each, and their values.
fn bytes_of_planes(planes: &ChannelPlanes, wanted: impl Fn(usize) -> bool) -> Vec<u8> {
    let values = planes.data.len() / planes.components.max(1);
    let is_there: Vec<bool> = (0..planes.components).map(wanted).collect();
    let mut bytes: Vec<u8> = is_there.iter().map(|is_there| u8::from(*is_there)).collect();
    let of_components = planes.data.chunks_exact(values.max(1)).zip(&is_there);
    for (plane, _) in of_components.filter(|(_, is_there)| **is_there) {
        bytes.extend(plane.iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

/// Planes of the wanted components from bytes, if all of them are there.
fn planes_of_bytes(
    bytes: &[u8],
    response: &FilmResponse,
    wanted: impl Fn(usize) -> bool,
) -> Option<ChannelPlanes> {
    let mut planes = response.dark();
    let values = planes.data.len() / planes.components.max(1);
    let (is_there, mut rest) = bytes.split_at_checked(planes.components)?;
    for (component, plane) in planes.data_mut().chunks_exact_mut(values.max(1)).enumerate() {
        let is_wanted = wanted(component);
        if is_there[component] == 0 {
            if is_wanted {
                return None;
            }
            continue;
        }
        let (own, others) = rest.split_at_checked(size_of::<f32>() * values)?;
        rest = others;
        if is_wanted {
            let (own, _) = own.as_chunks::<4>();
            plane.iter_mut().zip(own).for_each(|(value, bytes)| *value = f32::from_le_bytes(*bytes));
        }
    }
    rest.is_empty().then_some(planes)
}

/// An experiment as captures of an image need it.
pub(crate) struct ShownByImage<'a> {
    /// What captures see of the study, and the file.
    pub(crate) experiment: ResolvedExperiment,
    /// What makes the image show it.
    pub(crate) changes: SceneChanges<'a>,
}

/// What captures see of a component image.
pub(crate) struct CaptureView {
    planes: CapturePlanes,
    factors: ComponentFactors,
    /// What changed concentrations leave uncertain.
    pub(crate) uncertainty: Option<MultipleUncertainty>,
    light_errors: Vec<(String, f64)>,
}

impl CaptureView {
    /// The components as the captures see them.
    pub(crate) fn components<'a>(
        &'a self,
        image: &'a RenderedImage,
        captures: &'a [Capture],
    ) -> SeenComponents<'a> {
        let factors = &self.factors;
        SeenComponents { image: image.labels(), planes: &self.planes, captures, factors }
    }

    /// Tells how exact changed lights and concentrations are.
    pub(crate) fn say_uncertainty(&self, study: &Study, messages: Messages) {
        for (group, error) in &self.light_errors {
            messages.status(format!(
                "Light of \"{group}\" changed without a new render: fluorescence within {:.2} % of one, reflected light exact",
                100.0 * error
            ));
        }
        if let Some(found) = &self.uncertainty {
            messages.status(format!(
                "Concentrations changed without a new render: exact but for light that fluoresced twice, {:.2} % of the light of its \
                 light sources, which may be off by {:.2} % of that light at the very most",
                100.0 * found.share,
                100.0 * found.largest_error
            ));
        }
        if study.concentrations.iter().any(|change| change.painted.is_some()) {
            messages.status(
                "A painted mask also scales light that was emitted elsewhere and reflected in its pixels: inside of a mouth some \
                 percent (docs/theory.md)",
            );
        }
    }
}

/// The spectra of a row's pixels, one after the other, times a factor; `lines` has the row band by band.
fn by_pixel(lines: &[f32], width: usize, factor: f32) -> Vec<f32> {
    let bands = lines.len() / width.max(1);
    let mut spectra = vec![0.0; lines.len()];
    for (band, line) in lines.chunks_exact(width).enumerate() {
        line.iter().enumerate().for_each(|(col, value)| spectra[col * bands + band] = factor * value);
    }
    spectra
}
