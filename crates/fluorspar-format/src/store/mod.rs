//! Where files are opened and written: inputs within limits, outputs whole or not at all, the cache, films.

pub(crate) mod cache;
pub(crate) mod file;
pub(crate) mod file_format;
pub(crate) mod film;
pub(crate) mod input;
pub(crate) mod output;
pub(crate) mod provenance;
pub(crate) mod spooled_image;
