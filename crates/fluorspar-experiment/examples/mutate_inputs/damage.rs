//! Damage to files: changes of single bytes, sizes, numbers and ranges.

/// Largest input, bytes.
const MAX_INPUT: usize = 16 << 20;

/// Numbers that look random: SplitMix64.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Below `end`; 0 where that is 0.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        if end == 0 { 0 } else { (self.next() % end as u64) as usize }
    }

    pub(crate) fn one_of<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }

    /// A range of at most `longest` entries.
    fn range(&mut self, length: usize, longest: usize) -> std::ops::Range<usize> {
        let start = self.below(length);
        start..start + self.below(longest.min(length - start) + 1)
    }
}

const SIZES: &[u64] = &[
    0,
    1,
    2,
    7,
    8,
    127,
    128,
    255,
    256,
    0x7fff,
    0x8000,
    0xffff,
    0x1_0000,
    0xff_ffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_fff8,
    0xffff_ffff,
    1 << 32,
    1 << 40,
    i64::MAX as u64,
    1 << 63,
    u64::MAX,
];
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "-1",
    "1e-400",
    "1e308",
    "-1e308",
    "1e999",
    "nan",
    "inf",
    "-inf",
    "9223372036854775807",
    "18446744073709551616",
    "1e5",
    "100000",
    "65536",
    "0.1",
    "\"a\"",
    "[]",
    "{}",
    "true",
    "",
];

/// Changes an input once.
pub(crate) fn change(bytes: &mut Vec<u8>, random: &mut Random, other: &[u8]) {
    let length = bytes.len();
    let at = random.below(length);
    match random.below(12) {
        0 if length > 0 => bytes[at] ^= 1 << random.below(8),
        1 if length > 0 => {
            bytes[at] = *random.one_of(&[0, 1, 0x7f, 0x80, 0xff, b'0', b'9', b',', b'"', b'\n', b'['])
        }
        2 if length > 0 => bytes[at] = random.next() as u8,
        // A size, in either byte order.
        3 | 4 if length > 8 => {
            let value = *random.one_of(SIZES);
            let width = *random.one_of(&[1, 2, 4, 8]);
            let at = random.below(length - 8);
            if random.below(2) == 0 {
                bytes[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
            } else {
                bytes[at..at + width].copy_from_slice(&value.to_be_bytes()[8 - width..]);
            }
        }
        // A number of a text.
        5 | 6 => {
            let is_digit = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
            let Some(start) = (at..length).find(|i| bytes[*i].is_ascii_digit()) else { return };
            let end = (start..length).find(|i| !is_digit(&bytes[*i])).unwrap_or(length);
            bytes.splice(start..end, random.one_of(NUMBERS).bytes());
        }
        7 => bytes.truncate(at),
        8 => drop(bytes.drain(random.range(length, 64))),
        // A range repeated, now and then many times.
        9 => {
            let range = random.range(length, 256);
            let times = *random.one_of(&[1, 1, 2, 10, 1000, 20_000]);
            let part = bytes[range.clone()].repeat(times.min(MAX_INPUT / 2 / (range.len() + 1)));
            bytes.splice(range.end..range.end, part);
        }
        10 if !other.is_empty() => {
            let range = random.range(other.len(), 256);
            let end = (at + range.len()).min(length);
            bytes.splice(at..end, other[range].iter().copied());
        }
        _ => {
            let (one, two) = (random.range(length, 64), random.below(length));
            let part: Vec<u8> = bytes[one].to_vec();
            bytes.splice(two..two, part);
        }
    }
    bytes.truncate(MAX_INPUT);
}

/// Makes the check sums of a PNG right, so that what it says is looked at.
pub(crate) fn repair_png(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes) {
        let end = at + 8 + length as usize;
        let Some(content) = bytes.get(at + 4..end) else { return };
        let bit = |crc: u32, _| (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 };
        let crc = !content.iter().fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), bit));
        let Some(place) = bytes.get_mut(end..end + 4) else { return };
        place.copy_from_slice(&crc.to_be_bytes());
        at = end + 4;
    }
}
