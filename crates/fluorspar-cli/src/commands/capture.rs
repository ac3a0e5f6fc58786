//! `fluorspar capture`.

use fluorspar_session::{CaptureOptions, capture};

use super::{Answering, print_json};
use crate::error::CliError;
use crate::message::Messages;

pub(crate) fn run(options: &Answering<CaptureOptions>) -> Result<(), CliError> {
    let messages = Messages::default();
    let captured = capture(&options.task, &messages.job())?;
    if options.form.json {
        return print_json(&captured);
    }
    let (count, place) = (captured.frames.len(), captured.folder.display());
    let next = match options.task.report {
        true => format!("Open {}", captured.folder.join("report.html").display()),
        false if !options.task.format.is_raw() => "Next: open them in Fiji, napari or QuPath".into(),
        false => {
            format!("Next: fluorspar analyze {place} --out FOLDER, or capture again with --report for a page")
        }
    };
    messages
        .status(format!("Wrote {count} {} to {place}. {next}", if count == 1 { "frame" } else { "frames" }));
    Ok(())
}
