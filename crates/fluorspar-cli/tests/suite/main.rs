//! Tests of the command, in one program. What a signal, a limit or the environment changes is a process of its own, which
//! a test starts.

mod bad_input;
mod budget;
mod cache;
mod cohort;
mod compare;
mod dataset;
mod design;
mod documentation;
mod examples;
mod fluorophores;
mod frames;
mod instruments;
mod kills;
mod lenses;
mod memory;
mod messages;
mod mixture_fits;
mod mouths;
mod old_calls;
mod out_folder;
mod outputs;
mod pbrt;
mod photographs;
mod predict;
mod report_pages;
mod scene;
mod sensor;
mod stages;
mod streams;
mod support;
mod surroundings;
mod survival;
mod tissue;
mod validate;
mod workbench;
