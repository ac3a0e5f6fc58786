//! Tests of whole scenes.
#![allow(clippy::unwrap_used)]

mod equation_3;
mod experiment;
mod exporters;
mod light;
mod mistakes;
mod support;
mod table;
mod write;
