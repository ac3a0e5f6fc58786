//! Readings of the spectroradiometers of a study.

use serde::Serialize;

use super::light_by_shape::{light_by_shape, transmittance_ratio};
use crate::analysis::{AnalysisError, RegionOfInterest, SceneOnSensor};
use crate::image::{ComponentImage, SpectralImage};
use crate::pipeline::PipelineError;
use crate::sensor::SpectralReading;
use crate::spectral::{Radiance, Spectrum, WavelengthGrid};
use crate::study::{SpectroradiometerTarget, Study};

/// One reading and how it was taken.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpectroradiometerReading {
    /// Name of the instrument.
    pub name: String,
    /// Frame whose lights were on.
    pub capture: String,
    /// Description of the target.
    pub target: String,
    /// Pixels of the render that took part, as far as they lie in the spot.
    pub pixels: f64,
    /// The reading.
    #[serde(flatten)]
    pub reading: SpectralReading,
}

/// Samples along each side of a pixel that decide how much of it lies in a spot.
const SUB: usize = 4;

/// Takes the reading of every spectroradiometer of the study, from the place of the camera.
///
/// # Errors
/// Parts that nothing shows, an image of other wavelengths.
pub fn read_spectroradiometers(
    study: &Study,
    components: &ComponentImage,
) -> Result<Vec<SpectroradiometerReading>, PipelineError> {
    if study.spectroradiometers.is_empty() {
        return Ok(Vec::new());
    }
    if components.grid != study.scene.grid {
        let (image, study) = (components.grid.len(), study.scene.grid.len());
        return Err(PipelineError::OtherGrid { image, study });
    }
    let before_lens = over_illumination(study, components);
    let mut readings = Vec::new();
    for device in &study.spectroradiometers {
        // Weight the pixels of the spot or the parts
        let (weights, target) = match &device.target {
            SpectroradiometerTarget::Spot { aim, acceptance_deg } => {
                let camera = &study.scene.camera;
                let view = components.features.view;
                let tangent = f64::from(view.map_or(camera.tan_half_width, |view| view.tan_half_width));
                let weights =
                    spot_weights(components.width, components.height, tangent, *aim, *acceptance_deg);
                let place = format!(
                    "a spot of {acceptance_deg} degrees at {:.3}, {:.3} of the image",
                    aim[0], aim[1]
                );
                (weights, place)
            }
            SpectroradiometerTarget::Parts(parts) => {
                let region = RegionOfInterest::of_parts(parts.iter().cloned());
                let selection = region
                    .select(components.width, components.height, Some(SceneOnSensor::filling(components)))
                    .map_err(AnalysisError::from)?;
                (selection.pixels.into_iter().map(|pixel| (pixel, 1.0)).collect(), region.describe())
            }
        };
        let grid = &components.grid;
        // Average the radiance behind the instrument's filter
        let mut mean = vec![0.0; grid.len()];
        for light in light_by_shape(study, &device.frame, components) {
            let part = weighted_mean(&light.radiance, &weights, &before_lens);
            let ratio = transmittance_ratio(&device.instrument.filter, light.shape.as_ref(), grid);
            for (band, sum) in mean.iter_mut().enumerate() {
                *sum += part.values()[band] * ratio.as_ref().map_or(1.0, |ratio| ratio[band]);
            }
        }
        let mean = Spectrum::<Radiance>::from_parts(grid.clone(), mean);
        // Read the spectrum
        let reading = device.instrument.read(&mean, study.render.seed, &device.name);
        readings.push(SpectroradiometerReading {
            name: device.name.clone(),
            capture: device.frame.label.clone(),
            target,
            pixels: weights.iter().map(|(_, weight)| weight).sum(),
            reading,
        });
    }
    Ok(readings)
}

/// Radiance before a lens that was rendered over what the image holds of it, by pixel: one over the relative illumination. Empty without such a
/// lens.
fn over_illumination(study: &Study, components: &ComponentImage) -> Vec<f64> {
    let lens = study.camera.traced_lens().filter(|_| study.scene.camera.lens.is_some());
    let (Some(lens), Ok(band)) = (lens, WavelengthGrid::from_edges(&[500.0, 501.0])) else {
        return Vec::new();
    };
    let mut even = SpectralImage::<Radiance>::zeros(band, components.width, components.height);
    even.data_mut().fill(1.0);
    lens.darken(&mut even, lens.film_width_mm());
    even.data().iter().map(|illumination| 1.0 / f64::from(*illumination).max(1e-3)).collect()
}

/// Mean over pixels with their weights, each times its factor; without factors these are 1.
fn weighted_mean(
    image: &SpectralImage<Radiance>,
    weights: &[(usize, f64)],
    factors: &[f64],
) -> Spectrum<Radiance> {
    let bands = image.bands();
    let mut sums = vec![0.0; bands];
    for &(pixel, weight) in weights {
        let weight = weight * factors.get(pixel).copied().unwrap_or(1.0);
        for (sum, value) in sums.iter_mut().zip(&image.data()[pixel * bands..]) {
            *sum += weight * f64::from(*value);
        }
    }
    let total: f64 = weights.iter().map(|(_, weight)| weight).sum();
    let values = sums.into_iter().map(|sum| sum / total.max(f64::MIN_POSITIVE)).collect();
    Spectrum::from_parts(image.grid().clone(), values)
}

/// Pixels of a pinhole image within a round spot, with their share in it: directions within half the angle of the aim, the
/// border by 4 x 4 samples a pixel, weighted by solid angle (`cos³` off the axis). A spot smaller than a pixel takes the pixel
/// that it lies in.
fn spot_weights(
    width: usize,
    height: usize,
    tan_half_width: f64,
    aim: [f64; 2],
    acceptance_deg: f64,
) -> Vec<(usize, f64)> {
    let scale = 2.0 * tan_half_width / width as f64;
    let direction = |x: f64, y: f64| {
        glam::DVec3::new((x - 0.5 * width as f64) * scale, (0.5 * height as f64 - y) * scale, 1.0)
    };
    let aim_px = [aim[0] * width as f64, aim[1] * height as f64];
    let axis = direction(aim_px[0], aim_px[1]).normalize();
    let least = (0.5 * acceptance_deg).to_radians().cos();
    let mut weights = Vec::new();
    for row in 0..height {
        for col in 0..width {
            // Integrate the solid angle of the pixel within the acceptance cone
            let mut share = 0.0;
            for sub in 0..SUB * SUB {
                let place = |i: usize| (i as f64 + 0.5) / SUB as f64;
                let way = direction(col as f64 + place(sub % SUB), row as f64 + place(sub / SUB));
                let length = way.length();
                if way.dot(axis) >= least * length {
                    share += 1.0 / length.powi(3);
                }
            }
            if share > 0.0 {
                weights.push((row * width + col, share / (SUB * SUB) as f64));
            }
        }
    }
    // Take the pixel at the aim where the spot is smaller than a pixel
    if weights.is_empty() {
        let at = |value: f64, count: usize| (value.max(0.0) as usize).min(count - 1);
        weights.push((at(aim_px[1], height) * width + at(aim_px[0], width), 1.0));
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spot_covers_its_solid_angle_wherever_it_points() {
        // 200 x 100 pixels over 40 degrees: the solid angle of a pixel on the axis is (2 tan 20 / 200)².
        let tangent = 20f64.to_radians().tan();
        let pixel_sr = (2.0 * tangent / 200.0).powi(2);
        let expected = 2.0 * std::f64::consts::PI * (1.0 - 1f64.to_radians().cos());
        for aim in [[0.5, 0.5], [0.2, 0.3], [0.9, 0.8]] {
            let weights = spot_weights(200, 100, tangent, aim, 2.0);
            let solid: f64 = weights.iter().map(|(_, w)| w * pixel_sr).sum();
            // Some 75 pixels, 1200 samples: the border leaves a few of them.
            assert!((solid / expected - 1.0).abs() < 0.02, "{aim:?}: {solid} {expected}");
            let x: f64 = weights.iter().map(|(p, w)| w * ((p % 200) as f64 + 0.5)).sum::<f64>()
                / weights.iter().map(|(_, w)| w).sum::<f64>();
            assert!((x / 200.0 - aim[0]).abs() < 2e-3, "{aim:?}: {x}");
        }
        assert_eq!(spot_weights(200, 100, tangent, [0.5025, 0.505], 0.01), [(50 * 200 + 100, 1.0)]);
        assert_eq!(spot_weights(200, 100, tangent, [1.0, 1.0], 0.01).len(), 1);
    }
}
