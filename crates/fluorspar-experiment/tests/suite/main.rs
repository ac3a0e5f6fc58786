//! Tests of experiment files and the catalogue, down to the images that come of them, in one program.

mod absurd_numbers;
mod analysis_regions;
mod bad_experiments;
mod camera_color;
mod channel_planes;
mod design;
mod design_renders;
mod documentation;
mod emission_sides;
mod excitation_basis;
mod experiment_files;
mod experiment_presets;
mod film;
mod fixtures;
mod instances;
mod lens_camera;
mod lens_catalogue;
mod lens_change;
mod long_experiments;
mod mesh_files;
mod mouth_appearance;
mod porphyrin_coverage;
mod porphyrin_region;
mod safety_of_captures;
mod scene_change;
mod scene_control;
mod sensor_files;
mod stage_digests;
mod steep_filters;
mod study_from_code;
#[path = "../../../fluorspar/tests/suite/support.rs"]
mod support;
mod target_noise;
mod tissue;
mod tissue_sites;
mod traced_experiment;
