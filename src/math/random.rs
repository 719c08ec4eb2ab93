//! Counter-based random numbers: a number depends on its index alone, not on earlier calls.
//!
//! *Method*: the finaliser of [steele14]'s SplitMix64 over a mixed key. Symbols: none. Limits: not for secrets.

use super::Vec3;

/// Numbers of one key.
#[derive(Clone, Copy, Debug)]
pub struct Random(u64);

impl Random {
    /// Numbers that differ from those of any other `key`.
    pub fn new(key: [u32; 3]) -> Self {
        let [a, b, c] = key.map(u64::from);
        Self(mix(mix(mix(a.wrapping_add(GOLDEN)) ^ b) ^ c))
    }

    /// The number at `place`: even in [0, 1).
    pub fn at(self, place: u64) -> f32 {
        // 24 bits, as many as a single-precision number between ½ and 1 has.
        let bits = mix(self.0 ^ mix(place.wrapping_mul(GOLDEN).wrapping_add(1))) >> 40;
        bits as f32 / (1_u32 << 24) as f32
    }

    /// The vector at `place`: even in the cube from 0 to 1.
    pub fn vector(self, place: u64) -> Vec3 {
        Vec3::from_fn(|axis, _| self.at(3 * place + axis as u64))
    }
}

/// 2⁶⁴ over the golden ratio.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_even_and_keys_give_others() {
        for key in [[0, 0, 0], [0, 0, 1], [1, 0, 0], [7, 8, 9]] {
            let random = Random::new(key);
            let n = 40_000_u64;
            let mean = (0..n).map(|i| f64::from(random.at(i))).sum::<f64>() / n as f64;
            let square = (0..n).map(|i| f64::from(random.at(i)).powi(2)).sum::<f64>() / n as f64;
            let neighbours =
                (0..n).map(|i| f64::from(random.at(i) * random.at(i + 1))).sum::<f64>() / n as f64;
            assert!((mean - 0.5).abs() < 0.005 && (square - 1.0 / 3.0).abs() < 0.005, "{mean} {square}");
            assert!((neighbours - 0.25).abs() < 0.005, "{neighbours}");
            assert!((0..n).all(|i| (0.0..1.0).contains(&random.at(i))));
        }
        assert_ne!(Random::new([1, 2, 3]).at(0), Random::new([2, 1, 3]).at(0));
    }
}
