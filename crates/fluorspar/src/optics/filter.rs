//! Filters under the angles at which light really passes them, and the light that they add themselves.

use std::f64::consts::PI;

use crate::spectral::{Curve, Radiance, Spectrum, WavelengthGrid};

/// A filter: transmittance at normal incidence and how it moves with the angle.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    /// Transmittance at normal incidence.
    pub curve: Curve,
    /// Effective refractive index of an interference filter; `None` for one that does not move (absorbing glass).
    pub effective_index: Option<f64>,
}

impl Filter {
    /// Factor on every wavelength of the curve at the angle with this squared sine: `sqrt(1 - sin² / n²)`.
    pub fn shift(&self, sine2: f64) -> f64 {
        self.effective_index.map_or(1.0, |index| (1.0 - sine2 / (index * index)).max(0.0).sqrt())
    }

    /// Transmittance for light at an angle to the normal: `T(lambda) = T0(lambda / shift)`.
    pub fn at_angle(&self, angle_deg: f64) -> Curve {
        let sine = angle_deg.to_radians().sin();
        let shift = self.shift(sine * sine);
        if shift == 1.0 {
            return self.curve.clone();
        }
        let (first, last) = self.curve.range_nm();
        Curve::from_fn(first, last, |nm| self.shifted(nm, shift))
    }

    /// Value of the moved curve; beyond its end it keeps its last value, since the data only end, not the filter.
    fn shifted(&self, wavelength_nm: f64, shift: f64) -> f64 {
        let (first, last) = self.curve.range_nm();
        self.curve.at((wavelength_nm / shift).clamp(first, last))
    }
}

/// How light is spread over angles to an axis: shares of squared sines.
#[derive(Clone, Debug, PartialEq)]
pub struct AngleDistribution {
    /// `(sin², share)`, shares adding up to 1.
    shares: Vec<(f64, f64)>,
}

/// Classes of equal share into which many rays are gathered.
const ANGLE_CLASSES: usize = 24;

impl AngleDistribution {
    /// All light at one angle.
    pub fn single(angle_deg: f64) -> Self {
        Self { shares: vec![(angle_deg.to_radians().sin().powi(2), 1.0)] }
    }

    /// Rays with their weights, gathered into classes. `None` without light.
    pub fn of_rays(rays: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let mut rays: Vec<(f64, f64)> = rays.into_iter().filter(|ray| ray.1 > 0.0).collect();
        rays.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: f64 = rays.iter().map(|ray| ray.1).sum();
        if total <= 0.0 {
            return None;
        }
        let mut sums = vec![(0.0, 0.0); ANGLE_CLASSES];
        let mut before = 0.0;
        for (sine2, weight) in rays {
            let class = ((before + 0.5 * weight) / total * ANGLE_CLASSES as f64) as usize;
            let sum = &mut sums[class.min(ANGLE_CLASSES - 1)];
            sum.0 += sine2 * weight;
            sum.1 += weight;
            before += weight;
        }
        let shares = sums.into_iter().filter(|sum| sum.1 > 0.0).map(|(s, w)| (s / w, w / total)).collect();
        Some(Self { shares })
    }

    /// Mean of a function of `sin²`.
    pub fn mean(&self, f: impl Fn(f64) -> f64) -> f64 {
        self.shares.iter().map(|(sine2, share)| share * f(*sine2)).sum()
    }
}

#[cfg(test)]
impl AngleDistribution {
    /// A cone about the axis, filled by a Lambertian field: even in `sin²`.
    pub(super) fn cone(half_angle_deg: f64) -> Self {
        let most = half_angle_deg.to_radians().sin().powi(2);
        let share = 1.0 / ANGLE_CLASSES as f64;
        let middle = |class: usize| most * (class as f64 + 0.5) * share;
        Self { shares: (0..ANGLE_CLASSES).map(|class| (middle(class), share)).collect() }
    }

    /// Root mean square angle, degrees.
    pub(super) fn rms_angle_deg(&self) -> f64 {
        self.mean(|sine2| sine2).sqrt().min(1.0).asin().to_degrees()
    }

    /// Largest angle, degrees.
    pub(super) fn largest_angle_deg(&self) -> f64 {
        self.shares.iter().fold(0.0_f64, |a, s| a.max(s.0)).sqrt().min(1.0).asin().to_degrees()
    }
}

/// Transmittance of filters one behind the other, averaged over angles: the mean of the product, not the product of means,
/// because a ray passes all of them at its own angle.
pub fn averaged_transmittance(filters: &[Filter], angles: &AngleDistribution) -> Curve {
    if filters.iter().all(|filter| filter.effective_index.is_none()) {
        return filters.iter().fold(Curve::constant(1.0), |product, filter| product.times(&filter.curve));
    }
    let shifts: Vec<Vec<f64>> =
        angles.shares.iter().map(|(sine2, _)| filters.iter().map(|f| f.shift(*sine2)).collect()).collect();
    Curve::from_fn(200.0, 1200.0, |nm| {
        angles
            .shares
            .iter()
            .zip(&shifts)
            .map(|((_, share), shifts)| {
                let product: f64 = filters
                    .iter()
                    .zip(shifts)
                    .map(|(filter, shift)| {
                        let (first, last) = filter.curve.range_nm();
                        if (first..=last).contains(&nm) { filter.shifted(nm, *shift) } else { 0.0 }
                    })
                    .product();
                share * product
            })
            .sum()
    })
}

/// Filters of a camera, and how light passes them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FilterStack {
    /// The filters.
    pub filters: Vec<Filter>,
    /// Angle at which all light passes, degrees, unless `lens_angles`.
    pub angle_deg: f64,
    /// Whether light passes at the angles of the rays of the lens.
    pub lens_angles: bool,
    /// Whether the filters are between lens and film rather than in front of the lens.
    pub behind_lens: bool,
    /// Fluorescence of the filters.
    pub autofluorescence: Option<FilterAutofluorescence>,
}

impl FilterStack {
    /// Transmittance of all filters for light at these angles.
    pub fn transmittance(&self, angles: &AngleDistribution) -> Curve {
        averaged_transmittance(&self.filters, angles)
    }

    /// Transmittance of all filters at one angle.
    pub fn at_angle(&self, angle_deg: f64) -> Curve {
        self.filters
            .iter()
            .fold(Curve::constant(1.0), |product, filter| product.times(&filter.at_angle(angle_deg)))
    }
}

/// A filter that fluoresces: what it absorbs comes back, in part, at longer wavelengths, and veils the image.
///
/// Model: the filter is close to the lens and far out of focus, so its light is spread evenly. Of the photons that
/// it stops (`1 - T`, at normal incidence: reflected ones count as stopped, which overstates interference filters) the
/// share `photon_yield` is emitted again, half of it toward the lens, Lambertian and behind the layers that block: its
/// own light is not filtered again. With the photon irradiance `E_q` on the filter its radiance is
/// `L_q(lambda) = photon_yield e(lambda) / (2 pi) integral (1 - T) E_q`, with `e` of unit area.
#[derive(Clone, Debug, PartialEq)]
pub struct FilterAutofluorescence {
    /// Photons emitted, in all directions, per photon stopped.
    pub photon_yield: f64,
    /// Emission, photons per nm, any scale.
    pub emission: Curve,
}

impl FilterAutofluorescence {
    /// Radiance of the filter itself under an irradiance, W/(sr m² nm); `blocked` is `1 - T` on the same grid.
    pub fn veil_radiance(
        &self,
        irradiance: &[f64],
        transmittance: &[f64],
        grid: &WavelengthGrid,
    ) -> Spectrum<Radiance> {
        let centers = grid.centers_nm();
        let widths = grid.widths_nm();
        // Photons in units of 1/(h c): energy times wavelength.
        let stopped: f64 = irradiance
            .iter()
            .zip(transmittance)
            .zip(centers.iter().zip(&widths))
            .map(|((e, t), (nm, width))| e * (1.0 - t) * nm * width)
            .sum();
        let area = self.emission.total();
        let factor = if area > 0.0 { self.photon_yield * stopped / (2.0 * PI * area) } else { 0.0 };
        let emission: Spectrum<Radiance> = self.emission.on_grid(grid);
        let values = emission.values().iter().zip(&centers).map(|(e, nm)| factor * e / nm).collect();
        Spectrum::from_parts(grid.clone(), values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn long_pass(cut_nm: f64, index: Option<f64>) -> Filter {
        let curve = Curve::from_fn(200.0, 1200.0, |nm| 1.0 / (1.0 + (-(nm - cut_nm) / 1.0).exp()));
        Filter { curve, effective_index: index }
    }

    fn half_nm(curve: &Curve) -> f64 {
        (4000..6000).map(|i| f64::from(i) * 0.1).find(|nm| curve.at(*nm) >= 0.5).unwrap()
    }

    #[test]
    fn an_edge_moves_by_the_square_root() {
        let filter = long_pass(475.0, Some(1.8));
        let expected = 475.0 * (1.0 - (30.0_f64.to_radians().sin() / 1.8).powi(2)).sqrt();
        assert!((half_nm(&filter.at_angle(30.0)) - expected).abs() < 0.11);
        assert_eq!(long_pass(475.0, None).at_angle(30.0), long_pass(475.0, None).curve);
    }

    #[test]
    fn a_cone_averages_the_edges_of_its_angles() {
        // Even in sin² from 0 to s: an edge moves by 475 (1 - sqrt(1 - sin²/n²)), so the mean edge is that of the mean
        // sin² to first order, s / 2, and the averaged edge is as wide as the span of the shifts.
        let half_angle: f64 = 20.0;
        let s = half_angle.to_radians().sin().powi(2);
        let averaged =
            averaged_transmittance(&[long_pass(475.0, Some(1.6))], &AngleDistribution::cone(half_angle));
        let mean_edge = 475.0 * (1.0 - 0.5 * s / 2.56).sqrt();
        assert!((half_nm(&averaged) - mean_edge).abs() < 0.3, "{} {mean_edge}", half_nm(&averaged));
        // The integral of a step is moved by the mean shift exactly.
        let closed: f64 = {
            let n = 1000;
            (0..n).map(|i| 475.0 * (1.0 - s * (f64::from(i) + 0.5) / f64::from(n) / 2.56).sqrt()).sum::<f64>()
                / f64::from(n)
        };
        let edge = 600.0 - averaged.integral(400.0, 600.0);
        assert!((edge - closed).abs() < 0.05, "{edge} {closed}");
    }

    #[test]
    fn two_filters_pass_each_ray_at_its_own_angle() {
        // A band between two edges that move together never closes; products of means would leak at both ends.
        let short = Filter {
            curve: Curve::from_fn(200.0, 1200.0, |nm| if nm < 480.0 { 1.0 } else { 0.0 }),
            effective_index: Some(1.5),
        };
        let long = Filter {
            curve: Curve::from_fn(200.0, 1200.0, |nm| if nm > 480.0 { 1.0 } else { 0.0 }),
            effective_index: Some(1.5),
        };
        let both = averaged_transmittance(&[short, long], &AngleDistribution::cone(25.0));
        assert!(both.total() < 0.6, "{}", both.total());
    }

    #[test]
    fn rays_are_gathered_by_their_weight() {
        let rays = (0..1000).map(|i| (f64::from(i) * 1e-4, if i < 500 { 1.0 } else { 3.0 }));
        let angles = AngleDistribution::of_rays(rays).unwrap();
        let mean = (500.0 * 0.02495 + 1500.0 * 0.07495) / 2000.0;
        assert!((angles.mean(|s| s) - mean).abs() < 1e-12);
        assert!((angles.mean(|_| 1.0) - 1.0).abs() < 1e-12);
        assert!(AngleDistribution::of_rays([(0.1, 0.0)]).is_none());
    }

    #[test]
    fn a_fluorescing_filter_gives_back_its_share_of_photons() {
        let grid = WavelengthGrid::uniform(380.0, 700.0, 10.0).unwrap();
        let emission = Curve::from_fn(500.0, 600.0, |_| 1.0);
        let filter = FilterAutofluorescence { photon_yield: 0.01, emission };
        let irradiance: Vec<f64> =
            grid.centers_nm().iter().map(|nm| if *nm < 405.0 { 2.0 } else { 0.0 }).collect();
        let stopped: f64 = grid.centers_nm().iter().zip(&irradiance).map(|(nm, e)| e * nm * 10.0).sum();
        let veil = filter.veil_radiance(&irradiance, &vec![0.0; grid.len()], &grid);
        let photons: f64 = veil.values().iter().zip(grid.centers_nm()).map(|(l, nm)| l * nm * 10.0).sum();
        // Half of the yield leaves to each side, pi L being the exitance of one.
        assert!((PI * photons / (0.5 * 0.01 * stopped) - 1.0).abs() < 1e-9);
        assert!(veil.values()[0] == 0.0);
    }
}
