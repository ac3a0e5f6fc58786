//! SHA-256 digests as lower-case hexadecimal text, as results state them.

use std::io::{self, Read};

use sha2::{Digest, Sha256};

/// Two lower-case hexadecimal digits per byte.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 of blocks of bytes, 64 lower-case hexadecimal digits.
pub fn sha256_hex(blocks: impl IntoIterator<Item = impl AsRef<[u8]>>) -> String {
    let mut hash = Sha256::new();
    for block in blocks {
        hash.update(block);
    }
    hex(&hash.finalize())
}

/// Little-endian bytes of numbers, to digest them.
pub fn bytes_of(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// SHA-256 of the little-endian bytes of words, 64 lower-case hexadecimal digits: the bits of single-precision numbers, or counts.
pub(crate) fn sha256_of_words(words: impl IntoIterator<Item = u32>) -> String {
    const WORDS: usize = 1 << 12;
    let mut hash = Sha256::new();
    let mut block = Vec::with_capacity(4 * WORDS);
    for word in words {
        block.extend_from_slice(&word.to_le_bytes());
        if block.len() == 4 * WORDS {
            hash.update(&block);
            block.clear();
        }
    }
    hash.update(&block);
    hex(&hash.finalize())
}

/// SHA-256 of everything that can be read, 64 lower-case hexadecimal digits, block by block.
///
/// # Errors
/// What the reader reports.
pub fn sha256_of(mut reader: impl Read) -> io::Result<String> {
    let mut hash = Sha256::new();
    let mut block = vec![0; 1 << 16];
    loop {
        match reader.read(&mut block) {
            Ok(0) => return Ok(hex(&hash.finalize())),
            Ok(count) => hash.update(&block[..count]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_digest_of_the_standard() {
        // FIPS 180-2, appendix B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(super::sha256_hex(["a", "bc"]), expected);
        assert_eq!(super::sha256_of(&b"abc"[..]).unwrap(), expected);
    }

    #[test]
    fn words_are_digested_as_their_bytes() {
        let words: Vec<u32> = (0..10_000_u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        assert_eq!(super::sha256_of_words(words), super::sha256_hex([bytes]));
    }
}
