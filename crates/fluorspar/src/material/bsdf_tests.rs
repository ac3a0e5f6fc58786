//! Tests that every material has to pass.

use fluorspar_testkit::{MeanEstimate, chi_square_over_sphere, sidak};
use glam::{Vec2, Vec3};

use super::prepared::{Bsdf, PreparedMaterials};
use super::{FilmFrame, FluorophoreAmount, Material, ScalarTexture, Scattering};
use crate::sampling::hash_u64;
use crate::spectral::WavelengthGrid;

/// Two bands.
pub(super) fn grid() -> WavelengthGrid {
    WavelengthGrid::uniform(500.0, 510.0, 10.0).unwrap()
}

/// A material without fluorophores, and the same with one.
pub(super) fn plain_and_fluorescent(scattering: Scattering) -> [Material; 2] {
    let plain = Material::new("thing", scattering);
    let amount = FluorophoreAmount::new(0, ScalarTexture::Constant(1.0));
    [plain.clone(), Material { fluorophores: vec![amount], ..plain }]
}

/// A direction in the local frame.
pub(super) fn direction(cos: f32, azimuth: f32) -> Vec3 {
    let sin = (1.0 - cos * cos).sqrt();
    Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
}

/// Random numbers for the choice of a lobe and for a direction.
pub(super) fn numbers(index: usize) -> (f32, [f32; 2]) {
    let (a, b) = (hash_u64(index as u64 ^ 0xD1E1), hash_u64(index as u64 ^ 0xBEEF_0000_D1E1));
    let [choice, u, v] = [b >> 40, a >> 40, a & 0xFF_FFFF].map(|bits| bits as f32 / 16_777_216.0);
    (choice, [u, v])
}

/// Calls `check` with the BSDF of a material, seen from the side and at the cosine given.
pub(super) fn with_bsdf<T>(
    material: &Material,
    front: bool,
    cos: f32,
    check: impl FnOnce(&Bsdf<'_>, f64) -> T,
) -> T {
    let materials = PreparedMaterials::new(std::slice::from_ref(material), &grid());
    let prepared = &materials[0];
    let uv = Vec2::new(0.3, 0.7);
    let bsdf = prepared.bsdf(uv, front, direction(cos, 0.4), FilmFrame::default(), 0.0);
    let mut spectrum = 0.0;
    prepared.term_weights(uv, &bsdf, |index, weight| {
        spectrum += f64::from(weight) * f64::from(prepared.terms[index].bands[0]);
    });
    check(&bsdf, spectrum)
}

/// Chi-square test over the sphere: directions that are sampled follow the density that `evaluate` reports; delta lobes
/// are left out on either side. `tests` is how many such tests share the significance of 1 %.
pub(super) fn assert_samples_follow_density(material: &Material, front: bool, cos: f32, tests: usize) {
    let result = with_bsdf(material, front, cos, |bsdf, _| {
        chi_square_over_sphere(
            100_000,
            40,
            20,
            20,
            |index| {
                let (choice, u) = numbers(index);
                let sample = bsdf.sample(choice, u).filter(|sample| !sample.delta)?;
                Some(sample.incident.normalize().as_dvec3().to_array())
            },
            |direction| {
                let [x, y, z] = direction.map(|x| x as f32);
                f64::from(bsdf.evaluate(Vec3::new(x, y, z)).pdf)
            },
        )
    });
    assert!(result.p_value >= sidak(0.01, tests), "{:?} {front} {cos}: {result:?}", material.scattering);
}

/// Furnace: radiance toward the viewer in surroundings of radiance 1 in front and of `behind` on the other side,
/// estimated by samples, delta lobes included.
pub(super) fn furnace(material: &Material, front: bool, cos: f32, behind: f64) -> MeanEstimate {
    const SAMPLES: usize = 20_000;
    with_bsdf(material, front, cos, |bsdf, spectrum| {
        let values: Vec<f64> = (0..SAMPLES)
            .map(|index| {
                let (choice, u) = numbers(index);
                bsdf.sample(choice, u).map_or(0.0, |sample| {
                    let value = sample.value;
                    let around = if sample.incident.z > 0.0 { 1.0 } else { behind };
                    let elastic = f64::from(value.diffuse) * spectrum + f64::from(value.gloss);
                    around * elastic / f64::from(value.pdf)
                })
            })
            .collect();
        MeanEstimate::of(&values)
    })
}

/// Asserts the radiance of a [`furnace`] within four standard errors and `tolerance`.
pub(super) fn assert_furnace(
    material: &Material,
    front: bool,
    cos: f32,
    behind: f64,
    expected: f64,
    tolerance: f64,
) {
    let radiance = furnace(material, front, cos, behind);
    assert!(
        (radiance.mean - expected).abs() < tolerance + 4.0 * radiance.standard_error,
        "{:?} {front} {cos}: {radiance:?}, expected {expected}",
        material.scattering
    );
}
