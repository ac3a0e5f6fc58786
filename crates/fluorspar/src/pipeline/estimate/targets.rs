//! The targets of a study in its frames: which pixels see them, and how well.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use crate::analysis::{
    AnalysisError, ChannelNoise, LineNoise, PixelSelection, RenderNoise, SceneOnSensor, TargetDetection,
};
use crate::image::{CalibrationNoise, ChannelImage, SensorImage};
use crate::material::ImageTexture;
use crate::pipeline::PipelineError;
use crate::pipeline::capture::{CapturedFrame, SeenComponents};
use crate::sensor::{Sensor, SensorMode, noise_floor_dn};
use crate::study::{AnalysisPlan, Capture, Study, Target, TargetPlace};
use crate::warning::Warning;

/// Which target each pixel of the frames sees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TargetLabels {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Number of the target from 1, `[row, col]`; 0 where there is none.
    pub labels: Vec<u8>,
    /// Names of the targets, in the order of their numbers.
    pub names: Vec<String>,
}

/// Pixels between a target and the ring around it: what lies there holds light of both.
const GAP_PX: usize = 2;
/// Fewest pixels of a ring, and the farthest that it reaches.
const LEAST_RING: usize = 64;
const WIDEST_RING_PX: usize = 400;
/// Share of a spot from which a pixel belongs to it.
const HALF: f32 = 0.5;

/// Noise of the channels of a developed frame, from its first raw frame.
pub fn noise_of(image: &ChannelImage, raw: &SensorImage, sensor: &Sensor) -> ChannelNoise {
    let (model, dn_per_electron) = (sensor.model(), raw.dn_per_electron);
    // A flat field takes the spread of the pixels' response out, dark frames that of their dark signal.
    let is_calibrated = |by: fn(&CalibrationNoise) -> bool| image.calibration.as_ref().is_some_and(by);
    let prnu = if is_calibrated(|by| by.has_flat) { 0.0 } else { model.image_prnu_percent() / 100.0 };
    let dsnu =
        if is_calibrated(|by| by.has_dark) { 0.0 } else { dn_per_electron * model.image_dsnu_electrons() };
    // So does a frame that is subtracted with the offsets of lines, but for what its exposure scales
    let (again, left) = image
        .subtracted
        .as_ref()
        .map_or((1.0, 1.0), |light| (light.exposure_ratio.hypot(1.0), (1.0 - light.exposure_ratio).abs()));
    let left = if is_calibrated(|by| by.has_dark) { 0.0 } else { left };
    let noise = ChannelNoise::of_image(image, dn_per_electron, prnu, dsnu);
    if !matches!(model.mode, SensorMode::Physical | SensorMode::Isetcam { noise_flag: 2 }) {
        return noise;
    }
    let [of_rows, of_columns] = model.image_line_factors().map(f64::sqrt);
    let dn = |mv: f64| dn_per_electron * model.electrons_of_mv(mv);
    let lines = LineNoise {
        row_dn: again * of_rows * dn(model.row_noise_mv),
        column_dn: again * of_columns * dn(model.column_noise_mv),
        fixed_dn: [of_rows * dn(model.row_offset_mv), of_columns * dn(model.column_offset_mv)]
            .map(|dn| left * dn),
        column_gain: if is_calibrated(|by| by.has_flat) { 0.0 } else { model.image_column_gain() },
    };
    // The floor counts each read of a line as one of its pixel alone: what else is in it
    let of_lines_dn2 = model.image_reads() * dn(model.row_noise_mv.hypot(model.column_noise_mv)).powi(2);
    let share = (of_lines_dn2 / noise_floor_dn(raw).powi(2)).min(1.0);
    let floor_dn = (noise.floor_dn.powi(2) - share * image.noise_floor_dn.powi(2)).max(0.0).sqrt();
    ChannelNoise { floor_dn, lines, ..noise }
}

/// What the frames tell of the targets of a study.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct MeasuredTargets {
    /// Each target in each frame with light.
    pub(super) detections: Vec<TargetDetection>,
    /// Which target each pixel sees; `None` without targets.
    pub(super) labels: Option<TargetLabels>,
    /// Targets that can't be measured, with the reason.
    pub(super) warnings: Vec<Warning>,
}

/// Measures the targets of the analysis of a study in all its frames with light. `scene` tells where parts and spots are, `components`
/// what the frames show without the sensor's noise.
///
/// # Errors
/// A region that does not fit the frames.
pub(super) fn measured_targets(
    study: &Study,
    plan: &AnalysisPlan,
    frames: &[CapturedFrame],
    components: Option<&SeenComponents<'_>>,
    scene: Option<SceneOnSensor<'_>>,
) -> Result<MeasuredTargets, PipelineError> {
    let mut found = MeasuredTargets::default();
    let is_lit = |capture: &Capture| capture.frame.lights.values().any(|drive| *drive > 0.0);
    let mut lit: Vec<&CapturedFrame> =
        frames.iter().filter(|frame| study.capture(&frame.raw.label).is_some_and(is_lit)).collect();
    let (Some(first), Some(sensor)) = (lit.first(), &study.camera.sensor) else { return Ok(found) };
    if plan.targets.is_empty() {
        return Ok(found);
    }
    let (width, height) = (first.developed.width, first.developed.height);
    lit.retain(|frame| (frame.developed.width, frame.developed.height) == (width, height));
    let labels = labeled(&plan.targets, width, height, scene, &mut found.warnings)?;
    for (index, target) in plan.targets.iter().enumerate().take(labels.names.len()) {
        let number = index + 1;
        let is_its_own = |pixel: &usize| usize::from(labels.labels[*pixel]) == number;
        let pixels = (0..labels.labels.len()).filter(is_its_own).collect::<Vec<_>>();
        if pixels.is_empty() {
            continue;
        }
        let pixels = PixelSelection { width, height, pixels };
        let background = background(target, &labels, &pixels, scene)?;
        let mm_per_px = mm_per_pixel(study, sensor, &pixels, scene);
        for frame in &lit {
            let image = &frame.developed;
            let noise = noise_of(image, &frame.raw, sensor);
            let places = [&pixels, &background];
            let render = components.zip(scene).and_then(|(components, scene)| {
                render_noise(study, sensor, components, scene, frame, places)
            });
            match TargetDetection::new(
                &target.name,
                image,
                &noise,
                places,
                plan.wanted_d_prime,
                render.as_ref(),
            ) {
                Some(measured) => found.detections.push(TargetDetection {
                    number,
                    smallest_diameter_mm: mm_per_px.map(|mm| mm * measured.smallest_diameter_px),
                    ..measured
                }),
                None => {
                    let text = format!(
                        "Target \"{}\" in \"{}\": too few usable pixels, or no noise, to tell it from its background",
                        target.name, image.label
                    );
                    found.warnings.push(text.into());
                }
            }
        }
    }
    found.labels = Some(labels);
    Ok(found)
}

/// Which of some targets each pixel of frames of `width` columns and `height` rows sees, of several the first.
///
/// # Errors
/// A region that does not fit the frames.
pub fn target_labels(
    targets: &[Target],
    [width, height]: [usize; 2],
    scene: SceneOnSensor<'_>,
) -> Result<TargetLabels, PipelineError> {
    labeled(targets, width, height, Some(scene), &mut Vec::new())
}

/// Which target each pixel sees, of several the first. Tells of targets that no pixel sees.
fn labeled(
    targets: &[Target],
    width: usize,
    height: usize,
    scene: Option<SceneOnSensor<'_>>,
    warnings: &mut Vec<Warning>,
) -> Result<TargetLabels, PipelineError> {
    let mut found = TargetLabels { width, height, labels: vec![0; width * height], names: Vec::new() };
    if targets.len() > Target::MOST {
        let text = format!(
            "Of {} targets the first {} are measured: the image of labels has no more numbers",
            targets.len(),
            Target::MOST
        );
        warnings.push(text.into());
    }
    for (target, number) in targets.iter().zip(1..=u8::MAX) {
        found.names.push(target.name.clone());
        let pixels = pixels_of(target, width, height, scene)?;
        match &pixels {
            Some(pixels) if pixels.is_empty() => {
                warnings.push(format!("Target \"{}\": no pixel of the frames sees it", target.name).into());
            }
            Some(_) => {}
            None => {
                let text = format!(
                    "Target \"{}\": only a component image tells where it lies; give a mask, a polygon or a rectangle",
                    target.name
                );
                warnings.push(text.into());
            }
        }
        for pixel in pixels.into_iter().flatten() {
            if found.labels[pixel] == 0 {
                found.labels[pixel] = number;
            }
        }
    }
    Ok(found)
}

/// Pixels of a target; `None` where only a scene could tell them and there is none.
fn pixels_of(
    target: &Target,
    width: usize,
    height: usize,
    scene: Option<SceneOnSensor<'_>>,
) -> Result<Option<Vec<usize>>, PipelineError> {
    match &target.place {
        TargetPlace::Region(region) if region.parts.is_empty() || scene.is_some() => {
            let selected = region.select(width, height, scene).map_err(AnalysisError::from)?;
            Ok(Some(selected.pixels))
        }
        TargetPlace::Region(_) => Ok(None),
        TargetPlace::Spot(spot) => Ok(scene.and_then(|scene| pixels_of_spot(spot, width, height, scene))),
    }
}

/// Pixels that show a spot painted on parts, where its map is at least a half; `None` of images without parts or their coordinates.
fn pixels_of_spot(
    spot: &[(String, Arc<ImageTexture>)],
    width: usize,
    height: usize,
    scene: SceneOnSensor<'_>,
) -> Option<Vec<usize>> {
    let features = &scene.components.features;
    let count = scene.components.width * scene.components.height;
    if features.part.len() != count || features.uv.len() != count {
        return None;
    }
    let shows = |pixel: usize| {
        let Some(part) = usize::from(features.part[pixel]).checked_sub(1) else { return false };
        let map = features.part_names.get(part).and_then(|name| spot.iter().find(|(on, _)| on == name));
        map.is_some_and(|(_, map)| map.at(Vec2::from_array(features.uv[pixel])) >= HALF)
    };
    let behind =
        |pixel: &usize| scene.scene_pixel(pixel / width, pixel % width, width, height).is_some_and(shows);
    Some((0..width * height).filter(behind).collect())
}

/// What a target is told from: the region that is given, or a ring around it, of its own parts if it is a spot on them. No pixel of a
/// target belongs to it.
fn background(
    target: &Target,
    labels: &TargetLabels,
    pixels: &PixelSelection,
    scene: Option<SceneOnSensor<'_>>,
) -> Result<PixelSelection, PipelineError> {
    let (width, height) = (labels.width, labels.height);
    let is_free = |pixel: &usize| labels.labels[*pixel] == 0;
    if let Some(region) = &target.background {
        let mut selected = region.select(width, height, scene).map_err(AnalysisError::from)?;
        selected.pixels.retain(is_free);
        return Ok(selected);
    }
    let is_of_its_parts = |pixel: usize| {
        let (TargetPlace::Spot(spot), Some(scene)) = (&target.place, scene) else { return true };
        let features = &scene.components.features;
        let behind = scene.scene_pixel(pixel / width, pixel % width, width, height);
        let part = behind.and_then(|behind| usize::from(features.part[behind]).checked_sub(1));
        let name = part.and_then(|part| features.part_names.get(part));
        name.is_some_and(|name| spot.iter().any(|(on, _)| on == name))
    };
    let mut reached = vec![false; width * height];
    pixels.pixels.iter().for_each(|&pixel| reached[pixel] = true);
    let (mut rim, mut ring) = (pixels.pixels.clone(), Vec::new());
    let wanted = pixels.pixels.len().max(LEAST_RING);
    for step in 0..WIDEST_RING_PX {
        rim = grown(&rim, &mut reached, width, height, step % 2 == 1);
        if step >= GAP_PX {
            ring.extend(rim.iter().copied().filter(|pixel| is_free(pixel) && is_of_its_parts(*pixel)));
        }
        if rim.is_empty() || ring.len() >= wanted {
            break;
        }
    }
    ring.sort_unstable();
    Ok(PixelSelection { width, height, pixels: ring })
}

/// Pixels beside a rim that were not reached yet; those at its corners, too, in every second step: what grows is round.
fn grown(rim: &[usize], reached: &mut [bool], width: usize, height: usize, with_corners: bool) -> Vec<usize> {
    let mut next = Vec::new();
    for &pixel in rim {
        let (row, col) = (pixel / width, pixel % width);
        for r in row.saturating_sub(1)..=(row + 1).min(height - 1) {
            for c in col.saturating_sub(1)..=(col + 1).min(width - 1) {
                let other = r * width + c;
                if !reached[other] && (with_corners || r == row || c == col) {
                    reached[other] = true;
                    next.push(other);
                }
            }
        }
    }
    next
}

/// Fewest differences of neighboring pixels of a render that its noise is found from.
const LEAST_DIFFERENCES: usize = 32;

/// Noise of the render in a frame, on a target and its background: the second differences of neighboring pixels of the render, along rows
/// and columns, which are `(a - 2 b + c) / sqrt(6)` of independent noise. Structure as fine as a pixel of the render counts as its noise:
/// no frame of this render shows more of it. `None` for too few neighbors.
fn render_noise(
    study: &Study,
    sensor: &Sensor,
    components: &SeenComponents<'_>,
    scene: SceneOnSensor<'_>,
    frame: &CapturedFrame,
    places: [&PixelSelection; 2],
) -> Option<RenderNoise> {
    let capture = study.capture(&frame.raw.label)?;
    let rates = |capture: &Capture| {
        components.film_rates(capture, |component| capture.frame.drive(&component.light_group)).data
    };
    let mut seen = rates(capture);
    // Light that both frames hold is subtracted with its noise
    if let Some(other) = capture.subtract.as_deref().and_then(|label| study.capture(label)) {
        seen.iter_mut().zip(rates(other)).for_each(|(value, other)| *value -= other);
    }
    let (width, height) = (scene.components.width, scene.components.height);
    let mut place = vec![0u8; width * height];
    for (pixels, number) in places.into_iter().zip(1..) {
        scene.scene_pixels(pixels).into_iter().for_each(|pixel| place[pixel] = number);
    }
    let names = sensor.qe().channels();
    let of_name = |name: &String| names.iter().position(|channel| channel.name == *name);
    let numbers: Vec<usize> = frame.developed.channels.iter().map(of_name).collect::<Option<_>>()?;
    let dn = sensor.frame_light_s(frame.raw.exposure_s) * frame.raw.dn_per_electron / 6f64.sqrt();
    let at = |channel: usize, pixel: usize| f64::from(seen[channel * width * height + pixel]);
    let mut sums = vec![vec![0.0; numbers.len()]; numbers.len()];
    let mut count = 0usize;
    let mut add = |[a, b, c]: [usize; 3]| {
        if place[b] == 0 || place[a] != place[b] || place[c] != place[b] {
            return;
        }
        let differences: Vec<f64> =
            numbers.iter().map(|&n| dn * (at(n, a) - 2.0 * at(n, b) + at(n, c))).collect();
        for (row, x) in sums.iter_mut().zip(&differences) {
            row.iter_mut().zip(&differences).for_each(|(sum, y)| *sum += x * y);
        }
        count += 1;
    };
    for pixel in 0..width * height {
        let (row, col) = (pixel / width, pixel % width);
        if (1..width - 1).contains(&col) {
            add([pixel - 1, pixel, pixel + 1]);
        }
        if (1..height - 1).contains(&row) {
            add([pixel - width, pixel, pixel + width]);
        }
    }
    sums.iter_mut().flatten().for_each(|sum| *sum /= count.max(1) as f64);
    let [of_width, of_height] = scene.film_over_sensor;
    let image = &frame.developed;
    (count >= LEAST_DIFFERENCES).then(|| RenderNoise {
        covariance_dn2: sums,
        frame_per_render: [
            image.width as f64 * of_width / width as f64,
            image.height as f64 * of_height / height as f64,
        ],
        samples_per_pixel: scene.components.samples_per_pixel,
    })
}

/// Side of a square on the surface of a target that covers one pixel of the frames, mm: at the mean distance of its pixels and tilted as
/// they are, or in the plane in focus. `None` where neither is known.
fn mm_per_pixel(
    study: &Study,
    sensor: &Sensor,
    pixels: &PixelSelection,
    scene: Option<SceneOnSensor<'_>>,
) -> Option<f64> {
    // Frames may hold a part of the sensor, in pixels that are joined
    let model = sensor.model();
    let columns_of_sensor =
        model.columns as f64 / model.binning.map_or(1.0, |binning| binning.columns as f64);
    let seen = scene.and_then(|scene| {
        let features = &scene.components.features;
        let tan = f64::from(features.view?.tan_half_width);
        let (columns, rows) = (scene.components.width as f64, scene.components.height as f64);
        // The distance along the axis from that along the ray
        let depth = |&behind: &usize| {
            let along = f64::from(*features.depth_m.get(behind)?);
            let x = ((behind % scene.components.width) as f64 + 0.5) / columns * 2.0 - 1.0;
            let y = (((behind / scene.components.width) as f64 + 0.5) / rows * 2.0 - 1.0) * rows / columns;
            let depth = along / (1.0 + tan * tan * (x * x + y * y)).sqrt();
            depth.is_finite().then_some(depth)
        };
        let depths: Vec<f64> = scene.scene_pixels(pixels).iter().filter_map(depth).collect();
        let mean = depths.iter().sum::<f64>() / depths.len() as f64;
        let across = 2e3 * tan * mean / scene.film_over_sensor[0];
        let tilt = area_over_projection(scene, pixels).unwrap_or(1.0);
        Some(tilt.sqrt() * across / columns_of_sensor).filter(|mm| mm.is_finite())
    });
    seen.or_else(|| {
        let lens = &study.camera.lens.as_ref()?.equation;
        let distance_mm = lens.object_distance_mm?;
        let field_deg = 1.0f64;
        let magnification =
            lens.film_width_mm(field_deg) / (2.0 * distance_mm * (0.5 * field_deg).to_radians().tan());
        Some(sensor.film_extent().width_mm / columns_of_sensor / magnification)
    })
}

/// Most that a tilt enlarges a surface over its projection: beyond it the relief hides most of it.
const MOST_TILT: f64 = 10.0;

/// Area of the surface behind some pixels over that of its projection on a plane across the axis of the camera: the mean cosines of the
/// rays with the axis over those with the surface. `None` where the surface is not known.
fn area_over_projection(scene: SceneOnSensor<'_>, pixels: &PixelSelection) -> Option<f64> {
    let features = &scene.components.features;
    let view = features.view?;
    let (forward, right) = (Vec3::from_array(view.forward), Vec3::from_array(view.right));
    let down = forward.cross(right);
    let (width, height) = (scene.components.width, scene.components.height);
    let (mut with_axis, mut with_surface) = (0.0f64, 0.0f64);
    for pixel in scene.scene_pixels(pixels) {
        let normal = Vec3::from_array(*features.normal.get(pixel)?);
        let x = ((pixel % width) as f32 + 0.5) / width as f32 * 2.0 - 1.0;
        let y = (((pixel / width) as f32 + 0.5) / height as f32 * 2.0 - 1.0) * height as f32 / width as f32;
        let ray = (forward + (right * x + down * y) * view.tan_half_width).normalize();
        with_axis += f64::from(ray.dot(forward));
        with_surface += f64::from(ray.dot(normal).abs());
    }
    let ratio = with_axis / with_surface;
    ratio.is_finite().then(|| ratio.clamp(1.0, MOST_TILT))
}
