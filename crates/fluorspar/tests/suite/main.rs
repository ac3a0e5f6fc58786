//! Tests of the library from outside, in one program: it links once. `cargo test -p fluorspar --test suite light_transport::`
//! runs one file.

mod architecture;
mod format_damage;
mod format_images;
mod format_matlab_and_meshes;
mod format_raw;
mod format_tables;
mod light_transport;
mod mesh_files;
mod region_interval;
mod support;
mod transport_correctness;
