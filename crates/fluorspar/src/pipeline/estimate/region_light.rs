//! Electrons of a region by where their light was emitted: what a simulation knows and a camera does not.

use std::collections::BTreeSet;

use super::region_signal::CameraResponse;
use crate::analysis::{Analyte, PixelSelection, RegionLight};
use crate::image::{ChannelImage, Component, ComponentImage, InterpolationTaps, LightPath};
use crate::pipeline::PipelineError;
use crate::pipeline::capture::film_irradiance::{behind_filter, on_sensor};
use crate::pipeline::capture::{CapturedFrame, SeenComponents};
use crate::sensor::{ElectronRate, Sensor};
use crate::study::{Capture, Study};

/// A region of the developed frame as pixels of the sensor.
pub(super) struct RegionOnMosaic<'a> {
    sensor: &'a Sensor,
    /// Weight of each pixel of the sensor in the mean of its channel; 0 outside of the region.
    weights: Vec<f32>,
    /// Pixels of each channel.
    pub(super) counts: Vec<usize>,
}

impl<'a> RegionOnMosaic<'a> {
    /// The pixels behind a region, or all of them. Pixels of a binned frame are blocks of pixels of the sensor.
    pub(super) fn new(sensor: &'a Sensor, region: Option<&PixelSelection>) -> Self {
        let model = sensor.model();
        let (columns, rows) = (model.columns, model.rows);
        let mut weights = vec![f32::from(u8::from(region.is_none())); columns * rows];
        if let Some(region) = region {
            let [first_column, first_row, width, height] = model.region_px.unwrap_or([0, 0, columns, rows]);
            let (wide, high) = (width / region.width.max(1), height / region.height.max(1));
            for &pixel in &region.pixels {
                let left = first_column + (pixel % region.width) * wide;
                let top = first_row + (pixel / region.width) * high;
                for row in top..(top + high).min(rows) {
                    weights[row * columns + left..row * columns + (left + wide).min(columns)].fill(1.0);
                }
            }
        }
        Self::weighted(sensor, weights)
    }

    /// The pixels behind a region of a frame whose colors were interpolated, each with the weight that it has in the mean of the region.
    ///
    /// Pixels of one color alone stand for places that lie up to half a pixel beside the region as a whole: where light falls off across
    /// it, their plain mean would not be that of the frame. Pixels beyond the region have no weight, though they enter at its rim, unless
    /// it holds none of a channel.
    fn interpolated(sensor: &'a Sensor, region: &PixelSelection, taps: &InterpolationTaps) -> Self {
        let model = sensor.model();
        let (columns, rows) = (model.columns, model.rows);
        let [first_column, first_row, width, height] = model.region_px.unwrap_or([0, 0, columns, rows]);
        if [width, height] != [region.width, region.height] {
            return Self::new(sensor, Some(region));
        }
        let mut is_inside = vec![false; width * height];
        region.pixels.iter().for_each(|&pixel| is_inside[pixel] = true);
        let mut weights = vec![0.0; columns * rows];
        for channel in 0..taps.mosaic().channels.len() {
            let holds_it = region.pixels.iter().any(|&pixel| taps.channel_of(pixel, width) == channel);
            for &pixel in &region.pixels {
                let own = || {
                    let entering = taps.entering([pixel / width, pixel % width], channel, [width, height]);
                    entering.filter(|(raw, _)| {
                        (is_inside[*raw] || !holds_it) && taps.channel_of(*raw, width) == channel
                    })
                };
                let total: f32 = own().map(|(_, weight)| weight).sum();
                for (raw, weight) in own().filter(|_| total > 0.0) {
                    let (row, column) = (first_row + raw / width, first_column + raw % width);
                    weights[row * columns + column] += weight / total;
                }
            }
        }
        Self::weighted(sensor, weights)
    }

    fn weighted(sensor: &'a Sensor, weights: Vec<f32>) -> Self {
        let columns = sensor.model().columns;
        let mut counts = vec![0_usize; sensor.qe().channels().len()];
        for (index, _) in weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
            counts[sensor.mosaic().channel(index / columns, index % columns)] += 1;
        }
        Self { sensor, weights, counts }
    }

    /// Weighted means of the pixels of each channel.
    pub(super) fn means(&self, rate: &ElectronRate) -> Vec<f64> {
        let columns = self.sensor.model().columns;
        let mut sums = vec![[0.0; 2]; self.counts.len()];
        let weighted = rate.data.iter().zip(&self.weights).enumerate();
        for (index, (value, weight)) in weighted.filter(|(_, (_, weight))| **weight != 0.0) {
            let [sum, weights] = &mut sums[self.sensor.mosaic().channel(index / columns, index % columns)];
            *sum += f64::from(*weight) * f64::from(*value);
            *weights += f64::from(*weight);
        }
        sums.into_iter().map(|[sum, weights]| if weights > 0.0 { sum / weights } else { 0.0 }).collect()
    }
}

/// The pixels of the sensor that stand behind a region of a developed frame.
fn behind<'a>(sensor: &'a Sensor, region: &PixelSelection, frame: &ChannelImage) -> RegionOnMosaic<'a> {
    match &frame.interpolation {
        Some(taps) => RegionOnMosaic::interpolated(sensor, region, taps),
        None => RegionOnMosaic::new(sensor, Some(region)),
    }
}

/// Drive of a light group in a capture, less that of the frame that is subtracted from it: development scales that frame to the
/// same exposure.
fn remaining_drive(study: &Study, capture: &Capture, group: &str) -> f64 {
    let subtracted = capture.subtract.as_ref().and_then(|label| study.capture(label));
    capture.frame.drive(group) - subtracted.map_or(0.0, |other| other.frame.drive(group))
}

/// Splits the expected electrons of a region of a developed frame by where their light was emitted: mean electrons per pixel, a
/// subtracted frame taken off. The channels are those whose light counts in the share that a family of tissues gives: R, G and B, or
/// all that see light of a camera that lacks one of these. `None` without lens or sensor.
///
/// # Errors
/// A film that can't be used.
pub(super) fn region_light(
    study: &Study,
    seen: &SeenComponents<'_>,
    capture: &Capture,
    porphyrin: &str,
    frame: &CapturedFrame,
    region: &PixelSelection,
) -> Result<Option<RegionLight>, PipelineError> {
    let (components, Some(sensor)) = (seen.image, &study.camera.sensor) else { return Ok(None) };
    let Some(lens) = study.camera.lens_behind_filters() else { return Ok(None) };
    let camera = CameraResponse::new(&behind_filter(&lens, capture), sensor, &study.scene.grid, None);
    let channels = camera.rgb().map_or_else(|| camera.seeing_channels(), |rgb| rgb.to_vec());
    let mosaic = behind(sensor, region, &frame.developed);
    let held = fluorophores_of_region(study, components, region);
    let light_s = sensor.frame_light_s(frame.raw.exposure_s);
    let electrons = |is: &dyn Fn(&LightPath) -> bool| -> Result<Vec<f64>, PipelineError> {
        let drive = |c: &Component| {
            if is(&c.light) { remaining_drive(study, capture, &c.light_group) } else { 0.0 }
        };
        if components.components.iter().all(|c| drive(c) == 0.0) {
            return Ok(vec![0.0; channels.len()]);
        }
        let rates = seen.film_rates(capture, drive);
        let means = mosaic.means(&sensor.electron_rate_of(&rates, seen.planes.film)?);
        Ok(channels.iter().map(|&channel| light_s * means[channel]).collect())
    };
    let is_porphyrin =
        |light: &LightPath| matches!(light, LightPath::Fluorescence(name) if name == porphyrin);
    let is_pigment = |light: &LightPath| matches!(light, LightPath::Fluorescence(name) if Analyte::names_plant_pigment(name));
    let is_held = |light: &LightPath| matches!(light, LightPath::Fluorescence(name) if held.contains(name));
    let is_other = |light: &LightPath| matches!(light, LightPath::Fluorescence(name) if !held.contains(name));
    Ok(Some(RegionLight {
        channels: channels.iter().map(|&channel| camera.channels()[channel].clone()).collect(),
        porphyrin: electrons(&is_porphyrin)?,
        bulk: electrons(&|light| is_held(light) && !is_porphyrin(light))?,
        pigment: electrons(&|light| is_held(light) && is_pigment(light))?,
        other_parts: electrons(&|light| is_other(light) && !is_porphyrin(light))?,
        fluoresced_twice: electrons(&|light| *light == LightPath::MultipleFluorescence)?,
        reflected: electrons(&|light| *light == LightPath::Reflected)?,
    }))
}

/// Mean electrons per pixel of each channel of a region by some ways of the light, a subtracted frame taken off; empty without a sensor.
///
/// # Errors
/// A film that can't be used.
pub(super) fn region_electrons(
    study: &Study,
    seen: &SeenComponents<'_>,
    capture: &Capture,
    frame: &CapturedFrame,
    region: &PixelSelection,
    is: &dyn Fn(&LightPath) -> bool,
) -> Result<Vec<f64>, PipelineError> {
    let Some(sensor) = &study.camera.sensor else { return Ok(Vec::new()) };
    let drive = |c: &Component| {
        if is(&c.light) { remaining_drive(study, capture, &c.light_group) } else { 0.0 }
    };
    let rates = seen.film_rates(capture, drive);
    let means =
        behind(sensor, region, &frame.developed).means(&sensor.electron_rate_of(&rates, seen.planes.film)?);
    let light_s = sensor.frame_light_s(frame.raw.exposure_s);
    Ok(means.into_iter().map(|rate| light_s * rate).collect())
}

/// Names of the fluorophores that the materials hold which the region shows; all names where the render kept no map of parts.
fn fluorophores_of_region(
    study: &Study,
    components: &ComponentImage,
    region: &PixelSelection,
) -> BTreeSet<String> {
    let scene = &study.scene;
    let features = &components.features;
    let known = features.part.len() == components.width * components.height;
    let seen = on_sensor(study, components).filter(|_| known);
    let Some(seen) = seen else {
        return scene.fluorophores.iter().map(|fluorophore| fluorophore.name.clone()).collect();
    };
    let parts: BTreeSet<u16> = seen.scene_pixels(region).iter().map(|&pixel| features.part[pixel]).collect();
    let shown = |object: &&crate::scene::Object| {
        parts.iter().filter(|part| **part > 0).any(|part| {
            features.part_names.get(usize::from(*part) - 1).is_some_and(|name| *name == object.name)
        })
    };
    let mut names = BTreeSet::new();
    for object in scene.objects.iter().filter(shown) {
        for amount in &scene.materials[object.material].fluorophores {
            names.insert(scene.fluorophores[amount.fluorophore].name.clone());
        }
    }
    names
}
