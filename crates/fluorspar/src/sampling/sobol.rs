//! Owen-scrambled Sobol samples addressed by (seed, pixel, sample, dimension).

use super::random::mix;

/// One step of SplitMix64: scatters the bits of a word, zero included.
pub fn hash_u64(value: u64) -> u64 {
    mix(value.wrapping_add(0x9E37_79B9_7F4A_7C15))
}

/// Samples per scrambling: the Sobol sequence of the library repeats beyond this.
const SEQUENCE_LENGTH: u32 = 1 << 16;
/// Sets of four dimensions that the library provides.
const DIMENSION_SETS: u32 = sobol_burley::NUM_DIMENSION_SETS_4D;

/// The random numbers of one path: a pure function of seed, pixel, sample and the order in which they are drawn.
///
/// Sets of four numbers come from a hash-scrambled Sobol sequence (Burley, JCGT 9(4), 2020). Beyond the library's
/// dimensions or 65 536 samples, a new scrambling or hashed random numbers take over, still deterministic.
#[derive(Clone, Debug)]
pub struct SampleStream {
    seed: u64,
    scramble: u32,
    sample: u32,
    set: u32,
}

impl SampleStream {
    /// The stream of one sample of one pixel.
    pub fn new(seed: u64, pixel: u64, sample: u32) -> Self {
        let mixed = hash_u64(hash_u64(seed ^ 0x666C_756F_7273_7061) ^ pixel);
        let epoch = u64::from(sample / SEQUENCE_LENGTH);
        let scramble = hash_u64(mixed ^ epoch) as u32;
        Self { seed: mixed, scramble, sample: sample % SEQUENCE_LENGTH, set: 0 }.with_epoch(epoch)
    }

    fn with_epoch(mut self, epoch: u64) -> Self {
        self.seed = hash_u64(self.seed ^ (epoch << 32));
        self
    }

    /// The next four numbers in `[0, 1)`.
    #[inline]
    pub fn next_4d(&mut self) -> [f32; 4] {
        let set = self.set;
        self.set += 1;
        if set < DIMENSION_SETS {
            return sobol_burley::sample_4d(self.sample, set, self.scramble);
        }
        let base = hash_u64(self.seed ^ (u64::from(self.sample) << 32) ^ u64::from(set));
        let (a, b) = (hash_u64(base), hash_u64(base ^ 0xA5A5_5A5A_C3C3_3C3C));
        [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32].map(unit_interval)
    }
}

/// The 24 high bits as a float in `[0, 1)`.
fn unit_interval(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_reproducible_and_differ_between_pixels() {
        let first = SampleStream::new(1, 7, 3).next_4d();
        assert_eq!(first, SampleStream::new(1, 7, 3).next_4d());
        assert_ne!(first, SampleStream::new(1, 8, 3).next_4d());
        assert_ne!(first, SampleStream::new(2, 7, 3).next_4d());
        assert_ne!(first, SampleStream::new(1, 7, 3 + SEQUENCE_LENGTH).next_4d());
    }

    #[test]
    fn powers_of_two_of_samples_are_stratified() {
        for set in 0..3 {
            let mut counts = [[0_u32; 64]; 4];
            for sample in 0..64 {
                let mut stream = SampleStream::new(9, 5, sample);
                let mut values = [0.0; 4];
                for _ in 0..=set {
                    values = stream.next_4d();
                }
                for (dimension, value) in values.iter().enumerate() {
                    counts[dimension][(value * 64.0) as usize] += 1;
                }
            }
            assert!(counts.iter().flatten().all(|&count| count == 1), "set {set}");
        }
    }

    #[test]
    fn numbers_stay_in_the_unit_interval_beyond_the_last_dimension() {
        let mut stream = SampleStream::new(3, 1, 70_000);
        for _ in 0..DIMENSION_SETS + 50 {
            assert!(stream.next_4d().iter().all(|u| (0.0..1.0).contains(u)));
        }
    }
}
