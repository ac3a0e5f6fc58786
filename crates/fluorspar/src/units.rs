//! Physical constants (exact SI values of 2019) and conversions between energy and photons.

/// Planck constant, J s (exact).
pub const PLANCK_J_S: f64 = 6.626_070_15e-34;
/// Speed of light in vacuum, m/s (exact).
pub const LIGHT_SPEED_M_PER_S: f64 = 299_792_458.0;
/// Elementary charge, C (exact).
pub const ELEMENTARY_CHARGE_C: f64 = 1.602_176_634e-19;
/// Boltzmann constant, J/K (exact).
pub const BOLTZMANN_J_PER_K: f64 = 1.380_649e-23;
/// Luminous efficacy of 540 THz light, lm/W (exact).
pub const LUMINOUS_EFFICACY_LM_PER_W: f64 = 683.0;

/// Planck constant that ISETCam uses, J s: 1.6e-5 above the SI value. Only for its compatibility mode.
pub const ISETCAM_PLANCK_J_S: f64 = 6.626_176e-34;
/// Elementary charge that ISETCam uses, C. Only for its compatibility mode.
pub const ISETCAM_ELEMENTARY_CHARGE_C: f64 = 1.602_177e-19;

/// Energy of one photon, J: `h c / lambda`.
pub fn photon_energy_j(wavelength_nm: f64) -> f64 {
    PLANCK_J_S * LIGHT_SPEED_M_PER_S / (wavelength_nm * 1e-9)
}

/// Photons per joule at a wavelength, 1/J: `lambda / (h c)`.
pub fn photons_per_joule(wavelength_nm: f64) -> f64 {
    1.0 / photon_energy_j(wavelength_nm)
}

/// Vacuum wavenumber, 1/cm, of a wavelength in nm.
pub fn wavenumber_per_cm(wavelength_nm: f64) -> f64 {
    1e7 / wavelength_nm
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_green_photon_carries_2_33_electronvolt() {
        let electronvolt = photon_energy_j(532.0) / ELEMENTARY_CHARGE_C;
        assert!((electronvolt - 2.330_530_046_7).abs() < 1e-9, "{electronvolt}");
    }

    #[test]
    fn energy_and_photons_invert_each_other() {
        for wavelength_nm in [350.0, 385.0, 555.5, 750.0] {
            let product = photon_energy_j(wavelength_nm) * photons_per_joule(wavelength_nm);
            assert!((product - 1.0).abs() < 1e-12);
        }
    }
}
