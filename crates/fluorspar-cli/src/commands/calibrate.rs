//! `fluorspar calibrate`: a camera from its own frames, in words.

use fluorspar_report::calibration_rows;
use fluorspar_session::{CalibrateOptions, CalibratedCamera, calibrate};

use super::Answering;
use super::table::align;
use crate::error::CliError;
use crate::message::Messages;

pub(crate) fn run(options: &Answering<CalibrateOptions>) -> Result<(), CliError> {
    let found = calibrate(&options.task, &Messages::default().job())?;
    options.print(&found, describe)?;
    let camera = found.folder.join("camera.toml");
    Messages::default().status(format!(
        "Next: fluorspar analyze PHOTOS --experiment {}",
        fluorspar::quote::shell_word(&camera.to_string_lossy())
    ));
    Ok(())
}

fn describe(found: &CalibratedCamera) -> String {
    let heads = ["", "value", "95 % interval", "unit"].map(String::from).to_vec();
    let rows = calibration_rows(&found.camera, &found.scales).into_iter().map(Vec::from);
    align(&std::iter::once(heads).chain(rows).collect::<Vec<_>>(), &[2, 3])
}
