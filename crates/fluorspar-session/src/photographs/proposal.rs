//! Photographs whose regions nobody placed yet: pictures to place them on, and guesses to confirm.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fluorspar::analysis::{GuessedRegion, PixelSelection, guess_mouth};
use fluorspar::pipeline::{CapturedFrame, Preview};
use fluorspar::study::Study;
use fluorspar_experiment::{Warning, resolve};
use fluorspar_format::{OutputFolder, write_atomically, write_label_png};
use fluorspar_report::{OUTLINE_COLORS, ReportPicture, outlined_preview};

use super::camera::face_warning;
use super::estimate::{GUESS, PICTURE_COLUMNS, options_of, shown};
use super::pairing::Photograph;
use super::table::PhotographRow;
use super::{FailedPhotograph, PhotographWork};
use crate::analyze::{as_recorded, developed, parsed_for_frames};
use crate::values::as_typed;
use crate::{AnalyzeOptions, ExperimentSource, Job, Result};

/// What a photograph shows before regions are placed.
pub(super) struct Proposed {
    pub(super) rows: Vec<PhotographRow>,
    pub(super) picture: ReportPicture,
}

/// Writes pictures and guesses of all photographs; those that fail are told.
pub(super) fn propose(
    work: &PhotographWork<'_>,
    folder: &OutputFolder,
    job: &Job,
) -> Result<(Vec<Proposed>, Vec<FailedPhotograph>)> {
    let share_done = job.listener.begin("Developing photographs", "the photographs", crate::Left::Nothing);
    let (mut proposed, mut failures) = (Vec::new(), Vec::new());
    let count = work.photographs.len();
    for (number, photograph) in work.photographs.iter().enumerate() {
        if job.is_stopped() {
            return Err(crate::Error::Stopped(format!(
                "stopped after {number} of {count} photographs; nothing was written"
            )));
        }
        match propose_one(work, photograph, number, folder, job) {
            Ok(found) => proposed.push(found),
            Err(error) if error.kind() == crate::ErrorKind::Input => {
                failures.push(FailedPhotograph::of(photograph, &error))
            }
            Err(error) => return Err(error),
        }
        share_done((number + 1) as f64 / count.max(1) as f64);
    }
    Ok((proposed, failures))
}

/// The frames of a photograph, and the study whose captures they are.
fn developed_frames(
    options: &AnalyzeOptions,
    photograph: &Photograph,
) -> Result<(Study, Vec<CapturedFrame>)> {
    let options = options_of(photograph, options);
    let quiet = Job::new(Arc::default(), Arc::new(super::estimate::Heard::default()));
    let source = ExperimentSource::find(options.experiment.as_deref())?;
    let (parsed, overrides) = parsed_for_frames(&options, &source)?;
    let mut experiment = resolve(&parsed).map_err(|error| as_typed(error, &overrides))?;
    as_recorded(&options, true, &mut experiment, &quiet);
    let frames = developed(&options, &experiment.study, &photograph.frames[0].0, &quiet)?.frames;
    Ok((experiment.study, frames))
}

/// How the frames of a photograph look, by capture, and what is said of those that show a face.
///
/// # Errors
/// Frames that can't be read.
pub fn photograph_pictures(
    options: &AnalyzeOptions,
    photograph: &Photograph,
) -> Result<Vec<(String, Preview, Option<Warning>)>> {
    let (study, frames) = developed_frames(options, photograph)?;
    let picture = |(capture, path): &(String, PathBuf)| {
        let frame = frames.iter().find(|of| of.raw.label == *capture)?;
        let warning = face_warning(&study, path, &frame.developed);
        Some((capture.clone(), shown(&study, &frames, capture)?, warning))
    };
    Ok(photograph.frames.iter().filter_map(picture).collect())
}

fn propose_one(
    work: &PhotographWork<'_>,
    photograph: &Photograph,
    number: usize,
    folder: &OutputFolder,
    job: &Job,
) -> Result<Proposed> {
    let (study, frames) = developed_frames(work.options, photograph)?;
    let (capture, frame) = &photograph.frames[0];
    let image = shown(&study, &frames, capture)
        .ok_or_else(|| crate::Error::Failed(format!("{}: the frame has no picture", frame.display())))?;
    let stem = format!("{:03}_{}", number + 1, frame.file_stem().unwrap_or_default().to_string_lossy());
    let own = frames.iter().find(|of| of.raw.label == *capture);
    let guesses = own.map_or_else(Vec::new, |of| guess_mouth(&of.developed));
    let selections: Vec<&PixelSelection> = guesses.iter().map(|guess| &guess.selection).collect();
    let png = outlined_preview(&image, &selections, image.width).unwrap_or_default();
    write_atomically(&made(folder, "previews")?.join(format!("{stem}.png")), |file| file.write_all(&png))?;
    for (capture, path) in &photograph.frames {
        let shown = frames.iter().find(|of| of.raw.label == *capture);
        job.warn(shown.and_then(|of| face_warning(&study, path, &of.developed)).as_slice());
    }
    let mut rows = Vec::new();
    for guess in &guesses {
        let mask = format!("masks/{stem}_{}.png", guess.name);
        write_mask(&made(folder, "masks")?.join(format!("{stem}_{}.png", guess.name)), &guess.selection)?;
        let row = row_of(work, photograph, (capture, frame), 0);
        rows.push(PhotographRow { region: guess.name.into(), place: mask, verdict: GUESS.into(), ..row });
    }
    // A line names one dark and one flat frame: further ones have lines of their own, which stay when a region is struck
    let first = usize::from(!guesses.is_empty());
    let lines = photograph.dark.len().max(photograph.flat.len()).max(1);
    rows.extend((first..lines).map(|line| row_of(work, photograph, (capture, frame), line)));
    for (other, file) in &photograph.frames[1..] {
        rows.push(row_of(work, photograph, (other, file), 0));
    }
    Ok(Proposed { rows, picture: picture(photograph, &image, &guesses) })
}

/// A folder below that of the results, made where it is not there.
fn made(folder: &OutputFolder, name: &str) -> Result<PathBuf> {
    let path = folder.path().join(name);
    std::fs::create_dir_all(&path).map_err(|error| {
        crate::Error::Failed(format!("{}: can't make this folder: {error}", path.display()))
    })?;
    Ok(path)
}

fn write_mask(path: &Path, selection: &PixelSelection) -> Result<()> {
    let mut labels = vec![0; selection.width * selection.height];
    selection.pixels.iter().for_each(|pixel| labels[*pixel] = u8::MAX);
    Ok(write_label_png(path, selection.width, selection.height, &labels)?)
}

/// A line of a frame, with the dark and the flat frame of a number.
fn row_of(
    work: &PhotographWork<'_>,
    photograph: &Photograph,
    (capture, frame): (&str, &Path),
    number: usize,
) -> PhotographRow {
    let seen_from = |path: &Path| path_from(&work.folder, path);
    let of_number = |own: &[PathBuf]| own.get(number).map_or_else(PathBuf::new, |path| seen_from(path));
    PhotographRow {
        patient: photograph.patient.clone(),
        visit: photograph.visit.clone(),
        capture: capture.into(),
        frame: seen_from(frame),
        dark: of_number(&photograph.dark),
        flat: of_number(&photograph.flat),
        ..PhotographRow::default()
    }
}

/// A path as a folder has it, which may not be there yet.
pub(crate) fn path_from(folder: &Path, path: &Path) -> PathBuf {
    let (folder, path) = (without_links(folder), without_links(path));
    let shared = folder.components().zip(path.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| std::path::Component::ParentDir);
    up.chain(path.components().skip(shared)).collect()
}

/// An absolute path, without links as far as it is there.
fn without_links(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let there = absolute.ancestors().find_map(|part| Some((part, part.canonicalize().ok()?)));
    let Some((part, real)) = there else { return absolute };
    absolute.strip_prefix(part).map_or_else(|_| absolute.clone(), |rest| real.join(rest))
}

fn picture(photograph: &Photograph, image: &Preview, guesses: &[GuessedRegion]) -> ReportPicture {
    let selections: Vec<&PixelSelection> = guesses.iter().map(|guess| &guess.selection).collect();
    let tell = |(guess, color): (&GuessedRegion, &str)| {
        format!("{} ({color}) {:.0} %", guess.name, 100.0 * guess.sureness)
    };
    let told: Vec<String> = guesses.iter().zip(OUTLINE_COLORS).map(tell).collect();
    ReportPicture {
        png: outlined_preview(image, &selections, PICTURE_COLUMNS).unwrap_or_default(),
        title: format!("{}, visit {}", photograph.patient, photograph.visit),
        caption: if told.is_empty() {
            "nothing was guessed".into()
        } else {
            format!("guessed, and how sure: {}", told.join(", "))
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_from_one_folder_to_another() {
        assert_eq!(path_from(Path::new("out/a"), Path::new("photos/x.dng")), Path::new("../../photos/x.dng"));
        assert_eq!(path_from(Path::new("photos"), Path::new("photos/x.dng")), Path::new("x.dng"));
    }
}
