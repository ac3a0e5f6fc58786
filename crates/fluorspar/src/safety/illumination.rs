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

/// Subtenses beyond this count as this, rad: IEC 62471:2006, 4.2.1.
const LARGEST_SUBTENSE_RAD: f64 = 0.1;
/// Relative distance of the fields that are tried around a source.
const FIELD_STEP: f64 = 0.01;

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
        (0..irradiance.len()).map(|i| self.radiance_around(i, &irradiance, field_rad)).fold(0.0, f64::max)
    }

    /// The same of the field around one source.
    fn radiance_around(&self, middle: usize, irradiance: &[f64], field_rad: f64) -> f64 {
        let field_sr = 0.25 * PI * field_rad * field_rad;
        let share = |j: usize| (field_sr / self.sources[j].solid_angle_sr.max(field_sr)).min(1.0);
        let within = (0.5 * field_rad).cos();
        let seen = (0..irradiance.len()).filter(|&j| middle == j || self.cosine(middle, j) >= within);
        seen.map(|j| irradiance[j] * share(j)).sum::<f64>() / field_sr
    }

    fn cosine(&self, i: usize, j: usize) -> f64 {
        (0..3).map(|k| self.sources[i].direction[k] * self.sources[j].direction[k]).sum()
    }

    /// Mean radiance, W/(sr m²), and subtense, rad, whose product is the largest: what heats the retina most. Candidates are each source,
    /// with its radiance in the smallest field, and all that lies in a wider field around one of them, up to
    /// [`LARGEST_SUBTENSE_RAD`]: an array of small emitters is as large as it looks (ICNIRP 2013; IEC 60825-1:2014, 4.3 d).
    pub(super) fn hottest(&self, weight: ActionSpectrum, smallest_rad: f64) -> (f64, f64) {
        let irradiance = self.weighted(weight);
        let mut hottest = (0.0, smallest_rad);
        for middle in 0..irradiance.len() {
            let alone = self.sources[middle].subtense_rad.clamp(smallest_rad, LARGEST_SUBTENSE_RAD);
            let mut candidates = vec![(self.radiance_around(middle, &irradiance, smallest_rad), alone)];
            // Fields that reach just to another source, a percent apart at least
            let mut fields: Vec<f64> = (0..irradiance.len())
                .map(|j| 2.0 * self.cosine(middle, j).clamp(-1.0, 1.0).acos() * (1.0 + FIELD_STEP))
                .filter(|field| (smallest_rad..=LARGEST_SUBTENSE_RAD).contains(field))
                .collect();
            fields.sort_by(f64::total_cmp);
            fields.dedup_by(|next, kept| *next < *kept * (1.0 + FIELD_STEP));
            fields.push(LARGEST_SUBTENSE_RAD);
            candidates.extend(
                fields.into_iter().map(|field| (self.radiance_around(middle, &irradiance, field), field)),
            );
            for candidate in candidates {
                if candidate.0 * candidate.1 > hottest.0 * hottest.1 {
                    hottest = candidate;
                }
            }
        }
        hottest
    }

    /// Angle between the outermost edges of all sources, rad.
    pub(super) fn extent_rad(&self) -> f64 {
        let size = |i: usize| 0.5 * self.sources[i].subtense_rad;
        let apart = |i: usize, j: usize| {
            let angle = if i == j { 0.0 } else { self.cosine(i, j).clamp(-1.0, 1.0).acos() };
            angle + size(i) + size(j)
        };
        let count = self.sources.len();
        (0..count).flat_map(|i| (i..count).map(move |j| apart(i, j))).fold(0.0, f64::max)
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
    fn an_array_of_small_sources_heats_as_a_disc_of_its_size() {
        // 7 x 7 chips 10.5 mrad apart; a square of 73.5 mrad is a disc of 82.9
        let chip = |i: i32, j: i32| {
            let [x, y] = [i, j].map(|k| 0.0105 * f64::from(k));
            let z = (1.0 - x * x - y * y).sqrt();
            ApparentSource { direction: [x, y, z], ..source(0.0, 0.0113) }
        };
        let chips = (-3..=3).flat_map(|i| (-3..=3).map(move |j| chip(i, j))).collect();
        let line = Curve::new(vec![599.0, 600.0, 601.0], vec![0.0, 1.0, 0.0]).unwrap();
        let lit = |sources| Illumination { spectra: vec![line.clone()], sources };
        let heat = |light: &Illumination| {
            let (radiance, alpha) = light.hottest(ActionSpectrum::RetinalThermal, 0.0017);
            radiance * alpha
        };
        let (array, disc) =
            (lit(chips), lit(vec![ApparentSource { irradiance_factor: 49.0, ..source(0.0, 0.0829) }]));
        let ratio = heat(&array) / heat(&disc);
        assert!((0.9..1.1).contains(&ratio), "{ratio}");
        assert!(
            (array.extent_rad() - (0.063 * 2_f64.sqrt() * 1.0 + 0.0113)).abs() < 1e-3,
            "{}",
            array.extent_rad()
        );
        // Far apart each counts for itself
        let [two, one] = [vec![source(0.0, 0.02), source(0.5, 0.02)], vec![source(0.0, 0.02)]].map(lit);
        assert!((heat(&two) / heat(&one) - 1.0).abs() < 1e-12);
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
