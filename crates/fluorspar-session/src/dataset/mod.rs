//! People as training data: frames of every view of a cohort, with the truth about each pixel.

mod categories;
mod tables;
mod view_files;

use std::fs;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar_experiment::keep_no_surfaces;
use fluorspar_format::{check_room, read_start, write_atomically};
use fluorspar_report::{DatasetFacts, RunFolderError, dataset_sheet};
use serde::{Deserialize, Serialize};

use self::categories::Categories;
use self::tables::Tables;
use self::view_files::{FOLDERS, ViewWriter, WrittenView, room_of_view};
use crate::cohort::{CohortArgs, CohortWork, ExaminedView, FinishedShard};
use crate::{Error, Job, Result};

/// Which people become images, and where these go.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct DatasetOptions {
    /// The cohort.
    #[command(flatten)]
    #[serde(flatten)]
    pub people: CohortArgs,
    /// Also write the spectral radiance of every capture (.exr).
    #[arg(long)]
    pub spectra: bool,
    /// Folder for images, masks, truth, annotations (COCO) and DATASHEET.md [default: fluorspar-out/dataset-NAME; with --set or --unset
    /// fluorspar-out/dataset-NAME-DIGEST]. It grows with the work, whose journal lies beside it; it must be empty or of the same
    /// data set.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// What was written of a data set.
#[derive(Serialize)]
#[serde(untagged)]
pub enum WrittenDataset {
    /// All of it.
    All {
        /// The folder.
        folder: PathBuf,
        /// What it holds.
        holds: Box<DatasetFacts>,
    },
    /// The images of a part of the people.
    Shard(FinishedShard),
}

/// File from which a data set can be made again.
const SOURCE: &str = "dataset.toml";

/// Renders and captures every person of a cohort in every view, and writes the frames with masks, depths, normals and shares of light, for
/// `pycocotools` and NumPy. Goes on where one that was stopped or killed ended: a view that is in the journal, and whose files are there, is
/// not made again.
///
/// # Errors
/// A defect of the file; a folder of something else; a view that can't be rendered; files that can't be written; a job that is stopped.
pub fn dataset(options: &DatasetOptions, job: &Job) -> Result<WrittenDataset> {
    let _passing = keep_no_surfaces();
    let (work, first) = CohortWork::prepare(&options.people, options.out.as_deref(), "dataset", job)?;
    let experiment = first.experiment.clone();
    if experiment.study.scene.camera.view().is_none() {
        return Err(Error::Input(format!(
            "{}: camera: parallel rays, or a window off the axis, have no distance and no normals as a camera sees them; use a camera \
             whose rays meet",
            work.source.name
        )));
    }
    let categories = Categories::of(&work, &experiment)?;
    let head = format!("# Data set {} of Fluorspar {}\n", work.sha256, env!("CARGO_PKG_VERSION"));
    check_folder(&work.folder, &head)?;
    let views = u64::from(work.cohort.people.count) * work.cohort.views.len() as u64;
    check_room(&work.folder, views * room_of_view(&experiment.study, options.spectra))?;
    for below in FOLDERS.iter().filter(|folder| options.spectra || **folder != "spectra") {
        let path = work.folder.join(below);
        fs::create_dir_all(&path).map_err(|source| RunFolderError::Folder { path, source })?;
    }
    write(&work.folder, SOURCE, &format!("{head}{}", work.toml()?))?;

    let writer = ViewWriter { work: &work, categories: &categories, has_spectra: options.spectra };
    let read = |entry: &serde_json::Value| {
        WrittenView::deserialize(entry).ok().filter(|view| view.is_complete(&work.folder, options.spectra))
    };
    let make = |examined: &ExaminedView<'_>| Ok(serde_json::to_value(writer.write(examined)?)?);
    let shard = options.people.shard;
    let views = work.finish(shard, first, job, read, make)?;
    if let Some(shard) = shard {
        return Ok(WrittenDataset::Shard(work.finished_shard(shard, views.len(), job)));
    }
    let tables = Tables { work: &work, categories: &categories, study: &experiment.study, views: &views };
    for (name, text) in tables.files()? {
        write(&work.folder, &name, &text)?;
    }
    let holds = Box::new(tables.facts(options.spectra));
    write(&work.folder, "DATASHEET.md", &dataset_sheet(&holds, &experiment))?;
    job.status(format!("Read {}", work.folder.join("DATASHEET.md").display()));
    Ok(WrittenDataset::All { folder: work.folder.clone(), holds })
}

fn write(folder: &Path, name: &str, text: &str) -> Result<()> {
    use std::io::Write;
    Ok(write_atomically(&folder.join(name), |file| file.write_all(text.as_bytes()))?)
}

/// Refuses a folder that holds anything but this data set.
fn check_folder(folder: &Path, head: &str) -> Result<()> {
    let refuse = |why: &str| {
        Err(Error::Input(format!("{}: {why}; choose another with ⟨out⟩, or remove it", folder.display())))
    };
    let mut entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(_) => return refuse("this is no folder that can be read"),
    };
    let source = folder.join(SOURCE);
    match entries.next() {
        None => Ok(()),
        Some(_) if !source.is_file() => refuse("this folder holds something else than a data set"),
        Some(_) if read_start(&source, head.len() as u64)? == head.as_bytes() => Ok(()),
        Some(_) => refuse("this folder holds the data set of another file or version"),
    }
}
