//! A rough dielectric coat over a diffuse base.

use std::sync::Arc;

use glam::Vec3;

use super::ScalarTexture;
use super::microfacet::{self, AlbedoTable, TableCache, distribution, lambda};

/// A thin, clear, rough dielectric layer: saliva on mucosa, gloss of enamel.
///
/// Microfacet reflection with the GGX distribution, height-correlated Smith shadowing and unpolarised Fresnel
/// reflectance. Light that the coat does not reflect reaches the base, so no energy is lost.
#[derive(Clone, Debug, PartialEq)]
pub struct Coat {
    /// Refractive index of the layer against air, 1 to 3.
    pub refractive_index: f32,
    /// GGX roughness alpha, 0.01 (mirror-like) to 1.
    pub roughness: ScalarTexture,
}

/// A direction drawn from the coat's lobe, in the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoatSample {
    /// Direction of the arriving light, away from the surface.
    pub incident: Vec3,
}

/// Unpolarised Fresnel reflectance of a smooth dielectric seen from outside; `cos` is that of the angle of incidence.
#[inline]
pub fn fresnel(cos: f32, refractive_index: f32) -> f32 {
    let cos = cos.clamp(0.0, 1.0);
    let sin2_t = (1.0 - cos * cos) / (refractive_index * refractive_index);
    let cos_t = (1.0 - sin2_t).max(0.0).sqrt();
    let parallel = (refractive_index * cos - cos_t) / (refractive_index * cos + cos_t);
    let perpendicular = (cos - refractive_index * cos_t) / (cos + refractive_index * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Draws an incident direction by the visible normals of the GGX distribution.
/// `None` when the mirrored direction points into the surface: that light is absorbed by no one, it belongs to
/// the base, whose share is computed from [`CoatAlbedo`].
pub fn sample(outgoing: Vec3, alpha: f32, u: [f32; 2]) -> Option<CoatSample> {
    let half = microfacet::sample_visible_normal(outgoing, alpha, u);
    let incident = 2.0 * outgoing.dot(half) * half - outgoing;
    (incident.z > 0.0).then_some(CoatSample { incident })
}

/// BRDF of the coat times the cosine of the incident angle, 1/sr, and the density of [`sample`], 1/sr:
/// `G1(o) D(h) / (4 cos o)`. Directions are local and point away.
#[inline]
pub fn eval_and_pdf(outgoing: Vec3, incident: Vec3, alpha: f32, refractive_index: f32) -> (f32, f32) {
    if outgoing.z <= 0.0 || incident.z <= 0.0 {
        return (0.0, 0.0);
    }
    let half = (outgoing + incident).normalize_or_zero();
    if half.z <= 0.0 {
        return (0.0, 0.0);
    }
    let facets = distribution(half, alpha);
    let masking = microfacet::shadowing(outgoing, incident, alpha);
    let value = fresnel(outgoing.dot(half), refractive_index) * facets * masking / (4.0 * outgoing.z);
    (value, facets / ((1.0 + lambda(outgoing, alpha)) * 4.0 * outgoing.z))
}

/// Directional albedo of the coat, tabulated over cosine and roughness for one refractive index.
///
/// The base below receives `1 - E(cos)` of the light and sends it out with the same factor, normalised so that a
/// white base below any coat reflects everything (Kelemen and Szirmay-Kalos 2001):
/// `f_base = R (1 - E(i)) (1 - E(o)) / (pi (1 - E_mean))`.
#[derive(Clone, Debug, PartialEq)]
pub struct CoatAlbedo {
    refractive_index: f32,
    table: AlbedoTable,
}

impl CoatAlbedo {
    /// Integrates the coat's reflection numerically; deterministic.
    pub fn new(refractive_index: f32) -> Self {
        // f cos / pdf = F G2 / G1.
        let table = AlbedoTable::new(|outgoing, half, alpha| {
            let incident = 2.0 * outgoing.dot(half) * half - outgoing;
            if incident.z <= 0.0 {
                return 0.0;
            }
            fresnel(outgoing.dot(half), refractive_index) * microfacet::passing(outgoing, incident, alpha)
        });
        Self { refractive_index, table }
    }

    /// The table of a refractive index, shared by all scenes.
    pub fn shared(refractive_index: f32) -> Arc<Self> {
        static TABLES: TableCache<CoatAlbedo> = TableCache::new();
        TABLES.get(refractive_index, Self::new)
    }

    /// The refractive index of the table.
    pub fn refractive_index(&self) -> f32 {
        self.refractive_index
    }

    /// Directional albedo `E(cos)` and its cosine-weighted mean for a roughness.
    #[inline]
    pub fn at(&self, cos: f32, alpha: f32) -> (f32, f32) {
        self.table.at(cos, alpha)
    }
}

#[cfg(test)]
mod tests {
    use super::super::MIN_ROUGHNESS;
    use super::*;

    #[test]
    fn fresnel_matches_textbook_values() {
        assert!((fresnel(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!((fresnel(1.0, 1.40) - 0.027_78).abs() < 1e-5);
        assert!((fresnel(0.0, 1.5) - 1.0).abs() < 1e-6);
        // Brewster's angle: only one polarisation is reflected.
        let brewster = 1.5_f32.atan();
        let reflected = 0.5 * (2.0 * brewster - std::f32::consts::FRAC_PI_2).sin().powi(2);
        assert!((fresnel(brewster.cos(), 1.5) - reflected).abs() < 1e-5);
    }

    #[test]
    fn a_smooth_coat_has_the_fresnel_albedo() {
        let albedo = CoatAlbedo::new(1.4);
        for cos in [1.0, 0.8, 0.5] {
            let (e, _) = albedo.at(cos, MIN_ROUGHNESS);
            assert!((e - fresnel(cos, 1.4)).abs() < 2e-3, "{cos}: {e}");
        }
        // Diffuse mean of the external Fresnel reflectance at n = 1.40 is 0.07681.
        assert!(
            (albedo.at(1.0, MIN_ROUGHNESS).1 - 0.0768).abs() < 2e-3,
            "{}",
            albedo.at(1.0, MIN_ROUGHNESS).1
        );
    }

    #[test]
    fn sampled_directions_follow_their_density() {
        use fluorspar_testkit::{chi_square_over_sphere, sidak};
        let cases = [(0.2, 0.9), (0.5, 0.3), (1.0, 0.6), (0.35, 0.1)];
        for (alpha, cos) in cases {
            let outgoing = Vec3::new((1.0_f32 - cos * cos).sqrt(), 0.0, cos);
            chi_square_over_sphere(
                200_000,
                40,
                20,
                16,
                |i| {
                    let bits = crate::sampling::hash_u64(i as u64 ^ 0xC0A7);
                    let u = [(bits >> 40) as f32, (bits & 0xFF_FFFF) as f32].map(|b| b / 16_777_216.0);
                    sample(outgoing, alpha, u).map(|s| s.incident.normalize().as_dvec3().to_array())
                },
                |d| {
                    let incident = Vec3::new(d[0] as f32, d[1] as f32, d[2] as f32);
                    f64::from(eval_and_pdf(outgoing, incident, alpha, 1.4).1)
                },
            )
            .assert_accepted(sidak(0.01, cases.len()));
        }
    }

    #[test]
    fn the_brdf_is_reciprocal() {
        let o = Vec3::new(0.3, 0.1, 0.8).normalize();
        let i = Vec3::new(-0.5, 0.4, 0.3).normalize();
        let forward = eval_and_pdf(o, i, 0.3, 1.4).0 / i.z;
        let backward = eval_and_pdf(i, o, 0.3, 1.4).0 / o.z;
        assert!((forward / backward - 1.0).abs() < 1e-4);
    }
}
