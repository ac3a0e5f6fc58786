//! A result folder that appears complete or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use crate::error::CliError;
use crate::progress::set_unfinished;

/// Files that show that a folder holds results of this program.
const MARKS: [&str; 2] = ["results.json", "experiment.toml"];

/// Writes a folder beside its final place and moves it there when it is complete. Earlier results in the same
/// place are replaced; any other folder that is not empty is refused.
pub(crate) struct OutFolder {
    target: PathBuf,
    partial: PathBuf,
    done: bool,
}

impl OutFolder {
    /// Checks the place and prepares the partial folder.
    pub(crate) fn prepare(target: &Path) -> Result<Self, CliError> {
        let shown = target.display();
        if target.is_file() {
            return Err(CliError::Input(format!(
                "{shown}: this is a file; choose another folder with --out"
            )));
        }
        if is_occupied(target) {
            return Err(CliError::Input(format!(
                "{shown}: this folder holds files that are no results of fluorspar; choose another with --out"
            )));
        }
        let name = target.file_name().map_or_else(|| "results".into(), |n| n.to_string_lossy().into_owned());
        let parent = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let partial = parent.join(format!(".{name}.partial-{}", std::process::id()));
        fs::create_dir_all(&partial).map_err(|error| {
            CliError::Input(format!("{shown}: can't make this folder: {error}. Choose another with --out"))
        })?;
        set_unfinished(Some(&partial));
        Ok(Self { target: target.to_path_buf(), partial, done: false })
    }

    /// Where to write.
    pub(crate) fn path(&self) -> &Path {
        &self.partial
    }

    /// Moves the complete folder to its place.
    pub(crate) fn finish(mut self) -> Result<PathBuf, CliError> {
        let moved = (|| {
            if self.target.exists() {
                fs::remove_dir_all(&self.target)?;
            }
            fs::rename(&self.partial, &self.target)
        })();
        moved.map_err(|error| {
            CliError::Failed(format!("{}: can't put the results here: {error}", self.target.display()))
        })?;
        self.done = true;
        set_unfinished(None);
        Ok(self.target.clone())
    }
}

impl Drop for OutFolder {
    fn drop(&mut self) {
        if !self.done {
            // A folder that can't be removed is left; there is no one to tell.
            let _ = fs::remove_dir_all(&self.partial);
            set_unfinished(None);
        }
    }
}

fn is_occupied(folder: &Path) -> bool {
    let Ok(mut entries) = fs::read_dir(folder) else { return false };
    entries.next().is_some() && !MARKS.iter().any(|mark| folder.join(mark).is_file())
}
