//! `fluorspar sheet`: frames of one render side by side, each with changes of its own.

use clap::ValueHint;
use fluorspar::image::LightPath;
use fluorspar::pipeline::{
    CapturedFrame, ColorRendering, Preview, bright_level_dn, capture_from_planes, check_captures, preview,
};
use fluorspar::study::{Capture, Study};
use fluorspar_format::{Output, Outputs, write_rgb_png};
use fluorspar_report::{ContactSheet, Raster};
use fluorspar_session::{
    Changes, FinishedRender, ShownExperiment, Wanted, as_typed_in_session, experiment_of, say_uncertainty,
    warn_of_denoised,
};
use std::collections::BTreeSet;
use std::path::PathBuf;

use crate::error::CliError;
use crate::message::Messages;
use crate::values::{self, Override};

/// Options of `sheet`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Component image: components.exr of a run, or .exr or .npy of `render --components`.
    #[arg(value_name = "COMPONENTS", value_hint = ValueHint::FilePath)]
    image: PathBuf,
    /// Capture that is shown [default: the analyzed one, else the last with light].
    #[arg(long, value_name = "NAME")]
    capture: Option<String>,
    /// A picture: its title, a colon, and changes as of --set, separated by semicolons, for instance "bulk alone:
    /// concentration.protoporphyrin_ix=0". May be repeated [default: the frame as it is, then each fluorophore alone, then the
    /// reflected light].
    #[arg(long, value_name = "TITLE: CHANGES")]
    panel: Vec<String>,
    #[command(flatten)]
    changes: Changes,
    /// Width of each picture, pixels (64 to 2000).
    #[arg(long, value_name = "PX", default_value_t = 320, value_parser = values::whole::<usize, 64, 2000>,
        allow_negative_numbers = true)]
    width: usize,
    /// File of the sheet, .png.
    #[arg(long, value_name = "FILE.png", default_value = "sheet.png", value_hint = ValueHint::FilePath)]
    out: PathBuf,
}

/// A picture of the sheet.
struct Panel {
    title: String,
    changes: Vec<Override>,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    if options.out.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("png")) {
        let path = options.out.display();
        return Err(CliError::Input(format!("--out {path}: the name must end in .png")));
    }
    let inputs = [options.image.clone()];
    let set = Outputs::new().and(Output::file("--out", &options.out)).reading(&inputs).declare()?;
    let messages = Messages::default();
    let image = FinishedRender::open_for_captures(&options.image)?;
    warn_of_denoised(&image, &messages.job());
    let common = options.changes.overrides();
    let panels = panels(options, &image, &common)?;
    let sheet = ContactSheet::new(panels.len(), options.width);
    let mut pictures: Vec<(String, Raster)> = Vec::with_capacity(panels.len());
    let mut first_level = None;
    let mut exposures = None;
    for (panel, size) in panels.iter().zip(sheet.picture_sizes()) {
        let panel = exposed_as(panel, common.len(), exposures.as_deref().unwrap_or_default());
        let Shot { frame, picture, automatic } = picture(options, &image, &panel, messages)?;
        exposures.get_or_insert(automatic);
        let level = bright_level_dn(&frame.developed);
        let first = *first_level.get_or_insert(level);
        let title = match first > 0.0 && !pictures.is_empty() {
            true => format!("{} ({:.0} %)", panel.title, 100.0 * level / first),
            false => panel.title.clone(),
        };
        let fitted = picture.fitted(size);
        let raster = Raster::from_rgb8(fitted.width, fitted.height, &fitted.rgb);
        pictures
            .push((title, raster.ok_or_else(|| CliError::Failed("a picture of the sheet is empty".into()))?));
    }
    let named: Vec<(&str, Raster)> =
        pictures.iter().map(|(title, raster)| (title.as_str(), raster.clone())).collect();
    let sheet = sheet.compose(&named).map_err(|error| CliError::Failed(error.to_string()))?;
    write_rgb_png(&options.out, sheet.width, sheet.height, sheet.pixels.as_flattened())?;
    set.finish()?;
    messages.status(format!("Wrote {}", options.out.display()));
    Ok(())
}

/// The pictures that were asked for, else every fluorophore by itself.
fn panels(options: &Options, image: &FinishedRender, common: &[Override]) -> Result<Vec<Panel>, CliError> {
    if !options.panel.is_empty() {
        return options.panel.iter().map(|text| panel(text, common)).collect();
    }
    let fluorophore = |light: &LightPath| match light {
        LightPath::Fluorescence(name) => Some(name.clone()),
        _ => None,
    };
    let names: BTreeSet<String> =
        image.labels().components.iter().filter_map(|c| fluorophore(&c.light)).collect();
    let alone = |kept: Option<&String>| {
        let others = names.iter().filter(|name| Some(*name) != kept);
        let off = others.map(|name| Override::set(&format!("concentration.\"{name}\"=0")));
        common.iter().cloned().chain(off).collect::<Vec<_>>()
    };
    let mut panels = vec![Panel { title: "as rendered".into(), changes: common.to_vec() }];
    panels.extend(names.iter().map(|name| Panel { title: name.clone(), changes: alone(Some(name)) }));
    panels.push(Panel { title: "reflected light".into(), changes: alone(None) });
    Ok(panels)
}

/// A picture as it was typed.
fn panel(text: &str, common: &[Override]) -> Result<Panel, CliError> {
    let (title, changes) = match text.split_once(':') {
        Some((title, changes)) if !title.trim().is_empty() => (title.trim(), changes),
        _ => {
            return Err(CliError::Input(format!(
                "--panel {text}: write a title, a colon, and changes, for instance --panel \"no porphyrin: \
                 concentration.protoporphyrin_ix=0\""
            )));
        }
    };
    let own = changes.split(';').map(str::trim).filter(|change| !change.is_empty()).map(Override::set);
    Ok(Panel { title: title.into(), changes: common.iter().cloned().chain(own).collect() })
}

/// The frame of a panel.
struct Shot {
    frame: CapturedFrame,
    picture: Preview,
    /// The automatic exposures of its captures, as changes that set them.
    automatic: Vec<Override>,
}

/// A panel whose exposures, where they are automatic, are those of the first one, so that pictures differ by their light alone. What its own
/// changes set, behind those that are common to all panels, stays.
fn exposed_as(panel: &Panel, common: usize, exposures: &[Override]) -> Panel {
    let mut changes = panel.changes.clone();
    changes.splice(common..common, exposures.iter().cloned());
    Panel { title: panel.title.clone(), changes }
}

/// The automatic exposures of captures as they came out.
fn automatic_exposures(study: &Study, frames: &[CapturedFrame]) -> Vec<Override> {
    let pinned = frames.iter().filter_map(|frame| {
        let capture = study.capture(&frame.raw.label)?;
        capture.frame.exposure_ms.is_none().then(|| {
            Override::set(&format!(
                "capture.{}.exposure_ms={:?}",
                frame.raw.label,
                1e3 * frame.raw.exposure_s
            ))
        })
    });
    pinned.collect()
}

/// The frame of a panel and its picture.
fn picture(
    options: &Options,
    image: &FinishedRender,
    panel: &Panel,
    messages: Messages,
) -> Result<Shot, CliError> {
    let (_, parsed) = experiment_of(image, &panel.changes)?;
    let shown_by_image = image.shown(&parsed).map_err(|error| as_typed_in_session(error, &panel.changes))?;
    let ShownExperiment { experiment, changes } = shown_by_image;
    let study = &experiment.study;
    check_captures(study, image.labels())?;
    let analyzed = parsed.file.analysis.as_ref().map(|analysis| analysis.frame.as_str());
    let capture = shown(options, study, analyzed)?;
    messages.status(format!("{}: capture \"{}\"", panel.title, capture.frame.label));
    let view = image.seen_by(study, &study.captures, changes, Wanted::Lit)?;
    say_uncertainty(&view, study, &messages.job());
    let frames = capture_from_planes(study, &view.components(image))?;
    let automatic = automatic_exposures(study, &frames);
    let frame = frames.into_iter().find(|frame| frame.raw.label == capture.frame.label);
    let frame = frame.ok_or_else(|| CliError::Failed("the capture gave no frame".into()))?;
    let picture = preview(&frame.developed, &ColorRendering::of_frame(study, capture));
    Ok(Shot { frame, picture, automatic })
}

/// The capture that is shown.
fn shown<'a>(options: &Options, study: &'a Study, analyzed: Option<&str>) -> Result<&'a Capture, CliError> {
    let has_light = |capture: &&Capture| capture.frame.lights.values().any(|&drive| drive > 0.0);
    let found = match &options.capture {
        Some(name) => study.capture(name),
        None => analyzed
            .and_then(|name| study.capture(name))
            .or_else(|| study.captures.iter().rev().find(has_light)),
    };
    found.ok_or_else(|| {
        let known = study.captures.iter().map(|c| c.frame.label.as_str()).collect::<Vec<_>>().join(", ");
        let name = options.capture.as_deref().unwrap_or("with light");
        CliError::Input(format!(
            "there is no capture {name}; the captures are: {known}. Name one with --capture"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Panels have the exposures of the first one, but for what they set themselves.
    #[test]
    fn exposures_stand_behind_what_is_common_and_before_what_is_own() {
        let common = [Override::set("capture.blue.gain=2")];
        let own = panel("mine: capture.blue.exposure_ms=5", &common).unwrap();
        let found = exposed_as(&own, common.len(), &[Override::set("capture.blue.exposure_ms=59.3")]);
        let sets: Vec<&str> = found.changes.iter().map(|c| c.set.as_str()).collect();
        assert_eq!(
            sets,
            ["capture.blue.gain=2", "capture.blue.exposure_ms=59.3", "capture.blue.exposure_ms=5"]
        );
        assert_eq!(exposed_as(&own, common.len(), &[]).changes.len(), 2);
    }

    #[test]
    fn panels_have_titles_and_changes() {
        let found = panel("no porphyrin: concentration.protoporphyrin_ix=0; capture.blue.exposure_ms=5", &[])
            .unwrap();
        assert_eq!(found.title, "no porphyrin");
        assert_eq!(
            found.changes.iter().map(|c| c.set.as_str()).collect::<Vec<_>>(),
            ["concentration.protoporphyrin_ix=0", "capture.blue.exposure_ms=5"]
        );
        assert!(panel("no colon", &[]).is_err() && panel(": x=1", &[]).is_err());
        assert!(panel("as it is:", &[]).unwrap().changes.is_empty());
    }
}
