//! Random free paths and directions, without branches and transcendental functions.

use rand::Rng;
use rand_distr::{Distribution, Exp1};

use crate::sampling::random::KeyedRng;

/// Uniform in `[0, 1)`, a multiple of 2^-53.
#[inline(always)]
pub(super) fn uniform(rng: &mut KeyedRng) -> f64 {
    (rng.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// Optical depth to the next collision: exponential with mean 1.
#[inline(always)]
pub(super) fn free_path(rng: &mut KeyedRng) -> f64 {
    Exp1.sample(rng)
}

/// Coefficients of `sin(x) = x + x^3 P(x^2)` below pi/4, from the highest power down, with an error below 1e-16: Moshier,
/// Methods and Programs for Mathematical Functions (Cephes), 1989.
const SINE: [f64; 6] = [
    1.589_623_015_765_465_7e-10,
    -2.505_074_776_285_780_7e-8,
    2.755_731_362_138_572_5e-6,
    -1.984_126_982_958_954e-4,
    8.333_333_333_322_118e-3,
    -1.666_666_666_666_663e-1,
];
/// The same of `cos(x) = 1 - x^2 / 2 + x^4 P(x^2)`.
const COSINE: [f64; 6] = [
    -1.135_853_652_138_768_2e-11,
    2.087_570_084_197_473e-9,
    -2.755_731_417_929_674e-7,
    2.480_158_728_885_170_5e-5,
    -1.388_888_888_887_305_6e-3,
    4.166_666_666_666_659_3e-2,
];

#[inline(always)]
fn polynomial(coefficients: &[f64; 6], x: f64) -> f64 {
    let [a, b, c, d, e, f] = *coefficients;
    ((((a * x + b) * x + c) * x + d) * x + e) * x + f
}

/// Cosine and sine of a uniform angle in `[0, 2 pi)`: those of an angle in `[-pi/4, pi/4)`, which two more random bits move
/// into the other octants. No argument is reduced.
#[inline(always)]
pub(super) fn azimuth(rng: &mut KeyedRng) -> (f64, f64) {
    let bits = rng.next_u64();
    let angle = ((bits << 2) as i64 >> 11) as f64 * (std::f64::consts::FRAC_PI_4 / (1u64 << 52) as f64);
    let z = angle * angle;
    let sin = angle + angle * z * polynomial(&SINE, z);
    let cos = 1.0 - 0.5 * z + z * z * polynomial(&COSINE, z);
    let sign = bits & (1 << 63);
    let (x, y) = if bits & (1 << 62) == 0 { (cos, sin) } else { (sin, cos) };
    (f64::from_bits(x.to_bits() ^ sign), f64::from_bits(y.to_bits() ^ sign))
}

/// Constants of the phase function of Henyey and Greenstein (1941) for one anisotropy factor `g`.
#[derive(Clone, Copy, Debug)]
pub(super) struct HenyeyGreenstein {
    g: f64,
    half_g: f64,
    /// `1 + g^2`.
    plus: f64,
    /// `3 - g^2`.
    three_minus: f64,
}

impl HenyeyGreenstein {
    pub(super) fn new(g: f64) -> Self {
        Self { g, half_g: 0.5 * g, plus: 1.0 + g * g, three_minus: 3.0 - g * g }
    }

    /// Mean cosine of the scattering angle.
    #[inline(always)]
    pub(super) fn anisotropy(&self) -> f64 {
        self.g
    }

    /// Cosine of the scattering angle.
    ///
    /// Inverting the distribution function gives `cos = (1 + g^2 - ((1 - g^2) / (1 + g s))^2) / (2 g)` with `s` uniform in
    /// `[-1, 1)`. Multiplied out, the `g` below the line cancels: nothing is lost near `g = 0`, and no case is special.
    #[inline(always)]
    pub(super) fn cosine(&self, rng: &mut KeyedRng) -> f64 {
        let s = 2.0 * uniform(rng) - 1.0;
        let inverse = 1.0 / (1.0 + self.g * s);
        let scaled = self.plus * s;
        (scaled + self.half_g * (scaled * s + self.three_minus)) * (inverse * inverse)
    }
}

/// A unit vector.
pub(super) type Direction = [f64; 3];

/// Turns a direction by an angle of cosine `cos` about a uniform azimuth.
///
/// The two vectors across the direction are those of Duff et al., Building an orthonormal basis, revisited, JCGT 6(1), 2017.
#[inline(always)]
pub(super) fn turn([x, y, z]: Direction, cos: f64, rng: &mut KeyedRng) -> Direction {
    let sin2 = 1.0 - cos * cos;
    let sin = if sin2 > 0.0 { sin2.sqrt() } else { 0.0 };
    let (cos_azimuth, sin_azimuth) = azimuth(rng);
    let (p, q) = (sin * cos_azimuth, sin * sin_azimuth);
    let sign = 1.0_f64.copysign(z);
    let a = -1.0 / (sign + z);
    let b = x * y * a;
    [
        p * (1.0 + sign * x * x * a) + q * b + cos * x,
        p * sign * b + q * (sign + y * y * a) + cos * y,
        -p * sign * x - q * y + cos * z,
    ]
}

/// A direction that is uniform over the sphere.
#[inline]
pub(super) fn isotropic(rng: &mut KeyedRng) -> Direction {
    let z = 2.0 * uniform(rng) - 1.0;
    let sin = (1.0 - z * z).sqrt();
    let (cos_azimuth, sin_azimuth) = azimuth(rng);
    [sin * cos_azimuth, sin * sin_azimuth, z]
}

#[cfg(test)]
mod tests {
    use fluorspar_testkit::kolmogorov_smirnov;

    use super::*;
    use crate::sampling::random::Key;

    const DRAWS: usize = 20_000;

    #[test]
    fn cosines_follow_henyey_and_greenstein() {
        for (place, g) in [-0.9, -1e-9, 0.0, 1e-12, 0.3, 0.75, 0.97].into_iter().enumerate() {
            let phase = HenyeyGreenstein::new(g);
            let mut rng = Key::new(1).with(place as u64).rng();
            let mut cosines: Vec<f64> = (0..DRAWS).map(|_| phase.cosine(&mut rng)).collect();
            assert!(cosines.iter().all(|cos| cos.abs() <= 1.0 + 1e-14), "g = {g}");
            let distribution = |cos: f64| {
                if g.abs() < 1e-6 {
                    return 0.5 * (1.0 + cos);
                }
                // The integral of the phase function from -1.
                (1.0 - g * g) / (2.0 * g) * ((1.0 + g * g - 2.0 * g * cos).sqrt().recip() - 1.0 / (1.0 + g))
            };
            let p_value = kolmogorov_smirnov(&mut cosines, distribution);
            assert!(p_value > 1e-4, "g = {g}: {p_value}");
        }
    }

    #[test]
    fn azimuths_are_uniform_and_on_the_unit_circle() {
        let mut rng = Key::new(2).rng();
        let mut turns: Vec<f64> = (0..DRAWS)
            .map(|_| {
                let (cos, sin) = azimuth(&mut rng);
                assert!((cos.hypot(sin) - 1.0).abs() < 4e-16, "{cos} {sin}");
                sin.atan2(cos)
            })
            .collect();
        let pi = std::f64::consts::PI;
        assert!(kolmogorov_smirnov(&mut turns, |angle| (angle + pi) / (2.0 * pi)) > 1e-4);
    }

    #[test]
    fn a_turn_keeps_the_angle_and_the_length() {
        let mut rng = Key::new(3).rng();
        for direction in
            [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.48, 0.64, 0.6], [1.0, 0.0, 0.0]]
        {
            for cos in [-1.0, -0.3, 0.0, 0.9, 1.0] {
                let turned = turn(direction, cos, &mut rng);
                let dot: f64 = turned.iter().zip(&direction).map(|(a, b)| a * b).sum();
                let length: f64 = turned.iter().map(|a| a * a).sum();
                assert!((dot - cos).abs() < 1e-14 && (length - 1.0).abs() < 1e-14, "{direction:?} {cos}");
            }
        }
    }

    #[test]
    fn free_paths_are_exponential() {
        let mut rng = Key::new(4).rng();
        let mut paths: Vec<f64> = (0..DRAWS).map(|_| free_path(&mut rng)).collect();
        assert!(kolmogorov_smirnov(&mut paths, |path| 1.0 - (-path).exp()) > 1e-4);
    }
}
