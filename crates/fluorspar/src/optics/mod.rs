//! Cameras that make rays and lenses that form images.

mod perspective;

pub use perspective::PerspectiveCamera;
