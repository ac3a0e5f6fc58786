//! Colors as smooth spectra.
//!
//! Mallett and Yuksel, Spectral primary decomposition for rendering with sRGB reflectance (EGSR 2019): three spectra
//! between 0 and 1 whose sum is 1 everywhere, each of which under daylight D65 has the color of one primary of sRGB. A color
//! `(r, g, b)` becomes `r R + g G + b B`, which comes back exactly and stays between 0 and 1. The tables are our own: the
//! smoothest such spectra (least sum of squared second differences) on the tables of the CIE that this program uses.

use fluorspar::spectral::Curve;

/// First wavelength of the tables, nm; beyond them the first and last values hold.
const FIRST_NM: f64 = 380.0;
const STEP_NM: f64 = 10.0;

/// Red, every 10 nm from 380 nm on.
#[rustfmt::skip]
const RED: [f64; 41] = [
    0.26293, 0.22035, 0.1778, 0.13536, 0.09343, 0.05342, 0.0195, 0.0, 0.0, 0.0,
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.03775,
    0.20315, 0.46455, 0.73309, 0.92357, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0,
    1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0,
    1.0,
];

/// Green, at the same wavelengths.
#[rustfmt::skip]
const GREEN: [f64; 41] = [
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01181, 0.10487,
    0.28155, 0.50595, 0.72658, 0.89542, 0.98407, 1.0, 1.0, 1.0, 0.99503, 0.92654,
    0.74779, 0.49679, 0.24912, 0.07377, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0,
];

/// The spectra of full red, green and blue, from 200 to 1200 nm; they add up to 1.
pub fn primaries() -> [Curve; 3] {
    let table = |value: &dyn Fn(usize) -> f64| {
        let last = RED.len() - 1;
        let inner = (0..=last).map(|i| (FIRST_NM + STEP_NM * i as f64, value(i)));
        let (nm, values): (Vec<f64>, Vec<f64>) =
            [(200.0, value(0))].into_iter().chain(inner).chain([(1200.0, value(last))]).unzip();
        // The wavelengths rise and the values are finite.
        Curve::new(nm, values).unwrap_or_else(|_| Curve::constant(0.0))
    };
    [table(&|i| RED[i]), table(&|i| GREEN[i]), table(&|i| 1.0 - RED[i] - GREEN[i])]
}

/// The smooth spectrum of a linear sRGB color; components below 0 count as 0.
pub fn color_spectrum(rgb: [f64; 3]) -> Curve {
    let [red, green, blue] = rgb.map(|value| value.max(0.0));
    let [r, g, b] = primaries();
    let nm = r.wavelengths_nm().to_vec();
    let sum = |i: usize| red * r.values()[i] + green * g.values()[i] + blue * b.values()[i];
    let values = (0..nm.len()).map(sum).collect();
    Curve::new(nm, values).unwrap_or_else(|_| Curve::constant(0.0))
}

#[cfg(test)]
mod tests {
    use fluorspar::spectral::{StandardObserver, WavelengthGrid, daylight_d65, linear_srgb};

    use super::*;

    /// Largest error of a color that was made a spectrum and seen under D65, over the corners and the middle of the cube of
    /// colors: the tables are rounded to 1e-5, and D65 of the tables differs from its rounded white point by 2.5e-4.
    #[test]
    fn colors_come_back() {
        let grid = WavelengthGrid::uniform(360.0, 830.0, 1.0).unwrap();
        let observer = StandardObserver::new(&grid);
        let seen = |reflectance: &Curve| {
            let light = daylight_d65().times(reflectance).bin_averages(&grid);
            observer.xyz(&light.iter().map(|value| *value as f32).collect::<Vec<_>>())
        };
        let white = seen(&Curve::constant(1.0))[1];
        let mut largest = 0.0_f64;
        for corner in 0..27 {
            let rgb = [corner % 3, corner / 3 % 3, corner / 9].map(|level| f64::from(level) * 0.5);
            let back = linear_srgb(seen(&color_spectrum(rgb)).map(|value| value / white));
            largest = rgb.iter().zip(back).fold(largest, |most, (a, b)| most.max((a - b).abs()));
        }
        assert!(largest < 5e-4, "{largest}");
    }

    #[test]
    fn primaries_are_reflectances_that_add_up_to_one() {
        let all = primaries();
        for nm in (350..800).map(f64::from) {
            let values = all.each_ref().map(|curve| curve.at(nm));
            assert!(values.iter().all(|value| (-1e-9..=1.0).contains(value)), "{nm}: {values:?}");
            assert!((values.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        assert_eq!(color_spectrum([-1.0, 0.0, 0.0]).max(), 0.0);
    }
}
