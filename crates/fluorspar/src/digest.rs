//! SHA-256 digests as lower-case hexadecimal text, as results state them.

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

#[cfg(test)]
mod tests {
    #[test]
    fn the_digest_of_the_standard() {
        // FIPS 180-2, appendix B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(super::sha256_hex(["a", "bc"]), expected);
    }
}
