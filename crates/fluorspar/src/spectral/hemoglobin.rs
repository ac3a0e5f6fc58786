//! Molar extinction of oxygenated and reduced hemoglobin.
//!
//! Source: the compilation of S. Prahl, "Tabulated molar extinction coefficient for hemoglobin in water"
//! (Oregon Medical Laser Center, 1999; data of W. B. Gratzer and N. Kollias), base-10 logarithm, per mole of
//! hemoglobin tetramer (64 500 g/mol). The compilation has a value every 2 nm. Kept here are every tenth
//! nanometer and as many points between as it takes for linear interpolation to stay within 2 % of it everywhere
//! from 350 to 750 nm (values under 1500 /(cm M): within 30 /(cm M)).

/// Molar mass of the hemoglobin tetramer to which the extinctions refer, in g/mol.
pub(crate) const MOLAR_MASS_G_PER_MOL: f64 = 64_500.0;

/// Wavelengths of the table, nm; its ends are held constant beyond.
pub(crate) const RANGE_NM: [f64; 2] = [350.0, 750.0];

/// Rows of wavelength in nm, extinction of HbO2 and extinction of Hb, both in 1/(cm M), base 10.
#[rustfmt::skip]
const MOLAR_EXTINCTION: [[f64; 3]; 91] = [
    [350.0, 106_576.0, 122_092.0], [356.0, 101_568.0, 132_120.0], [360.0, 94_744.0, 134_940.0],
    [366.0, 88_484.0, 137_900.0], [370.0, 88_176.0, 139_968.0], [376.0, 98_936.0, 143_312.0],
    [380.0, 109_564.0, 145_232.0], [386.0, 135_132.0, 153_908.0], [388.0, 148_100.0, 159_544.0],
    [390.0, 167_748.0, 167_780.0], [394.0, 212_060.0, 191_540.0], [400.0, 266_232.0, 223_296.0],
    [404.0, 308_716.0, 253_368.0], [406.0, 354_208.0, 270_548.0], [408.0, 422_320.0, 287_356.0],
    [410.0, 466_840.0, 303_956.0], [414.0, 524_280.0, 342_596.0], [418.0, 515_520.0, 385_680.0],
    [420.0, 480_360.0, 407_560.0], [426.0, 326_032.0, 481_840.0], [430.0, 246_072.0, 528_600.0],
    [432.0, 214_120.0, 552_160.0], [434.0, 165_332.0, 552_160.0], [436.0, 132_820.0, 547_040.0],
    [438.0, 119_140.0, 501_560.0], [440.0, 102_580.0, 413_280.0], [442.0, 92_780.0, 363_240.0],
    [444.0, 81_444.0, 282_724.0], [446.0, 76_324.0, 237_224.0], [448.0, 67_044.0, 173_320.0],
    [450.0, 62_816.0, 103_292.0], [452.0, 58_864.0, 62_640.0], [454.0, 53_552.0, 36_170.0],
    [456.0, 49_496.0, 30_698.8], [458.0, 47_496.0, 25_886.4], [460.0, 44_480.0, 23_388.8],
    [462.0, 41_320.0, 20_891.2], [464.0, 39_807.2, 19_260.8], [470.0, 33_209.2, 16_156.4],
    [472.0, 31_620.0, 15_310.0], [480.0, 26_629.2, 14_550.0], [488.0, 24_174.8, 15_898.0],
    [490.0, 23_684.4, 16_684.0], [500.0, 20_932.8, 20_862.0], [506.0, 19_946.0, 23_774.4],
    [510.0, 20_035.2, 25_773.6], [516.0, 21_001.6, 29_263.2], [520.0, 24_202.4, 31_589.6],
    [524.0, 29_269.2, 34_397.6], [530.0, 39_956.8, 39_036.4], [536.0, 49_752.0, 43_592.0],
    [540.0, 53_236.0, 46_592.0], [544.0, 52_096.0, 49_708.0], [550.0, 43_016.0, 53_412.0],
    [556.0, 34_476.8, 54_540.0], [560.0, 32_613.2, 53_788.0], [564.0, 33_915.6, 50_572.0],
    [566.0, 36_495.2, 48_828.0], [570.0, 44_496.0, 45_072.0], [574.0, 53_308.0, 41_716.0],
    [576.0, 55_540.0, 40_092.0], [578.0, 54_728.0, 38_467.6], [580.0, 50_104.0, 37_020.0],
    [582.0, 43_304.0, 35_676.4], [586.0, 26_600.4, 32_851.6], [588.0, 19_763.2, 31_075.2],
    [590.0, 14_400.8, 28_324.4], [592.0, 10_468.4, 25_470.0], [594.0, 7_678.8, 22_574.8],
    [596.0, 5_683.6, 19_800.0], [600.0, 3_200.0, 14_677.2], [604.0, 2_128.0, 12_567.6],
    [606.0, 1_789.2, 11_513.2], [610.0, 1_506.0, 9_443.6], [614.0, 1_222.8, 7_762.0],
    [620.0, 942.0, 6_509.6], [624.0, 774.0, 5_906.8], [630.0, 610.0, 5_148.8],
    [634.0, 512.4, 4_730.8], [640.0, 442.0, 4_345.2], [650.0, 368.0, 3_750.1],
    [660.0, 319.6, 3_226.6], [670.0, 294.0, 2_795.1], [680.0, 277.6, 2_407.9],
    [690.0, 276.0, 2_052.0], [700.0, 290.0, 1_794.3], [710.0, 314.0, 1_540.5],
    [720.0, 348.0, 1_325.9], [730.0, 390.0, 1_102.2], [740.0, 446.0, 1_115.9],
    [750.0, 518.0, 1_405.2],
];

/// Largest extinction of oxygenated hemoglobin, nm.
const PEAK_NM: f64 = 414.0;

/// Molar extinction (HbO2, Hb) in 1/(cm M), base 10, by linear interpolation.
///
/// Outside 350 to 750 nm the value at the nearer end is returned: the caller states its own range of validity.
#[must_use]
pub(crate) fn molar_extinction(wavelength_nm: f64) -> (f64, f64) {
    let after = MOLAR_EXTINCTION.partition_point(|row| row[0] <= wavelength_nm);
    let low = &MOLAR_EXTINCTION[after.saturating_sub(1)];
    let high = &MOLAR_EXTINCTION[after.min(MOLAR_EXTINCTION.len() - 1)];
    let span = high[0] - low[0];
    let t = if span > 0.0 { (wavelength_nm - low[0]) / span } else { 0.0 };
    (low[1] + t * (high[1] - low[1]), low[2] + t * (high[2] - low[2]))
}

/// Absorption coefficient in 1/cm (natural logarithm) of blood with `grams_per_liter` of hemoglobin at the
/// oxygen saturation `saturation` (0 to 1):
/// `mua = ln(10) * (grams_per_liter / 64500) * [S eps_HbO2 + (1 - S) eps_Hb]`.
#[must_use]
pub(crate) fn absorption_per_cm(wavelength_nm: f64, grams_per_liter: f64, saturation: f64) -> f64 {
    let (oxy, deoxy) = molar_extinction(wavelength_nm);
    std::f64::consts::LN_10 * grams_per_liter / MOLAR_MASS_G_PER_MOL
        * (saturation * oxy + (1.0 - saturation) * deoxy)
}

/// Extinction of oxygenated hemoglobin, base 10, over that at its largest, 414 nm: a layer of optical density `D` passes
/// `10^(-D extinction)`. Outside 350 to 750 nm that of the nearer end.
#[must_use]
pub fn oxyhemoglobin_extinction(wavelength_nm: f64) -> f64 {
    molar_extinction(wavelength_nm).0 / molar_extinction(PEAK_NM).0
}

/// Transmittance of a layer of whole blood (150 g/l hemoglobin, saturation 0.9) of this thickness, µm, without
/// scattering: `exp(-mua d)`. Light that is reflected below the layer passes it twice.
#[must_use]
pub fn blood_transmittance(wavelength_nm: f64, thickness_um: f64) -> f64 {
    (-absorption_per_cm(wavelength_nm, 150.0, 0.9) * thickness_um * 1e-4).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_is_sorted_and_positive() {
        for pair in MOLAR_EXTINCTION.windows(2) {
            assert!(pair[1][0] > pair[0][0]);
        }
        assert!(MOLAR_EXTINCTION.iter().all(|row| row[1] > 0.0 && row[2] > 0.0));
    }

    #[test]
    fn published_values_come_back() {
        for (nm, oxy, deoxy) in [
            (350.0, 106_576.0, 122_092.0),
            (414.0, 524_280.0, 342_596.0),
            (434.0, 165_332.0, 552_160.0),
            (500.0, 20_932.8, 20_862.0),
            (576.0, 55_540.0, 40_092.0),
            (750.0, 518.0, 1_405.24),
        ] {
            let (o, d) = molar_extinction(nm);
            assert!((o - oxy).abs() < 0.1 + 1e-4 * oxy, "{nm}: {o}");
            assert!((d - deoxy).abs() < 0.1 + 1e-4 * deoxy, "{nm}: {d}");
        }
    }

    #[test]
    fn points_between_are_linear() {
        let (low, high) = (molar_extinction(350.0), molar_extinction(356.0));
        let (oxy, deoxy) = molar_extinction(353.0);
        assert!((oxy - 0.5 * (low.0 + high.0)).abs() < 1e-6);
        assert!((deoxy - 0.5 * (low.1 + high.1)).abs() < 1e-6);
    }

    #[test]
    fn ends_are_held() {
        assert_eq!(molar_extinction(300.0), molar_extinction(350.0));
        assert_eq!(molar_extinction(900.0), molar_extinction(750.0));
    }

    #[test]
    fn whole_blood_at_420_nm() {
        // 2.303 * 480360 * 150 / 64500 = 2573 / cm
        assert!((absorption_per_cm(420.0, 150.0, 1.0) - 2573.0).abs() < 2.0);
    }
}
