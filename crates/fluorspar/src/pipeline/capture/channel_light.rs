//! Which light the channels of a frame are of, in a wavelength each.

use super::direct_light::group_spectrum;
use crate::spectral::{Curve, WavelengthGrid};
use crate::study::{Capture, Study};

/// Most standard deviation of a light that one wavelength stands for, nm: LEDs have 5 to 15, white light 80 and more.
const MOST_DEVIATION_NM: f64 = 40.0;

/// Wavelengths that stand for the light of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelLight {
    /// Mean wavelength of the light that excites, nm; `None` of white light, of several light groups, and of none.
    pub excitation_nm: Option<f64>,
    /// Mean wavelength of what each channel of the sensor passes behind all filters, nm; `None` of one that passes nothing.
    pub emission_nm: Vec<Option<f64>>,
}

/// The light of the frames of a capture; no channels without a sensor.
pub fn channel_light(study: &Study, capture: &Capture) -> ChannelLight {
    let grid = &study.scene.grid;
    let mut lit = capture.frame.lights.iter().filter(|(_, drive)| **drive > 0.0);
    let group = lit.next().filter(|_| lit.next().is_none());
    let moments = group.and_then(|(group, _)| moments_nm(&group_spectrum(study, group)?, grid));
    let filter = &study.camera.view_filter.transmittance;
    let passed = |curve: &Curve| {
        let behind = curve.times(filter);
        moments_nm(&capture.filter.as_ref().map_or(behind.clone(), |own| behind.times(own)), grid)
    };
    let channels = study.camera.sensor.iter().flat_map(|sensor| sensor.qe().channels());
    ChannelLight {
        excitation_nm: moments.filter(|[_, deviation]| *deviation <= MOST_DEVIATION_NM).map(|[mean, _]| mean),
        emission_nm: channels.map(|channel| Some(passed(&channel.curve)?[0])).collect(),
    }
}

/// Mean and standard deviation of a curve within a grid, nm; `None` where it is zero.
fn moments_nm(curve: &Curve, grid: &WavelengthGrid) -> Option<[f64; 2]> {
    let values = curve.bin_averages(grid);
    let weighted = |f: &dyn Fn(f64) -> f64| {
        let bins = values.iter().zip(grid.centers_nm()).zip(grid.widths_nm());
        bins.map(|((value, nm), width)| value * width * f(nm)).sum::<f64>()
    };
    let all = weighted(&|_| 1.0);
    let mean = weighted(&|nm| nm) / all;
    let deviation = (weighted(&|nm| (nm - mean).powi(2)) / all).sqrt();
    (all > 0.0).then_some([mean, deviation])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_curve_has_its_middle_and_nothing_has_none() {
        let grid = WavelengthGrid::uniform(400.0, 700.0, 5.0).unwrap();
        let band = Curve::from_fn(400.0, 700.0, |nm| (-0.5 * ((nm - 525.0) / 8.0_f64).powi(2)).exp());
        let [mean, deviation] = moments_nm(&band, &grid).unwrap();
        assert!((mean - 525.0).abs() < 1e-6 && (deviation - 8.0).abs() < 0.3, "{mean} {deviation}");
        assert_eq!(moments_nm(&Curve::constant(0.0), &grid), None);
    }
}
