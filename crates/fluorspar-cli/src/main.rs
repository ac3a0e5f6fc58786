//! The `fluorspar` program.

use std::process::ExitCode;

use fluorspar_accel::{Allocator, return_freed_memory_at_once};

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

fn main() -> ExitCode {
    // Commands that do not render end soon: what they give back they would ask for again, and the system has to clear it each time.
    fluorspar_cli::main(std::env::args_os(), return_freed_memory_at_once)
}
