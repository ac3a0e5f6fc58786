//! One region before one camera, in numbers: from its mean radiance to electrons to the porphyrin fraction.
//!
//! A design search evaluates this thousands of times per second, so every step works on plain values that are prepared once:
//!
//! | step | prepared by | costs |
//! |---|---|---|
//! | camera | [`CameraResponse::new`], once for each lens, filter and sensor | milliseconds |
//! | fluorophores under a light | [`MixtureSpectra::new`], once for each light | milliseconds |
//! | mean radiance of a region | [`super::RegionRadiance`], once for each frame; linear in its drives | |
//! | electrons | [`CameraResponse::electrons`] | well below a microsecond |
//! | porphyrin fraction | [`estimate_porphyrin`] | about a microsecond |
//!
//! The region lies on the optical axis, at rest, without noise in its mean. Vignetting scales all channels alike: it
//! changes the noise, not the chromaticity.

use serde::Serialize;

use crate::analysis::{LineEstimate, MixtureError, MixtureLine};
use crate::design::LitExposure;
use crate::optics::IdealLens;
use crate::render::direct_exitance;
use crate::sensor::Sensor;
use crate::spectral::{Curve, Fluorophore, WavelengthGrid};

/// A camera on one wavelength grid: what each channel collects of a spectral radiance on the optical axis.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraResponse {
    /// Names of the channels.
    channels: Vec<String>,
    /// Irradiance on the film per radiance, sr, one value per bin: `pi T / (1 + 4 N² (1 + |m|)²)`.
    film_per_radiance: Vec<f64>,
    /// Electrons per second per irradiance on the film, e-/s per W/(m² nm), `[channel][bin]`.
    electrons_per_irradiance: Vec<Vec<f64>>,
    /// Share of the pixels that measure each channel.
    shares: Vec<f64>,
    /// Read noise of one pixel, e- rms.
    read_noise_e: f64,
    /// Photo-response non-uniformity, a share of the signal.
    gain_spread: f64,
}

impl CameraResponse {
    /// Prepares a lens (with its filters, see [`crate::study::Camera::lens_behind_filters`]) and a sensor. `light` is the
    /// spectrum of the light within each bin, up to a factor: that of the source for reflected light behind a steep
    /// filter; `None` is even.
    pub fn new(lens: &IdealLens, sensor: &Sensor, grid: &WavelengthGrid, light: Option<&Curve>) -> Self {
        let solid_angle_sr = lens.axial_solid_angle_sr();
        let transmittance = lens.transmittance_under(grid, light);
        let model = sensor.model();
        Self {
            channels: sensor.mosaic().channels.clone(),
            film_per_radiance: transmittance.values().iter().map(|t| solid_angle_sr * t).collect(),
            electrons_per_irradiance: sensor.flat_electron_weights(grid),
            shares: sensor.mosaic().shares(),
            read_noise_e: model.read_noise_electrons(),
            gain_spread: model.image_prnu_percent() / 100.0,
        }
    }

    /// The camera of an exposure of a design; `reflected` for light with the shape of its irradiance.
    pub(super) fn of_exposure(exposure: &LitExposure, reflected: bool) -> Self {
        let weights = if reflected { &exposure.weights_of_reflected } else { &exposure.weights };
        Self {
            channels: exposure.channels.clone(),
            film_per_radiance: vec![1.0; weights.first().map_or(0, Vec::len)],
            electrons_per_irradiance: weights.clone(),
            shares: exposure.shares.clone(),
            read_noise_e: 0.0,
            gain_spread: 0.0,
        }
    }

    /// Names of the channels, in the order of all results.
    pub fn channels(&self) -> &[String] {
        &self.channels
    }

    /// Mean photo-electrons of one pixel of a channel, e-, from a spectral radiance, W/(sr m² nm), one value per bin.
    pub fn channel_electrons(&self, channel: usize, radiance: &[f64], time_s: f64) -> f64 {
        let film = self.film_per_radiance.iter().zip(radiance);
        let weights = &self.electrons_per_irradiance[channel];
        let rate: f64 = weights.iter().zip(film).map(|(weight, (film, l))| weight * (film * l)).sum();
        rate * time_s
    }

    /// Electrons per second of one pixel of a channel per radiance in each bin, e-/s per W/(sr m² nm).
    pub fn channel_weights(&self, channel: usize) -> Vec<f64> {
        let film = self.film_per_radiance.iter().zip(&self.electrons_per_irradiance[channel]);
        film.map(|(film, weight)| film * weight).collect()
    }

    /// Numbers of the channels that see light: those that collect at least a hundredth of what the best one does of a radiance that
    /// is the same at all wavelengths. What others collect behind a filter is leaked light.
    pub fn seeing_channels(&self) -> Vec<usize> {
        let sums: Vec<f64> =
            (0..self.channels.len()).map(|channel| self.channel_weights(channel).iter().sum()).collect();
        let best = sums.iter().copied().fold(0.0, f64::max);
        (0..sums.len()).filter(|channel| sums[*channel] > 0.01 * best).collect()
    }

    /// Mean photo-electrons of one pixel of each channel, e-.
    pub fn electrons(&self, radiance: &[f64], time_s: f64) -> Vec<f64> {
        (0..self.channels.len()).map(|channel| self.channel_electrons(channel, radiance, time_s)).collect()
    }

    /// Numbers of the channels R, G, B; `None` when one of them is missing.
    pub fn rgb(&self) -> Option<[usize; 3]> {
        let find = |name: &str| self.channels.iter().position(|channel| channel == name);
        Some([find("R")?, find("G")?, find("B")?])
    }

    /// Variance of the mean of a channel over a region, e-²: shot noise, read noise and gain spread of one pixel over the
    /// pixels of the channel.
    fn variance_of_mean(&self, channel: usize, electrons: f64, pixels: f64) -> f64 {
        let spread = self.gain_spread * electrons;
        let of_pixel = electrons.max(0.0) + self.read_noise_e * self.read_noise_e + spread * spread;
        of_pixel / (pixels * self.shares[channel]).max(1.0)
    }
}

/// Radiance of one unit of bulk and of one unit of porphyrin under one light, W/(sr m² nm), one value per bin.
#[derive(Clone, Debug, PartialEq)]
pub struct MixtureSpectra {
    /// The fluorophores of the bulk together, at their amounts.
    pub bulk: Vec<f64>,
    /// The porphyrin at amount 1.
    pub porphyrin: Vec<f64>,
}

impl MixtureSpectra {
    /// Direct fluorescence under an irradiance, W/(m² nm): `L = (1/pi) integral Y E`. Names are those of the
    /// fluorophores; the bulk is a list of names with amounts.
    ///
    /// # Errors
    /// A name that no fluorophore has.
    pub fn new(
        fluorophores: &[Fluorophore],
        bulk: &[(String, f64)],
        porphyrin: &str,
        grid: &WavelengthGrid,
        irradiance: &Curve,
    ) -> Result<Self, MixtureError> {
        let radiance = |name: &str| -> Result<Vec<f64>, MixtureError> {
            let known = || fluorophores.iter().map(|fluorophore| fluorophore.name.clone());
            let found =
                fluorophores.iter().find(|fluorophore| fluorophore.name == name).ok_or_else(|| {
                    MixtureError::UnknownFluorophore { name: name.into(), available: known().collect() }
                })?;
            let exitance = direct_exitance(&found.eem, grid, irradiance);
            Ok(exitance.into_iter().map(|m| m / std::f64::consts::PI).collect())
        };
        let mut sum = vec![0.0; grid.len()];
        for (name, amount) in bulk {
            sum.iter_mut().zip(radiance(name)?).for_each(|(sum, l)| *sum += amount * l);
        }
        Ok(Self { bulk: sum, porphyrin: radiance(porphyrin)? })
    }
}

/// Signal of a region in a camera, and its estimate on the mixture line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PorphyrinEstimate {
    /// Mean photo-electrons of one pixel in R, G, B, e-.
    pub electrons: [f64; 3],
    /// Distance between bulk and porphyrin in chromaticity: what separates them.
    pub line_length: f64,
    /// Where on the line the region lies. Intervals hold 95 % of the sensor's noise, and nothing else.
    pub estimate: LineEstimate,
}

/// Estimates the porphyrin fraction of a region from its mean radiance, W/(sr m² nm), one value per bin: electrons in R, G
/// and B, the mixture line of the same camera, the nearest point on it. `pixels` of the sensor are averaged.
///
/// Light that is not fluorescence of bulk or porphyrin biases the estimate, as it does in a measurement.
///
/// # Errors
/// A line that can't be drawn. `Ok(None)` for a camera without R, G and B and for a region without light.
pub fn estimate_porphyrin(
    camera: &CameraResponse,
    spectra: &MixtureSpectra,
    radiance: &[f64],
    time_s: f64,
    pixels: f64,
) -> Result<Option<PorphyrinEstimate>, MixtureError> {
    let Some(rgb) = camera.rgb() else { return Ok(None) };
    let response = |radiance: &[f64]| rgb.map(|c| camera.channel_electrons(c, radiance, time_s));
    let line = MixtureLine::new(response(&spectra.bulk), response(&spectra.porphyrin))?;
    let electrons = response(radiance);
    Ok(estimate_on_line(camera, &line, rgb, electrons, pixels))
}

/// The nearest point of a line to electrons that were measured in R, G and B, `rgb` being the numbers of these channels.
pub(super) fn estimate_on_line(
    camera: &CameraResponse,
    line: &MixtureLine,
    rgb: [usize; 3],
    electrons: [f64; 3],
    pixels: f64,
) -> Option<PorphyrinEstimate> {
    let variance = std::array::from_fn(|c| camera.variance_of_mean(rgb[c], electrons[c], pixels));
    let estimate = line.project(electrons, variance)?;
    Some(PorphyrinEstimate { electrons, line_length: line.length(), estimate })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{Exposure, SensorModel, SpectralQe};
    use crate::spectral::{PhotonEem, Radiance, SeparableTerm, Spectrum, Stokes};

    fn bell(center_nm: f64, width_nm: f64) -> Curve {
        Curve::from_fn(350.0, 750.0, |nm| (-((nm - center_nm) / width_nm).powi(2)).exp())
    }

    fn fluorophore(name: &str, emission_nm: f64) -> Fluorophore {
        let emission = bell(emission_nm, 30.0);
        let emission = emission.scaled(1.0 / emission.total());
        let term = SeparableTerm { excitation: bell(400.0, 30.0).scaled(1e-3), emission };
        Fluorophore {
            name: name.into(),
            title: name.into(),
            eem: PhotonEem::separable(vec![term], Stokes::Mask),
            excitation_range_nm: (350.0, 450.0),
            emission_range_nm: (450.0, 750.0),
            source: "test".into(),
        }
    }

    /// A mixture without other light comes back with its fraction, and electrons are those of the whole sensor model.
    #[test]
    fn a_region_of_a_known_mixture_gives_its_fraction() {
        let grid = WavelengthGrid::default();
        let curves = [("R", bell(600.0, 60.0)), ("G", bell(540.0, 60.0)), ("B", bell(460.0, 60.0))];
        let qe = SpectralQe::from_curves(curves.map(|(name, curve)| (name, curve.scaled(0.5)))).unwrap();
        let sensor = Sensor::new(SensorModel::default(), qe).unwrap();
        let lens = IdealLens::new(3.0, 4.0);
        let camera = CameraResponse::new(&lens, &sensor, &grid, None);

        let fluorophores = [fluorophore("bulk", 520.0), fluorophore("porphyrin", 640.0)];
        let light = bell(400.0, 10.0).scaled(50.0);
        let bulk = [("bulk".to_owned(), 0.8)];
        let spectra = MixtureSpectra::new(&fluorophores, &bulk, "porphyrin", &grid, &light).unwrap();
        let mixed: Vec<f64> =
            spectra.bulk.iter().zip(&spectra.porphyrin).map(|(b, p)| 3.0 * (b + 0.25 * p)).collect();
        let found = estimate_porphyrin(&camera, &spectra, &mixed, 0.03, 400.0).unwrap().unwrap();
        assert!((found.estimate.fraction - 0.2).abs() < 1e-9, "{found:?}");

        let film = lens.axial_irradiance(&Spectrum::<Radiance>::new(grid, mixed).unwrap());
        let exposure = Exposure { time_s: 0.03, ..Exposure::default() };
        let whole = sensor.flat_response(&film, &exposure).unwrap();
        for (c, electrons) in camera.rgb().unwrap().into_iter().zip(found.electrons) {
            assert!((electrons / whole.electrons[c] - 1.0).abs() < 1e-12);
        }
        // Noise of a mean falls with the square root of the pixels.
        let more = estimate_porphyrin(&camera, &spectra, &spectra.bulk, 0.03, 40_000.0).unwrap().unwrap();
        let less = estimate_porphyrin(&camera, &spectra, &spectra.bulk, 0.03, 400.0).unwrap().unwrap();
        let ratio = less.estimate.fraction_standard_error / more.estimate.fraction_standard_error;
        assert!((ratio - 10.0).abs() < 1e-9, "{ratio}");
        assert!(
            MixtureSpectra::new(&fluorophores, &bulk, "none", &WavelengthGrid::default(), &light).is_err()
        );
    }
}
