//! Files that hold one part of an experiment: a flat sample, layers, a sensor, a tissue.

pub(crate) mod layers;
pub(crate) mod sample;
pub(crate) mod sensor;
pub(crate) mod tissue;
