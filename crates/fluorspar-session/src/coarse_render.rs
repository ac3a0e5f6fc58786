//! Renders that are coarser than the sensor that looks at them, or of another lens.

use std::cell::LazyCell;

use fluorspar::image::{ComponentImage, LightPath};
use fluorspar::pipeline::{columns_per_column_to_render, columns_per_render_column};
use fluorspar::study::Study;
use fluorspar_experiment::schema::ExperimentFile;
use fluorspar_experiment::{Experiment, ResolvedExperiment, Warning, resolve_captures};
use fluorspar_report::stopped_early;

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

/// What frames of an image may be mistaken for. `labels` is the image, of which only size, place and labels count, `rendered` the
/// experiment that it was rendered from, where it is known.
pub fn image_warnings(
    labels: &ComponentImage,
    rendered: Option<&Experiment>,
    experiment: &ResolvedExperiment,
) -> Vec<Warning> {
    let of_render = LazyCell::new(|| captures_of(labels, rendered?));
    let coarse = coarse_image(labels, &of_render, &experiment.study);
    let has_lens_of_render =
        experiment.record.experiment.as_deref().zip(rendered).is_none_or(|(now, then)| {
            (&now.lens, now.camera.aperture_mm) == (&then.file.lens, then.file.camera.aperture_mm)
        });
    let blurred = if has_lens_of_render { None } else { kept_blur(of_render.as_ref(), &experiment.study) };
    let other =
        rendered.zip(experiment.record.experiment.as_deref()).and_then(|(then, now)| other_file(then, now));
    let render = rendered.map(|then| &then.file.render);
    let by_error = render.is_some_and(|then| then.relative_error.is_some() && then.time_limit_s.is_none());
    let stopped = render.and_then(|then| stopped_early(labels, then.samples_per_pixel, by_error));
    coarse.into_iter().chain(blurred).chain(other).chain(stopped).collect()
}

/// Warns of a file that has changed since the render, where the digests that it held were taken away.
fn other_file(rendered: &Experiment, now: &ExperimentFile) -> Option<Warning> {
    let then = &rendered.file.files;
    let (path, _) =
        then.iter().find(|(path, known)| now.files.get(*path).is_some_and(|now| now != *known))?;
    Some(Warning::explained(
        format!("{path} has changed since the render, which shows the old one"),
        "What is told of lights and surfaces is that of the new one; render anew",
    ))
}

/// The captures of the experiment that an image was rendered from.
fn captures_of(labels: &ComponentImage, rendered: &Experiment) -> Option<Study> {
    let held = labels.components.iter().filter_map(|component| match &component.light {
        LightPath::Fluorescence(name) => Some(name.as_str()),
        _ => None,
    });
    Some(resolve_captures(rendered, rendered, &held.collect::<Vec<_>>()).ok()??.study)
}

/// Warns of another f-number or focus than those of the render, whose blur frames keep.
fn kept_blur(rendered: Option<&Study>, now: &Study) -> Option<Warning> {
    /// Share by which apertures or distances differ that can be seen.
    const SEEN: f32 = 0.01;
    let [then, now] = [rendered?, now].map(|study| study.scene.camera.aperture.as_ref());
    let (then, now) = then.zip(now)?;
    let differ = |a: f32, b: f32| (a / b - 1.0).abs() > SEEN;
    if !differ(then.radius(), now.radius()) && !differ(then.focus(), now.focus()) {
        return None;
    }
    let text = |radius: f32, focus: f32| format!("{:.2} mm in focus at {:.0} mm", 2e3 * radius, 1e3 * focus);
    let [of_render, of_now] = [text(then.radius(), then.focus()), text(now.radius(), now.focus())];
    Some(Warning::explained(
        "frames keep the blur of the render, not that of the new f-number or focus",
        format!("It has an aperture of {of_render}; render anew to see that of {of_now}"),
    ))
}

/// Warns of a render that is coarser than a sensor, unless it was as coarse for the sensor that it was made for.
fn coarse_image(
    labels: &ComponentImage,
    of_render: &LazyCell<Option<Study>, impl FnOnce() -> Option<Study>>,
    study: &Study,
) -> Option<Warning> {
    let covered = columns_per_render_column(study, labels)?;
    if covered <= MOST_COLUMNS {
        return None;
    }
    let made_for = of_render.as_ref().and_then(|found| columns_per_render_column(found, labels));
    if !is_beyond(covered, MOST_COLUMNS.max(1.01 * made_for.unwrap_or(0.0))) {
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
