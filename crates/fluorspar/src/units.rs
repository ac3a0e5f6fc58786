//! Physical constants (exact SI values of 2019), conversions between energy and photons, numbers and sizes of memory in
//! words.

pub use fluorspar_accel::memory_is_available;

/// Planck constant, J s (exact).
pub const PLANCK_J_S: f64 = 6.626_070_15e-34;
/// Speed of light in vacuum, m/s (exact).
pub const LIGHT_SPEED_M_PER_S: f64 = 299_792_458.0;
/// Luminous efficacy of 540 THz light, lm/W (exact).
pub const LUMINOUS_EFFICACY_LM_PER_W: f64 = 683.0;

/// Planck constant that ISETCam uses, J s: 1.6e-5 above the SI value. Only for its compatibility mode.
pub const ISETCAM_PLANCK_J_S: f64 = 6.626_176e-34;

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

/// A number as short as it can be typed: `0.5`, `1000000`, `1e99`, `1e-7`.
pub fn number_text(value: f64) -> String {
    if value == 0.0 || (1e-4..1e9).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

/// A number of things in words: `1 light`, `3 lights`.
pub fn counted(number: usize, one: &str, many: &str) -> String {
    format!("{number} {}", if number == 1 { one } else { many })
}

/// Refuses a number outside a range, ends included, and NaN: `1e99 is outside 0.1 to 1000; give kelvin`.
///
/// # Errors
/// That sentence, for a number outside the range.
pub fn check_range(value: f64, [low, high]: [f64; 2], hint: &str) -> Result<(), String> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    let [value, low, high] = [value, low, high].map(number_text);
    Err(format!("{value} is outside {low} to {high}; {hint}"))
}

/// An amount of memory in words: `12.3 MiB`, three digits and rounded up, so that the stated amount suffices.
pub fn memory_text(bytes: u64) -> String {
    memory_with(bytes, memory_unit(bytes), 2)
}

/// Two different amounts of memory in words, in one unit and with so many digits that they differ: `8.005 GiB` and
/// `8.003 GiB`. Rounded up.
pub fn memory_texts(a: u64, b: u64) -> [String; 2] {
    let unit = memory_unit(a.max(b));
    let both = |digits| [a, b].map(|bytes| memory_with(bytes, unit, digits));
    // Nine digits after the point tell single bytes of a GiB; above 1 TiB a few bytes may look alike.
    (2..9).map(both).find(|[a, b]| a != b).unwrap_or_else(|| both(9))
}

/// An amount of memory in GiB, rounded up to three digits: a limit that suffices.
pub fn memory_gib(bytes: u64) -> f64 {
    let gib = bytes as f64 / (1u64 << 30) as f64;
    let scale = 10f64.powi((2.0 - gib.max(1e-9).log10().floor()).max(0.0) as i32);
    (gib * scale).ceil() / scale
}

/// A number with so many digits that mean something, whatever its size: `0.0512`, `123.4`, `5.12e-7`.
pub fn digits_text(value: f64, digits: usize) -> String {
    let size = value.abs();
    let decimals = digits.saturating_sub(1);
    if value == 0.0 {
        "0".into()
    } else if !(1e-3..1e6).contains(&size) {
        format!("{value:.decimals$e}")
    } else {
        let decimals = (decimals as f64 - size.log10().floor()).clamp(0.0, 6.0) as usize;
        format!("{value:.decimals$}")
    }
}

const MEMORY_UNITS: [&str; 4] = ["bytes", "KiB", "MiB", "GiB"];

/// The largest unit of which there is one.
fn memory_unit(bytes: u64) -> usize {
    (1..MEMORY_UNITS.len()).rev().find(|&unit| bytes >> (10 * unit) > 0).unwrap_or(0)
}

/// With at least so many digits after the first one.
fn memory_with(bytes: u64, unit: usize, digits: usize) -> String {
    let value = bytes as f64 / (1u64 << (10 * unit)) as f64;
    let whole_digits = (value.max(1.0).log10().floor() as usize).min(digits);
    let decimals = if unit == 0 { 0 } else { digits - whole_digits };
    let scale = 10f64.powi(decimals as i32);
    format!("{:.decimals$} {}", (value * scale).ceil() / scale, MEMORY_UNITS[unit])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_are_asked_for() {
        let shown = [0.0, 0.051_234, -123.456, 99_999.6, 5.1234e-7, 2e6].map(|value| digits_text(value, 3));
        assert_eq!(shown, ["0", "0.0512", "-123", "100000", "5.12e-7", "2.00e6"]);
    }

    #[test]
    fn numbers_are_shown_as_they_would_be_typed() {
        let shown = [0.0, 0.5, -3.0, 1e99, 1e-7, 1e6, f64::NAN, f64::INFINITY].map(number_text);
        assert_eq!(shown, ["0", "0.5", "-3", "1e99", "1e-7", "1000000", "NaN", "inf"]);
        assert!(shown.iter().all(|text| text.parse::<f64>().is_ok()));
    }

    #[test]
    fn memory_is_told_with_three_digits_and_never_too_little() {
        let said = [0, 1, 1023, 1024, 1025, 1 << 20, (1 << 20) + 1, 13_000_000, 500 << 20, 3 << 30, 1 << 40];
        let expected = [
            "0 bytes",
            "1 bytes",
            "1023 bytes",
            "1.00 KiB",
            "1.01 KiB",
            "1.00 MiB",
            "1.01 MiB",
            "12.4 MiB",
            "500 MiB",
            "3.00 GiB",
            "1024 GiB",
        ];
        assert_eq!(said.map(memory_text), expected);
    }

    #[test]
    fn a_limit_in_gib_suffices_and_is_short() {
        for bytes in [1_100_000, 1_500_000, 12_345_678, 1 << 30, (8 << 30) + 1, 123 << 30] {
            let gib = memory_gib(bytes);
            assert!((gib * (1u64 << 30) as f64) as u64 >= bytes, "{bytes}");
            assert!(gib.to_string().len() <= 12, "{gib}");
        }
        assert_eq!([1_500_000, (8 << 30) + 1].map(memory_gib), [0.0014, 8.01]);
    }

    #[test]
    fn amounts_that_differ_look_different() {
        assert_eq!(memory_texts(8 << 30, 4 << 30), ["8.00 GiB", "4.00 GiB"]);
        assert_eq!(memory_texts((8 << 30) + 1, 8 << 30), ["8.01 GiB", "8.00 GiB"]);
        // 8.0049 and 8.0029 GiB.
        assert_eq!(memory_texts((8 << 30) + (5 << 20), (8 << 30) + (3 << 20)), ["8.005 GiB", "8.003 GiB"]);
        assert_eq!(memory_texts(1 << 30, 1 << 20), ["1.00 GiB", "0.01 GiB"]);
        let [a, b] = memory_texts((1 << 30) + 1, 1 << 30);
        assert_ne!(a, b);
    }

    #[test]
    fn a_green_photon_carries_2_33_electronvolt() {
        const ELEMENTARY_CHARGE_C: f64 = 1.602_176_634e-19;
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
