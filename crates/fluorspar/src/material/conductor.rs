//! Metals.

use std::sync::LazyLock;

use glam::Vec3;

use super::ScalarTexture;
use super::microfacet::{self, AlbedoTable};
use crate::spectral::{Curve, Reflectance, WavelengthGrid};

/// A metal surface, smooth or rough: GGX microfacets with the Fresnel reflectance of a complex refractive index.
///
/// What single scattering between rough microfacets drops comes back diffusely, tinted by repeated reflection (Kulla
/// and Conty 2017).
#[derive(Clone, Debug, PartialEq)]
pub struct Conductor {
    /// Real part n of the refractive index against air.
    pub n: Curve,
    /// Extinction coefficient k, the imaginary part.
    pub k: Curve,
    /// GGX roughness alpha, 0 to 1; below [`super::MIN_ROUGHNESS`] the surface is a mirror.
    pub roughness: ScalarTexture,
}

/// Unpolarised Fresnel reflectance of a conductor with the complex index `n + i k`; `cos` is that of the angle of
/// incidence. Born and Wolf, Principles of Optics, Sec. 14.2, in real arithmetic.
pub fn conductor_fresnel(cos: f64, n: f64, k: f64) -> f64 {
    let cos2 = (cos * cos).clamp(0.0, 1.0);
    let sin2 = 1.0 - cos2;
    let (n2, k2) = (n * n, k * k);
    let t0 = n2 - k2 - sin2;
    let a2_b2 = (t0 * t0 + 4.0 * n2 * k2).sqrt();
    let a = (0.5 * (a2_b2 + t0)).max(0.0).sqrt();
    let perpendicular = (a2_b2 - 2.0 * a * cos + cos2) / (a2_b2 + 2.0 * a * cos + cos2);
    let cross = 2.0 * a * cos * sin2;
    let parallel =
        perpendicular * (cos2 * a2_b2 + sin2 * sin2 - cross) / (cos2 * a2_b2 + sin2 * sin2 + cross);
    0.5 * (perpendicular + parallel)
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
        let n = conductor.n.on_grid::<Reflectance>(grid);
        let k = conductor.k.on_grid::<Reflectance>(grid);
        let bands = grid.len();
        let exact: Vec<Vec<f64>> = (0..COSINES)
            .map(|node| {
                let cos = node_cosine(node);
                (0..bands).map(|band| conductor_fresnel(cos, n.values()[band], k.values()[band])).collect()
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
        let tints: Vec<Vec<f64>> = (0..ROUGHNESSES)
            .map(|node| {
                let alpha = node as f32 / (ROUGHNESSES - 1) as f32;
                let albedo = f64::from(rough.at(1.0, alpha).1).min(1.0);
                mean.iter().map(|f| f * f * albedo / (1.0 - f * (1.0 - albedo))).collect()
            })
            .collect();
        let basis = orthonormal_basis(&exact);
        let weights: Vec<[f32; TERMS]> =
            exact.iter().map(|row| std::array::from_fn(|term| dot(row, &basis[term]) as f32)).collect();
        let (mut angles, mut multiple) = (Vec::new(), Vec::new());
        let (mut largest_error, mut sum_error) = (0.0_f64, 0.0);
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

/// Nodes crowd towards grazing angles.
fn node_cosine(node: usize) -> f64 {
    (node as f64 / (COSINES - 1) as f64).powi(2)
}

fn node_coordinate(cos: f32) -> f32 {
    cos.clamp(0.0, 1.0).sqrt() * (COSINES - 1) as f32
}

/// Albedo of rough microfacets that reflect everything; made on first use.
pub fn white_microfacets() -> &'static AlbedoTable {
    static TABLE: LazyLock<AlbedoTable> = LazyLock::new(|| {
        AlbedoTable::new(|outgoing, half, alpha| {
            let incident = 2.0 * outgoing.dot(half) * half - outgoing;
            if incident.z > 0.0 { microfacet::passing(outgoing, incident, alpha) } else { 0.0 }
        })
    });
    &TABLE
}

/// Density with which microfacets mirror `outgoing` into `incident`, and the same with shadowing: BRDF times cosine of
/// `incident` for a reflectance of one. 1/sr.
pub fn mirror_lobe(outgoing: Vec3, incident: Vec3, half: Vec3, alpha: f32) -> (f32, f32) {
    let pdf = microfacet::visible_normal_pdf(outgoing, half, alpha) / (4.0 * outgoing.dot(half));
    (pdf, pdf * microfacet::passing(outgoing, incident, alpha))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_conductor_without_extinction_is_a_dielectric() {
        for cos in [0.05, 0.3, 0.7, 1.0] {
            let dielectric = super::super::coat::fresnel(cos as f32, 1.5);
            assert!((conductor_fresnel(cos, 1.5, 0.0) - f64::from(dielectric)).abs() < 1e-5, "{cos}");
        }
        // Normal incidence: ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2).
        let (n, k) = (0.789, 5.85);
        let expected = ((n - 1.0_f64).powi(2) + k * k) / ((n + 1.0_f64).powi(2) + k * k);
        assert!((conductor_fresnel(1.0, n, k) - expected).abs() < 1e-12);
        assert!((conductor_fresnel(0.0, n, k) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_viewer_sees_the_exact_reflectance() {
        // Copper-like: dark in the blue.
        let n = Curve::new(vec![200.0, 560.0, 620.0, 1200.0], vec![1.2, 1.0, 0.25, 0.25]).unwrap();
        let k = Curve::new(vec![200.0, 560.0, 620.0, 1200.0], vec![2.2, 2.6, 3.3, 5.0]).unwrap();
        let copper = Conductor { n, k, roughness: ScalarTexture::Constant(0.0) };
        let grid = WavelengthGrid::uniform(400.0, 700.0, 50.0).unwrap();
        let reflectance = ConductorReflectance::new(&copper, &grid, white_microfacets());
        let (n, k) = (copper.n.on_grid::<Reflectance>(&grid), copper.k.on_grid::<Reflectance>(&grid));
        for cos in [0.02_f32, 0.1, 0.33, 0.77, 1.0] {
            let viewer = reflectance.viewer(cos);
            let (a, b) = reflectance.at_angle(viewer, cos);
            for (band, value) in reflectance.spectrum(viewer).iter().enumerate() {
                let exact = conductor_fresnel(cos.into(), n.values()[band], k.values()[band]);
                let fitted = f64::from(a * value + b);
                assert!((fitted - exact).abs() < 2e-3, "{cos} {}: {fitted} {exact}", grid.center_nm(band));
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
