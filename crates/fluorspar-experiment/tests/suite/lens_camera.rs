//! Renders through traced lenses against closed forms and against the pinhole with the lens's own camera equation.
#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use fluorspar::geometry::TriangleMesh;
use fluorspar::image::ComponentImage;
use fluorspar::light::LightGroup;
use fluorspar::material::Material;
use fluorspar::optics::{CameraLens, LensRay, LensSetting, LensState, PerspectiveCamera};
use fluorspar::render::{RenderControl, RenderSettings, render};
use fluorspar::scene::{Object, Scene, Shape, SurfaceEmission};
use fluorspar::spectral::{Curve, WavelengthGrid};
use fluorspar_experiment::preset;
use glam::{DVec3, Vec3};

fn grid() -> WavelengthGrid {
    WavelengthGrid::uniform(450.0, 650.0, 50.0).unwrap()
}

fn run(scene: &Scene, samples_per_pixel: u32) -> ComponentImage {
    let stop = AtomicBool::new(false);
    let settings = RenderSettings { samples_per_pixel, max_depth: 1, seed: 5, ..RenderSettings::default() };
    render(scene, &settings, &RenderControl { stop: &stop, progress: &|_| {} }).unwrap()
}

/// A camera 100 mm in front of the origin, on z, with a lens focused there, or the pinhole in its place.
fn camera(
    lens: &str,
    setting: LensSetting,
    width_mm: f64,
    pixels: [usize; 2],
    groups: usize,
) -> PerspectiveCamera {
    let state = LensState::new(&preset::lens(lens).unwrap().lens, setting).unwrap();
    let height_mm = width_mm * pixels[1] as f64 / pixels[0] as f64;
    let lens = CameraLens::new(state, width_mm, height_mm, &grid(), groups);
    let field = 2.0 * lens.covering_tangent().unwrap().atan().to_degrees();
    let position = Vec3::new(0.0, 0.0, 0.1);
    let pinhole =
        PerspectiveCamera::look_at(position, Vec3::ZERO, Vec3::Y, field as f32, pixels[0], pixels[1])
            .unwrap();
    PerspectiveCamera { lens: Some(Arc::new(lens)), ..pinhole }
}

fn close_up(f_number: Option<f64>) -> LensSetting {
    LensSetting { f_number, object_distance_mm: Some(100.0), ..LensSetting::default() }
}

fn emitter(name: &str, shape: Shape, radiance: f64) -> Object {
    let emission = SurfaceEmission { group: 0, radiance: Curve::constant(radiance), is_one_sided: false };
    Object { name: name.into(), shape, material: 0, emission: Some(emission) }
}

fn scene(camera: PerspectiveCamera, objects: Vec<Object>) -> Scene {
    Scene {
        grid: grid(),
        objects,
        materials: vec![Material::lambertian("black", Curve::constant(0.0))],
        fluorophores: Vec::new(),
        light_groups: vec![LightGroup { name: "glow".into() }],
        lights: Vec::new(),
        camera,
    }
}

/// A wall at the origin that fills any field.
fn wall(radiance: f64) -> Object {
    emitter("wall", Shape::Disc { center: Vec3::ZERO, normal: Vec3::Z, radius_m: 10.0 }, radiance)
}

fn band(image: &ComponentImage, row: usize, col: usize, band: usize) -> f64 {
    f64::from(image.component(0)[(row * image.width + col) * image.grid.len() + band])
}

#[test]
fn a_uniform_field_through_the_lens_has_the_irradiance_of_the_cone() {
    for (lens, setting) in [
        ("wide_3_5mm", close_up(None)),
        ("wide_3_5mm", close_up(Some(8.0))),
        ("double_gauss_100mm", LensSetting::default()),
        ("tessar_100mm", LensSetting::default()),
        ("macro_105mm", LensSetting::default()),
        ("macro_105mm", LensSetting { object_distance_mm: Some(400.0), ..LensSetting::default() }),
    ] {
        let camera = camera(lens, setting, 0.02, [2, 2], 1);
        let traced = Arc::clone(camera.lens.as_ref().unwrap());
        let image = run(&scene(camera, vec![wall(2.0)]), 4096);
        // A film of 20 um sees the axis only: the component image holds L, the film pi sin² u' L.
        let mean = (0..4).map(|i| band(&image, i / 2, i % 2, 0)).sum::<f64>() / 4.0;
        assert!((mean / 2.0 - 1.0).abs() < 0.005, "{lens}: {mean}");
        // A lens in air that obeys the sine condition: pi L / (4 N_w²), N_w = 1 / (2 sin u') = N (1 + |m| / p), with p the
        // pupil magnification. It holds while the focal length is that for which N is stated: not with moved groups.
        let state = traced.state();
        let pupils = state.paraxial.exit_pupil_scale / state.paraxial.entrance_pupil_scale;
        let working = state.f_number * (1.0 + state.magnification().abs() / pupils.abs());
        let error = traced.axial_solid_angle_sr() * 4.0 * working * working / PI - 1.0;
        println!(
            "{lens}: f/{:.3}, N_w {working:.3}; rendered {:+.3} %, traced cone against pi L / 4 N²: {:+.2} %",
            state.f_number,
            100.0 * (mean / 2.0 - 1.0),
            100.0 * error
        );
        if state.focus_travel == 0.0 {
            assert!(error.abs() < 0.005, "{lens}: {error}");
        } else {
            // With moved groups the same condition from the object's side, sin u' = sin u / |m|, with the steepest ray that
            // passes from the object point on the axis.
            let trace = state.trace(state.lens.design_wavelength_nm);
            let object = DVec3::new(0.0, 0.0, state.object_mm());
            let passes = |sine: f64| {
                let direction = DVec3::new(sine, 0.0, (1.0 - sine * sine).sqrt());
                trace.forward(LensRay { origin: object, direction }).is_ok()
            };
            let (mut low, mut high) = (0.0, 0.5);
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                if passes(middle) { low = middle } else { high = middle }
            }
            let error = traced.axial_solid_angle_sr() / (PI * (low / state.magnification()).powi(2)) - 1.0;
            println!("{lens}, moved groups: {:+.2} %", 100.0 * error);
            assert!(error.abs() < 0.005, "{lens}: {error}");
        }
    }
}

/// The picture by the other way: a pinhole's radiance, moved, blurred and darkened. The pinhole has the film's proportions.
fn by_point_spread(camera: &PerspectiveCamera, objects: Vec<Object>, samples_per_pixel: u32) -> Vec<f64> {
    let lens = Arc::clone(camera.lens.as_ref().unwrap());
    let pinhole = PerspectiveCamera { lens: None, ..camera.clone() };
    let tangent = f64::from(pinhole.tan_half_width);
    let radiance = run(&scene(pinhole, objects), samples_per_pixel).recombine(|_| 1.0);
    let picture = lens.lens_radiance(&radiance, tangent);
    (0..picture.height())
        .flat_map(|row| (0..picture.width()).map(move |col| (row, col)))
        .map(|(row, col)| f64::from(picture.pixel(row, col)[2]))
        .collect()
}

#[test]
fn a_flat_field_is_the_same_rendered_and_computed() {
    let camera = camera("wide_3_5mm", close_up(None), 3.0, [24, 18], 1);
    let lens = Arc::clone(camera.lens.as_ref().unwrap());
    let computed = by_point_spread(&camera, vec![wall(1.0)], 16);
    let image = run(&scene(camera, vec![wall(1.0)]), 4096);
    let mut worst = 0.0_f64;
    for row in 0..18 {
        for col in 0..24 {
            let error = band(&image, row, col, 2) / computed[row * 24 + col] - 1.0;
            worst = worst.max(error.abs());
        }
    }
    println!("largest departure {:.3} %", 100.0 * worst);
    assert!(worst < 0.01, "{worst}");
    // Not a flat lens: the corner must be darker than the middle for this test to mean anything.
    assert!(lens.relative_illumination(1.85) < 0.9 * lens.relative_illumination(0.0));
    assert!(computed[0] < 0.9 * computed[9 * 24 + 12]);
}

#[test]
fn a_slanted_edge_is_the_same_rendered_and_computed() {
    // A wall that ends along a line at 5 degrees to the columns, right of the axis; pixels of 4 um, so that the edge is
    // blurred over some of them.
    let pixels = [40, 30];
    let camera = camera("wide_3_5mm", LensSetting { film_shift_mm: 0.05, ..close_up(None) }, 0.16, pixels, 1);
    let slope = 5_f32.to_radians();
    let (along, across) =
        (Vec3::new(slope.sin(), slope.cos(), 0.0), Vec3::new(slope.cos(), -slope.sin(), 0.0));
    let corner = |a: f32, b: f32| along * a + across * b;
    let half_wall = TriangleMesh {
        positions: vec![corner(-1.0, 0.0), corner(-1.0, 2.0), corner(1.0, 2.0), corner(1.0, 0.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    };
    let wall = emitter("half", Shape::Mesh(Arc::new(half_wall)), 1.0);
    let computed = by_point_spread(&camera, vec![wall.clone()], 256);
    let image = run(&scene(camera, vec![wall]), 1024);
    let mut worst = 0.0_f64;
    let (mut sum, mut width) = ([0.0; 2], [0.0; 2]);
    // The rim of four pixels sees light from beyond the pinhole's picture, which the second way does not have.
    for row in 4..pixels[1] - 4 {
        for col in 4..pixels[0] - 4 {
            let values = [band(&image, row, col, 2), computed[row * pixels[0] + col]];
            worst = worst.max((values[0] - values[1]).abs());
            for (way, value) in values.into_iter().enumerate() {
                sum[way] += value;
                width[way] += value * (1.0 - value);
            }
        }
    }
    println!("edge: largest departure {worst:.3}, light {sum:?}, blur {width:?}");
    // The same light within 1 %, that is, the same place of the edge; the second way adds diffraction and the interpolation
    // over pixels, so its edge is a little softer: no pixel differs by more than 0.08 of the bright side.
    assert!((sum[1] / sum[0] - 1.0).abs() < 0.01, "{sum:?}");
    assert!(worst < 0.08, "{worst}");
    assert!(width[0] > 1.0 && width[1] / width[0] < 1.4 && width[1] / width[0] > 0.9, "{width:?}");
}

/// Bars of four pixels far from the axis keep their contrast wherever distortion moves them by half a pixel.
#[test]
fn fine_bars_are_the_same_rendered_and_computed() {
    let pixels = [128, 6];
    let camera = camera("wide_3_5mm", close_up(None), 0.8, pixels, 1);
    // Where the middle of the film of the plane in focus is 13 mm wide, so a pixel 1/128 of it
    let width_m = 2.0 * camera.tan_half_width * camera.position.z;
    let bar_m = width_m / 64.0;
    let bars = (0..34).map(|k| {
        let x = (2.0 * k as f32 - 34.0) * bar_m;
        let corners = [[x, -1.0], [x, 1.0], [x + bar_m, 1.0], [x + bar_m, -1.0]];
        let mesh = TriangleMesh {
            positions: corners.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..TriangleMesh::default()
        };
        emitter(&format!("bar {k}"), Shape::Mesh(Arc::new(mesh)), 1.0)
    });
    let bars: Vec<Object> = bars.collect();
    let computed = by_point_spread(&camera, bars.clone(), 256);
    let image = run(&scene(camera, bars), 512);
    let contrast = |value: &dyn Fn(usize) -> f64, first: usize| {
        let [sine, cosine, mean] = (first..first + 16).fold([0.0; 3], |sum, col| {
            let (sin, cos) = (std::f64::consts::FRAC_PI_2 * col as f64).sin_cos();
            [sum[0] + sin * value(col), sum[1] + cos * value(col), sum[2] + value(col)]
        });
        2.0 * sine.hypot(cosine) / mean
    };
    // An edge neither rings below the dark nor lies far above the bright
    assert!(computed.iter().all(|value| *value >= 0.0));
    let brightest = (0..128).map(|col| band(&image, 3, col, 2)).fold(0.0, f64::max);
    let most = computed[3 * 128..4 * 128].iter().fold(0.0_f64, |most, value| most.max(*value));
    assert!(most < 1.05 * brightest, "{most} {brightest}");
    for first in [4, 24, 44, 64, 84, 104] {
        let rendered = contrast(&|col| band(&image, 3, col, 2), first);
        let ratio = contrast(&|col| computed[3 * 128 + col], first) / rendered;
        println!("{first}: {rendered:.3}, {ratio:.3}");
        assert!(rendered > 0.7 && (0.8..1.05).contains(&ratio), "{first}: {rendered} {ratio}");
    }
}

#[test]
fn the_image_is_upright_and_where_the_pinhole_sees_it() {
    // A small disc up and to the right of the middle, in focus.
    let camera = camera("wide_3_5mm", close_up(None), 3.0, [60, 45], 1);
    let at = Vec3::new(0.012, 0.008, 0.0);
    let spot = emitter("spot", Shape::Disc { center: at, normal: Vec3::Z, radius_m: 0.002 }, 1.0);
    let pinhole = PerspectiveCamera { lens: None, ..camera.clone() };
    let center = |image: &ComponentImage| {
        let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
        for row in 0..45 {
            for col in 0..60 {
                let value = band(image, row, col, 0);
                sum += value;
                x += value * (col as f64 + 0.5);
                y += value * (row as f64 + 0.5);
            }
        }
        [x / sum - 30.0, 22.5 - y / sum]
    };
    let lens = Arc::clone(camera.lens.as_ref().unwrap());
    let image = run(&scene(camera, vec![spot.clone()]), 256);
    let through = center(&image);
    // Its part lies where its light does
    let mut of_part = [0.0; 3];
    for (pixel, _) in image.features.part.iter().enumerate().filter(|(_, part)| **part > 0) {
        let at = [(pixel % 60) as f64 - 29.5, 22.0 - (pixel / 60) as f64];
        of_part = [of_part[0] + at[0], of_part[1] + at[1], of_part[2] + 1.0];
    }
    let off = [0, 1].map(|axis| of_part[axis] / of_part[2] - through[axis]);
    assert!(off[0].hypot(off[1]) < 0.15, "{off:?}");
    let seen = center(&run(&scene(pinhole, vec![spot]), 64));
    assert!(through[0] > 0.0 && through[1] > 0.0, "{through:?}");
    // Pinhole pixels become film by tan, film by the chief rays: compare tangents.
    let tangent = lens.covering_tangent().unwrap();
    let pinhole_tangent = seen[0].hypot(seen[1]) / 30.0 * tangent;
    let height = through[0].hypot(through[1]) / 60.0 * 3.0;
    let lens_tangent = lens.middle().chief_ray(height).unwrap().object_tangent;
    assert!((lens_tangent / pinhole_tangent - 1.0).abs() < 0.01, "{lens_tangent} {pinhole_tangent}");
    assert!((through[0] / through[1] / (seen[0] / seen[1]) - 1.0).abs() < 0.02);
}

#[test]
fn band_groups_see_the_dispersion_of_the_glasses() {
    // Lateral color: the same spot lies at another height in blue than in red. One group sees none of it.
    let spot = emitter(
        "spot",
        Shape::Disc { center: Vec3::new(0.035, 0.0, 0.0), normal: Vec3::Z, radius_m: 0.001 },
        1.0,
    );
    let shift = |groups: usize| {
        let image =
            run(&scene(camera("wide_3_5mm", close_up(None), 3.0, [240, 1], groups), vec![spot.clone()]), 512);
        let mean = |b: usize| {
            let (mut sum, mut x) = (0.0, 0.0);
            for col in 0..240 {
                sum += band(&image, 0, col, b);
                x += band(&image, 0, col, b) * col as f64;
            }
            x / sum
        };
        mean(0) - mean(4)
    };
    assert_eq!(shift(1), 0.0);
    assert!(shift(5).abs() > 0.02, "{}", shift(5));
}

#[test]
fn the_same_bits_for_any_number_of_threads_through_a_lens() {
    let scene = scene(camera("wide_3_5mm", close_up(None), 3.0, [20, 15], 2), vec![wall(1.0)]);
    let with = |threads: usize| {
        let pool = rayon_pool(threads);
        pool.install(|| run(&scene, 8))
    };
    assert!(with(1).data == with(3).data);
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}
