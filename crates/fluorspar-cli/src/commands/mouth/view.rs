//! `fluorspar mouth view`: a contact sheet.

use clap::ValueHint;
use fluorspar::pipeline::{light_group_preview, reduce_to_preview};
use fluorspar_anatomy::{EXAMINATION_VIEWS, ExaminationView, POSES};
use fluorspar_experiment::{give_restorations_of, give_tissues_of, parse, resolve};
use fluorspar_format::{Output, Outputs, write_rgb_png};
use fluorspar_report::{ContactSheet, Raster};
use fluorspar_session::{ExperimentSource, render_scene};
use std::path::{Path, PathBuf};

use super::person::{PersonArgs, find_view};
use crate::commands::table::align;
use crate::error::CliError;
use crate::interrupt::interrupted;
use crate::message::Messages;
use crate::values::{self, Override, as_typed, sets};

/// Options of `mouth view`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    person: PersonArgs,
    /// Views, in this order [default: the nine of an examination and the four poses].
    #[arg(long, value_name = "VIEW", value_delimiter = ',')]
    views: Vec<String>,
    /// Experiment that gives lights and materials.
    #[arg(long, value_name = "EXPERIMENT", default_value = "oraleye-2021")]
    experiment: String,
    /// Group of lights that is on. Under white light surfaces are drawn in few bands and without fluorescence, which looks the
    /// same; under other light, with both.
    #[arg(long, value_name = "GROUP", default_value = "white")]
    light_group: String,
    /// Width of each image, pixels (64 to 2000); three quarters as high. Rows with fewer images have larger ones.
    #[arg(long, value_name = "PX", default_value_t = 240, value_parser = values::whole::<usize, 64, 2000>,
        allow_negative_numbers = true)]
    width: usize,
    /// Samples (paths) per pixel.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = values::whole::<u32, 1, 1_000_000>, allow_negative_numbers = true)]
    spp: u32,
    /// File of the contact sheet, .png.
    #[arg(long, value_name = "FILE.png", default_value = "mouth.png", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// List the views instead.
    #[arg(long)]
    list: bool,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    if options.list {
        let rows: Vec<Vec<String>> = EXAMINATION_VIEWS
            .iter()
            .chain(&POSES)
            .map(|view| vec![view.name.to_owned(), view.title.to_owned()])
            .collect();
        return crate::commands::print_text(&align(&rows, &[1]));
    }
    if !options.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Err(CliError::Input(format!("--out {}: the name must end in .png", options.out.display())));
    }
    let views: Vec<&ExaminationView> = if options.views.is_empty() {
        EXAMINATION_VIEWS.iter().chain(&POSES).collect()
    } else {
        options.views.iter().map(|name| find_view("--views", name)).collect::<Result<_, _>>()?
    };
    let experiment = PathBuf::from(&options.experiment);
    let set = Outputs::new().and(Output::file("--out", &options.out)).reading(&[experiment]).declare()?;
    // All poses are checked before the first image is made.
    for view in &views {
        options.person.parameters(Some(view.name))?;
    }
    let messages = Messages::default();
    let sheet = ContactSheet::new(views.len(), options.width);
    let mut pictures: Vec<(&str, Raster)> = Vec::new();
    for (view, [width, height]) in views.iter().zip(sheet.picture_sizes()) {
        messages.status(format!("{}: {}", view.name, view.title));
        pictures.push((view.name, picture(options, view, width, height)?));
    }
    let sheet = sheet.compose(&pictures).map_err(|error| CliError::Failed(error.to_string()))?;
    write_rgb_png(&options.out, sheet.width, sheet.height, sheet.pixels.as_flattened())?;
    set.finish()?;
    messages.status(format!("Wrote {}", options.out.display()));
    Ok(())
}

fn picture(
    options: &Options,
    view: &ExaminationView,
    width: usize,
    height: usize,
) -> Result<Raster, CliError> {
    let parameters = options.person.parameters(Some(view.name))?;
    let source = ExperimentSource::find(Some(&options.experiment))?;
    let mut overrides = vec![
        Override::of_option("render.samples_per_pixel", options.spp, format!("--spp {}", options.spp)),
        Override::set(&format!("render.width_px={width}")),
        Override::set(&format!("render.height_px={height}")),
        Override::set(&format!("camera.position_mm={:?}", view.camera_mm)),
        Override::set(&format!("camera.look_at_mm={:?}", view.look_at_mm)),
        Override::set(&format!("camera.horizontal_field_deg={}", view.horizontal_field_deg())),
    ];
    let mouth = toml::Value::try_from(&parameters)
        .map_err(|error| CliError::Failed(format!("can't write the parameters: {error}")))?;
    for (field, value) in mouth.as_table().into_iter().flatten() {
        // The person was checked before: what does not fit is the experiment.
        let typed = format!("--experiment {}", options.experiment);
        overrides.push(Override::of_option(&format!("mouth.{field}"), value, typed));
    }
    let base: &Path = &source.base_dir;
    let mut experiment = parse(&source.text, &source.name, base, &sets(&overrides))
        .map_err(|error| as_typed(error, &overrides))?;
    // Only light is looked at: a region that this view does not see is not a defect.
    experiment.file.analysis = None;
    if let Some(person) = options.person.person {
        give_tissues_of(person, &mut experiment.file).map_err(|error| CliError::Input(error.to_string()))?;
        give_restorations_of(person, &mut experiment.file);
        // This one takes the place of the person of the file
        experiment.file.mouth.iter_mut().for_each(|mouth| mouth.person = None);
    }
    let mut study = resolve(&experiment).map_err(|error| as_typed(error, &overrides))?.study;
    if !study.scene.light_groups.iter().any(|group| group.name == options.light_group) {
        let known: Vec<&str> = study.scene.light_groups.iter().map(|group| group.name.as_str()).collect();
        return Err(CliError::Input(format!(
            "--light-group {}: the experiment has no such light group. Known: {}",
            options.light_group,
            known.join(", ")
        )));
    }
    reduce_to_preview(&mut study, &options.light_group);
    let components = render_scene(&study.scene, &study.render, None, &Messages::default().job())?;
    if interrupted() {
        return Err(CliError::Stopped("interrupted: a picture is missing, and nothing was written".into()));
    }
    let preview = light_group_preview(&components.recombine(|_| 1.0), &study, &options.light_group);
    Raster::from_rgb8(preview.width, preview.height, &preview.rgb)
        .ok_or_else(|| CliError::Failed("an image without pixels".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_light_that_shows_colors_is_drawn_without_fluorescence() {
        for (group, dyes, bands) in [("white", false, 21), ("blue", true, 81)] {
            let source = ExperimentSource::find(Some("oraleye-2021-surface")).unwrap();
            let mut study = source.resolve(&[Override::set("mouth.detail=0.25")]).unwrap().study;
            reduce_to_preview(&mut study, group);
            let scene = &study.scene;
            assert_eq!((!scene.fluorophores.is_empty(), scene.grid.len()), (dyes, bands), "{group}");
            assert_eq!((scene.lights.len(), scene.light_groups.len()), (8, 1));
            assert!(scene.check().is_ok() && scene.lights.iter().all(|light| light.group == 0));
        }
    }
}
