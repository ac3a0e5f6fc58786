//! The files of a view: frames, masks and truth.

use std::path::Path;

use fluorspar::analysis::SceneOnSensor;
use fluorspar::image::{ComponentFactors, LightPath, View};
use fluorspar::pipeline::{
    CapturePlanes, CapturedFrame, ColorRendering, PipelineError, SeenComponents, capture_from_planes,
    check_captures, frame_radiance, on_sensor, preview, target_labels,
};
use fluorspar::study::{Capture, Study, Target};
use fluorspar_format::{
    CocoMask, ExrCompression, ExrOptions, FormatError, Provenance, write_indexed_png, write_map_npy,
    write_rgb_png, write_sensor_tiff, write_spectral_exr,
};
use serde::{Deserialize, Serialize};

use super::categories::Categories;
use crate::Result;
use crate::cohort::{CohortWork, ExaminedView};

/// Folders of a data set.
pub(super) const FOLDERS: [&str; 4] = ["images", "masks", "truth", "spectra"];

/// Most that a view takes on a disk, bytes: raw frames and pictures, masks, and maps of numbers.
pub(super) fn room_of_view(study: &Study, has_spectra: bool) -> u64 {
    let Some(sensor) = &study.camera.sensor else { return 0 };
    let (model, camera) = (sensor.model(), &study.scene.camera);
    let (pixels, captures) = ((model.columns * model.rows) as u64, study.captures.len() as u64);
    let maps = 4 * (7 + study.scene.fluorophores.len() as u64);
    let bands = if has_spectra { study.scene.grid.len() as u64 } else { 0 };
    let spectra = 4 * captures * bands * (camera.width * camera.height) as u64;
    pixels * (6 * captures + maps + 2) + spectra + (256 << 10) * (1 + captures)
}

/// Writes the files of views.
pub(super) struct ViewWriter<'a> {
    pub(super) work: &'a CohortWork,
    pub(super) categories: &'a Categories,
    pub(super) has_spectra: bool,
}

/// What was written of a view.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct WrittenView {
    /// Start of the names of its files.
    pub(super) stem: String,
    /// Every file below the folder, but for descriptions of raw frames.
    files: Vec<String>,
    pub(super) size_px: [usize; 2],
    pub(super) camera: Option<View>,
    /// Lesions that the person has.
    pub(super) lesions: Vec<String>,
    /// Where the electrons of each map come from.
    pub(super) electrons: Vec<String>,
    /// True share of the porphyrin in the first part of the view.
    pub(super) share: Option<f64>,
    /// Lesions and parts that are seen, by their numbers.
    pub(super) masks: Vec<(u8, CocoMask)>,
    pub(super) samples_per_pixel: u32,
}

impl WrittenView {
    /// Whether all files are there, spectra among them where they are wanted.
    pub(super) fn is_complete(&self, folder: &Path, wants_spectra: bool) -> bool {
        let has_spectra = self.files.iter().any(|file| file.starts_with("spectra/"));
        (has_spectra || !wants_spectra) && self.files.iter().all(|file| folder.join(file).is_file())
    }

    /// Whether there is a file of this name.
    pub(super) fn has(&self, file: &str) -> bool {
        self.files.iter().any(|known| known == file)
    }
}

/// Whether a capture has light: only such are images.
pub(super) fn is_lit(capture: &Capture) -> bool {
    capture.frame.lights.values().any(|drive| *drive > 0.0)
}

/// A view on its way to the disk.
struct ViewFiles<'a> {
    folder: &'a Path,
    stem: String,
    size_px: [usize; 2],
    files: Vec<String>,
}

impl ViewFiles<'_> {
    /// Writes a file of the view, `FOLDER/STEM_NAME`.
    fn put(
        &mut self,
        folder: &str,
        name: &str,
        write: impl FnOnce(&Path) -> Result<(), FormatError>,
    ) -> Result<()> {
        let file = format!("{folder}/{}_{name}", self.stem);
        write(&self.folder.join(&file))?;
        self.files.push(file);
        Ok(())
    }

    /// Writes a map with so many numbers before and after rows and columns.
    fn map(&mut self, name: &str, [before, after]: [Option<usize>; 2], values: &[f32]) -> Result<()> {
        let [width, height] = self.size_px;
        let shape: Vec<usize> = before.into_iter().chain([height, width]).chain(after).collect();
        self.put("truth", &format!("{name}.npy"), |path| write_map_npy(path, &shape, values))
    }
}

impl ViewWriter<'_> {
    /// Captures a view and writes its files.
    pub(super) fn write(&self, examined: &ExaminedView<'_>) -> Result<WrittenView> {
        let (study, image) = (&examined.experiment.study, examined.components);
        let failed = |error: PipelineError| examined.failed(error);
        check_captures(study, image).map_err(failed)?;
        let planes = CapturePlanes::new(study, image).map_err(failed)?;
        let factors = ComponentFactors::ones(image.components.len());
        let seen = SeenComponents { image, planes: &planes, captures: &study.captures, factors: &factors };
        let frames = capture_from_planes(study, &seen).map_err(failed)?;
        let missing = || failed(PipelineError::Missing("sensor"));
        let (first, scene) = frames.first().zip(on_sensor(study, image)).ok_or_else(missing)?;
        let size_px = [first.developed.width, first.developed.height];
        let stem = format!("{:06}_{}", examined.person, examined.view.name);
        let mut files = ViewFiles { folder: &self.work.folder, stem, size_px, files: Vec::new() };
        self.write_frames(examined, &frames, &mut files)?;

        // What lies behind each pixel
        let [width, height] = size_px;
        let behind: Vec<Option<usize>> = (0..width * height)
            .map(|pixel| scene.scene_pixel(pixel / width, pixel % width, width, height))
            .collect();
        let held: Vec<String> = self.held(examined.person).collect();
        let (lesions, parts) = self.labels(study, &held, scene, &behind, &files).map_err(failed)?;
        write_geometry(scene, &behind, &mut files)?;
        let palette = self.categories.palette();
        let mut masks = Vec::new();
        for (name, labels) in [("lesions", &lesions), ("parts", &parts)] {
            if name == "parts" || !self.categories.lesions.is_empty() {
                files.put("masks", &format!("{name}.png"), |path| {
                    write_indexed_png(path, width, height, labels, &palette)
                })?;
            }
            let mut seen: Vec<u8> = labels.iter().copied().filter(|label| *label > 0).collect();
            seen.sort_unstable();
            seen.dedup();
            let mask = |label| Some((label, CocoMask::new(width, height, |pixel| labels[pixel] == label)?));
            masks.extend(seen.into_iter().filter_map(mask));
        }

        let main = self.categories.part(examined.view.parts.first().copied().unwrap_or_default());
        let is_of_main = |pixel: usize| parts[pixel] == main;
        let (electrons, share) = write_electrons(study, &seen, &frames, &behind, is_of_main, &mut files)?;
        let ViewFiles { stem, files, .. } = files;
        let (camera, samples_per_pixel) = (image.features.view, image.samples_per_pixel);
        Ok(WrittenView {
            stem,
            files,
            size_px,
            camera,
            lesions: held,
            electrons,
            share,
            masks,
            samples_per_pixel,
        })
    }

    /// Names of the lesions that a person has.
    fn held(&self, person: u32) -> impl Iterator<Item = String> {
        let cohort = &self.work.cohort;
        let lesions = cohort.lesions().iter().filter(move |lesion| cohort.has_lesion(person, lesion));
        lesions.map(|lesion| lesion.name.clone())
    }

    /// Raw frames, pictures and spectra.
    fn write_frames(
        &self,
        examined: &ExaminedView<'_>,
        frames: &[CapturedFrame],
        files: &mut ViewFiles<'_>,
    ) -> Result<()> {
        let (study, record) = (&examined.experiment.study, &examined.experiment.record);
        let (toml, samples) = (&record.resolved_toml, examined.components.samples_per_pixel);
        let provenance = Provenance::new(&self.work.source.text, toml.clone(), study.render.seed, samples);
        for (frame, capture) in frames.iter().zip(&study.captures) {
            for raw in std::iter::once(&frame.raw).chain(&frame.bracket) {
                // The experiment is in the file of the data set: once for all frames
                let name = format!("{}.tiff", raw.label);
                files.put("images", &name, |path| write_sensor_tiff(path, raw, None))?;
                // Its description was written with it
                files.put("images", &format!("{name}.json"), |_| Ok(()))?;
            }
            if !is_lit(capture) {
                continue;
            }
            let label = &capture.frame.label;
            let picture = preview(&frame.developed, &ColorRendering::of_frame(study, capture));
            files.put("images", &format!("{label}.png"), |path| {
                write_rgb_png(path, picture.width, picture.height, &picture.rgb)
            })?;
            if self.has_spectra {
                let radiance = frame_radiance(&capture.frame, examined.components);
                let options = ExrOptions {
                    compression: ExrCompression::Rounded24,
                    provenance: Some(&provenance),
                    ..Default::default()
                };
                files.put("spectra", &format!("{label}.exr"), |path| {
                    write_spectral_exr(path, &radiance, &options)
                })?;
            }
        }
        Ok(())
    }

    /// Numbers of the lesion and of the part that each pixel sees.
    fn labels(
        &self,
        study: &Study,
        held: &[String],
        scene: SceneOnSensor<'_>,
        behind: &[Option<usize>],
        files: &ViewFiles<'_>,
    ) -> Result<(Vec<u8>, Vec<u8>), PipelineError> {
        let targets = study.analysis.iter().flat_map(|plan| &plan.targets);
        let targets: Vec<Target> = targets.filter(|target| held.contains(&target.name)).cloned().collect();
        let seen = target_labels(&targets, files.size_px, scene)?;
        let number = |name: &String| self.categories.lesion(name);
        let of_targets: Vec<u8> = std::iter::once(0).chain(seen.names.iter().map(number)).collect();
        let lesions = seen.labels.iter().map(|label| of_targets[usize::from(*label)]).collect();
        let features = &scene.components.features;
        let names = features.part_names.iter().map(|name| self.categories.part(name));
        let of_parts: Vec<u8> = std::iter::once(0).chain(names).collect();
        let part =
            |pixel: &Option<usize>| pixel.map_or(0, |pixel| of_parts[usize::from(features.part[pixel])]);
        Ok((lesions, behind.iter().map(part).collect()))
    }
}

/// Distances, and normals in the frame of the camera: right, down, forward.
fn write_geometry(
    scene: SceneOnSensor<'_>,
    behind: &[Option<usize>],
    files: &mut ViewFiles<'_>,
) -> Result<()> {
    let features = &scene.components.features;
    let is_seen = |pixel: &usize| features.part[*pixel] > 0;
    let depth = |pixel: &Option<usize>| pixel.filter(is_seen).map_or(0.0, |pixel| features.depth_m[pixel]);
    files.map("depth_m", [None; 2], &behind.iter().map(depth).collect::<Vec<f32>>())?;
    let Some(View { forward: f, right: r, .. }) = features.view else { return Ok(()) };
    let down = [f[1] * r[2] - f[2] * r[1], f[2] * r[0] - f[0] * r[2], f[0] * r[1] - f[1] * r[0]];
    let along = |normal: [f32; 3], axis: [f32; 3]| normal.iter().zip(axis).map(|(n, a)| n * a).sum::<f32>();
    let normal = |pixel: &Option<usize>| {
        let normal = pixel.map_or([0.0; 3], |pixel| features.normal[pixel]);
        [r, down, f].map(|axis| along(normal, axis))
    };
    files.map("normal", [None, Some(3)], &behind.iter().flat_map(normal).collect::<Vec<f32>>())
}

/// Electrons of the analyzed capture by where their light comes from, and the share of the porphyrin among those that fluoresced once.
/// Gives the names of the maps, and the share of some pixels together.
fn write_electrons(
    study: &Study,
    seen: &SeenComponents<'_>,
    frames: &[CapturedFrame],
    behind: &[Option<usize>],
    is_wanted: impl Fn(usize) -> bool,
    files: &mut ViewFiles<'_>,
) -> Result<(Vec<String>, Option<f64>)> {
    let frame = study.analyzed_capture().zip(study.camera.sensor.as_ref());
    let Some((capture, sensor)) = frame else { return Ok((Vec::new(), None)) };
    let exposure = frames.iter().find(|frame| frame.raw.label == capture.frame.label);
    let light_s = exposure.map_or(0.0, |frame| sensor.frame_light_s(frame.raw.exposure_s));
    let mut lights: Vec<&LightPath> = Vec::new();
    for component in &seen.image.components {
        if !lights.contains(&&component.light) {
            lights.push(&component.light);
        }
    }
    let channels = sensor.qe().channels().len();
    let map = |light: &&LightPath| -> Vec<f32> {
        let rates = seen.film_rates(capture, |component| {
            if component.light == **light { capture.frame.drive(&component.light_group) } else { 0.0 }
        });
        let pixels = rates.width * rates.height;
        let sum =
            |pixel: usize| (0..channels).map(|n| f64::from(rates.data[n * pixels + pixel])).sum::<f64>();
        behind.iter().map(|pixel| pixel.map_or(0.0, |pixel| (light_s * sum(pixel)) as f32)).collect()
    };
    let maps: Vec<Vec<f32>> = lights.iter().map(map).collect();
    files.map("electrons", [Some(lights.len()), None], &maps.concat())?;
    let name = |light: &&LightPath| match light {
        LightPath::Reflected => "reflected".to_owned(),
        LightPath::Fluorescence(name) => name.clone(),
        LightPath::MultipleFluorescence => "multiple".to_owned(),
    };
    let names = lights.iter().map(name).collect();
    let Some(wanted) = study.analysis.as_ref().and_then(|plan| plan.porphyrin.as_ref()) else {
        return Ok((names, None));
    };
    // Electrons of the porphyrin, and of all fluorophores
    let mut sums = vec![[0.0_f64; 2]; behind.len()];
    for (light, map) in lights.iter().zip(&maps) {
        let LightPath::Fluorescence(name) = light else { continue };
        for (sums, value) in sums.iter_mut().zip(map) {
            sums[1] += f64::from(*value);
            sums[0] += if name == wanted { f64::from(*value) } else { 0.0 };
        }
    }
    // The noise of few paths may leave less than no light
    let share = |[of, all]: [f64; 2]| if of >= 0.0 && all > 0.0 && of <= all { of / all } else { f64::NAN };
    let values: Vec<f32> = sums.iter().map(|sums| share(*sums) as f32).collect();
    files.map("share", [None; 2], &values)?;
    let of_wanted = sums.iter().enumerate().filter(|(pixel, _)| is_wanted(*pixel));
    let together = of_wanted.fold([0.0; 2], |[of, all], (_, sums)| [of + sums[0], all + sums[1]]);
    Ok((names, Some(share(together)).filter(|share| share.is_finite())))
}
