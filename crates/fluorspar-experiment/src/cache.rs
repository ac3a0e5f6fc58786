//! What takes long to make is made once: the cache of the program, if it has one.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread::{self, JoinHandle};

use fluorspar::material::{ScalarTexture, TissueSurface};
use fluorspar::spectral::Fluorophore;
use fluorspar::tissue::{CachedSolutions, SolutionStore};
use fluorspar_anatomy::{
    BakedMap, Mouth, MouthParameters, ParameterError, SurfaceMap, Tissue, generate_mouth, shared_mouth,
    shared_surface_map,
};
use fluorspar_format::Cache;

static CACHE: OnceLock<Cache> = OnceLock::new();

/// Lets this process keep what takes long to make in a cache, from here on. Without this call nothing is kept, and no file is
/// written. Later calls change nothing.
pub fn use_cache(cache: Cache) {
    let _ = CACHE.set(cache);
}

/// The cache of [`use_cache`].
pub fn cache() -> Option<&'static Cache> {
    CACHE.get()
}

/// Tasks whose surfaces nobody asks for again.
static PASSING: AtomicUsize = AtomicUsize::new(0);

/// What [`keep_no_surfaces`] gives.
#[derive(Debug)]
#[must_use]
pub struct PassingSurfaces(());

/// Until what is returned is dropped, meshes, maps and tissues that this process makes are not put into the cache: those of many people
/// would take the place of everything that is used again.
pub fn keep_no_surfaces() -> PassingSurfaces {
    PASSING.fetch_add(1, Ordering::Relaxed);
    PassingSurfaces(())
}

impl Drop for PassingSurfaces {
    fn drop(&mut self) {
        PASSING.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The cache, where surfaces go into it.
pub(crate) fn cache_of_surfaces() -> Option<&'static Cache> {
    cache().filter(|_| PASSING.load(Ordering::Relaxed) == 0)
}

/// [`generate_mouth`], or the same mouth from this process or from the cache.
///
/// # Errors
/// Those of [`generate_mouth`].
pub fn cached_mouth(parameters: &MouthParameters) -> Result<Arc<Mouth>, ParameterError> {
    shared_mouth(parameters, |key| {
        let kept = cache().and_then(|cache| Mouth::from_bytes(&cache.get("mouth", key.as_bytes())?));
        if let Some(mouth) = kept {
            return Ok(mouth);
        }
        let mouth = generate_mouth(parameters)?;
        if let Some(cache) = cache_of_surfaces() {
            cache.put("mouth", key.as_bytes(), &mouth.to_bytes());
        }
        Ok(mouth)
    })
}

/// Where solutions of light transport are kept: the cache.
pub(crate) fn cached_solutions() -> CachedSolutions {
    struct InCache;
    impl SolutionStore for InCache {
        fn get(&self, key: &[u8]) -> Option<Vec<u8>> {
            cache()?.get("light-in-tissues", key)
        }

        fn put(&self, key: &[u8], bytes: &[u8]) {
            if let Some(cache) = cache() {
                cache.put("light-in-tissues", key, bytes);
            }
        }
    }
    CachedSolutions::new(Arc::new(InCache))
}

/// Reads a mouth from the cache, if it is there, while its caller does something else: [`cached_mouth`] finds it after this thread has
/// been joined.
pub(crate) fn fetch_mouth(parameters: &MouthParameters) -> JoinHandle<()> {
    let parameters = parameters.clone();
    thread::spawn(move || {
        let _ = shared_mouth(&parameters, |key| {
            let kept = cache().and_then(|cache| Mouth::from_bytes(&cache.get("mouth", key.as_bytes())?));
            kept.ok_or_else(|| ParameterError { field: "", message: String::new() })
        });
    })
}

/// Solved tissues of this process, newest last, by what they were made of.
static TISSUES: Mutex<Vec<(String, TissueSurface)>> = Mutex::new(Vec::new());
/// Most of them.
const MOST_TISSUES: usize = 48;

/// What `make` solves, or the same tissue from this process or from the cache. `key` is all that the states depend on but for
/// the program; `parameters` are the names and maps of those that vary, and `find` gives a fluorophore by its name.
///
/// # Errors
/// Those of `make`.
pub(crate) fn cached_tissue<E>(
    key: &str,
    parameters: Vec<(String, ScalarTexture)>,
    find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>,
    make: impl FnOnce() -> Result<TissueSurface, E>,
) -> Result<TissueSurface, E> {
    let known = TISSUES
        .lock()
        .ok()
        .and_then(|kept| kept.iter().find(|(other, _)| other == key).map(|(_, surface)| surface.clone()));
    if let Some(surface) = known {
        return Ok(surface.with_maps(parameters.into_iter().map(|(_, map)| map)));
    }
    let kept = cache()
        .and_then(|cache| TissueSurface::from_bytes(&cache.get("tissue", key.as_bytes())?, parameters, find));
    let surface = match kept {
        Some(surface) => surface,
        None => {
            let surface = make()?;
            if let Some((cache, bytes)) =
                cache_of_surfaces().and_then(|cache| Some((cache, surface.to_bytes()?)))
            {
                cache.put("tissue", key.as_bytes(), &bytes);
            }
            surface
        }
    };
    keep(key, &surface);
    Ok(surface)
}

/// Keeps a tissue for the rest of this process, in place of the oldest one where there are many.
fn keep(key: &str, surface: &TissueSurface) {
    if let Ok(mut kept) = TISSUES.lock() {
        kept.push((key.to_owned(), surface.clone()));
        if kept.len() > MOST_TISSUES {
            kept.remove(0);
        }
    }
}

/// [`shared_surface_map`], from this process or from the cache.
pub(crate) fn cached_surface_map(
    map: SurfaceMap,
    tissue: Tissue,
    parameters: &MouthParameters,
) -> Arc<BakedMap> {
    shared_surface_map(map, tissue, parameters, |key, bake| {
        let Some(cache) = cache() else { return bake() };
        if let Some(kept) = cache.get("map", key.as_bytes()).and_then(|bytes| BakedMap::from_bytes(&bytes)) {
            return kept;
        }
        let baked = bake();
        if let Some(cache) = cache_of_surfaces() {
            cache.put("map", key.as_bytes(), &baked.to_bytes());
        }
        baked
    })
}
