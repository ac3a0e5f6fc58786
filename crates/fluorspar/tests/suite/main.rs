//! Tests of the library from outside, in one program: it links once. `cargo test -p fluorspar --test suite light_transport::`
//! runs one file.

mod architecture;
mod light_transport;
mod region_interval;
mod support;
mod transport_correctness;
