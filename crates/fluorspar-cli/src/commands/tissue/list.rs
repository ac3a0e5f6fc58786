//! `fluorspar catalog list tissue`.

use fluorspar_experiment::preset::{self, PresetKind};
use serde_json::json;

use crate::commands::table::ListOptions;
use crate::error::CliError;

pub(crate) fn run(options: &ListOptions) -> Result<(), CliError> {
    let (mut list, mut rows) = (Vec::new(), Vec::new());
    for name in preset::names(PresetKind::Site) {
        let site = preset::site(name)?;
        let basis = if site.is_assumed() { "assumed" } else { "fitted" };
        rows.push(vec![name.into(), basis.into(), site.title().into(), site.source().into()]);
        list.push(json!({
            "name": name,
            "title": site.title(),
            "assumed": site.is_assumed(),
            "source": site.source(),
            "fluorophores": site.fluorophores(),
        }));
    }
    options.print(&list, &["name", "basis", "title", "source"], rows, &[1, 2, 3])
}
