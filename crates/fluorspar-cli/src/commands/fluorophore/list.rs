//! `fluorspar catalog list fluorophore`.

use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_session::fluorophore::peaks_nm;
use serde_json::json;

use crate::commands::table::{ListOptions, short};
use crate::error::CliError;

const HEAD: [&str; 8] =
    ["name", "excitation", "emission", "peaks nm", "photon yield", "quantum yield", "fit error", "title"];

pub(crate) fn run(options: &ListOptions) -> Result<(), CliError> {
    let mut list = Vec::new();
    let mut rows = Vec::new();
    for name in preset::names(PresetKind::Fluorophore) {
        let preset = preset::fluorophore(name)?;
        let [excitation_nm, emission_nm] = peaks_nm(&preset.fluorophore());
        let range = |[first, last]: [f64; 2]| format!("{first:.0}-{last:.0}");
        let fit = &preset.fit;
        let error =
            if fit.cells > 0 { format!("{:.1} %", 100.0 * fit.relative_frobenius) } else { "-".into() };
        rows.push(vec![
            name.into(),
            range(preset.excitation_range_nm),
            range(preset.emission_range_nm),
            format!("{excitation_nm:.0} > {emission_nm:.0}"),
            short(preset.photon_yield),
            preset.published.as_ref().map_or_else(|| "-".into(), |dye| format!("{}", dye.quantum_yield)),
            error,
            preset.title.clone(),
        ]);
        list.push(json!({
            "name": name,
            "title": preset.title,
            "description": preset.description,
            "source": preset.source,
            "excitation_range_nm": preset.excitation_range_nm,
            "emission_range_nm": preset.emission_range_nm,
            "excitation_peak_nm": excitation_nm,
            "emission_peak_nm": emission_nm,
            "photon_yield": preset.photon_yield,
            "quantum_yield": preset.published.as_ref().map(|dye| dye.quantum_yield),
            "relative_fit_error": (fit.cells > 0).then_some(fit.relative_frobenius),
        }));
    }
    options.print(&list, &HEAD, rows, &[7])
}
