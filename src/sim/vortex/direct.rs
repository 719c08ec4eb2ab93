//! Direct summation over all pairs.

use super::{
    Vortons,
    kernels::RadialKernel,
    pairs::{self, SUMS, Source, Sums},
};
use crate::{
    math::Vec3,
    par,
    simd::{self, LANES, Lanes, Pass, splat},
};
use std::marker::PhantomData;

/// Targets per task.
const TARGETS_PER_TASK: usize = 64;

/// Vortons that are summed in single precision before the sums are added up in double precision. Smaller
/// blocks are more accurate, at the cost of a conversion each.
const SOURCES_PER_BLOCK: usize = 512;

/// The quantity `Q` that `vortons` induce at `points`.
pub(super) fn rows<K: RadialKernel, const Q: usize, const N: usize>(
    vortons: &Vortons,
    points: &[Vec3],
) -> Vec<[Vec3; N]> {
    let sources: Vec<Source> = (0..vortons.len()).map(|i| Source::new(vortons, i)).collect();
    let mut out = vec![[Vec3::zeros(); N]; points.len()];
    par::for_chunks(&mut out, TARGETS_PER_TASK, |first, out| {
        let points = &points[first..first + out.len()];
        simd::dispatch(DirectSum::<K, Q, N> { points, sources: &sources, out, kernel: PhantomData });
    });
    out
}

struct DirectSum<'a, K, const Q: usize, const N: usize> {
    points: &'a [Vec3],
    sources: &'a [Source],
    out: &'a mut [[Vec3; N]],
    kernel: PhantomData<K>,
}

impl<K: RadialKernel, const Q: usize, const N: usize> Pass for DirectSum<'_, K, Q, N> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (points, out) in self.points.chunks(LANES).zip(self.out.chunks_mut(LANES)) {
            let x = pairs::columns::<L>(|lane| points[lane.min(points.len() - 1)]);
            let mut totals = [[0.0_f64; LANES]; SUMS];
            for sources in self.sources.chunks(SOURCES_PER_BLOCK) {
                let mut sums: Sums<L> = [splat(0.0); SUMS];
                pairs::add_pairs::<L, K, Q>(x, sources, &mut sums);
                for k in 0..SUMS {
                    let row = sums[k].to_array();
                    for lane in 0..LANES {
                        totals[k][lane] += f64::from(row[lane]);
                    }
                }
            }
            for (lane, out) in out.iter_mut().enumerate() {
                let mut sums = [0.0; SUMS];
                for k in 0..SUMS {
                    sums[k] = totals[k][lane] as f32;
                }
                *out = pairs::vectors::<Q, N>(sums);
            }
        }
    }
}
