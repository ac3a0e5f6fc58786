//! Holds the sampling of every emitter to the density that its emission reports.

use fluorspar_testkit::{chi_square_over_sphere, sidak};
use glam::{DVec3, Vec2, Vec3};

use super::{Emitter, PreparedEmitter};
use crate::geometry::{OrientedPoint, TriangleMesh};
use crate::sampling::hash_u64;

/// A point that looks up.
pub(super) const UP: OrientedPoint = OrientedPoint { position: DVec3::ZERO, normal: DVec3::Z };

/// A point off all axes.
pub(super) const EYE: Vec3 = Vec3::new(0.1, -0.2, 0.05);

pub(super) fn assert_close(got: f64, expected: f64, tolerance: f64) {
    assert!((got - expected).abs() <= tolerance * expected, "{got}, expected {expected}");
}

/// [`check_prepared`] of a light.
pub(super) fn check_density(emitter: &Emitter, position: Vec3, tests: usize) {
    check_prepared(&emitter.prepare().unwrap(), position, tests);
}

/// Draws directions toward an emitter and compares them with the density that rays report on meeting it: the two must
/// be the same function for multiple importance sampling to be unbiased. One of `tests` checks of a test.
pub(super) fn check_prepared(emitter: &PreparedEmitter, position: Vec3, tests: usize) {
    let no_triangles = |_| [Vec3::ZERO; 3];
    let intersect = |direction| {
        emitter.intersect(position, direction, f32::INFINITY).map(|distance| (distance, [Vec3::ZERO; 3]))
    };
    check(emitter, position, no_triangles, intersect, tests);
}

fn check(
    emitter: &PreparedEmitter,
    position: Vec3,
    corners: impl Fn(usize) -> [Vec3; 3],
    intersect: impl Fn(Vec3) -> Option<(f32, [Vec3; 3])>,
    tests: usize,
) {
    chi_square_over_sphere(
        10_000,
        20,
        20,
        160,
        |i| {
            let bits = hash_u64(i as u64 ^ 0x1A3B);
            let u = [bits >> 40, bits & 0xFF_FFFF].map(|bits| bits as f32 / 16_777_216.0);
            let sample = emitter.sample(position, u, 1.0, &corners)?;
            assert!(sample.pdf > 0.0 && sample.scale > 0.0 && !sample.delta, "{sample:?}");
            Some(sample.direction.as_dvec3().normalize().to_array())
        },
        |d| {
            let direction = Vec3::new(d[0] as f32, d[1] as f32, d[2] as f32);
            intersect(direction)
                .and_then(|(distance, triangle)| {
                    emitter.emission(position, direction, distance, || Some(triangle))
                })
                .map_or(0.0, |emission| f64::from(emission.density))
        },
    )
    .assert_accepted(sidak(0.01, tests));
}

#[test]
fn emissive_meshes_are_sampled_by_the_density_that_they_report() {
    let mesh = TriangleMesh {
        positions: vec![
            Vec3::new(-2.0, -1.0, -2.0),
            Vec3::new(2.0, -1.5, -2.0),
            Vec3::new(2.0, 2.0, -2.5),
            Vec3::new(-2.0, 2.0, -2.0),
        ],
        uvs: vec![Vec2::ZERO; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    };
    let triangle = |number: usize| mesh.triangles[number].map(|v| mesh.positions[v as usize]);
    // Moeller and Trumbore (1997).
    let intersect = |direction: Vec3| {
        (0..2).map(triangle).find_map(|[a, b, c]| {
            let (along, across) = (b - a, c - a);
            let p = direction.cross(across);
            let (s, inverse) = (EYE - a, 1.0 / along.dot(p));
            let q = s.cross(along);
            let (u, v, t) = (s.dot(p) * inverse, direction.dot(q) * inverse, across.dot(q) * inverse);
            (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some((t, [a, b, c]))
        })
    };
    check(&PreparedEmitter::mesh(&mesh, 0, false), EYE, triangle, intersect, 1);
}

#[test]
fn emissive_discs_are_sampled_by_the_density_that_they_report() {
    check_prepared(&PreparedEmitter::disc(Vec3::Y, Vec3::Y, 1.2, false), EYE, 1);
    check_prepared(&PreparedEmitter::disc(Vec3::Y, Vec3::NEG_Y, 1.2, true), EYE, 1);
}
