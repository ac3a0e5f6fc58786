//! A frame in the page that follows sliders: planes of light, and a script that sums them.

use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::LazyLock;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use fluorspar::digest::sha256_hex;
use fluorspar::pipeline::{LiveCapture, LivePlane, LiveView};
use half::f16;
use serde_json::{Value, json};

/// The only script of a page.
const SCRIPT: &str = include_str!("live_figure.js");

/// What pages may do: show what is within them, and run the one script.
static POLICY: LazyLock<String> = LazyLock::new(|| {
    let hex = sha256_hex([SCRIPT]);
    let digits = hex.as_bytes().chunks(2).filter_map(|pair| std::str::from_utf8(pair).ok());
    let bytes: Vec<u8> = digits.filter_map(|pair| u8::from_str_radix(pair, 16).ok()).collect();
    let hash = STANDARD.encode(bytes);
    format!(
        "default-src 'none'; script-src 'sha256-{hash}'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
    )
});

/// The content policy of pages: nothing is loaded, and no script but that of the live figure runs.
pub fn page_policy() -> &'static str {
    &POLICY
}

/// Writes the section of a live figure, which begins with a capture of a name.
pub(super) fn write_live_figure(html: &mut String, view: &LiveView, first: Option<&str>) {
    let [width, height] = view.size;
    let _ = writeln!(
        html,
        "<section id=\"live\" hidden>\n<h2>Change light and camera</h2>\n<p>The frames without noise, {width} × {height} blocks of pixels, in \
         the tones of this report. Concentrations are those of the report times the sliders.</p>\n<div class=\"live\">\n\
         <canvas id=\"live-picture\" width=\"{width}\" height=\"{height}\" role=\"img\" aria-label=\"The frame with the values of the \
         sliders\"></canvas>\n<div>\n<label>Frame <select id=\"live-capture\"></select></label> <button type=\"button\" \
         id=\"live-again\">As in the report</button> <span id=\"live-told\" role=\"status\"></span>\n<div \
         id=\"live-controls\"></div>\n</div>\n</div>\n<script type=\"application/json\" id=\"live-data\">{}</script>\n\
         <script>{SCRIPT}</script>\n</section>",
        // No text within ends the element
        data_of(view, first).to_string().replace('<', "\\u003c").replace('>', "\\u003e")
    );
}

fn data_of(view: &LiveView, first: Option<&str>) -> Value {
    let pixels = view.size[0] * view.size[1];
    let found = view.captures.iter().position(|capture| first == Some(&capture.name));
    json!({
        "size": view.size,
        "channels": view.planes.first().map_or(1, |plane| plane.rates.len() / pixels.max(1)),
        "groups": view.groups,
        "planes": view.planes.iter().map(plane).collect::<Vec<_>>(),
        "values": values(&view.planes),
        "captures": view.captures.iter().map(capture).collect::<Vec<_>>(),
        "first": found.unwrap_or(view.captures.len().saturating_sub(1)),
    })
}

/// What the largest rate of a plane is the largest half of: halves of full precision reach from 6e-5 to 65504, mirrored lamps are that much
/// brighter than what is seen around them, and noisy spectra of few samples may be below zero.
fn scale(plane: &LivePlane) -> f32 {
    const LARGEST: f32 = 6e4;
    plane.rates.iter().map(|rate| rate.abs()).fold(LARGEST * f32::MIN_POSITIVE, f32::max) / LARGEST
}

fn plane(plane: &LivePlane) -> Value {
    json!({
        "response": plane.response,
        "group": plane.group,
        "fluorophore": plane.fluorophore,
        "is_multiple": plane.is_multiple,
        "scale": scale(plane),
    })
}

/// The rates of all planes over their scales as halves, compressed: first the high bytes of all, which are alike, then the low ones.
fn values(planes: &[LivePlane]) -> String {
    let halves = |plane: &LivePlane| {
        let scale = scale(plane);
        plane.rates.iter().map(move |rate| f16::from_f32(rate / scale).to_be_bytes()).collect::<Vec<_>>()
    };
    let halves: Vec<[u8; 2]> = planes.iter().flat_map(halves).collect();
    let bytes: Vec<u8> = [0, 1].into_iter().flat_map(|k| halves.iter().map(move |half| half[k])).collect();
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::best());
    // Memory takes all that is written
    let packed = packed.write_all(&bytes).and_then(|()| packed.finish());
    STANDARD.encode(packed.unwrap_or_default())
}

fn capture(capture: &LiveCapture) -> Value {
    json!({
        "name": capture.name,
        "response": capture.response,
        "drives": capture.drives,
        "subtracted": capture.subtracted,
        "exposure_s": capture.exposure_s,
        "gain": capture.gain,
        "dn_per_electron": capture.dn_per_electron,
        "white_dn": capture.white_dn,
        "well_e": capture.well_e,
        "dark_e_per_s": capture.dark_e_per_s,
        "matrix": capture.rendering.matrix,
        "lift": capture.rendering.lift,
        "is_colored": !capture.rendering.is_of_own_channels(),
        "white": capture.white,
    })
}
