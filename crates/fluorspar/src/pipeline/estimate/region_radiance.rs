//! Mean radiance of a region of a component image, kept apart by component.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::Serialize;

use crate::analysis::{PixelSelection, channel_response};
use crate::image::{Component, ComponentImage, LightPath};
use crate::pipeline::capture::direct_light::group_spectrum;
use crate::pipeline::capture::film_irradiance::{behind_filter, on_sensor};
use crate::sensor::CaptureFrame;
use crate::spectral::{Curve, QuantumEfficiency, Radiance, Spectrum};
use crate::study::Study;

/// Mean radiance that leaves a region under the lights of one frame, before filter and lens, W/(sr m² nm).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegionRadiance {
    /// Bin centers, nm.
    pub wavelength_nm: Vec<f64>,
    /// Light that never fluoresced.
    pub reflected: Vec<f64>,
    /// The same by component.
    #[serde(skip)]
    pub reflected_components: Vec<(Component, Vec<f64>)>,
    /// Light that fluoresced once, by fluorophore; those without any are left out.
    pub fluorescence: BTreeMap<String, Vec<f64>>,
    /// Light that fluoresced more than once.
    pub multiple_fluorescence: Vec<f64>,
    /// Everything.
    pub total: Vec<f64>,
    /// Pixels of the component image that were averaged.
    pub pixels: usize,
}

impl RegionRadiance {
    /// The light of the frame that a study analyzes, from the pixels behind the analyzed region of the sensor.
    /// `None` without an analysis.
    pub fn of_analysis(study: &Study, components: &ComponentImage, region: &PixelSelection) -> Option<Self> {
        let capture = study.analyzed_capture()?;
        let pixels = on_sensor(study, components)?.scene_pixels(region);
        Some(Self::new(components, &capture.frame, &pixels))
    }

    /// Averages pixels of the component image, given by their numbers.
    pub fn new(components: &ComponentImage, frame: &CaptureFrame, pixels: &[usize]) -> Self {
        let bands = components.grid.len();
        let mut radiance = Self {
            wavelength_nm: components.grid.centers_nm(),
            reflected: vec![0.0; bands],
            reflected_components: Vec::new(),
            fluorescence: BTreeMap::new(),
            multiple_fluorescence: vec![0.0; bands],
            total: vec![0.0; bands],
            pixels: pixels.len(),
        };
        for (index, component) in components.components.iter().enumerate() {
            let drive = frame.drive(&component.light_group);
            if drive == 0.0 {
                continue;
            }
            // Average the component over the region
            let (values, len) = (components.stored(index), components.values_per_pixel(index));
            let mut mean = vec![0.0; len];
            for &pixel in pixels {
                for (sum, value) in mean.iter_mut().zip(&values[pixel * len..]) {
                    *sum += drive * f64::from(*value);
                }
            }
            mean.iter_mut().for_each(|sum| *sum /= pixels.len().max(1) as f64);
            let mean = components.basis(index).map_or_else(|| mean.clone(), |basis| basis.all_bands(&mean));
            // Add it to its term and to the total
            let target = match &component.light {
                LightPath::Reflected => {
                    radiance.reflected_components.push((component.clone(), mean.clone()));
                    &mut radiance.reflected
                }
                LightPath::MultipleFluorescence => &mut radiance.multiple_fluorescence,
                LightPath::Fluorescence(name) => {
                    if mean.iter().all(|&v| v == 0.0) {
                        continue;
                    }
                    radiance.fluorescence.entry(name.clone()).or_insert_with(|| vec![0.0; bands])
                }
            };
            target.iter_mut().zip(&mean).for_each(|(sum, value)| *sum += value);
            radiance.total.iter_mut().zip(&mean).for_each(|(sum, value)| *sum += value);
        }
        radiance
    }

    /// Reflected over fluorescent electrons, all color channels together, behind lens and filters: the leak that the
    /// filters leave. `None` without a sensor, or without fluorescence.
    pub fn leak_ratio(&self, study: &Study) -> Option<f64> {
        let (lens, sensor) = (study.camera.lens_behind_filters()?, study.camera.sensor.as_ref()?);
        let analyzed = study.analyzed_capture();
        let lens = analyzed.map_or(Cow::Borrowed(&lens), |capture| behind_filter(&lens, capture));
        let (grid, qe) = (&study.scene.grid, sensor.effective_qe());
        let channels: Vec<Spectrum<QuantumEfficiency>> =
            (0..qe.channels().len()).map(|c| qe.on_grid(c, grid)).collect();
        let electrons = |values: &[f64], shape: Option<&Curve>| -> Option<f64> {
            let transmittance = lens.transmittance_under(grid, shape);
            let seen = values.iter().zip(transmittance.values()).map(|(l, t)| l * t).collect();
            let radiance = Spectrum::<Radiance>::new(grid.clone(), seen).ok()?;
            let mut sum = 0.0;
            for qe in &channels {
                sum += channel_response(&radiance, [qe, qe, qe]).ok()?[0];
            }
            Some(sum)
        };
        let fluorescent: Vec<f64> = self.total.iter().zip(&self.reflected).map(|(t, r)| t - r).collect();
        let fluorescent = electrons(&fluorescent, None)?;
        let mut reflected = 0.0;
        for (component, values) in &self.reflected_components {
            reflected += electrons(values, group_spectrum(study, &component.light_group).as_ref())?;
        }
        (fluorescent > 0.0).then_some(reflected / fluorescent)
    }
}
