//! Experiments as TOML files, with units in every name: a front that makes a [`fluorspar::study::Study`] from them,
//! and the catalogue that ships with it.
//!
//! | step | call | file |
//! |---|---|---|
//! | text to tree, with the line of every value | [`parse`] | `document.rs` |
//! | base experiment below, overrides above | [`parse`] | `merge.rs`, `scene_change.rs` |
//! | tree to typed sections | [`parse`] | `read.rs`, `schema/` |
//! | sections to a study | [`resolve`] | `resolve/` |
//! | paths with wildcards, parts by name, the tree of a scene | [`SceneChange`], [`scene_nodes`] | `scene_path.rs`, `scene_parts.rs`, `scene_tree.rs` |
//! | changes written into a file, and files of changes | [`edit_experiment`], [`parse_script`] | `scene_edit.rs`, `scene_script.rs` |
//! | what two experiments set differently, by path | [`setting_differences`] | `setting_difference.rs` |
//! | sections to text | [`file_text()`] | `file_text.rs` |
//! | the small file of a flat sample | [`parse_sample`] | `sample.rs` |
//! | the small file of a sensor | [`parse_sensor`] | `sensor_file.rs` |
//! | the small file of plane layers | [`parse_layers`] | `layers_file.rs` |
//! | the small file of one tissue | [`parse_tissue`] | `tissue_file.rs` |
//! | the file of a design problem | [`parse_design`] | `design/` |
//! | the file of a cohort | [`parse_cohort`] | `cohort.rs` |
//! | catalogue: lights, filters, tissues, sensors, lenses, experiments | [`preset`] | `preset/`, `data/` |
//!
//! Every error names file, line, entry, field and value, says what is wrong and how to fix it. No stage of the physics
//! knows of this crate.

mod cache;
mod change;
mod cohort;
mod design;
mod document;
mod error;
mod file_text;
mod mouth_view;
mod part_file;
mod people;
mod read;
mod resolve;
mod scene;
mod setting_difference;

pub mod preset;
pub mod schema;

pub use cache::{PassingSurfaces, cache, cached_mouth, keep_no_surfaces, use_cache};
pub use change::scene_change::SceneChange;
pub use cohort::{CohortFile, CohortQuestion, CohortStudy, PeopleSection, parse_cohort};
pub use design::{
    CohortSection, ComparedDesign, ComparedDesignSection, CriterionChoice, DesignFile, DesignQuestion,
    DesignRegion, DesignRender, DesignRenders, ExcitationSection, ExposuresSection, IdealBandsSection,
    LedSeriesSection, LimitsSection, LongPassSection, RegionSection, RenderedRegionSection, ResolvedDesign,
    SearchSection, UnknownsSection, VarySection, WheelFilterSection, WhiteFrameSection, parse_design,
};
pub use error::{BlamedOverride, ErrorDetails, ExperimentError, PathsFrom};
pub use file_text::file_text;
pub use fluorspar::warning::Warning;
pub use fluorspar_anatomy::{EXAMINATION_VIEWS, ExaminationView, POSES};
use fluorspar_format::FileFormat;
pub use part_file::layers::{
    LayerEmissionSection, LayerSection, LayersFile, ResolvedEmission, ResolvedLayers, parse_layers,
};
pub use part_file::sample::{
    MeasuredLight, ResolvedSample, SampleCompatibility, SampleExposure, SampleFile, SampleLight,
    SampleMaterial, SampleSurface, SampleTissue, is_experiment, is_sample, parse_sample,
};
pub use part_file::sensor::{ResolvedSensor, SensorFile, parse_sensor};
pub use part_file::tissue::{TissueFile, parse_tissue};
pub use people::{
    Person, give_restorations_of, give_tissues_of, has_drawn_restorations, people_csv, restoration_name,
};
pub use read::{Experiment, parse, parse_changed};
pub use resolve::cached_analysis::{CachedAnalysis, cached_analysis};
pub use resolve::named_tissue::NamedTissue;
pub use resolve::{
    CapturesOfRender, FileRecord, InputFile, ResolvedExperiment, check_settings, resolve, resolve_captures,
    resolve_rendered, resolve_shapes, resolve_unlit, section_of_other_surfaces, show_the_same_scene,
    with_sampling_of,
};
pub use scene::edit::edit_experiment;
pub use scene::script::{parse_script, script_text};
pub use scene::tree::{SceneNode, SceneValue, scene_nodes, scene_values};
pub use setting_difference::{SettingDifference, setting_differences};

/// JSON schema of an experiment file, with units, ranges and defaults as descriptions.
pub fn json_schema() -> serde_json::Value {
    json_schema_of::<schema::ExperimentFile>()
}

/// JSON schema of the file of a design problem.
pub fn design_json_schema() -> serde_json::Value {
    let mut schema = json_schema_of::<DesignFile>();
    let version = FileFormat::DESIGN.version();
    if let Some(format) = schema.pointer_mut("/properties/format") {
        *format = serde_json::json!({
            "description": format!("Version of the form of this file: {version}."), "type": "integer", "minimum": version, "maximum": version
        });
    }
    schema
}

/// JSON schema of a kind of file by the type of its sections: [`SampleFile`], [`SensorFile`], [`LayersFile`], [`CohortFile`].
pub fn json_schema_of<T: schemars::JsonSchema>() -> serde_json::Value {
    let mut schema = with_mosaic_letters(schemars::schema_for!(T).to_value());
    tidy(&mut schema);
    schema
}

/// Allows a table without its tag wherever one variant is the default, and takes defaults away that say that there is none.
fn tidy(schema: &mut serde_json::Value) {
    let default = schema.get("x-default").cloned();
    if let (Some(default), Some(variants)) =
        (default, schema.get_mut("oneOf").and_then(serde_json::Value::as_array_mut))
    {
        for variant in variants {
            let properties = variant.get("properties").and_then(serde_json::Value::as_object);
            let tag =
                properties.into_iter().flatten().find(|(_, value)| value.get("const") == Some(&default));
            let Some(tag) = tag.map(|(name, _)| name.clone()) else { continue };
            if let Some(required) = variant.get_mut("required").and_then(serde_json::Value::as_array_mut) {
                required.retain(|name| *name != tag);
            }
        }
    }
    match schema {
        serde_json::Value::Object(parts) => {
            parts.retain(|_, value| !value.is_null());
            parts.values_mut().for_each(tidy);
        }
        serde_json::Value::Array(parts) => parts.iter_mut().for_each(tidy),
        _ => {}
    }
}

/// Allows a mosaic in letters, which is spelled out before the sections are typed.
fn with_mosaic_letters(mut schema: serde_json::Value) -> serde_json::Value {
    if let Some(mosaic) = schema.pointer_mut("/$defs/SensorSection/properties/mosaic") {
        let rows = mosaic.take();
        *mosaic = serde_json::json!({
            "description": "Repeating cell of the color filter array: channel names by row, or letters such as \"grbg\", or \"mono\".",
            "anyOf": [rows, { "type": "string" }]
        });
    }
    schema
}

/// Name of the experiment that runs when none is named.
pub const DEFAULT_EXPERIMENT: &str = "oraleye-2021";

/// Name of the flat sample that is predicted when none is named.
pub const DEFAULT_SAMPLE: &str = "tongue-385nm";

/// Name of the design problem that is solved when none is named.
pub const DEFAULT_DESIGN: &str = "two-lights";
