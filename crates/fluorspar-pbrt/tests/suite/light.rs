//! Where light comes from, and how much of it: closed forms.

use std::f64::consts::PI;

use fluorspar_pbrt::{Emission, PbrtOptions};

use super::support::{load_files, load_text, remarks, rendered};

/// A black room with one small square that emits, right of and above the middle as pbrt's camera sees it.
fn square(before: &str, shape: &str) -> String {
    format!(
        "{before}\nCamera \"perspective\" \"float fov\" 90\nFilm \"image\" \"integer xresolution\" 4 \"integer yresolution\" 4\n\
         WorldBegin\nMaterial \"matte\" \"rgb Kd\" [0 0 0]\n{shape}\n"
    )
}

/// Number of the brightest pixel, rows from the top.
fn brightest(text: &str) -> Option<usize> {
    let image = rendered(&load_text(text), 4, 40);
    let most = image.pixels.iter().copied().fold(0.0, f32::max);
    image.pixels.iter().position(|value| *value == most && most > 0.0)
}

const QUAD: &str =
    "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [2 2 4  4 2 4  4 4 4  2 4 4]";

#[test]
fn images_are_as_pbrts_left_handed_camera_sees_them() {
    let light = "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"bool twosided\" true\n";
    let quad = format!("{light}{QUAD}");
    assert_eq!(brightest(&square("", &quad)), Some(3), "top right");
    assert_eq!(brightest(&square("Scale -1 1 1", &quad)), Some(0), "mirrored");
    assert_eq!(brightest(&square("LookAt 0 0 0  0 0 1  0 1 0", &quad)), Some(3));
    // From behind, right is left.
    assert_eq!(brightest(&square("LookAt 0 0 8  0 0 0  0 1 0", &quad)), Some(0));
}

/// The winding of a mesh decides, `ReverseOrientation` and mirrored frames turn it around, each as in pbrt.
#[test]
fn one_sided_light_leaves_the_front_only() {
    let light = "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\n";
    // (b - a) x (c - a) points to +z, away from the camera.
    assert_eq!(brightest(&square("", &format!("{light}{QUAD}"))), None);
    assert_eq!(brightest(&square("", &format!("{light}ReverseOrientation {QUAD}"))), Some(3));
    let mirrored = "Scale -1 1 1 Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-2 2 4  -4 2 4  -4 4 4  -2 4 4]";
    assert_eq!(brightest(&square("", &format!("{light}{mirrored}"))), Some(3));
    // Given normals decide instead.
    let normals = "\"normal N\" [0 0 -1 0 0 -1 0 0 -1 0 0 -1]";
    assert_eq!(brightest(&square("", &format!("{light}{QUAD}{normals}"))), Some(3));
    assert_eq!(brightest(&square("", &format!("{light}ReverseOrientation {QUAD}{normals}"))), None);
    let away = "\"normal N\" [0 0 1 0 0 1 0 0 1 0 0 1]";
    for version in ["", "ColorSpace \"srgb\" "] {
        assert_eq!(brightest(&square(version, &format!("{light}{QUAD}{away}"))), None);
        assert_eq!(
            brightest(&square(version, &format!("{light}ReverseOrientation {QUAD}{away}"))),
            Some(3),
            "{version}"
        );
    }
    // Discs face +z, spheres outward.
    let disk = "Translate 3 3 4 Shape \"disk\" \"float radius\" 1";
    assert_eq!(brightest(&square("", &format!("{light}{disk}"))), None);
    assert_eq!(brightest(&square("", &format!("{light}ReverseOrientation {disk}"))), Some(3));
    assert_eq!(
        brightest(&square("", &format!("{light}Translate 3 3 4 Shape \"sphere\" \"float radius\" 1"))),
        Some(3)
    );
}

/// A plane of reflectance 1/2 below a light; middle of the image, all bands.
fn plane(light: &str, options: &PbrtOptions, reflectance: &str) -> Vec<f64> {
    let text = format!(
        "LookAt 0 0 1  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 0.1\n\
         Film \"image\" \"integer xresolution\" 1 \"integer yresolution\" 1\nWorldBegin\n{reflectance}\n\
         Shape \"disk\" \"float radius\" 100\n{light}\n"
    );
    let study = load_files(&[("s.pbrt", text.as_bytes())], options).unwrap();
    rendered(&study, 64, 0).mean
}

const HALF: &str = "Material \"matte\" \"rgb Kd\" [0.5 0.5 0.5]";
const HALF_V4: &str = "Material \"diffuse\" \"rgb reflectance\" [0.5 0.5 0.5]";

#[test]
fn intensities_are_absolute_and_lengths_have_units() {
    let close = |found: &[f64], expected: f64| {
        assert!((found[40] / expected - 1.0).abs() < 1e-3, "{} {expected}", found[40]);
    };
    let meters = PbrtOptions::default();
    // E = I / r²; I of 3 W/(sr nm).
    let point = "LightSource \"point\" \"point from\" [0 0 2] \"rgb I\" [3 3 3]";
    close(&plane(point, &meters, HALF), 0.5 / PI * 3.0 / 4.0);
    let centimeters = PbrtOptions { unit_m: 0.01, ..PbrtOptions::default() };
    close(&plane(point, &centimeters, HALF), 0.5 / PI * 3.0 / 4e-4);
    let scaled = "LightSource \"distant\" \"point from\" [0 0 1] \"point to\" [0 0 0] \"rgb L\" [3 3 3] \"rgb scale\" [2 2 2]";
    close(&plane(scaled, &meters, HALF), 0.5 / PI * 6.0);
    close(&plane("LightSource \"infinite\" \"rgb L\" [2 2 2]", &meters, HALF), 0.5 * 2.0);
    // A disc of radius r at a height h gives E = pi L r² / (r² + h²) below its middle.
    let disk = "AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"bool twosided\" true Translate 0 0 3 \
                Shape \"disk\" \"float radius\" 1.5 AttributeEnd";
    let found = plane(disk, &meters, HALF)[40];
    // The disc also sees itself reflected: a small part; its own reflectance is 1/2, and 64 samples leave noise.
    let expected = 0.5 * 2.25 / (2.25 + 9.0);
    assert!((found / expected - 1.0).abs() < 0.1, "{found} {expected}");
    // The spot has the intensity of its cone on the axis.
    let spot = "LightSource \"spot\" \"point from\" [0 0 2] \"point to\" [0 0 0] \"rgb I\" [3 3 3]";
    close(&plane(spot, &meters, HALF), 0.5 / PI * 3.0 / 4.0);
}

/// Version 4 counts in nits, lumens and lux; spectra that are given stay absolute unless asked for.
#[test]
fn version_4_scales_lights_photometrically() {
    use fluorspar::spectral::{StandardObserver, WavelengthGrid};
    let options =
        PbrtOptions { grid: WavelengthGrid::uniform(360.0, 780.0, 5.0).unwrap(), ..PbrtOptions::default() };
    let luminance = |light: &str, options: &PbrtOptions| {
        let values: Vec<f32> = plane(light, options, HALF_V4).iter().map(|value| *value as f32).collect();
        StandardObserver::new(&options.grid).xyz(&values)[1]
    };
    let close =
        |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
    let distant = "LightSource \"distant\" \"point from\" [0 0 1] \"point to\" [0 0 0]";
    close(luminance(&format!("{distant} \"float illuminance\" 100"), &options), 0.5 * 100.0 / PI);
    close(luminance(&format!("{distant} \"blackbody L\" 4000 \"float scale\" 7"), &options), 0.5 * 7.0 / PI);
    close(luminance(&format!("{distant} \"rgb L\" [2 2 2]"), &options), 0.5 * 2.0 / PI);
    let point = "LightSource \"point\" \"point3 from\" [0 0 2] \"float power\" 50";
    close(luminance(point, &options), 0.5 / PI * 50.0 / (4.0 * PI * 4.0));
    close(luminance("LightSource \"infinite\" \"float illuminance\" 30", &options), 0.5 * 30.0 / PI);
    let spectrum = format!("{distant} \"spectrum L\" [300 3 900 3]");
    let absolute = plane(&spectrum, &options, HALF_V4)[40];
    close(absolute, 0.5 * 3.0 / PI);
    let photometric = PbrtOptions { emission: Emission::Photometric, ..options };
    close(luminance(&spectrum, &photometric), 0.5 / PI);
}

/// An image of one bright spot: it is found where pbrt puts it, in either map.
#[test]
fn images_of_the_sky_are_turned_as_in_pbrt() {
    // Gray 16 x 16 or 32 x 16 PFM, rows from the bottom.
    let pfm = |width: usize, height: usize, bright: (usize, usize)| {
        let mut bytes = format!("Pf\n{width} {height}\n-1\n").into_bytes();
        for row in (0..height).rev() {
            for col in 0..width {
                let value = if (col, row) == bright { 1.0_f32 } else { 0.0 };
                bytes.extend(value.to_le_bytes());
            }
        }
        bytes
    };
    let seen = |text: &str, image: &[u8]| {
        let study =
            load_files(&[("s.pbrt", text.as_bytes()), ("sky.pfm", image)], &PbrtOptions::default()).unwrap();
        let image = rendered(&study, 16, 40);
        let most = image.pixels.iter().copied().fold(0.0, f32::max);
        image.pixels.iter().position(|value| *value == most && most > 0.0)
    };
    let scene = |class: &str, light: &str| {
        format!(
            "Camera \"perspective\" \"float fov\" 90\nFilm \"{class}\" \"integer xresolution\" 2 \"integer yresolution\" 2\n\
             WorldBegin\n{light}\nTranslate 0 -50 0 Shape \"sphere\" \"float radius\" 0.1\n"
        )
    };
    // Version 3: u is the angle about z from x to y, v that from z: (1, 1, 2) is at u 1/8, v 0.196: the top right.
    let v3 = scene("image", "LightSource \"infinite\" \"string mapname\" \"sky.pfm\"");
    assert_eq!(seen(&v3, &pfm(32, 16, (4, 3))), Some(1));
    assert_eq!(seen(&v3, &pfm(32, 16, (11, 3))), Some(0));
    // Version 4: z in the middle, x to the right, y toward the last row.
    let v4 = scene("rgb", "LightSource \"infinite\" \"string filename\" \"sky.pfm\"");
    assert_eq!(seen(&v4, &pfm(16, 16, (9, 9))), Some(1));
    assert_eq!(seen(&v4, &pfm(16, 16, (6, 9))), Some(0));
    assert_eq!(seen(&v4, &pfm(16, 16, (9, 6))), Some(3));
}

#[test]
fn lights_without_counterpart_are_named() {
    let text = square(
        "",
        "LightSource \"goniometric\" \"string mapname\" \"a.png\" LightSource \"point\" \"float from\" 1 \"float foo\" 1\n\
         Shape \"sphere\"",
    );
    let study = load_text(&text);
    let found = remarks(&study);
    assert!(found.contains(&"LightSource \"goniometric\" has no counterpart and is left out"), "{found:?}");
    assert!(
        found.contains(&"LightSource \"point\": \"foo\" has no counterpart and is left out"),
        "{found:?}"
    );
}

/// On the axis E = I / r² = 100 / 25, however narrow; at an angle the intensity of pbrt's `Falloff`, cos⁴ over r² of a plane besides.
#[test]
fn spots_are_flat_cones_with_the_edge_of_their_version() {
    let spot = |cone: f64, delta: f64, to: f64| {
        format!(
            "LightSource \"spot\" \"spectrum I\" [300 100 900 100] \"point from\" [0 0 5] \"point to\" [{to} 0 0] \
             \"float coneangle\" {cone} \"float conedeltaangle\" {delta}"
        )
    };
    let options = PbrtOptions::default();
    let full = 0.5 / PI * 4.0;
    // (cone, delta, angle of the axis from that to the middle of the image)
    for (cone, delta, off_axis) in [
        (2.0, 1.0, 0.0),
        (0.1, 0.05, 0.0),
        (5.0, 1.0, 3.9),
        (5.0, 1.0, 4.5),
        (30.0, 5.0, 27.0),
        (5.0, 1.0, 5.1),
    ] {
        let to = 5.0 * f64::to_radians(off_axis).tan();
        let cosine = |degrees: f64| degrees.to_radians().cos();
        let t = (cosine(off_axis) - cosine(cone)) / (cosine(cone - delta) - cosine(cone));
        let t = t.clamp(0.0, 1.0);
        for (material, falloff) in [(HALF, t.powi(4)), (HALF_V4, t * t * (3.0 - 2.0 * t))] {
            let light = spot(cone, delta, to);
            let found = plane(&light, &options, material)[40];
            let wrong = (found - falloff * full).abs();
            assert!(wrong < 2e-3 * full, "{cone} {delta} {off_axis} {material}: {found} {}", falloff * full);
        }
    }
    let study = load_text(&format!("{}\nShape \"sphere\"", spot(2.0, 1.0, 0.0)));
    assert!(remarks(&study).is_empty(), "{:?}", remarks(&study));
}

/// A spot of 5/1 degrees on a white wall seen within 2.5 degrees is flat: radiance 1/pi at the distance 1 for an intensity of 1, times
/// cos³, .3181 on average.
#[test]
fn a_narrow_spot_is_flat_over_its_cone() {
    let text = "LookAt 0 0 1  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 5\n\
                Film \"image\" \"integer xresolution\" 16 \"integer yresolution\" 16\nWorldBegin\n\
                Material \"matte\" \"rgb Kd\" [1 1 1]\nShape \"disk\" \"float radius\" 10\n\
                LightSource \"spot\" \"spectrum I\" [300 1 900 1] \"point from\" [0 0 1] \"point to\" [0 0 0] \
                \"float coneangle\" 5 \"float conedeltaangle\" 1\n";
    let study = load_files(&[("s.pbrt", text.as_bytes())], &PbrtOptions::default()).unwrap();
    let found = rendered(&study, 16, 0).mean[40];
    // E of a plane at 1 m is I cos³; its mean over the square of +-2.5 degrees, by the midpoint rule
    let side = 2.5_f64.to_radians().tan();
    let steps = 200;
    let at = |k: usize| side * (2.0 * (k as f64 + 0.5) / f64::from(steps as u32) - 1.0);
    let sum: f64 =
        (0..steps * steps).map(|k| (1.0 + at(k % steps).powi(2) + at(k / steps).powi(2)).powf(-1.5)).sum();
    let expected = sum / (steps * steps) as f64 / PI;
    assert!((expected - 0.3177).abs() < 1e-3, "{expected}");
    assert!((found / expected - 1.0).abs() < 2e-3, "{found} {expected}");
}
