//! Owen-scrambled Sobol samples addressed by (seed, pixel, sample, set of dimensions).

use super::random::mix;

/// One step of SplitMix64: scatters the bits of a word, zero included.
pub fn hash_u64(value: u64) -> u64 {
    mix(value.wrapping_add(0x9E37_79B9_7F4A_7C15))
}

/// Samples per scrambling: the Sobol sequence of the library repeats beyond this.
const SEQUENCE_LENGTH: u32 = 1 << 16;

/// The random numbers of one path: a pure function of seed, pixel, sample and the number of the set.
///
/// Sets of four numbers are the first four dimensions of a hash-scrambled Sobol sequence (Burley, JCGT 9(4), 2020), each
/// set scrambled and shuffled by itself: higher dimensions of the sequence are less even in pairs at the few samples
/// that a pixel has. The first two numbers of a set are the most even pair, then the last two. Beyond 65 536 samples a
/// new scrambling takes over.
#[derive(Clone, Debug)]
pub struct SampleStream {
    seed: u64,
    sample: u32,
    set: u32,
}

impl SampleStream {
    /// The stream of one sample of one pixel.
    pub fn new(seed: u64, pixel: u64, sample: u32) -> Self {
        let mixed = hash_u64(hash_u64(seed ^ 0x666C_756F_7273_7061) ^ pixel);
        let epoch = u64::from(sample / SEQUENCE_LENGTH);
        Self { seed: hash_u64(mixed ^ epoch), sample: sample % SEQUENCE_LENGTH, set: 0 }
    }

    /// The four numbers in `[0, 1)` of a set.
    #[inline]
    pub fn set_4d(&self, set: u32) -> [f32; 4] {
        sobol_burley::sample_4d(self.sample, 0, hash_u64(self.seed ^ u64::from(set)) as u32)
    }

    /// A random word of the path, independent of its sets of numbers.
    #[inline]
    pub fn word(&self) -> u64 {
        hash_u64(hash_u64(self.seed) ^ u64::from(self.sample))
    }

    /// The next set of four numbers.
    #[inline]
    pub fn next_4d(&mut self) -> [f32; 4] {
        let set = self.set;
        self.set += 1;
        self.set_4d(set)
    }
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

    /// Every 64 samples lie one in each cell of every grid of 64 cells over the first two numbers of a set.
    #[test]
    fn the_first_pair_is_even_in_every_elementary_interval() {
        for set in 0..20 {
            for columns in [1, 2, 4, 8, 16, 32, 64] {
                let mut counts = [0_u32; 64];
                for sample in 64..128 {
                    let [u, v, ..] = SampleStream::new(9, 5, sample).set_4d(set);
                    let (col, row) = ((u * columns as f32) as usize, (v * 64.0 / columns as f32) as usize);
                    counts[row * columns + col] += 1;
                }
                assert_eq!(counts, [1; 64], "set {set}, {columns} columns");
            }
        }
    }

    /// Sets of one path know nothing of each other.
    #[test]
    fn sets_are_uncorrelated() {
        const COUNT: u32 = 4096;
        let numbers: Vec<[f32; 12]> = (0..COUNT)
            .map(|sample| {
                let stream = SampleStream::new(2, 77, sample);
                let sets = [0, 1, 40].map(|set| stream.set_4d(set));
                std::array::from_fn(|i| sets[i / 4][i % 4])
            })
            .collect();
        for a in 0..12 {
            for b in 0..a {
                let product = |n: &[f32; 12]| f64::from(n[a] - 0.5) * f64::from(n[b] - 0.5);
                let correlation = 12.0 * numbers.iter().map(product).sum::<f64>() / f64::from(COUNT);
                // Standard error 1 / sqrt(4096) = 0.016 for independent numbers, 66 pairs: five of them.
                assert!(correlation.abs() < 0.078, "{a}, {b}: {correlation}");
            }
        }
    }

    #[test]
    fn numbers_stay_in_the_unit_interval_beyond_the_first_scrambling() {
        let mut stream = SampleStream::new(3, 1, 70_000);
        for _ in 0..200 {
            assert!(stream.next_4d().iter().all(|u| (0.0..1.0).contains(u)));
        }
    }
}
