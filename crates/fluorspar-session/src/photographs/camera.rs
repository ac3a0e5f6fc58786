//! Photographs of a camera that are looked at and drawn upon one by one, before a table of them is analyzed.

use std::path::{Path, PathBuf};

use fluorspar::analysis::{sensor_chromaticity, surrounding_share};
use fluorspar::digest::sha256_hex;
use fluorspar::image::ChannelImage;
use fluorspar::pipeline::{
    AnalyzedFrame, Calibration, CapturedFrame, ColorRendering, KnownTarget, RawExposures, develop_frames,
    subtract_what_is_given, target_rates,
};
use fluorspar::sensor::SensorModel;
use fluorspar::spectral::Curve;
use fluorspar::study::Study;
use fluorspar_experiment::schema::{AnalysisSection, SensorRegionSection};
use fluorspar_experiment::{Experiment, Warning, preset, resolve, resolve_captures};

use super::estimate::site_of_region;
use super::known;
use super::pairing::{KnownCapture, capture_of, person_told};
use crate::analyze::{Regions, analyze_frames, read_raw};
use crate::region_option::region_options;
use crate::values::quoted;
use crate::{AnalyzeOptions, Error, ExperimentSource, Job, Result};

/// The camera and the lights that photographs are taken for: an experiment without its surfaces.
pub struct PhotographCamera {
    name: String,
    parsed: Experiment,
    study: Study,
}

/// The camera, lights and captures of an experiment, without its surfaces where these are not needed.
///
/// # Errors
/// An experiment that can't be resolved, or has no sensor, lens or capture.
pub(crate) fn camera_study(source: &ExperimentSource, parsed: &Experiment) -> Result<Study> {
    let concentrations: Vec<&str> = parsed.file.concentration.keys().map(String::as_str).collect();
    let study = match resolve_captures(parsed, parsed, &concentrations)? {
        Some(found) => found.into_resolved(parsed).study,
        None => resolve(parsed)?.study,
    };
    if study.captures.is_empty() || study.camera.sensor.is_none() || study.camera.lens.is_none() {
        let why =
            "frames of a camera need an experiment with lens, sensor and captures; give one that has them";
        return Err(Error::Input(format!("{}: {why}", source.name)));
    }
    Ok(study)
}

/// A digest of what decides the numbers of frames beside what these show: lights, camera, captures and analysis, but for how many pixels
/// share the sensor and where the analyzed region lies.
///
/// # Errors
/// An experiment that can't be resolved, or has no sensor, lens or capture.
pub fn camera_digest(source: &ExperimentSource, parsed: &Experiment) -> Result<String> {
    let Study { scene, camera, captures, develop, motion, .. } = camera_study(source, parsed)?;
    let sensor = camera.sensor.as_ref().map(|sensor| {
        let model = sensor.model();
        // Pixels of another size have the same signal where they collect as much
        let collects_um2 = format!("{:.5e}", model.fill_factor * model.pixel_size_um.powi(2));
        let of_any_size =
            SensorModel { columns: 1, rows: 1, pixel_size_um: 1.0, fill_factor: 1.0, ..model.clone() };
        (of_any_size, collects_um2, sensor.qe())
    });
    let analysis = parsed.file.analysis.clone().map(|section| AnalysisSection {
        place: SensorRegionSection::default(),
        inset_px: 0,
        compared_px: None,
        region: Vec::new(),
        bulk: None,
        tissue: None,
        ..section
    });
    let filters = (&camera.view_filter.stack, &camera.view_filter.transmittance);
    let lights = (&scene.light_groups, &scene.lights);
    let frames = (captures, develop, motion);
    let all = (env!("CARGO_PKG_VERSION"), lights, &camera.lens, filters, sensor, frames, analysis);
    Ok(sha256_hex([format!("{all:?}")]))
}

/// How much of a frame may be skin around the mouth before it is taken for a face.
const MOST_SKIN: f64 = 0.25;

/// Melanin of skin from the fairest to the darkest: its optical depth at 500 nm, there and back.
const MELANIN_DEPTHS: [f64; 8] = [0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 2.5, 3.0];

/// Reflectances that skin is told from: those within a mouth.
const MOUTH: [&str; 13] = [
    "tooth_incisor",
    "tooth_neck",
    "gingiva",
    "palate",
    "cheek",
    "tongue_dorsum",
    "tongue_ventral",
    "lip",
    "soft_palate",
    "floor_of_mouth",
    "mucosa_red",
    "mucosa_pale",
    "fungiform_papilla",
];

/// What is said of a frame that shows a face: much of it has the color that skin has under the lights of its capture. `None` where these do not
/// pass the viewing filter.
pub(super) fn face_warning(study: &Study, path: &Path, frame: &ChannelImage) -> Option<Warning> {
    let capture = study.capture(&frame.label)?;
    let names = &study.camera.sensor.as_ref()?.mosaic().channels;
    let rates = |reflectance: Curve, has_filters: bool| {
        let target = KnownTarget::Tile { reflectance, fluorophore: None };
        let rates = target_rates(study, capture, &target, has_filters)?;
        let of = |name: &str| names.iter().position(|channel| channel == name).map(|channel| rates[channel]);
        Some([of("R")?, of("G")?, of("B")?])
    };
    let sum = |has_filters| Some(rates(Curve::constant(1.0), has_filters)?.iter().sum::<f64>());
    // What passes a filter that blocks the light is fluorescence
    if sum(true)? < 0.01 * sum(false)? {
        return None;
    }
    let color = |reflectance: Curve| sensor_chromaticity(rates(reflectance, true)?);
    let skin = preset::reflectance("skin").ok()?.model;
    let skin_of = |depth: &f64| skin.with_melanin_depth(*depth).map(|model| Curve::from_model(&model));
    let skins: Vec<[f64; 2]> = MELANIN_DEPTHS.iter().filter_map(skin_of).filter_map(color).collect();
    let of_mouth = |name: &&str| preset::reflectance(name).ok().map(|preset| preset.curve());
    let others: Vec<[f64; 2]> = MOUTH.iter().filter_map(of_mouth).filter_map(color).collect();
    let share = surrounding_share(frame, &skins, &others)?;
    (share > MOST_SKIN).then(|| {
        Warning::explained(
            format!("{}: skin around the mouth takes {:.0} % of the frame", path.display(), 100.0 * share),
            "A person may be known again by a face: cut the frame before it leaves, or leave it out",
        )
    })
}

impl PhotographCamera {
    /// What is said of a frame of a capture that shows a face.
    ///
    /// # Errors
    /// Those of [`Self::developed`].
    pub fn face_warning(&self, file: &Path, capture: &str) -> Result<Option<Warning>> {
        let (frame, _) = self.developed(file, capture)?;
        Ok(face_warning(&self.study, file, &frame.developed))
    }

    /// Opens an experiment by file name or built-in name.
    ///
    /// # Errors
    /// An experiment that can't be read, or has no sensor, lens or capture.
    pub fn open(experiment: &str) -> Result<Self> {
        let source = ExperimentSource::find(Some(experiment))?;
        let parsed = source.parse(&[])?;
        let study = camera_study(&source, &parsed)?;
        Ok(Self { name: experiment.into(), parsed, study })
    }

    /// Names of its captures.
    pub fn captures(&self) -> Vec<&str> {
        self.study.captures.iter().map(|capture| capture.frame.label.as_str()).collect()
    }

    /// The capture that is analyzed, if any is.
    pub fn analyzed(&self) -> Option<&str> {
        self.parsed.file.analysis.as_ref().map(|section| section.frame.as_str())
    }

    /// Parts that its analysis, regions and objects name: what a drawn region may show.
    pub fn parts(&self) -> Vec<&str> {
        let file = &self.parsed.file;
        let of_analysis = file.analysis.iter().flat_map(|section| {
            let of_regions = section.region.iter().flat_map(|region| &region.place.parts);
            section.place.parts.iter().chain(of_regions)
        });
        let of_objects = file.object.iter().map(|object| &object.name);
        let mut parts: Vec<&str> = Vec::new();
        for part in of_analysis.chain(of_objects) {
            if !parts.contains(&part.as_str()) {
                parts.push(part);
            }
        }
        parts
    }

    /// Capture, person and visit of a frame: by the folders between `below` and it, by its name or, of the capture, what it tells of itself;
    /// the analyzed capture and no person where nothing tells one, so that frames of one visit stay together.
    pub fn told_by(&self, file: &Path, below: &Path) -> [String; 3] {
        let captures: Vec<KnownCapture> = self.parsed.file.capture.iter().map(known).collect();
        let capture = capture_of(file, &captures).ok();
        let capture = capture.or_else(|| self.analyzed().map(str::to_owned));
        let capture =
            capture.or_else(|| self.captures().first().map(|name| (*name).to_owned())).unwrap_or_default();
        let [patient, visit] = person_told(file, below, &capture).unwrap_or_default();
        [capture, patient, visit]
    }

    /// The frame in a file, developed as one of a capture, and how its colors are shown. Nothing is subtracted from it.
    ///
    /// # Errors
    /// A file that is no raw frame, a frame that lacks a number, a capture that is not there.
    pub fn developed(&self, file: &Path, capture: &str) -> Result<(CapturedFrame, ColorRendering)> {
        let mut study = self.study.clone();
        subtract_what_is_given(&mut study, |label| label == capture);
        let settings = study.capture(capture).ok_or_else(|| {
            Error::Input(format!(
                "there is no capture \"{capture}\"; there are {}",
                self.captures().join(", ")
            ))
        })?;
        let raw = read_raw(&study, file, Some(capture))?.image;
        let calibration = Calibration::of_frames(study.develop.demosaicing, Vec::new(), Vec::new(), None)?;
        let rendering = ColorRendering::of_frame(&study, settings);
        let exposures = vec![RawExposures { raw, bracket: Vec::new() }];
        let frame = develop_frames(&study, exposures, &calibration)?.pop();
        Ok((
            frame.ok_or_else(|| Error::Failed(format!("{}: no frame came of it", file.display())))?,
            rendering,
        ))
    }

    /// What the pixels of a named region say, as a table of photographs has it. `frames` are the captures and files of one visit, `place` is
    /// where the region lies, as fields of `[analysis]`.
    ///
    /// # Errors
    /// Those of [`analyze`].
    pub fn estimate(
        &self,
        frames: &[(String, PathBuf)],
        name: &str,
        place: &[(&str, String)],
        job: &Job,
    ) -> Result<AnalyzedFrame> {
        let fields: Vec<String> = place.iter().map(|(field, value)| format!("{field} = {value}")).collect();
        let regions = region_options(&[format!("{name}={{ {} }}", fields.join(", "))])?;
        let site = site_of_region(name, &self.parsed);
        let regions: Vec<_> = regions.into_iter().map(|region| region.of_site(site.as_deref())).collect();
        let options = AnalyzeOptions {
            frame: frames.iter().map(|(capture, file)| format!("{capture}={}", file.display())).collect(),
            experiment: Some(self.name.clone()),
            ..AnalyzeOptions::default()
        };
        let mut found = None;
        let see = |_: &Study, _: &[CapturedFrame], seen: &[(&str, &AnalyzedFrame)]| {
            found = seen.last().map(|(_, analyzed)| (*analyzed).clone());
            Ok(())
        };
        analyze_frames(&options, &Regions { main: regions.first(), beside: &regions }, job, see)?;
        found
            .ok_or_else(|| Error::Input(format!("{} has no [analysis] section; add one", quoted(&self.name))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fluorspar_experiment::parse_cohort;

    /// People, views and the number of pixels decide nothing of that; lights, filters and the analysis do.
    #[test]
    fn a_cohort_has_the_digest_of_its_camera() {
        let source = ExperimentSource::find(Some("oraleye-2021")).unwrap();
        let of = |text: &str| {
            let text = format!("format = 1\nbase = \"oraleye-2021\"\n{text}");
            let cohort = parse_cohort(&text, "c.toml", Path::new("."), &[]).unwrap();
            camera_digest(&source, &cohort.experiment).unwrap()
        };
        let own = camera_digest(&source, &source.parse(&[]).unwrap()).unwrap();
        let small = "[people]\ncount = 2\n[mouth]\ndetail = 0.25\n[render]\nwidth_px = 48\nheight_px = 36\n[spectral]\nstep_nm = 20.0\n\
                     [analysis]\nparts = [\"tongue_dorsum\"]\n[sensor]\ncolumns = 64\nrows = 48\npixel_size_um = 37.5\nfill_factor = 0.0044\n";
        assert_eq!(of(small), own);
        for other in [
            "[sensor]\nfill_factor = 0.2\n",
            "[view_filter]\nfilters = [\"long_pass_520\"]\n",
            "[[light]]\nname = \"blue\"\nspectrum = \"led_405\"\n",
            "[[capture]]\nname = \"blue\"\nexposure_ms = 20.0\n",
            "[analysis]\nframe = \"white\"\n",
            "[develop]\ndark_frames = 4\n",
        ] {
            assert_ne!(of(other), own, "{other}");
        }
    }
}
