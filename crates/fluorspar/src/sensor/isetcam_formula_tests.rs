//! Formulas of ISETCam that only comparisons with it need.

use super::isetcam::IsetcamChain;
use super::{Exposure, SensorModel};
use crate::units::{ISETCAM_PLANCK_J_S, LIGHT_SPEED_M_PER_S};

/// Photons per joule with ISETCam's Planck constant, 1/J.
pub(super) fn photons_per_joule(wavelength_nm: f64) -> f64 {
    wavelength_nm * 1e-9 / (ISETCAM_PLANCK_J_S * LIGHT_SPEED_M_PER_S)
}

/// Noise-free voltage at the converter for photo-electrons, V: dark signal (for flag 2), offset, gain and, from
/// flag 0 on, clipping.
pub(super) fn mean_volts(model: &SensorModel, noise_flag: i8, exposure: &Exposure, electrons: f64) -> f64 {
    IsetcamChain::new(model, noise_flag, exposure).mean_volts(electrons)
}

/// Variance of the voltage of noise flag 2 before offset, gain and clipping, V²:
/// `(g mu + read^2) (1 + p^2) + p^2 mu^2 + dsnu^2` for a mean `mu` that includes the dark signal, without column noise.
pub(super) fn volts_variance(model: &SensorModel, mean_volts: f64) -> f64 {
    let volts_per_e = model.conversion_gain_v_per_e();
    let read_v = model.read_noise_electrons() * volts_per_e;
    let dsnu_v = model.dsnu_electrons() * volts_per_e;
    let prnu2 = (model.prnu_percent * 1e-2).powi(2);
    (volts_per_e * mean_volts + read_v * read_v) * (1.0 + prnu2)
        + prnu2 * mean_volts * mean_volts
        + dsnu_v * dsnu_v
}

/// Signal-to-noise ratios of ISETCam's `sensorSNR`, dB; infinite for a noise that the model does not have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SnrDb {
    /// All noises together.
    pub(super) total: f64,
    /// Photon noise alone.
    pub(super) shot: f64,
    /// Read noise alone.
    pub(super) read: f64,
    /// Offsets of the pixels alone.
    pub(super) dsnu: f64,
    /// Responsivities of the pixels alone.
    pub(super) prnu: f64,
}

/// Signal-to-noise ratio at a mean voltage, as ISETCam's `sensorSNR`.
pub(super) fn snr_db(model: &SensorModel, volts: f64) -> SnrDb {
    let volts_per_e = model.conversion_gain_v_per_e();
    let db = |noise_variance: f64| 10.0 * (volts * volts / noise_variance).log10();
    let shot = volts_per_e * volts;
    let read = (model.read_noise_electrons() * volts_per_e).powi(2);
    let dsnu = (model.dsnu_electrons() * volts_per_e).powi(2);
    let prnu = (model.prnu_percent * 1e-2 * volts).powi(2);
    SnrDb {
        total: db(shot + read + dsnu + prnu),
        shot: db(shot),
        read: db(read),
        dsnu: db(dsnu),
        prnu: db(prnu),
    }
}
