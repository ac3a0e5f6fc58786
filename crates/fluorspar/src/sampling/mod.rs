//! Random numbers as functions of what they are for.

pub mod random;
