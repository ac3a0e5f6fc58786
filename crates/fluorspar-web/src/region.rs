//! What the pixels of a region say: the estimate with its interval as `analyze` has it, and the light that leaves it, split by what
//! happened to it.

use fluorspar::analysis::{PixelSelection, Polygon, Rectangle, RegionOfInterest};
use fluorspar::findings::region_findings;
use fluorspar::pipeline::on_sensor;
use fluorspar_report::finding_lines;
use fluorspar_session::{Changes, Error, LiveRender, LiveStudy, Result};
use serde::{Deserialize, Serialize};

use crate::subject::{check_no_files, said};

/// Which region is asked about.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RegionRequest {
    #[serde(default)]
    set: Vec<String>,
    /// The capture whose light is split.
    capture: String,
    /// Columns and rows of its frame.
    frame_px: [usize; 2],
    /// Where it lies; the region of the analysis where it is `None`.
    place: Option<Place>,
}

/// A region that was drawn on a frame.
#[derive(Clone, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Place {
    /// Column, row, width, height.
    RectanglePx([u32; 4]),
    /// Corners.
    PolygonPx(Vec<[f64; 2]>),
}

impl Place {
    /// The region as `analyze --named-region` takes it behind the name.
    pub(crate) fn text(&self) -> String {
        match self {
            Self::RectanglePx(place) => format!("{place:?}"),
            Self::PolygonPx(corners) => format!("{corners:?}"),
        }
    }

    fn region(&self) -> RegionOfInterest {
        let mut region = RegionOfInterest::default();
        match self {
            Self::RectanglePx([column, row, width, height]) => {
                let [col, row, width, height] = [*column, *row, *width, *height].map(|side| side as usize);
                region.rectangle = Some(Rectangle { row, col, width, height });
            }
            Self::PolygonPx(corners) => region.polygon = Some(Polygon(corners.clone())),
        }
        region
    }
}

/// What a region says.
#[derive(Default, Serialize)]
pub(crate) struct RegionAnswer {
    /// The capture that was analyzed.
    frame: String,
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
pub(crate) fn region(live: &LiveRender, request: &RegionRequest) -> Result<RegionAnswer> {
    let changes = Changes { set: request.set.clone(), unset: Vec::new() };
    check_no_files(&changes)?;
    let study = live.show(&changes)?;
    let text = request.place.as_ref().map(Place::text);
    let mut answer = RegionAnswer::default();
    let mut selection = None;
    match study.analyzed(text.as_deref()) {
        Ok(Some(analyzed)) => {
            let analysis = &analyzed.analysis;
            answer.frame.clone_from(&analysis.frame);
            answer.lines = finding_lines(&region_findings(analysis), &analysis.analyte, false);
            answer.warnings = analysis.warnings.iter().map(|warning| warning.text().to_owned()).collect();
            selection = Some(analyzed.region);
        }
        Ok(None) => answer.no_estimate = Some("the experiment has no [analysis]; its spectra are shown".into()),
        Err(error) => answer.no_estimate = Some(said(&error)),
    }
    let spectra = match (&request.place, selection) {
        (Some(place), _) => drawn_spectra(&study, live, request, place),
        (None, Some(region)) => spectra(&study, &request.capture, &region),
        (None, None) => Err(Error::Input("there is no region; draw one".into())),
    };
    match spectra {
        Ok(spectra) => answer.spectra = Some(spectra),
        Err(error) => answer.no_spectra = Some(said(&error)),
    }
    Ok(answer)
}

/// The spectra of all pixels of a region that was drawn, whether or not an estimate can use them.
fn drawn_spectra(
    study: &LiveStudy<'_>,
    live: &LiveRender,
    request: &RegionRequest,
    place: &Place,
) -> Result<Spectra> {
    let [width, height] = request.frame_px;
    const MOST_PIXELS: usize = 1 << 26;
    if width.checked_mul(height).is_none_or(|pixels| pixels > MOST_PIXELS) {
        return Err(Error::Input(format!("frame_px: {width} x {height} pixels are more than any sensor has")));
    }
    let scene = on_sensor(study.study(), live.render().labels());
    let selected = place.region().select(width, height, scene);
    let selected = selected.map_err(|error| Error::Input(format!("the region has no pixels: {error}")))?;
    spectra(study, &request.capture, &selected)
}

fn spectra(study: &LiveStudy<'_>, capture: &str, region: &PixelSelection) -> Result<Spectra> {
    let found = study.radiance(capture, region)?;
    let ends = [("reflected".to_owned(), found.reflected), ("fluoresced twice".into(), found.multiple_fluorescence)];
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
