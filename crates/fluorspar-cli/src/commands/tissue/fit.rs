//! `fluorspar tissue fit`.

use fluorspar::tissue::fit::{Fit, FittedSpectrum};
use fluorspar::units::number_text;
use fluorspar_session::tissue::FittedTissue;

use crate::commands::table::{align, short};

/// Above this share of the prior's standard deviation the data said little.
const UNSEEN: f64 = 0.9;

/// Where a spectrum is off most: wavelength, and difference relative to the root mean square of the spectrum.
fn worst(spectrum: &FittedSpectrum) -> (f64, f64) {
    let count = spectrum.measured.len() as f64;
    let level = (spectrum.measured.iter().map(|v| v * v).sum::<f64>() / count).sqrt();
    let differences = spectrum.model.iter().zip(&spectrum.measured).map(|(model, v)| (model - v) / level);
    let most = |a: (f64, f64), b: (f64, f64)| if b.1.abs() > a.1.abs() { b } else { a };
    spectrum.wavelengths_nm.iter().copied().zip(differences).fold((0.0, 0.0), most)
}

pub(super) fn describe(FittedTissue { title, fit: found, .. }: &FittedTissue) -> String {
    format!(
        "{title} ({}), fitted in {} steps\n\n{}\n{}",
        found.site.name(),
        found.steps,
        align(&parameter_rows(found), &[7]),
        align(&spectrum_rows(found), &[])
    )
}

/// The fitted parameters, below their heads.
fn parameter_rows(found: &Fit) -> Vec<Vec<String>> {
    let heads = ["parameter", "value", "95 % from", "to", "prior", "from", "to", ""];
    let mut rows = vec![heads.map(String::from).to_vec()];
    rows.extend(found.parameters.iter().map(|p| {
        let [low, high] = p.interval_95.map(short);
        let [prior_low, prior_high] = p.prior_interval_95.map(short);
        let unseen = if p.relative_deviation > UNSEEN { "not seen in these spectra" } else { "" };
        vec![p.name.into(), short(p.value), low, high, short(p.prior), prior_low, prior_high, unseen.into()]
    }));
    rows
}

/// How well each spectrum is met, below the heads.
fn spectrum_rows(found: &Fit) -> Vec<Vec<String>> {
    let mut rows = vec![["spectrum", "relative rms", "most", "at nm", "scale"].map(String::from).to_vec()];
    rows.extend(found.spectra.iter().map(|spectrum| {
        let (nm, difference) = worst(spectrum);
        let scale = spectrum.scale_interval_95.map_or_else(String::new, |[low, high]| {
            format!("{} ({} to {})", short(spectrum.scale), short(low), short(high))
        });
        vec![
            spectrum.name.clone(),
            format!("{:.1} %", 100.0 * spectrum.relative_rms()),
            format!("{:+.1} %", 100.0 * difference),
            number_text(nm),
            scale,
        ]
    }));
    rows
}
