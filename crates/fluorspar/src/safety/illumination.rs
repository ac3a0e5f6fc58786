//! Light sources as seen by an eye, and irradiance of a surface.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

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
/// Sources between whose pairs the middles of groups are looked for.
const MOST_PAIRED: usize = 64;
/// Directions in which a rectangle is tried: a square is found to be larger by 5 % at most.
const TURNS: u32 = 16;

/// Sides of the smallest rectangle around round things at these places with these diameters.
fn sides(places: &[(DVec2, f64)]) -> [f64; 2] {
    let count = places.len() as f64;
    let mean = places.iter().map(|(place, _)| *place).sum::<DVec2>() / count;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (place, _) in places {
        let off = *place - mean;
        (xx, xy, yy) = (xx + off.x * off.x, xy + off.x * off.y, yy + off.y * off.y);
    }
    let along_spread = 0.5 * (2.0 * xy).atan2(xx - yy);
    let side = |axis: DVec2| {
        let ends = places.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], (place, size)| {
            let at = place.dot(axis);
            [low.min(at - 0.5 * size), high.max(at + 0.5 * size)]
        });
        ends[1] - ends[0]
    };
    // A square has no axis of spread
    let turns = (0..TURNS).map(|turn| along_spread + 0.5 * PI * f64::from(turn) / f64::from(TURNS));
    let rectangles = turns.map(DVec2::from_angle).map(|axis| [axis, axis.perp()].map(side));
    rectangles.min_by(|a, b| (a[0] + a[1]).total_cmp(&(b[0] + b[1]))).unwrap_or_default()
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
    /// with its radiance in the smallest field, and sources that lie together, whose subtense is the mean of the sides of the rectangle
    /// around them, up to [`LARGEST_SUBTENSE_RAD`]: an array of small emitters is as large as it looks (ICNIRP 2013; IEC 60825-1:2014, 4.3 d).
    pub(super) fn hottest(&self, weight: ActionSpectrum, smallest_rad: f64) -> (f64, f64) {
        let irradiance = self.weighted(weight);
        let count = irradiance.len();
        let alone = (0..count).map(|i| {
            let subtense = self.sources[i].subtense_rad.clamp(smallest_rad, LARGEST_SUBTENSE_RAD);
            (self.radiance_around(i, &irradiance, smallest_rad), subtense)
        });
        let direction = |i: usize| DVec3::from(self.sources[i].direction);
        let pairs = (0..count.min(MOST_PAIRED)).flat_map(|i| (0..=i).map(move |j| (i, j)));
        let middles =
            pairs.map(|(i, j)| direction(i) + direction(j)).chain((MOST_PAIRED..count).map(direction));
        let all: DVec3 = (0..count).map(direction).sum();
        let together = middles.chain([all]).filter_map(DVec3::try_normalize).flat_map(|middle| {
            let mut near: Vec<usize> = (0..count).collect();
            near.sort_by(|i, j| direction(*j).dot(middle).total_cmp(&direction(*i).dot(middle)));
            self.groups_around(middle, &near, &irradiance, smallest_rad)
        });
        let hotter = |a: (f64, f64), b: (f64, f64)| if b.0 * b.1 > a.0 * a.1 { b } else { a };
        alone.chain(together).fold((0.0, smallest_rad), hotter)
    }

    /// Mean radiance and subtense of the nearest sources of a direction, one more each time, as far as they are seen as one. `near` are all of
    /// them in their order.
    fn groups_around(
        &self,
        middle: DVec3,
        near: &[usize],
        irradiance: &[f64],
        smallest_rad: f64,
    ) -> Vec<(f64, f64)> {
        let (across, up) = middle.any_orthonormal_pair();
        let place = |i: usize| {
            let direction = DVec3::from(self.sources[i].direction);
            DVec2::new(direction.dot(across), direction.dot(up)) / direction.dot(middle)
        };
        let is_ahead = |i: &&usize| DVec3::from(self.sources[**i].direction).dot(middle) > 0.5;
        let mut groups = Vec::new();
        let (mut places, mut total) = (Vec::new(), 0.0);
        for &source in near.iter().take_while(is_ahead) {
            places.push((place(source), self.sources[source].subtense_rad));
            total += irradiance[source];
            let sides = sides(&places);
            if sides.iter().any(|side| *side > LARGEST_SUBTENSE_RAD) {
                break;
            }
            let subtense = 0.5 * sides.iter().map(|side| side.max(smallest_rad)).sum::<f64>();
            groups.push((total / (0.25 * PI * subtense * subtense), subtense));
        }
        groups
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
    fn an_array_of_small_sources_heats_as_one_of_its_size() {
        let line = Curve::new(vec![599.0, 600.0, 601.0], vec![0.0, 1.0, 0.0]).unwrap();
        let at = |x: f64, y: f64, subtense: f64| {
            let z = (1.0 - x * x - y * y).sqrt();
            ApparentSource { direction: [x, y, z], ..source(0.0, subtense) }
        };
        let heat = |sources: Vec<ApparentSource>, smallest: f64| {
            let light = Illumination { spectra: vec![line.clone()], sources };
            let (radiance, alpha) = light.hottest(ActionSpectrum::RetinalThermal, smallest);
            radiance * alpha
        };
        // N / (pi/4 alpha) for N sources of 1 W/m², alpha the mean of the sides
        let near = |sources: Vec<ApparentSource>, smallest: f64, alpha: f64| {
            let expected = sources.len() as f64 / (0.25 * PI * alpha);
            let got = heat(sources, smallest);
            assert!((0.94..1.02).contains(&(got / expected)), "{got} {expected}");
        };
        let grid = |count: i32, pitch: f64, size: f64| -> Vec<ApparentSource> {
            let place = |k: i32| pitch * (f64::from(k) - 0.5 * f64::from(count - 1));
            (0..count).flat_map(|i| (0..count).map(move |j| at(place(i), place(j), size))).collect()
        };
        near(grid(7, 0.0105, 0.0113), 0.0017, 0.063 + 0.0113);
        near(grid(2, 0.02, 0.02), 0.0017, 0.04);
        let ring = (0..16).map(|k| f64::from(k) * PI / 8.0);
        near(ring.map(|a| at(0.03 * a.cos(), 0.03 * a.sin(), 0.003)).collect(), 0.011, 0.063);
        // A row in any direction: 91 by 11 mrad
        let row = (-4..=4).map(|k| 0.01 * f64::from(k));
        near(row.map(|x| at(0.6 * x, 0.8 * x, 0.011)).collect(), 0.011, 0.5 * (0.091 + 0.011));
        // Far apart each counts for itself
        let apart = heat(vec![source(0.0, 0.02), source(0.5, 0.02)], 0.0017);
        assert!((apart / heat(vec![source(0.0, 0.02)], 0.0017) - 1.0).abs() < 1e-12);
        let two =
            Illumination { spectra: Vec::new(), sources: vec![source(0.0, 0.002), source(0.02, 0.004)] };
        assert!((two.extent_rad() - 0.023).abs() < 1e-12);
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
