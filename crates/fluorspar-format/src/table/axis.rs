//! Wavelength axes of files.

use std::path::Path;

use crate::FormatError;

/// Checks that wavelengths increase and are in nanometers. `line` gives the line of each of them in a text file.
pub(crate) fn check_axis(
    path: &Path,
    what: &str,
    wavelength_nm: &[f64],
    line: impl Fn(usize) -> Option<u64>,
) -> Result<(), FormatError> {
    let refuse =
        |index: usize, what: String, hint: &str| Err(FormatError::at_line(path, line(index), what, hint));
    if let Some(index) = wavelength_nm.iter().position(|nm| !nm.is_finite()) {
        let what = format!("{what} wavelength number {} is {}", index + 1, wavelength_nm[index]);
        return refuse(index, what, "Give every wavelength in nm");
    }
    if let (Some(&first), Some(&last)) = (wavelength_nm.first(), wavelength_nm.last()) {
        let (low, high) = (first.min(last), first.max(last));
        if low < 100.0 || high > 20_000.0 {
            let hint = if low > 0.0 && high < 1e-4 {
                "They look like meters: multiply by 1e9"
            } else if low > 0.0 && high < 30.0 {
                "They look like micrometers: multiply by 1000"
            } else {
                "Give them in nanometers"
            };
            let what = format!("{what} wavelengths run from {first} to {last}, not between 100 and 20000 nm");
            return refuse(0, what, hint);
        }
    }
    for (index, pair) in wavelength_nm.windows(2).enumerate() {
        if pair[1] == pair[0] {
            let what = format!("{what} wavelength {} nm appears twice", pair[1]);
            return refuse(index + 1, what, "Keep one value per wavelength");
        }
        if pair[1] < pair[0] {
            let what = format!("{what} wavelength {} nm follows {} nm", pair[1], pair[0]);
            return refuse(index + 1, what, "Sort by wavelength, shortest first");
        }
    }
    Ok(())
}
