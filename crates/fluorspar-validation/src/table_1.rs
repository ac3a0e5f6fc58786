//! Table 1: geometry and electronics of the sensor.

use fluorspar::sensor::{CharacterizationSettings, SensorModel, characterize};

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{Setup, ValidationError, sensor};
use fluorspar_report::figures::{PhotonTransferPlot, photon_transfer};

/// The printed values: what, value, its last digit, unit, and the same of a sensor model.
type Row = (&'static str, f64, f64, &'static str, fn(&SensorModel) -> f64);

const PRINTED: [Row; 10] = [
    ("pixel size", 2.5, 0.1, "um", |m| m.pixel_size_um),
    ("fill factor", 0.99, 0.01, "", |m| m.fill_factor),
    ("well capacity", 9000.0, 1.0, "e-", |m| m.well_capacity_e),
    ("voltage swing", 0.911, 0.001, "V", |m| m.voltage_swing_v),
    ("conversion gain", 0.10, 0.01, "mV/e-", |m| 1e3 * m.conversion_gain_v_per_e()),
    ("bits", 12.0, 1.0, "", |m| f64::from(m.bit_depth)),
    ("DSNU", 0.2536, 1e-4, "mV", |m| 1e3 * m.conversion_gain_v_per_e() * m.dsnu_electrons()),
    ("PRNU", 2.29, 0.01, "%", |m| m.prnu_percent),
    ("dark voltage", 0.15, 0.01, "mV/s", |m| 1e3 * m.conversion_gain_v_per_e() * m.dark_electrons_per_s()),
    ("read noise", 1.39, 0.01, "mV", |m| 1e3 * m.conversion_gain_v_per_e() * m.read_noise_electrons()),
];

/// How far a measured quantity may lie from the set one: the promises of the estimator, which its own tests hold.
const PROMISES: [(&str, f64); 6] = [
    ("system gain", 0.02),
    ("temporal dark noise", 0.02),
    ("full scale", 0.01),
    ("DSNU", 0.05),
    ("PRNU", 0.02),
    ("dark current", 0.02),
];

/// A smaller region and fewer frames than the command takes by default. Relative errors of variances are `sqrt(2 / pixels)`,
/// 0.5 % here, and a quarter of the promises or less in all that follows from them.
const SETTINGS: CharacterizationSettings = CharacterizationSettings {
    region: [320, 240],
    exposure_s: 0.01,
    gain: 1.0,
    levels: 25,
    stack: 16,
    seed: 0,
};

pub(super) fn run(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let sample = setup.sample(&[])?;
    let sensor = sensor(&sample)?;
    let model = sensor.model();
    let printed = PRINTED.map(|(what, value, digit, unit, of)| {
        Check::near(what, value, 0.5 * digit, of(model), unit, "half a unit of the last printed digit")
    });
    let measured = characterize(sensor, &SETTINGS)?;
    let recovered = PROMISES.iter().filter_map(|&(quantity, promise)| {
        let found = measured.recovered.iter().find(|r| r.quantity == quantity)?;
        let why = "promise of the estimator, held by tests of other sensors";
        let what = format!("{quantity}, measured back from simulated flats and darks, over what was set");
        Some(Check::within(what, [1.0 - promise, 1.0 + promise], found.measured / found.set, "", why))
    });
    // The printed gain and capacity give a swing that is not the printed one
    let (capacity, swing) = (model.well_capacity_e, model.voltage_swing_v);
    let reason = format!(
        "The ten values are those of the catalogue, and measuring simulated frames gives them back. The printed gain is \
         rounded: {} e- x 0.10 mV/e- = {:.3} V, while the table has a swing of {swing} V; {swing} V / {} e- = {:.4} mV/e- is \
         used. Quantum efficiency, number of pixels and black level are not in the table.",
        number(capacity),
        capacity * 1e-4,
        number(capacity),
        1e3 * swing / capacity
    );
    Ok(Outcome::new(Verdict::Reproduced, reason)
        .checks(printed)
        .checks(recovered)
        .show("table_1_photon_transfer", photon_transfer(&PhotonTransferPlot::of(&measured))))
}
