//! `fluorspar describe`: the description of a camera's frame, from its tags and from what the user knows.

use clap::ValueHint;
use fluorspar::image::Mosaic;
use fluorspar_experiment::{DEFAULT_EXPERIMENT, Warning};
use fluorspar_format::{
    FactSource, FrameDescription, FrameFact, FrameFacts, Output, Outputs, describe_frame, description_path,
};
use fluorspar_session::ExperimentSource;
use serde_json::json;
use std::path::{Path, PathBuf};

use super::table::align;
use crate::args::Answer;
use crate::commands::shell_word;
use crate::error::CliError;
use crate::message::Messages;
use crate::values;

/// Options of `describe`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Frame of a camera: DNG, or TIFF or PNG of 8 or 16 bits, gray or linear RGB.
    #[arg(value_name = "FRAME", value_hint = ValueHint::FilePath)]
    frame: PathBuf,
    /// Capture of the experiment that it is a frame of [default: the name of the file].
    #[arg(long, value_name = "NAME")]
    capture: Option<String>,
    /// Color filter array from the upper left pixel on, as the file stores it: rggb, bggr, grbg, gbrg, or mono [default: from the tags, else mono].
    #[arg(long, value_name = "ORDER", value_parser = mosaic)]
    mosaic: Option<Mosaic>,
    /// RGB files: every pixel measured all three colors [default: they were interpolated from a Bayer array].
    #[arg(long)]
    measured: bool,
    /// Digital number without light [default: from the tags, else 0].
    #[arg(long, value_name = "DN", value_parser = values::number, allow_negative_numbers = true)]
    black_level: Option<f64>,
    /// Digital number from which a pixel is saturated [default: from the tags, else the largest number].
    #[arg(long, value_name = "DN", value_parser = values::whole::<u16, 1, 65_535>, allow_negative_numbers = true)]
    white_level: Option<u16>,
    /// Bits of the converter [default: from the tags, else the fewest that hold the largest value].
    #[arg(long, value_name = "BITS", value_parser = values::whole::<u8, 1, 16>, allow_negative_numbers = true)]
    bit_depth: Option<u8>,
    /// The values stand in the upper bits of 16: of dark frames, whose size does not show it [default: where some need more bits than the
    /// powers of 2 that all are multiples of leave].
    #[arg(long)]
    left_aligned: bool,
    /// Exposure time, ms [default: from the tags].
    #[arg(long, value_name = "MS", value_parser = values::number, allow_negative_numbers = true)]
    exposure_ms: Option<f64>,
    /// Gain of the amplifier, 1 at ISO 100 [default: from the tags, else 1].
    #[arg(long, value_name = "G", value_parser = values::number, allow_negative_numbers = true)]
    gain: Option<f64>,
    /// Digital numbers per electron [default: from the tags, else the sensor of the experiment tells].
    #[arg(long, value_name = "K", value_parser = values::number, allow_negative_numbers = true)]
    dn_per_electron: Option<f64>,
    /// Noise of a dark pixel, digital numbers rms [default: from the tags, else the sensor of the experiment tells].
    #[arg(long, value_name = "DN", value_parser = values::number, allow_negative_numbers = true)]
    read_noise_dn: Option<f64>,
    /// Replace the description that exists.
    #[arg(long)]
    replace: bool,
    #[command(flatten)]
    answer: Answer,
}

/// A color filter array by its letters.
fn mosaic(text: &str) -> Result<Mosaic, String> {
    if text.eq_ignore_ascii_case("mono") {
        return Ok(Mosaic::monochrome());
    }
    Mosaic::bayer(text).ok_or_else(|| "give rggb, bggr, grbg, gbrg or mono".into())
}

/// What the options tell.
fn facts(options: &Options) -> Result<FrameFacts, CliError> {
    for (option, value) in [
        ("exposure_ms", options.exposure_ms),
        ("gain", options.gain),
        ("dn_per_electron", options.dn_per_electron),
        ("read_noise_dn", options.read_noise_dn),
    ] {
        if let Some(value) = value {
            values::check_range(option, value, [1e-9, 1e9], "")?;
        }
    }
    Ok(FrameFacts {
        label: options.capture.clone(),
        mosaic: options.mosaic.clone(),
        is_measured: options.measured,
        black_level: options.black_level,
        white_level: options.white_level,
        bit_depth: options.bit_depth,
        is_left_aligned: options.left_aligned,
        exposure_s: options.exposure_ms.map(|ms| 1e-3 * ms),
        gain: options.gain,
        dn_per_electron: options.dn_per_electron,
        read_noise_dn: options.read_noise_dn,
    })
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let given = facts(options)?;
    let path = description_path(&options.frame);
    if path.exists() && !options.replace {
        return Err(CliError::Input(format!(
            "{}: the frame is described already; ⟨replace⟩ describes it anew, from its tags and the options of this call alone",
            path.display()
        )));
    }
    let found = describe_frame(&options.frame, &given)?;
    if found.facts.iter().any(|fact| fact.key == "exposure_s" && fact.source == FactSource::Unknown) {
        return Err(CliError::Input(format!(
            "{}: no tag of the file tells its exposure time; give ⟨exposure_ms⟩",
            options.frame.display()
        )));
    }
    let output = match options.replace {
        true => Output::continued("the description", &path),
        false => Output::file("the description", &path),
    };
    let set = Outputs::new().and(output).reading(std::slice::from_ref(&options.frame)).declare()?;
    found.write()?;
    set.finish()?;
    if options.answer.json {
        super::print_json(&json_of(&path, &found)?)?;
    } else {
        super::print_text(&text_of(&found))?;
    }
    let warnings: Vec<Warning> = found.warnings.iter().cloned().map(Warning::from).collect();
    Messages::default().warnings(&warnings);
    Messages::default().status(format!("Wrote {}. {}", path.display(), next_command(options)?));
    Ok(())
}

/// What to type next: all of it but the files that only the user knows, for the default experiment where the capture is one of it. A real
/// frame has no parts: its region is drawn, as a mask.
fn next_command(options: &Options) -> Result<String, CliError> {
    let stem = options.frame.file_stem().unwrap_or_default().to_string_lossy();
    let frame = shell_word(&options.frame.to_string_lossy());
    let out = shell_word(&format!("fluorspar-out/{stem}"));
    let captures = ExperimentSource::find(None)?.parse(&[])?.file.capture;
    let known = options.capture.as_ref().filter(|name| captures.iter().any(|capture| capture.name == **name));
    let (remark, experiment, frames) = match (known, &options.capture) {
        (Some(name), _) => {
            // Frames are analyzed with those that are subtracted from them
            let analyzed = captures.iter().find(|capture| {
                capture.subtract.is_some()
                    && (capture.name == *name || capture.subtract.as_ref() == Some(name))
            });
            let of_analyzed =
                analyzed.into_iter().flat_map(|capture| [Some(&capture.name), capture.subtract.as_ref()]);
            let mut names: Vec<&String> = of_analyzed.flatten().collect();
            if names.is_empty() {
                names.push(name);
            }
            let file = |other: &String| {
                if other == name { frame.clone() } else { format!("{}_FRAME", other.to_uppercase()) }
            };
            let frames: Vec<String> =
                names.iter().map(|name| format!("--frame {}={}", shell_word(name), file(name))).collect();
            (
                " (or with an experiment of your own; MASK.png is white in the region)",
                DEFAULT_EXPERIMENT,
                frames,
            )
        }
        (None, Some(name)) => {
            let frames = vec![format!("--frame {}={frame}", shell_word(name))];
            (" (EXPERIMENT being yours; MASK.png is white in the region)", "EXPERIMENT", frames)
        }
        (None, None) => (
            " (EXPERIMENT being yours, CAPTURE the name of the frame in it; MASK.png is white in the region)",
            "EXPERIMENT",
            vec![format!("--frame CAPTURE={frame}")],
        ),
    };
    Ok(format!(
        "Next{remark}: fluorspar analyze --experiment {experiment} {} --set analysis.mask=MASK.png --out {out}",
        frames.join(" ")
    ))
}

/// Each value and where it comes from.
fn text_of(found: &FrameDescription) -> String {
    let row = |fact: &FrameFact| {
        let source = match fact.remark.as_str() {
            "" => fact.source.word().to_owned(),
            remark => format!("{}: {remark}", fact.source.word()),
        };
        vec![fact.key.to_owned(), fact.value.clone(), source]
    };
    let rows: Vec<Vec<String>> = found.facts.iter().map(row).collect();
    align(&rows, &[1, 2])
}

fn json_of(path: &Path, found: &FrameDescription) -> Result<serde_json::Value, CliError> {
    let facts = found.facts.iter().map(|fact| {
        json!({ "key": fact.key, "value": fact.value, "source": fact.source.word(), "remark": fact.remark })
    });
    let facts: Vec<serde_json::Value> = facts.collect();
    Ok(json!({ "file": path, "description": found.to_json()?, "facts": facts, "warnings": found.warnings }))
}
