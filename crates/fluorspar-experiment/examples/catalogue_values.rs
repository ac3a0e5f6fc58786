//! Prints the spectra of the catalogue as JSON, for programs that check their own equations against the library's:
//! `cargo run -p fluorspar-experiment --example catalogue_values`.
//!
//! `curves` holds, by `FOLDER/NAME` or `FOLDER/NAME/CHANNEL`, one value per entry of `wavelength_nm`; `fluorophores`, by
//! name, photon yield densities in 1/nm, `[emission][excitation]` on the same wavelengths.

use std::collections::BTreeMap;
use std::error::Error;

use fluorspar::spectral::Curve;
use fluorspar_experiment::preset::{self, PresetKind};
use serde_json::json;

fn main() -> Result<(), Box<dyn Error>> {
    let wavelength_nm: Vec<f64> = (0..=40).map(|i| 350.0 + 10.0 * f64::from(i)).collect();
    let values = |curve: &Curve| -> Vec<f64> { wavelength_nm.iter().map(|&nm| curve.at(nm)).collect() };
    let mut curves = BTreeMap::new();
    for name in preset::names(PresetKind::Light) {
        curves.insert(format!("lights/{name}"), values(&preset::light_spectrum(name)?.curve()));
    }
    for name in preset::names(PresetKind::Filter) {
        curves.insert(format!("filters/{name}"), values(&preset::filter(name)?.curve()));
    }
    for name in preset::names(PresetKind::Reflectance) {
        curves.insert(format!("reflectances/{name}"), values(&preset::reflectance(name)?.curve()));
    }
    for name in preset::names(PresetKind::QuantumEfficiency) {
        for (channel, curve) in preset::quantum_efficiency(name)?.channels()? {
            curves.insert(format!("qe/{name}/{channel}"), values(&curve));
        }
    }
    let mut fluorophores = BTreeMap::new();
    for name in preset::names(PresetKind::Fluorophore) {
        let eem = preset::fluorophore(name)?.fluorophore().eem;
        let row = |&emission: &f64| -> Vec<f64> {
            wavelength_nm.iter().map(|&excitation| eem.at(emission, excitation)).collect()
        };
        fluorophores.insert(name, wavelength_nm.iter().map(row).collect::<Vec<_>>());
    }
    #[expect(clippy::print_stdout, reason = "what the example is for")]
    {
        println!(
            "{}",
            json!({ "wavelength_nm": wavelength_nm, "curves": curves, "fluorophores": fluorophores })
        );
    }
    Ok(())
}
