//! OME-Zarr 0.5: channels of an image as a Zarr array with the names that napari and its like show, after
//! <https://ngff.openmicroscopy.org/0.5/>.

use std::path::Path;

use serde_json::{Value, json};

use super::ome_tiff::{OmeChannel, OmeFacts, check_values};
use super::zarr::Group;
use crate::FormatError;
use crate::store::output::WRITTEN_BY;

/// Writes `[row, col, channel]`, f32, into a folder that is there or not, as `[c, y, x]` at one resolution. Wavelengths, nm, exposure time, s,
/// and unit, for which the form has no place of its own, are attributes of `fluorspar`.
///
/// # Errors
/// When the values do not fill the image, or the folder can't be written.
pub fn write_ome_zarr(
    folder: &Path,
    [width, height]: [usize; 2],
    values: &[f32],
    channels: &[OmeChannel],
    facts: &OmeFacts,
) -> Result<(), FormatError> {
    check_values(folder, [width, height], values, channels)?;
    let plane = |channel: usize| values.iter().skip(channel).step_by(channels.len()).copied();
    let planes: Vec<f32> = (0..channels.len()).flat_map(plane).collect();
    let mut group = Group::new(folder);
    let axes = [("c", channels.len()), ("y", height), ("x", width)];
    group.floats("0", &axes, &planes, json!({}))?;
    let shown = channels.iter().zip(planes.chunks_exact(width * height));
    let shown: Vec<Value> = shown.map(|(channel, plane)| as_shown(channel, plane)).collect();
    let of_channels = |nm: fn(&OmeChannel) -> Option<f64>| channels.iter().map(nm).collect::<Vec<_>>();
    group.finish(json!({
        "ome": { "version": "0.5", "multiscales": [multiscale(facts)], "omero": { "channels": shown } },
        "fluorspar": {
            "software": WRITTEN_BY,
            "unit": facts.unit,
            "exposure_s": facts.exposure_s,
            "emission_nm": of_channels(|channel| channel.emission_nm),
            "excitation_nm": of_channels(|channel| channel.excitation_nm),
        },
    }))
}

/// Axes, and the side of a pixel where it is known.
fn multiscale(facts: &OmeFacts) -> Value {
    let space = |name: &str| match facts.mm_per_pixel {
        Some(_) => json!({ "name": name, "type": "space", "unit": "millimeter" }),
        None => json!({ "name": name, "type": "space" }),
    };
    let side = facts.mm_per_pixel.unwrap_or(1.0);
    json!({
        "name": facts.title,
        "axes": [{ "name": "c", "type": "channel" }, space("y"), space("x")],
        "datasets": [{ "path": "0", "coordinateTransformations": [{ "type": "scale", "scale": [1.0, side, side] }] }],
    })
}

/// How a viewer begins to show a channel: from 0 to its brightest value, in a color near that of its light.
fn as_shown(channel: &OmeChannel, plane: &[f32]) -> Value {
    let end = plane.iter().copied().fold(0.0, f32::max).max(f32::MIN_POSITIVE);
    let color = match channel.emission_nm {
        Some(nm) if nm < 490.0 => "0000FF",
        Some(nm) if nm < 580.0 => "00FF00",
        Some(_) => "FF0000",
        None => "FFFFFF",
    };
    let window = json!({ "start": 0.0, "end": end, "min": 0.0, "max": end });
    json!({ "label": channel.name, "color": color, "active": true, "window": window })
}
