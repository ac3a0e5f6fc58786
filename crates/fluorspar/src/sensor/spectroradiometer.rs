//! A spectroradiometer: reads the radiance of a spot behind a filter, through a slit, above a noise floor.

use serde::Serialize;

use super::SensorProblem;
use crate::sampling::random::Key;
use crate::spectral::{Curve, Radiance, Spectrum};
use crate::units::number_text;

/// An instrument that reads spectral radiance.
///
/// ```text
/// S(l)  = integral L(x) T(x) tri((x - l) / b) / b dx           slit: triangle of half width b
/// S'(l) = S(l) + stray * mean of S over all readings
/// noise = hypot(floor, max S' / dynamic range) / sqrt(readings)
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Spectroradiometer {
    /// First wavelength, nm.
    pub first_nm: f64,
    /// Last wavelength, nm.
    pub last_nm: f64,
    /// Spacing of the readings, nm.
    pub step_nm: f64,
    /// Full width at half maximum of the slit function, nm.
    pub bandwidth_nm: f64,
    /// Noise of one reading in the dark, W/(sr m² nm) rms.
    pub noise_floor: f64,
    /// Largest signal of a reading over the noise that it brings to every wavelength.
    pub dynamic_range: f64,
    /// Share of the mean signal that is scattered over all wavelengths.
    pub stray_light: f64,
    /// Readings that are averaged.
    pub readings: u32,
    /// Transmittance of the filters in front.
    pub filter: Curve,
}

/// A reading of the instrument.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpectralReading {
    /// Wavelengths whose slit lies wholly within the bands of the light, nm.
    pub wavelength_nm: Vec<f64>,
    /// Radiance behind filter and slit, W/(sr m² nm).
    pub expected: Vec<f64>,
    /// The reading: with stray light and noise, W/(sr m² nm).
    pub reading: Vec<f64>,
    /// Standard deviation of the reading, W/(sr m² nm), the same at every wavelength.
    pub standard_deviation: f64,
}

/// Most readings of one spectrum.
const MOST_READINGS: f64 = 20_000.0;
/// Samples across the slit.
const SLIT_SAMPLES: usize = 64;

impl Spectroradiometer {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that can't be used, with the way to fix it.
    pub fn validate(&self) -> Result<(), SensorProblem> {
        let within = |field: &str, value: f64, [low, high]: [f64; 2], unit: &str| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            let [low, high] = [low, high].map(number_text);
            Err(SensorProblem::new(field, format!("must be between {low} and {high}{unit}")))
        };
        within("first_nm", self.first_nm, [200.0, 1200.0], " nm")?;
        within("last_nm", self.last_nm, [200.0, 1200.0], " nm")?;
        within("step_nm", self.step_nm, [0.1, 100.0], " nm")?;
        within("bandwidth_nm", self.bandwidth_nm, [0.1, 100.0], " nm")?;
        within("noise_floor", self.noise_floor, [0.0, 1e6], " W/(sr m² nm)")?;
        within("dynamic_range", self.dynamic_range, [1.0, 1e12], "")?;
        within("stray_light", self.stray_light, [0.0, 0.1], "")?;
        if self.last_nm <= self.first_nm {
            let message = format!("must be above first_nm, {}", self.first_nm);
            return Err(SensorProblem::new("last_nm", message));
        }
        if (self.last_nm - self.first_nm) / self.step_nm > MOST_READINGS {
            return Err(SensorProblem::new(
                "step_nm",
                "makes more than 20000 readings; choose a larger step",
            ));
        }
        within("readings", self.readings.into(), [1.0, 1e6], "")?;
        Ok(())
    }

    /// Reads a radiance. Noise is a function of the seed, the name and the number of the reading.
    ///
    /// Bands of the light are flat between their edges; filter and slit are sampled finely within them.
    pub fn read(&self, light: &Spectrum<Radiance>, seed: u64, name: &str) -> SpectralReading {
        let grid = light.grid();
        let (start, end) = (grid.start_nm(), grid.end_nm());
        let edges = grid.edges_nm();
        let band = |nm: f64| {
            edges.partition_point(|&edge| edge <= nm).saturating_sub(1).min(light.values().len() - 1)
        };
        let count = ((self.last_nm - self.first_nm) / self.step_nm + 1e-9).floor() as usize;
        let b = self.bandwidth_nm;
        // List the wavelengths whose slit lies within the bands
        let wavelength_nm: Vec<f64> = (0..=count)
            .map(|i| self.first_nm + i as f64 * self.step_nm)
            .filter(|nm| nm - b >= start - 1e-9 && nm + b <= end + 1e-9)
            .collect();
        // Integrate over the triangular slit
        let expected: Vec<f64> = wavelength_nm
            .iter()
            .map(|&nm| {
                // Midpoints across the triangle: their weights sum to one exactly.
                let (mut sum, mut weights) = (0.0, 0.0);
                for sample in 0..SLIT_SAMPLES {
                    let offset = (2.0 * (sample as f64 + 0.5) / SLIT_SAMPLES as f64 - 1.0) * b;
                    let weight = 1.0 - offset.abs() / b;
                    let at = nm + offset;
                    sum += weight * light[band(at)] * self.filter.at(at);
                    weights += weight;
                }
                sum / weights
            })
            .collect();
        // Add stray light
        let mean = expected.iter().sum::<f64>() / expected.len().max(1) as f64;
        let stray = self.stray_light * mean;
        let peak = expected.iter().fold(0.0, |peak: f64, value| peak.max(value + stray));
        // Draw the noise
        let standard_deviation =
            self.noise_floor.hypot(peak / self.dynamic_range) / f64::from(self.readings.max(1)).sqrt();
        let key = Key::new(seed).with_text("spectroradiometer").with_text(name);
        let draw = |index: usize| key.with(index as u64).normal();
        let reading = expected
            .iter()
            .enumerate()
            .map(|(index, value)| value + stray + standard_deviation * draw(index))
            .collect();
        SpectralReading { wavelength_nm, expected, reading, standard_deviation }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::WavelengthGrid;

    fn instrument() -> Spectroradiometer {
        Spectroradiometer {
            first_nm: 400.0,
            last_nm: 700.0,
            step_nm: 1.0,
            bandwidth_nm: 8.0,
            noise_floor: 0.0,
            dynamic_range: 1e12,
            stray_light: 0.0,
            readings: 1,
            filter: Curve::constant(1.0),
        }
    }

    #[test]
    fn a_line_is_read_as_the_slit_and_its_power_is_kept() {
        let grid = WavelengthGrid::uniform(380.0, 720.0, 1.0).unwrap();
        let mut values = vec![0.0; grid.len()];
        values[170] = 3.0; // 550 nm, 1 nm wide
        let light = Spectrum::new(grid, values).unwrap();
        let reading = instrument().read(&light, 1, "a");
        let sum: f64 = reading.expected.iter().sum();
        // 64 samples of a triangle of 16 nm: each 0.25 nm, so the 1 nm line holds four.
        assert!((sum - 3.0).abs() < 1e-9, "{sum}");
        let at = |nm: f64| {
            let index = reading.wavelength_nm.iter().position(|w| (w - nm).abs() < 1e-9).unwrap();
            reading.expected[index]
        };
        // Peak 1/b, averaged over the line's own width of 1 nm: 1/8 (1 - 0.25/8).
        assert!((at(550.0) - 3.0 / 8.0 * (1.0 - 0.25 / 8.0)).abs() < 1e-3);
        assert!((at(554.0) / (3.0 / 16.0) - 1.0).abs() < 1e-3, "half maximum at half the bandwidth");
        assert_eq!((at(541.0), at(559.0)), (0.0, 0.0));
    }

    #[test]
    fn only_wavelengths_whose_slit_is_covered_are_read() {
        let grid = WavelengthGrid::uniform(405.0, 695.0, 10.0).unwrap();
        let flat = Spectrum::constant(&grid, 2.0);
        let reading = instrument().read(&flat, 1, "a");
        assert_eq!((reading.wavelength_nm[0], reading.wavelength_nm.last().copied()), (408.0, Some(692.0)));
        assert!(reading.expected.iter().all(|v| (v - 2.0).abs() < 1e-12));
        // A filter of 30 %.
        let filtered = Spectroradiometer { filter: Curve::constant(0.3), ..instrument() };
        assert!(filtered.read(&flat, 1, "a").expected.iter().all(|v| (v - 0.6).abs() < 1e-12));
    }

    #[test]
    fn noise_has_its_floor_its_range_and_its_average() {
        let grid = WavelengthGrid::uniform(380.0, 720.0, 1.0).unwrap();
        let flat = Spectrum::constant(&grid, 1.0);
        let noisy = Spectroradiometer {
            noise_floor: 3e-3,
            dynamic_range: 250.0,
            stray_light: 0.01,
            step_nm: 0.1,
            readings: 4,
            ..instrument()
        };
        let reading = noisy.read(&flat, 5, "a");
        let expected_sd = 3e-3f64.hypot(1.01 / 250.0) / 2.0;
        assert!((reading.standard_deviation / expected_sd - 1.0).abs() < 1e-12);
        let n = reading.reading.len() as f64;
        let mean = reading.reading.iter().sum::<f64>() / n;
        let sd = (reading.reading.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        // Four standard errors.
        assert!((mean - 1.01).abs() < 4.0 * expected_sd / n.sqrt(), "{mean}");
        assert!((sd / expected_sd - 1.0).abs() < 4.0 / (2.0 * n).sqrt(), "{sd}");
        assert_eq!(reading, noisy.read(&flat, 5, "a"));
        assert_ne!(reading.reading, noisy.read(&flat, 5, "b").reading);
    }

    #[test]
    fn problems_name_the_field() {
        let field = |instrument: Spectroradiometer| instrument.validate().unwrap_err().field;
        assert!(instrument().validate().is_ok());
        assert_eq!(field(Spectroradiometer { bandwidth_nm: 0.0, ..instrument() }), "bandwidth_nm");
        assert_eq!(field(Spectroradiometer { last_nm: 300.0, ..instrument() }), "last_nm");
        assert_eq!(field(Spectroradiometer { dynamic_range: f64::NAN, ..instrument() }), "dynamic_range");
        assert_eq!(field(Spectroradiometer { readings: 0, ..instrument() }), "readings");
    }
}
