//! Action spectra: how much each wavelength counts for a hazard.

use crate::spectral::Curve;

/// The weighting functions of IEC 62471:2006, and that of an eye without its lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActionSpectrum {
    /// `S(lambda)`, 200 to 400 nm: actinic ultraviolet, eye and skin.
    ActinicUv,
    /// 1 from 315 to 400 nm: near ultraviolet, lens of the eye.
    UvA,
    /// `B(lambda)`, 300 to 700 nm: photochemical damage of the retina.
    BlueLight,
    /// `A(lambda)`, 305 to 700 nm: the same for an aphakic or an infant's eye, whose lens does not shield the retina.
    AphakicBlueLight,
    /// `R(lambda)`, 380 to 1400 nm: thermal damage of the retina.
    RetinalThermal,
    /// 1 from 780 to 1400 nm: thermal damage of the retina by invisible light.
    RetinalInfrared,
    /// 1 from 780 to 3000 nm: cornea and lens.
    InfraredEye,
    /// 1 from 380 to 3000 nm: burns of the skin.
    SkinThermal,
}

/// `S(lambda)`: ICNIRP 2004, Table 1; IEC 62471:2006, Table 4.1.
const ACTINIC: [(f64, f64); 54] = [
    (200.0, 0.030),
    (205.0, 0.051),
    (210.0, 0.075),
    (215.0, 0.095),
    (220.0, 0.120),
    (225.0, 0.150),
    (230.0, 0.190),
    (235.0, 0.240),
    (240.0, 0.300),
    (245.0, 0.360),
    (250.0, 0.430),
    (254.0, 0.500),
    (255.0, 0.520),
    (260.0, 0.650),
    (265.0, 0.810),
    (270.0, 1.000),
    (275.0, 0.960),
    (280.0, 0.880),
    (285.0, 0.770),
    (290.0, 0.640),
    (295.0, 0.540),
    (297.0, 0.460),
    (300.0, 0.300),
    (303.0, 0.120),
    (305.0, 0.060),
    (308.0, 0.026),
    (310.0, 0.015),
    (313.0, 0.006),
    (315.0, 0.003),
    (316.0, 0.0024),
    (317.0, 0.0020),
    (318.0, 0.0016),
    (319.0, 0.0012),
    (320.0, 0.0010),
    (322.0, 0.000_67),
    (323.0, 0.000_54),
    (325.0, 0.000_50),
    (328.0, 0.000_44),
    (330.0, 0.000_41),
    (333.0, 0.000_37),
    (335.0, 0.000_34),
    (340.0, 0.000_28),
    (345.0, 0.000_24),
    (350.0, 0.000_20),
    (355.0, 0.000_16),
    (360.0, 0.000_13),
    (365.0, 0.000_11),
    (370.0, 0.000_093),
    (375.0, 0.000_077),
    (380.0, 0.000_064),
    (385.0, 0.000_053),
    (390.0, 0.000_044),
    (395.0, 0.000_036),
    (400.0, 0.000_030),
];

/// `B(lambda)` from 300 to 500 nm: IEC 62471:2006, Table 4.2.
const BLUE: [(f64, f64); 26] = [
    (300.0, 0.01),
    (380.0, 0.01),
    (385.0, 0.013),
    (390.0, 0.025),
    (395.0, 0.05),
    (400.0, 0.10),
    (405.0, 0.20),
    (410.0, 0.40),
    (415.0, 0.80),
    (420.0, 0.90),
    (425.0, 0.95),
    (430.0, 0.98),
    (435.0, 1.00),
    (440.0, 1.00),
    (445.0, 0.97),
    (450.0, 0.94),
    (455.0, 0.90),
    (460.0, 0.80),
    (465.0, 0.70),
    (470.0, 0.62),
    (475.0, 0.55),
    (480.0, 0.45),
    (485.0, 0.40),
    (490.0, 0.22),
    (495.0, 0.16),
    (500.0, 0.10),
];

/// `A(lambda)` below 440 nm, from where it equals `B`: ICNIRP 2013, Table 2.
const APHAKIC: [(f64, f64); 23] = [
    (305.0, 6.00),
    (335.0, 6.00),
    (340.0, 5.88),
    (345.0, 5.71),
    (350.0, 5.46),
    (355.0, 5.22),
    (360.0, 4.62),
    (365.0, 4.29),
    (370.0, 3.75),
    (375.0, 3.56),
    (380.0, 3.19),
    (385.0, 2.31),
    (390.0, 1.88),
    (395.0, 1.58),
    (400.0, 1.43),
    (405.0, 1.30),
    (410.0, 1.25),
    (415.0, 1.20),
    (420.0, 1.15),
    (425.0, 1.11),
    (430.0, 1.07),
    (435.0, 1.03),
    (440.0, 1.00),
];

/// Wavelengths at which products are sampled, nm: fine compared with the 5 nm of the tables.
const STEP_NM: f64 = 0.5;

impl ActionSpectrum {
    /// First and last wavelength that counts, nm.
    pub fn range_nm(self) -> (f64, f64) {
        match self {
            Self::ActinicUv => (200.0, 400.0),
            Self::UvA => (315.0, 400.0),
            Self::BlueLight => (300.0, 700.0),
            Self::AphakicBlueLight => (305.0, 700.0),
            Self::RetinalThermal => (380.0, 1400.0),
            Self::RetinalInfrared => (780.0, 1400.0),
            Self::InfraredEye => (780.0, 3000.0),
            Self::SkinThermal => (380.0, 3000.0),
        }
    }

    /// Weight at a wavelength; 0 outside of the range. `S` is interpolated in its logarithm, as in its source, the
    /// others linearly.
    pub fn at(self, wavelength_nm: f64) -> f64 {
        let (first, last) = self.range_nm();
        if !(first..=last).contains(&wavelength_nm) {
            return 0.0;
        }
        match self {
            Self::ActinicUv => interpolate(&ACTINIC, wavelength_nm, true),
            Self::BlueLight => blue(wavelength_nm),
            Self::AphakicBlueLight if wavelength_nm < 440.0 => interpolate(&APHAKIC, wavelength_nm, false),
            Self::AphakicBlueLight => blue(wavelength_nm),
            // IEC 62471:2006, Table 4.2: ten times B up to 500 nm, 1 up to 700 nm, then falling.
            Self::RetinalThermal if wavelength_nm < 500.0 => 10.0 * blue(wavelength_nm),
            Self::RetinalThermal if wavelength_nm <= 700.0 => 1.0,
            Self::RetinalThermal if wavelength_nm <= 1050.0 => 10f64.powf((700.0 - wavelength_nm) / 500.0),
            Self::RetinalThermal => 0.2,
            Self::UvA | Self::RetinalInfrared | Self::InfraredEye | Self::SkinThermal => 1.0,
        }
    }

    /// `integral f(lambda) w(lambda) dlambda` of an absolute spectrum, in its unit times nm.
    ///
    /// Edges of the range are hit exactly; within it the trapezoidal rule runs over every 0.5 nm and every sample of
    /// the spectrum.
    pub fn weigh(self, spectrum: &Curve) -> f64 {
        let (first, last) = self.range_nm();
        let (start, end) = spectrum.range_nm();
        let (from, to) = (first.max(start), last.min(end));
        if to <= from {
            return 0.0;
        }
        let steps = ((to - from) / STEP_NM).ceil().max(1.0) as usize;
        let mut nodes: Vec<f64> = (0..=steps).map(|i| from + (to - from) * i as f64 / steps as f64).collect();
        nodes.extend(spectrum.wavelengths_nm().iter().copied().filter(|nm| (from..=to).contains(nm)));
        nodes.sort_by(f64::total_cmp);
        let value = |nm: f64| self.at(nm) * spectrum.at(nm);
        nodes.windows(2).map(|pair| 0.5 * (value(pair[0]) + value(pair[1])) * (pair[1] - pair[0])).sum()
    }
}

fn blue(wavelength_nm: f64) -> f64 {
    if wavelength_nm <= 500.0 {
        interpolate(&BLUE, wavelength_nm, false)
    } else if wavelength_nm <= 600.0 {
        10f64.powf((450.0 - wavelength_nm) / 50.0)
    } else {
        0.001
    }
}

fn interpolate(table: &[(f64, f64)], nm: f64, in_logarithm: bool) -> f64 {
    let right = table.partition_point(|row| row.0 < nm).clamp(1, table.len() - 1);
    let ((x0, y0), (x1, y1)) = (table[right - 1], table[right]);
    let t = ((nm - x0) / (x1 - x0)).clamp(0.0, 1.0);
    if in_logarithm && y0 > 0.0 && y1 > 0.0 {
        (y0.ln() + t * (y1 / y0).ln()).exp()
    } else {
        y0 + t * (y1 - y0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tabulated_values_are_met_and_ranges_end() {
        let near = |got: f64, expected: f64| assert!((got - expected).abs() <= 1e-9 * expected, "{got}");
        near(ActionSpectrum::ActinicUv.at(270.0), 1.0);
        near(ActionSpectrum::ActinicUv.at(385.0), 5.3e-5);
        near(ActionSpectrum::ActinicUv.at(400.0), 3.0e-5);
        // Between 380 and 385 nm: the geometric mean.
        near(ActionSpectrum::ActinicUv.at(382.5), (6.4e-5f64 * 5.3e-5).sqrt());
        near(ActionSpectrum::BlueLight.at(385.0), 0.013);
        near(ActionSpectrum::BlueLight.at(550.0), 0.01);
        near(ActionSpectrum::BlueLight.at(650.0), 0.001);
        near(ActionSpectrum::AphakicBlueLight.at(385.0), 2.31);
        near(ActionSpectrum::AphakicBlueLight.at(460.0), 0.8);
        near(ActionSpectrum::RetinalThermal.at(405.0), 2.0);
        near(ActionSpectrum::RetinalThermal.at(600.0), 1.0);
        near(ActionSpectrum::RetinalThermal.at(1050.0), 10f64.powf(-0.7));
        for (spectrum, outside) in [
            (ActionSpectrum::ActinicUv, 400.1),
            (ActionSpectrum::UvA, 314.9),
            (ActionSpectrum::BlueLight, 700.1),
            (ActionSpectrum::RetinalThermal, 379.9),
            (ActionSpectrum::InfraredEye, 779.0),
        ] {
            assert_eq!(spectrum.at(outside), 0.0, "{spectrum:?}");
        }
    }

    /// Share of the radiant power of LEDs (Gaussian, 12 nm full width at half maximum) that counts. Blue light: computed
    /// once with another program from the same tables, to the digits given. UV-A: the normal distribution function at
    /// 400 nm.
    #[test]
    fn leds_have_the_known_efficacies() {
        for (peak_nm, blue_share, uva_share) in [
            (365.0, 0.010, 1.0),
            (385.0, 0.018, 0.998_37),
            (395.0, 0.067, 0.836_74),
            (405.0, 0.26, 0.163_26),
            (415.0, 0.69, 0.001_63),
            (420.0, 0.85, 0.000_04),
            (435.0, 0.99, 0.0),
            (450.0, 0.93, 0.0),
            (470.0, 0.62, 0.0),
        ] {
            let sigma = 12.0 / (8.0 * std::f64::consts::LN_2).sqrt();
            let led = Curve::from_fn(300.0, 600.0, |nm| (-0.5 * ((nm - peak_nm) / sigma).powi(2)).exp());
            let share = |spectrum: ActionSpectrum| spectrum.weigh(&led) / led.total();
            // Half a unit of the last digit given.
            let blue = share(ActionSpectrum::BlueLight);
            let digit = if blue_share < 0.1 { 5e-4 } else { 5e-3 };
            assert!((blue - blue_share).abs() <= 1.1 * digit, "{peak_nm}: {blue}");
            let uva = share(ActionSpectrum::UvA);
            // The trapezoidal rule cut at 400 nm: h² / 12 times the slope there, at most 2.0e-4.
            assert!((uva - uva_share).abs() <= 2.5e-4, "{peak_nm}: {uva}");
        }
    }
}
