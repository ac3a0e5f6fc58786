//! The analog-to-digital converter.

/// A converter that rounds to the nearest code and clips at both ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Adc {
    /// Largest code.
    pub(super) max_code: u16,
}

impl Adc {
    /// `clamp(round(dn), 0, max_code)`; halves round away from zero.
    #[inline]
    pub(super) fn code(self, dn: f64) -> u16 {
        // What is below 0 clips, so that halves may round up; baseline processors have no instruction for `f64::round`
        (dn.clamp(0.0, f64::from(self.max_code)) + 0.5) as u16
    }
}

/// Standard deviation of rounding to whole codes, DN: `1 / sqrt(12)`.
pub(super) const QUANTIZATION_NOISE_DN: f64 = 0.288_675_134_594_812_9;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_rounded_and_clipped() {
        let adc = Adc { max_code: 4095 };
        assert_eq!(
            [-3.0, 0.49, 0.5, 4094.49, 4094.5, 1e9].map(|dn| adc.code(dn)),
            [0, 0, 1, 4094, 4095, 4095]
        );
        assert_eq!(adc.code(f64::NAN), 0);
        assert!((QUANTIZATION_NOISE_DN - (1.0f64 / 12.0).sqrt()).abs() < 1e-16);
    }
}
