//! A small frame as sums of planes: what other drives, concentrations, exposures and gains make of it is arithmetic without physics.

use super::preview::{ColorRendering, preview_white};
use crate::image::{Component, LightPath};
use crate::pipeline::{CapturedFrame, PipelineError, SeenComponents};
use crate::sensor::{ElectronRate, Sensor, SensorMode};
use crate::study::{AnalysisPlan, Capture, Study};

/// Frames of a study, in blocks of pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveView {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Names of the light groups.
    pub groups: Vec<String>,
    /// What frames are sums of.
    pub planes: Vec<LivePlane>,
    /// The frames.
    pub captures: Vec<LiveCapture>,
}

/// Electrons of some light, for a drive of 1 of its group.
#[derive(Clone, Debug, PartialEq)]
pub struct LivePlane {
    /// Frames that look through the same filters have planes of the same number.
    pub response: usize,
    /// Number of its light group.
    pub group: usize,
    /// The fluorophore whose concentration it follows; `None` of all other light.
    pub fluorophore: Option<String>,
    /// Light that fluoresced more than once: it follows the square of the mean factor on light that fluoresced once, as captures have it.
    pub is_multiple: bool,
    /// `[channel][row][col]`, e-/s: red, green and blue, or one channel.
    pub rates: Vec<f32>,
}

/// How a frame becomes a picture. Rates and the dark current times time are electrons, times `dn_per_electron` times gain digital numbers,
/// which clip at `white_dn`, electrons at `well_e`; the matrix makes colors of these, and [`super::preview_with_white`] a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveCapture {
    /// Name of the capture.
    pub name: String,
    /// Number of its planes.
    pub response: usize,
    /// Drives of the light groups.
    pub drives: Vec<f64>,
    /// Those of the frame that is subtracted, scaled to its exposure, if one is.
    pub subtracted: Option<Vec<f64>>,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Analog gain.
    pub gain: f64,
    /// Digital numbers per electron at a gain of 1.
    pub dn_per_electron: f64,
    /// Digital number above black at which a pixel clips.
    pub white_dn: f64,
    /// Full well, e-.
    pub well_e: f64,
    /// Mean dark current, e-/s.
    pub dark_e_per_s: f64,
    /// Colors and their lift.
    pub rendering: ColorRendering,
    /// Level that is shown as white.
    pub white: f64,
}

/// Largest number of pixels, and of values of all planes.
const MOST_PIXELS: usize = 160 * 120;
const MOST_VALUES: usize = 1 << 20;
/// Share of the light of a group from which on a fluorophore has planes of its own. One whose share is estimated, or which is not of the bulk
/// beside it, has them in any case.
const LEAST_SHARE: f64 = 1e-3;

/// Light that has planes of its own.
struct Part {
    response: usize,
    group: usize,
    fluorophore: Option<String>,
    is_multiple: bool,
    rate: ElectronRate,
}

impl LiveView {
    /// The frames of a study from what its captures see. `None` without captures, and where frames are no
    /// sums of pixels: exposures that are merged, a well that bends, hands that move, painted concentrations, pixels that are joined or left
    /// out, light in flashes or in storage nodes, formulas of ISETCam, calibration frames, and frames subtracted behind another filter.
    ///
    /// # Errors
    /// A study without sensor; a sensor that the planes do not fit.
    pub fn new(
        study: &Study,
        seen: &SeenComponents<'_>,
        frames: &[CapturedFrame],
    ) -> Result<Option<Self>, PipelineError> {
        let sensor = study.camera.sensor.as_ref().ok_or(PipelineError::Missing("sensor"))?;
        let is_merged = frames.iter().any(|frame| !frame.bracket.is_empty());
        if seen.captures.is_empty() || is_merged || !has_plain_frames(study, sensor) || !is_plain(seen) {
            return Ok(None);
        }
        let mut groups: Vec<String> = Vec::new();
        for component in &seen.image.components {
            if !groups.contains(&component.light_group) {
                groups.push(component.light_group.clone());
            }
        }
        let parts = parts(study, sensor, seen, &groups)?;
        let channels = sensor.mosaic().channels.as_slice();
        let find = |name: &str| channels.iter().position(|channel| channel == name);
        let shown = match [find("R"), find("G"), find("B")] {
            [Some(r), Some(g), Some(b)] => vec![r, g, b],
            _ => vec![0],
        };
        let size = size_of(sensor, parts.len() * shown.len());
        let planes = parts.into_iter().map(|part| LivePlane {
            response: part.response,
            group: part.group,
            fluorophore: part.fluorophore,
            is_multiple: part.is_multiple,
            rates: shown.iter().flat_map(|channel| in_blocks(sensor, &part.rate, *channel, size)).collect(),
        });
        let planes = planes.collect();
        let captures = frames.iter().filter_map(|frame| of_frame(study, sensor, seen, &groups, frame));
        let captures = captures.collect();
        Ok(Some(Self { size, groups, planes, captures }))
    }
}

/// Whether each pixel of a frame is that of the sensor, and its signal a sum.
fn has_plain_frames(study: &Study, sensor: &Sensor) -> bool {
    let (model, develop) = (sensor.model(), &study.develop);
    let is_calibrated = develop.dark_frames > 0 || develop.flat_field.is_some();
    let is_cut = model.binning.is_some() || model.region_px.is_some();
    let is_steady = model.strobe.is_none() && model.shutter.parasitic_light_sensitivity == 0.0;
    let is_linear = model.well_knee == 1.0 && !matches!(model.mode, SensorMode::Isetcam { .. });
    is_linear && is_steady && study.motion.is_none() && !is_calibrated && !is_cut
}

/// Whether concentrations are even, and what is subtracted was seen behind the same filters.
fn is_plain(seen: &SeenComponents<'_>) -> bool {
    let response = |label: &str| {
        seen.captures.iter().position(|c| c.frame.label == label).map(|number| seen.planes.of_capture[number])
    };
    seen.factors.maps.iter().all(Option::is_none)
        && seen.captures.iter().zip(&seen.planes.of_capture).all(|(capture, own)| {
            capture.subtract.as_deref().and_then(response).is_none_or(|other| other == *own)
        })
}

/// Reflected light and that of weak fluorophores of each group, and that of each other fluorophore.
fn parts(
    study: &Study,
    sensor: &Sensor,
    seen: &SeenComponents<'_>,
    groups: &[String],
) -> Result<Vec<Part>, PipelineError> {
    let plans = || study.analysis.iter().chain(study.regions.iter().map(|region| &region.analysis));
    // Porphyrin, and what may be taken for it
    let is_in_bulk = |plan: &AnalysisPlan, name: &str| plan.bulk.iter().any(|(of, _)| of == name);
    let is_sought = |name: &str| {
        let is_known = |plan: &AnalysisPlan| plan.fluorophores.iter().any(|of| of.name == name);
        plans().any(|plan| {
            plan.porphyrin.as_deref() == Some(name) || (is_known(plan) && !is_in_bulk(plan, name))
        })
    };
    let mut parts: Vec<Part> = Vec::new();
    for response in 0..seen.planes.planes.len() {
        let first = seen.planes.of_capture.iter().position(|of| *of == response).unwrap_or(0);
        let capture = &seen.captures[first];
        for (group, name) in groups.iter().enumerate() {
            let rate_of = |wanted: &dyn Fn(&Component) -> bool| {
                let is_wanted = |c: &Component| c.light_group == *name && wanted(c);
                let rates = seen.film_rates(capture, |component| f64::from(u8::from(is_wanted(component))));
                sensor.electron_rate_of(&rates, seen.planes.film)
            };
            let total = |rate: &ElectronRate| rate.data.iter().map(|value| f64::from(*value)).sum::<f64>();
            let all = total(&rate_of(&|_| true)?);
            let mut alone: Vec<String> = Vec::new();
            for component in seen.image.components.iter().filter(|c| c.light_group == *name) {
                let LightPath::Fluorescence(fluorophore) = &component.light else { continue };
                let rate = rate_of(&|other| other.light == component.light)?;
                let least = if is_sought(fluorophore) { 0.0 } else { LEAST_SHARE * all };
                if alone.contains(fluorophore) || total(&rate) <= least {
                    continue;
                }
                alone.push(fluorophore.clone());
                let fluorophore = Some(fluorophore.clone());
                parts.push(Part { response, group, fluorophore, is_multiple: false, rate });
            }
            let is_other = |component: &Component| match &component.light {
                LightPath::Fluorescence(name) => !alone.contains(name),
                LightPath::MultipleFluorescence => false,
                LightPath::Reflected => true,
            };
            let multiple = rate_of(&|component| component.light == LightPath::MultipleFluorescence)?;
            for (rate, is_multiple) in [(rate_of(&is_other)?, false), (multiple, true)] {
                if total(&rate) > 0.0 {
                    parts.push(Part { response, group, fluorophore: None, is_multiple, rate });
                }
            }
        }
    }
    Ok(parts)
}

/// Columns and rows of blocks of a sensor: as many as may be, of whole cells of the mosaic.
fn size_of(sensor: &Sensor, planes: usize) -> [usize; 2] {
    let (model, mosaic) = (sensor.model(), sensor.mosaic());
    let most = MOST_PIXELS.min(MOST_VALUES / planes.max(1)).max(1);
    let cells =
        [model.columns / mosaic.cols.max(1), model.rows / mosaic.rows.max(1)].map(|count| count.max(1));
    let block = ((cells[0] * cells[1]) as f64 / most as f64).sqrt().ceil().max(1.0) as usize;
    cells.map(|count| count.div_ceil(block))
}

/// Means of the pixels of a channel over blocks, `[row][col]`.
fn in_blocks(sensor: &Sensor, rate: &ElectronRate, channel: usize, [width, height]: [usize; 2]) -> Vec<f32> {
    let mut sums = vec![(0.0_f64, 0_u32); width * height];
    for (row, line) in rate.data.chunks_exact(rate.columns).enumerate() {
        for (col, value) in line.iter().enumerate() {
            if sensor.mosaic().channel(row, col) == channel {
                let sum = &mut sums[row * height / rate.rows * width + col * width / rate.columns];
                *sum = (sum.0 + f64::from(*value), sum.1 + 1);
            }
        }
    }
    sums.into_iter().map(|(sum, count)| (sum / f64::from(count.max(1))) as f32).collect()
}

fn of_frame(
    study: &Study,
    sensor: &Sensor,
    seen: &SeenComponents<'_>,
    groups: &[String],
    frame: &CapturedFrame,
) -> Option<LiveCapture> {
    let of_label = |label: &str| seen.captures.iter().position(|c| c.frame.label == label);
    let number = of_label(&frame.raw.label)?;
    let capture = &seen.captures[number];
    let drives =
        |capture: &Capture| groups.iter().map(|group| capture.frame.drive(group)).collect::<Vec<_>>();
    let subtracted =
        capture.subtract.as_deref().and_then(of_label).map(|other| drives(&seen.captures[other]));
    let rendering = ColorRendering::of_frame(study, capture);
    let raw = &frame.raw;
    Some(LiveCapture {
        name: raw.label.clone(),
        response: seen.planes.of_capture[number],
        drives: drives(capture),
        subtracted,
        exposure_s: raw.exposure_s,
        gain: raw.gain,
        dn_per_electron: raw.dn_per_electron / raw.gain,
        white_dn: f64::from(raw.white_level) - raw.black_level,
        well_e: sensor.model().well_capacity_e,
        dark_e_per_s: sensor.model().dark_electrons_per_s(),
        rendering,
        white: preview_white(&frame.developed, &rendering),
    })
}
