//! Seeded random numbers, the same on every platform.

use rand::RngExt;
use rand_pcg::Pcg64;

/// One stream of random numbers.
#[derive(Debug, Clone)]
pub struct Random {
    pcg: Pcg64,
}

impl Random {
    /// The stream of a seed and a purpose; streams of different purposes do not depend on one another.
    pub fn new(seed: u64, purpose: &str) -> Self {
        // FNV-1a, 64 bit.
        let stream = purpose.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        Self { pcg: Pcg64::new(u128::from(seed), u128::from(stream)) }
    }

    /// Uniform in 0..1.
    pub fn unit(&mut self) -> f64 {
        self.pcg.random::<f64>()
    }

    /// Uniform in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Log-uniform in `low..high`, both above zero.
    pub fn scale(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }

    /// True with a probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Uniform in `0..count`; 0 where there is nothing to choose from.
    pub fn index(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// One of these.
    pub fn pick<T: Copy, const N: usize>(&mut self, of: [T; N]) -> T {
        of[self.index(N)]
    }

    /// Standard normal (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// Fisher and Yates.
    pub fn shuffle<T>(&mut self, list: &mut [T]) {
        for i in (1..list.len()).rev() {
            list.swap(i, self.index(i + 1));
        }
    }
}
