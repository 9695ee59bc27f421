//! Numbers of cubes as keys: a hash for them that takes no time. Its order is never looked at.

use std::hash::Hasher;

/// A hash of the numbers of a cube.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CubeHasher(u64);

impl CubeHasher {
    fn mix(&mut self, value: u64) {
        // A large odd number spreads neighbours over all bits; the shift brings the high ones down.
        let mixed = (self.0.rotate_left(23) ^ value).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = mixed ^ (mixed >> 29);
    }
}

impl Hasher for CubeHasher {
    fn finish(&self) -> u64 {
        self.0.wrapping_mul(0xbf58_476d_1ce4_e5b9)
    }

    fn write(&mut self, bytes: &[u8]) {
        for part in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..part.len()].copy_from_slice(part);
            self.mix(u64::from_le_bytes(word));
        }
    }

    fn write_i32(&mut self, value: i32) {
        self.mix(u64::from(value.cast_unsigned()));
    }

    fn write_i64(&mut self, value: i64) {
        self.mix(value.cast_unsigned());
    }

    fn write_usize(&mut self, value: usize) {
        self.mix(value as u64);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::hash::{BuildHasher, BuildHasherDefault};

    use super::*;

    #[test]
    fn neighbouring_cubes_have_different_hashes_in_their_low_and_in_their_high_bits() {
        let hashes: Vec<u64> = (0..40_i64)
            .flat_map(|x| (0..40).flat_map(move |y| (0..40).map(move |z| [x, y, z])))
            .map(|key| BuildHasherDefault::<CubeHasher>::default().hash_one(key))
            .collect();
        let distinct = |shift: u32, bits: u64| {
            hashes
                .iter()
                .map(|h| (h >> shift) & ((1 << bits) - 1))
                .collect::<HashSet<u64>>()
                .len() as f64
        };
        // Of 2^16 values, 64 000 draws by chance leave 1 - exp(-64000/65536) = 62 % seen.
        for shift in [0, 48] {
            let seen = distinct(shift, 16) / 65_536.0;
            assert!((0.58..0.68).contains(&seen), "{shift}: {seen}");
        }
        assert_eq!(distinct(0, 63), 64_000.0);
    }
}
