//! `fluorspar catalog list lens`.

use fluorspar::optics::{LensSetting, LensState};
use fluorspar_experiment::preset::{self, LensError, PresetKind};
use serde_json::json;

use crate::commands::table::{ListOptions, short};
use crate::error::CliError;

const HEAD: [&str; 5] = ["name", "focal mm", "f-number", "surfaces", "title"];

pub(crate) fn run(options: &ListOptions) -> Result<(), CliError> {
    let mut list = Vec::new();
    let mut rows = Vec::new();
    for name in preset::names(PresetKind::Lens) {
        let loaded = preset::lens(name)?;
        let state = LensState::new(&loaded.lens, LensSetting::default())
            .map_err(|problem| LensError::Prescription { name: name.into(), problem })?;
        let (focal_length_mm, surfaces) = (state.paraxial.focal_length_mm, loaded.lens.surfaces.len());
        rows.push(vec![
            name.into(),
            short(focal_length_mm),
            short(state.f_number),
            surfaces.to_string(),
            loaded.title.clone(),
        ]);
        list.push(json!({
            "name": name,
            "title": loaded.title,
            "description": loaded.description,
            "source": loaded.lens.source,
            "assumed": loaded.assumed,
            "focal_length_mm": focal_length_mm,
            "f_number": state.f_number,
            "published_focal_length_mm": loaded.published.focal_length_mm,
            "published_f_number": loaded.published.f_number,
            "surfaces": surfaces,
        }));
    }
    options.print(&list, &HEAD, rows, &[4])
}
