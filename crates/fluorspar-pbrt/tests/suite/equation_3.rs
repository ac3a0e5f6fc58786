//! Eq. 3 on a flat plane: `L_o = (R E_o + c sum_i F_oi E_i) / pi`, in energy and bands of 5 nm.

use std::f64::consts::PI;

use fluorspar::spectral::WavelengthGrid;
use fluorspar_pbrt::PbrtOptions;

use super::support::{load_files, load_text, rendered};

const FIRST: f64 = 365.0;
const BANDS: usize = 69;

/// A matrix with its peak at 1 that breaks off below its diagonal, as those of the authors do.
fn matrix(row: usize, column: usize) -> f64 {
    if row <= column {
        return 0.0;
    }
    let bell = |at: f64, middle: f64, sd: f64| (-0.5 * ((at - middle) / sd).powi(2)).exp();
    let nm = |band: usize| FIRST + 5.0 * band as f64;
    bell(nm(column), 385.0, 40.0) * bell(nm(row), 520.0, 60.0)
}

fn scene(reflectance: f64, concentration: f64, light: &str) -> String {
    let mut values = format!("{FIRST} 5 705");
    for i in 0..BANDS * BANDS {
        values.push_str(&format!(" {:.10}", matrix(i / BANDS, i % BANDS)));
    }
    format!(
        "LookAt 0 0 10  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 10\n\
         Film \"image\" \"integer xresolution\" 3 \"integer yresolution\" 2\nWorldBegin\n{light}\n\
         Material \"matte\" \"rgb Kd\" [ {reflectance} {reflectance} {reflectance} ] \"photolumi fluorescence\" [ {values} ]\n\
         \"float concentration\" {concentration}\n\
         Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 0 2 3 ]\n\
         \"point P\" [ -9 -9 0  9 -9 0  9 9 0  -9 9 0 ]\nWorldEnd\n"
    )
}

#[test]
fn a_plane_with_photolumi_renders_to_the_closed_form() {
    let (concentration, irradiance) = (0.01, 2.0);
    let narrow = WavelengthGrid::uniform(365.0, 705.0, 5.0).unwrap();
    for (reflectance, grid) in
        [(0.0, WavelengthGrid::default()), (0.3, WavelengthGrid::default()), (0.3, narrow)]
    {
        let light = "LightSource \"distant\" \"point from\" [ 0 0 1 ] \"point to\" [ 0 0 0 ] \"spectrum L\" [ 365 2 705 2 ]";
        let options = PbrtOptions { grid, ..PbrtOptions::default() };
        let text = scene(reflectance, concentration, light);
        let study = load_files(&[("s.pbrt", text.as_bytes())], &options).unwrap();
        let image = rendered(&study, 4, 0);
        for (band, radiance) in image.mean.iter().enumerate() {
            let row = ((image.grid.center_nm(band) - FIRST) / 5.0).round();
            let sum = if (0.0..BANDS as f64).contains(&row) {
                (0..BANDS).map(|column| matrix(row as usize, column)).sum::<f64>()
            } else {
                0.0
            };
            let expected = irradiance * (reflectance + concentration * sum) / PI;
            assert!(
                (radiance - expected).abs() <= 1e-3 * expected + 1e-9,
                "{} nm, R {reflectance}: {radiance} instead of {expected}",
                image.grid.center_nm(band)
            );
        }
    }
}

/// Under light from everywhere the irradiance is `pi L`.
#[test]
fn an_even_sky_excites_as_much_as_its_irradiance() {
    let study = load_text(&scene(0.0, 0.01, "LightSource \"infinite\" \"spectrum L\" [ 300 1 800 1 ]"));
    let image = rendered(&study, 256, 0);
    let row = 31; // 520 nm
    let sum = (0..BANDS).map(|column| matrix(row, column)).sum::<f64>();
    // 6 pixels of 256 samples that all find the sky: nothing varies but rounding.
    let found = image.mean[image.grid.bin_of(520.0).unwrap()];
    assert!((found / (0.01 * sum) - 1.0).abs() < 2e-3, "{found} {}", 0.01 * sum);
}

/// The message says how the matrix is converted; one that makes photons is refused with a hint.
#[test]
fn the_conversion_is_said_and_photons_are_counted() {
    let light = "LightSource \"distant\" \"spectrum L\" [ 365 1 705 1 ]";
    let study = load_text(&scene(0.2, 0.01, light));
    assert!(
        study.messages.iter().any(|line| line.contains("energy per band of 5 nm")),
        "{:?}",
        study.messages
    );
    let text = scene(0.2, 1.0, light);
    let files = [("s.pbrt", text.as_bytes())];
    let error = load_files(&files, &PbrtOptions::default()).unwrap_err().to_string();
    assert!(error.contains("matte_0") && error.contains("concentrations of 0.01 and less"), "{error}");
}
