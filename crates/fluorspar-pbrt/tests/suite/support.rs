//! Scenes as texts, and their renders.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::render::{RenderControl, render};
use fluorspar::spectral::{Radiance, WavelengthGrid};
use fluorspar_format::PbrtError;
use fluorspar_pbrt::{PbrtOptions, PbrtStudy, load};

/// Writes files into a folder of their own and loads the first.
pub(crate) fn load_files(files: &[(&str, &[u8])], options: &PbrtOptions) -> Result<PbrtStudy, PbrtError> {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }
    load(&folder.path().join(files[0].0), options)
}

/// Loads a scene of one file.
pub(crate) fn load_text(text: &str) -> PbrtStudy {
    load_files(&[("s.pbrt", text.as_bytes())], &PbrtOptions::default()).unwrap()
}

/// What is left out or changed, and may show.
pub(crate) fn remarks(study: &PbrtStudy) -> Vec<&str> {
    study.remarks.iter().filter(|remark| remark.matters).map(|remark| remark.text.as_str()).collect()
}

/// Mean radiance of an image, one value per band, and of each pixel in one band.
pub(crate) struct Rendered {
    pub(crate) mean: Vec<f64>,
    pub(crate) pixels: Vec<f32>,
    pub(crate) grid: WavelengthGrid,
}

/// Renders with few samples; `band` is that of the pixels.
pub(crate) fn rendered(study: &PbrtStudy, samples: u32, band: usize) -> Rendered {
    let mut settings = study.study.render.clone();
    settings.samples_per_pixel = samples;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| () };
    let image = render(&study.study.scene, &settings, &control).unwrap();
    let sum = image.recombine(|_| 1.0);
    let mean: fluorspar::spectral::Spectrum<Radiance> = sum.mean_spectrum();
    Rendered {
        mean: mean.values().to_vec(),
        pixels: sum.data().chunks_exact(sum.bands()).map(|pixel| pixel[band]).collect(),
        grid: image.grid.clone(),
    }
}

/// Whether a file is named among those that were read.
pub(crate) fn has_read(study: &PbrtStudy, name: &str) -> bool {
    study.files.iter().any(|(path, _)| path.ends_with(Path::new(name)))
}
