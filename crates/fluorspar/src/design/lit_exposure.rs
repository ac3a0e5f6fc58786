//! Exposures of a design as an estimate of its region takes them: light, camera, time, signal and noise, white frames left out.

use super::design_camera::FineBands;
use super::design_space::{Design, DesignSpace};
use crate::spectral::Curve;

/// One exposure of a region under one light.
#[derive(Clone, Debug, PartialEq)]
pub struct LitExposure {
    /// Name of the light.
    pub light: String,
    /// Irradiance of the region, W/(m² nm).
    pub irradiance: Curve,
    /// Exposure time, s.
    pub time_s: f64,
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Share of the pixels that measure each channel.
    pub shares: Vec<f64>,
    /// Electrons per second of a pixel of each channel per W/(sr m² nm), `[channel][band]`: of light that is even within bands.
    pub weights: Vec<Vec<f64>>,
    /// The same of light with the shape of the irradiance.
    pub weights_of_reflected: Vec<Vec<f64>>,
    /// Mean electrons of a pixel, by channel.
    pub electrons: Vec<f64>,
    /// Variance of the mean over the region by the sensor's noise, by channel.
    pub variance: Vec<f64>,
}

impl DesignSpace {
    /// Exposures of a region, by its number in the geometry of the design.
    #[must_use]
    pub fn lit_exposures(&self, design: &Design, region: usize) -> Vec<LitExposure> {
        let p = &self.problem;
        let Some(model) = p.regions_of(design.geometry).nth(region) else { return Vec::new() };
        let bands = FineBands::of(&model.response.grid);
        let (camera, lens_sr) = (&p.cameras[design.camera], p.lens_sr(design.geometry, design.lens));
        let pixels = self.pixels_of(design, region);
        let exposures = self.exposures(design);
        let signals = self.region_signals(region, design);
        let of_light = |(k, &light): (usize, &usize)| {
            let choice = &p.lights[light];
            let irradiance = choice.spectrum.scaled(model.irradiance(choice) * p.drives[design.drive]);
            let behind = camera.behind(&p.filters[design.filter].transmittance(choice.peak_nm), &bands);
            // Fine bins of a band count by the light in them
            let fine = irradiance.bin_averages(&bands.fine);
            let even = irradiance.bin_averages(&model.response.grid);
            let reflected = |channel: usize| {
                let mut sums = vec![0.0; even.len()];
                for ((weight, light), &band) in behind.fine[channel].iter().zip(&fine).zip(&bands.band) {
                    sums[band] += weight * light;
                }
                let of_band = |(band, sum): (usize, f64)| match even[band] > 0.0 {
                    true => lens_sr * sum / even[band],
                    false => lens_sr * behind.by_band[channel][band],
                };
                sums.into_iter().enumerate().map(of_band).collect()
            };
            let (exposure, rates) = (&exposures[k], signals[k]);
            let electrons: Vec<f64> =
                (0..rates.leak.len()).map(|channel| exposure.channel_electrons(channel, rates)).collect();
            LitExposure {
                light: choice.name.clone(),
                time_s: exposure.time_s,
                channels: camera.channels.clone(),
                shares: camera.shares.clone(),
                weights: behind
                    .by_band
                    .iter()
                    .map(|weights| weights.iter().map(|weight| lens_sr * weight).collect())
                    .collect(),
                weights_of_reflected: (0..camera.channels.len()).map(reflected).collect(),
                variance: electrons
                    .iter()
                    .enumerate()
                    .map(|(channel, mean)| exposure.variance(channel, *mean, pixels))
                    .collect(),
                electrons,
                irradiance,
            }
        };
        design.lights.iter().enumerate().map(of_light).collect()
    }
}
