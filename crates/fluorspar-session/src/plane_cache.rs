//! Channel planes that were formed once: those of files on the disk, for later commands, those of images in memory, for later calls.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::thread::{self, JoinHandle};
use std::time::UNIX_EPOCH;

use fluorspar::image::ChannelPlanes;
use fluorspar::pipeline::FilmResponse;
use fluorspar::study::Capture;
use fluorspar_experiment::cache;

/// Most bytes of channel planes that go to the disk, an eighth of the cache: larger ones would drive mouths and tissues out of it.
const MOST_CACHED_BYTES: usize = 128 << 20;

/// Kind of the entries of the cache that hold channel planes.
const PLANES_KIND: &str = "planes";

/// Components whose planes are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted<'a> {
    /// Those under a light that some capture of the camera switches on.
    Lit,
    /// In the camera of one capture those under a light that it switches on.
    LitBy(&'a str),
    /// In the cameras of some captures those under a light that one of these switches on.
    LitByAny(&'a [&'a str]),
    /// In the camera of one capture all.
    AllOf(&'a str),
}

impl Wanted<'_> {
    /// Whether the planes of components under a light group are wanted for a capture.
    pub(crate) fn includes(self, capture: &Capture, group: &str) -> bool {
        let is_lit = || capture.frame.drive(group) != 0.0;
        match self {
            Self::Lit => is_lit(),
            Self::LitBy(name) => capture.frame.label == name && is_lit(),
            Self::LitByAny(names) => names.contains(&capture.frame.label.as_str()) && is_lit(),
            Self::AllOf(name) => capture.frame.label == name,
        }
    }
}

/// Channel planes, and of which components they were formed: the others are dark.
#[derive(Clone, Debug)]
pub(crate) struct FormedPlanes {
    pub(crate) planes: ChannelPlanes,
    pub(crate) formed: Vec<bool>,
}

impl FormedPlanes {
    /// Dark planes.
    pub(crate) fn none(response: &FilmResponse) -> Self {
        let planes = response.dark();
        let formed = vec![false; planes.components];
        Self { planes, formed }
    }

    /// Takes over the planes of components that are formed now.
    pub(crate) fn add(&mut self, new: ChannelPlanes, is_new: &[bool]) {
        if self.formed.contains(&true) {
            let missing = |component: &usize| is_new[*component] && !self.formed[*component];
            for component in (0..is_new.len()).filter(missing) {
                for channel in 0..new.channels {
                    self.planes.plane_mut(component, channel).copy_from_slice(new.plane(component, channel));
                }
            }
        } else {
            self.planes = new;
        }
        self.formed.iter_mut().zip(is_new).for_each(|(formed, is_new)| *formed |= is_new);
    }
}

/// Planes of the cameras that were last asked for, in memory.
#[derive(Debug, Default)]
pub(crate) struct MemoryPlanes(Mutex<Vec<FormedPlanes>>);

impl MemoryPlanes {
    /// Cameras whose planes stay.
    const MOST: usize = 4;

    pub(crate) fn get(&self, response: &FilmResponse) -> Option<FormedPlanes> {
        let cached = self.0.lock().ok()?;
        cached.iter().find(|formed| formed.planes.camera == response.camera()).cloned()
    }

    pub(crate) fn put(&self, formed: FormedPlanes) {
        if let Ok(mut cached) = self.0.lock() {
            cached.retain(|other| other.planes.camera != formed.planes.camera);
            cached.push(formed);
            let surplus = cached.len().saturating_sub(Self::MOST);
            cached.drain(..surplus);
        }
    }
}

/// Planes of the cameras of a component file, in the user's cache.
#[derive(Debug)]
pub(crate) struct DiskPlanes {
    path: PathBuf,
    /// Writes what was formed while the rest of the work goes on.
    writers: Mutex<Vec<JoinHandle<()>>>,
}

impl DiskPlanes {
    /// Of a component file.
    pub(crate) fn new(path: &Path) -> Self {
        Self { path: path.into(), writers: Mutex::new(Vec::new()) }
    }

    /// Planes that were formed before, if those of all wanted components are among them.
    pub(crate) fn get(
        &self,
        response: &FilmResponse,
        is_wanted: impl Fn(usize) -> bool,
    ) -> Option<ChannelPlanes> {
        let bytes = cache()?.get(PLANES_KIND, self.key(response)?.as_bytes())?;
        from_bytes(&bytes, response, is_wanted)
    }

    /// Caches planes of the wanted components.
    pub(crate) fn put(
        &self,
        response: &FilmResponse,
        planes: &ChannelPlanes,
        is_wanted: impl Fn(usize) -> bool,
    ) {
        let is_small = 4 * planes.data.len() <= MOST_CACHED_BYTES;
        let Some(key) = self.key(response).filter(|_| is_small && cache().is_some()) else { return };
        let bytes = to_bytes(planes, is_wanted);
        let write = move || {
            if let Some(cache) = cache() {
                cache.put(PLANES_KIND, key.as_bytes(), &bytes);
            }
        };
        if let Ok(mut writers) = self.writers.lock() {
            writers.push(thread::spawn(write));
        }
    }

    /// All that channel planes depend on: the file as it lies there, and the camera.
    fn key(&self, response: &FilmResponse) -> Option<String> {
        let path = self.path.canonicalize().ok()?;
        let metadata = path.metadata().ok()?;
        let changed = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
        Some(format!("planes 2 {path:?} {} {changed:?} {}", metadata.len(), response.camera()))
    }
}

impl Drop for DiskPlanes {
    /// Entries must be whole before the process ends.
    fn drop(&mut self) {
        for writer in self.writers.get_mut().map(std::mem::take).unwrap_or_default() {
            // What can't be cached is formed again.
            let _ = writer.join();
        }
    }
}

/// Planes of the wanted components as bytes: which components there are, a byte each, and their values.
fn to_bytes(planes: &ChannelPlanes, is_wanted: impl Fn(usize) -> bool) -> Vec<u8> {
    let values = planes.data.len() / planes.components.max(1);
    let is_there: Vec<bool> = (0..planes.components).map(is_wanted).collect();
    let mut bytes: Vec<u8> = is_there.iter().map(|is_there| u8::from(*is_there)).collect();
    let by_component = planes.data.chunks_exact(values.max(1)).zip(&is_there);
    for (plane, _) in by_component.filter(|(_, is_there)| **is_there) {
        bytes.extend(plane.iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

/// Planes of the wanted components from bytes, if all of them are there.
fn from_bytes(
    bytes: &[u8],
    response: &FilmResponse,
    is_wanted: impl Fn(usize) -> bool,
) -> Option<ChannelPlanes> {
    let mut planes = response.dark();
    let values = planes.data.len() / planes.components.max(1);
    let (is_there, mut rest) = bytes.split_at_checked(planes.components)?;
    for (component, plane) in planes.data_mut().chunks_exact_mut(values.max(1)).enumerate() {
        let is_wanted = is_wanted(component);
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
