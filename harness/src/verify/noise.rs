//! Numbers without a pattern, the same on every machine.

/// `count` numbers in [-1, 1), uniform, from SplitMix64 (Steele, Lea and Flood 2014) with `seed`.
pub fn noise(count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    let next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    std::iter::repeat_with(next).take(count).collect()
}

/// A permutation of 0..n that leaves no neighbourhood together, from `seed`.
pub fn shuffled(n: usize, seed: u64) -> Vec<u32> {
    let keys = noise(n, seed);
    let mut order: Vec<u32> = (0..n as u32).collect();
    order.sort_by(|&a, &b| keys[a as usize].total_cmp(&keys[b as usize]));
    order
}
