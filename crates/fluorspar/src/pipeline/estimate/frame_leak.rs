//! Reflected light against fluorescence in the frames of a study, as [`super::filter_leak()`] for a flat sample,
//! for a scene, and in electrons.

use serde::{Deserialize, Serialize};

use super::filter_leak::{LeakBehindFilters, behind_filters};
use super::region_light::RegionOnMosaic;
use super::region_radiance::RegionRadiance;
use crate::analysis::PixelSelection;
use crate::image::{Component, ComponentImage, LightPath};
use crate::pipeline::PipelineError;
use crate::pipeline::capture::SeenComponents;
use crate::pipeline::capture::direct_light::{group_spectrum, less_subtracted};
use crate::pipeline::capture::film_irradiance::on_sensor;
use crate::spectral::{Curve, Transmittance};
use crate::study::{Capture, Study};
use crate::units::photons_per_joule;

/// Where reflected light comes from and where it ends, in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameLeak {
    /// Label of the frame.
    pub frame: String,
    /// Exposure time that the electrons are for, s.
    pub exposure_s: f64,
    /// Pixels of the sensor over which the mean is taken.
    pub pixels: usize,
    /// Mean electrons per pixel by color channel.
    pub channels: Vec<ChannelLeak>,
    /// Reflected over fluorescent electrons, the means of all channels added up: the leak as the sensor sees it; null
    /// without fluorescence.
    pub leak_ratio: Option<f64>,
    /// Reflected over fluorescent photons before the filters; null without fluorescence.
    pub ratio_before: Option<f64>,
    /// Photon radiance behind the viewing filters, photons/(s m² sr), before lens and sensor.
    pub behind_filters: LeakBehindFilters,
}

/// Electrons of one color channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelLeak {
    /// Name of the channel.
    pub name: String,
    /// Mean electrons per pixel of light that never fluoresced.
    pub reflected_e: f64,
    /// Mean electrons per pixel of fluorescence.
    pub fluorescent_e: f64,
}

impl FrameLeak {
    /// Whether the viewing filters pass the excitation light: more than a tenth of the reflected photons. Such a frame is an image in
    /// reflected light, which is its signal and no leak.
    pub fn is_reflectance(&self) -> bool {
        self.behind_filters.reflected_density.is_some_and(|density| density < 1.0)
    }

    /// Mean electrons per pixel of all channels added up: reflected and fluorescent.
    pub fn electrons(&self) -> [f64; 2] {
        self.channels.iter().fold([0.0; 2], |[r, f], c| [r + c.reflected_e, f + c.fluorescent_e])
    }
}

/// Splits the expected electrons of a frame by whether their light fluoresced: through lens, filters and sensor as
/// [`crate::pipeline::capture()`] does it, without noise and at rest. Means are over `region`, pixels of the developed frame, or over
/// the whole sensor. Light of a frame that is subtracted is none of this one: room light is no leak where an ambient frame takes it away.
///
/// `components` holds the spectra of what is `seen`. `None` for a study without sensor and for a frame without light.
///
/// # Errors
/// A film that can't be used.
pub fn frame_leak(
    study: &Study,
    components: &ComponentImage,
    seen: &SeenComponents<'_>,
    capture: &Capture,
    exposure_s: f64,
    region: Option<&PixelSelection>,
) -> Result<Option<FrameLeak>, PipelineError> {
    let Some(sensor) = &study.camera.sensor else { return Ok(None) };
    let frame = less_subtracted(study, capture);
    if frame.lights.values().all(|&drive| drive == 0.0) {
        return Ok(None);
    }
    let names: Vec<String> = sensor.qe().channels().iter().map(|channel| channel.name.clone()).collect();
    let mosaic = RegionOnMosaic::new(sensor, region);
    let light_s = sensor.frame_light_s(exposure_s);
    // Electrons by channel: reflected, fluorescent.
    let mut means = vec![[0.0_f64; 2]; names.len()];
    for (kind, is_reflected) in [true, false].into_iter().enumerate() {
        let drive = |c: &Component| match (c.light == LightPath::Reflected) == is_reflected {
            true => frame.drive(&c.light_group),
            false => 0.0,
        };
        let rates = sensor.electron_rate_of(&seen.film_rates(capture, drive), seen.planes.film)?;
        means.iter_mut().zip(mosaic.means(&rates)).for_each(|(mean, rate)| mean[kind] = light_s * rate);
    }
    let channels: Vec<ChannelLeak> = (0..names.len())
        .filter(|&channel| mosaic.counts[channel] > 0)
        .map(|channel| ChannelLeak {
            name: names[channel].clone(),
            reflected_e: means[channel][0],
            fluorescent_e: means[channel][1],
        })
        .collect();
    let scene_pixels: Vec<usize> = match region {
        Some(region) => {
            on_sensor(study, components).map(|scene| scene.scene_pixels(region)).unwrap_or_default()
        }
        None => (0..components.width * components.height).collect(),
    };
    let radiance = RegionRadiance::new(components, &frame, &scene_pixels);
    let mut leak = FrameLeak {
        frame: capture.frame.label.clone(),
        exposure_s,
        pixels: mosaic.counts.iter().sum(),
        channels,
        leak_ratio: None,
        ratio_before: None,
        behind_filters: photons_behind(study, capture, components, &radiance),
    };
    let [reflected, fluorescent] = leak.electrons();
    leak.leak_ratio = (fluorescent > 0.0).then(|| reflected / fluorescent);
    let photons = |values: &mut dyn Iterator<Item = f64>| in_photons(components, values).iter().sum::<f64>();
    let before = photons(&mut radiance.reflected.iter().copied());
    let emitted = photons(&mut radiance.total.iter().zip(&radiance.reflected).map(|(t, r)| t - r));
    leak.ratio_before = (emitted > 0.0).then(|| before / emitted);
    Ok(Some(leak))
}

/// Photon radiance of each band, photons/(s m² sr).
fn in_photons(components: &ComponentImage, radiance: &mut dyn Iterator<Item = f64>) -> Vec<f64> {
    let (centers, widths) = (components.grid.centers_nm(), components.grid.widths_nm());
    radiance
        .zip(centers.iter().zip(widths))
        .map(|(l, (nm, width))| l * width * photons_per_joule(*nm))
        .collect()
}

/// Transmission of the mean radiance of a region by the viewing filters and that of the capture.
fn photons_behind(
    study: &Study,
    capture: &Capture,
    components: &ComponentImage,
    radiance: &RegionRadiance,
) -> LeakBehindFilters {
    let filter = &study.camera.view_filter.transmittance;
    let filter = match &capture.filter {
        Some(own) => filter.times(own),
        None => filter.clone(),
    };
    let even = filter.on_grid::<Transmittance>(&components.grid);
    let reflected = in_photons(components, &mut radiance.reflected.iter().copied());
    let emitted: Vec<f64> = radiance.total.iter().zip(&radiance.reflected).map(|(t, r)| t - r).collect();
    let emitted = in_photons(components, &mut emitted.into_iter());
    let of_reflected: Vec<f64> = reflected_behind(study, components, radiance, &filter)
        .iter()
        .zip(&reflected)
        .map(|(passed, all)| if *all > 0.0 { passed / all } else { 0.0 })
        .collect();
    behind_filters(&reflected, &emitted, &of_reflected, even.values())
}

/// Reflected photons behind a filter, by band. Each light source has its own spectrum within a band.
fn reflected_behind(
    study: &Study,
    components: &ComponentImage,
    radiance: &RegionRadiance,
    filter: &Curve,
) -> Vec<f64> {
    let mut passed = vec![0.0; components.grid.len()];
    for (component, values) in &radiance.reflected_components {
        let through = match group_spectrum(study, &component.light_group) {
            Some(shape) => filter.on_grid_under::<Transmittance>(&components.grid, &shape),
            None => filter.on_grid::<Transmittance>(&components.grid),
        };
        let values = in_photons(components, &mut values.iter().copied());
        for ((sum, value), through) in passed.iter_mut().zip(values).zip(through.values()) {
            *sum += value * through;
        }
    }
    passed
}
