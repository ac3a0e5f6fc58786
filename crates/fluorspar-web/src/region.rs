//! What the pixels of a region say: the estimate with its interval as `analyze` has it, and the light that leaves it, split by what
//! happened to it.

use fluorspar::analysis::{PixelSelection, Polygon, Rectangle, RegionOfInterest};
use fluorspar::findings::region_findings;
use fluorspar::pipeline::on_sensor;
use fluorspar_report::finding_lines;
use fluorspar_session::values::quoted;
use fluorspar_session::{Error, LiveRender, LiveStudy, Result};
use serde::{Deserialize, Serialize};

use crate::server::Shown;
use crate::subject::said;

/// Which region is asked about.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RegionRequest {
    #[serde(default)]
    pub(crate) set: Vec<String>,
    /// The capture whose light is split.
    capture: String,
    /// Columns and rows of its frame.
    frame_px: [usize; 2],
    /// Where it lies; the region of the analysis where it is `None`.
    place: Option<Place>,
}

/// A region that was drawn on a frame: a rectangle, or a polygon.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Place {
    /// Column, row, width, height.
    rectangle_px: Option<[u32; 4]>,
    /// Corners.
    polygon_px: Option<Vec<[f64; 2]>>,
    /// Painted pixels of a photograph: runs of pixels outside and inside, in turn, row by row.
    pub(crate) mask_runs: Option<Vec<u32>>,
    /// The part of the scene whose pixels count; empty for all of them. Where it is `None` it is yet to be found.
    part: Option<String>,
}

/// Share of the pixels of a shape that a part shows where the region is taken for one of it.
const MAIN_SHARE: f64 = 0.5;

impl Place {
    /// The region as `analyze --named-region` takes it behind the name.
    pub(crate) fn text(&self) -> String {
        let fields: Vec<String> =
            self.fields("").iter().map(|(field, value)| format!("{field} = {value}")).collect();
        format!("{{ {} }}", fields.join(", "))
    }

    /// The region as fields of `[analysis]` with values of TOML; what is painted is in the file of a mask.
    pub(crate) fn fields(&self, mask: &str) -> Vec<(&'static str, String)> {
        let part = self.part.as_ref().filter(|part| !part.is_empty());
        let shape = match (&self.rectangle_px, &self.polygon_px, &self.mask_runs) {
            (Some(place), ..) => Some(("rectangle_px", format!("{place:?}"))),
            (_, Some(corners), _) => Some(("polygon_px", format!("{corners:?}"))),
            (_, _, Some(_)) => Some(("mask", quoted(mask))),
            // A whole part; of nothing at all the analysis tells what is wrong
            _ if part.is_some() => None,
            _ => Some(("polygon_px", "[]".into())),
        };
        part.map(|part| ("parts", format!("[{}]", quoted(part)))).into_iter().chain(shape).collect()
    }

    fn region(&self) -> RegionOfInterest {
        let rectangle = self.rectangle_px.map(|place| {
            let [col, row, width, height] = place.map(|side| side as usize);
            Rectangle { row, col, width, height }
        });
        let parts = self.part.iter().filter(|part| !part.is_empty()).cloned().collect();
        RegionOfInterest {
            parts,
            rectangle,
            polygon: self.polygon_px.clone().map(Polygon),
            ..Default::default()
        }
    }
}

/// The parts that a shape shows, with their pixels in the render, most first.
fn parts_within(study: &LiveStudy<'_>, live: &LiveRender, shape: &PixelSelection) -> Vec<(String, usize)> {
    let labels = live.render().labels();
    let Some(scene) = on_sensor(study.study(), labels) else { return Vec::new() };
    let features = &labels.features;
    let mut counts = vec![0; features.part_names.len()];
    for pixel in scene.scene_pixels(shape) {
        let part = features.part.get(pixel).and_then(|part| usize::from(*part).checked_sub(1));
        if let Some(count) = part.and_then(|part| counts.get_mut(part)) {
            *count += 1;
        }
    }
    let mut parts: Vec<(String, usize)> = features.part_names.iter().cloned().zip(counts).collect();
    parts.retain(|(_, count)| *count > 0);
    parts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    parts
}

/// What a region says.
#[derive(Default, Serialize)]
pub(crate) struct RegionAnswer {
    /// The capture that was analyzed.
    frame: String,
    /// Parts that the shape shows, with their pixels in the render, and the one whose pixels count; empty for all of them.
    parts: Vec<(String, usize)>,
    part: String,
    /// Lines of findings, the verdict first.
    lines: Vec<String>,
    warnings: Vec<String>,
    /// Why there is no estimate.
    #[serde(skip_serializing_if = "Option::is_none")]
    no_estimate: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    spectra: Option<Spectra>,
    /// Why there are no spectra.
    #[serde(skip_serializing_if = "Option::is_none")]
    no_spectra: Option<String>,
}

/// Mean radiance before filter and lens, W/(sr m² nm).
#[derive(Serialize)]
struct Spectra {
    wavelength_nm: Vec<f64>,
    total: Vec<f64>,
    /// Names and values of its parts, which sum to the total.
    parts: Vec<(String, Vec<f64>)>,
    /// Pixels of the render that were averaged.
    pixels: usize,
}

/// Asks the pixels of a region.
///
/// # Errors
/// A change that can't be made or shown. That an estimate or spectra can't be had is told in the answer.
pub(crate) fn region(shown: &Shown, request: &RegionRequest) -> Result<RegionAnswer> {
    let live = &shown.live;
    let study = live.show(&shown.changes)?;
    let mut answer = RegionAnswer::default();
    let mut place = request.place.clone();
    if let Some(place) = &mut place {
        let whole = Place { part: None, ..place.clone() };
        let shape = selected(&study, live, request.frame_px, &whole)?;
        answer.parts = parts_within(&study, live, &shape);
        let all: usize = answer.parts.iter().map(|(_, count)| count).sum();
        let main = answer.parts.first().filter(|(_, count)| *count as f64 >= MAIN_SHARE * all as f64);
        let main = || main.map_or_else(String::new, |(part, _)| part.clone());
        answer.part = place.part.get_or_insert_with(main).clone();
    }
    let text = place.as_ref().map(Place::text);
    let mut selection = None;
    match study.analyzed(text.as_deref()) {
        Ok(Some(analyzed)) => {
            let analysis = &analyzed.analysis;
            answer.frame.clone_from(&analysis.frame);
            answer.lines = finding_lines(&region_findings(analysis), &analysis.analyte, false);
            answer.warnings = analysis.warnings.iter().map(|warning| warning.text().to_owned()).collect();
            selection = Some(analyzed.region.clone());
        }
        Ok(None) => answer.no_estimate = Some("the experiment has no [analysis] section".into()),
        Err(error) => answer.no_estimate = Some(said(&error)),
    }
    let region = match (&place, selection) {
        (Some(place), _) => selected(&study, live, request.frame_px, place),
        (None, Some(region)) => Ok(region),
        (None, None) => Err(Error::Input("there is no region; draw one".into())),
    };
    match region.and_then(|region| spectra(&study, &request.capture, &region)) {
        Ok(spectra) => answer.spectra = Some(spectra),
        Err(error) => answer.no_spectra = Some(said(&error)),
    }
    Ok(answer)
}

/// Which pixel is asked about.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PartRequest {
    #[serde(default)]
    pub(crate) set: Vec<String>,
    frame_px: [usize; 2],
    /// Column and row.
    at_px: [u32; 2],
}

/// The part that a pixel shows; `None` where it shows none.
///
/// # Errors
/// A change that can't be shown; a pixel that is not on the frame.
pub(crate) fn part_at(shown: &Shown, request: &PartRequest) -> Result<Option<String>> {
    let live = &shown.live;
    let study = live.show(&shown.changes)?;
    let [column, row] = request.at_px;
    let pixel =
        Place { rectangle_px: Some([column, row, 1, 1]), polygon_px: None, mask_runs: None, part: None };
    let shape = selected(&study, live, request.frame_px, &pixel)?;
    Ok(parts_within(&study, live, &shape).into_iter().next().map(|(part, _)| part))
}

/// The pixels of a region that was drawn, whether or not an estimate can use them.
fn selected(
    study: &LiveStudy<'_>,
    live: &LiveRender,
    [width, height]: [usize; 2],
    place: &Place,
) -> Result<PixelSelection> {
    const MOST_PIXELS: usize = 1 << 26;
    if width.checked_mul(height).is_none_or(|pixels| pixels > MOST_PIXELS) {
        return Err(Error::Input(format!(
            "frame_px: {width} x {height} pixels are more than any sensor has"
        )));
    }
    let scene = on_sensor(study.study(), live.render().labels());
    let found = place.region().select(width, height, scene);
    found.map_err(|error| Error::Input(format!("{error}; draw it elsewhere")))
}

fn spectra(study: &LiveStudy<'_>, capture: &str, region: &PixelSelection) -> Result<Spectra> {
    let found = study.radiance(capture, region)?;
    let ends =
        [("reflected".to_owned(), found.reflected), ("fluoresced twice".into(), found.multiple_fluorescence)];
    let [reflected, twice] = ends;
    let parts = std::iter::once(reflected).chain(found.fluorescence).chain([twice]);
    let is_there = |(_, values): &(String, Vec<f64>)| values.iter().any(|value| *value != 0.0);
    Ok(Spectra {
        wavelength_nm: found.wavelength_nm,
        total: found.total,
        parts: parts.filter(is_there).collect(),
        pixels: found.pixels,
    })
}
