//! Renders that are coarser than the sensor that looks at them.

use fluorspar::image::{ComponentImage, LightPath};
use fluorspar::pipeline::{columns_per_column_to_render, columns_per_render_column};
use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, ResolvedExperiment, Warning, resolve_captures};

/// Columns of the sensor that one of a render may cover before its pixels are seen as blocks.
const MOST_COLUMNS: f64 = 2.0;
/// The same of a render that is about to be made. Experiments for a first look render one pixel for 3 x 3 of the sensor, which means
/// over regions bear; a sensor that was changed for a finer one is beyond it.
const MOST_COLUMNS_OF_RUN: f64 = 4.0;

/// All that is known to be odd about an experiment before it is rendered: what `check` and `run` warn of.
pub fn warnings_before_run(experiment: &ResolvedExperiment) -> Vec<Warning> {
    experiment.record.warnings.iter().cloned().chain(coarse_render(&experiment.study)).collect()
}

/// Warns of an image that will be coarser than its sensor, before it is rendered. One object alone has nothing finer to show.
fn coarse_render(study: &Study) -> Option<Warning> {
    let covered = columns_per_column_to_render(study)?;
    let is_seen = is_beyond(covered, MOST_COLUMNS_OF_RUN) && study.scene.objects.len() > 1;
    is_seen.then(|| warning(study, covered, study.scene.camera.width, MOST_COLUMNS_OF_RUN))
}

/// Warns of a render that is coarser than a sensor, unless it was as coarse for the sensor that it was made for. `labels` is the image,
/// of which only size, place and labels count, `rendered` the experiment that it was rendered from, where it is known.
pub fn coarse_image(
    labels: &ComponentImage,
    rendered: Option<&Experiment>,
    study: &Study,
) -> Option<Warning> {
    let covered = columns_per_render_column(study, labels)?;
    if covered <= MOST_COLUMNS {
        return None;
    }
    let held: Vec<&str> = labels
        .components
        .iter()
        .filter_map(|component| match &component.light {
            LightPath::Fluorescence(name) => Some(name.as_str()),
            _ => None,
        })
        .collect();
    let made_for = rendered
        .and_then(|experiment| resolve_captures(experiment, experiment, &held).ok()?)
        .and_then(|found| columns_per_render_column(&found.study, labels))
        .unwrap_or(0.0);
    if !is_beyond(covered, MOST_COLUMNS.max(1.01 * made_for)) {
        return None;
    }
    // What is rendered for this sensor is judged as `run` judges it
    Some(warning(study, covered, labels.width, MOST_COLUMNS_OF_RUN.min(covered)))
}

/// Rounding of a field of view in single precision, relative.
const ROUNDING: f64 = 1e-6;

/// Whether a render is coarser than allowed, but for rounding.
fn is_beyond(covered: f64, most: f64) -> bool {
    covered > most * (1.0 + ROUNDING)
}

/// The warning with the smallest image that is not warned of, as wide to its height as the sensor.
fn warning(study: &Study, covered: f64, width: usize, most: f64) -> Warning {
    let wanted = (width as f64 * covered / most * (1.0 - ROUNDING)).ceil();
    let height = study.camera.sensor.as_ref().map_or_else(String::new, |sensor| {
        let high_over_wide = sensor.model().height_mm() / sensor.model().width_mm();
        format!(" and render.height_px={:.0}", (wanted * high_over_wide).round().max(1.0))
    });
    Warning::from(format!(
        "one pixel of the render covers {covered:.1} x {covered:.1} pixels of the sensor: frames show blocks, and nothing finer. Render \
         with render.width_px={wanted}{height} or more, or bin the sensor: sensor.binning"
    ))
}
