//! What takes long to make is made once: the cache of the program, if it has one.

use std::sync::{Arc, OnceLock};

use fluorspar_anatomy::{Mouth, MouthParameters, ParameterError, generate_mouth, shared_mouth};
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

/// [`generate_mouth`], or the same mouth from this process or from the cache.
///
/// # Errors
/// Those of [`generate_mouth`].
pub fn kept_mouth(parameters: &MouthParameters) -> Result<Arc<Mouth>, ParameterError> {
    shared_mouth(parameters, |key| {
        let kept = cache().and_then(|cache| Mouth::from_bytes(&cache.get("mouth", key.as_bytes())?));
        if let Some(mouth) = kept {
            return Ok(mouth);
        }
        let mouth = generate_mouth(parameters)?;
        if let Some(cache) = cache() {
            cache.put("mouth", key.as_bytes(), &mouth.to_bytes());
        }
        Ok(mouth)
    })
}
