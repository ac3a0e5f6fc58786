//! Tests of whole scenes.
#![allow(clippy::unwrap_used)]

mod equation_3;
mod exporters;
mod light;
mod mistakes;
mod support;
