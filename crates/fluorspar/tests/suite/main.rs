//! Tests of the library from outside, in one program: it links once. `cargo test -p fluorspar --test suite light_transport::`
//! runs one file.

mod architecture;
mod function_lengths;
mod light_transport;
mod proportion;
mod region_interval;
mod region_mean;
mod share_bound;
mod support;
#[path = "../tissue_benchmarks/mod.rs"]
mod tissue_benchmarks;
mod tissue_monte_carlo;
mod tissue_solvers;
mod transport_correctness;
mod visible_surfaces;
