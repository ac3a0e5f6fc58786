//! The workbench as a browser sees it: over HTTP, from a render of a few pixels.
#![allow(clippy::unwrap_used, reason = "these are tests")]

mod correctness;
mod designs;
mod photographs;
mod security;
mod support;
