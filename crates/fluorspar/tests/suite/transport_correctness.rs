//! Light transport with every light and material against closed forms, conservation laws and brute force.
//!
//! The tests that are ignored by default are the same ones with more samples and all combinations:
//! `cargo test -p fluorspar --test transport_correctness -- --ignored`.
#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;
use std::sync::Arc;

use fluorspar::geometry::{MeshInstance, MeshInstances, TriangleMesh};
use fluorspar::light::{
    DiscEmitter, DistantEmitter, Emitter, EnvironmentLayer, EnvironmentMap, Light, LightGroup, PointEmitter,
    PointPattern, RectangleEmitter, SphereEmitter,
};
use fluorspar::material::fresnel::conductor_fresnel;
use fluorspar::material::{Coat, Lambertian, Material, ScalarTexture};
use fluorspar::render::RenderSettings;
use fluorspar::scene::{Object, Scene, SceneError, Shape, SurfaceEmission};
use fluorspar::spectral::{Curve, Fluorophore, PhotonEem, SeparableTerm, Stokes, WavelengthGrid};
use fluorspar_testkit::{MeanEstimate, sidak, z_limit, z_score};
use glam::{Affine3, Vec3};

use crate::support::*;

fn three_bands() -> WavelengthGrid {
    WavelengthGrid::uniform(450.0, 650.0, 100.0).unwrap()
}

/// Surroundings of radiance 1, as such and as a map that lights are drawn from.
fn white_skies() -> [Emitter; 2] {
    let layer = EnvironmentLayer { spectrum: flat(1.0), factors: vec![1.0; 8 * 4] };
    let map = EnvironmentMap::new(8, 4, vec![layer], 0.0).unwrap();
    [Emitter::Environment, Emitter::EnvironmentMap(Arc::new(map))]
}

/// A ball of a material in the middle of white surroundings.
fn furnace(materials: Vec<Material>, sky: Emitter) -> Scene {
    let mut scene = scene(three_bands(), camera(Vec3::new(0.0, 0.4, 3.0), Vec3::ZERO, 36.0, 16));
    scene.materials = materials;
    let last = scene.materials.len() - 1;
    scene.objects.push(object("ball", Shape::Sphere { center: Vec3::ZERO, radius_m: 0.9 }, last));
    scene.lights.push(light(flat(1.0), sky));
    scene
}

/// A thing that loses no light can't be seen in surroundings of even radiance: energy and reciprocity at once.
#[test]
fn a_lossless_ball_in_white_surroundings_is_invisible() {
    let white = || Material::lambertian("white", flat(1.0));
    let mirror = |roughness| metal(flat(1e-6), flat(60.0), roughness);
    let half = ScalarTexture::Checker { columns: 4, rows: 3, low: 0.3, high: 0.8 };
    let cases: Vec<(&str, Vec<Material>)> = vec![
        ("lambertian", vec![white()]),
        ("coated", vec![coated(1.0, 0.3)]),
        ("smooth glass", vec![glass(1.5, 0.0, 1.0)]),
        ("glass of roughness 0.1", vec![glass(1.5, 0.1, 1.0)]),
        ("glass of roughness 0.5", vec![glass(1.33, 0.5, 1.0)]),
        ("glass of roughness 1", vec![glass(1.8, 1.0, 1.0)]),
        ("mirror", vec![mirror(0.0)]),
        ("metal of roughness 0.3", vec![mirror(0.3)]),
        ("metal of roughness 1", vec![mirror(1.0)]),
        ("mixed", vec![white(), mirror(0.2), mixed(0, 1, half.clone())]),
        ("two-sided", vec![white(), mirror(0.2), two_sided(0, 1)]),
        ("with holes", vec![Material { opacity: Some(half), ..white() }]),
    ];
    for (name, materials) in cases {
        for sky in white_skies() {
            let image = run(&furnace(materials.clone(), sky), &settings(256, 60));
            let mean = band_mean(&image, 0, 1);
            // Tables of albedos hold to 2e-3 per passage; paths through rough glass cross the surface some three times.
            let tolerance = 6e-3 + 4.0 * mean.standard_error;
            assert!((mean.mean - 1.0).abs() < tolerance, "{name}: {mean:?}");
            assert!(mean.standard_error < 6e-3, "{name}: {mean:?}");
        }
    }
}

/// Within a mirroring ball that emits `Le`, a ray keeps its angle from bounce to bounce: `L = Le / (1 - F(angle))`.
#[test]
fn a_bright_mirrored_cavity_has_the_radiance_of_its_angle() {
    let (n, k) = (flat(1.9), Curve::new(vec![200.0, 1200.0], vec![1.5, 5.5]).unwrap());
    for (sine, position) in [(0.0, Vec3::new(0.0, 0.0, 0.001)), (0.6, Vec3::new(0.6, 0.0, 0.0))] {
        // The line of sight passes the center at a distance of `sine`.
        let grid = WavelengthGrid::uniform(400.0, 700.0, 50.0).unwrap();
        let mut cavity = scene(grid, camera(position, position - Vec3::Z, 0.5, 4));
        cavity.materials = vec![metal(n.clone(), k.clone(), 0.0)];
        let mut wall = object("wall", Shape::Sphere { center: Vec3::ZERO, radius_m: 1.0 }, 0);
        wall.emission = Some(SurfaceEmission { group: 0, radiance: flat(2.0), is_one_sided: false });
        cavity.objects.push(wall);
        let image = run(&cavity, &settings(512, 400));
        let cos = (1.0_f64 - sine * sine).sqrt();
        for band in 0..image.grid.len() {
            let nm = image.grid.center_nm(band);
            let expected = 2.0 / (1.0 - conductor_fresnel(cos, 1.9, k.at(nm)));
            let mean = band_mean(&image, 0, band);
            // The reflectance is kept to 2e-3, which many reflections multiply by 1 / (1 - F).
            let bias = 1e-3 * expected * expected / 2.0;
            let z = z_score(mean, expected, bias);
            assert!(z < z_limit(sidak(1e-3, 14)), "{sine} {nm} nm: {mean:?}, expected {expected}");
        }
    }
}

/// The integrating sphere, bounce by bounce: with `E0` from a light in the middle, exitances
/// `r <- R r`, `phi_j <- R phi_j + F_j r`, `m <- R m + sum F (phi + m)`, summed and divided by pi.
#[test]
fn an_integrating_sphere_follows_its_series() {
    let grid = WavelengthGrid::uniform(360.0, 680.0, 20.0).unwrap();
    let (reflectance, power) = (0.7, 3.0);
    let dyes = [dye("a", 380.0, 450.0, 0.2), dye("b", 450.0, 560.0, 0.15)];
    let amounts = [(0, 0.5_f32), (1, 0.8)];
    let n = grid.len();
    // F by quadrature, 20 points per bin and axis.
    let matrix = |index: usize, amount: f64| -> Vec<f64> {
        const FINE: usize = 20;
        let node =
            |bin: usize, i: usize| grid.edges_nm()[bin] + grid.width_nm(bin) * (i as f64 + 0.5) / FINE as f64;
        let mut entries = vec![0.0; n * n];
        for (entry, value) in entries.iter_mut().enumerate() {
            let (o, i) = (entry / n, entry % n);
            for a in 0..FINE * FINE {
                let (lo, li) = (node(o, a / FINE), node(i, a % FINE));
                let same = if o == i && lo == li { 0.5 } else { 1.0 };
                let density = if lo >= li { dyes[index].eem.unmasked(lo, li) } else { 0.0 };
                *value += same * density * li / lo;
            }
            *value *= amount * grid.width_nm(i) / (FINE * FINE) as f64;
        }
        entries
    };
    let matrices: Vec<Vec<f64>> = amounts.iter().map(|&(d, c)| matrix(d, f64::from(c))).collect();
    let apply = |m: &[f64], v: &[f64]| -> Vec<f64> {
        (0..n).map(|o| (0..n).map(|i| m[o * n + i] * v[i]).sum()).collect()
    };
    let mut sphere = scene(grid.clone(), camera(Vec3::new(0.3, -0.2, 0.1), Vec3::X, 80.0, 12));
    sphere.fluorophores = dyes.to_vec();
    sphere.materials = vec![with_dyes(Material::lambertian("wall", flat(reflectance)), &amounts)];
    sphere.objects.push(object("wall", Shape::Sphere { center: Vec3::ZERO, radius_m: 1.0 }, 0));
    sphere.lights.push(light(
        flat(power),
        Emitter::Point(PointEmitter { position: Vec3::ZERO, pattern: PointPattern::Even }),
    ));

    let arriving = vec![power / (4.0 * PI); n];
    let mut kinds = [arriving, vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    let mut sums = vec![vec![0.0; n]; 4];
    for depth in 1..=5_u32 {
        let [r, a, b, m] = &kinds;
        let scaled = |v: &[f64]| v.iter().map(|x| reflectance * x).collect::<Vec<_>>();
        let add = |mut x: Vec<f64>, y: Vec<f64>| {
            x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
            x
        };
        let fluoresced: Vec<f64> = (0..n).map(|i| a[i] + b[i] + m[i]).collect();
        kinds = [
            scaled(r),
            add(scaled(a), apply(&matrices[0], r)),
            add(scaled(b), apply(&matrices[1], r)),
            add(add(scaled(m), apply(&matrices[0], &fluoresced)), apply(&matrices[1], &fluoresced)),
        ];
        for (sum, kind) in sums.iter_mut().zip(&kinds) {
            sum.iter_mut().zip(kind).for_each(|(sum, value)| *sum += value / PI);
        }
        let image = run(&sphere, &settings(64, depth));
        for (component, sums) in sums.iter().enumerate() {
            let peak = sums.iter().copied().fold(0.0, f64::max);
            for (band, expected) in sums.iter().enumerate() {
                let mean = band_mean(&image, component, band);
                // Bins of 20 nm are integrated with 8 points by the renderer: 1e-3 of the peak on the diagonal.
                let z = z_score(mean, *expected, 2e-3 * peak.max(1e-9));
                assert!(
                    z < z_limit(sidak(1e-3, 5 * 4 * n)),
                    "depth {depth}, component {component}, band {band}: {mean:?}, expected {expected}"
                );
            }
        }
    }
}

/// A plane that the light reaches only by way of a wall: the fluorescence of the plane against what it reflects is
/// `F s / (R s)`, as in direct light, and does not depend on the way the light came.
#[test]
fn indirect_light_excites_as_direct_light_does() {
    let grid = WavelengthGrid::uniform(360.0, 680.0, 20.0).unwrap();
    let photons = |image: &fluorspar::image::ComponentImage, component: usize| -> MeanEstimate {
        let bands = image.grid.len();
        let values: Vec<f64> = image
            .stored(component)
            .chunks_exact(bands)
            .map(|pixel| {
                (0..bands)
                    .map(|b| f64::from(pixel[b]) * image.grid.center_nm(b) * image.grid.width_nm(b))
                    .sum()
            })
            .collect();
        MeanEstimate::of(&values)
    };
    let plane = |reflectance: f64, indirect: bool| -> (MeanEstimate, MeanEstimate) {
        let mut scene = scene(grid.clone(), camera(Vec3::new(0.0, 0.5, 1.5), Vec3::ZERO, 10.0, 24));
        scene.fluorophores = vec![dye("d", 390.0, 520.0, 0.3)];
        scene.materials = vec![
            with_dyes(Material::lambertian("plane", flat(reflectance)), &[(0, 1.0)]),
            Material::lambertian("wall", flat(0.8)),
        ];
        scene.objects = vec![
            object("plane", quad(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y), 0),
            object("wall", quad(Vec3::new(-1.0, -1.0, 2.0), Vec3::Y * 2.0, Vec3::X * 2.0), 1),
        ];
        // Parallel light that falls on the wall alone, or on the plane alone, past the other one's edges.
        let direction = if indirect { Vec3::Z } else { Vec3::new(0.0, 0.8, -0.6) };
        if indirect {
            // From behind, through the plane's own shadow: the plane faces the wall and shades its middle.
            scene.objects.push(object("back", quad(Vec3::new(-0.5, -0.5, -0.01), Vec3::X, Vec3::Y), 1));
        } else {
            scene.objects.truncate(1);
        }
        scene.lights.push(light(gaussian(385.0, 8.0, 1.0), Emitter::Distant(DistantEmitter { direction })));
        let image = run(&scene, &settings(256, 2));
        (photons(&image, 0), photons(&image, 1))
    };
    let ratio = |(elastic, fluorescent): (MeanEstimate, MeanEstimate)| {
        let value = fluorescent.mean / elastic.mean;
        let relative =
            (elastic.standard_error / elastic.mean).hypot(fluorescent.standard_error / fluorescent.mean);
        (value, value * relative)
    };
    let (direct, _) = ratio(plane(0.4, false));
    let (indirect, error) = ratio(plane(0.4, true));
    // Both parts ride on the same paths, so their errors nearly cancel: the sum of squares is generous.
    assert!((indirect / direct - 1.0).abs() < 2e-3 + 4.0 * error / direct, "{indirect} {direct} +- {error}");
    let (dark, bright) = (plane(0.0, true), plane(0.4, true));
    assert_eq!(dark.0.mean, 0.0);
    assert!(
        (dark.1.mean / bright.1.mean - 1.0).abs() < 1e-3 + 4.0 * bright.1.standard_error / bright.1.mean,
        "{dark:?} {bright:?}"
    );
}

/// A Lambertian plate of reflectance 0.5 that faces +z, seen from close by: from below all lights.
fn plate() -> Scene {
    let mut scene = scene(three_bands(), camera(Vec3::new(0.03, -0.02, 0.01), Vec3::ZERO, 0.01, 8));
    scene.materials.push(Material::lambertian("plate", flat(0.5)));
    scene.objects.push(object("plate", quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), 0));
    scene
}

/// Irradiance at the origin on a plane that faces +z, from the radiance of the plate there.
fn irradiance(emitter: Emitter, spectrum: f64, samples: u32) -> MeanEstimate {
    let mut scene = plate();
    scene.lights.push(light(flat(spectrum), emitter));
    let mean = band_mean(&run(&scene, &settings(samples, 1)), 0, 1);
    MeanEstimate { mean: mean.mean * PI / 0.5, standard_error: mean.standard_error * PI / 0.5 }
}

/// Form factors from a point to lights of every shape (J. R. Howell, A catalog of radiation heat transfer
/// configuration factors), and the noise that sampling by solid angle leaves.
#[test]
fn lights_illuminate_by_their_form_factors() {
    let check = |name: &str, emitter: Emitter, power: f64, expected: f64, largest_error: f64| {
        let mean = irradiance(emitter, power, 256);
        let tolerance = 4.0 * mean.standard_error + 3e-4 * expected;
        assert!((mean.mean - expected).abs() < tolerance, "{name}: {mean:?}, expected {expected}");
        assert!(mean.standard_error < largest_error * expected, "{name}: {mean:?}");
    };
    // Disc parallel to the plane, its axis at a distance a: F = (1 - (h^2 + a^2 - r^2) / sqrt(...)) / 2.
    for (r, h, a) in [(0.3, 0.5, 0.0), (0.3, 0.5, 0.9), (0.5, 0.05, 0.1), (1e-4, 1.0, 0.5), (0.4, 0.02, 0.7)]
    {
        let z: f64 = h * h + a * a + r * r;
        let factor = 0.5 * (1.0 - (h * h + a * a - r * r) / (z * z - 4.0 * r * r * a * a).sqrt());
        let disc = Emitter::Disc(DiscEmitter {
            center: Vec3::new(0.0, a as f32, h as f32),
            normal: Vec3::NEG_Z,
            radius_m: r as f32,
            exponent: 1.0,
        });
        check(&format!("disc {r} {h} {a}"), disc, 2.0, 2.0 / (PI * r * r) * factor, 2e-3);
    }
    // Sphere above the horizon: E = M (r / d)^2 cos; its exitance is P / (4 pi r^2). Light from anywhere on it falls at
    // an angle of at most r / d from its center's, and E is all that is drawn from: small spheres leave no noise.
    for (r, center) in [(0.3, Vec3::new(0.2, 0.4, 0.8)), (1e-4, Vec3::new(0.0, 0.6, 0.8))] {
        let (d2, cos) = (f64::from(center.length_squared()), f64::from(center.z / center.length()));
        let expected = 2.0 / (4.0 * PI * d2) * cos;
        check("sphere", Emitter::Sphere(SphereEmitter { center, radius_m: r }), 2.0, expected, 2e-3);
    }
    for decade in 1..=5 {
        let ratio = 10.0_f64.powi(-decade);
        let center = Vec3::new(0.0, 0.6, 0.8);
        let sphere = Emitter::Sphere(SphereEmitter { center, radius_m: ratio as f32 });
        let expected = 2.0 / (4.0 * PI) * 0.8;
        check(&format!("sphere of r / d = {ratio}"), sphere, 2.0, expected, 2e-2 * ratio + 1e-6);
    }
    // Rectangle parallel to the plane with a corner above the point, and one seen from beside.
    let corner = |a: f64, b: f64, h: f64| {
        let (x, y) = (a / h, b / h);
        let (p, q) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        (x / p * (y / p).atan() + y / q * (x / q).atan()) / (2.0 * PI)
    };
    for (a, b, h) in [(0.5, 0.8, 0.4), (2.0, 3.0, 0.05), (1e-3, 2e-3, 1.0)] {
        let rectangle = Emitter::Rectangle(RectangleEmitter {
            corner: Vec3::new(0.0, 0.0, h as f32),
            edge_u: Vec3::Y * b as f32,
            edge_v: Vec3::X * a as f32,
            exponent: 1.0,
        });
        check(&format!("rectangle {a} {b} {h}"), rectangle, 3.0, 3.0 / (a * b) * corner(a, b, h), 4e-3);
    }
    let beside = Emitter::Rectangle(RectangleEmitter {
        corner: Vec3::new(0.3, 0.0, 0.6),
        edge_u: Vec3::Y * 0.5,
        edge_v: Vec3::X * 0.4,
        exponent: 1.0,
    });
    let factor = corner(0.7, 0.5, 0.6) - corner(0.3, 0.5, 0.6);
    check("rectangle beside", beside, 1.0, factor / (0.4 * 0.5), 2e-3);
    // A small light with a pattern cos^g: I = (g + 1) P / (2 pi) cos^g.
    for g in [1.0, 3.0, 40.0] {
        let (height, tilt) = (2.0_f32, 0.3_f32);
        let normal = Vec3::new(tilt.sin(), 0.0, -tilt.cos());
        let intensity = (g + 1.0) / (2.0 * PI) * f64::from(tilt.cos()).powf(g);
        let center = Vec3::Z * height;
        let disc = Emitter::Disc(DiscEmitter { center, normal, radius_m: 1e-3, exponent: g as f32 });
        check(&format!("pattern {g}"), disc, 1.0, intensity / 4.0, 2e-3);
        let point = Emitter::Point(PointEmitter {
            position: center,
            pattern: PointPattern::Lobe { axis: normal, exponent: g as f32 },
        });
        check(&format!("point {g}"), point, 1.0, intensity / 4.0, 1e-4);
    }
}

/// An object of radiance L: `E = pi L (r / d)^2 cos`.
#[test]
fn bright_balls_illuminate_by_their_form_factors() {
    for decade in 1..=5 {
        let ratio = 10.0_f64.powi(-decade);
        let mut scene = plate();
        let shape = Shape::Sphere { center: Vec3::new(0.0, 0.6, 0.8), radius_m: ratio as f32 };
        let emission =
            Some(SurfaceEmission { group: 0, radiance: flat(2.0 / (ratio * ratio)), is_one_sided: false });
        scene.objects.push(Object { emission, ..object("ball", shape, 0) });
        let mean = band_mean(&run(&scene, &settings(256, 1)), 0, 1);
        let expected = 0.5 * 2.0 * 0.8;
        let tolerance = 4.0 * mean.standard_error + 3e-4 * expected;
        assert!((mean.mean - expected).abs() < tolerance, "r / d = {ratio}: {mean:?}, expected {expected}");
    }
}

/// A point light (W/nm) and a wall that shines (W/(sr m² nm)) share a light group: in a closed sphere they mix evenly
/// everywhere, so one group gives the fluorescence of two, though bins are far wider than the lights' lines and excitation
/// changes fivefold within a bin. Weights by plain sums of spectra, whose units differ, would be off by tens of percent.
#[test]
fn lights_of_different_kinds_share_a_group() {
    let radius = 0.05_f32;
    let cavity = |groups: usize| -> MeanEstimate {
        let grid = WavelengthGrid::uniform(360.0, 680.0, 40.0).unwrap();
        let mut scene = scene(grid, camera(Vec3::new(0.01, -0.005, 0.003), Vec3::X, 80.0, 24));
        let term = SeparableTerm {
            excitation: Curve::new(vec![200.0, 365.0, 395.0, 396.0, 1000.0], vec![0.0, 0.05, 0.35, 0.0, 0.0])
                .unwrap(),
            emission: gaussian(560.0, 20.0, 1.0 / (20.0 * (2.0 * PI).sqrt())),
        };
        scene.fluorophores = vec![Fluorophore {
            eem: PhotonEem::separable(vec![term], Stokes::Mask),
            ..dye("steep", 380.0, 560.0, 0.1)
        }];
        scene.light_groups = (0..groups).map(|i| LightGroup { name: format!("light {i}") }).collect();
        scene.materials = vec![with_dyes(Material::lambertian("wall", flat(0.6)), &[(0, 1.0)])];
        let mut wall = object("wall", Shape::Sphere { center: Vec3::ZERO, radius_m: radius }, 0);
        wall.emission =
            Some(SurfaceEmission { group: 0, radiance: gaussian(367.0, 0.8, 1.0), is_one_sided: false });
        scene.objects.push(wall);
        // As much irradiance as from the wall: P / (4 pi r^2) = pi L.
        let power = 4.0 * PI * PI * f64::from(radius).powi(2);
        let point = Emitter::Point(PointEmitter { position: Vec3::ZERO, pattern: PointPattern::Even });
        scene.lights.push(Light { group: groups - 1, ..light(gaussian(393.0, 0.8, power), point) });
        let image = run(&scene, &settings(64, 12));
        let bands = image.grid.len();
        let pixels = 24 * 24;
        let per_pixel: Vec<f64> = (0..pixels)
            .map(|pixel| {
                (0..image.components.len())
                    .filter(|&c| image.components[c].label().contains("steep"))
                    .flat_map(|c| &image.stored(c)[pixel * bands..(pixel + 1) * bands])
                    .map(|&v| f64::from(v))
                    .sum()
            })
            .collect();
        MeanEstimate::of(&per_pixel)
    };
    let (one, two) = (cavity(1), cavity(2));
    let error = one.standard_error.hypot(two.standard_error);
    // The weights within a bin are sampled at eight points of 5 nm: the same for one group and two.
    let tolerance = 5e-3 * two.mean + 4.0 * error;
    assert!((one.mean - two.mean).abs() < tolerance, "{one:?} {two:?}");
    assert!(error < 5e-3 * two.mean, "{one:?} {two:?}");
}

/// One row of a map at an angle from the zenith of the plate: `E = pi L (sin^2 lower - sin^2 upper)`.
#[test]
fn a_map_illuminates_by_its_rows() {
    for row in 0..4 {
        let mut factors = vec![0.0; 8 * 10];
        factors[8 * row..8 * (row + 1)].fill(3.0);
        let map = EnvironmentMap::new(8, 10, vec![EnvironmentLayer { spectrum: flat(1.0), factors }], 10.0)
            .unwrap();
        let mut scene = scene(three_bands(), camera(Vec3::new(0.1, 0.5, 0.1), Vec3::ZERO, 0.01, 8));
        scene.materials.push(Material::lambertian("plate", flat(0.5)));
        scene.objects.push(object(
            "plate",
            quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0),
            0,
        ));
        scene.lights.push(light(flat(0.5), Emitter::EnvironmentMap(Arc::new(map))));
        let mean = band_mean(&run(&scene, &settings(256, 1)), 0, 0);
        let sine2 = |edge: usize| (PI * edge as f64 / 10.0).sin().powi(2);
        let expected = 0.5 * 1.5 * (sine2(row + 1) - sine2(row));
        let tolerance = 4.0 * mean.standard_error + 3e-4 * expected;
        assert!((mean.mean - expected).abs() < tolerance, "row {row}: {mean:?}, expected {expected}");
    }
}

/// Reciprocity: light from plate A to plate B is light from B to A, whatever lies between.
fn assert_reciprocal(samples: u32, runs: u64) {
    let (a, b) = (Vec3::new(-0.6, 0.0, 0.0), Vec3::new(0.6, 0.2, 0.1));
    let side = |light: Vec3, seen: Vec3| -> MeanEstimate {
        let normal = |at: Vec3| (Vec3::new(0.0, 1.0, 0.4) - at).normalize();
        let position = seen + normal(seen) * 0.3;
        let mut scene = scene(three_bands(), camera(position, seen, 24.0, 8));
        scene.materials = vec![
            Material::lambertian("plate", flat(0.5)),
            glass(1.5, 0.25, 0.9),
            metal(flat(1.9), flat(3.4), 0.3),
            coated(0.6, 0.2),
        ];
        let disc = |at: Vec3| Shape::Disc { center: at, normal: normal(at), radius_m: 0.08 };
        let mut bright = object("lamp", disc(light), 0);
        bright.emission = Some(SurfaceEmission { group: 0, radiance: flat(1.0), is_one_sided: false });
        let ball = |center: Vec3, radius_m: f32| Shape::Sphere { center, radius_m };
        scene.objects = vec![
            bright,
            object("seen", disc(seen), 0),
            object("glass", ball(Vec3::new(0.0, 0.25, 0.1), 0.18), 1),
            object("metal", ball(Vec3::new(-0.1, 0.7, 0.4), 0.3), 2),
            object("wall", quad(Vec3::new(-1.0, -0.5, -0.6), Vec3::X * 2.0, Vec3::Y * 2.0), 3),
        ];
        // Pixels of the plate only, to first bounce and beyond; its own light toward the camera does not count.
        let values: Vec<f64> = repeat(&scene, runs, &settings(samples, 8))
            .iter()
            .map(|image| {
                let seen = image.features.part.iter().position(|&part| part == 2);
                assert!(seen.is_some(), "the plate is not in view");
                let pixels: Vec<f64> = image
                    .stored(0)
                    .chunks_exact(3)
                    .zip(&image.features.part)
                    .filter(|(_, part)| **part == 2)
                    .map(|(pixel, _)| f64::from(pixel[1]))
                    .collect();
                MeanEstimate::of(&pixels).mean
            })
            .collect();
        MeanEstimate::of(&values)
    };
    let (there, back) = (side(a, b), side(b, a));
    // The mean over the pixels in view stands for that over the plate: of two plates of 0.08 at a distance of 1.2, the
    // irradiance varies by (0.08 / 1.2)^2 / 2 = 0.2 % to second order, and pixels at the rim weigh a little less.
    let tolerance = 5e-3 * there.mean + 4.0 * there.standard_error.hypot(back.standard_error);
    assert!((there.mean - back.mean).abs() < tolerance, "{there:?} {back:?}");
}

#[test]
fn light_and_camera_can_be_exchanged() {
    assert_reciprocal(256, 6);
}

/// A body that turns every photon it absorbs into another one sends out as many photons as it gets.
#[test]
fn photons_balance() {
    let grid = WavelengthGrid::uniform(360.0, 680.0, 10.0).unwrap();
    let spectrum = gaussian(390.0, 4.0, 1.0);
    let probe = dye("probe", 390.0, 540.0, 0.4);
    // Photons out per photon in under this light.
    let photons = Curve::from_fn(355.0, 685.0, |nm| nm);
    let incoming = spectrum.times(&photons).integral(355.0, 685.0);
    let emitted = probe.eem.photon_exitance(&spectrum.times(&photons), (355.0, 685.0)).total();
    let share = emitted / incoming;
    let diffuse = |reflectance: f64| Material::lambertian("ball", flat(reflectance));
    // The largest yield may exceed that under the light a little: leave room for it.
    let rest = 1.0 - 1.02 * share;
    let cases: Vec<(&str, Material, f64)> = vec![
        ("lambertian", diffuse(rest), rest + share),
        ("black", diffuse(0.0), share),
        ("coated white", coated(1.0, 0.3), 1.0),
    ];
    for (name, material, expected) in cases {
        let with_probe = expected != 1.0;
        let mut scene = scene(grid.clone(), camera(Vec3::new(0.0, 0.0, 300.0), Vec3::ZERO, 0.4, 48));
        scene.fluorophores = vec![probe.clone()];
        scene.materials = vec![if with_probe { with_dyes(material, &[(0, 1.0)]) } else { material }];
        scene.objects.push(object("ball", Shape::Sphere { center: Vec3::ZERO, radius_m: 1.0 }, 0));
        scene.lights.push(light(spectrum.clone(), Emitter::Environment));
        let image = run(&scene, &settings(64, 1));
        let bands = image.grid.len();
        // Off the rim, where pixels see some of the surroundings; an even ball is even all over.
        let is_inner = |pixel: &usize| {
            let (x, y) = ((pixel % 48) as f64 - 23.5, (pixel / 48) as f64 - 23.5);
            x.hypot(y) < 20.0 && image.features.part[*pixel] == 1
        };
        let sums: Vec<f64> = (0..48 * 48)
            .filter(is_inner)
            .map(|pixel| {
                (0..image.components.len())
                    .flat_map(|c| image.stored(c)[pixel * bands..(pixel + 1) * bands].iter().enumerate())
                    .map(|(b, v)| f64::from(*v) * image.grid.center_nm(b) * image.grid.width_nm(b))
                    .sum()
            })
            .collect();
        let balance = MeanEstimate::of(&sums).mean / incoming;
        let error = MeanEstimate::of(&sums).standard_error / incoming;
        // Bins of 10 nm against a light of 4 nm: their centers stand for the photons within 1e-3.
        assert!(
            (balance - expected).abs() < 4e-3 + 4.0 * error,
            "{name}: {balance} +- {error}, expected {expected}"
        );
    }
}

#[test]
fn without_fluorophores_every_material_has_none() {
    for material in MATERIALS {
        let image = run(&lit_box("disc", material, 0.0), &settings(2, 5));
        assert!(image.stored(0).iter().any(|&v| v > 0.0), "{material}");
        for component in 1..4 {
            assert!(image.stored(component).iter().all(|&v| v == 0.0), "{material}, component {component}");
        }
    }
}

#[test]
fn concentrations_leave_every_path_as_it_is() {
    for material in MATERIALS {
        let (thin, dense) = (
            run(&lit_box("lamps and sky", material, 0.5), &settings(2, 6)),
            run(&lit_box("lamps and sky", material, 1.0), &settings(2, 6)),
        );
        assert_eq!(thin.stored(0), dense.stored(0), "{material}");
        for (a, b) in thin.stored(1).iter().zip(dense.stored(1)) {
            assert!((2.0 * a - b).abs() <= 2e-6 * b.abs() + 1e-30, "{material}: {a} {b}");
        }
    }
}

/// Lights without an area, which no scattered ray finds, against small lights of the same power, which brute force
/// confirms: a point against a sphere, parallel light against a sphere far away. Mirrors and smooth glass see the spheres
/// themselves and are left out.
#[test]
fn lights_without_area_are_small_lights() {
    let blue = |power: f64| gaussian(390.0, 15.0, power);
    let near = Vec3::new(0.2, 0.9, 0.5);
    let direction = Vec3::new(-0.3, -0.8, -0.5).normalize();
    let far = 500.0_f32;
    let pairs = [
        (
            "point",
            Emitter::Point(PointEmitter { position: near, pattern: PointPattern::Even }),
            1.0,
            Emitter::Sphere(SphereEmitter { center: near, radius_m: 1e-3 }),
            1.0,
        ),
        (
            "parallel light",
            Emitter::Distant(DistantEmitter { direction }),
            1.0,
            Emitter::Sphere(SphereEmitter { center: -far * direction, radius_m: 0.5 }),
            4.0 * PI * f64::from(far).powi(2),
        ),
    ];
    let materials: Vec<&str> =
        MATERIALS.into_iter().filter(|name| !["smooth glass", "mirror"].contains(name)).collect();
    for material in &materials {
        for (name, emitter, strength, small, power) in &pairs {
            let renders = |emitter: &Emitter, strength: f64, seed: u64| {
                let mut scene = lit_box("disc", material, 1.0);
                scene.lights = vec![light(blue(strength), emitter.clone())];
                repeat(&scene, 16, &RenderSettings { seed, ..settings(8, 6) })
            };
            let (a, b) = (renders(emitter, *strength, 3), renders(small, *power, 4));
            let significance = 1e-3 / (pairs.len() * materials.len()) as f64;
            assert_same_light(&format!("{name} on {material}"), &a, &b, significance);
        }
    }
}

/// The comparison itself: a bias of 5 % in one component does not pass, and leaves maps where the message says.
#[test]
fn a_bias_is_noticed_and_its_maps_are_saved() {
    let scene = lit_box("rectangle", "coated", 1.0);
    let honest = repeat(&scene, 24, &settings(32, 6));
    let mut biased = repeat(&scene, 24, &RenderSettings { seed: 5, ..settings(32, 6) });
    assert_same_light("unbiased", &honest, &biased, 1e-3);
    let length = biased[0].stored(1).len();
    for image in &mut biased {
        image.data[length..2 * length].iter_mut().for_each(|value| *value *= 1.05);
    }
    let outcome = std::panic::catch_unwind(|| assert_same_light("biased", &honest, &biased, 1e-3));
    let message = *outcome.unwrap_err().downcast::<String>().unwrap();
    let folder = std::path::PathBuf::from(message.rsplit("maps in ").next().unwrap());
    for file in ["first.csv", "second.csv", "component-0.ppm", "component-3.ppm"] {
        assert!(folder.join(file).is_file(), "{message}: no {file}");
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// Every light once and every material once; the full table is a test that is ignored by default.
#[test]
fn lights_and_materials_agree_with_brute_force() {
    for (index, material) in MATERIALS.iter().enumerate() {
        compare_estimators(LIGHTS[index % LIGHTS.len()], material, 8, 20, 1e-3 / MATERIALS.len() as f64);
    }
}

/// Lamps of a group are chosen by what the surface mirrors.
#[test]
fn lamps_before_glossy_materials_agree_with_brute_force() {
    for material in ["coated", "rough glass", "rough metal"] {
        compare_estimators("lamps and sky", material, 8, 20, 3e-4);
    }
}

#[test]
#[ignore = "heavy: every light with every material"]
fn every_light_with_every_material_agrees_with_brute_force() {
    for light in LIGHTS {
        for material in MATERIALS {
            let significance = 1e-3 / (LIGHTS.len() * MATERIALS.len()) as f64;
            compare_estimators(light, material, 48, 24, significance);
        }
    }
}

#[test]
#[ignore = "heavy: many samples"]
fn light_and_camera_can_be_exchanged_precisely() {
    assert_reciprocal(2048, 8);
}

#[test]
fn mixtures_with_holes_and_bumps_agree_with_brute_force() {
    for material in ["mixed with holes", "bumpy mixture"] {
        compare_estimators("disc", material, 8, 20, 5e-4);
    }
}

/// The opacity and the normal map of a mixture or two-sided material are those of its parts: given to each part instead,
/// the light is the same.
#[test]
fn what_is_given_to_a_mixture_is_given_to_its_parts() {
    let net = || Some(ScalarTexture::Checker { columns: 4, rows: 4, low: 0.3, high: 1.0 });
    let last = 4;
    for kind in ["mixed", "two-sided"] {
        let [whole, parts] = [&[last][..], &[2, 3]].map(|with_net| {
            let mut scene = lit_box("disc", kind, 1.0);
            for &material in with_net {
                scene.materials[material].opacity = net();
            }
            scene
        });
        let whole = repeat(&whole, 20, &settings(8, 6));
        let parts = repeat(&parts, 20, &RenderSettings { seed: 5, ..settings(8, 6) });
        assert_same_light(&format!("{kind} with holes"), &whole, &parts, 5e-4);

        let [whole, parts] = [&[last][..], &[2, 3]].map(|with_map| {
            let mut scene = lit_box("disc", kind, 1.0);
            for &material in with_map {
                scene.materials[material].normal_map = Some(bumps());
            }
            run(&scene, &settings(8, 6))
        });
        assert_eq!(whole.data, parts.data, "{kind} with bumps");
    }
}

/// Two parts alike but for their opacities are one material of the mean opacity, times that of the mixture.
#[test]
fn opacities_of_parts_are_mixed_by_their_shares() {
    let gray = |opacity: f32| Material {
        opacity: Some(ScalarTexture::Constant(opacity)),
        ..Material::lambertian("gray", flat(0.5))
    };
    let [mixture, plain] = [true, false].map(|is_mixture| {
        let mut scene = lit_box("disc", "lambertian", 1.0);
        scene.materials[2] = gray(0.25);
        scene.materials[3] = gray(0.75);
        scene.materials[4] = if is_mixture {
            let opacity = Some(ScalarTexture::Constant(0.8));
            Material { opacity, ..mixed(2, 3, ScalarTexture::Constant(0.6)) }
        } else {
            // 0.8 (0.4 * 0.25 + 0.6 * 0.75)
            gray(0.44)
        };
        scene
    });
    let mixture = repeat(&mixture, 20, &settings(8, 6));
    let plain = repeat(&plain, 20, &RenderSettings { seed: 5, ..settings(8, 6) });
    assert_same_light("opacities of parts", &mixture, &plain, 1e-3);
}

/// A displaced sphere of wax: mesh, displacement and shading normals keep the furnace white.
#[test]
fn a_displaced_white_surface_is_invisible() {
    let mut mesh = TriangleMesh {
        positions: vec![
            Vec3::new(-1.0, -1.0, 0.0),
            Vec3::new(1.0, -1.0, 0.0),
            Vec3::new(1.0, 1.0, 0.0),
            Vec3::new(-1.0, 1.0, 0.0),
        ],
        uvs: vec![glam::Vec2::ZERO, glam::Vec2::X, glam::Vec2::ONE, glam::Vec2::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    };
    mesh.subdivide(5);
    mesh.displace(|uv| 0.08 * (9.0 * uv.x).sin() * (7.0 * uv.y).cos());
    let mut scene = furnace(vec![Material::lambertian("white", flat(1.0))], Emitter::Environment);
    scene.objects = vec![object("sheet", Shape::Mesh(Arc::new(mesh)), 0)];
    let image = run(&scene, &settings(64, 100));
    let mean = band_mean(&image, 0, 1);
    // Shading normals that differ from those of the triangles lose light where they disagree on what is above: for
    // facets of 1/32 of the sheet that is the angle between neighbors, some 0.03, cut off at grazing incidence.
    assert!((mean.mean - 1.0).abs() < 1e-2 + 4.0 * mean.standard_error, "{mean:?}");
}

/// A matte surface below a film that evens out relief over a length.
fn filmed(smoothing_m: f32) -> Material {
    let coat = Coat { smoothing_m, ..Coat::new(1.4, ScalarTexture::Constant(0.1)) };
    Material::with_base("wet", Lambertian::uniform(flat(0.5)), Some(coat))
}

#[test]
fn scenes_that_make_no_sense_are_refused() {
    let broken = |change: &dyn Fn(&mut Scene)| {
        let mut scene = lit_box("disc", "mixed", 1.0);
        change(&mut scene);
        scene.check().unwrap_err().to_string()
    };
    let last = 4;
    let cases: Vec<(&str, String)> = vec![
        ("contains itself", broken(&|s| s.materials[last] = mixed(last, 0, ScalarTexture::Constant(0.5)))),
        (
            "refers to material number 9",
            broken(&|s| s.materials[last] = mixed(9, 0, ScalarTexture::Constant(0.5))),
        ),
        ("more than 1", broken(&|s| s.materials[last] = mixed(0, 1, ScalarTexture::Constant(1.5)))),
        (
            "no fluorophores",
            broken(&|s| s.materials[last] = with_dyes(s.materials[last].clone(), &[(0, 1.0)])),
        ),
        (
            "a material with holes",
            broken(&|s| {
                s.materials[2].opacity = Some(ScalarTexture::Constant(0.5));
                s.objects[3].emission =
                    Some(SurfaceEmission { group: 0, radiance: flat(1.0), is_one_sided: false });
            }),
        ),
        ("refractive index 0.8", broken(&|s| s.materials[last] = glass(0.8, 0.1, 1.0))),
        ("evens out relief over -1 m", broken(&|s| s.materials[last] = filmed(-1.0))),
        (
            "the film on instances",
            broken(&|s| {
                s.materials[last] = filmed(1e-3);
                let meshes = vec![Arc::new(TriangleMesh::quad(Vec3::ZERO, Vec3::X, Vec3::Y))];
                let instances = vec![MeshInstance { mesh: 0, to_world: Affine3::IDENTITY }];
                let many = Shape::Instances(Arc::new(MeshInstances { meshes, instances }));
                s.objects.push(object("many", many, last));
            }),
        ),
        ("transmittance 1.2", broken(&|s| s.materials[last] = glass(1.5, 0.1, 1.2))),
        ("k of the metal is -1", broken(&|s| s.materials[last] = metal(flat(1.0), flat(-1.0), 0.1))),
        (
            "n of the metal is known from 400 to 500 nm",
            broken(&|s| {
                let short = Curve::new(vec![400.0, 500.0], vec![1.0, 1.0]).unwrap();
                s.materials[last] = metal(short, flat(1.0), 0.1);
            }),
        ),
        (
            "a material with holes",
            broken(&|s| {
                s.materials[0].opacity = Some(ScalarTexture::Constant(0.5));
                s.objects[1].emission =
                    Some(SurfaceEmission { group: 0, radiance: flat(1.0), is_one_sided: false });
            }),
        ),
    ];
    for (expected, message) in cases {
        assert!(message.contains(expected), "{expected}: {message}");
    }
    let mut clear = lit_box("disc", "smooth glass", 1.0);
    clear.materials[4] = with_dyes(glass(1.5, 0.0, 1.0), &[(0, 1.0)]);
    assert!(matches!(clear.check(), Err(SceneError::CreatesPhotons { .. })));
}
