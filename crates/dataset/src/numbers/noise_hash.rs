//! Hashes of small integers, for noise that depends only on its place: the same on every machine and thread.

/// A well-mixed 32-bit hash of three numbers (finaliser of MurmurHash3).
pub fn hash(a: u32, b: u32, c: u32) -> u32 {
    let mut h = a.wrapping_mul(0x9E37_79B1)
        ^ b.wrapping_mul(0x85EB_CA77).rotate_left(13)
        ^ c.wrapping_mul(0xC2B2_AE3D).rotate_left(7);
    h = (h ^ (h >> 16)).wrapping_mul(0x85EB_CA6B);
    h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
    h ^ (h >> 16)
}

/// A hash as a number in [0, 1).
pub fn unit_hash(a: u32, b: u32, c: u32) -> f32 {
    (hash(a, b, c) >> 8) as f32 / (1 << 24) as f32
}
