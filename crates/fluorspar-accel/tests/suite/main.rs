//! Tests of the traversal from outside, in one program.

mod common;
mod instances;
mod traversal;
