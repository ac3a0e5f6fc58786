//! Response of a sensor to a uniform patch, without an image.

use super::exposure::Chain;
use super::{Exposure, Sensor, SensorMode, SensorProblem};
use crate::spectral::{Irradiance, Spectrum, WavelengthGrid};

/// Response of every channel to a uniform irradiance, without noise.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatResponse {
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Mean photo-electrons in one pixel of the sensor, not clipped, e-.
    pub electrons: Vec<f64>,
    /// Mean dark electrons in one pixel of the sensor, e-. ISETCam mode has them for noise flag 2 only.
    pub dark_electrons: f64,
    /// Voltage at the converter, dark signal, gain, offset and the clipping of the mode included, V.
    pub volts: Vec<f64>,
    /// Digital numbers of a pixel of the raw image, joined pixels and black level included, not rounded, clipped at the
    /// converter's ends.
    pub dn: Vec<f64>,
    /// Digital number of no light.
    pub black_level: f64,
    /// Temporal noise of a pixel of the raw image, DN rms: photon noise, read noise and quantization. For the spread over pixels
    /// add PRNU and DSNU.
    pub noise_dn: Vec<f64>,
    /// Whether the mean fills the well or the converter; never where the mode clips nothing.
    pub saturated: Vec<bool>,
}

impl Sensor {
    /// Mean photo-electrons per second in one pixel of every channel under a uniform irradiance, e-/s: at the center of
    /// the sensor, crosstalk included.
    pub fn flat_electron_rate(&self, irradiance: &Spectrum<Irradiance>) -> Vec<f64> {
        let sum = |weights: Vec<f64>| weights.iter().zip(irradiance.values()).map(|(w, e)| w * e).sum();
        self.flat_electron_weights(irradiance.grid()).into_iter().map(sum).collect()
    }

    /// Photo-electrons per second of every channel per uniform irradiance in each bin, e-/s per W/(m² nm), `[channel][bin]`:
    /// at the center of the sensor, crosstalk included.
    pub fn flat_electron_weights(&self, grid: &WavelengthGrid) -> Vec<Vec<f64>> {
        self.weights_of(&self.effective_qe(), grid)
    }

    /// Electrons, volts and digital numbers of every channel under a uniform irradiance, in the model's mode.
    ///
    /// # Errors
    /// A time or gain that can't be used.
    pub fn flat_response(
        &self,
        irradiance: &Spectrum<Irradiance>,
        exposure: &Exposure,
    ) -> Result<FlatResponse, SensorProblem> {
        exposure.validate()?;
        let model = self.model();
        // Integrate spectra to electrons
        let rates = self.flat_electron_rate(irradiance);
        let chain = Chain::new(self, exposure);
        let light_s = match &chain {
            Chain::Physical(chain) => chain.light_s(),
            Chain::Isetcam(_) => exposure.time_s,
        };
        let electrons: Vec<f64> = rates.iter().map(|rate| rate * light_s).collect();
        let volts_per_dn = model.volts_per_dn();
        let each = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { electrons.iter().map(|&e| f(e)).collect() };
        // Take the mean of every random term of the chain
        let (dark_electrons, volts, dn, black_level, noise_dn) = match &chain {
            Chain::Physical(chain) => {
                let dark = chain.dark_electrons();
                let dn = |e| chain.dn_of_electrons(e + dark).clamp(0.0, chain.max_dn());
                let one_read = |e| chain.dn_of_one_read(e + dark).clamp(0.0, f64::from(model.max_code()));
                (
                    dark,
                    each(&|e| (one_read(e) - model.black_level_dn) * volts_per_dn),
                    each(&dn),
                    chain.black_dn(),
                    each(&|e| chain.temporal_noise_dn(e + dark)),
                )
            }
            Chain::Isetcam(chain) => {
                let dark = chain.dark_electrons();
                (
                    dark,
                    each(&|e| chain.mean_volts(e)),
                    each(&|e| chain.mean_volts(e) / volts_per_dn),
                    chain.black_dn(),
                    each(&|e| chain.temporal_noise_dn(e + dark)),
                )
            }
        };
        let full_e = chain.full_scale_e();
        // ISETCam's negative flags clip nothing
        let clips = !matches!(model.mode, SensorMode::Isetcam { noise_flag: ..0 });
        let saturated = electrons.iter().map(|e| clips && e + dark_electrons >= full_e).collect();
        let channels = self.mosaic().channels.clone();
        Ok(FlatResponse { channels, electrons, dark_electrons, volts, dn, black_level, noise_dn, saturated })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::SpectralImage;
    use crate::sensor::{SensorModel, SpectralQe};
    use crate::spectral::Curve;

    #[test]
    fn a_patch_and_an_image_of_it_agree_in_every_mode() {
        let qe = SpectralQe::from_curves([("mono", Curve::constant(0.6))]).unwrap();
        let light = Spectrum::<Irradiance>::constant(&WavelengthGrid::default(), 3e-4);
        let mut image = SpectralImage::zeros(light.grid().clone(), 2, 2);
        image.data_mut().fill(3e-4);
        for (mode, offset_mv, gain) in [
            (SensorMode::NoiseFree, 0.0, 1.0),
            (SensorMode::NoiseFree, 5.0, 3.0),
            (SensorMode::Isetcam { noise_flag: 0 }, 0.0, 1.0),
            (SensorMode::Isetcam { noise_flag: -1 }, 20.0, 2.0),
        ] {
            let model = SensorModel {
                columns: 2,
                rows: 2,
                mosaic: vec![vec!["mono".into()]],
                analog_offset_mv: offset_mv,
                mode,
                ..SensorModel::default()
            };
            let sensor = Sensor::new(model, qe.clone()).unwrap();
            for time_s in [0.0, 0.003, 0.03, 3.0] {
                let exposure = Exposure { time_s, gain, ..Exposure::default() };
                let patch = sensor.flat_response(&light, &exposure).unwrap();
                let raw = sensor.expose(&image, &exposure).unwrap();
                let dn = f64::from(raw.data[0]);
                // Half a code of rounding, and single precision of the rate.
                assert!(
                    (dn - patch.dn[0].min(65_535.0)).abs() <= 0.5 + 1e-6 * dn,
                    "{mode:?} {time_s} s: {dn} and {patch:?}"
                );
                assert!((raw.black_level - patch.black_level).abs() < 1e-12);
                let clips = mode != SensorMode::Isetcam { noise_flag: -1 };
                assert_eq!(patch.saturated[0], raw.data[0] >= raw.white_level && clips, "{patch:?}");
            }
        }
    }

    #[test]
    fn table_1_at_half_a_well() {
        let qe = SpectralQe::from_curves([("mono", Curve::constant(1.0))]).unwrap();
        let model = SensorModel { mosaic: vec![vec!["mono".into()]], ..SensorModel::default() };
        let sensor = Sensor::new(model, qe).unwrap();
        let unit = Spectrum::<Irradiance>::constant(&WavelengthGrid::default(), 1.0);
        let light = unit.scaled(4500.0 / 0.03 / sensor.flat_electron_rate(&unit)[0]);
        let patch = sensor.flat_response(&light, &Exposure::default()).unwrap();
        assert!((patch.electrons[0] - 4500.0).abs() < 1e-6);
        let total_e = 4500.0 + patch.dark_electrons;
        assert!((patch.volts[0] - 0.911 * total_e / 9000.0).abs() < 1e-9);
        assert!((patch.dn[0] - 64.0 - 4096.0 * total_e / 9000.0).abs() < 1e-6);
        // sqrt(4500 + 13.73²) = 68.5 e- at 0.4551 DN/e-
        assert!((patch.noise_dn[0] - 31.15).abs() < 0.02, "{}", patch.noise_dn[0]);
        assert!(!patch.saturated[0]);
        // Gain 4 would need 3.6 V: the converter's own swing is where both volts and digital numbers stop.
        let patch = sensor.flat_response(&light, &Exposure { gain: 4.0, ..Exposure::default() }).unwrap();
        assert_eq!(patch.dn[0], 4095.0);
        assert!(patch.volts[0] <= 0.911, "{}", patch.volts[0]);
    }
}
