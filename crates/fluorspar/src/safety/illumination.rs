//! Light sources as seen by an eye, and irradiance of a surface.

use std::f64::consts::PI;

use super::ActionSpectrum;
use crate::spectral::Curve;

/// One bright thing that an eye sees.
#[derive(Clone, Debug, PartialEq)]
pub struct ApparentSource {
    /// Which spectrum of the illumination it has.
    pub spectrum: usize,
    /// Irradiance that it gives at the eye, per unit of its spectrum.
    pub irradiance_factor: f64,
    /// Unit vector from the eye toward it.
    pub direction: [f64; 3],
    /// Angle that it subtends, mean of its longest and shortest, rad; 0 for a point.
    pub subtense_rad: f64,
    /// Solid angle that it fills, sr; 0 for a point.
    pub solid_angle_sr: f64,
}

/// Light at one place: absolute spectra, and the sources that send them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Illumination {
    /// Spectra; with its factor each source gives W/(m² nm).
    pub spectra: Vec<Curve>,
    /// Sources.
    pub sources: Vec<ApparentSource>,
}

/// Smallest field over which the radiance of a source is averaged for the blue-light hazard, rad, by exposure time:
/// ICNIRP 2013; IEC 62471:2006, 4.2.2. Eyes move, so longer exposures blur more.
pub(super) fn blue_light_field_rad(duration_s: f64) -> f64 {
    if duration_s < 100.0 { 0.011 } else { (0.0011 * duration_s.sqrt()).min(0.110) }
}

/// Smallest subtense for the thermal hazard, rad, by exposure time: IEC 62471:2006, 4.2.1.
pub(super) fn thermal_field_rad(duration_s: f64) -> f64 {
    (0.0017 * (duration_s / 0.25).max(1.0).sqrt()).min(0.011)
}

impl Illumination {
    /// Weighted irradiance from all sources, W/m².
    pub fn irradiance(&self, weight: ActionSpectrum) -> f64 {
        self.weighted(weight).iter().sum()
    }

    /// Irradiance over all wavelengths, W/m².
    pub fn total_irradiance(&self) -> f64 {
        let totals: Vec<f64> = self.spectra.iter().map(Curve::total).collect();
        self.sources.iter().map(|source| source.irradiance_factor * totals[source.spectrum]).sum()
    }

    fn weighted(&self, weight: ActionSpectrum) -> Vec<f64> {
        let per_spectrum: Vec<f64> = self.spectra.iter().map(|spectrum| weight.weigh(spectrum)).collect();
        self.sources.iter().map(|source| source.irradiance_factor * per_spectrum[source.spectrum]).collect()
    }

    /// Largest weighted radiance, averaged over a round field of a full angle, W/(sr m²).
    ///
    /// The field is centered on each source in turn. What it holds of a source larger than itself is the share of their
    /// solid angles; sources whose center lies in it count in full. For a lone source larger than the field that is its
    /// radiance, for a smaller one `E / (pi field² / 4)`.
    pub fn averaged_radiance(&self, weight: ActionSpectrum, field_rad: f64) -> f64 {
        let irradiance = self.weighted(weight);
        let field_sr = 0.25 * PI * field_rad * field_rad;
        let inside = |i: usize, j: usize| {
            let cosine: f64 =
                (0..3).map(|k| self.sources[i].direction[k] * self.sources[j].direction[k]).sum();
            i == j || cosine >= (0.5 * field_rad).cos()
        };
        let share = |j: usize| (field_sr / self.sources[j].solid_angle_sr.max(field_sr)).min(1.0);
        (0..irradiance.len())
            .map(|i| {
                let seen = (0..irradiance.len()).filter(|&j| inside(i, j));
                seen.map(|j| irradiance[j] * share(j)).sum::<f64>() / field_sr
            })
            .fold(0.0, f64::max)
    }

    /// Largest subtense of a single source, rad.
    pub fn largest_subtense_rad(&self) -> f64 {
        self.sources.iter().map(|source| source.subtense_rad).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(angle_rad: f64, subtense_rad: f64) -> ApparentSource {
        ApparentSource {
            spectrum: 0,
            irradiance_factor: 1.0,
            direction: [angle_rad.sin(), 0.0, angle_rad.cos()],
            subtense_rad,
            solid_angle_sr: 0.25 * PI * subtense_rad * subtense_rad,
        }
    }

    #[test]
    fn radiance_is_averaged_over_the_field() {
        // 1 W/m² at 600 nm: weight 1 of the thermal hazard.
        let line = Curve::new(vec![599.0, 600.0, 601.0], vec![0.0, 1.0, 0.0]).unwrap();
        let at = |sources: Vec<ApparentSource>, field: f64| {
            Illumination { spectra: vec![line.clone()], sources }
                .averaged_radiance(ActionSpectrum::RetinalThermal, field)
        };
        let disc = |full_angle: f64| 0.25 * PI * full_angle * full_angle;
        let near = |got: f64, expected: f64| assert!((got - expected).abs() < 1e-9 * expected, "{got}");
        near(at(vec![source(0.0, 0.05)], 0.011), 1.0 / disc(0.05));
        near(at(vec![source(0.0, 0.002)], 0.011), 1.0 / disc(0.011));
        near(at(vec![source(0.0, 0.0)], 0.011), 1.0 / disc(0.011));
        // Two small ones, apart and together.
        near(at(vec![source(0.0, 0.001), source(0.02, 0.001)], 0.011), 1.0 / disc(0.011));
        near(at(vec![source(0.0, 0.001), source(0.02, 0.001)], 0.110), 2.0 / disc(0.110));
    }

    #[test]
    fn fields_grow_with_time() {
        assert_eq!([0.03, 99.0].map(blue_light_field_rad), [0.011; 2]);
        assert!((blue_light_field_rad(400.0) - 0.022).abs() < 1e-12);
        assert_eq!(blue_light_field_rad(1e5), 0.110);
        assert_eq!(thermal_field_rad(0.03), 0.0017);
        assert!((thermal_field_rad(1.0) - 0.0034).abs() < 1e-12);
        assert_eq!(thermal_field_rad(100.0), 0.011);
    }
}
