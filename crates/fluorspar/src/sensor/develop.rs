//! From raw frames to linear channel images.

use thiserror::Error;

use super::adc::QUANTISATION_NOISE_DN;
use super::demosaic::Demosaic;
use crate::image::{ChannelImage, SensorImage, SubtractedLight};

/// Two raw frames that can't be subtracted from each other.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DevelopError {
    /// Frames of different sensors.
    #[error(
        "frame \"{frame}\" and ambient frame \"{ambient}\" differ in size or colour filter array; take both with one \
         sensor"
    )]
    DifferentSensors {
        /// Label of the frame.
        frame: String,
        /// Label of the ambient frame.
        ambient: String,
    },
    /// Without time or gain the ambient frame has no scale.
    #[error(
        "ambient frame \"{ambient}\" has an exposure of {exposure_s} s; take it with a positive exposure"
    )]
    NoExposure {
        /// Label of the ambient frame.
        ambient: String,
        /// Its exposure time, s.
        exposure_s: f64,
    },
}

/// Black subtraction, saturation mask and bilinear interpolation of the mosaic. Values are linear and may be below
/// zero; nothing is white-balanced.
pub fn develop(raw: &SensorImage) -> ChannelImage {
    let values: Vec<f32> = raw.data.iter().map(|&dn| (f64::from(dn) - raw.black_level) as f32).collect();
    let saturated: Vec<bool> = raw.data.iter().map(|&dn| dn >= raw.white_level).collect();
    channel_image(raw, &values, &saturated, noise_floor_dn(raw))
}

/// As [`develop`], with the light of an ambient frame subtracted before the mosaic is interpolated. The ambient frame
/// is scaled by the ratio of exposure time times gain, so the two may be taken differently. Noise of both adds up.
///
/// # Errors
/// Frames of different sensors, or an ambient frame without exposure.
pub fn develop_with_ambient(raw: &SensorImage, ambient: &SensorImage) -> Result<ChannelImage, DevelopError> {
    if (raw.width, raw.height) != (ambient.width, ambient.height) || raw.mosaic != ambient.mosaic {
        let (frame, ambient) = (raw.label.clone(), ambient.label.clone());
        return Err(DevelopError::DifferentSensors { frame, ambient });
    }
    let ambient_scale = ambient.exposure_s * ambient.dn_per_electron;
    if ambient_scale <= 0.0 || ambient_scale.is_nan() {
        let (ambient, exposure_s) = (ambient.label.clone(), ambient.exposure_s);
        return Err(DevelopError::NoExposure { ambient, exposure_s });
    }
    let scale = raw.exposure_s * raw.dn_per_electron / ambient_scale;
    let pairs = || raw.data.iter().zip(&ambient.data);
    let light = |dn: u16, image: &SensorImage| f64::from(dn) - image.black_level;
    let values: Vec<f32> =
        pairs().map(|(&a, &b)| (light(a, raw) - scale * light(b, ambient)) as f32).collect();
    let saturated: Vec<bool> =
        pairs().map(|(&a, &b)| a >= raw.white_level || b >= ambient.white_level).collect();
    let noise = noise_floor_dn(raw).hypot(scale * noise_floor_dn(ambient));
    let mut image = channel_image(raw, &values, &saturated, noise);
    let levels: Vec<f32> = ambient.data.iter().map(|&b| (scale * light(b, ambient)) as f32).collect();
    let unmarked = vec![false; levels.len()];
    let (dn, _) = Demosaic::new(&raw.mosaic).interpolate(&levels, &unmarked, raw.width, raw.height);
    image.subtracted = Some(SubtractedLight { dn, exposure_ratio: raw.exposure_s / ambient.exposure_s });
    Ok(image)
}

fn noise_floor_dn(raw: &SensorImage) -> f64 {
    raw.read_noise_dn.hypot(QUANTISATION_NOISE_DN)
}

fn channel_image(raw: &SensorImage, values: &[f32], saturated: &[bool], noise_floor_dn: f64) -> ChannelImage {
    let (data, saturated) = Demosaic::new(&raw.mosaic).interpolate(values, saturated, raw.width, raw.height);
    ChannelImage {
        width: raw.width,
        height: raw.height,
        channels: raw.mosaic.channels.clone(),
        data,
        saturated,
        noise_floor_dn,
        full_scale_dn: f64::from(raw.white_level) - raw.black_level,
        shares: raw.mosaic.shares(),
        subtracted: None,
        label: raw.label.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Mosaic;

    fn raw(data: Vec<u16>, mosaic: Mosaic, width: usize) -> SensorImage {
        SensorImage {
            width,
            height: data.len() / width,
            data,
            mosaic,
            black_level: 64.0,
            white_level: 4095,
            bit_depth: 12,
            exposure_s: 0.03,
            gain: 1.0,
            dn_per_electron: 0.5,
            read_noise_dn: 6.0,
            seed: 0,
            label: "blue".into(),
        }
    }

    #[test]
    fn monochrome_passes_through_below_zero_too() {
        let image = develop(&raw(vec![60, 64, 70, 4095], Mosaic::monochrome(), 2));
        assert_eq!(image.data, [-4.0, 0.0, 6.0, 4031.0]);
        assert_eq!(image.saturated, [false, false, false, true]);
        assert_eq!(image.full_scale_dn, 4031.0);
        assert!((image.noise_floor_dn - (36.0f64 + 1.0 / 12.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn ambient_light_is_scaled_by_exposure_and_gain() {
        let frame = raw(vec![164; 16], Mosaic::bayer("grbg").unwrap(), 4);
        let mut ambient = raw(vec![74; 16], Mosaic::bayer("grbg").unwrap(), 4);
        // A tenth of the time at twice the gain: its 10 DN are 50 DN of the frame.
        ambient.exposure_s = 0.003;
        ambient.dn_per_electron = 1.0;
        let image = develop_with_ambient(&frame, &ambient).unwrap();
        assert!(image.data.iter().all(|&value| (value - 50.0).abs() < 1e-4), "{:?}", image.data);
        let quantised = (36.0f64 + 1.0 / 12.0).sqrt();
        assert!((image.noise_floor_dn - quantised.hypot(5.0 * quantised)).abs() < 1e-9);
        let subtracted = image.subtracted.unwrap();
        assert!(subtracted.dn.iter().all(|&value| (value - 50.0).abs() < 1e-4));
        assert!((subtracted.exposure_ratio - 10.0).abs() < 1e-12);
        assert_eq!(image.shares, [0.25, 0.5, 0.25]);
        ambient.exposure_s = 0.0;
        assert!(matches!(develop_with_ambient(&frame, &ambient), Err(DevelopError::NoExposure { .. })));
        let other = raw(vec![64; 16], Mosaic::monochrome(), 4);
        assert!(develop_with_ambient(&frame, &other).unwrap_err().to_string().contains("one sensor"));
    }
}
