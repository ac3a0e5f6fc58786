//! A finished render, opened by part or in memory, and what captures see of it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use fluorspar::image::{
    ChannelPlanes, ComponentBases, ComponentFactors, ComponentImage, ComponentRows, ExcitationImage,
    PreparedRows, RelitRows, SpectralBasis,
};
use fluorspar::interruption::end_if_interrupted;
use fluorspar::light::Light;
use fluorspar::pipeline::{
    CapturePlanes, CaptureResponses, FilmResponse, MultipleUncertainty, PipelineError, SeenComponents,
};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::{Experiment, ResolvedExperiment, parse, resolve, with_sampling_of};
use fluorspar_format::{ComponentFile, FormatError, read_component_image};

use crate::plane_cache::{DiskPlanes, FormedPlanes, MemoryPlanes, Wanted};
use crate::rendered_scene::{RenderedScene, SceneChanges};
use crate::{Error, Result};

/// A finished render: a component file whose spectra are read when they are needed, or an image in memory.
pub struct FinishedRender {
    name: String,
    spectra: Spectra,
    planes: PlaneCache,
    /// The experiment that it was rendered from, once it is read; `None` where the image carries none.
    experiment: OnceLock<Option<Arc<Experiment>>>,
    /// The excitation basis, once it is read.
    basis: OnceLock<Option<ExcitationImage>>,
}

/// Where spectra lie.
enum Spectra {
    /// In a file, and once they were all read in memory, too.
    File(Box<ComponentFile>, OnceLock<Box<ComponentImage>>),
    Memory(Arc<ComponentImage>),
}

/// Where planes that were formed go.
enum PlaneCache {
    Disk(DiskPlanes),
    Memory(MemoryPlanes),
    Both(DiskPlanes, MemoryPlanes),
}

impl PlaneCache {
    fn on_disk(&self) -> Option<&DiskPlanes> {
        match self {
            Self::Disk(disk) | Self::Both(disk, _) => Some(disk),
            Self::Memory(_) => None,
        }
    }

    fn in_memory(&self) -> Option<&MemoryPlanes> {
        match self {
            Self::Memory(memory) | Self::Both(_, memory) => Some(memory),
            Self::Disk(_) => None,
        }
    }
}

impl FinishedRender {
    /// Opens a component file.
    ///
    /// # Errors
    /// A file that can't be read or holds no components.
    pub fn open(path: &Path) -> Result<Self> {
        Ok(Self::of_file(path, ComponentFile::open(path)?))
    }

    /// [`Self::open`] without the feature maps, which captures do not need.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_for_captures(path: &Path) -> Result<Self> {
        Ok(Self::of_file(path, ComponentFile::open_without_maps(path)?))
    }

    /// [`Self::open`] for many captures by one process: planes that were formed stay in memory, of the last few cameras.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_to_stay(path: &Path) -> Result<Self> {
        let opened = Self::open(path)?;
        Ok(Self { planes: PlaneCache::Both(DiskPlanes::new(path), MemoryPlanes::default()), ..opened })
    }

    /// Reads all spectra of a file into memory, where other cameras and regions find them sooner.
    ///
    /// # Errors
    /// A file that can't be read any more.
    pub fn read_spectra(&self) -> Result<()> {
        if let Spectra::File(file, read) = &self.spectra
            && read.get().is_none()
        {
            let mut image = read_component_image(Path::new(&self.name))?.image;
            file.check_unchanged()?;
            image.round_as_stored();
            read.get_or_init(|| Box::new(image));
        }
        Ok(())
    }

    fn of_file(path: &Path, file: ComponentFile) -> Self {
        Self {
            name: path.display().to_string(),
            spectra: Spectra::File(Box::new(file), OnceLock::new()),
            planes: PlaneCache::Disk(DiskPlanes::new(path)),
            experiment: OnceLock::new(),
            basis: OnceLock::new(),
        }
    }

    /// An image in memory, with the experiment that it was rendered from where it is known. It has no excitation basis.
    pub fn of_image(image: Arc<ComponentImage>, experiment: Option<Arc<Experiment>>) -> Self {
        Self {
            name: "the component image".into(),
            spectra: Spectra::Memory(image),
            planes: PlaneCache::Memory(MemoryPlanes::default()),
            experiment: OnceLock::from(experiment),
            basis: OnceLock::from(None),
        }
    }

    /// The same image with an excitation basis, by which its lights can change.
    #[must_use]
    pub fn with_basis(self, basis: ExcitationImage) -> Self {
        Self { basis: OnceLock::from(Some(basis)), ..self }
    }

    /// The file, as messages have it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The component image; that of a file is without its spectra.
    pub fn labels(&self) -> &ComponentImage {
        match &self.spectra {
            Spectra::File(file, _) => file.labels(),
            Spectra::Memory(image) => image,
        }
    }

    /// Text of the experiment that the file carries.
    ///
    /// # Errors
    /// An image that carries none.
    pub fn experiment_text(&self) -> Result<&str> {
        let provenance = match &self.spectra {
            Spectra::File(file, _) => file.provenance(),
            Spectra::Memory(_) => None,
        };
        let provenance = provenance.ok_or_else(|| Error::NoExperiment { image: self.name.clone() })?;
        Ok(&provenance.resolved_experiment_toml)
    }

    /// The experiment that the image was rendered from; `None` where it carries none.
    ///
    /// # Errors
    /// An experiment that can't be read any more.
    pub fn experiment(&self) -> Result<Option<&Arc<Experiment>>> {
        if let Some(experiment) = self.experiment.get() {
            return Ok(experiment.as_ref());
        }
        let read = match self.experiment_text() {
            Ok(text) => {
                let name = format!("experiment in {}", self.name);
                Some(Arc::new(parse(text, &name, Path::new("."), &[])?))
            }
            Err(_) => None,
        };
        Ok(self.experiment.get_or_init(|| read).as_ref())
    }

    /// [`Self::experiment`] as one that wants to see the image compares itself with it. With how many samples and within which limits an image
    /// in memory was rendered, which a call may say for itself, is no difference between the two; of a file a change of these would have no
    /// effect.
    fn experiment_for(&self, now: &Experiment) -> Result<Option<Arc<Experiment>>> {
        let rendered = self.experiment()?;
        let is_same = |rendered: &Experiment| {
            matches!(self.spectra, Spectra::File(..)) || rendered.file.render == now.file.render
        };
        Ok(rendered.map(|rendered| match is_same(rendered) {
            true => rendered.clone(),
            false => Arc::new(with_sampling_of(rendered, now)),
        }))
    }

    /// An experiment as captures of the image need it: with surfaces only where the scene has changed.
    ///
    /// # Errors
    /// The first defect of the experiment; a scene that only a new render can show.
    pub fn shown(&self, now: &Experiment) -> Result<ShownExperiment<'_>> {
        match self.shown_without_surfaces(now)? {
            Some(found) => Ok(found),
            None => self.shown_whole(now),
        }
    }

    /// [`Self::shown`] where nothing of the scene has changed but concentrations: no mesh or tissue is needed then. `None` where more
    /// has.
    ///
    /// # Errors
    /// As [`Self::shown`].
    pub fn shown_without_surfaces(&self, now: &Experiment) -> Result<Option<ShownExperiment<'static>>> {
        let rendered = self.experiment_for(now)?;
        let Some((found, changes)) = self.scene(rendered.as_deref()).captures(now)? else { return Ok(None) };
        Ok(Some(ShownExperiment { experiment: found.into_resolved(now), changes }))
    }

    /// [`Self::shown`] with all surfaces.
    ///
    /// # Errors
    /// As [`Self::shown`].
    pub fn shown_whole(&self, now: &Experiment) -> Result<ShownExperiment<'_>> {
        self.shown_by(now, resolve(now)?)
    }

    /// [`Self::shown`] of an experiment that is resolved.
    ///
    /// # Errors
    /// As [`Self::shown`].
    pub fn shown_by(&self, now: &Experiment, resolved: ResolvedExperiment) -> Result<ShownExperiment<'_>> {
        let changes = self.changes(now, &resolved, true)?;
        Ok(ShownExperiment { experiment: resolved, changes })
    }

    /// What makes the image show the scene of an experiment.
    ///
    /// # Errors
    /// A scene that only a new render can show, if `is_same` is demanded.
    pub fn changes(
        &self,
        now: &Experiment,
        resolved: &ResolvedExperiment,
        is_same: bool,
    ) -> Result<SceneChanges<'_>> {
        let rendered = self.experiment_for(now)?;
        self.scene(rendered.as_deref()).changes(now, resolved, is_same, || self.basis())
    }

    fn scene<'a>(&'a self, experiment: Option<&'a Experiment>) -> RenderedScene<'a> {
        RenderedScene { labels: self.labels(), experiment }
    }

    /// The excitation basis of the image, if it has one.
    fn basis(&self) -> Result<Option<&ExcitationImage>> {
        if let Some(basis) = self.basis.get() {
            return Ok(basis.as_ref());
        }
        let read = match &self.spectra {
            Spectra::File(file, _) => file.excitation_basis()?,
            Spectra::Memory(_) => None,
        };
        Ok(self.basis.get_or_init(|| read).as_ref())
    }

    /// Light groups whose light spectra can be changed without a new render, each with the wavelengths that its basis spans, nm.
    ///
    /// # Errors
    /// A damaged file.
    pub fn excitation_spans(&self) -> Result<Vec<(String, [f64; 2])>> {
        let groups = self.basis()?.into_iter().flat_map(|basis| &basis.groups);
        Ok(groups.map(|group| (group.light_group.clone(), group.nodes.span_nm())).collect())
    }

    /// What captures see of the image: the wanted channel planes, and the factors on them.
    ///
    /// # Errors
    /// A study without lens or sensor; spectra that can't be read.
    pub fn seen_by(
        &self,
        study: &Study,
        captures: &[Capture],
        changes: SceneChanges<'_>,
        wanted: Wanted<'_>,
    ) -> Result<CaptureView> {
        let labels = self.labels();
        let SceneChanges { mut factors, relit, lights, light_errors } = changes;
        let size = [labels.width, labels.height, labels.grid.len()];
        let rows = RelitRows { rows: &self.spectra, size, relit: &relit };
        let CaptureResponses { responses, of_capture } = CaptureResponses::new(study, captures, labels)?;
        let film = responses.first().ok_or(PipelineError::Missing("captures"))?.film();
        let planes = if relit.iter().all(Option::is_none) {
            self.planes(&responses, |response, component| {
                let group = &labels.components[component].light_group;
                let mut own = captures.iter().zip(&of_capture).filter(|(_, of)| **of == response);
                own.any(|(capture, _)| wanted.includes(capture, group))
            })?
        } else {
            self.relit_planes(study, &responses, captures, lights, &rows)?
        };
        let (planes, uncertainty) = CapturePlanes { planes, of_capture, film }.with_concentrations(
            &responses,
            (labels, captures),
            &mut factors,
            &rows,
            |component| matches!(wanted, Wanted::AllOf(_)) || self.is_lit(component, captures),
        )?;
        Ok(CaptureView { captures: captures.to_vec(), planes, factors, uncertainty, light_errors })
    }

    /// The image with the spectra that captures see: under changed lights, with changed concentrations but for what these do to light
    /// that fluoresced twice. Components of other lights stay dark. `None` where the spectra are larger than the
    /// memory that a study allows.
    ///
    /// # Errors
    /// Spectra that can't be read.
    pub fn spectra(&self, study: &Study, changes: &SceneChanges<'_>) -> Result<Option<ComponentImage>> {
        let labels = self.labels();
        let (width, height, bands) = (labels.width, labels.height, labels.grid.len());
        let bases = self.bases_under(changes);
        let mut image = ComponentImage { bases, data: Vec::new(), ..labels.clone() };
        let values = image.stored_values();
        // The rows that are read, and the image that they are put into
        if 2 * 4 * values as u64 > study.render.memory_limit_bytes {
            return Ok(None);
        }
        image.data = vec![0.0; values];
        let rows = RelitRows { rows: &self.spectra, size: [width, height, bands], relit: &changes.relit };
        let rows = PreparedRows { rows: &rows, factors: &changes.factors, width };
        let found = rows.map_rows(
            |component| self.is_lit(component, &study.captures),
            |component, _, lines| by_pixel(lines, width, changes.factors.even[component] as f32),
        )?;
        for (component, row, spectra) in found {
            let first = row * spectra.len();
            image.stored_mut(component)[first..first + spectra.len()].copy_from_slice(&spectra);
        }
        Ok(Some(image))
    }

    /// [`Self::spectra`] of some pixels alone, by their numbers: an image of one row, in their order.
    ///
    /// # Errors
    /// Spectra that can't be read.
    pub fn spectra_at(
        &self,
        study: &Study,
        changes: &SceneChanges<'_>,
        pixels: &[usize],
    ) -> Result<ComponentImage> {
        let labels = self.labels();
        let (width, height) = (labels.width, labels.height);
        let size = [width, height, labels.grid.len()];
        let mut image = ComponentImage {
            bases: self.bases_under(changes),
            ..ComponentImage::zeros(labels.grid.clone(), pixels.len(), 1, labels.components.clone())
        };
        image.data = vec![0.0; image.stored_values()];
        let mut places: BTreeMap<usize, Vec<(usize, usize)>> = BTreeMap::new();
        for (place, pixel) in pixels.iter().enumerate() {
            places.entry(pixel / width.max(1)).or_default().push((place, pixel % width.max(1)));
        }
        let rows = RelitRows { rows: &self.spectra, size, relit: &changes.relit };
        let rows = PreparedRows { rows: &rows, factors: &changes.factors, width };
        let found = rows.map_rows(
            |component| self.is_lit(component, &study.captures),
            |component, row, lines| {
                let factor = changes.factors.even[component] as f32;
                let line = |band: usize, col: usize| factor * lines[band * width + col];
                let spectrum = |col| (0..lines.len() / width.max(1)).map(|band| line(band, col)).collect();
                let of_row = places.get(&row).into_iter().flatten();
                of_row.map(|(place, col)| (*place, spectrum(*col))).collect::<Vec<(usize, Vec<f32>)>>()
            },
        )?;
        for (component, _, of_row) in found {
            for (place, spectrum) in of_row {
                let first = place * spectrum.len();
                image.stored_mut(component)[first..first + spectrum.len()].copy_from_slice(&spectrum);
            }
        }
        Ok(image)
    }

    /// The bases of the spectra; light under another spectrum comes with all its bands.
    fn bases_under(&self, changes: &SceneChanges<'_>) -> ComponentBases {
        let is_relit = |component: usize| changes.relit.get(component).is_some_and(Option::is_some);
        let own = self.labels().bases.iter().enumerate();
        own.map(|(component, basis)| basis.clone().filter(|_| !is_relit(component))).collect()
    }

    /// Light that no capture switches on need not be read.
    fn is_lit(&self, component: usize, captures: &[Capture]) -> bool {
        let group = &self.labels().components[component].light_group;
        captures.iter().any(|capture| capture.frame.drive(group) != 0.0)
    }

    /// Channel planes under other lights: new ones of the components that these change; of the others those that the same
    /// camera had before.
    fn relit_planes(
        &self,
        study: &Study,
        responses: &[FilmResponse],
        captures: &[Capture],
        lights: Option<Vec<Light>>,
        rows: &RelitRows<'_, Spectra>,
    ) -> Result<Vec<ChannelPlanes>> {
        let labels = self.labels();
        let mut before = study.clone();
        if let Some(lights) = lights {
            before.scene.lights = lights;
        }
        let rendered = CaptureResponses::new(&before, captures, labels)?;
        let ones = ComponentFactors::ones(labels.components.len());
        let rows_of = PreparedRows { rows, factors: &ones, width: labels.width };
        let mut all = Vec::with_capacity(responses.len());
        let is_same = |component: usize| rows.relit[component].is_none() && self.is_lit(component, captures);
        let before = self.planes(&rendered.responses, |_, component| is_same(component))?;
        for (number, response) in responses.iter().enumerate() {
            // The same captures share responses before and after
            let held = before.get(number);
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
                    if let Some(held) = held {
                        planes.plane_mut(component, channel).copy_from_slice(held.plane(component, channel));
                    }
                }
            }
            all.push(planes);
        }
        Ok(all)
    }

    /// Whether what lies at the place of the file is what was opened: the cache on the disk knows files by name and time.
    fn is_as_opened(&self) -> bool {
        match &self.spectra {
            Spectra::File(file, _) => file.check_unchanged().is_ok(),
            Spectra::Memory(_) => true,
        }
    }

    /// Channel planes that a cache holds, none of them wanted where there are none.
    fn formed_before(
        &self,
        response: &FilmResponse,
        is_wanted: impl Fn(usize) -> bool,
    ) -> Result<FormedPlanes> {
        let kept = self.planes.in_memory();
        if let Some(formed) = kept.and_then(|kept| kept.get(response)) {
            return Ok(formed);
        }
        let on_disk = self.planes.on_disk().filter(|_| self.is_as_opened());
        let found = on_disk.and_then(|cached| cached.get(response, &is_wanted));
        let Some(planes) = found else { return Ok(FormedPlanes::none(response)) };
        let found = FormedPlanes { formed: (0..planes.components).map(is_wanted).collect(), planes };
        kept.into_iter().for_each(|kept| kept.put(found.clone()));
        Ok(found)
    }

    /// The planes of cameras: those that were formed before, and new ones of other cameras and components from the spectra.
    /// `is_wanted` tells which components are, for a response; the planes of others may stay dark.
    fn planes(
        &self,
        responses: &[FilmResponse],
        is_wanted: impl Fn(usize, usize) -> bool,
    ) -> Result<Vec<ChannelPlanes>> {
        let labels = self.labels();
        let count = labels.components.len();
        let before =
            |(number, response)| self.formed_before(response, |component| is_wanted(number, component));
        let mut all: Vec<FormedPlanes> = responses.iter().enumerate().map(before).collect::<Result<_>>()?;
        let lacks =
            |number: usize, component: usize| !all[number].formed[component] && is_wanted(number, component);
        let missing: Vec<usize> =
            (0..all.len()).filter(|number| (0..count).any(|component| lacks(*number, component))).collect();
        let new: Vec<bool> =
            (0..count).map(|component| missing.iter().any(|number| lacks(*number, component))).collect();
        if missing.is_empty() {
            return Ok(all.into_iter().map(|formed| formed.planes).collect());
        }
        let ones = ComponentFactors::ones(count);
        let rows = PreparedRows { rows: &self.spectra, factors: &ones, width: labels.width };
        let cameras: Vec<&FilmResponse> = missing.iter().map(|number| &responses[*number]).collect();
        let formed = FilmResponse::planes(&cameras, |component| new[component], &rows)?;
        for (number, planes) in missing.into_iter().zip(formed) {
            // What stays in memory is tried and left by the dozen: it would drive all else out of the cache on the disk
            if let PlaneCache::Disk(cached) = &self.planes
                && self.is_as_opened()
            {
                cached.put(&responses[number], &planes, |component| new[component]);
            }
            all[number].add(planes, &new);
            if let Some(cached) = self.planes.in_memory() {
                cached.put(all[number].clone());
            }
        }
        Ok(all.into_iter().map(|formed| formed.planes).collect())
    }
}

impl ComponentRows for Spectra {
    type Error = FormatError;

    fn basis(&self, component: usize) -> Option<&SpectralBasis> {
        match self {
            Self::File(file, _) => file.basis(component),
            Self::Memory(image) => image.basis(component),
        }
    }

    fn are_rounded(&self) -> bool {
        match self {
            Self::File(_, read) => read.get().is_some(),
            Self::Memory(_) => false,
        }
    }

    fn map_rows<T: Send>(
        &self,
        wanted: impl Fn(usize) -> bool + Sync,
        visit: impl Fn(usize, usize, &[f32]) -> T + Sync,
    ) -> Result<Vec<(usize, usize, T)>, FormatError> {
        let visit = |component: usize, row: usize, lines: &[f32]| {
            end_if_interrupted();
            visit(component, row, lines)
        };
        let image = match self {
            Self::Memory(image) => image.as_ref(),
            Self::File(file, read) => match read.get() {
                Some(image) => image,
                None => return file.map_rows(wanted, visit),
            },
        };
        let Ok(rows) = image.map_rows(wanted, visit);
        Ok(rows)
    }
}

/// An experiment as captures of a finished render need it.
pub struct ShownExperiment<'a> {
    /// What captures see of the study, and the file.
    pub experiment: ResolvedExperiment,
    /// What makes the image show it.
    pub changes: SceneChanges<'a>,
}

/// What captures see of a finished render.
pub struct CaptureView {
    captures: Vec<Capture>,
    planes: CapturePlanes,
    factors: ComponentFactors,
    /// What changed concentrations leave uncertain.
    pub uncertainty: Option<MultipleUncertainty>,
    /// Light groups whose spectra changed, with the estimated relative error of their light.
    pub light_errors: Vec<(String, f64)>,
}

impl CaptureView {
    /// The components as the captures see them. `render` is the one that the view is of.
    pub fn components<'a>(&'a self, render: &'a FinishedRender) -> SeenComponents<'a> {
        let Self { captures, planes, factors, .. } = self;
        SeenComponents { image: render.labels(), planes, captures, factors }
    }

    /// Factors on whole components, those on light that fluoresced twice included.
    pub(crate) fn even_factors(&self) -> &[f64] {
        &self.factors.even
    }

    /// The channel planes of the camera of a capture.
    pub fn planes_of(&self, capture: &str) -> Option<&ChannelPlanes> {
        let number = self.captures.iter().position(|settings| settings.frame.label == capture)?;
        self.planes.planes.get(*self.planes.of_capture.get(number)?)
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
