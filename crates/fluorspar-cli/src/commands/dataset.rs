//! `fluorspar dataset`: what was written, in words.

use fluorspar_report::dataset_in_short;
use fluorspar_session::{DatasetOptions, WrittenDataset, dataset};

use super::{Answering, print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;

pub(crate) fn run(options: &Answering<DatasetOptions>) -> Result<(), CliError> {
    let written = dataset(&options.task, &Messages::default().job())?;
    match &written {
        _ if options.form.json => print_json(&written),
        WrittenDataset::All { holds, .. } => print_text(&dataset_in_short(holds)),
        // Its status says it
        WrittenDataset::Shard(_) => Ok(()),
    }
}
