//! Loops over eight numbers at a time, compiled for the processor that runs them.
//!
//! A job written as plain loops over arrays of eight is compiled twice: for any processor, and for those with AVX2, where
//! the compiler makes one instruction of each loop. Neither fuses or reorders operations, so both give the same bits.
#![allow(unsafe_code)] // The call into code for processors that have AVX2.

/// Numbers handled at once.
pub const WIDTH: usize = 8;

/// Eight numbers.
pub type Wide = [f32; WIDTH];

/// Work that gains from wide instructions.
pub trait Job {
    /// What it finds.
    type Out;
    /// Does the work. To be inlined always, with all that it calls: a closure or a function of its own is compiled
    /// without the wide instructions.
    fn run(self) -> Self::Out;
}

/// Does the job in the fastest form that the processor runs.
pub fn run<J: Job>(job: J) -> J::Out {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the feature was found.
        return unsafe { with_avx2(job) };
    }
    job.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<J: Job>(job: J) -> J::Out {
    job.run()
}

/// Σ of eight numbers: halves, quarters, pairs.
#[inline(always)]
pub fn sum(a: Wide) -> f32 {
    ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Mixed<'a>(&'a [Wide]);

    impl Job for Mixed<'_> {
        type Out = Vec<u32>;

        #[inline(always)]
        fn run(self) -> Vec<u32> {
            let mut total = [0.0; WIDTH];
            for row in self.0 {
                for lane in 0..WIDTH {
                    let a = row[lane];
                    total[lane] += (a * a + 0.3).sqrt() / (a - 7.1) - 3.0 * a;
                }
            }
            total.iter().chain([&sum(total)]).map(|v| v.to_bits()).collect()
        }
    }

    #[test]
    fn both_forms_give_the_same_bits() {
        let rows: Vec<Wide> = (0..100)
            .map(|i| std::array::from_fn(|k| ((i * 37 + k * 11) % 101) as f32 * 0.137 - 6.0))
            .collect();
        assert_eq!(run(Mixed(&rows)), Mixed(&rows).run());
    }
}
