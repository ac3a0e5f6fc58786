//! Traced lenses against closed forms.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::glass::Dispersion;
use super::prescription::{LensPrescription, LensSurface};
use super::sequential_trace::LensRay;
use super::traced_lens::{LensSetting, LensState, TracedLens};

/// Descartes' singlet: free of spherical aberration, f = 50 mm, f/2.
fn descartes() -> LensPrescription {
    let n = 1.5;
    let rear = LensSurface { conic: -n * n, ..LensSurface::spherical(-25.0, 0.0, 18.0) };
    LensPrescription::new(
        "descartes",
        vec![
            LensSurface::stop(2.0, 12.5),
            LensSurface::spherical(0.0, 7.0, 18.0).with_medium(Dispersion::Constant { index: n }),
            rear,
        ],
    )
}

/// A hole before a film: the simplest camera.
fn hole() -> LensPrescription {
    // A plane-parallel plate of index 1 behind it keeps everything else out of the way, and a weak lens far in front
    // of nothing is not needed: the focal length must be positive, so the plate is very slightly curved.
    LensPrescription::new(
        "hole",
        vec![
            LensSurface::stop(0.0, 1.0),
            LensSurface::spherical(1e7, 1e-3, 1e3).with_medium(Dispersion::Constant { index: 2.0 }),
            LensSurface::spherical(0.0, 0.0, 1e3),
        ],
    )
}

#[test]
fn on_the_axis_irradiance_is_that_of_the_cone() {
    // E = pi L sin² u'. Descartes' singlet is stigmatic but not aplanatic, so sin u' is not 1 / 2N; its marginal ray is
    // known in closed form: from the height h on the hyperboloid to its focus 50 mm behind the vertex.
    for f_number in [2.0, 2.8, 5.6, 16.0] {
        let setting = LensSetting { f_number: Some(f_number), ..LensSetting::default() };
        let state = LensState::new(&descartes(), setting).unwrap();
        assert!((state.f_number - f_number).abs() < 1e-9);
        let h = 25.0 / f_number;
        let sag = state.lens.surfaces[2].sag(h * h).unwrap().0;
        let sine2 = h * h / (h * h + (50.0 - sag).powi(2));
        let lens = TracedLens::new(&state, 587.0, 5.0);
        let closed = PI * sine2;
        assert!((state.axial_solid_angle_sr(587.0) / closed - 1.0).abs() < 1e-6);
        // 4096 stratified samples; the outermost few per cent of the ellipse are blocked.
        assert!((lens.solid_angle_sr(0.0) / closed - 1.0).abs() < 0.003, "{f_number}");
        // And the camera equation, exact for a lens that obeys the sine condition, is near: within 1 / (4 N²).
        let equation = PI / (1.0 + 4.0 * f_number * f_number);
        assert!(
            (closed / equation - 1.0).abs() < 0.6 / (f_number * f_number),
            "{f_number} {closed} {equation}"
        );
    }
}

#[test]
fn a_hole_before_a_film_has_the_view_factor_of_a_disc() {
    // Irradiance at the distance x from the axis under a uniform disc of radius r at the distance z (Foote 1915):
    // E = pi L / 2 (1 - (x² + z² - r²) / sqrt((x² + z² + r²)² - 4 r² x²)).
    let mut state = LensState::new(&hole(), LensSetting::default()).unwrap();
    let z = 4.0;
    state.film_mm = z;
    let lens = TracedLens::new(&state, 587.0, 6.0);
    for x in [0.0_f64, 1.0, 2.5, 4.0, 5.9] {
        let (s, r) = (x * x + z * z, 1.0);
        let closed = 0.5 * PI * (1.0 - (s - r) / ((s + r).powi(2) - 4.0 * x * x).sqrt());
        let ours = lens.solid_angle_sr(x);
        assert!((ours / closed - 1.0).abs() < 0.003, "{x}: {ours}, closed form {closed}");
    }
}

#[test]
fn samples_of_the_film_are_paths_of_light() {
    let state = LensState::new(&descartes(), LensSetting::default()).unwrap();
    let lens = TracedLens::new(&state, 587.0, 8.0);
    let film = DVec2::new(3.0, -4.0);
    let mut passed = 0;
    for i in 0..256 {
        let u = [(i % 16) as f32 / 16.0 + 0.03, (i / 16) as f32 / 16.0 + 0.03];
        let Some(sample) = lens.sample(film, u) else { continue };
        passed += 1;
        // Reverse the ray: it arrives where it started.
        let back = LensRay { origin: sample.ray.at_z(-20.0), direction: -sample.ray.direction };
        let arrived = state.trace(587.0).forward(back).unwrap().at_z(state.film_mm);
        assert!((arrived - DVec3::new(3.0, -4.0, state.film_mm)).length() < 1e-7);
        assert!(sample.ray.direction.z < 0.0);
    }
    assert!(passed > 200, "{passed} of 256 samples pass: the bounds are loose");
    assert!(lens.sample(DVec2::new(9.0, 0.0), [0.5; 2]).is_none(), "beyond the prepared film");
}

#[test]
fn chief_rays_give_perspective() {
    // A stop at the front plane face and rays that all cross its middle: tan(object) from the refraction is not needed
    // near the axis, where the height is f tan.
    let state = LensState::new(&descartes(), LensSetting::default()).unwrap();
    let lens = TracedLens::new(&state, 587.0, 8.0);
    for height in [0.01, 0.1] {
        let chief = lens.chief_ray(height).unwrap();
        assert!((50.0 * chief.object_tangent / height - 1.0).abs() < 1e-4, "{height}");
        assert!(chief.object_side.at_z(0.0).length() < 1e-6, "the stop is the first surface");
        let mirrored = lens.chief_ray(-height).unwrap();
        assert!((mirrored.object_tangent - chief.object_tangent).abs() < 1e-9);
    }
}

#[test]
fn focus_follows_newton() {
    let setting = LensSetting { object_distance_mm: Some(200.0), ..LensSetting::default() };
    let near = LensState::new(&descartes(), setting).unwrap();
    let p = near.paraxial;
    // x x' = -f² from the focal points.
    let x = near.object_mm() - p.front_focus_mm;
    let x_image = near.film_mm - p.rear_focus_mm;
    assert!((x * x_image + p.focal_length_mm.powi(2)).abs() < 1e-9);
    assert!((near.magnification() + x_image / p.focal_length_mm).abs() < 1e-12);
    let shifted = LensSetting { film_shift_mm: 0.25, ..setting };
    assert!((LensState::new(&descartes(), shifted).unwrap().film_mm - near.film_mm - 0.25).abs() < 1e-12);
}

#[test]
fn impossible_settings_are_explained() {
    let error = |setting: LensSetting| LensState::new(&descartes(), setting).unwrap_err();
    let fast = error(LensSetting { f_number: Some(1.4), ..LensSetting::default() });
    assert_eq!(fast.place, "f_number");
    assert!(fast.message.contains("the lens is f/2.000 wide open"), "{fast}");
    let near = error(LensSetting { object_distance_mm: Some(20.0), ..LensSetting::default() });
    assert!(near.place == "focus_distance_mm" && near.message.contains("no real image"), "{near}");
    let diverging = LensPrescription::new(
        "diverging",
        vec![
            LensSurface::stop(1.0, 2.0),
            LensSurface::spherical(-30.0, 2.0, 5.0).with_medium(Dispersion::Constant { index: 1.5 }),
            LensSurface::spherical(0.0, 0.0, 5.0),
        ],
    );
    let error = LensState::new(&diverging, LensSetting::default()).unwrap_err();
    assert!(error.message.contains("needs both positive"), "{error}");
}
