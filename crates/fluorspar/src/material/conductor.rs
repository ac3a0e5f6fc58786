//! Conductors: metals.

use glam::{Vec2, Vec3};

use super::bsdf::{
    BsdfSample, BsdfValue, LEAST_COSINE, Lobe, SpectralTerm, choose_lobe, cosine_lobe, fluorescent_share,
};
use super::fresnel::conductor_fresnel;
use super::material_error::{MaterialError, at_most_one};
use super::microfacet::{self, AlbedoTable, mirror_lobe, white_microfacets};
use super::texture::ScalarTexture;
use crate::sampling::warp;
use crate::spectral::{Curve, WavelengthGrid};

/// A metal surface, smooth or rough: GGX microfacets with the Fresnel reflectance of a complex refractive index.
///
/// Energy that single scattering between rough microfacets loses is returned diffusely, tinted by repeated reflection (Kulla
/// and Conty 2017).
#[derive(Clone, Debug, PartialEq)]
pub struct Conductor {
    /// Real part n of the refractive index against air.
    pub n: Curve,
    /// Extinction coefficient k, the imaginary part.
    pub k: Curve,
    /// GGX roughness alpha, 0 to 1; below [`super::MIN_ROUGHNESS`] the surface is a mirror.
    pub roughness: ScalarTexture,
    /// Whether light that microfacets scatter more than once is lost, as in renderers without it.
    pub single_scattering: bool,
}

impl Conductor {
    /// Checks that n and k are those of a metal over all bands, and the roughness.
    pub(super) fn check(&self, grid: &WavelengthGrid) -> Result<(), MaterialError> {
        let (start_nm, end_nm) = (grid.start_nm(), grid.end_nm());
        for (parameter, curve, least) in [("n", &self.n, 1e-6), ("k", &self.k, 0.0)] {
            let (first_nm, last_nm) = curve.range_nm();
            if first_nm > start_nm || last_nm < end_nm {
                return Err(MaterialError::MetalRange { parameter, first_nm, last_nm, start_nm, end_nm });
            }
            if let Some(&value) = curve.values().iter().find(|v| !(**v >= least && **v <= 1e3)) {
                return Err(MaterialError::MetalValue { parameter, value, least });
            }
        }
        at_most_one("roughness", &self.roughness)
    }
}

const COSINES: usize = 65;
const ROUGHNESSES: usize = 33;
/// Spectra of which those of all angles are sums: four leave less than 1e-4 of real metals.
pub const TERMS: usize = 4;

/// Reflectance of a metal over wavelength and angle, in the form that paths need: one spectrum per point of view, and
/// scalars for every direction of the light.
///
/// For a viewer at an angle the spectrum is the reflectance `V` at that angle, as a sum of [`TERMS`] spectra. Reflectances at other angles
/// (which rough microfacets bring into view) are fitted, over the bands of the render, by `a V + b` (least squares), as
/// is the tint of light that is scattered more than once. Mirrors are exact but for these sums and the interpolation
/// between 65 angles; see [`Self::largest_error`] and [`Self::mean_error`] for what the fit costs rough metals.
#[derive(Clone, Debug, PartialEq)]
pub struct ConductorReflectance {
    /// `[term][band]`.
    basis: Vec<Vec<f32>>,
    /// `[viewer]`.
    weights: Vec<[f32; TERMS]>,
    /// `(a, b)`, `[viewer][microfacet]`.
    angles: Vec<(f32, f32)>,
    /// `(a, b)`, `[viewer][roughness]`, of light scattered more than once between microfacets.
    multiple: Vec<(f32, f32)>,
    /// Largest reflectance of any band over the cosine.
    largest: Vec<f32>,
    largest_error: f64,
    mean_error: f64,
}

impl ConductorReflectance {
    /// Fits a metal on the bands of a grid. `rough` holds the albedo of microfacets that reflect everything.
    pub fn new(conductor: &Conductor, grid: &WavelengthGrid, rough: &AlbedoTable) -> Self {
        let (n, k) = (conductor.n.bin_averages(grid), conductor.k.bin_averages(grid));
        let bands = grid.len();
        // Tabulate the reflectance over angles
        let exact: Vec<Vec<f64>> = (0..COSINES)
            .map(|node| {
                let cos = node_cosine(node);
                (0..bands).map(|band| conductor_fresnel(cos, n[band], k[band])).collect()
            })
            .collect();
        // Mean over the hemisphere: 2 cos dcos, trapezoidal.
        let mean: Vec<f64> = (0..bands)
            .map(|band| {
                (1..COSINES)
                    .map(|node| {
                        let (low, high) = (node_cosine(node - 1), node_cosine(node));
                        (high - low) * (low * exact[node - 1][band] + high * exact[node][band])
                    })
                    .sum()
            })
            .collect();
        // Compute the color of multiple scattering between microfacets
        let tints: Vec<Vec<f64>> = (0..ROUGHNESSES)
            .map(|node| {
                let alpha = node as f32 / (ROUGHNESSES - 1) as f32;
                let albedo = f64::from(rough.at(1.0, alpha).1).min(1.0);
                mean.iter().map(|f| f * f * albedo / (1.0 - f * (1.0 - albedo))).collect()
            })
            .collect();
        // Project the tables onto a few spectra
        let basis = orthonormal_basis(&exact);
        let weights: Vec<[f32; TERMS]> =
            exact.iter().map(|row| std::array::from_fn(|term| dot(row, &basis[term]) as f32)).collect();
        let (mut angles, mut multiple) = (Vec::new(), Vec::new());
        let (mut largest_error, mut sum_error) = (0.0_f64, 0.0);
        // Fit reflectances at other angles to that at the angle of view
        for view in &exact {
            for reflected in &exact {
                let (a, b, error) = linear_fit(view, reflected);
                largest_error = largest_error.max(error);
                sum_error += error;
                angles.push((a as f32, b as f32));
            }
            for tint in &tints {
                let (a, b, _) = linear_fit(view, tint);
                multiple.push((a as f32, b as f32));
            }
        }
        Self {
            basis: basis.iter().map(|term| term.iter().map(|&f| f as f32).collect()).collect(),
            weights,
            angles,
            multiple,
            largest: exact.iter().map(|row| row.iter().copied().fold(0.0, f64::max) as f32).collect(),
            largest_error,
            mean_error: sum_error / (COSINES * COSINES) as f64,
        }
    }

    /// The tabulated viewer nearest to a cosine.
    pub fn viewer(&self, cos: f32) -> usize {
        (node_coordinate(cos) + 0.5) as usize
    }

    /// The spectra of which reflectances are sums: [`TERMS`], one value per band each, of any sign.
    pub fn basis(&self) -> &[Vec<f32>] {
        &self.basis
    }

    /// Weights of the terms for the reflectance at the angle of a viewer.
    pub fn weights(&self, viewer: usize) -> &[f32; TERMS] {
        &self.weights[viewer]
    }

    /// Reflectance at the angle of a viewer, one value per band.
    pub fn spectrum(&self, viewer: usize) -> Vec<f32> {
        let mut sum = vec![0.0; self.basis[0].len()];
        for (weight, term) in self.weights[viewer].iter().zip(&self.basis) {
            sum.iter_mut().zip(term).for_each(|(sum, value)| *sum += weight * value);
        }
        sum
    }

    /// `(a, b)` of the reflectance `a V + b` of microfacets at an angle, for the spectrum `V` of a viewer.
    pub fn at_angle(&self, viewer: usize, cos: f32) -> (f32, f32) {
        interpolate(&self.angles[viewer * COSINES..(viewer + 1) * COSINES], node_coordinate(cos))
    }

    /// `(a, b)` of the tint of multiple scattering.
    pub fn multiple(&self, viewer: usize, alpha: f32) -> (f32, f32) {
        let row = &self.multiple[viewer * ROUGHNESSES..(viewer + 1) * ROUGHNESSES];
        interpolate(row, alpha.clamp(0.0, 1.0) * (ROUGHNESSES - 1) as f32)
    }

    /// Largest reflectance of any band at an angle.
    pub fn largest_at(&self, cos: f32) -> f32 {
        let (cell, f) = cell(node_coordinate(cos), self.largest.len());
        self.largest[cell] * (1.0 - f) + self.largest[cell + 1] * f
    }

    /// Largest difference between fit and exact reflectance over bands, viewers and microfacets.
    pub fn largest_error(&self) -> f64 {
        self.largest_error
    }

    /// Mean over viewers and microfacets of the largest difference of any band.
    pub fn mean_error(&self) -> f64 {
        self.mean_error
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Orthonormal spectra that span the rows as well as so few can: in turn the row with the largest rest, with the
/// earlier ones taken out.
fn orthonormal_basis(rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut rest = rows.to_vec();
    let mut basis = Vec::with_capacity(TERMS);
    for _ in 0..TERMS {
        let norm2 = |row: &Vec<f64>| dot(row, row);
        let Some(largest) = rest.iter().max_by(|a, b| norm2(a).total_cmp(&norm2(b))).cloned() else { break };
        let norm = norm2(&largest).sqrt();
        let unit: Vec<f64> =
            if norm > 1e-9 { largest.iter().map(|v| v / norm).collect() } else { vec![0.0; largest.len()] };
        for row in &mut rest {
            let share = dot(row, &unit);
            row.iter_mut().zip(&unit).for_each(|(value, u)| *value -= share * u);
        }
        basis.push(unit);
    }
    basis
}

/// Nodes crowd toward grazing angles.
fn node_cosine(node: usize) -> f64 {
    (node as f64 / (COSINES - 1) as f64).powi(2)
}

fn node_coordinate(cos: f32) -> f32 {
    cos.clamp(0.0, 1.0).sqrt() * (COSINES - 1) as f32
}

fn cell(x: f32, nodes: usize) -> (usize, f32) {
    let cell = (x as usize).min(nodes - 2);
    (cell, x - cell as f32)
}

fn interpolate(table: &[(f32, f32)], x: f32) -> (f32, f32) {
    let (cell, f) = cell(x, table.len());
    let ((a0, b0), (a1, b1)) = (table[cell], table[cell + 1]);
    (a0 + (a1 - a0) * f, b0 + (b1 - b0) * f)
}

/// Least squares `y = a x + b` and the largest residual. A spectrally flat `x` gives `a = 0`.
fn linear_fit(x: &[f64], y: &[f64]) -> (f64, f64, f64) {
    let count = x.len() as f64;
    let (mean_x, mean_y) = (x.iter().sum::<f64>() / count, y.iter().sum::<f64>() / count);
    let variance: f64 = x.iter().map(|x| (x - mean_x).powi(2)).sum();
    let covariance: f64 = x.iter().zip(y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let a = if variance > 1e-10 * count { covariance / variance } else { 0.0 };
    let b = mean_y - a * mean_x;
    let error = x.iter().zip(y).map(|(x, y)| (a * x + b - y).abs()).fold(0.0, f64::max);
    (a, b, error)
}

/// A metal with its reflectance on the bands of a grid.
#[derive(Debug)]
pub(super) struct PreparedConductor {
    reflectance: ConductorReflectance,
    roughness: ScalarTexture,
    /// Albedo of microfacets that reflect everything.
    white: &'static AlbedoTable,
    single_scattering: bool,
    fluoresces: bool,
}

impl Conductor {
    /// Fits the reflectance over the bands of a grid; with it the terms of its spectra.
    pub(super) fn prepare(
        &self,
        grid: &WavelengthGrid,
        fluoresces: bool,
    ) -> (PreparedConductor, Vec<SpectralTerm>) {
        let white = white_microfacets();
        let reflectance = ConductorReflectance::new(self, grid, white);
        let centers = grid.centers_nm();
        let term = |bands: &Vec<f32>| {
            let values = bands.iter().map(|&value| f64::from(value)).collect();
            // A single band makes no curve.
            let spectrum = Curve::new(centers.clone(), values).unwrap_or_else(|_| Curve::constant(0.0));
            SpectralTerm { spectrum, bands: bands.clone(), weight: ScalarTexture::Constant(1.0) }
        };
        let terms = reflectance.basis().iter().map(term).collect();
        let (roughness, single_scattering) = (self.roughness.clone(), self.single_scattering);
        (PreparedConductor { reflectance, roughness, white, single_scattering, fluoresces }, terms)
    }
}

impl PreparedConductor {
    /// The metal at a point, seen from `outgoing`.
    #[inline]
    pub(super) fn bsdf(&self, uv: Vec2, outgoing: Vec3) -> ConductorBsdf<'_> {
        let alpha = microfacet::rough(self.roughness.at(uv));
        let returned = alpha.filter(|_| !self.single_scattering);
        let lost = returned.map_or(0.0, |a| (1.0 - self.white.at(outgoing.z, a).0).max(LEAST_COSINE));
        ConductorBsdf {
            metal: &self.reflectance,
            viewer: self.reflectance.viewer(outgoing.z),
            outgoing,
            white: self.white,
            single_scattering: self.single_scattering,
            alpha,
            cosine_probability: lost.max(fluorescent_share(self.fluoresces)),
        }
    }
}

/// A metal at a point.
pub(crate) struct ConductorBsdf<'a> {
    metal: &'a ConductorReflectance,
    viewer: usize,
    outgoing: Vec3,
    white: &'a AlbedoTable,
    single_scattering: bool,
    /// `None` is a mirror.
    alpha: Option<f32>,
    /// Probability to draw from the cosine lobe instead of the specular one.
    cosine_probability: f32,
}

impl ConductorBsdf<'_> {
    /// Weight of a term of the spectrum at the angle of view.
    #[inline]
    pub(super) fn term_weight(&self, term: usize) -> f32 {
        self.metal.weights(self.viewer)[term]
    }

    /// Value for light from a direction; the delta lobe of a mirror is left out.
    #[inline]
    pub(super) fn evaluate(&self, incident: Vec3) -> BsdfValue {
        if incident.z <= 0.0 {
            return BsdfValue::default();
        }
        let Self { metal, outgoing, white, .. } = *self;
        let lambert = cosine_lobe(incident);
        let fluorescent = lambert * (1.0 - metal.largest_at(incident.z));
        let Some(alpha) = self.alpha else {
            let pdf = self.cosine_probability * lambert;
            return BsdfValue { diffuse: 0.0, fluorescent, gloss: 0.0, pdf };
        };
        // Single scattering: the reflectance at the angle to the microfacet, a V + b.
        let half = (outgoing + incident).normalize_or_zero();
        let (pdf, lobe) =
            if half.z > 0.0 { mirror_lobe(outgoing, incident, half, alpha) } else { (0.0, 0.0) };
        let (a, b) = metal.at_angle(self.viewer, outgoing.dot(half));
        // Multiple scattering between microfacets, c V + d.
        let (albedo_o, mean) = white.at(outgoing.z, alpha);
        let albedo_i = white.at(incident.z, alpha).0;
        let returned = if self.single_scattering { 0.0 } else { lambert };
        let multiple =
            returned * (1.0 - albedo_o).max(0.0) * (1.0 - albedo_i).max(0.0) / (1.0 - mean).max(1e-6);
        let (c, d) = metal.multiple(self.viewer, alpha);
        BsdfValue {
            diffuse: lobe * a + multiple * c,
            fluorescent,
            gloss: lobe * b + multiple * d,
            pdf: (1.0 - self.cosine_probability) * pdf + self.cosine_probability * lambert,
        }
    }

    /// Draws a mirrored direction or one by the cosine; `None` ends the path.
    #[inline]
    pub(super) fn sample(&self, choice: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let incident = match (choose_lobe(choice, self.cosine_probability), self.alpha) {
            (Lobe::Cosine(_), _) => warp::cosine_hemisphere(u),
            (Lobe::Specular(_), Some(alpha)) => microfacet::sample_mirrored(self.outgoing, alpha, u)?,
            (Lobe::Specular(_), None) => {
                let (a, b) = self.metal.at_angle(self.viewer, self.outgoing.z);
                let pdf = 1.0 - self.cosine_probability;
                let value = BsdfValue { diffuse: a, fluorescent: 0.0, gloss: b, pdf };
                return Some(BsdfSample::mirrored(self.outgoing, value));
            }
        };
        BsdfSample::of_density(incident, self.evaluate(incident))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scattering;
    use super::super::bsdf_tests::{assert_furnace, assert_samples_follow_density, plain_and_fluorescent};
    use super::*;

    #[test]
    fn a_viewer_sees_the_exact_reflectance() {
        // Copper-like: dark in the blue.
        let n = Curve::new(vec![200.0, 560.0, 620.0, 1200.0], vec![1.2, 1.0, 0.25, 0.25]).unwrap();
        let k = Curve::new(vec![200.0, 560.0, 620.0, 1200.0], vec![2.2, 2.6, 3.3, 5.0]).unwrap();
        let copper = Conductor { n, k, roughness: ScalarTexture::Constant(0.0), single_scattering: false };
        let grid = WavelengthGrid::uniform(400.0, 700.0, 50.0).unwrap();
        let reflectance = ConductorReflectance::new(&copper, &grid, white_microfacets());
        let (n, k) = (copper.n.bin_averages(&grid), copper.k.bin_averages(&grid));
        for cos in [0.02_f32, 0.1, 0.33, 0.77, 1.0] {
            let viewer = reflectance.viewer(cos);
            let (a, b) = reflectance.at_angle(viewer, cos);
            for (band, value) in reflectance.spectrum(viewer).iter().enumerate() {
                let exact = conductor_fresnel(cos.into(), n[band], k[band]);
                let fitted = f64::from(a * value + b);
                assert!((fitted - exact).abs() < 2e-3, "{cos} {}: {fitted} {exact}", grid.center_nm(band));
            }
        }
    }

    fn metal(k: f64, roughness: f32) -> Scattering {
        Scattering::Conductor(Conductor {
            n: Curve::constant(1e-6),
            k: Curve::constant(k),
            roughness: ScalarTexture::Constant(roughness),
            single_scattering: false,
        })
    }

    #[test]
    fn sampled_directions_follow_their_density() {
        let cases = [(0.0, 0.7), (0.2, 0.9), (0.5, 0.3), (1.0, 0.6)];
        for (roughness, cos) in cases {
            for material in plain_and_fluorescent(metal(3.0, roughness)) {
                assert_samples_follow_density(&material, true, cos, 2 * cases.len());
            }
        }
    }

    /// Samples of single scattering follow their density, and what is lost is what the tables say.
    #[test]
    fn single_scattering_loses_what_the_other_returns() {
        let once = |roughness: f32| match metal(50.0, roughness) {
            Scattering::Conductor(metal) => {
                Scattering::Conductor(Conductor { single_scattering: true, ..metal })
            }
            other => other,
        };
        for (roughness, cos) in [(0.2, 0.9), (0.5, 0.3), (1.0, 0.6)] {
            for material in plain_and_fluorescent(once(roughness)) {
                assert_samples_follow_density(&material, true, cos, 6);
            }
            let albedo = f64::from(white_microfacets().at(cos, roughness).0);
            assert_furnace(&plain_and_fluorescent(once(roughness))[0], true, cos, 0.0, albedo, 4e-3);
        }
    }

    /// Without absorption nothing is lost, smooth or rough. Tables of albedos hold to 2e-3, sums of spectra to 1e-3.
    #[test]
    fn a_metal_that_does_not_absorb_reflects_everything() {
        for roughness in [0.0, 0.1, 0.4, 1.0] {
            for cos in [0.1, 0.5, 1.0] {
                for material in plain_and_fluorescent(metal(50.0, roughness)) {
                    assert_furnace(&material, true, cos, 0.0, 1.0, 4e-3);
                }
            }
        }
    }

    #[test]
    fn a_rough_conductor_that_reflects_everything_loses_nothing() {
        let rough = white_microfacets();
        let silver = Conductor {
            n: Curve::constant(1e-6),
            k: Curve::constant(50.0),
            roughness: ScalarTexture::Constant(0.5),
            single_scattering: false,
        };
        let grid = WavelengthGrid::uniform(400.0, 700.0, 50.0).unwrap();
        let reflectance = ConductorReflectance::new(&silver, &grid, rough);
        for alpha in [0.1, 0.5, 1.0] {
            let (a, b) = reflectance.multiple(40, alpha);
            assert!((a * reflectance.spectrum(40)[0] + b - 1.0).abs() < 1e-3, "{a} {b}");
        }
        let (albedo, mean) = rough.at(0.7, 1.0);
        // Single scattering at alpha = 1 keeps less than one half.
        assert!((0.3..0.6).contains(&albedo) && (0.3..0.6).contains(&mean), "{albedo} {mean}");
        assert!(rough.at(0.7, 0.02).0 > 0.995);
    }
}
