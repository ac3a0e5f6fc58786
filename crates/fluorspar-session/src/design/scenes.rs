//! The scenes that a design problem renders, as experiments of their own: for several processes or machines to render one of them together.

use std::fs;
use std::io::Write;
use std::path::PathBuf;

use fluorspar_experiment::DesignRender;
use fluorspar_format::write_atomically;
use serde::Serialize;

use super::ProblemOptions;
use super::renders::path_of;
use crate::{Error, Job, Result};

/// The scenes of a problem.
#[derive(Clone, Debug, Serialize)]
pub struct DesignScenes {
    /// One for each render.
    pub scenes: Vec<DesignScene>,
}

/// A scene as an experiment.
#[derive(Clone, Debug, Serialize)]
pub struct DesignScene {
    /// Its name.
    pub name: String,
    /// File of the experiment.
    pub experiment: PathBuf,
    /// Place of its image.
    pub image: PathBuf,
    /// Whether the image is there.
    pub is_rendered: bool,
}

/// Writes each scene as an experiment beside the place of its image.
///
/// # Errors
/// A defect of the file; a problem without scenes; files that can't be written.
pub fn scenes(options: &ProblemOptions, job: &Job) -> Result<DesignScenes> {
    let problem = options.read(job)?;
    let renders = &problem.resolved.rendered.renders;
    if renders.is_empty() {
        return Err(Error::Input(format!(
            "{}: the problem renders no scene: its regions are flat",
            problem.source.name
        )));
    }
    fs::create_dir_all(&problem.renders)
        .map_err(|error| Error::Input(format!("⟨renders={}⟩: {error}", problem.renders.display())))?;
    let write = |render: &DesignRender| {
        let image = path_of(&problem.renders, render);
        let experiment = image.with_extension("toml");
        write_atomically(&experiment, |file| file.write_all(render.record.resolved_toml.as_bytes()))?;
        Ok(DesignScene { name: render.name.clone(), is_rendered: image.exists(), experiment, image })
    };
    Ok(DesignScenes { scenes: renders.iter().map(write).collect::<Result<_>>()? })
}
