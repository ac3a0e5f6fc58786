//! Tests of files from outside, in one program.

mod camera_frames;
mod cubes;
mod fixtures;
mod foreign_spectra;
mod format_damage;
mod format_images;
mod format_matlab_and_meshes;
mod format_raw;
mod format_tables;
mod hostile_files;
