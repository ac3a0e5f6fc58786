//! `fluorspar scene view`: the shapes of a scene, at once.

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::pipeline::{SurfaceView, depth_range_m, part_color, surface_view};
use fluorspar::render::visible_surfaces;
use fluorspar_format::{Output, Outputs, write_rgb_png};
use fluorspar_session::Changes;

use super::source::SceneArgs;
use crate::error::CliError;
use crate::message::Messages;
use crate::values;

/// Options of `scene view`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    changes: Changes,
    /// What the picture shows: gray clay, a color for each part, the distance from the camera, or texture coordinates.
    #[arg(long, value_parser = values::choice::<SurfaceView>(&["clay", "part", "depth", "uv"]), value_name = "WHAT",
        default_value = "clay")]
    show: SurfaceView,
    /// Width of the picture, pixels [default: that of the render].
    #[arg(long, value_name = "PX", value_parser = values::whole::<usize, 16, 8192>, allow_negative_numbers = true)]
    width: Option<usize>,
    /// File of the picture, .png.
    #[arg(long, value_name = "FILE.png", default_value = "scene.png", value_hint = ValueHint::FilePath)]
    out: PathBuf,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let Options { scene, changes, show, width, out } = options;
    if !out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")) {
        return Err(CliError::Input(format!("--out {}: the name must end in .png", out.display())));
    }
    let set = Outputs::new().and(Output::file("--out", out)).reading(&[scene.name().into()]).declare()?;
    let mut shapes = scene.shapes(&changes.overrides())?;
    let camera = &mut shapes.camera;
    if let Some(width) = *width {
        let height = (width * camera.height).div_ceil(camera.width).clamp(1, 16_384);
        (camera.width, camera.height) = (width, height);
    }
    let maps = visible_surfaces(&shapes, &shapes.camera);
    let picture = surface_view(&maps, shapes.camera.width, *show);
    write_rgb_png(out, picture.width, picture.height, &picture.rgb)?;
    set.finish()?;
    Messages::default().status(format!("Wrote {}", out.display()));
    match (show, depth_range_m(&maps)) {
        (_, None) => Messages::default().status("Nothing is in the field of view of the camera"),
        (SurfaceView::Depth, Some([nearest, farthest])) => crate::commands::print_text(&format!(
            "bright {:.2} mm, dark {:.2} mm from the camera",
            1e3 * nearest,
            1e3 * farthest
        ))?,
        (SurfaceView::Part, _) => {
            let is_seen = |part: &usize| maps.part.contains(&((part + 1).min(usize::from(u16::MAX)) as u16));
            let line = |part: usize| {
                let [r, g, b] = part_color(part);
                format!("#{r:02x}{g:02x}{b:02x} {}", maps.part_names[part])
            };
            let lines: Vec<String> = (0..maps.part_names.len()).filter(is_seen).map(line).collect();
            crate::commands::print_text(&lines.join("\n"))?;
        }
        _ => {}
    }
    Ok(())
}
