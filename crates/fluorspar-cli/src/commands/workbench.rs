//! `fluorspar workbench`: a page on which frames follow lights, filters and sensors, until Ctrl-C.

use fluorspar_web::{Workbench, WorkbenchOptions};

use super::print_text;
use crate::error::CliError;
use crate::interrupt::{serve_until_interrupted, stop_flag};
use crate::message::Messages;

pub(crate) fn run(options: &WorkbenchOptions) -> Result<(), CliError> {
    let workbench = Workbench::open(options)?;
    Messages::default().status("The workbench is at this address of this machine; Ctrl-C ends it:");
    print_text(workbench.address())?;
    serve_until_interrupted();
    workbench.run(&stop_flag())
}
