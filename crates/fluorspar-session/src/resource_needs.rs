//! What a job needs of memory, disk and time, told and held against limits before it begins.

use std::time::Instant;

use fluorspar::image::{Film, StatisticsKind};
use fluorspar::render::{
    ComponentBands, FilmRenderer, Share, basis_bytes, memory_bytes, surface_bytes, whole_image_bytes,
};
use fluorspar::scene::Scene;
use fluorspar::study::Study;
use fluorspar::units::{memory_text, memory_texts};
use fluorspar_experiment::{ResolvedExperiment, cache};
use serde::{Deserialize, Serialize};

use crate::values::{self, Override, duration};
use crate::{Error, Job, Result};

/// Memory of the program itself with its catalogue, bytes, as measured.
const PROGRAM_BYTES: u64 = 50 << 20;
/// Memory of page and figures, bytes, as measured.
const REPORT_BYTES: u64 = 48 << 20;
/// Spectra of a component among which its bands are searched, as measured.
const SEARCHED_SPECTRA: usize = 5200;
/// Memory that an image takes besides its film while it is made of it, bytes, at most.
const CONVERSION_BYTES: u64 = 64 << 20;

/// What a render may take.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct ResourceLimits {
    /// Refuse work that would need more memory than this, for instance 8GiB.
    #[arg(long, value_name = "SIZE", value_parser = values::size, allow_negative_numbers = true)]
    pub max_memory: Option<u64>,
    /// Refuse work that could write more than this to the disk, for instance 20GiB.
    #[arg(long, value_name = "SIZE", value_parser = values::size, allow_negative_numbers = true)]
    pub max_disk: Option<u64>,
    /// End the render after this time with the image so far, for instance 20min; refused if not even the first sample of every
    /// pixel would be there.
    #[arg(long, value_name = "TIME", value_parser = values::time, allow_negative_numbers = true)]
    pub time_limit: Option<f64>,
}

impl ResourceLimits {
    /// The time limit as a change of the experiment.
    pub fn overrides(&self) -> Option<Override> {
        self.time_limit.map(|seconds| Override::number("render.time_limit_s", seconds, "time_limit"))
    }
}

/// Memory and room on the disk that a job takes, bytes.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ResourceNeeds {
    /// Memory at its peak.
    #[serde(rename = "memory_bytes")]
    pub memory: u64,
    /// The film in it.
    #[serde(rename = "film_bytes")]
    pub film: u64,
    /// Surfaces and what finds rays among them in it.
    #[serde(rename = "surface_bytes")]
    pub surfaces: u64,
    /// Room on the disk.
    #[serde(rename = "disk_bytes")]
    pub disk: u64,
}

impl ResourceNeeds {
    /// Of a render. Of an image that does not fit into the memory limit, the film is as large as the limit.
    pub fn of_render(study: &Study, components: bool, keeps_film: bool) -> Self {
        let (scene, settings) = (&study.scene, &study.render);
        let whole = memory_bytes(scene, settings);
        let film_file = if keeps_film { film_file_bytes(study) } else { 0 };
        let film = (whole + basis_bytes(scene, settings)).min(settings.memory_limit_bytes);
        let conversion = (film / 4).min(CONVERSION_BYTES);
        let surfaces = surface_bytes(scene);
        let search = match settings.film_bands() {
            ComponentBands::All => 0,
            ComponentBands::Basis => 4 * (SEARCHED_SPECTRA * band_spectra(scene)) as u64,
        };
        let memory = film + surfaces + whole_image_bytes(scene) + PROGRAM_BYTES + conversion + search;
        Self { memory, film, surfaces, disk: image_room_bytes(study, components) + film_file }
    }

    /// Of a run, from scene to report.
    pub fn of_run(study: &Study) -> Self {
        let render = Self::of_render(study, true, false);
        let memory = render.memory.max(render.surfaces + PROGRAM_BYTES + REPORT_BYTES);
        Self { memory, disk: run_bytes(study), ..render }
    }

    /// Refuses a job that would take more than the user grants.
    pub fn check(&self, limits: &ResourceLimits, study: &Study) -> Result<()> {
        let camera = &study.scene.camera;
        let size =
            format!("{} x {} pixels with {} bands", camera.width, camera.height, study.scene.grid.len());
        let less = "render fewer pixels, bands, light groups or fluorophores";
        if let Some(most) = limits.max_memory.filter(|&most| self.memory > most) {
            let [needed, limit] = memory_texts(self.memory, most);
            return Err(Error::Input(format!(
                "⟨max_memory={limit}⟩: {size} need about {needed} (film {}, surfaces {}); {less}, use coarser meshes, or lower \
                 render.memory_limit_gib, with which `fluorspar render` goes through the image in bands of rows",
                memory_text(self.film),
                memory_text(self.surfaces)
            )));
        }
        if let Some(most) = limits.max_disk.filter(|&most| self.disk > most) {
            let [needed, limit] = memory_texts(self.disk, most);
            return Err(Error::Input(format!(
                "⟨max_disk={limit}⟩: {size} take up to {needed}; {less}, or grant more"
            )));
        }
        Ok(())
    }

    /// One line for people.
    pub fn text(&self) -> String {
        format!(
            "about {} of memory (film {}, surfaces {}), up to {} of disk",
            memory_text(self.memory),
            memory_text(self.film),
            memory_text(self.surfaces),
            memory_text(self.disk)
        )
    }
}

/// Seconds of the paths that a film lacks, by timing some thousand of them.
pub fn seconds_of(renderer: &FilmRenderer, share: &Share, film: Option<&Film>) -> f64 {
    let started = Instant::now();
    let paths = renderer.trial_paths();
    let per_path = started.elapsed().as_secs_f64() / paths.max(1) as f64;
    renderer.missing_paths(share, film) as f64 * per_path
}

/// Seconds that a whole render takes, by a pilot. What a pilot found is kept for the next time: it traces the whole scene.
pub fn render_seconds(experiment: &ResolvedExperiment) -> Result<f64> {
    let pilot = || -> Result<Vec<u8>> {
        let renderer = FilmRenderer::for_rows(&experiment.study.scene, &experiment.study.render)?;
        Ok(seconds_of(&renderer, &Share::Whole, None).to_le_bytes().to_vec())
    };
    // The digest leaves out where files are, and no setting of the render.
    let key = format!("pilot 1 {} {}", experiment.record.sha256, rayon::current_num_threads());
    let bytes = match cache() {
        Some(cache) => cache.get_or_make("pilot", key.as_bytes(), pilot)?,
        None => pilot()?,
    };
    match bytes.first_chunk::<8>() {
        Some(bytes) => Ok(f64::from_le_bytes(*bytes)),
        None => Err(Error::Failed("the pilot gave no time".into())),
    }
}

/// Says how long rendering takes, and what a time limit does to it.
///
/// # Errors
/// A time limit in which not even the first sample of every pixel gets done.
pub fn say_time(seconds: f64, samples: u32, time_limit_s: Option<f64>, job: &Job) -> Result<()> {
    check_time(seconds, samples, time_limit_s)?;
    job.status(match time_limit_s.filter(|&limit| limit < seconds) {
        Some(limit) => {
            let held = (f64::from(samples) * limit / seconds).max(1.0);
            format!(
                "Rendering would take about {}; the time limit ends it after {}, with about {held:.0} of {samples} samples per pixel",
                duration(seconds),
                duration(limit)
            )
        }
        None => format!("Rendering takes about {}", duration(seconds)),
    });
    Ok(())
}

/// Refuses a time limit in which not even the first sample of every pixel gets done.
pub(crate) fn check_time(seconds: f64, samples: u32, time_limit_s: Option<f64>) -> Result<()> {
    let first = seconds / f64::from(samples.max(1));
    match time_limit_s.filter(|&limit| limit < seconds) {
        // The pilot may be wrong by a half.
        Some(limit) if 2.0 * limit < first => Err(Error::Input(format!(
            "render.time_limit_s {}: one sample of every pixel takes about {}; allow more time (⟨time_limit⟩), or render fewer \
             pixels, bands or light groups",
            duration(limit),
            duration(first)
        ))),
        _ => Ok(()),
    }
}

/// Size of a rendered image on the disk, bytes, at most: all values as they are in memory, which packing only makes less.
fn image_bytes(study: &Study, components: bool) -> u64 {
    let (scene, settings) = (&study.scene, &study.render);
    let film = memory_bytes(scene, settings);
    if !components {
        let pixels = (scene.camera.width * scene.camera.height) as u64;
        return 4 * pixels * scene.grid.len() as u64;
    }
    if settings.excitation_basis.is_some() {
        return basis_bytes(scene, settings) + whole_image_bytes(scene);
    }
    // Four bytes instead of eight for a value, and three planes of statistics instead of two.
    let values = match settings.film_statistics() {
        StatisticsKind::None => film / 2,
        _ => film / 4 * 3,
    };
    values + whole_image_bytes(scene)
}

/// Room of a rendered image on the disk while it is made, bytes: rows of one in bands wait in a file of their own.
pub fn image_room_bytes(study: &Study, components: bool) -> u64 {
    // Spectra by which bands follow from coefficients, as text
    const SPECTRA: usize = 16;
    let text = if components { 6 * (SPECTRA * band_spectra(&study.scene)) as u64 } else { 0 };
    let image = image_bytes(study, components) + text;
    let in_bands = memory_bytes(&study.scene, &study.render) > study.render.memory_limit_bytes;
    // Rows of a render with an excitation basis wait in memory
    if in_bands && study.render.excitation_basis.is_none() { 2 * image } else { image }
}

/// Bands of all components.
fn band_spectra(scene: &Scene) -> usize {
    scene.light_groups.len() * (scene.fluorophores.len() + 2) * scene.grid.len()
}

/// Room of a film on the disk while it is renewed, bytes: the earlier one stays until the new one is complete.
pub fn film_file_bytes(study: &Study) -> u64 {
    // A sample takes up to 30 bits of a sum (2^-30 of the brightest one of the pilot is its quantum), and brighter ones come.
    const SAMPLE_BITS: u32 = 30 + 3;
    let bits = SAMPLE_BITS + study.render.samples_per_pixel.max(1).ilog2();
    let film = memory_bytes(&study.scene, &study.render) / 8 * u64::from(bits.div_ceil(8).min(8));
    2 * (film + whole_image_bytes(&study.scene))
}

/// Room of the frames of all captures on the disk, bytes: 16 bits a pixel for a raw frame, 24 for a preview.
pub fn frame_bytes(study: &Study) -> u64 {
    let sensor = study.camera.sensor.as_ref();
    let pixels = sensor.map_or(0, |sensor| (sensor.model().columns * sensor.model().rows) as u64);
    let frames: usize = study.captures.iter().map(|capture| 1 + capture.bracket_ev.len()).sum();
    pixels * (2 * frames as u64 + 3 * study.captures.len() as u64)
}

/// Room of the folder of a run on the disk, bytes: components, the radiance of each frame with light, frames, and a few
/// megabytes of figures and report.
pub fn run_bytes(study: &Study) -> u64 {
    const REPORT: u64 = 16 << 20;
    let lit = study.captures.iter().filter(|c| c.frame.lights.values().any(|&drive| drive > 0.0)).count();
    image_bytes(study, true) + lit as u64 * image_bytes(study, false) + frame_bytes(study) + REPORT
}
