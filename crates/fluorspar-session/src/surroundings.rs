//! What all tasks of a process use: the cache and the catalogue of the user.

use std::path::Path;

use fluorspar_experiment::preset::use_catalogue;
use fluorspar_experiment::use_cache;
use fluorspar_format::Cache;

use crate::Result;

/// Lets all work of this process use the user's cache, if it is wanted, and the folder of spectra and sensors that `FLUORSPAR_CATALOGUE` names
/// beside the catalogue.
///
/// # Errors
/// A folder that is none, or holds what is no entry.
pub fn use_surroundings(keeps: bool) -> Result<()> {
    if let (true, Some(cache)) = (keeps, Cache::of_user()) {
        use_cache(cache);
    }
    if let Some(folder) = std::env::var_os("FLUORSPAR_CATALOGUE").filter(|folder| !folder.is_empty()) {
        use_catalogue(Path::new(&folder))?;
    }
    Ok(())
}
