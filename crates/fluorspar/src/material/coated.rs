//! A rough dielectric coat over a diffuse base.

use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3};

use super::bsdf::{BsdfSample, BsdfValue, Lobe, SpectralTerm, choose_lobe, cosine_lobe};
use super::fresnel::dielectric_fresnel;
use super::lambertian::Lambertian;
use super::material_error::MaterialError;
use super::microfacet::{self, AlbedoTable, MIN_ROUGHNESS, TableCache, distribution, lambda};
use super::texture::ScalarTexture;
use crate::sampling::warp;

/// Least length over which a film evens out relief, m: a hundredth of a millimeter.
const LEAST_SMOOTHING_M: f32 = 1e-5;

/// A thin, clear, rough dielectric layer: saliva on mucosa, gloss of enamel.
///
/// Microfacet reflection with the GGX distribution, height-correlated Smith shadowing and unpolarized Fresnel
/// reflectance. Light that the coat does not reflect reaches the base, so no energy is lost.
#[derive(Clone, Debug, PartialEq)]
pub struct Coat {
    /// Refractive index of the layer against air, 1 to 3.
    pub refractive_index: f32,
    /// GGX roughness alpha, 0.01 (mirror-like) to 1.
    pub roughness: ScalarTexture,
    /// Length over which a liquid layer evens out the relief of a mesh below it, m ([`film_normals`](crate::geometry::film_normals)):
    /// it mirrors by its own normal, and what it mirrors into the surface is lost. 0 where it follows the relief. Of the parts of a
    /// mixture that have some, the longest counts.
    pub smoothing_m: f32,
}

/// The frame of a film of its own normal in the local frame of the surface below it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FilmFrame(Option<Mat3>);

impl FilmFrame {
    /// Of a film with a local unit normal.
    #[inline]
    pub(crate) fn new(normal: Vec3) -> Self {
        let (along, across) = warp::tangents(normal);
        Self(Some(Mat3::from_cols(along, across, normal)))
    }

    /// A local direction in the frame whose +z is the film's normal.
    #[inline]
    pub(crate) fn to_film(self, local: Vec3) -> Vec3 {
        self.0.map_or(local, |frame| {
            Vec3::new(frame.x_axis.dot(local), frame.y_axis.dot(local), frame.z_axis.dot(local))
        })
    }

    /// The other way round.
    #[inline]
    pub(crate) fn to_local(self, film: Vec3) -> Vec3 {
        self.0.map_or(film, |frame| frame * film)
    }
}

impl Coat {
    /// A coat that follows the relief below it.
    pub fn new(refractive_index: f32, roughness: ScalarTexture) -> Self {
        Self { refractive_index, roughness, smoothing_m: 0.0 }
    }

    /// Checks index and smoothing; roughnesses are clamped.
    pub(super) fn check(&self) -> Result<(), MaterialError> {
        if self.smoothing_m != 0.0 && !(LEAST_SMOOTHING_M..f32::INFINITY).contains(&self.smoothing_m) {
            return Err(MaterialError::FilmSmoothing(self.smoothing_m));
        }
        let value = self.refractive_index;
        if (1.0..=3.0).contains(&value) {
            return Ok(());
        }
        Err(MaterialError::RefractiveIndex { layer: "coat", value, range: "between 1 and 3" })
    }
}

/// A diffuse base below a coat.
#[derive(Clone, Debug, PartialEq)]
pub struct Coated {
    /// Material below the coat.
    pub base: Lambertian,
    /// The coat.
    pub coat: Coat,
}

/// Directional albedo of the coat, tabulated over cosine and roughness for one refractive index.
///
/// The base below receives `1 - E(cos)` of the light and sends it out with the same factor, normalized so that a
/// white base below any coat reflects everything (Kelemen and Szirmay-Kalos 2001):
/// `f_base = R (1 - E(i)) (1 - E(o)) / (pi (1 - E_mean))`. Fluorescence passes the coat alike, with the matrix in place
/// of `R`. Reflectance and matrix are those of all light that the coat lets in: what it throws back inside is part of them. Where
/// a film has a normal of its own, its angles are measured from that, those of the base from the normal below, and a white base
/// loses what the film mirrors into it.
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
            let leaving = dielectric_fresnel(outgoing.dot(half), refractive_index)
                * microfacet::passing(outgoing, incident, alpha);
            if incident.z <= 0.0 { 0.0 } else { leaving }
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

/// Least reflectance of a fluorescent base for the choice of lobes: it emits even where it reflects little.
const FLUORESCENT_ALBEDO: f32 = 0.25;

/// A coated material with its table.
#[derive(Debug)]
pub(super) struct PreparedCoated {
    table: Arc<CoatAlbedo>,
    roughness: ScalarTexture,
    /// Whether it is a film with a normal of its own, where its mesh has one.
    is_film: bool,
    /// Largest reflectance of any band of the base, or a stand-in for one that fluoresces, at most 1; for choosing
    /// lobes. It does not depend on concentrations, so that changing them leaves all paths as they are.
    base_albedo: f32,
}

impl Coated {
    /// Makes the table of the coat; `terms` are those of the base.
    pub(super) fn prepare(&self, terms: &[SpectralTerm], bands: usize, fluoresces: bool) -> PreparedCoated {
        let elastic =
            (0..bands).map(|band| self.base.upper_bound(|term| terms[term].bands[band])).fold(0.0, f32::max);
        let albedo = if fluoresces { elastic.max(FLUORESCENT_ALBEDO) } else { elastic };
        PreparedCoated {
            table: CoatAlbedo::shared(self.coat.refractive_index),
            roughness: self.coat.roughness.clone(),
            is_film: self.coat.smoothing_m > 0.0,
            base_albedo: albedo.min(1.0),
        }
    }
}

impl PreparedCoated {
    /// Whether the coat has a normal of its own where its mesh has a film.
    pub(super) fn is_film(&self) -> bool {
        self.is_film
    }

    /// Refractive index of the coat.
    pub(super) fn refractive_index(&self) -> f32 {
        self.table.refractive_index()
    }

    /// The material at a point, seen from `outgoing`, with a coat at least as rough as `least_alpha`.
    #[inline]
    pub(super) fn bsdf(&self, uv: Vec2, outgoing: Vec3, film: FilmFrame, least_alpha: f32) -> CoatedBsdf<'_> {
        let outgoing = film.to_film(outgoing);
        let alpha = self.roughness.at(uv).max(least_alpha).clamp(MIN_ROUGHNESS, 1.0);
        let table = &*self.table;
        let (albedo, mean) = table.at(outgoing.z, alpha);
        let pass_out = 1.0 - albedo;
        let base = pass_out * self.base_albedo;
        let coat = if base <= 0.0 { 1.0 } else { (albedo / (albedo + base)).clamp(0.1, 0.9) };
        CoatedBsdf { table, outgoing, film, alpha, pass_out, mean, cosine_probability: 1.0 - coat }
    }
}

/// A coated material at a point.
pub(crate) struct CoatedBsdf<'a> {
    table: &'a CoatAlbedo,
    /// In the frame of the film.
    outgoing: Vec3,
    film: FilmFrame,
    alpha: f32,
    /// Share of light that passes the coat on the way out, and the mean share that it reflects.
    pass_out: f32,
    mean: f32,
    /// Probability to draw from the cosine lobe instead of the coat's.
    cosine_probability: f32,
}

impl CoatedBsdf<'_> {
    /// Value for light from a direction: the coat, and the base below it (see [`CoatAlbedo`]).
    #[inline]
    pub(super) fn evaluate(&self, incident: Vec3) -> BsdfValue {
        if incident.z <= 0.0 {
            return BsdfValue::default();
        }
        let lambert = cosine_lobe(incident);
        let on_film = self.film.to_film(incident);
        let pass_in = 1.0 - self.table.at(on_film.z.max(0.0), self.alpha).0;
        let passed = lambert * pass_in * self.pass_out / (1.0 - self.mean);
        let (gloss, pdf) = lobe(self.outgoing, on_film, self.alpha, self.table.refractive_index());
        BsdfValue {
            diffuse: passed,
            fluorescent: passed,
            gloss,
            pdf: (1.0 - self.cosine_probability) * pdf + self.cosine_probability * lambert,
        }
    }

    /// About [`Self::evaluate`] over a base of some reflectance: without shadows among facets, with a coat that passes all light, and
    /// with Schlick's reflectance (1994).
    #[inline]
    pub(super) fn estimate(&self, incident: Vec3, reflectance: f32) -> f32 {
        if incident.z <= 0.0 {
            return 0.0;
        }
        let base = reflectance * cosine_lobe(incident);
        let half = self.outgoing + self.film.to_film(incident);
        let length2 = half.length_squared();
        if half.z <= 0.0 {
            return base;
        }
        // D of the half vector whatever its length, which is twice the cosine with either direction
        let a2 = self.alpha * self.alpha;
        let t = (half.x * half.x + half.y * half.y) + half.z * half.z * a2;
        let facets = a2 * length2 * length2 / (std::f32::consts::PI * t * t);
        let grazing = (1.0 - 0.5 * length2.sqrt()).max(0.0);
        let index = self.table.refractive_index();
        let normal = ((index - 1.0) / (index + 1.0)).powi(2);
        let fresnel = normal + (1.0 - normal) * grazing.powi(5);
        base + fresnel * facets / (4.0 * self.outgoing.z.max(self.alpha))
    }

    /// Draws a direction from the coat's lobe or by the cosine; `None` ends the path. A mirrored direction that points
    /// into the surface is absorbed by nothing: that light belongs to the base, whose share is computed from
    /// [`CoatAlbedo`]. Only what a leaning film mirrors into the surface is lost.
    #[inline]
    pub(super) fn sample(&self, choice: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let incident = match choose_lobe(choice, self.cosine_probability) {
            Lobe::Cosine(_) => warp::cosine_hemisphere(u),
            Lobe::Specular(_) => {
                self.film.to_local(microfacet::sample_mirrored(self.outgoing, self.alpha, u)?)
            }
        };
        BsdfSample::of_density(incident, self.evaluate(incident))
    }
}

/// BRDF of the coat times the cosine of the incident angle, 1/sr, and the density of [`microfacet::sample_mirrored`], 1/sr:
/// `G1(o) D(h) / (4 cos o)`. Directions are local and point away.
#[inline]
fn lobe(outgoing: Vec3, incident: Vec3, alpha: f32, refractive_index: f32) -> (f32, f32) {
    if outgoing.z <= 0.0 || incident.z <= 0.0 {
        return (0.0, 0.0);
    }
    let half = (outgoing + incident).normalize_or_zero();
    if half.z <= 0.0 {
        return (0.0, 0.0);
    }
    let facets = distribution(half, alpha);
    let masking = microfacet::shadowing(outgoing, incident, alpha);
    let value =
        dielectric_fresnel(outgoing.dot(half), refractive_index) * facets * masking / (4.0 * outgoing.z);
    (value, facets / ((1.0 + lambda(outgoing, alpha)) * 4.0 * outgoing.z))
}

#[cfg(test)]
mod tests {
    use super::super::Scattering;
    use std::f32::consts::PI;

    use super::super::bsdf_tests::{
        assert_furnace, assert_samples_follow_density, plain_and_fluorescent, with_bsdf,
    };
    use super::*;
    use crate::spectral::Curve;

    #[test]
    fn a_smooth_coat_has_the_fresnel_albedo() {
        let albedo = CoatAlbedo::new(1.4);
        for cos in [1.0, 0.8, 0.5] {
            let (e, _) = albedo.at(cos, MIN_ROUGHNESS);
            assert!((e - dielectric_fresnel(cos, 1.4)).abs() < 2e-3, "{cos}: {e}");
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
                    microfacet::sample_mirrored(outgoing, alpha, u)
                        .map(|d| d.normalize().as_dvec3().to_array())
                },
                |d| {
                    let incident = Vec3::new(d[0] as f32, d[1] as f32, d[2] as f32);
                    f64::from(lobe(outgoing, incident, alpha, 1.4).1)
                },
            )
            .assert_accepted(sidak(0.01, cases.len()));
        }
    }

    fn coated(reflectance: f64, roughness: f32) -> Scattering {
        let coat = Coat::new(1.4, ScalarTexture::Constant(roughness));
        Scattering::Coated(Coated { base: Lambertian::uniform(Curve::constant(reflectance)), coat })
    }

    #[test]
    fn directions_of_both_lobes_follow_their_density() {
        let cases = [(0.2, 0.9), (0.5, 0.3), (1.0, 0.6)];
        for (roughness, cos) in cases {
            for material in plain_and_fluorescent(coated(0.5, roughness)) {
                assert_samples_follow_density(&material, true, cos, 2 * cases.len());
            }
        }
    }

    /// A white base below a coat reflects everything. Tables of albedos hold to 2e-3.
    #[test]
    fn a_coat_on_a_white_base_loses_nothing() {
        for roughness in [0.05, 0.3, 1.0] {
            for cos in [0.1, 0.5, 1.0] {
                for material in plain_and_fluorescent(coated(1.0, roughness)) {
                    assert_furnace(&material, true, cos, 0.0, 1.0, 4e-3);
                }
            }
        }
    }

    /// On a black base only the coat reflects: its albedo.
    #[test]
    fn a_coat_on_a_black_base_has_its_own_albedo() {
        let albedo = CoatAlbedo::new(1.4);
        for cos in [0.1, 0.5, 1.0] {
            for material in plain_and_fluorescent(coated(0.0, 0.3)) {
                assert_furnace(&material, true, cos, 0.0, albedo.at(cos, 0.3).0.into(), 4e-3);
            }
        }
    }

    /// Through the coat fluorescence keeps its photons and has the Fresnel directions: at n = 1.4 it is 5 % brighter head-on
    /// than Lambertian light and 31 % darker at 80 degrees, `(1 - F(cos)) / (1 - 0.07681)`.
    #[test]
    fn fluorescence_leaves_through_the_coat() {
        for roughness in [MIN_ROUGHNESS, 0.3, 1.0] {
            let [_, material] = plain_and_fluorescent(coated(0.3, roughness));
            let incident = Vec3::new(0.6, 0.0, 0.8);
            let factor =
                |cos: f32| with_bsdf(&material, true, cos, |bsdf, _| bsdf.evaluate(incident).fluorescent);
            // Midpoint rule over the cosine; the tables of albedos hold to 2e-3.
            const STEPS: usize = 200;
            let cosines = (0..STEPS).map(|step| (step as f32 + 0.5) / STEPS as f32);
            let leaving: f32 = cosines.map(|cos| 2.0 * cos * factor(cos) / STEPS as f32).sum();
            let entering = incident.z * (1.0 - CoatAlbedo::shared(1.4).at(incident.z, roughness).0);
            assert!((PI * leaving / entering - 1.0).abs() < 2e-3, "{roughness}: {leaving} {entering}");
        }
        let [_, smooth] = plain_and_fluorescent(coated(0.3, MIN_ROUGHNESS));
        for cos in [1.0, 0.5, 80.0_f32.to_radians().cos()] {
            let value = with_bsdf(&smooth, true, cos, |bsdf, _| bsdf.evaluate(Vec3::Z).fluorescent);
            let shape = value * PI / (1.0 - dielectric_fresnel(1.0, 1.4));
            let expected = (1.0 - dielectric_fresnel(cos, 1.4)) / (1.0 - 0.07681);
            assert!((shape - expected).abs() < 5e-3, "{cos}: {shape}, expected {expected}");
        }
    }

    /// A film that leans against a white base loses what it mirrors into the base, and nothing else.
    #[test]
    fn a_film_with_a_normal_of_its_own_keeps_light_and_follows_its_density() {
        use super::super::bsdf_tests::{direction, grid, numbers};
        use super::super::prepared::PreparedMaterials;
        use fluorspar_testkit::{chi_square_over_sphere, sidak};
        let material = super::super::Material::new("wet", coated(1.0, 0.1));
        let materials = PreparedMaterials::new(std::slice::from_ref(&material), &grid());
        let cases = [(1.0, 0.0), (0.8, 2.0), (0.5, 4.0)];
        for (cos, azimuth) in cases {
            let film = FilmFrame::new(direction(15.0_f32.to_radians().cos(), azimuth));
            let bsdf = materials[0].bsdf(Vec2::ZERO, true, direction(cos, 0.4), film, 0.0);
            let drawn = |index: usize| {
                let (choice, u) = numbers(index);
                bsdf.sample(choice, u)
            };
            const DRAWN: usize = 100_000;
            let sums = (0..DRAWN).filter_map(drawn).map(|s| (s.value.diffuse + s.value.gloss) / s.value.pdf);
            let albedo = sums.map(f64::from).sum::<f64>() / DRAWN as f64;
            let outgoing = film.to_film(direction(cos, 0.4));
            let lost = |index: usize| {
                let incident = microfacet::sample_mirrored(outgoing, 0.1, numbers(index).1)?;
                let (value, density) = lobe(outgoing, incident, 0.1, 1.4);
                (film.to_local(incident).z <= 0.0 && density > 0.0).then_some(f64::from(value / density))
            };
            let lost = (0..DRAWN).filter_map(lost).sum::<f64>() / DRAWN as f64;
            assert!((albedo + lost - 1.0).abs() < 0.01, "{cos}: {albedo}, {lost}");
            chi_square_over_sphere(
                DRAWN,
                40,
                20,
                20,
                |index| drawn(index).map(|sample| sample.incident.normalize().as_dvec3().to_array()),
                |to| f64::from(bsdf.evaluate(Vec3::from_array(to.map(|c| c as f32))).pdf),
            )
            .assert_accepted(sidak(0.01, cases.len()));
        }
    }

    #[test]
    fn the_brdf_is_reciprocal() {
        let o = Vec3::new(0.3, 0.1, 0.8).normalize();
        let i = Vec3::new(-0.5, 0.4, 0.3).normalize();
        let forward = lobe(o, i, 0.3, 1.4).0 / i.z;
        let backward = lobe(i, o, 0.3, 1.4).0 / o.z;
        assert!((forward / backward - 1.0).abs() < 1e-4);
    }
}
