//! Counter-based random numbers: every draw is a function of a seed and of what the draw is for.
//!
//! Nothing is stored and nothing advances between pixels, so a result has the same bits for any number of
//! threads and any order of rows. A purpose (seed, frame, pixel, noise source) is hashed into a [`Key`]; a key
//! starts a [`KeyedRng`], which costs nothing to make and feeds the distributions of `rand_distr`.
//!
//! Both steps use the output function of SplitMix64 [^steele2014] with the constants of Stafford's "Mix13"
//! variant, as in Vigna's reference code [^vigna]: a bijection of 64-bit words in which every input bit flips
//! every output bit with a probability close to one half. Not for cryptography.
//!
//! [^steele2014]: Steele, Lea, Flood, Fast splittable pseudorandom number generators, OOPSLA 2014, 453-472,
//!     doi:10.1145/2660193.2660195.
//! [^vigna]: <https://prng.di.unimi.it/splitmix64.c>, public domain.

use std::convert::Infallible;

use rand::{TryRng, rand_core::utils};
use rand_distr::{Distribution, StandardNormal};

/// Step of the Weyl sequence under SplitMix64: the odd integer nearest to `2^64 / golden ratio`.
const GOLDEN_GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// Output function of SplitMix64: a bijection that scatters the bits of a word.
#[inline]
pub fn mix(word: u64) -> u64 {
    let word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    word ^ (word >> 31)
}

/// Hashed purpose of a random number: a seed followed by any number of identifiers, order included.
///
/// ```
/// use fluorspar::sampling::random::Key;
/// let frame = Key::new(7).with(3).with_text("blue");
/// assert_ne!(frame.with(0), frame.with(1));
/// assert_ne!(Key::new(1).with(2), Key::new(2).with(1));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Key(u64);

impl Key {
    /// The key of a seed alone.
    #[inline]
    pub fn new(seed: u64) -> Self {
        Self(mix(seed.wrapping_add(GOLDEN_GAMMA)))
    }

    /// This key narrowed by one more identifier. Different identifiers of one key never collide.
    #[inline]
    #[must_use]
    pub fn with(self, id: u64) -> Self {
        Self(mix((self.0 ^ id).wrapping_add(GOLDEN_GAMMA)))
    }

    /// This key narrowed by a name.
    #[must_use]
    pub fn with_text(self, text: &str) -> Self {
        text.bytes().fold(self.with(text.len() as u64), |key, byte| key.with(u64::from(byte)))
    }

    /// The hash itself.
    #[inline]
    pub fn value(self) -> u64 {
        self.0
    }

    /// The first standard normal draw of the generator that starts at this key.
    #[inline]
    pub fn normal(self) -> f64 {
        StandardNormal.sample(&mut self.rng())
    }

    /// A generator that starts at this key.
    #[inline]
    pub fn rng(self) -> KeyedRng {
        KeyedRng { state: self.0 }
    }
}

/// SplitMix64 from a [`Key`]: eight bytes of state, for the few draws that one purpose needs.
#[derive(Clone, Debug)]
pub struct KeyedRng {
    state: u64,
}

impl TryRng for KeyedRng {
    type Error = Infallible;

    #[inline]
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok((self.try_next_u64()? >> 32) as u32)
    }

    #[inline]
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        self.state = self.state.wrapping_add(GOLDEN_GAMMA);
        Ok(mix(self.state))
    }

    #[inline]
    fn try_fill_bytes(&mut self, dst: &mut [u8]) -> Result<(), Infallible> {
        utils::fill_bytes_via_next_word(dst, || self.try_next_u64())
    }
}

#[cfg(test)]
mod tests {
    use fluorspar_testkit::chi_square;
    use rand::{Rng, RngExt};

    use super::*;

    #[test]
    fn the_generator_is_splitmix64() {
        // First outputs of Vigna's reference code for this state.
        let mut rng = KeyedRng { state: 1_477_776_061_723_855_037 };
        for expected in [1_985_237_415_132_408_290, 2_979_275_885_539_914_483, 13_511_426_838_097_143_398] {
            assert_eq!(rng.next_u64(), expected);
        }
    }

    #[test]
    fn keys_are_stable() {
        // A change here changes every noisy image ever made: say so in the release notes.
        assert_eq!(Key::new(0).value(), 0xe220_a839_7b1d_cdaf);
        assert_eq!(Key::new(1).with(2).value(), mix((Key::new(1).value() ^ 2).wrapping_add(GOLDEN_GAMMA)));
        assert_ne!(Key::new(0).with_text("ab"), Key::new(0).with_text("a").with_text("b"));
    }

    #[test]
    fn one_flipped_bit_of_an_identifier_flips_half_of_the_hash() {
        // Mean of 64 * 512 words of 64 fair bits: 32 with a standard error of 4 / sqrt(32768) = 0.022; 5 of them.
        let mut flipped = 0u64;
        for pixel in 0..512 {
            let key = Key::new(5).with(pixel);
            for bit in 0..64 {
                flipped +=
                    u64::from((key.value() ^ Key::new(5).with(pixel ^ (1 << bit)).value()).count_ones());
            }
        }
        let mean = flipped as f64 / (512.0 * 64.0);
        assert!((mean - 32.0).abs() < 0.11, "{mean} bits");
    }

    #[test]
    fn first_draws_of_neighboring_pixels_are_uniform_and_uncorrelated() {
        let n = 100_000;
        let draws: Vec<f64> = (0..n).map(|pixel| Key::new(11).with(pixel).rng().random::<f64>()).collect();
        let mut counts = [0.0f64; 100];
        for &draw in &draws {
            counts[(draw * 100.0) as usize] += 1.0;
        }
        let expected = n as f64 / 100.0;
        let even = chi_square(&counts, &[expected; 100]);
        even.assert_accepted(1e-6);
        // Nor are they more even than chance.
        assert!(even.p_value < 1.0 - 1e-6, "{even:?}");
        for lag in [1, 2, 64, 640] {
            let products = draws.iter().zip(&draws[lag..]).map(|(a, b)| (a - 0.5) * (b - 0.5));
            let correlation = 12.0 * products.sum::<f64>() / (n as f64 - lag as f64);
            // Standard error 1 / sqrt(n) = 0.0032; five of them.
            assert!(correlation.abs() < 0.016, "lag {lag}: correlation {correlation}");
        }
    }
}
