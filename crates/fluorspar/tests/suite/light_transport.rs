//! Light transport against closed forms: physics that the code cannot argue with.
#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::support::{camera, dye, flat, gaussian, lit_box, object, quad, run, scene, settings, with_dyes};
use fluorspar::geometry::TriangleMesh;
use fluorspar::image::{ComponentImage, LightPath};
use fluorspar::light::{DiscEmitter, DistantEmitter, Emitter, Light, RectangleEmitter};
use fluorspar::material::{
    Coat, CoatAlbedo, FluorophoreAmount, Lambertian, MappedParameter, Material, PhotonExcess, ScalarTexture,
    StateGrid, TissueEmission,
};
use fluorspar::render::{Estimator, RenderControl, RenderSettings, render};
use fluorspar::scene::{Scene, SceneError, Shape, SurfaceEmission};
use fluorspar::spectral::{Curve, Fluorophore, WavelengthGrid};
use fluorspar_testkit::{MeanEstimate, sidak, z_limit, z_score};
use glam::Vec3;

/// Means of one component and band over pixels, with the standard error from pixel to pixel.
fn band_mean(image: &ComponentImage, component: usize, band: usize) -> MeanEstimate {
    let bands = image.grid.len();
    let values: Vec<f64> =
        image.stored(component).iter().skip(band).step_by(bands).map(|&v| f64::from(v)).collect();
    MeanEstimate::of(&values)
}

/// A white surface in white surroundings can't be seen, whatever its coat.
#[test]
fn white_furnace() {
    for roughness in [None, Some(0.05), Some(0.3), Some(1.0)] {
        let mut scene = scene(
            WavelengthGrid::uniform(400.0, 700.0, 100.0).unwrap(),
            camera(Vec3::new(0.0, 0.0, 3.0), Vec3::ZERO, 30.0, 16),
        );
        let coat = |r| Coat::new(1.5, ScalarTexture::Constant(r));
        scene.materials.push(Material::with_base(
            "white",
            Lambertian::uniform(flat(1.0)),
            roughness.map(coat),
        ));
        scene.objects.push(object("sphere", Shape::Sphere { center: Vec3::ZERO, radius_m: 1.0 }, 0));
        scene.lights.push(Light {
            name: "sky".into(),
            group: 0,
            spectrum: flat(1.0),
            crossed_polarizers: false,
            emitter: Emitter::Environment,
        });
        let image = run(&scene, &settings(1024, 4));
        for band in 0..image.grid.len() {
            let mean = band_mean(&image, 0, band);
            // Bias below 0.1 %; the pixels scatter by their standard error, four of which are allowed on top.
            let tolerance = 1e-3 + 4.0 * mean.standard_error;
            assert!((mean.mean - 1.0).abs() < tolerance, "roughness {roughness:?}: {mean:?}");
            assert!(mean.standard_error < 1e-3, "{mean:?}");
        }
    }
}

/// A coated plane with a disc light where its middle mirrors the camera's view.
fn mirrored_disc(reflectance: f64, crossed_polarizers: bool) -> ComponentImage {
    let mut scene = scene(
        WavelengthGrid::uniform(500.0, 510.0, 10.0).unwrap(),
        camera(Vec3::new(0.3, 0.0, 1.0), Vec3::ZERO, 20.0, 16),
    );
    let coat = Coat::new(1.4, ScalarTexture::Constant(0.05));
    scene.materials.push(Material::with_base("wet", Lambertian::uniform(flat(reflectance)), Some(coat)));
    scene.objects.push(object("plane", quad(Vec3::new(-1.0, -1.0, 0.0), 2.0 * Vec3::X, 2.0 * Vec3::Y), 0));
    let (center, normal) = (Vec3::new(-0.3, 0.0, 1.0), Vec3::new(0.3, 0.0, -1.0).normalize());
    scene.lights.push(Light {
        name: "lamp".into(),
        group: 0,
        spectrum: flat(1.0),
        crossed_polarizers,
        emitter: Emitter::Disc(DiscEmitter { center, normal, radius_m: 0.05, exponent: 1.0 }),
    });
    run(&scene, &settings(256, 1))
}

/// Between crossed polarizers a wet surface shows what it scatters, and nothing of what it mirrors.
#[test]
fn crossed_polarizers_hold_back_mirrored_light() {
    let mean = |reflectance, crossed| band_mean(&mirrored_disc(reflectance, crossed), 0, 0);
    let (both, scattered, mirrored) = (mean(0.5, false), mean(0.5, true), mean(0.0, false));
    assert_eq!(mean(0.0, true).mean, 0.0);
    assert!(mirrored.mean > 0.2 * scattered.mean, "{mirrored:?}, {scattered:?}");
    let ratio = (scattered.mean + mirrored.mean) / both.mean;
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
}

/// A film over waves that are shorter than it evens out mirrors as one over a plane; one that follows them does not.
#[test]
fn a_film_mirrors_by_its_own_normal() {
    let mirrored = |height_mm: f32, smoothing_m: f32| {
        let mut scene = scene(
            WavelengthGrid::uniform(500.0, 510.0, 10.0).unwrap(),
            camera(Vec3::new(0.0, 0.0, 0.1), Vec3::ZERO, 8.0, 16),
        );
        let coat = Coat { smoothing_m, ..Coat::new(1.4, ScalarTexture::Constant(0.03)) };
        scene.materials.push(Material::with_base("wet", Lambertian::uniform(flat(0.0)), Some(coat)));
        scene.objects.push(object("waves", Shape::Mesh(Arc::new(waves(height_mm))), 0));
        let (center, normal) = (Vec3::new(0.01, 0.0, 0.1), Vec3::NEG_Z);
        scene.lights.push(Light {
            name: "lamp".into(),
            group: 0,
            spectrum: flat(1.0),
            crossed_polarizers: false,
            emitter: Emitter::Disc(DiscEmitter { center, normal, radius_m: 2e-3, exponent: 1.0 }),
        });
        run(&scene, &settings(256, 1)).stored(0).to_vec()
    };
    let (plane, film, relief) = (mirrored(0.0, 0.0), mirrored(0.05, 1.5e-3), mirrored(0.05, 0.0));
    let total: f32 = plane.iter().sum();
    let off = |other: &[f32]| plane.iter().zip(other).map(|(a, b)| (a - b).abs()).sum::<f32>() / total;
    assert!(off(&film) < 0.1, "{}", off(&film));
    assert!(off(&relief) > 0.5, "{}", off(&relief));
}

/// A sheet of 20 mm in the middle of the scene with waves of 1 mm along x.
fn waves(height_mm: f32) -> TriangleMesh {
    const SIDE: u32 = 200;
    let mut mesh = TriangleMesh::default();
    for (row, column) in (0..=SIDE).flat_map(|row| (0..=SIDE).map(move |column| (row, column))) {
        let (x, y) = (0.1 * column as f32 - 10.0, 0.1 * row as f32 - 10.0);
        mesh.positions.push(1e-3 * Vec3::new(x, y, height_mm * (std::f32::consts::TAU * x).sin()));
        if row < SIDE && column < SIDE {
            let corner = row * (SIDE + 1) + column;
            let above = corner + SIDE + 1;
            mesh.triangles.extend([[corner, corner + 1, above + 1], [corner, above + 1, above]]);
        }
    }
    mesh.compute_smooth_normals();
    mesh
}

/// Where light is even, a coat that mirrors scattered light less sharply returns as much of it but for what facets
/// hide from each other; what the camera sees first is as sharp.
#[test]
fn regularized_coats_keep_their_light() {
    let mut scene =
        scene(WavelengthGrid::uniform(500.0, 510.0, 10.0).unwrap(), camera(Vec3::ZERO, Vec3::X, 60.0, 16));
    let coat = Coat::new(1.4, ScalarTexture::Constant(0.05));
    scene.materials.push(Material::with_base("wall", Lambertian::uniform(flat(0.5)), Some(coat)));
    let mut wall = object("room", Shape::Sphere { center: Vec3::ZERO, radius_m: 1.0 }, 0);
    wall.emission = Some(SurfaceEmission { radiance: flat(1.0), group: 0, is_one_sided: false });
    scene.objects.push(wall);
    let rendered = |depth, regularize| {
        let settings = RenderSettings { regularize, ..settings(1024, depth) };
        run(&scene, &settings)
    };
    assert_eq!(rendered(1, true).stored(0), rendered(1, false).stored(0));
    let [sharp, blurred] = [false, true].map(|regularize| band_mean(&rendered(12, regularize), 0, 0).mean);
    // L = Le / (1 - R - (1 - R) E), with the albedo E of the coat under even light, at all vertices but the first, which takes
    // 1 + (L - 1) of what the others return
    let albedo = |roughness| f64::from(CoatAlbedo::new(1.4).at(1.0, roughness).1);
    let radiance = |roughness| 1.0 / (0.5 - 0.5 * albedo(roughness));
    let first = |returned: f64| 1.0 + (0.5 + 0.5 * albedo(0.05)) * returned;
    let expected = first(radiance(0.2)) / first(radiance(0.05));
    assert!((blurred / sharp / expected - 1.0).abs() < 2e-3, "{blurred}, {sharp}, {expected}");
}

/// Radiance in a closed cavity that emits `Le` everywhere: `L = Le / (1 - R)`; and with fluorescence
/// `L = (I - R - F)^-1 Le`, component by component.
#[test]
fn fluorescent_furnace() {
    let grid = WavelengthGrid::uniform(360.0, 700.0, 10.0).unwrap();
    let (reflectance, emission) = (0.35, 2.0);
    let dyes = [dye("a", 380.0, 450.0, 0.3), dye("b", 450.0, 560.0, 0.25)];
    let amounts = [(0, 0.8_f32), (1, 0.5_f32)];

    // Closed form with matrices from fine quadrature, independent of the renderer's operators.
    let n = grid.len();
    let matrix = |index: usize, c: f64| -> Vec<f64> {
        let mut entries = vec![0.0; n * n];
        const FINE: usize = 40;
        for o in 0..n {
            for i in 0..=o {
                let mut sum = 0.0;
                for a in 0..FINE {
                    for b in 0..FINE {
                        let lo = grid.edges_nm()[o] + grid.width_nm(o) * (a as f64 + 0.5) / FINE as f64;
                        let li = grid.edges_nm()[i] + grid.width_nm(i) * (b as f64 + 0.5) / FINE as f64;
                        sum += dyes[index].eem.at(lo, li) * li / lo;
                    }
                }
                entries[o * n + i] = c * sum / (FINE * FINE) as f64 * grid.width_nm(i);
            }
        }
        entries
    };
    // Dyes that give back next to nothing as well: what fluoresced excites again at random there
    for (strength, samples) in [(1.0, 64), (0.02, 128)] {
        let amounts = amounts.map(|(dye, amount)| (dye, strength * amount));
        let matrices: Vec<Vec<f64>> = amounts.iter().map(|&(k, c)| matrix(k, f64::from(c))).collect();
        let elastic = emission / (1.0 - reflectance);
        let apply = |m: &[f64], v: &[f64]| -> Vec<f64> {
            (0..n).map(|o| (0..n).map(|i| m[o * n + i] * v[i]).sum::<f64>() / (1.0 - reflectance)).collect()
        };
        let first: Vec<Vec<f64>> = matrices.iter().map(|m| apply(m, &vec![elastic; n])).collect();
        let mut total = vec![elastic; n];
        for _ in 0..200 {
            let mut next = vec![elastic; n];
            for m in &matrices {
                for (value, added) in next.iter_mut().zip(apply(m, &total)) {
                    *value += added;
                }
            }
            total = next;
        }

        let mut cavity = scene(grid.clone(), camera(Vec3::new(0.1, 0.05, 0.2), Vec3::X, 90.0, 24));
        cavity.fluorophores = dyes.to_vec();
        cavity.materials.push(with_dyes(Material::lambertian("wall", flat(reflectance)), &amounts));
        let mut wall = object("wall", Shape::Sphere { center: Vec3::ZERO, radius_m: 1.0 }, 0);
        wall.emission = Some(SurfaceEmission { group: 0, radiance: flat(emission), is_one_sided: false });
        cavity.objects.push(wall);

        let image = run(&cavity, &settings(samples, 100));
        // 4 components x 35 bands and the totals of two cavities: all together reject a correct renderer once in a thousand seeds.
        let limit = z_limit(sidak(1e-3, 2 * 5 * n));
        let peak = first.iter().flatten().copied().fold(0.0, f64::max);
        // What fluoresced twice is less by the yield
        let share = [1.0, 1.0, 1.0, peak / elastic];
        let mut sums = vec![MeanEstimate::default(); n];
        for band in 0..n {
            let expected = [
                elastic,
                first[0][band],
                first[1][band],
                total[band] - elastic - first[0][band] - first[1][band],
            ];
            for (component, &truth) in expected.iter().enumerate() {
                let mean = band_mean(&image, component, band);
                // Quadrature of the diagonal bins and single precision: 2e-4 of the level, or 2e-3 of weak fluorescence
                let tolerance = match component {
                    1.. if strength < 1.0 => 2e-3 * peak * share[component],
                    _ => 2e-4 * elastic.max(truth),
                };
                let z = z_score(mean, truth, tolerance);
                assert!(
                    z < limit,
                    "strength {strength}, component {component}, band {band}: {mean:?}, expected {truth}, z = {z}"
                );
                sums[band].mean += mean.mean;
                sums[band].standard_error = sums[band].standard_error.hypot(mean.standard_error);
            }
            let z = z_score(sums[band], total[band], 2e-4 * total[band]);
            assert!(z < limit, "sum, band {band}: {:?}, expected {}", sums[band], total[band]);
        }
        assert_eq!(image.components[3].light, LightPath::MultipleFluorescence);
    }
}

fn patch(
    grid: WavelengthGrid,
    reflectance: f64,
    fluorophores: Vec<Fluorophore>,
    amounts: &[(usize, f32)],
) -> Scene {
    let mut scene = scene(grid, camera(Vec3::new(0.0, 0.3, 1.0), Vec3::ZERO, 5.0, 4));
    scene.fluorophores = fluorophores;
    scene.materials.push(with_dyes(Material::lambertian("patch", flat(reflectance)), amounts));
    scene.objects.push(object("patch", quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), 0));
    scene
}

fn distant(spectrum: Curve, direction: Vec3) -> Light {
    Light {
        name: "sun".into(),
        group: 0,
        spectrum,
        crossed_polarizers: false,
        emitter: Emitter::Distant(DistantEmitter { direction }),
    }
}

/// `L = R E cos / pi` and `L_f = M / pi`, independent of `R`, with `R = 0` too.
#[test]
fn flat_patch_under_a_distant_light() {
    let light = gaussian(385.0, 6.0, 3.0);
    let direction = Vec3::new(0.0, 0.6, -0.8);
    let expected_photons: f64 = {
        let curve = Curve::from_fn(347.5, 752.5, |nm| nm);
        let eem = dye("d", 390.0, 520.0, 0.3).eem;
        0.8 * eem.photon_exitance(&light.times(&curve), (347.5, 752.5)).total()
    };
    for reflectance in [0.0, 0.5] {
        let mut scene =
            patch(WavelengthGrid::default(), reflectance, vec![dye("d", 390.0, 520.0, 0.3)], &[(0, 1.0)]);
        scene.lights.push(distant(light.clone(), direction));
        let image = run(&scene, &settings(1, 3));
        let elastic = light.on_grid::<fluorspar::spectral::Irradiance>(&image.grid);
        for band in 0..image.grid.len() {
            let expected = reflectance * elastic[band] * 0.8 / PI;
            let mean = band_mean(&image, 0, band).mean;
            // Single precision; below its smallest normal number nothing is promised.
            assert!(
                (mean - expected).abs() <= 2e-6 * expected + 1e-37,
                "band {band}: {mean}, expected {expected}"
            );
        }
        let photons: f64 = (0..image.grid.len())
            .map(|b| band_mean(&image, 1, b).mean * PI * image.grid.center_nm(b) * image.grid.width_nm(b))
            .sum();
        assert!(
            (photons / expected_photons - 1.0).abs() < 1e-3,
            "R = {reflectance}: {photons} {expected_photons}"
        );
    }
}

#[test]
fn emitted_photons_do_not_depend_on_the_wavelength_step() {
    // A 10 nm LED behind a steep short-pass, and a dye whose excitation edge lies within it.
    let light = Curve::from_fn(300.0, 800.0, |nm| {
        (-0.5 * ((nm - 385.0) / 4.5).powi(2)).exp() / (1.0 + ((nm - 391.0) / 0.7).exp())
    });
    let photons = |step: f64| -> f64 {
        let grid = WavelengthGrid::uniform(350.0, 750.0, step).unwrap();
        let mut scene = patch(grid, 0.1, vec![dye("d", 400.0, 520.0, 0.3)], &[(0, 1.0)]);
        scene.lights.push(distant(light.clone(), Vec3::NEG_Z));
        let image = run(&scene, &settings(1, 2));
        let sum = |component: usize| -> f64 {
            (0..image.grid.len())
                .map(|b| {
                    band_mean(&image, component, b).mean * image.grid.center_nm(b) * image.grid.width_nm(b)
                })
                .sum()
        };
        sum(1) + sum(2)
    };
    let reference = photons(1.0);
    for step in [2.0, 5.0, 10.0] {
        let ratio = photons(step) / reference;
        assert!((ratio - 1.0).abs() < 1e-3, "{step} nm: {ratio}");
    }
}

/// A box with a glossy fluorescent floor under a small light: used for statistics and bookkeeping.
fn cornell(power: f64, concentration: f32) -> Scene {
    let grid = WavelengthGrid::uniform(360.0, 700.0, 20.0).unwrap();
    let mut scene = scene(grid, camera(Vec3::new(0.0, 0.0, 3.4), Vec3::ZERO, 40.0, 12));
    scene.fluorophores = vec![dye("a", 380.0, 450.0, 0.4), dye("b", 440.0, 560.0, 0.4)];
    let coat = Coat::new(1.4, ScalarTexture::Constant(0.3));
    let dyes = [(0, concentration), (1, concentration)];
    let floor = with_dyes(Material::coated("floor", flat(0.4), coat), &dyes);
    scene.materials = vec![Material::lambertian("wall", flat(0.6)), floor];
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let low = Vec3::new(-1.0, -1.0, -1.0);
    scene.objects = vec![
        object("floor", quad(low, z, x), 1),
        object("ceiling", quad(low + y, x, z), 0),
        object("back", quad(low, x, y), 0),
        object("left", quad(low, y, z), 0),
        object("right", quad(low + x, z, y), 0),
        object("ball", Shape::Sphere { center: Vec3::new(0.3, -0.6, 0.1), radius_m: 0.4 }, 1),
    ];
    scene.lights = vec![Light {
        name: "lamp".into(),
        group: 0,
        spectrum: gaussian(390.0, 15.0, power),
        crossed_polarizers: false,
        emitter: Emitter::Rectangle(RectangleEmitter {
            corner: Vec3::new(-0.5, 0.99, -0.5),
            edge_u: Vec3::X,
            edge_v: Vec3::Z,
            exponent: 1.0,
        }),
    }];
    scene
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let scene = cornell(1.0, 1.0);
    let settings = settings(8, 6);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&scene, &settings)).data
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(3));
}

#[test]
fn radiance_is_linear_in_power_and_first_order_in_concentration() {
    let settings = settings(4, 5);
    let base = run(&cornell(1.0, 0.5), &settings);
    let bright = run(&cornell(2.0, 0.5), &settings);
    // A factor of two is exact in binary floating point.
    assert!(base.data.iter().zip(&bright.data).all(|(a, b)| 2.0 * a == *b || *b < 1e-30));
    let dense = run(&cornell(1.0, 1.0), &settings);
    assert_eq!(base.stored(0), dense.stored(0), "reflected light does not know of fluorophores");
    for component in [1, 2] {
        for (a, b) in base.stored(component).iter().zip(dense.stored(component)) {
            assert!((2.0 * a - b).abs() <= 1e-6 * b.abs() + 1e-30, "{a} {b}");
        }
    }
    for (a, b) in base.stored(3).iter().zip(dense.stored(3)) {
        // At least two events: at least quadratic.
        assert!(4.0 * a <= b * (1.0 + 1e-5) + 1e-30, "{a} {b}");
    }
}

#[test]
fn without_fluorophores_fluorescence_is_exactly_zero() {
    let image = run(&cornell(1.0, 0.0), &settings(4, 5));
    assert!(image.stored(0).iter().any(|&v| v > 0.0));
    for component in 1..4 {
        assert!(image.stored(component).iter().all(|&v| v == 0.0));
    }
}

/// The same things, of a plain material or of tissue whose state lies between the nodes of two parameters: a mean of
/// reflectances and of matrices, weighted by hand here.
fn box_of_tissue(as_states: bool, coat: Option<Coat>) -> Scene {
    let mut scene = lit_box("lamps and sky", "lambertian", 1.0);
    let reflectances = [0.1, 0.3, 0.2, 0.5, 0.3, 0.4];
    let yields = [0.5, 0.1, 0.2, 0.4, 0.3, 0.2];
    // Between nodes 1 and 2 of three at three quarters, between two at one fifth.
    let parameter = |name: &str, nodes: &[f32], value: f32| MappedParameter {
        nodes: nodes.to_vec(),
        ..MappedParameter::without_nodes(name.into(), ScalarTexture::Constant(value))
    };
    let parameters = vec![parameter("blood", &[0.0, 1.0, 3.0], 2.5), parameter("keratin", &[1.0, 2.0], 1.2)];
    let weights = [0.0, 0.0, 0.25 * 0.8, 0.25 * 0.2, 0.75 * 0.8, 0.75 * 0.2];
    let mean = |values: &[f64]| values.iter().zip(weights).map(|(value, weight)| value * weight).sum::<f64>();
    let matrix = |fluorophore: usize, factor: f64| scene.fluorophores[fluorophore].eem.clone().scaled(factor);

    let (base, amounts) = if as_states {
        let grid = StateGrid { parameters, ..StateGrid::default() };
        let base = Lambertian::of_states(reflectances.map(flat).to_vec(), grid);
        let amount = |fluorophore: usize, term: usize| FluorophoreAmount {
            in_tissue: Some(TissueEmission {
                eem: Arc::new(matrix(fluorophore, yields[term])),
                term,
                profiles: None,
            }),
            ..FluorophoreAmount::new(fluorophore, ScalarTexture::Constant(0.8))
        };
        (base, (0..12).map(|number| amount(number / 6, number % 6)).collect())
    } else {
        let amounts = [0, 1].map(|dye| FluorophoreAmount::new(dye, ScalarTexture::Constant(0.8)));
        (Lambertian::uniform(flat(mean(&reflectances))), amounts.to_vec())
    };
    if !as_states {
        // The dyes of the floor keep theirs: take them off, in both scenes.
        let scaled = [0, 1].map(|dye| matrix(dye, mean(&yields)));
        scene.fluorophores.iter_mut().zip(scaled).for_each(|(dye, eem)| dye.eem = eem);
    }
    scene.materials[1].fluorophores.clear();
    let thing = scene.materials.last_mut().unwrap();
    *thing = Material { fluorophores: amounts, ..Material::with_base("thing", base, coat) };
    scene
}

#[test]
fn tissue_between_states_has_their_mean() {
    let gloss = Coat::new(1.4, ScalarTexture::Constant(0.3));
    for coat in [None, Some(gloss)] {
        // Below the vertex from which paths end at random: there the largest reflectance of the states counts.
        let [states, mean] =
            [true, false].map(|as_states| run(&box_of_tissue(as_states, coat.clone()), &settings(16, 3)));
        assert_eq!(states.components.len(), mean.components.len());
        for component in 0..mean.components.len() {
            for band in 0..mean.grid.len() {
                let [a, b] = [&states, &mean].map(|image| band_mean(image, component, band));
                // Lobes of the coat are chosen by the largest reflectance of any state, and how often light that fluoresced
                // excites again by what any state gives back, so the samples differ.
                let differ = coat.is_some() || component % 4 == 3;
                let error = if differ { 5.0 * a.standard_error.hypot(b.standard_error) } else { 0.0 };
                let tolerance = 1e-4 * b.mean.abs() + error;
                assert!((a.mean - b.mean).abs() <= tolerance, "{component} {band}: {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn states_that_make_photons_are_refused() {
    let mut scene = box_of_tissue(true, None);
    scene.check().unwrap();
    scene.materials.last_mut().unwrap().diffuse_mut().unwrap().reflectance[3].spectrum = flat(0.9);
    let message = scene.check().unwrap_err().to_string();
    assert!(message.contains("thing") && message.contains("photons"), "{message}");
    scene.materials.last_mut().unwrap().diffuse_mut().unwrap().reflectance.pop();
    let message = scene.check().unwrap_err().to_string();
    assert!(message.contains("6 states, but 5"), "{message}");
}

/// Next-event estimation with multiple importance sampling against scattered directions alone.
#[test]
fn both_estimators_agree() {
    let scene = cornell(1.0, 1.0);
    let estimates = |estimator: Estimator, samples: u32| -> Vec<ComponentImage> {
        (0..8).map(|seed| run(&scene, &RenderSettings { estimator, seed, ..settings(samples, 6) })).collect()
    };
    let guided = estimates(Estimator::MultipleImportance, 64);
    let blind = estimates(Estimator::ScatteringOnly, 256);
    let bands = scene.grid.len();
    let limit = z_limit(sidak(1e-3, 4 * bands));
    for component in 0..4 {
        for band in 0..bands {
            let means = |images: &[ComponentImage]| {
                MeanEstimate::of(
                    &images.iter().map(|i| band_mean(i, component, band).mean).collect::<Vec<_>>(),
                )
            };
            let (a, b) = (means(&guided), means(&blind));
            let error = a.standard_error.hypot(b.standard_error);
            // Eight runs estimate their own scatter poorly: Student's t with 14 degrees of freedom has a wider tail,
            // which a factor of 1.6 on the normal quantile covers at this significance.
            assert!(
                (a.mean - b.mean).abs() <= 1.6 * limit * error + 1e-12,
                "component {component}, band {band}: {a:?} {b:?}"
            );
        }
    }
}

/// A Lambertian disc of exitance `M = P / (pi r^2)` gives `E = M r^2 / (r^2 + d^2)` on its axis, exactly.
#[test]
fn a_disc_light_illuminates_by_its_view_factor() {
    let (radius, distance, power) = (0.3_f32, 0.5_f32, 2.0);
    let mut scene = patch(WavelengthGrid::uniform(500.0, 600.0, 50.0).unwrap(), 0.5, vec![], &[]);
    scene.camera = camera(Vec3::new(0.0, 0.0, 0.4), Vec3::ZERO, 0.01, 16);
    scene.lights.push(Light {
        name: "disc".into(),
        group: 0,
        spectrum: flat(power),
        crossed_polarizers: false,
        emitter: Emitter::Disc(DiscEmitter {
            center: Vec3::Z * distance,
            normal: Vec3::NEG_Z,
            radius_m: radius,
            exponent: 1.0,
        }),
    });
    let image = run(&scene, &settings(256, 1));
    let (r2, d2) = (f64::from(radius).powi(2), f64::from(distance).powi(2));
    let exitance = power / (PI * r2);
    let expected = 0.5 / PI * exitance * r2 / (r2 + d2);
    let mean = band_mean(&image, 0, 0);
    assert!(
        (mean.mean - expected).abs() < 4.0 * mean.standard_error + 1e-4 * expected,
        "{mean:?} {expected}"
    );
}

#[test]
fn a_material_that_creates_photons_is_refused() {
    let mut scene = patch(WavelengthGrid::default(), 0.9, vec![dye("d", 400.0, 520.0, 0.3)], &[(0, 1.0)]);
    scene.lights.push(distant(flat(1.0), Vec3::NEG_Z));
    match scene.check() {
        Err(SceneError::CreatesPhotons { material, excess }) => {
            assert_eq!(material, "patch");
            let PhotonExcess { wavelength_nm, excess, .. } = excess;
            assert!(
                (excess - 0.2).abs() < 0.05 && (350.0..450.0).contains(&wavelength_nm),
                "{excess} {wavelength_nm}"
            );
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_interrupted_render_keeps_what_it_has() {
    let scene = cornell(1.0, 1.0);
    let stop = AtomicBool::new(false);
    let halfway = |progress: fluorspar::render::RenderProgress| {
        if progress.paths_done * 4 > progress.paths_total {
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
        }
    };
    let image =
        render(&scene, &settings(256, 5), &RenderControl { stop: &stop, progress: &halfway }).unwrap();
    assert!(image.samples_per_pixel < 256 && image.samples_per_pixel > 0);
    assert!(image.data.iter().all(|v| v.is_finite()));
}
