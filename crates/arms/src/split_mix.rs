//! Chance for simulated arms and networks: the same seed, the same run.

/// splitmix64 (Steele, Lea, Flood 2014). RT: safe.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SplitMix64(u64);

impl SplitMix64 {
    /// From a seed.
    pub(crate) const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in 0..1.
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        (bits >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rolls_are_uniform_and_repeat_with_their_seed() {
        let rolls = |seed| {
            let mut random = SplitMix64::new(seed);
            core::array::from_fn::<f64, 4000, _>(|_| random.unit())
        };
        let first = rolls(7);
        let again = rolls(7);
        let other = rolls(8);
        assert!(first == again && first != other);
        let mean = first.iter().sum::<f64>() / 4000.0;
        // Twenty standard deviations of the mean would be 0.09.
        assert!(
            (mean - 0.5).abs() < 0.02 && first.iter().all(|roll| (0.0..1.0).contains(roll)),
            "{mean}"
        );
    }
}
