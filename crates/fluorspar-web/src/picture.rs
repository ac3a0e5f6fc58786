//! A frame as a picture: developed as previews are, raw, with stripes where it clips, or with its map of porphyrin.

use std::time::Instant;

use fluorspar::image::{ChannelImage, SensorImage};
use fluorspar::pipeline::{
    AnalyzedFrame, CapturedFrame, ColorRendering, PipelineError, Preview, SurfaceView, bright_level_dn,
    depth_range_m, noise_of, on_sensor, preview_white, preview_with_white, radiance_preview, surface_view,
};
use fluorspar::spectral::encode_srgb;
use fluorspar_report::ColorMap;
use fluorspar_session::{Error, LiveRender, LiveStudy, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::region::Place;
use crate::server::Shown;

/// Which picture is wanted.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PictureRequest {
    #[serde(default)]
    pub(crate) set: Vec<String>,
    capture: String,
    view: View,
    /// Level that is shown as white, as an earlier picture had it: its tones are held. A new one where there is none.
    white: Option<f64>,
    /// Region of the map, where it is not that of the analysis.
    place: Option<Place>,
    /// Whether half the width and height will do.
    #[serde(default)]
    is_coarse: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum View {
    Developed,
    Raw,
    Clip,
    Noise,
    Eye,
    Clay,
    Part,
    Depth,
    Porphyrin,
}

/// What is told beside a picture.
#[derive(Serialize)]
pub(crate) struct PictureFacts {
    /// Columns and rows of the frame, and width and height of the sensor, mm.
    frame_px: [usize; 2],
    sensor_mm: [f64; 2],
    /// Level that is shown as white, on the scale of the view.
    white: f64,
    exposure_ms: f64,
    gain: f64,
    clipped_percent: f64,
    /// Level of the brightest half percent, and that of noise, DN.
    bright_dn: f64,
    noise_dn: f64,
    /// Digital numbers between black and saturation.
    full_scale_dn: f64,
    /// Columns, rows and samples per pixel of the render, and whether a finer one is in the making.
    render_px: [usize; 2],
    samples_per_pixel: u32,
    is_coarse: bool,
    /// Share at the upper end of the colors of a map, and the colors from 0 on.
    #[serde(skip_serializing_if = "Option::is_none")]
    legend: Option<Legend>,
    /// What changed lights and concentrations leave uncertain.
    remarks: Vec<String>,
    /// Time that the answer took, ms.
    milliseconds: f64,
}

/// The colors of a map.
#[derive(Serialize)]
pub(crate) struct Legend {
    label: String,
    /// What the first and the last color stand for.
    ends: [String; 2],
    /// What is in gray.
    note: &'static str,
    colors: Vec<[u8; 3]>,
}

impl Legend {
    fn new(label: String, ends: [String; 2], note: &'static str) -> Self {
        let colors = (0..LEGEND_STEPS).map(|i| MAP.color(i as f64 / (LEGEND_STEPS - 1) as f64));
        Self { label, ends, note, colors: colors.collect() }
    }

    /// Of distances from the camera, m.
    pub(crate) fn of_depth(range_m: Option<[f32; 2]>) -> Self {
        let ends = range_m.unwrap_or_default().map(|distance| format!("{:.1} mm", 1e3 * distance));
        let (label, colors) = ("Distance from the camera".into(), vec![[255; 3], [38; 3]]);
        Self { label, ends, note: "nearest to farthest", colors }
    }
}

/// Widest picture that is sent, px: of wider frames means over blocks are.
const WIDEST: usize = 1600;
/// Side of the stripes over clipped pixels, px.
const STRIPE: usize = 4;
/// Their two colors, told apart by brightness.
const STRIPES: [[u8; 3]; 2] = [[255, 70, 200], [20, 0, 20]];
/// Colors of maps: told apart with any color vision, and in gray.
const MAP: ColorMap = ColorMap::Viridis;
/// Colors of a legend.
const LEGEND_STEPS: usize = 24;

/// Draws a picture: what is told of it, and its PNG.
///
/// # Errors
/// A change that can't be made or shown, a capture that is not there, a map without an analysis.
pub(crate) fn picture(shown: &Shown, request: &PictureRequest) -> Result<(PictureFacts, Vec<u8>)> {
    let begun = Instant::now();
    let live = &shown.live;
    let study = live.show(&shown.changes)?;
    let frame = study.frame(&request.capture)?;
    let (picture, white, legend) = match request.view {
        View::Porphyrin => {
            let analyzed = study.analyzed(request.place.as_ref().map(Place::text).as_deref())?;
            let analyzed = analyzed.ok_or(PipelineError::Missing("analysis"))?;
            let (shown, legend) = porphyrin(&analyzed, &frame.developed)?;
            (shown, 0.0, Some(legend))
        }
        View::Noise => {
            let (shown, legend) = signal_to_noise(&study, &frame)?;
            (shown, 0.0, Some(legend))
        }
        View::Eye => {
            let seen = radiance_preview(&study.radiance_image(&request.capture)?);
            (laid_out(&seen, &study, live, &frame)?, 0.0, None)
        }
        View::Clay => (of_surfaces(SurfaceView::Clay, &study, live, &frame)?, 0.0, None),
        View::Part => (of_surfaces(SurfaceView::Part, &study, live, &frame)?, 0.0, None),
        View::Depth => {
            let legend = Legend::of_depth(depth_range_m(&live.render().labels().features));
            (of_surfaces(SurfaceView::Depth, &study, live, &frame)?, 0.0, Some(legend))
        }
        View::Raw => {
            let white = request.white.unwrap_or_else(|| bright_raw(&frame.raw));
            (raw(&frame.raw, white), white, None)
        }
        View::Developed | View::Clip => {
            let (developed, white) = developed(&study, &frame, request.white);
            (if request.view == View::Clip { striped(developed, &frame) } else { developed }, white, None)
        }
    };
    let (png, facts) =
        rayon::join(|| png_of(&shrunk(picture, request.is_coarse)), || facts(live, &study, &frame, white));
    let (png, mut facts) = (png?, facts?);
    (facts.legend, facts.milliseconds) = (legend, 1e3 * begun.elapsed().as_secs_f64());
    Ok((facts, png))
}

/// A photograph as a picture, with what is told of it; its map where a region of it was analyzed.
///
/// # Errors
/// A map without an analysis; a view that only a simulation has.
pub(crate) fn of_photograph(
    frame: &CapturedFrame,
    rendering: &ColorRendering,
    view: View,
    analyzed: Option<&AnalyzedFrame>,
) -> Result<(Value, Preview)> {
    let CapturedFrame { raw: mosaic, developed, .. } = frame;
    let white = preview_white(developed, rendering);
    let (shown, legend) = match view {
        View::Developed => (preview_with_white(developed, rendering, white), None),
        View::Clip => (striped(preview_with_white(developed, rendering, white), frame), None),
        View::Raw => (raw(mosaic, bright_raw(mosaic)), None),
        View::Porphyrin => {
            let no_region = || Error::Input("a map needs a region that was analyzed; draw one".into());
            let (shown, legend) = porphyrin(analyzed.ok_or_else(no_region)?, developed)?;
            (shown, Some(legend))
        }
        View::Noise | View::Eye | View::Clay | View::Part | View::Depth => {
            return Err(Error::Input("this view is one of simulations; choose another".into()));
        }
    };
    let facts = json!({
        "frame_px": [developed.width, developed.height],
        "exposure_ms": 1e3 * mosaic.exposure_s,
        "gain": mosaic.gain,
        "clipped_percent": clipped_percent(developed),
        "bright_dn": bright_level_dn(developed),
        "full_scale_dn": developed.full_scale_dn,
        "legend": legend,
    });
    Ok((facts, shrunk(shown, false)))
}

fn clipped_percent(developed: &ChannelImage) -> f64 {
    let clipped = developed.saturated.iter().filter(|is_saturated| **is_saturated).count();
    100.0 * clipped as f64 / developed.saturated.len().max(1) as f64
}

/// What is told beside a picture, but for legend and time.
fn facts(
    live: &LiveRender,
    study: &LiveStudy<'_>,
    frame: &CapturedFrame,
    white: f64,
) -> Result<PictureFacts> {
    let CapturedFrame { raw, developed, .. } = frame;
    let sensor = study.study().camera.sensor.as_ref().ok_or(PipelineError::Missing("sensor"))?.film_extent();
    let labels = live.render().labels();
    Ok(PictureFacts {
        frame_px: [developed.width, developed.height],
        sensor_mm: [sensor.width_mm, sensor.height_mm],
        white,
        exposure_ms: 1e3 * raw.exposure_s,
        gain: raw.gain,
        clipped_percent: clipped_percent(developed),
        bright_dn: bright_level_dn(developed),
        noise_dn: developed.noise_floor_dn,
        full_scale_dn: developed.full_scale_dn,
        render_px: [labels.width, labels.height],
        samples_per_pixel: labels.samples_per_pixel,
        is_coarse: live.is_coarse(),
        legend: None,
        remarks: remarks(study, &raw.label)?,
        milliseconds: 0.0,
    })
}

/// What changed lights and concentrations leave uncertain, in words.
fn remarks(study: &LiveStudy<'_>, capture: &str) -> Result<Vec<String>> {
    let view = study.view_of(capture)?;
    let lights = view.light_errors.iter().map(|(group, error)| {
        format!(
            "Light of \"{group}\" changed without a new render: fluorescence within {:.2} % of one",
            100.0 * error
        )
    });
    let multiple = view.uncertainty.iter().map(|found| {
        format!(
            "Concentrations changed without a new render: light that fluoresced twice, {:.2} % of all, may be off; the light of its source \
             by {:.2} % at the very most",
            100.0 * found.share,
            100.0 * found.largest_error
        )
    });
    Ok(lights.chain(multiple).collect())
}

/// The frame as its preview, and the level that is white.
fn developed(study: &LiveStudy<'_>, frame: &CapturedFrame, white: Option<f64>) -> (Preview, f64) {
    let study = study.study();
    let capture = study.capture(&frame.raw.label);
    let own = ColorRendering { matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], lift: 1.0 };
    let rendering = capture.map_or(own, |capture| ColorRendering::of_frame(study, capture));
    let white = white.unwrap_or_else(|| preview_white(&frame.developed, &rendering));
    (preview_with_white(&frame.developed, &rendering, white), white)
}

/// Level of a raw frame that all but its brightest half percent stay below, DN above black.
fn bright_raw(raw: &SensorImage) -> f64 {
    const SHARE: f64 = 0.995;
    let mut values = raw.data.clone();
    let at = ((values.len() as f64 * SHARE) as usize).min(values.len().saturating_sub(1));
    if values.is_empty() {
        return 1.0;
    }
    let bright = *values.select_nth_unstable(at).1;
    (f64::from(bright) - raw.black_level).max(1.0)
}

/// The mosaic in gray, pixel by pixel: of sensors whose pixels hold all channels the first one.
fn raw(raw: &SensorImage, white: f64) -> Preview {
    let per_pixel = (raw.data.len() / (raw.width * raw.height).max(1)).max(1);
    let gray = |value: &u16| encode_srgb((f64::from(*value) - raw.black_level) / white);
    // A table is as exact and much faster
    let levels: Vec<u8> = (0..=u16::MAX).map(|value| gray(&value)).collect();
    let pixels = raw.data.iter().step_by(per_pixel);
    let rgb = pixels.flat_map(|value| [levels[usize::from(*value)]; 3]).collect();
    Preview { width: raw.width, height: raw.height, rgb }
}

/// Stripes over the pixels that clip.
fn striped(mut shown: Preview, frame: &CapturedFrame) -> Preview {
    let width = shown.width.max(1);
    let clipped = frame.developed.saturated.iter().enumerate().filter(|(_, is_saturated)| **is_saturated);
    for (pixel, _) in clipped {
        let stripe = (pixel % width + pixel / width) / STRIPE % 2;
        shown.rgb[3 * pixel..3 * pixel + 3].copy_from_slice(&STRIPES[stripe]);
    }
    shown
}

/// The share of each pixel of the region on the mixture line, over the frame in gray.
fn porphyrin(analyzed: &AnalyzedFrame, developed: &ChannelImage) -> Result<(Preview, Legend)> {
    let Some(map) = &analyzed.porphyrin else {
        let why =
            "this analysis has no mixture line, and so no map; give analysis.porphyrin and analysis.bulk";
        return Err(Error::Input(why.into()));
    };
    if [map.width, map.height] != [developed.width, developed.height] {
        return Err(Error::Input(
            "the map is of frames of another size; show the capture that is analyzed".into(),
        ));
    }
    let share = map.layers().share;
    let mut sorted: Vec<f32> = share.iter().copied().filter(|share| !share.is_nan()).collect();
    sorted.sort_by(f32::total_cmp);
    let top = sorted.get(sorted.len() * 99 / 100).copied().map_or(1.0, f64::from).clamp(0.01, 1.0);
    let bright = bright_level_dn(developed).max(f64::MIN_POSITIVE);
    let channels = developed.channels.len().max(1);
    let color = |(share, pixel): (&f32, &[f32])| match share.is_nan() {
        true => [encode_srgb(f64::from(pixel.iter().copied().fold(0.0, f32::max)) / bright * 0.5); 3],
        false => MAP.color(f64::from(*share) / top),
    };
    let rgb = share.iter().zip(developed.data.chunks_exact(channels)).flat_map(color).collect();
    let label = format!("{} share on the mixture line", analyzed.analysis.analyte.capitalized());
    let ends = ["0 %".into(), format!("{:.1} % and more", 100.0 * top)];
    let legend = Legend::new(label, ends, "gray: outside the region, clipped, dark or other light");
    Ok((Preview { width: map.width, height: map.height, rgb }, legend))
}

/// Signal over noise of the brightest channel of each pixel, logarithmic from 1 on.
fn signal_to_noise(study: &LiveStudy<'_>, frame: &CapturedFrame) -> Result<(Preview, Legend)> {
    let image = &frame.developed;
    let sensor = study.study().camera.sensor.as_ref().ok_or(PipelineError::Missing("sensor"))?;
    let noise = noise_of(image, &frame.raw, sensor);
    let channels = image.channels.len();
    let of_channel = |channel: usize, pixel: usize| {
        let [variance] = noise.of_pixel(image, [channel], pixel);
        f64::from(image.data[pixel * channels + channel]) / variance.sqrt().max(f64::MIN_POSITIVE)
    };
    let of_pixel = |pixel| (0..channels).map(|channel| of_channel(channel, pixel)).fold(0.0, f64::max);
    let ratios: Vec<f64> = (0..image.width * image.height).map(of_pixel).collect();
    let top = ratios.iter().copied().fold(10.0, f64::max);
    let rgb = ratios.iter().flat_map(|ratio| MAP.color(ratio.max(1.0).ln() / top.ln())).collect();
    let label = "Signal to noise of the brightest channel".into();
    let legend = Legend::new(label, ["1 and less".into(), format!("{top:.0}")], "logarithmic between them");
    Ok((Preview { width: image.width, height: image.height, rgb }, legend))
}

/// The surfaces without light, laid out as the frame is.
fn of_surfaces(
    view: SurfaceView,
    study: &LiveStudy<'_>,
    live: &LiveRender,
    frame: &CapturedFrame,
) -> Result<Preview> {
    let labels = live.render().labels();
    laid_out(&surface_view(&labels.features, labels.width, view), study, live, frame)
}

/// A picture of the render, laid out as the frame is.
fn laid_out(
    seen: &Preview,
    study: &LiveStudy<'_>,
    live: &LiveRender,
    frame: &CapturedFrame,
) -> Result<Preview> {
    let scene = on_sensor(study.study(), live.render().labels()).ok_or(PipelineError::Missing("sensor"))?;
    let [width, height] = [frame.developed.width, frame.developed.height];
    let color = |place: usize| match scene.scene_pixel(place / width, place % width, width, height) {
        Some(pixel) => [0, 1, 2].map(|channel| seen.rgb[3 * pixel + channel]),
        None => [0; 3],
    };
    Ok(Preview { width, height, rgb: (0..width * height).flat_map(color).collect() })
}

/// A picture that is not wider than what a page shows, at half of that where it `is_coarse`.
fn shrunk(shown: Preview, is_coarse: bool) -> Preview {
    let block = shown.width.max(shown.height).div_ceil(WIDEST) << u32::from(is_coarse);
    let size = [shown.width, shown.height].map(|side| (side / block).max(1));
    if block > 1 { shown.fitted(size) } else { shown }
}

/// The picture as PNG: the fastest way to pack it, since it goes nowhere.
pub(crate) fn png_of(shown: &Preview) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, shown.width as u32, shown.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fastest);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&shown.rgb)?;
        writer.finish()
    });
    written.map_err(|error| Error::Failed(format!("the picture can't be packed: {error}")))?;
    Ok(bytes)
}
